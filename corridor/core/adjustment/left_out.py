"""What cannot be adjusted and is left out: points that one image sees, images that see hardly any.

Every real project has some; the rest of the block is none the worse for it.
"""

import numpy as np
import pandas as pd

from corridor.core.adjustment.blunders import without_wild_cells
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.ordering import appearances
from corridor.core.adjustment.result import Again, where_it_leads
from corridor.core.block import POSE, Block, is_among
from corridor.core.errors import InputError, some
from corridor.core.output import counted

# Points that a pose needs.
LEAST_POINTS = 3
_NAMED = 10
# Places that differ by less are one.
_ONE_PLACE_M = 1e-3
# So few places with so many images at each are no flight: a head takes five at once and flies on.
_PLACES, _AT_ONE_PLACE = 2, 6


def adjustable_part(block: Block, model: Model, strict: bool = False) -> tuple[Block, list[str]]:
    """The block without what cannot be adjusted, and a sentence on each kind of what was left out.

    Wild cells; tie points and check points that one image alone sees; images with fewer than three
    points. strict: nothing is left out; wild cells raise InputError, the adjustment refuses others.
    A block of which not even half of the images would be left comes back as it is: there,
    something else is wrong, and the adjustment says what.
    """
    _refuse_one_place(block)
    block, alike = _without_one_position(block, strict)
    sound, wild = without_wild_cells(block, model)
    wild = [*alike, *wild]
    if strict:
        if wild:
            raise InputError(f"{wild[0]} Correct or delete them, or leave out --strict")
        return block, []
    block = sound
    roles = model.roles(block)
    ground = block.ground["point"].to_numpy(dtype=object)
    ties, marks = (getattr(block, table)["point"].cat for table in ("tie_points", "marks"))
    names = ties.categories.append(marks.categories)
    is_mark = np.arange(len(names)) >= len(ties.categories)
    held, unused = (
        np.concatenate([np.zeros(len(ties.categories), bool), is_among(marks.categories, given)])
        for given in (ground[roles == role] for role in ("control", "unused"))
    )
    codes = marks.codes.to_numpy().astype(np.int32)
    point = np.concatenate([ties.codes.to_numpy(), codes + np.int32(len(ties.categories))])
    image = np.concatenate([block.image_rows(table, np.int32) for table in ("tie_points", "marks")])

    counts = np.ones(len(point), dtype=bool)
    first = len(block.tie_points)
    counts[first:] = ~unused[point[first:]]
    keep, there = counts.copy(), np.ones(len(block.images), dtype=bool)
    alone = np.zeros(len(names), dtype=bool)
    few: dict[str, int] = {}
    while True:
        # Where all count, which is the rule, nothing is copied.
        rows = slice(None) if keep.all() else keep
        single = (appearances(point[rows], len(names)) == 1) & ~held
        if single.any():
            keep &= ~single[point]
            rows = keep
        seen = appearances(image[rows], len(there))
        scarce = np.flatnonzero(there & (seen < LEAST_POINTS))
        if not single.any() and not len(scarce):
            break
        alone |= single
        few |= {block.images["image"].iloc[k]: seen[k] for k in scarce}
        there[scarce] = False
        if len(scarce):
            keep &= there[image]
    if 2 * there.sum() < len(there) or not (alone.any() or few):
        return block, wild
    notes = wild
    for mine, what in ((alone & ~is_mark, "tie point"), (alone & is_mark, "check point")):
        if mine.any():
            verb = "is" if mine.sum() == 1 else "are"
            notes.append(
                f"{counted(int(mine.sum()), what)} {verb} seen in one image only and {verb} left "
                f"out: {some(names[mine], _NAMED)}."
            )
    if few:
        shown = [f"{name} with {number}" for name, number in few.items()]
        notes.append(
            f"{counted(len(few), 'image')} {'has' if len(few) == 1 else 'have'} fewer than "
            f"{LEAST_POINTS} points that another image shows, which a pose needs, and "
            f"{'is' if len(few) == 1 else 'are'} left out: {some(shown, _NAMED)}."
        )
    return _without(block, keep | ~counts, there), notes


