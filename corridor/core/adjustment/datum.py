"""What the measurements leave open: position, rotation and scale of the whole block.

With neither control nor GNSS the block is a free network: a few unknowns are held while it is
solved (which changes no residual), and the result is laid on the start poses as a whole.
Covariances are those of the same datum. With some control or GNSS, but not enough, the input is
wrong and the message says which quantity nothing determines.

Source: Luhmann et al., "Close-range photogrammetry and 3D imaging", section 4.4.3 (free net);
Baarda 1973 (S-transformation).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh, qr

from corridor.core.adjustment.distances import ENDS, ends_at_points, scale_of
from corridor.core.adjustment.linear_system import LinearSystem, motions
from corridor.core.adjustment.matrix import Singular
from corridor.core.adjustment.misfit import misfit
from corridor.core.adjustment.problem import Problem, State
from corridor.core.effects import every_effect
from corridor.core.errors import InputError, StartFailed
from corridor.core.geometry import rotation_from_vector
from corridor.core.output import counted

_TURNS = tuple(f"rotation about {axis}" for axis in "xyz")
QUANTITIES = ("position along x", "position along y", "height", *_TURNS, "scale")
# Share of the information that is left when everything else adapts; rounding leaves 1e-15.
OPEN = 1e-12


@dataclass(frozen=True)
class Datum:
    """Where a free network lies.

    null_space (n + q, k): the motions that no measurement determines. held (k, 2): image and
    unknown of it that are held while the network is solved.
    """

    null_space: np.ndarray
    held: np.ndarray


def null_space(system: LinearSystem) -> tuple[np.ndarray, list[str]]:
    """What nothing determines at a state: changes (n + q, k) of the unknowns, and in words."""
    whole, reference, q = system.motions, system.reference, len(system.columns.shared)
    n = len(whole) - q
    moved = system.multiply(whole)
    scale = np.sqrt(np.maximum(reference[n:], np.finfo(float).tiny))
    shared_block = system.shared_matrix / scale[:, None] / scale
    try:
        shared = -np.linalg.lstsq(shared_block, moved[n:] / scale[:, None], 1e-13)[0]
        shared /= scale[:, None]
        information = whole.T @ moved + moved[n:].T @ shared
        total = whole.T @ (reference[:, None] * whole)
        norm = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
        value, vector = eigh(information / norm[:, None] / norm, total / norm[:, None] / norm)
    except (np.linalg.LinAlgError, ValueError):
        # Numbers that are none, or too few points in front of any image.
        raise StartFailed(
            "hardly an image shows its points: the start values are too far off, check poses, "
            "camera and the unit of the coordinates"
        ) from None
    loose = vector[:, value < OPEN] / norm[:, None]
    part = (vector[:, value < OPEN] ** 2).sum(axis=1)
    words = [QUANTITIES[k] for k in np.flatnonzero(part > 0.3 * part.max(initial=1.0))]
    return np.concatenate([whole[:n] @ loose, (whole[n:] + shared) @ loose]), words


def free_network(system: LinearSystem) -> Datum | None:
    """The datum of a free network; None where control or GNSS determine everything.

    Raises InputError where there is control or GNSS, but not enough.
    """
    p, state = system.problem, system.state
    given = p.control_given[: len(p.control_rows)]
    few_controls = _on_a_line(given) or bool(p.stack.at("ground"))
    few_antennas = _on_a_line(p.gnss_given) or p.arms_free or bool(p.stack.at("antenna"))
    if not (few_controls and few_antennas):
        return None
    loose, words = null_space(system)
    if not words:
        return None
    if len(p.control_rows) or len(p.gnss_image):
        raise InputError(undetermined(p, words))
    # Hold unknowns of two images far apart: the best determined choice by pivoting.
    first = p.image_count // 2
    away = np.linalg.norm(state.centre - state.centre[first], axis=1)
    pose = system.columns.pose
    rows = np.concatenate([pose[first], pose[np.argmax(away), :3]])
    weight = np.sqrt(system.reference[rows])
    _, _, pivot = qr((loose[rows] * weight[:, None]).T, pivoting=True, mode="economic")
    held = rows[pivot[: loose.shape[1]]]
    return Datum(loose, np.stack(np.divmod(held, p.d), axis=1))


def _on_a_line(xyz: np.ndarray) -> bool:
    """Whether points (n, 3) leave a rotation open: fewer than three, or on one line."""
    if len(xyz) < 3:
        return True
    spread = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    # Information goes with the square of the width.
    return bool(spread[1] <= np.sqrt(OPEN) * spread[0])


def undetermined(p: Problem, words: list[str]) -> str:
    """The sentence for a block whose datum has a hole."""
    what = " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
    have = []
    for count, thing, place, loose in (
        (len(p.control_rows), "control point", "ground", []),
        (len(p.gnss_image), "GNSS position", "antenna", ["free lever arms"] * p.arms_free),
        (len(p.attitude_image), "attitude", "attitude", []),
    ):
        loose = [*loose, *(f"effect {member.effect.slug}" for member in p.stack.at(place))]
        if count:
            have.append(counted(count, thing) + f" with {' and '.join(loose)}" * bool(loose))
    return (
        f"{what[0].upper()}{what[1:]} of the block cannot be determined by {' and '.join(have)}: "
        "add control points or GNSS (ground.csv, gnss.csv), hold lever arms and effects of the "
        "GNSS or the ground, or take control and GNSS away to adjust a free network"
    )


def explain(system: LinearSystem, singular: Singular) -> InputError:
    """What a singular matrix means for the person who made the block."""
    p = system.problem
    if singular.shared is not None:
        label = system.columns.shared[singular.shared].label
        off = misfit(system, far=True)
        correct = f"; or correct what lies far off: {off[0]}" if off else ""
        return InputError(
            f"{p.block.folder or p.block.name}: {label} cannot be determined from these "
            "measurements together with the other unknowns: hold it, give it a prior, or leave "
            f"the effect out{correct}"
        )
    try:
        _, words = null_space(system)
    except StartFailed:
        words = []
    if words and (len(p.control_rows) or len(p.gnss_image)):
        return InputError(undetermined(p, words))
    name = p.images.names[singular.image]
    own = singular.own
    if own is not None and own >= 6:
        slug, number = p.per_image_unknowns[own - 6]
        return InputError(
            f"images.csv: {p.stack.members[slug].parameters[number].name} of effect {slug} cannot "
            f"be determined for image {name}: share the effect ({slug}@flight) or leave it out"
        )
    return InputError(
        f"images.csv: the pose of image {name} cannot be determined: its points lie on a line or "
        "are linked to the other images by too few points; measure more or remove the image"
        f"{_left_out(p)}"
    )


def _left_out(p: Problem) -> str:
    """How the camera turned during its readout, if the block says it and the model does not."""
    taken = any(one.effect.needs_table("rates") for one in p.stack.members.values())
    if not len(p.block.rates) or taken:
        return ""
    slugs = [one.slug for one in every_effect() if one.form(p.block).needs_table("rates")]
    return (
        "; or the model is wrong, which takes no turn of the camera during its readout although "
        f"rates.csv records it: `corridor adjust BLOCK --effect {' or '.join(slugs)}`"
    )


def centred(system: LinearSystem, loose: np.ndarray) -> np.ndarray:
    """Weights M (k, n) of the poses with M G = I: the datum that is laid on the start poses.

    loose: G (n, k), the null space by the poses.
    """
    weight, pose = np.zeros(len(loose)), system.columns.pose
    weight[pose[:, :3]], weight[pose[:, 3:]] = 1.0, typical_depth(system.state) ** 2
    heavy = weight[:, None] * loose
    return np.linalg.solve(loose.T @ heavy, heavy.T)


def typical_depth(state: State) -> float:
    """Typical distance from camera to ground, m: turns angles into metres."""
    middle = np.median(state.points, axis=0)
    return float(np.median(np.linalg.norm(state.centre - middle, axis=1)))


def open_motions(p: Problem) -> np.ndarray:
    """Which of the seven motions leave all measurements of a free network as they are.

    Attitudes hold its rotation, rigs and distances its scale.
    """
    turns, grows = not len(p.attitude_image), not (len(p.rig_image) or len(p.distance_given))
    return np.array([True] * 3 + [turns] * 3 + [grows])


def helmert_onto(p: Problem, state: State, start: State) -> State:
    """A free network laid on its start poses as a whole, by what nothing holds of it."""
    kept = np.diag(open_motions(p).astype(float))
    for _ in range(20):
        poses = motions(state, 6) @ kept
        weight = np.ones((p.image_count, 6))
        weight[:, 3:] = typical_depth(state) ** 2
        turn = np.einsum("nij,nkj->nik", start.rotation, state.rotation)
        small = 0.5 * (turn - turn.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
        away = np.concatenate([start.centre - state.centre, small], axis=1)
        heavy = weight.reshape(-1, 1) * poses
        step = np.linalg.lstsq(poses.T @ heavy, heavy.T @ away.ravel())[0]
        state = moved(state, step)
        if np.max(np.abs(poses @ step)) < 1e-12 * max(typical_depth(state), 1.0):
            break
    return ends_at_points(p, state)


def moved(state: State, step: np.ndarray) -> State:
    """The whole block moved by step (7): translation, rotation, growth about its camera centre."""
    middle = state.centre.mean(axis=0)
    turn = rotation_from_vector(step[3:6])
    grow = np.exp(step[6])

    def place(xyz: np.ndarray) -> np.ndarray:
        return middle + step[:3] + grow * (xyz - middle) @ turn.T

    centre, points = place(state.centre), place(state.points)
    return replace(state, centre=centre, rotation=state.rotation @ turn.T, points=points)


def scaled_by_distances(p: Problem) -> Problem:
    """The problem with the start of a free network scaled as its distances say."""
    if not len(p.distance_given) or len(p.control_rows) or len(p.gnss_image) or len(p.rig_image):
        return p
    scale = scale_of(p, p.start)
    grown = moved(p.start, np.array([0.0] * 6 + [np.log(scale)]))
    at = p.control >= 0
    start = np.empty_like(p.end_start)
    start[p.control[at]] = grown.points[at]
    effects = grown.effects | {ENDS: np.zeros_like(start)}
    return replace(
        p,
        end_start=start,
        control_given=start,
        control_weight=p.control_weight / scale**2,
        start=replace(grown, effects=effects),
    )
