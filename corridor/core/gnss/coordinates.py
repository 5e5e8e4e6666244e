"""Coordinates: a local frame about the block.

An adjustment needs a Cartesian frame with small numbers. `Local` is one: east, north, up about a
point near the middle of the block. The Earth's curvature and the scale of a map projection are
then no error, because nothing is flattened.
"""

from __future__ import annotations

import warnings
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from corridor.core.block import RHO, correlations, covariances
from corridor.core.errors import InputError
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track

# PROJ is loaded at first use: most blocks are in local metres.
if TYPE_CHECKING:
    import pyproj

# Grids of PROJ's database between a height system and ellipsoids, the newest datum first.
_HEIGHTS = """
    SELECT crs.name, grids.proj_grid_name FROM grid_transformation AS way
    JOIN geodetic_crs AS crs ON crs.auth_name = way.source_crs_auth_name
        AND crs.code = way.source_crs_code
    JOIN grid_alternatives AS grids ON grids.original_grid_name = way.grid_name
    JOIN usage ON usage.object_table_name = 'grid_transformation'
        AND usage.object_auth_name = way.auth_name AND usage.object_code = way.code
    JOIN extent ON extent.auth_name = usage.extent_auth_name AND extent.code = usage.extent_code
    WHERE way.target_crs_auth_name = 'EPSG' AND way.target_crs_code = ? AND NOT way.deprecated
        AND ? BETWEEN extent.south_lat AND extent.north_lat
        AND (? - extent.west_lon + 360) % 360 <= (extent.east_lon - extent.west_lon + 360) % 360
    ORDER BY CAST(crs.code AS INTEGER) DESC
"""
_GRS80, _AS_ONE_M = (6378137.0, 298.2572), 2.0
_SIGMAS = (("sx", "sy", "sz"), ("svx", "svy", "svz"))


