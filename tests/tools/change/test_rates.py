"""What is stated comes true, as often as it says: draws of the same dike with other noise."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from benchmarks import change as benchmark


@pytest.fixture(scope="module")
def draws(request):
    return benchmark.draws(request.param)


@pytest.mark.parametrize("draws", [6, pytest.param(60, marks=pytest.mark.slow)], indirect=True)
class TestDraws:
    def test_the_spread_is_the_stated_one(self, draws):
        """A volume's is one number a draw; the others, correlated, are bounded as if so were they.

        `python -m benchmarks.change` says how near 200 draws come.
        """
        for kind in ("surface", "points", "volume"):
            rms, count = benchmark.scatter(draws, kind)["ratio"], len(draws)
            low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], count) / count)
            assert low < rms < high, kind

    def test_false_alarms_come_at_the_rate_asked_for(self, draws):
        moved = sum(bool(one["moved"]) for one in draws)
        assert moved <= binom.ppf(0.9995, len(draws), 0.01)

    def test_half_is_seen_at_the_level_of_detection_and_all_at_twice(self, draws):
        once, twice = np.mean([one["seen"] for one in draws], axis=0)
        # A draw shifts all core points alike: as uncertain as so many coins.
        room = 3.3 * np.sqrt(0.25 / len(draws))
        assert abs(once - 0.5) < room
        assert twice > 0.97 - 3.3 * np.sqrt(0.025 * 0.975 / len(draws))
