"""Whether two dates may be compared: each epoch fits its own model, and both have one datum.

The covariance of a change is that of a model which holds. It is believed where

- the given coordinates of common ground points agree between the two `ground.csv`;
- the residuals of every kind of observation, of every flight, are as large as stated;
- effects that were estimated have a size that such effects have;
- control with the same coordinates at both dates comes out at the same place.

What fails is an `Objection`. Source: Pelzer 1971 (congruency), Foerstner 1979 (sigma naught by
group), Baarda 1968 (data snooping).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.core.effects import find
from corridor.core.errors import InputError, some
from corridor.core.output import counted, fixed
from corridor.tools.change.joint import SAME_M
from corridor.tools.change.points import PointChanges
from corridor.tools.change.significance import congruency

# Level of every test of an epoch, divided among the tests of its kind: so seldom a sound epoch is
# turned away.
FALSE_REFUSAL = 1e-3
# A scale that is too small by so much makes of a test at 1e-4 one at 1e-2, which a comparison at
# the usual level bears: 2 (1 - Phi(3.89 / 1.5)) = 0.0095.
SLACK = 1.5
# An estimated effect of so many standard deviations of what one expects of it is another cause.
FAR = 5.0
FLIGHTS, BOTH_FLIGHTS = ("the first flight", "the second flight"), "the adjustment of both flights"
# Who fails where no flight does by itself.
BOTH_DATES = "the two dates"
_AXES = {"plan": " horizontally", "height": " in height"}
_WRONG = {
    "gnss": "float or wrong fixes, exchanged images",
    "control": "wrong coordinates or names, points that moved themselves since they were surveyed "
    "(survey these again, or give them the role check at both dates)",
    "attitude": "wrong images, axes or units",
}
_CALLED = {"gnss": "GNSS positions", "control": "control points", "attitude": "attitudes"}


@dataclass(frozen=True)
class Objection:
    """Why dates cannot be compared. who: what fails; what: how, both for one sentence; remedy: a
    sentence, what to do."""

    who: str
    what: str
    remedy: str


# --- given coordinates -------------------------------------------------------------------------


def slips(before: Block, after: Block) -> Iterator[str]:
    """That one block is given twice, and that points have other names at the second date."""
    first, second = (block.tie_points[["x", "y"]].to_numpy() for block in (before, after))
    if len(first) and np.array_equal(first, second):
        yield (
            "The two dates have the same image measurements: it is one block given twice, so "
            "nothing can have moved. Name the folders of two flights."
        )
    sides = [block.ground[block.ground["role"] != "unused"] for block in (before, after)]
    names = [set(side["point"]) for side in sides]
    places = [side[["x", "y", "z"]].to_numpy(float) for side in sides]
    called = {}
    for name, place in zip(sides[1]["point"], places[1], strict=True):
        near = np.flatnonzero((np.abs(places[0] - place) <= SAME_M).all(axis=1))
        other = str(sides[0]["point"].iloc[near[0]]) if len(near) else name
        if name not in names[0] and other not in names[1]:
            called[other] = str(name)
    if called:
        told = some([f"{old} is {new}" for old, new in called.items()], 3)
        yield (
            f"{counted(len(called), 'ground point')} of the first date have another name at the "
            f"second ({told}): points are compared by their names. Give each one name."
        )


@dataclass(frozen=True)
class Coordinates:
    """Given coordinates (k, 3), m, of ground points of both dates, second minus first.

    names, control (k,): whether a point is control at one of them. sigma (k, 3), m: of both
    surveys. differ (k,): beyond what these allow, by itself or as all do; or at all where most
    are the same. together: whether all of them are shifted, turned or scaled as one.
    """

    names: list[str]
    control: np.ndarray
    difference: np.ndarray
    sigma: np.ndarray
    differ: np.ndarray
    together: bool

    @classmethod
    def of(cls, before: Block, after: Block) -> Coordinates:
        """Compared by the chi-square of each point, at `FALSE_REFUSAL` divided among all, and by
        that of a similarity of all, which errors of single points average out of."""
        sides = [
            {
                str(name): (xyz, sigma, role == "control")
                for name, xyz, sigma, role in zip(
                    block.ground["point"],
                    block.numbers("ground", *"xyz"),
                    block.ground_sigma(),
                    block.ground["role"],
                    strict=True,
                )
                if np.isfinite(xyz).all()
            }
            for block in (before, after)
        ]
        names = [name for name in sides[0] if name in sides[1]]
        first, second = ([side[name] for name in names] for side in sides)
        control = np.array([a[2] or b[2] for a, b in zip(first, second, strict=True)], dtype=bool)
        apart = np.array([b[0] - a[0] for a, b in zip(first, second, strict=True)]).reshape(-1, 3)
        sigma = np.array([np.hypot(a[1], b[1]) for a, b in zip(first, second, strict=True)])
        sigma = sigma.reshape(-1, 3)
        differ = _beyond(apart, sigma)
        # Where most are of one survey, what differs from it is no noise of a survey.
        other = (np.abs(apart) > np.maximum(SAME_M, 0.1 * sigma)).any(axis=1)
        whole = None
        if other.sum() < 0.5 * len(other):
            differ |= other
        else:
            xyz = np.array([one[0] for one in first]).reshape(-1, 3)
            whole = _as_one(xyz, apart, sigma, ~differ)
        if whole is not None:
            differ |= ~_beyond(apart - whole, sigma)
        return cls(names, control, apart, sigma, differ, whole is not None)

    @property
    def two_datums(self) -> bool:
        """Whether most of them differ, which is no mistake of one point, and no datum is common:
        that takes three control points that stayed, while others moved or were mistaken."""
        most, stayed = self.differ.sum() > 0.5 * len(self.differ), self.control & ~self.differ
        return bool(most and (self.together or stayed.sum() < 3))

    @property
    def mistaken(self) -> list[str]:
        """Control points that differ where others agree."""
        return [] if self.two_datums else self._named(self.differ & self.control)

    @property
    def displacements(self) -> dict[str, np.ndarray]:
        """Of those that differ (3,), m, by name."""
        return dict(zip(self._named(self.differ), self.difference[self.differ], strict=True))

    def objections(self) -> Iterator[Objection]:
        """That the dates are in two datums."""
        if not self.two_datums:
            return
        apart, sigma = self.difference[self.differ], self.sigma[self.differ]
        median = np.median(apart, axis=0)
        left = np.abs((apart - median)[_beyond(apart - median, sigma)]).max(initial=0.0)
        which = (
            f"{self.differ.sum()} of {len(self.differ)} ground points have other coordinates in "
            "the second ground.csv than in the first"
        )
        far = np.linalg.norm(self.difference[self.differ], axis=1).max()
        each = np.abs(apart - median).max() > np.abs(median).max()
        if left > np.abs(median).max() and not self.together:
            yield Objection(
                BOTH_DATES,
                f"have control that is not the same: {which}, each by another amount, up to "
                f"{far:.3f} m",
                "Give each point that was painted anew, or moved, a name of its own at the second "
                "date, and correct the coordinates of the others.",
            )
            return
        if self.together and each:
            by = f"turned or scaled as a whole, by up to {far:.3f} m"
        else:
            by = "by (" + ", ".join(f"{v:+.3f}" for v in median) + ") m in the median"
            by += "" if left < 0.2 * np.abs(median).max() else f", and up to {left:.3f} m more"
        yield Objection(
            BOTH_DATES,
            f"have two datums: {which}, {by}",
            "Bring both surveys into one system (same base, geoid and projection), or lay both "
            "dates together on what stands still (--datum stable).",
        )

    def check(self, largest: float, flown: np.ndarray) -> None:
        """Raises InputError where two datums lie farther apart than ground moves, m.

        flown (3,): from the images of the first date to those of the second, m. Where these lie
        elsewhere by the same vector it is another place, which is told later.
        """
        for one in self.objections():
            apart = np.median(self.difference[self.differ], axis=0)
            size = np.linalg.norm(apart)
            if size > largest and not np.linalg.norm(apart - flown) < 0.5 * size:
                raise InputError(f"{one.who} {one.what}. {one.remedy}")

    def notes(self) -> Iterator[str]:
        """Points whose coordinates differ, by name."""
        if self.two_datums:
            return
        for kind, which in (("control", self.control), ("check", ~self.control)):
            rows = np.flatnonzero(self.differ & which)
            if len(rows):
                by = [f"{self.names[k]} by {self._by(k)}" for k in rows[:8]]
                what = (
                    "They do not count as control of either date, and are compared as other points."
                    if kind == "control"
                    else "They are not used."
                )
                yield (
                    f"The two ground.csv give other coordinates to {some(by, 8)}: a point that was "
                    f"surveyed or typed wrongly, or one that moved. {what}"
                )

    def _by(self, k: int) -> str:
        return "(" + ", ".join(f"{v:+.3f}" for v in self.difference[k]) + ") m"

    def _named(self, which: np.ndarray) -> list[str]:
        return [name for name, yes in zip(self.names, which, strict=True) if yes]


def _beyond(apart: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Which of vectors (k, 3) their standard deviations do not allow (k,)."""
    size = np.sum((apart / sigma) ** 2, axis=1)
    return size > chi2.isf(FALSE_REFUSAL / max(len(size), 1), 3)