@dataclass(frozen=True)
class Local:
    """East, north, up in metres about a point on the WGS 84 ellipsoid or above it.

    lat_deg, lon_deg: degrees. height: of the origin above the ellipsoid, metres.
    Topocentric: geocentric coordinates minus the origin's, then turned; float64.
    """

    lat_deg: float
    lon_deg: float
    height: float = 0.0

    def __post_init__(self):
        # Plain numbers: PROJ would take the text of any other kind of number for zero.
        for name in ("lat_deg", "lon_deg", "height"):
            object.__setattr__(self, name, float(getattr(self, name)))
        if not (abs(self.lat_deg) <= 90 and abs(self.lon_deg) <= 360 and abs(self.height) < 1e5):
            raise InputError(
                f"{self.lat_deg:g}, {self.lon_deg:g}, {self.height:g} is not a place on Earth; "
                "give latitude, longitude (degrees) and height (m)"
            )

    @classmethod
    def about(cls, track: Track) -> Local:
        """The frame about the middle of a track, on round numbers (0.0001 degrees, about 10 m).

        Its height is 0, so that z is close to the height above the ellipsoid.
        Raises InputError where the track has no place in the world.
        """
        geographic = geographic_positions(track)
        if np.ptp(geographic[:, 0]) > 180:  # over the 180th meridian
            geographic[:, 0] %= 360
        middle = (geographic.min(axis=0) + geographic.max(axis=0)) / 2
        lon_deg = (float(middle[0]) + 180) % 360 - 180
        return cls(round(float(middle[1]), 4), round(lon_deg, 4))

    @classmethod
    def amid(cls, places: np.ndarray, crs: str, digits: int = 4) -> Local:
        """The same about the median of places (n, 3) in a CRS; digits: decimals of its degrees."""
        lon_deg, lat_deg, _ = np.median(convert(places, crs, GEOGRAPHIC), axis=0)
        return cls(round(float(lat_deg), digits), round(float(lon_deg), digits))

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude and longitude in degrees, height in metres."""
        return self.lat_deg, self.lon_deg, self.height

    def rotation(self) -> np.ndarray:
        """(3, 3): geocentric directions to east, north, up."""
        lat, lon = np.radians([self.lat_deg, self.lon_deg])
        return np.array(
            [
                [-np.sin(lon), np.cos(lon), 0.0],
                [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
                [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
            ]
        )

    def from_crs(self, points: np.ndarray, crs: str) -> np.ndarray:
        """(n, 3) east, north, up of points (n, 3) in any CRS, x or longitude first.

        Heights of a CRS that has none are taken as above the ellipsoid.
        Raises InputError for a CRS that is not known, or needs a grid that is not there.
        """
        return self.from_geographic(convert(points, crs, GEOGRAPHIC))

    def to_crs(self, points: np.ndarray, crs: str) -> np.ndarray:
        """(n, 3) of east, north, up (n, 3) in any CRS, x or longitude first; the way back."""
        return convert(self.to_geographic(points), GEOGRAPHIC, crs)

    def from_geographic(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) east, north, up of longitude, latitude (degrees) and height (n, 3).

        Raises InputError for a latitude that is none.
        """
        high = np.abs(np.asarray(points, dtype=float).reshape(-1, 3)[:, 1]) > 90
        if high.any():
            raise InputError(
                f"latitude {np.asarray(points).reshape(-1, 3)[high, 1][0]:g} is none: latitude and "
                "longitude are exchanged, or the coordinates are not in degrees"
            )
        return _columns(_topocentric(*self.origin), points)

    def to_geographic(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) longitude, latitude (degrees) and height of east, north, up (n, 3)."""
        return _columns(_topocentric(*self.origin), points, "INVERSE")

    def to_local(self, track: Track) -> Track:
        """The track in this frame; crs None, `origin` this frame's.

        Standard deviations, covariances and velocities are turned where their axes are not east,
        north, up already. Those of a geographic track are east, north, up at the antenna; over 1
        km that differs from this frame's by 0.01 degrees, which is left alone.
        A track in local metres without a place in the world comes back as it is.
        """
        if track.crs is None and track.origin is None:
            return track
        points = self.from_geographic(geographic_positions(track))
        table = track.table.copy()
        table[["x", "y", "z"]] = points
        if track.crs == GEOCENTRIC:
            table = _turned(table, self.rotation())
        elif track.origin is not None and track.origin != self.origin:
            table = _turned(table, self.rotation() @ Local(*track.origin).rotation().T)
        return replace(track, table=table, crs=None, origin=self.origin)


def to_local(track: Track, about: Local | None = None) -> Track:
    """The track in metres east, north, up about a point; without one, about its own middle.

    A track that is local already keeps its frame unless `about` asks for another.
    """
    if about is None:
        if track.crs is None:
            return track
        about = Local.about(track)
    return about.to_local(track)


def geographic_positions(track: Track) -> np.ndarray:
    """(n, 3) longitude, latitude (degrees), height (m) above the WGS 84 ellipsoid.

    Raises InputError for a local track without a place in the world.
    """
    if track.crs is not None:
        return convert(track.positions(), track.crs, GEOGRAPHIC)
    if track.origin is None:
        raise InputError(
            f"{track.source.name} is in local metres without a place in the world; use it with "
            "images in the same frame, or give a track with latitude and longitude"
        )
    return Local(*track.origin).to_geographic(track.positions())


def convert(points: np.ndarray, source: str, target: str) -> np.ndarray:
    """Points (n, 3) from one CRS to another; x, easting or longitude first, float64.

    A height that neither or only one of the CRS names passes as it is.
    Raises InputError for a CRS that is not known, for a point outside its area, and for a height
    system whose geoid is not installed: nothing is converted roughly.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    if source == target:
        return points.copy()
    from pyproj.exceptions import ProjError

    try:
        # A missing grid is told by the sentence below, not by PROJ's warning.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            return _columns(_between(source, target), points)
    except ProjError:
        raise InputError(_no_way(points, source, target)) from None


def _no_way(points: np.ndarray, source: str, target: str) -> str:
    """Why PROJ does not convert: the coordinates, a grid that is missing, or no known operation."""
    outside = outside_area(points, source)
    if outside:
        return outside
    x, y = np.median(points[:, :2], axis=0)
    place = lon_lat(x, y, known_crs(source))
    grids = _missing_grids(source, target, place)
    named, other = (_called(crs) for crs in (source, target))
    high = [system for system in map(known_crs, (source, target)) if system.is_compound]
    if grids:
        needs = other if known_crs(target).is_compound else named
        return (
            f"{needs} needs {' and '.join(grids)}, which {'is' if len(grids) < 2 else 'are'} not "
            f"installed: {_fetched(grids, 'it' if len(grids) < 2 else 'them')}"
            + "; or give heights above the ellipsoid in a system without a vertical part"
            * bool(high)
        )
    if high:
        heights = named if known_crs(source).is_compound else other
        return (
            f"PROJ knows no way between the heights of {heights} and the ellipsoid"
            f"{_other_datums(high[0], *place)}: give them above the ellipsoid, in a system without "
            "a vertical part"
        )
    for crs, system in zip((named, other), map(known_crs, (source, target)), strict=True):
        datum = system.geodetic_crs
        if datum is not None and "unknown" in datum.name.lower():
            return (
                f"{crs} names an ellipsoid and no datum: give the code of the system, as EPSG:25832"
            )
    return (
        f"no exact transformation from {named} to {other} is known: PROJ would be off by tens of "
        "metres; give the coordinates in a system of the other's datum, as the survey authority's "
        "program converts them"
    )


