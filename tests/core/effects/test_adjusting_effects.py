"""Adjusting with effects of every group: gaps, what is refused, what stays sparse."""

from dataclasses import replace

import numpy as np
import pytest
from strips import CAMLIGHT, corridor_block

import corridor
from corridor.core.adjustment.problem import make_problem
from corridor.core.effects import add
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

NOISE = {"tie_px": 0.3, "mark_px": 0.3, "gnss_m": 0.005, "control_m": 0.005}


def flown(calibrated=True, **options):
    camera = replace(CAMLIGHT, calibrated=calibrated)
    options = {"images": 16, "observations_per_image": 120, "seed": 6} | options
    return corridor_block(strips=2, flights=2, camera=camera, **options)


class TestImagesWithoutGnss:
    """Antennas of some images are missing, of another the cells are empty."""

    @staticmethod
    def gappy(effect, values):
        block = add_noise(add(flown(), {effect: values}), **NOISE, seed=3)
        block.gnss = block.gnss.drop(index=[2, 3, 9]).reset_index(drop=True)
        block.gnss.loc[4, ["x", "y", "z"]] = np.nan
        silent = {2, 3, 9, 6}  # row 4 is image 6 once 2 and 3 are gone
        names = block.images["image"]
        return block, [name for k, name in enumerate(names) if k not in silent]

    def test_an_effect_of_each_image_is_estimated_where_there_is_gnss_and_nowhere_else(self):
        block, heard = self.gappy("time_rounding", {"offset": 0.04})
        found = corridor.adjust(block, effects=["time_rounding"], lever_arm="fixed")
        assert found.converged
        assert sorted(found.effects["group"]) == sorted(heard)
        off = (found.effects["value"] - 0.04) / found.effects["sigma"]
        assert np.abs(off).max() < 4

    def test_what_nothing_determines_is_not_counted_as_an_unknown(self):
        """12 antennas bring 36 numbers and 12 unknowns, whatever the 4 silent images say."""
        block, heard = self.gappy("time_rounding", {"offset": 0.04})
        free, held = (
            corridor.adjust(block, effects=effects, lever_arm="fixed").redundancy
            for effects in (["time_rounding"], [])
        )
        assert held - free == len(heard) == 12

    def test_a_flight_whose_cells_are_all_empty_has_no_arm(self):
        block = add_noise(add(flown(), {"lever_arm": {"x": 0.03}}), **NOISE, seed=3)
        second = block.gnss["image"].isin(block.images.query("flight == 'F2'")["image"])
        block.gnss.loc[second, ["x", "y", "z"]] = np.nan
        found = corridor.adjust(block, effects=["lever_arm_per_flight"], lever_arm="fixed")
        assert found.effects["group"].tolist() == ["F1"] * 3
        off = (found.effects["value"] - [0.03, 0.0, 0.0]) / found.effects["sigma"]
        assert np.abs(off).max() < 4


class TestWhatACameraParameterDoesItself:
    @pytest.mark.parametrize(
        "effect, named",
        [
            ("focal", "f"),
            ("focal_per_image", "f"),
            ("principal_point_per_flight", "cx, cy"),
            ("radial_distortion", "k1, k2, k3"),
            ("sensor_unflatness", "k1, k2, k3, p1, p2"),
        ],
    )
    def test_is_refused_while_the_parameter_is_free(self, effect, named):
        block = flown(calibrated=False)
        with pytest.raises(InputError) as error:
            corridor.adjust(block, effects=[effect])
        for word in (f"effect {effect}", f"what {named} of camera camlight", "hold the camera"):
            assert word in str(error.value)

    def test_is_estimated_where_the_others_are_free(self):
        """Free distortion does not mind a focal length of each flight."""
        block = add_noise(flown(), **NOISE, seed=1)
        found = corridor.adjust(
            block, camera="cx,cy,k1,k2,p1,p2", effects=["focal_per_flight"], lever_arm="fixed"
        )
        assert found.converged
        assert (found.effects["value"] / found.effects["sigma"]).abs().max() < 4

    def test_is_estimated_with_a_prior(self):
        block = add_noise(flown(calibrated=False), **NOISE, seed=1)
        found = corridor.adjust(
            block, effects=["focal_per_flight"], lever_arm="fixed",
            priors={"focal_per_flight.f": (0.0, 2.0)},
        )  # fmt: skip
        assert found.converged
        # The mean of both is the camera's own: known by the prior alone, 2 px / sqrt(2).
        assert found.effects["sigma"].min() / found.sigma0 > 1.4


