"""Marks and ground control that are not as good as stated."""

import numpy as np
import pytest
from test_gross_errors import flown

import corridor


def noisy_marks(block, px, seed=1):
    marks = block.marks.copy()
    marks[["x", "y"]] += np.random.default_rng(seed).normal(0, px, (len(marks), 2))
    block.marks = marks
    return block


def noisy_control(block, sigma, stated, seed=1):
    """Control and check points alike."""
    ground = block.ground.copy()
    ground[["x", "y", "z"]] += np.random.default_rng(seed).normal(0, sigma, (len(ground), 3))
    ground[["sx", "sy", "sz"]] = stated
    block.ground = ground
    return block


def about(notes, kind):
    return [note for note in notes if note.startswith(kind)]


@pytest.mark.parametrize("seed", [46, 47, 48])
def test_marks_worse_than_stated_accuse_no_control(seed):
    block = noisy_marks(flown(seed), 4.0)
    found = corridor.adjust(block)
    (told,) = about(found.notes, "Marks:")
    assert "where 0.3 px is stated" in told
    seen = float(told.split("accurate to ")[1].split(" px")[0])
    assert seen == pytest.approx(4.0, rel=0.35)
    assert not any("Ground control is wrong" in warning for warning in found.warnings)
    # Weights are as stated: whoever states them may be answered by their digits.
    assert found.start.mark_sigma()[0] == pytest.approx(0.3)


def test_a_diagnosis_weights_them_as_they_are():
    found = corridor.diagnose(noisy_marks(flown(46), 4.0))
    assert found.verdict == "nothing" and about(found.notes, "Marks:")
    assert np.median(found.block.mark_sigma()) == pytest.approx(4.0, rel=0.35)


def test_control_worse_than_stated_is_told_as_a_whole():
    found = corridor.adjust(noisy_control(flown(45), 0.03, 0.001))
    (told,) = about(found.notes, "Ground control:")
    assert "where 0.001 and 0.001 m are stated" in told
    assert 0.008 < float(told.split("accurate to ")[1].split(" m")[0]) < 0.06
    wrong = [w for w in found.warnings if w.startswith("Ground control is wrong")]
    assert sum(w.count(";") + 1 for w in wrong) <= 1


@pytest.mark.parametrize("seed", range(60, 66))
def test_what_is_as_stated_says_nothing(seed):
    found = corridor.adjust(flown(seed))
    assert not about(found.notes, "Marks:") and not about(found.notes, "Ground control:")


def test_a_single_wrong_point_strains_its_marks_and_is_not_their_fault():
    block = flown(28)
    row = block.ground.index[block.ground["role"] == "control"][2]
    block.ground.loc[row, "z"] += 1.0
    found = corridor.adjust(block)
    assert not about(found.notes, "Marks:") and not about(found.notes, "Ground control:")
    assert any("G05 in height by +1.00 m" in note for note in found.notes)


def test_check_points_of_another_base_are_told_together():
    block = flown(67, check=8)
    block.ground.loc[block.ground["role"] == "check", "z"] += 0.12
    sentence = corridor.diagnose(block).sentence
    assert "all check points lie" in sentence and "gnss_bias" not in sentence
    assert "surveyed from another base" in sentence
