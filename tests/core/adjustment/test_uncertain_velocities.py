"""A readout beside velocities that are derived from positions: neither drawn to zero nor too sure.

The blocks are made row by row, with a projection of their own (benchmarks/flown.py).
"""

import importlib

import numpy as np
import pytest

import corridor
from benchmarks.flown import READOUT, flown
from corridor.core.adjustment import Model, Run, make_problem, refit
from corridor.core.effects import VELOCITY_SIGMA


def readout(block):
    found = corridor.adjust(block, camera="f,cx,cy,k1", effects=["rolling_shutter"])
    row = found.effects.iloc[0]
    return row["value"], row["sigma"], found


@pytest.mark.parametrize("kind", ["one speed", "two speeds"])
def test_errors_are_as_large_as_their_sigmas(tmp_path, kind):
    """Sixteen blocks: the mean error within three of its own sigmas, their size within 40 %."""
    pulls = []
    for seed in range(16):
        value, sigma, _ = readout(flown(tmp_path, seed, kind))
        pulls.append((value - READOUT) / sigma)
    assert abs(np.mean(pulls)) < 3 / np.sqrt(16)
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_uncertain_velocities_tell_less_than_exact_ones(tmp_path):
    exact, uncertain = (readout(flown(tmp_path, 1, derived=one))[1] for one in (False, True))
    assert uncertain > 1.1 * exact


def test_a_stated_sigma_counts(tmp_path):
    """The same velocities, believed to the centimetre a second and to a metre a second."""
    block = flown(tmp_path, 2, derived=False)
    sigmas = []
    for stated in (0.01, 1.0):
        block.put("images", VELOCITY_SIGMA, np.full((len(block.images), 3), stated))
        problem = make_problem(block, effects=["rolling_shutter"])
        assert problem.per_image_prior[1].min() == pytest.approx((0.03 * stated) ** -2)
        sigmas.append(readout(block)[1])
    assert sigmas[1] > sigmas[0]


def test_errors_of_velocities_stand_in_no_table(tmp_path):
    found = readout(flown(tmp_path, 3))[2]
    assert set(found.effects["slug"]) == {"rolling_shutter"}
    assert len(found.problem.beside) == 2


def test_a_refit_with_another_size_of_these_errors_begins_where_the_last_one_ended(
    tmp_path, monkeypatch
):
    """Robust from the first step on: poses, points and the readout are there."""
    module = importlib.import_module("corridor.core.adjustment.adjusting")
    solved, solve = [], module.solve

    def kept(*args, **how):
        solved.append(solve(*args, **how))
        return solved[-1]

    monkeypatch.setattr(module, "solve", kept)
    block = corridor.prepare(flown(tmp_path, 1)).block
    model = Model(camera="f,cx,cy,k1", effects=["rolling_shutter"], loss="cauchy:2")
    found = refit(block, model, Run())
    first, *rounds = solved
    assert rounds and found.converged
    assert all(one.iterations < first.iterations for one in rounds)
    assert all(one.history[0]["cost"] < 1.2 * found.cost for one in rounds)
