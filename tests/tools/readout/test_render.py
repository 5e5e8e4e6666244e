"""Rendered photographs against closed form: where an edge is on each row, and how bright."""

import math
import time

import numpy as np
import pytest

from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.tools.readout import render

CAMERA = Camera.from_table("pinhole", {"width": 401, "height": 301, "f": 400.0})
VIEW = render.View(CAMERA, distance=1.0)


def edge_column(row_of_light, low, high):
    """Column at which a step from dark to bright lies: from the area under it."""
    share = (row_of_light - low) / (high - low)
    return len(row_of_light) - 0.5 - share.sum()


@pytest.mark.parametrize("direction", ["down", "up"])
@pytest.mark.parametrize("turns", [0.5, -0.5])
def test_an_edge_is_on_every_row_where_the_star_was_at_that_row_s_time(direction, turns):
    """An upright edge above the axis: x = -y tan(turned), t(row)."""
    readout = 0.04
    light = render.star(
        VIEW,
        render.Shutter(readout, row_direction=direction),
        turns,
        sectors=2,
        radius=5.0,
        hub=0.0,
        phase_deg=-90.0,
        white=1.0,
        black=0.0,
    )
    for row in (10, 60, 110):
        time_of_row = readout * (row / 300 - 0.5) * (1 if direction == "down" else -1)
        turned = 2 * math.pi * turns * time_of_row
        # Angles clockwise from x with y down: the edge points to -90 degrees + turned.
        expected = 200 + (150 - row) * math.tan(turned)
        assert edge_column(light[row], 0.0, 1.0) == pytest.approx(expected, abs=0.01)


def test_rows_may_be_columns():
    """`right` is `down` of the transposed scene, which turns the other way round."""
    square = Camera.from_table("square", {"width": 201, "height": 201, "f": 200.0})
    view = render.View(square, distance=1.0)
    down = render.star(view, render.Shutter(0.05, 0.002, "down"), 2.0, phase_deg=20.0, radius=0.4)
    right = render.star(
        view, render.Shutter(0.05, 0.002, "right"), -2.0, phase_deg=90 - 20 - 22.5, radius=0.4
    )
    assert np.abs(down - right.T).max() < 1e-9


def test_the_exposure_smears_an_edge_over_the_angle_it_turns_by():
    """A point on a circle brightens linearly while the edge passes: closed form of a box."""
    exposure, turns = 0.01, 1.0
    light = render.star(
        VIEW,
        render.Shutter(0.0, exposure),
        turns,
        sectors=2,
        radius=5.0,
        hub=0.0,
        white=1.0,
        black=0.0,
    )
    smear = 2 * math.pi * turns * exposure
    for angle in (-0.4 * smear, -0.2 * smear, 0.0, 0.3 * smear):
        column = 380
        row = 150 + 180 * math.tan(angle)
        low, share = int(math.floor(row)), row - math.floor(row)
        seen = (1 - share) * light[low, column] + share * light[low + 1, column]
        # The bright sector begins at angle 0: half of the exposure is bright on the edge.
        assert seen == pytest.approx(0.5 + angle / smear, abs=2e-3)


def test_a_spoke_is_a_straight_line_when_it_stands_and_its_light_is_its_width():
    """Sum of the light across an upright spoke: width in pixels times brightness."""
    light = render.wheel(
        VIEW,
        render.Shutter(0.03),
        0.0,
        spokes=1,
        crosses=0,
        radius=0.3,
        flange=0.0,
        spoke_width=0.004,
        valve=False,
        phase_deg=-90.0,
        spoke_light=1.0,
        background=0.0,
    )
    rows = light[70:120, 150:251]
    assert rows.sum(axis=1) == pytest.approx(0.004 * 400, abs=1e-6)
    assert (rows * np.arange(101)).sum(axis=1) / rows.sum(axis=1) == pytest.approx(50.0, abs=1e-6)


