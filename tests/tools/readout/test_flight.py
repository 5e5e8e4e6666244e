"""The readout time from an ordinary survey: what is told, what is refused, and how sure."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

import corridor
from benchmarks.readout_flight import measured, survey
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import cluster_robust_sigma, jackknife, sigma_by_test
from corridor.core.preparation import strips_of, unrounded
from corridor.interface.cli import main
from corridor.tools.readout import published_value, readout_from_flight, save_flight, use
from corridor.tools.readout.flight import _at_once, judged
from corridor.tools.readout.motion import on_one_clock

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
        found = [
            cluster_robust_sigma(*one, sigma)
            for one in zip(whole, np.ones(4000), left, strict=True)
        ]
        variance, free = np.mean([one**2 for one, _ in found]), found[0][1]
        assert variance == pytest.approx(1.0, abs=3 * np.sqrt(2 / free / 4000))
        assert free == pytest.approx(1 / (weight**2).sum() - 1)
        assert np.mean([jackknife(one) ** 2 for one in left]) > 1.5

    def test_of_equal_groups_contrasts_and_jackknife_agree(self):
        """The share of each is 1 / q: both are (q - 1) / q times the sum of squared moves."""
        x = np.array([1.0, 4.0, 2.0, 8.0, 5.0])
        without = [np.delete(x, k).mean() for k in range(5)]
        found, free = cluster_robust_sigma(x.mean(), 1.0, without, np.full(5, np.sqrt(5 / 4)))
        assert found == pytest.approx(jackknife(without)) and free == pytest.approx(4.0)

    def test_strips_count_where_they_contradict_the_formal_one(self):
        """Chi-square of 4 degrees of freedom, 95 per cent: 9.488, so 1.54 times the sigma."""
        for by_strips, free in ((np.nan, 0), (0.3, 4), (1.53, 4)):
            assert sigma_by_test(1.0, by_strips, free) == 1.0
        assert sigma_by_test(1.0, 1.55, 4) == 1.55


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


def test_whether_all_rows_are_exposed_at_once_is_asked_of_block_and_model():
    camera = corridor.read(DIKE).cameras["camlight"]
    assert "Phantom 4 RTK" in _at_once(camera, "DJI FC6310R")
    assert not _at_once(camera, "DJI FC330") and not _at_once(camera, "")
    assert _at_once(replace(camera, readout_s=0.0), "") == "block.toml"
    assert not _at_once(replace(camera, readout_s=0.033), "DJI FC6310")
    by_row = replace(camera, extra={"readout_from": "its electronic shutter took them"})
    assert not _at_once(by_row, "DJI M3E")


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

    def test_what_a_global_shutter_cannot_show(self, found):
        """Its maker says that all rows are exposed at once: no motion of them is a readout."""
        said = changed(found, readout=0.030, sigma=0.001, eight=0.030, at_once="its maker")
        assert not said.told and "is no readout time" in said.reasons[0]
        assert use(said)[:2] == (0.0, 0.0) and "its maker" in use(said)[2]
        assert not said.advises and "Four more photographs" not in str(said)
        none = changed(found, readout=0.0004, sigma=0.0004, at_once="its maker", published=())
        assert none.told and "shows no rolling shutter" in str(none) and use(none)[0] == 0.0

    def test_too_few_strips(self, found):
        assert "too few" in changed(found, left=found.left[:2]).reasons[0]

    def test_then_the_published_value_is_the_one_to_use(self, found):
        said = changed(found, readout=-0.0191, sigma=0.0011)
        assert use(said)[0] == pytest.approx(0.033, rel=0.001)
        assert "20.4 sigmas from it" in use(said)[2]
        near = changed(found, readout=0.030, sigma=0.001, eight=0.040)
        assert "neither proves nor disproves" in use(near)[2]
        alone = replace(said, published=(), stated=None)
        assert use(alone)[:2] == (None, None)
        assert "measure it from photographs" in use(alone)[2]

    def test_a_focal_length_that_runs_away_is_not_said_to_stand_in_the_block(self):
        """One speed, one height, positions to a metre: from 5,504 px it ran to 196."""
        block = survey(5002, untold=True)[0]
        with pytest.raises(AdjustmentFailed, match="^the flight does not determine the focal le"):
            readout_from_flight(block, advise=False)

    def test_an_adjustment_that_does_not_settle_says_what_it_was_of(self, monkeypatch):
        monkeypatch.setattr("corridor.tools.readout.flight._FIRST_ITERATIONS", 1)
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


@pytest.fixture(scope="module")
def rocking():
    """A camera that rocks on a track of two strips; its readout, 52.61 ms; rates.csv by flight."""
    block, readout, _ = survey(7, images=(24, 30), observations=60, rocking=True)
    return block, readout


@pytest.fixture(scope="module")
def heard(rocking):
    return readout_from_flight(rocking[0])


class TestACameraThatRocks:
    def test_the_gyroscope_takes_the_rocking_along(self, rocking, heard):
        """Rates of 6 degrees a second, heights of 60 m: as much as 6 m/s, another in each image."""
        assert heard.told
        assert abs(heard.readout - rocking[1]) < 3 * heard.sigma < 0.001

    def test_without_its_record_the_flight_is_refused(self, rocking):
        """Each picture turned another way: velocities say a tenth of how its rows moved."""
        deaf = rocking[0].copy()
        deaf.rates = deaf.rates.iloc[:0]
        said = readout_from_flight(deaf, advise=False)
        assert not said.told and said.turns is None
        assert "no angular rates are given" in said.reasons[0] and "rates.csv" in said.reasons[0]

    def test_what_the_gyroscope_told_is_said(self, heard, tmp_path):
        """The generator's gyroscope is on time."""
        text = str(heard)
        assert "by the flight itself and its gyroscope." in text
        assert "delay of the gyroscope's clock" in text
        assert "too short by as much" in " ".join(text.split())
        ((name, delay, sigma, unit),) = heard.turns.estimated
        assert (name, unit) == ("delay of the gyroscope's clock", "s")
        assert abs(delay) < 4 * sigma < 0.002
        save_flight(heard, tmp_path / "out")
        told = json.loads((tmp_path / "out" / "readout.json").read_text(encoding="utf-8"))
        assert told["gyroscope"]["estimated"][0]["value"] == delay
        assert told["method"].endswith("velocities and recorded turns of its images")

    def test_photographs_taken_again_turn_as_they_did(self, rocking, heard):
        """A record of each image's own says the same as one of the flight."""
        block = rocking[0].copy()
        time = block.images["time_s"].to_numpy()
        near = np.abs(time - block.rates["time_s"].to_numpy()[:, None]).argmin(axis=1)
        names = block.images["image"].astype(str).to_numpy()
        block.rates = block.rates.drop(columns="flight").assign(image=names[near])
        own = readout_from_flight(block)
        assert own.readout == pytest.approx(heard.readout, abs=heard.sigma / 10)
        assert own.advice is not None
        assert own.advice.sigma == pytest.approx(heard.advice.sigma, rel=0.05)

    def test_rocking_counts_as_motion_of_the_rows(self, heard):
        """Velocities that hardly differ swamp nothing where the turns tell."""
        derived = replace(heard.motion, given=False, sigma=0.5 + 0 * heard.motion.sigma)
        level = np.zeros((len(heard.names), 3))
        turned = np.hstack([level, 60 * heard.turns.rate])
        assert changed(heard, motion=derived, in_camera=turned).told
        said = changed(heard, motion=derived, in_camera=np.hstack([level, level]))
        assert said.reasons[0].startswith("The velocities and turns")
        assert "moved and turned alike" in changed(
            heard, sigma=0.02, in_camera=np.ones((len(heard.names), 6))
        ).reasons[0]  # fmt: skip

    def test_an_image_without_a_record_is_counted(self, rocking):
        block = rocking[0].copy()
        own = block.rates.drop(columns="flight").iloc[:4]
        names = block.images["image"].iloc[0]
        block.rates = own.assign(image=names)
        rest = len(block.images) - 1
        with pytest.raises(InputError, match=f"{rest} of {rest + 1} images have no record"):
            readout_from_flight(block)

    def test_rounded_stamps_do_not_find_the_epochs_of_a_flight(self, rocking):
        block = rocking[0].copy()
        assert on_one_clock(block) == (block, [])
        block.images["time_s"] = np.floor(block.images["time_s"])
        without, said = on_one_clock(block)
        assert not len(without.rates) and len(block.rates)
        assert "time stamps of 1 s" in said[0] and "left out" in said[0]
        block.rates["image"] = block.images["image"].iloc[0]
        assert on_one_clock(block) == (block, [])


