"""Matches that cannot be: rays of tie points that pass their point by a part of the picture.

Programs that check matches by their geometry leave none; of raw matches some join images that do
not see each other. Ten such rays among 9,000 led a whole block astray: to squares, one of them
counts as much as a million others. A robust loss alone does not get there from where they lead.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from corridor.core.adjustment.gross_ground import NO_SAY
from corridor.core.adjustment.left_out import adjustable_part
from corridor.core.adjustment.model import Loss, Model
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.problem import make_problem
from corridor.core.adjustment.result import Adjustment, Again
from corridor.core.adjustment.variance_components import CONTRADICTING_FACTOR
from corridor.core.block import Block, is_among, values_of, with_rigid_poses
from corridor.core.errors import InputError, some
from corridor.core.geometry import GROSS
from corridor.core.output import counted

# Start poses are off too, but an image as a whole, and what a model lacks bends it smoothly: a ray
# is false that differs from the middle of its image, and from so many about it, by so many times
# what rays of it typically do, and by this share of the picture.
_ABOUT, _TYPICAL, _SHARE = 8, 10.0, 0.05
# Of more rays than this share, it is the start values that are wrong.
_MOST = 0.25
# Beside a rest that does not fit: a missing shutter had cost a fifth, raw matches hold 1 %.
_FEW = 0.05
_ROUNDS = 4
# An image of which this share is gross, so many times as much as of nine in ten, and most by the
# share of the picture above, is another picture, or of another size, or mirrored.
_ALL, _BEYOND = 0.5, 3.0
# Robust adjustments, each without what the one before shows.
_ROBUST = 3


def with_true_matches(
    block: Block,
    model: Model,
    again: Again,
    whole: Callable[[Block], Adjustment],
    begin: Callable[[Block], Block],
) -> Adjustment:
    """Adjusted without them: without rays that miss at the start, then without those that a robust
    loss shows to be gross.

    For blocks that cannot be adjusted with them: of a rough start, as of a shutter that is missing,
    a ray may lie as far off that is none of them. begin: fills starts in.
    Raises InputError where there are none, or too many, or the rest does not fit and they are not
    gross beside it.
    """
    sound = _without_what_misses(begin(with_rigid_poses(block)), begin)
    images: set[str] = set()
    for _ in range(_ROBUST):
        # Where it has not converged, it does so without the worst.
        robust = again(sound, replace(model, loss=NO_SAY))
        ties = robust.residuals["tie"].astype({"point": str, "image": str})
        rays, wrong = suspects(ties, _ALL)
        gross = ties.loc[rays, ["point", "image"]]
        # Where the model lacks something, an image that rocks misses too, by less.
        missed = np.hypot(ties["vx"], ties["vy"]).groupby(ties["image"]).median()
        seen = robust.problem.images
        size = pd.Series(seen.size.min(axis=1), seen.names.astype(str))
        more = {name for name in wrong if missed[name] > _SHARE * size[name]} - images
        images |= more
        sound = _without(sound, set(gross.itertuples(index=False, name=None)))
        if images:
            sound = sound.select(images=[n for n in sound.images["image"] if n not in images])
        sound, _ = adjustable_part(sound, model)
        if robust.converged or not (len(gross) or more):
            break
    gone = len(block.tie_points) - len(sound.tie_points)
    if not 0 < gone <= _MOST * len(block.tie_points):
        raise InputError("no few matches lie far from where all else puts their points")
    found = whole(sound)
    # Where the rest does not fit either, it may be the model: a shutter on a rocking wing, say.
    few = gone < _FEW * len(block.tie_points)
    if found.sigma0 >= CONTRADICTING_FACTOR and not (few and _gross(block, sound, found)):
        raise InputError("what is left out lies no farther off than the rest")
    rest = block.tie_points[~is_among(block.tie_points["image"], list(images))]
    if len(rest) > len(sound.tie_points):
        before, after = (ties["point"].value_counts() for ties in (rest, sound.tie_points))
        fewer = before.index[after.reindex(before.index, fill_value=0) < before].astype(str)
        found.add_note(
            f"{counted(len(rest) - len(sound.tie_points), 'tie point observation')} left out, far "
            "from where all else puts the point, or behind the camera "
            f"({some(sorted(fewer), 5)}): their matches are wrong."
        )
    if images:
        found.add_note(
            f"{counted(len(images), 'image')} left out ({some(sorted(images), 5)}): most of what "
            f"{'it' if len(images) == 1 else 'they'} measured lies elsewhere. Another picture or "
            "picture size, mirrored, or with the names of other points?"
        )
    return found


def suspects(ties: pd.DataFrame, share: float = 0.1) -> tuple[np.ndarray, set[str]]:
    """Which residuals (n,) of tie points are gross while those about them in their image are not,
    and images of which more than a share is, and far more than of others."""
    number, names = ties["image"].factorize()
    apart = _alone(values_of(ties, "vx", "vy"), number, values_of(ties, "x", "y"))
    alone = apart > _TYPICAL * _by_image(apart, number, len(names))[number, 0]
    of = ties.groupby("image", observed=True)["gross"].mean()
    images = of.index[of > max(share, _BEYOND * of.quantile(0.9))]
    return ties["gross"].to_numpy() & alone, set(images.astype(str))


def _gross(block: Block, sound: Block, found: Adjustment) -> bool:
    """Whether what was left out (most of it) is gross beside the rest, where that puts points."""
    rest, ties = found.start_again, block.tie_points
    there = is_among(ties["point"], list(sound.tie_points["point"].cat.categories))
    there &= is_among(ties["image"], list(rest.images["image"]))
    problem = make_problem(rest.with_(tie_points=_with_ties(block, there).tie_points))
    residual, _ = Normal(problem, Loss()).residuals(problem.start)
    kept = pd.MultiIndex.from_frame(sound.tie_points[["point", "image"]].astype(str))
    rays = problem.point_names[problem.point_of_ray], problem.images.names[problem.img]
    gone = is_among(pd.Index(rays[0]), list(sound.tie_points["point"].cat.categories))
    gone &= ~pd.MultiIndex.from_arrays(rays).isin(kept)
    length = np.nan_to_num(np.hypot(*residual[gone].T), nan=np.inf)
    return bool(len(length) and np.median(length) > GROSS * found.statistics["tie"]["rms"])


def _without_what_misses(block: Block, begin: Callable[[Block], Block]) -> Block:
    """The block without rays that miss at the start.

    A ray is left out where most others of its point show it where it starts; else the start of the
    point may be wild, and where it was intersected anew and one ray still passes it, its rays do
    not meet.
    """
    rays, points = _false(block)
    block = _without(block, rays)
    if points:
        block = block.copy()
        begun = is_among(block.points["point"], list(points))
        block.points.loc[begun, ["x", "y", "z"]] = np.nan
        block = begin(block)
        rays, lost = _false(block)
        block = without_ties(block, lost | {point for point, _ in rays})
    return block


def _false(block: Block) -> tuple[set[tuple[str, str]], set[str]]:
    """Point and image of the false rays of points that most rays show where they start, and names
    of the other tie points that have false rays."""
    problem = make_problem(block)
    residual, _ = Normal(problem, Loss()).residuals(problem.start)
    size = problem.images.size.min(axis=1)
    bad = behind = np.isnan(residual[:, 0])
    image, point = problem.img, problem.point_of_ray
    # An image that has many false rays is known by the others, once most of these are found.
    for _ in range(_ROUNDS):
        middle = _by_image(residual[~bad], image[~bad], len(size))
        off = np.abs(residual - middle[image]).max(axis=1)
        typical = _by_image(off[~bad], image[~bad], len(size))[:, 0]
        least = np.fmax(_TYPICAL * typical, _SHARE * size)[image]
        before, bad = bad, ~(off <= least)
        if (bad == before).all():
            break
    bad &= behind | (_alone(residual, image, problem.xy) > least)
    if bad.mean() > _MOST:
        bad = behind
    wrong, count = np.bincount(point[bad], minlength=len(problem.ptr) - 1), np.diff(problem.ptr)
    ties = is_among(pd.Index(problem.point_names), problem.block.tie_points["point"])
    shown = ties & (2 * wrong < count)
    rays = np.flatnonzero(bad & shown[point])
    of = problem.point_names[point[rays]], problem.images.names[image[rays]]
    return set(zip(*of, strict=True)), set(problem.point_names[ties & (wrong > 0) & ~shown])


def _by_image(values: np.ndarray, image: np.ndarray, count: int) -> np.ndarray:
    """Medians (count, k) of values (n,) or (n, k) by image; NaN for an image without any."""
    return pd.DataFrame(values).groupby(image).median().reindex(range(count)).to_numpy()


def _alone(residual: np.ndarray, image: np.ndarray, place: np.ndarray) -> np.ndarray:
    """By how much each residual (n, 2) differs from those about it in its image, px; NaN: unknown.

    image (n,): its number. place (n, 2): of each in the picture, px.
    """
    alone = np.full(len(image), np.nan)
    known = np.flatnonzero(~np.isnan(residual[:, 0]))
    known = known[np.argsort(image[known], kind="stable")]
    for mine in np.split(known, np.flatnonzero(np.diff(image[known])) + 1):
        if len(mine) > 1:
            _, about = cKDTree(place[mine]).query(place[mine], k=min(_ABOUT + 1, len(mine)))
            middle = np.median(residual[mine[about[:, 1:]]], axis=1)
            alone[mine] = np.abs(residual[mine] - middle).max(axis=1)
    return alone


def _without(block: Block, rays: set[tuple[str, str]]) -> Block:
    """The block without what images measured of tie points, by the names of point and image."""
    ties = block.tie_points
    rows = np.flatnonzero(is_among(ties["point"], list({point for point, _ in rays})))
    pairs = ties[["point", "image"]].iloc[rows].astype(str).itertuples(index=False, name=None)
    kept = np.ones(len(ties), dtype=bool)
    kept[rows] = [pair not in rays for pair in pairs]
    return _with_ties(block, kept)


def without_ties(block: Block, names: Collection[str]) -> Block:
    """The block without tie points of these names."""
    return _with_ties(block, ~is_among(block.tie_points["point"], list(names)))


def _with_ties(block: Block, kept: np.ndarray) -> Block:
    block = block.copy()
    block.tie_points = block.tie_points[kept].reset_index(drop=True)
    block.tie_points["point"] = block.tie_points["point"].cat.remove_unused_categories()
    return block
