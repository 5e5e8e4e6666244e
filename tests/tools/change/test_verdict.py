"""The verdict: ground, camera, or cannot be told."""

import numpy as np
import pytest
from made import adjusted, flown, joint, middle
from scipy.stats import binom

import corridor
from corridor.core import effects
from corridor.core.effects import find
from corridor.tools.change import Settlement, Signatures, change, surface_change

SAME = {"same_ties": True, "spacing": 10.0}
SHUTTER = {"rolling_shutter": {"readout": 0.02}}


def with_effect(slug, value):
    """The flight of draw 11, with one parameter of an effect on top of the same noise."""
    block = flown(11)
    parameter = find(slug).form(block).parameters(block)[0]
    truth = adjusted(11).block
    moved = effects.add(truth, {slug: {parameter.name: value * parameter.scale}})
    for table, columns in (("tie_points", ["x", "y"]), ("marks", ["x", "y"]),
                           ("gnss", ["x", "y", "z"])):  # fmt: skip
        step = getattr(moved, table)[columns] - getattr(truth, table)[columns]
        getattr(block, table)[columns] += step
    return corridor.adjust(block)


@pytest.mark.parametrize(
    "slug",
    [
        "rolling_shutter",
        pytest.param("gnss_drift", marks=pytest.mark.slow),
        pytest.param("affine_distortion", marks=pytest.mark.slow),
    ],
)
def test_what_an_effect_does_to_the_ground_is_what_adjusting_again_shows(slug, pair, cores):
    """A tenth of the expected size, in the same noise: the signature says where the ground goes."""
    there = joint(adjusted(10), with_effect(slug, 0.1))
    here = surface_change(pair, cores, sampled=False)
    moved = surface_change(there, here.cores, sampled=False)
    signature = Signatures(pair.after.epoch)
    shape = signature.on(pair.parts(here.functions)[1])[:, signature.of([slug])[0]]
    step = moved.distance - here.distance
    np.testing.assert_allclose(step, 0.1 * shape, atol=0.02 * np.abs(step).max() + 1e-6)


def test_an_effect_in_the_images_is_estimated_as_large_as_it_is():
    signature = Signatures(joint(adjusted(10), with_effect("rolling_shutter", 0.5)).after.epoch)
    found = signature.estimate(signature.of(["rolling_shutter"]), free=True)
    assert found.value[0] == pytest.approx(0.5, abs=4 * found.covariance[0, 0] ** 0.5 + 0.02)


@pytest.fixture(scope="module")
def bowl():
    return Settlement(middle(), 15.0, 0.03, 0.5)


def test_a_shutter_is_no_settlement():
    found = change(flown(20), flown(21, added=SHUTTER), **SAME)
    assert found.verdict == "camera"
    assert found.explanation.shown == (set(), {"rolling_shutter"})
    assert "The camera explains it" in str(found)


@pytest.mark.slow
def test_a_settlement_and_a_shutter_are_both_said(bowl):
    found = change(flown(20), flown(21, bowl, SHUTTER), **SAME)
    # Beside all effects of the catalogue 30 mm may stay undecided; never nothing, nor the camera.
    assert found.verdict in {"moved", "undecided"}
    assert "rolling shutter" in str(found)


@pytest.mark.slow
def test_the_ground_moves_no_more_often_than_asked():
    """Twenty nulls and twenty shutters at 1 %: more than two movers has a probability of 1e-5.

    A shutter of 20 ms alone is said to have moved the ground in none of a hundred.
    """
    verdicts = [
        change(flown(2 * k), flown(2 * k + 1, added=added), **SAME).verdict
        for k in range(200, 210)
        for added in (None, SHUTTER)
    ]
    assert verdicts.count("moved") <= binom.ppf(0.9999, len(verdicts), 0.01)
    assert verdicts[1::2].count("camera") >= 8


def test_one_adjustment_of_both_dates_models_what_it_shows():
    """A shutter at both dates, at rest: said, modelled, and no motion; the sigma falls."""
    found = change(
        flown(20, added=SHUTTER), flown(21, added=SHUTTER), together=True, same_camera=True, **SAME
    )
    assert found.explanation.shown == ({"rolling_shutter"},)
    effects = found.remaining.adjustments[0].system.effects
    assert "rolling_shutter" in effects and found.verdict != "moved"
    assert found.gained[1] < found.gained[0]
