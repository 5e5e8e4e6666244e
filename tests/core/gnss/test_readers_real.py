"""Real files: RTKLIB's own output in six forms, GrafNav and DJI of one published flight."""

import json

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import (
    Local,
    align,
    geographic_positions,
    read_exposures,
    read_track,
    to_local,
)


@pytest.fixture(scope="module")
def flight(real_data):
    return real_data / "m300_ppk"


@pytest.fixture(scope="module")
def grafnav(flight):
    return read_track(flight / "grafnav_5hz.txt.gz")


@pytest.fixture(scope="module")
def marks(flight):
    return read_exposures(flight / "timestamp.MRK")


@pytest.fixture(scope="module")
def rtklib(real_data):
    return real_data / "interchange" / "rtklib_pos"


@pytest.fixture(scope="module")
def expected(rtklib):
    return json.loads((rtklib / "expected.json").read_text())


def test_the_published_586_positions_are_reproduced_to_the_printed_digits(flight, grafnav, marks):
    """Linear interpolation plus offset, V down; 9 decimals of a degree, 3 of a metre."""
    published = pd.read_csv(flight / "published_camera_positions.csv", dtype="str")
    result = align(grafnav, marks)
    assert result.offset_s == 0.0
    time = marks.table["time_s"].to_numpy()
    at = grafnav.table["time_s"].to_numpy()
    antenna = np.column_stack([np.interp(time, at, grafnav.table[axis]) for axis in "xyz"])
    offset = marks.table[["offset_e", "offset_n", "offset_u"]].to_numpy()
    camera = np.array(
        [
            Local(lat, lon, height).to_geographic(step)[0]
            for (lon, lat, height), step in zip(antenna, offset, strict=True)
        ]
    )
    ours = [(f"{lon:.9f}", f"{lat:.9f}", f"{height:.3f}") for lon, lat, height in camera]
    theirs = list(published[["Lng_EOP", "Lat_EOP", "h_EOP"]].itertuples(index=False, name=None))
    assert len(theirs) == 586
    assert ours == theirs


def test_v_up_would_miss_the_published_heights_by_half_a_metre(flight, grafnav, marks):
    published = pd.read_csv(flight / "published_camera_positions.csv")["h_EOP"].to_numpy()
    height = np.interp(marks.table["time_s"], grafnav.table["time_s"], grafnav.table["z"])
    assert np.abs(height - marks.table["offset_u"] - published).max() > 0.5


def test_the_track_in_the_block_format_is_the_grafnav_track(flight, grafnav):
    """0.05 mm: track.csv has four decimals; its frame is about 14.5174 N, 101.0187 E, height 0."""
    block = read_track(flight / "track.csv")
    local = to_local(grafnav, Local(14.5174, 101.0187, 0.0))
    assert np.abs(block.positions() - local.positions()).max() < 6e-5
    assert np.array_equal(block.table["time_s"], grafnav.table["time_s"])
    assert np.array_equal(block.table["quality"], grafnav.table["grafnav_quality"])


def test_marks_and_block_track_need_their_common_clock_stated(flight, marks):
    block = read_track(flight / "track.csv")
    with pytest.raises(InputError, match=r"track.csv does not say in which time system"):
        align(block, marks)
    assert align(block, marks, track_system="GPST").offset_s == 0.0


def test_utc_taken_for_gps_time_shows_in_the_positions_of_the_real_marks(grafnav, marks):
    """The on-board positions are metres off, 18 s of flight some 200 m."""
    with pytest.raises(InputError, match=r"one of the two states UTC and means GPS time"):
        align(grafnav, marks, exposures_system="UTC")


def test_six_forms_of_one_solution_agree_to_the_printed_digits(rtklib, expected):
    made = expected["made"]
    place = Local(*made["ref_pos_llh"])
    tracks = [read_track(rtklib / "made" / name) for name in made["same_solution"]]
    first = to_local(tracks[0], place).positions()
    for track in tracks:
        assert len(track.table) == made["epochs"]
        assert np.abs(to_local(track, place).positions() - first).max() < 1.1e-4
        shift = {"GPST": 0.0, "UTC": 18.0}[track.time_system]
        assert track.day == "2024-06-24" and track.start + shift == 30000.0