def _as_one(
    xyz: np.ndarray, apart: np.ndarray, sigma: np.ndarray, some: np.ndarray
) -> np.ndarray | None:
    """What a small similarity does to all points (k, 3) of which some (k,) tell it by `apart`
    (k, 3); None where that is chance, or not what they do.

    Of fewer than four it is a shift: three points fit every turn of a plane.
    """
    if not some.any():
        return None
    away = xyz - xyz[some].mean(axis=0)
    size = max(float(np.abs(away).max()), 1.0)
    scaled, turned = away[:, :, None], np.cross(np.eye(3), away[:, None, :]).transpose(0, 2, 1)
    design = np.broadcast_to(np.eye(3), (len(xyz), 3, 3))
    if some.sum() > 3:
        design = np.concatenate([design, scaled / size, turned / size], axis=2)
    rows = (design / sigma[:, :, None])[some].reshape(-1, design.shape[2])
    right = (apart / sigma)[some].ravel()
    found, _, rank, _ = np.linalg.lstsq(rows, right, rcond=1e-6)
    told, left = rows @ found, right - rows @ found
    if chi2.sf(told @ told, rank) >= FALSE_REFUSAL:
        return None
    fits = rank == len(right) or chi2.sf(left @ left, len(right) - rank) >= FALSE_REFUSAL
    return design @ found if fits else None


