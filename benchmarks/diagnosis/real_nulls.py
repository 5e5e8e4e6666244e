"""Real flights from which nothing is missing: their own residuals, laid over what they model.

A part of a real survey is adjusted. What its model says becomes the truth, and its residuals are
resampled by runs of images: each image takes the residuals of another one, of a run drawn with
those that follow it, each observation those of the nearest place of that picture. So tails,
wrong matches, what the lens leaves and what hangs together within a picture and from one to the
next stay those of the flight, and whatever effect there was is gone, or in the model.
Source: Künsch 1989 (bootstrap of runs).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from corridor import Adjustment, Block


def resampled(adjustment: Adjustment, seed: int, run: int = 10) -> Block:
    """A block of an adjustment's truth with residuals of its own in other places."""
    rng = np.random.default_rng(seed)
    system, block = adjustment.system, adjustment.block.copy()
    rows, left = system.image_rows, system.residuals()
    pixels = np.nan_to_num(left.pixels)
    source = _sources(system, run, rng)
    # Poses, points and camera have taken up a share of what was measured.
    taken = 3 * len(system.points.names) + 6 * len(source)
    size = (1.0 - min(taken / (2 * len(pixels)), 0.9)) ** -0.5
    error = size * _moved(rows, pixels, source)
    for tie, table in ((True, "tie_points"), (False, "marks")):
        mine = rows.tie == tie
        at = rows.row[mine] - (0 if tie else len(block.tie_points))
        given = getattr(block, table)
        xy = given[["x", "y"]].to_numpy(float)
        xy[at] = (rows.xy - pixels + error)[mine]
        setattr(block, table, given.assign(x=xy[:, 0], y=xy[:, 1]))
    if len(block.gnss):
        gnss = system.gnss
        place = np.full(len(source), -1)
        place[gnss.image] = np.arange(len(gnss.image))
        other = place[source[gnss.image]]
        drawn = np.where(other[:, None] >= 0, gnss.residual[other], 0.0)
        xyz = gnss.given - gnss.residual + drawn
        table = block.gnss.set_index(block.gnss["image"].astype(str))
        table.loc[gnss.names.astype(str), ["x", "y", "z"]] = xyz
        block.gnss = table.reset_index(drop=True)
    control = system.control
    if len(control.names):
        truth = control.given - control.residual
        ground = block.ground.set_index(block.ground["point"].astype(str))
        noise = control.sigma * rng.standard_normal(truth.shape)
        ground.loc[control.names.astype(str), ["x", "y", "z"]] = truth + noise
        block.ground = ground.reset_index(drop=True)
    return block


def _sources(system, run: int, rng) -> np.ndarray:
    """Number (images,) of the image whose residuals each takes: of its own camera."""
    images = system.images
    order = np.lexsort((system.image_order, np.nan_to_num(images.time), images.flight))
    out = np.arange(len(order))
    for camera in np.unique(images.camera):
        mine = order[images.camera[order] == camera]
        for first in range(0, len(mine), run):
            taken = rng.integers(len(mine)) + np.arange(len(mine[first : first + run]))
            out[mine[first : first + run]] = mine[taken % len(mine)]
    return out


def _moved(rows, pixels: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Residuals (n, 2) px of near places in each observation's source image, each taken once.

    One that is taken twice would be an error that two matches share.
    """
    out = np.zeros_like(pixels)
    order = np.argsort(rows.image, kind="stable")
    ends = np.searchsorted(rows.image[order], np.arange(len(source) + 1))
    for n, other in enumerate(source):
        mine, theirs = order[ends[n] : ends[n + 1]], order[ends[other] : ends[other + 1]]
        theirs = theirs[rows.tie[theirs]]
        while len(mine) and len(theirs):
            one, near = linear_sum_assignment(cdist(rows.xy[mine], rows.xy[theirs]))
            out[mine[one]] = pixels[theirs[near]]
            # Where there are more than the source has, the next round takes them again.
            mine = np.delete(mine, one)
    return out
