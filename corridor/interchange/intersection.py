"""Points from rays: least squares of the distances to the rays, then of the image residuals."""

from __future__ import annotations

import numpy as np

from corridor.camera import rotation_from_quaternion, undistort
from corridor.interchange.columns import grouped, in_parts

_PARALLEL = 1e-7  # smallest eigenvalue over the largest: the rays fix no distance


def intersected(rows, points: np.ndarray, steps: int = 4) -> np.ndarray:
    """Coordinates (k, 3) of points (k,) of `Rows`; NaN with fewer than two rays that meet.

    Rays are of images with a pose. The direct solution weighs a ray by nothing, the following
    steps by its distance, which is least squares in the image but for the distortion.
    """
    place = np.full(len(rows.positions), -1)
    place[points] = np.arange(len(points))
    chosen = np.flatnonzero(place[rows.point] >= 0)
    at = place[rows.point[chosen]]
    turn = rotation_from_quaternion(np.nan_to_num(rows.quaternion, nan=1.0))
    found = np.full((len(points), 3), np.nan)
    # Some points at a time: the matrices of all rays at once would fill the memory.
    for part, starts, mine in in_parts(*grouped(at, len(points))):
        seen = chosen[mine]
        image = rows.image[seen]
        rays = undistort(rows.pixels[seen], rows.interior, image)
        good = np.isfinite(rays).all(axis=1) & np.isfinite(rows.centre[image]).all(axis=1)
        image = image[good]
        found[part] = meet(
            turn[image], rows.centre[image], rays[good], (at[mine] - part.start)[good],
            len(starts) - 1, steps,
        )  # fmt: skip
    return found


def meet(
    rotation: np.ndarray,
    centre: np.ndarray,
    rays: np.ndarray,
    point: np.ndarray,
    count: int,
    steps: int = 4,
) -> np.ndarray:
    """Coordinates (count, 3) where rays meet; NaN where fewer than two do.

    rotation (m, 3, 3), centre (m, 3), rays (m, 2), point (m,): one row a ray.
    """
    several = np.bincount(point, minlength=count) >= 2
    # u (r3 . d) = r1 . d and v (r3 . d) = r2 . d with d = P - C are linear in P.
    a = rotation[:, :2] - rays[:, :, None] * rotation[:, 2:3]
    a /= np.linalg.norm(a, axis=2, keepdims=True)
    weight = np.ones(len(point))
    found = np.full((count, 3), np.nan)
    for step in range(steps):
        normal = np.zeros((count, 3, 3))
        right = np.zeros((count, 3))
        # About a near origin: squares of map coordinates would lose the distances.
        origin = np.median(centre, axis=0) if len(centre) else np.zeros(3)
        b = np.einsum("nij,nj->ni", a, centre - origin)
        for i in range(3):
            right[:, i] = np.bincount(point, weight * (a[:, :, i] * b).sum(1), minlength=count)
            for j in range(i, 3):
                normal[:, i, j] = normal[:, j, i] = np.bincount(
                    point, weight * (a[:, :, i] * a[:, :, j]).sum(1), minlength=count
                )
        values = np.linalg.eigvalsh(normal)
        fixed = several & (values[:, 0] > _PARALLEL * values[:, 2])
        found[:] = np.nan
        found[fixed] = np.linalg.solve(normal[fixed], right[fixed][:, :, None])[:, :, 0] + origin
        if step == steps - 1:
            break
        away = found[point] - centre
        depth = np.einsum("nj,nj->n", rotation[:, 2], away)
        # The length of a row before it was made a unit was about 1: depth is the ray's scale.
        weight = np.nan_to_num(1.0 / np.maximum(np.abs(depth), 1e-9) ** 2)
    return found