class TestGroundControl:
    @pytest.mark.parametrize(
        "effect, words",
        [
            ("control_blunder", "with effect control_blunder"),
            ("control_datum", "Position along x, position along y and height"),
        ],
    )
    def test_that_may_move_holds_no_block_without_gnss(self, effect, words):
        block = flown(gnss=False)
        with pytest.raises(InputError, match=words):
            corridor.adjust(block, effects=[effect])

    def test_only_points_that_are_control_have_a_blunder(self):
        block = add_noise(flown(), **NOISE, seed=2)
        names = block.ground["point"].tolist()
        found = corridor.adjust(
            block, control=names[1:3], effects=["control_blunder"], lever_arm="fixed"
        )
        assert sorted(set(found.effects["group"])) == names[1:3]

    def test_a_blunder_of_one_point_is_found_at_that_point(self):
        """10 cm in z of one point; the others stay within four sigmas of zero."""
        block = flown()
        name = block.ground.query("role == 'control'")["point"].iloc[2]
        block = add_noise(add(block, {"control_blunder": {"z": {name: 0.10}}}), **NOISE, seed=2)
        found = corridor.adjust(block, effects=["control_blunder"], lever_arm="fixed").effects
        guilty = (found["group"] == name) & (found["parameter"] == "z")
        assert found.loc[guilty, "value"].item() == pytest.approx(0.10, abs=0.04)
        assert (found["value"] / found["sigma"])[~guilty].abs().max() < 4
        assert (found["value"] / found["sigma"])[guilty].item() > 5

    def test_a_blunder_that_is_known_beforehand_to_be_small_stays_small(self):
        block = add_noise(flown(gnss=False), **NOISE, seed=2)
        prior = {f"control_blunder.{axis}": (0.0, 0.001) for axis in "xyz"}
        found = corridor.adjust(block, effects=["control_blunder"], priors=prior)
        assert found.converged
        assert found.effects["value"].abs().max() < 0.001


class TestEffectsOnTheImage:
    @pytest.mark.parametrize("effect", ["row_polynomial", "sensor_unflatness", "image_deformation"])
    def test_take_no_more_steps_than_others_where_residuals_are_large(self, effect):
        """5 % of gross errors, up to 50 px: the slope of the shift times these is not small.

        Without that slope in the equations the first and the last take 12 and 16 steps.
        """
        block = add_noise(flown(images=24), **NOISE, outliers=0.05, seed=5)
        usual = corridor.adjust(block, effects=["rolling_shutter"], lever_arm="fixed")
        found = corridor.adjust(block, effects=[effect], lever_arm="fixed")
        assert found.converged
        assert found.iterations <= usual.iterations + 5


class TestManyImages:
    @pytest.mark.parametrize("effects", [["row_polynomial"], ["row_polynomial", "time_rounding"]])
    def test_effects_of_each_image_widen_no_border(self, effects):
        """The band takes them: as many image blocks as without, of 6 + 4 (+ 1) unknowns."""
        block = flown(images=60, observations_per_image=40)
        plain = make_problem(block, lever_arm="fixed")
        wide = make_problem(block, effects=effects, lever_arm="fixed")
        assert wide.shared_count == plain.shared_count == 0
        assert wide.bandwidth == plain.bandwidth < 60
        assert wide.d == 6 + 4 + ("time_rounding" in effects)
