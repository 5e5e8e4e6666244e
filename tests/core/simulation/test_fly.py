"""Where the camera is at each exposure, and which way it looks: by hand, on quiet air."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from corridor.core.camera import Camera
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.simulation import Flight, Plan, Terrain, read_plan
from corridor.core.simulation.fly import fly

PINHOLE = Camera.from_table("pinhole", {"width": 5120, "height": 3840, "f": 5489.0})
STILL = {
    "attitude_jitter_deg": 0.0,
    "position_jitter_m": 0.0,
    "velocity_jitter_m_s": 0.0,
    "angular_rate_deg_s": 0.0,
}
NORTH = ((0.0, 0.0), (0.0, 200.0))
BEND = ((0.0, 0.0), (0.0, 250.0), (200.0, 400.0))


def flown(axis=NORTH, seed=0, **flight):
    """A flight at 50 m over a corridor that leads north, without any jitter unless asked for."""
    flight = {"name": "a", "camera": "pinhole", "height_m": 50.0} | STILL | flight
    return fly(Plan("p", (Flight(**flight),), axis, cameras={"pinhole": PINHOLE}), seed)


def column(made, *names):
    return made.table[list(names)].to_numpy()


def strips(made):
    """Rows of each strip."""
    return [rows.index.to_numpy() for _, rows in made.table.groupby("strip", sort=False)]


def headings(made):
    """Unit vectors (m, 3) along which the images of a strip follow each other."""
    out = np.empty_like(made.centre)
    for rows in strips(made):
        step = np.gradient(made.centre[rows], axis=0) * [1, 1, 0]
        out[rows] = step / np.linalg.norm(step, axis=1)[:, None]
    return out


# --- how far apart ---------------------------------------------------------------------------


def bases(made):
    return [np.linalg.norm(np.diff(made.centre[rows], axis=0), axis=1) for rows in strips(made)]


def test_three_metres_a_second_every_two_and_a_half_seconds_is_a_base_of_7_5_m():
    """Thesis, table 4.1: strips of 14 images at 3 m/s and 2.5 s."""
    made = fly(read_plan("thesis_50vt").with_flights(**STILL), 0)
    assert [len(rows) for rows in strips(made)] == [14, 14, 14]
    assert np.array(bases(made)) == pytest.approx(7.5, abs=1e-12)
    assert np.diff(made.table["time_s"]) == pytest.approx(2.5, abs=1e-6)
    assert np.linalg.norm(column(made, "vx", "vy", "vz"), axis=1) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("long_side", "base"), [("across", 0.2 * 3839 / 5489 * 50), ("along", 0.2 * 5119 / 5489 * 50)]
)
def test_eighty_per_cent_overlap_is_a_fifth_of_the_side_along_the_flight(long_side, base):
    made = flown(forward=0.8, images=30, long_side=long_side)
    assert np.array(bases(made)) == pytest.approx(base, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "base", "interval"),
    [
        ({"forward": 0.8, "speed_m_s": 3.0}, 6.9940, 6.9940 / 3),
        ({"forward": 0.8, "interval_s": 2.0}, 6.9940, 2.0),
        ({"speed_m_s": 4.0, "interval_s": 2.0}, 8.0, 2.0),
        # 2.5 s unless said otherwise.
        ({"forward": 0.8}, 6.9940, 2.5),
        ({"speed_m_s": 4.0}, 10.0, 2.5),
    ],
)
def test_two_of_overlap_speed_and_interval_give_the_third(given, base, interval):
    made = flown(strips=1, images=10, **given)
    # 0.2 x 3839 / 5489 x 50 = 6.9940 m; the clock counts microseconds.
    assert bases(made)[0] == pytest.approx(base, abs=5e-5)
    assert np.diff(made.table["time_s"]) == pytest.approx(interval, abs=2e-5)
    speed = np.linalg.norm(column(made, "vx", "vy", "vz"), axis=1)
    assert speed == pytest.approx(base / interval, abs=5e-5)


def test_speed_and_interval_are_flown_also_where_images_do_not_share_out_evenly():
    """44 images in 3 strips are 15, 14, 15: the middle strip is shorter, not slower."""
    made = flown(images=44, speed_m_s=3.0, interval_s=2.5)
    assert [len(rows) for rows in strips(made)] == [15, 14, 15]
    assert np.linalg.norm(column(made, "vx", "vy", "vz"), axis=1) == pytest.approx(3.0)
    for rows in strips(made):
        assert np.diff(made.table["time_s"][rows]) == pytest.approx(2.5, abs=2e-6)
        assert np.ptp(made.centre[rows, 1]) == pytest.approx((len(rows) - 1) * 7.5)
        # About the middle of the axis, so that the strips lie side by side.
        assert made.centre[rows, 1].mean() == pytest.approx(100)


def test_a_speed_is_kept_where_an_overlap_makes_strips_of_one_length():
    """31 images in 3 strips are 10, 11, 10: the bases of the outer strips are longer."""
    made = flown(images=31, forward=0.8, speed_m_s=3.0)
    assert [np.ptp(made.centre[rows, 1]) for rows in strips(made)] == pytest.approx(
        [69.94] * 3, abs=1e-3
    )
    assert np.linalg.norm(column(made, "vx", "vy", "vz"), axis=1) == pytest.approx(3.0)
    for rows in strips(made):
        step = np.diff(made.centre[rows, 1]) / np.diff(made.table["time_s"][rows])
        assert np.abs(step) == pytest.approx(3.0, abs=1e-5)


def test_a_number_of_images_alone_fills_the_axis_from_end_to_end():
    made = flown(images=33)
    for rows in strips(made):
        assert np.sort(made.centre[rows, 1])[[0, -1]] == pytest.approx([0, 200])
    assert np.array(bases(made)) == pytest.approx(20)


def test_overlap_without_a_number_covers_the_stations_and_overlaps_no_less():
    """160 m in bases of at most 6.994 m: 23 of them, 24 images a strip."""
    made = flown(forward=0.8, stations_m=(20.0, 180.0))
    for rows in strips(made):
        assert len(rows) == 24
        assert np.sort(made.centre[rows, 1])[[0, -1]] == pytest.approx([20, 180])


def test_sixty_per_cent_side_overlap_is_two_fifths_of_the_other_side():
    """0.4 x 5119 / 5489 x 50 = 18.652 m between strips, the middle one on the axis."""
    made = flown(side=0.6, images=30)
    assert [made.centre[rows, 0].mean() for rows in strips(made)] == pytest.approx(
        [-18.652, 0, 18.652], abs=5e-4
    )


def test_offsets_that_are_given_are_flown():
    made = flown(strips=2, offsets_m=(-3.0, 12.0), images=20)
    assert [made.centre[rows, 0].mean() for rows in strips(made)] == pytest.approx([-3, 12])


def test_each_strip_has_its_height_above_the_plain():
    plan = Plan(
        "p",
        (Flight("a", (30.0, 70.0), "pinhole", strips=2, images=20, **STILL),),
        terrain=Terrain(level_m=200.0),
        cameras={"pinhole": PINHOLE},
    )
    made = fly(plan, 0)
    assert [set(made.centre[rows, 2]) for rows in strips(made)] == [{230.0}, {270.0}]


# --- which way it looks ----------------------------------------------------------------------


@pytest.mark.parametrize("heading", ["turned", "kept"])
def test_the_heading_turns_at_a_strips_end_or_is_kept(heading):
    """The picture's top, -y of the camera, points where the nose does."""
    made = flown(images=20, strips=2, heading=heading)
    nose = -made.rotation[:, 1]
    assert nose[0] == pytest.approx([0, 1, 0])
    assert nose[-1] == pytest.approx([0, -1, 0] if heading == "turned" else [0, 1, 0])
    assert made.rotation[:, 2] == pytest.approx(np.tile([0, 0, -1.0], (20, 1)))


