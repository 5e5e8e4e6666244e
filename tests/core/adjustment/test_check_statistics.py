"""Check-point statistics: the definitions behind the tables of Zhou 2019."""

import numpy as np
import pytest

from corridor.core.adjustment import check_table

RNG = np.random.default_rng(5)


class TestCheckTable:
    def test_lengths_in_plan_and_space_and_signs_in_height_by_hand(self):
        """Lengths 5 and 0 in xy, 0 and 12 in z, 5 and 12 in 3D."""
        table = check_table(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 12.0]]))
        assert table.rms == pytest.approx((np.sqrt(12.5), np.sqrt(72), np.sqrt(84.5)))
        assert table.mean == pytest.approx((2.5, 6.0, 8.5))
        assert table.std == pytest.approx((np.sqrt(12.5), np.sqrt(72), np.sqrt(24.5)))

    def test_mean_in_height_keeps_its_sign_and_a_mean_length_has_none(self):
        """As in Zhou 2019, table 7.4, row o-8p-GCP1: xy 9.4, z -1.7, 3D 11.6 cm."""
        table = check_table(np.array([[-3.0, 4.0, -1.0], [3.0, -4.0, -2.0]]))
        assert table.mean.xy == 5.0
        assert table.mean.z == -1.5

    def test_rms_joins_mean_and_unbiased_std(self):
        """RMS^2 = mean^2 + (n - 1)/n STD^2, which the rows of Zhou 2019, tables 7.4 to 7.7 obey."""
        table = check_table(RNG.normal(0.3, 1.0, (7, 3)))
        for rms, mean, std in zip(*table, strict=True):
            assert rms**2 == pytest.approx(mean**2 + 6 / 7 * std**2)

    def test_one_point_has_no_spread(self):
        table = check_table(np.array([[0.0, 0.0, 2.0]]))
        assert table.rms.z == table.mean.z == 2.0
        assert np.isnan(table.std).all()

    def test_no_point_gives_no_number(self):
        assert np.isnan(np.array(check_table(np.empty((0, 3))))).all()

    def test_points_without_coordinates_do_not_count(self):
        table = check_table(np.array([[3.0, 4.0, 0.0], [np.nan, 0.0, 0.0]]))
        assert table.rms.xy == 5.0
