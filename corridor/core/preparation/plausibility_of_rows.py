"""Cells that the rest of a block contradicts: one that is far off, a column that was filled down.

An image is judged by where its start pose shows points that other images place, a column by how
often it says the same. Nobody measures the same coordinate in half of all rows, unless what is
measured does not move: for positions of camera and antenna each is asked of the other.
"""

from collections.abc import Iterator

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import some
from corridor.core.output import counted
from corridor.core.preparation.half_turns import LEAST, as_posed, sampled, turned_by

# Rows of which half are alike by no chance.
_ROWS = 10
# Times as far as three quarters of all: no flight is so unlike itself. Of rows that are so, more
# than this share are another flight.
_FAR, _FEW = 20.0, 0.02
# An image points elsewhere where its points lie so many focal lengths, and times as far as usual,
# from where it shows them; start values of which the usual one is so far off say nothing.
_ASTRAY, _TIMES, _ROUGH = 0.3, 5.0, 0.1
_NAMED = 5


def row_warnings(block: Block) -> Iterator[str]:
    """Sentences on such columns and rows, by name."""
    yield from _filled_down(block)
    yield from _far_times(block)
    yield from _astray(block)


def _repeated(values: np.ndarray) -> float | None:
    """The number that stands in half of the rows (n,) or more; None where there is none."""
    values = values[np.isfinite(values)]
    n = len(values)
    if n < _ROWS:
        return None
    for middle in np.partition(values, [(n - 1) // 2, n // 2])[[(n - 1) // 2, n // 2]]:
        if 2 * np.count_nonzero(values == middle) >= n:
            return float(middle)
    return None


def _filled_down(block: Block) -> Iterator[str]:
    columns = [(table, axis) for table in ("tie_points", "marks") for axis in "xy"]
    told: dict[str, list[str]] = {}
    for table, axis in [*columns, *_filled_positions(block), ("images", "time_s")]:
        values = block.column(table, axis)
        value = _repeated(values)
        if value is not None:
            told.setdefault(table, []).append(
                f"{axis} is {value:.12g} in {np.count_nonzero(values == value):,} of "
                f"{len(values):,} rows"
            )
    for table, found in told.items():
        yield f"{table}.csv: {', '.join(found)}. Was one cell copied into the rows below it?"


def _filled_positions(block: Block) -> Iterator[tuple[str, str]]:
    """Columns of antennas that say the same where the camera moves, and the other way round."""
    for axis in "xyz":
        camera, antenna = block.column("images", axis), np.full(len(block.images), np.nan)
        antenna[block.image_rows("gnss")] = block.column("gnss", axis)
        for table, told, witness in (("gnss", antenna, camera), ("images", camera, antenna)):
            value = _repeated(told)
            if value is not None:
                moved = witness[(told == value) & np.isfinite(witness)]
                if len(moved) >= _ROWS // 2 and _repeated(moved) is None:
                    yield table, axis


def _far_times(block: Block) -> Iterator[str]:
    time = block.column("images", "time_s")
    known = np.flatnonzero(np.isfinite(time))
    if len(known) < _ROWS:
        return
    away = np.abs(time[known] - np.median(time[known]))
    usual = np.quantile(away, 0.75)
    far = known[away > _FAR * usual] if usual > 0.0 else known[:0]
    if 0 < len(far) <= max(_FEW * len(known), 1.0):
        row = int(far[np.argmax(np.abs(time[far] - np.median(time[known])))])
        yield (
            f"{block.where('images', row)}: time_s is {time[row]:.12g}, "
            f"{abs(time[row] - np.median(time[known])):.3g} s from the middle of the flight, where "
            f"most images are within {usual:.3g} s ({counted(len(far), 'such row')}). A comma or a "
            "digit out of place?"
        )


def astray(block: Block) -> np.ndarray:
    """Which images (n,) have a start pose that shows their tie points elsewhere than all others do.

    None where they are many: then it is the others, or the points.
    """
    count = len(block.images)
    step = sampled(block)
    image, pixel, ray, _ = as_posed(block, "tie_points", step)
    lens = np.array([camera.interior for camera in block.cameras.values()])
    f, centre = lens[block.image_camera[image], 0], lens[block.image_camera[image], 1:3]
    miss = np.full(count, np.nan)
    away = np.linalg.norm((pixel - centre) / f[:, None] - ray, axis=1)
    seen = np.bincount(image, minlength=count)
    order = np.lexsort((away, image))
    first = np.concatenate([[0], np.cumsum(seen)[:-1]])
    enough = seen >= LEAST
    miss[enough] = away[order][first[enough] + seen[enough] // 2]
    # Of those that look away all points lie behind.
    posed = np.isfinite(block.poses).all(axis=1)
    given = np.bincount(block.image_rows("tie_points")[::step], minlength=count)
    miss[posed & (given >= LEAST) & (seen < LEAST)] = np.inf
    known = ~np.isnan(miss)
    wrong = np.zeros(count, dtype=bool)
    if known.any() and (usual := float(np.median(miss[known]))) < _ROUGH:
        wrong = known & (miss > max(_ASTRAY, _TIMES * usual)) & (turned_by(block) == 0.0)
    return wrong & (wrong.sum() <= max(_FEW * known.sum(), 1.0))


def _astray(block: Block) -> Iterator[str]:
    rows = np.flatnonzero(astray(block))
    if len(rows):
        names = some([str(block.images["image"].iloc[k]) for k in rows], _NAMED)
        yield (
            f"{block.where('images', int(rows[0]))}: the start pose of {names} shows "
            f"{'its' if len(rows) == 1 else 'their'} tie points elsewhere than other images do. A "
            "comma, a digit or a sign out of place?"
        )
