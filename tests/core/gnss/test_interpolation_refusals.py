"""Which exposures get no position, and what is said of them."""

import numpy as np
import pandas as pd
import pytest
from turbulent_flight import fly, observed

from corridor.core.errors import InputError
from corridor.core.gnss import interpolate
from corridor.core.gnss.interpolation import segments
from corridor.core.gnss.interpolation.blunders import blunder_epochs, singular_epochs

SXYZ = ["sx", "sy", "sz"]


def steady(seconds=100, interval=0.2, speed=5.0, sigma=0.01, seed=0):
    time = np.arange(0, seconds, interval)
    track = pd.DataFrame({"time_s": time, "x": speed * time, "y": 0.0, "z": 80.0})
    track[["x", "y", "z"]] += sigma * np.random.default_rng(seed).normal(size=(len(time), 3))
    track[SXYZ] = sigma
    return track


def without(track, low, high):
    return track[(track["time_s"] <= low) | (track["time_s"] >= high)].reset_index(drop=True)


class TestOutsideTheTrack:
    def test_each_refusal_says_why(self):
        track = without(steady(), 40.0, 60.0)
        at = np.array([-1.0, 10.0, 50.0, 120.0, np.nan])
        table = interpolate(track, at).table
        assert list(table["why"]) == [
            "before the track begins",
            "",
            "in a gap of the track",
            "after the track ends",
            "no time",
        ]
        assert table[["x", "sx"]].isna().all(axis=1).tolist() == [True, False, True, True, True]
        assert table["segment"].tolist() == [-1, 0, -1, -1, -1]

    def test_the_first_and_the_last_epoch_are_inside(self):
        track = steady()
        at = track["time_s"].iloc[[0, -1]].to_numpy()
        assert (interpolate(track, at).table["why"] == "").all()

    def test_a_time_that_two_flights_cover_is_refused_unless_its_flight_is_named(self):
        track = pd.concat([steady().assign(flight="a"), steady(seed=1).assign(flight="b", y=9.0)])
        at = np.array([50.0, 50.0])
        assert set(interpolate(track, at).table["why"]) == {
            "two flights of the track cover this time"
        }
        named = interpolate(track, at, flight=np.array(["a", "b"])).table
        assert (named["why"] == "").all()
        assert named["y"].to_numpy() == pytest.approx([0.0, 9.0], abs=0.05)


