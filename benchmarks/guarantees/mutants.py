"""Faults that a photogrammetrist makes, put into the source one at a time: do the tests find them?

A mutant is a place in the source and what would stand there by a mistake of meaning, not of typing:
p1 for p2, an arm with the other sign, degrees for radians, half a pixel, a transposed rotation. It
is killed where one of its tests fails. The source itself is left alone: a copy is changed, with the
machine code that is there already.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_COPIED = ("corridor", "tests", "benchmarks", "notebooks", "data_synthetic", "docs")
_PATIENCE_S = 900.0


@dataclass(frozen=True)
class Mutant:
    """what: the mistake. file: in corridor/. old, new: the text, which is there once, and what
    stands there by mistake. tests: what pytest is given; one file or two, the nearest."""

    what: str
    file: str
    old: str
    new: str
    tests: str


_CAMERA, _PHYSICS = "tests/test_camera.py", "tests/core/effects/test_physics.py"
_CATALOGUE = "core/effects/catalogue"
MUTANTS = (
    # --- the camera ---
    Mutant("p1 for p2", "core/camera.py",
           "    p1, p2, b1, b2 = flat\n", "    p2, p1, b1, b2 = flat\n", _CAMERA),
    Mutant("b1 for b2", "core/camera.py",
           "u * stretch + p1 * r2 + (b1 * u + b2 * v)",
           "u * stretch + p1 * r2 + (b2 * u + b1 * v)", _CAMERA),
    Mutant("the affinity in y", "core/camera.py",
           "        v * stretch + p2 * r2,\n",
           "        v * stretch + p2 * r2 + b1 * v,\n", _CAMERA),
    Mutant("distortion with the other sign", "core/camera.py",
           "    radial = radial * r2 + 1.0\n", "    radial = 1.0 - radial * r2\n", _CAMERA),
    Mutant("a derivative without its cross term", "core/camera.py",
           "    mixed = u * by_v + 2.0 * p1 * v\n", "    mixed = u * by_v\n", _CAMERA),
    # --- rotations and frames ---
    Mutant("a rotation camera to world", "core/geometry/rotations.py",
           "scalar_first=True).as_matrix()\n", "scalar_first=True).inv().as_matrix()\n",
           "tests/core/geometry/test_rotations.py"),
    Mutant("the scalar of a quaternion last", "core/geometry/rotations.py",
           "Rotation.from_quat(np.where(known, q, 1.0), scalar_first=True)",
           "Rotation.from_quat(np.where(known, q, 1.0), scalar_first=False)",
           "tests/core/geometry/test_rotations.py"),
    Mutant("angles in radians where degrees are given", "core/geometry/rotations.py",
           "[omega, phi, kappa], degrees=True", "[omega, phi, kappa], degrees=False",
           "tests/core/geometry/test_rotations.py tests/tools/formats/test_expected_projects.py"),
    Mutant("a similarity the wrong way round", "core/geometry/helmert.py",
           "rotations, dtype=float) @ self.rotation.T\n",
           "rotations, dtype=float) @ self.rotation\n",
           "tests/core/geometry/test_similarity.py"),
    Mutant("latitude in degrees", "core/gnss/coordinates.py",
           "lat, lon = np.radians([self.lat_deg, self.lon_deg])",
           "lat, lon = np.array([self.lat_deg, self.lon_deg])",
           "tests/core/gnss/test_coordinates.py"),
    # --- the antenna ---
    Mutant("a lever arm with the other sign", "core/adjustment/measured_poses.py",
           'state.centre[image] + np.einsum("nij,nj->ni", to_world, arm) + shift',
           'state.centre[image] - np.einsum("nij,nj->ni", to_world, arm) + shift',
           "tests/core/adjustment/test_truth.py"),
    Mutant("a lever arm in the world", "core/adjustment/measured_poses.py",
           "    to_world = state.rotation[image].transpose(0, 2, 1)\n    arm =",
           "    to_world = state.rotation[image]\n    arm =",
           "tests/core/adjustment/test_truth.py"),
    Mutant("the effect of the lever arm without its turn", f"{_CATALOGUE}/lever_arm.py",
           "return context.rotation.transpose(0, 2, 1)", "return context.rotation", _PHYSICS),
    Mutant("a clock that is late for one that is early", f"{_CATALOGUE}/clock_offset.py",
           "return -context.velocity[:, :, None]", "return context.velocity[:, :, None]", _PHYSICS),
    # --- the shutter ---
    Mutant("rows read the other way", "core/effects/context.py",
           '"down": (1, 1.0), "up": (1, -1.0)', '"down": (1, -1.0), "up": (1, 1.0)', _PHYSICS),
    Mutant("columns for rows", "core/effects/context.py",
           '"right": (0, 1.0), "left": (0, -1.0)',
           '"right": (0, -1.0), "left": (0, 1.0)', _PHYSICS),
    Mutant("milliseconds for seconds", f"{_CATALOGUE}/rolling_shutter.py",
           "np.multiply(context.velocity, row, out=derivative[:, :3, 0])",
           "np.multiply(context.velocity, row / 1000, out=derivative[:, :3, 0])", _PHYSICS),
    Mutant("rows counted from the first for from the middle", "core/effects/context.py",
           "self.row_sign / last, -0.5 * self.row_sign]", "self.row_sign / last, 0.0 * last]",
           _PHYSICS),
    Mutant("rows for rows less one", "core/effects/context.py",
           "np.arange(len(self.size)), self.row_axis] - 1\n",
           "np.arange(len(self.size)), self.row_axis]\n", _PHYSICS),
    # --- other effects ---
    Mutant("refraction in radians where degrees are given", f"{_CATALOGUE}/refraction.py",
           "bent *= np.radians(constant)[:, None]", "bent *= constant[:, None]",
           "tests/core/effects/test_physics_image.py"),
    # --- other programs ---
    Mutant("half a pixel of COLMAP", "tools/formats/programs/colmap/cameras.py",
           "HALF = 0.5\n", "HALF = 0.0\n", "tests/tools/formats/test_expected_projects.py"),
    Mutant("half a pixel of Metashape, the other way",
           "tools/formats/programs/metashape/__init__.py",
           'table["x"], table["y"]]).astype(float) - 0.5',
           'table["x"], table["y"]]).astype(float) + 0.5',
           "tests/tools/formats/test_expected_projects.py"),
    # --- statistics ---
    Mutant("observations for redundancy", "core/adjustment/tables.py",
           "            - self.problem.unknown_count\n",
           "            - 0 * self.problem.unknown_count\n",
           "tests/core/adjustment/test_truth.py"),
    Mutant("a variance for a sigma", "core/adjustment/tables.py",
           "float(np.sqrt(2 * self.cost / self.redundancy))",
           "float(2 * self.cost / self.redundancy)",
           "tests/core/adjustment/test_published_answers.py tests/core/adjustment/test_truth.py"),
    Mutant("half the cost for the cost", "core/adjustment/tables.py",
           "np.sqrt(2 * self.cost / self.redundancy)", "np.sqrt(self.cost / self.redundancy)",
           "tests/core/adjustment/test_published_answers.py tests/core/adjustment/test_truth.py"),
    Mutant("a spread about zero", "core/adjustment/check_statistics.py",
           "std = values.std(axis=0, ddof=1)", "std = np.sqrt(np.mean(values**2, axis=0))",
           "tests/core/adjustment/test_check_statistics.py"),
    Mutant("a spread of the sample", "core/adjustment/check_statistics.py",
           "std = values.std(axis=0, ddof=1)", "std = values.std(axis=0)",
           "tests/core/adjustment/test_check_statistics.py"),
    Mutant("a tilt in degrees", "core/simulation/fly.py",
           "tilt = np.radians(flight.tilt_deg) *", "tilt = flight.tilt_deg *",
           "tests/core/simulation/test_fly.py"),
    Mutant("a shake in degrees", "core/simulation/fly.py",
           "sigma = np.radians(np.broadcast_to(flight.attitude_jitter_deg, 3))",
           "sigma = np.broadcast_to(flight.attitude_jitter_deg, 3)",
           "tests/core/simulation/test_fly.py"),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """killed: by which test, "" where none failed. seconds: what that took."""

    mutant: Mutant
    killed: str
    seconds: float


def misplaced() -> list[str]:
    """Mutants whose text is not there exactly once, which would test nothing."""
    return [
        f"{one.what}: {one.file}"
        for one in MUTANTS
        if (ROOT / "corridor" / one.file).read_text(encoding="utf-8").count(one.old) != 1
    ]


def tried(which: str = "") -> Iterator[Outcome]:
    """Each mutant whose mistake or file has `which` in it.

    Raises ValueError for a misplaced one, and where a test fails without any mutant.
    """
    if misplaced():
        raise ValueError(f"not there, or not once: {'; '.join(misplaced())}")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "project"
        for name in _COPIED:
            shutil.copytree(ROOT / name, place / name)
        shutil.copy(ROOT / "pyproject.toml", place / "pyproject.toml")
        chosen = [one for one in MUTANTS if which in one.what or which in one.file]
        for tests in dict.fromkeys(one.tests for one in chosen):
            failed = _first_failure(place, tests.split())
            if failed:
                raise ValueError(f"without any mutant {failed}")
        for one in chosen:
            path = place / "corridor" / one.file
            sound = path.read_text(encoding="utf-8")
            path.write_text(sound.replace(one.old, one.new), encoding="utf-8", newline="\n")
            began = time.monotonic()
            yield Outcome(one, _first_failure(place, one.tests.split()), time.monotonic() - began)
            path.write_text(sound, encoding="utf-8", newline="\n")


def _first_failure(place, tests):
    path = os.pathsep.join([str(place), str(place / "notebooks"), os.environ.get("PYTHONPATH", "")])
    env = os.environ | {"PYTHONPATH": path}
    data = ROOT.parent / "shared" / "data"
    if data.is_dir():
        env.setdefault("CORRIDOR_DATA", str(data))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--tb=no"]
    try:
        done = subprocess.run(
            [*command, "-m", "not slow", *tests], cwd=place, env=env,
            capture_output=True, text=True, timeout=_PATIENCE_S,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "it did not end"
    if done.returncode == 0:
        return ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0] if failed else f"status {done.returncode}"


def run(which: str = "", say: Callable[[str], None] = print) -> dict:
    """Says a line a mutant; the figures. It holds where 95 of 100 are killed."""
    outcomes = []
    for one in tried(which):
        say(f"{one.mutant.what}: {one.killed or 'SURVIVES'} ({one.seconds:.0f} s)")
        outcomes.append(one)
    survive = [one.mutant.what for one in outcomes if not one.killed]
    killed = len(outcomes) - len(survive)
    return {
        "mutants": len(outcomes),
        "killed": killed,
        "survive": survive,
        "holds": killed >= 0.95 * len(outcomes),
    }
