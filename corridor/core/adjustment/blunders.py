"""Wild cells: one number so far off that no adjustment would get over it, named and set aside.

A comma in the wrong place is enough. Where the rest agrees, the block is none the worse without.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from corridor.core.adjustment.model import Model
from corridor.core.block import Block
from corridor.core.camera import project, project_rays, undistort
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import Rays, meeting_points, robust_scale, rotation_from_quaternion
from corridor.core.output import counted
from corridor.core.preparation import (
    AXES,
    LARGE_UNITS,
    apart,
    apart_in_shape,
    as_posed,
    other_unit,
    sampled,
)

if TYPE_CHECKING:
    from corridor.core.adjustment.result import Adjustment

# Wild: beyond this many robust sigmas of what start values leave, and beyond this share of the
# flying height; of the pictures, beyond this share of their size outside.
_SIGMAS, _OF_HEIGHT, _OUTSIDE = 20.0, 0.5, 0.25
# More than this share is no slip of the pen.
_MOST = 0.2
_NAMED = 5
_SLIP = " (a comma or a digit out of place?)"
# Two exchanged points lie on each other's place but for this share of their distance, and beyond
# so many robust sigmas off their own.
EXCHANGED, _EXCHANGED_SIGMAS, _FARTHEST = 0.25, 5.0, 20
# Another reading of the coordinates is the right one where it leaves less than this share; so far
# off, m, points lie elsewhere: nearer, an adjustment gets over it and tells.
_ALIKE, _ELSEWHERE_M = 0.1, 2.0
# Sigma naught of tie points, without any ground point, from which on the images do not fit their
# camera, and are no witness of how high ground points lie.
_NO_WITNESS = 2.0
# Control points that hold a block without GNSS.
_LEAST_CONTROL = 3
# A shape tells a unit by so many points: a similarity takes seven of their fifteen numbers.
_LEAST_IN_SHAPE = 5


def without_wild_cells(block: Block, model: Model) -> tuple[Block, list[str]]:
    """The block without wild measurements, and a sentence on each kind, with rows.

    Looked for beside the start poses of images.csv, and beside the picture's size. Ground points
    become unused; GNSS positions and image observations go.
    """
    notes: list[str] = []
    out = block
    for table in ("tie_points", "marks"):
        out = _outside(out, block, table, notes)
    if not _posed(block):
        return out, notes
    pose = block.poses
    out = _gnss(out, block, pose, notes)
    return _ground(out, block, model, pose, notes), notes


def positions_otherwise(given: np.ndarray, at: np.ndarray, of_nothing: float | None = None) -> str:
    """Which axes of positions (n, 3) are in which unit, beside where images are, (n, 3) in metres
    of the same frame or of any; empty where they are in metres. of_nothing: as in `other_unit`."""
    known = np.isfinite(given).all(axis=1) & np.isfinite(at).all(axis=1)
    if known.sum() < _LEAST_IN_SHAPE:
        return ""
    given, at = given[known], at[known]
    told = other_unit("gnss.csv", given, at, _ALIKE)
    if told or apart(given, at) < _ELSEWHERE_M:
        return told
    return other_unit("gnss.csv", given, at, _ALIKE, apart_in_shape, of_nothing)


def _askew(block: Block) -> bool:
    """Whether most tie points lie elsewhere in their pictures than start values put them."""
    seen = as_posed(block, "tie_points", sampled(block))
    lens = np.array([camera.interior for camera in block.cameras.values()])
    lens[:, 3:-1] = 0.0
    off = seen.pixel - project_rays(seen.ray, lens, block.image_camera[seen.image])
    width = max(camera.width for camera in block.cameras.values())
    return bool(len(off)) and float(np.median(np.linalg.norm(off, axis=1))) > _ALIKE * width


def _posed(block: Block) -> bool:
    """Whether start poses show where things are."""
    return np.isfinite(block.poses).all(axis=1).sum() >= 3


def _outside(out: Block, block: Block, table: str, notes: list[str]) -> Block:
    frame = getattr(block, table)
    sizes = np.array([(c.width, c.height) for c in block.cameras.values()], dtype=float)
    size = sizes[block.image_camera]
    one = bool(len(size)) and (size == size[0]).all()
    image = None if one else block.image_rows(table)
    wild = np.zeros(len(frame), dtype=bool)
    for axis, limit in zip("xy", size.T, strict=True):
        limit, at = limit[0] if one else limit[image], frame[axis].to_numpy()
        wild |= at < -_OUTSIDE * limit
        wild |= at > (1.0 + _OUTSIDE) * limit
    rows = np.flatnonzero(wild)
    if not len(rows) or len(rows) > 0.02 * len(frame):
        return out
    shown = [
        f"{block.named(table, k)} at {frame['x'].iloc[k]:g}, {frame['y'].iloc[k]:g}"
        for k in rows[:_NAMED]
    ]
    notes.append(_told(rows, "image observation", "far outside the picture", shown))
    out = _own(out, block)
    kept = frame[~wild].reset_index(drop=True)
    kept["point"] = kept["point"].cat.remove_unused_categories()
    setattr(out, table, kept)
    return out


def without_exchanged(
    block: Block, model: Model, adjusted: Callable[[Block, Model], Adjustment]
) -> tuple[Block, list[str]]:
    """The block without exchanged ground points where no start pose shows them, and sentences.

    For blocks that cannot be adjusted with them: `adjusted` is asked to do without ground control,
    on GNSS alone, and shows then where ground points lie. Raises AdjustmentFailed where all lie
    elsewhere: in another unit, with other axes, or by one vector; beside the stated camera too.
    """
    asked = model.control is not None or model.check is not None
    if asked or len(block.gnss) < 4 or len(block.ground) < 4:
        return block, []
    try:
        bare = block.copy()
        bare.ground["role"] = "unused"
        found = adjusted(bare, model.without_effects())
    except (InputError, AdjustmentFailed):
        return block, []
    blind, used = found.block, model.roles(block) != "unused"
    given = block.numbers("ground", *"xyz")[used]
    otherwise = _read_otherwise(given, where_seen(blind, blind.poses)[used])
    if otherwise:
        raise AdjustmentFailed(otherwise)

    def elsewhere(by: Block) -> str:
        seen = where_seen(by, by.poses)[used]
        return _elsewhere(given, seen, _ALIKE * _height(block, by.poses))

    told = found.statistics["tie"].get("sigma0", 0.0) <= _NO_WITNESS and elsewhere(blind)
    if told:
        # A free focal length follows positions that contradict each other, and the points with it;
        # a free arm of a camera that always looks the same way is any vector.
        stated = replace(model.without_effects(), camera="fixed", lever_arm="fixed")
        try:
            held = adjusted(bare, stated).block
        except (InputError, AdjustmentFailed):
            held = blind
        if elsewhere(held):
            raise AdjustmentFailed(told)
    if _posed(block):
        return block, []
    notes: list[str] = []
    return _ground(block, block, model, blind.poses, notes, seen_by=blind), notes


def _in_place(block: Block, pose: np.ndarray) -> bool:
    """Whether poses lie where the GNSS has them, in its scale."""
    if len(block.gnss) < 4:
        return False
    given, at = block.numbers("gnss", *"xyz"), pose[block.image_rows("gnss"), :3]
    known = np.isfinite(given).all(axis=1) & np.isfinite(at).all(axis=1)
    if known.sum() < 4:
        return False
    return apart(at[known], given[known]) < _ALIKE * np.ptp(given[known], axis=0).max()


def _read_otherwise(given: np.ndarray, seen: np.ndarray) -> str:
    """In which unit or with which axes ground points (n, 3) lie where they are seen; "": as they
    are."""
    known = np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1)
    given, seen = given[known], seen[known]
    if len(given) < _LEAST_CONTROL:
        return ""
    if told := other_unit("ground.csv", given, seen, _ALIKE):
        return f"{told}, beside images and GNSS in metres: convert to metres."
    left = apart(given, seen)
    turned = {words: apart(given[:, order] * sign, seen) for words, order, sign in AXES}
    words = min(turned, key=turned.__getitem__)
    if turned[words] < _ALIKE * left:
        return f"ground.csv has {words} beside images and GNSS: x is east, y north, z up."
    span = np.ptp(seen, axis=0)
    # Ground may be level, and what start poses show of it is rough.
    for k in np.flatnonzero(
        (np.ptp(given[:, :2], axis=0) == 0.0) & (span[:2] > _ALIKE * max(span))
    ):
        other = given.copy()
        other[:, k] = seen[:, k]
        if apart(other, seen) < _ALIKE * left:
            return (
                f"ground.csv has {'xyz'[k]} = {given[0, k]:g} in all rows, where images show the "
                f"points up to {span[k]:.2f} m apart: was one cell copied into the rows "
                "below it?"
            )
    return ""


def _elsewhere(given: np.ndarray, seen: np.ndarray, far: float) -> str:
    """Where all ground points (n, 3), m, lie beside where images and GNSS put them; "": nowhere.

    far: below it a focal length that nobody knows may be the reason, m.
    """
    known = np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1)
    given, seen = given[known], seen[known]
    if len(given) < _LEAST_CONTROL:
        return ""
    middle, left = np.median(given - seen, axis=0), apart(given, seen)
    length = float(np.linalg.norm(middle))
    if length < max(_ELSEWHERE_M, far) or left > _ALIKE * length:
        return ""
    vector = ", ".join(f"{value:+.2f}" for value in middle)
    cause = "another datum, or the offset of block.toml taken off once too often or not at all"
    if abs(middle[2]) > (1.0 - _ALIKE) * length:
        cause = "heights above the ellipsoid and above the geoid, or another height system"
    return (
        f"All {len(given)} ground points lie ({vector}) m from where images and GNSS put them: "
        f"{cause}? Correct ground.csv or gnss.csv."
    )


def _gnss(out: Block, block: Block, pose: np.ndarray, notes: list[str]) -> Block:
    if not len(block.gnss):
        return out
    given, at = block.numbers("gnss", *"xyz"), pose[block.image_rows("gnss"), :3]
    told = positions_otherwise(given, at)
    # Which of the two is in metres, the images show where a unit is larger.
    if told and not (told.endswith(LARGE_UNITS) and _askew(block)):
        raise InputError(f"{told}, beside the start poses of images.csv: write metres.")
    rows, far = _far(given - at, _height(block, pose))
    permuted, other = _permuted(given, at)
    if len(permuted) >= max(len(rows), 1):
        rows, far = permuted, np.linalg.norm(given - at, axis=1)
    if not len(rows):
        return out
    shown = [f"{block.named('gnss', k)}, {_metres(far[k])} off" for k in rows[:_NAMED]]
    cause, slip = "far from where the others put the image", _SLIP
    if rows is permuted:
        cause, slip = "each where another of these images was taken", " (are the images in order?)"
        names = block.gnss["image"].astype(str).to_numpy()
        pairs = [
            f"{names[k]} and {names[other[k]]}" for k in rows if other[other[k]] == k < other[k]
        ]
        if pairs:
            cause += f"; exchanged are {'; '.join(pairs)}"
    notes.append(_told(rows, "GNSS position", cause, shown, cause=slip))
    out = _own(out, block)
    out.gnss = block.gnss.drop(index=block.gnss.index[rows]).reset_index(drop=True)
    return out


def _permuted(given: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) that lie where another image is, at (n, 3), whose own lie where a third or
    the first is, and so on: a part of a table in another order; and of each which is there (n,)."""
    known = np.flatnonzero(np.isfinite(given).all(axis=1) & np.isfinite(at).all(axis=1))
    at, away, other = at[known], given[known] - at[known], np.arange(len(given))
    for middle in (np.zeros(3), np.median(away, axis=0)) if len(known) > _LEAST_CONTROL else ():
        found, nearest = cKDTree(at).query(at + away - middle)
        own = np.linalg.norm(away - middle, axis=1)
        moved = (found < EXCHANGED * own) & (own > _ELSEWHERE_M) & (nearest != other[: len(known)])
        closed = np.array_equal(np.sort(nearest[moved]), np.flatnonzero(moved))
        # Of hardly any that are left, it is all of them that are in another order.
        if closed and moved.any() and len(known) - moved.sum() > _LEAST_CONTROL:
            other[known[moved]] = known[nearest[moved]]
            return known[moved], other
    return known[:0], other


