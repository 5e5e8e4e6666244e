"""The track of an antenna: positions at the receiver's epochs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.gnss.time import clock

POSITION = ["x", "y", "z"]
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
            geocentric or None); rho_xy, rho_xz, rho_yz: their correlations; optional
        vx, vy, vz, svx, svy, svz: velocities and their standard deviations, m/s, axes as for sx;
            optional
        quality: RTKLIB's number (1 fix, 2 float, 3 SBAS, 4 DGPS, 5 single, 6 PPP); optional
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

    @classmethod
    def of_rows(
        cls,
        table: pd.DataFrame,
        rows: np.ndarray,
        source: Path,
        day: str | None = None,
        time_system: str | None = None,
        crs: str | None = None,
        notes: Sequence[str] = (),
    ) -> "Track":
        """Of epochs as they were read, copies left out; rows (n,): lines of the file.

        Raises InputError where a place cannot be, the time goes back, or one epoch has two
        positions.
        """
        if crs == GEOGRAPHIC:
            _check_geographic(table, rows, source)
        table, copies = _in_order(table, rows, source)
        return cls(table, day, time_system, crs, source, notes=(*notes, *copies))

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
    """Raises InputError where a quality is none of RTKLIB's whole numbers, or every epoch is a
    single position: metres, not centimetres."""
    if "quality" not in track.table:
        return
    quality = track.table["quality"].to_numpy(float)
    wrong = np.flatnonzero(np.isfinite(quality) & (quality != np.round(quality)))
    if len(wrong):
        raise InputError(
            f"{track.source.name}, row {wrong[0] + 2}: quality {quality[wrong[0]]:g} is not a "
            "whole number; write RTKLIB's 1 fix, 2 float, 5 single"
        )
    if len(quality) and (quality == 5).all():
        raise InputError(
            f"{track.source.name}: all {len(track.table)} epochs are single positions (quality 5), "
            "good to metres only; process the track again with a base station"
        )


def _in_order(
    table: pd.DataFrame, rows: np.ndarray, path: Path
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The table without copies of epochs, and notes on what was left out.

    table: columns of a track; times must rise within each flight. rows: (n,) lines of the file.
    Raises InputError where the time goes back, or one epoch has two positions.
    """
    if not len(table):
        raise InputError(f"{path.name} holds no epochs; write the track again")
    time = table["time_s"].to_numpy()
    same_flight = np.ones(len(table) - 1, dtype=bool)
    if "flight" in table:
        names = table["flight"].to_numpy()
        same_flight = names[1:] == names[:-1]
    step = np.diff(time)
    back = same_flight & (step < 0)
    if back.any():
        k = int(np.argmax(back))
        raise InputError(
            f"{path.name}, row {rows[k + 1]}: the time goes back by {-step[k]:.6g} s, from "
            f"{clock(time[k])} in row {rows[k]} to {clock(time[k + 1])}; sort the rows by time, or "
            "put each flight into a file of its own"
        )
    twice = same_flight & (step == 0)
    if not twice.any():
        return table, ()
    position = table[POSITION].to_numpy()
    differ = twice & (position[1:] != position[:-1]).any(axis=1)
    if differ.any():
        k = int(np.argmax(differ))
        raise InputError(
            f"{path.name}, row {rows[k + 1]}: the epoch {clock(time[k])} stands in row {rows[k]} "
            "too, with another position; delete the wrong one"
        )
    copies = np.append(False, twice)
    count, first = int(copies.sum()), rows[int(np.argmax(copies))]
    note = f"{path.name}: {count} epoch{'s' * (count > 1)} written twice (first in row {first}), "
    note += "the copies were left out"
    return table[~copies].reset_index(drop=True), (note,)


def _check_geographic(table: pd.DataFrame, rows: np.ndarray, path: Path) -> None:
    """Raise InputError where a longitude (x) or latitude (y), degrees, cannot be."""
    wrong = (table["y"].abs() > 90) | (table["x"].abs() > 360)
    if wrong.any():
        k = int(np.argmax(wrong.to_numpy()))
        raise InputError(
            f"{path.name}, row {rows[k]}: latitude {table['y'].iloc[k]:g} and longitude "
            f"{table['x'].iloc[k]:g} are not a place on Earth; correct or delete the row"
        )
