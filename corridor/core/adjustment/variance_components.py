"""Adjusted again, where the first result tells that something was assumed which is not so.

Each of these takes a result, and `again`, which adjusts a block, with a model or that of the
first; it gives the result that holds, with a note on what was changed.

Photographs rarely say how good their positions are; whoever imports them assumes one number for
all, as the manual of a receiver has it. Their scatter about the adjusted flight says better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from corridor.core.adjustment.model import Model, Setting, Settings, arms_unseen
from corridor.core.adjustment.result import Adjustment
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError, some
from corridor.core.output import counted
from corridor.core.preparation import derived, record_derived

Again = Callable[..., Adjustment]
# What standard deviations come from that this file has made, as the block records it.
SCATTER = "the residuals of the positions"
# One number of at least so many metres for all positions is an assumption.
_ASSUMED_M = 0.5
# Photographs write their positions to some centimetres.
_LEAST_M = 0.05
# A factor within this is as assumed; beyond, it is estimated again until it changes by less.
_FACTOR, _SETTLED, _ROUNDS = 2.0, 0.2, 4
_LEAST = 8
_IN_PLAN_AND_HEIGHT = (slice(0, 2), slice(2, 3))
# No drone carries its antenna nearly so far from the camera: known no better is not known.
_ARM_M = 2.0
# Residuals as large as they are stated to be say nothing against what is held.
_LARGE_FIT = 1.1
# Sigmas by which an estimate is another one; five, as of outliers.
_FOCAL_SIGMAS = 5.0
# Heat moves a focal length by less than a thousandth; a rolling shutter of 50 ms, which takes it
# along at 5 m/s, by a quarter of a metre of the 50 that a picture shows from as high.
_FOCAL_SHARE = 0.01


def without_false_fixes(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted again without the outliers among the antenna positions, until none is left."""
    rejected: dict[str, float] = {}
    for _ in range(10):
        table = result.residuals["gnss"]
        gone = table[table["outlier"]]
        if not len(gone) or len(gone) > len(table) / 2:
            break
        lengths = np.linalg.norm(gone[["vx", "vy", "vz"]], axis=1)
        rejected |= dict(zip(gone["image"], lengths.tolist(), strict=True))
        block = result.start.copy()
        block.gnss = block.gnss[~block.gnss["image"].isin(list(rejected))].reset_index(drop=True)
        result = again(block)
    if rejected:
        many = counted(len(rejected), "antenna position")
        result.add_note(
            f"{many} rejected as false fix{'es' * (len(rejected) > 1)}, residual up to "
            f"{max(rejected.values()):.2f} m ({some(rejected, 5)})."
        )
    return result


