"""Effects without a mean: noise that changes over time, row or radius, and vibration.

The length of each pseudo-residual, bounded as Student's t bounds it and freed of what few rays
take away, is compared between parts of the flight and of the picture. Images share a good or a
bad day, so that images and not observations are counted. A camera that shakes while its rows are
read moves neighbours in one image together: residuals of a strip of rows then add up to more than
chance would have it.

Source: White 1980 (covariance of a regression whose errors are not alike), clustered by image.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.equations import Equations


def variance_alarms(equations: Equations) -> list[dict]:
    """Quantities with which the image noise changes.

    Each: `quantity` (time, row, radius, vibration), `ratio` of the standard deviations at both
    ends (of vibration: with and without it), `z`, `where` in words and `location` with the keys
    of the diagnosis.
    """
    e, images, rows = equations, equations.system.images, equations.system.image_rows
    r = e.pixels / e.scales.of_observation[:, None]
    length = 0.5 * (r**2).sum(axis=1) / np.maximum(1.0 - 1.5 / rows.multiplicity, 0.2)
    good = rows.tie & (length > 0)
    image, pixel = rows.image[good], rows.xy[good]
    if good.sum() < SETTINGS.fewest_ties or len(np.unique(image)) < SETTINGS.fewest_images:
        return []
    value = np.minimum(length[good], SETTINGS.student_nu + 2.0)
    half = (images.size[image] - 1) / 2
    place = (pixel - half) / half
    axis, sign = images.row_of[image, 0], np.sign(images.row_of[image, 1])
    along = np.where(axis == 1, place[:, 1], place[:, 0]) * sign
    quantities = {"row": along, "radius": np.linalg.norm(place, axis=1)}
    time = images.time[image]
    if np.isfinite(time).all() and np.ptp(time) > 0:
        quantities["time"] = time
    limit = float(-ndtri(0.5 * SETTINGS.alarm_level / (len(quantities) + 1)))
    out = []
    for name, x in quantities.items():
        slope, error = _slope(x, value, image, len(images.names))
        ends = np.quantile(x, [0.02, 0.98])
        level = np.maximum(value.mean() + slope * (ends - x.mean()), 1e-2)
        ratio = float(np.sqrt(level.max() / level.min()))
        z = slope / max(error, 1e-12)
        if abs(z) > limit and ratio > SETTINGS.variance_ratio:
            where = _place(name, z, ends, images)
            out.append({"quantity": name, "ratio": ratio, "z": float(z)} | where)
    bounded = r[good] * np.sqrt(value / length[good])[:, None]
    shaking = _vibration(bounded, along, image, images, limit)
    return out + ([shaking] if shaking else [])


def _slope(x, value, image, count: int) -> tuple[float, float]:
    """Slope of value (n,) on x (n,), and its standard deviation with images as clusters."""
    centre = x - x.mean()
    square = centre @ centre
    slope = float(centre @ value / square)
    left = (value - value.mean() - slope * centre) * centre
    seen = len(np.unique(image))
    # Few clusters: two degrees of freedom went into the line.
    few = seen / max(seen - 2, 1)
    spread = np.bincount(image, left, minlength=count)
    return slope, float(np.sqrt(few * (spread**2).sum()) / square)


def _place(name: str, z: float, ends, images) -> dict:
    """Where the noise is largest, in words and as a location."""
    if name == "time":
        moment = float(ends[int(z > 0)])
        worst = int(np.nanargmin(np.abs(images.time - moment)))
        flight = str(images.flight_names[images.flight[worst]])
        return {
            "where": f"largest at the {'end' if z > 0 else 'beginning'} of the flight, about "
            f"{moment:.0f} s, flight {flight}",
            "location": {"time_s": moment, "flight": flight},
        }
    if name == "row":
        which = "last" if z > 0 else "first"
        return {"where": f"largest in the rows read {which}", "location": {"row": which}}
    width, height = (images.size[0] - 1).tolist()
    if z > 0:
        return {
            "where": "largest at the edges of the picture",
            "location": {"image": [0.0, 0.0, width, height]},
        }
    return {
        "where": "largest in the middle of the picture",
        "location": {"image": [0.25 * width, 0.25 * height, 0.75 * width, 0.75 * height]},
    }


def _vibration(r, along, image, images, limit: float) -> dict | None:
    """Whether residuals (n, 2) of one strip of rows of one image go together more than by chance.

    Under the null hypothesis the squared sum over a strip has the expectation of the sum of the
    squares; poses and points, which follow the noise, make it smaller.
    """
    strips = 2 * max(SETTINGS.places)
    strip = np.clip(((along + 1.0) / 2.0 * strips).astype(int), 0, strips - 1)
    code = image * strips + strip
    size = len(images.names) * strips
    count = np.bincount(code, minlength=size)
    excess, usual = np.zeros(size), np.zeros(size)
    for k in range(2):
        sums = np.bincount(code, r[:, k], size)
        squares = np.bincount(code, r[:, k] ** 2, size)
        # Pairs of different observations alone: wrong matches do not pair.
        excess += sums**2 - squares
        usual += squares
    of_image = np.arange(size) // strips
    total, each = (np.bincount(of_image, part, len(images.names)) for part in (excess, usual))
    pairs = float((usual * (count - 1)).sum())
    if pairs <= 0 or (each > 0).sum() < SETTINGS.fewest_images:
        return None
    # Correlation within a strip, and what images say about how certain it is.
    correlation = total.sum() / pairs
    z = float(total.sum() / max(np.sqrt((total**2).sum()), 1e-12))
    ratio = float(np.sqrt(1.0 / max(1.0 - correlation, 0.01)))
    if z < limit or ratio < SETTINGS.vibration_ratio:
        return None
    worst = int(np.argmax(total))
    name, flight = images.names[worst], str(images.flight_names[images.flight[worst]])
    where = {"row": "all", "flight": flight}
    if np.isfinite(images.time[worst]):
        where["time_s"] = float(images.time[worst])
    many = int((total > 0).sum())
    return {
        "quantity": "vibration",
        "ratio": ratio,
        "z": z,
        "where": f"rows read together move together in {many} of {int((each > 0).sum())} images, "
        f"most in {name}",
        "location": where,
    }
