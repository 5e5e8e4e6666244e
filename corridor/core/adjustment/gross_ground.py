"""Ground points and marks that are grossly wrong, as a fit shows them that marks cannot rule.

Squares make a focal length, or positions, of a control point with a digit too many, or of an image
whose marks stand under each other's names. Where marks count a hundredth of what is stated, images
and GNSS keep their shape; a shift (beside GNSS), or a similarity, through the best points shows
which others lie elsewhere.

Source: Rousseeuw and Leroy 1987 (least median of squares, by samples of as few points as it takes).
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, islice

import numpy as np
import pandas as pd

from corridor.core.adjustment.blunders import where_seen
from corridor.core.adjustment.ground_variances import with_mark_sigma
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.result import Adjustment, Again, from_where_it_ended, where_it_leads
from corridor.core.adjustment.warnings import MISFIT, implausible
from corridor.core.block import Block, values_of
from corridor.core.camera import project
from corridor.core.errors import AdjustmentFailed, InputError, some
from corridor.core.geometry import (
    GROSS,
    OUTLIER,
    robust_scale,
    robust_scale_of_lengths,
    similarity,
)
from corridor.core.output import counted

# A robust loss that gross errors have no say in.
NO_SAY = "cauchy:2"
# Where a model lacks something such a loss creeps without an end; what is gross shows by then.
LOOKING_STEPS = 30
# By what marks count less: fifty pixels are as rough as start poses; beside GNSS nothing at all.
_LOOSE, _SILENT = 100.0, 1000.0
# Median of the length of three errors of standard deviation 1.
OF_THREE = 1.538
# Points of which one can be wrong; samples of three of them at most.
_LEAST, _SAMPLES = 4, 300
# A part of the rest that agrees as well as the best, but for this factor, may be right too.
_AS_GOOD = 3.0
# An error is in one axis where the others have this share of it; several are one within it.
_SHARE = 0.1
_NAMED = 5
# Marks of a point of which one can be wrong, and what names it as a tie point.
_FOR_ONE, _AS_TIE = 3, "ground point "


def suspicious(result: Adjustment) -> bool:
    """Whether marks or ground control may be grossly wrong."""
    control, mark = result.residuals["control"], result.residuals["mark"]
    off = bool(len(control) and control["outlier"].any()) or bool(len(mark) and mark["gross"].any())
    return off or not result.converged or bool(implausible(result))


def with_ground_apart(
    block: Block, model: Model, again: Again
) -> tuple[Adjustment | None, list[str]]:
    """Adjusted with wrong control and wrong marks set aside, and sentences; None where there are
    none, or nothing shows them.

    Control keeps its place, with standard deviations of the size of its error; marks go.
    """
    placed = len(block.gnss) >= _LEAST
    used = np.flatnonzero(model.roles(block) != "unused")
    if len(used) < _LEAST or not len(block.marks):
        return None, []
    factor = _SILENT if placed else _LOOSE
    given = block.numbers("ground", *"xyz")[used]
    names = block.ground["point"].to_numpy(dtype=object)[used]
    sigma, either = block.ground_sigma()[used], ""
    wrong = block.marks.iloc[:0] if placed else _beside_ties(block, model, again)
    start, off = without_marks(block, wrong), np.zeros(len(used), bool)
    # Points that lie elsewhere draw marks of the others, where no GNSS holds the block.
    for _ in range(1 if placed else 2):
        loose = looked_at(again, with_mark_sigma(start, factor), model)
        if loose is None:
            return None, []
        table = loose.residuals["mark"]
        wrong = pd.concat([wrong, table[wrong_marks(table, 0.0)]], ignore_index=True)
        sound = without_marks(block, wrong)
        away = given - _seen(sound, loose)[used]
        more, rival = _off(given, given - away, sigma, placed)
        if rival.any():
            either = _told_either(names, more, rival)
            off[:] = False
            break
        off |= more
        if not placed:
            # What is wrong had a say in where all of it lies, those that agree have it alone.
            with suppress(InputError):
                away = given - _laid_on(given, given - away, ~off)
        if not off.any():
            break
        start = _with_points_aside(sound, model, used, off, away)
    if either and not len(wrong):
        return None, [either]
    control = model.roles(block)[used] == "control"
    while len(wrong) or off.any():
        # Check points stay, for what the rest knows of them: beyond all control it is little.
        start = _with_points_aside(sound, model, used, off & control, away)
        found = where_it_leads(again, start, model)
        if found is None:
            return None, [either] if either else []
        seen = _seen(start, found)
        away = given - seen[used]
        # Rough as the look was, it may have bent what is right.
        usual = np.maximum(sigma, robust_scale(away[~off], axis=0))
        check = found.check_points.set_index("point")[["s_dx", "s_dy", "s_dz"]]
        usual = np.fmax(usual, check.reindex(names).to_numpy(float))
        right = off & (np.abs(away) < OUTLIER * usual).all(axis=1)
        wrong, good = _as_found(wrong, start, found, seen)
        if not (right.any() or good.any()):
            break
        off &= ~right
        wrong = wrong[~good]
        sound = without_marks(block, wrong)
    else:
        return None, []
    if (off & ~control).any():
        start = _with_points_aside(sound, model, used, off, away)
        found = where_it_leads(from_where_it_ended, found, start, model, again) or found
    notes = [told_marks(found, wrong)] if len(wrong) else []
    if found.residuals["control"]["outlier"].any():
        notes += [either] if either else []
    if off.any():
        notes.append(_told_points(block, used, names, given, away, off))
    return found, notes


def with_named_control_apart(
    result: Adjustment, again: Again, most: int
) -> tuple[Adjustment | None, list[str]]:
    """Adjusted with the control set aside that all other observations contradict, and a sentence;
    None where another point explains as much, or not all else fits without.

    One point after the other, the most significant first, and no more than `most`.
    Source: Baarda 1968; Kok 1984 (iterated data snooping).
    """
    block, model, found = result.start, result.problem.model, result
    used = np.flatnonzero(model.roles(block) != "unused")
    names = block.ground["point"].to_numpy(dtype=object)[used]
    given, off = block.numbers("ground", *"xyz")[used], np.zeros(len(used), bool)
    away = np.zeros((len(used), 3))
    while True:
        wrong = found.reliability.wrong_control
        wrong = wrong[~wrong["point"].isin(names[off]) & (wrong["w"].abs() > OUTLIER)]
        if not len(wrong):
            break
        worst = wrong.iloc[0]
        mine = names == worst["point"]
        rivals = {name.rsplit(" ", 1)[0] for name in worst["or_else"].split(", ") if name}
        if rivals - {worst["point"]} or off.sum() == most:
            return None, []
        off |= mine
        away[mine] = np.linalg.norm(wrong["error"][wrong["point"] == worst["point"]])
        start = _set_aside(block, used[off], away[off])
        led = where_it_leads(from_where_it_ended, result, start, model, again)
        if led is None:
            return None, []
        found = led
    # Where a model lacks something, all control bends, and one point of it the most.
    fit = max(found.sigma0, *(kind.get("sigma0", 0.0) for kind in found.statistics.values()))
    if not off.any() or fit > MISFIT:
        return None, []
    away = given - _seen(block, found)[used]
    return found, [_told_points(block, used, names, given, away, off)]


def _with_points_aside(
    block: Block, model: Model, used: np.ndarray, off: np.ndarray, away: np.ndarray
) -> Block:
    """The block with some ground points (n,) of those used set aside: control keeps a standard
    deviation of the size by which it is away (n, 3), others are unused."""
    control = off & (model.roles(block)[used] == "control")
    start = _set_aside(block, used[control], away[control])
    if model.control is None and model.check is None:
        start.ground.loc[start.ground.index[used[off & ~control]], "role"] = "unused"
    return start


def _beside_ties(block: Block, model: Model, again: Again) -> pd.DataFrame:
    """Marks that miss where the others of their point meet, as rows of residuals.

    Where only ground points hold a block, a wrong mark bends it; as tie points, of a free network,
    marks have no more say than others.
    """
    marks = block.marks.astype({"point": str})
    marks = marks[marks.groupby("point")["image"].transform("size") >= _FOR_ONE]
    names = _AS_TIE + marks["point"]
    ties = pd.concat([block.tie_points, marks.assign(point=names)], ignore_index=True)
    bare = {name: getattr(block, name).iloc[:0] for name in ("marks", "ground", "gnss")}
    free = block.with_(tie_points=ties.astype({"point": "category", "image": "category"}), **bare)
    found = looked_at(again, free, replace(model, control=None, check=None))
    if found is None:
        return block.marks.iloc[:0]
    table = found.residuals["tie"].astype({"point": str})
    table = table[table["point"].isin(names)].reset_index(drop=True)
    table["point"] = table["point"].str.removeprefix(_AS_TIE)
    return table[wrong_marks(table)]


def looked_at(again: Again, block: Block, model: Model) -> Adjustment | None:
    """What a robust adjustment shows to be gross, though it creeps on; None where it fails."""
    try:
        return again(block, replace(model, loss=NO_SAY), steps=LOOKING_STEPS)
    except (InputError, AdjustmentFailed):
        return None


def _seen(block: Block, found: Adjustment) -> np.ndarray:
    """Where the marks of a block show its ground points (n, 3), by poses that were found."""
    part = block.select(images=list(found.problem.block.images["image"]))
    at = where_seen(part, found.pose, found.state.interior)
    rows = pd.Index(part.ground["point"]).get_indexer(block.ground["point"])
    return np.where((rows >= 0)[:, None], at[rows], np.nan)


def _off(
    given: np.ndarray, seen: np.ndarray, sigma: np.ndarray, placed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Which ground points (n,) lie elsewhere, given and seen at (n, 3), by what the best half of
    them says of all; and, where another half agrees as well, which do by that.

    sigma (n, 3): of the given. placed: GNSS has placed what is seen, but for one vector.
    """
    known = np.flatnonzero(np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1))
    out, rival, count = np.zeros(len(given), bool), np.zeros(len(given), bool), len(known)
    given, seen = given[known], seen[known]
    least = _LEAST if placed else _LEAST + 1
    if count < least:
        return out, rival
    half = max((count + 1) // 2, least - 1)
    samples: Iterable[tuple] = combinations(range(count), 1 if placed else 3)
    if not placed and count > 12:
        draw = np.random.default_rng(count)
        samples = (tuple(draw.choice(count, 3, replace=False)) for _ in range(_SAMPLES))
    tried = []
    for sample in islice(samples, _SAMPLES):
        length = _lengths(given, seen, np.array(sample), placed)
        if length is not None:
            nearest = np.argsort(length, kind="stable")[:half]
            length = _lengths(given, seen, nearest, placed)
        if length is not None:
            tried.append((float(np.partition(length, half - 1)[half - 1]), length, nearest))
    if not tried:
        return out, rival
    usual = max(min(size for size, *_ in tried), float(np.median(sigma)) * OF_THREE)
    good = [one for one in tried if one[0] <= _AS_GOOD * usual]
    if placed:
        # Of two halves the one is right that lies where the GNSS has it.
        good.sort(key=lambda one: float(np.linalg.norm((given - seen)[one[2]].mean(axis=0))))
    accused = [length > GROSS * max(size, usual) / OF_THREE for size, length, _ in good]
    best = 0 if placed else min(range(len(good)), key=lambda k: good[k][0])
    if not placed and accused[best].sum() > 1:
        # One point that is wrong is likelier than several.
        alone = [k for k, other in enumerate(accused) if other.sum() == 1]
        best = min(alone or [best], key=lambda k: good[k][0])
    wrong = out[known] = accused[best]
    for other in accused if not placed and wrong.any() else ():
        likelier = wrong.sum() == 1 and other.sum() > 1
        if not likelier and (other & ~wrong).any() and (wrong & ~other).any():
            rival[known] = other
            break
    return out, rival


def _lengths(
    given: np.ndarray, seen: np.ndarray, some: np.ndarray, placed: bool
) -> np.ndarray | None:
    """How far (n,) points lie from where they are given, some of them laid on it."""
    if placed:
        return np.linalg.norm(given - seen - np.median((given - seen)[some], axis=0), axis=1)
    mine = np.isin(np.arange(len(given)), some)
    try:
        moved = _laid_on(given, seen, mine)
    except InputError:
        return None
    return np.linalg.norm(given - moved, axis=1)


def _laid_on(given: np.ndarray, seen: np.ndarray, sound: np.ndarray) -> np.ndarray:
    """What is seen (n, 3), turned, scaled and moved so that the sound points lie on the given.

    Raises InputError where these are too few, or lie in a line.
    """
    known = sound & np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1)
    return similarity(seen[known], given[known]).apply(seen)