def weighted_by_scatter(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with standard deviations of the antenna positions as they scatter, if assumed.

    The result itself where sigmas were stated one by one, or are good to less than half a metre,
    or within a factor of two of what the residuals say.
    Source: Förstner 1979 (v'Pv / r, each group with its own redundancy).
    """
    stated = result.problem.block.gnss_sigma()
    count = len(result.problem.gnss_image)
    if count < _LEAST or np.ptp(stated, axis=0).any() or np.median(stated[0]) < _ASSUMED_M:
        return result
    sigma = np.array([_scatter(result, rows) for rows in _IN_PLAN_AND_HEIGHT])
    factor = sigma / [stated[0, rows].mean() for rows in _IN_PLAN_AND_HEIGHT]
    if not result.converged or np.all(np.abs(np.log(factor)) < np.log(_FACTOR)):
        return result
    # An arm that these positions cannot show is not to be seen in their scatter either.
    model = result.problem.model
    if model.lever_arm is None and arms_unseen(result.problem.block):
        model = replace(model, lever_arm="fixed")
    # A flight at one height hardly tells the focal length, which flattens heights that positions
    # have: both together run away, a smaller f and positions that fit the better for it.
    held, found = _with_focal_held(result, model), result
    for _ in range(_ROUNDS):
        start, told = _restated(result.start, stated[0], sigma)
        found = _from_where_it_ended(found, start, held, again)
        if not found.converged:
            return result
        before, sigma = sigma, np.array([_scatter(found, rows) for rows in _IN_PLAN_AND_HEIGHT])
        if np.all(np.abs(np.log(sigma / before)) < _SETTLED):
            break
    start, told = _restated(result.start, stated[0], sigma)
    found = _from_where_it_ended(found, start, model, again)
    if not found.converged:
        return result
    found.add_note(told)
    return found


def _with_focal_held(result: Adjustment, model: Model) -> Model:
    """The model with all focal lengths where they start."""
    names = [f"camera.{name}.f" for name in result.start.cameras]
    return replace(
        model,
        priors={name: prior for name, prior in model.priors.items() if name not in names},
        parameters=Settings(
            {**model.parameters, **{name: Setting(vary=False) for name in names}},
        ),
    )


def _restated(start: Block, stated: np.ndarray, sigma: np.ndarray) -> tuple[Block, str]:
    """A block with these sigmas of its positions, in plan and in height, and a word on that."""
    start = start.copy()
    for axis, column in enumerate(("sx", "sy", "sz")):
        start.gnss[column] = sigma[0 if axis < 2 else 1]
    told = (
        f"GNSS: {stated[0]:g} m in plan and {stated[2]:g} m in height are assumed for "
        f"all positions; about the flight they scatter by {sigma[0]:.2g} and {sigma[1]:.2g} m, "
        "which is used. An offset that all of them share is not seen in this."
    )
    record_derived(start, "gnss.sx", SCATTER, sigma, told)
    return start, told


def _from_where_it_ended(
    result: Adjustment, start: Block, model: Model, again: Again
) -> Adjustment:
    """Adjusted with positions and stated arms of `start`, from the poses that were found."""
    ended = result.block.copy()
    ended.gnss, ended.lever_arm, ended.extra = start.gnss, start.lever_arm, start.extra
    found = again(ended, model)
    found.start = start
    return found


def _scatter(result: Adjustment, axes: slice) -> float:
    """Root of v'v / r of the antenna positions along some axes, m."""
    p = result.problem
    table = result.residuals["gnss"]
    v = table[["vx", "vy", "vz"]].to_numpy()[:, axes]
    # What is left of each after the pose has taken its part.
    variance = np.einsum("nii->ni", result.covariance.each_pose)[p.gnss_image, :3][:, axes]
    share = np.clip(1.0 - variance * p.gnss_weight[:, axes], 0.05, 1.0)
    return max(float(np.sqrt(np.sum(v**2) / np.sum(share))), _LEAST_M)


def gnss_of_metres(block: Block) -> bool:
    """Whether all positions may be wrong together by decimetres or metres: the block says so, or
    its standard deviations are of the scatter about the flight, which holds nothing common."""
    scatter = any(one.column == "gnss.sx" and one.source == SCATTER for one in derived(block))
    return scatter or arms_unseen(block)


def without_unseen_arms(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with the lever arms held where nobody asked for them and they are not determined."""
    arms = result.lever_arm
    if not result.problem.arms_free or result.problem.model.lever_arm is not None or not len(arms):
        return result
    sigma = float(np.nanmax(arms[["sx", "sy", "sz"]].to_numpy(float)))
    if not sigma > _ARM_M:
        return result
    model = replace(result.problem.model, lever_arm="fixed")
    found = _from_where_it_ended(result, result.start, model, again)
    if not found.converged:
        return result
    found.add_note(
        f"The lever arm is held at {'what block.toml states' if result.start.lever_arm else '0'}: "
        f"this flight tells it to {sigma:.1f} m only; --lever-arm free estimates it all the same."
    )
    return found


def with_held_focal_asked(result: Adjustment, again: Again) -> Adjustment:
    """The same, with notes on calibrated focal lengths that the measurements contradict.

    Adjusted with these free only where the residuals are larger than their standard deviations
    say. A free lever arm takes up what a wrong focal length does at one flying height: residuals
    are small then, the ground is right, and nothing is said.
    """
    p, model = result.problem, result.problem.model
    held = [
        name
        for name, camera in result.start.cameras.items()
        if camera.calibrated and "f" not in p.free.get(name, ())
    ]
    if not (result.converged and held and result.sigma0 > _LARGE_FIT and result.redundancy > 30):
        return result
    free = {
        name: ",".join(("f", *p.free.get(name, ()))) if name in held else p.free.get(name, ())
        for name in result.start.cameras
    }
    try:
        found = again(result.block, replace(model, camera=free))
    except (InputError, AdjustmentFailed):
        return result
    rows = found.camera[found.camera["parameter"] == "f"].set_index("camera")
    for name in held if found.converged else ():
        stated, f, sigma = result.start.cameras[name]["f"], *rows.loc[name, ["value", "sigma"]]
        off = f - stated
        if abs(off) > max(_FOCAL_SIGMAS * sigma, _FOCAL_SHARE * stated):
            result.add_note(
                f"The focal length of camera {name} is held at {stated:.1f} px; estimated it comes "
                f"to {f:.1f} +- {sigma:.1f} px, {100 * abs(off) / stated:.1f} % "
                f"{'longer' if off > 0 else 'shorter'}, and sigma naught falls from "
                f"{result.sigma0:.2f} to {found.sigma0:.2f}: is it the calibration of another "
                "camera, focus or picture size? `--camera fraser8` estimates the camera."
            )
    return result
