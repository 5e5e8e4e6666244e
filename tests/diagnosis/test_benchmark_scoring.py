"""Scores of the benchmark, on answers made by hand with figures worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.diagnosis import real_rates
from benchmarks.diagnosis.assess import parameter_errors
from benchmarks.diagnosis.judge import judge
from benchmarks.diagnosis.methods import methods
from benchmarks.diagnosis.promises import promises
from benchmarks.diagnosis.rates import Rate
from benchmarks.diagnosis.summary import confusion, summary
from benchmarks.diagnosis.table import as_text
from benchmarks.diagnosis.truth import Truth, truth_of
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.diagnosis.verification.held_out import closure

SHUTTER = truth_of({"effects": ["rolling_shutter"]})
NOTHING = Truth()


@pytest.fixture(scope="module")
def block():
    """Images from 0 to 100 m and from 0 to 200 s: 15 % are 15 m and 30 s."""
    images = pd.DataFrame(
        {"image": ["a", "b"], "camera": "c", "x": [0.0, 100.0], "y": 0.0, "time_s": [0.0, 200.0]}
    )
    camera = Camera.from_table("c", {"width": 1000, "height": 800, "f": 1000.0})
    return Block(name="made", cameras={"c": camera}, images=images)


def effect(slug, kind="named", alike=(), **more):
    return {
        "slug": slug, "class": kind, "cannot_be_told_apart_from": list(alike), "parameters": []
    } | more  # fmt: skip


def said(*effects, unknown=(), verdict=None, variance=()):
    verdict = verdict or (effects[0]["class"] if effects else "unknown" if unknown else "nothing")
    return {
        "verdict": verdict, "effects": list(effects), "variance": list(variance),
        "unknown": [{"group": "spline", "class": "unknown", "location": w} for w in unknown],
    }  # fmt: skip


class TestRate:
    def test_nine_of_ten_lie_between_60_and_98_per_cent(self):
        """Wilson's centre 1.0921 / 1.3842 = 0.7890, half width 0.1931."""
        assert Rate(9, 10).interval == pytest.approx((0.5958, 0.9821), abs=1e-4)

    def test_none_of_a_hundred_may_still_be_four(self):
        """Upper end z^2 / (n + z^2) = 3.8415 / 103.8415."""
        assert Rate(0, 100).interval == pytest.approx((0.0, 0.03699), abs=1e-5)

    def test_no_block_has_no_share(self):
        assert Rate.of([]).share is None and Rate.of([]).interval == (None, None)


class TestTruth:
    def test_slugs_alone_are_enough(self):
        assert [one.slug for one in SHUTTER.inside] == ["rolling_shutter"]
        assert SHUTTER.kind == "single"

    def test_parameters_come_as_a_table_or_as_a_list(self):
        table = truth_of({"effects": {"rolling_shutter": {"readout": 0.02}}})
        rows = truth_of(
            {"effects": [{"slug": "rolling_shutter",
                          "parameters": [{"name": "readout", "value": 0.02, "unit": "s"}]}]}
        )  # fmt: skip
        assert table.inside == rows.inside
        assert rows.inside[0].values == {("", "readout"): 0.02}

    def test_entries_of_flights_make_one_effect_and_those_of_points_one_each(self):
        drifts = [
            {"slug": "focal_per_flight", "flight": f, "parameters": {"f": v}}
            for f, v in (("F1", 1.0), ("F2", -1.0))
        ]
        blunders = [{"slug": "control_blunder", "point": p} for p in ("P1", "P2")]
        truth = truth_of({"effects": drifts + blunders})
        assert truth.inside[0].values == {("F1", "f"): 1.0, ("F2", "f"): -1.0}
        assert [one.point for one in truth.inside[1:]] == ["P1", "P2"]

    def test_values_of_each_image_are_kept_by_parameter(self):
        entry = {"slug": "rolling_shutter_rotation", "per_image": {"x, y, z": {"a": [1, 2, 3]}}}
        (one,) = truth_of({"effects": [entry]}).inside
        assert one.values == {("a", "x"): 1.0, ("a", "y"): 2.0, ("a", "z"): 3.0}

    def test_what_is_odd_in_a_strangers_truth_is_left_out(self):
        entry = {"slug": "jello", "where": "everywhere", "per_image": {"f": {"a": None, "b": 1}}}
        (one,) = truth_of({"effects": [entry | {"parameters": {"rms": None}}]}).outside
        assert one.values == {("b", "f"): 1.0} and one.where == {}

    def test_what_no_catalogue_names_is_outside(self):
        """`camera_step` is a generic shape of the catalogue, not a physical effect."""
        truth = truth_of({"effects": ["jello", "camera_step"]})
        assert truth.kind == "unknown" and len(truth.outside) == 2

    def test_no_effects_are_a_null_block(self):
        assert truth_of({"effects": []}).kind == "null"

    def test_a_truth_that_does_not_say_is_refused(self):
        with pytest.raises(InputError, match="no key effects"):
            truth_of({"seed": 3}, "A.truth.json")


