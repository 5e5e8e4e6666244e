"""A gyroscope whose clock is late: a delay does nothing without a readout, and needs a start."""

import numpy as np
import pytest
import scipy.stats

import corridor
from benchmarks.readout_flight import survey

LATE_S = 0.015  # the record reaches so far beyond the longest readout


def late(seed):
    """A survey by a camera that rocks, its rates written late; its readout, s."""
    block, readout, _ = survey(seed, images=(24, 30), observations=60, rocking=True)
    block = block.copy()
    block.rates = block.rates.assign(time_s=block.rates["time_s"] + LATE_S)
    return block, readout


@pytest.mark.slow
def test_the_shutter_is_named_with_its_readout_and_the_delay():
    """At nothing the equations cannot tell it from a shutter that velocities move.

    In the first survey two images are taken 8 cm apart: no depth, and a robust loss has valleys.
    """
    errors = []
    for seed in (1, 4):
        block, readout = late(seed)
        (effect,) = corridor.diagnose(block).findings.effects
        assert (effect.slug, effect.kind) == ("rolling_shutter_rotation", "named")
        told = {row["name"]: row for row in effect.parameters}
        for name, true in (("readout", readout), ("delay", LATE_S)):
            assert told[name]["sigma"] < 0.003
            errors.append((told[name]["value"] - true) / told[name]["sigma"])
    # Sum of squares of four normal errors that chance passes once in a thousand.
    assert np.sum(np.square(errors)) < scipy.stats.chi2.ppf(0.999, len(errors))
