"""Above what, and in which unit, photographs count their heights: EXIF says neither.

What they say beside it (height above the take-off, EXIF's and XMP's two heights) and what the
images show (how high above the ground they were taken) are the witnesses.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from corridor.core.block import Block
from corridor.core.gnss import local_of
from corridor.core.photographs import Metadata
from corridor.core.preparation import (
    UNITS_M,
    apart_in_shape,
    other_unit,
    position_difference,
)
from corridor.tools.formats.project import Project

_FOOT_M = UNITS_M["feet"]
# Heights are written to a decimetre or to a metre; lower flights are at the take-off whatever.
_SAME_M, _LOW_M, _FEWEST = 1.0, 10.0, 3
# Two heights of one photograph that lie farther apart are of two systems; a geoid lies 100 m from
# the ellipsoid at most.
_APART_M, _GEOID_M = 3.0, 110.0
# Share of the flying height within which ground below is level with the take-off.
_LEVEL, _OF_FEET = 0.05, 0.02
# The same, from which a ground point is far above or below the tie points beside it.
_OFF = 0.2
# Beside so much rise and fall a unit of heights shows; any unit, by so many times less misfit.
_RISE_M, _BETTER = 5.0, 5.0
# Above the ellipsoid: only at the Dead Sea land lies lower, and hardly anybody surveys higher.
_LOWEST_M, _HIGHEST_M = -250.0, 6500.0


def unit_that_fits(what: str, source: np.ndarray, target: np.ndarray) -> str:
    """Which axes of what is called so, target (n, 3), fit the shape of source only in another unit:
    "Heights of positions are in feet"; or empty.

    source: camera centres in any frame. Flights at one height do not tell heights.
    """
    known = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < 2 * _FEWEST:
        return ""
    return other_unit(what, target[known], source[known], 1.0 / _BETTER, apart_in_shape)


def with_heights_told(project: Project, photos: Mapping[int, Metadata], free: bool) -> Project:
    """The project with sentences on the heights of the photographs, which are in gnss.csv.

    free: whether the photographs have placed it.
    """
    told = [*_none(photos), *_beside_take_off(photos), *_of_two(photos)]
    block, notes, doubts = project.block, [], []
    posed = block.numbers("images", *"xyz")[block.image_rows("gnss")]
    given = block.numbers("gnss", *"xyz")
    if apart := position_difference("gnss.csv", given, "the project's poses", posed):
        doubts = [apart.rstrip(".")]
    elif free and len(block.gnss):
        notes, doubts = _of_ground(block)
    return project.having(notes=notes, warnings=told or doubts)


def _none(photos: Mapping[int, Metadata]) -> Iterator[str]:
    """A sentence on heights that are all 0."""
    heights = [photo.height for photo in photos.values() if photo.height is not None]
    if len(heights) >= _FEWEST and not any(heights):
        yield "all heights of the photographs are 0: are they unknown? Give control with --ground"


def _beside_take_off(photos: Mapping[int, Metadata]) -> Iterator[str]:
    """A sentence on heights that are those above the take-off, or in another unit than these."""
    pairs = [
        (photo.height, above)
        for photo in photos.values()
        if photo.height is not None
        and (above := photo.number("RelativeAltitude", "AboveGroundAltitude")) is not None
    ]
    if len(pairs) < _FEWEST:
        return
    height, above = np.array(pairs).T
    for unit, metres in (("", 1.0), (" in feet", _FOOT_M)):
        off = float(np.median(np.abs(metres * height - above)))
        if off < _SAME_M and np.median(above) > _LOW_M:
            yield (
                f"Heights of the photographs are their heights above the take-off{unit} (XMP says "
                f"{np.median(above):.0f} m, the position {np.median(height):.0f}): unless the "
                "take-off lay at height 0, all heights of the block lack its height. Give control "
                "with --ground, or write heights above the ellipsoid into the photographs"
            )
            return
    rise = float(np.ptp(above))
    slope = float(np.polyfit(above, height, 1)[0]) if rise > _RISE_M else 1.0
    if abs(slope * _FOOT_M - 1.0) < _OF_FEET:
        yield (
            f"Heights of the photographs rise by {slope:.2f} times what XMP says of their heights "
            "above the take-off: are they in feet? Write metres"
        )


def _of_two(photos: Mapping[int, Metadata]) -> Iterator[str]:
    """A sentence on photographs whose EXIF and XMP give two heights."""
    pairs = [
        (photo.exif_height, photo.height)
        for photo in photos.values()
        if photo.exif_height is not None and photo.height is not None
    ]
    if len(pairs) < _FEWEST:
        return
    exif, xmp = np.array(pairs).T
    off = float(np.median(exif - xmp))
    if abs(off) < _APART_M:
        return
    ratio = float(np.median(exif)) / float(np.median(xmp)) if np.median(xmp) else 0.0
    if abs(ratio * _FOOT_M - 1.0) < _OF_FEET:
        why = "EXIF's are in feet"
    elif abs(off) < _GEOID_M and np.median(np.abs(exif - xmp - off)) < _APART_M:
        why = "one above the ellipsoid, the other above the sea or the take-off?"
    else:
        why = "which are right?"
    yield (
        f"EXIF gives the photographs heights {off:+.1f} m (median) from those of XMP, which were "
        f"read: {why}"
    )


def _of_ground(block: Block) -> tuple[list[str], list[str]]:
    """Notes and doubts on where the ground lies by the heights of the photographs.

    Nothing where control says it, or where the block has no heights of its own.
    """
    local = local_of(block)
    zero = block.offset[2] + (0.0 if local is None else local.height)
    points, centres = (zero + block.column(table, "z") for table in ("points", "gnss"))
    points, centres = points[np.isfinite(points)], centres[np.isfinite(centres)]
    nowhere = local is None and block.crs is None
    if len(block.marks) or not len(points) or not len(centres) or nowhere:
        return [], []
    ground, flown = float(np.median(points)), float(np.median(centres))
    high = flown - ground
    if not high > _LOW_M:
        return [], []
    if len(block.ground):
        return [], list(_of_unmarked(block, high))
    shown = f"by the heights of the photographs the ground lies at {ground:.0f} m"
    note = (
        f"{shown}, {high:.0f} m below the cameras; no photograph says whether its heights count "
        "from the ellipsoid, the sea or the take-off, nor in which unit, and nothing here can "
        "check it: compare with a map, or give control with --ground"
    )
    why = ""
    if not _LOWEST_M < ground < _HIGHEST_M:
        why = "where no land is: are they in another unit, or with a wrong sign (GPSAltitudeRef)?"
    elif abs(ground) < _LEVEL * high:
        # By the sea that is as it should be.
        level = f"and the cameras {high:.0f} m above it: do they count from the take-off?"
        return [f"{shown}, {level} By the sea they may be right"], []
    elif abs(flown * _FOOT_M / high - 1.0) < _OF_FEET:
        why = f"and the cameras {high:.0f} m above it, {flown:.0f} feet: are they in feet?"
    return ([], [f"{shown}, {why}"]) if why else ([note], [])


def _of_unmarked(block: Block, high: float) -> Iterator[str]:
    """A sentence on ground points, measured in no image, that lie above or below the tie points
    beside them by a good share of the flying height."""
    ties, given = (block.numbers(table, *"xyz") for table in ("points", "ground"))
    ties = ties[np.isfinite(ties).all(axis=1)]
    given = given[np.isfinite(given).all(axis=1)]
    if not len(given):
        return
    away = np.linalg.norm(ties[None, :, :2] - given[:, None, :2], axis=2)
    near = away.argmin(axis=1)
    beside = away.min(axis=1) < high
    off = float(np.median((given - ties[near])[beside, 2])) if beside.any() else 0.0
    if abs(off) > _OFF * high:
        yield (
            f"ground points lie {off:+.1f} m (median) from the tie points beside them, which have "
            "the heights of the photographs: one above the ellipsoid, the other above the sea or "
            "the take-off, or in feet? Measure the points in the images"
        )
