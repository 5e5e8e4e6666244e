"""The change of the surface at core points and of volumes, each with the standard deviation of
that very number.

A volume is the area's share of each cell times its change of height, summed: again a linear
function of the points. Its variance comes from the one covariance of all of them, in which the
errors of neighbouring cells, nearly the same, add up instead of averaging out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from matplotlib.path import Path
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.stats import t

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.output import with_units
from corridor.tools.change.cores import Cores
from corridor.tools.change.epoch import Cloud
from corridor.tools.change.joint import Joint
from corridor.tools.change.m3c2 import (
    LEAST_IN_CYLINDER,
    Members,
    distance_functions,
    members,
    roughness,
    sampling,
)
from corridor.tools.change.registration import Registration, lay
from corridor.tools.change.significance import discoveries, two_sided

# Core points by which the degree of the surface is chosen.
SOME = 300
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
    functions: the distances as functions of the points of `joint`; rough: what rough ground does to
    them, point by point, see `corridor.tools.change.m3c2.sampling`.
    """

    cores: Cores
    distance: np.ndarray
    sigma: np.ndarray
    sampling: np.ndarray
    count: np.ndarray
    roughness: np.ndarray
    freedom: np.ndarray
    level: float
    functions: csr_array = field(repr=False)
    rough: csr_array = field(repr=False)
    joint: Joint = field(repr=False)
    registration: Registration | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.distance)

    def sums(self, matrix) -> csr_array:
        """Sums of the distances, by a matrix (s, k), as functions of the points."""
        if self.registration is None:
            return csr_array(csr_array(matrix) @ self.functions)
        return self.registration.sums(self.functions, matrix)

    def sigma_of_sums(self, matrix) -> np.ndarray:
        """Standard deviations (s,), m, of such sums: of measurements and sampling."""
        sums = self.sums(matrix)
        scale = 1.0 if self.registration is None else self.registration.scale
        return scale * np.sqrt(self.joint.variance(sums) + self.sampling_of_sums(matrix))

    def sampling_of_sums(self, matrix) -> np.ndarray:
        """Variances (s,), m^2, of such sums by the sampling of rough ground."""
        return _squares(csr_array(matrix) @ self.rough)

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
    registration: Registration | None = None,
) -> SurfaceChange:
    """The change between both clouds of `joint` at core points where each shows a surface.

    level: false discovery rate. degree: see `members`. sampled: False where both surfaces are the
    very same points of the ground, one for one, so that its roughness cancels. datum: `stated`, or
    `stable`: laid together by a motion of the kind of `registration.MOTIONS` on what stands still.
    registration: the motion found by another surface of the same dates, in place of one's own.
    Raises InputError where no core point shows a surface at both dates.
    """
    if not len(cores):
        raise InputError("no core points are given: there is no surface to compare")
    clouds = (joint.before, joint.after)
    found = _both(clouds, cores, degree, sampled)
    least = max(LEAST_IN_CYLINDER, found[0].fit + 2)
    enough = [(one.count >= least) & ~one.beyond for one in found]
    kept = np.flatnonzero(enough[0] & enough[1])
    if not len(kept):
        raise InputError(
            f"no core point has {least} tie points within {cores.radius:.1f} m at both dates: give "
            "a larger radius (--radius), or measure more tie points"
        )
    cores = cores.only(kept)
    found = _both(clouds, cores, degree, sampled)
    rough, free = csr_array((len(cores), 0)), np.full(len(cores), np.inf)
    if sampled:
        squares, free = roughness(clouds, found, cores)
        rough = sampling(clouds, found, squares)
    between = _squares(rough)
    functions = distance_functions(clouds, found, cores)
    distance, variance = found[1].mean - found[0].mean, joint.variance(functions)
    own = registration is None and datum == "stable"
    if own:
        alone = np.sqrt(joint.own_variance(functions) + between)
        registration = lay(distance, alone, functions, joint.after, kind)
    elif registration is not None:
        registration = registration.elsewhere(functions, joint.after)
    if registration is not None:
        variance = np.maximum(registration.variance(joint, functions, variance), 0.0)
        distance, known = registration.apply(distance), variance + between
        if own:
            registration = registration.scaled(joint, functions, distance / np.sqrt(known), between)
        variance = variance + (registration.scale**2 - 1.0) * known
    return SurfaceChange(
        cores=cores,
        distance=distance,
        sigma=np.sqrt(variance),
        sampling=np.sqrt(between),
        count=np.column_stack([f.count for f in found]),
        roughness=np.column_stack([f.spread for f in found]),
        freedom=_freedom(
            variance, between, free, np.inf if registration is None else registration.freedom
        ),
        level=level,
        functions=functions,
        rough=rough,
        joint=joint,
        registration=registration,
    )


def _squares(rows: csr_array) -> np.ndarray:
    """Sums of the squares (k,) of the rows."""
    return np.asarray(rows.multiply(rows).sum(axis=1)).ravel()


def _freedom(
    variance: np.ndarray, between: np.ndarray, free: np.ndarray, scale_freedom: float
) -> np.ndarray:
    """Degrees of freedom (k,) of a variance (k,) that is known and one (k,) that is estimated.

    free (k,): of the roughness. scale_freedom: of the scale of them all, see `Registration`.
    Source: Welch 1947.
    """
    whole = (variance + between) ** 2
    doubt = between**2 / free + whole / scale_freedom
    return np.divide(whole, doubt, out=np.full(len(whole), np.inf), where=doubt > 0)


