"""Each effect by hand: size, sign and direction of what it moves."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hovering import (
    BOTTOM,
    HEIGHT,
    LEFT,
    LINES,
    RIGHT,
    SPOTS,
    TOP,
    WIDTH,
    F,
    context,
    hovering,
    seen,
)
from strips import corridor_block

from corridor.core.camera import INTERIOR
from corridor.core.effects import Images, find, predict
from corridor.core.effects.context import Context


def shutter(block, readout):
    return seen(block, rolling_shutter={"readout": readout})


class TestRollingShutterOfAFlyingCamera:
    """10 m/s and 30 ms: 0.15 m in half a readout, which is f 0.15 / 50 = 15 px."""

    def test_without_the_effect_the_points_are_where_they_were_put(self):
        assert seen(hovering()) == pytest.approx(np.array(SPOTS, float), abs=1e-9)

    @pytest.mark.parametrize(
        "direction, velocity, first, last, move",
        [
            # Flying east the ground runs to the left: x falls in what is read last.
            ("down", (10, 0, 0), TOP, BOTTOM, (-15, 0)),
            ("up", (10, 0, 0), BOTTOM, TOP, (-15, 0)),
            # Flying south (down in the picture) the ground runs up: y falls.
            ("right", (0, -10, 0), LEFT, RIGHT, (0, -15)),
            ("left", (0, -10, 0), RIGHT, LEFT, (0, -15)),
            # Flying west, the other way.
            ("down", (-10, 0, 0), TOP, BOTTOM, (15, 0)),
        ],
    )
    def test_the_last_row_sees_the_ground_from_further_on(
        self, direction, velocity, first, last, move
    ):
        moved = shutter(hovering(velocity, row_direction=direction), 0.030) - np.array(SPOTS)
        assert moved[SPOTS.index(last)] == pytest.approx(move, abs=1e-9)
        assert moved[SPOTS.index(first)] == pytest.approx(np.negative(move), abs=1e-9)
        assert moved[0] == pytest.approx([0, 0], abs=1e-9)

    def test_flying_along_the_rows_order_the_row_is_the_one_that_is_modelled(self):
        """y' = y - f v tau(y') / h is solved by y / (1 + f v readout / (h (L - 1))).

        f v readout / h = 30 px over 3000 rows: a point 1500 px down stays 1500 / 1.01.
        With the row of the unmoved point it would be 1485 px, 0.149 px off.
        """
        moved = shutter(hovering((0, -10, 0)), 0.030)
        assert moved[2] == pytest.approx([0, 1500 / 1.01], abs=1e-9)
        assert moved[1] == pytest.approx([0, -1500 / 1.01], abs=1e-9)
        # Against the order of the rows the picture is stretched.
        moved = shutter(hovering((0, -10, 0), row_direction="up"), 0.030)
        assert moved[2] == pytest.approx([0, 1500 / 0.99], abs=1e-9)

    def test_climbing_makes_the_ground_shrink_in_the_last_row(self):
        """5 m/s up: 0.075 m higher in the last row, scale 50 / 50.075 there."""
        moved = shutter(hovering((0, 0, 5)), 0.030)
        # y' (h + v readout y' / (L - 1)) = y h, the positive root.
        a, b, c = 5 * 0.030 / 3000, HEIGHT, -1500 * HEIGHT
        root = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
        assert moved[2] == pytest.approx([0, root], abs=1e-9)
        assert root < 1500

    def test_twice_the_readout_is_twice_the_move(self):
        block = hovering((10, 0, 0))
        once, twice = shutter(block, 0.030), shutter(block, 0.060)
        assert twice - SPOTS == pytest.approx(2 * (once - SPOTS), abs=1e-9)


class TestRollingShutterOfATurningCamera:
    """Angular rate in the camera frame, right-handed: R_camera_to_world(t) = R' Exp(w t)."""

    def solve(self, equation):
        """Fixed point by bisection on -2000..2000 px."""
        low, high = -2000.0, 2000.0
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if equation(middle) > middle else (low, middle)
        return (low + high) / 2

    def test_about_x_the_axis_rises_and_the_scene_sinks(self):
        """+x takes y to z and z to -y: the axis turns to the picture's top, points go down.

        v' = tan(atan(v) + w tau): 2 rad/s for 30 ms.
        """
        moved = shutter(hovering(rate=(2.0, 0, 0)), 0.030)
        by_hand = self.solve(lambda y: F * np.tan(np.arctan(0.3) + 0.06 * y / (LINES - 1)))
        assert by_hand > 1500
        assert moved[2] == pytest.approx([0, by_hand], abs=1e-9)

    def test_about_y_the_axis_turns_right_and_the_scene_goes_left(self):
        """+y takes z to x. Rows to the right: u' = tan(atan(u) - w tau)."""
        moved = shutter(hovering(rate=(0, 2.0, 0), row_direction="right"), 0.030)
        by_hand = self.solve(lambda x: F * np.tan(np.arctan(0.4) - 0.06 * x / (WIDTH - 1)))
        assert by_hand < 2000
        assert moved[4] == pytest.approx([by_hand, 0], abs=1e-9)

    def test_about_z_the_camera_turns_with_the_clock_and_the_scene_against_it(self):
        """+z takes x (right) to y (down), so the scene turns against the clock.

        By 30 mrad in the last row and by -30 mrad in the first: both move 45 px to the right.
        """
        moved = shutter(hovering(rate=(0, 0, 2.0)), 0.030)
        angle = 0.06 * moved[2, 1] / (LINES - 1)
        assert moved[2] == pytest.approx([1500 * np.sin(angle), 1500 * np.cos(angle)], abs=1e-9)
        assert moved[2, 0] == pytest.approx(45, abs=0.1)
        assert moved[1, 0] == pytest.approx(45, abs=0.1)

    def test_a_rotation_an_image_is_the_angular_rate_times_the_readout(self):
        rate = np.array([0.4, -0.7, 1.1])
        turning = shutter(hovering(rate=rate), 0.030)
        angles = dict(zip("xyz", rate * 0.030, strict=True))
        assert seen(hovering(), rolling_shutter_rotation=angles) == pytest.approx(turning, abs=1e-9)

    def test_flying_and_turning_are_done_in_that_order(self):
        """X = Exp(-w tau) R (P - C - v tau), row by row."""
        velocity, w = np.array([6.0, -8.0, 1.0]), np.array([0.0, 0.0, 1.5])
        moved = shutter(hovering(velocity, rate=w), 0.040)
        for (dx, dy), at in zip(SPOTS, moved, strict=True):
            tau = 0.040 * at[1] / (LINES - 1)
            away = np.array([dx, -dy, 0]) * [HEIGHT / F, HEIGHT / F, 1] - [0, 0, HEIGHT]
            east, north, up = away - velocity * tau
            x, y, z = east, -north, -up
            c, s = np.cos(1.5 * tau), np.sin(1.5 * tau)
            assert at == pytest.approx([F * (c * x + s * y) / z, F * (c * y - s * x) / z], abs=1e-9)


