"""What a survey's time stamps and geometry can carry, and what the program says of it."""

from dataclasses import replace

import numpy as np
import pytest
from kit.identifiability import readout_with_errors, supported

import corridor
from corridor.core.simulation import read_plan, simulate

READOUT = 0.0564


def adjusted(name, ties):
    """A survey as the drone's files tell of it: times in whole seconds, no velocities."""
    plan = read_plan(name)
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=ties))
    block = simulate(plan, seed=0).copy()
    block.images = block.images.drop(columns=["vx", "vy", "vz", "wx", "wy", "wz"])
    block.images["time_s"] = np.floor(block.images["time_s"])
    return corridor.adjust(block, camera="fraser8").block


@pytest.fixture(scope="module")
def line():
    return adjusted("thesis_viabon_n40", 80)


@pytest.fixture(scope="module")
def area():
    return adjusted("thesis_viabon_n90", 80)


@pytest.mark.parametrize("name", ["line", "area"])
def test_rounded_velocities_attenuate_the_readout_and_the_program_says_so(name, request):
    """Issue 10: 0 to 22 ms of 56."""
    found = readout_with_errors(request.getfixturevalue(name), "rolling_shutter", draws=2)
    assert -0.1 * READOUT < found.plain < 0.5 * READOUT
    assert found.plain_sigma < 0.003
    assert found.share < 0.5 and np.isnan(found.readout)
    assert "no measurement of the readout" in str(found)


@pytest.mark.parametrize("name", ["line", "area"])
def test_velocities_of_a_smooth_strip_do_not(name, request):
    block = request.getfixturevalue(name)
    found = readout_with_errors(block, "rolling_shutter", "strip")
    assert found.readout == pytest.approx(READOUT, abs=max(4 * found.sigma, 0.003))
    assert found.sigma < 0.1 * READOUT


def test_attenuation_by_a_known_share_is_mended(area):
    """Stamps in half seconds: the plain readout is many sigmas off, the mended one is not."""
    block = area.copy()
    exact = simulate(read_plan("thesis_viabon_n90"), seed=0).images.set_index("image")["time_s"]
    time = exact.loc[block.images["image"]].to_numpy()
    block.images["time_s"] = np.floor(time * 2) / 2
    found = readout_with_errors(block, "rolling_shutter")
    assert found.velocities.stamp_s == 0.5
    assert 0.5 < found.share < 0.9
    assert abs(found.plain - READOUT) > 5 * found.plain_sigma
    assert abs(found.readout - READOUT) < 2 * found.sigma
    assert abs(found.readout - READOUT) < 0.5 * abs(found.plain - READOUT)


@pytest.mark.slow
def test_a_corridor_does_not_support_six_motions_an_image_and_a_block_does(line, area):
    """As published for two programs: corridor much worse, blocks better (tables 7.8 to 7.15)."""
    told = {t.effect: t for t in supported(line, "rolling_shutter", ["motion_per_image"])}
    assert told["rolling_shutter"].supported
    assert not told["motion_per_image"].supported
    assert "does not support motion_per_image" in told["motion_per_image"].sentence
    (_, block) = supported(area, "rolling_shutter", ["motion_per_image"])
    assert block.supported
