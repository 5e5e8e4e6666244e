"""Coordinates: a local frame about the block.

An adjustment needs a Cartesian frame with small numbers. `Local` is one: east, north, up about a
point near the middle of the block. The Earth's curvature and the scale of a map projection are
then no error, because nothing is flattened.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from corridor.core.block import RHO, correlations, covariances
from corridor.core.errors import InputError
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track

# PROJ is loaded at first use: most blocks are in local metres.
if TYPE_CHECKING:
    import pyproj

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
    grids = _missing_grids(source, target)
    named, other = (_called(crs) for crs in (source, target))
    if grids:
        files = " ".join(f"--file {grid.removesuffix('.tif')}" for grid in grids)
        needs = other if known_crs(target).is_compound else named
        return (
            f"{needs} needs {' and '.join(grids)}, which is not installed: `pyproj sync {files}` "
            "fetches it; or give heights above the ellipsoid in a system without a vertical part"
        )
    if known_crs(source).is_compound or known_crs(target).is_compound:
        heights = named if known_crs(source).is_compound else other
        return (
            f"PROJ knows no way between the heights of {heights} and the ellipsoid: give them "
            "above the ellipsoid, in a system without a vertical part"
        )
    return (
        f"no exact transformation from {named} to {other} is known: PROJ would be off by tens of "
        "metres; write the system by its EPSG code, which states its datum"
    )


def loosely_known(lon: float, lat: float, source: str, target: str) -> str:
    """A sentence where the datums of two systems are joined to more than a metre; empty elsewhere.

    lon, lat: degrees, of the place. EPSG states 1 m between datums that are taken as one.
    """
    from pyproj.exceptions import ProjError

    systems = map(known_crs, (source, target))
    one, other = (s.sub_crs_list[0] if s.is_compound else s for s in systems)
    try:
        way = _between(*((system.geodetic_crs or system).to_wkt() for system in (one, other)))
        way.transform(lon, lat, 0.0)
        known_m = way.accuracy if way.accuracy >= 0 else way.get_last_used_operation().accuracy
    except ProjError:  # no step, or told where points are converted
        return ""
    if not known_m > 1.0:
        return ""
    names = ("WGS 84" if crs == GEOGRAPHIC else _called(crs) for crs in (source, target))
    files = " ".join(f"--file {g.removesuffix('.tif')}" for g in _missing_grids(source, target))
    return (
        f"PROJ knows the way between {' and '.join(names)} to {known_m:g} m only: what GNSS and "
        "what the surveyor gave may lie as far apart"
        + (f"; `pyproj sync {files}` fetches what says it better" if files else "")
    )


@lru_cache(maxsize=32)
def _missing_grids(source: str, target: str) -> tuple[str, ...]:
    """Files that PROJ's best way from one system to the other needs and has not; it looks long."""
    from pyproj.transformer import TransformerGroup

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            group = TransformerGroup(
                known_crs(source), known_crs(target), always_xy=True, allow_ballpark=False
            )
        except RuntimeError:
            return ()
    first = group.unavailable_operations[:1]
    return tuple(g.short_name for one in first for g in one.grids if not g.available)


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
    return pyproj.Transformer.from_crs(
        known_crs(source), known_crs(target), always_xy=True, allow_ballpark=False, only_best=True
    )
