"""The cases of `python -m benchmarks.diagnosis`: which effects, how large, in which flights."""

import math

from .cases import CATALOGUE, NULLS, OUTSIDE, Case, null, perfect, single, together
from .generate import generate

__all__ = ["KINDS", "SHORT", "generate", "plan"]

KINDS = ("null", "single", "lookalike", "together", "unknown", "perfect")
SHORT = {"images": 40, "observations": 150}
GEOMETRIES = ("nadir", "oblique", "fixed_yaw", "cross", "multi_height")
# Signal-to-noise ratios that single effects are meant to have; what they have, the twin says.
TARGETS = (7.0, 14.0, 40.0)
# Ratio of the usual amplitude in `SHORT` blocks, by geometry in the order above, measured once.
# Blocks of 80 images and 300 observations have twice that.
_USUAL = {
    "rolling_shutter": (68, 100, 430, 110, 330),
    "rolling_shutter_rotation": (110, 110, 110, 120, 110),
    "focal": (5.7, 25, 7.3, 6.1, 5.8),
    "focal_drift": (8.1, 27, 8.3, 10, 8.8),
    "focal_per_flight": (10, 26, 10, 11, 9.8),
    "principal_point_drift": (16, 30, 15, 20, 16),
    "principal_point_per_flight": (18, 34, 18, 22, 18),
    "thermal": (4.7, 11, 4.6, 10, 6.7),
    "radial_distortion": (67, 88, 71, 72, 60),
    "decentring_distortion": (20, 33, 11, 26, 19),
    "affine_distortion": (9.8, 11, 9.9, 250, 7.8),
    "sensor_unflatness": (44, 63, 34, 57, 39),
    "lever_arm": (14, 26, 1.9, 15, 17),
    "lever_arm_per_flight": (14, 16, 8.9, 19, 17),
    "clock_offset": (1.7, 7.3, 16, 1.5, 1.6),
    "time_rounding": (130, 180, 140, 170, 150),
    "gnss_bias": (9.7, 9.9, 0.56, 8.2, 9.9),
    "gnss_drift": (9.5, 12, 1.7, 18, 10),
    "gnss_scale": (4.0, 3.4, 3.8, 2.0, 2.9),
    "control_blunder": (25, 29, 22, 29, 28),
    "control_datum": (8.3, 8.6, 0.57, 7.6, 9.1),
    "earth_curvature": (4.1, 1.3, 4.0, 2.3, 0.93),
    "refraction": (0.42, 8.2, 0.41, 0.58, 5.0),
}
# An effect that would have to be larger than that is one that the flight cannot show.
_MOST = 8.0
# Amplitudes that happen: all of the earth's curvature forgotten; air that bends rays five times as
# much as the usual one does. Larger ones, which a short flight would need, test nothing.
_HAPPENS = {"earth_curvature": 1.0, "refraction": 5.0}
# In two short flights a change between them is a drift as well.
_APART = {
    slug: {"flights": 3}
    for slug in ("focal_per_flight", "principal_point_per_flight", "lever_arm_per_flight")
}

# Flights over which null blocks are spread, besides everyday noise.
_FLIGHTS = (
    {}, {"geometry": "oblique"}, {"geometry": "fixed_yaw"},
    {"geometry": "cross", "gnss": "interpolated"}, {"geometry": "multi_height"},
    {"calibrated": True, "arms": "fixed"}, {"geometry": "oblique", "calibrated": True},
    {"flights": 2, "sortie": "all"}, {"geometry": "oblique", "flights": 2, "arms": "fixed"},
    {"gnss": "interpolated", "gaps": 1}, {"gyro": "rates"}, {"gyro": "none"},
)  # fmt: skip
# What a flight cannot, or can hardly, tell apart.
_ALIKE = (
    ("clock_offset", {"geometry": "nadir", "arms": "fixed"}),
    ("lever_arm", {"geometry": "nadir"}),
    ("lever_arm", {"geometry": "fixed_yaw"}),
    ("gnss_bias", {"geometry": "oblique"}),
    ("gnss_bias", {"geometry": "nadir", "arms": "fixed"}),
    ("control_datum", {"geometry": "oblique"}),
    ("gnss_drift", {"geometry": "nadir", "flights": 2, "sortie": "all"}),
    ("focal_drift", {"geometry": "nadir", "flights": 2, "sortie": "all"}),
    ("affine_distortion", {"geometry": "cross"}),
    ("rolling_shutter", {"geometry": "cross", "calibrated": True}),
    ("rolling_shutter", {"geometry": "nadir", "calibrated": True, "arms": "fixed"}),
    ("rolling_shutter", {"geometry": "nadir", "arms": "fixed"}),
)
_PAIRS = (
    ("rolling_shutter", "control_blunder"), ("thermal", "gnss_bias"),
    ("rolling_shutter", "gnss_scale"), ("focal", "control_blunder"),
    ("radial_distortion", "rolling_shutter"), ("clock_offset", "sensor_unflatness"),
    ("lever_arm", "decentring_distortion"), ("principal_point_per_flight", "time_rounding"),
    ("gnss_drift", "radial_distortion"), ("focal_per_flight", "control_blunder"),
)  # fmt: skip


def plan(kind: str, count: int | None, seed: int, short: bool):
    """(name, case, seed) of the first `count` blocks of a kind; default: each case once.

    More than there are cases begin again with other seeds.
    """
    cases = _cases(kind, SHORT if short else {})
    chosen = [cases[k % len(cases)] for k in range(len(cases) if count is None else count)]
    return [
        (f"{kind}-{k + 1:03d}-{name}", case, 100_000 * seed + 1_000 * KINDS.index(kind) + k)
        for k, (name, case) in enumerate(chosen)
    ]


def _cases(kind: str, size: dict):
    if kind == "null":
        return [
            (f"{noise}-{flight.get('geometry', 'nadir')}", null(noise, **(size | flight)))
            for flight in _FLIGHTS
            for noise in (*NULLS, "everyday")
        ]
    if kind == "single":
        return [
            _single(slug, GEOMETRIES[(k + n) % 5], TARGETS[(k + n) % 3], size)
            for k in range(len(GEOMETRIES) * len(TARGETS))
            for n, slug in enumerate(CATALOGUE)
        ]
    if kind == "lookalike":
        return [
            (f"{slug}-{changes['geometry']}", single(slug, 2.0, **(size | changes)))
            for slug, changes in _ALIKE
        ]
    if kind == "together":
        return [
            ("+".join(pair), together(*pair, factor=factor, **size))
            for factor in (2.0, 3.0)
            for pair in _PAIRS
        ]
    if kind == "unknown":
        return [
            (f"{slug}-{factor:g}", single(slug, factor, **size))
            for factor in (1.0, 2.0)
            for slug in OUTSIDE
        ]
    return [("nothing", perfect(Case(**size)))] + [
        (slug, perfect(single(slug, **size))) for slug in (*CATALOGUE, *OUTSIDE)
    ]


def _single(slug, geometry, target, size):
    """Every slug meets every geometry with every ratio: 5 and 3 share no divisor."""
    usual = _USUAL[slug][GEOMETRIES.index(geometry)] * (1.0 if size else 2.0)
    most = _HAPPENS.get(slug, math.inf) / CATALOGUE[slug][0]
    factor = min(target / usual, _MOST, most)
    case = single(slug, factor, **(size | _APART.get(slug, {}) | {"geometry": geometry}))
    return f"{slug}-{geometry}-{target:g}", case