def loosely_known(lon: float, lat: float, source: str, target: str) -> str:
    """A sentence where the datums of two systems are joined to more than a metre, or a grid that is
    not installed joins them better; empty elsewhere.

    lon, lat: degrees, of the place. EPSG states 1 m between datums that are taken as one.
    """
    from pyproj.exceptions import ProjError

    systems = map(known_crs, (source, target))
    levels = (s.sub_crs_list[0] if s.is_compound else s for s in systems)
    one, other = ((level.geodetic_crs or level).to_wkt() for level in levels)
    try:
        way = _between(one, other)
        way.transform(lon, lat, 0.0)
    except ProjError:  # told where points are converted
        return ""
    known_m = _AS_ONE_M if _taken_as_one(one, other) else way.accuracy
    if known_m < 0:
        try:
            known_m = way.get_last_used_operation().accuracy
        except ProjError:  # a way without a step
            known_m = 0.0 if one == other else 1.0
    grids = _missing_grids(one, other, (lon, lat), known_m)
    if not known_m > 1.0 and not grids:
        return ""
    names = ("WGS 84" if crs == GEOGRAPHIC else _called(crs) for crs in (source, target))
    return (
        f"PROJ knows the way between {' and '.join(names)} to {known_m:g} m only: what GNSS and "
        "what the surveyor gave may lie as far apart"
        + (f"; {_fetched(grids, 'what joins them better')}" if grids else "")
    )


def _fetched(grids: tuple[str, ...], what: str) -> str:
    """How grids are had: those of the network of PROJ by its command, others from their makers."""
    own = [grid for grid in grids if ".tif" not in grid]
    if own:
        return (
            f"put {' and '.join(own)} of the survey authority into the folder that `pyproj -v` "
            "names"
        )
    files = " ".join(f"--file {grid.removesuffix('.tif')}" for grid in grids)
    return f"`pyproj sync {files}` fetches {what}"


