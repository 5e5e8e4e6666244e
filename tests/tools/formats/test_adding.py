"""What photographs, a track and a file of ground points add to a project."""

import base64
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import corridor
from corridor.core.errors import InputError
from corridor.core.gnss import Exposures, Local
from corridor.core.photographs import photographs_in, read_metadata
from corridor.interface import cli
from corridor.tools.formats import (
    Additions,
    add_ground,
    complete,
    export_project,
    read_photograph,
    read_project,
)
from corridor.tools.formats.ground import crs_of_line, in_frame, read_gcp_list
from corridor.tools.formats.placing import (
    Track,
    _with_positions,
    add_photographs,
    add_track,
    gyro_rates,
)

from .conftest import exact_block

PLACE = Local(47.5, 8.7, 0.0)
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


@pytest.mark.parametrize(
    "name", ["m3e_rtk_fix.jpg", "p4rtk_float_misspelt.jpg", "phantom_no_rtk.jpg", "no_xmp.jpg"]
)
def test_headers_say_what_expected_json_says(name, real_data):
    home = real_data / "interchange" / "dji_xmp"
    known = json.loads((home / "expected.json").read_text())[name]
    photo = read_photograph(home / name)
    xmp, exif = known.get("xmp", {}), known.get("exif", {})
    lat = xmp.get("GpsLatitude", exif.get("lat"))
    lon = xmp.get("GpsLongitude", xmp.get("GpsLongtitude", exif.get("lon")))
    assert photo.lat_deg == pytest.approx(lat, abs=1e-9 if "GpsLatitude" in xmp else 1e-6)
    assert photo.lon_deg == pytest.approx(lon, abs=1e-9 if "GpsLatitude" in xmp else 1e-6)
    assert photo.height == pytest.approx(xmp.get("AbsoluteAltitude", exif.get("altitude")))
    assert photo.flag == (int(xmp["RtkFlag"]) if "RtkFlag" in xmp else None)
    if "RtkStdLon" in xmp:
        assert photo.sigma == (xmp["RtkStdLon"], xmp["RtkStdLat"], xmp["RtkStdHgt"])
    else:
        assert photo.sigma is None  # unknown, not zero
    assert photo.pitch == xmp.get("GimbalPitchDegree")
    assert photo.orientation == exif.get("orientation", 1)


