"""A block in another frame: another grid, or east, north, up about a point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from corridor.core.block import POSE, RHO, SIGMAS, VELOCITY, Block, correlations, covariances
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.gnss import (
    GEOGRAPHIC,
    LOCAL_FRAME,
    Local,
    about_the_middle,
    convert,
    convert_within,
    known_crs,
    local_of,
    outside_area,
    places_of,
)
from corridor.tools.formats.textfile import opening

if TYPE_CHECKING:
    import pyproj

# Directions are differences over this length: of PROJ's nanometres 1e-11 rad are left.
_STEP_M = 100.0
_SIGMAS = tuple((table, SIGMAS) for table in ("gnss", "ground", "points", "track"))
_VELOCITY = (("images", VELOCITY), ("track", VELOCITY))


def local_table(local: Local, crs: str | None = None) -> dict[str, float | str]:
    """`local_frame` of block.toml; crs: the system in which results are given."""
    table = {"lat_deg": local.lat_deg, "lon_deg": local.lon_deg, "height": local.height}
    return table | ({"crs": crs} if crs else {})


def system_in(path: Path, option: str) -> tuple[str, pyproj.CRS] | None:
    """The system that a .prj names: its EPSG code, else its text, and as PROJ has it; None where
    the file is empty. option: that says it otherwise. Raises InputError where it names none."""
    text = opening(path, 20_000).strip()
    if not text:
        return None
    try:
        system = known_crs(text)
    except InputError:
        raise InputError(
            f"{path.name} names no coordinate system that is known; delete it, or give its code "
            f"with {option}"
        ) from None
    code = system.to_epsg()
    return f"EPSG:{code}" if code else text, system


def elsewhere(places: np.ndarray, crs: str) -> str:
    """A sentence on a stated system whose area does not hold places (n, 3); empty where it does,
    or where a block describes its frame in words."""
    try:
        outside = outside_area(places, crs)
    except InputError:
        return ""
    return outside and (
        f"the project states a system of another place: {outside}; its datum may lie metres from "
        "the right one, and heights and control given in another system will not fit: set the "
        "system that the coordinates are in, and export again"
    )


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
        rotation = rotation_from_quaternion(block.poses[:, 3:])
        turned = rotation @ turns["images"].transpose(0, 2, 1)
        made.put("images", POSE[3:], quaternion_from_rotation(turned))
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
    made.extra = {key: value for key, value in block.extra.items() if key != LOCAL_FRAME}
    made.offset = np.zeros(3)
    if isinstance(target, Local):
        made.crs, made.extra[LOCAL_FRAME] = None, local_table(target, crs)
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
    middle = np.nanmedian(places_of(block), axis=0)
    at = np.where(known[:, None], places, middle)
    ahead, behind = (
        np.stack([over(at + sign * step) for step in _STEP_M * np.eye(3)], axis=2)
        for sign in (1, -1)
    )
    u, _, vt = np.linalg.svd((ahead - behind) / (2 * _STEP_M))
    return u @ vt


def height_unit(crs: str) -> float:
    """Metres in a unit of heights beside a grid that names none: they count as the plane does."""
    system = known_crs(crs)
    plain = system.is_projected and len(system.axis_info) == 2
    return float(system.axis_info[0].unit_conversion_factor) if plain else 1.0