class TestJudge:
    def test_the_right_name(self, block):
        one = judge(said(effect("rolling_shutter")), SHUTTER, block)
        assert (one.named, one.inside, one.wrong) == (["rolling_shutter"], ["rolling_shutter"], [])
        assert (one.extras, one.score) == (0, 1.0)

    def test_a_set_that_holds_the_truth_is_half_as_good(self, block):
        answer = said(effect("affine_distortion", "ambiguous", ["rolling_shutter"]))
        one = judge(answer, SHUTTER, block)
        assert (one.named, one.inside, one.extras, one.score) == ([], ["rolling_shutter"], 0, 0.5)

    def test_a_wrong_name_costs_more_than_silence(self, block):
        wrong = judge(said(effect("affine_distortion")), SHUTTER, block)
        silent = judge(said(), SHUTTER, block)
        assert (wrong.wrong, wrong.extras, wrong.score) == (["affine_distortion"], 1, -1.0)
        assert (silent.detected, silent.score) == (False, 0.0)

    def test_a_wrong_name_beside_the_right_one_takes_it_back(self, block):
        one = judge(said(effect("rolling_shutter"), effect("focal")), SHUTTER, block)
        assert (one.named, one.wrong, one.score) == (["rolling_shutter"], ["focal"], 0.0)

    def test_what_is_suspected_is_not_stated(self, block):
        one = judge(said(effect("focal", "suspected")), NOTHING, block)
        assert one.suspected and not one.detected and one.score == 1.0

    def test_a_null_block_that_is_accused_scores_less_than_nothing(self, block):
        assert judge(said(effect("focal")), NOTHING, block).score == -1.0

    def test_the_wrong_control_point_is_a_wrong_name(self, block):
        truth = truth_of({"effects": [{"slug": "control_blunder", "point": "P1"}]})
        assert judge(said(effect("control_blunder", point="P1")), truth, block).wrong == []
        assert judge(said(effect("control_blunder", point="P2")), truth, block).wrong

    def test_flights_of_one_effect_are_one_extra(self, block):
        twice = [effect("focal_per_flight", flight=f) for f in ("F1", "F2")]
        assert judge(said(*twice), SHUTTER, block).extras == 1

    def test_of_two_effects_each_counts_half(self, block):
        truth = truth_of({"effects": ["rolling_shutter", "focal"]})
        one = judge(said(effect("focal")), truth, block)
        assert (one.inside, one.score) == (["focal"], 0.5)

    @pytest.mark.parametrize(
        ("true", "found", "near"),
        [
            ({"image": [0, 0, 100, 100]}, {"image": [60, 60, 300, 300]}, False),
            ({"image": [0, 0, 100, 100]}, {"image": [40, 40, 120, 120]}, True),
            ({"image": [200, 200, 220, 220]}, {"image": [0, 0, 800, 800]}, True),
            ({"x": 50.0, "y": 0.0}, {"x": 50.0, "y": 14.0}, True),
            ({"x": 50.0, "y": 0.0}, {"x": 50.0, "y": 16.0}, False),
            ({"time_s": 100.0, "flight": "1"}, {"time_s": 129.0}, True),
            ({"time_s": 100.0, "flight": "1"}, {"time_s": 131.0}, False),
            ({"row": "all"}, {"row": "all"}, True),
            ({"row": "all"}, {"image": [0, 0, 10, 10]}, False),
            ({}, {"time_s": 3.0}, None),
            ({"image": "DSC_0017"}, {"image": [0, 0, 10, 10]}, None),
        ],
    )
    def test_an_unknown_has_to_be_at_its_place(self, block, true, found, near):
        truth = truth_of({"effects": [{"slug": "ghost", "where": true}]})
        one = judge(said(unknown=[found]), truth, block)
        assert one.unknown and one.place is near and one.extras == 0

    def test_an_unknown_beside_the_catalogues_effect_is_an_extra(self, block):
        answer = said(effect("rolling_shutter"), unknown=[{}], verdict="named")
        assert judge(answer, SHUTTER, block).extras == 1

    def test_a_variance_alarm_tells_of_an_unknown(self, block):
        truth = truth_of({"effects": ["jello"]})
        one = judge(said(variance=[{"quantity": "row"}]), truth, block)
        assert one.detected and one.unknown

    def test_an_alarm_has_its_place_too(self, block):
        truth = truth_of({"effects": [{"slug": "ghost", "where": {"image": [0, 0, 900, 900]}}]})
        near, far = {"image": [300, 300, 500, 500]}, {"image": [2000, 0, 2500, 500]}
        for location, right in ((near, True), (far, False)):
            alarm = {"quantity": "wrong matches", "location": location}
            assert judge(said(variance=[alarm]), truth, block).place is right