class TestBySigmaNotByTheGap:
    def test_the_same_gap_is_good_on_a_calm_line_and_refused_in_a_storm(self):
        """Three seconds without epochs, at 5 Hz."""
        calm = without(steady(), 50.0, 53.0)
        storm = without(observed(fly(1, gust=0.5), 1, interval=0.2), 50.0, 53.0)
        at = np.array([51.5])
        assert interpolate(calm, at).table["why"][0] == ""
        refused = interpolate(storm, at).table
        assert "is above 0.1 m" in refused["why"][0]
        # The numbers stay for whoever wants to see them.
        assert refused["sx"][0] > 0.1 and np.isfinite(refused["x"][0])

    def test_the_limit_is_the_user_s(self):
        at = np.array([20.1])
        assert interpolate(steady(), at, max_sigma=0.02).table["why"][0] == ""
        assert interpolate(steady(), at, max_sigma=0.001).table["why"][0] != ""

    def test_float_and_single_epochs_count_by_their_sigma(self):
        track = observed(fly(1), 1, interval=0.2)
        track["quality"] = 1.0
        bad = track["time_s"].between(50, 70)
        rng = np.random.default_rng(3)
        track.loc[bad, SXYZ] = 1.5
        track.loc[bad, ["x", "y", "z"]] += 1.5 * rng.normal(size=(int(bad.sum()), 3))
        track.loc[bad, "quality"] = 5.0
        table = interpolate(track, np.array([30.0, 60.0, 90.0])).table
        assert (table["why"] == "").tolist() == [True, False, True]
        assert table.loc[[0, 2], "sx"].max() < 0.02

    def test_one_epoch_where_no_drone_can_be_is_left_out_and_told(self):
        """Half of its height, with the sigma of all others; images nearby are as good as before."""
        track, at = steady(), np.array([30.05, 49.93, 50.0, 50.1, 70.0])
        whole = interpolate(track, at).table
        track.loc[250, "z"] /= 2
        found = interpolate(track, at)
        assert any("that at 50.000 s by 40.0" in note for note in found.notes)
        assert found.table["z"].to_numpy() == pytest.approx(whole["z"].to_numpy(), abs=0.02)
        assert (found.table["sz"] < 0.02).all()

    @pytest.mark.parametrize("seed", range(3))
    def test_no_epoch_of_a_storm_or_of_coarse_fixes_is_left_out(self, seed):
        storm = observed(fly(seed, gust=0.5), seed, interval=0.2)
        coarse = steady(sigma=1.5, seed=seed).drop(columns=SXYZ)
        for track in (storm, coarse):
            assert blunder_epochs(track, segments(track)) == {}

    def test_one_epoch_that_stands_out_of_its_noise_alone_is_left_out_and_told(self):
        """Up and down again within 0.4 s: a drone can do it, and none does."""
        track, at = steady(), np.array([50.05])
        whole = interpolate(track, at).table
        track.loc[250, "z"] += 0.3
        found = interpolate(track, at)
        assert any("that at 50.000 s by 0.3" in note for note in found.notes)
        assert found.table["z"].to_numpy() == pytest.approx(whole["z"].to_numpy(), abs=0.02)

    def test_an_epoch_off_by_five_sigmas_is_told_and_one_off_by_four_is_not(self):
        """Of a cubic through four epochs: 1 + 34 / 36 of the variance of one."""
        track = steady()
        noise = 0.01 * np.sqrt(1 + 34 / 36)
        for sigmas, told in ((4.0, 0), (5.5, 1)):
            track["z"] = 0.0
            track.loc[250, "z"] = sigmas * noise
            assert len(singular_epochs(track.assign(sz=0.01), segments(track))) == told

    def test_one_epoch_that_hardly_counts_is_told(self):
        track, at = steady(), np.array([50.05])
        assert not any("hardly counts" in note for note in interpolate(track, at).notes)
        track.loc[250, "sx"] = 5.0
        told = interpolate(track, at).notes
        assert any("the epoch at 50.000 s states 500 times the usual" in note for note in told)

    @pytest.mark.parametrize("seed", range(3))
    def test_no_epoch_of_a_flight_with_turns_and_gusts_stands_out(self, seed):
        for gust in (0.0, 0.5):
            track = observed(fly(seed, gust=gust), seed, interval=0.2)
            assert singular_epochs(track, segments(track)) == []

    def test_epochs_that_are_missing_are_counted(self):
        track, at = steady(), np.array([30.05])
        thin = track.drop(index=np.random.default_rng(1).choice(np.arange(1, 499), 200, False))
        said = "200 of 499 epochs at intervals of 0.2 s are missing"
        assert any(said in note for note in interpolate(thin.reset_index(drop=True), at).notes)
        assert not any("missing" in note for note in interpolate(track, at).notes)

    def test_a_track_that_jumps_keeps_all_its_epochs(self):
        track = steady()
        track.loc[250:, "x"] += 30.0
        assert blunder_epochs(track, segments(track)) == {}

    def test_one_single_epoch_among_fixes_does_no_harm(self):
        track = steady()
        track.loc[250, SXYZ] = 3.0
        track.loc[250, ["x", "y", "z"]] += 2.5
        at = track["time_s"].iloc[[250]].to_numpy()
        table = interpolate(track, at).table
        assert table["x"][0] == pytest.approx(5.0 * at[0], abs=0.03)
        assert table["sx"][0] < 0.03

    def test_without_sigmas_quality_tells_float_from_fix(self):
        track = steady()
        track["quality"] = 1.0
        bad = track["time_s"].between(50, 70)
        track.loc[bad, ["x", "y", "z"]] += 0.2 * np.random.default_rng(3).normal(
            size=(int(bad.sum()), 3)
        )
        track.loc[bad, "quality"] = 2.0
        table = interpolate(track.drop(columns=SXYZ), np.array([30.0, 60.0])).table
        assert table["sx"][1] > 3 * table["sx"][0]

    def test_a_sigma_of_zero_is_an_unknown_one(self):
        track = steady()
        track.loc[100:120, "sx"] = 0.0
        track.loc[130, "sz"] = np.nan
        made = interpolate(track, np.array([22.0]))
        assert made.table["why"][0] == ""
        assert 0.001 < made.table["sx"][0] < 0.02
        assert any("22 epochs state no sigma" in note for note in made.notes)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (dict(method="magic"), "method 'magic' is not known"),
        (dict(max_sigma=0.0), "the largest sigma is 0 m"),
        (dict(slow_share=1.0), "the slow share is 1"),
    ],
)
def test_a_wrong_option_is_named(change, sentence):
    with pytest.raises(InputError, match=sentence):
        interpolate(steady(), np.array([1.0]), **change)


def test_no_times_give_an_empty_table():
    made = interpolate(steady(), np.array([]))
    assert len(made.table) == 0 and len(made.good) == 0
