"""What a flight cannot tell apart is known before anything is measured."""

import numpy as np
import pytest

from corridor.diagnosis import confusability, diagnose
from corridor.interface.figures import alike
from tests.diagnosis.test_diagnose import made


@pytest.fixture(scope="module")
def table():
    evidence = diagnose(made()).course.last.evidence
    return confusability(evidence)


def test_a_height_bias_of_gnss_and_a_wrong_datum_of_control_are_one_class(table):
    """Issue: GNSS height bias and control datum can never be told apart."""
    assert table.loc["gnss_bias", "control_datum"] > 0.97
    assert table.loc["control_datum", "gnss_bias"] > 0.97


def test_a_rolling_shutter_is_not_explained_by_a_bias_of_gnss(table):
    assert table.loc["rolling_shutter", "gnss_bias"] < 0.1


def test_shares_lie_between_nothing_and_all_of_an_effect(table):
    assert np.all((table >= 0) & (table <= 1))
    assert np.all(np.diag(table) == 1)


def test_the_picture_leaves_out_what_looks_like_nothing_else(table):
    drawn = alike(table, "24 images", least=0.9)
    words = " ".join(text.get_text() for text in drawn.axes[0].get_yticklabels())
    assert "gnss bias" in words
    assert len(drawn.axes[0].get_yticklabels()) < len(table)
