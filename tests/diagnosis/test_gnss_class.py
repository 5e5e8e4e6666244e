"""How large slow noise of the GNSS may be is a matter of what kind of positions they are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_evidence import known_otherwise

from corridor.diagnosis.noise.gnss import most_of_class, stated_noise
from corridor.diagnosis.noise.likelihood import Arguments, estimate
from corridor.diagnosis.settings import SETTINGS

COUNT = 120


def positions(stated, white, wander=0.0, seed=0):
    """Positions every two seconds, off by white noise and by one slow wave of `wander` metres."""
    rng = np.random.default_rng(seed)
    time = 2.0 * np.arange(COUNT)
    residual = rng.standard_normal((COUNT, 3)) * white
    residual += wander * np.sin(2 * np.pi * time / 120.0)[:, None]
    return SimpleNamespace(
        gnss=SimpleNamespace(
            image=np.arange(COUNT), sigma=np.tile(stated, (COUNT, 1)), residual=residual
        ),
        images=SimpleNamespace(time=time, flight=np.zeros(COUNT, dtype=int), flight_names=["1"]),
    )


class TestTheClass:
    def test_fixed_solutions_wander_by_centimetres(self):
        _, most = most_of_class(positions([0.02, 0.02, 0.03], 0.008))
        assert np.allclose(most, SETTINGS.carrier_phase_slow)

    def test_a_wander_does_not_make_another_class_of_them(self):
        _, most = most_of_class(positions([0.02, 0.02, 0.03], 0.008, wander=0.10))
        assert np.allclose(most, SETTINGS.carrier_phase_slow)

    def test_a_large_stated_sigma_counts_where_positions_scatter_by_it(self):
        """Five centimetres stated for a height that is good to one are the importer's."""
        assert (
            most_of_class(positions([0.02, 0.02, 0.05], 0.01))[1, 2]
            == SETTINGS.carrier_phase_slow[2]
        )
        honest = most_of_class(positions([0.02, 0.02, 0.05], [0.01, 0.01, 0.06]))
        assert honest[1, 2] == pytest.approx(0.05)

    @pytest.mark.parametrize(("stated", "white"), [(3.0, 0.3), (0.02, 1.0)])
    def test_positions_from_code_may_wander_by_anything(self, stated, white):
        assert np.isinf(most_of_class(positions([stated] * 3, white))).all()


@pytest.mark.parametrize("held", [True, False])
def test_what_a_model_lacks_is_no_wander_of_a_fixed_solution(held):
    """Ten centimetres over two minutes, seen at the antenna alone: poses are known otherwise."""
    stated = np.array([0.02, 0.02, 0.03])
    system = positions(stated, 0.008, wander=0.10)
    e = known_otherwise(system.images.time, system.gnss.residual, stated)
    noise = stated_noise(e.system)
    if not held:
        noise = replace(noise, most=np.full((2, 3), np.inf))
    found = estimate(e, (), Arguments(noise)).noise
    within = found.coloured[0] <= 1.001 * np.array(SETTINGS.carrier_phase_slow)
    assert within.all() if held else (found.coloured[0] > 0.04).all()
    # Nor is it white noise: that is how one position differs from the next.
    assert not held or (found.white[0] * stated < 0.03).all()
