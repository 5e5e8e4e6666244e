"""What is done otherwise from a size on: one register, and the same results at the least sizes.

A branch that only large blocks take is seen by no test of a small one. So every size from which
core does something otherwise stands here with its least value, small blocks are adjusted once with
all of them there, and nothing may change but the last digits. Those of the diagnosis are held in
`corridor.diagnosis.settings` and tried in tests/diagnosis.
"""

import ast
import importlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.simulation import add_noise

CORE = Path(corridor.__file__).parent / "core"
# Module and name -> the least value.
SIZES = {
    # rows, observations or rays that are looked at together
    ("block.writing", "_GROUP"): 5,
    ("adjustment.tables", "_PART"): 7,
    ("adjustment.normal", "CHUNK"): 7,
    # rays of a thread
    ("adjustment.partition", "_LEAST"): 1,
    # columns of a band beyond which LAPACK factors it
    ("engine.panels.triangular", "_WIDE"): 0,
}
# Names under which such sizes are kept; one that is new has to stand in the register.
NAMES = {"_PART", "CHUNK", "_GROUP", "_LEAST", "_WIDE"}


@pytest.fixture
def least(monkeypatch):
    """All sizes at their least."""
    for (module, name), value in SIZES.items():
        monkeypatch.setattr(importlib.import_module(f"corridor.core.{module}"), name, value)


def test_the_register_has_them_all():
    found = set()
    for path in CORE.rglob("*.py"):
        for line in ast.parse(path.read_text(encoding="utf-8")).body:
            for target in getattr(line, "targets", []):
                if getattr(target, "id", "") in NAMES:
                    place = ".".join(path.relative_to(CORE).with_suffix("").parts)
                    found.add((place, target.id))
    assert found == set(SIZES)


@pytest.fixture(scope="module")
def dirty():
    """Two flights without a clean number in them: outliers, rounding, a shutter, no order."""
    made = corridor_block(images=18, strips=3, flights=3, observations_per_image=60, seed=4,
                          start_error=(0.1, 0.002, 0.2))  # fmt: skip
    made = add_noise(
        made, tie_px=0.6, mark_px=0.3, gnss_m=0.03, control_m=0.01, outliers=0.01, rounding_px=0.1,
        seed=4,
    )  # fmt: skip
    random = np.random.default_rng(4)
    for table in ("images", "tie_points", "gnss"):
        frame = getattr(made, table)
        setattr(made, table, frame.iloc[random.permutation(len(frame))].reset_index(drop=True))
    return made


@pytest.mark.parametrize("effects", [(), ("rolling_shutter",), ("focal_drift@flight",)])
def test_an_adjustment_is_the_same_with_all_sizes_at_their_least(dirty, effects, request):
    usual = corridor.adjust(dirty, effects=effects, loss="cauchy")
    request.getfixturevalue("least")
    small = corridor.adjust(dirty, effects=effects, loss="cauchy")
    assert small.sigma0 == pytest.approx(usual.sigma0, rel=1e-9)
    for column, by in zip(("x", "y", "z"), ("sx", "sy", "sz"), strict=True):
        off = small.poses[column].to_numpy() - usual.poses[column].to_numpy()
        # Another order of sums leaves 1e-16 of the normal equations.
        assert np.abs(off / usual.poses[by].to_numpy()).max() < 1e-6
        assert np.allclose(small.poses[by], usual.poses[by], rtol=1e-7)


def test_tables_are_written_and_read_the_same(dirty, least, tmp_path):
    pytest.importorskip("pyarrow")
    dirty.write(tmp_path / "b", form="parquet")
    again = corridor.read(tmp_path / "b")
    for table in ("images", "tie_points", "gnss"):
        old, new = getattr(dirty, table), getattr(again, table)
        pd.testing.assert_frame_equal(
            new.astype(old.dtypes.to_dict()), old, check_categorical=False
        )


def test_what_is_checked_of_rows_is_checked_across_parts(dirty, least, tmp_path):
    """A point that is measured twice in one image, the two rows in different parts."""
    twice = pd.concat([dirty.tie_points, dirty.tie_points.iloc[:1]], ignore_index=True)
    with pytest.raises(corridor.InputError, match=r"tie_points"):
        dirty.with_(tie_points=twice).check()
