"""Against flights known at every moment: how far off, and does the sigma say so."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from turbulent_flight import SIGMA, exposures, fly, observed, slow_noise

from corridor.core.gnss import interpolate

SEEDS = (1, 2)
XYZ, SXYZ = ["x", "y", "z"], ["sx", "sy", "sz"]


@cache
def flown(seed, **motion):
    return fly(seed, **motion)


@cache
def errors(method, motion=(), seeds=SEEDS, told=(), **receiver):
    """Errors and errors over sigma, (n, 3) each, and whether the drone turned, of all seeds."""
    error, ratio, turning = [], [], []
    for seed in seeds:
        flight = flown(seed, **dict(motion))
        track = observed(flight, seed, **receiver)
        at = exposures(track, seed)
        made = interpolate(track, at, method, max_sigma=10.0, **dict(told)).table
        assert (made["why"] == "").all()
        error.append(made[XYZ].to_numpy() - flight.position(at))
        ratio.append(error[-1] / made[SXYZ].to_numpy())
        turning.append(flight.turning(at))
    return np.vstack(error), np.vstack(ratio), np.concatenate(turning)


def rms(values):
    return np.sqrt(np.mean(np.sum(np.square(values), axis=1)))


def scatter(values):
    return np.sqrt(np.mean(np.square(values)))


class TestTurbulentFlightAtOneHertz:
    """The noise is 13.9 mm in 3D."""

    def test_the_error_is_at_most_085_of_the_parabola_and_065_of_linear(self):
        smoother, parabola, linear = (
            rms(errors(method)[0]) for method in ("smoother", "parabola", "linear")
        )
        assert smoother <= 0.85 * parabola
        assert smoother <= 0.65 * linear

    def test_it_is_no_worse_than_the_cubic_spline(self):
        assert rms(errors("smoother")[0]) <= 1.01 * rms(errors("spline")[0])

    def test_velocities_of_3_cm_s_bring_it_to_065_of_the_parabola(self):
        with_velocity = rms(errors("smoother", velocity=0.03)[0])
        assert with_velocity <= 0.65 * rms(errors("parabola")[0])

    @pytest.mark.parametrize("velocity", [None, 0.03])
    @pytest.mark.parametrize("part", ["strips", "turns"])
    def test_error_over_sigma_holds_in_strips_and_in_turns(self, part, velocity):
        _, ratio, turning = errors("smoother", velocity=velocity)
        rows = turning if part == "turns" else ~turning
        assert 0.6 <= scatter(ratio[rows][:, :2]) <= 1.3
        assert 0.6 <= scatter(ratio[rows][:, 2]) <= 1.3

    def test_the_sigma_of_the_parabola_does_not_hold_in_turns(self):
        _, ratio, turning = errors("parabola")
        assert scatter(ratio[turning][:, :2]) > 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "motion",
    [
        dict(speed=10.0, length=400.0, gust=0.05),
        dict(speed=7.0, length=300.0, gust=0.3),
        dict(gust=0.02),
        dict(speed=5.0, brake=3.0, gust=0.1, lags=(0.7, 0.1)),
    ],
    ids=["fast and calm", "storm", "dead calm", "hard turns"],
)
@pytest.mark.parametrize("receiver", [dict(interval=1.0), dict(interval=0.2)], ids=["1 Hz", "5 Hz"])
def test_error_over_sigma_holds_whatever_the_weather(motion, receiver):
    _, ratio, turning = errors("smoother", motion=tuple(motion.items()), **receiver)
    for rows in (turning, ~turning):
        assert 0.6 <= scatter(ratio[rows]) <= 1.3


class TestSlowNoise:
    """Half a minute to minutes of correlation, as GNSS has it: it cannot be smoothed away."""

    def test_at_5_hz_it_is_found_and_the_sigma_holds(self):
        _, ratio, _ = errors("smoother", seeds=SEEDS[:2], interval=0.2, slow=0.9)
        assert 0.6 <= scatter(ratio) <= 1.3

    def test_taken_for_white_it_makes_the_sigma_a_lie(self):
        told = (("slow_share", 0.0),)
        _, ratio, _ = errors("smoother", seeds=SEEDS[:1], interval=0.2, slow=0.9, told=told)
        # 0.9 of the variance slow: sqrt(0.9) of the sigma of one epoch, in place of what is left of
        # it by smoothing; the part that hangs together like motion is in the sigma.
        assert scatter(ratio) > 1.2

    def test_at_1_hz_the_sigma_holds_with_what_is_known(self):
        _, ratio, _ = errors("smoother", slow=0.9, told=(("slow_share", 0.9),))
        assert 0.6 <= scatter(ratio) <= 1.3

    def test_at_1_hz_the_sigma_holds_unaided(self):
        _, ratio, _ = errors("smoother", slow=0.9)
        assert 0.6 <= scatter(ratio) <= 1.3

    def test_white_noise_at_5_hz_is_seen_to_be_white_and_smoothed(self):
        flight = flown(1)
        track = observed(flight, 1, interval=0.2)
        at = exposures(track, 1)
        made = interpolate(track, at)
        assert (made.noise["slow"] < 0.2).all()
        smoothed, through = (
            rms(interpolate(track, at, method).table[XYZ].to_numpy() - flight.position(at))
            for method in ("smoother", "spline")
        )
        # Some three epochs share in each moment of a flight shaken once a second.
        assert smoothed < 0.75 * through


def test_the_sigma_holds_where_fixed_becomes_float_and_back():
    """A quarter of the flight is float: 20 cm of slow error, from anew at each change."""
    ratios, fixed = [], []
    for seed in range(1, 5):
        flight = flown(seed)
        track = observed(flight, seed, interval=0.5, slow=0.9)
        time = track["time_s"].to_numpy()
        rng = np.random.default_rng([seed, 3])
        loose = (time % 80) > 60
        added = np.zeros((len(time), 3))
        for first in np.flatnonzero(loose & ~np.append(False, loose[:-1])):
            rows = (time >= time[first]) & (time < time[first] + 30) & loose
            added[rows] = 0.2 * slow_noise(rng, time[rows], 60.0)
        track[XYZ] += added
        track.loc[loose, SXYZ] = np.hypot(track.loc[loose, SXYZ], 0.2)
        at = exposures(track, seed)
        made = interpolate(track, at, max_sigma=10.0).table
        ratio = (made[XYZ].to_numpy() - flight.position(at)) / made[SXYZ].to_numpy()
        floating = ((at % 80) > 61) & ((at % 80) < 79)
        ratios.append(ratio[floating])
        fixed.append(ratio[(at % 80 > 5) & (at % 80 < 55)])
        assert np.median(made[SXYZ].to_numpy()[floating]) > 0.03
    # Some 50 stretches and axes that are independent: 10 % of scatter, and heavy tails.
    assert 0.5 <= scatter(np.vstack(ratios)) <= 1.5
    assert 0.6 <= scatter(np.vstack(fixed)) <= 1.3


class TestWhatTheTrackDoesNotState:
    def test_without_sigmas_the_scatter_is_found(self):
        flight = flown(1)
        track = observed(flight, 1, interval=0.2).drop(columns=SXYZ)
        made = interpolate(track, exposures(track, 1))
        # The grid of the search has steps of 1.8.
        assert made.noise["sigma_m"].to_numpy() == pytest.approx(SIGMA[[0, 2]], rel=0.45)
        assert any("states no standard deviations" in note for note in made.notes)

    def test_the_sigma_of_the_velocities_is_found(self):
        flight = flown(2)
        track = observed(flight, 2, interval=0.2, velocity=0.1)
        made = interpolate(track, exposures(track, 2))
        assert made.noise["velocity_sigma"].to_numpy() == pytest.approx([0.1, 0.1], rel=0.45)

    def test_stated_sigmas_of_the_velocities_are_used(self):
        flight = flown(1)
        track = observed(flight, 1, velocity=0.03)
        track[["svx", "svy", "svz"]] = 0.03
        at = exposures(track, 1)
        made = interpolate(track, at)
        assert made.noise["velocity_sigma"].isna().all()
        without = interpolate(track, at, velocities=False)
        truth = flight.position(at)
        assert rms(made.table[XYZ].to_numpy() - truth) < 0.8 * rms(
            without.table[XYZ].to_numpy() - truth
        )

    def test_the_velocity_at_the_exposures_comes_along(self):
        flight = flown(1)
        track = observed(flight, 1, interval=0.2)
        at = exposures(track, 1)
        made = interpolate(track, at).table[["vx", "vy", "vz"]].to_numpy()
        # Two epochs of 7 mm, 0.2 s apart, say 5 cm/s; the smoother must know more.
        assert scatter(made - flight.velocity(at)) < 0.05


def made(track, at):
    return interpolate(track, at).table


@pytest.fixture(scope="module")
def given():
    track = observed(flown(1), 1)
    at = exposures(track, 1, count=200)
    return track, at, made(track, at)


class TestWhateverTheFrame:
    def test_a_quarter_turn_of_the_axes_turns_the_result(self, given):
        track, at, before = given
        turned = made(track.assign(x=-track["y"], y=track["x"]), at)
        # The likelihood is summed in another order: micrometres, not bits.
        assert turned["x"].to_numpy() == pytest.approx(-before["y"].to_numpy(), abs=1e-6)
        assert turned["sy"].to_numpy() == pytest.approx(before["sx"].to_numpy(), abs=1e-6)

    def test_far_from_the_origin_and_late_in_the_week_nothing_changes(self, given):
        track, at, before = given
        far = track.assign(x=track["x"] + 7e5, y=track["y"] + 5e6, time_s=track["time_s"] + 6e5)
        moved = made(far, at + 6e5)
        assert moved["x"].to_numpy() - 7e5 == pytest.approx(before["x"].to_numpy(), abs=1e-6)
        assert moved["sz"].to_numpy() == pytest.approx(before["sz"].to_numpy(), abs=1e-6)

    def test_flown_backwards_it_is_the_same_flight(self, given):
        track, at, before = given
        back = track[::-1].assign(time_s=-track["time_s"])
        turned = made(back.reset_index(drop=True), -at)
        # Noise is found from forward likelihoods: a part of the sigma may differ.
        apart = (turned[XYZ] - before[XYZ]).abs().to_numpy() / before[SXYZ].to_numpy()
        assert np.percentile(apart, 99) < 0.3
        assert turned["sx"].to_numpy() == pytest.approx(before["sx"].to_numpy(), rel=0.15)

    def test_the_order_of_the_times_does_not_matter(self, given):
        track, at, before = given
        shuffled = np.random.default_rng(0).permutation(len(at))
        pd.testing.assert_frame_equal(
            made(track, at[shuffled]).reset_index(drop=True),
            before.iloc[shuffled].reset_index(drop=True),
        )


def test_a_camera_delay_of_17_ms_at_7_m_s_is_12_cm():
    """rtklibexplorer/RTKLIB issue 71, the user's own arithmetic."""
    time = np.arange(0, 60, 0.2)
    track = pd.DataFrame({"time_s": time, "x": 7.0 * time, "y": 0.0, "z": 80.0})
    track[SXYZ] = 0.01
    at = np.linspace(10, 50, 30)
    for method in ("smoother", "parabola", "linear"):
        early, late = (interpolate(track, at + delay, method).table for delay in (0, 0.017))
        assert (late["x"] - early["x"]).to_numpy() == pytest.approx(0.12, abs=0.002)