def photograph(path, k, centre, size=(4000, 3000), decimals=True, xmp=""):
    """A small file that claims nothing it cannot: a black picture with a header."""
    lon, lat, height = PLACE.to_geographic(np.array(centre)[None])[0]
    exif = Image.Exif()
    exif[271], exif[272] = "Autel Robotics", "XT701"
    inner = exif.get_ifd(0x8769)
    inner[36867], inner[36881] = f"2024:06:24 10:20:{2 * k:02d}", "+00:00"
    if decimals:
        inner[37521] = "250"
    gps = exif.get_ifd(0x8825)
    for n, value, letter in ((1, lat, "N"), (3, lon, "E")):
        minutes = 60 * (value % 1)
        gps[n] = letter
        gps[n + 1] = (float(int(value)), float(int(minutes)), round(60 * (minutes % 1), 6))
    gps[5], gps[6] = b"\0", float(height)
    kind = {"exif": exif}
    if xmp:
        packet = (
            '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/'
            f'22-rdf-syntax-ns#"><rdf:Description xmlns:a="http://made/1.0/" {xmp}/></rdf:RDF>'
            "</x:xmpmeta>"
        )
        kind["xmp"] = packet.encode()
    Image.new("L", size).save(path, quality=30, **kind)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A free COLMAP model, its photographs, the block they are of."""
    home = tmp_path_factory.mktemp("flown")
    block = exact_block(k1=-0.05, k2=0.02)
    (home / "photos").mkdir()
    for k, (name, place) in enumerate(
        zip(block.images["image"], block.images[POSE[:3]].to_numpy(float), strict=True)
    ):
        photograph(home / "photos" / name, k, place, xmp=f'a:LensTemperature="{20 + k}.5"')
    free = block.copy()
    # Turned, shrunk and moved, as a reconstruction comes: R R0', s R0 C + t.
    from corridor.core.geometry import (
        quaternion_from_rotation,
        rotation_from_quaternion,
        rotation_from_vector,
    )

    turn = rotation_from_vector(np.array([[0.3, -1.2, 0.7]]))[0]
    pose = free.images[POSE].to_numpy(float)
    rotation = rotation_from_quaternion(pose[:, 3:]) @ turn.T
    free.images[POSE[:3]] = 0.07 * pose[:, :3] @ turn.T + [1, 2, 3]
    free.images[POSE[3:]] = quaternion_from_rotation(rotation)
    for table in (free.points, free.ground):
        table[["x", "y", "z"]] = 0.07 * table[["x", "y", "z"]].to_numpy() @ turn.T + [1, 2, 3]
    free.ground = free.ground[:0]
    export_project(free, "colmap", home / "model")
    (home / "model" / "ground_points.csv").unlink()
    return home, block


def test_a_free_model_that_photographs_place_goes_into_the_system_of_crs(flown):
    home, block = flown
    added = Additions(photos=home / "photos", crs="EPSG:25832")
    made = complete(read_project(home / "model"), added).block
    known = PLACE.to_crs(block.poses[:, :3], "EPSG:25832")
    assert made.crs == "EPSG:25832"
    assert np.abs(made.poses[:, :3] + made.offset - known).max() < 0.02


def test_photographs_place_a_free_model_and_tell_times_and_temperatures(flown):
    home, block = flown
    project, *_ = add_photographs(read_project(home / "model"), home / "photos")
    made = project.block
    local = made.extra["local_frame"]
    place = Local(local["lat_deg"], local["lon_deg"], local["height"])
    back = PLACE.from_geographic(place.to_geographic(made.images[POSE[:3]].to_numpy(float)))
    # EXIF holds a tenth of a millimetre here.
    assert np.abs(back - block.images[POSE[:3]].to_numpy(float)).max() < 0.01
    assert project.placed and len(made.gnss) == 12
    assert made.column("images", "time_s")[:3] == pytest.approx([37200.25, 37202.25, 37204.25])
    # The day of the flight: `corridor change` tells by it which of two dates came first.
    assert made.extra["date"] == "2024-06-24"
    assert made.column("images", "temperature_c")[1] == 21.5
    # No RTK flag: a code receiver, not two centimetres.
    assert (made.gnss["sx"] == 3.0).all()
    # Published for all rows: 25 ms of 3000 rows is 24.99 ms from first to last.
    assert made.cameras["1"].readout_s == pytest.approx(0.025 * 2999 / 3000)


@pytest.mark.parametrize("lost", ["N", "E"])
def test_positions_that_are_mirrored_are_told(flown, lost):
    """The sign of a half of the Earth lost: a flat flight fits upside down."""
    home, _ = flown
    positions = {k: read_metadata(path) for k, path in enumerate(photographs_in(home / "photos"))}
    change = {"N": "lat_deg", "E": "lon_deg"}[lost]
    mirrored = {
        k: replace(photo, **{change: -getattr(photo, change)}) for k, photo in positions.items()
    }
    for photos, said in ((positions, 0), (mirrored, 1)):
        made = _with_positions(read_project(home / "model"), photos, None)
        assert sum("the positions are mirrored" in told for told in made.warnings) == said


def test_marks_without_a_place_have_a_time_only(flown):
    home, _ = flown
    project = read_project(home / "model")
    photos = {k: read_metadata(path) for k, path in enumerate(photographs_in(home / "photos"))}
    table = pd.DataFrame({"image": project.block.images["image"], "time_s": 1.0})
    table[["x", "y", "z"]] = [[photos[k].lon_deg, photos[k].lat_deg, photos[k].height]
                              for k in range(len(table))]  # fmt: skip
    table.loc[5, ["x", "y", "z"]] = np.nan
    exposures = Exposures(table, "2024-06-24", "GPST", "EPSG:4979", home / "a.MRK")
    assert len(_with_positions(project, photos, exposures).block.gnss) == len(table) - 1


def test_what_is_added_makes_a_new_project_and_leaves_the_old_as_it_was(flown, tmp_path):
    home, block = flown
    project = read_project(home / "model")
    images, notes = project.block.images.copy(), list(project.notes)
    block.ground.to_csv(tmp_path / "ground.csv", index=False)
    made, *_ = add_photographs(project, home / "photos")
    made = add_ground(made, tmp_path / "ground.csv")
    assert len(made.block.gnss) == 12 and len(made.block.ground) == 4
    assert project.block.images.equals(images) and project.notes == notes
    assert not project.placed and not len(project.block.gnss) and not len(project.block.ground)


def test_the_command_makes_a_block_that_adjusts(flown, tmp_path):
    home, _ = flown
    arguments = ["import", "auto", str(home / "model"), "--photos", str(home / "photos")]
    assert cli.main([*arguments, "-o", str(tmp_path / "block")]) == 0
    assert corridor.adjust(corridor.read(tmp_path / "block"), camera="fixed").converged


def rover(folder, time, places, system="UTC"):
    """RTKLIB's rover.pos of places (n, 3) at seconds of the day (n,)."""
    names = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m)"
    rows = [f"%  {system} {names} sdun(m) age(s) ratio"]
    for t, (lon, lat, up) in zip(time, PLACE.to_geographic(places), strict=True):
        hour, rest = divmod(t, 3600)
        minute, second = divmod(rest, 60)
        rows.append(
            f"2024/06/24 {int(hour):02d}:{int(minute):02d}:{second:06.3f} {lat:.9f} {lon:.9f} "
            f"{up:.4f} 1   9   0.0100   0.0100   0.0200   0.0   0.0   0.0   0.0   9.9"
        )
    (folder / "rover.pos").write_text("\n".join(rows) + "\n")


