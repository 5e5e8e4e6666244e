"""Whether the surface around a marked point says the same as the point.

A mark that was moved, or measured in another place of the pictures, is seen as displaced by all
images alike: nothing of its own tells that from motion of the ground. The surface around it does,
as far as it goes along the normal: ground that moves takes both along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from corridor.tools.change.joint import displacements
from corridor.tools.change.points import PointChanges
from corridor.tools.change.significance import two_sided
from corridor.tools.change.surface import SurfaceChange

# How far around a point, in radii of a cylinder, the surface is asked; the nearest first.
RINGS = (1.0, 2.0)


@dataclass(frozen=True)
class Contradiction:
    """A point (its number) that moved along the normal of the surface, which within a radius does
    not: both with their standard deviations, m."""

    point: int
    moved: float
    moved_sigma: float
    surface: float
    surface_sigma: float
    radius: float


def contradictions(
    points: PointChanges, surface: SurfaceChange, level: float
) -> list[Contradiction]:
    """The points that seem to move by themselves and that the surface around them contradicts.

    In the mean the surface changes by less than it detects and than half of the point, and the
    difference, in which the errors that both share cancel, is significant at the level, divided
    among all points that could have seemed to move. Two against one: what the next marked point
    says too holds, as on ground that sinks under grass that grows.
    """
    joint, out = surface.joint, []
    clouds, registration = (joint.before, joint.after), surface.registration
    # As the points are, without the motion by which dates are laid together.
    raw, scale = surface.distance, 1.0
    if registration is not None:
        raw, scale = raw + registration.of_motion, registration.scale
    xyz = np.concatenate([cloud.epoch.xyz.ravel() for cloud in clouds])
    asked = np.flatnonzero(points.free & (points.probability < level))
    beside = cKDTree(points.xyz[:, :2]).query(points.xyz[:, :2], min(2, len(points)))[1][:, -1]
    for k in asked:
        if (
            beside[k] in asked
            and beside[k] != k
            and points.shift[beside[k]] @ points.shift[k] > 0.0
        ):
            continue
        away = np.linalg.norm(surface.cores.xyz[:, :2] - points.xyz[k, :2], axis=1)
        for radius in np.multiply(RINGS, surface.cores.radius):
            rows = np.flatnonzero(away < radius)
            if not len(rows):
                continue
            mean = csr_array(np.bincount(rows, minlength=len(away))[None] / len(rows))
            normal = surface.cores.normal[rows].mean(axis=0)
            moved = float(normal @ points.shift[k])
            own = points.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
            around, sigma = float(surface.distance[rows].mean()), surface.sigma_of_sums(mean)[0]
            freedom = np.median(surface.freedom[rows])
            still = two_sided(around / sigma, freedom) > 0.05 and abs(around) < 0.5 * abs(moved)
            lone = csr_array((normal @ displacements(*clouds, [points.names[k]])).reshape(1, -1))
            variance = joint.variance(csr_array(lone - mean @ surface.functions))
            apart = scale * np.sqrt(variance[0] + surface.sampling_of_sums(mean)[0])
            chance = two_sided(((lone @ xyz)[0] - raw[rows].mean()) / apart, freedom)
            if still and chance < level / (points.free.sum() * len(RINGS)):
                sigmas = float(np.sqrt(normal @ own @ normal)), float(sigma)
                out.append(Contradiction(int(k), moved, sigmas[0], around, sigmas[1], radius))
                break
    return out
