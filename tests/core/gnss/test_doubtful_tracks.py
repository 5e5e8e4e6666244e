"""Tracks and clocks that are not what they say: each is told, and counts in the sigma."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError, WorkFailed
from corridor.core.gnss import Exposures, Track, antenna, interpolate, read_exposures
from corridor.core.gnss.formats.dji_mrk import status
from corridor.core.gnss.interpolation.roughness import left_over

XYZ, SXYZ = ["x", "y", "z"], ["sx", "sy", "sz"]
SIGMA = np.array([0.008, 0.008, 0.015])


def place(time):
    """A strip at 6 m/s that turns back in a half circle: metres at seconds."""
    time = np.asarray(time, float)
    return np.stack([60 * np.sin(time / 10), 25 * np.cos(time / 12), 50 + 0 * time], axis=-1)


def flown(rate=5.0, noise=1.0, seed=0, seconds=100.0):
    """A track of epochs with white noise, `noise` times as large as it states."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / rate)
    table = pd.DataFrame({"time_s": time})
    table[XYZ] = place(time) + noise * SIGMA * rng.standard_normal((len(time), 3))
    table[SXYZ] = SIGMA
    return table


def exposed(late=0.0, sigma=0.01, seed=1):
    """Exposures every 2 s with positions of their own, at times that are `late`."""
    rng = np.random.default_rng(seed)
    time = np.arange(10.0, 90.0, 2.1)
    table = pd.DataFrame({"image": [f"i{n}.jpg" for n in range(len(time))], "time_s": time + late})
    table[XYZ] = place(time) + sigma * rng.standard_normal((len(time), 3))
    table[SXYZ] = sigma
    return table


def at_images(track, images, day="2024-05-14", systems=("GPST", "GPST"), **more):
    return antenna(
        Track(track, day, systems[0], None, Path("rover.pos")),
        Exposures(images, day, systems[1], None, Path("marks.MRK"), **more),
    )


class TestClocks:
    @pytest.mark.parametrize("seconds", [1.0, -1.0, 2.0])
    def test_a_miscount_of_leap_seconds_is_put_right_by_the_positions(self, seconds):
        images = exposed(late=-seconds)
        found = at_images(flown(), images)
        off = found.gnss[XYZ].to_numpy() - images[XYZ].to_numpy()
        assert np.abs(off).max() < 0.1
        assert any("another number of leap seconds" in note for note in found.notes)

    def test_another_delay_is_told_with_its_size(self):
        found = at_images(flown(), exposed(late=-0.4))
        assert any("0.40 +- 0.00 s later" in note for note in found.notes)

    def test_a_right_clock_is_not_doubted(self):
        assert not any("positions in" in note for note in at_images(flown(), exposed()).notes)

    @pytest.mark.parametrize(("seconds", "means"), [(14.0, "BDT"), (-37.0, "TAI"), (4.0, "BDT")])
    def test_another_time_system_is_refused_by_its_seconds(self, seconds, means):
        """BeiDou time is 14 s behind GPS time and 4 s ahead of UTC, TAI 37 s ahead of UTC."""
        with pytest.raises(InputError, match=f"{abs(seconds):g} s .*means {means}"):
            at_images(flown(), exposed(late=seconds))

    def test_a_count_of_seconds_that_leaves_metres_is_none(self):
        found = at_images(flown(), exposed(late=-2.3))
        assert any(re.search(r"2\.(29|30) \+- 0\.0. s later", note) for note in found.notes)
        assert not len(found.refused)

    def test_positions_of_the_next_row_are_told(self):
        images = exposed()
        images.loc[:, XYZ] = np.roll(images[XYZ].to_numpy(), -1, axis=0)
        images["time_s"] += np.random.default_rng(2).uniform(-0.3, 0.3, len(images))
        images.loc[:, XYZ] = np.roll(place(images["time_s"]), -1, axis=0)
        found = at_images(flown(), images)
        assert any("1 row above 0.0" in note for note in found.notes)

    def test_another_place_is_refused(self):
        images = exposed()
        images["x"] += 2000.0
        with pytest.raises(InputError, match="2 km from rover.pos: one of the two is of another"):
            at_images(flown(), images)

    @pytest.mark.parametrize("step", [0.5, 0.1, 0.01])
    def test_a_step_of_times_is_seen(self, step):
        rng = np.random.default_rng(6)
        time = np.cumsum(1.7 + 0.03 * rng.standard_normal(200))
        time = np.round(time / step) * step + 0.123
        table = pd.DataFrame({"image": np.arange(200).astype(str), "time_s": time})
        seen = Exposures(table, None, None, None, Path("images.csv")).with_seen_step()
        assert seen.resolution_s == step

    def test_even_firing_is_no_step(self):
        time = np.delete(0.7 * np.arange(100), [20, 50, 51])
        table = pd.DataFrame({"image": np.arange(97).astype(str), "time_s": time})
        seen = Exposures(table, None, None, None, Path("images.csv")).with_seen_step()
        assert seen.resolution_s is None

    def test_whole_seconds_are_in_the_sigma(self):
        images = exposed()
        with pytest.raises(WorkFailed, match="steps of 1000 ms"):
            at_images(flown(), images.drop(columns=[*XYZ, *SXYZ]), resolution_s=1.0)

    def test_a_track_that_stands_still_is_told(self):
        track = flown()
        track[XYZ] = track[XYZ].to_numpy() - place(track["time_s"])
        found = at_images(track, exposed().drop(columns=[*XYZ, *SXYZ]))
        assert any("stands still" in note for note in found.notes)


