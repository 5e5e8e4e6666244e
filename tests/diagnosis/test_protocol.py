"""Flights are left out as wholes, numbers are chosen without them, and new ones join a folder."""

import json

import numpy as np
import pytest

from benchmarks.diagnosis import protocol
from benchmarks.diagnosis.nulls import figures, resampled
from benchmarks.guarantees import sizes
from benchmarks.ladder import Dirt, made
from corridor import adjust
from corridor.core.errors import InputError
from corridor.diagnosis.settings import Settings

RIGHT = {"failed": None, "kind": "single", "named": True, "inside": True, "stated": True,
         "wrong": [], "absurd": [], "worse": False, "verdict": "named",
         "effects": [], "unknown": []}  # fmt: skip
WRONG = RIGHT | {"named": False, "inside": False, "wrong": ["thermal"]}
NULL = RIGHT | {"kind": "null", "stated": False, "named": False, "inside": False}


class TestFlights:
    def test_a_flight_joins_by_a_folder_with_a_truth_file(self, tmp_path):
        block = made(12, 0, Dirt(strips=2)).block
        for name, truth in (
            ("river/part1", {"effects": []}),
            ("river/part2", {"effects": []}),
            ("alone", {"effects": [{"slug": "rolling_shutter"}], "flight": "dike"}),
        ):
            block.write(tmp_path / name)
            (tmp_path / f"{name}.truth.json").write_text(json.dumps(truth), encoding="utf-8")
        block.write(tmp_path / "river/without_truth")
        found = {one.name: one.flight for one in protocol.flights_of(tmp_path)}
        assert found == {"river-part1": "river", "river-part2": "river", "alone": "dike"}

    def test_a_folder_without_truth_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="no block NAME"):
            protocol.flights_of(tmp_path)


class TestLeftOut:
    def test_a_flight_is_judged_with_what_is_best_on_the_others(self):
        """Each flight likes another value: judged on itself, both would be right."""
        rows = {
            "a1": {"default": WRONG, "x=1": RIGHT, "x=2": WRONG},
            "b1": {"default": WRONG, "x=1": WRONG, "x=2": RIGHT},
        }
        found = protocol.left_out(rows, {"a1": "a", "b1": "b"})
        assert {flight: best for flight, (best, _) in found.items()} == {"a": "x=2", "b": "x=1"}
        assert all(row["wrong"] for _, mine in found.values() for row in mine.values())

    def test_parts_of_one_flight_go_together(self):
        rows = {
            "a1": {"default": WRONG, "x=1": RIGHT},
            "a2": {"default": WRONG, "x=1": RIGHT},
            "b1": {"default": NULL, "x=1": WRONG | {"kind": "null"}},
        }
        found = protocol.left_out(rows, {"a1": "a", "a2": "a", "b1": "b"})
        assert found["a"][0] == "default" and set(found["a"][1]) == {"a1", "a2"}

    def test_one_flight_alone_is_judged_as_it_is(self):
        rows = {"a1": {"default": WRONG, "x=1": RIGHT}}
        assert protocol.left_out(rows, {"a1": "a"})["a"][0] == "default"

    def test_a_false_name_costs_what_a_right_one_brings(self):
        assert protocol.score(RIGHT) == 1.0 and protocol.score(NULL) == 1.0
        assert protocol.score(WRONG) == -1.0
        assert protocol.score(RIGHT | {"named": False}) == 0.5


class TestSensitivity:
    def test_every_number_is_halved_and_doubled_and_nothing_else_moves(self):
        every = protocol.halved_and_doubled()
        usual = Settings()
        for name, other in every.items():
            moved = [f for f in vars(usual) if getattr(usual, f) != getattr(other, f)]
            assert moved == ([] if name == "default" else [name.partition(" x ")[0]])

    def test_chances_stay_chances_and_counts_stay_counts(self):
        every = protocol.halved_and_doubled(["control_level", "most_groups", "cost_ratio"])
        assert every["most_groups x 2"].most_groups == 2 * Settings().most_groups
        assert isinstance(every["most_groups x 0.5"].most_groups, int)
        assert 0.97 < every["cost_ratio x 2"].cost_ratio < 1.0

    def test_a_name_that_is_no_setting_is_refused(self):
        with pytest.raises(InputError, match="no speed"):
            protocol.halved_and_doubled(["speed"])

    def test_answers_that_change_are_counted(self):
        rows = {"a": {"default": RIGHT, "x x 2": WRONG | {"verdict": "unknown"}},
                "b": {"default": RIGHT, "x x 2": RIGHT}}  # fmt: skip
        found = protocol.sensitivity(rows)["x x 2"]
        assert found == {"blocks": 2, "changed": 1, "score": -1.0}
        assert "| `x x 2` | 1 of 2 | -1.00 |" in sizes.matters({"x x 2": found})


@pytest.fixture(scope="module")
def pair():
    block = made(24, 5, Dirt(strips=2, control=4)).block
    adjustment = adjust(block, loss="cauchy:2")
    return adjustment, resampled(adjustment, 0)


class TestNulls:
    def test_every_observation_moves_and_none_is_lost(self, pair):
        adjustment, drawn = pair
        before, after = (b.tie_points[["x", "y"]].to_numpy() for b in (adjustment.block, drawn))
        assert before.shape == after.shape
        assert (np.abs(before - after).max(axis=1) > 0).mean() > 0.95

    def test_the_residuals_are_those_of_the_flight(self, pair):
        """As large, with their tails; the truth is what was modelled."""
        adjustment, drawn = pair
        again = adjust(drawn, loss="cauchy:2")
        sizes_of = [
            np.median(np.abs(one.system.residuals().pixels), axis=0) for one in (adjustment, again)
        ]
        assert sizes_of[1] == pytest.approx(sizes_of[0], rel=0.15)

    def test_the_test_of_uniform_answers_is_told(self):
        rng = np.random.default_rng(0)
        rows = {f"sim45_{n}": {"p": p, "halves": p} for n, p in enumerate(rng.random(50))}
        rows |= {f"pair_{n}": {"p": 0.001, "halves": None} for n in range(20)}
        found = figures(rows)
        assert found["simulated, p"]["ks"] > 0.01 > found["real, p"]["ks"]
        assert found["real, halves"] == {"count": 0}