def adjustable_part_as_seen(
    block: Block, model: Model, again: Again, strict: bool = False
) -> tuple[Block, list[str]]:
    """As `adjustable_part`; what lies far from start poses is judged again beside adjusted ones,
    for it may be a start pose that is wild.

    again: adjusts a block.
    """
    part, notes = adjustable_part(block, model, strict)
    gone = 0 if strict else _set_aside(block, part)
    found = where_it_leads(again, part) if gone else None
    if found is None:
        return part, notes
    begun, seen = block.copy(), found.block
    at = pd.Index(block.images["image"]).get_indexer(seen.images["image"])
    pose = block.poses
    pose[at] = seen.poses
    begun.put("images", POSE, pose)
    other, told = adjustable_part(begun, model)
    if _set_aside(begun, other) >= gone:
        return part, notes
    away, turn = moved_from_start(pose[at], block.poses[at])
    names = seen.images["image"].to_numpy()
    return other, [
        f"Start poses of images.csv are off by up to {np.nanmax(away):.1f} m "
        f"({names[np.nanargmax(away)]}) and {np.nanmax(turn):.0f} degrees "
        f"({names[np.nanargmax(turn)]}): GNSS and ground points that they alone contradict "
        "are kept.",
        *told,
    ]


def moved_from_start(pose: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much poses (n, 7) differ from their starts: (n,) m and (n,) degrees."""
    cosine = np.abs(np.sum((pose * start)[:, 3:], axis=1))
    turn = 2.0 * np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))
    return np.linalg.norm((pose - start)[:, :3], axis=1), turn


def _set_aside(block: Block, part: Block) -> int:
    """Of how many positions and ground points no use is made in a part of a block."""
    unused = (part.ground["role"] == "unused").sum() - (block.ground["role"] == "unused").sum()
    return len(block.gnss) - len(part.gnss) + int(unused)


def _refuse_one_place(block: Block) -> None:
    """Refuse start values by which nothing is seen from two places."""
    centre = block.numbers("images", *"xyz") if len(block.images) > 2 else np.zeros((0, 3))
    known = np.isfinite(centre).all(axis=1)
    if known.sum() > 2 and known.all() and np.ptp(centre, axis=0).max() < _ONE_PLACE_M:
        place = ", ".join(f"{value:g}" for value in centre[0])
        raise InputError(
            f"images.csv: all {len(centre)} images stand at one place ({place}), from where no "
            "distance is seen: write where each was taken, or leave x, y, z and the quaternion "
            "empty, so that they are found"
        )


def _without_one_position(block: Block, strict: bool) -> tuple[Block, list[str]]:
    """The block without antenna positions that are all the same: they place nothing."""
    given = block.numbers("gnss", *"xyz") if len(block.gnss) > 2 else np.full((1, 3), np.nan)
    if not np.isfinite(given).all():
        return block, []
    place = ", ".join(f"{value:g}" for value in given[0])
    told = f"gnss.csv: all {len(given)} positions are the same ({place}) and place nothing"
    if np.ptp(given, axis=0).max() >= _ONE_PLACE_M:
        places = len(np.unique(np.round(given[:, :2] / _ONE_PLACE_M), axis=0))
        climbs = np.ptp(given[:, 2]) > np.median(block.gnss_sigma()[:, 2])
        few = places <= _PLACES and places * _AT_ONE_PLACE <= len(given)
        if not few or (places == 1 and climbs):
            return block, []
        told = (
            f"gnss.csv: its {len(given)} positions stand at {counted(places, 'place')} "
            f"({place}{', ...' if places > 1 else ''}), which distinguishes no image from its "
            "neighbours"
        )
    if strict:
        raise InputError(f"{told}: correct them, or leave gnss.csv out")
    block = block.copy()
    block.gnss = block.gnss.iloc[:0]
    return block, [f"{told}: they are left out. Were they cut off on their way?"]


def _without(block: Block, keep: np.ndarray, there: np.ndarray) -> Block:
    """The block with these rows of its tie points and marks, and with these images."""
    block, first = block.copy(), len(block.tie_points)
    for table, rows in (("tie_points", keep[:first]), ("marks", keep[first:])):
        frame = getattr(block, table)[rows].reset_index(drop=True)
        frame["point"] = frame["point"].cat.remove_unused_categories()
        setattr(block, table, frame)
    return block if there.all() else block.select(images=block.images["image"][there])
