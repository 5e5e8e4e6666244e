"""What a surface does between its points: roughness beyond the noise of the points.

Two dates rarely show the same points. Where the ground is rough, other points have other heights,
and a mean over them changes though nothing moves. Each point is therefore given, along the local
normal, a variance of its own: that of the heights around it beyond what its own error explains.
Source: Lague et al. 2013 (roughness in the level of detection), here without the noise that the
covariance of the points holds already.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from corridor.change.clouds import Cloud
from corridor.change.cores import Cores
from corridor.change.m3c2 import Members

# Core points whose roughness is taken together.
AROUND = 25


def excess(cloud: Cloud, found: Members, cores: Cores) -> np.ndarray:
    """Variance (r,), m^2, of the heights in each cylinder beyond the noise of the points."""
    normal = cores.normal[found.core]
    own = np.einsum("ni,nij,nj->n", normal, cloud.epoch.own(found.point), normal)
    count = found.count
    noise = np.bincount(found.core, own, minlength=len(count)) / np.maximum(count, 1)
    own = np.maximum(found.spread**2 - cloud.epoch.sigma0**2 * noise, 0.0)
    # A handful of points does not tell how rough the ground is; the surroundings know more.
    around = cKDTree(cores.xyz).query(cores.xyz, min(AROUND, len(own)))[1]
    return np.maximum(own, own[around.reshape(len(own), -1)].mean(axis=1))


def sampling(found: Members, roughness: np.ndarray) -> np.ndarray:
    """Variances (r,) of the heights at core points, by the roughness (r,), m^2, around each."""
    return roughness * np.bincount(found.core, found.weight**2, minlength=len(roughness))


def with_roughness(cloud: Cloud, found: Members, cores: Cores, roughness: np.ndarray) -> Cloud:
    """The cloud with a variance (n, 3, 3) of each point along the normal.

    roughness (r,), m^2: of the cylinders; a point takes the median of those it lies in.
    """
    order = np.lexsort((roughness[found.core], found.point))
    point, value = found.point[order], roughness[found.core][order]
    some, start, count = np.unique(point, return_index=True, return_counts=True)
    middle = start + (count - 1) // 2
    normal = cores.normal[found.core[order][middle]]
    rough = np.zeros((len(cloud.epoch.xyz), 3, 3))
    rough[some] = value[middle][:, None, None] * np.einsum("ni,nj->nij", normal, normal)
    return replace(cloud, roughness=rough)
