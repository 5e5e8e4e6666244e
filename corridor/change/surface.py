"""The change of the surface at core points, and the standard deviation of that very number."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from scipy.stats import t

from corridor.brief import brief
from corridor.change.clouds import Cloud, Functions
from corridor.change.cores import Cores
from corridor.change.joint import Joint
from corridor.change.laying import Laying, lay
from corridor.change.m3c2 import LEAST, Members, distance_functions, members
from corridor.change.roughness import excess, sampling, with_roughness
from corridor.change.significance import discoveries, two_sided
from corridor.errors import InputError
from corridor.report import with_units

_LENGTHS = "x y z station across change sigma sampling detection_95 rough_before rough_after"


@brief
@dataclass(frozen=True, eq=False)
class SurfaceChange:
    """Distances along the normals at core points, after minus before.

    distance (k,), m. sigma (k,): of the measurements, exact; sampling (k,): of rough ground that
    both dates show at other points. count, roughness (k, 2): points in the cylinders before and
    after, and the standard deviation of their heights. probability (k,) of so large a distance,
    were nothing changed. moved (k,): significant at the false discovery rate asked for.
    freedom (k,): degrees of freedom of the standard deviation: a handful of points does not tell
    how rough the ground is, and Student's distribution takes the normal one's place.
    functions: the distances as functions of the points of `joint`.
    """

    cores: Cores
    distance: np.ndarray
    sigma: np.ndarray
    sampling: np.ndarray
    count: np.ndarray
    roughness: np.ndarray
    freedom: np.ndarray
    level: float
    functions: Functions = field(repr=False)
    joint: Joint = field(repr=False)
    laying: Laying | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.distance)

    def sums(self, matrix) -> Functions:
        """Sums of the distances, by a matrix (s, k), as functions of the points."""
        if self.laying is None:
            return self.functions.combined(matrix)
        return self.laying.sums(self.functions, matrix)

    @property
    def total(self) -> np.ndarray:
        """Standard deviation (k,), m, of the measurements and of the sampling."""
        return np.hypot(self.sigma, self.sampling)

    @property
    def detection(self) -> np.ndarray:
        """Level of detection (k,), m: a change of this size is seen with 95 % confidence."""
        return t.ppf(0.975, self.freedom) * self.total

    @property
    def floor(self) -> np.ndarray:
        """The same (k,), m, were the ground covered with points: of the measurements alone."""
        return t.ppf(0.975, np.inf) * self.sigma

    @property
    def probability(self) -> np.ndarray:
        """Of so large a distance, were nothing changed (k,)."""
        return two_sided(self.distance / self.total, self.freedom)

    @property
    def moved(self) -> np.ndarray:
        """Significant at the false discovery rate `level` (k,)."""
        return discoveries(self.probability, self.level)

    @property
    def frame(self) -> pd.DataFrame:
        """A row a core point: place, normal, distance and what belongs to it, m."""
        table = pd.DataFrame(dict(zip("xyz", self.cores.xyz.T, strict=True)))
        table[["nx", "ny", "nz"]] = self.cores.normal
        table["station"], table["across"] = self.cores.station, self.cores.across
        table["change"], table["sigma"] = self.distance, self.sigma
        table["sampling"], table["detection_95"] = self.sampling, self.detection
        table[["points_before", "points_after"]] = self.count
        table[["rough_before", "rough_after"]] = self.roughness
        table = table.assign(probability=self.probability, significant=self.moved.astype(int))
        return with_units(table, {"m": _LENGTHS})


def surface_change(
    joint: Joint,
    cores: Cores,
    level: float = 0.01,
    degree: int = 0,
    sampled: bool = True,
    datum: str = "stated",
    kind: str = "rigid",
    laying: Laying | None = None,
) -> SurfaceChange:
    """The change between both clouds of `joint` at core points where each shows a surface.

    level: false discovery rate. degree: see `members`. sampled: False where both surfaces are the
    very same points of the ground, one for one, so that its roughness cancels. datum: `stated`, or
    `stable`: laid together by a motion of the kind of `stable.MOTIONS` on what stands still.
    laying: the motion found by another surface of the same dates, in place of one's own.
    Raises InputError where no core point shows a surface at both dates.
    """
    if not len(cores):
        raise InputError("no core points are given: there is no surface to compare")
    clouds = (joint.before, joint.after)
    found = _both(clouds, cores, degree, sampled)
    least = max(LEAST, found[0].fit + 2)
    kept = np.flatnonzero((found[0].count >= least) & (found[1].count >= least))
    if not len(kept):
        raise InputError(
            f"no core point has {least} tie points within {cores.radius:.1f} m at both dates: give "
            "a larger radius (--radius), or measure more tie points"
        )
    cores = only(cores, kept)
    found = _both(clouds, cores, degree, sampled)
    between = np.zeros((2, len(cores)))
    if sampled:
        rough = [excess(c, f, cores) for c, f in zip(clouds, found, strict=True)]
        between = np.array([sampling(f, r) for f, r in zip(found, rough, strict=True)])
        joint = joint.with_clouds(
            *(with_roughness(c, f, cores, r) for c, f, r in zip(clouds, found, rough, strict=True))
        )
    functions = distance_functions(*found, cores, joint)
    distance, variance = found[1].mean - found[0].mean, joint.variance(functions)
    own = laying is None
    if laying is not None:
        laying = laying.elsewhere(functions, joint.after)
    elif datum == "stable":
        alone = np.sqrt(joint.own_variance(functions) + between.sum(axis=0))
        laying = lay(distance, alone, functions, joint.after, kind)
    if laying is not None:
        variance = np.maximum(laying.variance(joint, functions, variance), 0.0)
        distance, known = laying.apply(distance), variance + between.sum(axis=0)
        if own:
            independent = laying.independent(joint, functions, between.sum(axis=0))
            laying = laying.scaled(distance / np.sqrt(known), independent)
        variance = variance + (laying.scale**2 - 1.0) * known
    return SurfaceChange(
        cores=cores,
        distance=distance,
        sigma=np.sqrt(variance),
        sampling=np.sqrt(between.sum(axis=0)),
        count=np.column_stack([f.count for f in found]),
        roughness=np.column_stack([f.spread for f in found]),
        freedom=_freedom(
            variance,
            between,
            np.array([f.count - f.fit for f in found]),
            np.inf if laying is None else laying.freedom,
        ),
        level=level,
        functions=functions,
        joint=joint,
        laying=laying,
    )


def _freedom(
    variance: np.ndarray, between: np.ndarray, free: np.ndarray, scale_freedom: float
) -> np.ndarray:
    """Degrees of freedom (k,) of a variance (k,) that is known and two (2, k) that are estimated.

    free (2, k): points of each beyond what was fitted. scale_freedom: of the scale of them all, see
    `Laying`. Source: Welch 1947.
    """
    whole = (variance + between.sum(axis=0)) ** 2
    doubt = np.sum(between**2 / free, axis=0) + whole / scale_freedom
    return np.divide(whole, doubt, out=np.full(len(whole), np.inf), where=doubt > 0)


def _both(clouds: tuple[Cloud, Cloud], cores: Cores, degree: int, sampled: bool) -> list[Members]:
    """The points in each cylinder; the same ones where both clouds are the same points."""
    first = members(clouds[0], cores, degree)
    if sampled:
        return [first, members(clouds[1], cores, degree)]
    return [first, first.elsewhere(*clouds, cores)]


def only(cores: Cores, rows: np.ndarray) -> Cores:
    """Some of the core points."""
    return replace(
        cores,
        xyz=cores.xyz[rows],
        normal=cores.normal[rows],
        station=cores.station[rows],
        across=cores.across[rows],
    )
