"""Whether ground points can lie where a file puts them, measured by what the images see.

The yardstick is never the suspect: where the rays of the marks meet, else where the cameras stood.
What makes the coordinates fit (axes exchanged, feet, a zone before the easting ...) is named.
"""

from collections.abc import Callable, Iterable

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.gnss import about_the_middle, known_crs, local_of
from corridor.tools.formats.frames import height_unit
from corridor.tools.formats.rows import rows_of

_FOOT_M = 0.3048
_GON = "the angles are in gon: give degrees, which are 0.9 of them"
# So far, beside the reach of the flight, points may lie that no image shows.
_BESIDE_M = 2000.0
# A slip explains points that lie so many times nearer with it, and within reach of the flight.
_BETTER = 20.0
# Points this near to their rays are not suspected: coarse start poses are off by as much.
_CLOSE_M = 10.0
# Points on one spot, and how much wider they lie with what explains it: a degree is 1e5 m.
_ONE_PLACE_M, _WIDER = 0.5, 1e3
# A code receiver is not off by more horizontally; heights of drones are.
_FAR_M = 100.0


def refusal(
    block: Block, points: list[str], given: np.ndarray, crs: str | None, in_frame: Callable
) -> str:
    """Why ground points cannot lie where they are put, and what would explain it; else empty.

    block: with the ground points in ground.csv and the marks. points: those to look at. given:
    their coordinates (n, 3) as the file has them, in `crs`. in_frame: of a block, places, crs and
    what they are called, the places in the block's frame.
    """
    placed = block.numbers("ground", *"xyz")[block.ground["point"].isin(points).to_numpy()]
    met, centres = _met(block, points), _centres(block)
    seen = np.isfinite(met).all(axis=1)
    if seen.sum() >= 2:
        return _of_rays(block, placed[seen], met[seen], given[seen], crs, in_frame)
    return _of_reach(block, placed, centres, given, crs, in_frame) if len(centres) else ""


def remedy(
    block: Block, points: list[str], given: np.ndarray, crs: str | None, in_frame: Callable
) -> str:
    """What makes coordinates fit that are none in their system; empty where nothing does.

    As `refusal`; block: with the marks.
    """
    met, centres = _met(block, points), _centres(block)
    seen = np.isfinite(met).all(axis=1)
    for told, other in _slips(block, given, crs, in_frame):
        if seen.sum() >= 2:
            near = _distance(other[seen], met[seen]) < _FAR_M
        else:
            near = bool(len(centres)) and _beside(other, centres) < _reach(block, centres)
        if near:
            return told.rstrip(";")
    return ""


def _centres(block: Block) -> np.ndarray:
    """(n, 3): known places of the cameras."""
    centres = block.numbers("images", *"xyz")
    return centres[np.isfinite(centres).all(axis=1)]


def _met(block: Block, points: list[str]) -> np.ndarray:
    """(n, 3) where the rays of the marks of ground points meet; NaN with fewer than two."""
    if not len(block.marks) or not np.isfinite(block.poses).all(axis=1).any():
        return np.full((len(points), 3), np.nan)
    rows = rows_of(block, complete=False).posed()
    at = {name: k for k, name in enumerate(rows.point_names) if k >= rows.ties}
    known = np.array([at.get(name, -1) for name in points])
    met = np.full((len(points), 3), np.nan)
    if (known >= 0).any():
        with np.errstate(all="ignore"):
            met[known >= 0] = rows.intersected(known[known >= 0])
    return met


def _of_rays(block, placed, met, given, crs, in_frame) -> str:
    away = _distance(placed, met)
    if away < _CLOSE_M:
        # Less than start poses may miss; the adjustment says what is left.
        return ""
    left, told = _best(
        (_distance(other, met), told) for told, other in _slips(block, given, crs, in_frame)
    )
    if left < min(away / _BETTER, _reach(block, _centres(block))):
        return (
            f"{told} the points lie {_shown(away)} from where the rays of their marks meet; "
            f"otherwise {_shown(left)}"
        )
    # What no slip explains is told by `control`, with both numbers.
    return ""


