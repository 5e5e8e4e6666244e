"""What photographs say of themselves."""

import csv
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import corridor
from corridor.core.errors import InputError
from corridor.core.photographs import (
    Metadata,
    exif,
    global_shutter,
    maker_note,
    of_picture,
    published_readouts,
    read_metadata,
)
from corridor.tools.formats import Project
from corridor.tools.formats.placing import (
    _with_readout,
    add_photographs,
    at_once,
    gyro_rates,
    readout_of,
)


def saved(path, tags=(), inner=(), xmp=""):
    """A small picture with these EXIF tags and attributes of an XMP packet."""
    exif = Image.Exif()
    exif.update(dict(tags))
    exif.get_ifd(0x8769).update(dict(inner))
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/'
        f'22-rdf-syntax-ns#"><rdf:Description xmlns:a="http://made/1.0/" {xmp}/></rdf:RDF>'
        "</x:xmpmeta>"
    )
    Image.new("L", (40, 30)).save(path, exif=exif, xmp=packet.encode())
    return path


def test_djis_speed_is_north_east_down_and_ours_east_north_up(tmp_path):
    xmp = 'a:FlightXSpeed="+6.70" a:FlightYSpeed="-0.30" a:FlightZSpeed="+0.20"'
    found = read_metadata(saved(tmp_path / "a.jpg", xmp=xmp))
    assert found.velocity == (-0.3, 6.7, -0.2)
    assert found.velocity_of.startswith("FlightXSpeed")


def test_text_ends_at_its_first_zero(tmp_path):
    """Some cameras leave in the tag what an earlier, longer text had."""
    found = read_metadata(saved(tmp_path / "a.jpg", tags={272: "FC6310\0\0old"}))
    assert found.model == "FC6310"


def test_one_speed_of_three_is_no_velocity(tmp_path):
    found = read_metadata(saved(tmp_path / "a.jpg", xmp='a:FlightXSpeed="+6.70"'))
    assert found.velocity is None


def test_the_time_keeps_its_sub_seconds_and_its_zone(tmp_path):
    inner = {36867: "2024:06:24 10:20:31", 37521: "05", 36881: "+07:00"}
    taken = read_metadata(saved(tmp_path / "a.jpg", inner=inner)).taken
    assert (taken.day, taken.decimals, taken.zone) == ("2024-06-24", 2, "+07:00")
    assert taken.seconds == pytest.approx(37231.05, abs=1e-9)


def test_a_day_that_no_calendar_has_is_no_day(tmp_path):
    taken = read_metadata(saved(tmp_path / "a.jpg", inner={36867: "2024:13:24 10:20:31"})).taken
    assert taken.day is None and taken.text.startswith("2024:13:24")


def test_what_makes_no_sense_is_not_known(tmp_path):
    found = read_metadata(
        saved(tmp_path / "a.jpg", {271: "DJI\0", 274: 77}, {37386: 0.0}, 'a:RtkStdLon="x"')
    )
    assert found.make == "DJI" and found.orientation == 1
    assert found.focal_mm is None and found.sigma is None and found.taken is None


def test_a_cut_off_file_ends_in_a_sentence(tmp_path):
    saved(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:40])
    with pytest.raises(InputError, match=r"^a\.jpg cannot be read as a photograph"):
        read_metadata(tmp_path / "a.jpg")


def test_photographs_of_a_phantom_4_give_a_block_its_velocities(real_data):
    """special_plot: 76 photographs, their speeds also in metadata.csv, read by another program."""
    home = real_data / "special_plot"
    project = Project("made", home, corridor.read(home / "block"))
    project, *_ = add_photographs(project, home / "photos")
    block = project.block
    with (home / "metadata.csv").open() as file:
        known = {row["image"]: row for row in csv.DictReader(file)}
    for row in block.images.itertuples(index=False):
        said = known[row.image]
        north, east, down = (float(said[f"speed_{axis}"]) for axis in ("north", "east", "down"))
        assert (row.vx, row.vy, row.vz) == (east, north, -down)
    assert len(block.images) == 76
    # The block was placed by these positions: it moves as it says it does.
    moved = block.images.sort_values("image")
    step = np.diff(moved[["x", "y"]].to_numpy(), axis=0) / np.diff(moved["time_s"])[:, None]
    middle = (moved[["vx", "vy"]].to_numpy()[1:] + moved[["vx", "vy"]].to_numpy()[:-1]) / 2
    assert np.median(np.linalg.norm(step - middle, axis=1)) < 1.0


