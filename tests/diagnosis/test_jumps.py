"""A camera that is refocused between two images of a strip is one change, not many values."""

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.generator.cases import Case
from benchmarks.diagnosis.generator.generate import generate
from corridor.diagnosis.evidence.jumps import jumps


def test_two_jumps_lie_where_the_mean_changes():
    rng, time = np.random.default_rng(0), np.arange(30.0)
    values = rng.normal(0.0, 0.3, (30, 2))
    values[11:19] += 2.0
    assert jumps(values, time) == (10.5, 18.5)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "last"), [(18, 36), (16, 22)], ids=["for good", "and back"])
def test_a_camera_refocused_within_a_strip_has_its_moment(first, last):
    case = Case({}, images=36, strips=3, observations=120, control=6, check=6)
    block = generate(case, 1).block.copy()
    names = block.images["image"].astype(str)
    camera = next(iter(block.cameras.values()))
    middle = np.array([camera.width, camera.height]) / 2.0
    for table in (block.tie_points, block.marks):
        mine = table["image"].astype(str).isin(names[first:last]).to_numpy()
        table.loc[mine, ["x", "y"]] = middle + (table.loc[mine, ["x", "y"]] - middle) * 1.003
    found = corridor.diagnose(block)
    (one,) = found.unknown
    assert one["group"] == "camera_step" and not found.effects
    moments = [block.images["time_s"].iloc[k] for k in (first, last) if k < len(names)]
    assert min(abs(one["location"]["time_s"] - moment) for moment in moments) < 4.0
    # Half of what the camera alone did to the check points is gone.
    gap = found.gap["check_m"]
    assert gap["after"] < 0.9 * gap["before"]
