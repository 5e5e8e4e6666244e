"""What photographs say of themselves."""

import csv

import numpy as np
import pytest
from PIL import Image

import corridor
from corridor.errors import InputError
from corridor.interchange import Project
from corridor.interchange.placing import add_photographs
from corridor.photographs import read_metadata


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
    project, _ = add_photographs(project, home / "photos")
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
