"""How the clock of the images becomes the clock of the track."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_readers_bad_tracks import fault

from corridor.core.errors import InputError
from corridor.core.gnss import Exposures, Track, align
from corridor.core.gnss.time import ahead_of_utc, leap_seconds, mjd_day, time_system

EAST = 6378137.0 * np.pi / 180  # metres a degree of longitude on the equator


def track(first=30000.0, system="GPST", day="2024-06-24", seconds=100.0, crs="EPSG:4979"):
    """Flying east along the equator at 10 m/s, 5 Hz."""
    time = first + np.arange(0, seconds + 0.1, 0.2)
    x = 10 * (time - first)
    table = pd.DataFrame({"time_s": time, "x": x / (EAST if crs else 1), "y": 0.0, "z": 0.0})
    return Track(table, day, system, crs, Path("flight.pos"))


def images(times, system="GPST", day="2024-06-24", **columns):
    table = pd.DataFrame({"image": [f"i{k}" for k in range(len(times))], "time_s": times})
    return Exposures(table.assign(**columns), day, system, None, Path("images.txt"))


def test_gps_time_is_18_s_ahead_of_utc_since_2017_and_17_before():
    """IERS Bulletin C 52."""
    assert (leap_seconds("2016-12-31"), leap_seconds("2017-01-01")) == (17, 18)


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("gps", 18), ("UTC", 0), ("JST", 32400), ("utc+7", 25200), ("UTC-03:30", -12600),
     ("BDT", 4), ("TAI", 37)],
)  # fmt: skip
def test_time_systems_by_their_distance_to_utc(name, seconds):
    assert ahead_of_utc(name, "2024-06-24") == seconds


def test_an_unknown_time_system_is_refused():
    assert "'MEZ' is not known" in fault(time_system, "MEZ")


def test_no_digit_of_a_modified_julian_day_is_lost():
    """MJD 51544.5 is noon of 2000-01-01; a microsecond is the twelfth decimal."""
    assert mjd_day("51544.5") == ("2000-01-01", 43200.0)
    assert mjd_day("60485.000000000012")[1] == pytest.approx(1.0368e-6, rel=1e-9)


def test_one_system_and_one_day_want_no_offset():
    assert align(track(), images([30010.0, 30020.0])).offset_s == 0.0


def test_images_in_gps_time_and_a_track_in_utc_are_18_s_apart_and_it_is_said():
    result = align(track(system="UTC"), images([30028.0, 30038.0]))
    assert result.offset_s == -18.0
    assert "18 s taken off the images' times" in result.notes[0]


def test_a_camera_that_shows_a_zones_time():
    """10:20:10 at UTC+02:00 is 08:20:10 UTC, 08:20:28 GPST."""
    offset = align(track(), images([37210.0], system="UTC+02:00")).offset_s
    assert offset == -2 * 3600 + 18


def test_the_day_may_differ():
    flown = track(first=86390.0, day="2024-06-24")
    assert align(flown, images([5.0, 6.0], day="2024-06-25")).offset_s == 86400.0


@pytest.mark.parametrize(("above", "told"), [(11.6, True), (-47.0, True), (0.3, False)])
def test_heights_of_the_images_above_another_surface_are_told(above, told):
    """A track above the geoid, marks above the ellipsoid; 0.3 m are those of an antenna."""
    at = 30010.0 + 5 * np.arange(8)
    exposures = images(at, x=10 * (at - 30000.0) / EAST, y=0.0, z=above, sx=0.01, sy=0.01, sz=0.02)
    flown = track()
    flown.table[["sx", "sy", "sz"]] = 0.01, 0.01, 0.02
    notes = align(flown, replace(exposures, crs="EPSG:4979")).notes
    word = f"are {abs(above):.1f} m {'above' if above > 0 else 'below'} those of flight.pos"
    assert [word in note for note in notes] == [True] * told


@pytest.mark.parametrize("which", ["track", "images"])
def test_an_unknown_system_is_refused_unless_it_is_stated(which):
    flown = track(system=None if which == "track" else "GPST")
    times = images([30010.0], system=None if which == "images" else "GPST")
    assert "does not say in which time system" in fault(align, flown, times)
    stated = {"track_system" if which == "track" else "exposures_system": "GPST"}
    assert align(flown, times, **stated).offset_s == 0.0


def test_seconds_without_a_date_count_from_the_day_or_the_week():
    """24 June 2024 is a Monday: its midnight is second 86400 of the GPS week."""
    flown = track()
    assert align(flown, images([30010.0], day=None)).offset_s == 0.0
    assert align(flown, images([116410.0], day=None)).offset_s == -86400.0
    since_1980 = 86400.0 * 16241  # days from 6 January 1980 to 24 June 2024
    assert align(flown, images([since_1980 + 30010.0], day=None)).offset_s == -since_1980
    week = track(first=116400.0, day=None)
    assert align(week, images([30010.0])).offset_s == 86400.0


def test_milliseconds_without_a_date_are_named():
    with pytest.raises(InputError, match="has its times in milliseconds; write seconds"):
        align(track(), images([30_010_000.0, 30_012_000.0], day=None))


WRONG = {
    "18 s": (images([30105.0, 30110.0]), "18 s earlier they would: UTC is taken for GPS time"),
    "a zone": (images([30000.0 + 7 * 3600 + 10]), "7 h earlier they would: one of the clocks"),
    "a day": (images([30010.0], day="2024-06-22"), "2 days later they would: it is another day"),
    "another flight": (images([40000.0], day="2023-01-01"), "name the track of this flight"),
}


@pytest.mark.parametrize("case", WRONG)
def test_no_overlap_is_refused_and_the_usual_cause_is_named(case):
    times, cause = WRONG[case]
    sentence = fault(align, track(), times)
    assert "do not overlap in time" in sentence and cause in sentence


def block(first, times, **more):
    flown = track(first=first, system=None, day=None, crs=None)
    return flown, images(times, system=None, day=None, **more)


def test_tables_of_a_block_share_one_clock():
    assert align(*block(100.0, [110.0, 150.0])).offset_s == 0.0


@pytest.mark.parametrize("times", [[0.5, 50.0, 90.0], [150.0, 250.0, 350.0, 450.0]])
def test_tables_without_a_common_clock_are_refused_and_not_stretched(times):
    """The second begins within the track and would fit if it were squeezed to a third."""
    sentence = fault(align, *block(100.0, times))
    assert "have no common clock" in sentence


def test_a_flight_that_the_track_lacks_altogether_is_only_noted():
    result = align(*block(100.0, [110.0, 120.0, 900.0, 910.0, 920.0], flight=list("AABBB")))
    assert result.offset_s == 0.0 and "3 of 5 images lie outside" in result.notes[0]


def test_images_outside_are_noted_with_the_18_s_that_would_bring_them_in():
    result = align(track(), images([30050.0, 30110.0]))
    assert "1 of 2 images lie outside flight.pos, by up to 10 s" in result.notes[0]
    assert "18 s earlier all would lie inside" in result.notes[0]


@pytest.mark.parametrize("shift", [18.0, -18.0])
def test_positions_give_a_wrongly_stated_time_system_away(shift):
    """180 m at 10 m/s; the on-board positions are 2 m off."""
    taken = 30030.0 + 4 * np.arange(10)
    wrong = images(taken + shift, x=10 * (taken - 30000) / EAST, y=2 / EAST, z=0.0)
    sentence = fault(align, track(), replace(wrong, crs="EPSG:4979"))
    assert "180 m from flight.pos, but 2.0 m if the images were taken 18 s" in sentence
    assert "one of the two states UTC and means GPS time" in sentence
    right = images(taken, x=10 * (taken - 30000) / EAST, y=2 / EAST, z=0.0)
    assert align(track(), replace(right, crs="EPSG:4979")).offset_s == 0.0


def test_positions_that_are_metres_off_everywhere_accuse_no_clock():
    taken = 30030.0 + 4 * np.arange(10)
    rough = images(taken, x=(10 * (taken - 30000) + 8) / EAST, y=-9 / EAST, z=30.0)
    assert align(track(), replace(rough, crs="EPSG:4979")).notes == ()


def test_a_file_without_times_is_refused():
    with pytest.raises(InputError, match=r"images.txt states no times"):
        align(track(), images([np.nan, np.nan]))