class TestGnss:
    def test_camera_delay_of_17_ms_at_7_m_s_is_12_cm(self):
        """rtklibexplorer/RTKLIB issue 71, the user's own arithmetic."""
        shift, _ = find("clock_offset").shift(context(hovering((7, 0, 0))), np.array([[0.017]]))
        assert np.linalg.norm(shift, axis=1) == pytest.approx(0.12, abs=0.005)

    def test_a_camera_clock_that_is_late_leaves_the_measured_antenna_behind(self):
        """True time = time_s + offset: at the stated time the antenna was not there yet."""
        block = hovering((7, -3, 0))
        there = predict(block, {"clock_offset": {"offset": 0.1}}).gnss
        assert there - predict(block).gnss == pytest.approx(np.array([[-0.7, 0.3, 0]]), abs=1e-12)

    def test_a_bias_is_measured_minus_true(self):
        block = hovering()
        there = predict(block, {"gnss_bias": {"x": 0.1, "z": -0.2}}).gnss
        assert there[0] == pytest.approx([0.1, 0.0, HEIGHT - 0.2], abs=1e-12)

    def test_an_arm_to_the_right_above_and_in_front_of_a_camera_that_looks_down(self):
        """P = C + R' a (thesis eq. 5.2 with theta = -a): right is east, up in the picture north,
        forward is down."""
        block = hovering()
        there = predict(block, {"lever_arm": {"x": 0.10, "y": -0.05, "z": 0.35}}).gnss
        assert there[0] == pytest.approx([0.10, 0.05, HEIGHT - 0.35], abs=1e-12)

    def test_an_arm_turns_with_the_camera(self):
        """A camera that looks up, right to the south and down to the east of its picture."""
        half = np.sqrt(0.5)
        block = hovering(qw=half, qx=0.0, qy=0.0, qz=half)
        right, down, ahead = Images.of(block).rotation[0]
        assert right == pytest.approx([0, -1, 0], abs=1e-15)
        assert down == pytest.approx([1, 0, 0], abs=1e-15)
        assert ahead == pytest.approx([0, 0, 1], abs=1e-15)
        there = predict(block, {"lever_arm": {"x": 0.10, "y": -0.05, "z": 0.35}}).gnss
        assert there[0] == pytest.approx([-0.05, -0.10, HEIGHT + 0.35], abs=1e-12)

    def test_an_arm_that_is_an_effect_is_the_same_arm_as_a_stated_one(self):
        block = corridor_block(images=8, strips=2, flights=2, observations_per_image=30)
        block.lever_arm = {"F1": (0.1, -0.2, 0.3), "F2": (-0.4, 0.0, 0.2)}
        stated = predict(block).gnss
        block.lever_arm = {}
        arms = {"x": {"F1": 0.1, "F2": -0.4}, "y": {"F1": -0.2}, "z": {"F1": 0.3, "F2": 0.2}}
        assert predict(block, {"lever_arm_per_flight": arms}).gnss == pytest.approx(
            stated, abs=1e-12
        )

    def test_the_effect_is_added_to_the_stated_arm(self):
        block = hovering()
        block.lever_arm = {"default": (0.5, 0.0, 0.0)}
        there = predict(block, {"lever_arm": {"x": 0.02}}).gnss
        assert there[0] == pytest.approx([0.52, 0, HEIGHT], abs=1e-12)


