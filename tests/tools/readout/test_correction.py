"""Velocities from what a block knows, and the shutter taken out of its measurements."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from kit.table_7_3 import two_step

import corridor
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.effects import add, correct, predict
from corridor.core.errors import InputError
from corridor.core.simulation import perfect_block, read_plan, simulate
from corridor.tools.readout import rates_from_neighbours, velocities

SHUTTER = {"rolling_shutter": {"readout": 0.0564}}


def flight(time, position, **columns):
    """A block of images alone."""
    names = [f"i{k:02d}" for k in range(len(time))]
    position = np.asarray(position, dtype=float)
    table = {
        "image": names,
        "camera": "c",
        "time_s": time,
        **dict(zip("xyz", position.T, strict=True)),
    }
    return Block(
        name="flown",
        cameras={"c": Camera.from_table("c", {"width": 400, "height": 300, "f": 300.0})},
        images=pd.DataFrame(table | columns),
    )


def straight(time, speed=5.0, offset=0.0):
    time = np.asarray(time, dtype=float)
    return np.stack([speed * time, 0 * time + offset, 0 * time + 50.0], axis=1)


class TestVelocities:
    @pytest.mark.parametrize("method", ["neighbours", "strip"])
    def test_a_steady_flight_has_its_speed_everywhere(self, method):
        time = np.arange(10) * 2.03
        found = velocities(flight(time, straight(time)), method)
        assert found.velocity == pytest.approx(np.tile([5.0, 0, 0], (10, 1)), abs=1e-9)
        assert not found.stamp_s

    @pytest.mark.parametrize("method", ["neighbours", "strip"])
    @pytest.mark.parametrize("named", [True, False])
    def test_never_across_the_end_of_a_strip(self, method, named):
        """There and back, 30 m beside: the last of one strip still flies on, the next one back."""
        time = np.arange(12) * 2.03
        back = 10.15 + 5.0 * 2.03 * np.arange(6)[::-1]
        position = np.concatenate([straight(time[:6]), straight(time[6:], offset=30.0)])
        position[6:, 0] = back
        columns = {"strip": ["1"] * 6 + ["2"] * 6} if named else {}
        found = velocities(flight(time, position, **columns), method)
        assert found.velocity[:6, 0] == pytest.approx(5.0)
        assert found.velocity[6:, 0] == pytest.approx(-5.0)
        assert np.abs(found.velocity[:, 1]).max() < 1e-9
        assert any("no strips" in note for note in found.notes) == (not named)

    def test_flights_that_interleave_in_time_and_in_the_file_stand_for_themselves(self):
        """Two drones at once, 400 m apart, one row each in turn."""
        time = np.arange(20) * 1.01
        position = straight(time)
        position[1::2] += [0.0, 400.0, 0.0]
        found = velocities(flight(time, position, flight=["a", "b"] * 10), "neighbours")
        assert found.velocity == pytest.approx(np.tile([5.0, 0, 0], (20, 1)), abs=1e-9)
        assert any("interleave" in note for note in found.notes)

    def test_images_that_stand_in_another_order_are_put_in_order_and_it_is_said(self):
        time = np.arange(8) * 2.03
        order = [3, 1, 0, 2, 7, 6, 4, 5]
        found = velocities(flight(time[order], straight(time)[order], strip="1"), "neighbours")
        assert found.velocity[:, 0] == pytest.approx(5.0)
        assert any("order of their time stamps" in note for note in found.notes)

    def test_equal_stamps_take_the_next_ones_that_differ(self):
        """Two pictures a second, time stamps in whole seconds."""
        true = np.arange(12) * 0.5
        found = velocities(flight(np.floor(true), straight(true), strip="1"), "neighbours")
        assert found.velocity[2:-2, 0] == pytest.approx(5.0, rel=0.35)
        assert any("same time stamp" in note for note in found.notes)
        assert any("multiples of 1 s" in note for note in found.notes)

    def test_a_strip_knows_its_speed_better_than_its_rounded_stamps(self):
        """Every 2.15 s, cut to whole seconds: 4 or 5 s between neighbours, 7 and 20 % wrong."""
        true = np.arange(40) * 2.15
        block = flight(np.floor(true), straight(true), strip="1")
        by_neighbours, by_strip = (velocities(block, m) for m in ("neighbours", "strip"))
        assert np.abs(by_neighbours.velocity[:, 0] - 5).max() > 0.3
        assert by_strip.velocity[:, 0] == pytest.approx(5.0, abs=0.1)
        # Rounding by up to half a second either way: 1 / sqrt(12).
        assert by_strip.stamp_sigma_s == pytest.approx(1 / np.sqrt(12), rel=0.15)
        assert velocities(block).method == "strip"

    @pytest.mark.parametrize("method", ["neighbours", "metadata"])
    def test_two_hundred_metres_a_second_are_an_error_not_a_number(self, method):
        time = np.arange(8) * 2.03
        position = straight(time)
        block = flight(time, position, strip="1", vx=5.0, vy=0.0, vz=0.0)
        block.images.loc[4, "vx"] = 212.0
        block.images.loc[4:, "x"] += 1000.0
        with pytest.raises(InputError, match=r"images.csv, row \d: image i0\d would fly .*m/s"):
            velocities(block, method)

    def test_all_stamps_equal_is_an_error(self):
        block = flight(np.full(5, 7.0), straight(np.arange(5.0)), strip="1")
        with pytest.raises(InputError, match="no neighbour in its strip with another time stamp"):
            velocities(block, "neighbours")

    def test_without_times_the_row_is_named(self):
        block = flight(np.arange(5.0), straight(np.arange(5.0)))
        block.images.loc[3, "time_s"] = np.nan
        with pytest.raises(InputError, match="images.csv, row 5: image i03 has no time_s"):
            velocities(block, "strip")

    def test_a_track_gives_the_velocity_at_the_exposure(self):
        """s = t2 m: 2 t m/s, epochs five a second, exposures in between."""
        epochs = np.arange(0, 10, 0.2)
        time = np.array([1.11, 3.33, 7.77])
        block = flight(time, straight(time))
        block.track = pd.DataFrame({"time_s": epochs, "x": epochs**2, "y": 0.0, "z": 50.0})
        found = velocities(block)
        assert found.method == "gnss"
        assert found.velocity[:, 0] == pytest.approx(2 * time, abs=0.02)
        block.images["time_s"] = time + 90.0
        with pytest.raises(InputError, match="track.csv .* have no common clock"):
            velocities(block)

    def test_antennas_stand_in_for_poses_that_are_missing(self):
        time = np.arange(6) * 2.03
        block = flight(time, np.full((6, 3), np.nan))
        block.gnss = pd.DataFrame(
            {"image": block.images["image"], **dict(zip("xyz", straight(time).T, strict=True))}
        )
        # Positions good to 2 cm, 2 s apart: two sigmas of their difference over the time.
        tolerance = 2 * np.sqrt(2) * 0.02 / 2.03
        assert velocities(block).velocity[:, 0] == pytest.approx(5.0, abs=tolerance)
        block.gnss = block.gnss.iloc[:0]
        with pytest.raises(InputError, match="run `corridor adjust` first"):
            velocities(block, "neighbours")


def test_attitudes_of_neighbours_give_the_rate_of_a_curve():
    """Yaw of 3 degrees a second to the right, seen from above: about z of a camera looking down."""
    time = np.arange(8) * 2.0
    yaw = np.radians(3.0) * time
    # Nadir camera, x to the right of the flight: world to camera.
    quaternion = np.stack([0 * yaw, np.cos(yaw / 2), -np.sin(yaw / 2), 0 * yaw], axis=1)
    block = flight(
        time,
        straight(time),
        strip="1",
        **dict(zip(("qw", "qx", "qy", "qz"), quaternion.T, strict=True)),
    )
    found = rates_from_neighbours(block).images[["wx", "wy", "wz"]].to_numpy()
    assert found == pytest.approx(np.tile([0, 0, np.radians(3.0)], (8, 1)), abs=1e-9)


@pytest.fixture(scope="module")
def survey():
    """90 m over flat ground, with and without the shutter: same noise, exact velocities."""
    plan = read_plan("thesis_viabon_n90").with_flights(angular_rate_deg_s=0.6)
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=80))
    with_it = simulate(plan, seed=1).copy()
    return with_it, simulate(replace(plan, effects={}), seed=1).copy()


def errors(adjustment):
    return adjustment.check_points[["dx", "dy", "dz"]].to_numpy()


def rms(errors):
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


@pytest.fixture(scope="module")
def corrected(survey):
    return two_step(survey[0], SHUTTER, "metadata", camera="fraser8")


def test_with_exact_velocities_the_shutter_is_gone(survey, corrected):
    """Issue 10, Must 3: within a fifth of the noise floor of the flight without a shutter."""
    clean = corridor.adjust(survey[1], camera="fraser8")
    assert rms(errors(corrected.before)) > 3 * rms(errors(clean))
    assert rms(errors(corrected.after) - errors(clean)) < 0.2 * rms(errors(clean))
    assert corrected.gain > 0.6


def test_a_known_rotation_is_corrected_to_a_fifth(survey, corrected):
    """Issue 10, Must 4: 0.6 degrees a second, known rates."""
    clean = corridor.adjust(survey[1], camera="fraser8")
    still = survey[0].copy()
    still.images = still.images.drop(columns=["wx", "wy", "wz"])
    moved_only = two_step(still, SHUTTER, "metadata", camera="fraser8").after
    left = rms(errors(corrected.after) - errors(clean))
    assert left < 0.2 * rms(errors(moved_only) - errors(clean))


def test_read_literally_the_published_formula_doubles_the_error(survey):
    """Eq. 7.16 adds pi(O_c, P) - pi(O, P), which is what the shutter did already."""
    block = survey[0]
    perfect = perfect_block(
        replace(
            read_plan("thesis_viabon_n90").with_flights(angular_rate_deg_s=0.6),
            tie_points=replace(read_plan("thesis_viabon_n90").tie_points, per_image=80),
        ),
        1,
    )
    still, seen = predict(perfect).tie, predict(perfect, SHUTTER).tie
    shutter = seen - still
    right = predict(correct(perfect.copy(), SHUTTER)).tie
    assert right == pytest.approx(still)
    literal = seen + shutter
    assert np.linalg.norm(literal - still) == pytest.approx(2 * np.linalg.norm(shutter))
    corrected = correct(add(perfect, SHUTTER), SHUTTER).tie_points[["x", "y"]].to_numpy()
    assert corrected == pytest.approx(still, abs=1e-6)
    assert len(block.tie_points) == len(still)


class TestCorrecting:
    @pytest.fixture
    def block(self, survey):
        block = survey[0].copy()
        block.points = perfect_points(block)
        return block

    def test_adding_the_effect_back_gives_the_observations_back(self, block):
        """Issue 10, Must 6: within 1e-6 px."""
        there = correct(block, SHUTTER)
        moved = there.tie_points[["x", "y"]].to_numpy() - block.tie_points[["x", "y"]].to_numpy()
        assert np.abs(moved).max() > 1
        back = add(there, SHUTTER)
        for table in ("tie_points", "marks"):
            one, other = (getattr(b, table)[["x", "y"]].to_numpy() for b in (back, block))
            assert np.abs(one - other).max() < 1e-6

    def test_what_was_done_is_recorded_and_not_done_twice(self, block):
        there = correct(block, SHUTTER, ["by hand"])
        record = there.extra["corrected"]
        assert {k: v for k, v in record.items() if k != "notes"} == SHUTTER
        assert record["notes"][0].startswith("velocities:") and record["notes"][-1] == "by hand"
        with pytest.raises(InputError, match="has been taken out of this block already"):
            correct(there, SHUTTER)

    def test_without_values_the_block_states_them_or_is_refused(self, block):
        with pytest.raises(InputError, match="the block states none: write rolling_shutter:readou"):
            correct(block, {"rolling_shutter": None})
        block.cameras = {k: replace(c, readout_s=0.0564) for k, c in block.cameras.items()}
        stated = correct(block, {"rolling_shutter": None})
        given = correct(block, SHUTTER)
        assert stated.tie_points.equals(given.tie_points)

    def test_a_block_without_start_values_is_sent_to_the_adjustment(self, block):
        block.points = block.points.iloc[:-3]
        with pytest.raises(InputError, match="has no coordinates.*run `corridor adjust` first"):
            correct(block, SHUTTER)
        block.images.loc[2, "qw"] = np.nan
        with pytest.raises(InputError, match="row 4: image .* has no pose .*`corridor adjust`"):
            correct(block, SHUTTER)


def perfect_points(block):
    """Points of the block, all of them (its start values)."""
    return block.points.copy()
