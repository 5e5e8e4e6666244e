"""Rings around a pylon and cameras that stand still: free of error, as large as published."""

import numpy as np
import pytest
from kit.ring import ring_block
from kit.static import static_block

import corridor
from corridor.core.effects import predict
from corridor.core.errors import InputError


@pytest.mark.parametrize("closed", [True, False])
def test_all_rays_of_a_ring_meet(closed):
    block = ring_block(closed=closed)
    block.check()
    seen = predict(block)
    for found, table in ((seen.tie, block.tie_points), (seen.mark, block.marks)):
        assert np.abs(found - table[["x", "y"]].to_numpy()).max() < 1e-9


def test_a_ring_is_that_of_the_thesis():
    """Tables 6.7 and 6.8: 28 pictures, 13 points, 23 to 31 C in 14 min, 0.5 to 1.5 mm a pixel."""
    block = ring_block()
    assert (len(block.images), len(block.ground)) == (28, 13)
    assert block.images["temperature_c"].iloc[[0, -1]].tolist() == pytest.approx([23, 31])
    assert block.images["time_s"].iloc[-1] == 14 * 60
    centre = block.images[["x", "y"]].to_numpy()
    metres = np.linalg.norm(centre, axis=1) - 1.5
    assert (metres / 5489 > 0.0005).all() and (metres / 5489 < 0.0015).all()
    # The last two stand where the first two stood, and look at the same side.
    assert np.linalg.norm(centre[-1] - centre[0]) < 1.0


def test_an_open_ring_shares_no_point_across_its_ends():
    block = ring_block(closed=False)
    names = block.images["image"].tolist()
    ties = block.tie_points
    first = set(ties.loc[ties["image"].isin(names[:4]), "point"])
    last = set(ties.loc[ties["image"].isin(names[-4:]), "point"])
    assert not first & last
    assert {point.removesuffix("+") for point in last} & first


def test_every_target_is_seen_often_enough():
    for seed in range(5):
        block = ring_block(seed=seed)
        assert block.marks.groupby("point", observed=False).size().min() >= 3


def test_a_ring_can_be_adjusted():
    adjusted = corridor.adjust(ring_block(points=400), camera="fraser8", control=[])
    assert adjusted.converged and adjusted.statistics["tie"]["rms"] < 1e-6


def test_a_static_camera_is_that_of_the_thesis():
    """Table 6.6: 263 pictures, 21 points, 30.6 to 45.7 C in 26 min, 1.6 to 4.0 mm a pixel."""
    block = static_block()
    block.check()
    assert (len(block.images), len(block.ground)) == (263, 21)
    assert block.images["temperature_c"].iloc[[0, -1]].tolist() == pytest.approx([30.6, 45.7])
    assert block.images[["x", "y", "z"]].drop_duplicates().shape[0] == 1
    assert np.abs(predict(block).mark - block.marks[["x", "y"]].to_numpy()).max() < 1e-9
    depth = block.ground["y"].to_numpy() / 5489
    assert depth.min() == pytest.approx(0.0016, rel=0.02)
    assert depth.max() == pytest.approx(0.0040, rel=0.02)


@pytest.mark.parametrize("wrong", [{"stations": 3}, {"distance_m": 2.0}])
def test_a_ring_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError, match="stations"):
        ring_block(**wrong)


def test_a_camera_without_points_is_refused():
    with pytest.raises(InputError, match="points"):
        static_block(points=2)