def test_errors_of_parameters_in_sigmas_by_flight():
    truth = truth_of(
        {"effects": [{"slug": "focal_per_flight", "flight": "F2", "parameters": {"f": -1.0}}]}
    )
    estimate = {"name": "f", "value": -1.6, "sigma": 0.3, "unit": "px"}
    answer = said(effect("focal_per_flight", flight="F2", parameters=[estimate]),
                  effect("focal_per_flight", flight="F1", parameters=[estimate]))  # fmt: skip
    (one,) = parameter_errors(answer, truth)
    assert one["sigmas"] == pytest.approx(-2.0)


def test_closure_is_of_variances_above_the_floor():
    """(25 - 10) / (25 - 9)."""
    assert closure(5.0, np.sqrt(10.0), 3.0) == pytest.approx(15 / 16)
    assert closure(3.0, 2.0, 3.0) is None


def row(hidden, answer, kind="single", ratio=20.0, separable=True, **more):
    """A row as `assess` makes it, of an answer `named:slug`, `nothing` or `failed`."""
    verdict, _, slug = answer.partition(":")
    right = slug == hidden
    effects = [effect(slug, verdict)] if slug else []
    signals = {
        hidden: {"ratio": ratio, "apart": ratio, "separable": separable, "alike": not separable}
    }
    return {
        "name": f"{hidden}-{answer}", "kind": kind, "hidden": hidden, "verdict": verdict,
        "failed": "it broke" if answer == "failed" else None, "detected": bool(slug),
        "suspected": False, "named": [slug] * (right and verdict == "named"),
        "inside": [slug] * right, "wrong": [slug] * (verdict == "named" and not right),
        "ambiguous": verdict == "ambiguous", "extras": 0, "unknown": False, "place": None,
        "said": {"effects": effects}, "signals": {} if kind == "null" else signals,
    } | more  # fmt: skip


def test_the_confusion_matrix_has_the_hidden_down_and_the_answers_across():
    rows = [
        row("nothing", "nothing", "null"), row("nothing", "named:focal", "null"),
        row("focal", "named:focal"), row("focal", "named:thermal"), row("thermal", "failed"),
        row("focal+thermal", "named:focal", "together"),
    ]  # fmt: skip
    found = confusion(rows)
    assert found["hidden"] == ["nothing", "focal", "thermal"]
    assert found["answers"] == ["focal", "thermal", "nothing", "failed"]
    assert found["counts"] == [[1, 0, 1, 0], [1, 1, 0, 0], [0, 0, 0, 1]]


def test_promises_are_of_separable_blocks_of_their_ratio():
    """Of ratio 8: two of three named; the look-alike and the weak one count elsewhere."""
    rows = [
        row("focal", "named:focal"), row("thermal", "named:thermal"),
        row("clock_offset", "named:focal"), row("lever_arm", "nothing", ratio=7.0),
        row("gnss_bias", "ambiguous:gnss_bias", separable=False),
    ]  # fmt: skip
    found = summary(rows)
    eight = found["single_8"]
    assert (eight["named"]["hits"], eight["named"]["count"]) == (2, 3)
    assert (eight["detected"]["hits"], eight["wrong"]["hits"]) == (3, 1)
    assert (found["single_6"]["detected"]["hits"], found["single_6"]["detected"]["count"]) == (0, 1)
    assert found["lookalike"]["inside"]["share"] == 1.0
    assert found["lookalike"]["one_name"]["share"] == 0.0
    kept = {one.name: one.holds for one in promises(found)}
    assert kept["ratio 8 and more: detected"] is True
    assert kept["ratio 8 and more: named"] is False
    assert kept["two at once: both found"] is None
    assert "NOT" in as_text(found)


