"""The readout time of a camera from an ordinary survey flight, or why it does not tell."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core import adjustment as least_squares
from corridor.core.block import Block, read
from corridor.core.effects import Images
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import by_contrasts, honest
from corridor.core.output import Progress, telling
from corridor.core.photographs import of_picture, published_readouts
from corridor.core.preparation import strips_of
from corridor.tools.readout.flight_report import CONTRADICTS, FlightReadout, Left, Turns
from corridor.tools.readout.motion import motion_of, on_one_clock, with_velocities
from corridor.tools.readout.next_photographs import advice
from corridor.tools.readout.row_motion import LEAST_S, READOUT, RowMotions, late_clock, shutter

# A readout is told where its sigma is below this share of it, or below so many seconds: then a
# shutter that is nearly global is told as well.
POOR_SHARE, SHORT_S = 0.2, 0.002
LEAST_GROUPS, LEAST_IMAGES = 3, 8
# Speeds in the camera's frame that differ by less than this share are one speed.
ONE_SPEED = 0.1
STANDING_M_S = 0.3
ERRORS_SHARE = 0.3
_FIRST_ITERATIONS, _SETTLED = 40, 1e-5


def readout_from_flight(
    block: Block | str | os.PathLike,
    *,
    model: str = "",
    loss: str = "huber:3",
    max_iterations: int = 200,
    advise: bool = True,
    progress: Callable[[Progress], None] | None = None,
) -> FlightReadout:
    """Readout time of the camera of an ordinary survey, with a sigma that holds.

    block: one camera; with velocities, or what they can be derived from (`corridor.prepare`).
    model: make and model of the camera, for published values. loss, max_iterations: of `adjust`.
    advise: look which four photographs more would tell it. progress: called with a
    `Progress` whose `done` is a share.

    The block is adjusted with ten camera parameters, one readout and, with GNSS, the delay of its
    positions; with rates.csv the camera turns as its gyroscope says. See `row_motion` for how the
    velocities' errors count. Refused, with `reasons`, where it does not tell.
    Raises InputError for a block of several cameras or without velocities, AdjustmentFailed.
    """
    say = telling(progress)
    block, lost = on_one_clock(read(block))
    prepared = with_velocities(block)
    block = prepared.block
    name = _one_camera(block)
    motion_of(block)  # says what is missing before the work
    say("adjusting the block", 0.05, 1.0)
    adjustment = _adjusted(block, loss, max_iterations)
    motion = motion_of(adjustment.block)
    say("weighing the velocities", 0.4, 1.0)
    equations = RowMotions.of(adjustment, motion)
    found, unstated = equations.best()
    eight = equations.told(found.readout, unstated, affine=False)
    left = []
    groups = strips_of(adjustment.block)
    for number, (strip, rows) in enumerate(groups):
        say("leaving out one strip in turn", 0.5 + 0.4 * number / len(groups), 1.0)
        one = equations.without(rows).told(found.readout, unstated)
        left.append(Left(strip, len(rows), one.readout, one.sigma))
    without = [one.readout for one in left], [one.sigma for one in left]
    by_strips, free = by_contrasts(found.readout, found.sigma, *without)
    sigma = honest(found.sigma, by_strips, free)
    counsel = None
    if advise:
        say("looking for photographs that would help", 0.9, 1.0)
        counsel = advice(adjustment, motion, found.readout, unstated, sigma / found.sigma)
    camera = block.cameras[name]
    size = camera.width, camera.height
    result = FlightReadout(
        camera=name, readout=found.readout, sigma=sigma, formal=found.sigma, jackknife=by_strips,
        left=tuple(left), eight=eight.readout, eight_sigma=eight.sigma, unstated=unstated,
        delay=(found.delay, found.delay_sigma), motion=motion, reasons=(),
        published=tuple(of_picture(published_readouts(model), size)) if model else (),
        stated=camera.readout_s, advice=counsel,
        place=np.stack([adjustment.block.column("images", axis) for axis in "xyz"], axis=1),
        names=tuple(adjustment.block.images["image"].astype(str)), sigma0=adjustment.sigma0,
        rows=camera.height if camera.row_direction in ("down", "up") else camera.width,
        notes=tuple(dict.fromkeys([d.sentence for d in prepared.derived] + prepared.notes + lost)),
        turns=_turns(adjustment, found.readout),
    )  # fmt: skip
    in_camera = np.einsum("nij,nj->ni", adjustment.state.rotation, equations.motion.velocity)
    if result.turns:
        seen = equations.height * result.turns.rate[equations.system.image_order]
        in_camera = np.hstack([in_camera, seen])
    return judged(result, in_camera)


def _one_camera(block: Block) -> str:
    used = list(dict.fromkeys(block.images["camera"].astype(str)))
    if len(used) != 1:
        raise InputError(
            f"the images are of {len(used)} cameras ({', '.join(used)}), and a readout time is "
            "that of one: give a block with the images of one camera"
        )
    return used[0]


def _adjusted(block: Block, loss: str, max_iterations: int) -> least_squares.Adjustment:
    """Adjusted with one readout; gross errors, which the loss follows slowly, are left out."""
    effects = [shutter(block), *([late_clock()] if len(block.gnss) else [])]
    model = least_squares.Model(camera=least_squares.REFERENCE_CAMERA, effects=effects, loss=loss)
    found = least_squares.adjust(block, model=model, max_iterations=_FIRST_ITERATIONS)
    ties = found.residuals["tie"]
    wrong = pd.MultiIndex.from_frame(ties.loc[ties["gross"], ["point", "image"]].astype(str))
    block = found.block
    if len(wrong):
        all_ties = pd.MultiIndex.from_frame(block.tie_points[["point", "image"]].astype(str))
        block.tie_points = block.tie_points[~all_ties.isin(wrong)].reset_index(drop=True)
    if len(wrong) or not found.converged:
        found = least_squares.adjust(block, model=model, max_iterations=max_iterations)
    if not found.converged and not _settled(found):
        slugs = ", ".join(effect.slug for effect in effects)
        raise AdjustmentFailed(
            f"the adjustment with {slugs} did not converge in {max_iterations} iterations: look at "
            "`corridor adjust` of this block first"
        )
    return found


def _turns(adjustment: least_squares.Adjustment, readout: float) -> Turns | None:
    """How the camera turned, where the adjustment's shutter takes it from rates.csv."""
    block = adjustment.block
    effect, images = shutter(block), Images.of(block)
    if not effect.needs_table("rates"):
        return None
    half = max(abs(readout), LEAST_S) / 2
    turn, _, _ = images.gyroscope.turn(images.record, images.time - half, images.time + half)
    text = {one.name: one.text for one in effect.parameters(block)}
    table = adjustment.effects
    beside = table[(table["slug"] == effect.slug) & (table["parameter"] != READOUT)]
    return Turns(
        rate=turn / (2 * half),
        estimated=tuple(
            (f"{row.parameter} {text[row.parameter]}".strip(), row.value, row.sigma, row.unit)
            for row in beside.itertuples(index=False)
        ),
    )