@pytest.mark.parametrize("late", [0.0, 0.8])
def test_positions_of_photographs_are_witnesses_of_the_clock_of_a_track(flown, tmp_path, late):
    """UTC that is called GPS time, and a clock that is late: the antenna would be metres off."""
    home, block = flown
    project, _, exposures = add_photographs(read_project(home / "model"), home / "photos")
    taken = 37200.25 + 2.0 * np.arange(len(block.images))
    time = np.arange(37160.0, 37260.0, 0.2)
    centres = block.images[POSE[:3]].to_numpy(float)
    places = np.column_stack([np.interp(time, taken - late, axis) for axis in centres.T])
    rover(tmp_path, time, places)
    made = add_track(project, exposures, Track(tmp_path / "rover.pos"))
    told = [note for note in made.notes if "s earlier than the images' times" in note]
    assert len(told) == (late > 0)
    rover(tmp_path, time, places, system="GPST")
    if not late:
        with pytest.raises(InputError, match="one of the two states UTC and means GPS time"):
            add_track(project, exposures, Track(tmp_path / "rover.pos"))


def test_a_track_gives_antenna_positions_and_velocities(flown, tmp_path):
    home, block = flown
    project, _, exposures = add_photographs(read_project(home / "model"), home / "photos")
    taken = 37200.25 + 2.0 * np.arange(len(block.images))
    time = np.arange(37195.0, 37230.0, 0.2)
    centres = block.images[POSE[:3]].to_numpy(float)
    rover(tmp_path, time, np.column_stack([np.interp(time, taken, axis) for axis in centres.T]))
    made = add_track(project, exposures, Track(tmp_path / "rover.pos")).block
    assert len(made.gnss) == 12
    along = made.images["vx"].to_numpy(float).reshape(3, 4)[:, 1:3]
    assert np.abs(along - 11.0).max() < 0.05
    assert made.gnss["sx"].max() < 0.05


def test_a_project_without_times_says_what_a_track_needs(flown, tmp_path):
    home, _ = flown
    with pytest.raises(InputError, match="--photos FOLDER"):
        add_track(read_project(home / "model"), None, Track(tmp_path / "rover.pos"))


def test_photographs_of_another_flight_are_refused(flown, tmp_path):
    home, _ = flown
    photograph(tmp_path / "OTHER_1.JPG", 0, [0, 0, 50], size=(40, 30))
    with pytest.raises(InputError, match="none of the 1 photographs"):
        add_photographs(read_project(home / "model"), tmp_path)