class TestDrifts:
    @staticmethod
    def line(interval, count=41):
        """Images at equal intervals from one place; the last shows the points."""
        block = hovering()
        one = block.images.iloc[0].to_dict()
        rows = [one | {"image": f"i{k}", "time_s": 1e6 + interval * k} for k in range(count)]
        tie_points = block.tie_points.assign(image=rows[-1]["image"])
        return replace(
            block, images=pd.DataFrame(rows), tie_points=tie_points, marks=None, gnss=None
        )

    def test_the_thesis_drift_of_0_0275_px_an_image(self):
        """Thesis table 4.2; with 2.5 s from image to image it is 0.011 px/s."""
        values = np.array([[0.0275 / 2.5, 0.0]])
        shift, _ = find("focal_drift").shift(context(self.line(2.5)), values)
        f = shift[:, INTERIOR.index("f")]
        assert np.diff(f) == pytest.approx(np.full(40, 0.0275), abs=1e-9)
        assert f[20] == 0.0  # zero in the middle of the block's time
        assert not np.delete(shift, INTERIOR.index("f"), axis=1).any()

    def test_the_bend_is_the_coefficient_of_t_squared(self):
        shift, _ = find("focal_drift").shift(context(self.line(2.0)), np.array([[0.0, 0.003]]))
        # 40 s from the middle: 0.003 * 1600
        assert shift[[0, 20, 40], INTERIOR.index("f")] == pytest.approx([4.8, 0, 4.8], abs=1e-9)

    def test_a_longer_focal_length_moves_points_outward(self):
        """10 s after the middle, 0.1 px/s: f + 1, an edge 1500 / 5000 out moves 0.3 px."""
        block = self.line(10.0, count=3)
        moved = seen(block, focal_drift={"rate": 0.1}) - seen(block)
        assert moved[2] == pytest.approx([0, 0.3], abs=1e-9)
        assert moved[3] == pytest.approx([-0.4, 0], abs=1e-9)

    def test_the_principal_point_moves_all_points_alike(self):
        block = self.line(10.0, count=3)
        moved = seen(block, principal_point_drift={"x_rate": 0.1, "y_rate": -0.05}) - seen(block)
        assert moved == pytest.approx(np.tile([1.0, -0.5], (5, 1)), abs=1e-9)


def test_a_boresight_that_drifts_is_right_in_the_middle_of_each_flight():
    """1 mrad a minute; the second flight begins a quarter of an hour later, and not 15 mrad off."""
    block = corridor_block(16, 2)
    time = np.tile(10.0 * np.arange(8), 2) + np.repeat([0.0, 900.0], 8)
    block.images = block.images.assign(time_s=time, flight=np.repeat(["F1", "F2"], 8))
    block = block.with_()
    images = Images.of(block)
    drift = find("boresight_drift")
    turned = drift.derivative(Context(images, np.arange(16)))[:, 0, 0] * 1e-3 / 60
    assert turned == pytest.approx(np.tile((np.arange(8) - 3.5) / 6000, 2), abs=1e-12)
