"""How much more the scores of candidates vary than independent residuals would let them.

Residuals hang together: a run of images shares its light and its vegetation, a place of the picture
what is left of the lens. With b what a candidate moves in the pictures after everything else has
had its say, w the weights and v the residuals, its score is the sum of b w v, and with clusters c

    s_c = sum in c of b w v,   m_c = sum in c of b w b,   variance = sum of (s_c - m_c theta)^2

Residuals are smaller than the noise, for poses and points follow it, those of one cluster
together: what the variance would be of independent noise is asked of draws. The evidence of a
candidate is that of a likelihood raised to the power of one over the ratio.
Source: Chandler and Bate 2007, "Inference for clustered data using the independence
loglikelihood"; Carter, Schnepel and Steigerwald 2017 (how many clusters count).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from corridor.core.adjustment import Adjustment, Design, Sets
from corridor.core.engine.scene import PANEL
from corridor.diagnosis.evidence.evidence import Evidence, inverted
from corridor.diagnosis.evidence.nothing import residuals, runs
from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.noise.image import places
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import Equations
from corridor.diagnosis.system.groups import Group

# Changes that pass the points at once.
_TOGETHER = PANEL


class Influence:
    """What candidates move in the pictures and at the antenna once all else has followed."""

    def __init__(self, elimination: Elimination, draws: list[np.ndarray] | None = None):
        """draws: as of `drawn`, of the same observations; default: none are made."""
        self.draws = draws or []
        self.elimination = elimination
        self.equations = e = elimination.equations
        sigma = e.scales.of_observation
        self._sigma = np.where(np.isfinite(sigma), sigma, 0.0)[:, None]
        self._design = Design(e.system)
        # Poses and nuisance go where this noise of the GNSS has them, and a lens where it is.
        first = elimination.solve(elimination.here)
        step = self._changes(first, np.zeros((len(e.at), 1)))
        left, *_ = self._design.back(residuals(elimination), step)
        self.residual = self._sigma * left.image[0].reshape(-1, 2)
        self.antenna = e.residual - (elimination.jacobian @ first)[:, 0]
        self.weight = e.scales.of_observation**-2.0

    def moves(self, core: np.ndarray) -> Iterator[np.ndarray]:
        """Of each change of the core (c, k), in prior sigmas, what it moves: pixels (n, 2)."""
        changes = self._changes(-self.elimination.following(core), core)
        for first in range(0, changes.shape[1], _TOGETHER):
            yield from self._moved(changes[:, first : first + _TOGETHER])

    def _moved(self, changes: np.ndarray) -> Iterator[np.ndarray]:
        """What changes of the columns (n, k) move in the pictures, the points following."""
        left, *_ = self._design.back(self._nothing(changes.shape[1]), changes)
        for one in left.image:
            yield -self._sigma * one.reshape(-1, 2)

    def _nothing(self, count: int) -> Sets:
        """So many sets of measurements without an error."""
        rows, control = 2 * len(self._sigma), self.equations.system.control.residual.size
        return Sets([np.zeros(rows) for _ in range(count)], np.zeros((control, count)))

    def scores(self, b: np.ndarray) -> np.ndarray:
        """What each observation says (n,) of what moves the pictures by b (n, 2) px."""
        return (b * self.residual).sum(axis=1) * self.weight

    def of_noise(self, b: np.ndarray, square: Callable[[np.ndarray], float]) -> float | None:
        """The mean of a square of such scores over independent noise; None without draws."""
        root = np.sqrt(self.weight)
        each = [square((b * draw).sum(axis=1) * root) for draw in self.draws]
        return float(np.mean(each)) if each else None

    def moved_by_images(self, group: Group, values: np.ndarray) -> np.ndarray:
        """What values (p,) for each image, in prior sigmas, move in the pictures (n, 2), px."""
        return next(self._moved(self._change_by_images(group, values)))

    def ground_moved_by_images(self, group: Group, values: np.ndarray) -> np.ndarray:
        """How far values (p,) for each image, in prior sigmas, move the points (n, 3), m."""
        system = self.equations.system
        design = Design(system, followed=range(len(system.state.points)))
        _, moved, _ = design.back(self._nothing(1), self._change_by_images(group, values))
        return moved[:, :, 0]

    def _change_by_images(self, group: Group, values: np.ndarray) -> np.ndarray:
        """Change (n, 1) of the columns by values (p,) for each image, all else following."""
        e, at = self.equations, self.elimination.at
        change = np.zeros((len(e.unit), 1))
        change[at, 0] = -e.unit[at] * self.elimination.followed(group, values)
        at = e.own_at[group.own]
        change[at, 0] += e.unit[at] * values
        return change

    def by_cluster(self, core: np.ndarray, cluster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores (clusters, k) and information (clusters, k, k) of changes of the core (c, k).

        cluster: number (images,) of that of each image.
        """
        e = self.equations
        count = int(cluster.max()) + 1
        of_row = cluster[e.system.image_rows.image]
        moves = np.stack(list(self.moves(core)), axis=2)
        weighted = moves * self.weight[:, None, None]
        score, inside = np.zeros((count, core.shape[1])), []
        for n in range(count):
            mine = of_row == n
            score[n] = np.einsum("ijk,ij->k", weighted[mine], self.residual[mine])
            inside.append(np.einsum("ijk,ijl->kl", weighted[mine], moves[mine]))
        if len(e.residual):
            moved = self.antenna_moved(core)
            heavy = self.elimination.weigh(moved)
            of_row = np.repeat(cluster[e.image], 3)
            for n in range(count):
                mine = of_row == n
                score[n] += heavy[mine].T @ self.antenna[mine]
                both = heavy[mine].T @ moved[mine]
                inside[n] += 0.5 * (both + both.T)
        return score, np.array(inside)

    def antenna_moved(self, core: np.ndarray) -> np.ndarray:
        """What changes of the core (c, k) move at the antenna (3k, k), m."""
        first = -self.elimination.following(core)
        return self.elimination.jacobian @ first + self.equations.core.antenna @ core

    def _changes(self, first: np.ndarray, core: np.ndarray) -> np.ndarray:
        """Changes (n, k) of the columns by those of static rows and core, in prior sigmas."""
        e, at = self.equations, self.elimination.at
        changes = np.zeros((len(e.unit), core.shape[1]))
        changes[e.at] = e.unit[e.at, None] * core
        changes[at] += e.unit[at, None] * first
        return changes


