"""M3C2: the distance between two clouds along the local normal, as a linear function of points.

At a core point with normal n the points of each cloud within a cylinder along n are averaged; the
distance is n . (mean after - mean before). With the points that count and the normal held, it is
linear in the points, and its standard deviation is exact: errors that points share do not average
out, and are not lost as in s / sqrt(number of points).

Two dates rarely show the same points. Where the ground is rough, other points have other heights,
and a mean over them changes though nothing moves. Each point is therefore given, along the local
normal, a variance of its own: that of the heights around it, at both dates, beyond what its own
error, which the covariance of the points holds already, explains.
Source: Lague et al. 2013.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, hstack
from scipy.spatial import cKDTree

from corridor.tools.change.cores import Cores
from corridor.tools.change.epoch import Cloud

# Fewer points than this are no surface.
LEAST_IN_CYLINDER = 5
# Core points whose roughness is taken together: so many at most, as near as this share of the
# radius, where two cylinders share half of their points.
AROUND, ALIKE = 9, 0.75
# Numbers in a polynomial of two variables, by degree.
_TERMS = {0: 1, 1: 3, 2: 6}


@dataclass(frozen=True)
class Members:
    """The points of a cloud in the cylinders: start (r + 1,), point (m,) of core r's members,
    as positions in the epoch.

    normal (m, 3): that of the core point. height (m,) along it, from the core point, m. weight
    (m,): of each in the height of the surface at the core point. left (m,): height less the fitted
    surface, m. beyond (r,): whether the core point lies outside of its members, where a polynomial
    would be extrapolated. fit: numbers that were fitted in a cylinder.
    """

    start: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    height: np.ndarray
    weight: np.ndarray
    left: np.ndarray
    beyond: np.ndarray
    fit: int = 1

    @property
    def count(self) -> np.ndarray:
        """How many points each cylinder holds (r,)."""
        return np.diff(self.start)

    @property
    def core(self) -> np.ndarray:
        """The core point (m,) of each member."""
        return np.repeat(np.arange(len(self.start) - 1), self.count)

    @property
    def mean(self) -> np.ndarray:
        """Height (r,) of the surface at the core points, m; NaN where nothing is."""
        sums = np.bincount(self.core, self.weight * self.height, minlength=len(self.count))
        return np.where(self.count > 0, sums, np.nan)

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (r,) of the heights about the surface, m; NaN of too few."""
        squares = np.bincount(self.core, self.left**2, minlength=len(self.count))
        free = self.count - self.fit
        return np.where(free > 0, np.sqrt(squares / np.maximum(free, 1)), np.nan)

    def elsewhere(self, here: Cloud, there: Cloud, cores: Cores) -> Members:
        """The same points, weighted as here, where another cloud has them; one for one."""
        order = np.full(len(here.epoch.xyz), -1)
        order[here.surface] = there.surface
        point = order[self.point]
        away = there.epoch.xyz[point] - cores.xyz[self.core]
        height = np.einsum("nk,nk->n", away, cores.normal[self.core])
        left = self.left + (height - self.height)
        sums = np.bincount(self.core, self.weight * (height - self.height), len(self.count))
        return replace(self, point=point, height=height, left=left - sums[self.core])


def members(cloud: Cloud, cores: Cores, degree: int = 0) -> Members:
    """The points of a cloud in the cylinder of each core point, and their weights.

    degree: of the polynomial in the plane across the normal whose height at the core point is
    taken: 0 the mean (M3C2), 1 a plane, 2 with curvature, which lets points lie anywhere on a
    slope or a bend.
    """
    cloud, surface = cloud.xyz, cloud.surface
    tree = cKDTree(cloud)
    ball = float(np.hypot(cores.radius, cores.reach))
    steep = cores.normal[:, 2] < 0.999
    near = np.empty(len(cores), dtype=object)
    near[steep] = tree.query_ball_point(cores.xyz[steep], ball)
    # Where the normal is upright, the plan tells who is near; a ball holds all else.
    near[~steep] = cKDTree(cloud[:, :2]).query_ball_point(
        cores.xyz[~steep, :2], cores.radius + 0.05 * cores.reach
    )
    count = np.fromiter((len(n) for n in near), np.int64, len(near))
    point = np.concatenate([np.asarray(n, np.int64) for n in near] or [[]]).astype(np.int64)
    core = np.repeat(np.arange(len(near)), count)
    away = cloud[point] - cores.xyz[core]
    height = np.einsum("nk,nk->n", away, cores.normal[core])
    aside = np.linalg.norm(away - height[:, None] * cores.normal[core], axis=1)
    inside = (aside <= cores.radius) & (np.abs(height) <= cores.reach)
    core, point, height = core[inside], point[inside], height[inside]
    start = np.concatenate([[0], np.cumsum(np.bincount(core, minlength=len(near)))])
    across = (away[inside] - height[:, None] * cores.normal[core]) / cores.radius
    found = _weights(start, height, across, cores.normal, degree)
    return Members(start, surface[point], cores.normal[core], height, *found, _TERMS[degree])


