"""What in a block contradicts where it says it lies on Earth."""

from collections.abc import Iterator

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.gnss import grid_distortion, known_crs, local_of, outside_area

# Beyond this share of the smallest sigma, the shape of the Earth is seen.
_SEEN = 1.0


def earth_warnings(block: Block) -> Iterator[str]:
    """Sentences on the system of a block's coordinates, the gravest first."""
    if not block.crs or block.crs.startswith("local"):
        return
    if local_of(block) is not None:
        yield (
            f"block.toml has crs = {block.crs!r} and a [local_frame]: coordinates are in one of "
            "them; delete the other."
        )
        return
    try:
        system = known_crs(block.crs)
    except InputError:
        yield (
            f"block.toml: crs = {block.crs!r} is not a coordinate system: write the code of a "
            "projected one, as EPSG:25832."
        )
        return
    unit = system.axis_info[0]
    what = "counts degrees" if system.is_geographic else ""
    what = "has no height axis" if system.is_geocentric else what
    if not what and abs(unit.unit_conversion_factor - 1) > 1e-9:
        what = f"counts in {unit.unit_name}"
    if what:
        yield (
            f"block.toml: crs = {block.crs!r} {what}; a block is in metres with z up: name the "
            "projected system its coordinates are in, as EPSG:25832."
        )
        return
    tables = [block.numbers(table, *"xyz") for table in ("images", "gnss", "ground")]
    places = next((xyz for xyz in tables if np.isfinite(xyz).all(axis=1).any()), None)
    if places is None:
        return
    outside = outside_area(places + block.offset, block.crs)
    if outside:
        told = ""
        if block.offset.any() and not outside_area(places, block.crs):
            told = ": the coordinates are full ones, from which the offset was not subtracted"
        yield f"block.toml: {outside}{told}."
        return
    yield from _grid(block)


def _grid(block: Block) -> Iterator[str]:
    try:
        found = grid_distortion(block)
    except InputError:
        return
    if found is None:
        return
    scale, curved = found
    sigmas = [
        np.median(sigma[sigma > 0])
        for sigma in (block.gnss_sigma() if len(block.gnss) else np.zeros(0),
                      block.ground_sigma() if len(block.ground) else np.zeros(0))
        if (sigma > 0).any()
    ]  # fmt: skip
    if not sigmas or curved < _SEEN * min(sigmas):
        return
    yield (
        f"Coordinates are those of the grid {block.crs}, which is not a Cartesian frame: its scale "
        f"is {1e6 * scale:+.0f} ppm horizontally and 0 in height, which focal lengths take up, and "
        f"the Earth curves below it: points are up to {_length(curved)} from their places after "
        f"the best similarity. `corridor import block BLOCK -o NEW --to-crs {block.crs}` brings "
        f"the block into a local frame, and results out in {block.crs}."
    )


def _length(metres: float) -> str:
    return f"{metres:.2f} m" if metres >= 1 else f"{1000 * metres:.0f} mm"
