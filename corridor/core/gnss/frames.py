"""Where on Earth a block's coordinates lie.

A block is Cartesian. Its coordinates are either those of a grid (`crs` of block.toml, less its
`offset`), or east, north, up about a point (`[local_frame]` there). A grid is no Cartesian frame:
its scale differs from 1, heights keep theirs, and the Earth curves below it. In the local frame
these are no errors; results then go out through PROJ, in the system that `[local_frame]` names.
"""

from typing import Any

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.geometry import similarity
from corridor.core.gnss import coordinates
from corridor.core.gnss.coordinates import Local, convert, known_crs, outside_area
from corridor.core.gnss.track import GEOGRAPHIC

FRAME = "local_frame"

# Equal-area grids of continents stretch lengths by 3 % at their rims; web maps by far more.
_STRETCHED, _NEAR_M = 0.03, 100.0


def local_of(block: Block) -> Local | None:
    """The block's east, north, up frame on Earth, None where it has none.

    Raises InputError where block.toml has one without latitude and longitude.
    """
    return local_frame(block.extra.get(FRAME))


def local_frame(table: Any) -> Local | None:
    """The frame of a table `[local_frame]` of block.toml. Raises InputError as `local_of`."""
    if not table:
        return None
    try:
        place = table["lat_deg"], table["lon_deg"], table.get("height", 0.0)
        return Local(*map(float, place))
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"block.toml: [{FRAME}] is not a place on Earth; write lat_deg, lon_deg and height "
            "there, numbers in degrees and metres"
        ) from None