def test_strips_alternate_their_direction_or_are_flown_the_same_way():
    for direction, second in (("alternating", -1), ("same", 1)):
        made = flown(images=20, strips=2, direction=direction)
        assert np.sign(column(made, "vy").ravel()) == pytest.approx([1] * 10 + [second] * 10)
        assert headings(made)[:, 1] == pytest.approx([1] * 10 + [second] * 10)
        # Turned, a drone that flies every strip the same way has nothing to turn for.
        assert -made.rotation[-1, 1, 1] == pytest.approx(second)


def test_along_puts_the_long_side_of_the_picture_along_the_flight():
    assert flown(images=6, long_side="along").rotation[0, 0] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize("long_side", ["across", "along"])
@pytest.mark.parametrize("heading", ["turned", "kept"])
@pytest.mark.parametrize("look", ["forward", "sideways", "alternating"])
def test_a_tilted_camera_looks_exactly_that_far_from_the_vertical(look, heading, long_side):
    made = flown(BEND, images=60, tilt_deg=30.0, look=look, heading=heading, long_side=long_side)
    cosine = made.rotation[:, 2] @ [0, 0, -1.0]
    assert cosine == pytest.approx(np.cos(np.radians(30)), abs=1e-14)


def test_a_camera_tilted_forward_looks_ahead():
    made = flown(images=30, tilt_deg=30.0)
    # Horizontal part: sin 30 degrees, along the flight, also after the turn.
    assert made.rotation[:, 2, :2] == pytest.approx(0.5 * headings(made)[:, :2], abs=1e-12)