def dji_note(**floats):
    """DJI's maker note with these tags, t3=1.5: single floats among an entry of text."""
    entries = [
        (1, 2, 4, b"DJI\0"),
        *((int(k[1:]), 11, 1, struct.pack("<f", floats[k])) for k in floats),
    ]
    body = b"".join(struct.pack("<HHI4s", *entry) for entry in entries)
    return struct.pack("<H", len(entries)) + body + bytes(4)


def test_a_small_djis_speed_is_in_its_maker_note(tmp_path):
    note = dji_note(t3=6.5, t4=-0.25, t5=0.5, t9=-90.0, t10=12.5, t11=0.0)
    found = read_metadata(saved(tmp_path / "a.jpg", {271: "DJI"}, {37500: note}))
    assert found.velocity == (-0.25, 6.5, -0.5)
    assert "maker note" in found.velocity_of
    assert (found.yaw, found.pitch, found.roll) == (12.5, -90.0, 0.0)
    # XMP, where it speaks, is asked first; another maker's note is another thing.
    xmp = 'a:FlightXSpeed="1" a:FlightYSpeed="2" a:FlightZSpeed="3"'
    both = read_metadata(saved(tmp_path / "b.jpg", {271: "DJI"}, {37500: note}, xmp))
    assert both.velocity == (2.0, 1.0, -3.0)
    other = read_metadata(saved(tmp_path / "c.jpg", {271: "made"}, {37500: note}))
    assert other.velocity is None


@pytest.mark.parametrize("note", [b"", b"\x00" * 40, b"\xff" * 40, dji_note(t3=1.0, t4=2.0)])
def test_a_maker_note_of_another_form_says_nothing(tmp_path, note):
    found = read_metadata(saved(tmp_path / "a.jpg", {271: "DJI"}, {37500: note}))
    assert found.velocity is None


@pytest.mark.parametrize("written", [True, False])
def test_a_picture_made_smaller_keeps_the_rows_that_were_read(tmp_path, written):
    """Parrot's row time is of 3456 rows, whatever is stored, and told by EXIF or the model."""
    inner = {40962: 4608, 40963: 3456} if written else {}
    xmp = 'a:LineReadoutTime="47500" a:ModelType="perspective"'
    found = read_metadata(saved(tmp_path / "a.jpg", {271: "Parrot", 272: "Sequoia"}, inner, xmp))
    assert found.resized and found.taken_size == (4608, 3456)


def test_a_cropped_picture_is_not_a_smaller_one(tmp_path):
    found = read_metadata(saved(tmp_path / "a.jpg", inner={40962: 4000, 40963: 2250}))
    assert not found.resized and found.taken_size == (40, 30)


@pytest.mark.parametrize(
    ("camera", "size", "milliseconds"),
    [
        ("DJI FC7203", (4000, 3000), {25.0}),
        ("DJI FC7203", (4000, 2250), {19.0}),
        ("Hasselblad L1D-20c", (5472, 3648), {56.0}),
        ("Hasselblad L1D-20c", (5472, 3420), {47.0}),
        ("DJI FC3582", (4032, 3024), {26.0}),
        ("DJI FC3582", (8064, 6048), {60.0}),
        ("DJI FC8482", (4032, 2268), {16.0}),
        ("DJI FC8482", (1008, 756), {21.0, 58.0}),
        ("DJI FC8482", (1000, 1000), {16.0, 21.0, 43.0, 58.0}),
        ("Panasonic GX85", (4592, 3448), {40.12}),
        ("Panasonic GX85", (3840, 2160), {27.06}),
    ],
)
def test_the_size_of_a_picture_tells_the_mode(camera, size, milliseconds):
    found = of_picture(published_readouts(camera), size)
    assert {row.readout_ms for row in found} == milliseconds


