"""What of a change the effects of camera and flight explain, and what they cannot.

The change of two dates is put in few numbers that are tested together: named points, cells of the
surface (`Evidence`). Each effect of the catalogue has a shape on the ground and an amount that the
measurements of its own date say, or leave open. Three vectors of the same change follow: as
adjusted; with all effects estimated with their priors, one and all; with those that the
measurements show. What survives the second moved; what was there, was to be seen, and is gone in
the third was the camera.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.sparse import csr_array, vstack

from corridor.core.brief import brief
from corridor.tools.change.joint import Joint
from corridor.tools.change.points import PointChanges
from corridor.tools.change.signature import Signatures
from corridor.tools.change.significance import (
    Patch,
    Test,
    discs_in,
    normal_scores,
    patches,
    patches_beside,
    tested,
)
from corridor.tools.change.surface import SurfaceChange

# Cells of the surface at most: their covariance is a dense matrix.
MOST_CELLS = 240
# Lengths (m, as shares of the extent) and heights of the motions that ground may make.
_LENGTHS = (0.1, 0.25)
# Share of a change that effects have to explain where what is left is no change of any place.
NEARLY_ALL = 0.95
_EPOCHS = ("before", "after")


@dataclass(frozen=True, eq=False)
class Evidence:
    """Changes (k,), m, with their covariance (k, k), places (k, 2), which are of the surface (k,),
    and what the effects of each epoch would do to them: effect (k, e), a column a parameter of
    `Signatures`. freedom (k,): degrees of freedom of each variance, see `SurfaceChange`;
    redundancy: of the scale of them all, where what stands still tells it (`Registration`).
    cells (c, n): the mean of core points in each cell; near (c, c): which of them are neighbours.
    """

    value: np.ndarray
    covariance: np.ndarray
    places: np.ndarray
    of_surface: np.ndarray
    signatures: tuple[Signatures, ...]
    effect: tuple[np.ndarray, ...]
    freedom: np.ndarray
    redundancy: float = np.inf
    cells: csr_array | None = None
    near: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.value)

    @property
    def every(self) -> tuple[set[str], ...]:
        """What each epoch could have: effects of camera and flight, and what its measurements
        show, were it a shape that stands for the unknown."""
        return tuple(s.named | s.shown() | s.unknown for s in self.signatures)

    def without(self, slugs: tuple[set[str], ...]) -> tuple[np.ndarray, np.ndarray]:
        """Value and covariance once effects of each epoch are estimated with their priors."""
        value, covariance = self.value.copy(), self.covariance.copy()
        for signature, effect, some in zip(self.signatures, self.effect, slugs, strict=True):
            at = signature.of(some)
            if len(at):
                found = signature.estimate(at)
                value -= effect[:, at] @ found.value
                covariance += effect[:, at] @ found.covariance @ effect[:, at].T
        return value, covariance

    def test(self, level: float, slugs: tuple[set[str], ...] = ()) -> Test:
        """Whether the changes are significant, with some effects of each epoch estimated."""
        value, covariance = self.without(slugs) if slugs else (self.value, self.covariance)
        return self.tested(value, covariance, level)

    def tested(self, value: np.ndarray, covariance: np.ndarray, level: float) -> Test:
        """Whether other values of the same changes are significant, by such a covariance."""
        return tested(value, covariance, level, self.freedom, self.redundancy)

    def patches(self, level: float) -> list[Patch]:
        """Patches of the surface that moved beside every effect of camera and flight."""
        at = np.flatnonzero(self.of_surface)
        if not len(at):
            return []
        value, covariance = self.without(self.every)
        covariance = covariance[np.ix_(at, at)]
        sigma = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        z = normal_scores(value[at] / sigma, self.freedom[at])
        alike = covariance / sigma[:, None] / sigma
        noise = np.diag(self.covariance)[at]
        whole = self.value[at], self.covariance[np.ix_(at, at)]
        shifted = discs_in(patches(z, alike, self.near, 0.5 * level), *whole, self.places[at])
        beside = patches_beside(z * sigma, covariance, noise, self.places[at], 0.5 * level)
        taken = [cell for one in shifted for cell in one.cells]
        # Beside a bowl a whole date that is shifted is raised too: half of the most is its rim.
        rims = (0.5 * np.abs(value[at][one.cells]).max() for one in shifted)
        return [
            replace(one, cells=one.cells[np.abs(value[at][one.cells]) > rim])
            for one, rim in zip(shifted, rims, strict=True)
        ] + [one for one in beside if not np.isin(one.cells, taken).any()]

    def besides(self, cells: Iterable[int] = (), points: Iterable[int] = ()) -> Evidence:
        """The same without some cells of the surface and some points, by their numbers here."""
        gone = np.zeros(len(self), dtype=bool)
        gone[np.flatnonzero(self.of_surface)[np.array([*cells], dtype=int)]] = True
        gone[np.flatnonzero(~self.of_surface).reshape(-1, 3)[np.array([*points], dtype=int)]] = True
        left, gone = np.flatnonzero(~gone), gone[self.of_surface]
        return replace(
            self,
            value=self.value[left],
            covariance=self.covariance[np.ix_(left, left)],
            places=self.places[left],
            of_surface=self.of_surface[left],
            effect=tuple(effect[left] for effect in self.effect),
            freedom=self.freedom[left],
            cells=None if self.cells is None else self.cells[~gone],
            near=None if self.near is None else self.near[np.ix_(~gone, ~gone)],
        )

    def cores_of(self, patch: Patch) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Numbers of the core points of a patch and of its disc, and its weights of all of them."""
        weight = None if patch.weight is None else patch.weight @ self.cells
        rows, disc = (np.unique(self.cells[some].indices) for some in (patch.cells, patch.disc))
        return rows, disc, weight

    def judged(self, points: PointChanges | None, level: float) -> PointChanges | None:
        """Points that moved beside every effect told from those that an effect could have moved."""
        at = np.flatnonzero(~self.of_surface)
        if points is None or not len(at):
            return points
        value, covariance = self.without(self.every)
        changed = self.test(level).significant
        return points.beside_effects(value[at], covariance[np.ix_(at, at)], level, changed)


