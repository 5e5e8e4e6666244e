"""Which settings matter, by a diagnosis that is made up."""

import pytest

from benchmarks.diagnosis import sensitivity
from corridor.diagnosis.settings import Settings


@pytest.mark.parametrize(
    ("value", "half", "double"),
    [
        (3.0, 1.5, 6.0),
        (0.01, 0.005, 0.02),
        (0.9, 0.45, 0.95),
        (1, 1, 2),
        ((4, 0.2), (2, 0.1), (8, 0.4)),
    ],
)
def test_levels_and_shares_stay_below_one_and_numbers_whole(value, half, double):
    assert sensitivity.times(value, 0.5) == pytest.approx(half)
    assert sensitivity.times(value, 2.0) == pytest.approx(double)


def one(verdict="named", value=1.0, sigma=0.1):
    found = [] if verdict == "nothing" else ["focal"]
    values = {"focal f": (value, sigma)} if found else {}
    return {"verdict": verdict, "found": found, "alarms": [], "values": values}


def test_a_fifth_of_a_sigma_is_no_difference_and_another_verdict_is():
    assert not sensitivity.differs(one(), one(value=1.015))
    assert sensitivity.differs(one(), one(value=1.03)) == "focal f by 0.30 sigma, sigma times 1.00"
    assert sensitivity.differs(one(), one(sigma=0.13))
    assert sensitivity.differs(one(), one("nothing")).startswith("verdict")


def test_of_settings_changed_together_those_that_matter_are_found(monkeypatch):
    """Two of nine matter: one where it is halved, one where it is doubled."""

    def told(block, settings=None):
        settings = settings or Settings()
        return one("nothing" if settings.named_least < 3 or settings.folds > 10 else "named")

    monkeypatch.setattr(sensitivity, "told", told)
    monkeypatch.setattr(sensitivity, "bench", lambda: {"block": lambda: None})
    names = ["student_nu", "named_least", "iterations", "fewest", "places", "folds", "settled",
             "null_draws", "most_free"]  # fmt: skip
    usual = {"block": told(None)}
    assert set(sensitivity.matter(names, 0.5, usual, lambda said: None)) == {"named_least"}
    assert set(sensitivity.matter(names, 2.0, usual, lambda said: None)) == {"folds"}
