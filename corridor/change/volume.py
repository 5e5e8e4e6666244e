"""Volumes between the surfaces of two dates within a polygon.

The volume is the area's share of each cell times its change of height, summed: again a linear
function of the points. Its variance comes from the one covariance of all of them, in which the
errors of neighbouring cells, nearly the same, add up instead of averaging out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.path import Path
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from corridor.brief import brief
from corridor.change.cores import Cores
from corridor.change.joint import Joint
from corridor.change.laying import Laying
from corridor.change.surface import SurfaceChange, surface_change
from corridor.errors import InputError


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
    laying: Laying | None = None,
) -> Volume:  # fmt: skip
    """The change of volume within a polygon (n, 2), after minus before, up is more.

    cores: whose spacing and radius are used; the cells are upright. laying: of the whole surface,
    see `surface_change`. Raises InputError where the polygon holds no cell that both epochs show.
    """
    polygon = np.asarray(polygon, float)[:, :2]
    upright = _cells(polygon, cores, joint)
    try:
        found = surface_change(joint, upright, degree=degree, sampled=sampled, laying=laying)
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
    sampling = found.joint.roughness(total)[0]
    scale = 1.0 if found.laying is None else found.laying.scale
    return Volume(
        value=float(cell * found.distance.sum()),
        sigma=scale * float(np.sqrt(found.joint.variance(total)[0])),
        sampling=scale * float(np.sqrt(sampling)),
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
    x, y = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    places = np.column_stack([x, y])
    places = places[Path(polygon).contains_points(places)]
    cloud = joint.before.xyz
    nearest = cKDTree(cloud[:, :2]).query(places, 1)[1] if len(places) else np.zeros(0, int)
    xyz = np.column_stack([places, cloud[nearest, 2]])
    flat = np.zeros(len(xyz))
    return Cores(
        xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)), flat, flat, np.array([1.0, 0.0]), spacing,
        cores.radius, cores.normal_radius, cores.reach,
    )  # fmt: skip


def _area(polygon: np.ndarray) -> float:
    """Signed area, m^2."""
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