def gathered(
    joint: Joint,
    points: PointChanges | None,
    surface: SurfaceChange | None,
    signatures: tuple[Signatures, ...],
) -> Evidence:
    """Points that are not held and cells of the surface as one vector with its covariance."""
    parts, cells, near = [], None, None
    if points is not None and not points.held.all():
        at = np.flatnonzero(np.repeat(~points.held, 3))
        places = np.repeat(points.xyz[:, :2], 3, axis=0)[at]
        parts.append((points.functions[at], points.shift.ravel()[at], places, False))
    if surface is not None:
        cells, near = _cells(surface)
        means = cells @ surface.distance, cells @ surface.cores.xyz[:, :2]
        parts.append((surface.sums(cells), *means, True))
    functions = vstack([part[0] for part in parts], format="csr")
    value, places = (np.concatenate([part[n] for part in parts]) for n in (1, 2))
    of_surface = np.repeat([part[3] for part in parts], [len(part[1]) for part in parts])
    covariance = joint.covariance(functions)
    if surface is not None:
        uneven = cells @ surface.rough
        covariance[np.ix_(of_surface, of_surface)] += (uneven @ uneven.T).toarray()
    effect = tuple(s.on(p) for s, p in zip(signatures, joint.parts(functions), strict=False))
    freedom, redundancy = np.full(len(value), np.inf), np.inf
    registration = None if surface is None else surface.registration
    if registration is not None:
        scale = np.where(of_surface, registration.scale, 1.0)
        covariance = scale[:, None] * covariance * scale
        redundancy = registration.freedom
    if surface is not None:
        # Only what comes from rough ground is uncertain, and no surer than at one core point there.
        rough, least = np.zeros(len(value)), np.ones(len(value))
        rough[of_surface] = surface.sampling_of_sums(cells)
        least[of_surface] = np.maximum(cells @ surface.count.min(axis=1) - 1.0, 1.0)
        some = of_surface & (rough > 0)
        freedom[some] = least[some] * (np.diag(covariance)[some] / rough[some]) ** 2
        freedom[of_surface] = np.minimum(freedom[of_surface], redundancy)
    return Evidence(
        value, covariance, places, of_surface, signatures, effect, freedom, redundancy, cells, near
    )


