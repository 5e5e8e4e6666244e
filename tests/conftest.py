"""What several rooms' tests share."""

import gc
import os
import re
import sys
from contextlib import suppress
from pathlib import Path

import pytest

# Matrices of tests are small and many: threads of BLAS wait for each other, for ten times the
# time, and two workers have two cores. The variables are for programs that tests start.
os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))
with suppress(ImportError):
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


# With CORRIDOR_ALONE=1 there are numpy, scipy, pandas, numba and pytest: what the core needs. Tests
# of what asks for another library are left out, and say so.
AROUND = (
    "PIL", "cv2", "dask", "joblib", "laspy", "matplotlib", "pyarrow", "pycolmap",
    "pyogrio", "pyproj", "rasterio", "threadpoolctl", "tqdm",
)  # fmt: skip
ALONE = os.environ.get("CORRIDOR_ALONE") == "1"
if ALONE:
    sys.modules.update(dict.fromkeys(AROUND))


def _left_out(report, fault: str):
    """The report of what failed for want of a library, as one of what was left out."""
    found = re.search(r"import of (\w+) halted|No module named '(\w+)[.']", fault)
    if ALONE and report.outcome == "failed" and found:
        name = found[1] or found[2]
        report.outcome, report.longrepr = "skipped", ("conftest.py", 1, f"Skipped: needs {name}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    return _left_out(report, str(call.excinfo.value) if call.excinfo else "")


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    report = yield
    return _left_out(report, str(report.longrepr))


# Names of tests that take more than a fifth of a second, beside those that say so themselves: as
# `pytest tests --durations=0 --durations-min=0.2` measures them. They are run with the long ones.
# Where tests start tests by "not slow", CORRIDOR_SECONDS=0 keeps them among those.
SECONDS = set((Path(__file__).parent / "seconds.txt").read_text(encoding="utf-8").splitlines())
if os.environ.get("CORRIDOR_SECONDS") == "0":
    SECONDS = set()
# Names of long tests that are run by night: whole flights, rates of many draws, the longest of
# variants, and what takes longest. Cells of chapters say so themselves, by the tag `night`.
NIGHT = set((Path(__file__).parent / "night.txt").read_text(encoding="utf-8").splitlines())


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Files with long tests, and notebooks, first: two workers end together.

    One file is one worker's. Had a worker its longest file last, the other would wait for it.
    Before all of them one that has the adjustment's kernels compiled, and for as long as that takes
    files that need none of them: begun together, two workers and a notebook would compile the same
    ones, each for itself.
    """
    long = {item.path for item in items if item.get_closest_marker("slow")}
    for item in items:
        tags = getattr(item, "cell", {}).get("metadata", {}).get("tags", [])
        night = item.nodeid in NIGHT or "night" in tags or item.get_closest_marker("night")
        if item.nodeid in SECONDS or night:
            item.add_marker("slow")
        if night:
            item.add_marker("night")
    chapters = {item.path for item in items if item.path.suffix == ".ipynb"}
    # The longest, so that none is left to be the last; and programs of two threads (`test_batch`
    # comes later) beside chapters, which have one.
    early = ("test_flight.py", "test_benchmarks.py", "test_site.py")
    order = {
        "test_truth.py": -4,
        "test_matching_walls.py": -3,
        "test_thermal_commands.py": -2,
        "test_star.py": -1,
        "test_notebooks.py": 0,
        **dict.fromkeys((*early, *(path.name for path in chapters)), 1),
    }
    order = dict.fromkeys((path.name for path in long), 2) | order
    items.sort(key=lambda item: order.get(item.path.name, 3))


# Libraries and tests are there to the end: else the collector of garbage would look through all of
# them again and again, for a tenth of the time of short tests.
gc.disable()


def pytest_collection_finish():
    gc.collect()
    gc.freeze()
    gc.enable()
    gc.set_threshold(50_000, 10, 10)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real measurements, which is not part of the project."""
    named = os.environ.get("CORRIDOR_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(
            "no real data: CORRIDOR_DATA names no folder"
            if named
            else "no real data: put them at ../shared/data or let CORRIDOR_DATA name their folder"
        )
    return folder