def _as_found(
    gone: pd.DataFrame, block: Block, found: Adjustment, seen: np.ndarray
) -> tuple[pd.DataFrame, np.ndarray]:
    """Marks that are gone with the residuals that they have where the others show their points
    (n, 3), and which of them are right there."""
    gone, lens = gone.reset_index(drop=True), [c.interior for c in found.block.cameras.values()]
    images = found.problem.images
    at = pd.Index(images.names.astype(str)).get_indexer(gone["image"].astype(str))
    place = seen[pd.Index(block.ground["point"]).get_indexer(gone["point"].astype(str))]
    for row in np.flatnonzero((at >= 0) & np.isfinite(place).all(axis=1)):
        k = at[row]
        pose = found.state.centre[k], found.state.rotation[k], lens[images.camera[k]]
        v = values_of(gone, "x", "y")[row] - project(place[row][None], *pose)[0]
        if np.isfinite(v).all():
            gone.loc[row, ["vx", "vy"]] = v
    table = found.residuals["mark"]
    usual = np.hypot(table["vx"], table["vy"]).to_numpy() / table["sigma"].to_numpy()
    length = np.hypot(gone["vx"], gone["vy"]).to_numpy() / gone["sigma"].to_numpy()
    return gone, length < OUTLIER * robust_scale_of_lengths(usual, least=1.0)


