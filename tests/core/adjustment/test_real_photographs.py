"""An ordinary survey by a rolling-shutter drone: what its adjustment says, and how soon."""

import numpy as np
import pandas as pd
import pytest

import corridor

pytestmark = pytest.mark.slow
# Leaving out one strip in turn: the formal sigma is 2.4 times too small.
JACKKNIFE_S = 1.6e-3


@pytest.fixture(scope="module")
def special(real_data):
    return corridor.read(real_data / "special_plot" / "block")


@pytest.fixture(scope="module")
def as_written(special, real_data):
    """With the velocities that the camera wrote into XMP."""
    said = pd.read_csv(real_data / "special_plot" / "metadata.csv").set_index("image")
    said = said.loc[special.images["image"]]
    block = special.copy()
    block.images = block.images.assign(
        vx=said["speed_east"].to_numpy(float),
        vy=said["speed_north"].to_numpy(float),
        vz=-said["speed_down"].to_numpy(float),
    )
    return block


@pytest.fixture(scope="module")
def adjusted(as_written):
    # The first adjustment alone takes 25 iterations; 83 by damping alone.
    return corridor.adjust(as_written, effects=["rolling_shutter"], max_iterations=40)


def readout(adjusted):
    return adjusted.parameters["rolling_shutter.readout"].value


def test_the_published_readout_is_found_and_set_beside(adjusted):
    assert adjusted.converged
    assert readout(adjusted) == pytest.approx(0.033, abs=2 * JACKKNIFE_S)
    assert "readout: stated 33.0 ms, estimated 3" in str(adjusted)


def test_positions_of_three_metres_are_decimetres_and_late(adjusted):
    """0.3 m across; 1.3 m and more along, because they are 317 +- 51 ms late."""
    assert any(s.startswith("GNSS: 3 m horizontally and 6 m in height") for s in adjusted.warnings)
    (late,) = (s for s in adjusted.warnings if "behind the images along the flight" in s)
    assert int(late.split("positions are ")[1].split()[0]) == pytest.approx(317, abs=2 * 51)
    assert not adjusted.problem.arms_free and not adjusted.block.lever_arm


def test_whole_second_stamps_alone_tell_the_readout(special):
    """One quadratic a strip gives 3.5 +- 2.2 ms, because it does not know that drones stop.

    28.4 +- 2.0 ms beside positions whose errors last; 30.5 where they count as independent.
    """
    found = corridor.adjust(special, effects=["rolling_shutter"])
    assert any("Velocities of 76 of 76 images are derived from gnss.csv" in s
               for s in found.warnings)  # fmt: skip
    assert readout(found) == pytest.approx(0.033, abs=3 * JACKKNIFE_S)
    stated = corridor.adjust(special, effects=["rolling_shutter"], weights="stated")
    assert readout(stated) == pytest.approx(0.033, abs=2 * JACKKNIFE_S)


def test_velocities_know_where_the_drone_stood(special, as_written):
    true = as_written.images[["vx", "vy", "vz"]].to_numpy()
    found = corridor.preparation.velocities(special, "gnss")
    slow = np.linalg.norm(true, axis=1) < 2.0
    ratio = np.linalg.norm(found.velocity - true, axis=1)[slow] / found.sigma[slow]
    assert slow.sum() == 9
    # Three axes each: 95 % of their lengths are below 2.8 sigmas, all nine below 4.
    assert ratio.max() < 4.0 and np.median(ratio) < 2.0
    assert np.median(found.speed[slow]) < 2.5
