"""What is published: the same bytes from the same source."""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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
