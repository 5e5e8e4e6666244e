"""An area of photographs is no corridor: what is not asked of it is said, all else is found.

Two threads, and rounds that let go of their equations, change nothing.
"""

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.generator import single
from benchmarks.diagnosis.generator.generate import generate
from benchmarks.ladder import Dirt, made
from corridor.core.adjustment import fronts
from corridor.core.geometry import robust_scale
from corridor.diagnosis import diagnose
from corridor.diagnosis.bootstrap.replicator import antenna_noise
from corridor.diagnosis.settings import SETTINGS, Settings, changed, side_by_side
from corridor.diagnosis.system import chain, elimination

SMALL = {"images": 30, "observations": 130}


@pytest.fixture
def area(monkeypatch):
    """Every block is too wide."""
    monkeypatch.setattr(elimination, "_MOST_PRODUCTS", 0.0)


@pytest.fixture(scope="module")
def bent():
    return generate(single("radial_distortion", 1.5, **SMALL), seed=2)


class TestAnArea:
    def test_an_error_of_the_lens_is_named_as_in_a_corridor(self, bent, area):
        found = diagnose(bent.block)
        assert [one["slug"] for one in found.effects] == ["radial_distortion"]
        assert found.sentence.endswith("a few neighbouring strips can be asked.")
        assert "30 images are no corridor" in found.sentence

    def test_nothing_is_named_of_the_gnss_or_of_single_images(self, bent, area):
        found = diagnose(bent.block)
        tested = {effect.slug for effect in found.course.candidates.effects}
        untested = {one["slug"] for one in found.untestable}
        for slug in ("gnss_drift", "clock_offset", "time_rounding", "row_polynomial"):
            assert slug not in tested
        assert {"gnss_drift", "gnss_bias"} <= untested
        assert not {"gnss_drift", "gnss_bias"} & set(found.detection_limits)

    def test_counterparts_take_errors_of_the_gnss_as_large_as_they_are(self, bent, area):
        system = corridor.adjust(bent.block).system
        noise, left = antenna_noise(system, 1.0), system.gnss.residual
        assert not noise.coloured.any()
        for rows, flight, axis in noise.blocks():
            size = noise.white[flight, axis] * np.sqrt(np.mean(noise.stated[rows] ** 2))
            assert size == pytest.approx(robust_scale(left.ravel()[rows], centred=True))

    def test_a_corridor_is_asked_for_all(self, bent):
        found = diagnose(bent.block)
        assert not found.course.unasked
        assert "gnss_drift" in {effect.slug for effect in found.course.candidates.effects}


class TestBranches:
    @pytest.mark.parametrize("seed", [6015, 6028, 6051])
    def test_a_dirty_block_says_the_same_in_branches_as_in_a_chain(self, monkeypatch, seed):
        """Of three strips; only large areas take branches otherwise."""
        block = made(24, seed, Dirt(strips=3, lens=0.3, rows=0.1, matches=3, lost=0.3)).block
        usual = diagnose(block)
        taken = []

        def in_branches(*pairs):
            order, tree = chain.blocks_of(*pairs)
            taken.append((np.diff(tree.parent)[:-1] < 1).any())
            return order, tree

        monkeypatch.setattr(chain, "_QUICK", 0.0)
        monkeypatch.setattr(chain, "_WORTH", np.inf)
        for cost in ("_PAIR", "_FRONT"):
            monkeypatch.setattr(fronts, cost, 0.0)
        monkeypatch.setattr(elimination, "blocks_of", in_branches)
        branches = diagnose(block)
        assert taken and all(taken)
        assert branches.verdict == usual.verdict
        # A draw or two of a thousand may lie at the edge.
        assert branches.p_nothing == pytest.approx(usual.p_nothing, abs=2e-3)
        told, asked = (
            [one.evidence for one in found.course.last.evidence.given({})]
            for found in (branches, usual)
        )
        assert told == pytest.approx(asked, abs=1e-6)


class TestTwoThreads:
    def test_they_find_what_one_finds(self, bent):
        one = diagnose(bent.block)
        two = diagnose(bent.block, threads=2, settings=Settings(large_block=1))
        assert two.sentence == one.sentence
        (mine,), (other,) = one.effects, two.effects
        for a, b in zip(mine["parameters"], other["parameters"], strict=True):
            assert b["value"] == pytest.approx(a["value"], rel=1e-6)
            assert b["sigma"] == pytest.approx(a["sigma"], rel=1e-6)

    @pytest.mark.parametrize("threads", [1, 2])
    def test_works_go_by_the_settings_in_use_and_keep_their_order(self, threads):
        with changed(most_rivals=17):
            found = side_by_side(
                threads, *(lambda k=k: (k, SETTINGS.most_rivals) for k in range(5))
            )
        assert found == [(k, 17) for k in range(5)]

    def test_what_fails_in_a_thread_fails(self):
        def wrong():
            raise ValueError("no number")

        with pytest.raises(ValueError, match="no number"):
            side_by_side(2, wrong, lambda: 1)