def drone(model, size=(5472, 3648), exposed=0.001, **tags):
    """A photograph of a drone of DJI's."""
    return Metadata(
        Path("a.jpg"), *size, make="DJI", model=model, exposure_s=exposed, tags=dict(tags)
    )


@pytest.mark.parametrize(
    ("photo", "once"),
    [
        (drone("FC6310R"), True),
        (drone("FC6310"), True),
        (drone("FC6310", exposed=1 / 2000), True),
        (drone("FC6310", exposed=1 / 3200), False),
        (drone("FC6310", exposed=None), True),
        (drone("FC6360", (1600, 1300), 1 / 10_000), True),
        (drone("ZenmuseP1", (8192, 5460)), True),
        (drone("M3E", (5280, 3956)), True),
        (drone("M3E", (5280, 3956), ShutterType="Electronic"), False),
        (drone("M3E", (4000, 3000)), False),
        (drone("a camera of next year", ShutterType="Mechanical"), True),
        (drone("FC330", (4000, 3000)), False),
        (drone("FC7203", (4000, 2250)), False),
    ],
)
def test_a_shutter_that_exposes_all_rows_at_once_is_known_by_model_and_exposure(photo, once):
    assert bool(at_once(photo)) == once
    readout, source = readout_of(photo, photo.height_px)
    assert (readout == 0.0) == once
    if not once and photo.model == "FC6310":
        assert readout == pytest.approx(0.033, rel=1e-3) and "published" in source
    if not once and photo.model == "M3E":
        assert readout is None


@pytest.mark.parametrize(
    ("exposures", "readout", "said"),
    [
        ((1 / 800, 1 / 1000), 0.0, "all rows are exposed at once"),
        ((1 / 4000, 1 / 3200), 0.033, "published for FC6310"),
        ((1 / 4000, 1 / 1000), None, "21 of 42 photographs were taken with the electronic shutter"),
    ],
)
def test_the_import_asks_every_photograph_of_a_camera_for_its_shutter(exposures, readout, said):
    block = corridor.read("data_synthetic/dike")
    photos = {row: drone("FC6310", exposed=exposures[row % 2]) for row in range(len(block.images))}
    found = _with_readout(Project("made", Path("made"), block), photos)
    assert any(said in note for note in found.notes)
    (camera,) = found.block.cameras.values()
    if readout is None:
        assert camera.readout_s is None
    else:
        assert camera.readout_s == pytest.approx(readout, rel=1e-3)


def test_every_global_shutter_is_found_by_its_names_and_no_other():
    assert global_shutter("DJI FC6310R") is global_shutter("phantom 4 rtk")
    assert global_shutter("DJI FC6310R").takes(exposure_s=1 / 2000)
    for name in ("", "DJI", "FC330", "DJI Mavic 3", "M3T", "FC6520"):
        assert global_shutter(name) is None


def test_garfield_was_made_smaller_and_says_its_own_readout(real_data):
    """47,500 ns a row of 3456, the maker's; the pictures are stored with 864."""
    photo = read_metadata(sorted((real_data / "garfield" / "photos").iterdir())[3])
    assert (photo.width, photo.height_px) == (1152, 864)
    readout, source = readout_of(photo, 864)
    assert 1000 * readout == pytest.approx(164.1, abs=0.05)
    assert "3456 rows as they were taken" in source
    rates = gyro_rates(photo, 100.0)
    first_row = photo.gyro["us"][0] * 1e-6 + photo.number("IMUTimeOffset") * 1e-9
    middle = first_row + 0.0475e-3 * 3455 / 2
    expected = photo.gyro["us"][0] * 1e-6 + 100.0 - middle
    assert rates["time_s"].iloc[0] == pytest.approx(expected, abs=1e-9)


