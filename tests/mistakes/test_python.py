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
    "a noise that is none": (
        lambda block: corridor.simulate("thesis_50vt", noise="loud"), "ordinary, none"
    ),
    "effects that are a name": (
        lambda block: corridor.simulate("thesis_50vt", "rolling_shutter"), "by slug and parameter"
    ),
    "a preparation of no folder": (lambda block: corridor.prepare("nowhere"), "no such folder"),
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


def test_a_preparation_takes_a_folder(sound):
    assert corridor.prepare(sound).derived == corridor.prepare(corridor.read(sound)).derived


@pytest.mark.parametrize(
    "room", ["change", "data", "effects", "figures", "gnss", "readout", "thermal"]
)
def test_a_room_shows_what_it_offers(room):
    room = getattr(corridor, room)
    assert dir(room) == sorted(room.__all__)
    assert all(hasattr(room, name) for name in room.__all__)


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

    @pytest.mark.parametrize(
        ("name", "units"),
        [
            ("check_points", {"m": "dx dy dz sx sy sz s_dx s_dy s_dz"}),
            ("points", {"m": "x y z"}),
            ("poses", {"m": "x y z sx sy sz", "rad": "s_rx s_ry s_rz"}),
            ("lever_arm", {"m": "x y z sx sy sz"}),
        ],
    )
    def test_every_number_has_its_unit_in_the_head(self, adjusted, name, units):
        table = getattr(adjusted, name)
        of = {column: unit for unit, columns in units.items() for column in columns.split()}
        assert table.units == of
        lengths = table.select_dtypes("float").columns
        assert set(lengths) == set(of)
        for column, unit in of.items():
            assert f"{column} ({unit})" in table.sort_values(column)._repr_html_()

    def test_no_unit_is_claimed_of_what_was_computed(self, adjusted):
        table = adjusted.check_points.set_index("point")
        assert "dx (m)" in repr(table[["dx", "dy"]])
        assert "(m)" not in repr(1000.0 * table[["dx", "dy"]])

    def test_a_file_bears_units_in_its_names(self, adjusted, tmp_path):
        adjusted.save(tmp_path / "out")
        head = (tmp_path / "out" / "check_points.csv").read_text().splitlines()[0]
        assert head == "point,dx_m,dy_m,dz_m,sx_m,sy_m,sz_m,s_dx_m,s_dy_m,s_dz_m,rays"
        head = (tmp_path / "out" / "poses.csv").read_text().splitlines()[0]
        assert head == "image,x_m,y_m,z_m,sx_m,sy_m,sz_m,s_rx_rad,s_ry_rad,s_rz_rad"

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
