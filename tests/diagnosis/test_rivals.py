"""What may stand in the place of a named effect is asked where it has been adjusted itself."""

from types import SimpleNamespace

import pytest
from strips import corridor_block

from corridor.core.effects import add
from corridor.core.simulation import add_noise
from corridor.diagnosis import diagnose
from corridor.diagnosis.evidence.evidence import Gain
from corridor.diagnosis.findings.verdict import near_rivals


def test_a_drift_of_positions_is_not_named_alone_beside_a_camera_that_changes():
    """Both are hidden, and heights alone cannot tell them apart. At the fit with the drift of the
    positions, which fits better, that was beyond doubt; where the camera's is adjusted it is not.
    """
    block = corridor_block(
        images=24, strips=3, observations_per_image=90, control=4, check=0, relief=4.0, seed=1
    )  # fmt: skip
    hidden = {"focal_drift": {"rate": 0.1}, "gnss_drift": {"y": 8e-4}}
    noise = {"tie_px": 0.3, "mark_px": 0.3, "gnss_m": 0.01, "control_m": 0.004}
    block = add_noise(add(block, hidden), **noise, seed=1)
    (found,) = diagnose(block, only=list(hidden)).effects
    assert {found["slug"], *found["cannot_be_told_apart_from"]} == set(hidden)
    assert found["class"] == "ambiguous" and found["separated_by"]


class Sized(SimpleNamespace):
    """A group, of which the length is the number of its parameters."""

    def __len__(self):
        return len(self.labels)


def group(count=2, **changed):
    """One that images share, of so many parameters."""
    known = {"generic": False, "own": None, "single": None, "slug": "its"}
    labels = [("", f"p{k}", "m") for k in range(count)]
    return Sized(**(known | changed), effect=SimpleNamespace(refines=""), labels=labels)


@pytest.mark.parametrize(
    ("other", "gain", "beside", "asked"),
    [
        (group(), Gain(10.0, 1.0, 15.0), 12.0, True),
        (group(), Gain(10.0, 1.0, 9.0), 12.0, False),
        (group(), Gain(3.0, 1.0, 15.0), 12.0, False),
        (group(), Gain(10.0, 1.0, 15.0), 45.0, False),
        (group(9), Gain(10.0, 1.0, 15.0), 12.0, False),
        (group(generic=True), Gain(10.0, 1.0, 15.0), 12.0, False),
        (group(own="its"), Gain(10.0, 1.0, 15.0), 12.0, False),
        (group(single="P1"), Gain(10.0, 1.0, 15.0), 12.0, False),
    ],
    ids=[
        "explains most of the same",
        "explains little of it",
        "would not be named itself",
        "leaves what is beyond doubt",
        "has many more parameters",
        "has no name",
        "has values for each image",
        "is one control point",
    ],
)
def test_a_rival_is_worth_a_fit_where_it(other, gain, beside, asked):
    groups = [group(), other]

    def given(chosen, only=None):
        return [Gain(beside if chosen else 20.0, 1.0, 20.0), gain]

    evidence = SimpleNamespace(groups=groups, given=given)
    one = SimpleNamespace(
        evidence=evidence, found=SimpleNamespace(chosen={0: 1.0}), threshold={"named": 4.0}
    )
    assert near_rivals(one, 0) == ([1] if asked else [])