@lru_cache(maxsize=32)
def _missing_grids(
    source: str,
    target: str,
    place: tuple[float, float] | None = None,
    within_m: float = np.inf,
) -> tuple[str, ...]:
    """Files that PROJ's best way from one system to the other needs and has not; it looks long.

    place: longitude, latitude, degrees; a way is one for a part of the Earth. within_m: how well
    the way has to be known.
    """
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    area = None
    if place is not None and np.isfinite(place).all():
        lon, lat = (place[0] + 180) % 360 - 180, place[1]
        area = AreaOfInterest(lon - 0.01, lat - 0.01, lon + 0.01, lat + 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            group = TransformerGroup(
                known_crs(source),
                known_crs(target),
                always_xy=True,
                allow_ballpark=False,
                area_of_interest=area,
            )
        except RuntimeError:
            return ()
    good = (one for one in group.unavailable_operations if one.accuracy <= within_m)
    first = next(good, None)
    return tuple(g.short_name for g in first.grids if not g.available) if first else ()


def _other_datums(system: pyproj.CRS, lon: float, lat: float) -> str:
    """By which grid PROJ joins the heights of a compound system to the ellipsoid of another datum
    at a place (degrees); empty where it has none."""
    import sqlite3

    import pyproj

    code = system.sub_crs_list[1].to_authority("EPSG", 100)
    try:
        with closing(sqlite3.connect(Path(pyproj.datadir.get_data_dir()) / "proj.db")) as data:
            rows = data.execute(_HEIGHTS, (code[1] if code else "", lat, lon)).fetchall()
    except sqlite3.Error:
        return ""
    if not rows:
        return ""
    datum, grid = rows[0]
    return f" (it does for {datum}, with {grid}: {_fetched((grid,), 'it')})"


# Zones of UTM are used far beyond their borders: zone 32 for all of Bavaria, to 14 degrees east,
# zone 33 (12 to 18) for all of Norway, 4 to 31; other grids a little.
_BEYOND_UTM_DEG, _BEYOND_DEG = 13.0, 1.0


def outside_area(points: np.ndarray, crs: str, converted: bool = False) -> str:
    """A sentence where points (n, 3) lie outside the area of use of their CRS; empty elsewhere.

    The median of the points counts, and some degrees beyond the area are allowed. A CRS without a
    stated area covers the Earth. converted: into the CRS, from a place that is sure. Others may be
    local metres, which lie on the equator, beside the zone.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points) or known_crs(crs).is_geocentric:
        return ""
    system, named = known_crs(crs), _called(crs)
    x, y = np.median(points[:, :2], axis=0)
    shown = f"x = {x:.10g}, y = {y:.10g} {{}} the area of use of {named}"
    lon, lat = lon_lat(x, y, system)
    if not (np.isfinite([lon, lat]).all() and abs(lat) <= 90 and abs(lon) <= 360):
        return shown.format("are not coordinates in")
    level = system.sub_crs_list[0] if system.is_compound else system
    area = level.area_of_use
    if area is None:
        return ""
    told = level.utm_zone and (converted or area.south > _BEYOND_DEG)
    beyond = _BEYOND_UTM_DEG if told else _BEYOND_DEG
    east = (lon - area.west + beyond) % 360
    width = (area.east - area.west) % 360 or 360.0
    wide = width + 2 * beyond
    if area.south - 1 <= lat <= area.north + 1 and (east <= wide or wide >= 360):
        return ""
    return (
        f"{shown.format('lie outside')} ({shorten(area.name.rstrip('.'), 80, placeholder=' ...')})"
    )


def lon_lat(x: float, y: float, system: pyproj.CRS) -> tuple[float, float]:
    """Longitude and latitude, degrees, of x and y on the system's own datum; inf where none."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    plane = system.sub_crs_list[0] if system.is_compound else system
    geographic = plane.geodetic_crs
    if geographic is None:
        return np.inf, np.inf
    try:
        to = Transformer.from_crs(plane, geographic, always_xy=True)
        lon, lat = to.transform(x, y)
        back = to.transform(lon, lat, direction="INVERSE") if np.isfinite(lon) else (np.inf,) * 2
    except ProjError:
        return np.inf, np.inf
    # Far from its meridian a projection folds: what does not come back was no coordinate.
    near = np.abs(np.subtract(back, (x, y))).max() < 1e-3 * max(abs(x), abs(y), 1.0)
    return (lon, lat) if near or plane.is_geographic else (np.inf, np.inf)


def _called(crs: str) -> str:
    """A CRS as a person calls it: its code, or its name where only a long text is given."""
    name = known_crs(crs).name
    return crs if len(crs) <= 40 or name == "unknown" else name


@lru_cache(maxsize=32)
def known_crs(name: str) -> pyproj.CRS:
    """The coordinate reference system of a code or text. Raises InputError where it is none."""
    import pyproj

    try:
        return pyproj.CRS.from_user_input(name)
    except pyproj.exceptions.CRSError:
        raise InputError(
            f"{name[:60]!r} is not a known coordinate system; give a code, as EPSG:32647"
        ) from None


def _turned(table, rotation: np.ndarray):
    """Covariances and velocities of the columns, turned by a rotation (3, 3)."""
    table = table.copy()
    velocity = ["vx", "vy", "vz"]
    if set(velocity) <= set(table):
        table[velocity] = table[velocity].to_numpy() @ rotation.T
    for names in _SIGMAS:
        if not set(names) <= set(table):
            continue
        full = names[0] == "sx" and set(RHO) <= set(table)
        sigma = table[list(names)].to_numpy()
        rho = table[list(RHO)].to_numpy() if full else np.zeros(sigma.shape)
        covariance = rotation @ covariances(sigma, rho) @ rotation.T
        table[list(names)] = np.sqrt(np.einsum("nii->ni", covariance))
        if full:
            table[list(RHO)] = correlations(covariance)
    return table


def _columns(transformer, points, direction="FORWARD") -> np.ndarray:
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    moved = transformer.transform(*points.T, errcheck=True, direction=direction)
    return np.column_stack(moved)


@lru_cache(maxsize=32)
def _topocentric(lat_deg: float, lon_deg: float, height: float) -> pyproj.Transformer:
    import pyproj

    return pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={height!r}"
    )


@lru_cache(maxsize=32)
def _between(source: str, target: str) -> pyproj.Transformer:
    import pyproj

    # Without these two a height system whose geoid is missing would pass silently unconverted.
    rough = _taken_as_one(source, target)
    return pyproj.Transformer.from_crs(
        known_crs(source), known_crs(target), always_xy=True, allow_ballpark=rough, only_best=True
    )


@lru_cache(maxsize=32)
def _taken_as_one(source: str, target: str) -> bool:
    """Whether PROJ knows no way between two datums about the middle of the Earth, as CGCS2000 and
    WGS 84: their ellipsoids are one to 0.1 mm, and they are one to `_AS_ONE_M`."""
    from pyproj.transformer import TransformerGroup

    systems = known_crs(source), known_crs(target)
    for system in systems:
        datum = system.geodetic_crs
        shape = datum.ellipsoid if datum else None
        if datum is None or shape is None or system.is_compound or "unknown" in datum.name.lower():
            return False
        size = shape.semi_major_metre, shape.inverse_flattening
        if np.abs(np.subtract(size, _GRS80)).max() > 1e-4:
            return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        ways = TransformerGroup(*systems, always_xy=True, allow_ballpark=False)
    return not ways.transformers and not ways.unavailable_operations
