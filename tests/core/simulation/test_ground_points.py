"""Surveyed points: where they lie, which role they have, and check points taken from tie points."""

import numpy as np
import pytest

import corridor
from corridor.core.errors import InputError
from corridor.core.simulation import Flight, Ground, Plan, add_noise, simulate
from corridor.core.simulation.ground_points import evenly, surveyed

BANK = 12.0


def placed(begin=0.0, end=600.0, seed=0, **ground):
    return surveyed(Ground(**ground), begin, end, BANK, np.random.default_rng(seed))


def test_banks_alternate():
    _, across, _ = placed(control=5, check=6)
    assert np.sign(across).tolist() == [1, -1] * 5 + [1]


def test_a_spread_layout_takes_both_banks_and_the_axis_in_turn():
    _, across, _ = placed(control=10, check=0, layout="spread")
    assert np.sign(across).tolist() == [-1, 1, 0] * 3 + [-1]


@pytest.mark.parametrize("layout", ["alternating", "spread"])
def test_points_on_a_bank_lie_on_the_bank(layout):
    _, across, _ = placed(control=10, check=10, layout=layout)
    away = np.abs(across[across != 0])
    # Nobody finds solid ground at exactly 12 m: up to 15 % nearer.
    assert away.max() <= BANK and away.min() >= 0.85 * BANK


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("every", "count"), [(50.0, 13), (70.0, 9), (5.0, 121), (600.0, 2)])
def test_a_point_every_so_many_metres(every, count, seed):
    """600 m hold floor(600 / every) intervals and one point more than that."""
    station, _, _ = placed(every_m=every, seed=seed)
    assert len(station) == count
    # Shaken by a quarter of the distance at most, so that neighbours stay in order.
    assert np.diff(station).min() >= 0.5 * every and np.diff(station).max() <= 1.5 * every
    left = (600 - (count - 1) * every) / 2
    assert station == pytest.approx(left + every * np.arange(count), abs=0.25 * every)


@pytest.mark.parametrize("count", [2, 11, 200])
def test_a_number_of_points_fills_what_is_flown_in_order(count):
    station, _, _ = placed(begin=100.0, end=700.0, control=count, check=0)
    assert np.all(np.diff(station) > 0)
    assert station[0] == pytest.approx(124, abs=12) and station[-1] == pytest.approx(676, abs=12)


@pytest.mark.parametrize(("control", "check"), [(5, 6), (2, 9), (11, 0), (3, 1)])
def test_control_takes_the_ends_and_the_numbers_are_those_asked_for(control, check):
    _, _, role = placed(control=control, check=check)
    assert (role == "control").sum() == control and (role == "check").sum() == check
    assert role[0] == role[-1] == "control"


def test_control_is_spread_evenly():
    _, _, role = placed(control=5, check=16)
    assert np.diff(np.flatnonzero(role == "control")).tolist() == [5, 5, 5, 5]


def test_without_control_all_points_are_check_points():
    assert set(placed(control=0, check=4)[2]) == {"check"}
    assert set(placed(control=0, check=4, every_m=30.0)[2]) == {"check"}


def test_no_points_are_no_points():
    assert [len(part) for part in placed(control=0, check=0)] == [0, 0, 0]


def test_every_m_keeps_the_share_of_control():
    """5 of 11 are control: of 25 points 11."""
    _, _, role = placed(control=5, check=6, every_m=25.0)
    assert (role == "control").sum() == 11


def test_more_points_than_anybody_surveys_are_refused():
    with pytest.raises(InputError, match="every_m"):
        placed(every_m=1e-6)


# --- check points from tie points ------------------------------------------------------------


