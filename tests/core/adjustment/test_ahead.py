"""What a second process compiles while the first compiles other things."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from machine_code import copy_kept

from corridor.core.adjustment.precompiling import precompiled_aside
from corridor.core.engine import compiled

FIRST = """
import json, sys
import numpy as np
from strips import corridor_block
import corridor
from corridor.core.engine import compiled
from corridor.core.adjustment import precompiling as ahead
if {dies}:
    start = ahead.meanwhile
    ahead.meanwhile = lambda code: start("raise SystemExit(3)")
block = corridor_block(images=6, strips=2, observations_per_image=20, seed=1)
with ahead.precompiled_aside():
    begun = compiled._Helper.process is not None
    found = corridor.adjust(block)
    sigma = found.point_sigma.sum()
print(json.dumps([begun, compiled._Helper.process is None, found.cost, float(sigma)]))
"""


def adjusted(cache, dies=False):
    """What a process with its own cache says: began a second one, ended it, cost, sum of sigmas."""
    tests = Path(__file__).resolve().parents[2]
    path = os.pathsep.join([str(tests), str(tests.parent)])
    done = subprocess.run(
        [sys.executable, "-c", FIRST.format(dies=dies)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": path},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_a_second_process_compiles_once_and_the_numbers_are_those_of_one_that_died(tmp_path):
    caching = pytest.importorskip("numba.core.caching")
    named = caching.UserProvidedCacheLocator.get_suitable_cache_subpath
    # The longest of the late kernels, and one that is compiled meanwhile: all would take minutes.
    copy_kept(
        lambda folder: tmp_path / "cache" / named(str(folder / "any.py")),
        but=("point_covariance.", "rows.pass_points"),
    )
    first = adjusted(tmp_path / "cache")
    again = adjusted(tmp_path / "cache")
    late = list((tmp_path / "cache").rglob("*point_covariance*"))
    assert late
    for file in late:
        file.unlink()
    alone = adjusted(tmp_path / "cache", dies=True)
    # Compiled once, none is started.
    assert (first[0], again[0], alone[0]) == (True, False, True)
    assert first[1] and again[1] and alone[1]
    assert first[2:] == again[2:] == alone[2:]


def test_where_all_is_compiled_no_process_is_started(monkeypatch):
    monkeypatch.setattr("corridor.core.engine.panels.is_kept", lambda kernel: True)
    with precompiled_aside():
        assert compiled._Helper.process is None


def test_a_process_that_is_at_a_kernel_is_ended_when_it_is_no_longer_needed():
    with compiled.meanwhile("import time; time.sleep(600)"):
        process = compiled._Helper.process
        if process is None:
            pytest.skip("one core")
        assert process.poll() is None
    assert process.poll() is not None and compiled._Helper.process is None


def test_a_kernel_that_a_process_never_leaves_is_compiled_here(monkeypatch):
    """The one that waits looks again until its patience ends, and ends what it waited for."""
    monkeypatch.setattr(compiled, "PATIENCE_S", 0.1)
    asked = []
    load = compiled._patient(lambda signature, context: asked.append(signature))
    with compiled.meanwhile("import time; time.sleep(600)"):
        assert load("types", None) is None
        assert compiled._Helper.process is None
    assert len(asked) > 1