def _settled(found: least_squares.Adjustment) -> bool:
    """Whether the last iterations gained next to nothing: a step of least squares does the rest."""
    cost = [step["cost"] for step in found.history[-2:]]
    return len(cost) == 2 and abs(cost[0] - cost[1]) < _SETTLED * cost[1]


def judged(found: FlightReadout, in_camera: np.ndarray) -> FlightReadout:
    """The result with the reasons why the flight does not tell.

    in_camera (m, 3): velocities, m/s; (m, 6) with turns: the angular rates times the height, too.
    """
    return replace(found, reasons=tuple(_reasons(found, in_camera)))


def _reasons(found: FlightReadout, in_camera: np.ndarray) -> Iterator[str]:
    images = len(found.names)
    if images < LEAST_IMAGES or len(found.left) < LEAST_GROUPS:
        yield (
            f"{images} images in {len(found.left)} strips are too few to tell an error of the "
            "flight from a readout time."
        )
    swamped = _swamped(found, in_camera)
    if found.sigma > max(POOR_SHARE * abs(found.readout), SHORT_S):
        why = _why_uncertain(found, in_camera, swamped)
        yield f"The readout time is known to {1000 * found.sigma:.1f} ms only: {why}"
    elif swamped:
        yield swamped
    if found.readout < -CONTRADICTS * found.sigma:
        yield (
            f"The readout time comes out negative ({1000 * found.readout:.1f} ms): rows are read "
            "the other way than row_direction of block.toml says, the pictures were turned, or the "
            f"{_known(found)} are wrong."
        )
    if abs(found.eight - found.readout) > CONTRADICTS * found.sigma:
        yield (
            f"Eight and ten camera parameters disagree: {1000 * found.eight:.1f} and "
            f"{1000 * found.readout:.1f} ms, so that what looks like a shutter may be the lens."
        )
    if abs(found.readout) <= CONTRADICTS * found.sigma and not found.motion.measured:
        yield (
            "No motion of the rows is seen, and the velocities were derived from where the "
            "photographs were taken: the shutter is global, or the drone stood still at each "
            "exposure."
        )


def _why_uncertain(found: FlightReadout, in_camera: np.ndarray, swamped: str) -> str:
    speed = float(np.median(np.linalg.norm(in_camera, axis=1)))
    spread = _spread(in_camera)
    if speed < STANDING_M_S:
        return (
            f"the drone stood still at most exposures, say its velocities ({found.motion.source})."
        )
    if spread < ONE_SPEED * speed:
        alike = "moved and turned alike" if found.turns else "were taken at one speed"
        return (
            f"all images {alike} in the camera's frame ({speed:.1f} m/s, differing "
            f"by {spread:.2g} m/s), and then poses, ground and lens do what a shutter does."
        )
    if swamped:
        return swamped[0].lower() + swamped[1:]
    if found.jackknife > 2 * found.formal:
        low, high = (f(found.left, key=lambda one: one.readout) for f in (min, max))
        return (
            f"it depends on single strips ({1000 * low.readout:.1f} ms without {low.strip}, "
            f"{1000 * high.readout:.1f} ms without {high.strip})."
        )
    return (
        f"too few images differ in their {'motion' if found.turns else 'velocity'} for what their "
        f"points can tell ({_known(found)} differ by {spread:.1f} m/s)."
    )


def _swamped(found: FlightReadout, in_camera: np.ndarray) -> str:
    """Derived velocities that differ by little more than their errors attenuate the readout.

    By the square of the share (Fuller 1987, section 1.1): a tenth at ERRORS_SHARE.
    """
    spread = _spread(in_camera)
    errors = float(np.median(np.linalg.norm(found.motion.sigma, axis=1)))
    if found.motion.given or errors <= ERRORS_SHARE * spread:
        return ""
    return (
        f"The {_known(found)} ({found.motion.source}) differ between the images by {spread:.2g} "
        f"m/s in the camera's frame and are known to {errors:.2g} m/s: what differs may be their "
        "errors."
    )


def _known(found: FlightReadout) -> str:
    return "velocities and turns" if found.turns else "velocities"


def _spread(in_camera: np.ndarray) -> float:
    """Standard deviation of the velocities (m, 3), or motions (m, 6), between the images, m/s."""
    return float(np.sqrt(np.var(in_camera, axis=0).sum()))
