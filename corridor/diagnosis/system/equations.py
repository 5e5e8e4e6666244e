"""The normal equations of a converged adjustment with a column for every candidate.

The points are eliminated and leave poses, what images share, and the candidates; robust weights
are replaced by pseudo-residuals, so that the candidates meet a plain least squares problem. The
GNSS is kept apart: its noise is coloured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, hstack, vstack

from corridor.core.adjustment import Adjustment, LinearSystem, open_motions
from corridor.core.brief import brief
from corridor.core.effects import Effect
from corridor.diagnosis.noise.image import Scales, pseudo_residuals
from corridor.diagnosis.system.groups import Group, make_groups


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


@brief
@dataclass
class Equations:
    """Everything about a block at a state, points eliminated.

    matrix (n, n) sparse, right (n,): poses (6 an image, in the system's order), then nuisance:
    what else the believed model estimates. jacobian (3k, n) sparse, residual (3k,), stated (3k,)
    standard deviation, image (k,): of the antenna positions. core: columns that images share;
    own: blocks of per-image columns; between: each of them with the core (p, c); mutual: (i, j)
    -> of two of them, i < j.
    owner (n,): position of the image to which each of the poses and nuisance belongs, -1 of what
    images share. first (n,), at (c,), own_at: numbers of the poses and nuisance, of the core, and
    of the blocks, among the system's columns, and unit of all of these. free_motions: (n, 7 or
    fewer) of a block that nothing holds, else None. kept: by those who solve these equations.
    """

    system: LinearSystem
    matrix: csc_array
    right: np.ndarray
    jacobian: csr_array
    core: Columns
    own: list[Columns]
    between: list[np.ndarray]
    mutual: dict[tuple[int, int], csc_array]
    groups: list[Group]
    owner: np.ndarray
    first: np.ndarray
    at: np.ndarray
    own_at: list[np.ndarray]
    unit: np.ndarray
    scales: Scales | None = None
    free_motions: np.ndarray | None = None
    pixels: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    kept: dict = field(default_factory=dict)

    @cached_property
    def residual(self) -> np.ndarray:
        """Of the antenna positions (3k,), m."""
        return self.system.gnss.residual.ravel()

    @cached_property
    def stated(self) -> np.ndarray:
        """Standard deviations (3k,), m, of the antenna positions as gnss.csv has them."""
        return self.system.gnss.sigma.ravel()

    @cached_property
    def without(self) -> tuple[np.ndarray, np.ndarray]:
        """Right side (n,) of poses and nuisance, and residuals of the antenna (3k,), of no effect.

        What has been estimated of candidates is put back: all that is tested counts as missing.
        """
        blocks = [self.core, *self.own]
        right = self.right + sum(np.asarray(b.cross @ b.value) for b in blocks)
        return right, self.residual + sum(np.asarray(b.antenna @ b.value) for b in blocks)

    @cached_property
    def core_without(self) -> np.ndarray:
        """Right side (c,) of the core, of no effect."""
        out = self.core.right + self.core.inside @ self.core.value
        for to_core, block in zip(self.between, self.own, strict=True):
            out = out + to_core.T @ block.value
        return out

    @cached_property
    def own_without(self) -> list[np.ndarray]:
        """Right side (p,) of each block of per-image columns, of no effect."""
        out = []
        for n, block in enumerate(self.own):
            mine = block.right + block.inside @ block.value + self.between[n] @ self.core.value
            for k, other in enumerate(self.own):
                if k != n:
                    both = self.mutual[n, k] if n < k else self.mutual[k, n].T
                    mine = mine + both @ other.value
            out.append(np.asarray(mine))
        return out

    def owner_of(self, group: Group) -> np.ndarray:
        """Image (p,) of each value of a group that images have for themselves."""
        images = len(self.system.columns.images)
        return np.repeat(np.arange(images), len(self.own_at[group.own]) // images)

    @property
    def image(self) -> np.ndarray:
        """Image (k,) of each antenna position."""
        return self.system.gnss.image


def moved_by(e: Equations, group: Group, theta: np.ndarray) -> Equations:
    """The equations of data that a group with parameters (p,), in prior sigmas, has moved too."""
    block = e.core if group.own is None else e.own[group.own]
    value = block.value.copy()
    value[group.columns] += theta
    block = replace(block, value=value)
    if group.own is None:
        return replace(e, core=block, kept={})
    own = [block if n == group.own else one for n, one in enumerate(e.own)]
    return replace(e, own=own, kept={})


def equations(adjustment: Adjustment, effects: list[Effect], priors: Mapping) -> Equations:
    """Equations at the result of an adjustment.

    effects: candidates; those that the adjustment estimated stand where it left them. What else
    it estimated is nuisance, with the priors it had there. priors: of candidates, by slug or
    `slug.parameter`.
    """
    system = adjustment.stated_system.testing(effects)
    residual, rows = system.residuals().pixels, system.image_rows
    found, scales = pseudo_residuals(system, residual)
    # Behind a camera there is no residual to change.
    xy = rows.xy + np.nan_to_num(found - residual)
    system = system.measuring(xy=xy, sigma=scales.of_observation)
    groups = make_groups(system.columns, len(system.control_names), effects, priors)
    out = take_apart(system, groups)
    out.scales, out.pixels = scales, found
    return out


def take_apart(system: LinearSystem, groups: list[Group]) -> Equations:
    """Split the equations into poses and nuisance, what images share, and per-image columns."""
    columns, jacobian = system.columns, system.gnss.jacobian
    tested = {group.slug for group in groups}
    core = np.concatenate([columns.of(slug) for slug in tested] or [[]]).astype(int)
    core.sort()
    own = {slug: at for slug, at in columns.of_image.items() if slug in tested}
    # In units of prior standard deviations.
    unit = np.ones(len(columns))
    for group in groups:
        at = core if group.own is None else own[group.slug].ravel()
        unit[at[group.columns]] = group.scale
    believed = [at for slug, at in columns.of_image.items() if slug not in tested]
    nuisance = np.setdiff1d(columns.shared_at, core)
    rest = [columns.pose, *([np.concatenate(believed, axis=1)] if believed else [])]
    first = np.concatenate([*(at.ravel() for at in rest), nuisance]).astype(int)
    blocks = list(own.values())

    def dense(rows: np.ndarray, shared: np.ndarray) -> np.ndarray:
        return unit[rows][:, None] * system.with_shared(rows, shared) * unit[shared]

    def sparse(one: np.ndarray, other: np.ndarray) -> csc_array:
        made = system.of_images(one, other)
        made.data *= unit[one.ravel()][made.indices]
        made.data *= np.repeat(unit[other.ravel()], np.diff(made.indptr))
        return made

    def whole(block: np.ndarray) -> csc_array:
        """Poses and nuisance with what images have for themselves."""
        shared = csc_array(dense(block.ravel(), nuisance).T)
        return csc_array(vstack([*(sparse(at, block) for at in rest), shared]))

    def with_gnss(at: np.ndarray) -> csr_array:
        return csr_array(jacobian[:, at] @ diags_array(unit[at]))

    images = np.arange(len(columns.images))
    each = [np.repeat(images, at.shape[1]) for at in rest]
    nothing_holds = not len(system.gnss.names) and len(system.control_names) < 3
    free = system.motions[first][:, open_motions(system.problem)]
    out = Equations(
        system=system,
        matrix=csc_array(hstack([*map(whole, rest), csc_array(dense(first, nuisance))])),
        right=system.right[first],
        jacobian=with_gnss(first),
        core=Columns(
            dense(first, core),
            dense(core, core),
            system.right[core] * unit[core],
            with_gnss(core).toarray(),
            columns.value[core] / unit[core],
        ),
        own=[
            Columns(
                whole(at),
                sparse(at, at),
                system.right[at.ravel()] * unit[at.ravel()],
                with_gnss(at.ravel()),
                columns.value[at.ravel()] / unit[at.ravel()],
            )
            for at in blocks
        ],
        between=[dense(at.ravel(), core) for at in blocks],
        mutual={(i, j): sparse(blocks[i], blocks[j]) for j in range(len(blocks)) for i in range(j)},
        groups=groups,
        owner=np.concatenate([*each, np.full(len(nuisance), -1)]),
        first=first,
        at=core,
        own_at=[at.ravel() for at in blocks],
        unit=unit,
        free_motions=free if nothing_holds else None,
    )
    # Of thousands of images it weighs too much to be there twice.
    system.let_go()
    return out