def world_crs(block: Block) -> str | None:
    """The system in which results are given; None for local metres without a place on Earth.

    Of a local frame that names none: UTM on WGS 84, with heights above the ellipsoid.
    """
    local = local_of(block)
    if local is None:
        # A crs that begins with `local` describes a frame in words.
        return None if block.crs is None or block.crs.startswith("local") else block.crs
    named = block.extra[FRAME].get("crs")
    if named:
        return str(named)
    zone = int((local.lon_deg + 180) % 360 // 6) + 1
    return f"EPSG:{(32600 if local.lat_deg >= 0 else 32700) + zone}"


def in_world(block: Block, places: np.ndarray) -> np.ndarray:
    """Places (..., 3) of a block in the system of `world_crs`."""
    places = np.asarray(places, dtype=float)
    local, flat = local_of(block), places.reshape(-1, 3) + block.offset
    crs = world_crs(block)
    if local is not None and crs is not None:
        flat = local.to_crs(flat, crs)
    return flat.reshape(places.shape)


def about_the_middle(block: Block) -> Local:
    """A local frame about the middle of a block in a CRS, on round numbers, height 0.

    Raises InputError where nothing says where on Earth the block lies.
    """
    if block.crs is None:
        raise InputError(
            "nothing says where on Earth the project's coordinates are; name their system with "
            "--crs of `corridor import` (crs in block.toml), or give it --photos whose positions "
            "place it"
        )
    places = places_of(block)
    known = places[np.isfinite(places).all(axis=1)]
    middle = (known.min(axis=0) + known.max(axis=0)) / 2 + block.offset
    return Local.amid(middle[None], block.crs)


def loose_way(block: Block, crs: str | None) -> list[str]:
    """A sentence where the datum of a system is joined only loosely to the block's."""
    local = local_of(block)
    if crs is None or block.crs is None and local is None:
        return []
    if local is None:
        x, y, _ = np.nanmedian(places_of(block), axis=0) + block.offset
        place = coordinates.lon_lat(x, y, known_crs(str(block.crs)))
    else:
        place = local.lon_deg, local.lat_deg
    told = coordinates.loosely_known(*place, crs, block.crs or GEOGRAPHIC)
    return [told] if told else []


def places_of(block: Block) -> np.ndarray:
    """Coordinates (n, 3) of images, else antennas, else ground points."""
    for table in ("images", "gnss", "ground", "points"):
        places = block.numbers(table, *"xyz")
        if np.isfinite(places).all(axis=1).any():
            return places
    raise InputError("the block has no coordinates; there is nothing to convert")


def metric(crs: str) -> tuple[str, float]:
    """The same grid counted in metres, and how many metres its own unit has; 1.0: it is metric."""
    system = known_crs(crs)
    unit = float(system.axis_info[0].unit_conversion_factor)
    if not system.is_projected or abs(unit - 1) < 1e-9:
        return crs, 1.0
    table = system.to_json_dict()
    for part in (table, *table.get("components", ())):
        part.pop("id", None)
        for axis in part.get("coordinate_system", {}).get("axis", ()):
            axis["unit"] = "metre"
    table["name"] = f"{system.name} in metres"
    return type(system).from_json_dict(table).to_wkt(), unit


def in_metres(crs: str) -> None:
    """Raises InputError unless a CRS is a grid in metres, as a block's coordinates have to be."""
    system = known_crs(crs)
    if not system.is_projected:
        raise InputError(f"crs {crs} is not in metres of a grid; give one that is, as EPSG:32647")
    if metric(crs)[1] != 1.0:
        raise InputError(
            f"crs {crs} counts in {system.axis_info[0].unit_name}, and a block in metres; give a "
            "system in metres of the same place"
        )


def convert_within(places: Any, crs: str) -> np.ndarray:
    """Longitude, latitude (degrees), height (n, 3) in a CRS.

    Raises InputError where they lie outside its area of use, or where its metres are none.
    """
    places = np.asarray(places, dtype=float)
    made = convert(places, GEOGRAPHIC, crs)
    outside = outside_area(made, crs, converted=True)
    lon, lat, _ = np.median(places, axis=0)
    system = known_crs(crs)
    if system.is_projected and not outside:
        near = Local(lat, lon).to_geographic(np.array([[0, 0, 0], [_NEAR_M, 0, 0]]))
        ends = convert(near, GEOGRAPHIC, crs)[:, :2] * system.axis_info[0].unit_conversion_factor
        scale = float(np.linalg.norm(ends[1] - ends[0])) / _NEAR_M
        if abs(scale - 1) > _STRETCHED:
            zone = int((lon + 180) // 6) % 60 + 1
            raise InputError(
                f"{crs} makes lengths {scale:.3f} times as long at latitude {lat:.2f}: it is for "
                f"maps, not for measuring; give another, as EPSG:{32600 + 100 * (lat < 0) + zone}"
            )
    if outside:
        raise InputError(
            f"{outside}, and the block lies at latitude {lat:.2f}, longitude {lon:.2f}: give a "
            "system of that place"
        )
    return made


def grid_distortion(block: Block) -> tuple[float, float] | None:
    """How far a block's grid is from Cartesian: scale less 1, and curvature, m; None: it has none.

    The first is the scale of the projection over the block, which heights do not have: focal
    lengths take it up. The second is the largest distance of cameras and points from their places
    on Earth after the best similarity, with heights of that scale: what no adjustment takes up.
    """
    if block.crs is None or local_of(block) is not None or not known_crs(block.crs).is_projected:
        return None
    tables = [block.numbers(t, *"xyz") for t in ("images", "gnss", "points", "ground")]
    places = np.concatenate([xyz for xyz in tables if xyz.shape[1:] == (3,)])
    places = places[np.isfinite(places).all(axis=1)]
    places = places[:: max(len(places) // 2000, 1)]
    if len(places) < 3:
        return None
    local = about_the_middle(block)
    true = local.from_crs(places + block.offset, block.crs)
    level = places - places.mean(axis=0)
    scale = 1 / similarity(places, true).scale
    level[:, 2] *= scale
    away = np.linalg.norm(similarity(level, true).apply(level) - true, axis=1)
    return scale - 1, float(away.max())