def _set_aside(block: Block, rows: np.ndarray, away: np.ndarray) -> Block:
    """The block with standard deviations of ground points as large as they are away (n, 3), m."""
    block, sigma = block.copy(), block.ground_sigma()
    sigma[rows] = np.maximum(np.linalg.norm(away, axis=1)[:, None], sigma[rows])
    block.put("ground", ("sx", "sy", "sz"), sigma)
    return block


def wrong_marks(table: pd.DataFrame, least: float = 1.0) -> np.ndarray:
    """Which marks (n,) are grossly off, by their residuals where they have no say: single ones, and
    all of an image that are off by one vector. least: of their scale, in standard deviations."""
    v = values_of(table, "vx", "vy") / values_of(table, "sigma")
    length = np.linalg.norm(v, axis=1)
    limit = GROSS * robust_scale_of_lengths(length, least=least)
    wrong = length > limit
    image = table["image"].astype(str)
    together = pd.DataFrame(v).groupby(image).transform("median").to_numpy()
    count = image.groupby(image).transform("size").to_numpy()
    common = np.linalg.norm(together, axis=1)
    alike = pd.Series(np.linalg.norm(v - together, axis=1) < 0.5 * common)
    alike = alike.groupby(image).transform("min").to_numpy(dtype=bool)
    shifted = alike & (common * np.sqrt(count) > limit) & (count > 1)
    # What is gross draws the others of its points with it.
    wrong |= shifted & (image.isin(image[wrong]).to_numpy() | ~wrong.any())
    # Where most marks of a point are off, it is the point that lies elsewhere, or one draws it.
    point = table["point"].astype(str).to_numpy()
    share, usual = (
        pd.Series(part).groupby(point).transform(how).to_numpy()
        for part, how in ((wrong, "mean"), (length, "median"))
    )
    return wrong & ((share < 0.5) | (length > OUTLIER * usual))


