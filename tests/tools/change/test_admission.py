"""Epochs that do not fit their own model, or each other, are not compared: made-up dates."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

import corridor
from benchmarks import two_dates
from corridor.core.effects import candidates
from corridor.core.errors import InputError
from corridor.tools.change import Signatures, significance
from corridor.tools.change.admission import Coordinates, misfits, slips
from corridor.tools.change.epoch import Epoch
from corridor.tools.change.m3c2 import polynomial
from corridor.tools.change.significance import discs_in, patches, patches_beside
from tests.block_folder import small


def said(kind, seed=0, **options):
    return corridor.change(*two_dates.pair(kind, seed), surface=False, **options)


@pytest.mark.parametrize(
    ("kind", "verdict", "words"),
    [
        ("GNSS float", "nothing", ["9 GNSS positions disagree with all others by one vector"]),
        ("datum 1 m", "unfit", ["two datums", "+1.000", "--datum stable"]),
        ("control point 0.10 m", "nothing", ["C2 by (+0.100, +0.000, +0.000) m"]),
        ("names exchanged", "nothing", ["Are their names exchanged"]),
        ("readout 20 ms, turning", "camera", ["rotation while the rows are read"]),
    ],
)
def test_what_is_wrong_with_an_epoch_is_said_and_never_called_motion(kind, verdict, words):
    found = said(kind)
    text = " ".join(str(found).split())
    assert found.verdict == verdict
    for word in words:
        assert word in text


def test_two_datums_may_be_laid_together():
    assert said("datum 1 m", datum="stable", motion="translation").verdict == "nothing"


def test_without_common_control_a_constant_error_of_the_gnss_is_a_doubt():
    found = said("GNSS 20 mm, no control")
    assert "--gnss-bias" in str(found)
    assert "--gnss-bias" not in str(said("GNSS 20 mm, no control", gnss_bias=0.02))


class TestCoordinates:
    """Given coordinates of two dates, without any adjustment."""

    def dates(self, shift):
        before, after = two_dates.pair("rest", 0)
        for name, by in shift.items():
            rows = after.ground["point"] == name
            after.ground.loc[rows, ["x", "y", "z"]] += np.asarray(by)
        return Coordinates.of(before, after)

    def test_one_point_is_named(self):
        found = self.dates({"C2": (0.0, 0.0, 0.05)})
        assert found.mistaken == ["C2"] and not list(found.objections())
        assert "C2 by (+0.000, +0.000, +0.050) m" in next(found.notes())

    def test_a_check_point_is_named_and_costs_no_control(self):
        found = self.dates({"K1": (0.3, 0.0, 0.0)})
        assert found.mistaken == [] and "K1" in next(found.notes())

    def test_most_of_them_are_two_datums(self):
        names = [f"C{k}" for k in range(6)] + ["K0", "K1"]
        (one,) = self.dates({name: (0.0, 0.2, 0.0) for name in names}).objections()
        assert "8 of 11 ground points" in one.what and "(+0.000, +0.200, +0.000) m" in one.what

    def test_that_all_of_one_side_sank_is_no_datum(self):
        """Three control points that stayed hold it; two alone do not."""
        sank = {name: (0.0, 0.01 * k, -0.3 + 0.02 * k) for k, name in enumerate(["C0", "C2", "C4"])}
        sank |= {f"K{k}": (0.0, 0.0, -0.25) for k in range(4)}
        found = self.dates(sank)
        assert not list(found.objections()) and found.mistaken == ["C0", "C2", "C4"]
        assert list(self.dates(sank | {"C5": (0.0, 0.0, -0.2)}).objections())

    def test_a_base_2_cm_beside_is_told_by_all_points_where_none_tells_it_alone(self):
        """Each lies 2.8 sigmas away; their median 7. That a third of them sinks is no datum."""
        names = [f"C{k}" for k in range(6)] + [f"K{k}" for k in range(5)]
        draw = np.random.default_rng(5)
        noise = draw.normal(0, 1, (11, 3)) * [0.005, 0.005, 0.008]
        surveyed = noise + [0.0, 0.02, 0.0]
        (one,) = self.dates(dict(zip(names, surveyed, strict=True))).objections()
        assert "11 of 11 ground points" in one.what and "more" not in one.what
        sunk = noise - np.outer(np.arange(11) < 4, [0.0, 0.0, 0.07])
        found = self.dates(dict(zip(names, sunk, strict=True)))
        assert not found.two_datums and found.differ.sum() == 4

    @pytest.mark.parametrize("way", ["scaled", "turned", "tilted"])
    def test_a_system_that_lies_otherwise_is_told_by_all_points(self, way):
        """A projection scaled by 300 ppm, north that is 70 arc seconds off, a geoid that slopes:
        most at the ends, 24 mm, and nothing in the median."""
        points = two_dates.pair("rest", 0)[0].ground
        away = points[["x", "y", "z"]] - points[["x", "y", "z"]].mean()
        zero, size = np.zeros(len(away)), 3e-4
        by = {
            "scaled": size * away.to_numpy(),
            "turned": size * np.column_stack([-away["y"], away["x"], zero]),
            "tilted": size * np.column_stack([zero, zero, away["x"]]),
        }[way]
        noise = np.random.default_rng(8).normal(0, 1, (11, 3)) * [0.005, 0.005, 0.008]
        (one,) = self.dates(dict(zip(points["point"], by + noise, strict=True))).objections()
        assert "11 of 11 ground points" in one.what and "turned or scaled as a whole" in one.what

    def test_heights_of_another_system_are_refused_as_such(self):
        names = [f"C{k}" for k in range(6)] + [f"K{k}" for k in range(5)]
        found = self.dates(dict.fromkeys(names, (0.0, 0.0, 30.0)))
        with pytest.raises(InputError, match=r"two datums: 11 of 11 .*\+30\.000"):
            found.check(5.0, np.zeros(3))
        found.check(50.0, np.zeros(3))
        found.check(5.0, np.array([0.3, 0.1, 30.0]))

    def test_marks_that_were_painted_anew_are_no_datum(self):
        turned = np.linspace(0.0, 2 * np.pi, 7)[:6]
        shift = {f"C{k}": (0.05 * np.cos(t), 0.05 * np.sin(t), 0.0) for k, t in enumerate(turned)}
        (one,) = self.dates(shift).objections()
        assert "6 of 11" in one.what and "up to 0.050 m" in one.what and "datum" not in one.what

    def test_two_surveys_of_the_same_points_agree(self):
        """Noise as stated, of both: one in a thousand pairs would differ."""
        draw = np.random.default_rng(3)
        wrong = 0
        for _ in range(40):
            names = [f"C{k}" for k in range(6)] + [f"K{k}" for k in range(5)]
            noise = draw.normal(0, np.sqrt(2) * np.array([0.005, 0.005, 0.008]), (11, 3))
            wrong += bool(self.dates(dict(zip(names, noise, strict=True))).differ.any())
        assert wrong <= binom.ppf(0.9999, 40, 1e-3)


def test_what_fits_is_admitted_and_what_does_not_is_named_with_its_worst():
    one = corridor.adjust(two_dates.pair("rest", 1)[1])
    assert not list(misfits(one, "the first flight"))
    one = corridor.adjust(two_dates.pair("mark of C1 5 px off", 1000)[1], weights="stated")
    (objection,) = misfits(one, "the second flight")
    assert "control points" in objection.what and "most at C1" in objection.what


@pytest.mark.parametrize("seed", [1001, 1002])
def test_water_is_no_ground(seed):
    """Two strips fly over it in opposite directions, and see two surfaces."""
    found = corridor.change(*two_dates.pair("moving water", seed))
    assert found.verdict != "moved" and found.final.apart
    assert "does not count: at the second date" in " ".join(str(found).split())


def test_the_catalogue_is_the_one_of_the_diagnosis():
    """Every effect of camera and flight that can be tested, those of single images included."""
    one = corridor.adjust(two_dates.pair("rest", 1)[1])
    system = one.system
    known = candidates(system.block, system.free, [], list(system.control_names)).effects
    expected = {effect.slug for effect in known if effect.place != "ground"}
    found = Signatures(Epoch(one))
    assert set(found.effects) == expected
    assert any(effect.group == "image" for effect in found.effects.values())


class TestPatches:
    """A map of 12 x 8 cells whose neighbours err alike."""

    place = np.stack(np.meshgrid(np.arange(12), np.arange(8)), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(place[:, None] - place, axis=2)
    alike = np.exp(-away / 1.5)
    near = away < 1.5

    def maps(self, count, seed):
        root = np.linalg.cholesky(self.alike)
        return np.random.default_rng(seed).normal(size=(count, len(self.place))) @ root.T

    def test_maps_of_nothing_show_one_as_often_as_asked(self):
        found = sum(bool(patches(z, self.alike, self.near, 0.05)) for z in self.maps(60, 1))
        assert binom.ppf(0.0005, 60, 0.05) <= found <= binom.ppf(0.9995, 60, 0.05)

    def test_a_wide_patch_is_found_that_no_cell_shows(self):
        """Cells of 2.5 sigmas are nothing among 96; thirty of them together are."""
        inside = (np.abs(self.place - [5, 4]) <= [3, 2]).all(axis=1)
        found = patches(2.5 * inside, self.alike, self.near, 0.01)
        assert len(found) == 1
        np.testing.assert_array_equal(found[0].cells, np.flatnonzero(inside))
        assert not patches(np.where(np.arange(96) == 40, 2.5, 0.0), self.alike, self.near, 0.01)

    def test_what_is_said_of_a_bowl_holds_although_the_data_chose_its_place(self, monkeypatch):
        """The mean of cells that were chosen beyond a limit errs outwards by more than one of its
        standard deviations; that of a disc lies within two of its own in 95 %."""
        monkeypatch.setattr(significance, "MAPS", 200)
        bowl = -3.0 * np.exp(-0.5 * np.sum((self.place - [5, 4]) ** 2, axis=1) / 2.0**2)
        cells, discs = [], []
        for noise in self.maps(40, 4):
            value = bowl + noise
            found = patches(value, self.alike, self.near, 0.05)
            for one in discs_in(found, value, self.alike, self.place.astype(float)):
                for some, wider, errors in ((one.cells, 1.0, cells), (one.disc, one.wider, discs)):
                    sigma = wider * np.sqrt(self.alike[np.ix_(some, some)].mean())
                    errors.append(np.sign(one.z) * noise[some].mean() / sigma)
        assert len(discs) > 20 and np.mean(cells) > 1.0
        assert np.sum(np.abs(discs) > 2.0) <= binom.ppf(0.9995, len(discs), 0.05)


class TestPatchesBesideTheirSurroundings:
    """The same map, of a datum that shifts, tilts and bends it by far more than its cells err."""

    place = 5.0 * TestPatches.place.astype(float)
    shape = polynomial(*(place - place.mean(axis=0)).T / 30.0, 2)
    errors = TestPatches.alike + 30.0**2 * shape @ shape.T
    noise = np.ones(len(place))

    def maps(self, count, seed):
        root = np.linalg.cholesky(self.errors)
        return np.random.default_rng(seed).normal(size=(count, len(self.place))) @ root.T

    def found(self, value, level):
        return patches_beside(value, self.errors, self.noise, self.place, level)

    def test_maps_of_nothing_show_one_as_often_as_asked(self):
        found = sum(bool(self.found(z, 0.05)) for z in self.maps(60, 1))
        assert binom.ppf(0.0005, 60, 0.05) <= found <= binom.ppf(0.9995, 60, 0.05)

    def test_a_bowl_is_found_that_the_datum_hides_and_nothing_else(self):
        """As the coordinates say, no cell of it is larger than a third of its sigma."""
        sigma = np.sqrt(np.diag(self.errors))
        alike = self.errors / sigma[:, None] / sigma
        centre = np.array([30.0, 20.0])
        bowl = -9.0 * np.exp(-0.5 * np.sum((self.place - centre) ** 2, axis=1) / 6.0**2)
        others = 0
        for z in self.maps(10, 2):
            value = z + bowl
            assert not patches(value / sigma, alike, TestPatches.near, 0.01)
            first, *more = self.found(value, 0.01)
            others += len(more)
            assert first.z < 0.0
            assert np.linalg.norm(self.place[first.cells].mean(axis=0) - centre) < 8.0
            # It is the bowl against its surroundings that is stated, not the datum.
            error = np.sqrt(first.weight @ self.errors @ first.weight)
            assert abs(first.weight @ z) < 4.0 * error
            assert first.weight @ bowl < -3.0
        assert others <= 2

    def test_two_of_either_sign_are_found_both(self):
        bumps = [
            sign * 9.0 * np.exp(-0.5 * np.sum((self.place - centre) ** 2, axis=1) / 5.0**2)
            for sign, centre in ((-1.0, [10.0, 10.0]), (1.0, [45.0, 25.0]))
        ]
        found = self.found(self.maps(1, 3)[0] + sum(bumps), 0.01)
        assert {np.sign(one.z) for one in found} == {-1.0, 1.0}


def test_a_settlement_beside_a_shutter_is_said_with_its_place_and_sign():
    told = two_dates.told("readout 20 ms", two_dates.BOWL, 0)
    assert told["verdict"] == "moved" and told["words"]
    assert told["place"] and told["sign"] and told["size"]


def _surveyed(names, shift=0.0):
    ground = pd.DataFrame({"point": names, "x": [0.0, 9.0], "y": 1.0, "z": 2.0, "role": "control"})
    block = small(ground=ground)
    block.tie_points["x"] += shift
    return block


def test_one_block_given_twice_is_told():
    (said,) = slips(_surveyed(["A", "B"]), _surveyed(["A", "B"]))
    assert "one block given twice" in said
    assert not list(slips(_surveyed(["A", "B"]), _surveyed(["A", "B"], shift=0.3)))


def test_points_of_the_same_place_and_another_name_are_told():
    (said,) = slips(_surveyed(["A", "B"]), _surveyed(["P_A", "B"], shift=0.3))
    assert "1 ground point of the first date" in said and "A is P_A" in said
