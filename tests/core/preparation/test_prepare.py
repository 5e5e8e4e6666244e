"""What a block knows by itself: every entrance finds the same, and says what it derived."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2
from strips import corridor_block

import corridor
from corridor.core.errors import InputError
from corridor.core.preparation import prepare, velocities
from corridor.core.simulation import add_noise
from corridor.interface.cli import main

VELOCITY, SIGMA = ["vx", "vy", "vz"], ["svx", "svy", "svz"]
TRACK_M = 0.01


def with_a_track_alone(velocities: bool = True):
    """Two calm strips; the receiver's track at 5 Hz in place of gnss.csv."""
    block = corridor_block(
        images=16, strips=2, attitude_jitter_deg=0.0, position_jitter=0.0, velocity_jitter=0.0,
        wind=0.0, observations_per_image=80, control=4, check=2, seed=2,
    )  # fmt: skip
    # Antenna and velocity are those of a drone that flies evenly between two exposures.
    time = block.images["time_s"].to_numpy()
    place = block.gnss[["x", "y", "z"]].to_numpy()
    at = np.arange(time[0] - 1, time[-1] + 1, 0.2)
    track = np.column_stack([np.interp(at, time, column) for column in place.T])
    speed = (place[1] - place[0]) / (time[1] - time[0])
    track[at < time[0]] += (at[at < time[0]] - time[0])[:, None] * speed
    track += TRACK_M * np.random.default_rng(1).standard_normal(track.shape)
    block.track = pd.DataFrame({"time_s": at, **dict(zip("xyz", track.T, strict=True))})
    block.track[["sx", "sy", "sz"]] = TRACK_M
    block.gnss = block.gnss.iloc[:0]
    if not velocities:
        block.images = block.images.drop(columns=VELOCITY)
    return add_noise(block, tie_px=0.3, mark_px=0.3, seed=3)


@pytest.fixture(scope="module")
def track_alone():
    return with_a_track_alone()


@pytest.fixture(scope="module")
def adjusted(track_alone):
    return corridor.adjust(track_alone, camera="fixed")


class TestEveryEntrance:
    def test_adjust_takes_the_positions_that_the_gnss_tool_finds(self, track_alone, adjusted):
        found = corridor.gnss.of_block(track_alone).gnss
        assert len(found) == len(track_alone.images)
        # Sigmas may be estimated anew, where the drone turned on the spot as no drone does.
        place = ["image", "x", "y", "z"]
        pd.testing.assert_frame_equal(adjusted.start.gnss[place], found[place], check_dtype=False)
        assert (adjusted.start.gnss["sx"] >= found["sx"]).all()
        assert "gnss" in adjusted.residuals

    def test_the_command_gives_the_numbers_of_python(self, track_alone, adjusted, tmp_path):
        track_alone.write(tmp_path / "block")
        command = ["adjust", str(tmp_path / "block"), "--camera", "fixed", "-o"]
        assert main([*command, str(tmp_path / "out")]) == 0
        told = corridor.read(tmp_path / "out" / "block")
        for axis in "xyz":
            assert told.images[axis].to_numpy() == pytest.approx(
                adjusted.block.images[axis].to_numpy(), abs=1e-9
            )

    @pytest.mark.slow
    def test_diagnose_sees_the_same_positions(self, track_alone, adjusted):
        found = corridor.diagnose(track_alone, camera="fixed", only=["gnss_bias"])
        place = ["image", "x", "y", "z"]
        pd.testing.assert_frame_equal(found.block.gnss[place], adjusted.start.gnss[place])
        assert [one["column"] for one in found.to_dict()["derived"]] == ["gnss"]

    def test_a_clock_of_another_day_is_refused_not_stretched(self, track_alone):
        block = track_alone.copy()
        block.track = block.track.assign(time_s=block.track["time_s"] + 86400.0)
        with pytest.raises(InputError, match="common clock"):
            corridor.adjust(block, camera="fixed")