def _ground(
    out: Block, block: Block, model: Model, pose: np.ndarray, notes, seen_by: Block | None = None
) -> Block:
    """seen_by: the block with cameras that are better known, where there is one."""
    roles = model.roles(block)
    used = np.flatnonzero((roles == "control") | (roles == "check"))
    if len(used) < 4 or not len(block.marks):
        return out
    given = block.numbers("ground", *"xyz")[used]
    seen = where_seen(seen_by or block, pose)[used]
    otherwise = _read_otherwise(given, seen) if _in_place(block, pose) else ""
    known = np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1)
    if not otherwise and known.sum() >= _LEAST_IN_SHAPE:
        unit = other_unit("ground.csv", given[known], seen[known], _ALIKE, apart_in_shape)
        otherwise = f"{unit}, beside images in one scale: convert to metres." if unit else ""
    if otherwise:
        raise InputError(otherwise)
    names = block.ground["point"].to_numpy(dtype=object)[used]
    pairs = exchanged_points(given, seen)
    notes.extend(told_exchanged(names[i], names[j]) for i, j in pairs)
    rows, far = _far(given - seen, _height(block, pose))
    rows = np.array([k for k in rows if not _shown(seen_by or block, pose, used[k])], dtype=int)
    told = model.control is not None or model.check is not None
    # A point without a role is of no use to a block of few: what is named is left where it is.
    left = (roles[used] == "control").sum() - 2 * len(pairs)
    if len(block.gnss) or left >= _LEAST_CONTROL:
        rows = np.union1d(rows, np.array(pairs, dtype=int).ravel())
    if told or not len(rows):
        return out
    shown = [
        f"{block.where('ground', used[k])}: {names[k]} ({roles[used[k]]}), {_metres(far[k])} off"
        for k in rows[:_NAMED]
    ]
    slip = "" if set(rows) <= set(np.ravel(pairs)) else _SLIP
    them = "them" if len(rows) > 1 else "it"
    where = f"far from where images show {them}"
    notes.append(_told(rows, "ground point", where, shown, cause=slip))
    out = _own(out, block)
    out.ground.loc[out.ground.index[used[rows]], "role"] = "unused"
    return out


