from pathlib import Path

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import read_track

DATA = Path(__file__).parent / "data"


def test_gps_time_has_its_own_midnight_18_s_before_that_of_utc():
    track = read_track(DATA / "grafnav_midnight.txt")
    assert (track.day, track.time_system) == ("2024-06-24", "GPST")
    assert track.table["time_s"].tolist() == [86399.0, 86399.5, 86400.0, 86400.5, 86401.0, 86401.5]


def test_columns_are_found_by_name_and_unit():
    table = read_track(DATA / "grafnav_midnight.txt").table
    # 45 49 48.36 N, 100 15 1.44 W
    assert table[["x", "y", "z"]].iloc[0].tolist() == pytest.approx([-100.2504, 45.8301, 300.0])
    assert table[["sx", "sy", "sz"]].iloc[0].tolist() == [0.008, 0.012, 0.025]
    # 36, -18 and 1.8 km/h
    assert table[["vx", "vy", "vz"]].iloc[0].tolist() == pytest.approx([10.0, -5.0, 0.5])


def test_quality_is_told_in_rtklibs_numbers_and_kept_in_grafnavs():
    table = read_track(DATA / "grafnav_midnight.txt").table
    assert table["grafnav_quality"].tolist() == [1, 1, 2, 3, 5, 6]
    assert table["quality"].tolist() == [1, 1, 2, 2, 4, 5]


def test_week_and_seconds_and_geocentric_coordinates_will_do():
    track = read_track(DATA / "grafnav_ecef_week.txt")
    assert (track.day, track.crs) == ("2024-06-29", "EPSG:4978")
    assert np.diff(track.table["time_s"]) == pytest.approx(0.5)
    assert track.table[["sx", "sy", "sz"]].iloc[0].tolist() == [0.01, 0.01, 0.02]


def test_a_utc_column_that_is_not_18_s_behind_is_refused(tmp_path):
    text = (DATA / "grafnav_midnight.txt").read_text()
    text = text.replace("    GPSTime ", "    UTCTime     GPSTime ").replace(
        "      (HMS) ", "      (HMS)       (HMS) "
    )
    lines = text.splitlines()
    rows = []
    for k, line in enumerate(lines):
        if line.startswith("06/24"):
            line = line.replace("06/24/2024 ", f"06/24/2024 23:59:{42 + 0.5 * (k - 11):06.3f} ")
        rows.append(line)
    (tmp_path / "x.txt").write_text("\n".join(rows))
    with pytest.raises(InputError, match=r"x.txt, row 12: GPS time and UTC are 17 s apart, but 18"):
        read_track(tmp_path / "x.txt")


def test_a_grid_without_heights_above_the_ellipsoid_is_refused(tmp_path):
    text = (DATA / "grafnav_midnight.txt").read_text().replace("H-Ell", "H-MSL")
    (tmp_path / "x.txt").write_text(text)
    with pytest.raises(InputError, match=r"x.txt lacks H-Ell"):
        read_track(tmp_path / "x.txt")
