"""The iterations come to their end where real flights are hard."""

import importlib

import numpy as np
import pytest
from kit.gyroscope import level_ground
from strips import corridor_block

import corridor
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.model import Loss, Model
from corridor.core.adjustment.normal import Normal, shared_values
from corridor.core.adjustment.problem import make_problem
from corridor.core.adjustment.solving import SHARED_STEP, solve
from corridor.core.simulation import add_noise


@pytest.fixture(scope="module")
def flat():
    """One flight of the dike with coarse positions and no control: f and height trade."""
    block = corridor.read("data_synthetic/dike")
    second = block.images["image"][block.images["flight"] == "F2"]
    block = block.select(images=list(second)).copy()
    block.gnss = block.gnss.assign(sx=3.0, sy=3.0, sz=6.0)
    block.tie_points = block.tie_points.assign(sigma=0.3)
    return block


def far(block, factor):
    """The block with a focal length that starts elsewhere."""
    block = block.copy()
    block.cameras = {n: c.with_values(f=factor * c["f"]) for n, c in block.cameras.items()}
    return block


def test_a_focal_length_a_third_too_long_finds_its_way_along_the_valley(flat):
    """With damping alone it takes more than 200 iterations."""
    long = corridor.adjust(far(flat, 1.3), control=[], lever_arm="fixed", max_iterations=20)
    short = corridor.adjust(far(flat, 0.7), control=[], lever_arm="fixed", max_iterations=20)
    assert long.converged and short.converged
    a, b = (found.parameters["camera.camlight.f"] for found in (long, short))
    assert a.value == pytest.approx(b.value, abs=0.01 * a.sigma)


def test_an_adjustment_from_a_result_starts_where_that_one_ended():
    """Ground that is known to 10 m only is no start: points.csv knows those points better."""
    block = corridor_block(images=12, strips=2, observations_per_image=40, control=0, seed=3)
    block = level_ground(block, height_m=15.0, sigma_m=10.0, points=20)
    first = corridor.adjust(block, camera="fixed")
    again = corridor.adjust(first.block, camera="fixed")
    assert again.history[0]["step"] < 1e-4
    assert again.history[0]["cost"] == pytest.approx(first.cost, rel=1e-6)


@pytest.mark.parametrize("effects", [(), ("rolling_shutter",)])
@pytest.mark.parametrize("seed", range(6))
def test_what_images_share_has_hardly_further_to_go_where_the_iterations_end(seed, effects):
    """A thousandth of a standard deviation, against the end of far more iterations."""
    start = (0.3, 0.003, 0.3)
    block = corridor_block(48, 3, seed, observations_per_image=60, control=4, start_error=start)
    block = add_noise(block, tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), seed=seed)
    problem = make_problem(corridor.prepare(block).block, Model(effects=list(effects)))
    normal = Normal(problem, Loss())
    found, far = (solve(normal, 30, tolerance) for tolerance in (5e-5, 1e-9))
    assert found.converged and len(found.history) < len(far.history)
    system = LinearSystem(problem, far.state)
    sigma = np.sqrt(np.diag(system.factor.shared_inverse()))
    left = np.abs(shared_values(problem, found.state) - shared_values(problem, far.state))
    assert (left < SHARED_STEP * sigma).all()


@pytest.mark.parametrize("effects", [(), ("rolling_shutter",)])
@pytest.mark.parametrize("loss", ["squares", "huber:2"])
def test_the_factor_of_the_last_step_is_that_of_the_equations_at_the_result(
    effects, loss, monkeypatch
):
    """Within a millionth: the step was shorter than 1e-6 of a standard deviation."""
    # A matrix that served two steps is made anew for the result.
    module = importlib.import_module("corridor.core.adjustment.solving")
    monkeypatch.setattr(module, "REUSE_SQUARES", (0.0, 0.0))
    monkeypatch.setattr(module, "REUSE_ROBUST", (0.0, 0.0))
    start = (0.3, 0.003, 0.3)
    block = corridor_block(48, 3, observations_per_image=60, control=4, start_error=start)
    block = add_noise(block, tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), seed=2)
    problem = make_problem(corridor.prepare(block).block, Model(effects=list(effects)))
    normal = Normal(problem, Loss.parse(loss))
    found = solve(normal, tolerance=2e-8, equations=True)
    mine = LinearSystem.in_place(normal, found.state, 1, found.factor)
    anew = LinearSystem(problem, found.state, normal.loss)
    assert found.factor is not None
    ours, theirs = (one.factor.shared_inverse() for one in (mine, anew))
    sigma = np.sqrt(np.diag(theirs))
    assert np.abs((ours - theirs) / np.outer(sigma, sigma)).max() < 1e-6
    assert mine.right == pytest.approx(anew.right, rel=1e-6, abs=1e-6 * np.abs(anew.right).max())
    cost, _ = normal.cost_at(found.state)
    assert found.cost == pytest.approx(cost, rel=1e-9)


def test_a_robust_loss_that_creeps_keeps_its_matrix_and_ends_where_new_ones_lead(monkeypatch):
    """One match in five is wrong: steps of weights, of which each is most of the one before."""
    block = corridor_block(30, 2, 3, observations_per_image=60, control=4)
    block = add_noise(block, tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), seed=3)
    rng = np.random.default_rng(1)
    away = rng.normal(size=(len(block.tie_points), 2)) * 4.0
    away[rng.random(len(away)) > 0.2] = 0.0
    block.put("tie_points", ("x", "y"), block.tie_points[["x", "y"]].to_numpy() + away)
    problem = make_problem(corridor.prepare(block).block, Model())
    matrices, assemble = [], Normal.assemble

    def counted(normal, state, damping, near=None, matrix=True):
        matrices.append(matrix)
        assemble(normal, state, damping, near, matrix)

    monkeypatch.setattr(Normal, "assemble", counted)
    found = solve(Normal(problem, Loss.parse("cauchy:1")), 100)
    kept = matrices.count(False) / len(matrices)
    monkeypatch.setattr(importlib.import_module(solve.__module__), "REUSE_ROBUST", (0.0, 0.0))
    anew = solve(Normal(problem, Loss.parse("cauchy:1")), 100)
    assert found.converged and anew.converged
    assert kept > 0.25
    assert abs(found.iterations - anew.iterations) <= 2
    assert found.cost == pytest.approx(anew.cost, rel=1e-6)
