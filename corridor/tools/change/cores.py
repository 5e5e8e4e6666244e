"""Core points: where a change of the surface is asked for, and along which normal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from corridor.core.errors import InputError

# So many points should stand for the surface at a core point, in the thinner of both clouds.
WANTED = 15
MOST_CORES = 20_000


@dataclass(frozen=True)
class Cores:
    """xyz (k, 3), m; normal (k, 3), upwards. station, across (k,): along the corridor, m.
    axes (2, 2): the directions of both in plan, across to the left.

    spacing: of the grid, m. radius: of the cylinder along the normal in which points count
    (Lague's d / 2), reach: its half length, m.
    """

    xyz: np.ndarray
    normal: np.ndarray
    station: np.ndarray
    across: np.ndarray
    axes: np.ndarray
    spacing: float
    radius: float
    reach: float

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def cells(self) -> np.ndarray:
        """Corners (k, 4, 2) in plan, m, of the square around each core point."""
        corners = 0.5 * self.spacing * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return self.xyz[:, None, :2] + corners

    def along(self, places: np.ndarray) -> np.ndarray:
        """Station and across (2, n), m, of places (n, 2+) in plan."""
        away = (places[:, :2] - self.xyz[0, :2]) @ self.axes.T
        return away.T + np.array([[self.station[0]], [self.across[0]]])

    def only(self, rows: np.ndarray) -> Cores:
        """Some of the core points."""
        parts = {name: getattr(self, name)[rows] for name in ("xyz", "normal", "station", "across")}
        return replace(self, **parts)


def usual_radius(*clouds: np.ndarray) -> float:
    """Radius (m) of the circle that holds `WANTED` points of the thinner cloud, as a median."""
    out = []
    for xyz in clouds:
        if len(xyz) <= WANTED:
            raise InputError(
                f"{len(xyz)} points are too few for a surface: compare named points only, or "
                "measure more tie points"
            )
        some = xyz[:: max(len(xyz) // 2000, 1), :2]
        out.append(np.median(cKDTree(xyz[:, :2]).query(some, WANTED)[0][:, -1]))
    return float(max(out))


def make_cores(
    before: np.ndarray,
    after: np.ndarray,
    spacing: float | None = None,
    radius: float | None = None,
    normal: str = "local",
    profile: np.ndarray | None = None,
    at: np.ndarray | None = None,
) -> Cores:
    """Core points on a grid over both clouds, along a profile (n, 2), or at given places (n, 2+).

    before, after: clouds (n, 3), m. spacing: default half the radius, more where there would be
    over `MOST_CORES`. radius: see `usual_radius`. normal: `local`, fitted to the first cloud, or
    `vertical`. Raises InputError where no place has points of both clouds within the radius.
    """
    radius = radius or usual_radius(before, after)
    origin, axes = _frame(before[:, :2])
    trees = cKDTree(before[:, :2]), cKDTree(after[:, :2])
    if at is not None:
        places = np.asarray(at, float)[:, :2]
        spacing = spacing or radius
    elif profile is not None:
        spacing = spacing or 0.5 * radius
        places = _along(np.asarray(profile, float)[:, :2], spacing)
    else:
        places, spacing = _grid(before[:, :2], origin, axes, spacing or 0.5 * radius)
    near = [tree.query(places, 1)[0] < radius for tree in trees]
    places = places[near[0] & near[1]]
    if not len(places):
        raise InputError(
            f"no core point has tie points of both dates within {radius:.1f} m: give a larger "
            "radius (--radius), or a line (--profile) on ground that both dates show"
        )
    around = trees[0].query(places, min(5, len(before)))[1]
    xyz = np.column_stack([places, np.median(before[around.reshape(len(places), -1), 2], axis=1)])
    if normal == "vertical":
        normals = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    else:
        normals = fitted_normals(before, xyz, 1.5 * radius)
    station, across = axes @ (places - origin).T
    return Cores(xyz, normals, station, across, axes, spacing, radius, reach=3.0 * radius)


def fitted_normals(cloud: np.ndarray, places: np.ndarray, radius: float) -> np.ndarray:
    """Upward unit normals (k, 3) of planes fitted to the points of a cloud around places (k, 3).

    Where fewer than five points are near, the normal is vertical.
    """
    out = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    for k, near in enumerate(cKDTree(cloud).query_ball_point(places, radius)):
        if len(near) < 5:
            continue
        away = cloud[near] - cloud[near].mean(axis=0)
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        out[k] = normal * (1.0 if normal[2] >= 0 else -1.0)
    return out


def _frame(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin (2,) and axes (2, 2), along and across to the left, of a corridor of places (n, 2).

    They are longest along it; the first of them lies at station zero.
    """
    middle = np.median(xy, axis=0)
    along = np.linalg.svd(xy - middle, full_matrices=False)[2][0]
    along = along * (1.0 if along[np.argmax(np.abs(along))] > 0 else -1.0)
    origin = middle + np.percentile((xy - middle) @ along, 0.5) * along
    return origin, np.array([along, [-along[1], along[0]]])


def _grid(xy: np.ndarray, origin, axes, spacing: float) -> tuple[np.ndarray, float]:
    """Places (k, 2) on a grid along x and y, as a map lies, over the corridor of others (n, 2), and
    their spacing."""
    low, high = np.percentile((xy - origin) @ axes.T, [0.5, 99.5], axis=0)
    area = np.prod(np.maximum(high - low, spacing))
    spacing = max(spacing, float(np.sqrt(area / MOST_CORES)))
    corners = (
        origin + np.array([[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])]) @ axes
    )
    first, last = corners.min(axis=0), corners.max(axis=0)
    grid = [np.arange(a, b + 0.5 * spacing, spacing) for a, b in zip(first, last, strict=True)]
    places = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 2)
    where = (places - origin) @ axes.T
    inside = (where >= low - 0.5 * spacing) & (where <= high + 0.5 * spacing)
    return places[inside.all(axis=1)], spacing


def _along(line: np.ndarray, spacing: float) -> np.ndarray:
    """Places every `spacing` m along a line (n, 2)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0.0, length[-1] + 1e-9, spacing)
    return np.column_stack([np.interp(at, length, line[:, k]) for k in range(2)])
