"""Rigs: images of one exposure that hang together by the stated mounting.

Measured, as it were, to a micrometre and a fiftieth of a second of arc: that a member j stands

    R_i (C_j - C_i) - t = 0,   Log(R_j R_i' M') = 0      with t, M the mounting in i's frame

where the mounting is stated. What it is wrong by is an effect on the motion of the member, so that
every member has its pose by its exposure's and what all exposures share.
Source: Fraser 1997 (constraints as observations of high weight).
"""

from dataclasses import dataclass

import numpy as np

from corridor.core.adjustment.unknowns import State
from corridor.core.block import Block, exposures_of, mountings_of, relative
from corridor.core.geometry import right_jacobian, skew, vector_from_rotation

# Far below what any image shows of a pose, and far above what rounding leaves of the equations.
_SIGMA = np.array([1e-6] * 3 + [1e-7] * 3)


@dataclass
class Rigs:
    """Pairs of images of one exposure: rig_image (k, 2), the later of two in the problem's order
    last; rig_place (k, 3), m, and rig_rotation (k, 3, 3) of the second in the first one's frame."""

    rig_image: np.ndarray
    rig_place: np.ndarray
    rig_rotation: np.ndarray


@dataclass(frozen=True)
class RigRows:
    """residual (k, 6), weight (6,), and derivatives of the modelled by the poses of the first and
    of the second image (k, 6, 6) each."""

    residual: np.ndarray
    weight: np.ndarray
    first: np.ndarray
    second: np.ndarray


def rigs_in(block: Block, rank: np.ndarray) -> Rigs:
    """The pairs of a block. rank (m,): position of each row of images.csv."""
    both = exposures_of(block)
    if not len(both.member):
        return Rigs(np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    mountings, cameras = mountings_of(block), block.images["camera"].to_numpy(object)
    pairs = np.stack([both.base, both.member], axis=1)
    back = rank[pairs[:, 0]] > rank[pairs[:, 1]]
    pairs[back] = pairs[back][:, ::-1]
    known = {}
    for one, other in set(map(tuple, cameras[pairs])):
        known[one, other] = relative(mountings[one], mountings[other])
    each = [known[one, other] for one, other in cameras[pairs]]
    place, rotation = (np.array([two[k] for two in each]) for k in range(2))
    return Rigs(rank[pairs], place, rotation)


def rig_rows(p: Rigs, state: State) -> RigRows:
    """The pairs at a state."""
    i, j = p.rig_image.T
    one, other = state.rotation[i], state.rotation[j]
    away = np.einsum("nij,nj->ni", one, state.centre[j] - state.centre[i])
    turn = vector_from_rotation(other @ one.transpose(0, 2, 1) @ p.rig_rotation.transpose(0, 2, 1))
    first, second = np.zeros((len(i), 6, 6)), np.zeros((len(i), 6, 6))
    first[:, :3, :3], first[:, :3, 3:] = -one, -skew(away)
    second[:, :3, :3] = one
    # Exp(w) before R_j is before the turn; before R_i it comes behind it, turned by M.
    first[:, 3:, 3:] = -np.linalg.inv(right_jacobian(turn)) @ p.rig_rotation
    second[:, 3:, 3:] = np.linalg.inv(right_jacobian(-turn))
    residual = np.concatenate([p.rig_place - away, -turn], axis=1)
    return RigRows(residual, _SIGMA**-2.0, first, second)
