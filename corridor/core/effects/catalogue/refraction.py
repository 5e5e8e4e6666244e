"""Rays bend in the air, which is denser below: points are seen too far from the nadir.

    delta = K tan(alpha), K = 7.4e-4 (H - h) (1 - 0.02 (2 H - h)) degrees

alpha is the angle from the nadir, H and h the heights of camera and ground above the sea in km;
standard atmosphere, H up to about 9 km.

Source: Wolf and Dewitt 2000, "Elements of Photogrammetry", chapter 4.
"""

import numpy as np

from corridor.core.camera import ray_derivatives
from corridor.core.effects.contract import LinearEffect, Parameter

# Beyond 80 degrees from the nadir the formula grows without bound, and is wrong.
_FLATTEST = np.cos(np.radians(80.0))


class Refraction(LinearEffect):
    slug = "refraction"
    title = "Refraction of the atmosphere"
    called = "the refraction of the atmosphere"
    place = "image"
    revealed_by = "flights at several kilometres: 0.16 px for a camera of 5,500 px at 3 km"
    unobservable_when = (
        "the drone flies below a few hundred metres; a focal length takes most of it"
    )
    unknowns = [Parameter("fraction", "1", 1.0, text="1: nobody has allowed for it", most=4.0)]

    def derivative(self, context):
        """What the change of the ray that leans away from the nadir by fraction delta moves.

        With the ray's part in plan s and its part downwards n, delta adds K s in plan and
        K s^2 / n upwards.
        """
        images, image = context.images, context.image
        u, v = context.ray.T
        to_camera = context.rotation
        ray = np.einsum("nji,nj->ni", to_camera, np.stack([u, v, np.ones(len(u))], axis=1))
        camera = (context.centre[:, 2] + images.elevation) / 1000.0
        ground = (images.ground + images.elevation) / 1000.0
        constant = 7.4e-4 * (camera - ground) * (1.0 - 0.02 * (2.0 * camera - ground))
        bent = ray.copy()
        down = np.maximum(-ray[:, 2], _FLATTEST * np.linalg.norm(ray, axis=1))
        bent[:, 2] = (ray[:, :2] ** 2).sum(axis=1) / down
        bent *= np.radians(constant)[:, None]
        x, y, z = np.einsum("nij,nj->ni", to_camera, bent).T
        by_ray = ray_derivatives(context.ray, images.interior, image)
        return by_ray @ np.stack([x - u * z, y - v * z], axis=1)[:, :, None]
