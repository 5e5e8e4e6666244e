"""What is called by mistake in Python: taken as it is meant, or refused in one sentence."""

import numpy as np
import pytest

import corridor
from corridor import AdjustmentFailed, InputError

# What is called -> words of the refusal.
CALLS = {
    "read(None)": (lambda block: corridor.read(None), "folder"),
    "read of a dictionary": (lambda block: corridor.read({"images": 1}), "folder"),
    "read of a table": (lambda block: corridor.read(corridor.read(block).images), "folder"),
    "read of no folder": (lambda block: corridor.read("nowhere"), "there is no such folder"),
    "adjust of a file": (lambda block: corridor.adjust(block / "images.csv"), "is a file"),
    "adjust of nothing": (lambda block: corridor.adjust(""), "folder|block.toml"),
    "an effect that is none": (
        lambda block: corridor.adjust(block, effects="gnss_bia"), "did you mean gnss_bias"
    ),
    "an effect that is a number": (lambda block: corridor.adjust(block, effects=[3]), "3"),
    "a control point that is none": (
        lambda block: corridor.adjust(block, control="G99"), "no point G99"
    ),
    "a camera parameter that is none": (
        lambda block: corridor.adjust(block, camera=["f", "cz"]), "cz"
    ),
    "a camera that is none": (
        lambda block: corridor.adjust(block, camera={"other": "f"}), "other"
    ),
    "a prior that is a number": (
        lambda block: corridor.adjust(block, priors={"camera.camlight.f": 5490}),
        "standard deviation",
    ),
    "a prior of no parameter": (
        lambda block: corridor.adjust(block, priors={"focal": (5490, 1)}), "focal"
    ),
    "no thread": (lambda block: corridor.adjust(block, threads=0), "0 threads"),
    "a loss that is none": (lambda block: corridor.adjust(block, loss="l1"), "l1"),
    "a level that is none": (lambda block: corridor.diagnose(block, level=5), "between 0 and 1"),
    "a candidate that is none": (
        lambda block: corridor.diagnose(block, only="gnss_bia"), "did you mean gnss_bias"
    ),
    "a plan that is none": (lambda block: corridor.simulate("thesis_50vz"), "did you mean"),
    "a plan that is a dictionary": (lambda block: corridor.simulate({}), "plan"),
    "a plan that is a block": (lambda block: corridor.plan(block), "block|plan"),
    "a camera of numbers": (
        lambda block: corridor.Camera("phone", 1600, 1200, 1500.0), "Camera.from_table"
    ),
    "correct without a value": (
        lambda block: corridor.correct(block, "rolling_shutter"), "needs values|states none"
    ),
    "correct with a wrong name": (
        lambda block: corridor.correct(block, {"rolling_shutter": {"speed": 1}}), "'speed'"
    ),
    "export to no format": (
        lambda block: corridor.export(block, "project", "colmop"), "colmop|colmap"
    ),
    "a change of one block and none": (lambda block: corridor.change(block, "nowhere"), "nowhere"),
    "batch of no verb": (lambda block: corridor.batch("ajust", [block], "out"), "ajust"),
    "data of no name": (lambda block: corridor.data.fetch("dyke", "out"), "did you mean dike"),
}  # fmt: skip


@pytest.mark.parametrize("call", CALLS)
def test_is_refused_in_a_sentence(sound, tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    made, words = CALLS[call]
    with pytest.raises((InputError, AdjustmentFailed), match=words) as refused:
        made(sound)
    assert len(str(refused.value)) < 500 and "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_block_is_as_good_as_its_folder(sound):
    block = corridor.read(sound)
    assert corridor.read(block) is block
    assert repr(corridor.summary(block)) == repr(corridor.summary(sound))


@pytest.fixture(scope="module")
def adjusted(sound):
    return corridor.adjust(sound, camera=["f", "cx", "cy"], effects="gnss_bias", control="G01,G02")


class TestWhatOneHoldsInHand:
    """Tables have their units in their columns, and everything shows itself in a line or two."""

    def test_observations_are_a_table_with_units(self, adjusted):
        table = adjusted.observations
        assert list(table.index) == ["tie", "mark", "gnss", "control"]
        assert {"count", "rms_px", "rms_x_m", "rms_z_m", "sigma0"} <= set(table.columns)
        assert table.loc["tie", "rms_px"] == adjusted.statistics["tie"]["rms"]
        assert table.loc["gnss", "rms_z_m"] == adjusted.statistics["gnss"]["rms"][2]
        assert np.isnan(table.loc["gnss", "rms_px"])

    def test_the_dictionary_it_was_answers_for_a_release(self, adjusted):
        with pytest.warns(DeprecationWarning, match=r'observations.loc\["tie"\]'):
            assert adjusted.observations["tie"] == adjusted.statistics["tie"]

    def test_the_correlation_matrix_is_a_table(self, adjusted):
        table = adjusted.correlation_matrix
        assert list(table.index) == list(table.columns)
        assert table.loc["camera.camlight.f", "camera.camlight.f"] == pytest.approx(1.0)

    def test_nothing_shows_arrays(self, adjusted):
        held = [getattr(adjusted, name) for name in ("block", "system", "problem", "state",
                "covariance", "values")]  # fmt: skip
        held += [adjusted, *adjusted.block.cameras.values(), *corridor.catalogue()]
        for one in held:
            shown = repr(one)
            assert len(shown) < 700 and "array(" not in shown and " at 0x" not in shown, shown
