"""Rays bend at the surface of the water: the bed of a river is seen too high.

The surface is a plane at the height `level` of the table [effect.water_refraction] in block.toml,
in the block's coordinates; points above it do not move. With H the height of the camera above the
surface, d the depth of the point below it and R their distance in plan, the ray meets the surface
at the distance r from the camera where, by Snell's law,

    r / sqrt(r^2 + H^2) = n (R - r) / sqrt((R - r)^2 + d^2)

so that the point seems to lie straight above itself, H (R - r) / r below the surface. Straight
below the camera that is d / n: the bed is raised by the share 1 - 1 / n of its depth.

`index` in the same table is the water's index of refraction, if it is known: 1.333 in green light
at 25 degrees Celsius (Hale and Querry 1973). Waves are left out, and so is that a camera which
moves during the readout meets the surface elsewhere.

Source: Dietrich 2017, for rays of several cameras; Hale and Querry 1973 for the index.
"""

import numpy as np

from corridor.core.camera import project, projection_derivatives
from corridor.core.effects.contract import Effect, Parameter

WATER = 1.333


class WaterRefraction(Effect):
    slug = "water_refraction"
    title = "Refraction at the surface of the water, of points below it"
    called = "the refraction at the water's surface"
    place = "image"
    sees_points = True
    needs = ("effect.water_refraction.level",)
    revealed_by = (
        "points of the bed in images from several sides: the higher they seem, the farther from "
        "the nadir they are seen"
    )
    unobservable_when = (
        "points lie above the water, or are seen from nearly straight above: there the bed is "
        "raised by a quarter of its depth and every ray meets in it"
    )
    # Glass raises by a third; what bends more is no water.
    unknowns = [
        Parameter(
            "raised", "1", 0.25, most=1.0 / 3.0,
            text="share of the depth by which the bed seems too high straight below, 1 - 1/n",
        )
    ]  # fmt: skip

    def stated(self, block):
        return {"raised": 1.0 - 1.0 / block.constants.get(self.slug, {}).get("index", WATER)}

    def shift(self, context, values):
        """The pixel of where a point seems to lie, less that of where it lies."""
        level = context.images.constants[self.slug]["level"]
        centre, position, rotation = context.centre, context.position, context.rotation
        height, depth = centre[:, 2] - level, level - position[:, 2]
        wet = (depth > 0.0) & (height > 0.0) & (context.depth > 0.0)
        centre, position, rotation = centre[wet], position[wet], rotation[wet]
        away = np.linalg.norm((position - centre)[:, :2], axis=1)
        index = 1.0 / (1.0 - values[wet, 0])
        rise, by_index = _rise(height[wet], depth[wet], away, index)
        seems = position + rise[:, None] * [0.0, 0.0, 1.0]
        lens = context.images.interior, context.image[wet]
        moved = project(seems, centre, rotation, *lens) - project(position, centre, rotation, *lens)
        by_height = projection_derivatives(seems, centre, rotation, *lens).by_point[:, :, 2]
        shift, derivative = np.zeros((len(context), 2)), np.zeros((len(context), 2, 1))
        shift[wet] = moved
        # dn / draised = n^2
        derivative[wet, :, 0] = (index**2 * by_index)[:, None] * by_height
        return shift, derivative


def _rise(height, depth, away, index):
    """How far points seem to be raised (n,), m, and the derivative by the index of refraction.

    The share s = r / R of the way in plan at which the ray meets the surface, by Newton from the
    ray of paraxial optics; its equation is monotonous, and near a straight line from there on.
    """
    share = index * height / (depth + index * height)
    for _ in range(50):
        value, by_share, _ = _snell(share, height, depth, away, index)
        step = value / by_share
        # Between the ends, whatever Newton says.
        after = np.clip(share - step, 0.5 * share, 0.5 * (1.0 + share))
        moved = np.abs(after - share)
        share = after
        if np.all(moved < 1e-15):
            break
    _, by_share, by_index = _snell(share, height, depth, away, index)
    seems = height * (1.0 - share) / share
    rise = np.where(index == 1.0, 0.0, depth - seems)
    return rise, height / share**2 * (-by_index / by_share)


def _snell(share, height, depth, away, index):
    """Snell's law divided by the distance in plan, and its derivatives by share and index."""
    rest = 1.0 - share
    air = np.hypot(share * away, height)
    water = np.hypot(rest * away, depth)
    value = share / air - index * rest / water
    by_share = height**2 / air**3 + index * depth**2 / water**3
    return value, by_share, -rest / water
