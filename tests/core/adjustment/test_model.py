"""What is estimated is said once, and every parameter has a name, a value and a prior."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor import Model
from corridor.core.adjustment import ParameterId, make_problem
from corridor.core.effects import add


@pytest.fixture(scope="module")
def block():
    """Two strips with GNSS and control, with a readout of 30 ms."""
    block = corridor_block(images=12, strips=2, observations_per_image=80, seed=3)
    return add(block, {"rolling_shutter": {"readout": 0.03}})


def name_of(block):
    return next(iter(block.cameras))


@pytest.mark.parametrize(
    "text",
    ["camera.P1.f", "camera.DJI.P1.k1", "lever_arm.F1.z", "lever_arm.z", "focal.F1.f", "thermal"],
)
def test_a_name_is_read_and_written(text):
    assert str(ParameterId.parse(text)) == text


def test_lever_arm_is_a_kind_and_an_effect():
    assert ParameterId.parse("lever_arm.F1.z").kind == "lever_arm"
    assert ParameterId.parse("lever_arm.z") == ParameterId("effect", "lever_arm", "z")


class TestWhatOneTypesFirst:
    def test_a_folder_in_place_of_a_block(self, block, tmp_path):
        block.write(tmp_path / "flown")
        of_folder = corridor.adjust(str(tmp_path / "flown"), camera="fixed")
        assert of_folder.sigma0 == pytest.approx(corridor.adjust(block, camera="fixed").sigma0)

    def test_a_folder_is_diagnosed(self, tmp_path):
        with pytest.raises(corridor.InputError, match="no such folder"):
            corridor.diagnose(tmp_path / "nowhere")

    def test_a_block_that_was_read_is_itself(self, block):
        assert corridor.read(block) is block

    def test_a_file_is_no_folder(self, tmp_path):
        (tmp_path / "tie_points.csv").touch()
        with pytest.raises(corridor.InputError, match="is a file; give the folder"):
            corridor.read(tmp_path / "tie_points.csv")

    def test_one_name_needs_no_list(self):
        model = Model(effects="gnss_bias", control="G01", check="G02, G03", camera=["f", "cx"])
        assert [effect.slug for effect in model.effects] == ["gnss_bias"]
        assert (model.control, model.check) == (["G01"], ["G02", "G03"])
        assert model.camera == "f,cx"
        assert Model(camera={"P1": ["f", "k1"], "P2": []}).camera == {"P1": "f,k1", "P2": "fixed"}

    def test_an_effect_needs_no_list(self):
        effect = corridor.effects.find("gnss_bias")
        assert Model(effects=effect).effects == [effect]

    def test_a_prior_needs_its_standard_deviation(self):
        with pytest.raises(corridor.InputError, match=r"camera.P1.f is 5490: .* standard dev"):
            Model(priors={"camera.P1.f": 5490})

    @pytest.mark.parametrize("typed", ["roling_shutter", "rolling-shutter", "Rolling Shutter"])
    def test_the_nearest_effect_is_named(self, typed):
        with pytest.raises(corridor.InputError, match=r"did you mean rolling_shutter\?"):
            Model(effects=typed)


class TestOneModelForEveryEntrance:
    def test_a_model_is_what_its_options_are(self, block):
        options = {"camera": "fixed", "effects": ["rolling_shutter"], "lever_arm": "fixed"}
        told = corridor.adjust(block, **options)
        model = corridor.adjust(block, model=Model(**options))
        assert model.to_dict()["effects"] == told.to_dict()["effects"]

    def test_a_model_and_options_contradict_each_other(self, block):
        with pytest.raises(corridor.InputError, match="camera"):
            corridor.adjust(block, camera="fixed", model=Model())

    def test_a_diagnosis_takes_it_too(self, block):
        model = Model(camera="fixed", effects=["rolling_shutter"])
        found = corridor.diagnose(block, model=model, only=["clock_offset"])
        assert set(found.before.values) == {"rolling_shutter"}
        assert not any(u.kind == "camera" for u in found.before.problem.unknowns)

    @pytest.mark.parametrize("options", [{"lever_arm": "loose"}, {"loss": "l1"}])
    def test_what_nobody_knows_is_refused_at_once(self, options):
        with pytest.raises(corridor.InputError, match="is unknown"):
            Model(**options)


class TestSettings:
    def test_a_camera_parameter_that_is_not_to_vary(self, block):
        camera = name_of(block)
        model = Model(camera="f,k1")
        model.parameters[f"camera.{camera}.k1"].vary = False
        model.parameters[f"camera.{camera}.cx"].vary = True
        free = [u.name for u in make_problem(block, model).unknowns if u.kind == "camera"]
        assert free == ["f", "cx"]

    def test_an_effect_of_a_known_value_is_held_at_it(self, block):
        """The readout is given and held: residuals are those of the true model."""
        model = Model(camera="fixed", effects=["rolling_shutter"])
        model.parameters["rolling_shutter.readout"].value = 0.03
        model.parameters["rolling_shutter.readout"].vary = False
        held = corridor.adjust(block, model=model)
        readout = held.parameters["rolling_shutter.readout"]
        assert (readout.value, readout.sigma, readout.vary) == (0.03, 0.0, False)
        free = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"])
        assert held.redundancy == free.redundancy + 1
        assert held.statistics["tie"]["rms"] == pytest.approx(
            free.statistics["tie"]["rms"], rel=0.01, abs=1e-4
        )

    def test_a_prior_is_one_wherever_it_is_given(self, block):
        camera = name_of(block)
        one = Model(priors={f"camera.{camera}.f": (8190.0, 5.0)})
        other = Model()
        other.parameters[f"camera.{camera}.f"].prior = (8190.0, 5.0)
        weights = [make_problem(block, model).prior_weight for model in (one, other)]
        assert np.array_equal(*weights) and weights[0].max() == pytest.approx(1 / 25)

    @pytest.mark.parametrize("name", ["camera.nobody.f", "rolling_shutter.speed", "focal.f"])
    def test_a_name_that_the_model_does_not_have_is_refused(self, block, name):
        model = Model(effects=["rolling_shutter"])
        model.parameters[name].vary = False
        with pytest.raises(corridor.InputError, match=name):
            make_problem(block, model)


@pytest.fixture(scope="module")
def found(block):
    arm = f"lever_arm.{block.flight_names[0]}.z"
    return corridor.adjust(
        block, camera="f,cx,cy", effects=["rolling_shutter"], priors={arm: (0.0, 0.02)}
    )


class TestParametersOfAResult:
    def test_they_are_those_of_the_tables(self, block, found):
        camera = name_of(block)
        f = found.parameters[f"camera.{camera}.f"]
        row = found.camera.set_index("parameter").loc["f"]
        assert (f.value, f.sigma, f.unit, f.vary) == (row["value"], row["sigma"], "px", True)
        assert found.parameters["rolling_shutter.readout"].unit == "s"
        assert not found.parameters[f"camera.{camera}.k1"].vary

    def test_a_prior_is_told(self, block, found):
        arm = found.parameters[f"lever_arm.{block.flight_names[0]}.z"]
        assert arm.prior == (0.0, 0.02) and arm.vary

    def test_all_of_them_make_a_table(self, found):
        frame = found.parameters.to_frame()
        assert list(frame.index) == list(found.parameters)
        assert {"value", "sigma", "unit", "vary", "prior", "prior_sigma", "start"} == set(frame)
        varied = frame[frame["vary"]]
        assert (varied["sigma"] > 0).all() and len(varied) == len(found.problem.unknowns)