def _shown(block: Block, pose: np.ndarray, row: int) -> bool:
    """Whether most marks of a ground point show it where it is given: then one mark is wrong."""
    marks = np.flatnonzero((block.marks["point"] == block.ground["point"].iloc[row]).to_numpy())
    cameras, off = list(block.cameras.values()), []
    place = block.numbers("ground", *"xyz")[[row]]
    for k, image in zip(marks, block.image_rows("marks")[marks], strict=True):
        camera = cameras[block.image_camera[image]]
        turn = rotation_from_quaternion(pose[[image], 3:])[0]
        seen = project(place, pose[image, :3], turn, camera.interior)[0]
        away = np.linalg.norm(seen - block.numbers("marks", "x", "y")[k])
        off.append(away / min(camera.width, camera.height))
    return len(off) > 2 and bool(np.median(np.nan_to_num(off, nan=np.inf)) < _ALIKE)


def exchanged_points(given: np.ndarray, seen: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of ground points each of which lies where the other was surveyed.

    given, seen: (n, 3), metres, as surveyed and as images show them; NaN unknown. Wherever all of
    them are seen shifted alike, that does not count.
    """
    known = np.flatnonzero(np.isfinite(given).all(axis=1) & np.isfinite(seen).all(axis=1))
    if len(known) < 2:
        return []
    away = seen[known] - given[known]
    # Of four and more points most are where they belong.
    middle = np.median(away, axis=0) if len(known) > 3 else np.zeros(3)
    length = np.linalg.norm(away - middle, axis=1)
    usual = robust_scale(length) if len(known) > 3 else 0.0
    # Those that lie farthest off; of more pairs nobody would read.
    worst = np.argsort(-length, kind="stable")[:_FARTHEST]
    worst = np.sort(worst[length[worst] > _EXCHANGED_SIGMAS * usual])
    pairs = []
    for i, j in itertools.combinations(worst, 2):
        one, two = known[i], known[j]
        between = np.linalg.norm(given[one] - given[two])
        crossed = [seen[one] - middle - given[two], seen[two] - middle - given[one]]
        other = np.linalg.norm(crossed, axis=1).max()
        if other < EXCHANGED * between and min(length[i], length[j]) > (1.0 - EXCHANGED) * between:
            pairs.append((int(one), int(two)))
    return pairs


def told_exchanged(one: str, two: str) -> str:
    """The sentence on two such points."""
    return (
        f"Ground points {one} and {two}: each lies where the other was surveyed. Are their names "
        "exchanged, in ground.csv or in marks.csv?"
    )


def where_seen(block: Block, pose: np.ndarray, interior: np.ndarray | None = None) -> np.ndarray:
    """Where the images of each ground point (n, 3) show it, by these poses; NaN unknown.

    interior (cameras, 15): as found, in place of the block's.
    """
    image, which = block.image_rows("marks"), block.image_camera
    if interior is None:
        interior = np.array([c.interior for c in block.cameras.values()])
    ray = undistort(block.numbers("marks", "x", "y"), interior, which[image])
    quaternion = np.where(np.isfinite(pose[:, 3:]), pose[:, 3:], [1.0, 0.0, 0.0, 0.0])
    rays = Rays(
        image.astype(np.int32), ray, rotation_from_quaternion(quaternion), pose[:, :3].copy(),
        1.0 / interior[which, 0],
    )  # fmt: skip
    marked = block.marks["point"].array
    names = marked.categories
    found = meeting_points(rays, marked.codes, len(names))
    at = names.get_indexer(block.ground["point"])
    found = np.concatenate([found, np.full((1, 3), np.nan)])
    return found[at]


def _height(block: Block, pose: np.ndarray) -> float:
    """Flying height above the points or the ground, m; 10 m where nothing tells."""
    ground = np.concatenate([block.points["z"].to_numpy(float), block.ground["z"].to_numpy(float)])
    if not np.isfinite(ground).any():
        return 10.0
    return max(float(np.nanmedian(pose[:, 2]) - np.nanmedian(ground)), 10.0)


def _far(away: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Which differences (n, 3), m, are wild, and how far (n,) all are from their median.

    None where they are too many for slips of the pen, or too few to tell.
    """
    known = np.isfinite(away).all(axis=1)
    if known.sum() < 4:
        return np.zeros(0, int), np.zeros(len(away))
    middle = np.median(away[known], axis=0)
    length = np.where(known, np.linalg.norm(np.nan_to_num(away - middle), axis=1), 0.0)
    usual = robust_scale(length[known], least=1e-9)
    rows = np.flatnonzero(length > max(_SIGMAS * usual, _OF_HEIGHT * height))
    return (rows if len(rows) <= max(_MOST * len(away), 1.0) else rows[:0]), length


def _metres(length: float) -> str:
    return f"{length:,.0f} m" if length < 1e9 else f"{length:.0e} m"


def _own(out: Block, block: Block) -> Block:
    return block.copy() if out is block else out


def _told(rows: np.ndarray, what: str, why: str, shown: list[str], cause: str = _SLIP) -> str:
    more = "; ..." if len(rows) > len(shown) else ""
    return f"{counted(len(rows), what)} set aside, {why}{cause}: {'; '.join(shown)}{more}."