def drawn(adjustment: Adjustment, equations: Equations) -> list[np.ndarray]:
    """What independent noise of the pictures leaves of itself (n, 2), in standard deviations.

    After an adjustment of it alone; nothing where the block is held by nothing.
    """
    if equations.free_motions is not None:
        return []
    system, rng, out = adjustment.stated_system, np.random.default_rng(0), []
    sigma = equations.scales.of_observation
    here = system.image_rows.xy - np.nan_to_num(system.residuals().pixels)
    # All else was measured as it is modelled.
    system = system.measuring(
        sigma=sigma,
        gnss=system.gnss.given - system.gnss.residual,
        control=system.control.given - system.control.residual,
        prior=system.columns.shared_value,
        distance=system.distance.given - system.distance.residual,
    )
    size = np.where(np.isfinite(sigma), sigma, 0.0)[:, None]
    for _ in range(SETTINGS.cluster_draws):
        noise = system.measuring(xy=here + size * rng.standard_normal(here.shape))
        left = noise.at(noise.step()).residuals().pixels
        out.append(np.nan_to_num(left / sigma[:, None]))
    return out


def as_spread(evidence: Evidence, found: Found, threshold: float) -> Found:
    """The model with the evidence that each group has as its scores are spread.

    What is then below the threshold goes, the weakest first: another may have stood back for it.
    """
    while True:
        each = dict(found.evidence)
        for n, phi in enumerate(evidence.inflation):
            if n in each and phi > 1.0:
                rest = {k: kappa for k, kappa in found.chosen.items() if k != n}
                spread = evidence.given(rest, spread=True, only=n)[n].evidence
                each[n] = min(each[n] / phi, spread)
        below = [n for n in each if not each[n] > threshold and n not in found.kept]
        if len(below) < 2:
            return found.beyond(each, threshold)
        weakest = min(below, key=lambda n: found.evidence[n] / evidence.inflation[n])
        rest = {k: kappa for k, kappa in found.chosen.items() if k != weakest}
        again = Found.of(evidence, rest, found.kept)
        before = {n: found.evidence[n] for n in rest}
        # What was held against noise stays so, unless the one that goes has stood in its place.
        found = replace(
            again, evidence={n: max(before[n], again.evidence[n]) for n in rest}
        ).ordered


