"""What an adjustment without an effect says of it, in the effect's own words."""

from dataclasses import replace

import pytest
from strips import CAMLIGHT, corridor_block

import corridor
from corridor.core.effects import add
from corridor.core.simulation import add_noise

READOUT = {"rolling_shutter": {"readout": 0.03}}


def flown(readout_s=0.03):
    """7 m/s at 50 m: 0.03 s are 0.2 m, some 30 px."""
    camera = replace(CAMLIGHT, calibrated=True, readout_s=readout_s)
    block = corridor_block(images=16, strips=2, observations_per_image=60, camera=camera, seed=2)
    return add_noise(add(block, READOUT), tie_px=0.3, mark_px=0.3, gnss_m=0.02, seed=2)


def told(block, camera="fixed", effects=()):
    found = corridor.adjust(block, camera=camera, effects=list(effects))
    return [sentence for sentence in found.warnings if "takes the shutter as global" in sentence]


@pytest.fixture(scope="module")
def block():
    return flown()


class TestAStatedShutterThatIsLeftOut:
    def test_is_told_once_with_the_way_to_estimate_it(self, block):
        (sentence,) = told(block)
        assert "reads a picture in 30.0 ms" in sentence
        assert "(rolling_shutter; with rates.csv one that takes them)" in sentence

    @pytest.mark.parametrize(
        "model",
        [
            {"effects": ["rolling_shutter"]},
            {"effects": ["translation_per_image"]},
            {"camera": "b1"},
        ],
        ids=["it", "another of the motion", "affinity"],
    )
    def test_is_not_where_the_model_has_what_takes_it_up(self, block, model):
        assert not told(block, **model)

    def test_is_not_where_nobody_states_it(self):
        assert not told(flown(readout_s=None))
