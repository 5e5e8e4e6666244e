"""What changed between two dates: one result, read as text, page, table or picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from corridor.core.adjustment import Adjustment
from corridor.tools.change.admission import Objection
from corridor.tools.change.comparison import Comparison
from corridor.tools.change.explanation import Explanation
from corridor.tools.change.joint import Joint
from corridor.tools.change.points import PointChanges
from corridor.tools.change.report import of_change
from corridor.tools.change.surface import PatchChange, SurfaceChange, Volume

# Marked points that contradict a patch of the surface, and by how many standard deviations.
LEAST_POINTS, FAR_APART = 3, 3.0


@dataclass(frozen=True, eq=False)
class Compared:
    """Points, surface and volumes of one pair of adjustments.

    patches: of the surface that moved. apart: what seems to move and is no ground, and why: a
    sentence each.
    """

    adjustments: tuple[Adjustment, Adjustment]
    joint: Joint = field(repr=False)
    points: PointChanges | None
    surface: SurfaceChange | None
    volumes: dict[str, Volume]
    patches: tuple[PatchChange, ...] = ()
    apart: tuple[str, ...] = ()

    @property
    def moved(self) -> bool:
        """Whether a point or a patch of the surface did."""
        return bool(self.patches) or (self.points is not None and bool(self.points.moved.any()))

    @property
    def doubted(self) -> bool:
        """Whether a point did, but an effect could have moved it, or nothing else says so."""
        undecided = None if self.points is None else self.points.undecided
        return undecided is not None and bool(undecided.any())

    @property
    def cover(self) -> Cover | None:
        """What the patches are where marked points in them stand still and contradict them."""
        points, surface = self.points, self.surface
        if not self.patches or points is None or points.moved.any():
            return None
        ways = {np.sign(one.change) for one in self.patches}
        rows = np.unique(np.concatenate([one.rows for one in self.patches]))
        # Control that fits both dates stands still too.
        inside = cKDTree(surface.cores.xyz[rows, :2]).query(points.xyz[:, :2])[0]
        inside = inside < surface.cores.radius
        # What covers everything shows at all marks, where the few in a patch show too little.
        found = (self._covered(rows, some) for some in (inside, np.ones(len(inside), dtype=bool)))
        return None if len(ways) > 1 else next(filter(None, found), None)

    def _covered(self, rows: np.ndarray, inside: np.ndarray) -> Cover | None:
        """Core points that some marked points (k,) contradict; all of them where they change by no
        more than the surface at all marks, or a bowl between these would be grass."""
        points, surface = self.points, self.surface
        if inside.sum() < LEAST_POINTS:
            return None
        # The surface where these points are: at the rim of a bowl both move little.
        away = cKDTree(points.xyz[inside, :2]).query(surface.cores.xyz[:, :2])[0]
        up = np.flatnonzero(inside) * 3 + 2
        weight = np.full(len(up), 1.0 / len(up))
        still = float(weight @ points.shift[inside, 2])
        sigma = float(np.sqrt(weight @ points.covariance[np.ix_(up, up)] @ weight))
        whole, there = (
            PatchChange.of(surface, some, max(p.probability for p in self.patches))
            for some in (rows, np.flatnonzero(away < surface.cores.radius))
        )
        apart = abs(there.change - still) / np.hypot(there.sigma, sigma)
        if apart < FAR_APART or abs(still) > FAR_APART * sigma:
            return None
        more = abs(whole.change - there.change) / np.hypot(whole.sigma, there.sigma)
        if inside.all() and more > FAR_APART:
            return None
        whole = whole.chosen(max(one.wider for one in self.patches))
        return Cover(whole, int(inside.sum()), still, sigma)


@dataclass(frozen=True)
class Cover:
    """What lies or grows on the ground: patch: what changed; points: how many marked ones stand in
    it, with their mean change in height and its standard deviation, m."""

    patch: PatchChange
    points: int
    still: float
    sigma: float


@dataclass(frozen=True, eq=False)
class Change:
    """What moved between two dates, what the camera explains of it, and how sure that is.

    names: of both blocks. compared: as adjusted. remaining: with the effects modelled that the
    measurements of an epoch show (None: none is). explanation: None where it was not asked for.
    objections: why the dates cannot be compared, see `corridor.tools.change.admission`.
    gained: with one adjustment of both dates, the median standard deviations (m) of the surface
    apart and together. notes: sentences.
    """

    names: tuple[str, str]
    asked: Comparison
    compared: Compared
    remaining: Compared | None
    explanation: Explanation | None
    gained: tuple[float, float] | None
    notes: tuple[str, ...]
    objections: tuple[Objection, ...] = ()

    @property
    def final(self) -> Compared:
        """With everything modelled that the measurements show."""
        return self.remaining or self.compared

    @property
    def points(self) -> PointChanges | None:
        """Displacements of named points."""
        return self.final.points

    @property
    def surface(self) -> SurfaceChange | None:
        """Change of the surface at core points."""
        return self.final.surface

    @property
    def volumes(self) -> dict[str, Volume]:
        """Change of volume by polygon."""
        return self.final.volumes

    @property
    def verdict(self) -> str:
        """`unfit` where an epoch does not fit its own model, `cover` where what lies or grows on
        the ground changed, else `moved`, `camera`, `undecided` or `nothing`; see `Explanation`."""
        if self.objections:
            return "unfit"
        if self.final.cover is not None:
            return "cover"
        if self.explanation is not None:
            return self.explanation.verdict
        unexplained = "undecided" if self.final.doubted else "nothing"
        return "moved" if self.final.moved else unexplained

    def __repr__(self) -> str:
        return f"Change from {self.names[0]} to {self.names[1]}: {self.verdict}"

    def __str__(self) -> str:
        return str(of_change(self))

    def _repr_html_(self) -> str:
        return of_change(self).html()
