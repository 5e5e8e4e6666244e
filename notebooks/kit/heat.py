"""The camera of the thermal chapters, and what its heat does to a pylon and to a road."""

from __future__ import annotations

import numpy as np

import corridor
from corridor.core.adjustment import Adjustment, Model, Run, lay_on_control, refit
from corridor.core.block import Block
from corridor.core.simulation import CAMLIGHT, add_noise
from corridor.tools import thermal
from kit.draws import Table
from kit.ring import ring_block


def camlight(width=5120, height=3840, scale=13.7e-6, radial=0.0117, shift=(-0.07, 0.27), bent=0.0):
    """The truth of these chapters, after the thesis's camera: f grows by 0.075 px a degree.

    scale: of the picture, 1/C; bent: its change, 1/C^2. radial, shift: px/C in the corner of, and
    of, a picture 5120 px wide; they shrink with the width.
    """
    part = width / 5120
    return thermal.simple_model(
        width, height, 24.0, (20.0, 55.0), scale=(scale, bent), radial=(radial * part,),
        decentring=(0.0005 * part,), shift=((shift[0] * part, shift[1] * part),),
    )  # fmt: skip


def rms(values) -> float:
    """Root mean square of what is known."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def ties_alone(block: Block, camera: str) -> Adjustment:
    """Adjusted without control; in a simulated block nothing is gross, and all is as stated."""
    return refit(block, Model(camera=camera, control=[]), Run())


def pylon(
    heat,
    tie_px: float,
    closed: bool,
    draw: int,
    camera="fraser8",
    mark_px: float | None = None,
    targets_mm: float = 0.0,
    held_at_c: float | None = None,
    **ring,
) -> np.ndarray:
    """Mean residual at the targets and mean closing error, mm: (2, 2), raw and corrected.

    mark_px: of the targets in the pictures, by default as of tie points; targets_mm: of their given
    coordinates. held_at_c: the camera is that of a calibration at this temperature, and held; what
    is corrected has its own at the model's zero. ring: of `ring_block`. The closing error is that
    of points seen at either end of an open ring.
    """
    perfect = ring_block(closed=closed, seed=draw, **ring)
    noise = {"tie_px": tie_px, "mark_px": mark_px or tie_px, "control_m": targets_mm / 1000}
    seen = add_noise(thermal.uncorrect(perfect, heat)[0], **noise, seed=draw)
    rows = []
    for block, at in ((seen, held_at_c), (thermal.correct(seen, heat)[0], heat.t0_c)):
        if held_at_c is not None:
            block, camera = thermal.calibrated_at(block, heat, at), "fixed"
        adjusted = ties_alone(block, camera)
        laid = lay_on_control(adjusted)
        place = adjusted.points.set_index("point")[["x", "y", "z"]]
        twice = [p for p in place.index if p.endswith("+") and p[:-1] in place.index]
        gap = place.loc[twice].to_numpy() - place.loc[[p[:-1] for p in twice]].to_numpy()
        gap = 1000 * laid.similarity.scale * np.linalg.norm(gap, axis=1)
        rows.append([1000 * laid.control_error.mean(), gap.mean() if twice else np.nan])
    return np.array(rows)


def on_the_road(block: Block, names, model, calibrated_c: float | None = None) -> np.ndarray:
    """Residuals (points,) at ground points, mm, of a flight whose camera is held.

    calibrated_c: temperature of the calibration; None: the heat is taken out first. Ties alone are
    adjusted, then laid on the points.
    """
    if calibrated_c is None:
        block, calibrated_c = thermal.correct(block, model)[0], model.t0_c
    known = thermal.calibrated_at(block, model, calibrated_c)
    return 1000 * lay_on_control(ties_alone(known, "fixed"), names).control_error


def held_by_gnss(block: Block, names, model, calibrated_c: float) -> np.ndarray:
    """Horizontal and height RMS at ground points, mm; GNSS, camera and lever arm held."""
    known = thermal.calibrated_at(block, model, calibrated_c)
    found = corridor.adjust(known, camera="fixed", control=[], check=names, lever_arm="fixed")
    return 1000 * np.array(found.check_rms[:2])


# Column of `pylon`, error of tie points (px) and of given targets (mm): as large as published is
# what is left after the correction.
LOOPS = {"closed": (0, 0.3, 2.0), "open": (1, 0.1, 0.0)}
HELD = {"estimated": None, "held": 35.1}
TIMES = (1, 5, 25, 50)


def _strong(times, loop, camera, seed):
    """The pylon with heat so many times as strong as measured: error, raw and corrected, mm."""
    heat = camlight(
        scale=times * 0.075 / CAMLIGHT["f"], radial=times * 0.0117,
        shift=(-0.07 * times, 0.27 * times),
    )  # fmt: skip
    column, tie, targets_mm = LOOPS[loop]
    found = pylon(heat, tie, loop == "closed", seed, targets_mm=targets_mm, held_at_c=HELD[camera])
    return dict(zip(("raw", "corrected"), found[:, column], strict=True))


STRONG = Table(
    "pylon_heat", ("times", "loop", "camera", "seed"),
    [(t, loop, camera, d) for t in TIMES for loop in LOOPS for camera in HELD for d in range(3)],
    _strong, decimals=3,
)  # fmt: skip
