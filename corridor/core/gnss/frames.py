"""Where on Earth a block's coordinates lie, and the same block in another frame.

A block is Cartesian. Its coordinates are either those of a grid (`crs` of block.toml, less its
`offset`), or east, north, up about a point (`[local_frame]` there). A grid is no Cartesian frame:
its scale differs from 1, heights keep theirs, and the Earth curves below it. In the local frame
these are no errors; results then go out through PROJ, in the system that `[local_frame]` names.
"""

from typing import Any

import numpy as np

from corridor.core.block import POSE, RHO, Block, correlations, covariances
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion, similarity
from corridor.core.gnss.coordinates import Local, convert, known_crs, outside_area
from corridor.core.gnss.track import GEOGRAPHIC

FRAME = "local_frame"
# Directions are differences over this length: of PROJ's nanometres 1e-11 rad are left.
_STEP_M = 100.0
_SIGMAS = (("gnss", ("sx", "sy", "sz")), ("ground", ("sx", "sy", "sz")),
           ("points", ("sx", "sy", "sz")), ("track", ("sx", "sy", "sz")))  # fmt: skip
_VELOCITY = (("images", ("vx", "vy", "vz")), ("track", ("vx", "vy", "vz")))


def local_table(local: Local, crs: str | None = None) -> dict[str, float | str]:
    """`local_frame` of block.toml; crs: the system in which results are given."""
    table = {"lat_deg": local.lat_deg, "lon_deg": local.lon_deg, "height": local.height}
    return table | ({"crs": crs} if crs else {})


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
            "--crs, or give --photos whose positions place it"
        )
    places = _places(block)
    known = places[np.isfinite(places).all(axis=1)]
    middle = (known.min(axis=0) + known.max(axis=0)) / 2 + block.offset
    lon, lat, _ = convert(middle[None], block.crs, GEOGRAPHIC)[0]
    return Local(round(float(lat), 4), round(float(lon), 4), 0.0)


def _places(block: Block) -> np.ndarray:
    """Coordinates (n, 3) of images, else antennas, else ground points."""
    for table in ("images", "gnss", "ground", "points"):
        places = block.numbers(table, *"xyz")
        if np.isfinite(places).all(axis=1).any():
            return places
    raise InputError("the block has no coordinates; there is nothing to convert")


def convert_within(places: Any, crs: str) -> np.ndarray:
    """Longitude, latitude (degrees), height (n, 3) in a CRS.

    Raises InputError where they lie outside its area of use.
    """
    places = np.asarray(places, dtype=float)
    made = convert(places, GEOGRAPHIC, crs)
    outside = outside_area(made, crs, converted=True)
    if outside:
        lon, lat, _ = np.median(places, axis=0)
        raise InputError(
            f"{outside}, and the block lies at latitude {lat:.2f}, longitude {lon:.2f}: give a "
            "system of that place"
        )
    return made


def moved(block: Block, target: Local | str, crs: str | None = None) -> Block:
    """The same block in another frame: a `Local`, or a CRS in metres.

    Points go through PROJ, one by one; rotations, velocities and standard deviations turn with the
    axes at their place. crs: the system that results of a local frame are given in.
    Raises InputError where the block has no place on Earth or one that no such CRS is for, or PROJ
    knows no exact way.
    """
    before = local_of(block)
    stated = block.crs or ""
    middle = before or about_the_middle(block)
    goal = crs if isinstance(target, Local) else target
    if goal:
        convert_within([[middle.lon_deg, middle.lat_deg, middle.height]], goal)

    def over(places: np.ndarray) -> np.ndarray:
        places = places + block.offset
        if before is not None:
            places = before.to_geographic(places)
        elif isinstance(target, Local):
            places = convert(places, stated, GEOGRAPHIC)
        else:
            return convert(places, stated, target)
        if isinstance(target, Local):
            return target.from_geographic(places)
        return convert(places, GEOGRAPHIC, target)

    made = block.copy()
    turns = {table: _turns(over, block.numbers(table, *"xyz"), block) for table in _turned(block)}
    for table in ("images", "points", "ground", "gnss", "track"):
        places = block.numbers(table, *"xyz") if _has(block, table, "xyz") else np.zeros((0, 3))
        known = np.isfinite(places).all(axis=1)
        if known.any():
            places[known] = over(places[known])
            made.put(table, "xyz", places)
    if _has(block, "images", POSE):
        pose = block.poses
        known = np.isfinite(pose).all(axis=1)
        rotation = rotation_from_quaternion(pose[known, 3:])
        back = np.transpose(turns["images"][known], (0, 2, 1))
        pose[known, 3:] = quaternion_from_rotation(rotation @ back)
        made.put("images", POSE[3:], pose[:, 3:])
    for table, names in _VELOCITY:
        if _has(block, table, names):
            velocity = block.numbers(table, *names)
            made.put(table, names, np.einsum("nij,nj->ni", turns[table], velocity))
    for table, names in _SIGMAS:
        if _has(block, table, names):
            sigma, rho = block.numbers(table, *names), np.array(block.correlation(table))
            known = np.isfinite(sigma).all(axis=1)
            turn = turns[table][known]
            full = turn @ covariances(sigma[known], rho[known]) @ turn.transpose(0, 2, 1)
            sigma[known] = np.sqrt(np.einsum("nii->ni", full))
            made.put(table, names, sigma)
            if rho.any():
                rho[known] = correlations(full)
                made.put(table, RHO, rho)
    made.extra = {key: value for key, value in block.extra.items() if key != FRAME}
    made.offset = np.zeros(3)
    if isinstance(target, Local):
        made.crs, made.extra[FRAME] = None, local_table(target, crs)
    else:
        made.crs = target
    made.forget_folder()
    return made


def _has(block: Block, table: str, names) -> bool:
    frame = getattr(block, table)
    return bool(len(frame)) and set(names) <= set(frame.columns)


def _turned(block: Block) -> set[str]:
    """Tables with directions."""
    tables = {table for table, names in (*_SIGMAS, *_VELOCITY) if _has(block, table, names)}
    return tables | ({"images"} if _has(block, "images", POSE) else set())


def _turns(over, places: np.ndarray, block: Block) -> np.ndarray:
    """(n, 3, 3): directions in the old frame to the new one, at each place; orthogonal.

    Unknown places turn as the middle of the block does.
    """
    known = np.isfinite(places).all(axis=1)
    middle = np.nanmedian(_places(block), axis=0)
    at = np.where(known[:, None], places, middle)
    ahead, behind = (
        np.stack([over(at + sign * step) for step in _STEP_M * np.eye(3)], axis=2)
        for sign in (1, -1)
    )
    u, _, vt = np.linalg.svd((ahead - behind) / (2 * _STEP_M))
    return u @ vt


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


def height_unit(crs: str) -> float:
    """Metres in a unit of heights beside a grid that names none: they count as the plane does."""
    system = known_crs(crs)
    plain = system.is_projected and len(system.axis_info) == 2
    return float(system.axis_info[0].unit_conversion_factor) if plain else 1.0


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
