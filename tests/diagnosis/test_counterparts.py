"""The simulated counterparts of a block: drawn from what was believed, adjusted as it was."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from believing import NOISE, believed, flown

import corridor
from corridor import diagnosis
from corridor.core.errors import InputError
from corridor.diagnosis.bootstrap.replicator import (
    GRID,
    Replicator,
    _signals,
    _with_signals,
    lengths,
)
from corridor.diagnosis.bootstrap.statistics import Fit, SummaryStatistics
from corridor.diagnosis.noise.gnss import stated_noise
from corridor.diagnosis.noise.likelihood import Arguments, value_of
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import take_apart


@pytest.fixture(scope="module")
def adjusted():
    return believed(flown())


@pytest.fixture(scope="module")
def model(adjusted):
    return Replicator(adjusted)


@pytest.fixture(scope="module")
def found(adjusted):
    return diagnosis.counterparts(adjusted, 19, seed=3)


def test_rounding_moves_no_likelihood_of_the_antennas_noise(adjusted):
    """What effects of the antenna can do is projected out; nearly singular, it moved it by 0.1."""
    system = replace(adjusted.system, gnss_counts=False)
    noise = stated_noise(system)
    e, rows = _with_signals(take_apart(system, []), _signals(system), 10.0)
    arguments = Arguments(noise, ((1e-3, 1e2), (1e-3, 1e2), (1.0, 100.0)))
    x = arguments.of(replace(noise, white=1.0 + 0.0 * noise.white, coloured=0.02 + noise.coloured))
    found, rng = [], np.random.default_rng(1)
    for size in (0.0, 1e-15, 1e-15):
        matrix = e.matrix.copy()
        matrix.data = matrix.data * (1.0 + size * rng.standard_normal(len(matrix.data)))
        made = Elimination(replace(e, matrix=matrix, kept={}), arguments.noise_at(x), rows)
        found.append(value_of(made, arguments, x))
    assert np.ptp(found) < 1e-3


class TestDrawing:
    def test_the_same_seed_gives_the_same_numbers_whatever_the_threads(self, adjusted, found):
        said = []
        again = diagnosis.counterparts(
            adjusted, 19, seed=3, threads=2, progress=lambda step: said.append((step.done, step.of))
        )
        assert np.array_equal(again.simulated, found.simulated)
        assert np.array_equal(again.measured, found.measured)
        assert len(said) == 3 and said == sorted(said) and said[-1] == (19, 19)

    def test_another_seed_draws_others(self, model):
        one, two = (model.draw(np.random.default_rng([seed, 0])) for seed in (3, 4))
        assert not np.any(one.xy == two.xy) and not np.any(one.gnss == two.gnss)

    def test_too_few_for_a_band_are_refused(self, adjusted):
        with pytest.raises(InputError, match="ask for 19 or more"):
            diagnosis.counterparts(adjusted, 18)

    def test_residuals_of_a_counterpart_are_as_long_as_those_measured(self, model):
        """Six counterparts of 3,000 observations: the median is known to 1 %, the tail to 5 %."""
        ties = model.is_tie & ~model.held_out
        sigma = model.sigma[ties, None]
        again = model.fits([model.draw(np.random.default_rng(k)) for k in range(6)])
        drawn = lengths(np.concatenate([fit.pixels[ties] / sigma for fit in again]))
        measured = lengths(model.fit.pixels[ties] / sigma)
        at = [np.searchsorted(GRID, p) for p in (0.25, 0.5, 0.9)]
        assert drawn[at] == pytest.approx(measured[at], rel=0.04)


class TestFits:
    """Right sides of one factorisation stand for adjustments anew."""

    @pytest.mark.parametrize(
        ("loss", "usual", "nearly_all"), [("squares", 0.003, 0.03), ("cauchy:1.4", 0.04, 0.3)]
    )
    def test_statistics_are_those_of_full_adjustments(self, loss, usual, nearly_all):
        """In standard deviations of a statistic, which 20 counterparts know to 16 %."""
        model = Replicator(believed(flown(), loss=loss))
        drawn = [model.draw(np.random.default_rng([0, k])) for k in range(7)]
        values = SummaryStatistics(model)
        linear, full = values(model.fits(drawn)), values([adjusted_anew(model, d) for d in drawn])
        spread = full.std(axis=0, ddof=1)
        there = linear.std(axis=0) > 1e-9  # a lever arm takes all of the mean up
        apart = np.sqrt(np.mean((linear - full)[:, there] ** 2, axis=0)) / spread[there]
        assert np.median(apart) < usual
        assert np.quantile(apart, 0.99) < nearly_all
        ratio = linear[:, there].std(axis=0, ddof=1) / spread[there]
        assert np.median(ratio) == pytest.approx(1.0, abs=0.01)

    def test_a_prior_pulls_as_it_does_in_a_full_adjustment(self):
        """Half of what is known of the focal length comes from the prior, drawn anew each time."""
        block = flown()
        (camera,) = block.cameras
        prior = {f"camera.{camera}.f": (block.cameras[camera]["f"], 0.5)}
        model = Replicator(believed(block, priors=prior))
        drawn = model.draw(np.random.default_rng(5))
        (linear,), full = model.fits([drawn]), adjusted_anew(model, drawn)
        moved = full.pixels - model.fit.pixels
        assert np.abs(linear.pixels - full.pixels).max() < 0.01 * np.abs(moved).max()
        assert linear.gnss == pytest.approx(full.gnss, abs=0.01 * np.abs(full.gnss).max())


def adjusted_anew(model, drawn):
    """The fit of a counterpart by iterations from the measured block's."""
    system = model.system.measuring(
        drawn.xy, gnss=drawn.gnss, control=drawn.control, prior=drawn.prior
    ).minimised(100, 1e-4, near=True)
    left, state = system.residuals(), system.state
    check = state.points[model.check_points] - drawn.check
    return Fit(state, left.pixels, left.gnss, left.control, check)


