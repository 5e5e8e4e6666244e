"""Effects on GNSS and ground control by hand: size, sign and direction."""

import numpy as np
import pandas as pd
import pytest
from hovering import HEIGHT, NADIR, context, hovering
from strips import corridor_block

from corridor.core.effects import Context, Images, add, find, predict, take_out


def surveyed(*places):
    """A context of ground control at places (x, y, z), below a camera at the origin of plan."""
    names = [f"P{k}" for k in range(len(places))]
    return Context(Images.of(hovering()), point=names, position=np.array(places, float))


def shift(slug, values, *places):
    return find(slug).shift(surveyed(*places), np.atleast_2d(values))[0]


class TestEarthCurvature:
    def test_600_m_from_the_middle_it_is_28_mm(self):
        """d^2 / 2R = 360,000 / 12,742,000 m."""
        up = shift("earth_curvature", [1.0], (600, 0, 0), (0, -600, 5), (360, 480, 0))
        assert up == pytest.approx(np.array([[0, 0, 0.02825]] * 3), abs=1e-5)

    def test_the_given_height_of_a_level_far_point_lies_above_the_plane(self):
        """A sphere of 6371 km: level with the middle, the point is below the tangent plane."""
        angle = 5000.0 / 6.371e6
        below = 6.371e6 * (1 - np.cos(angle))
        assert shift("earth_curvature", [1.0], (5000, 0, 0))[0, 2] == pytest.approx(below, rel=1e-6)

    def test_ten_times_as_far_is_a_hundred_times_as_much_and_the_middle_nothing(self):
        up = shift("earth_curvature", [1.0], (0, 0, 0), (100, 0, 0), (1000, 0, 0))[:, 2]
        assert up[0] == 0.0
        assert up[2] == pytest.approx(100 * up[1])


def test_a_geoid_that_rises_5_cm_in_a_kilometre_to_the_north():
    """Above the middle of the images nothing; 500 m to the north of it 2.5 cm."""
    up = shift("control_tilt", [0.0, 5e-5], (0, 0, 9), (100, 500, 0), (100, -500, 0))
    assert up == pytest.approx(np.array([[0, 0, 0], [0, 0, 0.025], [0, 0, -0.025]]), abs=1e-12)


class TestControl:
    def test_a_blunder_is_given_minus_true_and_of_one_point_only(self):
        block = corridor_block(images=8, strips=2, observations_per_image=30, control=3, check=2)
        names = block.ground.query("role == 'control'")["point"].tolist()
        values = {"control_blunder": {"x": {names[1]: 0.05}, "z": {names[1]: -0.02}}}
        given = add(block, values).ground[["x", "y", "z"]].to_numpy()
        off = given - block.ground[["x", "y", "z"]].to_numpy()
        row = block.ground["point"].tolist().index(names[1])
        assert off[row] == pytest.approx([0.05, 0, -0.02], abs=1e-12)
        assert not np.delete(off, row, axis=0).any()

    def test_a_datum_shifts_all_that_was_surveyed_together_check_points_too(self):
        """Given minus true; a base station with wrong coordinates spares no point."""
        block = corridor_block(images=8, strips=2, observations_per_image=30, control=3, check=2)
        moved = add(block, {"control_datum": {"x": 0.1, "y": -0.2, "z": 0.3}}).ground
        off = moved[["x", "y", "z"]].to_numpy() - block.ground[["x", "y", "z"]].to_numpy()
        assert off == pytest.approx(np.tile([0.1, -0.2, 0.3], (len(off), 1)), abs=1e-9)

    def test_taking_a_motion_out_starts_from_the_true_place(self):
        """A slope of 1 m in 60 m along the corridor: one step back would be 1.7 % wrong."""
        block = corridor_block(images=8, strips=2, observations_per_image=30, control=5, check=2)
        count = len(find("ground_motion").parameters(block))
        values = {"ground_motion": np.linspace(-1, 1, count)[None]}
        back = take_out(add(block, values), values)
        columns = ["x", "y", "z"]
        off = back.ground[columns].to_numpy() - block.ground[columns].to_numpy()
        assert np.abs(off).max() < 1e-9
        assert np.abs(add(block, values).ground["x"] - block.ground["x"]).max() > 0.1

    @pytest.mark.parametrize("azimuth", [0.0, 90.0, 200.0])
    def test_ground_motion_follows_the_corridor_wherever_it_heads(self, azimuth):
        """Two points abreast of each other move alike, two along it do not."""
        block = corridor_block(
            images=12, strips=2, observations_per_image=30, azimuth_deg=azimuth, position_jitter=0.0
        )
        images = Images.of(block)
        ahead = np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth)), 0.0])
        aside = np.array([ahead[1], -ahead[0], 0.0])
        places = images.middle + np.stack([0 * ahead, 8 * aside, 15 * ahead])
        look = Context(images, point=["a", "b", "c"], position=places)
        count = len(find("ground_motion").parameters(block))
        values = np.tile(np.random.default_rng(2).normal(0, 0.1, count), (3, 1))
        moved, _ = find("ground_motion").shift(look, values)
        assert moved[0] == pytest.approx(moved[1], abs=1e-9)
        assert np.abs(moved[0] - moved[2]).max() > 0.01


