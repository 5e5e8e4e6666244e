"""Machine code follows the source of all that it has taken in, and other people's is let be."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import corridor

HEAVY = {"scipy.stats", "scipy.interpolate", "scipy.ndimage", "pyproj", "cv2", "matplotlib"}
PIXEL = """
import numpy as np
from corridor.core.simulation.views import _Pictures, _project
interior = np.zeros((1, 15))
interior[0, 0], interior[0, 7] = 1000.0, 1.0
zero = np.zeros(1, dtype=np.int64)
one = np.eye(3)[None]
pictures = _Pictures(np.zeros((1, 3)), one, zero, interior, 1, np.zeros((1, 2)), 0.0)
seen = _project(np.array([[0.5, 0.0, 1.0]]), zero, zero, pictures)
print(seen[0, 0])
"""


def printed(folder: Path, script: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


def test_a_change_of_the_distortion_reaches_the_kernels_of_other_files(tmp_path):
    """u = 1/2, k1 = 1, f = 1000: 1000 u (1 + u^2) = 625 px; with 1 + 2 u^2 it is 750 px."""
    package = tmp_path / "corridor"
    clean = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(corridor.__file__).parent, package, ignore=clean)
    assert float(printed(tmp_path, PIXEL)) == 625.0
    source = (package / "core" / "camera.py").read_text()
    assert source.count("r2 = u * u + v * v\n    radial = 0.0\n    slope") == 1
    (package / "core" / "camera.py").write_text(
        source.replace("r2 = u * u + v * v\n    radial = 0.0\n    slope",
                       "r2 = 2.0 * (u * u + v * v)\n    radial = 0.0\n    slope")
    )  # fmt: skip
    assert float(printed(tmp_path, PIXEL)) == 750.0


@pytest.fixture(scope="module")
def imported():
    """Whether numba's settings are what they were, and which heavy modules are loaded."""
    script = (
        "import sys, numba; before = numba.config.SLP_VECTORIZE; import corridor.core.adjustment; "
    )
    script += "print(numba.config.SLP_VECTORIZE == before); "
    script += f"print(*({HEAVY!r} & set(sys.modules)))"
    return printed(Path(corridor.__file__).parents[1], script).splitlines()


def test_numbas_settings_stay_as_they_are_for_everyone_else(imported):
    assert imported[0] == "True"


def test_an_adjustment_does_not_wait_for_libraries_that_it_does_not_need(imported):
    assert imported[1:] == []


WITHOUT_A_PLACE = """
import os, stat, tempfile
from pathlib import Path
from numba.core import caching

def nowhere(self):
    raise OSError("read only")

for one in (caching.InTreeCacheLocator, caching.UserWideCacheLocator):
    one.ensure_cache_path = nowhere
tempfile.tempdir = {folder!r}
from corridor.core.engine.compiled import compiled

def twice(x):
    return 2 * x

made = compiled()(twice)
print(made(21))
where = Path({folder!r})
print(*sorted(oct(stat.S_IMODE(p.stat().st_mode)) for p in where.iterdir()) or ["none"])
print(sum(p.suffix == ".nbc" for p in where.rglob("*")))
import numba
print(repr(numba.config.CACHE_DIR))
"""


def without_a_place(folder):
    script = folder.parent / f"{folder.name}.py"  # what is in no file has no cache
    script.write_text(WITHOUT_A_PLACE.format(folder=str(folder)))
    source = f"import runpy; runpy.run_path({str(script)!r})"
    return printed(Path(corridor.__file__).parents[1], source).splitlines()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no users by number")
class TestAReadOnlyInstallationWithoutAHome:
    def test_keeps_its_machine_code_in_a_temporary_folder_of_the_users(self, tmp_path):
        assert without_a_place(tmp_path) == ["42", "0o700", "1", "''"]
        assert without_a_place(tmp_path) == ["42", "0o700", "1", "''"]
        assert len(list(tmp_path.iterdir())) == 1

    def test_does_not_run_what_others_could_have_put_there(self, tmp_path):
        """A folder of that name that others can write to, and a link to another one."""
        taken = tmp_path / f"corridor-{os.getuid()}"
        taken.mkdir()
        taken.chmod(0o777)
        assert without_a_place(tmp_path) == ["42", "0o700 0o777", "1", "''"]
        assert not list(taken.iterdir())

    def test_compiles_each_time_where_nothing_at_all_can_be_written(self, tmp_path):
        script = WITHOUT_A_PLACE.format(folder=str(tmp_path / "missing")).split("where =")[0]
        assert printed(Path(corridor.__file__).parents[1], script) == "42"


KERNEL = """
from corridor.core.engine.compiled import compiled

@compiled()
def first(pair):
    return pair.a
"""
OF_A_NOTEBOOK = "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    a: float\n"


def test_a_cache_that_names_a_notebooks_types_is_begun_anew(tmp_path, monkeypatch):
    """Numba keeps the types of arguments beside the machine code, by the module they are of."""
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit" / "ours.py").write_text(OF_A_NOTEBOOK)
    both = os.pathsep.join([str(tmp_path / "kit"), str(Path(corridor.__file__).parents[1])])
    monkeypatch.setenv("PYTHONPATH", both)
    assert printed(tmp_path, "import kernel, ours; print(kernel.first(ours.Pair(2.0)))") == "2.0"
    kept = list(tmp_path.rglob("*.nbi"))
    assert kept and b"ours" in kept[0].read_bytes()
    shutil.rmtree(tmp_path / "kit")
    script = f"{OF_A_NOTEBOOK}import kernel; print(kernel.first(Pair(3.0)))"
    assert printed(tmp_path, script) == "3.0"
    assert b"ours" not in kept[0].read_bytes()


def test_an_option_that_numba_has_no_longer_is_left_out_and_told(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    gone = "from numba.core.cpu import CPUTargetOptions as known\n"
    gone += "del next(one for one in known.__mro__ if '_nrt' in vars(one))._nrt\n"
    gone += "import warnings; warnings.simplefilter('always')\n"
    run = subprocess.run(
        [sys.executable, "-c", gone + PIXEL], cwd=Path(corridor.__file__).parents[1],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert float(run.stdout) == 625.0
    assert run.stderr.count("has no option _nrt: what is compiled is slower; install numba") == 1


def test_without_numba_an_adjustment_says_so_in_one_sentence_and_works(tmp_path):
    script = "import sys; sys.modules['numba'] = None\nfrom corridor.interface.cli import main\n"
    script += f"sys.exit(main(['adjust', 'data_synthetic/dike', '-o', {str(tmp_path / 'o')!r}]))"
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=Path(corridor.__file__).parents[1],
        capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0 and (tmp_path / "o" / "report.html").exists()
    said = [line for line in run.stderr.splitlines() if line.startswith("warning: numba")]
    assert len(said) == 1 and "RuntimeWarning" not in run.stderr
    assert "numba cannot be used" in said[0] and "install numba 0.64 to 0.68" in said[0]
