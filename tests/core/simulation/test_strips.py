"""The perfect block: geometry by hand, points seen everywhere they can be seen."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.camera import Camera, project
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.simulation import CAMLIGHT, Dike

PINHOLE = Camera.from_table("pinhole", {"width": 5120, "height": 3840, "f": 5489.0})
STILL = {"attitude_jitter_deg": 0.0, "position_jitter": 0.0, "velocity_jitter": 0.0}


def poses(block):
    centre = block.images[["x", "y", "z"]].to_numpy()
    return centre, rotation_from_quaternion(block.images[["qw", "qx", "qy", "qz"]].to_numpy())


def places(block, table):
    return getattr(block, table).set_index("point")[["x", "y", "z"]]


@pytest.fixture(scope="module")
def block():
    return corridor_block(seed=3)


@pytest.mark.parametrize(
    ("observations", "points"), [("tie_points", "points"), ("marks", "ground")]
)
def test_every_observation_is_the_projection_of_its_point(block, observations, points):
    rows = getattr(block, observations)
    point = places(block, points).loc[rows["point"].astype(str)].to_numpy()
    image = block.image_rows(observations)
    centre, rotation = poses(block)
    modelled = project(point, centre[image], rotation[image], CAMLIGHT.interior)
    # A dozen float64 operations on numbers up to 5120.
    assert np.abs(modelled - rows[["x", "y"]].to_numpy()).max() < 1e-11


@pytest.mark.parametrize("long_side", ["across", "along"])
def test_a_point_is_seen_in_every_image_that_contains_it(long_side):
    """Without distortion: a polynomial would fold points far outside back into the picture."""
    block = corridor_block(
        images=24, strips=2, height=[30.0, 70.0], long_side=long_side, camera=PINHOLE, seed=4
    )
    point = places(block, "points").to_numpy()
    contained = 0
    for centre, rotation in zip(*poses(block), strict=True):
        x, y = project(point, centre, rotation, PINHOLE.interior).T
        contained += ((x >= 10) & (x <= 5109) & (y >= 10) & (y <= 3829)).sum()
    assert contained == len(block.tie_points)


def test_images_have_the_number_of_observations_asked_for(block):
    counts = np.bincount(block.image_rows("tie_points"), minlength=42)
    assert counts.mean() == pytest.approx(440, rel=0.01)
    # Drawn at random, so not steadier than a count of 440; nowhere half empty.
    assert counts.min() > 330


def test_thinning_keeps_the_multiplicity(block):
    """Thesis, section 5.6.4: the reduction lowers the number of tie points, not their rays."""

    def rays(made):
        return len(made.tie_points) / len(made.points)

    dense = corridor_block(seed=3, observations_per_image=4400)
    assert rays(block) == pytest.approx(rays(dense), rel=0.05)
    assert block.tie_points["point"].value_counts().min() == 2


def test_eighty_per_cent_forward_overlap_at_50_m_is_a_base_of_7_m():
    """0.2 x 3839 px / 5489 px x 50 m = 6.994 m between exposures, and 2.798 m/s at 2.5 s."""
    block = corridor_block(camera=PINHOLE, wind=0.0, **STILL)
    centre, _ = poses(block)
    assert np.linalg.norm(np.diff(centre[:14], axis=0), axis=1) == pytest.approx(6.994, abs=5e-4)
    assert np.diff(block.images["time_s"][:14]) == pytest.approx(2.5, abs=1e-6)
    assert block.images["vx"][:14].to_numpy() == pytest.approx(2.798, abs=5e-4)


def test_sixty_per_cent_side_overlap_at_50_m_is_18_65_m_between_strips():
    """0.4 x 5119 px / 5489 px x 50 m = 18.652 m."""
    block = corridor_block(camera=PINHOLE, **STILL)
    assert np.diff(block.images.groupby("strip")["y"].mean()) == pytest.approx(-18.652, abs=5e-4)


def test_rows_follow_each_other_along_the_flight_and_headings_turn():
    turned, kept = (corridor_block(turned=way, **STILL) for way in (True, False))
    for block, second in ((turned, -1.0), (kept, 1.0)):
        _, rotation = poses(block)
        # Picture's top (-y) towards the heading: east on the first strip.
        assert rotation[0, 1] == pytest.approx([-1, 0, 0], abs=1e-12)
        assert rotation[20, 1] == pytest.approx([-second, 0, 0], abs=1e-12)
        assert rotation[:, 2] == pytest.approx(np.tile([0, 0, -1.0], (42, 1)), abs=1e-12)
        assert block.images["vx"][0] > 0 > block.images["vx"][20]


def test_azimuth_is_clockwise_from_north():
    block = corridor_block(azimuth_deg=0.0, **STILL)
    assert np.ptp(block.images["y"]) > 85
    assert block.images["vy"][0] > 0
    # Strips are counted from left to right, and north has the west on its left.
    assert block.images["x"].iloc[0] < block.images["x"].iloc[-1]


def test_images_are_where_their_velocity_took_them(block):
    images = block.images[block.images["strip"] == "2"]
    speed = -images["vx"].mean()
    travelled = np.ptp(images["x"])
    # 0.3 m of jitter at either end, 0.1 m/s of velocity jitter on 14 images.
    assert speed * np.ptp(images["time_s"]) == pytest.approx(travelled, abs=3.0)


def test_antennas_sit_at_the_end_of_the_lever_arm(block):
    centre, rotation = poses(block)
    arm = rotation @ (block.gnss[["x", "y", "z"]].to_numpy() - centre)[:, :, None]
    assert arm[:, :, 0] == pytest.approx(np.tile([0.10, -0.05, 0.35], (42, 1)), abs=1e-12)
    assert block.lever_arm == {"F1": (0.10, -0.05, 0.35)}


def test_without_gnss_there_are_no_antennas():
    block = corridor_block(images=6, strips=1, gnss=False)
    assert not len(block.gnss) and not block.lever_arm


def test_control_takes_the_ends_and_banks_alternate(block):
    ground = block.ground
    assert ground["role"].iloc[[0, -1]].tolist() == ["control", "control"]
    assert ground["role"].value_counts().to_dict() == {"control": 5, "check": 6}
    assert (np.sign(ground["y"]) == [-1.0, 1.0] * 5 + [-1.0]).all() or (
        np.sign(ground["y"]) == [1.0, -1.0] * 5 + [1.0]
    ).all()
    assert block.marks["point"].nunique() == 11


def test_start_errors_have_the_size_asked_for_and_change_no_measurement(block):
    wrong = corridor_block(seed=3, start_error=(0.5, 0.01, 1.0))
    for table in ("tie_points", "marks", "ground", "gnss"):
        assert getattr(wrong, table).equals(getattr(block, table)), table
    centre, rotation = (b - a for a, b in zip(poses(block), poses(wrong), strict=True))
    point = (places(wrong, "points") - places(block, "points")).to_numpy()
    # 126 numbers: their standard deviation is known to 6 %; four times that.
    assert centre.std() == pytest.approx(0.5, rel=0.25)
    # Two thirds of the square of a small turn's nine elements: 2 sigma^2 a row.
    assert np.sqrt((rotation**2).sum((1, 2)).mean() / 2 / 3) == pytest.approx(0.01, rel=0.25)
    assert point.std() == pytest.approx(1.0, rel=0.05)


def test_one_seed_gives_one_block_and_another_seed_another(block):
    again, other = corridor_block(seed=3), corridor_block(seed=5)
    for table in ("images", "tie_points", "points", "marks", "ground", "gnss"):
        assert getattr(again, table).equals(getattr(block, table)), table
    assert not np.allclose(poses(other)[0], poses(block)[0])


def test_flights_share_the_strips_and_lie_apart_in_time():
    images = corridor_block(flights=2).images
    strips = images.groupby("flight")["strip"].unique().map(list).to_dict()
    assert strips == {"F1": ["1", "2"], "F2": ["3"]}
    start = images.groupby("flight")["time_s"].agg(["min", "max"])
    assert start["min"]["F2"] - start["max"]["F1"] == pytest.approx(900)


def test_strips_of_two_heights_are_equally_long():
    block = corridor_block(images=27, strips=2, height=[30.0, 70.0], **STILL)
    length = block.images.groupby("strip")["x"].agg(np.ptp)
    assert length["1"] == pytest.approx(length["2"])
    assert block.images.groupby("strip")["z"].mean().tolist() == pytest.approx([30.0, 70.0])


def test_the_block_passes_its_own_check_and_survives_the_folder(block, tmp_path):
    block.write(tmp_path / "made")
    read = corridor.read(tmp_path / "made")
    for table in ("images", "tie_points", "points", "marks", "ground", "gnss"):
        assert getattr(read, table).equals(getattr(block, table)), table


def test_ground_without_relief_is_a_plane():
    height = Dike(relief=0.0, level=7.0).height(np.arange(5.0), np.arange(5.0))
    assert height.tolist() == [7.0] * 5


def test_the_crest_stands_the_relief_above_the_plain():
    dike = Dike(relief=3.0, level=100.0, seed=1)
    along = np.linspace(0, 5000, 20001)
    # Roughness averages out along 5 km; its RMS is a twelfth of the relief by definition.
    assert dike.height(along, 0.0).mean() == pytest.approx(103.0, abs=0.1)
    assert dike.height(along, 25.0).mean() == pytest.approx(100.0, abs=0.1)
    assert dike.height(along, 0.0).std() == pytest.approx(0.25, rel=0.2)


@pytest.mark.parametrize("relief", [-4.0, 0.0, 3.0])
def test_the_ground_keeps_within_its_bounds(relief):
    dike = Dike(relief, 10.0, seed=2, roughness=0.3)
    along, across = np.random.default_rng(1).uniform(-200, 200, (2, 50_000))
    height, (low, high) = dike.height(along, across), dike.bounds
    assert low <= height.min() < height.max() <= high
    # Berm and water are a quarter of the relief below; waves add up to twice their RMS or more.
    assert high - low < 1.25 * abs(relief) + 2 * 0.3 * np.sqrt(2 * 24)


def test_the_section_of_the_dike_by_its_corners():
    """Relief 3 m: crest to 2.1 m on either side, berm of 1.2 m at 6.6 to 10.8 m, plain at 14.4."""
    dike = Dike(3.0, 100.0, roughness=0.0)
    across = np.array([-27.0, -11.4, -2.1, 0.0, 2.1, 6.6, 10.8, 14.4, 27.0])
    height = [99.25, 99.25, 103.0, 103.0, 103.0, 101.2, 101.2, 100.0, 100.0]
    assert dike.height(0.0, across) == pytest.approx(height, abs=1e-12)


def test_roughness_is_the_rms_of_its_waves_and_needs_no_relief():
    along, across = np.random.default_rng(1).uniform(-20_000, 20_000, (2, 50_000))
    assert Dike(0.0, roughness=0.5).height(along, across).std() == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"forward": 1.0}, "overlap forward = 1 "),
        ({"side": -0.1}, "overlap side = -0.1 "),
        ({"strips": 1, "forward": 0.4}, "sees points only once"),
        ({"height": -50.0}, "height"),
        ({"height": [50.0, 60.0]}, "each of 3 strips"),
        ({"images": 5}, "at least 2 images a strip"),
        ({"images": 10**7}, "shorter corridor"),
        ({"flights": 4}, "cannot be shared out"),
        ({"long_side": "up"}, "long_side"),
        ({"wind": 9.0}, "stops a drone"),
        ({"interval_s": 0.0}, "interval_s"),
        ({"observations_per_image": 0}, "tie_points: per_image = 0"),
        ({"control": -1}, "control"),
        ({"camera": CAMLIGHT.with_values(k1=-2.0)}, "folds inside the picture"),
    ],
)
def test_a_flight_that_cannot_be_is_refused_in_one_sentence(wrong, says):
    with pytest.raises(InputError, match=says) as refused:
        corridor_block(**wrong)
    assert "\n" not in str(refused.value)


# --- the shipped block -----------------------------------------------------------------------

SHIPPED = Path(__file__).parents[3] / "data_synthetic"


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("make", SHIPPED / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_makes_the_shipped_block_byte_for_byte(make, tmp_path):
    make.write(tmp_path)
    made = {p.relative_to(tmp_path): p for p in tmp_path.rglob("*") if p.is_file()}
    shipped = {p.relative_to(SHIPPED) for p in (SHIPPED / "dike").iterdir()}
    assert set(made) == shipped | {Path("dike.truth.json"), Path("dike_track.csv")}
    for name, path in made.items():
        assert path.read_bytes() == (SHIPPED / name).read_bytes(), name


def test_the_shipped_block_is_small_and_does_not_hold_its_truth():
    files = list((SHIPPED / "dike").iterdir())
    assert sum(path.stat().st_size for path in files) < 1_000_000
    assert not any("truth" in path.name for path in files)


def test_the_shipped_block_differs_from_its_truth_by_the_noise_it_states():
    block = corridor.read(SHIPPED / "dike")
    truth = json.loads((SHIPPED / "dike.truth.json").read_text(encoding="utf-8"))
    camera = Camera.from_table("camlight", truth["camera"]["camlight"])
    centre = np.array([truth["centre"][name] for name in block.images["image"]])
    rotation = rotation_from_quaternion(
        np.array([truth["quaternion"][name] for name in block.images["image"]])
    )
    arm = np.array([truth["lever_arm"][name] for name in block.images["flight"]])
    for table, places_ in (("tie_points", "points"), ("marks", "ground")):
        rows = getattr(block, table)
        point = np.array([truth[places_][name] for name in rows["point"].astype(str)])
        image = block.image_rows(table)
        seen = project(point, centre[image], rotation[image], camera.interior)
        noise = (rows[["x", "y"]].to_numpy() - seen).std()
        # Four standard errors of a standard deviation.
        assert noise == pytest.approx(0.4, rel=4 / np.sqrt(4 * len(rows)))
    off = block.gnss[["x", "y", "z"]].to_numpy() - centre - np.einsum("nij,ni->nj", rotation, arm)
    assert off.std(axis=0) == pytest.approx([0.02, 0.02, 0.04], rel=4 / np.sqrt(2 * 42))
    assert block.sigma["tie_px"] == block.sigma["mark_px"] == 0.4
