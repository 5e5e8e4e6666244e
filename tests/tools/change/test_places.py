"""Where something moved: points that only together show it, and patches that are no ground."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

import corridor
from benchmarks import two_dates
from corridor.tools.change import significance
from corridor.tools.change.cores import Cores
from corridor.tools.change.explanation import Explanation
from corridor.tools.change.layers import level, scatter_added, typical
from corridor.tools.change.m3c2 import members
from corridor.tools.change.points import PointChanges, localised
from corridor.tools.change.result import Compared
from corridor.tools.change.sentence import patch_level, verdict_sentence
from corridor.tools.change.significance import patches_beside
from corridor.tools.change.surface import PatchChange

SHIPPED = Path(__file__).parents[3] / "data_synthetic" / "dike.toml"


class TestPointsTogether:
    """Heights and places with standard deviations of 10 mm."""

    alone = np.ones(8, dtype=bool)

    def test_four_of_eight_that_sink_by_three_sigmas_each_are_found(self):
        """The weighted square is 36; chi square with 8 degrees of freedom exceeds 22 in 0.5 %."""
        shift = np.zeros((8, 3))
        shift[:4, 2] = -0.03
        found = localised(shift.ravel(), 1e-4 * np.eye(24), 0.01, self.alone)
        assert found[:4].any() and not found[4:].any()

    def test_one_point_alone_gets_no_second_chance(self):
        """3.2 sigmas down: 1.4e-3 by its height alone, 1.7e-2 by all three numbers."""
        found = localised(np.array([0.0, 0.0, -0.032]), 1e-4 * np.eye(3), 0.01, self.alone[:1])
        assert not found.any()

    def test_nothing_is_found_more_often_than_asked(self):
        noise = np.random.default_rng(3).normal(0.0, 0.01, (500, 24))
        found = sum(localised(n, 1e-4 * np.eye(24), 0.05, self.alone).any() for n in noise)
        assert binom.ppf(0.0005, 500, 0.05) <= found <= binom.ppf(0.9995, 500, 0.05)

    def test_a_datum_that_floats_hides_no_point_that_sinks_from_its_neighbours(self):
        """All float by 1 m together: none moves by itself, the third sinks by 10 sigmas."""
        shift = np.full((8, 3), 0.4)
        shift[2, 2] -= 0.1
        floating = np.kron(np.ones((8, 8)), np.eye(3))
        found = localised(shift.ravel(), floating + 1e-4 * np.eye(24), 0.01, ~self.alone)
        np.testing.assert_array_equal(np.flatnonzero(found), [2])


def cloud(xyz):
    return SimpleNamespace(xyz=xyz, surface=np.arange(len(xyz)), epoch=SimpleNamespace(xyz=xyz))


def upright(places):
    """Core points on a level of zero."""
    xyz = np.column_stack([places, np.zeros(len(places))])
    return Cores(
        xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)), xyz[:, 0], xyz[:, 1], np.eye(2), 2.0, 5.0, 8.0
    )


class TestPatches:
    """Sixty points on level ground, rough by 1 cm."""

    draw = np.random.default_rng(4)
    level = np.column_stack([draw.uniform(-4.0, 4.0, (60, 2)), draw.normal(0.0, 0.01, 60)])
    core = upright(np.zeros((1, 2)))

    @pytest.mark.parametrize("degree", [0, 1, 2])
    def test_a_lorry_on_a_third_of_it_moves_the_mean_and_not_the_typical_point(self, degree):
        parked = self.level + np.outer(self.level[:, 0] > 1.5, [0.0, 0.0, 3.0])
        dates = cloud(self.level), cloud(parked)
        assert abs(typical(dates, self.core, degree)[0]) < 0.02
        sunk = cloud(self.level - [0.0, 0.0, 0.1])
        assert typical((dates[0], sunk), self.core, degree)[0] == pytest.approx(-0.1, abs=1e-9)

    def test_of_the_same_points_it_is_what_each_of_them_did(self):
        """On a slope of 1 : 2, where the medians of their heights say little."""
        slope = self.level + np.outer(0.5 * self.level[:, 0], [0.0, 0.0, 1.0])
        sunk = slope - [0.0, 0.0, 0.03]
        # Less than half of them carry what stands on it.
        sunk[:25, 2] += 0.5
        dates = cloud(slope), cloud(sunk)
        found = typical(dates, self.core, 0, sampled=False)
        assert found == pytest.approx([-0.03], abs=1e-9)

    @pytest.mark.parametrize("edge", [0.0, 3.0])
    def test_what_grows_scatters_beside_an_edge_of_the_ground_too(self, edge):
        """Heights of 0.5 m, scatter 0.29 m; the edge of a dike is in one of five cylinders."""
        places = np.concatenate([self.level + [12.0 * n, 0.0, 0.0] for n in range(5)])
        places[:60, 2] += edge * (places[:60, 0] > 0.0)
        cores = upright(np.column_stack([12.0 * np.arange(5.0), np.zeros(5)]))
        grown = places + np.outer(self.draw.gamma(3.0, 0.5 / 3.0, 300), [0.0, 0.0, 1.0])
        added = scatter_added((cloud(places), cloud(grown)), cores, 0, 1)
        assert added == pytest.approx(0.29**2, rel=0.5 if edge == 0.0 else 0.8)
        lifted = cloud(places + [0.0, 0.0, 0.5])
        assert scatter_added((cloud(places), lifted), cores, 0, 1) == 0.0

    @pytest.mark.parametrize("degree", [1, 2])
    def test_a_surface_is_not_extrapolated(self, degree):
        aside = self.level[self.level[:, 0] > 1.0]
        assert members(cloud(aside), self.core, degree).beyond.all()
        assert not members(cloud(self.level), self.core, degree).beyond.any()
        assert not members(cloud(aside), self.core, 0).beyond.any()


@dataclass
class Surface:
    """Changes at core points, their means with a standard deviation of 10 mm."""

    distance: np.ndarray
    cores: Cores

    def __len__(self):
        return len(self.distance)

    def sigma_of_sums(self, matrix):
        return np.full(len(matrix), 0.01)


class TestCover:
    """A patch of 200 m along which the surface changes, and three marks that stand still."""

    def found(self, change, held, rows=slice(None)):
        cores = upright(np.column_stack([np.arange(0.0, 200.0, 2.0), np.zeros(100)]))
        surface = Surface(change(cores.station), cores)
        marks = np.array([[2.0, 1.0, 0.0], [8.0, -1.0, 0.0], [14.0, 0.0, 0.0]])
        points = SimpleNamespace(
            xyz=marks, shift=np.zeros((3, 3)), covariance=1e-4 * np.eye(9),
            held=np.full(3, held), moved=np.zeros(3, dtype=bool), undecided=None,
        )  # fmt: skip
        every = np.arange(100)[rows], 0.3, 0.01, 100.0, 0.0, 400.0, 0.001, np.full(100, 0.01)
        patch = PatchChange(*every)
        return Compared((), None, points, surface, {}, (patch,)).cover

    def test_control_that_stands_in_it_says_so(self):
        assert self.found(lambda station: np.full(len(station), 0.3), held=True).points == 3

    def test_marks_at_the_rim_of_a_bowl_do_not(self):
        """Where they are the surface does not change either."""
        assert self.found(lambda station: -0.3 * (station > 100.0) - 1e-3, held=False) is None

    def test_marks_beside_a_patch_say_so_where_the_surface_changes_at_all_of_them(self):
        far = slice(50, None)
        assert self.found(lambda station: np.full(len(station), -0.3), True, far).points == 3
        assert self.found(lambda station: -0.3 * (station > 100.0) - 1e-3, True, far) is None
        # 0.3 m of a bowl where 0.1 m were mown at all marks.
        assert self.found(lambda station: -0.2 * (station > 100.0) - 0.1, True, far) is None


@pytest.mark.parametrize("seed", [5010, 5024])
def test_lorries_are_not_the_ground_and_are_told(seed):
    """Where they are seen at all: in ten of thirty draws."""
    found = corridor.change(*two_dates.pair("lorries", seed))
    assert found.verdict == "nothing" and found.final.apart
    assert "some of its tie points lie higher at the second date" in " ".join(str(found).split())


def test_every_effect_that_is_said_to_be_modelled_is_modelled():
    """With the camera's rotation modelled the measurements show the rolling shutter too."""
    slide = two_dates.MOTIONS["slide"]
    found = corridor.change(*two_dates.pair("readout 20 ms, turning", 5000, slide), surface=False)
    shown = found.explanation.shown[1]
    assert shown == {"rolling_shutter", "rolling_shutter_rotation"}
    assert shown <= set(found.remaining.adjustments[1].system.effects)


