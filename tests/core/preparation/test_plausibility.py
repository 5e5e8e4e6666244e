"""What is probably a mistake in a block is said, and what the program writes itself is none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import corridor
from corridor.core.preparation.plausibility import plausibility_warnings
from corridor.core.preparation.plausibility_of_motion import _disordered

DIKE = Path(__file__).parents[3] / "data_synthetic" / "dike"


@pytest.fixture(scope="module")
def dike():
    return corridor.read(DIKE)


def with_keys(block, of_block, of_camera):
    """The block with further keys in its block.toml."""
    (name, camera), *_ = block.cameras.items()
    cameras = {**block.cameras, name: replace(camera, extra={**camera.extra, **of_camera})}
    return replace(block, cameras=cameras, extra={**block.extra, **of_block})


def unknown(block):
    return [doubt for doubt in plausibility_warnings(block) if "not known to corridor" in doubt]


def test_keys_that_an_import_writes_are_not_called_unknown(dike):
    frame = {"local_frame": {"lat_deg": 3.6}, "date": "2026-03-01"}
    camera = {"readout_from": "published for FC330", "f_stated": [566.6, 17.0]}
    assert unknown(with_keys(dike, frame, camera)) == []


def test_a_key_nearly_written_as_a_known_one_is_called_unknown(dike):
    (said,) = unknown(with_keys(dike, {}, {"readout": 0.03}))
    assert "readout of [camera." in said and "readout_s" in said


@pytest.mark.parametrize(("places", "told"), [(1, "image after"), (-2, "2 images before")])
def test_positions_of_other_images_are_told_with_how_many_places(dike, places, told):
    """A photograph deleted before names and positions were put together."""
    block = dike.copy()
    names = block.images["image"].astype(str).tolist()
    other = dict(zip(names, names[places:] + names[:places], strict=True))
    gnss = block.gnss.copy()
    own = gnss.set_index(gnss["image"].astype(str))[["x", "y", "z"]]
    gnss[["x", "y", "z"]] = own.loc[[other[name] for name in gnss["image"].astype(str)]].to_numpy()
    block.gnss = gnss
    (sentence,) = [one for one in plausibility_warnings(block) if "gives each image" in one]
    assert f"the position of the {told} it" in sentence


def test_positions_of_their_own_images_are_not_called_those_of_others(dike):
    assert not [one for one in plausibility_warnings(dike) if "gives each image" in one]


def test_times_of_each_other_are_told_where_names_lie_in_order(dike):
    block = dike.copy()
    time = block.images["time_s"].to_numpy()
    block.images = block.images.assign(time_s=np.random.default_rng(1).permutation(time))
    told = [one for one in plausibility_warnings(block) if "jumps to and fro" in one]
    assert len(told) == len(block.flight_names)
    assert all("each other's times" in one for one in told)
    # Names of chance lie in no order: then nothing tells which of the two is right.
    names = [f"{n:08x}" for n in np.random.default_rng(2).integers(0, 2**31, len(time))]
    new = dict(zip(block.images["image"].astype(str), names, strict=True))
    block.images["image"] = [new[one] for one in block.images["image"].astype(str)]
    assert not list(_disordered(block))


@pytest.mark.parametrize(("name", "value"), [("cx", 0.0), ("cy", -41.5)])
def test_a_principal_point_counted_from_the_middle_is_told(dike, name, value):
    block = dike.copy()
    ((camera, one),) = block.cameras.items()
    block.cameras = {camera: one.with_values(**{name: value})}
    said = [doubt for doubt in plausibility_warnings(block) if "counted from the middle" in doubt]
    assert len(said) == 1 and f"{name} = {value:g}" in said[0]
    assert not [
        doubt for doubt in plausibility_warnings(dike) if "counted from the middle" in doubt
    ]


def test_the_area_of_a_system_with_heights_is_that_of_its_grid(dike):
    block = replace(dike, crs="EPSG:25833+7837")
    assert [one for one in plausibility_warnings(block) if "area of use" in one]


@pytest.mark.parametrize("written", ["7", "7.0", "007", "Gcp 7"])
def test_a_name_that_a_spreadsheet_has_changed_is_told(dike, written):
    block = dike.copy()
    first = block.ground["point"].iloc[0]
    own = "GCP7" if "Gcp" in written else "07"
    block.ground = block.ground.assign(point=block.ground["point"].replace({first: own}))
    block.marks = block.marks.assign(
        point=block.marks["point"].astype(str).replace({first: written}).astype("category")
    )
    (said,) = [one for one in plausibility_warnings(block) if "written in two ways" in one]
    assert repr(own) in said and repr(written) in said and "1 such pair" in said


def test_names_that_are_no_ground_point_at_all_are_not_called_one(dike):
    assert not [one for one in plausibility_warnings(dike) if "written in two ways" in one]


@pytest.mark.parametrize("table", ["tie_points", "marks"])
def test_shares_of_a_picture_are_told_from_pixels(dike, table):
    block = dike.copy()
    rows, (camera,) = getattr(block, table), block.cameras.values()
    scaled = rows.assign(x=rows["x"] / camera.width, y=rows["y"] / camera.height)
    setattr(block, table, scaled)
    (said,) = [one for one in plausibility_warnings(block) if "Write pixels" in one]
    assert f"{table}.csv" in said


@pytest.mark.parametrize(("degrees", "unit"), [(108.0, "Fahrenheit"), (305.0, "kelvin")])
def test_temperatures_that_no_camera_endures_are_told_with_their_unit(dike, degrees, unit):
    block = dike.copy()
    block.images = block.images.assign(temperature_c=degrees)
    (said,) = [one for one in plausibility_warnings(block) if "temperature_c" in one]
    assert unit in said


def test_times_in_milliseconds_are_told(dike):
    block = dike.copy()
    block.images = block.images.assign(time_s=1000.0 * block.images["time_s"])
    said = [one for one in plausibility_warnings(block) if "milliseconds" in one]
    assert said and "flight" in said[0]
    assert not [one for one in plausibility_warnings(dike) if "milliseconds" in one]


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        ((0.0, 20.0, 35.0), "40.31 mm are 0.0403"),
        ((0.0, 2.0, -12.0), "metres"),
        ((0.2, 0.1, 1.0), ""),
    ],
)
def test_a_lever_arm_longer_than_a_drone_is_in_another_unit(arm, said, dike):
    block = replace(dike.copy(), lever_arm={"default": arm})
    found = [one for one in plausibility_warnings(block) if "lever arms are in metres" in one]
    assert bool(found) == bool(said) and said in "".join(found)


def test_an_aircraft_may_carry_its_antenna_farther_away(dike):
    block = replace(dike.copy(), lever_arm={"default": (0.0, 3.0, -4.0)})
    block.put("images", "z", block.numbers("images", "z") + 600.0)
    assert not [one for one in plausibility_warnings(block) if "lever arms are in metres" in one]


@pytest.mark.parametrize("seed", range(5))
def test_ground_seen_across_a_ring_of_images_has_no_exchanged_axes(dike, seed):
    """What is seen from the far side stands opposite, where exchanged axes would put it."""
    rng = np.random.default_rng(seed)
    block, count = dike.copy(), len(dike.images)
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    block.images["x"], block.images["y"] = 30.0 * np.cos(angle), 30.0 * np.sin(angle)
    side = rng.choice([0.75, -0.25], len(block.ground)) * np.pi
    at = side + rng.normal(0.0, 0.3, len(side))
    block.ground["x"], block.ground["y"] = 12.0 * np.cos(at), 12.0 * np.sin(at)
    seen = np.round((at[:, None] / (2.0 * np.pi) + 0.5) * count + np.arange(-2, 3)).astype(int)
    marks = block.marks.iloc[: seen.size].reset_index(drop=True)
    marks["point"] = np.repeat(block.ground["point"].to_numpy(), seen.shape[1])
    marks["image"] = block.images["image"].to_numpy()[seen.ravel() % count]
    doubts = plausibility_warnings(block.with_(marks=marks))
    assert not any("x and y exchanged" in doubt for doubt in doubts)
