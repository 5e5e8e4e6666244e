"""The normal equations of a converged adjustment with a column for every candidate.

The kernels of the adjustment eliminate the points and leave poses, what images share, and the
candidates; robust weights are replaced by pseudo-residuals, so that the candidates meet a plain
least squares problem. The GNSS is kept apart: its noise is coloured.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import block_array, csc_array, csr_array, diags_array, vstack

from corridor.adjustment import Adjustment, Loss, Normal
from corridor.diagnosis.candidates import (
    Group,
    antenna_columns,
    candidate_problem,
    make_groups,
)
from corridor.diagnosis.robust import Scales, pseudo_residuals
from corridor.effects import Effect


@dataclass
class Columns:
    """Candidate columns before poses and camera are eliminated.

    cross (n, p): with poses and nuisance, from images and ground; inside (p, p) among themselves;
    right (p,); antenna (3k, p): derivative of the antenna positions; value (p,): where the
    parameters stand, in prior standard deviations. All but right and value may be sparse.
    """

    cross: np.ndarray | csc_array
    inside: np.ndarray | csc_array
    right: np.ndarray
    antenna: np.ndarray | csr_array
    value: np.ndarray


@dataclass
class Equations:
    """Everything about a block at a state, points eliminated.

    matrix (n, n) sparse, right (n,): poses (6 an image, in the problem's order), then nuisance:
    free camera, believed effects, lever arms. jacobian (3k, n) sparse, residual (3k,), stated (3k,)
    standard deviation, image (k,): of the antenna positions. core: columns that images share;
    own: blocks of per-image columns; between: each of them with the core (p, c); mutual: (i, j)
    -> of two of them, i < j.
    free_motions: (n, 7) of a block that nothing holds, else None.
    """

    problem: object
    state: object
    matrix: csc_array
    right: np.ndarray
    jacobian: csr_array
    residual: np.ndarray
    stated: np.ndarray
    image: np.ndarray
    core: Columns
    own: list[Columns]
    between: list[np.ndarray]
    mutual: dict[tuple[int, int], csc_array]
    groups: list[Group]
    scales: Scales
    free_motions: np.ndarray | None = None
    pixels: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    nuisance: list[str] = field(default_factory=list)


def equations(
    adjustment: Adjustment,
    effects: list[Effect],
    believed: list[Effect],
    options: dict,
    priors: dict,
) -> Equations:
    """Equations at the result of an adjustment.

    effects: candidates; those that the adjustment estimated stand where it left them. believed:
    effects that are nuisance. options: camera, control, check, lever_arm as given to `adjust`.
    priors: of the believed model, by name; of candidates, by slug or `slug.parameter`.
    """
    mine = {k: v for k, v in priors.items() if _of_candidate(k, effects, adjustment.block)}
    others = {k: v for k, v in priors.items() if k not in mine}
    done = adjustment.problem
    problem = candidate_problem(
        done.block, options["camera"], believed, effects, options["control"], options["check"],
        others, options["lever_arm"],
    )  # fmt: skip
    gnss = problem.gnss_image, problem.gnss_given, problem.gnss_weight
    arms = problem.arms_free
    state = _state_of(adjustment, problem)
    problem.start = state
    problem.gnss_image = np.zeros(0, dtype=np.int64)
    normal = Normal(problem, Loss())
    residual, _ = normal.look(state, passes=3)
    found, scales = pseudo_residuals(problem, state, residual)
    problem.xy = problem.xy + np.nan_to_num(found - residual)
    problem.weight = 1.0 / scales.of_observation
    normal.look(state, passes=1)
    normal.assemble(state, 0.0)
    out = _take_apart(normal, problem, state, effects, scales, mine)
    _add_antenna(out, normal, gnss, arms, adjustment, effects, mine)
    out.pixels = found
    if not len(gnss[0]) and len(problem.control_rows) < 3:
        out.free_motions = _motions(state, len(out.right))
    return out


def _of_candidate(label: str, effects: list[Effect], block) -> bool:
    """Whether a prior is one of a candidate: of its slug, or of `slug.parameter`.

    `lever_arm.F1.z` is the arm of a flight that every adjustment with GNSS estimates; `lever_arm.z`
    is the candidate that corrects a stated arm.
    """
    slug, _, parameter = label.partition(".")
    names = [p.name for e in effects if e.slug == slug for p in e.parameters(block)]
    return bool(names) and parameter in ("", *names)


def _state_of(adjustment: Adjustment, problem):
    """The state of an adjustment with the values of candidates it did not know, zero."""
    state = adjustment.state
    # Zero moves nothing; some effects ask for another start when they are adjusted.
    effects = {slug: np.zeros_like(value) for slug, value in problem.stack.start().items()}
    for slug, values in state.effects.items():
        if slug in effects:
            effects[slug] = values.copy()
    return type(state)(
        state.centre, state.rotation, state.points, state.interior, effects, state.arms
    )


def _take_apart(normal, p, state, effects, scales, priors) -> Equations:
    """Split the assembled equations into poses and nuisance, core, and per-image columns."""
    m, d, q = p.image_count, p.d, p.shared_count
    slugs = {effect.slug for effect in effects}
    whole = normal.blocks.symmetric()
    border = normal.border[:m].reshape(-1, p.wide)[:, :q]
    corner = normal.corner + np.tril(normal.corner, -1).T
    gradient = normal.gradient[:m].reshape(-1)

    shared = np.array(
        [u.kind == "effect" and u.owner in slugs for u in p.unknowns], dtype=bool
    ).reshape(-1)
    inner, outer = np.flatnonzero(~shared), np.flatnonzero(shared)
    own_slugs = [slug for slug, _ in p.own_unknowns]
    pose = (np.arange(m)[:, None] * d + np.arange(6)).ravel()
    believed = [6 + n for n, slug in enumerate(own_slugs) if slug not in slugs]
    more = (np.arange(m)[:, None] * d + np.array(believed, dtype=int)).ravel()
    # Poses first, then what else the believed model estimates.
    first = np.concatenate([pose, more]).astype(int)
    size = len(first) + len(inner)
    mine = csc_array(border[first][:, inner])
    parts = [[whole[first][:, first], mine], [mine.T, csc_array(corner[np.ix_(inner, inner)])]]
    matrix = csc_array(block_array(parts))
    right = np.concatenate([gradient[first], normal.shared_gradient[inner]])

    scale = np.array([_scale_of(p, p.unknowns[k]) for k in outer])
    value = np.array([state.effects[p.unknowns[k].owner][p.unknowns[k].at] for k in outer])
    cross = np.concatenate([border[first][:, outer], corner[np.ix_(inner, outer)]])
    core = Columns(
        cross * scale, corner[np.ix_(outer, outer)] * scale[:, None] * scale,
        normal.shared_gradient[outer] * scale, np.zeros((0, len(outer))),
        value / scale if len(scale) else value,
    )  # fmt: skip
    columns: dict[str, list] = {}
    for column, k in enumerate(outer):
        unknown = p.unknowns[k]
        columns.setdefault(unknown.owner, []).append((column, unknown.group, unknown.at[1]))

    owns = list(dict.fromkeys(slug for slug in own_slugs if slug in slugs))
    own, between, mutual, taken = [], [], {}, []
    for slug in owns:
        numbers = [k for k, name in enumerate(own_slugs) if name == slug]
        rows = (np.arange(m)[:, None] * d + 6 + np.array(numbers)).ravel()
        parameters = p.stack.members[slug].parameters
        unit = np.tile([parameters[p.own_unknowns[k][1]].scale for k in numbers], m)
        over_poses = csc_array(whole[first][:, rows])
        cross = vstack([over_poses, csc_array(border[rows][:, inner].T)]) @ diags_array(unit)
        own.append(
            Columns(
                csc_array(cross),
                csc_array(diags_array(unit) @ whole[rows][:, rows] @ diags_array(unit)),
                gradient[rows] * unit,
                csr_array((0, len(rows))),
                state.effects[slug].reshape(-1) / unit,
            )  # fmt: skip
        )
        between.append(border[rows][:, outer] * unit[:, None] * scale)
        for i, (others, their) in enumerate(taken):
            both = whole[others][:, rows]
            mutual[i, len(own) - 1] = diags_array(their) @ both @ diags_array(unit)
        taken.append((rows, unit))
    groups = make_groups(p, effects, columns, owns, priors)
    _rescale(groups, core, between, scale)
    names = [p.unknowns[k].label for k in inner]
    return Equations(
        p, state, matrix, right, csr_array((0, size)), np.zeros(0), np.zeros(0),
        np.zeros(0, np.int64), core, own, between, mutual, groups, scales, nuisance=names,
    )  # fmt: skip


def _rescale(groups, core, between, scale) -> None:
    """Columns of groups that come with laboratory knowledge, in units of its uncertainty."""
    for group in groups:
        if not group.known or group.own is not None:
            continue
        factor = np.ones(len(scale))
        factor[group.columns] = group.scale / scale[group.columns]
        core.cross *= factor
        core.inside *= factor[:, None] * factor
        core.right *= factor
        core.value /= factor
        for block in between:
            block *= factor


def _scale_of(p, unknown) -> float:
    return p.stack.members[unknown.owner].parameters[unknown.at[1]].scale


def _add_antenna(out: Equations, normal, gnss, arms_free, adjustment, effects, priors) -> None:
    """Antenna positions: their derivatives by poses, nuisance and candidates, and residuals."""
    p, state = out.problem, out.state
    image, given, weight = gnss
    k, size = len(image), len(out.right)
    m = p.image_count
    p.gnss_image, p.gnss_given, p.gnss_weight = gnss
    out.image, out.stated = image, (weight**-0.5).ravel()
    images = p.images.with_poses(state.centre, state.rotation)
    found = antenna_columns(p.block, images, image, effects)
    if not k:
        out.jacobian = csr_array((0, size))
        return
    predicted, d_pose, d_believed, to_world = normal.antenna(state, images)
    residual = given - predicted
    where = (6 * image[:, None] + np.arange(6))[:, None, :]
    rows = np.broadcast_to(np.arange(3 * k).reshape(k, 3, 1), (k, 3, 6))
    parts = [(rows.ravel(), np.broadcast_to(where, (k, 3, 6)).ravel(), d_pose.ravel())]
    inner = [n for n, u in enumerate(p.unknowns) if u.label in set(out.nuisance)]
    shared = {n: size - len(inner) + at for at, n in enumerate(inner)}
    own_slugs = [slug for slug, _ in p.own_unknowns]
    tested = {effect.slug for effect in effects}
    believed = [n for n, slug in enumerate(own_slugs) if slug not in tested]
    for source, columns in ((d_believed, p.antenna_column[image]), (to_world, p.arm_column[image])):
        for n in range(columns.shape[1]):
            column = columns[:, n]
            at = np.array([shared.get(c, -1) for c in column.tolist()])
            for c, i in zip(np.flatnonzero(column <= -2), image[column <= -2], strict=True):
                at[c] = 6 * m + i * len(believed) + believed.index(-2 - column[c])
            rows = np.arange(3 * k).reshape(k, 3)
            keep = np.repeat((at >= 0)[:, None], 3, axis=1)
            parts.append(
                (rows[keep], np.repeat(at[:, None], 3, axis=1)[keep], source[:, :, n][keep])
            )
    row, column, data = (np.concatenate([part[c] for part in parts]) for c in range(3))
    out.jacobian = csr_array((data, (row, column)), shape=(3 * k, size))
    out.core.antenna = np.zeros((3 * k, out.core.cross.shape[1]))
    for block in out.own:
        block.antenna = csr_array((3 * k, block.cross.shape[1]))
    for effect, derivative, group, names in found:
        values = adjustment.state.effects.get(effect.slug)
        residual = residual - (
            0.0 if values is None else np.einsum("nij,nj->ni", derivative, values[group])
        )
        _append(out, effect, derivative, group, names, values, priors)
    out.residual = residual.ravel()


def _append(out: Equations, effect, derivative, group, names, values, priors) -> None:
    """Columns of an effect on the antenna, behind the others."""
    k, _, count = derivative.shape
    parameters = effect.parameters(out.problem.block)
    size = len(out.right)
    scale = np.array([p.scale for p in parameters])
    total = len(names) * count
    at = group[:, None, None] * count + np.arange(count)
    rows = np.broadcast_to(np.arange(3 * k).reshape(k, 3, 1), (k, 3, count))
    data = derivative * scale
    antenna = csr_array(
        (data.ravel(), (rows.ravel(), np.broadcast_to(at, (k, 3, count)).ravel())),
        shape=(3 * k, total),
    )
    value = np.zeros(total) if values is None else (values / scale).reshape(-1)
    labels = [(name, p.name, p.unit) for name in names for p in parameters]
    if effect.group == "image":
        empty = csc_array((size, total))
        own = Columns(empty, csc_array((total, total)), np.zeros(total), antenna, value)
        out.own.append(own)
        out.between.append(np.zeros((total, out.core.cross.shape[1])))
        owns = [""] * (len(out.own) - 1) + [effect.slug]
        out.groups += make_groups(out.problem, [effect], {}, owns, {})
        return
    # Flights without a position have nothing to be tested with.
    seen = np.flatnonzero(np.bincount(group, minlength=len(names)))
    keep = (seen[:, None] * count + np.arange(count)).ravel()
    core = out.core
    before = core.cross.shape[1]
    labels = [labels[c] for c in keep]
    numbers = {p.name: n for n, p in enumerate(parameters)}
    entries = [(before + c, label[0], numbers[label[1]]) for c, label in enumerate(labels)]
    groups = make_groups(out.problem, [effect], {effect.slug: entries}, [], priors)
    unit = np.concatenate([g.scale for g in groups]) / np.tile(scale, len(seen))
    core.cross = np.concatenate([core.cross, np.zeros((size, len(keep)))], axis=1)
    inside = np.zeros((before + len(keep),) * 2)
    inside[:before, :before] = core.inside
    core.inside = inside
    core.right = np.concatenate([core.right, np.zeros(len(keep))])
    core.antenna = np.concatenate([core.antenna, antenna.toarray()[:, keep] * unit], axis=1)
    core.value = np.concatenate([core.value, value[keep] / unit])
    out.groups += groups
    for n, block in enumerate(out.between):
        out.between[n] = np.concatenate([block, np.zeros((len(block), len(keep)))], axis=1)


def _motions(state, size: int) -> np.ndarray:
    """Translation, rotation and growth of the whole block (size, 7), by the poses."""
    m = len(state.centre)
    away = state.centre - state.centre.mean(axis=0)
    out = np.zeros((m, 6, 7))
    for k in range(3):
        axis = np.eye(3)[k]
        out[:, k, k] = 1.0
        out[:, :3, 3 + k] = np.cross(axis, away)
        out[:, 3:, 3 + k] = -state.rotation @ axis
    out[:, :3, 6] = away
    whole = np.zeros((size, 7))
    whole[: 6 * m] = out.reshape(6 * m, 7)
    return whole
