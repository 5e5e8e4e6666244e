"""A block corrected with a model: there and back, what is refused, and the laboratory's prior."""

import numpy as np
import pytest
from strips import corridor_block
from walls import camlight

import corridor
from corridor.core.effects import Parameter, find
from corridor.core.errors import InputError
from corridor.interface.cli import main
from corridor.tools.thermal import correct, laboratory_prior, uncorrect


@pytest.fixture(scope="module")
def flown():
    return corridor_block(images=12, strips=2, observations_per_image=60, seed=1)


@pytest.fixture(scope="module")
def model():
    return camlight()


def points(block):
    return np.vstack([t[["x", "y"]].to_numpy(float) for t in (block.tie_points, block.marks)])


class TestThereAndBack:
    def test_it_returns_the_observations(self, flown, model):
        """Issue 9, must show 9: within 1e-6 px."""
        cold, _ = correct(flown, model)
        again, _ = uncorrect(cold, model)
        assert np.abs(points(cold) - points(flown)).max() > 0.01
        assert np.abs(points(again) - points(flown)).max() < 1e-6

    def test_what_was_done_is_written_down_and_not_done_twice(self, flown, model, tmp_path):
        cold, _ = correct(flown, model)
        cold.write(tmp_path / "cold")
        read = corridor.read(tmp_path / "cold")
        assert read.extra["corrected"]["thermal"] == {"t0_c": 24.0, "kind": "decentring"}
        with pytest.raises(InputError, match="taken out of this block already"):
            correct(read, model)
        again, _ = uncorrect(read, model)
        assert "corrected" not in again.extra
        assert np.abs(points(again) - points(flown)).max() < 1e-6

    def test_the_block_handed_in_stays(self, flown, model):
        before = points(flown).copy()
        correct(flown, model)
        np.testing.assert_array_equal(points(flown), before)

    def test_each_image_is_moved_by_its_own_temperature(self, flown, model):
        warm, _ = uncorrect(flown, model)
        rows = flown.image_rows("tie_points")
        temperature = flown.column("images", "temperature_c")[rows]
        x, y = flown.tie_points["x"].to_numpy(), flown.tie_points["y"].to_numpy()
        dx, dy = model.displacement(x, y, temperature)
        np.testing.assert_allclose(warm.tie_points["x"] - x, dx, atol=1e-9)
        np.testing.assert_allclose(warm.tie_points["y"] - y, dy, atol=1e-9)

    def test_a_lag_makes_a_warming_camera_colder_than_its_thermometer(self, flown, model):
        from dataclasses import replace

        from corridor.tools.thermal.correction import optics_of

        felt = optics_of(flown, replace(model, lag_s=60.0))
        read = flown.column("images", "temperature_c")
        assert felt[0] == read[0] and (felt[1:] < read[1:]).all()


class TestRefusals:
    def test_a_model_of_another_camera(self, flown):
        with pytest.raises(InputError, match=r"1280 x 960.*this camera"):
            correct(flown, camlight(1280, 960))

    def test_no_temperatures_at_all(self, flown, model):
        block = flown.copy()
        block.images = block.images.drop(columns="temperature_c")
        with pytest.raises(InputError, match="has no temperature_c"):
            correct(block, model)

    def test_one_temperature_missing(self, flown, model):
        block = flown.copy()
        block.images.loc[3, "temperature_c"] = np.nan
        name = block.images["image"][3]
        with pytest.raises(InputError, match=f"image {name} has no temperature_c"):
            correct(block, model)

    def test_temperatures_outside_the_range_are_said(self, flown, model):
        block = flown.copy()
        block.images["temperature_c"] += 40
        _, (said,) = correct(block, model)
        assert "outside" in said and "20.0 to 55.0 C" in said
        assert correct(flown, model)[1] == []


class TestLaboratoryPrior:
    def test_it_is_the_slope_that_the_model_has(self, flown):
        """f = 5489 px and 13.7 ppm/C: 2559.5 px from the middle that is 0.0351 px/C."""
        prior = laboratory_prior(camlight(radial=0.0, shift=(0.02, -0.03)), flown)
        assert set(prior) == {f"thermal.{name}" for name in ("scale", "cubic", "x", "y")}
        assert prior["thermal.scale"][0] == pytest.approx(2559.5 * 13.7e-6, rel=0.02)
        assert prior["thermal.x"][0] == pytest.approx(0.02, abs=0.001)
        assert all(sigma > 0 for _, sigma in prior.values())

    def test_it_is_one_of_the_effect_whatever_that_estimates(self, flown, monkeypatch):
        """Shapes and names were typed a second time: a change of the effect was not seen."""
        thermal = type(find("thermal"))
        growth = [Parameter("growth", "px/C", scale=0.1)]
        whole = thermal.derivative
        monkeypatch.setattr(thermal, "parameters", lambda self, block: growth)
        monkeypatch.setattr(thermal, "derivative", lambda *given: 2.0 * whole(*given)[:, :, :1])
        (name, (value, _)) = laboratory_prior(camlight(radial=0.0), flown).popitem()
        assert name == "thermal.growth"
        assert value == pytest.approx(2559.5 * 13.7e-6 / 2.0, rel=0.02)

    def test_an_adjustment_takes_it(self, flown, model):
        prior = laboratory_prior(model, flown)
        adjusted = corridor.adjust(flown, camera="fixed", effects=["thermal"], priors=prior)
        scale = adjusted.effects.set_index("parameter").loc["scale"]
        assert scale["sigma"] <= prior["thermal.scale"][1]

    def test_the_command_prints_it_as_options_of_adjust(self, flown, model, tmp_path, capsys):
        flown.write(tmp_path / "block")
        model.write(tmp_path / "heat.json")
        assert main(["thermal", "prior", str(tmp_path / "heat.json"), str(tmp_path / "block")]) == 0
        options = capsys.readouterr().out.split()
        known = laboratory_prior(model, flown)
        assert options.count("--prior") == len(known) == 4
        for name, (value, _) in known.items():
            said = next(word for word in options if word.startswith(f"{name}="))
            assert float(said.partition("=")[2].partition("+-")[0]) == pytest.approx(value, 1e-5)
        assert main(["adjust", str(tmp_path / "block"), "--camera", "fixed", *options]) == 0
        assert "thermal" in capsys.readouterr().out