def _of_reach(block, placed, centres, given, crs, in_frame) -> str:
    reach = _reach(block, centres)
    away = _beside(placed, centres)
    wide = float(np.ptp(placed[:, :2], axis=0).max())
    if away < reach and not (len(placed) > 1 and wide < _ONE_PLACE_M):
        return ""
    if away < reach:
        # Degrees taken for metres: nobody surveys several points on one spot.
        for told, other in _slips(block, given, crs, in_frame):
            spread = float(np.ptp(other[:, :2], axis=0).max())
            if _beside(other, centres) < reach and spread > _WIDER * max(wide, 1e-9):
                return f"{told} as metres all points lie within {_shown(wide)} of each other"
        return ""
    left, told = _best(
        (_beside(other, centres), told) for told, other in _slips(block, given, crs, in_frame)
    )
    if left < reach and left < away / _BETTER:
        return f"{told} the points lie {_shown(away)} from the images"
    return (
        f"the points lie {_shown(away)} from the images; are they of this project, and in its "
        "coordinates? Give the system with --ground-crs"
    )


def _best(slips: Iterable[tuple[float, str]]) -> tuple[float, str]:
    """What brings points nearest, m, and its words; of what is as good but for centimetres the
    usual one, which stands first."""
    found = list(slips)
    return min(found, key=lambda one: round(one[0], 1)) if found else (np.inf, "")


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    """Median distance, m."""
    return float(np.median(np.linalg.norm(one - other, axis=1)))


def _beside(places: np.ndarray, centres: np.ndarray) -> float:
    """Horizontal distance, m, of the middle of places from the rectangle of the cameras."""
    middle = np.median(places[:, :2], axis=0)
    low, high = centres[:, :2].min(axis=0), centres[:, :2].max(axis=0)
    return float(np.linalg.norm(np.maximum(np.maximum(low - middle, middle - high), 0.0)))


def _reach(block: Block, places: np.ndarray) -> float:
    """How far from the images their points can lie, m: some flight and some ground beside it."""
    points = block.points[["x", "y", "z"]].to_numpy(float)
    points = points[np.isfinite(points).all(axis=1)]
    every = np.concatenate([block.poses[:, :3], points, places])
    every = every[np.isfinite(every).all(axis=1)]
    low, high = np.percentile(every, [2, 98], axis=0)
    return float(np.linalg.norm(high - low)) + _BESIDE_M


