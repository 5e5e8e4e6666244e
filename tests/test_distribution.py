"""What is published: the same bytes from the same source."""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from machine_code import copy_kept

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folders of two builds, from two copies of the source of different age."""
    pytest.importorskip("build", reason="the extra dev is not installed")
    pytest.importorskip("hatchling", reason="the extra dev is not installed")
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    files = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True).stdout
    if not files:
        pytest.skip("no clone: git does not say what belongs to the source")
    out = []
    for age in (1_000_000_000, 1_500_000_000):
        folder = tmp_path_factory.mktemp("build")
        for name in filter(None, files.split("\0")):
            if (ROOT / name).is_file():
                (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, folder / "source" / name)
                os.utime(folder / "source" / name, (age, age))
        command = [sys.executable, "-m", "build", "--no-isolation", "-o", str(folder / "dist")]
        environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
        done = subprocess.run(
            [*command, str(folder / "source")], env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        out.append(folder / "dist")
    return out


def test_two_builds_of_one_source_are_the_same_bytes(built):
    first, second = (
        {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}
        for folder in built
    )
    assert len(first) == 2 and first == second


def test_the_wheel_checks_a_block_from_a_foreign_folder(built, tmp_path):
    """As `uvx --from dist/corridor.whl corridor check BLOCK` does, but with the libraries at hand.

    Nothing of the clone is on the path: neither its folder nor its data.
    """
    wheel = next(built[0].glob("*.whl"))
    place, foreign = tmp_path / "site", tmp_path / "elsewhere"
    command = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "-q"]
    done = subprocess.run([*command, "--target", str(place), str(wheel)], capture_output=True)
    assert done.returncode == 0, done.stderr
    # What the clone has compiled of the same sources: compiling is not what is asked here.
    copy_kept(lambda folder: place / folder.relative_to(ROOT) / "__pycache__")
    shutil.copytree(ROOT / "data_synthetic" / "dike", foreign / "data_synthetic" / "dike")
    environment = os.environ | {"PYTHONPATH": str(place)}
    words = ["check", "data_synthetic/dike", "--quick", "--required", "0.03"]
    run = [sys.executable, "-c", "import corridor, sys; print(corridor.__file__)"]
    where = subprocess.run(run, cwd=foreign, env=environment, capture_output=True, text=True)
    assert Path(where.stdout.strip()).is_relative_to(place)
    done = subprocess.run(
        [sys.executable, "-m", "corridor", *words],
        cwd=foreign, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Good enough" in done.stdout and (foreign / "dike_checked" / "report.html").is_file()
    assert (foreign / "dike_checked" / "take_back" / "settings.txt").is_file()
