"""Adjusted again, where the first result tells that something was assumed which is not so.

Each of these takes a result, and `again`, which adjusts a block, with a model or that of the
first; it gives the result that holds, with a note on what was changed.

Photographs rarely say how good their positions are; whoever imports them assumes one number for
all, as the manual of a receiver has it. Their scatter about the adjusted flight says better.
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from corridor.core.adjustment.cofactors import shares_of_antennas
from corridor.core.adjustment.false_positions import false_apart
from corridor.core.adjustment.model import (
    Model,
    ParameterSettings,
    Setting,
    arms_unseen,
    listed_effects,
)
from corridor.core.adjustment.result import Adjustment, Again, from_where_it_ended, where_it_leads
from corridor.core.adjustment.uncertain_motion import MotionScale
from corridor.core.adjustment.variance_components import (
    AXES,
    CONTRADICTING_FACTOR,
    RARE_CHANCE,
    Slow,
    components,
    contradicting,
    general,
    restate,
    slow,
)
from corridor.core.adjustment.warnings import FAR_SIGMAS
from corridor.core.block import Block, turned, values_of
from corridor.core.effects import every_effect
from corridor.core.geometry import OUTLIER
from corridor.core.preparation import derived, record_derived

# What standard deviations come from that this file has made, as the block records it.
SCATTER = "the residuals of the positions"
# Photographs write their positions to a centimetre, or to 1e-7 degrees, which is as much.
_LEAST_M = 0.01
# A factor within this is as assumed; beyond, it is estimated again until it changes by less.
_SETTLED, _ROUNDS = 0.1, 4
# Gauss-Newton is quadratic: 1, 0.1, 0.01 and less of what it has to go.
_FEW_STEPS = 4
_FEWEST = 8
# An offset that all other observations take up but for this share of its information is not shown.
_SEEN = 1e-4
# An offset may be so many times as large as it is stated, or first seen, to be.
_PRIOR = 3.0
# No drone carries its antenna nearly so far from the camera: known no better is not known.
_ARM_M = 2.0
# Residuals as large as they are stated to be say nothing against what is held.
_LARGE_FIT = 1.1
# Sigmas by which an estimate is another one; five, as of outliers.
_FOCAL_SIGMAS = 5.0
# Heat moves a focal length by less than a thousandth; a rolling shutter of 50 ms, which takes it
# along at 5 m/s, by a quarter of a metre of the 50 that a picture shows from as high.
_FOCAL_SHARE = 0.01
# Sigma naught of what positions may bend; the share of redundancy that leaves their residuals a
# tenth of their errors; by what they are loosened: millimetres taken for centimetres or metres.
_BENT, _TIGHT, _LOOSE = 1.25, 0.1, 100.0
# Below this a readout scales no error of a velocity any more: a global shutter, s.
_LEAST_S = 0.002
# A scale of uncertain motion that changes by less is the same; it settles within some rounds.
_SAME, _MOTION_ROUNDS = 0.1, 4
# The stated deviations of velocities count as one of their own beside what the pictures say of
# their size: a flight of few pictures cannot say it.
_STATED_COUNTS = 1.0
_TURNS = ("turn_x", "turn_y", "turn_z")


def weighted_by_scatter(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with standard deviations of the antenna positions as they scatter, if assumed.

    Coarse ones, too coarse to see a lever arm, are taken for assumed: what somebody measured to
    decimetres is told by the images. The result itself where they are finer, or within a factor of
    two of what the residuals say. The scatter is about the mean of each flight, in the world and in
    the camera, so that no lever arm is in it; where it turns out fine enough to see the arms,
    these are estimated, as of positions that are stated so.
    Source: Förstner 1979 (v'Pv / r, each group with its own redundancy).
    """
    count = len(result.problem.gnss_image)
    if count < _FEWEST or not result.converged or not arms_unseen(result.problem.block):
        return result
    stated = result.problem.block.gnss_sigma()
    factor = _scatter(result)
    if np.all(np.abs(np.log(factor)) < np.log(CONTRADICTING_FACTOR)):
        return result
    model = result.problem.model
    # A flight at one height hardly tells the focal length, which flattens heights that positions
    # have: both together run away, a smaller f and positions that fit the better for it.
    held, found = _with_focal_held(result, model), result
    for _ in range(_ROUNDS):
        start, told = _restated(result.start, stated, factor)
        # From where it was it moves by hundredths of its sigmas in some steps; the rest of the way
        # to its end, along what nothing determines, changes no residual to speak of.
        found = from_where_it_ended(found, start, held, again, steps=_FEW_STEPS)
        change = _scatter(found)
        factor = _at_least(factor * change, stated)
        if np.all(np.abs(np.log(change)) < _SETTLED):
            break
    start, told = _restated(result.start, stated, factor)
    found = from_where_it_ended(found, start, model, again)
    if not found.converged:
        return result
    found.add_note(told)
    return found