def test_parrots_gyroscope_is_turned_into_the_camera_frame(tmp_path):
    """Samples of 24 bytes; wx = y, wy = -x, wz = z; the first row IMUTimeOffset after the first."""
    samples = np.zeros(3, [("us", "<u8"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("f", "<i4")])
    samples["us"] = 5_000_000 + 1000 * np.arange(3)
    samples["x"], samples["y"], samples["z"] = 0.1, 0.2, -0.3
    text = base64.b64encode(samples.tobytes()).decode()
    xmp = f'a:IMUAngularVelocity="{text}" a:LineReadoutTime="47500" a:IMUTimeOffset="10000000"'
    photograph(tmp_path / "S.JPG", 0, [0, 0, 50], size=(40, 31), xmp=xmp)
    rates = gyro_rates(read_photograph(tmp_path / "S.JPG"), time_s=100.0)
    assert rates[["wx", "wy", "wz"]].to_numpy()[0] == pytest.approx([0.2, -0.1, -0.3])
    # Middle row: 10 ms and fifteen rows of 47.5 us after the first sample.
    assert rates["time_s"].iloc[0] == pytest.approx(100.0 - 0.010 - 15 * 47.5e-6, abs=1e-9)
    assert np.diff(rates["time_s"]) == pytest.approx([0.001, 0.001])


# --- ground points ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["gcp_utm_north_valid.txt", "gcp_extras.txt", "gcp_latlon_valid.txt",
             "gcp_latlon_south.txt", "gcp_michigan_feet_valid.txt", "bellus_gcp_list.txt"],
)  # fmt: skip
def test_lists_of_ground_points_count_as_expected(name, real_data):
    home = real_data / "interchange" / "odm_gcp_lists"
    known = json.loads((home / "expected.json").read_text())[name]
    ground = read_gcp_list(home / name)
    assert len(ground.marks) == known["observations"]
    if "points" in known:
        assert len(ground.table) == known["points"]
    if "name" in known:
        assert list(ground.table["point"]) == [known["name"]]
    if known["crs"].startswith("EPSG:") and "feet" not in known["crs"]:
        assert ground.crs == known["crs"]
    if "first" in known:
        first = known["first"]
        assert ground.table.loc[0, list("xyz")].tolist() == [first[axis] for axis in "xyz"]
        assert ground.marks[0][1:] == (first["image"], *first["pixel_as_written"])


def test_feet_become_metres_in_plan_and_height(real_data):
    """EPSG:2251 is in international feet; 563.2 ft are 171.66 m."""
    from corridor.core.block import Block
    from corridor.core.gnss import convert

    home = real_data / "interchange" / "odm_gcp_lists"
    ground = read_gcp_list(home / "gcp_michigan_feet_valid.txt")
    places = ground.table[["x", "y", "z"]].to_numpy()
    block = Block("x", {}, pd.DataFrame({"image": ["a"], "camera": ["b"]}))
    lon, lat, _ = convert(places, "EPSG:2251", "EPSG:4979")[0]
    block.extra["local_frame"] = {"lat_deg": lat, "lon_deg": lon, "height": 0.0}
    place = in_frame(block, places, ground.crs, "points")[0]
    assert np.abs(place[:2]).max() < 0.01
    assert place[2] == pytest.approx(563.1987598425 * 0.3048, abs=0.01)


def test_a_utm_line_names_its_zone():
    assert crs_of_line("WGS84 UTM 16N") == "EPSG:32616"
    assert crs_of_line("WGS84 UTM 33S") == "EPSG:32733"
    assert crs_of_line("609925.8 4950688.7 171.6 1331 350 DJI_0002.JPG") is None


def test_ground_points_and_marks_of_a_table_come_into_the_block(fraser8, tmp_path):
    block = fraser8.copy()
    bare = block.copy()
    bare.marks, bare.ground = bare.marks[:0], bare.ground[:0]
    export_project(bare, "colmap", tmp_path / "model")
    block.ground.to_csv(tmp_path / "ground.csv", index=False)
    block.marks.to_csv(tmp_path / "marks.csv", index=False)
    arguments = ["import", "auto", str(tmp_path / "model"), "-o", str(tmp_path / "block")]
    assert cli.main([*arguments, "--ground", str(tmp_path / "ground.csv")]) == 0
    made = corridor.read(tmp_path / "block")
    assert len(made.marks) == len(block.marks) and len(made.ground) == 4
    assert (made.ground["role"] == "control").all()


def test_a_project_without_observations_is_written_and_said_not_to_be_proved(
    real_data, tmp_path, capsys
):
    """odm_albay: 35 poses, no tie points in OpenDroneMap's public results."""
    home = real_data / "interchange" / "odm_albay"
    assert cli.main(["import", "auto", str(home), "-o", str(tmp_path / "block")]) == 0
    said = capsys.readouterr().out
    assert "are not proved" in said and "add them with --ground FILE" in said
    assert len((tmp_path / "block" / "images.csv").read_text().splitlines()) == 36
    with pytest.raises(InputError, match="neither holds an observation"):
        corridor.read(tmp_path / "block")