def _cells(found: SurfaceChange) -> tuple[csr_array, np.ndarray]:
    """The matrix (c, k) that takes the mean of the core points in each cell of the surface, and
    which cells (c, c) touch."""
    where = np.column_stack([found.cores.station, found.cores.across])
    # A mean of few points of rough ground errs by much more often than its sigma says.
    size = (2.0 if np.any(found.sampling > 0.0) else 1.0) * found.cores.radius
    while True:
        # A core on an edge is of the next cell, whatever rounding makes of it.
        cell = np.floor(where / size + 1e-6).astype(int)
        where_is, number, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        if len(count) <= MOST_CELLS:
            break
        size *= 1.15
    number = number.ravel()
    entries = (1.0 / count[number], (number, np.arange(len(number))))
    near = np.abs(where_is[:, None] - where_is).max(axis=2) <= 1
    return csr_array(entries, shape=(len(count), len(number))), near


@brief
@dataclass(frozen=True)
class Explanation:
    """What effects do to a change.

    as_adjusted, all_modelled, shown_modelled: tests of the change as adjusted, with every effect
    estimated with its prior, and with those that the measurements show. visible: whether the
    change as adjusted would be significant with the covariance of `shown_modelled`. shown: the
    effects that the measurements of each epoch show. moved: whether a point or a patch of the
    surface did, beside every effect; doubted: whether a point did, but an effect could have moved
    it. table: epoch, effect, what the epoch says of it (log_evidence), share of the change that has
    its shape, share that its value explains, probability against ground motion, whether it alone
    could hide the change. explained: share of what is beyond noise that is gone with all of `shown`
    modelled.
    """

    as_adjusted: Test
    all_modelled: Test
    shown_modelled: Test
    visible: bool
    shown: tuple[set[str], ...]
    table: pd.DataFrame
    explained: float = 0.0
    moved: bool = False
    doubted: bool = False

    @property
    def verdict(self) -> str:
        """`moved`, `camera`, `undecided`, or `nothing` where no change is significant."""
        if self.moved:
            return "moved"
        if not self.as_adjusted.significant:
            return "nothing"
        # As a whole alone, a map of hundreds of cells is significant where its sigmas are a little
        # too small: that is no change of any place where next to nothing is left of it.
        told = self.visible or self.explained > 0.5
        left = self.shown_modelled
        gone = not left.significant or (not left.located and self.explained > NEARLY_ALL)
        if any(self.shown) and told and gone:
            return "camera"
        return "undecided" if self.as_adjusted.located or self.doubted else "nothing"


def explain(evidence: Evidence, level: float, moved: bool, doubted: bool = False) -> Explanation:
    """What effects do to a change; moved, doubted: see `Explanation`."""
    plain = evidence.test(level)
    shown = tuple(signatures.shown() for signatures in evidence.signatures)
    value, covariance = evidence.without(shown)
    return Explanation(
        as_adjusted=plain,
        all_modelled=evidence.test(level, evidence.every),
        shown_modelled=evidence.tested(value, covariance, level),
        visible=evidence.tested(evidence.value, covariance, level).significant,
        shown=shown,
        table=_table(evidence, level, plain.significant),
        explained=_Shares.of(evidence, plain.significant).of_values(value),
        moved=moved,
        doubted=doubted,
    )


def explained_again(
    first: Explanation,
    before: Evidence,
    after: Evidence,
    level: float,
    shown: tuple[set[str], ...],
    moved: bool,
    doubted: bool,
) -> Explanation:
    """The explanation once what the measurements show is estimated with everything else.

    before, after: the change as it was and as that leaves it. Seen is what would be significant
    with the errors as they are now.
    """
    visible = len(before) != len(after)
    return replace(
        first,
        all_modelled=after.test(level, after.every),
        shown_modelled=after.test(level),
        visible=visible or after.tested(before.value, after.covariance, level).significant,
        shown=shown,
        moved=moved,
        doubted=doubted,
    )


