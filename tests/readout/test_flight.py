"""The readout time from an ordinary survey: what is told, what is refused, and how sure."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from benchmarks.readout_flight import measured, survey
from corridor.cli import main
from corridor.errors import AdjustmentFailed, InputError
from corridor.geometry import by_contrasts, honest, jackknife
from corridor.preparation import strips_of
from corridor.readout import published_value, readout_from_flight, save_flight, use
from corridor.readout.flight import judged
from corridor.readout.motion import unrounded

DIKE = "data_synthetic/dike"


@pytest.fixture(scope="module")
def found():
    """Of a drone with a global shutter that flew 42 images."""
    return readout_from_flight(DIKE, model="DJI FC330")


class TestOneSigma:
    def test_the_jackknife_of_means_is_the_standard_error_of_the_mean(self):
        """Efron and Tibshirani 1993, section 11.2."""
        x = np.array([1.0, 4.0, 2.0, 8.0, 5.0])
        without = [np.delete(x, k).mean() for k in range(5)]
        assert jackknife(without) == pytest.approx(x.std(ddof=1) / np.sqrt(5))

    def test_contrasts_give_the_sigma_back_however_unequal_the_groups(self):
        """Means of four groups, one of which knows most: of 4,000 draws the jackknife is too large.

        Left out, group c moves the mean by w_c / (1 - w_c) times what it is off from the others.
        """
        weight = np.array([0.7, 0.15, 0.1, 0.05])
        value = np.random.default_rng(7).normal(size=(4000, 4)) / np.sqrt(weight)
        whole = value @ weight
        left = (whole[:, None] - weight * value) / (1 - weight)
        sigma = 1 / np.sqrt(1 - weight)
        found = [by_contrasts(*one, sigma) for one in zip(whole, np.ones(4000), left, strict=True)]
        variance, free = np.mean([one**2 for one, _ in found]), found[0][1]
        assert variance == pytest.approx(1.0, abs=3 * np.sqrt(2 / free / 4000))
        assert free == pytest.approx(1 / (weight**2).sum() - 1)
        assert np.mean([jackknife(one) ** 2 for one in left]) > 1.5

    def test_of_equal_groups_contrasts_and_jackknife_agree(self):
        """The share of each is 1 / q: both are (q - 1) / q times the sum of squared moves."""
        x = np.array([1.0, 4.0, 2.0, 8.0, 5.0])
        without = [np.delete(x, k).mean() for k in range(5)]
        found, free = by_contrasts(x.mean(), 1.0, without, np.full(5, np.sqrt(5 / 4)))
        assert found == pytest.approx(jackknife(without)) and free == pytest.approx(4.0)

    def test_strips_count_where_they_contradict_the_formal_one(self):
        """Chi-square of 4 degrees of freedom, 95 per cent: 9.488, so 1.54 times the sigma."""
        assert honest(1.0, np.nan, 0) == honest(1.0, 0.3, 4) == honest(1.0, 1.53, 4) == 1.0
        assert honest(1.0, 1.55, 4) == 1.55


class TestTheFlightOfADike:
    def test_a_global_shutter_is_nothing_within_its_sigma(self, found):
        assert found.told and found.is_short
        assert abs(found.readout) < 3 * found.sigma < 0.001
        assert "shows no rolling shutter" in str(found)

    def test_strips_are_left_out_one_at_a_time(self, found):
        assert len(found.left) == 4
        assert sum(one.images for one in found.left) == 42

    def test_what_is_published_of_the_camera_stands_beside_it(self, found):
        """33 ms, all of 3840 rows."""
        value, _, whose = published_value(found)
        assert (value, whose) == (pytest.approx(0.033 * 3839 / 3840), "published")
        assert "contradicts" in use(found)[2]

    def test_four_photographs_more_would_make_it_better(self, found):
        assert len(set(found.advice.images)) == 4
        assert 0 < found.advice.sigma < found.sigma


def changed(found, **changes):
    """The same flight with other numbers, judged again; velocities in the camera's frame differ."""
    in_camera = changes.pop("in_camera", found.motion.velocity)
    return judged(replace(found, **changes), in_camera)


