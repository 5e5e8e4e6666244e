"""Sound inputs, in which then one thing is wrong."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from strips import corridor_block

from corridor.core.simulation import add_noise

SHIPPED = Path(__file__).parents[2] / "data_synthetic"


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    """A small block in which nothing is wrong."""
    block = corridor_block(
        images=15, strips=3, flights=2, observations_per_image=60, control=5, check=2, seed=4,
        azimuth_deg=60.0, start_error=(0.3, 0.004, 0.5),
    )  # fmt: skip
    block.lever_arm = {}
    path = tmp_path_factory.mktemp("sound") / "dike"
    noise = dict(tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01)
    add_noise(block, **noise, seed=4).write(path)
    return path


@pytest.fixture
def folder(sound, tmp_path):
    """A copy of it, to be spoilt."""
    return shutil.copytree(sound, tmp_path / "dike")


@pytest.fixture
def places(sound, tmp_path):
    """What words of a command stand for; see `typed`."""
    for name in ("FULL", "EMPTY"):
        (tmp_path / name).mkdir()
    (tmp_path / "FULL" / "mine.txt").write_text("mine")
    (tmp_path / "TEXT").write_text("hello\n")
    cv2.imwrite(str(tmp_path / "PICTURE.png"), np.full((120, 160), 128, np.uint8))
    plan = (
        Path(__file__).parents[2]
        / "corridor"
        / "core"
        / "simulation"
        / "plans"
        / "thesis_50vt.toml"
    )
    here = {name: tmp_path / name for name in ("FULL", "EMPTY", "TEXT", "NOWHERE", "OUT")}
    return here | {
        "BLOCK": sound,
        "PICTURE": tmp_path / "PICTURE.png",
        "PLAN": plan,
        "TRACK": SHIPPED / "dike_track.csv",
    }