class TestVelocities:
    def test_a_shutter_is_adjusted_and_diagnosed_without_velocities(self):
        """Put in with the true velocities, found with those that the track tells."""
        block = corridor.effects.add(with_a_track_alone(), {"rolling_shutter": {"readout": 0.03}})
        block.images = block.images.drop(columns=VELOCITY)
        found = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"]).effects.iloc[0]
        assert found["value"] == pytest.approx(0.03, abs=4 * found["sigma"])
        assert found["sigma"] < 0.003
        told = corridor.diagnose(block, camera="fixed", only=["rolling_shutter", "gnss_bias"])
        assert not told.untestable
        assert {"gnss", "images.vx", "images.vy", "images.vz"} <= {
            one["column"] for one in told.to_dict()["derived"]
        }

    @pytest.mark.parametrize("source", ["gnss.csv", "track.csv", "the poses of images.csv"])
    def test_they_are_right_within_their_sigmas(self, source):
        if source == "track.csv":
            block = with_a_track_alone()
        else:
            block = corridor_block(
                images=60, observations_per_image=40, velocity_jitter=0.0, seed=4
            )
            block = add_noise(block, gnss_m=0.02, seed=5)
        if source.startswith("the poses"):
            block.images = block.images.assign(
                **block.gnss.set_index("image")[list("xyz")]
                .loc[block.images["image"]]
                .reset_index(drop=True)
            )
            block.gnss = block.gnss.iloc[:0]
        true = block.images[VELOCITY].to_numpy()
        block.images = block.images.drop(columns=VELOCITY)
        made, derived, _ = prepare(block)
        off = made.images[VELOCITY].to_numpy() - true
        if source == "track.csv":
            # At the ends of a strip this drone turns on the spot, which none does.
            off[[0, 7, 8, 15]] = np.nan
        ratio = off / made.images[SIGMA].to_numpy()
        assert {one.source for one in derived if one.column == "images.vx"} == {source}
        # Errors of neighbouring images are not independent, and the flight is no random walk.
        assert np.sqrt(np.nanmean(ratio**2)) < 1.5
        assert np.sqrt(np.nanmean(off**2)) < 0.4

    def test_a_drone_that_brakes_between_two_images_has_a_large_sigma_there(self):
        """It stands for 25 s between two runs at 6 m/s; positions every 5 s."""
        time = np.arange(0, 150, 5.0)
        place = 6.0 * np.minimum(time, 60) + 6.0 * np.maximum(time - 85, 0)
        block = corridor_block(images=30, strips=1, observations_per_image=40, seed=1)
        zero = np.zeros(30)
        block.images = block.images.assign(time_s=time).drop(columns=VELOCITY)
        block.gnss = block.gnss.assign(x=place, y=zero, z=zero + 50.0)
        images = prepare(block).block.images
        calm, braking = images["svx"].iloc[4:9].median(), images["svx"].iloc[11:14].max()
        assert braking > 3 * calm
        assert np.abs(images["vx"].iloc[4:9] - 6).max() < 0.5
        assert np.abs(images["vx"].iloc[14:16]).max() < 0.5

    def test_given_ones_are_kept_and_only_the_gaps_are_filled(self):
        block = corridor_block(images=20, strips=1, observations_per_image=40)
        given = block.images[VELOCITY].copy()
        block.images.loc[3, "vx"] = np.nan
        made = prepare(block).block.images
        pd.testing.assert_frame_equal(made[VELOCITY].drop(3), given.drop(3))
        assert made[VELOCITY].notna().all(axis=None)
        assert made[SIGMA].drop(3).isna().all(axis=None)


