"""Real strips flown minutes apart: nothing moved, and what is put in is found.

saraburi/flight2: strips S11 and S13 against S12 and S14, 59 % overlap across, five ground points.
"""

import numpy as np
import pytest

import corridor
from corridor.change import Settlement, moved_ground

pytestmark = pytest.mark.slow


def strips(block, names):
    """The block of some strips: their images, and tie points that two of them still show."""
    part = block.copy()
    kept = set(part.images.loc[part.images["strip"].isin(names), "image"])
    for table in ("images", "tie_points", "marks", "gnss"):
        rows = getattr(part, table)
        setattr(part, table, rows[rows["image"].isin(kept)].reset_index(drop=True))
    count = part.tie_points["point"].map(part.tie_points["point"].value_counts())
    part.tie_points = part.tie_points[count > 1].reset_index(drop=True)
    return part


@pytest.fixture(scope="module")
def dates(real_data):
    block = corridor.read(real_data / "saraburi" / "flight2")
    return strips(block, ["S11", "S13"]), strips(block, ["S12", "S14"])


@pytest.fixture(scope="module")
def adjusted(dates):
    return tuple(corridor.adjust(block) for block in dates)


@pytest.mark.parametrize("same_ties", [True, False])
def test_nothing_moved_in_minutes(adjusted, same_ties):
    found = corridor.change(*adjusted, same_ties=same_ties)
    assert found.verdict == "nothing"
    assert not found.surface.moved.any() and not found.points.moved.any()


@pytest.mark.parametrize("depth", [0.02, 0.05])
def test_a_patch_that_sinks_is_found_in_size_and_place(dates, adjusted, depth):
    """Away from the control that is held: the step of the surface is the one put in."""
    place = (204.5, 152.3)
    truth = adjusted[1].block
    sunk = moved_ground(truth, Settlement(place, 70.0, depth, 0.2), survey=False)
    block = dates[1].copy()
    for table in ("tie_points", "marks"):
        rows = getattr(block, table)
        step = getattr(sunk, table)[["x", "y"]].to_numpy(float)
        step = step - getattr(truth, table)[["x", "y"]].to_numpy(float)
        rows[["x", "y"]] = rows[["x", "y"]].to_numpy(float) + step
    options = {"same_ties": True, "camera": False, "spacing": 9.8}
    before = corridor.change(*adjusted, **options).surface
    after = corridor.change(adjusted[0], corridor.adjust(block), **options).surface
    assert len(before) == len(after)
    away = np.linalg.norm(after.cores.xyz[:, :2] - place, axis=1)
    step = after.distance - before.distance
    inside = away < 56.0 - after.cores.radius
    assert inside.sum() > 10
    # The noise is the same both times: what is left is what the motion does to the camera.
    np.testing.assert_allclose(step[inside], -depth, atol=0.05 * depth)
    assert np.abs(step[away > 70.0 + after.cores.radius]).max() < 0.05 * depth
    assert np.abs(step[inside] + depth).max() < np.median(after.sigma[inside])
