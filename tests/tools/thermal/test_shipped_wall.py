"""The shipped series: what its script makes, and what the commands find in it."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from walls import off_by, rms

from corridor.tools import thermal

SHIPPED = Path(__file__).parents[3] / "data_synthetic"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("make", SHIPPED / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_shipped_pictures_are_what_the_script_makes(script, tmp_path):
    shots = script.filmed()
    for row in (0, 7):
        shipped = thermal.read_picture(SHIPPED / "wall" / shots.picture[row])
        np.testing.assert_array_equal(shots.read(row), shipped)


def test_a_model_fitted_to_them_agrees_with_the_truth_beside_them(tmp_path):
    """Half a pixel is the largest motion: to a hundredth, and the lag to 20 %."""
    found = thermal.fit(thermal.measure_maps(SHIPPED / "wall")).model
    truth = json.loads((SHIPPED / "wall.truth.json").read_text("utf-8"))
    (tmp_path / "true.json").write_text(json.dumps(truth["model"]))
    true = thermal.read_model(tmp_path / "true.json")
    assert found.lag_s == pytest.approx(truth["lag_s"], rel=0.2)
    for warm in np.linspace(*found.range_c, 4):
        assert rms(off_by(found, true, warm)) < 0.01
