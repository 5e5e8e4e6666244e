"""Tables of positions that are not as they should be: one sentence, and the same moment is one."""

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Exposures, Track, align, read_track
from corridor.core.gnss.time import gps_day, on_one_day

HEAD = "Project: x\nProgram: GrafNav Version 8.90\n\n"
NAMES = "Week  GPSTime  Latitude  Longitude  H-MSL"
UNITS = "(weeks)  (sec)  (deg)  (deg)  (m)"


def grafnav(folder, names, units):
    path = folder / "flight.txt"
    path.write_text(f"{HEAD}{names}\n{units}\n2371 207010.2 48.2 16.1 345.0\n")
    return path


def test_more_units_than_columns_are_told(tmp_path):
    with pytest.raises(InputError, match="more units than columns"):
        read_track(grafnav(tmp_path, NAMES, UNITS + "  (m)"))


def test_only_columns_that_are_missing_are_called_so(tmp_path):
    with pytest.raises(InputError, match=r"lacks H-Ell \(it has Week \(weeks\), GPSTime \(sec\)"):
        read_track(grafnav(tmp_path, NAMES, UNITS))


def test_one_moment_is_one_number_whatever_it_was_counted_from():
    """An exposure at the first epoch of its track lies in it."""
    second = 207010.137  # of the week: Tuesday 09:30:10.137
    seconds = np.arange(2000) / 1000
    by_week = on_one_day([gps_day(2371, second + more) for more in seconds])
    by_clock = on_one_day([("2025-06-17", 34210.137 + more) for more in seconds])
    assert by_week == by_clock


@pytest.mark.parametrize("head", ["$PTNL,GGK,092942.00,061725", "$BDGGA,092942.00,4812.0,N"])
def test_messages_of_any_receiver_are_called_messages(tmp_path, head):
    path = tmp_path / "log.txt"
    path.write_text(f"{head},4812.0,N,01606.0,E\n")
    with pytest.raises(InputError, match="NMEA"):
        read_track(path)


def test_a_table_of_no_known_program_is_refused_with_the_way_on(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("Timestamp,Lat,Lon,Alt,Quality\n2025-06-17,48.2,16.1,345,Fixed\n")
    with pytest.raises(
        InputError, match=r"write the columns of another program as the track.csv of a block"
    ):
        read_track(path)


def test_seconds_since_1970_are_counted_from_there(tmp_path):
    """10 s after the start of a track at 2025-06-17 09:30:00 GPS time, which is 18 s ahead."""
    track = Track(
        pd.DataFrame({"time_s": [34200.0, 34260.0], "x": 16.1, "y": 48.2, "z": 300.0}),
        "2025-06-17", "GPST", "EPSG:4979", tmp_path / "a.pos",
    )  # fmt: skip
    taken = pd.DataFrame({"image": ["a"], "time_s": [1750152592.0]})
    exposures = Exposures(taken, None, "UTC", None, tmp_path / "images.csv")
    found = align(track, exposures)
    assert taken["time_s"][0] + found.offset_s == 34210.0
    assert any("from the start of 1970" in note for note in found.notes)


CSRS = (
    "HDR GRP CANADIAN GEODETIC SURVEY\nDIR FRAME  STN   DAYofYEAR YEAR-MM-DD HR:MN:SS.SSS NSV GDOP "
    "SDLAT(95%)  SDLON(95%)  SDHGT(95%) LATDD LATMN    LATSS LONDD LONMN    LONSS     HGT(m)\n"
)
ROW = "{} {} ROVR 168.39 2025-06-17 {} 12 2.0 0.0196 0.0392 0.0588 45 24 0.36 {} 42 0.0 75.123\n"


def csrs(folder, *rows):
    path = folder / "flight.pos"
    path.write_text(CSRS + "".join(ROW.format(*row) for row in rows))
    return read_track(path)


def test_a_solution_of_csrs_ppp_is_read_with_one_sigma_and_its_backward_pass(tmp_path):
    """95 % are 1.96 sigma; 75 degrees 42 minutes west; the forward pass knows half the flight."""
    track = csrs(
        tmp_path,
        ("FWD", "ITRF20", "09:30:00.000", "-75"),
        ("BWD", "ITRF20", "09:30:00.200", "-75"),
        ("BWD", "ITRF20", "09:30:00.000", "-75"),
    )
    assert track.time_system == "GPST" and track.day == "2025-06-17" and not track.notes
    assert track.table["time_s"].tolist() == [34200.0, 34200.2]
    row = track.table.iloc[0]
    assert row[["x", "y", "z"]].tolist() == pytest.approx([-75.7, 45.4001, 75.123], abs=1e-12)
    assert row[["sx", "sy", "sz"]].tolist() == pytest.approx([0.02, 0.01, 0.03])


def test_a_solution_of_csrs_ppp_in_another_frame_or_with_a_wrong_day_is_told(tmp_path):
    (note,) = csrs(tmp_path, ("BWD", "NAD83", "09:30:00.000", "-75")).notes
    assert "NAD83" in note
    with pytest.raises(InputError, match=r"row 3: 2025-06-17 9h30 is not a time"):
        csrs(tmp_path, ("BWD", "ITRF20", "9h30", "-75"))