def without_marks(block: Block, gone: pd.DataFrame) -> Block:
    """The block without marks, by the image and point of rows of residuals."""
    keys = set(zip(gone["image"].astype(str), gone["point"].astype(str), strict=True))
    if not keys:
        return block
    marks = block.marks
    rows = zip(marks["image"].astype(str), marks["point"].astype(str), strict=True)
    kept = np.array([row not in keys for row in rows])
    return block.with_(marks=marks[kept].reset_index(drop=True))


def told_marks(robust: Adjustment, gone: pd.DataFrame) -> str:
    """A sentence on marks that are set aside, with the point to which each belongs by its place."""
    block = robust.block
    ground = block.ground
    place = values_of(ground, *"xyz")
    rotation = robust.state.rotation
    row = {name: k for k, name in enumerate(robust.problem.images.names.tolist())}
    shown, others = [], []
    for mark in gone.itertuples():
        off, k = float(np.hypot(mark.vx, mark.vy)), row.get(str(mark.image))
        shown.append(f"{mark.point} in {mark.image}, {off:.0f} px")
        if k is None:
            continue
        camera = list(block.cameras.values())[robust.problem.images.camera[k]]
        seen = project(place, robust.state.centre[k], rotation[k], camera.interior)
        away = np.hypot(*(seen - [mark.x, mark.y]).T)
        if np.isfinite(away).any() and np.nanmin(away) < _SHARE * off:
            others.append(str(ground["point"].iloc[int(np.nanargmin(away))]))
    many = counted(len(gone), "mark")
    told = f"{many} set aside, far from where all else puts the point: {some(shown, _NAMED)}."
    images = gone["image"].astype(str).unique()
    v = values_of(gone, "vx", "vy")
    middle = np.median(v, axis=0)
    if len(gone) > 1 and len(images) == 1:
        if (np.linalg.norm(v - middle, axis=1) < 0.5 * np.linalg.norm(middle)).all():
            vector = ", ".join(f"{value:+.0f}" for value in middle)
            return (
                f"{told} They are all of image {images[0]}, off by one vector ({vector} px) from "
                "its tie points: were they measured in another picture, or is a row of marks.csv "
                "shifted?"
            )
    if not others:
        return told
    names = some(list(dict.fromkeys(others)), _NAMED)
    belong = f"{len(others)} of them lie" if len(others) < len(gone) else "They lie"
    if len(gone) == 1:
        belong = "It lies"
    return f"{told} {belong} where {names} is: marked under another name?"


