"""How two dates are compared: everything that may be asked for, and whether it can be done."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import date

import numpy as np
from scipy.spatial import cKDTree

from corridor.core.adjustment import Adjustment, gnss_of_metres, listed, read_corners
from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.tools.change.cores import Cores
from corridor.tools.change.joint import Joint
from corridor.tools.change.registration import MOTIONS
from corridor.tools.change.surface import usual_degree

DEGREES = (0, 1, 2)
DATUMS = ("stated", "stable")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is asked of two dates.

    common: errors that both epochs share, of `control` (the same coordinates of a control point in
        both), `priors` (the same value known beforehand), `gnss` (the base station's).
    gnss_bias: standard deviation, m (one number or three), of a constant error of the GNSS.
    datum: `stated`: as each epoch's control and GNSS say; `stable`: laid together on what stands
        still by a motion: `translation`, `rigid`, `similarity`. Default: `stable` where an epoch
        hangs on GNSS of metres alone, else `stated`.
    level: false discovery rate of single tests, level of the global ones.
    surface: whether surfaces are compared. camera: whether effects of the camera are asked for.
    together: both dates in one adjustment. stable: ground points that stand still, one point
        there (default: those that do as far as can be seen). same_camera: one calibration.
    reject_gnss: see `corridor.adjust`.
    largest: m, displacement of a named point beyond which the name means something else.

    Of the surface:

    spacing: of the core points, m (default: half the radius). radius: of the cylinder in which
        points count, m (default: so that it holds some 15). normal: `local` or `vertical`.
    degree: 0 the mean of the points (M3C2), 1 a plane, 2 with curvature (default: what the
        roughness at hand lets be told best).
    profile (n, 2): core points along this line instead of a grid. polygons: name -> (n, 2), m, for
        volumes.
    rays: images that must show a tie point. same_ties: a tie point of one name is one point of the
        ground.

    Raises InputError for a value that means nothing.
    """

    common: str | Iterable[str] = ("control", "priors")
    gnss_bias: float | Iterable[float] | None = None
    datum: str | None = None
    motion: str = "rigid"
    level: float = 0.01
    surface: bool = True
    camera: bool = True
    together: bool = False
    stable: str | Iterable[str] | None = None
    same_camera: bool = False
    reject_gnss: bool = False
    largest: float = 5.0
    spacing: float | None = None
    radius: float | None = None
    normal: str = "local"
    degree: int | None = None
    profile: np.ndarray | None = None
    polygons: Mapping[str, np.ndarray] | None = None
    rays: int = 3
    same_ties: bool = False

    def __post_init__(self):
        # A text, and what can be walked through once, are names too, whenever they are asked for.
        object.__setattr__(self, "common", tuple(listed(self.common)))
        if self.stable is not None:
            object.__setattr__(self, "stable", tuple(listed(self.stable)))
        if self.datum is not None and self.datum not in DATUMS:
            raise InputError(f"datum {self.datum!r} is unknown: use {' or '.join(DATUMS)}")
        if self.motion not in MOTIONS:
            raise InputError(f"motion {self.motion!r} is unknown: use one of {', '.join(MOTIONS)}")
        if not 0 < self.level < 1:
            raise InputError(f"level {self.level} is not a probability between 0 and 1")
        if self.degree is not None and self.degree not in DEGREES:
            raise InputError(
                f"a surface of degree {self.degree} is unknown: use 0 (the mean), 1 (a plane) or 2"
            )
        if not self.together and (self.same_camera or self.stable is not None):
            what = "one calibration for both dates (--same-camera)"
            what = what if self.same_camera else "points that stand still (--stable)"
            raise InputError(f"{what}: it goes with both dates in one adjustment, add --together")

    @property
    def bias(self) -> np.ndarray | None:
        """Standard deviations (3,), m, of a constant error of the GNSS; None: nobody states one."""
        if self.gnss_bias is None:
            return None
        return np.broadcast_to(np.asarray(self.gnss_bias, float), 3)

    @property
    def surfaces(self) -> dict:
        """How surfaces are compared, for `surface_change` and `volume`."""
        return {"degree": self.degree or 0, "sampled": not self.same_ties}

    def chosen(self, joint: Joint, cores: Cores) -> Comparison:
        """The same with a degree of the surface."""
        if self.degree is not None:
            return self
        return replace(self, degree=usual_degree(joint, cores, DEGREES, not self.same_ties))


def read_line(path: str | os.PathLike) -> np.ndarray:
    """Corners (n, 2), m, of a CSV file with the columns x and y, two or more, in its order.

    Raises InputError where the file is missing or is no such table.
    """
    return read_corners(path, least=2)


