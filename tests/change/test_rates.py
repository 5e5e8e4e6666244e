"""What is stated comes true, as often as it says: draws of the same dike with other noise."""

import numpy as np
import pytest
from made import flown, joint, middle
from scipy.stats import binom, chi2

import corridor
from corridor.change import make_cores, point_changes, surface_change, volume


@pytest.fixture(scope="module")
def draws(request):
    """Changes over their stated sigma in so many comparisons of a dike at rest."""
    x, y = middle()
    polygon = np.array([[x - 15, y - 10], [x + 15, y - 10], [x + 15, y + 10], [x - 15, y + 10]])
    cores, out = None, {"surface": [], "points": [], "volume": [], "seen": [], "moved": 0}
    for k in range(request.param):
        first, second = (corridor.adjust(flown(5000 + 2 * k + n)) for n in (0, 1))
        both = joint(first, second)
        cores = cores or make_cores(both.before.xyz, both.after.xyz, spacing=12.0)
        surface = surface_change(both, cores, sampled=False)
        points = point_changes(both, 0.01, "stated", "rigid")
        one = volume(both, polygon, cores, sampled=False)
        out["surface"].append(surface.distance / surface.sigma)
        out["points"].append((points.shift / points.sigma).ravel())
        out["volume"].append(np.array([one.value / one.sigma]))
        # The distance is linear: a rise of its level of detection is added as such.
        risen = np.abs(surface.distance + np.outer([1, 2], surface.detection))
        out["seen"].append((risen > surface.detection).mean(axis=1))
        out["moved"] += bool(points.moved.any())
    return out


@pytest.mark.parametrize("draws", [6, pytest.param(60, marks=pytest.mark.slow)], indirect=True)
class TestDraws:
    def test_the_spread_is_the_stated_one(self, draws):
        """A volume's is one number a draw; the others, correlated, are bounded as if so were they.

        `python -m benchmarks.change` says how near 200 draws come.
        """
        for kind in ("surface", "points", "volume"):
            rms = np.sqrt(np.mean(np.concatenate(draws[kind]) ** 2))
            count = len(draws[kind])
            low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], count) / count)
            assert low < rms < high, kind

    def test_false_alarms_come_at_the_rate_asked_for(self, draws):
        count = len(draws["points"])
        assert draws["moved"] <= binom.ppf(0.9995, count, 0.01)

    def test_half_is_seen_at_the_level_of_detection_and_all_at_twice(self, draws):
        once, twice = np.mean(draws["seen"], axis=0)
        # A draw shifts all core points alike: as uncertain as so many coins.
        room = 3.3 * np.sqrt(0.25 / len(draws["seen"]))
        assert abs(once - 0.5) < room
        assert twice > 0.97 - 3.3 * np.sqrt(0.025 * 0.975 / len(draws["seen"]))
