"""What an import of photographs says of those that it could not join, and of the focal length."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from corridor.core.errors import InputError, WorkFailed
from corridor.core.gnss import Local
from corridor.core.photographs import Metadata, Taken, photographs_in, read_metadata
from corridor.tools.formats import Project, mapping, placing
from corridor.tools.formats.focal import stated_focal
from corridor.tools.formats.importing import _straight
from corridor.tools.formats.joining import bent, damaged, why_lost
from corridor.tools.formats.mapping import _each_once, _without_smaller

from .conftest import exact_block

PLACE = Local(47.5, 8.7, 0.0)


def flown(step_m, speed=6.5, count=12, **facts):
    """Photographs of a strip, 50 m above ground, as a Phantom 4 writes them."""
    photos = []
    for k in range(count):
        lon, lat, height = PLACE.to_geographic(np.array([[step_m * k, 0.0, 50.0]]))[0]
        known = {"make": "DJI", "model": "FC330", "focal_mm": 3.61, "focal_35_mm": 20.0,
                 "velocity": (speed, 0.0, 0.0), "exposure_s": 1e-3,
                 "tags": {"RelativeAltitude": "+50.0"}}  # fmt: skip
        photos.append(
            Metadata(Path(f"IMG_{k:04d}.JPG"), 4000, 3000, lat_deg=lat, lon_deg=lon, height=height,
                     **known | facts)
        )  # fmt: skip
    return photos


def test_pictures_bent_by_the_shutter_say_so_in_pixels():
    """6.5 m/s times 33 ms is 0.215 m, 9.7 px of 2.2 cm; at a third of the speed it is 3.2 px."""
    assert "the drone moved 0.2 to 0.2 m, 10 to 10 px while" in why_lost(flown(10.0), {0})
    assert "overlap or texture" in why_lost(flown(10.0, speed=2.0), {0})


def test_pictures_that_hardly_overlap_say_so():
    said = why_lost(flown(45.0, speed=2.0), {0, 1, 2})
    assert said.startswith("they overlap their neighbours by about") and "% only" in said


def test_a_picture_that_is_cut_off_is_named(tmp_path):
    path = tmp_path / "cut.jpg"
    noise = np.random.default_rng(1).integers(0, 255, (200, 300, 3), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    whole = Metadata(path, 300, 200)
    assert "damaged" not in why_lost([whole], set())
    path.write_bytes(path.read_bytes()[:9000])
    assert "cut.jpg is damaged" in why_lost([whole], set())
    assert "damaged" not in why_lost([whole], {0})


def test_a_long_exposure_blurs():
    assert "blurs 2.9 px" in why_lost(flown(10.0, exposure_s=0.01), {0})


def test_garfield_says_that_its_shutter_bends_the_pictures(real_data):
    photos = [read_metadata(path) for path in photographs_in(real_data / "garfield" / "photos")]
    said = why_lost(photos, {0, 1, 2, 3, 4})
    assert "while one picture was read out (164 ms at" in said


def joined(images):
    block = exact_block(images=images)
    return Project("photos", Path("photos"), block), [str(name) for name in block.images["image"]]


def test_few_joined_keep_the_work_and_are_no_block(tmp_path):
    photos = flown(10.0, count=28)
    names = [photo.name for photo in photos]
    project, there = joined(6)
    project.block.images["image"] = names[: len(there)]
    with pytest.raises(WorkFailed) as failed:
        mapping._with_lost_named(project, tmp_path, names, photos, force=False)
    said = str(failed.value)
    assert said.startswith("only 6 of 28 photographs make one model") and "10 px" in said
    assert str(tmp_path) in said and "the same command goes on" in said
    forced = mapping._with_lost_named(project, tmp_path, names, photos, force=True)
    assert "22 of 28 photographs could not be connected" in forced.warnings[0]


def test_focal_lengths_that_photographs_state(real_data):
    """Maker's 4.812 mm is 3591 px of 4608; 20 mm of 35 mm film is between 2222 and 2312 of 4000."""
    garfield = read_metadata(photographs_in(real_data / "garfield" / "photos")[0])
    assert stated_focal(garfield).px == pytest.approx(3591 / 4, abs=0.5)
    assert stated_focal(garfield, 4608).px == pytest.approx(3591, abs=1)
    phantom = stated_focal(flown(10.0)[0])
    assert 2222 < phantom.px < 2312 and phantom.of == "EXIF's, of 35 mm film"
    assert stated_focal(replace(flown(10.0)[0], focal_35_mm=None)) is None


@pytest.mark.parametrize(("f", "word"), [(2600.0, "15 % longer"), (2270.0, None)])
def test_a_focal_length_far_from_the_stated_one_is_told(f, word, tmp_path):
    photos = flown(10.0)
    block = exact_block(f=f)
    project = Project("photos", Path("photos"), block)
    names, none = [photo.name for photo in photos], tmp_path / "none"
    made = mapping._with_focal_compared(project, names, photos, none)
    assert bool(made.warnings) == bool(word)
    if word:
        assert (
            word in made.warnings[0]
            and "stated 2266 px (EXIF's, of 35 mm film)" in made.warnings[0]
        )


def test_a_stated_focal_length_that_the_pictures_contradict_is_no_narrow_prior(tmp_path):
    """35 mm of a picture whose points fit better with 1300 px: stated 3966, held, and doubted."""
    photos = flown(10.0, focal_35_mm=35.0)
    project = Project("photos", Path("photos"), exact_block(f=3966.0))
    (name,) = project.block.cameras
    (tmp_path / "freed.json").write_text(f'{{"{name}": 1300.0}}')
    names = [photo.name for photo in photos]
    made = mapping._with_focal_compared(project, names, photos, tmp_path / "freed.json")
    assert "f 1300 px fits better; stated 3966 px" in made.warnings[0]
    made = placing._with_focal(made, dict(enumerate(photos[: len(made.block.images)])))
    assert made.block.cameras[name].extra == {"f_stated": [3966.01, 2666.01]}


