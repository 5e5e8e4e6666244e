"""POSPac's SBET and text: positions and attitudes, in the frame of a block."""

import struct

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import Exposures, antenna, read_track

LAT, LON, HEIGHT = 48.0, 10.5, 600.0
RAD = np.pi / 180
# A camera that looks down from an aircraft that flies north: x east, y south, z down.
NORTH = np.diag([1.0, -1.0, -1.0])
HEADER = """
POSPac MMS Version: 8.3
 POS Export Utility Version 8.3
 Mission Start Time:
   Date of Mission: 2018-08-07
   Start Time: 06:38:26
 TIME, DISTANCE, EASTING, NORTHING, ELLIPSOID HEIGHT, LATITUDE, LONGITUDE, ELLIPSOID HEIGHT, \
ROLL, PITCH, HEADING, EAST VELOCITY, NORTH VELOCITY, UP VELOCITY, EAST SD, NORTH SD, HEIGHT SD, \
ROLL SD, PITCH SD, HEADING SD

  (time in Sec, distance in Meters, position in Meters, lat, long in Degrees, orientation angles \
and SD in Degrees, velocity in Meter/Sec, position SD in Meters)
"""


def sbet(path, roll=0.0, pitch=0.0, heading=0.0, wander=0.0, rate=0.0, step=0.005, start=196706.0):
    """Two seconds of 5 m/s north; angles in degrees; rate: of the roll, degrees a second."""
    with path.open("wb") as file:
        for k in range(int(2 / step)):
            t = step * k
            file.write(struct.pack(
                "<17d", start + t, (LAT + 4.5e-5 * t) * RAD, LON * RAD, HEIGHT, 0, 5, 0,
                (roll + rate * t) * RAD, pitch * RAD, (heading + wander) * RAD, wander * RAD,
                *[0.0] * 6,
            ))  # fmt: skip
    return path


def text(path, step=0.005):
    rows = [
        f"{196706 + step * k:.4f} {5 * step * k:.3f} 611875.0 {5317510 + 5 * step * k:.3f} 600.0 "
        f"{LAT + 4.5e-5 * step * k:.10f} {LON:.10f} {HEIGHT:.3f} 1.0 2.0 90.0 0.0 5.0 0.0 0.01 "
        "0.01 0.02 0.02 0.03 0.08\n"
        for k in range(int(2 / step))
    ]
    path.write_text(HEADER + "".join(rows))
    return path


def at(track, time, **options):
    """The attitudes of one exposure and its rotation, at seconds after the first epoch."""
    table = pd.DataFrame({"image": ["a"], "time_s": [track.start + time]})
    moments = Exposures(table, track.day, "GPST", None, track.source)
    found = antenna(track, moments, method="linear", max_sigma=9.0, **options)
    rotation = rotation_from_quaternion(found.attitudes[["qw", "qx", "qy", "qz"]].to_numpy(float))
    return found, rotation


def about(axis, degrees):
    """Right-handed turn by code of its own."""
    c, s = np.cos(degrees * RAD), np.sin(degrees * RAD)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.eye(3)
    out[[i, j, i, j], [i, j, j, i]] = c, c, -s, s
    return out


def test_heading_is_that_of_the_platform_less_the_wander_angle(tmp_path):
    """To the east: the right of the picture south, its bottom west."""
    track = read_track(sbet(tmp_path / "sbet_mission.out", heading=90.0, wander=10.0))
    _, (rotation,) = at(track, 1.0)
    assert rotation == pytest.approx(np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1.0]]), abs=1e-5)


@pytest.mark.parametrize("angles, turn", [
    ({"roll": 3.0}, about(1, 3.0)),  # right side down: about the way ahead, which is north
    ({"pitch": 3.0}, about(0, 3.0)),  # nose up: about east
    ({"heading": 3.0}, about(2, -3.0)),  # to the right: about down
])  # fmt: skip
def test_angles_turn_the_camera_as_an_aircraft(tmp_path, angles, turn):
    _, (rotation,) = at(read_track(sbet(tmp_path / "a.out", **angles)), 1.0)
    assert rotation == pytest.approx(NORTH @ turn.T, abs=1e-5)


def test_between_epochs_a_turn_is_even(tmp_path):
    _, (rotation,) = at(read_track(sbet(tmp_path / "a.sbet", rate=8.0)), 1.0025)
    assert rotation == pytest.approx(NORTH @ about(1, 8.0 * 1.0025).T, abs=1e-5)


