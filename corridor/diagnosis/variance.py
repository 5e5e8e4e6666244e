"""Effects without a mean: noise that grows with time, row or distance from the middle.

The length of each pseudo-residual, bounded as Student's t bounds it and freed of what few rays
take away, is regressed on time, row and radius. Images share a good or a bad day: the test is on
means of images and of cells of the picture, and says only what is large.
"""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.equations import Equations

ALARM = 6.0
LEAST_RATIO = 1.25


def variance_alarms(equations: Equations) -> list[dict]:
    """Quantities with which the image noise changes.

    Each: `quantity` (time, row, radius), `ratio` of the standard deviations at both ends, `z`.
    """
    e, p = equations, equations.problem
    tie = p.row < p.tie_count
    rays = np.repeat(np.diff(p.ptr), np.diff(p.ptr))
    r = e.pixels / e.scales.of_observation[:, None]
    length = 0.5 * (r**2).sum(axis=1) / np.maximum(1.0 - 1.5 / rays, 0.2)
    good = tie & (length > 0)
    if good.sum() < 500:
        return []
    value = np.minimum(length[good], 6.0)
    image, pixel = p.img[good], p.xy[good]
    size = p.images.size[image]
    half = (size - 1) / 2
    place = (pixel - half) / half
    row_of = p.images.row_of[image]
    along = np.where(row_of[:, 0] == 1, place[:, 1], place[:, 0]) * np.sign(row_of[:, 1])
    quantities = {"row": along, "radius": np.linalg.norm(place, axis=1)}
    time = p.images.time[image]
    if np.isfinite(time).all() and np.ptp(time) > 0:
        quantities["time"] = 2.0 * (time - time.min()) / np.ptp(time) - 1.0
    count = np.bincount(image, minlength=p.image_count)
    out = []
    for name, x in quantities.items():
        centre = x - x.mean()
        slope = float(centre @ value / (centre @ centre))
        left = (value - value.mean() - slope * centre) * centre
        # Sandwich: observations of one image are not independent.
        spread = np.bincount(image, left, minlength=len(count))
        error = float(np.sqrt((spread**2).sum()) / (centre @ centre))
        ends = value.mean() + slope * np.array(
            [np.quantile(centre, 0.02), np.quantile(centre, 0.98)]
        )
        ratio = float(np.sqrt(max(ends.max(), 1e-9) / max(ends.min(), 1e-2)))
        z = slope / max(error, 1e-12)
        if abs(z) > ALARM and ratio > LEAST_RATIO:
            out.append({"quantity": name, "ratio": ratio, "z": float(z)})
    return out
