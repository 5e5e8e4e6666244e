"""Where a track is cut, and what is no track."""

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import interpolate, segments


def track(time, x=None, **more):
    time = np.asarray(time, dtype=float)
    table = {"time_s": time, "x": 5.0 * time if x is None else x, "y": 0.0, "z": 50.0}
    return pd.DataFrame(table | more)


def two_flights(standing_s, still=0.0, seed=0):
    """Out, `standing_s` seconds on the ground, and back, at 1 Hz."""
    time = np.arange(0.0, 200.0 + standing_s)
    x = np.interp(time, [0, 100, 100 + standing_s, 200 + standing_s], [0, 500, 500, 0])
    x = x + still * np.random.default_rng(seed).normal(size=len(time))
    return track(time, x)


class TestCuts:
    def test_a_whole_track_is_one_piece(self):
        found = segments(track(np.arange(0, 60, 0.2)))
        assert found[["first", "last", "epochs"]].to_numpy().tolist() == [[0, 299, 300]]
        assert found["interval_s"][0] == pytest.approx(0.2)

    def test_a_long_gap_cuts_and_a_short_one_does_not(self):
        time = np.concatenate([np.arange(0, 20), np.arange(25, 50), np.arange(80, 100)])
        found = segments(track(time))
        assert found["begins"].tolist() == ["track", "gap"]
        assert found[["start_s", "end_s"]].to_numpy().tolist() == [[0, 49], [80, 99]]

    def test_at_one_epoch_in_five_seconds_ten_seconds_are_no_gap(self):
        time = np.concatenate([np.arange(0, 100, 5), np.arange(115, 200, 5)])
        assert len(segments(track(time))) == 1

    def test_another_flight_begins_another_piece_though_the_time_goes_back(self):
        time = np.concatenate([np.arange(50, 100), np.arange(0, 40)])
        found = segments(track(time, flight=["a"] * 50 + ["b"] * 40))
        assert found["flight"].tolist() == ["a", "b"]
        assert found["begins"].tolist() == ["track", "flight"]

    def test_a_battery_change_cuts_in_the_middle_of_standing(self):
        found = segments(two_flights(90))
        assert found["begins"].tolist() == ["track", "standing"]
        assert found["end_s"][0] == found["start_s"][1] == pytest.approx(145, abs=6)

    def test_a_pause_of_half_a_minute_does_not_cut(self):
        assert len(segments(two_flights(30))) == 1

    def test_standing_before_take_off_and_after_landing_stays_with_the_flight(self):
        time = np.arange(0.0, 400.0)
        found = segments(track(time, np.interp(time, [150, 250], [0, 500])))
        assert len(found) == 1

    def test_noise_as_large_as_stated_is_no_motion(self):
        noisy = two_flights(90, still=0.2)
        noisy[["sx", "sy", "sz"]] = 0.2
        assert len(segments(noisy)) == 2

    def test_no_moment_is_lost_at_a_battery_change(self):
        flown = two_flights(90, still=0.005)
        flown[["sx", "sy", "sz"]] = 0.005
        table = interpolate(flown, np.arange(0.5, 289, 0.5), max_sigma=1.0).table
        assert (table["why"] == "").all()
        assert set(table["segment"]) == {0, 1}

    def test_each_piece_has_its_own_noise(self):
        calm, rough = np.arange(0.0, 100.0), np.arange(200.0, 300.0)
        rng = np.random.default_rng(1)
        shaken = np.cumsum(0.3 * rng.normal(size=100)) + 5 * rough
        both = track(np.concatenate([calm, rough]), np.concatenate([5 * calm, shaken]))
        both[["x", "y", "z"]] += 0.005 * rng.normal(size=(200, 3))
        both[["sx", "sy", "sz"]] = 0.005
        noise = interpolate(both, np.array([50.5, 250.5])).noise
        plan = noise[noise["group"] == "plan"]["gust"].to_numpy()
        assert plan[1] > 30 * plan[0]


class TestNoTrack:
    @pytest.mark.parametrize(
        ("time", "sentence"),
        [
            ([0, 1, 2, 1.5, 3], r"epoch 4 of the track: the time goes back at 1.500 s"),
            ([0, 1, 1, 2], r"epoch 3 of the track: the time stands still at 1.000 s"),
            ([0], "a track of 1 epochs cannot be interpolated"),
            ([0, 1, np.nan, 3], "epoch 3 of the track has no time or no position"),
        ],
    )
    def test_one_sentence_names_the_epoch(self, time, sentence):
        with pytest.raises(InputError, match=sentence):
            segments(track(time))

    def test_a_missing_position_is_named_too(self):
        with pytest.raises(InputError, match="epoch 2 of the track has no time or no position"):
            segments(track([0, 1, 2], [0, np.nan, 2]))