class TestHeldOut:
    def test_a_point_keeps_its_rays(self, model):
        rows = model.system.image_rows
        out = np.bincount(rows.point, model.held_out)
        rays = np.bincount(rows.point)
        assert out.max() == 1
        assert (rays - out)[out > 0].min() >= SETTINGS.fewest - 1
        assert 0.03 < model.held_out.sum() / rows.tie.sum() < 0.07

    def test_what_is_held_out_has_no_say(self, model):
        """Moved by 50 px, they change no other residual."""
        moved = model.measured.xy.copy()
        moved[model.held_out] += 50.0
        fit, again = model.fits([model.measured._replace(xy=moved), model.measured])
        assert np.array_equal(fit.pixels[~model.held_out], again.pixels[~model.held_out])
        assert np.array_equal(fit.gnss, again.gnss)
        held = fit.pixels[model.held_out] - again.pixels[model.held_out]
        assert held == pytest.approx(np.full_like(held, 50.0))

    def test_it_is_farther_off_than_what_was_fitted(self, found):
        """A fitted observation is drawn towards its point, one held out is not."""
        table = found.table.set_index("statistic")["value"]
        fitted = table.loc["size of tie residuals by image position"].median()
        assert table.loc["size of held-out tie residuals"] > 1.05 * fitted


