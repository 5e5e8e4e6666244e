"""The usual size of residuals does not follow a few wrong ones."""

import numpy as np
import pytest

from corridor.core.geometry import (
    GROSS,
    OUTLIER,
    is_outlier,
    robust_scale,
    robust_scale_of_lengths,
)

NOISE = np.random.default_rng(4).normal(0, 0.3, (20_000, 2))


def with_gross(values):
    return np.concatenate([values, np.full((200, 2), 1e3)])


class TestRobustScale:
    """Within 3 %: the median of 20,000 has 0.8 %, one gross error in a hundred adds 1 %."""

    def test_it_is_the_standard_deviation_of_normal_residuals_and_gross_errors_do_not_count(self):
        assert robust_scale(with_gross(NOISE)) == pytest.approx(0.3, rel=0.03)
        assert robust_scale(with_gross(NOISE), axis=0) == pytest.approx([0.3, 0.3], rel=0.03)

    def test_lengths_in_the_plane_give_the_standard_deviation_of_a_coordinate(self):
        lengths = np.hypot(*with_gross(NOISE).T)
        assert robust_scale_of_lengths(lengths) == pytest.approx(0.3, rel=0.03)

    def test_a_shift_counts_unless_it_is_taken_off(self):
        assert robust_scale(NOISE + 5.0, centred=True) == pytest.approx(0.3, rel=0.03)
        assert robust_scale(NOISE + 5.0) > 5.0

    def test_unknown_residuals_do_not_count_and_without_any_there_is_the_least(self):
        assert robust_scale([np.nan, -2.0, 2.0]) == pytest.approx(2 * 1.4826)
        assert robust_scale([], least=1e-9) == robust_scale_of_lengths([], least=1e-9) == 1e-9


def test_an_outlier_is_beyond_five_usual_sizes_and_a_gross_error_beyond_fifteen():
    sizes = np.array([4.9, 5.1, 14.9, 15.1]) * 0.3
    assert is_outlier(sizes, 0.3).tolist() == [False, True, True, True]
    assert is_outlier(sizes, 0.3, GROSS).tolist() == [False, False, False, True]
    assert OUTLIER == 5.0