def _slips(block, given, crs, in_frame):
    """(what is wrong, the places in the block's frame without it) of every usual slip."""

    def framed(places, system):
        try:
            return in_frame(block, places, system, "")
        except Exception:
            return None

    exchanged = given[:, [1, 0, 2]]
    geographic = crs is not None and known_crs(crs).is_geographic
    axes = "latitude and longitude are exchanged: longitude stands first"
    if not geographic:
        axes = (
            "x and y are exchanged: x is east, y north; name the columns in a header (Northing, "
            "Easting) or exchange them"
        )
    tries = [(axes, exchanged, crs)]
    if geographic:
        told = "the sign of the latitude is wrong: south of the equator it is below 0"
        tries.append((told, given * [1, -1, 1], crs))
        told = "the sign of the longitude is wrong: west of Greenwich it is below 0"
        tries.append((told, given * [-1, 1, 1], crs))
    if np.abs(given[:, :2]).max() <= 360 and crs is None:
        told = "the coordinates are longitude and latitude: give --ground-crs EPSG:4326"
        tries.append((told, given, "EPSG:4979"))
        told = "the coordinates are latitude and longitude: name the columns lat, lon, height"
        tries.append((told, exchanged, "EPSG:4979"))
    if geographic:
        gon = given * [0.9, 0.9, 1]
        tries += [(_GON, gon, crs), (f"{_GON}, and {axes}", gon[:, [1, 0, 2]], crs)]
        for told, angles in _written(given[:, :2]):
            tries.append((f"{told}: give degrees", np.column_stack([angles, given[:, 2]]), crs))
    elif np.abs(given[:, :2]).max() > 360:
        for name, metres in (("millimetres", 1e-3), ("centimetres", 1e-2), ("kilometres", 1e3)):
            tries.append((f"the coordinates are in {name}: give metres", given * metres, crs))
    for name, foot in (("feet", _FOOT_M), ("US survey feet", 1200 / 3937)):
        scaled = given * foot
        tries.append((f"the coordinates are in {name}: give metres", scaled, crs))
        told = f"the heights are in {name}: give metres"
        tries.append((told, given * [1, 1, foot], crs))
    unit = height_unit(crs) if crs else 1.0
    if unit != 1.0:
        told = f"the heights are in metres, and {crs[:40]} counts in feet: give them in feet"
        tries.append((told, given / [1, 1, unit], crs))
    zone = np.floor(given[:, 0] / 1e6)
    if (zone == zone[0]).all() and 1 <= zone[0] <= 60:
        bare = given - np.array([zone[0] * 1e6, 0, 0])
        told = f"the number of the zone ({zone[0]:.0f}) stands before the easting: take it away"
        tries.append((told, bare, crs))
        for north in (25800, 32600, 32700):
            code = f"EPSG:{north + int(zone[0])}"
            tries.append((f"{told}, and give --ground-crs {code}", bare, code))
    for code in _usual(block) if crs is None or known_crs(crs).is_projected else ():
        told = f"the coordinates are not those of the project: give --ground-crs {code}"
        if crs is not None:
            told = f"the coordinates are those of {code}: write that in place of {crs[:40]}"
        tries.append((told, given, code))
        told = f"northing stands first: name the columns, and give --ground-crs {code}"
        tries.append((told, exchanged, code))
    if block.offset.any() and crs is None:
        told = "the offset of the project was subtracted already: give full coordinates"
        tries.append((told, given + block.offset, None))
    for told, places, system in tries:
        made = framed(places, system)
        if made is not None and np.isfinite(made).all():
            yield f"{told};", made


def _written(angles: np.ndarray) -> Iterable[tuple[str, np.ndarray]]:
    """Angles (n, 2) that are no degrees, in degrees, and how they are written."""
    yield "the angles are in radians", np.degrees(angles)
    size, sign = np.abs(angles), np.sign(angles)
    whole = np.floor(size / 100.0)
    yield (
        "degrees and minutes are one number (DDMM.mmm)",
        sign * (whole + (size / 100 - whole) / 0.6),
    )
    minutes, seconds = np.divmod(np.round(1e4 * size, 7), 100.0)
    whole, minutes = np.divmod(minutes, 100.0)
    told = "degrees, minutes and seconds are one number (DD.MMSS)"
    yield told, sign * (whole + minutes / 60 + seconds / 3600)


def _usual(block: Block) -> list[str]:
    """The usual systems of where the block lies: its zone, those beside it, the national one of
    Germany, the web's and geocentric ones."""
    place = local_of(block)
    if place is None and block.crs is not None:
        try:
            place = about_the_middle(block)
        except InputError:
            return []
    if place is None:
        return []
    utm = int((place.lon_deg + 180) // 6) + 1
    bases = (25800, 32600) if place.lat_deg >= 0 else (32700,)
    codes = [base + zone for zone in (utm, utm - 1, utm + 1) for base in bases]
    if 47 < place.lat_deg < 56 and 5 < place.lon_deg < 16:
        codes += range(31466, 31470)
    return [f"EPSG:{code}" for code in (*codes, 3857, 4978)]


def _shown(metres: float) -> str:
    return f"{metres:,.1f} m" if metres < 1000 else f"{metres / 1000:,.2f} km"