def _with_focal_held(result: Adjustment, model: Model) -> Model:
    """The model with all focal lengths where they start."""
    names = [f"camera.{name}.f" for name in result.start.cameras]
    return replace(
        model,
        priors={name: prior for name, prior in (model.priors or {}).items() if name not in names},
        parameters=ParameterSettings(
            {**model.parameters, **{name: Setting(vary=False) for name in names}}
        ),
    )


def _restated(start: Block, stated: np.ndarray, factor: np.ndarray) -> tuple[Block, str]:
    """A block with its sigmas (k, 3) of positions times a factor in plan and in height, and a word
    on that."""
    start, sigma = start.copy(), stated.copy()
    sigma[:, :2] *= factor[0]
    sigma[:, 2] *= factor[1]
    start.put("gnss", ("sx", "sy", "sz"), sigma)
    usual, used = np.median(stated, axis=0), np.median(sigma, axis=0)
    told = (
        f"GNSS: {usual[0]:g} m horizontally and {usual[2]:g} m in height are assumed for "
        f"all positions; about the flight they scatter by {used[0]:.2g} and {used[2]:.2g} m, "
        "which is used. An offset that all of them share is not seen in this."
    )
    record_derived(start, "gnss.sx", SCATTER, used[[0, 2]], told)
    return start, told


