"""Blocks with correlated measurements: counterparts are drawn with the same correlations."""

from dataclasses import replace

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.block import RHO, with_equal_axes
from corridor.core.errors import InputError
from corridor.diagnosis.bootstrap.replicate_block import counterpart
from corridor.diagnosis.bootstrap.replicator import Replicator
from corridor.diagnosis.noise.gnss import stated_noise

GNSS_RHO, CONTROL_RHO = (0.7, -0.5, -0.3), (-0.6, 0.4, 0.2)
NOISE = {"tie_px": 0.5, "mark_px": 0.5, "gnss_m": 0.03, "control_m": 0.02}


def flown(**correlated):
    block = corridor_block(
        images=16, strips=2, observations_per_image=60, seed=4, control=5, check=2, relief=8.0
    )
    return corridor.simulation.add_noise(block, **NOISE, **correlated, seed=4)


def test_draws_have_the_correlations_of_the_block():
    """Of 60 draws of 16 positions and 5 points a correlation is known to 0.03 and 0.06; the sizes
    along the independent coordinates are those that are stated, not the ones found."""
    adjusted = corridor.adjust(flown(gnss_rho=GNSS_RHO, control_rho=CONTROL_RHO))
    made = Replicator(adjusted)
    gnss, control = made.system.gnss, made.system.control
    noise = replace(made.noise, gnss=stated_noise(made.system), control=1.0)
    errors = {"gnss": [], "control": []}
    for k in range(60):
        drawn = made.errors(made.draw(np.random.default_rng(k), noise))
        errors["gnss"].append(gnss.along_axes(drawn.gnss))
        errors["control"].append(control.along_axes(drawn.control))
    for kind, rho, allowed in (("gnss", GNSS_RHO, 0.1), ("control", CONTROL_RHO, 0.2)):
        found = np.corrcoef(np.concatenate(errors[kind]).T)
        assert found[[0, 0, 1], [1, 2, 2]] == pytest.approx(rho, abs=allowed)


def test_a_counterpart_stands_where_the_block_does():
    """Positions are written along the axes: they miss those of the block by its noise."""
    block = flown(gnss_rho=GNSS_RHO, control_rho=CONTROL_RHO)
    made = counterpart(corridor.adjust(block), seed=2)
    away = made.numbers("gnss", *"xyz") - block.numbers("gnss", *"xyz")
    assert np.abs(away).max() < 6 * 0.03 * np.sqrt(2)
    away = made.numbers("ground", *"xyz") - block.numbers("ground", *"xyz")
    assert np.abs(away).max() < 6 * 0.02 * np.sqrt(2) + 0.1
    assert made.correlation("gnss") == pytest.approx(block.correlation("gnss"))


def test_correlated_image_points_are_refused_or_taken_as_equal_and_said():
    block = flown(image_rho=0.6)
    with pytest.raises(InputError, match="without sx, sy and rho_xy"):
        Replicator(corridor.adjust(block))
    plain, (note,) = with_equal_axes(block)
    assert "equally good and independent" in note
    assert not set(plain.marks) & {"sx", "sy", RHO[0]}
    # The fourth root of the determinant: 0.5 (1 - 0.36)^(1/4).
    assert plain.mark_sigma() == pytest.approx(0.5 * 0.64**0.25)
    assert with_equal_axes(plain) == (plain, [])