def test_exposure_moves_no_light_of_a_spoke_but_spreads_it():
    """The middle of a smeared spoke is where it is in the middle of its row's exposure.

    One pixel wide, so that its light under the pixels has its first moment on the spoke.
    """
    common = dict(spokes=1, crosses=0, flange=0.0, valve=False, phase_deg=-90.0, background=0.0)
    common["spoke_width"] = 1 / 400
    turns, readout = 0.4, 0.02
    sharp = render.wheel(VIEW, render.Shutter(readout), turns, **common)
    smeared = render.wheel(VIEW, render.Shutter(readout, 0.01), turns, **common)
    columns = np.arange(401)
    for row in (60, 90):
        one, two = sharp[row, 150:251], smeared[row, 150:251]
        assert two.sum() == pytest.approx(one.sum(), rel=2e-3)
        middle = [(part * columns[150:251]).sum() / part.sum() for part in (one, two)]
        assert middle[0] == pytest.approx(middle[1], abs=0.02)
        assert (two > 1e-6).sum() > (one > 1e-6).sum()


def test_neighbouring_spokes_reach_opposite_flanges_and_lean_in_turns():
    hub, rim, height = render.Wheel(36, 3, flange=0.03).lacing()
    assert list(height[:4]) == [0.03, -0.03, 0.03, -0.03]
    lean = (hub - rim + np.pi) % (2 * np.pi) - np.pi
    # Three crosses on a flange of 18 spokes: 3 x 20 degrees ahead or behind.
    assert np.degrees(np.abs(lean)) == pytest.approx(60.0)
    assert list(np.sign(lean[:4])) == [1, 1, -1, -1]


def test_led_stripes_repeat_with_the_period_of_the_light():
    """400 Hz, 50 ms over 501 rows: 25 rows a period; exposure of half a period and duty one half
    make a triangle from 0 to 1."""
    camera = Camera.from_table("led", {"width": 64, "height": 501, "f": 500.0})
    shutter = render.Shutter(0.05, 0.5 / 400)
    light = render.led(camera, shutter, 400.0, light=1.0, ambient=0.0)
    assert np.abs(light[:-25] - light[25:]).max() < 1e-9
    assert light.max() <= 1.0 and light.min() >= 0.0
    assert light.mean() == pytest.approx(0.5, abs=0.01)


def test_an_exposure_of_a_whole_period_leaves_no_stripes():
    camera = Camera.from_table("led", {"width": 64, "height": 300, "f": 500.0})
    light = render.led(camera, render.Shutter(0.05, 1 / 400), 400.0, light=1.0, ambient=0.0)
    assert np.ptp(light) < 1e-9


def test_distortion_bends_the_rim_as_the_camera_says():
    """The rim's point to the right of the axis is where the camera projects it."""
    from corridor.core.camera import project_rays

    camera = CAMERA.with_values(k1=-0.2)
    view = render.View(camera, distance=1.0)
    light = render.wheel(view, render.Shutter(0.0), spokes=1, radius=0.3, tyre=0.05, background=1.0)
    expected = project_rays(np.array([[0.35, 0.0]]), camera.interior)[0, 0]
    row = light[150, 300:]
    dark = np.flatnonzero(row < 0.5)
    assert 300 + dark[-1] == pytest.approx(expected, abs=1.0)


def test_development_is_the_srgb_curve():
    """IEC 61966-2-1: linear 0.2140 is 0.5 of the scale."""
    assert render.develop(np.array([[0.0, 0.21404, 1.0, 3.0]])).tolist() == [[0, 128, 255, 255]]


def test_a_teaching_frame_takes_less_than_a_tenth_of_a_second():
    """Processor time, so that a busy machine does not count; the fastest of a few."""
    camera = Camera.from_table("lesson", {"width": 640, "height": 480, "f": 600.0})
    view = render.View(camera, distance=1.0)

    def frame(k):
        light = render.wheel(view, render.Shutter(0.05, 0.002), 2.0, phase_deg=10.0 * k)
        return render.develop(light, noise=0.01, seed=k)

    frame(0)
    taken = []
    for k in range(5):
        start = time.process_time()
        frame(k)
        taken.append(time.process_time() - start)
    assert min(taken) < 0.1


@pytest.mark.parametrize(
    "wrong", [dict(readout_s=-0.1), dict(readout_s=0.1, row_direction="sideways")]
)
def test_a_shutter_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError):
        render.Shutter(**wrong)


def test_a_star_has_an_even_number_of_sectors():
    with pytest.raises(InputError, match="even"):
        render.star(VIEW, render.Shutter(0.01), sectors=15)