@pytest.mark.slow
def test_garfield_tells_what_its_maker_states(real_data, tmp_path):
    """A Parrot Sequoia that rocks on a fixed wing: 47,500 ns for each of 3456 rows by its maker."""
    pytest.importorskip("pycolmap", reason="the extra 'images' is not installed")
    photos, block = str(real_data / "garfield" / "photos"), str(tmp_path / "block")
    assert main(["import", "photos", photos, "-o", block]) == 0
    told = readout_from_flight(block, advise=False)
    assert told.told and told.turns is not None
    assert told.stated == pytest.approx(0.1641125)
    # 162.2 +- 0.9 ms in one import, 2.2 sigmas: matching is drawn anew in each.
    assert abs(told.readout - told.stated) < 3 * told.sigma < 0.015
    # Strips differ by more than noise explains, and that is what counts.
    assert told.sigma > 2 * told.formal
    # The record comes some 43 ms late, as data/sequoia's does.
    assert told.turns.estimated[0][1] == pytest.approx(0.043, abs=0.005)
    # Chapter 5 names it too, and does not take it for a shutter that velocities move (128 ms).
    (named,) = (one for one in corridor.diagnose(block).findings.effects if one.kind == "named")
    values = {row["name"]: row["value"] for row in named.parameters}
    assert abs(values["readout"] - told.stated) < 2 * told.sigma
    assert values["delay"] == pytest.approx(0.043, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("rocking", [False, True], ids=["steady", "rocking"])
def test_errors_are_as_large_as_stated(rocking):
    """Eight surveys of the independent generator, two of each kind of velocity, and with a record
    of a camera that rocks.

    The benchmark does a hundred. What is told lies within its sigma as chi-square has it; the
    jackknife over few strips has heavier tails, for which the upper bound takes four strips.
    """
    size = {"images": (24, 30), "observations": 60}
    rows = [measured(seed, rocking=rocking, **size) for seed in range(8)]
    ratios = np.array([row["ratio"] for row in rows if row["told"]])
    assert len(ratios) >= 4
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], len(ratios))
    assert low < (ratios**2).sum() < 2 * high


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_every_adjustment_of_a_diagnosis_is_of_the_same_points(real_data):
    """Sequoia's images stand nearly at one place: some refits draw points into a camera."""
    found = corridor.diagnose(real_data / "sequoia" / "flight_block")
    for one in (found.before, found.after, found.course.last.adjustment):
        assert len(one.block.tie_points) == len(found.block.tie_points)