def test_positions_of_photographs_hold_a_lever_arm_of_naught(real_data, tmp_path):
    home = real_data / "special_plot"
    block = corridor.read(home / "block")
    block.lever_arm, block.lever_arm_fixed = {}, False
    project, *_ = add_photographs(Project("made", home, block), home / "photos")
    assert project.block.lever_arm == {"default": (0.0, 0.0, 0.0)}
    assert any(note.startswith("lever arm: 0, held") for note in project.notes)
    assert any("made smaller" in note and "4000 x 3000" in note for note in project.notes)
    project.block.write(tmp_path / "block", observed=False)
    assert corridor.read(tmp_path / "block").lever_arm_fixed


def test_the_maker_note_says_what_xmp_says(real_data):
    """A Phantom 4 writes speed and yaw in both: an independent check of the tags."""
    files = sorted((real_data / "special_plot" / "photos").iterdir())
    differ = []
    for file in files:
        photo = read_metadata(file)
        with Image.open(file) as picture:
            noted = maker_note.facts_of(exif.facts_of(picture)[1])
        moved = np.subtract(noted["velocity"], photo.velocity)
        differ.append([*moved, noted["yaw"] - photo.yaw])
    assert len(files) == 76 and np.abs(differ).max() < 1e-4


def position(path, degrees, tags=(), xmp=""):
    """A small picture whose EXIF has a latitude in whole degrees, longitude 8 E, height 40 m."""
    exif = Image.Exif()
    exif.get_ifd(0x8825).update(
        {1: "N", 2: (degrees, 0.0, 0.0), 3: "E", 4: (8.0, 0.0, 0.0), 6: 40.0} | dict(tags)
    )
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/'
        f'22-rdf-syntax-ns#"><rdf:Description xmlns:a="http://made/1.0/" {xmp}/></rdf:RDF>'
        "</x:xmpmeta>"
    )
    Image.new("L", (40, 30)).save(path, exif=exif, xmp=packet.encode())
    return read_metadata(path)


def test_a_position_of_zeros_in_xmp_leaves_that_of_exif(tmp_path):
    """A drone without a fix writes zeros; a program has put the position into EXIF afterwards."""
    none = 'a:GpsLatitude="0.0" a:GpsLongitude="0.0" a:AbsoluteAltitude="+0.00"'
    found = position(tmp_path / "a.jpg", 49.0, xmp=none)
    assert (found.lat_deg, found.lon_deg, found.height) == (49.0, 8.0, 40.0)


def test_how_far_the_positions_of_exif_and_xmp_lie_apart_is_kept(tmp_path):
    """A degree of latitude has 111 km, so a hundred-thousandth 1.1 m."""
    xmp = 'a:GpsLatitude="49.00001" a:GpsLongitude="8.0"'
    found = position(tmp_path / "a.jpg", 49.0, xmp=xmp)
    assert found.lat_deg == 49.00001 and found.apart_m == pytest.approx(1.11, abs=0.01)
    assert position(tmp_path / "b.jpg", 49.0).apart_m is None


@pytest.mark.parametrize(("reference", "sign"), [(0, 1), (1, -1), (2, 1), (3, -1)])
def test_heights_below_ellipsoid_or_sea_are_negative(tmp_path, reference, sign):
    """EXIF 3.0: 0 and 1 above and below the ellipsoid, 2 and 3 the sea."""
    found = position(tmp_path / "a.jpg", 49.0, tags={5: bytes([reference])})
    assert found.height == sign * 40.0


@pytest.mark.parametrize(("said", "lat"), [("S", -49.0), (b"S\0", -49.0), ("", None), ("x", None)])
def test_a_latitude_without_its_hemisphere_is_none(tmp_path, said, lat):
    """On the wrong side of the equator a survey would be mirrored."""
    assert position(tmp_path / "a.jpg", 49.0, tags={1: said}).lat_deg == lat