@pytest.mark.parametrize(("film_mm", "sigma"), [(20.0, 57.0), (10.0, 1133.0)])
def test_a_stated_focal_length_that_a_project_contradicts_is_no_narrow_prior(film_mm, sigma):
    """A project with 2266 px: of 35 mm film 20 mm, and one half of that by mistake."""
    photos = dict(enumerate(flown(10.0, focal_35_mm=film_mm)))
    project = Project("colmap", Path("model"), exact_block(f=2266.0))
    photos = {k: photos[k] for k in range(len(project.block.images))}
    made = placing._with_focal(project, photos)
    (camera,) = made.block.cameras.values()
    assert camera.extra["f_stated"][1] == pytest.approx(sigma, rel=0.2)
    assert ("the project has 2266 px" in "".join(made.notes)) == (sigma > 1000)


def test_work_is_kept_for_the_same_photographs_at_the_same_size_only(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"1")
    place = tmp_path / "place"
    files = [tmp_path / "a.jpg"]

    def again(cheaply):
        mapping._same_photos(place, tmp_path, files, ["a.jpg"], cheaply)
        return (place / "mark").exists()

    again(mapping.Cheaply())
    (place / "mark").touch()
    assert again(mapping.Cheaply())
    assert not again(mapping.Cheaply(size=1000))


def test_pictures_are_made_smaller_once(real_data, tmp_path):
    folder = real_data / "brighton" / "photos"
    files = photographs_in(folder)[:2]
    photos, names, said = [read_metadata(file) for file in files], [f.name for f in files], []
    cheaply = mapping.Cheaply(size=400)
    made = mapping._pictures(folder, tmp_path, names, photos, cheaply, said.append)
    small = read_metadata(made / names[0])
    assert (small.width, small.height_px) == mapping._size_of(photos[0], cheaply) == (400, 225)
    assert said == ["pictures made smaller: 1 of 2", "pictures made smaller: 2 of 2"]
    mapping._pictures(folder, tmp_path, names, photos, cheaply, said.append)
    assert len(said) == 2
    assert mapping._pictures(folder, tmp_path, names, photos, mapping.Cheaply(), print) == folder


def test_a_model_that_contradicts_its_positions_is_bent():
    """Centres 30 m off in the median where GNSS states 3 m and the block has 120 m."""
    block = exact_block()
    place = block.images[["x", "y", "z"]].to_numpy(float)
    block.gnss = pd.DataFrame({"image": block.images["image"]})
    block.gnss[["x", "y", "z"]] = place
    block.gnss[["sx", "sy", "sz"]] = 3.0
    assert bent(block) is None
    off = np.random.default_rng(3).normal(0, 25.0, (len(place), 2))
    block.gnss[["x", "y"]] += off
    block.images[["vx", "vy", "vz"]] = [12.0, 0.0, 0.0]
    name, camera = next(iter(block.cameras.items()))
    block.cameras[name] = replace(camera, readout_s=0.164)
    said = bent(block)
    assert said.startswith("the reconstruction is bent") and "stated to 3.0 m" in said
    assert "moved 2.0 m (median) while one picture was read out (164 ms)" in said
    project = Project("photos", Path("photos"), block)
    with pytest.raises(WorkFailed, match=r"kept in .*--force"):
        _straight(project, Path("block"), force=False)
    assert _straight(project, Path("block"), force=True).warnings == [said]


@pytest.mark.parametrize("name", ["IMG_1.HEIC", "DSC1.ARW", "DJI_1.MP4"])
def test_a_folder_of_other_files_says_which(tmp_path, name):
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=rf"but \.{name[-3:].lower()}|but \.heic"):
        photographs_in(tmp_path)


def test_copies_of_photographs_are_left_out_and_the_shortest_name_stays(tmp_path):
    for name, content in (("a (1).jpg", b"one"), ("a.jpg", b"one"), ("b.jpg", b"two")):
        (tmp_path / name).write_bytes(content)
    kept, copies = _each_once(sorted(tmp_path.iterdir()))
    assert [file.name for file in kept] == ["a.jpg", "b.jpg"]
    assert [[one.name for one in pair] for pair in copies] == [["a (1).jpg", "a.jpg"]]


def test_a_picture_that_ends_early_is_told_though_it_joins(tmp_path):
    rng = np.random.default_rng(7)
    path = tmp_path / "cut.jpg"
    Image.fromarray(rng.integers(0, 255, (300, 400), np.uint8)).save(path)
    photo = read_metadata(path)
    assert list(damaged([photo])) == []
    path.write_bytes(path.read_bytes()[:30_000])
    assert "cut.jpg is damaged" in next(damaged([photo]))


def test_a_preview_of_a_photograph_is_left_out_and_that_of_another_camera_is_not():
    taken = Taken("2024:05:14 10:00:00", "2024-05-14", 36000.0, 0, "")
    whole = Metadata(Path("a/DJI_1.JPG"), 4000, 3000, model="FC330", taken=taken)
    small = replace(whole, path=Path("thumbs/dji_1.jpg"), width=160, height_px=120)
    other = replace(small, path=Path("b/DJI_1.JPG"), model="FC6310")
    kept, pairs = _without_smaller([whole, small, other])
    assert kept == [whole, other]
    assert pairs == [(small.path, whole.path)]