def _at_least(factor: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """Factors that leave no standard deviation below what positions are written to."""
    return np.maximum(factor, _LEAST_M / np.median(stated, axis=0)[[0, 2]])


def _scatter(result: Adjustment) -> np.ndarray:
    """Root of v'v / r (2,) of the antenna positions in plan and in height, in their sigmas.

    About the mean of each flight: what its positions share in the world or, where the arms are
    held, in the camera's frame is an offset or an arm.
    """
    p = result.problem
    table = result.residuals["gnss"]
    root = np.sqrt(p.gnss_weight)[:, :, None] * p.gnss_turn
    v = turned(root, values_of(table, "vx", "vy", "vz"))
    share = shares_of_antennas(result.covariance)
    left = np.empty_like(v)
    to_world = result.state.rotation[p.gnss_image].transpose(0, 2, 1)
    flight = p.images.flight[p.gnss_image]
    for one in np.unique(flight):
        mine = flight == one
        own = root[mine]
        shared = [own] if p.arms_free else [own, own @ to_world[mine]]
        design = np.concatenate(shared, axis=2).reshape(3 * mine.sum(), -1)
        found, _, rank, _ = np.linalg.lstsq(design, v[mine].ravel(), rcond=1e-6)
        left[mine] = (v[mine].ravel() - design @ found).reshape(-1, 3)
        # Freedom that the shared part has taken.
        share[mine] *= max(1.0 - rank / (3.0 * mine.sum()), 0.0)
    free = [max(np.sum(share[:, a]), 0.05 * share[:, a].size) for a in AXES.values()]
    factor = [
        np.sqrt(np.sum(left[:, a] ** 2) / r) for a, r in zip(AXES.values(), free, strict=True)
    ]
    return _at_least(np.array(factor), p.gnss_weight**-0.5)


def with_gnss_as_it_is(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with the standard deviations that antenna positions have, where these contradict
    what is stated, and notes on that; the result itself where they do not.

    A block of false positions of a flight is weighted apart from the rest.
    """
    notes: list[str] = []
    found = _unbent(result, again)
    doubtful = contradicting(found)
    if doubtful:
        found = false_apart(found, again, sorted({flight for _, flight in doubtful}), notes)
    for _ in range(_ROUNDS):
        doubtful = contradicting(found)
        if not doubtful:
            break
        found = _scaled(found, doubtful, again)
        if not found.converged:
            return result
        if max(abs(np.log(f)) for f in doubtful.values()) < _SETTLED:
            break
    if found is not result:
        notes += _told(result, found)
    lasting = slow(found)
    if lasting is not None:
        later = _scaled(found, lasting.factor, again)
        if later.converged:
            notes.append(_told_slow(lasting, found.start))
            found = later
    if found is result:
        return result
    found.add_note(*notes)
    return found


def _unbent(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with positions as they scatter about images that need not follow them, where these
    then fit as much better as if all positions had been outliers; else the result itself.

    Positions whose standard deviations are far too small bend the images, and have no residuals
    left that would contradict.
    """
    fits = not result.converged or result.sigma0 < _BENT
    if fits or not len(result.problem.gnss_image) or not result.problem.tie_count:
        return result
    loose = result
    for _ in range(_ROUNDS):
        table = components(loose).query("kind == 'gnss'").set_index(["part", "flight"])
        if (table["redundancy"] >= _TIGHT * table["count"]).all():
            break
        loose = _scaled(loose, dict.fromkeys(table.index, _LOOSE), again)
        if not loose.converged:
            return result
    before, after = general(result) ** 2, general(loose) ** 2
    gain = 2 * result.problem.tie_count * (before - after) / after
    if loose is result or gain < OUTLIER**2 * table["count"].sum():
        return result
    factor = (table["sigma0"] / np.sqrt(after)).fillna(1.0).clip(lower=1.0 / _LOOSE)
    found = _scaled(loose, factor.to_dict(), again)
    return found if found.converged else result


def _scaled(found: Adjustment, factors: dict[tuple[str, str], float], again: Again) -> Adjustment:
    """Adjusted with standard deviations of groups (part, flight) of positions times factors."""
    start = found.start.copy()
    flight = start.image_flight[start.image_rows("gnss")]
    for (part, name), factor in factors.items():
        restate(start, flight == start.flight_names.index(name), AXES[part], factor)
    model = found.problem.model
    if found.problem.arms_free and model.lever_arm is None and arms_unseen(start):
        # What was free is not held at nothing because positions count less: it is less certain.
        model = replace(model, lever_arm="free")
    return from_where_it_ended(found, start, model, again)


def _told(before: Adjustment, found: Adjustment) -> list[str]:
    """A sentence on each flight whose positions were given other standard deviations as a whole."""
    notes = []
    old, new = before.start.gnss_sigma(), found.start.gnss_sigma()
    flight = found.start.image_flight[found.start.image_rows("gnss")]
    for k, name in enumerate(found.start.flight_names):
        mine = flight == k
        if not mine.any():
            continue
        parts = []
        for part, axes in AXES.items():
            # A block that is weighted apart is less than half.
            factor = float(np.median((new / old)[mine, axes]))
            if factor > 1.0:
                stated, used = (float(np.median(s[mine, axes])) for s in (old, new))
                parts.append(f"{used:.2g} m in {part} where {stated:.2g} m is stated")
        if parts:
            notes.append(
                f"GNSS of flight {name}: residuals contradict the stated standard deviations; the "
                f"positions count with {' and '.join(parts)}. Either these are too small, or the "
                "model lacks something: `corridor diagnose` finds out what."
            )
    return notes


def _told_slow(found: Slow, start: Block) -> str:
    stated = np.median(start.gnss_sigma(), axis=0)[[0, 2]]
    lasting = " and ".join(
        f"{found.white * np.sqrt(found.ratio) * sigma:.2g} m in {part}"
        for sigma, part in zip(stated, AXES, strict=True)
    )
    most = max(found.factor.values())
    return (
        f"GNSS: the errors of one position and the next are alike ({lasting} that lasts for some "
        f"{found.constant:.0f} s). Their standard deviations are multiplied by up to {most:.1f}, "
        "because many such positions together are less certain than they seem. RTK and PPK drift "
        "like this; where a model lacks something it looks the same: `corridor diagnose` finds out."
    )


def with_common_offset(result: Adjustment, again: Again, stated: np.ndarray) -> Adjustment:
    """Adjusted with an offset that all antenna positions of a flight share, where ground control
    shows one and they are coarse, or contradict their standard deviations or last without it.

    A receiver without corrections is off by metres for hours, one with a wrong base station for
    good. As errors of their own they would bend the block between them and the control.
    stated (k, 3): standard deviations before any were restated, m. Source: score test, Rao 1948.
    """
    p, model = result.problem, result.problem.model
    shared = next((e for e in every_effect() if e.datum and e.place == "antenna"), None)
    if shared is None or p.stack.at("antenna") or not len(p.control_rows):
        return result
    if not result.converged or len(p.gnss_image) < _FEWEST:
        return result
    coarse = gnss_of_metres(result.start)
    wrong = {} if coarse else contradicting(result)
    lasting = not (coarse or wrong) and slow(result) is not None
    if not (coarse or wrong or lasting):
        return result
    offset, test = _common_offset(result)
    if test < chdtri(max(np.count_nonzero(offset), 1), RARE_CHANCE):
        return result
    # What drifts is off in the mean too, and by no more than it drifts.
    if lasting and (np.abs(offset) < OUTLIER * np.median(stated, axis=0)).all():
        return result
    several = len(p.images.flight_names) > 1
    effect = shared.per("flight") if several else shared
    names = [parameter.name for parameter in effect.parameters(p.block)]
    # What control does not show stays near zero; the rest is as free as it need be.
    wide = _PRIOR * np.maximum(np.median(stated, axis=0), np.abs(offset).max(axis=0))
    priors = {
        f"{effect.slug}.{name}": (0.0, float(size)) for name, size in zip(names, wide, strict=True)
    }
    wider = replace(model, effects=[*listed_effects(model.effects), effect],
                    priors=priors | dict(model.priors or {}))  # fmt: skip
    found = where_it_leads(from_where_it_ended, result, result.start, wider, again)
    # An offset that is not what is wrong leaves the contradiction.
    if found is None or (wrong and contradicting(found)):
        return result
    if lasting and slow(found) is not None:
        return result
    values = found.effects.query("slug == @effect.slug")
    # Nor is one that a free focal length and the arms leave unknown.
    if not (values["value"].abs() > FAR_SIGMAS * values["sigma"]).any():
        return result
    shown = "; ".join(
        f"{f'flight {group} ' if several else ''}"
        f"{', '.join(f'{value:+.2f}' for value in part['value'])} m"
        for group, part in values.groupby("group", sort=False)
    )
    cause = (
        ": a base station with other coordinates, another datum, or heights above the ellipsoid "
        "and above the geoid? It may as well be the control that is off, by the opposite."
    )
    found.add_note(
        f"GNSS and ground control disagree by one vector ({shown}), which is estimated with the "
        f"rest ({effect.slug}); the control decides where the block lies{'.' if coarse else cause}"
    )
    return found


def _common_offset(result: Adjustment) -> tuple[np.ndarray, float]:
    """What the positions of each flight are off by together (flights, 3), m, as control and images
    show it, zero along what they do not show; and its chi-square."""
    p, rows = result.problem, result.system.gnss
    flight = p.images.flight[p.gnss_image]
    flights = np.unique(flight)
    columns = (flight[:, None] == flights)[:, None, :, None] * np.eye(3)[:, None, :]
    columns = (p.gnss_turn @ columns.reshape(len(flight), 3, -1)).reshape(3 * len(flight), -1)
    heavy = columns * p.gnss_weight.reshape(-1, 1)
    sums = rows.jacobian.T @ heavy
    system = columns.T @ heavy
    scale = np.sqrt(np.diag(system))
    system = (system - sums.T @ result.covariance.solve(sums)) / scale[:, None] / scale
    right = heavy.T @ rows.residual.ravel() / scale
    size, axes = np.linalg.eigh(system)
    seen = size > _SEEN
    along = axes[:, seen].T @ right
    offset = axes[:, seen] @ (along / size[seen]) / scale
    return offset.reshape(-1, 3), float(np.sum(along**2 / size[seen]))


def gnss_of_metres(block: Block) -> bool:
    """Whether all positions may be wrong together by decimetres or metres: the block says so, or
    its standard deviations are of the scatter about the flight, which holds nothing common."""
    scatter = any(one.column == "gnss.sx" and one.source == SCATTER for one in derived(block))
    return scatter or arms_unseen(block)


def without_unseen_arms(result: Adjustment, again: Again, asked: bool) -> Adjustment:
    """Adjusted with the lever arms held where nobody asked for them and they are not determined."""
    arms = result.lever_arm
    if not result.problem.arms_free or asked or not len(arms):
        return result
    sigma = float(np.nanmax(values_of(arms, "sx", "sy", "sz")))
    if not sigma > _ARM_M:
        return result
    model = replace(result.problem.model, lever_arm="fixed")
    found = from_where_it_ended(result, result.start, model, again)
    if not found.converged:
        return result
    why = f"this flight determines it to {sigma:.1f} m only; --lever-arm free estimates it anyway"
    found.add_note(unseen_arms(result, why))
    return found


def unseen_arms(result: Adjustment, why: str) -> str:
    """The sentence on lever arms that are held where nobody asked for it."""
    at = "what block.toml states" if result.start.lever_arm else "0"
    return f"The lever arm is held at {at}: {why}."


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
    found = where_it_leads(again, result.block, replace(model, camera=free))
    if found is None:
        return result
    rows = found.camera[found.camera["parameter"] == "f"].set_index("camera")
    for name in held:
        stated = result.start.cameras[name]["f"]
        f, sigma = rows.loc[name, "value"], rows.loc[name, "sigma"]
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


def with_motion_as_seen(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with errors of velocities of the size that the readout and the pictures say."""
    for _ in range(_MOTION_ROUNDS):
        model, p = result.problem.model, result.problem
        if not p.beside or not result.converged:
            return result
        before, now = model.motion or MotionScale(), _motion_scale(result)
        if all(abs(np.log(a / b)) < _SAME for a, b in zip(now, before, strict=True)):
            return result
        start = result.start
        left, values = result.as_left(p.stack.members)
        result = again(left, replace(model.starting(values), motion=now))
        result.begun_from(start)
    result.add_note(
        f"The size of the errors of the velocities did not settle in {_MOTION_ROUNDS} rounds "
        f"({before.moved:.2g}, then {now.moved:.2g} times what is stated): the readout time "
        "depends on it, and its standard deviation holds for the last of them."
    )
    return result


def _motion_scale(result: Adjustment) -> MotionScale:
    """By what the deviations of velocities and of angular rates count, by this result.

    Source: Förstner 1979 (v'Pv / r); what is stated counts as some observations of its own.
    """
    p = result.problem
    before = p.model.motion or MotionScale()
    table = result.effects
    found = table.loc[table["parameter"] == "readout", "value"].abs()
    readout = max([_LEAST_S, *found[np.isfinite(found)]])
    factors = []
    for axes, factor in (("x", "y", "z"), before.moved), (_TURNS, before.turned):
        own = [
            (n, slug, k)
            for n, (slug, k) in enumerate(p.per_image_unknowns)
            if slug in p.beside and p.stack.members[slug].parameters[k].name in axes
        ]
        if own:
            number = [n for n, _, _ in own]
            value = np.stack([result.state.effects[slug][:, k] for _, slug, k in own], axis=1)
            weight = p.per_image_prior[1][:, number]
            left = np.einsum("nii->ni", result.covariance.each_pose)[:, 6 + np.array(number)]
            stated = factor * before.readout / readout
            seen = float(np.sum(value**2 * weight)) * stated**2
            counts = float(np.sum(np.clip(1.0 - left * weight, 0.0, 1.0)))
            factor = float(np.sqrt((seen + _STATED_COUNTS) / (counts + _STATED_COUNTS)))
        factors.append(factor)
    return MotionScale(readout, *factors)
