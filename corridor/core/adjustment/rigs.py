"""Rigs: images of one exposure that hang together by the stated mounting.

An exposure has one pose, that of its base i, and a member j stands where it hangs:

    C_j = C_i + R_i' t,   R_j = M R_i      with t, M the mounting in i's frame

What the mounting is wrong by is an effect on the motion of the member, so that every member has its
pose by its exposure's and what all exposures share. The unknowns x of images follow from those u of
exposures, which the equations are made and solved for: N_u = T' N T and

    x = T u,   dC_j = dC + R_i' [t] dr,   dr_j = M dr

Whoever asks for N itself, image by image, gets one with the same solutions and covariances: N_u
where the bases stand, and besides, as if measured to a micrometre and a fiftieth of a second,

    R_i (C_j - C_i) - t = 0,   Log(R_j R_i' M') = 0

Source: Fraser 1997 (constraints as observations of high weight); Rupnik, Nex and Remondino 2014.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from corridor.core.adjustment.unknowns import State
from corridor.core.block import Block, exposures_of, mountings_of, relative
from corridor.core.geometry import right_jacobian, skew, vector_from_rotation

# Far below what any image shows of a pose, and far above what rounding leaves of the equations.
_SIGMA = np.array([1e-6] * 3 + [1e-7] * 3)


@dataclass
class Rigs:
    """Pairs of images of one exposure, its base and another: rig_image (k, 2); rig_place (k, 3), m,
    and rig_rotation (k, 3, 3) of the other in the base's frame."""

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


class Exposures:
    """Unknowns of images by those of exposures, at a state: x = T u.

    count: how many exposures; size: unknowns of each, those of its pose and behind them those that
    its images have for themselves, in turn. unknown (m, d): number of u behind each x, turn
    (m, d, d): what T makes of them. hung (m, 18): R_i' [t] and M, or (0, 18) without rigs.
    """

    def __init__(self, p, rotation: np.ndarray):
        """p: `Problem`; rotation (m, 3, 3): where its images stand."""
        m, d = p.image_count, p.d
        base, member = p.rig_image.T
        self.rigs, self.count = len(member) > 0, p.exposure_count
        first = np.searchsorted(p.exposure, np.arange(self.count))
        slot = np.arange(m) - first[p.exposure]
        self.size = 6 + (d - 6) * (int(slot.max(initial=0)) + 1)
        self.unknown = p.exposure[:, None] * self.size + np.arange(d)
        self.unknown[:, 6:] += (slot * (d - 6))[:, None]
        self.hung = np.zeros((m if self.rigs else 0, 18))
        if self.rigs:
            self.hung[:, 9:] = np.eye(3).ravel()
            lever = rotation[base].transpose(0, 2, 1) @ skew(p.rig_place)
            self.hung[member] = np.concatenate([lever, p.rig_rotation], axis=1).reshape(-1, 18)
        self._member = member
        self._p = p

    @cached_property
    def turn(self) -> np.ndarray:
        out = np.tile(np.eye(self._p.d), (len(self.unknown), 1, 1))
        if self.rigs:
            out[:, :3, 3:6], out[:, 3:6, 3:6] = self.hung.reshape(-1, 2, 3, 3).transpose(1, 0, 2, 3)
        return out

    @cached_property
    def _whole(self) -> csr_array:
        """T."""
        return self._sparse(self.turn)

    @cached_property
    def first(self) -> csr_array:
        """The same, but members' poses stay where they are: zeros in place of T."""
        only = np.tile(np.eye(self._p.d), (len(self.unknown), 1, 1))
        only[self._member, :6] = 0.0
        return self._sparse(only)

    def _sparse(self, blocks: np.ndarray) -> csr_array:
        m, d, _ = blocks.shape
        start = np.arange(m * d + 1) * d
        column = np.repeat(self.unknown, d, axis=0).ravel()
        out = csr_array((blocks.flatten(), column, start), shape=(m * d, self.count * self.size))
        out.eliminate_zeros()
        return out

    def images(self, u: np.ndarray) -> np.ndarray:
        """x = T u (m d, k) of exposures' unknowns u (n, k)."""
        return self._whole @ u if self.rigs else u

    def sums(self, right: np.ndarray) -> np.ndarray:
        """T' right (n, k) of what stands on the right, image by image (m d, k)."""
        return self._whole.T @ right if self.rigs else right

    def at_bases(self, u: np.ndarray) -> np.ndarray:
        """Rows (m d, k) of exposures' unknowns (n, k), each once: members' poses have zeros."""
        return self.first @ u if self.rigs else u

    def of_bases(self, x: np.ndarray) -> np.ndarray:
        """u (n, k) of images' x (m d, k), which hang as they should."""
        return self.first.T @ x if self.rigs else x

    def rows(self, image: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of unknowns (k, d) of some images, and rows (k, r, d) by these in place of x."""
        return self.unknown[image], own @ self.turn[image] if self.rigs else own


def hung(p, state: State) -> State:
    """The state with each member where its exposure's base has it."""
    if not len(p.rig_image):
        return state
    (base, member), centre, rotation = p.rig_image.T, state.centre.copy(), state.rotation.copy()
    centre[member] = centre[base] + np.einsum("nji,nj->ni", rotation[base], p.rig_place)
    rotation[member] = p.rig_rotation @ rotation[base]
    return replace(state, centre=centre, rotation=rotation)


def rigs_in(block: Block, rank: np.ndarray) -> Rigs:
    """The pairs of a block. rank (m,): position of each row of images.csv."""
    both = exposures_of(block)
    if not len(both.member):
        return Rigs(np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    mountings, cameras = mountings_of(block), block.images["camera"].to_numpy(object)
    pairs = np.stack([both.base, both.member], axis=1)
    known = {}
    for one, other in set(map(tuple, cameras[pairs])):
        known[one, other] = relative(mountings[one], mountings[other])
    each = [known[one, other] for one, other in cameras[pairs]]
    place, rotation = (np.array([two[k] for two in each]) for k in range(2))
    return Rigs(rank[pairs], place, rotation)


def lots(block: Block) -> np.ndarray:
    """Number (m,) of the exposure of each row of images.csv."""
    both, lot = exposures_of(block), np.arange(len(block.images))
    lot[both.member] = both.base
    return np.unique(lot, return_inverse=True)[1]


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
