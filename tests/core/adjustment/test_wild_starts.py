"""Start poses that are wild: what lies far from them is not what is wrong."""

from pathlib import Path

import numpy as np
import pytest

import corridor

DIKE = Path(__file__).parents[3] / "data_synthetic" / "dike"
QUATERNION = ["qw", "qx", "qy", "qz"]
WILD = {
    "300 m away": lambda rows: rows.assign(x=rows["x"] + 300.0),
    "at the origin": lambda rows: rows.assign(x=0.0, y=0.0, z=0.0),
    "quaternions backwards": lambda rows: rows.assign(
        **dict(zip(QUATERNION, rows[QUATERNION[::-1]].to_numpy().T, strict=True))
    ),
}


@pytest.fixture(scope="module")
def block():
    whole = corridor.read(DIKE)
    return whole.select(images=whole.images["image"].astype(str)[:12])


def with_wild(block, mistake):
    images = block.images.copy()
    rows = images.index[[4, 10]]
    images.loc[rows] = WILD[mistake](images.loc[rows])
    return block.with_(images=images)


@pytest.mark.slow
@pytest.mark.parametrize("mistake", WILD)
def test_measurements_that_wild_start_poses_contradict_are_kept(block, mistake):
    """Two right GNSS positions, or a check point, were set aside and named in their place."""
    sound, found = corridor.adjust(block), corridor.adjust(with_wild(block, mistake))
    off = found.block.images[["x", "y", "z"]] - sound.block.images[["x", "y", "z"]]
    assert np.abs(off.to_numpy()).max() < 1e-4
    assert len(found.residuals["gnss"]) == 12
    assert len(found.check_points) == len(sound.check_points)
    assert [note for note in found.warnings if "Start poses of images.csv are off" in note]
    assert not [note for note in found.warnings if "set aside" in note]


@pytest.mark.slow
def test_a_position_that_is_wild_itself_is_set_aside(block):
    gnss = block.gnss.copy()
    gnss.loc[gnss.index[3], "x"] += 1e4
    found = corridor.adjust(block.with_(gnss=gnss))
    assert len(found.residuals["gnss"]) == 11
    (told,) = [note for note in found.warnings if "set aside" in note]
    assert "gnss.csv, row" in told