def test_errors_and_gaps_are_counted_over_the_blocks_that_have_them():
    """Errors of -1 and 1 sigma: std sqrt(2). Readouts 1 ms and 1.1 ms off 20 ms."""

    def estimate(error, sigmas):
        return {"slug": "rolling_shutter", "class": "named", "name": "readout", "true": 0.02,
                "value": 0.02 + error, "sigma": 1e-4, "sigmas": sigmas}  # fmt: skip

    rows = [
        row("rolling_shutter", "named:rolling_shutter", parameters=[estimate(0.00099, 1.0)],
            excess=3.0, closure=0.99, after_over_twin=1.3),
        row("rolling_shutter", "named:rolling_shutter", parameters=[estimate(-0.0011, -1.0)],
            excess=2.5, closure=0.97, after_over_twin=1.2),
        row("focal", "named:focal", excess=1.9, closure=0.1, after_over_twin=1.0),
    ]  # fmt: skip
    rows[0] |= {"check_known": 0.004, "closure_known": 0.985, "known_over_twin": 1.2}
    rows[1] |= {"check_known": 0.005, "closure_known": 0.97, "known_over_twin": 1.3}
    found = summary(rows)
    assert found["parameters"]["std"] == pytest.approx(np.sqrt(2))
    assert found["parameters"]["readout"]["share"] == 0.5
    assert (found["gap"]["blocks"], found["gap"]["closed"]["share"]) == (2, 0.5)
    assert found["gap"]["near_twin"]["share"] == 0.5
    # Told what is hidden, an adjustment closes the first, as the diagnosis does, and comes nearer.
    told = {k: (v["hits"], v["count"]) for k, v in found["gap"].items() if "known" in k}
    assert told["closed_known"] == (1, 2) and told["closed_of_known"] == (1, 1)
    assert told["near_twin_known"] == (1, 2) and told["near_twin_of_known"] == (0, 1)
    limits = [one for one in promises(found) if one.wanted == "the limit"]
    assert [(one.found, one.holds) for one in limits] == [(0.5, None)] * 2


class TestMethods:
    def rows(self):
        best = {"focal": 9.0, "thermal": 5.0}
        other = {"focal": 5.0, "thermal": 8.0}
        every = {"correlation": best, "t_test": other, "check_points": {}}
        close = {"focal": 30.0, "thermal": 33.0}
        return [row("focal", "named:focal", baselines=every | {"bic": close})]

    def nulls(self, *largest, accused=0):
        return [
            row("nothing", "named:focal" if k < accused else "nothing", "null",
                baselines=dict.fromkeys(("correlation", "bic", "t_test", "check_points"), {"x": v}))
            for k, v in enumerate(largest)
        ]  # fmt: skip

    def test_limits_are_such_that_all_accuse_as_many_null_blocks(self):
        nulls = self.nulls(1.0, 7.0, 8.5, 3.0, accused=1)
        found = methods(self.rows(), nulls)
        assert {one["false_alarms"]["hits"] for one in found.values()} == {1}
        assert found["correlation"]["limit"] == 7.0

    def test_without_false_alarms_the_limit_is_the_largest_of_all(self):
        found = methods(self.rows(), self.nulls(1.0, 8.5))
        assert found["correlation"]["named"]["share"] == 1.0
        assert found["t_test"]["detected"]["share"] == 0.0  # 8.0 is below 8.5

    def test_a_wrong_first_beyond_the_limit_is_a_wrong_name(self):
        found = methods(self.rows(), self.nulls(1.0))
        assert found["t_test"]["wrong"]["share"] == 1.0 and found["t_test"]["score"] == -1.0

    def test_two_models_within_six_of_bic_cannot_be_told_apart(self):
        found = methods(self.rows(), self.nulls(1.0))
        assert found["bic"]["alike"]["share"] == 1.0 and found["bic"]["score"] == 0.5


def test_to_take_out_what_was_put_in_is_no_harm_to_check_points():
    """It had made good, by chance, what the untouched part is off by; beyond that it is harm."""

    def row(before, after):
        return {
            "failed": None, "kind": "single", "hidden": "clock_offset", "named": True,
            "right_value": True, "inside": True, "wrong": [], "stated": True, "absurd": [],
            "worse": after > real_rates.WORSE * before, "sure": [], "signals": {}, "errors": [],
            "effects": [], "check": {"before": before, "after": after},
        }  # fmt: skip

    rows = {
        "west_untouched": row(0.055, 0.055) | {"kind": "null"},
        "west_clock_offset_20": row(0.046, 0.055),
        "west_lever_arm_10": row(0.055, 0.100),
        "east_lever_arm_10": row(0.055, 0.100),
    }
    told = real_rates.rates(rows)
    assert told["check points worse by a tenth"].startswith("75")
    assert told["check points worse by a tenth, than in the untouched part too"].startswith("50")


@pytest.mark.parametrize(
    ("error", "crash"), [(ZeroDivisionError("x"), True), (InputError("no"), False)]
)
def test_a_crash_is_a_row_and_a_figure(monkeypatch, error, crash):
    def fails(block, settings):
        raise error

    monkeypatch.setattr(real_rates.corridor, "diagnose", fails)
    row = real_rates.row_of(None, SHUTTER)
    told = real_rates.rates({"b": row})
    assert ("(1 of 1;" in told["crashes"]) == crash != ("(1 of 1;" in told["refused in a sentence"])