class TestOwnPositions:
    """What on-board positions of centimetres say of each image."""

    def test_a_clock_that_drifts_is_told_and_its_images_refused(self):
        images = exposed()
        images["time_s"] += 0.003 * (images["time_s"] - 50)
        found = at_images(flown(), images)
        assert any("clock of the images drift, by 3 ms a second" in note for note in found.notes)
        assert {"i0.jpg", "i37.jpg"} <= set(found.refused["image"])

    def test_a_clock_that_jumps_is_told_with_its_image(self):
        images = exposed()
        images.loc[27:, "time_s"] += 0.7
        found = at_images(flown(), images)
        assert any("jump, by 0.70 s from i27.jpg on" in note for note in found.notes)
        assert list(found.refused["image"]) == [f"i{n}.jpg" for n in range(27, len(images))]

    def test_epochs_that_are_false_for_half_a_minute_refuse_their_images(self):
        track = flown()
        track.loc[track["time_s"].between(40, 60), XYZ] += [0.2, -0.2, 0.3]
        found = at_images(track, exposed())
        time = exposed()["time_s"].to_numpy()[[int(i[1:-4]) for i in found.refused["image"]]]
        assert len(time) == 9 and ((time > 40) & (time < 60)).all()

    @pytest.mark.parametrize("shift", [(0.8, -0.6, 0.4), (40.0, 0.0, 0.0)])
    def test_what_all_have_in_common_refuses_none(self, shift):
        images = exposed()
        images[XYZ] += np.array(shift)
        assert not len(at_images(flown(), images).refused)

    def test_positions_without_sigmas_tell_a_clock_and_refuse_none(self):
        images = exposed(sigma=0.05).drop(columns=SXYZ)
        images["time_s"] += 0.005 * (images["time_s"] - 50)
        found = at_images(flown(), images)
        assert any("clock of the images drift" in note for note in found.notes)
        assert not len(found.refused)

    def test_an_on_board_solution_that_is_no_fix_contradicts_nothing(self):
        images = exposed().assign(flag=pd.array([34] * 39, dtype="Int64"))
        images.loc[20:, XYZ] += [0.5, 0.5, 0.5]
        assert not len(at_images(flown(), images).refused)


