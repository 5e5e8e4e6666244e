"""A size that no camera has, or that the next adjustment denies, is not told as a value."""

from types import SimpleNamespace

import pandas as pd
import pytest
from strips import corridor_block

from corridor.core.effects import effect_of
from corridor.diagnosis.findings.findings import Estimate
from corridor.diagnosis.verification.held_out import untold


def asked(
    value, sigma, fitted, slug="rolling_shutter", name="readout", unit="s", where=None, own=0.004
):
    """Why the size of an effect cannot be told, by its estimate and an adjustment with it."""
    row = {"name": name, "value": value, "sigma": sigma, "unit": unit}
    one = Estimate(slug, "named", 20.0, [row], key=slug, where=where or {})
    table = pd.DataFrame(
        [(slug, name, group, v, own) for group, v in fitted.items()],
        columns=["slug", "parameter", "group", "value", "sigma"],
    )
    fit = SimpleNamespace(start=corridor_block(images=6), effects=table)
    return untold(one, effect_of(slug), fit)


class TestUntold:
    def test_a_readout_that_both_fits_have_is_told(self):
        assert asked(0.0248, 0.0005, {"block": 0.0251}) == ""

    @pytest.mark.parametrize("value", [0.31, -0.31])
    def test_no_camera_reads_that_long(self, value):
        """Within its sigmas it might be possible, and is no value all the same."""
        why = asked(value, 0.047, {"block": value})
        assert why.endswith("and none is beyond 300 ms")
        assert f"{1000 * value:.0f} ms" in why

    def test_an_adjustment_that_turns_it_round_denies_it(self):
        why = asked(0.209, 0.047, {"block": -0.137})
        assert why == "readout is 209 ms by the equations of one fit, and -137 ms in the next"

    def test_a_small_change_of_a_sure_value_does_not(self):
        """Noise of the GNSS that one fit knows of moves a value by many of its sigmas."""
        assert asked(0.0248, 0.0002, {"block": 0.0300}) == ""

    def test_what_the_adjustment_does_not_determine_denies_nothing(self):
        """A bend that the search left near nothing, and the adjustment leaves free."""
        assert asked(2e-5, 1e-4, {"block": 0.1}, own=0.08) == ""

    def test_a_large_change_of_an_unsure_value_does_not(self):
        assert asked(0.010, 0.010, {"block": 0.045}) == ""

    def test_each_flight_is_asked_for_its_own(self):
        fitted = {"F1": -0.05, "F2": 0.032}
        slug = "rolling_shutter_per_flight"
        assert asked(0.032, 0.001, fitted, slug, where={"flight": "F2"}) == ""
        assert asked(0.013, 0.001, fitted, slug, where={"flight": "F1"}) != ""

    def test_an_arm_longer_than_a_drone_is_not_told(self):
        why = asked(0.55, 0.1, {"block": 0.55}, "lever_arm", "x", "m")
        assert why == "x would be 550 mm, and none is beyond 500 mm"
