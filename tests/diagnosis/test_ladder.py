"""The ladder of sizes in short: the generator is sound, and its small blocks end with no name."""

import numpy as np
import pytest

import corridor
from benchmarks.ladder import Dirt, double, made
from benchmarks.ladder.climb import agree, climb, false_names, rates


@pytest.fixture(scope="module")
def clean():
    return made(30, 1, Dirt(strips=3, control=6, check=4))


class TestGenerator:
    """Code of its own: what the package makes of it is what was put in."""

    def test_the_package_finds_the_camera_and_the_check_points(self, clean):
        found = corridor.adjust(clean.block, camera="fraser10", loss="cauchy:2")
        assert found.converged
        off = found.check_points
        for axis in "xyz":
            assert (np.abs(off[f"d{axis}"]) < 5.0 * off[f"s{axis}"] + 0.03).all()
        # Antennas are as far off as their noise, white and slow, with the arm estimated.
        left = found.residuals["gnss"][["vx", "vy", "vz"]].to_numpy()
        assert (
            np.abs(left).max(axis=0) < 5.0 * np.hypot((8e-3, 8e-3, 15e-3), (6e-3, 6e-3, 12e-3))
        ).all()

    def test_the_same_seed_gives_the_same_block(self, clean):
        again = made(30, 1, Dirt(strips=3, control=6, check=4)).block
        assert again.tie_points.equals(clean.block.tie_points)

    @pytest.mark.parametrize(
        "dirt",
        [{"lens": 0.3}, {"rows": 0.2}, {"matches": 2}, {"water": 1.2}, {"lost": 1.0}, {"gaps": 2}],
        ids=str,
    )
    def test_dirt_changes_what_it_names(self, dirt):
        usual = {"strips": 2, "control": 6}
        before, after = (made(40, 3, Dirt(**usual, **d)).block for d in ({}, dirt))
        if "lost" in dirt:
            assert len(before.gnss) == len(before.images) and not len(after.gnss)
        elif "gaps" in dirt:
            assert len(after.images) < len(before.images)
        else:
            assert not after.tie_points.equals(before.tie_points)

    def test_thousands_of_images_are_seen_in_arrays(self):
        block = made(2500, 0, Dirt(), per_image=20).block
        assert len(block.images) == 2500 and len(block.tie_points) > 15 * 2500


class TestDouble:
    def test_two_copies_do_not_touch_each_other(self):
        block = made(20, 2, Dirt(strips=2)).block
        both = double(block)
        assert len(both.images) == 2 * len(block.images)
        assert len(both.tie_points) == 2 * len(block.tie_points)
        assert both.images["image"].is_unique and both.images["time_s"].is_unique
        first, second = both.images[:20]["x"], both.images[20:]["x"]
        assert second.min() - first.max() > 100.0

    def test_without_positions_half_of_the_points_stay(self):
        block = made(20, 2, Dirt(strips=2, lost=1.0, control=6)).block
        half = double(block)
        assert len(half.images) == len(block.images)
        assert 0.4 < len(half.tie_points) / len(block.tie_points) < 0.6


def _said(verdict, effects=(), unknown=()):
    return {"verdict": verdict, "effects": list(effects), "unknown": list(unknown), "seconds": 1.0}


class TestJudgement:
    NOTHING = _said("nothing")
    SHUTTER = _said("named", [["rolling_shutter", "named", None, []]])
    SUSPECTED = _said("suspected", [["rolling_shutter", "suspected", None, []]])
    LENS = _said("unknown", unknown=[["image_deformation", "unknown", []]])

    def test_a_name_is_false_and_a_suspicion_is_none(self):
        assert false_names(self.SHUTTER) == ["rolling_shutter"]
        assert not false_names(self.SUSPECTED) and not false_names(self.LENS)

    def test_a_name_that_the_double_does_not_suspect_is_no_agreement(self):
        assert not agree(self.SHUTTER, self.NOTHING, True)
        assert agree(self.SHUTTER, self.SUSPECTED, True)

    def test_more_data_may_show_what_is_outside_the_catalogue(self):
        assert agree(self.NOTHING, self.LENS, True)
        assert not agree(self.NOTHING, self.LENS, False)

    def test_a_crash_is_counted_and_agrees_with_nothing(self):
        crash = {"crash": "LinAlgError", "seconds": 1.0}
        assert not agree(crash, self.NOTHING, True)
        rows = [{"images": 12, "once": crash, "double": self.NOTHING, "agree": False}]
        assert rates(rows)["12"]["crashes"].startswith("50.0 % (1 of 2")


@pytest.mark.parametrize("seed", [0, 2])
def test_the_first_rung_ends_names_nothing_and_agrees_with_its_double(seed):
    row = climb(12, seed)
    assert "verdict" in row["once"] and "verdict" in row["double"]
    assert not false_names(row["once"]) and not false_names(row["double"])
    assert row["agree"]


def test_what_predicts_other_image_points_worse_is_not_named():
    """Rows that shift look like a readout of -106 ms, with which 0.55 px become 0.59."""
    said = corridor.diagnose(made(12, 51051).block)
    (one,) = said.findings.effects
    assert (one.slug, one.kind) == ("rolling_shutter", "suspected")
    assert "of image points that are left out become" in " ".join(said.notes)