def test_a_point_that_an_effect_could_have_moved_is_not_called_no_change():
    """As a whole significant, no place of the surface, and one point undecided."""
    tested = significance.Test
    tests = [tested(True, 1e-6, 100), tested(False, 0.1, 100), tested(True, 1e-6, 100)]
    told = Explanation(*tests, visible=True, shown=(set(), set()), table=None)
    assert told.verdict == "nothing"
    assert replace(told, doubted=True).verdict == "undecided"


class TestLevel:
    """A hundred points of a date in three cylinders, each with a standard deviation of 10 mm."""

    draw = np.random.default_rng(7)
    places = draw.uniform(-5.0, 5.0, (150, 2)) + np.repeat([[0, 0], [12, 0], [24, 0]], 50, axis=0)
    cores = upright(np.array([[0.0, 0.0], [12.0, 0.0], [24.0, 0.0]]))
    smooth = 0.02**2

    def found(self, heights, smooth=smooth, some=slice(None)):
        noise = self.draw.normal(0.0, 0.01, (2, 150))
        dates = [
            SimpleNamespace(
                xyz=np.column_stack([self.places, z + e])[some],
                sigma0=1.0,
                names=np.arange(150)[some],
                own=lambda point: np.tile(1e-4 * np.eye(3), (len(point), 1, 1)),
            )
            for z, e in zip(heights, noise, strict=True)
        ]
        clouds = [
            SimpleNamespace(xyz=one.xyz, surface=np.arange(len(one.xyz)), epoch=one)
            for one in dates
        ]
        joint = SimpleNamespace(
            before=clouds[0],
            after=clouds[1],
            variance=lambda functions: np.full(functions.shape[0], 1e-4),
        )
        return level(joint, self.cores, 0, smooth), clouds

    def test_water_that_falls_is_level_at_both_dates(self):
        found, _ = self.found((0.4, 0.0))
        np.testing.assert_allclose(found.heights, [0.4, 0.0], atol=0.005)
        assert found.within < 0.015

    def test_a_flood_that_left_rough_ground_was_level_at_the_first_date(self):
        found, _ = self.found((0.4, self.draw.normal(0.0, 0.05, 150)))
        assert found.dates == (0,) and found.heights == pytest.approx((0.4,), abs=0.005)
        assert "at the first date its points share one height" in patch_level(found)

    def test_rough_or_sloping_ground_that_falls_is_not(self):
        rough = self.draw.normal(0.0, 0.02, 150)
        assert self.found((rough + 0.4, rough))[0] is None
        slope = 0.01 * self.places[:, 0]
        assert self.found((slope + 0.4, slope))[0] is None

    def test_a_bank_beside_it_is_not_of_it(self):
        bank = np.where(self.places[:, 0] > 18.0, 2.0 + 0.5 * self.places[:, 0], 0.0)
        found, clouds = self.found((np.where(bank > 0.0, bank, 0.4), bank))
        np.testing.assert_array_equal(found.shown(clouds, self.cores, 0), [True, True, False])

    def test_what_points_cannot_tell_from_smooth_ground_is_not_called_water(self):
        assert self.found((0.4, 0.0), smooth=0.005**2)[0] is None
        assert self.found((0.4, 0.0), some=slice(0, 150, 10))[0] is None