def _told_either(names: np.ndarray, off: np.ndarray, rival: np.ndarray) -> str:
    one, other = (some(names[mine].tolist(), 2 * _NAMED) for mine in (off, rival))
    return (
        f"Ground points contradict each other, and nothing shows who is right: either {one} lie "
        f"elsewhere, or {other}. Two height systems, or the height of a pole in one of two "
        "sessions? GNSS positions, or a point that is known twice, would decide."
    )


def _told_points(
    block: Block, used: np.ndarray, names: np.ndarray, given: np.ndarray, away: np.ndarray,
    off: np.ndarray,
) -> str:  # fmt: skip
    """A sentence on ground points that are off by what they are given away from (n, 3), m."""
    rest = np.flatnonzero(off)
    roles, shown = block.ground["role"].to_numpy(dtype=object)[used], []
    for k in rest:
        size = np.abs(away[k])
        axis = int(np.argmax(size))
        lone = np.delete(size, axis).max() < _SHARE * size[axis]
        vector = ", ".join(f"{value:+.2f}" for value in away[k])
        by = f"in {('x', 'y', 'height')[axis]} by {away[k, axis]:+.2f} m" if lone else ""
        told = f"{block.where('ground', used[k])}: {names[k]} {by or f'by ({vector}) m'}"
        elsewhere = np.linalg.norm(given - given[k], axis=1)
        elsewhere[k] = np.inf
        nearest = int(np.nanargmin(elsewhere))
        if elsewhere[nearest] < _SHARE * np.linalg.norm(away[k]):
            told += f", where {names[nearest]} was surveyed"
        shown.append(told + (" (a check point)" if roles[k] == "check" else ""))
    middle = np.median(away[rest], axis=0)
    size = np.linalg.norm(middle)
    one = len(rest) > 1 and (np.linalg.norm(away[rest] - middle, axis=1) < _SHARE * size).all()
    cause = ", all by one vector (another height system, or the height of a pole?)" if one else ""
    return (
        f"{counted(len(rest), 'ground point')} set aside, given minus where all else puts "
        f"{'them' if len(rest) > 1 else 'it'}{cause}: {'; '.join(shown)}."
    )