def _table(evidence: Evidence, level: float, significant: bool) -> pd.DataFrame:
    """A row an effect and epoch, the likeliest explanation first."""
    shares = _Shares.of(evidence, significant)
    ground = ground_motion(evidence)
    rows = []
    for n, (signatures, effect) in enumerate(
        zip(evidence.signatures, evidence.effect, strict=True)
    ):
        for slug in sorted(signatures.named | signatures.unknown):
            some = [set()] * len(evidence.signatures)
            some[n] = {slug}
            value, covariance = evidence.without(tuple(some))
            at = signatures.of([slug])
            shape = effect[:, at]
            fitted = np.linalg.lstsq(shares.root @ shape, shares.root @ evidence.value, 1e-8)[0]
            likely = _log_density(value, covariance) - ground
            estimate = signatures.estimate(at)
            free = signatures.estimate(at, free=True)
            rows.append(
                {
                    "epoch": _EPOCHS[n] if len(evidence.signatures) == 2 else "both",
                    "effect": slug,
                    "place": signatures.effects[slug].place,
                    "log_evidence": signatures.log_evidence([slug]),
                    "shape_share": shares.of_values(evidence.value - shape @ fitted),
                    "explained": shares.of_values(value),
                    "probability": float(1.0 / (1.0 + np.exp(-np.clip(likely, -700, 700)))),
                    "hides": significant
                    and not evidence.tested(value, covariance, level).significant,
                    "needed": float(np.abs(fitted).max(initial=0.0)),
                    "value": float(estimate.value[0]) * signatures.scale[at[0]],
                    "sigma": float(np.sqrt(max(free.covariance[0, 0], 0.0)))
                    * signatures.scale[at[0]],
                    "parameter": signatures.labels[at[0]].rpartition(".")[2],
                    "unit": signatures.units[at[0]],
                }
            )
    table = pd.DataFrame(rows)
    if not len(table):
        return table
    return table.sort_values(
        ["hides", "probability", "explained"], ascending=False, kind="stable"
    ).reset_index(drop=True)


@dataclass(frozen=True)
class _Shares:
    """Shares of a change: of its weighted square, less what noise alone would have.

    root: of the weights; whole: the weighted square; noise: its expectation. Of a change that is
    not significant there is nothing to share: 0.
    """

    root: np.ndarray
    whole: float
    noise: float

    @classmethod
    def of(cls, evidence: Evidence, significant: bool) -> _Shares:
        value, vector = np.linalg.eigh(evidence.covariance)
        kept = value > 1e-10 * value[-1]
        root = vector[:, kept].T / np.sqrt(value[kept])[:, None]
        whole = float(np.sum((root @ evidence.value) ** 2))
        return cls(root, whole, float(kept.sum()) if significant else np.inf)

    def of_values(self, left: np.ndarray) -> float:
        """The share that is gone where these changes are left."""
        beyond = max(self.whole - self.noise, 0.05 * self.whole)
        if not np.isfinite(self.noise) or not beyond > 0:
            return 0.0
        return float(min((self.whole - np.sum((self.root @ left) ** 2)) / beyond, 1.0))


def ground_motion(evidence: Evidence) -> float:
    """Log density of the change, were it motion of the ground: patches of a tenth or a quarter of
    the extent, as high as fits best."""
    away = np.linalg.norm(evidence.places[:, None] - evidence.places, axis=2)
    extent = max(float(away.max(initial=0.0)), 1e-9)
    size = max(float(np.sqrt(np.mean(evidence.value**2))), 1e-6)
    best = -np.inf
    for length in _LENGTHS:
        alike = np.exp(-((away / (length * extent)) ** 2))
        for height in size * np.array([0.5, 1.0, 2.0]):
            density = _log_density(evidence.value, evidence.covariance + height**2 * alike)
            best = max(best, density)
    return best


def _log_density(value: np.ndarray, covariance: np.ndarray) -> float:
    """Of a normal vector, up to a constant that the dimension alone decides."""
    lifted = covariance + 1e-10 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    _, volume = np.linalg.slogdet(lifted)
    return -0.5 * float(value @ np.linalg.solve(lifted, value)) - 0.5 * float(volume)