class TestSteps:
    """A map of 12 x 8 cells that float together by five of their own standard deviations."""

    place = np.stack(np.meshgrid(np.arange(12), np.arange(8)), axis=-1).reshape(-1, 2)
    errors = np.eye(96) + 25.0
    noise = np.random.default_rng(2).normal(size=96)

    def found(self, value):
        return patches_beside(value, self.errors, np.ones(96), self.place.astype(float), 0.01)

    def test_a_neighbourhood_that_steps_from_all_others_is_found(self):
        """Nine cells by 2.5 of their own: 7.5 together, and 0.5 of what each has in all."""
        step = -2.5 * (np.abs(self.place - [5, 4]).max(axis=1) <= 1)
        (found,) = self.found(self.noise + step + 2.0)
        assert found.z < -5.0 and np.isin(53, found.cells)

    def test_that_all_float_is_no_step(self):
        assert not self.found(self.noise + 10.0)


def test_a_point_in_a_patch_that_moved_that_way_moved():
    """Whatever effects there are: the patch moved beside all of them; not another way."""
    cores = upright(np.column_stack([np.arange(0.0, 40.0, 2.0), np.zeros(20)]))
    xyz = np.array([[10.0, 1.0, 0.0], [12.0, 0.0, 0.0], [90.0, 0.0, 0.0], [14.0, 0.0, 0.0]])
    shift = np.outer([-0.04, 0.04, -0.04, -0.04], [0.0, 0.0, 1.0])
    none, undecided = np.zeros(4, dtype=bool), np.array([True, True, True, False])
    points = PointChanges(
        np.array(list("abcd")), xyz, shift, 1e-4 * np.eye(12), none, np.full(4, 1e-4), none,
        None, None, undecided=undecided,
    )  # fmt: skip
    patch = PatchChange(np.arange(20), -0.05, 0.01, 10.0, 0.0, 80.0, 0.001, np.full(20, 0.05))
    found = points.within([patch], SimpleNamespace(cores=cores))
    np.testing.assert_array_equal(found.moved, [True, False, False, False])
    np.testing.assert_array_equal(found.undecided, [False, True, True, False])


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("water 0.4 m lower", "its points share one height, level within"),
        ("mark M3 6 px off", "Point M3 sank by"),
    ],
)
def test_what_is_no_ground_is_said_in_the_first_sentence(kind, words):
    found = corridor.change(*two_dates.pair(kind, 5002), camera=False)
    first, *more = verdict_sentence(found).split(". ")
    assert found.verdict == "nothing" and first.startswith("No change of the ground is significant")
    assert words in ". ".join(more)
    # Of its first patch; the rim of it is another one.
    assert " ".join(str(found).split()).count(" ".join(found.final.apart[0].split())) == 1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_bowl_is_found_where_effects_of_the_camera_could_shift_all_of_a_date(seed):
    """30 mm deep, and 30 m wide: it lies below the surface around it. Without it nothing moved."""
    plan = corridor.simulation.read_plan(SHIPPED)
    plan = replace(plan, tie_points=corridor.simulation.TiePoints(90))
    noise = replace(plan.noise, gnss_m=(0.005, 0.005, 0.008), control_m=0.002)
    dike = corridor.simulation.perfect_block(plan, 0)
    dike.sigma |= {"gnss_m": np.array(noise.gnss_m), "control_m": np.full(3, noise.control_m)}
    middle = np.median(dike.points[["x", "y"]].to_numpy(float), axis=0)
    bowl = corridor.change.Settlement(tuple(middle), radius=15.0, depth=0.03, edge=0.6)
    sunk = corridor.change.moved_ground(dike, bowl)

    def compared(ground):
        dates = [
            corridor.simulation.add_noise(one, **asdict(noise), seed=50 + 2 * seed + n)
            for n, one in enumerate((dike, ground))
        ]
        model = corridor.Model(camera="fixed", lever_arm="fixed")
        return corridor.change(*dates, model=model, same_ties=True, spacing=5.0)

    found = compared(sunk)
    assert found.verdict == "moved"
    (patch,) = found.final.patches
    true = patch.weight @ bowl(found.surface.cores.xyz)[:, 2]
    # A cylinder of 9 m takes the mean, of a bowl whose floor is narrower than that.
    assert 1.25 * true < patch.change < 0.5 * true
    assert compared(dike).verdict == "nothing"