def usual_degree(joint: Joint, cores: Cores, degrees: Iterable[int], sampled: bool) -> int:
    """The degree whose surface is told best at the roughness at hand: of the least median
    standard deviation over some core points. Of the very same points the mean has the least.
    """
    if not sampled:
        return min(degrees)
    some = cores.only(np.unique(np.linspace(0, len(cores) - 1, SOME).astype(int)))
    found = {}
    for degree in degrees:
        try:
            found[degree] = np.median(surface_change(joint, some, degree=degree).total)
        except InputError:
            continue
    return min(found, key=found.get, default=min(degrees))


def _both(clouds: tuple[Cloud, Cloud], cores: Cores, degree: int, sampled: bool) -> list[Members]:
    """The points in each cylinder; the same ones where both clouds are the same points."""
    first = members(clouds[0], cores, degree)
    if sampled:
        return [first, members(clouds[1], cores, degree)]
    return [first, first.elsewhere(*clouds, cores)]


@brief
@dataclass(frozen=True)
class PatchChange:
    """A patch of the surface that moved one way: mean change of its height at places that stay,
    and its standard deviation, m.

    rows: its core points. station, across: where it moved most, m. area: m^2. probability: of one
    as significant anywhere on the surface, were nothing moved. weight (k,): of all core points in
    the change. local: whether it is one against the surface around. wider: how much larger the
    standard deviation is than of an area that nothing chose, see `significance.discs_in`.
    """

    rows: np.ndarray
    change: float
    sigma: float
    station: float
    across: float
    area: float
    probability: float
    weight: np.ndarray
    local: bool = False
    wider: float = 1.0

    @classmethod
    def of(
        cls,
        surface: SurfaceChange,
        rows: np.ndarray,
        probability: float,
        weight: np.ndarray | None = None,
    ) -> PatchChange:
        """The mean of some core points; weight: of a change against the surface around them."""
        # Along a slope a surface that sinks comes nearer by less than it sinks: by least squares.
        local, upwards = weight is not None, surface.cores.normal[rows, 2]
        if local:
            weight = weight * (weight[rows].sum() / (weight[rows] @ upwards))
        else:
            weight = np.zeros(len(surface))
            weight[rows] = upwards / (upwards @ upwards)
        # What moved most says where.
        most = np.ones(len(rows)) if local else surface.distance[rows] ** 2
        most = most / most.sum()
        return cls(
            rows=rows,
            change=float(weight @ surface.distance),
            sigma=float(surface.sigma_of_sums(weight[None])[0]),
            station=float(most @ surface.cores.station[rows]),
            across=float(most @ surface.cores.across[rows]),
            area=float(len(rows) * surface.cores.spacing**2),
            probability=probability,
            weight=weight,
            local=local,
        )

    def chosen(self, wider: float) -> PatchChange:
        """The same with a standard deviation so much larger, as the data chose the area."""
        return replace(self, sigma=wider * self.sigma, wider=wider)


@brief
@dataclass(frozen=True)
class Volume:
    """A change of volume, m^3: value with sigma (of the measurements) and sampling (of rough
    ground between the points). area: covered, m^2; share: of the polygon that could be compared.
    independent: what the sigma would be, were the cells independent.
    """

    value: float
    sigma: float
    sampling: float
    area: float
    share: float
    independent: float

    @property
    def total(self) -> float:
        """Standard deviation, m^3, of the measurements and of the sampling."""
        return float(np.hypot(self.sigma, self.sampling))


def volume(
    joint: Joint, polygon: np.ndarray, cores: Cores, degree: int = 0, sampled: bool = True,
    registration: Registration | None = None,
) -> Volume:  # fmt: skip
    """The change of volume within a polygon (n, 2), after minus before, up is more.

    cores: whose spacing and radius are used; the cells are upright. registration: of the whole
    surface, see `surface_change`. Raises InputError where the polygon holds no cell that both
    epochs show.
    """
    polygon = np.asarray(polygon, float)[:, :2]
    upright = _cells(polygon, cores, joint)
    try:
        found = surface_change(
            joint, upright, degree=degree, sampled=sampled, registration=registration
        )
    except InputError:
        raise InputError(
            "the polygon holds no ground that both epochs show: check its coordinates, which are "
            "those of the block (world minus offset)"
        ) from None
    return summed(found, len(found) / len(upright), abs(_area(polygon)))


def summed(found: SurfaceChange, share: float, area: float) -> Volume:
    """The volume of cells that cover a share of an area, m^2."""
    cell = share * area / len(found)
    row = csr_array(np.full((1, len(found)), cell))
    total = found.sums(row)
    scale = 1.0 if found.registration is None else found.registration.scale
    return Volume(
        value=float(cell * found.distance.sum()),
        sigma=scale * float(np.sqrt(found.joint.variance(total)[0])),
        sampling=scale * float(np.sqrt(found.sampling_of_sums(row)[0])),
        area=share * area,
        share=share,
        independent=float(cell * np.sqrt(np.sum(found.sigma**2))),
    )


def _cells(polygon: np.ndarray, cores: Cores, joint: Joint) -> Cores:
    spacing = cores.spacing
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    # At least some fifty cells, or the rim of a small polygon would count too much or too little.
    spacing = min(spacing, float(np.sqrt(abs(_area(polygon)) / 50.0)))
    axes = [np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[Path(polygon).contains_points(places)]
    cloud = joint.before.xyz
    nearest = cKDTree(cloud[:, :2]).query(places, 1)[1] if len(places) else np.zeros(0, int)
    xyz = np.column_stack([places, cloud[nearest, 2]])
    upright, flat = np.tile([0.0, 0.0, 1.0], (len(xyz), 1)), np.zeros(len(xyz))
    return replace(cores, xyz=xyz, normal=upright, station=flat, across=flat, spacing=spacing)


def _area(polygon: np.ndarray) -> float:
    """Signed area, m^2."""
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
