"""Matches that cannot be: rays of tie points that pass their point by a part of the picture.

Programs that check matches by their geometry leave none; of raw matches some join images that do
not see each other. Ten such rays among 9,000 led a whole block astray: to squares, one of them
counts as much as a million others.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import pandas as pd

from corridor.core.adjustment.model import Loss
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.problem import Problem, make_problem
from corridor.core.block import Block, is_among
from corridor.core.errors import InputError, some
from corridor.core.output import counted

# Start poses are off too, but an image as a whole: a ray is false that differs from the middle of
# its image by so many times what rays of it typically do, and by this share of the picture.
_TYPICAL, _SHARE = 10.0, 0.05
# Of more rays than this share, it is the start values that are wrong.
_MOST = 0.25
_ROUNDS = 4


def without_false_matches(
    block: Block, problem: Problem, residual: np.ndarray, begin: Callable[[Block], Block]
) -> tuple[Block, list[str]]:
    """The block without them, points that begin wildly intersected anew, and sentences.

    A ray is left out where most others of its point show it where it starts; else the start of the
    point may be wild, and where it was intersected anew and one ray still passes it, its rays do
    not meet. residual (n, 2): px, at the start, NaN behind the camera. begin: fills starts in.
    Raises InputError where all points of an image lie behind it.
    """
    rays, points = _false(problem, residual)
    if not (len(rays) or points):
        return block, []
    _refuse_blind(block, problem, residual)
    measured, named = len(block.tie_points), set(problem.point_names[problem.point_of_ray[rays]])
    block = _without_rays(block, problem, rays)
    if points:
        block = block.copy()
        begun = is_among(block.points["point"], list(points))
        block.points.loc[begun, ["x", "y", "z"]] = np.nan
        block = begin(block)
        problem = make_problem(block)
        rays, lost = _false(problem, Normal(problem, Loss()).residuals(problem.start)[0])
        lost |= set(problem.point_names[problem.point_of_ray[rays]])
        named |= lost
        block = without_ties(block, lost)
    gone = measured - len(block.tie_points)
    if not gone:
        return block, []
    return block, [
        f"{counted(gone, 'tie point observation')} left out, far from where all else puts the "
        f"point, or behind the camera ({some(sorted(named), 5)}): their matches are wrong."
    ]


def _false(problem: Problem, residual: np.ndarray) -> tuple[np.ndarray, set[str]]:
    """False rays (k,) of tie points that most rays show where they start, and names of the other
    points that have false rays."""
    size = problem.images.size.min(axis=1)
    # Nearly always nothing: what follows is as large as the observations, several times.
    highest, lowest = (by.reduce(residual, axis=None, initial=0.0) for by in (np.fmax, np.fmin))
    bad = behind = np.isnan(residual[:, 0])
    image, point = problem.img, problem.point_of_ray
    # An image that has many false rays is known by the others, once most of these are found.
    for _ in range(_ROUNDS if max(highest, -lowest) > _SHARE * size.min() else 0):
        middle = _by_image(residual[~bad], image[~bad], len(size))
        off = np.abs(residual - middle[image]).max(axis=1)
        typical = _by_image(off[~bad], image[~bad], len(size))[:, 0]
        before, bad = bad, ~(off <= np.fmax(_TYPICAL * typical, _SHARE * size)[image])
        if (bad == before).all():
            break
    if bad.mean() > _MOST:
        bad = behind
    wrong, count = np.bincount(point[bad], minlength=len(problem.ptr) - 1), np.diff(problem.ptr)
    ties = is_among(pd.Index(problem.point_names), problem.block.tie_points["point"])
    shown = ties & (2 * wrong < count)
    return np.flatnonzero(bad & shown[point]), set(problem.point_names[(wrong > 0) & ~shown])


def _by_image(values: np.ndarray, image: np.ndarray, count: int) -> np.ndarray:
    """Medians (count, k) of values (n,) or (n, k) by image; NaN for an image without any."""
    return pd.DataFrame(values).groupby(image).median().reindex(range(count)).to_numpy()


def _refuse_blind(block: Block, problem: Problem, residual: np.ndarray) -> None:
    """Raise InputError where all points of an image lie behind it."""
    behind = np.isnan(residual[:, 0])
    hidden, count = (
        np.bincount(of, minlength=problem.image_count) for of in (problem.img[behind], problem.img)
    )
    blind = np.flatnonzero(hidden == count)
    if len(blind):
        row = problem.order[blind].min()
        more = f" ({len(blind) - 1} more images too)" if len(blind) > 1 else ""
        raise InputError(
            f"{block.where('images', row)}: all points of image "
            f"{block.images['image'].iloc[row]} lie behind it{more}: check its quaternion (world "
            "to camera, qw first) and its position"
        )


def _without_rays(block: Block, problem: Problem, rays: np.ndarray) -> Block:
    """The block without what images measured of tie points, for some rays (k,) of a problem."""
    if not len(rays):
        return block
    ties, points = block.tie_points, problem.point_names[problem.point_of_ray[rays]]
    false = set(zip(points, problem.images.names[problem.img[rays]], strict=True))
    rows = np.flatnonzero(is_among(ties["point"], list(set(points))))
    pairs = ties[["point", "image"]].iloc[rows].astype(str).itertuples(index=False, name=None)
    kept = np.ones(len(ties), dtype=bool)
    kept[rows] = [pair not in false for pair in pairs]
    return _with_ties(block, kept)


def without_ties(block: Block, names: Collection[str]) -> Block:
    """The block without tie points of these names."""
    return _with_ties(block, ~is_among(block.tie_points["point"], list(names)))


def _with_ties(block: Block, kept: np.ndarray) -> Block:
    block = block.copy()
    block.tie_points = block.tie_points[kept].reset_index(drop=True)
    block.tie_points["point"] = block.tie_points["point"].cat.remove_unused_categories()
    return block
