"""Cases: a flight, its errors of measurement, and what is hidden in it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .noise import NOISES, Noise
from .trajectory import Air


@dataclass(frozen=True)
class Case:
    """What to generate; the seed decides the rest.

    effects: slug -> amplitude, or slug -> {"amplitude": ..., option: ...}, of `physics` and
        `unknown`.
    geometry: see `ground.plan`. strips: along the corridor, 0 for the geometry's own number.
    sortie: strips are shared out among flights in order (`in_turn`), or each flies `all` of them.
    height m, speed m/s, pause_s between flights; forward, side: overlap. beyond_s: photographs go
        on so long before and after each strip.
    width, lines, f: of the camera, px. family: of the lens, `any` for one that is not Fraser's.
    texture_px: rms of what no smooth law describes; Fraser leaves another 0.001 px of the
        families. Both stay below what 60,000 observations of 0.3 px can show; 0.03 px would be an
        effect of its own, and no block with it is a null block.
    calibrated: the camera is stated, and held, at the best Fraser parameters of the twin's lens.
    arms: `free`, or `fixed`: the twin's lever arm is stated and held.
    gnss: `exposures` (positions with their own noise), `interpolated` (from the 1 Hz track, which
        is given too), `track` (that alone) or `none`. gaps: losses of the fix, 6 s each.
    gyro: `images` (a rate each), `rates` (its curve, rates.csv) or `none`: a rolling shutter then
        leaves the rotation of every image as well.
    warmth_c: by how much the camera warms up at last. relief: height of the bank, m.
    observations: of tie points, an image. rays: mean probability that a point is found where it
        lies in a picture. sigma_column: tie_points.csv states the sigma of each observation.
    control, check: numbers of ground points. start_error: sigmas by which start values miss:
        centres m, angles degrees, points m.
    """

    effects: Mapping[str, float | Mapping] = field(default_factory=dict)
    geometry: str = "nadir"
    images: int = 80
    strips: int = 0
    flights: int = 1
    sortie: str = "in_turn"
    height: float = 50.0
    speed: float = 6.0
    forward: float = 0.8
    side: float = 0.6
    azimuth_deg: float = 62.0
    pause_s: float = 400.0
    beyond_s: float = 0.0
    width: int = 5120
    lines: int = 3840
    f: float = 5500.0
    family: str = "any"
    texture_px: float = 0.001
    calibrated: bool = False
    arms: str = "free"
    gnss: str = "exposures"
    gyro: str = "images"
    gaps: int = 0
    row_direction: str = "down"
    warmth_c: float = 15.0
    observations: int = 300
    rays: float = 0.65
    sigma_column: bool = False
    relief: float = 4.0
    control: int = 5
    check: int = 10
    start_error: tuple[float, float, float] = (0.3, 0.3, 0.3)
    noise: Noise = NOISES["everyday"]
    air: Air = field(default_factory=Air)


# For each slug: an amplitude of some 10 to 40 standard deviations with 80 images and everyday
# noise, and what the flight needs so that the effect is there to be found. What it costs on check
# points: nothing where GNSS and control hold the block against it, up to some centimetres.
_TWICE = {"flights": 2, "sortie": "all"}
CATALOGUE: dict[str, tuple[float, dict]] = {
    "rolling_shutter": (0.025, {}),
    "rolling_shutter_rotation": (np.radians(0.6) * 0.025, {"gyro": "none"}),
    "focal": (6.0, {"geometry": "multi_height", "calibrated": True, "arms": "fixed"}),
    "focal_drift": (6.0 / 600, {"geometry": "oblique", **_TWICE}),
    "focal_per_flight": (3.0, {"geometry": "oblique", "arms": "fixed", **_TWICE}),
    "principal_point_drift": (4.0 / 600, {"arms": "fixed", **_TWICE}),
    "principal_point_per_flight": (2.5, {"arms": "fixed", **_TWICE}),
    "thermal": (0.4, {"geometry": "oblique"}),
    "radial_distortion": (2.0, {"calibrated": True}),
    "decentring_distortion": (1.0, {"calibrated": True}),
    "affine_distortion": (3.0, {"calibrated": True, "arms": "fixed"}),
    "sensor_unflatness": (0.5, {"calibrated": True}),
    "lever_arm": (0.06, {"geometry": "oblique", "arms": "fixed"}),
    "lever_arm_per_flight": (0.04, {"geometry": "oblique", "arms": "fixed", **_TWICE}),
    "clock_offset": (0.010, {"geometry": "fixed_yaw"}),
    "time_rounding": (0.03, {}),
    "gnss_bias": (0.08, {"geometry": "oblique"}),
    "gnss_drift": (0.10 / 600, {"geometry": "oblique", **_TWICE}),
    "gnss_scale": (400e-6, {}),
    "control_blunder": (0.08, {"control": 7}),
    "control_datum": (0.08, {"geometry": "oblique"}),
    "earth_curvature": (80.0, {"control": 7}),
    "refraction": (800.0, {"geometry": "oblique"}),
}
OUTSIDE: dict[str, tuple[float, dict]] = {
    "local_bump": (1.5, {}),
    "window": (2.0, {}),
    "jello": (2e-4, {"gyro": "none"}),
    "ground_motion": (0.06, {"control": 11}),
    "ground_creep": (0.10, {"control": 7, **_TWICE}),
    "focus_hunting": (6.0, {"geometry": "oblique"}),
    "camera_step": (4.0, {"arms": "fixed"}),
}
NULLS = ("clean", "outliers", "heavy_tails", "coarse", "coloured_gnss")


def single(slug: str, factor: float = 1.0, **changes) -> Case:
    """One effect at `factor` times its usual amplitude; changes: other fields of the case."""
    amplitude, needs = (CATALOGUE | OUTSIDE)[slug]
    return Case({slug: factor * amplitude}, **(needs | changes))


def together(*slugs: str, factor: float = 1.0, **changes) -> Case:
    """Several effects at once, in a flight that serves them all as well as one flight can."""
    effects, needs = {}, {}
    for slug in slugs:
        amplitude, more = (CATALOGUE | OUTSIDE)[slug]
        effects[slug] = factor * amplitude
        needs |= {k: max(v, needs.get(k, 0)) if k == "control" else v for k, v in more.items()}
    return Case(effects, **(needs | changes))


def null(kind: str, **changes) -> Case:
    """Nothing hidden; kind: one of `NULLS`, or another of `noise.NOISES`."""
    return Case(**({"noise": NOISES[kind]} | changes))


def perfect(case: Case) -> Case:
    """The same without any error of measurement."""
    return replace(case, noise=NOISES["none"])
