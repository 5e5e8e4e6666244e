"""What photographs say of times, places, lenses and drones is believed where something agrees."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from corridor.core.geometry import quaternion_from_rotation
from corridor.core.photographs import Metadata, photographs_in, read_metadata
from corridor.tools.formats import Project
from corridor.tools.formats.delay import delay_of, with_delay_told
from corridor.tools.formats.focal import stated_focal
from corridor.tools.formats.importing import Imported, _with_tie_sigma
from corridor.tools.formats.joining import places_apart
from corridor.tools.formats.placing import (
    _by_axes,
    _positions_of,
    _put,
    _turned_away,
    _turned_by_a_quarter,
    _with_flights,
    _with_positions,
    with_motion,
)
from corridor.tools.formats.proof import prove

from .conftest import exact_block


def photo(name="a.jpg", width=4000, height=3000, **facts):
    return Metadata(Path(name), width, height, **facts)


# --- how late positions are ---------------------------------------------------------------------


CORNERS = np.array([[0, 0], [180, 0], [180, 30], [0, 30], [0, 60], [180, 60]], dtype=float)


def way(time, turns):
    """(n, 3): three strips to and fro at 8 m/s, or one that goes straight on."""
    if not turns:
        return np.column_stack([8.0 * time, 0.0 * time, np.full(len(time), 60.0)])
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(CORNERS, axis=0), axis=1))]
    plan = [np.interp(8.0 * time, along, axis) for axis in CORNERS.T]
    return np.column_stack([*plan, np.full(len(time), 60.0)])


def flown(late=0.0, noise=0.5, seed=2, turns=True):
    """A picture every 2 s; positions of `late` seconds before."""
    rng = np.random.default_rng(seed)
    time = 2.0 * np.arange(2, 36)
    images = pd.DataFrame({"image": [f"I{k:03d}" for k in range(len(time))], "camera": "P1"})
    images["time_s"] = time
    images[["x", "y", "z"]] = way(time, turns)
    images[["qw", "qx", "qy", "qz"]] = [1.0, 0.0, 0.0, 0.0]
    gnss = images[["image"]].copy()
    gnss[["x", "y", "z"]] = way(time - late, turns) + rng.normal(0, noise, (len(time), 3))
    ties = pd.DataFrame({"point": ["p"], "image": ["I000"], "x": [5.0], "y": [5.0]})
    return replace(exact_block(), images=images, gnss=gnss, tie_points=ties, marks=None,
                   points=None, ground=None)  # fmt: skip


@pytest.mark.parametrize("late", [2.4, -1.5, 0.8])
def test_late_positions_are_told_with_the_value(late):
    block = flown(late)
    found = delay_of(block, block.numbers("gnss", *"xyz"))
    assert found.seconds == pytest.approx(late, abs=3 * found.sigma)
    (said,) = with_delay_told(Project("photos", Path("x"), block)).warnings
    assert f"s {'late' if late > 0 else 'early'}:" in said and "--effect clock_offset" in said


@pytest.mark.parametrize("seed", range(5))
def test_positions_in_time_are_not_called_late(seed):
    assert with_delay_told(Project("photos", Path("x"), flown(seed=seed))).warnings == []


def test_one_direction_tells_no_delay():
    assert with_delay_told(Project("photos", Path("x"), flown(2.4, turns=False))).warnings == []


# --- focal lengths ------------------------------------------------------------------------------


def test_the_makers_calibration_comes_before_its_nominal_value_and_exifs():
    every = {
        "DewarpData": "2022-03-02;1973.1,1955.7,-19.0,-11.4,-0.42,0.37,0.004,0.004,-0.26",
        "CalibratedFocalLength": "1913.333",
    }
    facts = {"focal_35_mm": 40.0, "focal_mm": 5.74}
    of = [
        stated_focal(photo(width=1600, height=1300, tags=tags, **facts))
        for tags in (every, {"CalibratedFocalLength": "1913.333"}, {})
    ]
    assert [one.px for one in of] == pytest.approx([1964.4, 1913.333, 40 / 35.3 * 1600])
    assert of[0].sigma_px < of[1].sigma_px < of[2].sigma_px


def test_the_makers_calibration_goes_with_the_size_of_the_picture():
    tags = {"CalibratedFocalLength": "3600"}
    small = photo(width=1000, height=750, written_size=(4000, 3000), tags=tags)
    assert stated_focal(small).px == pytest.approx(900)


@pytest.mark.parametrize("text", ["", "2022;", "2022;a,b", "2022;0,0", "2022;1000,2000", "nan"])
def test_a_calibration_that_makes_no_sense_is_passed_over(text):
    assert stated_focal(photo(tags={"DewarpData": text}, focal_35_mm=24.0)).of.startswith("EXIF")


def test_a_wide_picture_leaves_the_35_mm_equivalent_more_open():
    three, nine = (stated_focal(photo(height=h, focal_35_mm=24.0)) for h in (3000, 2250))
    assert nine.sigma_px > 1.5 * three.sigma_px


def test_i_sfm_states_the_makers_own_numbers(real_data):
    (first, *_) = photographs_in(real_data / "i_sfm" / "photos")
    assert stated_focal(read_metadata(first)).px == pytest.approx(1964, abs=1)


# --- drones and flights -------------------------------------------------------------------------


def project_of(photos, times):
    images = pd.DataFrame({"image": [p.name for p in photos.values()], "camera": "P1"})
    images["time_s"] = times
    images[["x", "y", "z", "qw", "qx", "qy", "qz"]] = [0.0, 0, 0, 1, 0, 0, 0]
    block = replace(exact_block(), images=images, tie_points=None, marks=None, points=None)
    return Project("photos", Path("x"), block)


def test_serial_numbers_make_flights():
    photos = {k: photo(f"{k}.jpg", serial="AB"[k % 2]) for k in range(8)}
    found = _with_flights(project_of(photos, np.arange(8.0)), photos)
    assert found.block.images["flight"].tolist() == ["F1", "F2"] * 4
    assert "2 drones" in found.notes[0]


def test_a_long_gap_makes_flights_and_a_line_does_not():
    photos = {k: photo(f"{k}.jpg") for k in range(8)}
    times = np.r_[np.arange(4.0) * 2, 900 + np.arange(4.0) * 2]
    found = _with_flights(project_of(photos, times), photos)
    assert found.block.images["flight"].tolist() == ["F1"] * 4 + ["F2"] * 4
    times = np.r_[np.arange(4.0) * 2, 40 + np.arange(4.0) * 2]
    assert "flight" not in _with_flights(project_of(photos, times), photos).block.images


def test_one_serial_number_is_one_flight():
    photos = {k: photo(f"{k}.jpg", serial="A") for k in range(8)}
    assert "flight" not in _with_flights(project_of(photos, np.arange(8.0)), photos).block.images


def test_two_places_are_told_with_their_distance_and_names():
    photos = [photo(f"I{k}.jpg", lat_deg=47.0 + 1e-4 * k, lon_deg=8.0) for k in range(6)]
    photos += [photo(f"J{k}.jpg", lat_deg=47.1 + 1e-4 * k, lon_deg=8.0) for k in range(4)]
    said = places_apart(photos, [one.name for one in photos])
    assert "2 places, 11.1 km" in said and "I0.jpg to I5.jpg" in said and "J0.jpg to J3.jpg" in said
    assert places_apart(photos[:6], [one.name for one in photos[:6]]) is None


def test_pictures_turned_by_a_quarter_are_named():
    photos = {k: photo(f"{k}.jpg", model="M") for k in range(6)}
    photos |= {k: photo(f"{k}.jpg", 3000, 4000, model="M") for k in (6, 7)}
    assert _turned_by_a_quarter(photos) == ["6.jpg", "7.jpg"]
    assert _turned_by_a_quarter({k: one for k, one in photos.items() if k > 5}) == []
    # Of as many, those that stand upright.
    assert _turned_by_a_quarter({k: one for k, one in photos.items() if k > 3}) == [
        "6.jpg",
        "7.jpg",
    ]


@pytest.mark.parametrize(
    ("flag", "least", "word"), [(16, 3.0, "single"), (34, 0.5, "float"), (52, 3.0, "not a fix")]
)
def test_positions_that_are_no_fix_are_named_and_not_believed(flag, least, word):
    fix = photo(lat_deg=47.0, lon_deg=8.0, sigma=(0.01, 0.01, 0.02), flag=50)
    fix = replace(fix, height=400.0)
    table, _, (note,) = _positions_of({"a": replace(fix, flag=flag), "b": fix})
    assert table["sx"].tolist() == [least, 0.01]
    assert f"RtkFlag {flag}" in note and word in note and note.startswith("1 of 2")


def test_positions_without_a_height_are_no_measurements():
    with_height = replace(photo(lat_deg=47.0, lon_deg=8.0), height=400.0)
    table, _, notes = _positions_of({"a": with_height, "b": replace(with_height, height=None)})
    assert any("1 positions have no height" in note for note in notes)
    block = replace(flown(), extra=NORTH)
    made = _put(Project("made", None, block, placed=True), table, "photographs")
    assert list(made.block.gnss["image"]) == ["a"]


@pytest.mark.parametrize(("yaw_deg", "told"), [(0, 0), (10, 0), (90, 90), (180, 180)])
def test_attitudes_that_contradict_the_positions_are_told_by_their_angle(yaw_deg, told):
    """Ten photographs along 45 m, positions good to 1 m, know the turn to 2 degrees; what a compass
    is wrong by is no contradiction."""
    rng = np.random.default_rng(6)
    place = np.c_[np.linspace(0, 45, 10), np.zeros(10), np.full(10, 40.0)]
    down = np.tile([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]], (10, 1, 1))
    pose = np.c_[place, quaternion_from_rotation(down)]
    yaw = np.radians(yaw_deg)
    turn = [[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    target = place + rng.normal(0, 1, (10, 3))
    axes, directions, _ = _by_axes(pose, place, target, down @ turn, 1.0)
    off = np.degrees(_turned_away(axes, directions, place, target, 1.0))
    assert off == pytest.approx(told, abs=6)


def test_positions_of_exif_and_xmp_that_differ_are_told():
    photos = {k: photo(f"{k}.jpg", lat_deg=47.0, lon_deg=8.0, apart_m=4.4) for k in range(5)}
    made = _with_positions(Project("made", None, flown()), photos, None)
    assert "EXIF and XMP of 5 photographs put them 4.4 m (median) apart" in made.warnings[0]


# --- velocities ---------------------------------------------------------------------------------

NORTH = {"local_frame": {"lat_deg": 47.0, "lon_deg": 8.0, "height": 0.0}}


def moving(mistaken=lambda v: v, **extra):
    block = flown(noise=0.02)
    true = np.gradient(block.numbers("images", *"xyz"), block.column("images", "time_s"), axis=0)
    said = mistaken(true)
    photos = {
        k: photo(name, velocity=tuple(v), velocity_of="a tag")
        for k, (name, v) in enumerate(zip(block.images["image"], said, strict=True))
    }
    block = replace(block, extra=extra)
    return with_motion(Project("photos", Path("x"), block, placed=bool(extra)), photos)


def test_velocities_go_into_a_frame_that_has_a_north_only():
    assert moving(**NORTH).warnings == [] and "vx" in moving(**NORTH).block.images
    lost = moving()
    assert "vx" not in lost.block.images
    assert "nothing says where north is" in lost.warnings[0]


@pytest.mark.parametrize(
    ("mistaken", "word"),
    [
        (lambda v: -v, "opposite sign?"),
        (lambda v: v[:, [1, 0, 2]], "vx and vy exchanged?"),
        (lambda v: -v[:, [1, 0, 2]], "exchanged, with the opposite sign?"),
        (lambda v: 3.6 * v, "km/h?"),
        (lambda v: 1.9438 * v, "knots?"),
        (lambda v: np.roll(v, 3, axis=0), "its own velocity?"),
    ],
)
def test_velocities_that_contradict_the_way_flown_are_told_with_the_mistake(mistaken, word):
    (said,) = moving(mistaken, **NORTH).warnings
    assert word in said


# --- the page, the sigma of tie points ----------------------------------------------------------


def test_tie_points_are_as_good_as_their_residuals(noisy):
    """Noise of 0.6 px; r is 2m - 3p - 6n, as of an adjustment with a known camera."""
    from corridor import adjust

    adjusted = adjust(noisy, camera="fixed").block
    project = _with_tie_sigma(Project("photos", Path("x"), adjusted))
    assert project.block.sigma["tie_px"] == pytest.approx(0.6, abs=0.05)


def test_an_import_has_a_page_with_what_was_derived_and_what_to_do(tmp_path):
    block = exact_block()
    project = replace(Project("photos", Path("field"), block), lost=["DJI_0007.JPG"])
    project = project.having(notes=["placed by nothing"], warnings=["look at <this>"])
    page = Imported(project, prove(project), tmp_path).save().read_text(encoding="utf-8")
    for said in ("12 of 13 images", "DJI_0007.JPG", "look at &lt;this&gt;", "placed by nothing",
                 "corridor adjust"):  # fmt: skip
        assert said in page