def flown_line(*places, seconds=None):
    """Images at places (x, y, z), straight down."""
    rows = [
        {"image": f"i{k}", "camera": "c", "time_s": float(k if seconds is None else seconds[k])}
        | dict(zip("xyz", map(float, place), strict=True))
        | NADIR
        for k, place in enumerate(places)
    ]
    block = hovering()
    block.images = pd.DataFrame(rows)
    return block


class TestGnss:
    def test_300_ppm_over_a_kilometre_is_30_cm(self):
        """Half of it at either end: the scale is about the middle of the block."""
        block = flown_line((0, 0, 50), (1000, 0, 50))
        moved, _ = find("gnss_scale").shift(context(block), np.full((2, 1), 300e-6))
        assert moved == pytest.approx(np.array([[-0.15, 0, 0], [0.15, 0, 0]]), abs=1e-12)

    def test_a_tenth_of_a_degree_over_a_kilometre_is_87_cm_at_either_end(self):
        """Towards the north at the eastern end: anticlockwise."""
        block = flown_line((0, 0, 50), (1000, 0, 50))
        moved, _ = find("gnss_rotation").shift(context(block), np.full((2, 1), np.radians(0.1)))
        assert moved == pytest.approx(np.array([[0, -0.873, 0], [0, 0.873, 0]]), abs=1e-3)

    def test_a_drift_of_10_cm_in_10_minutes_is_5_cm_on_either_side_of_the_middle(self):
        block = flown_line((0, 0, 50), (1, 0, 50), (2, 0, 50), seconds=[1000, 1300, 1600])
        rate = np.tile([0.0, 0.0, 0.1 / 600], (3, 1))
        moved, _ = find("gnss_drift").shift(context(block), rate)
        assert moved == pytest.approx(np.array([[0, 0, -0.05], [0, 0, 0], [0, 0, 0.05]]), abs=1e-12)

    def test_a_stamp_that_is_30_ms_early_at_8_m_s_leaves_the_antenna_24_cm_behind(self):
        """True time = time_s + offset, image by image: the clock's rule (issue 11: 30 ms)."""
        there = predict(hovering((8, 0, 0)), {"time_rounding": {"offset": 0.030}}).gnss
        assert there[0] == pytest.approx([-0.24, 0, HEIGHT], abs=1e-12)

    def test_arms_of_two_flights_are_arms_of_one_where_they_agree(self):
        block = corridor_block(images=8, strips=2, flights=2, observations_per_image=30)
        arm = {"x": 0.1, "y": -0.2, "z": 0.3}
        one, two = (predict(block, {s: arm}).gnss for s in ("lever_arm", "lever_arm_per_flight"))
        assert np.array_equal(one, two)

    def test_a_curve_of_one_flight_leaves_the_other_alone_and_has_no_constant(self):
        block = corridor_block(images=20, strips=2, flights=2, observations_per_image=30)
        out = predict(block, {"gnss_spline": {"y_2": {"F2": 0.1}}}).gnss - predict(block).gnss
        first = Images.of(block).flight == 0
        assert not out[first].any()
        assert out[~first, 1].any() and not out[:, [0, 2]].any()
        _, derivative = find("gnss_spline").shift(context(block), np.zeros((20, 15)))
        curves = derivative[first, 0, :5]
        assert np.linalg.matrix_rank(np.column_stack([curves, np.ones(first.sum())])) == 6
