"""Points from the rays of a project."""

from __future__ import annotations

import numpy as np

from corridor.camera import undistort
from corridor.geometry import Rays, meeting_points


def intersected(rows, points: np.ndarray) -> np.ndarray:
    """Coordinates (k, 3) of points (k,) of `Rows`; NaN with fewer than two rays that meet."""
    place = np.full(len(rows.positions), -1)
    place[points] = np.arange(len(points))
    seen = np.flatnonzero(place[rows.point] >= 0)
    image = rows.image[seen]
    ray = undistort(rows.pixels[seen], rows.interior, image)
    good = np.isfinite(ray).all(axis=1)
    rays = Rays(image[good], ray[good], rows.rotation, rows.centre, 1.0 / rows.interior[:, 0])
    return meeting_points(rays, place[rows.point[seen]][good], len(points))