def test_a_kept_heading_looks_back_on_the_way_back():
    made = flown(images=30, tilt_deg=30.0, heading="kept")
    assert made.rotation[:, 2, 1] == pytest.approx(0.5)
    assert headings(made)[12, 1] == pytest.approx(-1)


@pytest.mark.parametrize("heading", ["turned", "kept"])
def test_a_camera_tilted_sideways_looks_towards_the_axis(heading):
    made = flown(images=20, strips=2, tilt_deg=20.0, look="sideways", heading=heading)
    towards = -np.sign(made.centre[:, 0])
    assert made.rotation[:, 2, 0] == pytest.approx(np.sin(np.radians(20)) * towards)
    assert made.rotation[:, 2, 1] == pytest.approx(0)


def test_on_the_axis_sideways_is_to_the_right():
    made = flown(images=40, strips=1, tilt_deg=20.0, look="sideways")
    assert made.rotation[:, 2, 0] == pytest.approx(np.sin(np.radians(20)))


def test_alternating_looks_ahead_and_back_from_image_to_image():
    made = flown(images=30, tilt_deg=30.0, look="alternating")
    number = np.concatenate([np.arange(10)] * 3)
    along = np.sum(made.rotation[:, 2] * headings(made), axis=1)
    assert along == pytest.approx(np.where(number % 2, -0.5, 0.5))


def test_rotations_are_rotations_and_those_of_the_table():
    made = flown(BEND, images=60, tilt_deg=25.0, attitude_jitter_deg=3.0)
    square = made.rotation @ made.rotation.transpose(0, 2, 1)
    assert square == pytest.approx(np.tile(np.eye(3), (60, 1, 1)), abs=1e-14)
    assert np.linalg.det(made.rotation) == pytest.approx(1)
    stored = rotation_from_quaternion(column(made, "qw", "qx", "qy", "qz"))
    assert np.array_equal(stored, made.rotation)