def test_in_a_grid_north_is_that_of_the_grid(tmp_path):
    """1.5 degrees east of the meridian, at 48: 1.5 sin(48) = 1.1147 degrees (Snyder 1987)."""
    found, (rotation,) = at(read_track(sbet(tmp_path / "a.out")), 1.0, crs="EPSG:32632")
    assert found.gnss["y"][0] == pytest.approx(5317510, abs=200)
    assert np.degrees(np.arctan2(-rotation[1, 0], -rotation[1, 1])) == pytest.approx(
        -1.1147, abs=2e-3
    )


def test_text_has_its_day_and_its_sigmas(tmp_path):
    """7 August 2018 was a Tuesday: 196,706 s of the week are 23,906 s of the day, 06:38:26."""
    track = read_track(text(tmp_path / "export.txt"))
    assert (track.day, track.time_system, track.start) == ("2018-08-07", "GPST", 23906.0)
    assert track.table.loc[0, ["x", "y", "z"]].tolist() == [LON, LAT, HEIGHT]
    found, _ = at(track, 1.0)
    assert found.attitudes[["sroll", "spitch", "syaw"]].to_numpy().tolist() == [[0.02, 0.03, 0.08]]


def test_a_smoothed_track_is_not_as_good_as_it_is_smooth(tmp_path):
    """Its scatter says nothing of its errors: sigmas are those beside it, or assumed and told."""
    path = sbet(tmp_path / "sbet_mission.out")
    bare, _ = at(read_track(path), 1.0)
    assert bare.track.table[["sx", "sz"]].to_numpy()[0].tolist() == [0.02, 0.04]
    assert any("states no standard deviations" in note for note in bare.notes)
    (tmp_path / "smrmsg_mission.out").write_bytes(b"".join(
        struct.pack("<10d", 196706.0 + t, 0.03, 0.05, 0.07, 0, 0, 0, 1.5, 3.0, 6.0) for t in (0, 2)
    ))  # fmt: skip
    found, _ = at(read_track(path), 1.0)
    assert found.attitudes[["sroll", "spitch", "syaw"]].to_numpy()[0] == pytest.approx(
        [0.025, 0.05, 0.1]
    )
    assert found.track.table[["sx", "sy", "sz"]].to_numpy()[0] == pytest.approx([0.05, 0.03, 0.07])
    (tmp_path / "smrmsg_mission.out").write_bytes(b"12345678")
    with pytest.raises(InputError, match="smrmsg_mission.out is cut off"):
        read_track(path)


def test_epochs_too_far_apart_give_no_attitude_and_it_is_said(tmp_path):
    found, _ = at(read_track(text(tmp_path / "export.txt", step=0.2)), 0.5)
    assert not len(found.attitudes)
    assert any("attitudes too, of 0 of 1 images" in note for note in found.notes)


def test_they_are_written_beside_the_positions(tmp_path):
    found, _ = at(read_track(sbet(tmp_path / "a.out", heading=90.0)), 1.0)
    said = found.save(tmp_path / "gnss.csv", attitudes=tmp_path / "attitudes.csv")
    assert [path.name for path in said] == ["gnss.csv", "attitudes.csv"]
    back = pd.read_csv(tmp_path / "attitudes.csv")
    assert back.to_numpy()[0, 1:] == pytest.approx(found.attitudes.to_numpy()[0, 1:], abs=1e-9)
    (tmp_path / "images.csv").write_text("image,camera\n")
    with pytest.raises(InputError, match="images.csv is there and is no attitudes.csv"):
        found.save(tmp_path / "gnss.csv", attitudes=tmp_path / "images.csv")
    with pytest.raises(InputError, match="other.csv is not beside"):
        found.save(tmp_path / "gnss.csv", attitudes=tmp_path / "there" / "other.csv")


def test_what_is_no_whole_sbet_and_a_number_that_is_not_finite_are_refused(tmp_path):
    whole = sbet(tmp_path / "sbet.out").read_bytes()
    (tmp_path / "sbet.out").write_bytes(whole[:-8])
    with pytest.raises(InputError, match="neither whole records of an SBET"):
        read_track(tmp_path / "sbet.out")
    broken = whole[: 136 * 3] + struct.pack("<d", np.nan) + whole[136 * 3 + 8 :]
    (tmp_path / "sbet.out").write_bytes(broken)
    with pytest.raises(InputError, match="record 4: a number is not finite"):
        read_track(tmp_path / "sbet.out")