def inflation_of_scores(
    influence: Influence, evidence: Evidence, model: Collection[int]
) -> np.ndarray:
    """Factor (groups,), one at least, on the variance of the scores of each group.

    evidence: with the lens out. model: numbers of the groups that are asked. They have been
    adjusted: beside a model that does not fit, residuals hang together by what it misses, and most
    of all where the cause lies. Others, and shapes, are taken to be like those of their place.
    Source: Burnham and Anderson 2002, 2.5 (the factor is that of a model that fits).
    """
    groups = evidence.groups
    there = [n for n in model if groups[n].single is None]
    beside = {n: SETTINGS.free_size for n in there if groups[n].own is None}
    out = _of_shared(influence, evidence, beside)
    for n in there:
        if groups[n].own is not None:
            out[n] = _within_images(influence, evidence, n)
    asked = [n for n in there if out[n] > 0.0]
    for n in np.flatnonzero(out == 0.0):
        alike = [out[k] for k in asked if _alike(groups[k], groups[n])]
        out[n] = float(np.median(alike)) if alike and groups[n].single is None else 1.0
    return out


def _alike(one: Group, other: Group) -> bool:
    """Whether two groups show alike: both in each image for itself, or shared and in one place."""
    if one.own is not None or other.own is not None:
        return one.own is not None and other.own is not None
    return one.effect.place == other.effect.place


def _of_shared(influence: Influence, evidence: Evidence, beside: dict[int, float]) -> np.ndarray:
    """Factors (groups,) of the named groups of a model that images share, zero of all others."""
    groups = evidence.groups
    out = np.zeros(len(groups))
    asked = [n for n in beside if not groups[n].generic and len(groups[n]) <= SETTINGS.most_free]
    if not asked:
        return out
    theta = {n: _estimate(evidence, n, beside) for n in asked}
    core = np.column_stack([responding(evidence, n, beside)[0] @ theta[n] for n in asked])
    kinds = clusters(influence.equations)
    found = [[_spread(influence, b, cluster) for cluster in kinds] for b in influence.moves(core)]
    usual = [_pooled(1.0, of_kind) for of_kind in zip(*found, strict=True)]
    for n, each in zip(asked, found, strict=True):
        whole = float(theta[n] @ evidence.block(groups[n])[0] @ theta[n])
        # The antenna and the ground have their part in what is known.
        excess = (
            (_pooled(centre, [one]) - 1.0) * one.information / max(one.information, whole, 1e-12)
            for centre, one in zip(usual, each, strict=True)
        )
        out[n] = 1.0 + max(0.0, *excess)
    return out


def _within_images(influence: Influence, evidence: Evidence, n: int) -> float:
    """Factor of values for each image: by places of one picture, about what that image says."""
    group = evidence.groups[n]
    theta, _ = evidence.solution({n: SETTINGS.least_fit_size})
    b = influence.moved_by_images(group, theta[n])
    image = influence.equations.system.image_rows.image
    place = clusters(influence.equations)[1]
    return max(1.0, _ratio(influence, b, place, image)[0])