class TestEpochs:
    @pytest.mark.parametrize("rate", [1.0, 5.0, 10.0])
    def test_false_epochs_are_left_out_by_their_own_noise(self, rate):
        track, rng = flown(rate, seed=3, seconds=200.0), np.random.default_rng(4)
        false = rng.choice(np.arange(8, len(track) - 8, 12), 6, replace=False)
        track.loc[false, XYZ] += 0.35 * rng.choice([-1, 1], (6, 3))
        at = np.arange(10.0, 190.0, 1.7)
        found = interpolate(track, at).table
        off = (found[XYZ].to_numpy() - place(at)) / found[SXYZ].to_numpy()
        assert np.abs(off).max() < 5

    @pytest.mark.parametrize("row", [50, 52])
    def test_a_false_epoch_where_a_drone_stops_is_told_by_its_height(self, row):
        """From 5 m/s to a stop in 2 s, and aside: one epoch a second says nothing of it in plan."""
        fine = np.arange(0.0, 100.0, 0.01)
        speed = 5.0 * np.clip((52.0 - fine) / 2.0, 0.0, 1.0)
        track = flown(1.0, seed=row)
        stops = np.cumsum([speed, (5.0 - speed) / 2.0], axis=1).T[::100] * 0.01
        track[["x", "y"]] += stops - place(track["time_s"])[:, :2]
        at = track["time_s"].to_numpy()[[row]]
        sound = interpolate(track, at)
        track.loc[row, XYZ] += [0.3, -0.25, 0.3]
        found = interpolate(track, at)
        said = f"1 epoch stands alone, .* left out of the track: that at {row:.3f} s"
        assert any(re.match(said, note) for note in found.notes)
        assert not any("left out" in note for note in sound.notes)
        off = (found.table[XYZ] - sound.table[XYZ]).to_numpy() / found.table[SXYZ].to_numpy()
        assert np.abs(off).max() < 5

    @pytest.mark.parametrize("many", [2, 3])
    def test_epochs_that_are_false_together_are_left_out(self, many):
        track = flown(10.0, seconds=40.0, seed=7)
        track.loc[150 : 149 + many, XYZ] += [0.25, -0.2, 0.3]
        at = np.array([14.95, 15.05, 15.25])
        found = interpolate(track, at)
        off = (found.table[XYZ].to_numpy() - place(at)) / found.table[SXYZ].to_numpy()
        assert np.abs(off).max() < 5
        assert any(f"{many} epochs stand" in note and "0.4" in note for note in found.notes)

    @pytest.mark.parametrize("by", [(0.3, 0.2, -0.3), (0.0, 0.0, -28.0)])
    def test_a_jump_is_told_and_nothing_is_interpolated_across_it(self, by):
        track = flown(10.0, seconds=40.0, seed=8)
        track.loc[200:, XYZ] += np.array(by)
        found = interpolate(track, np.array([19.5, 19.97, 21.0]))
        assert found.table["why"].tolist() == ["", "in a gap of the track", ""]
        assert any("jumps by" in note and "at 20.000 s" in note for note in found.notes)

    def test_two_receivers_in_one_file_are_refused(self):
        track = flown()
        track.loc[::2, "x"] += 0.5
        with pytest.raises(InputError, match="every second epoch lies 0.50 m beside the others"):
            interpolate(track, np.array([20.0]))

    def test_variances_in_place_of_sigmas_are_not_used(self):
        track = flown()
        track[SXYZ] = SIGMA**2
        found = interpolate(track, np.array([20.0]))
        assert any("are they variances" in note for note in found.notes)
        assert found.table["sx"].iloc[0] > 0.002

    def test_sigmas_in_another_unit_are_named_where_all_is_refused(self):
        track = flown()
        track[SXYZ] = 1000 * SIGMA
        with pytest.raises(WorkFailed, match="sigmas in centimetres or millimetres"):
            at_images(track, exposed().drop(columns=[*XYZ, *SXYZ]))

    @pytest.mark.parametrize(("step", "shown"), [(0.1, "10 cm"), (1.0, "1e\\+02 cm")])
    def test_what_the_last_digit_is_worth_is_in_the_sigma(self, step, shown):
        track = flown().round(dict.fromkeys("xyz", 0 if step == 1 else 1))
        told = f"prints positions in steps of {shown}, which is in the sigmas"
        try:
            found = at_images(track, exposed().drop(columns=[*XYZ, *SXYZ]))
        except WorkFailed as error:
            assert step == 1 and re.search(told, str(error))
        else:
            assert any(re.search(told, note) for note in found.notes)
            assert found.gnss["sx"].min() > 0.005

    def test_degrees_in_a_table_of_metres_are_refused(self):
        track = flown()
        track[["x", "y"]] = track[["x", "y"]] * 1e-5 + [8.5, 49.0]
        with pytest.raises(InputError, match="longitude and latitude in degrees"):
            at_images(track, exposed().drop(columns=[*XYZ, *SXYZ]))

    @pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0, 170.0])
    @pytest.mark.parametrize("speed", [1.0, 3.0])
    def test_a_corner_is_no_false_epoch(self, degrees, speed):
        """A drone of 2 g turns 3 m/s back within a third of a second: between two epochs."""
        time, turn = np.arange(0.0, 60.0, 0.5), np.radians(degrees)
        after = speed * np.array([np.cos(turn), np.sin(turn), 0.0])
        way = np.where(time[:, None] < 30, [speed, 0.0, 0.0], after)
        track = pd.DataFrame({"time_s": time})
        track[XYZ] = way * (time - 30)[:, None]
        track[XYZ] += SIGMA * np.random.default_rng(5).standard_normal((len(time), 3))
        track[SXYZ] = SIGMA
        found = interpolate(track, np.array([29.5, 30.0, 30.5]))
        assert not any("left out of the track" in note for note in found.notes)
        off = found.table[XYZ].to_numpy() - track[XYZ].to_numpy()[[59, 60, 61]]
        assert np.abs(off / found.table[SXYZ].to_numpy()).max() < 5

    def test_a_sound_track_loses_none(self):
        notes = interpolate(flown(5.0, seconds=300.0), np.array([20.0])).notes
        assert not any("left out" in note for note in notes)

    def test_sigmas_that_the_scatter_contradicts_are_not_used(self):
        at = np.arange(10.0, 90.0, 0.7)
        found = interpolate(flown(5.0, noise=2.7), at)
        off = (found.table[XYZ].to_numpy() - place(at)) / found.table[SXYZ].to_numpy()
        assert np.sqrt(np.mean(off**2)) < 1.2  # 2.2 where they are believed
        assert any("times as much as their sigmas say" in note for note in found.notes)

    def test_motion_that_one_epoch_a_second_does_not_show_is_in_the_sigma(self):
        rng = np.random.default_rng(0)
        fine = np.arange(0, 200, 0.02)
        spectrum = np.fft.rfft(rng.standard_normal((len(fine), 3)), axis=0)
        spectrum[np.fft.rfftfreq(len(fine), 0.02) > 1.0] = 0
        shaken = np.fft.irfft(spectrum, len(fine), axis=0)
        shaken *= 0.03 / shaken.std()
        track = flown(1.0, seconds=200.0)
        track[XYZ] += shaken[:: round(1 / 0.02)]
        at = np.arange(10.0, 190.0, 0.7)
        true = place(at) + np.stack([np.interp(at, fine, one) for one in shaken.T], axis=1)
        found = interpolate(track, at)
        off = (found.table[XYZ].to_numpy() - true) / found.table[SXYZ].to_numpy()
        assert np.sqrt(np.mean(off**2)) < 1.3
        assert any("cannot show motion above 0.5 Hz" in note for note in found.notes)

    def test_motion_that_a_smoother_takes_for_noise_is_in_the_sigma(self):
        """A height shaken by 2 cm, flat up to 2 Hz, beside noise of 2 cm: neither is told by its
        size, but noise does not hang together from epoch to epoch."""
        rng, fine = np.random.default_rng(0), np.arange(0, 60, 0.02)
        spectrum = np.fft.rfft(rng.standard_normal(len(fine)))
        spectrum[np.fft.rfftfreq(len(fine), 0.02) > 2.0] = 0
        shaken = np.fft.irfft(spectrum, len(fine))
        shaken *= 0.02 / shaken.std()
        track = flown(10.0, seconds=60.0)
        track["z"] += shaken[::5] + 0.013 * rng.standard_normal(len(track))
        track["sz"] = 0.02
        at = np.arange(2.0, 58.0, 0.37)
        found = interpolate(track, at).table
        off = found["z"] - 50 - np.interp(at, fine, shaken)
        assert np.sqrt(np.mean((off / found["sz"]) ** 2)) < 1.5  # 3 without

    @pytest.mark.parametrize(("quality", "name"), [(2, "float"), (5, "single")])
    def test_epochs_that_are_no_fixes_are_not_used_as_fixes(self, quality, name):
        track = flown().assign(quality=1)
        track.loc[200:300, "quality"] = quality
        found = interpolate(track, np.array([20.0, 50.0]))
        fix, other = found.table["sx"]
        assert other > 10 * fix
        assert any(f"{name}) and state the sigmas of fixes" in note for note in found.notes)

    def test_a_track_that_is_turned_round_is_the_same(self):
        track, at = flown(2.0), np.arange(10.0, 90.0, 1.3)
        back = track[::-1].assign(time_s=-track["time_s"]).reset_index(drop=True)
        one, other = interpolate(track, at).table, interpolate(back, -at).table
        for columns in (XYZ, SXYZ):
            assert other[columns].to_numpy() == pytest.approx(one[columns].to_numpy(), abs=1e-7)


