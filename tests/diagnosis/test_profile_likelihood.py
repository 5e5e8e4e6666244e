"""What the antenna feels is held against slow noise of the GNSS that may do the same."""

import pytest

from benchmarks.diagnosis.generator import single
from benchmarks.diagnosis.generator.generate import generate
from corridor.diagnosis import diagnose
from corridor.diagnosis.settings import SETTINGS

SHORT = {"images": 40, "observations": 150, "geometry": "cross", "flights": 3}
# Arms that differ by 17 mm: 8.6 sigmas with the noise known, 6.5 with noise of any size.
FACTOR, SEED = 8 / 19, 1_101_128


@pytest.fixture(scope="module")
def hidden():
    return generate(single("lever_arm_per_flight", FACTOR, **SHORT), seed=SEED)


@pytest.fixture(scope="module")
def found(hidden):
    return diagnose(hidden.block)


@pytest.mark.slow
def test_a_camera_mounted_anew_shows_through_slow_noise(found):
    assert [one["slug"] for one in found.effects] == ["lever_arm_per_flight"] * 3
    assert found.verdict == "named"


def test_the_evidence_stated_is_that_beside_noise(found):
    """Noise that was estimated with the effect leaves all of it to the effect."""
    last = found.course.last
    n = last.evidence.number["lever_arm_per_flight"]
    assert last.noises.touches(n) > SETTINGS.gnss_share_main
    alone = last.evidence.given({})[n].evidence
    assert found.effects[0]["log_evidence"] < 0.5 * alone


def test_the_twin_with_the_same_noise_is_not_accused(hidden):
    assert diagnose(hidden.twin).verdict == "nothing"