class TestPreparing:
    def test_a_model_without_effects_looks_at_no_velocities(self):
        block = with_a_track_alone(velocities=False)
        plain = corridor.adjust(block, camera="fixed").block
        assert len(plain.gnss) and not plain.has("images.vx")
        shutter = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"]).block
        assert shutter.has("images.vx") and not block.has("images.vx")

    def test_a_block_that_has_all_is_left_as_it_is(self):
        block = corridor_block(images=12, strips=1, observations_per_image=40)
        assert prepare(block) == (block, [], [])

    def test_twice_is_once(self):
        once = prepare(with_a_track_alone(velocities=False))
        twice = prepare(once.block)
        assert twice.block is once.block
        assert twice.derived == once.derived

    def test_the_block_handed_in_is_not_changed(self):
        block = with_a_track_alone(velocities=False)
        prepare(block)
        assert not len(block.gnss) and "vx" not in block.images and not block.extra

    def test_a_written_block_still_says_what_was_derived(self, tmp_path):
        made = prepare(with_a_track_alone(velocities=False))
        made.block.write(tmp_path / "block")
        again = prepare(corridor.read(tmp_path / "block"))
        assert again.derived == made.derived

    def test_who_asks_for_velocities_by_a_method_is_not_given_derived_ones(self):
        block = with_a_track_alone(velocities=False)
        block.track = block.track.iloc[:0]
        made = prepare(block).block
        assert "vx" in made.images
        assert velocities(made).method == velocities(block).method != "metadata"

    @pytest.mark.parametrize("lost", ["time_s", "x"])
    def test_what_is_missing_never_stops_it(self, lost):
        block = with_a_track_alone(velocities=False)
        block.images[lost] = np.nan
        prepare(block)

    def test_flights_are_those_of_the_track(self):
        block = with_a_track_alone(velocities=False)
        time = block.track["time_s"]
        # A pause between two flights, in which no image was taken.
        cut = block.images["time_s"].iloc[7:9].mean()
        block.track = block.track.assign(flight=np.where(time < cut, "A", "B"))
        block.images = block.images.drop(columns="flight")
        made = prepare(block)
        assert made.block.images["flight"].tolist() == ["A"] * 8 + ["B"] * 8
        assert "images.flight" in [one.column for one in made.derived]

    def test_rates_at_the_exposures_come_from_the_gyroscope(self):
        block = corridor_block(images=12, strips=1, observations_per_image=40)
        block.images = block.images.drop(columns=["wx", "wy", "wz"])
        time = np.linspace(block.images["time_s"].min() - 1, block.images["time_s"].max() + 1, 500)
        block.rates = pd.DataFrame({"time_s": time, "wx": 0.01 * time, "wy": 0.0, "wz": 0.02})
        made = prepare(block).block.images
        assert made["wx"].to_numpy() == pytest.approx(0.01 * made["time_s"].to_numpy())
        assert made["wz"].to_numpy() == pytest.approx(0.02)


class TestWholeSeconds:
    """A drone that stops at the ends of its strips; positions to 0.3 m, stamps to whole seconds."""

    @staticmethod
    def flown(seed):
        """The block as a camera tells of it, and what its velocities were (n, 3) m/s."""
        rng = np.random.default_rng(seed)
        at = np.arange(0.0, 220.0, 0.1)
        # 6.5 m/s for 34 s, 2 s to stop, 4 s still, sideways by 24 m, 4 s still, and back.
        phase, strip = np.mod(at, 55.0), (at // 55.0).astype(int)
        knots = [0, 2, 36, 38, 42, 44, 49, 51, 55]
        along = np.interp(phase, knots, [0, 6.5, 6.5, 0, 0, 0, 0, 0, 0]) * np.where(
            strip % 2, -1, 1
        )
        aside = np.interp(phase, knots, [0, 0, 0, 0, 0, 3.4, 3.4, 0, 0])
        speed = np.stack([aside, along, 0 * at], axis=1)
        place = np.cumsum(speed, axis=0) * 0.1
        taken = np.flatnonzero(np.mod(np.arange(len(at)), 21) == 0)
        n = len(taken)
        names = pd.Series([f"i{k:03d}" for k in range(n)], dtype="str")
        block = corridor_block(images=16, strips=2, observations_per_image=20)
        position = place[taken] + rng.normal(0, 0.3, (n, 3))
        block.images = pd.DataFrame(
            {"image": names, "camera": next(iter(block.cameras)), "time_s": np.round(at[taken])}
        )
        block.gnss = pd.DataFrame(
            {"image": names, **dict(zip("xyz", position.T, strict=True))}
        ).assign(sx=3.0, sy=3.0, sz=6.0)
        return block, speed[taken]

    def test_a_stop_is_no_cruise_and_sigmas_are_honest(self):
        """One quadratic a strip says 5 m/s where the drone of a real survey stood."""
        error, sigma, still = [], [], []
        for seed in range(4):
            block, true = self.flown(seed)
            found = velocities(block)
            assert found.method == "gnss"
            cruising = np.abs(true[:, 1]) == 6.5
            error.append(found.velocity[cruising, 1] - true[cruising, 1])
            sigma.append(found.sigma[cruising])
            still.append(found.speed[np.linalg.norm(true, axis=1) < 0.1])
        ratio = np.concatenate(error) / np.concatenate(sigma)
        # Neighbours share their errors, and all of a block the slope of the smooth curve: one in
        # six is new.
        many = len(ratio) / 6
        low, high = np.sqrt(chi2.ppf([0.001, 0.999], many) / many)
        assert low < np.sqrt(np.mean(ratio**2)) < high
        # A mean between the positions before and after: they are metres from where it stood.
        assert np.median(np.concatenate(still)) < 1.0