# --- jitter ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sigmas", "keeps", "moves"),
    [
        # Roll about the flight direction leaves the nose, pitch the wing, yaw the vertical.
        ((2.0, 0.0, 0.0), 1, 2),
        ((0.0, 2.0, 0.0), 0, 2),
        ((0.0, 0.0, 2.0), 2, 0),
    ],
    ids=["roll", "pitch", "yaw"],
)
def test_jitter_of_one_angle_turns_about_its_own_axis_only(sigmas, keeps, moves):
    made = flown(images=600, strips=1, attitude_jitter_deg=sigmas)
    still = flown(images=600, strips=1)
    assert made.rotation[:, keeps] == pytest.approx(still.rotation[:, keeps], abs=1e-14)
    cosine = np.sum(made.rotation[:, moves] * still.rotation[:, moves], axis=1)
    angle = np.degrees(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2)))
    # Four standard errors of a standard deviation of 600.
    assert angle == pytest.approx(2.0, rel=4 / np.sqrt(1200))


def test_yaw_of_a_tilted_camera_turns_about_the_vertical_as_well():
    made = flown(images=600, strips=1, tilt_deg=30.0, attitude_jitter_deg=(0.0, 0.0, 2.0))
    assert made.rotation[:, 2, 2] == pytest.approx(-np.cos(np.radians(30)), abs=1e-14)
    yaw = np.degrees(np.arctan2(made.rotation[:, 2, 0], made.rotation[:, 2, 1]))
    assert yaw.std() == pytest.approx(2.0, rel=4 / np.sqrt(1200))


def test_jitter_has_the_sigmas_asked_for():
    made = flown(
        images=600, strips=1, position_jitter_m=0.4, velocity_jitter_m_s=0.2, angular_rate_deg_s=3.0
    )
    still = flown(images=600, strips=1)
    for name, sigma in (("xyz", 0.4), (("vx", "vy", "vz"), 0.2)):
        off = column(made, *name) - column(still, *name)
        assert off.std(axis=0) == pytest.approx([sigma] * 3, rel=4 / np.sqrt(1200))
    rate = np.degrees(column(made, "wx", "wy", "wz"))
    assert rate.std(axis=0) == pytest.approx([3.0] * 3, rel=4 / np.sqrt(1200))


def test_another_seed_shakes_otherwise_and_the_same_seed_the_same():
    first, again, other = (
        flown(images=20, strips=1, position_jitter_m=0.3, seed=seed) for seed in (1, 1, 2)
    )
    assert np.array_equal(first.centre, again.centre)
    assert np.abs(first.centre - other.centre).max() > 0.1


@pytest.mark.parametrize("names", ["thesis_50ob+thesis_50vt", "thesis_50vt+thesis_3070vt"])
def test_a_flight_is_the_same_in_any_company(names):
    """So that what a flight adds is the flight, not another draw of the others."""
    alone = fly(read_plan("thesis_50vt"), 5)
    together = fly(read_plan(names), 5)
    mine = (together.table["flight"] == "50vt").to_numpy()
    kept = alone.table.columns.drop(["time_s", "strip"])
    pd.testing.assert_frame_equal(
        together.table.loc[mine, kept].reset_index(drop=True), alone.table[kept], check_exact=True
    )
    assert np.array_equal(together.rotation[mine], alone.rotation)
    assert np.array_equal(together.antenna[mine], alone.antenna)


# --- velocities and bends --------------------------------------------------------------------


@pytest.mark.parametrize("wind", [0.0, 1.0])
def test_images_are_where_their_velocity_took_them_and_no_velocity_crosses_a_turn(wind):
    made = flown(images=30, speed_m_s=4.0, interval_s=2.0, wind_m_s=wind, turn_s=50.0)
    velocity = column(made, "vx", "vy", "vz")
    for k, rows in enumerate(strips(made)):
        step = np.diff(made.centre[rows], axis=0) / np.diff(made.table["time_s"][rows])[:, None]
        # 8 m over 2 s that the clock knows to 1e-6 s.
        assert velocity[rows[1:]] == pytest.approx(step, abs=1e-5)
        # The wind blows along the corridor: with the first strip, against the second.
        assert np.linalg.norm(velocity[rows], axis=1) == pytest.approx(4 + wind * (-1) ** k)


