"""What changed between two dates: one result, read as text, page, table or picture."""

from __future__ import annotations

from dataclasses import dataclass, field

from corridor.core.adjustment import Adjustment
from corridor.tools.change.admission import Objection
from corridor.tools.change.comparison import Comparison
from corridor.tools.change.explanation import Explanation
from corridor.tools.change.joint import Joint
from corridor.tools.change.points import PointChanges
from corridor.tools.change.report import of_change
from corridor.tools.change.surface import PatchChange, SurfaceChange, Volume


@dataclass(frozen=True, eq=False)
class Compared:
    """Points, surface and volumes of one pair of adjustments."""

    adjustments: tuple[Adjustment, Adjustment]
    joint: Joint = field(repr=False)
    points: PointChanges | None
    surface: SurfaceChange | None
    volumes: dict[str, Volume]
    patches: tuple[PatchChange, ...] = ()

    @property
    def moved(self) -> bool:
        """Whether a point or a patch of the surface did."""
        return bool(self.patches) or (self.points is not None and bool(self.points.moved.any()))


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
        """`unfit` where an epoch does not fit its own model, else `moved`, `camera`, `undecided`
        or `nothing`; see `Explanation.verdict`."""
        if self.objections:
            return "unfit"
        if self.explanation is not None:
            return self.explanation.verdict
        return "moved" if self.final.moved else "nothing"

    def __repr__(self) -> str:
        return f"Change from {self.names[0]} to {self.names[1]}: {self.verdict}"

    def __str__(self) -> str:
        return str(of_change(self))

    def _repr_html_(self) -> str:
        return of_change(self).html()