class TestMotionInResiduals:
    """Epochs at 5 Hz whose smoother passes nothing: residuals are noise and motion themselves."""

    TIME = np.arange(600) * 0.2

    def found(self, seed, highest_hz, motion):
        rng = np.random.default_rng(seed)
        spectrum = np.fft.rfft(rng.standard_normal(len(self.TIME)))
        spectrum[np.fft.rfftfreq(len(self.TIME), 0.2) > highest_hz] = 0
        shaken = np.fft.irfft(spectrum, len(self.TIME))
        noise = 0.04 * rng.choice([-1.0, 1.0], (len(self.TIME), 1))
        residual = 0.04 * rng.standard_normal((len(self.TIME), 1))
        residual[:, 0] += motion * shaken / shaken.std()
        return left_over(self.TIME, residual, noise, 0 * noise)

    @pytest.mark.parametrize("highest_hz", [1.0, 2.0])
    def test_its_size_is_found_up_to_near_half_the_rate(self, highest_hz):
        """No more than there is: the least that the covariances allow, of six lags at most."""
        sizes = [self.found(seed, highest_hz, 0.05) for seed in range(20)]
        assert 0.03 < np.mean(sizes) < 0.052 and min(sizes) > 0.02

    def test_noise_alone_shows_none_six_times_in_seven(self):
        shown = np.mean([self.found(seed, 1.0, 0.0) > 0 for seed in range(100)])
        assert shown < 1 / 7 + 3 * np.sqrt(6 / 49 / 100)