def test_on_a_bend_heading_and_velocity_follow_the_tangent_of_the_axis():
    made = flown(BEND, strips=1, images=100, offsets_m=(0.0,))
    _, tangent = Plan("p", (Flight("a", 50.0),), BEND).axis.at(made.station)
    assert -made.rotation[:, 1, :2] == pytest.approx(tangent, abs=1e-12)
    velocity = column(made, "vx", "vy")
    assert velocity / np.linalg.norm(velocity, axis=1)[:, None] == pytest.approx(tangent, abs=1e-12)
    # From north to (200, 150): the bend is there.
    assert tangent[0] == pytest.approx([0, 1]) and tangent[-1] == pytest.approx([0.8, 0.6])


def test_strips_keep_their_distance_round_a_bend():
    made = flown(BEND, images=300, side=0.6)
    position, _ = Plan("p", (Flight("a", 50.0),), BEND).axis.at(made.station)
    away = np.linalg.norm(made.centre[:, :2] - position, axis=1)
    assert [away[rows].mean() for rows in strips(made)] == pytest.approx(
        [18.652, 0, 18.652], abs=5e-4
    )


# --- clock, warmth, antenna ------------------------------------------------------------------


def two(**second):
    first = Flight("a", 50.0, images=20, speed_m_s=3.0, strips=2, turn_s=30.0, start_s=100.0)
    return fly(Plan("p", (first, replace(first, **{"name": "b", "start_s": None} | second))), 0)


def test_turns_and_pauses_take_the_time_they_are_given():
    time = two(pause_s=600.0).table["time_s"].to_numpy()
    assert time[0] == 100.0
    # Two strips of nine intervals, a turn between them; then the pause.
    assert time[10] - time[9] == pytest.approx(30, abs=1e-6)
    assert time[19] == pytest.approx(100 + 9 * 2.5 + 30 + 9 * 2.5, abs=1e-5)
    assert time[20] - time[19] == pytest.approx(600, abs=1e-6)


def test_a_flight_may_say_when_it_starts():
    assert two(start_s=5000.0).table["time_s"][20] == 5000.0


def test_the_camera_warms_with_a_time_constant_of_ten_minutes():
    made = flown(images=40, strips=1, interval_s=60.0, temperature_c=12.0, warming_c=9.0)
    time, warmth = made.table["time_s"], made.table["temperature_c"]
    # Thousandths of a degree are stated.
    assert warmth.to_numpy() == pytest.approx(21 - 9 * np.exp(-time / 600), abs=5.1e-4)
    # After ten minutes 1 - 1/e = 63 % of it.
    assert warmth[10] == pytest.approx(12 + 9 * 0.632, abs=1e-2)


def test_a_second_flight_starts_cold():
    made = two(pause_s=3000.0)
    assert made.table["temperature_c"][20] == 20.0


def test_antennas_sit_at_the_end_of_the_lever_arm():
    """Nadir, heading north: camera x is east, y south, z down, so (1, 2, 3) is (1, -2, -3)."""
    made = flown(images=6, lever_arm_m=(1.0, 2.0, 3.0))
    assert made.antenna[0] - made.centre[0] == pytest.approx([1, -2, -3])
    tilted = flown(images=60, tilt_deg=30.0, attitude_jitter_deg=2.0, lever_arm_m=(1.0, 2.0, 3.0))
    arm = np.einsum("nij,nj->ni", tilted.rotation, tilted.antenna - tilted.centre)
    assert arm == pytest.approx(np.tile([1.0, 2.0, 3.0], (60, 1)), abs=1e-12)


def test_strips_are_counted_through_and_images_carry_their_flight():
    made = two()
    assert [table["strip"].unique().tolist() for _, table in made.table.groupby("flight")] == [
        ["1", "2"],
        ["3", "4"],
    ]
    assert made.table["image"].is_unique
    assert made.table["image"][20] == "b_0001.tif"
