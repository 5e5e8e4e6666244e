"""Observations that can be spared, so that a fit can be asked for them."""

from __future__ import annotations

import numpy as np

from corridor.block import Block
from corridor.diagnosis.settings import SETTINGS


def hold_out(block: Block, rng: np.random.Generator) -> tuple[Block, np.ndarray]:
    """The block with some tie observations robbed of their weight, and their rows (k,).

    Points that control the marks are not touched, and every image keeps most of its points. They
    are those of a few places of each picture, all that can be spared there.
    """
    ties = block.tie_points
    image = block.image_rows("tie_points")
    sizes = {name: (camera.width, camera.height) for name, camera in block.cameras.items()}
    size = np.array([sizes[name] for name in block.images["camera"]], dtype=float)[image]
    xy = ties[["x", "y"]].to_numpy(float)
    among = in_places(image, xy, size, SETTINGS.held_out_places, rng)
    point = ties["point"].array.codes
    chosen = spared(point, SETTINGS.held_out_share, rng, among)
    out = block.copy()
    sigma = block.tie_sigma().copy()
    sigma[chosen] *= SETTINGS.held_out_sigma
    out.tie_points = ties.assign(sigma=sigma)
    return out, chosen


def spared(
    point: np.ndarray, share: float, rng: np.random.Generator, among: np.ndarray | None = None
) -> np.ndarray:
    """Rows (k,), ascending, of a share of observations: one of a point of four rays or more.

    point: (n,) number of the point of each tie observation. among (n,): which may be chosen.
    """
    fit = np.bincount(point)[point] >= SETTINGS.held_out_rays
    order = rng.permutation(np.flatnonzero(fit if among is None else fit & among))
    _, first = np.unique(point[order], return_index=True)
    return np.sort(rng.permutation(order[first])[: max(int(share * len(point)), 1)])


def in_places(
    image: np.ndarray, xy: np.ndarray, size: np.ndarray, share: float, rng: np.random.Generator
) -> np.ndarray:
    """Which observations (n,) lie in places of their picture that are chosen for it, share of all.

    image (n,): number; xy (n, 2), size (n, 2): px. Residuals of neighbours in one picture hang
    together: what is to be predicted has to lie away from what has been used.
    """
    place = places(xy, size)
    chosen = rng.random((int(image.max()) + 1, int(np.prod(SETTINGS.places)))) < share
    return chosen[image, place]


def places(xy: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Number (n,) of the place of its picture in which a point lies. xy, size (n, 2): px."""
    columns, rows = SETTINGS.places
    cell = np.clip((xy + 0.5) / size * (columns, rows), 0, (columns - 1, rows - 1)).astype(int)
    return cell[:, 0] * rows + cell[:, 1]
