"""The covariances against the spread of adjustments with drawn noise."""

import numpy as np
import pandas as pd
import pytest
from small_plans import NADIR, OBLIQUE, SIGMAS, plan_of

import corridor
from corridor.core.simulation import TiePoints, add_noise
from corridor.tools.planning import GnssNoise, Planner

NOISE = GnssNoise(correlated=0.5, correlation_s=20.0, bias_m=(0.02, -0.01, 0.05))


def drawn(block, seed):
    """The block with the plan's noise on everything, the GNSS's with its memory and bias."""
    rng = np.random.default_rng(seed)
    noisy = add_noise(
        block, SIGMAS.tie_px, SIGMAS.mark_px, control_m=SIGMAS.control_m, seed=seed + 1000
    )
    noisy.sigma["gnss_m"] = np.array(SIGMAS.gnss_m)
    xyz = noisy.gnss[["x", "y", "z"]].to_numpy(copy=True)
    sigma, time = np.array(SIGMAS.gnss_m), noisy.images["time_s"].to_numpy()
    # A recursion, where the planner has a matrix: x' = r x + sqrt(1 - r^2) e, r = exp(-dt / tau).
    share = NOISE.correlated
    for flight in np.unique(noisy.image_flight):
        state = rng.standard_normal(3)
        mine = np.flatnonzero(noisy.image_flight == flight)
        mine = mine[np.argsort(time[mine])]
        for row, passed in zip(mine, np.diff(time[mine], prepend=time[mine[0]]), strict=True):
            r = np.exp(-passed / NOISE.correlation_s)
            state = r * state + np.sqrt(1 - r**2) * rng.standard_normal(3)
            white = rng.standard_normal(3)
            xyz[row] += sigma * (np.sqrt(share) * state + np.sqrt(1 - share) * white)
    noisy.gnss = noisy.gnss.assign(**dict(zip("xyz", (xyz + NOISE.bias_m).T, strict=True)))
    return noisy


def ratios(plan, control, draws):
    """Drawn over expected RMS: xy, z, focal length, lever arms' z."""
    planner = Planner(plan, noise=NOISE)
    expected = planner.expect(control)
    errors, parameters = [], []
    for seed in range(draws):
        noisy = drawn(planner.block, seed)
        adjusted = corridor.adjust(noisy, control=list(expected.control))
        table = adjusted.check_points.set_index("point")[["dx", "dy", "dz"]]
        errors.append(table.loc[expected.check_points["point"]].to_numpy())
        camera = adjusted.camera.set_index("parameter")["value"]
        arms = adjusted.lever_arm.set_index("flight")["z"]
        true = {f.name: f.lever_arm_m[2] for f in plan.flights}
        parameters.append(
            [camera["f"] - planner.block.cameras["camlight"]["f"]]
            + [arms[name] - z for name, z in true.items()]
        )
    mean = np.mean(np.square(errors), axis=(0, 1))
    rms = expected.parameters.set_index("parameter")["rms"]
    wanted = rms[["camera.camlight.f", *(f"lever_arm.{f.name}.z" for f in plan.flights)]]
    found = np.sqrt(np.mean(np.square(parameters), axis=0)) / wanted.to_numpy()
    return pd.Series(
        [np.sqrt(mean[0] + mean[1]) / expected.xy, np.sqrt(mean[2]) / expected.z, *found],
        ["xy", "z", "f", *(f"arm {f.name}" for f in plan.flights)],
    )


@pytest.mark.slow
def test_a_few_small_draws_are_as_wrong_as_expected():
    """Sixty draws; what is common to all points of a draw is known to 9 %."""
    found = ratios(plan_of(NADIR, OBLIQUE, tie_points=TiePoints(30)), 1, 60)
    assert found.between(0.8, 1.25).all(), found


@pytest.mark.slow
@pytest.mark.parametrize("control", [0, 3])
def test_draws_are_as_wrong_as_expected(control):
    """150 draws of a larger plan; what is common to all points of a draw is known to 6 %."""
    plan = plan_of(NADIR, OBLIQUE, tie_points=TiePoints(150))
    found = ratios(plan, control, 150)
    assert found.between(0.85, 1.2).all(), found
