"""What needs no catalogue: one probability of nothing, and halves that must agree."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

import corridor
from benchmarks.ladder import Dirt, made
from corridor.core.adjustment import Design, Model
from corridor.core.preparation import prepare
from corridor.diagnosis import forward_selection
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.nothing import (
    by_run,
    null_scores,
    probability_of_nothing,
    residuals,
    runs,
    scores_by_run,
)
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.report.sentence import _halves
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import equations
from corridor.diagnosis.verification.halves import Halves, compare_halves, halves_of, split

SIZE = 24


def _block(seed, **dirt):
    return made(SIZE, seed, Dirt(**({"strips": 2, "check": 0} | dirt)), per_image=80).block


def _evidence(block):
    believed = ReferenceModel.of(prepare(block).block, Model())
    first = believed.adjust()
    chosen = corridor.core.effects.candidates(
        believed.block, first.system.free, [], first.system.control_names
    )
    return Evidence(Elimination(equations(first, chosen.effects, {}), None).reduced())


@pytest.fixture(scope="module")
def evidence():
    return _evidence(_block(0))


class TestProbabilityOfNothing:
    def test_nothing_has_a_name_that_all_tests_together_do_not_show(self, monkeypatch):
        """One of 160 blocks of the ladder in which nothing of the catalogue is missing: a group had
        a log evidence of 4.4, and the whole search said that so much comes by chance. (Its rows
        shift, which the rule on shears leaves without that name.)"""
        monkeypatch.setattr(forward_selection, "nameless", lambda *_: {})
        found = corridor.diagnose(made(12, 6027).block)
        assert found.course.p_nothing > 0.01 and found.verdict == "suspected"

    def test_runs_together_say_what_all_images_say(self, evidence):
        """The score is linear in the errors: that of all is the sum over the runs."""
        e = evidence.reduced.elimination
        design, antenna = Design(e.equations.system), e.equations.residual[:, None]
        parts = design.right(by_run(e.equations.system, residuals(e)))
        each = e.scores(parts, np.zeros((len(antenna), parts.shape[1])))
        whole = e.scores(np.zeros((len(parts), 1)), antenna)
        assert each.sum(axis=1) + whole[:, 0] == pytest.approx(
            evidence.reduced.g, abs=1e-6 * np.abs(evidence.reduced.g).max()
        )

    def test_runs_are_neighbours_in_time(self, evidence):
        system = evidence.reduced.elimination.equations.system
        run = runs(system)[np.argsort(system.images.time)]
        assert (np.diff(run) >= 0).all() and run.max() == SIZE // 10 - 1

    def test_drawn_scores_have_about_the_spread_of_independent_noise(self, evidence):
        """Where residuals are independent, resampling them is no other noise."""
        M = evidence.reduced.M
        value, vector = np.linalg.eigh(M)
        known = vector[:, value > 1.0]
        drawn = known.T @ null_scores(evidence, 2000, np.random.default_rng(0))
        ratio = drawn.var(axis=1) / value[value > 1.0]
        assert 0.7 < np.median(ratio) < 1.4
        assert scores_by_run(evidence.reduced.elimination).shape == (len(M), 2)

    def test_together_is_more_than_the_best_alone_and_less_than_all_of_it(self, evidence):
        g = evidence.reduced.g[:, None]
        each = [one.evidence for one in evidence.given({}) if np.isfinite(one.evidence)]
        together = np.logaddexp.reduce([*evidence.of_scores(g)])
        assert max(each) <= together[0] < max(each) + np.log(len(each))

    def test_it_is_uniform_where_nothing_is_missing(self):
        found = [
            probability_of_nothing(_evidence(_block(seed)), np.random.default_rng(seed))
            for seed in range(12)
        ]
        assert kstest(found, "uniform").pvalue > 0.01

    def test_it_is_small_where_the_lens_is_no_polynomial_by_far(self):
        evidence = _evidence(_block(0, lens=1.5))
        assert probability_of_nothing(evidence, np.random.default_rng(0)) < 0.01


def _compared(block):
    believed = ReferenceModel.of(prepare(block).block, Model())
    believed.adjust()
    return compare_halves(believed, [], None, None)


@pytest.fixture(scope="module")
def sound():
    return [_compared(_block(seed)) for seed in range(12)]


class TestHalves:
    def test_they_agree_where_the_model_is_right(self, sound):
        assert kstest([one.p for one in sound], "uniform").pvalue > 0.01
        assert not any(one.p < 1e-4 for one in sound)

    def test_differences_scatter_as_their_joint_covariance_says(self, sound):
        off = [row["value"] / row["sigma"] for one in sound for row in one.rows]
        # 12 blocks of correlated numbers: some thirty of them count.
        assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.3

    def test_another_principal_point_in_odd_images_raises_the_alarm(self):
        block = _block(0)
        _, first = halves_of(block)
        odd = first[block.image_rows("tie_points")]
        block.tie_points["x"] += 4.0 * odd
        found = _compared(block)
        assert found.alarm
        row = next(row for row in found.rows if row["name"].endswith(".cx"))
        assert row["value"] == pytest.approx(4.0, abs=4.0 * row["sigma"])

    def test_four_strips_are_halved_by_strips_and_two_by_images(self):
        for strips, wanted in ((2, "images"), (4, "strips")):
            block = made(48, 3, Dirt(strips=strips)).block
            by, first = halves_of(block)
            assert by == wanted and 0.3 < first.mean() < 0.7
            if by == "strips":
                assert block.images.groupby("strip")["image"].count().eq(12).all()
                assert all(len(set(first[block.images["strip"] == one])) == 1
                           for one in block.images["strip"].unique())  # fmt: skip

    def test_a_point_of_two_and_two_rays_is_split_and_a_single_ray_has_no_say(self):
        block = _block(1)
        _, first = halves_of(block)
        apart, pairs = split(block, first)
        rays = apart.tie_points["point"].astype(str).value_counts()
        assert rays.min() >= 2
        assert {name + " (second half)" for name in pairs} <= set(rays.index)
        assert len(apart.tie_points) <= len(block.tie_points)

    def test_a_block_that_cannot_be_halved_says_why(self):
        few = made(4, 0, Dirt(strips=1, control=0, check=0), per_image=30).block
        found = _compared(few)
        assert found.p is None and found.reason and not found.alarm
        assert found.to_dict()["reason"] == found.reason

    def test_the_sentence_tells_what_differs_most(self):
        rows = ({"name": "camera.P1.f", "unit": "px", "value": 3.0, "sigma": 0.5},
                {"name": "camera.P1.cx", "unit": "px", "value": 0.1, "sigma": 0.5})  # fmt: skip
        told = _halves(SimpleNamespace(halves=Halves("images", 60.0, 20, 1.0, 1e-6, rows)))
        assert (
            "contradict each other (p < 0.001; most of all camera.P1.f, by 3.00 +- 0.50 px)" in told
        )
        assert _halves(SimpleNamespace(halves=Halves("images", 20.0, 20, 1.0, 0.4, rows))) == ""
