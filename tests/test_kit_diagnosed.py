"""What chapter 5b shows of the game, played by the program."""

import pandas as pd
from kit import diagnosed, hide

import corridor
from benchmarks.diagnosis import of_folder
from benchmarks.diagnosis.summary import ANSWERS


def test_what_is_told_counts_right_and_wrong_names_and_those_of_nothing():
    counts = pd.DataFrame(
        [[0, 1, 0, 9], [3, 0, 2, 1], [1, 4, 0, 0]],
        ["nothing", "rolling_shutter", "focal_drift"],
        ["rolling_shutter", "focal_drift", "its set", "nothing"],
    )
    assert diagnosed.told(counts) == (
        "an effect hidden in 11 flights: 7 named rightly, 1 wrongly, 3 not named alone\n"
        "nothing hidden in 10 flights: 1 given a name"
    )


def test_the_stored_answers_are_of_effects_of_the_catalogue():
    counts = diagnosed.read()
    known = {effect.slug for effect in corridor.catalogue()}
    assert set(counts.index) == set(hide.SIZES)
    assert set(counts.columns) <= known | set(ANSWERS)
    # Every effect of the game as often as every other.
    assert len(set(counts.sum(axis=1))) == 1


def test_every_effect_is_flown_at_every_level_with_its_truth_beside_it(tmp_path, monkeypatch):
    monkeypatch.setattr(hide, "LEVELS", ("easy",))
    diagnosed.fly(tmp_path, 1)
    trials = of_folder(tmp_path)
    hidden = {trial.name: trial.load()[2].label for trial in trials}
    assert hidden == {f"1-{effect}-easy": effect for effect in hide.SIZES}