def test_epochs_as_expected(rtklib, expected):
    track = read_track(rtklib / "made" / "llh_deg_gpst_hms.pos")
    for sample in expected["made"]["epochs_sample"]:
        row = track.table[track.table["time_s"] == sample["gps_seconds"] - 86400].iloc[0]
        assert [row["y"], row["x"], row["z"]] == sample["llh"]
        assert [row["sy"], row["sx"], row["sz"]] == sample["sd_north_east_up"]
    moving = read_track(rtklib / "made" / "llh_velocity_utc.pos").table.iloc[0]
    stated = expected["made"]["velocity_file"]["first"]
    assert [moving["vy"], moving["vx"], moving["vz"]] == stated["vn_ve_vu"]
    assert [moving["svy"], moving["svx"], moving["svz"]] == stated["sd_vn_ve_vu"]


def test_geocentric_standard_deviations_turn_into_those_of_the_geographic_form(rtklib):
    """Printed with 0.1 mm, signed roots too: 0.3 mm."""
    names = ["sx", "sy", "sz"]
    turned = to_local(read_track(rtklib / "made" / "ecef_xyz_gpst.pos")).table[names]
    direct = read_track(rtklib / "made" / "llh_deg_gpst_hms.pos").table[names]
    assert np.abs(turned.to_numpy() - direct.to_numpy()).max() < 3e-4


def test_other_programs_files(rtklib, expected):
    driven = read_track(rtklib / "matrtklib" / "rover_1Hz_rtk.pos").table
    assert len(driven) == 200 and driven["quality"].value_counts().to_dict() == {1: 53, 2: 147}
    flown = read_track(rtklib / "ugcs" / "ValidEmlidGpst.pos")
    lat, lon, height = expected["ugcs/ValidEmlidGpst.pos"]["first"]["llh"]
    assert geographic_positions(flown)[0].tolist() == [lon, lat, height]
    with pytest.raises(InputError, match=r"Invalid.pos, row 13: longitude = 'error'"):
        read_track(rtklib / "ugcs" / "Invalid.pos")


def test_broken_files(real_data):
    broken = real_data / "interchange" / "broken"
    with pytest.raises(InputError, match=r"rtklib_no_header.pos, row 1: the header is missing"):
        read_track(broken / "rtklib_no_header.pos")
    with pytest.raises(InputError, match=r"row 11: .* decimal comma"):
        read_track(broken / "rtklib_mixed_decimal_comma.pos")
    track = read_track(broken / "rtklib_utf16_real.pos")
    assert len(track.table) == 60
    assert track.table[["y", "x", "z"]].iloc[0].tolist() == [27.682020092, 85.319235124, 1271.37]


@pytest.mark.parametrize("name", ["m300_real_cut.MRK", "made_p4rtk.MRK", "made_m3e_south_west.MRK"])
def test_time_marks_as_expected(real_data, name):
    folder = real_data / "interchange" / "dji_mrk"
    stated = json.loads((folder / "expected.json").read_text())[name]
    marks = read_exposures(folder / name)
    first, row = stated["first"], marks.table.iloc[0]
    assert len(marks.table) == stated["lines"]
    assert row["time_s"] == pytest.approx(first["gps_seconds"] % 86400, abs=1e-9)
    assert [row["y"], row["x"], row["z"]] == [first["lat"], first["lon"], first["height"]]
    assert [row["sy"], row["sx"], row["sz"]] == first["sd_north_east_up"]
    place = Local(row["y"], row["x"], row["z"])
    lon, lat, height = place.to_geographic([[row["offset_e"], row["offset_n"], row["offset_u"]]])[0]
    assert [lat, lon] == pytest.approx(first["camera_if_position_is_antenna"][:2], abs=6e-10)
    assert height == pytest.approx(first["camera_if_position_is_antenna"][2], abs=1e-6)


def test_times_of_real_marks_rise_across_the_end_of_the_week(real_data):
    folder = real_data / "interchange" / "dji_mrk"
    stated = json.loads((folder / "expected.json").read_text())["made_week_rollover.MRK"]["all"]
    time = read_exposures(folder / "made_week_rollover.MRK").table["time_s"].to_numpy()
    weeks = np.array([604800 * mark["gps_week"] + mark["gps_seconds"] for mark in stated])
    assert time - time[0] == pytest.approx(weeks - weeks[0], abs=1e-6)