class TestNoise:
    def test_a_wrong_stated_sigma_is_seen_through(self):
        """Drawn 0.3 px, stated 0.6 px: half of it, for ties and for marks (100 of them: 10 %)."""
        block = flown()
        block.sigma |= {"tie_px": 0.6, "mark_px": 0.6}
        noise = Replicator(believed(block)).noise
        assert noise.tie_sigma == pytest.approx(0.5, rel=0.04)
        assert noise.mark == pytest.approx(0.5, rel=0.3)

    def test_heavy_tails_are_drawn_again(self):
        """Student's t with three degrees of freedom: at 1 - 1/200 lengths of 6.1 medians, not 2.8.

        Two t3 of one scale: length^2 / 2 is F(2, 3), whose quantiles give the ratio.
        """
        block = flown(noise={"tie_px": 0.0})
        draw = np.random.default_rng(7)
        scale = 0.25 / np.sqrt(draw.chisquare(3, len(block.tie_points)) / 3)
        error = scale[:, None] * draw.standard_normal((len(scale), 2))
        xy = block.tie_points[["x", "y"]].to_numpy() + error
        block.tie_points = block.tie_points.assign(x=xy[:, 0], y=xy[:, 1])
        block.sigma["tie_px"] = 0.3
        noise = Replicator(believed(block)).noise
        tail, middle = np.interp([0.995, 0.5], GRID, noise.tie)
        assert 4.5 < tail / middle < 8.5
        assert middle == pytest.approx(0.25 / 0.3 * np.sqrt(2 * 0.8811), rel=0.05)

    def test_white_gnss_noise_is_white_and_of_its_size(self, model):
        """36 positions, three axes: 10 % of the standard deviation."""
        noise = model.noise.gnss
        assert np.sqrt(np.mean(noise.size**2)) == pytest.approx(NOISE["gnss_m"], rel=0.25)
        assert np.sum(noise.coloured > 0) <= 2

    def test_a_drift_of_the_antenna_is_not_taken_for_noise(self):
        """5 mm/s for 45 s: 0.2 m, twenty times the noise, yet no noise."""
        block = flown({"gnss_drift": {"z": 0.005}})
        noise = Replicator(believed(block)).noise.gnss
        assert noise.coloured.max() < 2.0 * NOISE["gnss_m"]
        assert noise.white.max() < 2.0

    def test_slow_gnss_noise_is_found(self):
        block = flown(
            images=80, strips=2, height=50.0, noise={"gnss_slow": 0.9, "gnss_slow_s": 20.0}
        )
        noise = Replicator(believed(block)).noise.gnss
        slow = noise.coloured > 0
        assert slow.sum() >= 4
        assert 4 < np.median(noise.tau[slow]) < 60

    def test_wrong_matches_are_fitted_robustly_and_do_not_swell_the_noise(self):
        block = flown(noise={"outliers": 0.05})
        noise = Replicator(believed(block)).noise
        # Five per cent of any length push the median up by 2 %.
        assert noise.tie_sigma == pytest.approx(1.0, rel=0.07)


class TestStatistics:
    def test_a_table_names_unit_and_place_of_each_value(self, found):
        table = found.table
        assert list(table) == ["statistic", "kind", "axis", "x", "y", "label", "value", "unit"]
        assert np.isfinite(table["value"]).all()
        assert set(table["unit"]) <= {"px", "m", "log10 m²", "stated deviations"}
        kinds = {"tie", "held_out", "mark", "gnss", "control", "check", "signature"}
        assert set(table["kind"]) == kinds

    def test_measuring_alone_gives_the_same_table(self, found, adjusted):
        pd.testing.assert_frame_equal(diagnosis.measure(adjusted), found.table)

    @pytest.mark.parametrize(
        "axis",
        ["image position", "row", "time", "temperature", "depth", "flight", "its direction",
         "place along the corridor", "place on the ground"],
    )  # fmt: skip
    def test_tie_residuals_are_looked_at_by(self, found, axis):
        assert any(s.kind == "tie" and axis in s.name for s in found.statistics)

    def test_gnss_residuals_are_looked_at_by_time_and_frequency(self, found):
        names = {s.name for s in found.statistics}
        for axis in "xyz":
            assert {f"GNSS {axis} by time", f"GNSS {axis} spectrum"} <= names
            assert f"second differences of the poses against GNSS {axis}" in names

    def test_what_the_adjustment_makes_zero_is_not_compared(self, found):
        """A free lever arm takes the mean of the antenna's residuals in the camera's frame."""
        compared = diagnosis.compare(found)["GNSS down of the camera by flight"]
        assert 0.0 in compared.z
        assert np.abs(compared.measured[compared.z == 0.0]).max() < 1e-6

    def test_the_strength_of_a_signature_is_the_estimate_in_its_sigmas(self):
        """Score over the root of its variance is estimate over sigma, for what is linear."""
        block = flown({"focal": {"f": 30.0}}, calibrated=True)
        missing = diagnosis.measure(believed(block))
        row = believed(block, "focal").effects.iloc[0]
        unit_weight = row["sigma"] / believed(block, "focal").sigma0
        strength = missing[missing["label"] == "focal"]["value"].iloc[0]
        # A twentieth is held out, and the rest is as it happens to be.
        assert strength == pytest.approx(row["value"] / unit_weight, rel=0.1)