# --- an epoch against its own model ------------------------------------------------------------


def misfits(adjustment: Adjustment, who: str) -> Iterator[Objection]:
    """Groups of observations that lie farther off than the comparison bears.

    By sigma naught of each kind of observation, flight, and plan or height, against the standard
    deviations that count; see `Adjustment.variance_components`.
    """
    table = adjustment.variance_components
    table = table[table["kind"].isin(_CALLED) & (table["redundancy"] >= 1.0)]
    # Beside image points that scatter more than stated, all that is stated counts as more.
    scale = max(adjustment.sigma0, 1.0)
    for one in table.itertuples(index=False):
        limit = chi2.isf(FALSE_REFUSAL / len(table), one.redundancy)
        if one.sigma0**2 * one.redundancy <= (SLACK * scale) ** 2 * limit:
            continue
        called = _CALLED[one.kind]
        where = f" of flight {one.flight}" if one.flight else ""
        yield Objection(
            who,
            f"the residuals of its {called}{where} are {fixed(one.sigma0, 1)} times as large as "
            f"stated{_AXES.get(one.part, '')} (most at {_worst(adjustment, one)})",
            f"Look at {called} of {who}: {_WRONG[one.kind]}, or standard deviations that are "
            "stated too small.",
        )


def _worst(adjustment: Adjustment, group) -> str:
    """The name of the largest residual of a row of the variance components."""
    table = getattr(adjustment.reliability, group.kind)
    mine = table["axis"].isin(["z"] if group.part in ("height", "yaw") else ["x", "y"])
    key = table.columns[0]
    if group.flight:
        images = adjustment.block.images
        mine &= table[key].isin(images.loc[images["flight"].astype(str) == group.flight, "image"])
    return str(table.loc[table.loc[mine, "w"].abs().idxmax(), key])


def strange_effects(adjustment: Adjustment, slugs: Iterable[str], who: str) -> Iterator[Objection]:
    """Effects that came out larger than such effects are."""
    for slug in sorted(slugs):
        if slug not in adjustment.values:
            continue
        one = adjustment.values[slug]
        for k, parameter in enumerate(one.parameters):
            # A mistake in the ground control may have any size.
            far = np.inf if one.effect.place == "ground" else FAR * parameter.scale
            value = one.value[:, k]
            if one.kind == "image":
                value = np.sqrt(np.nanmean(value**2, keepdims=True))
            sure = np.abs(value) - 2.0 * np.nan_to_num(np.nanmedian(one.sigma[:, k]))
            if sure.max() > min(parameter.most, far):
                worst = value[np.argmax(sure)]
                size = abs(worst) / parameter.scale
                yield Objection(
                    who,
                    f"its measurements require {find(slug).called} of {fixed(size, 0)} times the "
                    f"usual size ({parameter.name} = {worst:.3g} {parameter.unit})",
                    f"Something else than {find(slug).called} is wrong with {who}: "
                    "`corridor diagnose` says what its model lacks.",
                )
                break


def held_apart(points: PointChanges | None, scale: float) -> Iterator[Objection]:
    """Control with the same coordinates at both dates that comes out at two places.

    scale: sigma naught of the epochs, the smaller; below 1 control is no better than stated.
    """
    if points is None or not points.held.any():
        return
    at = np.flatnonzero(np.repeat(points.held, 3))
    shift = min(scale, 1.0) / SLACK * points.shift.ravel()[at]
    found = congruency(shift, points.covariance[np.ix_(at, at)])
    if found.probability >= FALSE_REFUSAL:
        return
    rows = np.flatnonzero(points.held)
    sigma = points.sigma[rows]
    worst = int(np.argmax(np.max(np.abs(points.shift[rows]) / np.maximum(sigma, 1e-9), axis=1)))
    by = 1000 * np.linalg.norm(points.shift[rows[worst]])
    yield Objection(
        "one of the two flights",
        f"{counted(len(rows), 'control point')} with the same coordinates at both dates come out "
        f"at two places ({points.names[rows[worst]]} most, by {fixed(by, 0)} mm)",
        "Run `corridor diagnose` on each date to find what its model lacks. If control itself "
        "moved between the dates, survey it again, or give it the role check.",
    )
