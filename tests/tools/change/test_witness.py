"""What one witness says, asked of others: marks and the surface around them, rays and strips."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array, hstack

import corridor
from benchmarks import two_dates
from corridor.core.adjustment import Model, Run, refit
from corridor.tools.change.cores import Cores
from corridor.tools.change.matching import between_strips, without_gross_ties
from corridor.tools.change.points import PointChanges
from corridor.tools.change.witness import contradictions


class TestSurfaceAroundAPoint:
    """Two marks, 3 m and 60 m along a level of 100 m whose core points are known to 40 mm each."""

    station = np.arange(0.0, 100.0, 2.0)
    places = np.column_stack([station, 0.0 * station, 0.0 * station])

    def found(self, sank, surface, names=("A", "B")):
        xyz = np.array([[3.0, 0.0, 0.0], [60.0, 0.0, 0.0]])
        if names == ("A", "near"):
            xyz[1, 0] = 5.0
        after = np.vstack([xyz, self.places])
        before, after = after.copy(), after.copy()
        after[:2, 2] -= sank
        after[2:, 2] += surface
        named = dict(zip(names, (0, 1), strict=True))
        clouds = [
            SimpleNamespace(named=named, epoch=SimpleNamespace(xyz=x, names=np.arange(len(x))))
            for x in (before, after)
        ]
        joint = SimpleNamespace(
            before=clouds[0], after=clouds[1], variance=lambda rows: np.array([1e-4])
        )
        up = np.tile([0.0, 0.0, 1.0], (50, 1))
        cores = Cores(self.places, up, self.station, self.station, np.eye(2), 2.0, 5.0, 8.0)
        each = csr_array(
            (np.ones(50), (np.arange(50), 6 + 3 * np.arange(50) + 2)), shape=(50, 3 * 52)
        )
        around = SimpleNamespace(
            joint=joint, registration=None, cores=cores, freedom=np.full(50, np.inf),
            distance=np.broadcast_to(surface, 50).astype(float),
            functions=hstack([-each, each], format="csr"),
            sampling_of_sums=lambda mean: 0.04**2 * np.sum(mean.toarray() ** 2, axis=1),
            sigma_of_sums=lambda mean: 0.04 * np.sqrt(np.sum(mean.toarray() ** 2, axis=1)),
        )  # fmt: skip
        shift = np.zeros((2, 3))
        shift[:, 2] = -np.asarray(sank)
        none = np.zeros(2, dtype=bool)
        chance = np.where(np.abs(sank) > 0.03, 1e-6, 0.5)
        points = PointChanges(
            np.array(names), xyz, shift, 1e-4 * np.eye(6), none, chance, none, None, None
        )
        return contradictions(points, around, 0.01)

    def test_that_stands_still_says_that_the_mark_was_moved(self):
        (one,) = self.found((0.2, 0.0), 0.0)
        assert one.point == 0 and one.moved == pytest.approx(-0.2) and abs(one.surface) < 1e-9

    def test_that_sinks_too_says_nothing_against_it(self):
        assert not self.found((0.2, 0.0), np.where(self.station < 30.0, -0.2, 0.0))

    def test_that_rises_as_grass_does_is_no_witness(self):
        assert not self.found((0.2, 0.0), 0.3)

    def test_that_is_too_rough_is_no_witness(self):
        """Five to ten core points of 40 mm each: 0.05 m are three of their standard deviations."""
        assert not self.found((0.05, 0.0), 0.0)

    def test_does_not_stand_against_two_marks_side_by_side(self):
        assert not self.found((0.2, 0.2), 0.0, ("A", "near"))
        assert len(self.found((0.2, -0.2), 0.0, ("A", "near"))) == 2


def small(kind, seed=3):
    """The second date of a short dike."""
    return two_dates.pair(kind, seed, images=6, count=400)[1]


def test_what_a_repeated_pattern_puts_aside_does_not_count():
    found = refit(small("repeated pattern"), Model(), Run())
    assert found.sigma0 > 3.0
    sound = without_gross_ties(found, corridor.adjust)
    assert 0.9 < sound.sigma0 < 1.1
    gone = set(found.block.tie_points["point"]) - set(sound.block.tie_points["point"])
    assert 4 < len(gone) < 30 and f"{len(gone)} tie points with gross errors" in sound.notes[0]


def test_no_tie_point_goes_where_they_decide_nothing():
    found = corridor.adjust(small("rest"))
    assert without_gross_ties(found, pytest.fail) is found


def test_matches_that_are_off_by_strip_are_told_from_free_errors():
    """As many free errors of 0.3 px as stated; then each point 0.6 px off in one strip beside."""
    block = small("rest")
    assert between_strips(corridor.adjust(block)) < 1.1
    draw, ties = np.random.default_rng(5), block.tie_points
    off = {name: draw.normal(0.0, 0.6, 2) for name in ties["point"].unique()}
    second = ties["image"].isin(block.images.loc[block.images["strip"] == "S1", "image"])
    ties.loc[second, ["x", "y"]] += np.array([off[name] for name in ties.loc[second, "point"]])
    # Means of four: 0.15 px by noise, 0.3 px on either side of the middle by what is off.
    assert 1.6 < between_strips(corridor.adjust(block)) < 3.5
