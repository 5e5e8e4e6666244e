"""An effect that was found beside another is asked again where that one does not stand."""

from types import SimpleNamespace

import numpy as np
import pytest

from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.findings.findings import Estimate, Findings
from corridor.diagnosis.forward_selection import Round
from corridor.diagnosis.verification.verification import Verification

KEYS = ("shape", "arm", "other")


def verification(used, alone, by_checks=()):
    """Of a round that found a shape and an arm; alone: evidence of the arm without the shape.

    by_checks: what check points told, which that round did not ask.
    """

    def given(chosen, spread=False, only=None):
        there = 9.0 if 0 in chosen or 2 in chosen else alone
        return [SimpleNamespace(evidence=gain, kappa=1.0) for gain in (9.0, there, 9.0)]

    groups = [
        SimpleNamespace(key=key, known=False, effect=SimpleNamespace(place="camera"))
        for key in KEYS
    ]
    evidence = SimpleNamespace(
        number=dict(zip(KEYS, range(3), strict=True)), groups=groups, inflation=np.ones(3),
        given=given, total=lambda _: 0.0, likeliest=lambda *_: 1.0,
    )  # fmt: skip
    found = Found({0: 1.0, 1: 1.0}, {0: 9.0, 1: 9.0}, 0.0)
    last = Round(
        None,
        None,
        None,
        SimpleNamespace(few=True),
        evidence,
        {"named": 4.0},
        found,
        ["shape", "arm"],
    )
    out = Verification.__new__(Verification)
    out._last, out._groups, out.used, out.notes = last, groups, list(used), []
    out._by_checks = set(by_checks)
    out.findings = Findings([Estimate("arm", "named", 9.0, [], key="arm")], [])
    return out


@pytest.mark.parametrize(
    ("used", "alone", "kind"),
    [
        (["arm"], 1.0, "suspected"),
        (["arm"], 8.0, "named"),
        (["shape", "arm"], 1.0, "named"),
        (["other", "arm"], 1.0, "named"),
    ],
    ids=[
        "it spoke beside the shape alone",
        "it speaks alone",
        "both stand",
        "another stands for it",
    ],
)
def test_what_was_found_beside_a_shape_is_asked_without_it(used, alone, kind):
    asked = verification(used, alone)
    asked._drop_lonely()
    assert asked.findings.effects[0].kind == kind
    assert bool(asked.notes) == (kind == "suspected")


def test_what_check_points_told_is_not_asked_of_a_round_without_them():
    """Two blunders that hide each other are found as a third, in place of which they stand."""
    asked = verification(["arm"], 1.0, by_checks=["arm"])
    asked._drop_lonely()
    assert asked.findings.effects[0].kind == "named"
    assert not asked.notes
