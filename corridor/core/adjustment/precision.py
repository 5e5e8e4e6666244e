"""How precise points are among themselves: their covariances in a datum of one's choice.

With G the small similarities of the points that carry the datum and C the covariance of all points,

    C' = S C S',   S = 1 - G_all (G' G)^-1 G'

is what remains where position, rotation and scale are laid on those points: the same for every
datum from which one starts. Of C the blocks of single points are needed, and C G, which is seven
solutions of the equations.
Source: Baarda 1973 (S-transformation); James, Robson and Smith 2017 (precision of shape).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.regression import point_gains
from corridor.core.errors import InputError
from corridor.core.geometry import helmert_motions

# Of a river's points every so many-th stands for all.
MOST = 100_000
# Times the usual size from which on the error of a point is no part of the datum.
FAR = 10.0


def in_datum(
    covariance: Covariance, points: np.ndarray, carrying: np.ndarray, scale: bool = True
) -> np.ndarray:
    """Variances (k, 3) of points (k,) for unit weight, m^2, in the datum of some of them.

    carrying (k,): mask of the points on which the datum lies. scale: whether it has their scale,
    too; without, the scale is that of the measurements (a distance, say).
    Raises InputError where these points leave a rotation or the scale open.
    """
    xyz = covariance.state.points[points]
    middle = xyz[carrying].mean(axis=0) if carrying.any() else np.zeros(3)
    g = helmert_motions(xyz, middle).reshape(-1, 7)[:, : 7 if scale else 6]
    # Metres for all: turns and growth by the size of the block.
    size = np.ones(g.shape[1])
    size[3:] = max(float(np.sqrt(np.mean((xyz[carrying] - middle) ** 2))), 1e-9)
    g = g / size
    carried = g * np.repeat(carrying, 3)[:, None]
    own = carried.T @ carried
    if np.linalg.cond(own) > 1e9:
        raise InputError(
            "these points lie on a line, or are too few: they cannot carry a datum; name three "
            "or more that lie around the block"
        )
    gains = point_gains(covariance.system, points)
    sums = gains.gain.T @ covariance.solve(gains.gain @ carried)
    sums += np.einsum("nij,njk->nik", gains.own, carried.reshape(-1, 3, g.shape[1])).reshape(
        sums.shape
    )
    # Rows of S - 1, and what is left of a point by itself.
    taken = g @ np.linalg.inv(own)
    variance = covariance.points(points)[:, [0, 2, 5]].ravel()
    variance = variance - 2 * np.einsum("nk,nk->n", taken, sums)
    variance += np.einsum("nk,kl,nl->n", taken, carried.T @ sums, taken)
    return np.maximum(variance, 0.0).reshape(-1, 3)


def chosen(names: Iterable[str], wanted: Iterable[str] | None, sound: np.ndarray) -> np.ndarray:
    """Mask (n,) of the points that carry a datum: those named, or by default all sound ones.

    Raises InputError for a name that no point has.
    """
    if wanted is None:
        return sound
    wanted = [wanted] if isinstance(wanted, str) else list(wanted)
    names = np.asarray(names, dtype=object)
    unknown = [name for name in wanted if name not in set(names)]
    if unknown:
        raise InputError(f"no adjusted point is called {', '.join(unknown)}: name measured points")
    return np.isin(names, wanted)
