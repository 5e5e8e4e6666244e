"""What chapters 4 and 5 make of the surveys of Viabon."""

import numpy as np
import pandas as pd
import pytest
from kit import published, viabon

STATISTICS = ["c-8p-GCP1 xy", "c-8p-GCP1 z"]


def made_up(amount_true, draws=40, seed=0):
    """Draws of a cause that adds in squares to 2 and 3 cm, with log-normal scatter."""
    draw = np.random.default_rng(seed)
    rows = []
    for cause, amounts in {viabon.NOTHING: (0.0,), "rotation": (1.0, 2.0), "marks": (1.0,)}.items():
        for amount in amounts:
            strength = np.array([4.0, 1.0]) if cause == "rotation" else np.array([0.0, 0.0])
            middle = np.sqrt(np.array([4.0, 9.0]) + strength * amount**2)
            for number in range(draws):
                values = middle * np.exp(0.2 * draw.standard_normal(2))
                head = dict(zip(viabon.COLUMNS, ("d2", 150, cause, amount, number), strict=True))
                rows.append(
                    head | dict(zip(["c-8p-GCP1 rms_xy", "c-8p-GCP1 rms_z"], values, strict=True))
                )
    truth = np.sqrt(np.array([4.0, 9.0]) + np.array([4.0, 1.0]) * amount_true**2)
    return pd.DataFrame(rows), truth


@pytest.mark.parametrize("true", [1.0, 1.7, 2.3])
def test_the_amount_that_was_put_in_is_found_within_its_interval(monkeypatch, true):
    draws, published = made_up(true)
    monkeypatch.setattr(viabon, "published_values", lambda *_: published)
    found = viabon.judge(draws, "d2", "rotation", STATISTICS)
    assert found.low < true < found.high
    assert found.amount == pytest.approx(true, abs=0.25)
    assert found.better > 1 and found.factor < 1.1
    assert found.expected(0.0) == pytest.approx([2, 3], rel=0.1)


def test_a_cause_that_does_nothing_makes_nothing_more_likely(monkeypatch):
    draws, published = made_up(1.5)
    monkeypatch.setattr(viabon, "published_values", lambda *_: published)
    assert viabon.judge(draws, "d2", "marks", STATISTICS).better < 1.0


def test_intervals_of_new_draws_hold_the_amount_that_was_put_in(monkeypatch):
    """95 % intervals: of 60 published draws, 57 +- 2 hold the truth."""
    draws, middle = made_up(1.5)
    random = np.random.default_rng(1)
    held = 0
    for _ in range(60):
        values = middle * np.exp(0.2 * random.standard_normal(2))
        monkeypatch.setattr(viabon, "published_values", lambda *_, values=values: values)
        found = viabon.judge(draws, "d2", "rotation", STATISTICS)
        held += found.low <= 1.5 <= found.high
    assert 50 <= held


def test_no_verdict_is_from_one_draw():
    counts = viabon.TABLE.read().groupby(["survey", "cause", "amount"]).size()
    assert counts.min() >= 8


def test_motions_of_single_images_are_in_the_table_where_they_are_asked_for():
    table = viabon.TABLE.read()
    for head, cameras in viabon.PER_IMAGE.items():
        rows = viabon.some(table, *head)
        assert rows[[f"m-{camera}-GCP1 rms_3d" for camera in cameras]].notna().all(axis=None)


def test_a_row_that_holds_with_no_cause_says_which_part_is_off():
    """With the larger of two amounts RMS and mean come out, STD does not."""
    register = viabon._register()
    name = "shutter.d2.c_8p_2.z"
    of = {
        words: published.compare({name: np.array(ours)}, register=register)[name]
        for words, ours in {"pitch 1": (0.0, 5.0, 0.0), "pitch 2": (4.8, -1.0, 1.2)}.items()
    }
    said = published._nearest_miss(of)
    assert said == "holds with none of pitch 1, pitch 2; nearest with pitch 2: STD 1.2 cm"
