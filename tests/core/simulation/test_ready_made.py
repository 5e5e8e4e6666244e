"""The plans that come with corridor, against the tables they were taken from."""

import time

import numpy as np
import pandas as pd
import pytest

from corridor.core.geometry import rotation_from_quaternion
from corridor.core.simulation import perfect_block, read_plan, ready_made, simulate

# Zhou 2019: images (tables 4.1, 5.1, 6.11 and 7.2), strips, heights, length flown in metres.
PUBLISHED = {
    "thesis_50vt": (42, 3, {50.0}),
    "thesis_50ob": (44, 3, {50.0}),
    "thesis_3070vt": (27, 2, {30.0, 70.0}),
    "thesis_s1_n50": (395, 3, {50.0}),
    "thesis_s2_n50": (315, 3, {50.0}),
    "thesis_s2_o50": (323, 3, {50.0}),
    "thesis_s2_n3070": (200, 2, {30.0, 70.0}),
    "thesis_road": (77, 2, {70.0}),
    "thesis_viabon_n30": (443, None, {30.0}),
    "thesis_viabon_o60": (125, None, {60.0}),
    "thesis_viabon_n90": (80, None, {90.0}),
    "thesis_viabon_n40": (136, 2, {40.0}),
}
CHAPTER_5 = ("thesis_s1_n50", "thesis_s2_n50", "thesis_s2_o50", "thesis_s2_n3070")
VIABON = ("thesis_viabon_n30", "thesis_viabon_o60", "thesis_viabon_n90")


def test_every_plan_that_comes_with_corridor_is_checked_here():
    assert set(ready_made()) == set(PUBLISHED)


@pytest.fixture(scope="module", params=PUBLISHED)
def flown(request):
    plan = read_plan(request.param)
    return plan, perfect_block(plan, 1)


def test_a_flight_has_the_published_number_of_images_and_its_heights(flown):
    plan, block = flown
    images, strips, heights = PUBLISHED[plan.name]
    assert len(block.images) == images
    assert strips is None or block.images["strip"].nunique() == strips
    (flight,) = plan.flights
    assert set(flight.heights) == heights
    # Position jitter of 0.3 m, four standard errors of a mean.
    for height, (_, rows) in zip(flight.heights, block.images.groupby("strip"), strict=True):
        assert rows["z"].mean() == pytest.approx(height, abs=4 * 0.3 / np.sqrt(len(rows)))


def test_a_block_can_be_adjusted_as_it_is(flown):
    plan, block = flown
    block.check()
    # Every image sees enough for a pose of its own, and most points tie more than two.
    seen = pd.concat([block.tie_points["image"], block.marks["image"]]).value_counts()
    assert seen.min() > 50
    assert len(block.tie_points) / len(block.points) > 3
    # Ground control is seen, and enough of it to lay the block on.
    seen = block.marks["point"].astype(str).value_counts()
    control = block.ground.loc[block.ground["role"] == "control", "point"]
    assert (seen.reindex(control).fillna(0) >= 2).sum() >= 3


def test_pictures_look_the_way_they_are_said_to(flown):
    plan, block = flown
    (flight,) = plan.flights
    rotation = rotation_from_quaternion(block.images[["qw", "qx", "qy", "qz"]].to_numpy())
    mean = np.degrees(np.arccos(np.mean(-rotation[:, 2, 2])))
    # A jitter of 1.5 degrees in roll and pitch lowers the mean cosine by its square.
    assert mean == pytest.approx(flight.tilt_deg, abs=3.0)


def test_neighbours_overlap_as_the_flight_is_meant_to(flown):
    """Points on the axis are seen in several images: half an overlap of 75 % is four."""
    plan, block = flown
    rays = block.tie_points["point"].value_counts()
    assert rays.median() >= 3


@pytest.mark.parametrize("name", ["thesis_50vt", "thesis_50ob", "thesis_3070vt"])
def test_chapter_4_flies_about_a_hundred_metres_at_three_metres_a_second(name):
    """13 to 15 images a strip, 3 m/s, 2.5 s (issue 3); no time passes between strips."""
    block = perfect_block(read_plan(name), 1)
    for _, rows in block.images.groupby("strip"):
        assert 13 <= len(rows) <= 15
        assert np.ptp(rows["y"]) == pytest.approx(100, abs=11)
    # A velocity jitter of 0.1 m/s.
    assert np.hypot(block.images["vx"], block.images["vy"]).mean() == pytest.approx(3.0, abs=0.05)
    assert np.diff(block.images["time_s"]) == pytest.approx(2.5, abs=1e-6)


@pytest.mark.parametrize("name", CHAPTER_5)
def test_chapter_5_flies_600_metres(name):
    assert read_plan(name).axis.length == pytest.approx(600, rel=0.02)


def test_the_second_session_of_chapter_5_flies_round_a_bend_and_the_first_does_not():
    def turn(name):
        _, tangent = read_plan(name).axis.at([0.0, 1e4])
        return np.degrees(np.arccos(np.clip(tangent[0] @ tangent[1], -1, 1)))

    assert turn("thesis_s1_n50") == 0
    assert {round(turn(name)) for name in CHAPTER_5[1:]} == {47}


def test_the_road_is_500_m_long_and_its_camera_warms_as_published():
    """Table 6.11: 22.7 to 28.8 degrees in 15 minutes."""
    plan = read_plan("thesis_road")
    assert plan.axis.length == 500
    images = perfect_block(plan, 1).images
    assert images["temperature_c"].iloc[0] == 22.7
    at_the_end = np.interp(900, images["time_s"], images["temperature_c"])
    assert at_the_end == pytest.approx(28.8, abs=0.3)


@pytest.mark.parametrize("name", VIABON)
def test_viabon_covers_150_by_200_metres(name):
    images = perfect_block(read_plan(name), 1).images
    # Centres and half a picture; the published area is what the pictures show together.
    assert np.ptp(images["y"]) == pytest.approx(200, abs=5)
    assert np.ptp(images["x"]) == pytest.approx(150, rel=0.2)


def test_the_mavics_pixel_is_a_centimetre_at_40_m():
    """Table 7.2 gives 0.96 cm; 40 m / 4260 px is 0.94, and the ground is rough by 0.5 m."""
    assert perfect_block(read_plan("thesis_viabon_n40"), 1).summary().gsd_m == pytest.approx(
        0.0096, rel=0.04
    )


def test_the_camlights_pixel_is_nine_millimetres_at_50_m():
    """50 m / 5489 px = 9.1 mm on the plain; the dike is up to 3 m nearer."""
    gsd = perfect_block(read_plan("thesis_50vt"), 1).summary().gsd_m
    assert 47 / 5489 < gsd < 50.5 / 5489


def test_the_segment_of_chapter_5_has_838_images_and_some_300_000_observations():
    """Issue 3: 315 + 323 + 200 images, in under 20 s."""
    began = time.process_time()
    block = simulate("thesis_s2_n50+thesis_s2_o50+thesis_s2_n3070")
    assert time.process_time() - began < 20
    assert len(block.images) == 838
    assert len(block.tie_points) == pytest.approx(300_000, rel=0.25)
    assert block.flight_names == ["s2-n50", "s2-o50", "s2-n3070"]