class TestRefused:
    def test_a_negative_readout_however_small_its_sigma(self, found):
        """Brighton: -19.1 +- 1.1 ms, which was called supported."""
        said = changed(found, readout=-0.0191, sigma=0.0011, eight=-0.0191)
        assert not said.told and "negative" in said.reasons[0]

    def test_one_speed_in_the_cameras_frame(self, found):
        steady = np.tile([0.0, 6.5, 0.0], (42, 1))
        said = changed(found, readout=0.0, sigma=0.024, in_camera=steady)
        assert "one speed in the camera's frame" in said.reasons[0]

    def test_a_drone_that_stood(self, found):
        still = changed(found, sigma=0.5, in_camera=np.zeros((42, 3)))
        assert "stood still" in still.reasons[0]
        derived = replace(found.motion, measured=False)
        said = changed(found, readout=0.00037, sigma=0.00043, motion=derived)
        assert "global, or the drone stood still" in said.reasons[0]

    def test_eight_and_ten_camera_parameters_that_disagree(self, found):
        said = changed(found, readout=0.030, sigma=0.001, eight=0.040)
        assert "Eight and ten" in said.reasons[0]

    def test_what_hangs_on_one_strip(self, found):
        said = changed(found, readout=0.030, sigma=0.009, formal=0.003, jackknife=0.02)
        assert "depends on single strips" in said.reasons[0]

    def test_too_few_strips(self, found):
        assert "too few" in changed(found, left=found.left[:2]).reasons[0]

    def test_then_the_published_value_is_the_one_to_use(self, found):
        said = changed(found, readout=-0.0191, sigma=0.0011)
        assert use(said)[0] == pytest.approx(0.033, rel=0.001)
        alone = replace(said, published=(), stated=None)
        assert use(alone)[:2] == (None, None)
        assert "measure it from photographs" in use(alone)[2]

    def test_an_adjustment_that_does_not_settle_says_what_it_was_of(self, monkeypatch):
        monkeypatch.setattr("corridor.readout.flight._FIRST_ITERATIONS", 1)
        with pytest.raises(AdjustmentFailed, match="rolling_shutter.*did not converge in 1 iter"):
            readout_from_flight(DIKE, max_iterations=1)


class TestWhatIsWritten:
    def test_a_readout_that_was_told(self, found, tmp_path):
        for path in save_flight(found, tmp_path / "out"):
            assert path.stat().st_size
        told = json.loads((tmp_path / "out" / "readout.json").read_text(encoding="utf-8"))
        assert told["readout_ms"] == 1000 * found.readout
        assert told["sigma_ms"] >= told["formal_sigma_ms"]
        assert "shows no rolling shutter" in (tmp_path / "out" / "report.html").read_text("utf-8")

    def test_a_refusal_takes_the_place_of_a_number(self, found, tmp_path):
        save_flight(found, tmp_path / "out")
        save_flight(changed(found, readout=-0.0191, sigma=0.0011), tmp_path / "out")
        names = {path.name for path in (tmp_path / "out").iterdir()}
        assert names == {"refused.json", "report.html", "readout.png"}

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            ([DIKE, "--size", "800"], "is for photographs"),
            (["nowhere"], "nowhere"),
        ],
    )
    def test_wrong_input_is_one_sentence(self, words, said, tmp_path, capsys):
        assert main(["readout", "flight", *words, "-o", str(tmp_path / "out")]) == 2
        assert said in capsys.readouterr().err.splitlines()[-1]
        assert not (tmp_path / "out").exists()


def test_without_velocities_and_times_it_says_what_is_missing():
    import corridor

    block = corridor.read(DIKE).copy()
    block.images = block.images.drop(columns=["vx", "vy", "vz", "time_s"])
    with pytest.raises(InputError, match="42 of 42 images have no velocity"):
        readout_from_flight(block)


class TestRoundedStamps:
    def test_whole_seconds_of_a_timer_give_its_interval_back(self):
        """Thirty intervals of 1.37 s: their sum is right to a second, so each to a thirtieth."""
        true = 100.4 + 1.37 * np.arange(31)
        times = unrounded(np.floor(true), 1.0)
        assert np.abs(times - np.floor(true)).max() <= 0.5 + 1e-9
        assert np.diff(times) == pytest.approx(1.37, abs=1 / 30)

    def test_a_pause_belongs_to_no_rhythm(self):
        true = np.concatenate([0.7 * np.arange(12), 60.3 + 0.7 * np.arange(12)])
        steps = np.diff(unrounded(np.floor(true), 1.0))
        assert np.delete(steps, 11) == pytest.approx(0.7, abs=0.1)

    def test_two_stamps_stay_as_they_are(self):
        assert unrounded(np.array([3.0, 5.0]), 1.0).tolist() == [3.0, 5.0]


def test_strips_are_all_images_once():
    block, _, _ = survey(3, images=(24, 30), observations=30)
    rows = np.concatenate([rows for _, rows in strips_of(block)])
    assert sorted(rows) == list(range(len(block.images)))


@pytest.mark.slow
def test_errors_are_as_large_as_stated():
    """Eight surveys of the independent generator, two of each kind of velocity.

    The benchmark does a hundred. What is told lies within its sigma as chi-square has it; the
    jackknife over few strips has heavier tails, for which the upper bound takes four strips.
    """
    rows = [measured(seed, images=(24, 30), observations=60) for seed in range(8)]
    ratios = np.array([row["ratio"] for row in rows if row["told"]])
    assert len(ratios) >= 4
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], len(ratios))
    assert low < (ratios**2).sum() < 2 * high