class TestColumnsThatAreNotThere:
    @pytest.mark.parametrize(
        "gone, says",
        [
            (["time_s"], "images.time_s"),
            (["temperature_c"], "images.temperature_c"),
            # With times they are derived from the antenna.
            (["vx", "vy", "vz", "time_s"], "images.vx, images.vy, images.vz"),
        ],
    )
    def test_are_named_and_stop_nothing(self, gone, says):
        block = flown(images=20)
        block.images = block.images.drop(columns=gone)
        found = diagnosis.counterparts(believed(block), 19)
        assert says in found.missing.values()
        assert says in str(diagnosis.compare(found))

    def test_ties_alone_are_enough(self):
        """A free network: no GNSS, no control, no marks."""
        block = flown(images=20)
        empty = {"gnss": block.gnss[:0], "ground": block.ground[:0], "marks": block.marks[:0]}
        for name, table in empty.items():
            setattr(block, name, table)
        found = diagnosis.counterparts(believed(block, camera="fixed"), 19)
        assert {s.kind for s in found.statistics} <= {"tie", "held_out", "signature"}
        assert np.isfinite(found.simulated).all()


class TestCounterpartAsABlock:
    @pytest.fixture(scope="class")
    @staticmethod
    def pair():
        block = flown({"rolling_shutter": {"readout": 0.03}})
        block.gnss = block.gnss.drop(index=[4]).reset_index(drop=True)
        adjustment = believed(block, "rolling_shutter")
        return block, adjustment, diagnosis.counterpart(adjustment, seed=8)

    def test_it_measures_the_same_things(self, pair):
        block, _, like = pair
        for table in ("tie_points", "marks"):
            ours, theirs = getattr(like, table), getattr(block, table)
            assert (
                ours[["point", "image"]].astype(str).equals(theirs[["point", "image"]].astype(str))
            )
        assert like.gnss["image"].equals(block.gnss["image"])
        assert like.ground[["point", "role"]].equals(block.ground[["point", "role"]])
        pd.testing.assert_frame_equal(like.images, block.images)

    def test_every_measurement_is_new_by_its_noise(self, pair):
        block, _, like = pair
        for table, columns, sigma in (
            ("tie_points", ["x", "y"], NOISE["tie_px"]),
            ("gnss", ["x", "y", "z"], NOISE["gnss_m"]),
        ):
            ours, theirs = (getattr(b, table)[columns].to_numpy(float) for b in (like, block))
            off = (ours - theirs)[np.isfinite(ours).all(axis=1)]
            # Two noises apart, less what the first adjustment took up of its own.
            assert sigma < off.std() < 1.6 * sigma

    def test_its_truth_is_found_again(self, pair):
        _, adjustment, like = pair
        again = believed(like, "rolling_shutter").effects.iloc[0]
        truth = like.truth["effects"]["rolling_shutter"]["readout"]
        assert truth == pytest.approx(adjustment.effects["value"].iloc[0], abs=2e-3)
        assert abs(again["value"] - truth) < 4 * again["sigma"]

    def test_an_effect_comes_on_top(self, pair):
        _, adjustment, _ = pair
        like = diagnosis.counterpart(adjustment, seed=8, effects={"gnss_bias": {"z": 0.3}})
        plain = diagnosis.counterpart(adjustment, seed=8)
        off = like.gnss["z"] - plain.gnss["z"]
        assert off.dropna().to_numpy() == pytest.approx(0.3, abs=1e-9)
        assert like.truth["effects"]["gnss_bias"] == {"z": 0.3}

    def test_an_effect_of_the_model_cannot_come_on_top(self, pair):
        with pytest.raises(InputError, match="estimated already"):
            diagnosis.counterpart(pair[1], effects={"rolling_shutter": {"readout": 0.01}})

    def test_it_can_be_written_with_its_truth_beside_it(self, pair, tmp_path):
        pair[2].write(tmp_path / "like")
        assert corridor.read(tmp_path / "like").name == pair[0].name
        assert (tmp_path / "like.truth.json").is_file()