def check_blocks(before: Block, after: Block) -> None:
    """Raises InputError where two blocks cannot be compared: coordinates, dates."""
    if before.crs and after.crs and before.crs != after.crs:
        raise InputError(
            f"block.toml: crs of BEFORE is {before.crs}, of AFTER {after.crs}: bring both blocks "
            "into one system"
        )
    if np.abs(before.offset - after.offset).max() > 1e-6:
        told = ["[" + ", ".join(f"{v:.12g}" for v in b.offset) + "]" for b in (before, after)]
        raise InputError(
            f"block.toml: offset of BEFORE is {told[0]}, of AFTER {told[1]}: coordinates differ by "
            "metres that are no motion; write both blocks with one offset"
        )
    dates = [_date(block, name) for block, name in ((before, "BEFORE"), (after, "AFTER"))]
    if all(dates) and dates[0] > dates[1]:
        raise InputError(
            f"block.toml: BEFORE is of {dates[0]}, AFTER of {dates[1]}: exchange the two blocks"
        )


def _date(block: Block, name: str) -> date | None:
    given = block.extra.get("date")
    if given is None or isinstance(given, date):
        return given.date() if hasattr(given, "date") else given
    try:
        return date.fromisoformat(str(given)[:10])
    except ValueError:
        raise InputError(
            f"block.toml of {name}: date = {given!r} is not a date; write it as 2024-05-31"
        ) from None


def check_datum(before: Adjustment, after: Adjustment, datum: str) -> None:
    """Raises InputError where an epoch is a free network and the datum is to be the stated one."""
    free = [
        name for name, one in (("BEFORE", before), ("AFTER", after)) if one.system.held is not None
    ]
    if free and datum != "stable":
        both = len(free) == 2
        raise InputError(
            f"{' and '.join(free)} {'have' if both else 'has'} neither control nor GNSS and so no "
            "datum: give control points or GNSS, or align both on what stands still "
            "(--datum stable --motion similarity)"
        )


def usual_datum(adjusted: Iterable[Adjustment]) -> str:
    """`stable` where an epoch hangs on GNSS of metres alone, and floats by as much; else
    `stated`."""
    for one in adjusted:
        alone = not len(one.system.control_names) and one.system.held is None
        if alone and gnss_of_metres(one.start):
            return "stable"
    return "stated"


def check_meeting(before: np.ndarray, after: np.ndarray, cores: Cores) -> None:
    """Raises InputError where the surfaces of both epochs (n, 3) lie beyond each other's reach."""
    heights = [xyz[cKDTree(xyz[:, :2]).query(cores.xyz[:, :2])[1], 2] for xyz in (before, after)]
    apart = float(np.median(np.abs(heights[1] - heights[0])))
    beside = before[cKDTree(before[:, :2]).query(before[:, :2], 2)[1], 2]
    steep = float(np.median(np.abs(beside[:, 1] - beside[:, 0])))
    if apart > cores.reach and steep > cores.reach:
        raise InputError(
            f"the surface is steep: points beside each other in plan lie {steep:.1f} m (median) "
            "apart in height at one date already. Of a wall compare named points (--points-only), "
            "or give both blocks in coordinates whose z points out of it"
        )
    if apart > cores.reach:
        raise InputError(
            f"the surfaces of both epochs lie {apart:.1f} m apart in height (median) where both "
            f"show the ground, and are looked for within {cores.reach:.1f} m: look at what "
            "`corridor adjust` says of both, at their focal lengths and their datum above all"
        )


def check_names(names: np.ndarray, shift: np.ndarray, sigma: np.ndarray, largest: float) -> None:
    """Raises InputError where a name means different points: it lies further off than ground moves.

    shift, sigma (k, 3), m.
    """
    away = np.linalg.norm(shift, axis=1)
    wrong = away > np.maximum(largest, 6.0 * np.linalg.norm(sigma, axis=1))
    common = np.median(shift, axis=0)
    if len(shift) > 2 and wrong.all() and np.linalg.norm(shift - common, axis=1).max() < largest:
        raise InputError(
            "all {} common points lie ({:+.1f}, {:+.1f}, {:+.1f}) m apart in the two epochs: bring "
            "both into one system of coordinates and of heights (ellipsoid, geoid), with offset in "
            "block.toml".format(len(shift), *common)
        )
    if wrong.any():
        k = int(np.argmax(np.where(wrong, away, 0.0)))
        more = f" ({wrong.sum() - 1} more so)" if wrong.sum() > 1 else ""
        raise InputError(
            f"point {names[k]} lies {away[k]:.1f} m apart in the two epochs{more}: the name means "
            f"different points; rename one (marks.csv, ground.csv), or allow motions beyond "
            f"{largest:g} m (--largest-motion)"
        )


def check_overlap(before: np.ndarray, after: np.ndarray) -> None:
    """Raises InputError where points (n, 3) of both epochs lie in places apart."""
    if not (len(before) and len(after)):
        return
    boxes = [np.percentile(xyz[:, :2], [1, 99], axis=0) for xyz in (before, after)]
    low, high = np.maximum(boxes[0][0], boxes[1][0]), np.minimum(boxes[0][1], boxes[1][1])
    if (low > high).any():
        apart = float(np.linalg.norm(np.maximum(low - high, 0.0)))
        raise InputError(
            f"the epochs do not overlap: their ground lies {apart:.0f} m apart; check that both "
            "blocks are of the same place and in the same coordinates"
        )
