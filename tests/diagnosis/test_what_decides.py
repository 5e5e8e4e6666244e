"""What a diagnosis decides by: the contract of effects and what was asked, not names or order."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from strips import corridor_block
from test_evidence import biased

import corridor
from corridor.core.adjustment import Model
from corridor.core.effects import Effect, add, find, take_out
from corridor.core.effects.splines import surface
from corridor.diagnosis import diagnose, reference
from corridor.diagnosis.anomalies import wrong_matches as discontinuity
from corridor.diagnosis.findings.location import _images
from corridor.diagnosis.findings.verdict import refines
from corridor.diagnosis.settings import SETTINGS, changed
from corridor.diagnosis.system.groups import Group, of_some


def test_the_noise_of_a_model_is_the_same_whatever_was_asked_before():
    """It begins where a part of the model ended, and ends within what a step has to promise."""
    models = [{}, {0: 1.0}, {0: 1000.0}]
    found = []
    for order in (models, models[::-1]):
        noises = biased(np.random.default_rng(4))
        answers = {tuple(model.items()): noises.given(model) for model in order}
        found.append([answers[tuple(model.items())] for model in models])
    for (one, value), (other, again) in zip(*found, strict=True):
        assert value == pytest.approx(again, abs=0.05)
        assert one.coloured == pytest.approx(other.coloured, rel=0.1)


def test_a_prior_of_a_lever_arm_counts_where_the_candidate_of_that_name_is_tested():
    """Seen from above a free arm hides a bias in z; an arm known to 2 mm does not."""
    block = corridor_block(
        images=24, strips=2, observations_per_image=150, control=6, check=0, relief=6.0
    )  # fmt: skip
    block = corridor.simulation.add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.01, seed=1)
    arms = corridor.adjust(block, camera="fixed").lever_arm
    priors = {f"lever_arm.{row.flight}.z": (row.z, 0.002) for row in arms.itertuples()}
    asked = {"only": ["lever_arm", "gnss_bias"], "camera": "fixed"}
    free, known = (diagnose(block, priors=p, **asked).detection_limits for p in (None, priors))
    assert (free["gnss_bias"]["z"] or np.inf) > 2 * known["gnss_bias"]["z"]


def test_a_catalogue_without_a_sudden_effect_breaks_no_picture(monkeypatch):
    monkeypatch.setattr(sys.modules[discontinuity.__name__], "every_effect", lambda: [])
    assert discontinuity.broken_picture(None) is None


class Narrow(find("focal_per_image").__class__):
    slug = "narrow_field"


@pytest.mark.parametrize(("effect", "told"), [(Narrow(), False), (find("row_polynomial"), True)])
def test_rows_are_told_of_effects_that_differ_by_row_whatever_their_name(effect, told):
    images = SimpleNamespace(
        names=["a", "b"], flight=np.zeros(2, int), flight_names=["F1"], time=np.full(2, np.nan),
        centre=np.zeros((2, 3)),
    )  # fmt: skip
    _, where = _images(images, np.array([1.0, 2.0]), effect)
    assert ("row" in where) == told


def test_finer_is_what_an_effect_says_and_not_what_it_inherits():
    class Mine(Effect):
        slug, place, group, refines = "my_focal", "camera", "flight", "focal"

        def parameters(self, block):
            return []

        def shift(self, context, values):
            return values, values

    def group(effect, size):
        return Group(effect.slug, effect, None, np.arange(size), np.ones(size), [])

    focal = group(find("focal"), 1)
    assert refines(group(Mine(), 2), focal) and refines(group(find("focal_per_flight"), 2), focal)
    assert not refines(focal, focal) and not refines(focal, group(Mine(), 2))


def test_an_effect_of_some_points_keeps_all_that_the_contract_says():
    whole, part = find("control_blunder"), of_some(find("control_blunder"), ["P1"])
    for name in Effect.__annotations__:
        assert getattr(part, name) == getattr(whole, name)


def test_a_deformation_is_taken_out_of_a_block_without_marks():
    """All three blocks made of photographs alone once ended here."""
    assert surface(np.zeros((0, 2)), 8, 6).shape == (0, 45)
    block = corridor_block(images=6, observations_per_image=40, control=0, check=0)
    names = [p.name for p in find("image_deformation").parameters(block)]
    values = {"image_deformation": {names[0]: 0.5}}
    block.marks, block.ground = block.marks.iloc[:0], block.ground.iloc[:0]
    there = add(block, values)
    xy = ["x", "y"]
    assert not np.allclose(there.tie_points[xy], block.tie_points[xy], atol=1e-3)
    back = take_out(there, values).tie_points[xy].to_numpy()
    assert back == pytest.approx(block.tie_points[xy].to_numpy(), abs=1e-6)


@pytest.mark.slow
def test_a_block_without_any_noise_is_diagnosed():
    """Rounding errors are no evidence; a shutter of 30 ms is, to a hundredth."""
    block = corridor_block(
        images=24, strips=2, observations_per_image=100, control=6, check=3, relief=6.0
    )  # fmt: skip
    found = diagnose(add(block, {"rolling_shutter": {"readout": 0.030}}))
    assert [one["slug"] for one in found.effects] == ["rolling_shutter"]
    assert found.effects[0]["parameters"][0]["value"] == pytest.approx(0.030, abs=3e-4)
    assert diagnose(block).verdict == "nothing"


def test_settings_hold_for_a_while_and_no_longer():
    before = SETTINGS.clear_evidence
    with changed(clear_evidence=7.0) as settings:
        assert settings is SETTINGS and SETTINGS.clear_evidence == 7.0
    assert SETTINGS.clear_evidence == before
    with pytest.raises(AttributeError), changed(jelly=1.0):
        pass


def test_a_shape_whose_weights_creep_ends_after_a_fifth_of_the_iterations(monkeypatch):
    """The first few begin with squares, whose cost is another one: their fall says nothing. A rig
    of five cameras crept for 75 iterations to a cost that had fallen by 1e-5 in the last five."""
    given = []

    def refit(block, model, run, near, motion):
        given.append(run.max_iterations)
        cost = [100.0 if not near and k < 2 else 50.0 - 1e-4 * k for k in range(given[-1])]
        history = [{"cost": one} for one in cost]
        return SimpleNamespace(converged=False, history=history, as_left=lambda _: (block, {}))

    monkeypatch.setattr(reference.adjustment, "refit", refit)
    block = corridor_block(images=6, observations_per_image=20, control=0, check=0)
    believed = reference.ReferenceModel(block, Model())
    believed._refitted(block, Model(), brief=True, near=False, motion=False)
    assert given == [SETTINGS.iterations_of_shapes, SETTINGS.iterations // 5]