class TestFiles:
    HEAD = (
        "% program   : RTKPOST ver.demo5\n"
        "%  GPST   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    )
    ROWS = (
        "2021/03/18 12:19:04.623  47.848703631  11.489500183  346.9086  1 16 0.005 0.004 0.008\n"
        "2021/03/18 12:19:06.323  47.848513143  11.490020556  347.1328  1 16 0.005 0.004 0.008\n"
    )

    def test_positions_at_events_are_times_of_images(self, tmp_path):
        (tmp_path / "rover_events.pos").write_text(self.HEAD + self.ROWS)
        found = read_exposures(tmp_path / "rover_events.pos")
        assert found.table["number"].tolist() == [1, 2]
        named = found.named(["b.jpg", "a.jpg"])
        assert named.table["image"].tolist() == ["a.jpg", "b.jpg"]
        with pytest.raises(InputError, match="2 events and there are 1 images"):
            found.named(["a.jpg"])

    def test_any_other_track_is_none(self, tmp_path):
        (tmp_path / "rover.pos").write_text(self.HEAD + self.ROWS)
        with pytest.raises(InputError, match="_events.pos"):
            read_exposures(tmp_path / "rover.pos")

    def test_observations_of_a_receiver_are_named(self, tmp_path):
        head = "     3.03           OBSERVATION DATA    M: Mixed            RINEX VERSION / TYPE\n"
        (tmp_path / "rover.24O").write_text(head)
        with pytest.raises(InputError, match="RINEX"):
            read_exposures(tmp_path / "rover.24O")

    def test_a_deleted_photograph_leaves_its_exposure_out(self):
        table = pd.DataFrame({"number": pd.array([1, 2, 3], dtype="Int64"), "time_s": [0.0, 1, 2]})
        marks = Exposures(table, None, "GPST", None, Path("a.MRK"))
        found = marks.named(["DJI_0001.JPG", "DJI_0003.JPG"])
        assert found.table["image"].tolist() == ["DJI_0001.JPG", "DJI_0003.JPG"]
        assert any("no image has number 2" in note for note in found.notes)

    def test_dji_says_how_good_a_position_is(self):
        assert "single" in status(16) and "float" in status(34) and "fix" in status(50)
        assert "not taken for a fix" in status(52)
