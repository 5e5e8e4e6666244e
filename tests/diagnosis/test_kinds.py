"""Kinds of blocks that once ended in a wrong name, or in none, or not at all."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from believing import believed
from believing import flown as two_flights
from strips import corridor_block

from benchmarks.diagnosis.generator.cases import Case, single, together
from benchmarks.diagnosis.generator.generate import generate
from benchmarks.ladder import made
from corridor.core.adjustment import Model
from corridor.core.effects import add, candidates, find
from corridor.core.simulation import CAMLIGHT, add_noise
from corridor.diagnosis import Settings, diagnose
from corridor.diagnosis.evidence.scores import as_spread
from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.findings.verdict import _changes
from corridor.diagnosis.forward_selection import _without_motion
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.report.sentence import _off, _still_off
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import equations
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification.held_out import Prediction


def flown(**options):
    """A block of 16 images flown to and fro, with noise."""
    options = {"images": 16, "strips": 2, "observations_per_image": 80, "control": 4} | options
    block = corridor_block(check=0, relief=6.0, seed=2, **options)
    return add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.02, control_m=0.004, seed=2)


def stated(block, sigma):
    """The block with one standard deviation stated for all its positions, m."""
    block = block.copy()
    block.gnss = block.gnss.assign(sx=sigma, sy=sigma, sz=sigma)
    block.lever_arm, block.lever_arm_fixed = {}, False
    return block


class TestAnArmThatNobodyStated:
    """It is held where stated sigmas are coarse, and not accused where positions are better."""

    @pytest.mark.parametrize(("scatter", "arm"), [(0.0, "free"), (2.0, "fixed")])
    def test_it_is_free_where_positions_tell_it(self, scatter, arm):
        block = stated(flown(), 0.4)
        rng = np.random.default_rng(1)
        xyz = ["x", "y", "z"]
        block.gnss[xyz] = block.gnss[xyz] + scatter * rng.standard_normal((len(block.gnss), 3))
        model = ReferenceModel.of(block, Model())
        model.adjust()
        assert model.model.lever_arm == arm

    def test_what_somebody_says_of_it_holds(self):
        model = ReferenceModel.of(stated(flown(), 0.4), Model(lever_arm="fixed"))
        model.adjust()
        assert model.model.lever_arm == "fixed"


class TestRowsReadWhileTheCameraMoves:
    @staticmethod
    def asked(block):
        chosen = candidates(block, {name: () for name in block.cameras}, [], ["G1"])
        notes = _without_motion(block, chosen)
        return {e.slug for e in chosen.effects if e.place == "motion"}, notes

    def test_a_camera_that_reads_them_at_once_has_none(self):
        block = flown()
        cameras = {name: replace(c, readout_s=0.0) for name, c in block.cameras.items()}
        names, (note,) = self.asked(replace(block, cameras=cameras))
        assert not names and "readout_s = 0" in note

    def test_nor_does_a_column_that_is_missing_stand_in_its_way(self):
        """Who reads the sentence is not told to add velocities for a shutter that is none."""
        block = flown()
        cameras = {name: replace(c, readout_s=0.0) for name, c in block.cameras.items()}
        block = replace(block, cameras=cameras)
        block.images = block.images.drop(columns=["vx", "vy", "vz"], errors="ignore")
        chosen = candidates(block, {name: () for name in block.cameras}, [], ["G1"])
        assert "rolling_shutter" in chosen.untestable
        _without_motion(block, chosen)
        assert not {slug for slug in chosen.untestable if find(slug).place == "motion"}

    def test_without_a_speed_nothing_makes_a_motion_of_values_for_each_image(self):
        block = flown()
        block.images = block.images.drop(columns=["vx", "vy", "vz"])
        names, (note,) = self.asked(block)
        assert not names and "no name" in note

    def test_with_a_speed_or_a_readout_they_are_asked(self):
        block = flown()
        assert self.asked(block)[0] >= {"rolling_shutter", "rolling_shutter_rotation"}
        cameras = {name: replace(c, readout_s=0.03) for name, c in block.cameras.items()}
        block = replace(block, cameras=cameras)
        block.images = block.images.drop(columns=["vx", "vy", "vz"])
        names, notes = self.asked(block)
        assert "rolling_shutter_rotation" in names and not notes


class TestShiftsOfRowsInEachImage:
    """A turn during the readout shears rows as well; what shifts them as a whole has no name."""

    @staticmethod
    def found(block):
        return {one["slug"] for one in diagnose(block).effects if one["class"] == "named"}

    @pytest.mark.parametrize("seed", [1, 2])
    def test_a_camera_that_turns_is_named(self, seed):
        case = single("rolling_shutter_rotation", 0.5, images=40, observations=150)
        assert self.found(generate(case, seed).block) == {"rolling_shutter_rotation"}

    def test_pictures_that_bend_along_their_columns_as_well_are_not_called_so(self):
        """Each by a quadratic of its own, as a lens that is not at rest does."""
        case = single("rolling_shutter_rotation", 0.5, images=40, observations=150)
        block = generate(case, 1).twin.copy()
        (camera,) = block.cameras.values()
        xy = block.numbers("tie_points", "x", "y")
        u, v = ((xy - [camera.width / 2, camera.height / 2]) / (camera.width / 2)).T
        bend = 0.6 * np.random.default_rng(1).standard_normal((len(block.images), 2, 3))
        shift = np.einsum(
            "nik,kn->ni", bend[block.image_rows("tie_points")], np.stack([u * u, u * v, v * v])
        )
        block.put("tie_points", ("x", "y"), xy + shift)
        found = diagnose(block)
        assert [(one["slug"], one["class"]) for one in found.effects] == [
            ("rolling_shutter_rotation", "suspected")
        ]
        assert any("along the columns of the pictures" in note for note in found.notes)

    @pytest.mark.parametrize("seed", [4, 54022])
    def test_rows_that_shift_are_not_called_so(self, seed):
        hidden = made(12, seed)
        assert hidden.truth["outside"] == ["rows"]
        found = diagnose(hidden.block)
        assert not found.effects
        assert any("is not taken for the cause" in note for note in found.notes)


class TestWhatAFlightCannotSeparate:
    """A late clock moves the antenna along the way, as an arm does whose camera looks ahead."""

    def test_a_value_that_another_effect_would_change_is_told_and_no_limit_says_otherwise(self):
        hidden = generate(together("clock_offset", "lever_arm", images=40, observations=120), 5)
        found = diagnose(hidden.block)
        assert [one["slug"] for one in found.effects] == ["lever_arm"]
        (told,) = [note for note in found.notes if "cannot separate" in note]
        assert "separate y of a correction of the lever arm" in told and "clocks" in told
        first = found.to_dict()["not_separated"][0]
        assert (first["slug"], first["from"]) == ("lever_arm", "clock_offset")
        assert first["sigma_beside"] > 3.0 * first["sigma"]
        # Hidden are 10 ms, which were not found.
        assert found.detection_limits["clock_offset"]["offset"] > 0.010


def test_errors_of_what_a_block_does_not_have_are_not_offered():
    block = flown()
    chosen = candidates(block, {name: () for name in block.cameras}, [], ["G1"])
    slugs = {*chosen.untestable, *(effect.slug for effect in chosen.effects)}
    assert not {slug for slug in slugs if find(slug).needs_table("rig")}
    assert not {slug for slug in slugs if find(slug).needs_table("attitudes")}
    assert "gnss_bias" in slugs and "thermal" in slugs


class TestPositionsThatJump:
    """Another fix or base from a moment on: a jump, and no drift, which would bend the block."""

    CASE = Case({}, images=36, strips=3, observations=120, control=6, check=6)

    @pytest.mark.parametrize("back", [False, True])
    def test_are_found_with_the_moment(self, back):
        block = generate(self.CASE, 4).block
        rows = np.arange(len(block.gnss))
        gone = (rows >= 18) & ((rows < 25) | (not back))
        xyz = block.gnss[["x", "y", "z"]].to_numpy() + gone[:, None] * [0.3, -0.2, 0.5]
        block.gnss = block.gnss.assign(x=xyz[:, 0], y=xyz[:, 1], z=xyz[:, 2])
        found = diagnose(block)
        (one,) = found.unknown
        assert one["group"] == "gnss_step" and not found.effects
        assert np.abs(np.array(one["location"]["jump_m"]) - [0.3, -0.2, 0.5]).max() < 0.05
        assert "another fix or base), by (+0." in found.sentence
        assert any("receiver's log" in step for step in found.actions)
        assert found.gap["check_m"]["after"] < 0.015 < found.gap["check_m"]["before"]

    @pytest.mark.parametrize("degrees", [0.06, 1.0])
    def test_another_north_is_named_with_its_angle(self, degrees):
        """Antennas on the grid, control by true north: turned about somewhere, not the middle."""
        block = generate(self.CASE, 47).block
        angle = np.radians(degrees)
        x, y = block.gnss[["x", "y"]].to_numpy().T
        x, y = x - x[3], y - y[3]
        turned = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
        block.gnss = block.gnss.assign(
            x=turned[0] + block.gnss["x"].iloc[3], y=turned[1] + block.gnss["y"].iloc[3]
        )
        found = diagnose(block)
        rotation = next(one for one in found.effects if one["slug"] == "gnss_rotation")
        (z,) = rotation["parameters"]
        assert abs(z["value"] - angle) < 3.0 * z["sigma"] < 5e-4
        assert found.gap["check_m"]["after"] < 0.015

    def test_heights_that_lean_are_named_with_their_slope(self):
        """Control above a geoid that falls by 0.9 mm a metre to the east."""
        case = Case({}, images=60, strips=2, observations=120, control=8, check=6)
        block = generate(case, 48).block
        block.ground["z"] += 9e-4 * block.ground["x"]
        found = diagnose(block)
        (tilt,) = found.effects
        assert tilt["slug"] == "control_tilt"
        values = {one["name"]: (one["value"], one["sigma"]) for one in tilt["parameters"]}
        value, sigma = values["east"]
        assert abs(value - 9e-4) < 3.0 * sigma < 9e-4
        assert found.gap["check_m"]["after"] < 0.015 < found.gap["check_m"]["before"]

    def test_an_honest_flight_has_none(self):
        found = diagnose(generate(self.CASE, 5).block)
        assert not found.unknown and not found.effects


class TestFlightsThatDiffer:
    def test_the_sigma_of_a_difference_knows_nothing_of_what_they_have_in_common(self):
        """Values of two flights known to 0.2 apart from each other, and to 300 together."""
        group = Group(
            "focal_per_flight", find("focal_per_flight"), None, np.arange(2), np.full(2, 5.0),
            [("F1", "f", "px"), ("F2", "f", "px")],
        )  # fmt: skip
        spread = 300.0**2 * np.ones((2, 2)) + 0.1**2 * np.eye(2)
        ((row,),) = _changes(group, np.array([-10.0, 10.0]), spread, None).values()
        assert row["value"] == 20.0
        assert row["sigma"] == pytest.approx(5.0 * 0.1 * np.sqrt(2), rel=1e-3)

    def test_variants_of_each_flight_are_asked_of_two_flights_only(self):
        slugs = {"rolling_shutter_per_flight", "radial_distortion_per_flight"}
        for flights in (1, 2):
            block = flown(flights=flights)
            chosen = candidates(block, {name: () for name in block.cameras}, [], ["G1"])
            found = {effect.slug for effect in chosen.effects}
            assert slugs <= found if flights > 1 else not slugs & found

    @pytest.mark.slow
    def test_two_readouts_are_two_readouts(self):
        block = corridor_block(
            images=36, strips=4, flights=2, height=(45.0, 55.0, 45.0, 55.0),
            observations_per_image=120, control=5, check=4, seed=1, relief=6.0,
        )  # fmt: skip
        values = {"F1": 0.012, "F2": 0.032}
        names = dict(zip(values, block.flight_names, strict=True))
        there = {"readout": {names[key]: value for key, value in values.items()}}
        block = add(block, {"rolling_shutter_per_flight": there})
        block = add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.004, seed=1)
        found = diagnose(block)
        assert {one["slug"] for one in found.effects} == {"rolling_shutter_per_flight"}
        (change,) = found.effects[1]["change_from_flight_before"]
        assert change["value"] == pytest.approx(0.020, abs=4 * change["sigma"])


def test_a_free_network_is_asked_for_what_it_predicts():
    """Nothing holds it but the places where it began."""
    block = flown(camera=replace(CAMLIGHT, calibrated=True))
    block.gnss = block.gnss.iloc[:0]
    one = believed(block, control=[])
    assert np.isfinite(
        Prediction.of_folds(one, one, pd.MultiIndex.from_arrays([[], []])).gain
    ).all()


class TestCheckPointsThatNothingExplains:
    @staticmethod
    def told(sigmas, gnss=3, off=(0.7, 0.7, 0.7), tell=_off):
        gap, block = {"check_m": {"before": 0.7, "after": 0.7}}, SimpleNamespace(gnss=[0] * gnss)
        table = pd.DataFrame({"point": ["A", "B", "C"], "dx": 0.0, "dy": 0.0, "dz": off})
        after = SimpleNamespace(
            system=SimpleNamespace(control_names=[]),
            check_points=table.assign(s_dx=0.01, s_dy=0.01, s_dz=0.01),
        )
        return tell(SimpleNamespace(gap=gap, check_sigmas=sigmas, block=block, after=after))

    def test_they_are_told_beside_what_was_found_too(self):
        assert "still off by 700 mm, 9.0 times" in self.told(9.0, tell=_still_off)
        assert self.told(1.4, tell=_still_off) == ""

    def test_one_that_is_off_alone_is_named(self):
        told = self.told(9.0, off=(0.01, -0.3, 0.01))
        assert "check point B is off by -300 mm in height, alone: the others by 10 mm" in told
        assert "gnss_bias" not in told

    def test_they_are_told_beside_nothing_with_what_to_do(self):
        assert "9.0 times" in self.told(9.0) and "--effect gnss_bias" in self.told(9.0)
        assert "gnss_bias" not in self.told(9.0, gnss=0)

    def test_chance_is_no_word_worth(self):
        assert self.told(1.4) == ""


def test_of_two_that_their_spread_does_not_bear_the_stronger_is_asked_again():
    """Beside each other neither stands; without the weaker the other does."""

    class Told:
        inflation = np.array([2.0, 2.0])

        def given(self, rest, spread=False, only=None):
            alone = {0: 20.0, 1: 6.0}
            value = alone[only] if not rest else 1.0
            return {only: SimpleNamespace(evidence=value)}

        def total(self, chosen):
            return 0.0

    found = Found({0: 1.0, 1: 1.0}, {0: 30.0, 1: 4.0}, 30.0)
    assert set(as_spread(Told(), found, 2.5).chosen) == {0}


def test_settings_are_an_argument_and_are_written_down():
    block = flown(camera=replace(CAMLIGHT, calibrated=True))
    settings = Settings(null_draws=50)
    found = diagnose(block, only=["gnss_bias"], settings=settings)
    assert found.to_dict()["settings"]["null_draws"] == 50
    assert Settings().null_draws != 50


class TestABlockAndItsDouble:
    """Nothing of the equations depends on how many images a block has."""

    def test_a_second_block_beside_it_changes_no_evidence_of_its_images(self):
        """Two copies that share nothing bring twice the evidence of one, to rounding."""
        block = flown(camera=replace(CAMLIGHT, calibrated=True), images=14)
        block.lever_arm_fixed = True
        effects = [find("row_polynomial"), find("focal_per_image")]
        double = doubled(block)
        each = []
        for one in (block, double):
            e = equations(believed(one, camera="fixed"), effects, {})
            plain = Elimination(e, None).reduced()
            each.append(
                [plain.beside(((g, np.full(len(g), 0.5)),)).cost - plain.cost for g in e.groups]
            )
        assert each[1] == pytest.approx(2.0 * np.array(each[0]), rel=2e-2)


def doubled(block):
    """The block and a copy of it a kilometre away, of other names."""
    other = block.copy()
    for name in ("images", "points", "ground", "gnss"):
        table = getattr(other, name).copy()
        table["x"] = table["x"] + 1000.0
        setattr(other, name, table)
    out = block.copy()
    for name in ("images", "points", "ground", "gnss", "tie_points", "marks"):
        table = getattr(other, name).copy()
        for column in {"image", "point", "strip"} & set(table):
            table[column] = [f"{value}_2" for value in table[column].astype(str)]
        first = getattr(block, name).copy()
        for column in {"image", "point", "strip"} & set(first):
            first[column] = first[column].astype(str)
        both = pd.concat([first, table], ignore_index=True)
        if name in ("tie_points", "marks"):
            both = both.astype({"image": "category", "point": "category"})
        setattr(out, name, both)
    return out


class TestShapesOfEachImage:
    """Residuals of one image hang together: what does nothing else is no finding."""

    @staticmethod
    def diagnosed(size):
        """Rows of each image shifted by `size` times what is usual, noise of 0.3 px."""
        block, rng = two_flights(), np.random.default_rng(5)
        values = {
            p.name: {
                image: size * p.scale * rng.standard_normal() for image in block.images["image"]
            }
            for p in find("row_polynomial").parameters(block)
        }
        only = ["row_polynomial", "rolling_shutter", "focal_drift", "control_blunder", "gnss_bias"]
        return diagnose(add(block, {"row_polynomial": values}), only=only)

    def test_small_ones_are_told_and_not_adjusted(self):
        found = self.diagnosed(0.3)
        assert found.verdict == "nothing"
        assert any("neither moves the ground" in note for note in found.notes)
        assert [one.log["model"] for one in found.course.rounds] == [[]]

    def test_large_ones_are_something_outside_the_catalogue(self):
        found = self.diagnosed(3.0)
        assert found.verdict == "unknown" and "row_polynomial" in found.course.last.log["found"]


def test_another_lens_in_the_second_flight_is_told_from_there_on():
    """k1 larger by 0.004, as after a knock: the common part of both flights is the camera's."""
    block = two_flights()
    first, second = block.flight_names
    lens = {"radial_distortion_per_flight": {"k1": {first: 0.0, second: 0.004}}}
    found = diagnose(add(block, lens))
    assert "from flight F2 on k1" in found.sentence
    key = "change_from_flight_before"
    (change,) = [one[key][0] for one in found.effects if key in one]
    assert change["value"] == pytest.approx(0.004, abs=3.0 * change["sigma"])
