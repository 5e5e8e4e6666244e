"""The track of an antenna: positions at the receiver's epochs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.brief import brief
from corridor.errors import InputError
from corridor.gnss.epochs import POSITION

QUALITY = {1: "fix", 2: "float", 3: "sbas", 4: "dgps", 5: "single", 6: "ppp", 7: "dead reckoning"}
GEOGRAPHIC = "EPSG:4979"
GEOCENTRIC = "EPSG:4978"


@brief
@dataclass(frozen=True)
class Track:
    """Positions of an antenna over time.

    table: one row an epoch, times rising, float64:
        time_s: seconds since `day` 00:00 of `time_system`
        x, y, z: metres; longitude and latitude in degrees, height in metres where `crs` is
            EPSG:4979
        sx, sy, sz: standard deviations, metres, east, north, up (along the axes where `crs` is
            geocentric or None); cxy, cyz, czx: covariances, m2; optional
        vx, vy, vz, svx, svy, svz: velocities and their standard deviations, m/s, axes as for sx;
            optional
        quality: RTKLIB's number (QUALITY: 1 fix, 2 float, 5 single); optional
        flight: text; optional
    day: "2022-11-06"; None where the file states no date (time_s is then as in the file)
    time_system: "GPST", "UTC", "JST", ...; None where the file does not say
    crs: "EPSG:4979" (geographic, WGS 84), "EPSG:4978" (geocentric); None: local metres
    origin: latitude, longitude (degrees) and height (m) about which local x, y, z are east,
        north, up; None where crs says all, or where the place in the world is not known
    notes: sentences worth telling
    """

    table: pd.DataFrame
    day: str | None
    time_system: str | None
    crs: str | None
    source: Path
    notes: tuple[str, ...] = ()
    origin: tuple[float, float, float] | None = None

    @property
    def start(self) -> float:
        """Time of the first epoch, seconds."""
        return float(self.table["time_s"].min())

    @property
    def end(self) -> float:
        """Time of the last epoch, seconds."""
        return float(self.table["time_s"].max())

    def positions(self) -> np.ndarray:
        """(n, 3) x, y, z as in the table."""
        return self.table[POSITION].to_numpy()


def check_quality(track: Track) -> None:
    """Raise InputError where every epoch is a single position: metres, not centimetres."""
    if "quality" not in track.table:
        return
    quality = track.table["quality"].to_numpy()
    if len(quality) and (quality == 5).all():
        raise InputError(
            f"{track.source.name}: all {len(quality)} epochs are single positions (quality 5), "
            "good to metres only; process the track again with a base station"
        )