def shaken(seed, size, highest, rate=1.0, count=180):
    """A straight flight at 5 m/s whose position has a flat spectrum up to `highest` Hz: epochs,
    and times and true places between them."""
    rng = np.random.default_rng([seed, 40])
    fine = np.arange(0, count / rate, 0.02)
    spectrum = np.fft.rfft(rng.standard_normal((len(fine), 3)), axis=0)
    frequency = np.fft.rfftfreq(len(fine), 0.02)
    spectrum[(frequency > highest) | (frequency < 0.05)] = 0
    motion = np.fft.irfft(spectrum, len(fine), axis=0)
    place = size * motion / motion.std(axis=0) + fine[:, None] * [5.0, 0, 0]
    rows = np.arange(0, len(fine), round(50 / rate))
    table = pd.DataFrame({"time_s": fine[rows]})
    table[XYZ] = place[rows] + rng.normal(0, [0.008, 0.008, 0.015], (len(rows), 3))
    table[SXYZ] = [0.008, 0.008, 0.015]
    at = rng.uniform(2, fine[rows[-1]] - 2, 100)
    return table, at, np.stack([np.interp(at, fine, one) for one in place.T], axis=1)


@pytest.mark.parametrize(("size", "highest"), [(0.03, 1.5), (0.05, 2.0), (0.04, 1.0)])
def test_motion_that_one_epoch_a_second_cannot_show_is_in_the_sigma_and_told(size, highest):
    ratio = []
    for seed in range(4):
        table, at, true = shaken(seed, size, highest)
        made = interpolate(table, at, max_sigma=10.0)
        ratio.append((made.table[XYZ].to_numpy() - true) / made.table[SXYZ].to_numpy())
        assert any("shaken faster than 1 epochs" in n or "cannot show" in n for n in made.notes)
    assert 0.5 <= scatter(np.vstack(ratio)) <= 1.3
    assert np.abs(np.vstack(ratio)).max() < 5


def test_a_flight_that_epochs_show_is_not_called_shaken():
    for seed in range(4):
        table, at, true = shaken(seed, 0.10, 0.08)
        made = interpolate(table, at, max_sigma=10.0)
        assert not any("shaken" in note for note in made.notes)
        off = (made.table[XYZ].to_numpy() - true) / made.table[SXYZ].to_numpy()
        assert 0.4 <= scatter(off) <= 1.4