@pytest.mark.parametrize("count", [50, 400, 3000])
def test_points_spread_evenly_differ_by_at_most_one_a_cell(count):
    """Crowded on one side: what is taken is even all the same, as long as there are points."""
    draw = np.random.default_rng(1)
    station, across = 300 * draw.random(20_000) ** 2, draw.uniform(-20, 20, 20_000)
    taken = evenly(station, across, count, draw)
    assert len(taken) == count and len(np.unique(taken)) == count
    side = np.sqrt(np.ptp(station) * np.ptp(across) / count)
    cells = np.stack([(x - x.min()) // side for x in (station, across)]).astype(int)
    _, cell = np.unique(cells, axis=1, return_inverse=True)
    there = np.bincount(cell)
    mine = np.bincount(cell[taken], minlength=len(there))
    # A cell that has points left has no fewer than another one but for the last round.
    left = mine < there
    assert left.sum() > 0.9 * len(there)
    assert mine.max() - mine[left].min() <= 1


def test_asking_for_more_than_there_are_takes_all():
    draw = np.random.default_rng(1)
    assert evenly(np.arange(7.0), np.zeros(7), 10, draw).tolist() == list(range(7))


@pytest.fixture(scope="module")
def block():
    flight = Flight("a", 50.0, images=30, speed_m_s=3.0)
    ground = Ground(control=4, check=0, check_from_ties=300, within_m=10.0)
    return simulate(Plan("p", (flight,), ground=ground), seed=2)


def test_check_points_from_ties_are_ground_points_with_the_marks_of_tie_points(block):
    taken = block.ground[block.ground["role"] == "check"]
    assert len(taken) == 300 and taken["point"].str.startswith("C").all()
    rays = block.marks["point"].value_counts()
    assert rays[taken["point"]].min() >= 3
    # They left the tie points.
    assert not set(block.points["point"]) & set(taken["point"])
    tied = {tuple(place) for place in block.truth["points"].values()}
    assert not tied & {tuple(block.truth["ground"][name]) for name in taken["point"]}


def test_what_only_two_images_show_checks_nothing():
    """At an overlap of 60 % half of a strip is seen twice only."""
    flight = Flight("a", 50.0, images=8, strips=1, forward=0.6)
    made = simulate(Plan("p", (flight,), ground=Ground(0, 0, check_from_ties=10**6)), seed=2)
    assert made.tie_points["point"].value_counts().eq(2).sum() > 500
    assert made.marks["point"].value_counts().min() == 3


def test_check_points_lie_within_the_strips_ends_and_near_the_axis(block):
    taken = block.ground[block.ground["role"] == "check"]
    assert taken["x"].abs().max() <= 10
    centre = np.array(list(block.truth["centre"].values()))
    # Stations of a northward axis are y; 0.3 m of jitter at five sigma.
    assert taken["y"].min() >= centre[:, 1].min() - 1.5
    assert taken["y"].max() <= centre[:, 1].max() + 1.5


def test_banks_lie_at_three_tenths_of_the_picture_unless_said_otherwise():
    """0.3 x 5119 / 5489 x 50 = 13.99 m; distortion widens the picture by below 2 %."""
    flight = Flight("a", 50.0, images=30, speed_m_s=3.0)
    away = simulate(Plan("p", (flight,)), seed=2).ground["x"].abs()
    assert 0.85 * 13.99 <= away.min() and away.max() <= 1.02 * 13.99
    away = simulate(Plan("p", (flight,), ground=Ground(offset_m=5.0)), seed=2).ground["x"].abs()
    assert 0.85 * 5 <= away.min() and away.max() <= 5


class TestBars:
    PLAN = Plan(
        "bars", (Flight("a", 50.0, images=20, strips=1, forward=0.8),),
        ground=Ground(0, 2, bars=6, bar_m=3.0),
        gnss=False,
    )  # fmt: skip

    def test_without_noise_they_are_as_long_as_their_points_are_apart(self):
        made = simulate(self.PLAN, seed=1)
        at = {name: np.array(place) for name, place in made.truth["points"].items()}
        table = made.distances
        assert len(table) == 6 and len({*table["from"], *table["to"]}) == 12
        for row in table.itertuples(index=False):
            assert np.linalg.norm(at[row[0]] - at[row[1]]) == pytest.approx(row[2], abs=1e-9)
        assert table["distance"].median() == pytest.approx(3.0, abs=1.0)
        rays = made.tie_points["point"].value_counts()
        assert rays[[*table["from"], *table["to"]]].min() >= 3

    def test_noise_is_as_large_as_asked_and_said_in_the_table(self):
        perfect = simulate(self.PLAN, seed=1).distances
        errors = []
        for seed in range(40):
            noisy = add_noise(simulate(self.PLAN, seed=1), distance_m=0.004, seed=seed)
            assert (noisy.distances["sigma"] == 0.004).all()
            errors += (noisy.distances["distance"] - perfect["distance"]).tolist()
        assert np.std(errors) == pytest.approx(0.004, rel=0.2)

    def test_a_free_network_gets_its_scale_from_them(self):
        noise = {"tie_px": 0.5, "mark_px": 0.5, "distance_m": 0.002}
        made = simulate(self.PLAN, seed=1, noise=noise)
        found = corridor.adjust(made, camera="fixed").distances
        assert len(found) == 6 and found["w"].abs().max() < 4