def test_a_project_that_does_not_reproject_needs_force(real_data, tmp_path):
    """dubrovnik-3-7-pre is before its adjustment: 11 px median."""
    file = real_data / "interchange" / "bal_dubrovnik" / "dubrovnik-3-7-pre.txt"
    arguments = ["import", "bal", str(file), "-o", str(tmp_path / "block")]
    assert cli.main(arguments) == 2 and not (tmp_path / "block").exists()
    assert cli.main([*arguments, "--force"]) == 0
    assert len(corridor.read(tmp_path / "block").tie_points) == 19


def test_photographs_alone_need_the_extra_and_say_so(flown, tmp_path, monkeypatch, capsys):
    import sys

    monkeypatch.setitem(sys.modules, "pycolmap", None)
    home, _ = flown
    arguments = ["import", "photos", str(home / "photos"), "-o", str(tmp_path / "block")]
    assert cli.main(arguments) == 2
    assert "pip install 'corridor[images]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_damaged_file_of_ground_points_ends_in_a_sentence(flown, tmp_path, capsys):
    home, _ = flown
    for name, text in (
        ("a.csv", "point,x,y,z\nA,1,2\n"),
        ("b.csv", "point,x,y,z\nA,1,2,x\n"),
        ("c.xml", "<document><chunk></document>"),
        ("d.txt", "WGS84 UTM 99N\n1 2 3 4 5 a.jpg\n"),
        ("e.txt", "A 1 2\n"),
        ("f.json", "[1, 2"),
    ):
        (tmp_path / name).write_text(text)
        arguments = ["import", "auto", str(home / "model"), "-o", str(tmp_path / "block")]
        assert cli.main([*arguments, "--ground", str(tmp_path / name)]) == 2
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert said.startswith("error: ") and (name in said or "not a place on Earth" in said)


def test_djis_time_marks_in_the_folder_are_taken_for_times_and_positions(real_data, tmp_path):
    """made_p4rtk.MRK: 24 exposures of week 2083; the project used twelve of the photographs."""
    import shutil

    home = real_data / "interchange" / "dji_mrk"
    known = json.loads((home / "expected.json").read_text())["made_p4rtk.MRK"]["first"]
    shutil.copy(home / "made_p4rtk.MRK", tmp_path / "flight_Timestamp.MRK")
    for k in range(24):
        photograph(tmp_path / f"DJI_{k + 1:04d}.JPG", k, [10.0 * k, 0, 60], size=(40, 30))
    block = exact_block(names="DJI_{:04d}.JPG")
    block.images["image"] = [f"DJI_{k + 1:04d}.JPG" for k in range(12)]
    renamed = dict(zip(exact_block(names="DJI_{:04d}.JPG").images["image"],
                       block.images["image"], strict=True))  # fmt: skip
    for table in (block.tie_points, block.marks):
        table["image"] = table["image"].cat.rename_categories(renamed)
    block.__post_init__()
    export_project(block, "opensfm", tmp_path / "model")
    project, _, exposures = add_photographs(read_project(tmp_path / "model"), tmp_path)
    assert exposures.time_system == "GPST" and len(exposures.table) == 12
    # Second 190613.469 of the week is Tuesday, 4:56:53.
    assert project.block.column("images", "time_s")[0] == pytest.approx(
        known["gps_seconds"] - 2 * 86400, abs=1e-6
    )
    sigma = project.block.gnss[["sx", "sy", "sz"]].to_numpy()[0]
    north, east, up = known["sd_north_east_up"]
    assert sigma == pytest.approx([east, north, up])


@pytest.mark.parametrize("form", ["colmap", "opensfm", "micmac", "bundler"])
def test_an_export_says_that_distances_stay_behind(form, tmp_path):
    block = exact_block()
    names = block.ground["point"]
    table = {"from": names[:1], "to": names[1:2].to_numpy(), "distance": 10.0}
    block = block.with_(distances=pd.DataFrame(table))
    made = export_project(block, form, tmp_path / form, lossy=True)
    assert any("1 row of distances.csv" in told for told in made.sentences)
