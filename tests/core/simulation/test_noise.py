"""Noise: the distribution that comes out, not the draws."""

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

TABLES = {
    "tie_points": ["x", "y"],
    "marks": ["x", "y"],
    "gnss": ["x", "y", "z"],
    "ground": ["x", "y", "z"],
}


@pytest.fixture(scope="module")
def perfect():
    return corridor_block(images=120, control=40, check=40, seed=1)


def off(noisy, perfect, table):
    columns = TABLES[table]
    return (getattr(noisy, table)[columns] - getattr(perfect, table)[columns]).to_numpy()


def test_errors_have_the_sigma_asked_for_on_every_axis(perfect):
    noisy = add_noise(
        perfect, tie_px=0.4, mark_px=0.7, gnss_m=(0.02, 0.03, 0.06), control_m=0.005, seed=7
    )
    asked = {
        "tie_points": [0.4, 0.4],
        "marks": [0.7, 0.7],
        "gnss": [0.02, 0.03, 0.06],
        "ground": [0.005] * 3,
    }
    for table, sigma in asked.items():
        errors = off(noisy, perfect, table)
        # Four standard errors of a standard deviation, and of a mean.
        assert errors.std(axis=0) == pytest.approx(sigma, rel=4 / np.sqrt(2 * len(errors)))
        assert np.abs(errors.mean(axis=0) / sigma).max() < 4 / np.sqrt(len(errors))
    assert noisy.sigma["tie_px"] == 0.4
    assert noisy.sigma["gnss_m"].tolist() == [0.02, 0.03, 0.06]


def test_no_noise_changes_nothing_and_the_perfect_block_stays_as_it_is(perfect):
    before = perfect.copy()
    same = add_noise(perfect)
    add_noise(perfect, tie_px=1.0, gnss_m=1.0, outliers=0.1)
    for table in TABLES:
        assert getattr(same, table).equals(getattr(before, table)), table
        assert getattr(perfect, table).equals(getattr(before, table)), table
    assert same.sigma["tie_px"] == before.sigma["tie_px"]


def test_noise_of_one_kind_does_not_change_another(perfect):
    alone = add_noise(perfect, gnss_m=0.02, seed=2)
    together = add_noise(perfect, tie_px=0.5, mark_px=0.5, gnss_m=0.02, outliers=0.01, seed=2)
    pd.testing.assert_frame_equal(alone.gnss, together.gnss)


def test_outliers_are_the_share_asked_for_and_stay_in_the_picture(perfect):
    noisy = add_noise(perfect, outliers=0.02, seed=4)
    length = np.linalg.norm(off(noisy, perfect, "tie_points"), axis=1)
    assert (length > 0).sum() == round(0.02 * len(length))
    assert length.max() <= 50
    values = noisy.tie_points[["x", "y"]].to_numpy()
    assert values.min() >= 0 and (values <= [5119, 3839]).all()


def test_coordinates_are_rounded_last_and_to_the_nearest_step(perfect):
    rounded = add_noise(perfect, tie_px=0.5, rounding_px=0.25, seed=6)
    free = add_noise(perfect, tie_px=0.5, seed=6)
    for table in ("tie_points", "marks"):
        values = getattr(rounded, table)[["x", "y"]].to_numpy()
        # A quarter is exact in binary.
        assert np.array_equal(values * 4, np.round(values * 4))
        assert np.abs(off(rounded, free, table)).max() <= 0.125
    # Uniform over a step: its width over sqrt(12); four standard errors, sqrt(0.2) each.
    errors = off(rounded, free, "tie_points")
    assert errors.std() == pytest.approx(0.25 / np.sqrt(12), rel=4 * np.sqrt(0.2 / errors.size))
    assert rounded.sigma["tie_px"] == 0.5
    pd.testing.assert_frame_equal(rounded.gnss, free.gnss)
    pd.testing.assert_frame_equal(rounded.ground, free.ground)


@pytest.mark.parametrize(
    "wrong", [{"tie_px": -1.0}, {"gnss_m": (0.1, -0.1, 0.1)}, {"rounding_px": -0.1}]
)
def test_a_negative_sigma_is_refused(perfect, wrong):
    (key,) = wrong
    with pytest.raises(InputError, match=rf"noise: {key} = .* is below 0"):
        add_noise(perfect, **wrong)


def test_a_share_above_one_is_refused(perfect):
    with pytest.raises(InputError, match="outliers = 2 is a share: give 0 to 1"):
        add_noise(perfect, outliers=2.0)


@pytest.fixture(scope="module")
def errors():
    block = corridor_block(images=600, strips=2, observations_per_image=5, flights=2, seed=2)
    rows = [
        add_noise(block, gnss_m=0.01, gnss_slow=0.5, seed=s).gnss[["x", "y", "z"]].to_numpy()
        - block.gnss[["x", "y", "z"]].to_numpy()
        for s in range(20)
    ]
    return block, np.array(rows)


class TestSlowGnss:
    """Half of the variance correlated over 120 s."""

    def test_the_variance_is_what_was_asked_for(self, errors):
        # 20 draws of 600 x 3; slow parts of 2.5 s steps count about one in fifty: 2 %, four times.
        assert errors[1].std() == pytest.approx(0.01, rel=0.08)

    def test_neighbours_share_half_of_it_and_later_ones_less(self, errors):
        block, made = errors
        time = block.images["time_s"].to_numpy()[:300]
        first = made[:, :300]
        lag = 48
        expected = 0.5 * np.exp(-(time[lag] - time[0]) / 120.0)
        found = (first[:, lag:] * first[:, :-lag]).mean() / 0.01**2
        assert found == pytest.approx(expected, abs=0.06)
        near = (first[:, 1:] * first[:, :-1]).mean() / 0.01**2
        assert near == pytest.approx(0.5, abs=0.06)

    def test_flights_share_nothing(self, errors):
        made = errors[1]
        assert abs((made[:, 299] * made[:, 300]).mean()) / 0.01**2 < 0.45
