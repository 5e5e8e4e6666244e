"""The core with numpy, scipy, pandas and numba alone: other libraries are for what stands around
it, and for tables of millions of rows."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import corridor

ROOT = Path(corridor.__file__).parents[1]
OTHERS = ("PIL", "cv2", "joblib", "matplotlib", "pyarrow", "pyproj", "threadpoolctl", "tqdm")
WITHOUT = f"import sys; sys.modules |= dict.fromkeys({OTHERS!r})\n"
WORK = """
import corridor
block = corridor.read(sys.argv[1])
found = corridor.adjust(block, effects="gnss_bias")
print(repr(found.sigma0), repr(found.parameters["gnss_bias.z"].value))
corridor.simulate("thesis_50vt", seed=1).write(sys.argv[2])
print(len(corridor.read(sys.argv[2]).tie_points), corridor.read(sys.argv[2]).points["x"].sum())
"""


def alone(script: str, *words: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT + script, *words],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_it_reads_adjusts_simulates_and_writes(tmp_path):
    said = alone(WORK, str(ROOT / "data_synthetic" / "dike"), str(tmp_path / "made")).split()
    found = corridor.adjust(ROOT / "data_synthetic" / "dike", effects="gnss_bias")
    ours = corridor.simulate("thesis_50vt", seed=1)
    assert [float(word) for word in said] == pytest.approx(
        [found.sigma0, found.parameters["gnss_bias.z"].value, len(ours.tie_points),
         ours.points["x"].sum()], rel=1e-12
    )  # fmt: skip
    # What was written without Arrow is read with it to the last bit.
    block = corridor.read(tmp_path / "made")
    assert np.array_equal(block.points[["x", "y", "z"]], ours.points[["x", "y", "z"]])
    assert (block.tie_points["point"].astype(str) == ours.tie_points["point"].astype(str)).all()


TABLE = """
from pathlib import Path
from corridor.core.block.reading import read_columns
from corridor.core.block.tables import LAYOUTS
from corridor.core.errors import InputError
try:
    print(read_columns(Path(sys.argv[1]), LAYOUTS["gnss"]).to_csv())
except InputError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "text",
    [
        "image,x,y,z\na, 1.5 ,+2,3e-3\n\nb,4,5,6\n",
        "image,x,y,z,why\na,1,2,3,\nb,4,5,6,\"c, d\"\n",
        "image,x,y,z\na,1,2,3\nb,4,five,6\n",
        "image,x,y,z\na,1,2,inf\n",
        "image,x,y,z\na,1,2,1e999\n",
        "image,x,y,z\na,1,2\n",
        "image,x,y,\na,1,2,3\n",
        "image,x,y,z,\na,1,2,3,4\n",
        "image,x,y,z\n",
        "",
    ],
)  # fmt: skip
def test_its_own_reader_of_tables_says_what_arrows_says(text, tmp_path):
    path = tmp_path / "gnss.csv"
    path.write_text(text)
    script = f"import sys\n{TABLE}"
    with_it = subprocess.run(
        [sys.executable, "-c", script, str(path)], cwd=ROOT, capture_output=True, text=True
    )
    assert alone(TABLE, str(path)) == with_it.stdout != ""


def test_a_parquet_asks_for_the_library(tmp_path):
    path = tmp_path / "gnss.parquet"
    path.write_bytes(b"PAR1")
    assert "gnss.parquet needs pyarrow; install it, or" in alone(TABLE, str(path))