def _ratio(
    influence: Influence, b: np.ndarray, cluster: np.ndarray, owner: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Variance of scores by clusters over that of independent residuals; information of each.

    b (n, 2): what moves the pictures, px. cluster (n,): number of that of each observation, -1
    outside. owner (n,): number of what has clusters of its own, judged about what it says itself.
    """
    mine, cells = cluster >= 0, int(cluster.max(initial=0)) + 1
    owner = np.zeros(len(cluster), dtype=np.int64) if owner is None else owner
    owners = int(owner.max(initial=0)) + 1
    code, many = (owner * cells + cluster)[mine], owners * cells
    info = (b * b).sum(axis=1) * influence.weight
    m = np.bincount(code, info[mine], many).reshape(owners, -1)
    whole = np.maximum(m.sum(axis=1, keepdims=True), 1e-12)

    def square(score: np.ndarray) -> float:
        s = np.bincount(code, score[mine], many).reshape(owners, -1)
        return float(((s - m * s.sum(axis=1, keepdims=True) / whole) ** 2).sum())

    usual = influence.of_noise(b, square) or float((m - m**2 / whole).sum())
    return (square(influence.scores(b)) / usual if usual > 0.0 else 1.0), m


@dataclass(frozen=True)
class Spread:
    """Variance of a score by clusters over that of independent residuals.

    count: how many clusters of one size would tell as much. information: of what they hold.
    """

    ratio: float
    count: float
    information: float


def _spread(influence: Influence, b: np.ndarray, cluster: np.ndarray) -> Spread:
    ratio, m = _ratio(influence, b, cluster)
    total = float(m.sum())
    count = total**2 / float((m**2).sum()) if total > 0.0 else 0.0
    # Fewer say nothing of a spread, once their mean is taken off.
    if count < SETTINGS.fewest - 1:
        return Spread(1.0, 0.0, total)
    return Spread(ratio, count, total)


def _pooled(centre: float, spreads: Iterable[Spread]) -> float:
    """The ratio that spreads tell of where `centre` is what one expects; one at least."""
    spreads = list(spreads)
    worth = SETTINGS.clusters_of_prior
    told = worth * centre + sum(one.count * one.ratio for one in spreads)
    return max(1.0, told / (worth + sum(one.count for one in spreads)))


def _estimate(evidence: Evidence, n: int, beside: dict[int, float]) -> np.ndarray:
    """Parameters (p,) of a group of the size at which a fit is judged, beside others n -> kappa."""
    rest = {k: kappa for k, kappa in beside.items() if k != n}
    theta, _ = evidence.solution(rest | {n: SETTINGS.least_fit_size}, each_image=False)
    return theta[n]


def responding(
    evidence: Evidence, n: int, beside: dict[int, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Change of the core (c, p) by a unit of each parameter of the n-th group, others following.

    beside: groups n -> kappa that images share. Also M (p, p) and g (p,) that they leave.
    """
    group, rest = evidence.groups[n], {k: v for k, v in beside.items() if k != n}
    left, r = evidence.beside(rest), evidence.reduced
    core = np.zeros((len(r.g), len(group)))
    core[group.columns] = np.eye(len(group))
    if rest:
        at, sizes, _ = evidence.laid(rest)
        inverse, _ = inverted(r.M[np.ix_(at, at)] + np.diag(sizes**-2.0))
        core[at] = -inverse @ r.M[np.ix_(at, group.columns)]
    columns = group.columns
    return core, left.M[np.ix_(columns, columns)], left.g[columns]


def clusters(equations: Equations) -> list[np.ndarray]:
    """Numbers (n,) of the cluster of each observation, -1 outside: runs of images, and places."""
    system, rows = equations.system, equations.system.image_rows
    place = places(rows.xy, system.images.size[rows.image])
    return [np.where(rows.tie, one, -1) for one in (runs(system)[rows.image], place)]