def _weights(start, height, across, normal, degree: int):
    """Weights of the members in the height at each core point, what the fit leaves, and whether
    the core point has more leverage than any of them (Cook and Weisberg 1982)."""
    count = np.diff(start)
    weight, left = np.empty(len(height)), np.empty(len(height))
    beyond = np.zeros(len(count), dtype=bool)
    first = np.cross(normal, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1)[:, None]
    core = np.repeat(np.arange(len(count)), count)
    u = np.einsum("nk,nk->n", across, first[core])
    v = np.einsum("nk,nk->n", across, np.cross(normal, first)[core])
    terms = polynomial(u, v, degree)
    # Cylinders of as many points are fitted together.
    for n in np.unique(count[count > 0]):
        at = start[:-1][count == n][:, None] + np.arange(n)
        matrix = terms[at] if n > _TERMS[degree] else np.ones((len(at), n, 1))
        inverse = np.linalg.pinv(matrix)
        weight[at] = inverse[:, 0]
        left[at] = height[at] - (matrix @ (inverse @ height[at][:, :, None]))[:, :, 0]
        most = np.einsum("cnt,ctn->cn", matrix, inverse).max(axis=1)
        beyond[count == n] = np.sum(inverse[:, 0] ** 2, axis=1) > most * (1.0 + 1e-9)
    return weight, left, beyond


def polynomial(u: np.ndarray, v: np.ndarray, degree: int) -> np.ndarray:
    """Its terms (n, k) at places (n,)."""
    return np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v][: _TERMS[degree]])


def distance_functions(
    clouds: tuple[Cloud, Cloud], found: list[Members], cores: Cores
) -> csr_array:
    """The distances (k,) as linear functions of the points of both dates."""
    sides = []
    for cloud, one, sign in zip(clouds, found, (-1.0, 1.0), strict=True):
        value = sign * cores.normal[one.core] * one.weight[:, None]
        column = 3 * one.point[:, None] + np.arange(3)
        entries = (value.ravel(), (np.repeat(one.core, 3), column.ravel()))
        sides.append(csr_array(entries, shape=(len(cores), 3 * len(cloud.epoch.names))))
    return hstack(sides, format="csr")


def roughness(
    clouds: tuple[Cloud, Cloud], found: list[Members], cores: Cores
) -> tuple[np.ndarray, np.ndarray]:
    """Variance (r,), m^2, of the heights in each cylinder beyond the noise of the points, and its
    degrees of freedom (r,).

    How rough the ground is at a place both dates tell, each with the points it has there, and so do
    the cylinders that overlap with most of this one: a dozen points alone do not.
    """
    squares, free = 0.0, 0.0
    for cloud, one in zip(clouds, found, strict=True):
        normal = one.normal
        own = np.einsum("ni,nij,nj->n", normal, cloud.epoch.own(one.point), normal)
        noise = np.bincount(one.core, own, minlength=len(one.count)) / np.maximum(one.count, 1)
        mine = np.maximum(one.count - one.fit, 1)
        squares = squares + mine * (one.spread**2 - cloud.epoch.adjustment.sigma0**2 * noise)
        free = free + mine
    reach = ALIKE * cores.radius
    far, near = cKDTree(cores.xyz).query(
        cores.xyz, np.arange(1, AROUND + 1), distance_upper_bound=reach
    )
    known = np.isfinite(far)
    near = np.where(known, near, 0)
    pooled = np.sum(known * squares[near], axis=1) / np.sum(known * free[near], axis=1)
    return np.maximum(pooled, 0.0), free


def sampling(clouds: tuple[Cloud, Cloud], found: list[Members], rough: np.ndarray) -> csr_array:
    """What the roughness at each point does to the distances: (r, n + m), m, a row a core point.

    rough (r,): see `roughness`. Where a surface is bent, what one cylinder has too much of a point
    the next one has too little of: in sums of distances it cancels, and the variance of sums is the
    square of the sums of these. Source: White 1980 (a covariance by the residuals themselves).
    """
    sides = []
    for cloud, one in zip(clouds, found, strict=True):
        value = one.weight * one.left
        # In each cylinder as large as the roughness that its neighbours tell too.
        seen, stated = (np.bincount(one.core, v**2, len(rough)) for v in (value, one.weight))
        scale = np.sqrt(rough * stated / np.maximum(seen, 1e-18))
        entries = (value * scale[one.core], (one.core, one.point))
        sides.append(csr_array(entries, shape=(len(rough), len(cloud.epoch.xyz))))
    return hstack(sides, format="csr")
