"""The readout time of a camera from an ordinary survey flight, or why it does not tell."""

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd

from corridor.core import adjustment as least_squares
from corridor.core.block import Block, read
from corridor.core.camera import Camera
from corridor.core.effects import Effect, Images, every_effect
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import cluster_robust_sigma, sigma_by_test
from corridor.core.output import Progress, telling
from corridor.core.photographs import global_shutter, of_picture, published_readouts
from corridor.core.preparation import prepare, strips_of
from corridor.tools.readout.flight_report import CONTRADICTS, FlightReadout, Left, Turns
from corridor.tools.readout.motion import DELAY_S, motion_of, on_one_clock
from corridor.tools.readout.next_photographs import advice

# The parameter of every effect that has a readout.
READOUT = "readout"
# A readout is told where its sigma is below this share of it, or below so many seconds: then a
# shutter that is nearly global is told as well.
POOR_SHARE, SHORT_S = 0.2, 0.002
LEAST_GROUPS, LEAST_IMAGES = 3, 8
# Speeds in the camera's frame that differ by less than this share are one speed.
ONE_SPEED = 0.1
STANDING_M_S = 0.3
# What is not known of the motion is as large as what is known to differ.
ERRORS_SHARE = 1.0
_FIRST_ITERATIONS, _SETTLED = 40, 1e-5
# What a strip measured that is left out counts a millionth: its images keep their poses.
_LEFT_OUT = 1e3
# The time over which a camera turns during its readout is at least this, s.
_LEAST_S = 0.002


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
    positions; with rates.csv the camera turns as its gyroscope says. What velocities and turns are
    off is estimated with it, by how well they can be known, as in every adjustment
    (`corridor.core.adjustment.uncertain_motion`). Refused, with `reasons`, where it does not tell.
    Raises InputError for a block of several cameras or without velocities, AdjustmentFailed.
    """
    say = telling(progress)
    block, lost = on_one_clock(read(block))
    prepared = prepare(block)
    name = _one_camera(prepared.block)
    motion = motion_of(prepared.block)  # says what is missing before the work
    say("adjusting the block", 0.05, 1.0)
    adjustment = _adjusted(motion.on(prepared.block), loss, max_iterations)
    block, system = adjustment.block, adjustment.system
    row = adjustment.effects[adjustment.effects["parameter"] == READOUT].iloc[0]
    readout, formal = float(row["value"]), float(row["sigma"])
    left = []
    groups = strips_of(block)
    for number, (strip, rows) in enumerate(groups):
        say("leaving out one strip in turn", 0.5 + 0.4 * number / len(groups), 1.0)
        left.append(Left(strip, len(rows), *_without(adjustment, rows)))
    without = [one.readout for one in left], [one.sigma for one in left]
    by_strips, free = cluster_robust_sigma(readout, formal, *without)
    sigma = sigma_by_test(formal, by_strips, free)
    counsel = None
    if advise:
        say("looking for photographs that would help", 0.9, 1.0)
        counsel = advice(adjustment, motion, _number(adjustment), sigma / formal)
    camera = block.cameras[name]
    size, at_once = (camera.width, camera.height), _at_once(camera, model)
    every = published_readouts(model) if model and not at_once else []
    published = tuple(of_picture(every, size))
    eight, eight_sigma = _with_eight(adjustment)
    scale = adjustment.problem.model.motion or least_squares.MotionScale()
    ground = float(np.median(adjustment.state.points[:, 2]))
    height = max(float(np.median(adjustment.state.centre[:, 2])) - ground, 1.0)
    notes = [d.sentence for d in prepared.derived] + prepared.notes + lost
    notes += [note for note in adjustment.notes if "velocit" in note]
    result = FlightReadout(
        camera=name, readout=readout, sigma=sigma, formal=formal, jackknife=by_strips,
        left=tuple(left), eight=eight, eight_sigma=eight_sigma,
        delay=_delay(adjustment, scale.readout) if motion.given else (0.0, 0.0),
        motion=replace(
            motion,
            sigma=least_squares.as_seen(motion.sigma, scale.moved),
            turning=least_squares.as_seen(motion.turning, scale.turned),
        ),
        reasons=(),
        published=published, stated=camera.readout_s, at_once=at_once, advice=counsel,
        place=block.numbers("images", *"xyz"),
        names=tuple(block.images["image"].astype(str)), sigma0=adjustment.sigma0, height=height,
        rows=camera.height if camera.row_direction in ("down", "up") else camera.width,
        notes=tuple(dict.fromkeys(notes)), turns=_turns(adjustment, readout),
    )  # fmt: skip
    in_camera = np.einsum(
        "nij,nj->ni", adjustment.state.rotation, adjustment.problem.images.velocity
    )
    if result.turns:
        in_camera = np.hstack([in_camera, height * result.turns.rate[system.image_order]])
    return judged(result, in_camera)


def _at_once(camera: Camera, model: str) -> str:
    """Who says that all rows of the camera are exposed at once; empty where nobody does."""
    if camera.readout_s is not None:
        return "" if camera.readout_s else camera.extra.get("readout_from", "block.toml")
    # The photographs themselves, where they were asked, say more than the model.
    known = None if "readout_from" in camera.extra else global_shutter(model)
    return str(known) if known else ""


# Which effects of the catalogue tell a readout: by what they act on and need, not by name.


def shutter(block: Block) -> Effect:
    """What moves the camera during the readout as its velocity says, for one readout time.

    With rates.csv: what turns it as the gyroscope says, too.
    """
    motions = (one for one in every_effect() if one.place == "motion" and one.during_readout)
    forms = [one.form(block) for one in motions]
    turned = [o for o in forms if o.needs_table("rates") and "images.vx" in o.takes]
    return (turned or [one for one in forms if "images.vx" in one.needs])[0]


@cache
def late_clock() -> Effect:
    """What moves antenna positions as the velocity says: they are late."""
    late = (one for one in every_effect() if one.place == "antenna" and one.group == "block")
    return next(one for one in late if "images.vx" in one.needs)


def _number(adjustment: least_squares.Adjustment) -> int:
    """Of the readout among what images share."""
    unknowns = adjustment.problem.unknowns
    return next(n for n, one in enumerate(unknowns) if one.kind == "effect" and one.name == READOUT)


def _without(adjustment: least_squares.Adjustment, rows: np.ndarray) -> tuple[float, float]:
    """Readout and formal sigma without what some images (rows of images.csv) saw: one step."""
    system, number = adjustment.system, _number(adjustment)
    seen = system.image_rows
    gone = np.isin(system.image_order, rows)[seen.image]
    part = system.measuring(sigma=np.where(gone, _LEFT_OUT * seen.sigma, seen.sigma))
    at = int(part.columns.shared_at[number])
    right = np.zeros((len(part.right), 2))
    right[:, 0], right[at, 1] = part.right, 1.0
    found = part.solve(right)[at]
    readout = float(part.columns.shared_value[number] + found[0])
    return readout, float(adjustment.sigma0 * np.sqrt(found[1]))


def _with_eight(adjustment: least_squares.Adjustment) -> tuple[float, float]:
    """Readout and formal sigma where b1 and b2 are zero: the conditional expectation."""
    covariance, system = adjustment.covariance.shared, adjustment.system
    number, unknowns = _number(adjustment), adjustment.problem.unknowns
    affine = [n for n, one in enumerate(unknowns) if one.kind == "camera" and one.name[0] == "b"]
    gain = np.linalg.solve(covariance[np.ix_(affine, affine)], covariance[affine, number])
    value = system.columns.shared_value
    variance = covariance[number, number] - gain @ covariance[affine, number]
    readout = float(value[number] - gain @ value[affine])
    return readout, float(adjustment.sigma0 * np.sqrt(variance))


def _delay(adjustment: least_squares.Adjustment, readout: float) -> tuple[float, float]:
    """By which given velocities were written late, s, and its sigma: their common error."""
    p, system = adjustment.problem, adjustment.system
    for n, one in enumerate(p.unknowns):
        if one.owner in p.beside:
            share = DELAY_S / readout
            sigma = adjustment.sigma0 * np.sqrt(adjustment.covariance.shared[n, n])
            return float(share * system.columns.shared_value[n]), float(share * sigma)
    return 0.0, 0.0


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
    camera = block.cameras[_one_camera(block)]
    if camera.too_short:
        raise AdjustmentFailed(
            f"the flight does not determine the focal length, which comes out as {camera['f']:.0f} "
            "px: photograph from a second height or obliquely, or add control points"
        )
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
    half = max(abs(readout), _LEAST_S) / 2
    turn, _, _ = images.gyroscope.turn(images.record, images.time - half, images.time + half)
    text = {one.name: one.text for one in effect.parameters(block)}
    table = adjustment.effects
    beside = table[(table["slug"] == effect.slug) & (table["parameter"] != READOUT)]
    estimated = tuple(
        (f"{row.parameter} {text[row.parameter]}".strip(), row.value, row.sigma, row.unit)
        for row in beside.itertuples(index=False)
    )
    return Turns(turn / (2 * half), estimated)


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
    if found.at_once and abs(found.readout) > CONTRADICTS * found.sigma:
        yield (
            f"All rows of this camera are exposed at once ({found.at_once}), so that "
            f"{1000 * found.readout:.1f} ms is no readout time: velocities, time stamps, or the "
            "lens look like one, or the electronic shutter took the pictures."
        )
    elif found.readout < -CONTRADICTS * found.sigma:
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
    """Why what is not known of the motion is as large as what is known to differ; else nothing.

    Errors of velocities and turns that nobody wrote down are estimated beside the readout; where
    they are as large as all that differs between the images, how they are distributed decides.
    """
    spread = _spread(in_camera)
    errors = float(np.median(np.linalg.norm(found.motion.sigma, axis=1)))
    if not found.motion.given and errors > ERRORS_SHARE * spread:
        return (
            f"The {_known(found)} ({found.motion.source}) differ between the images by "
            f"{spread:.2g} m/s in the camera's frame and are known to {errors:.2g} m/s: what "
            "differs may be their errors."
        )
    turning = float(np.median(np.linalg.norm(found.motion.turning[:, :2], axis=1)))
    if found.turns is None and found.height * turning > ERRORS_SHARE * spread:
        return (
            f"The camera turned by about {np.degrees(turning):.2g} degrees a second while it was "
            f"read, which moves its rows like {found.height * turning:.1f} m/s, and no angular "
            f"rates are given; the velocities differ by {spread:.2g} m/s only: give rates.csv."
        )
    return ""


def _known(found: FlightReadout) -> str:
    return "velocities and turns" if found.turns else "velocities"


def _spread(in_camera: np.ndarray) -> float:
    """Standard deviation of the velocities (m, 3), or motions (m, 6), between the images, m/s."""
    return float(np.sqrt(np.var(in_camera, axis=0).sum()))
