"""Many flight sets: on one core, on two, on a cluster."""

import pandas as pd
import pytest
from small_plans import LOW_HIGH, NADIR, OBLIQUE, plan_of

from corridor.core.errors import InputError
from corridor.tools.planning import Surveyed, flight_sets, subset, sweep

WHOLE = plan_of(NADIR, OBLIQUE, LOW_HIGH)
POINTS = Surveyed.grid(WHOLE)


class TestFlightSets:
    def test_one_plan_of_three_flights_has_seven(self):
        names = [plan.name for plan in flight_sets([WHOLE])]
        assert names[:3] == ["nadir", "oblique", "low_high"]
        assert names[3:] == [
            "nadir+oblique", "nadir+low_high", "oblique+low_high", "nadir+oblique+low_high",
        ]  # fmt: skip

    def test_several_plans_are_taken_as_they_are(self):
        plans = [subset(WHOLE, ["nadir"]), subset(WHOLE, ["nadir", "oblique"])]
        assert [plan.name for plan in flight_sets(plans)] == ["nadir", "nadir+oblique"]

    def test_several_plans_may_be_combined(self):
        plans = [subset(WHOLE, ["nadir"]), subset(WHOLE, ["nadir", "oblique"])]
        names = [plan.name for plan in flight_sets(plans, combined=True)]
        assert names == ["nadir", "oblique", "nadir+oblique"]

    def test_one_flight_is_one_set(self):
        assert len(flight_sets([plan_of(NADIR)])) == 1

    def test_a_strip_across_keeps_its_own_axis(self):
        across = plan_of(OBLIQUE, axis_m=((0.0, 0.0), (120.0, 0.0)))
        both = flight_sets([plan_of(NADIR), across], combined=True)[-1]
        assert both.flights[1].axis_m == ((0.0, 0.0), (120.0, 0.0))

    def test_more_flights_than_a_picture_holds_are_refused(self):
        from dataclasses import replace

        many = plan_of(*(replace(NADIR, name=f"F{k}") for k in range(6)))
        with pytest.raises(InputError, match="63 combinations"):
            flight_sets([many], combined=True)


@pytest.fixture(scope="module")
def table():
    return sweep(flight_sets([WHOLE]), [0, 1])


def test_every_flight_set_has_a_row_for_each_number_of_points(table):
    assert len(table) == 14
    assert table["control"].tolist() == [0, 1] * 7
    assert table.loc[6, ["flights", "nadir", "oblique"]].tolist() == ["nadir+oblique", 1, 1]


def test_flight_sets_are_compared_at_the_same_points(table):
    """One grid over what all flights cover, wherever each has its lowest pictures."""
    assert table["points"].nunique() == 2


def test_more_flights_are_believed_better(table):
    one = table[table["control"] == 1].set_index("flights")["stated_z"]
    assert one["nadir+oblique+low_high"] < one["nadir+oblique"] < one["nadir"]


def test_the_best_places_are_at_least_as_good_as_spread_ones(table):
    best = sweep([subset(WHOLE, ["nadir"])], [1], place="best", surveyed=POINTS)
    assert best["d3"].iloc[0] <= table.loc[1, "d3"] * (1 + 1e-9)


def test_progress_is_told(table):
    told = []
    sweep(
        flight_sets([plan_of(NADIR)]), [0], progress=lambda step: told.append((step.done, step.of))
    )
    assert told == [(1, 1)]


def test_a_place_that_nobody_knows_is_refused():
    with pytest.raises(InputError, match="spread or best"):
        sweep([WHOLE], [0], place="anywhere")


def test_flight_sets_that_a_table_could_not_tell_apart_are_refused():
    with pytest.raises(InputError, match="two flight sets are called small"):
        sweep([plan_of(NADIR), plan_of(OBLIQUE)], [0])


def test_a_cluster_gives_the_same_numbers(table):
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        found = sweep(
            flight_sets([WHOLE])[:2], [0, 1], cluster=cluster.scheduler_address, surveyed=POINTS
        )
    pd.testing.assert_frame_equal(found, table[:4], rtol=1e-9)


def test_a_cluster_that_does_not_answer_is_said_to():
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        sweep([WHOLE], [0], cluster="nowhere")


@pytest.mark.slow
def test_two_processes_give_the_same_numbers(table):
    pd.testing.assert_frame_equal(
        sweep(flight_sets([WHOLE])[:2], [0, 1], jobs=2, surveyed=POINTS), table[:4]
    )