class TestAlone:
    """Five points 10 m apart, known to 10 mm; no patch of the surface moved."""

    def found(self, shift, surveyed=None):
        xyz = np.column_stack([10.0 * np.arange(5), np.zeros((5, 2))])
        moved = np.any(np.asarray(shift) != 0.0, axis=1)
        points = PointChanges(
            np.array(list("abcde")), xyz, np.array(shift), 1e-4 * np.eye(15), ~moved & False,
            np.where(moved, 1e-9, 0.5), moved, None, None, undecided=~moved & False,
        )  # fmt: skip
        return points.within([], None, surveyed or {})

    still, aside, down = [0.0, 0.0, 0.0], [0.5, 0.2, 0.0], [0.1, 0.0, -0.3]

    def test_a_mark_that_nothing_else_follows_did_not_move_for_sure(self):
        found = self.found([self.still, self.aside, self.still, self.still, self.still])
        assert not found.moved.any() and list(np.flatnonzero(found.undecided)) == [1]
        assert found.alone[1] and not found.stable[1]

    def test_two_with_each_others_name_did_not_either(self):
        other = [-v for v in self.aside]
        found = self.found([self.still, self.aside, other, self.still, self.still])
        assert not found.moved.any() and found.alone.sum() == 2

    def test_two_that_go_the_same_way_did(self):
        lower = [0.05, -0.03, -0.1]
        found = self.found([self.still, self.down, lower, self.still, self.still])
        assert list(np.flatnonzero(found.moved)) == [1, 2] and not found.alone.any()

    def test_one_that_was_surveyed_there_did(self):
        shifts = [self.still, self.down, self.still, self.still, self.still]
        assert self.found(shifts, {"b": np.array([0.09, 0.01, -0.29])}).moved[1]
        assert not self.found(shifts, {"b": np.array([-0.1, 0.0, 0.0])}).moved[1]


def test_of_a_mark_alone_it_is_said_that_it_may_be_the_mark():
    """Measured on another target 0.6 m aside, on level ground; of the surface nothing follows."""
    first, second = two_dates.pair("mark M3 6 px off", 5002, images=6, count=400)
    own = second.marks["point"] == "M2"
    second.marks.loc[own, ["x", "y"]] += [30.0, 10.0]
    found = corridor.change(first, second, surface=False, camera=False)
    said = verdict_sentence(found)
    assert found.verdict == "undecided" and said.startswith("Ground and mark cannot be told apart")
    assert "same mark" in " ".join(str(found).split())
