"""Damage files at random and see that nothing is lost silently.

python -m tests.interchange.fuzzing COUNT [SEED]
"""

import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.guarantees.damage import damage_bytes
from corridor.core.errors import InputError
from corridor.tools.formats import prove, read_project
from corridor.tools.formats.rows import rows_of

from .small_projects import write_all

_GROSS_PX = 60.0
# Formats that state no counts: a file that lost a whole record is a whole file.
UNCOUNTED = {"pix4d", "opensfm", "metashape", "micmac", "odm"}


def look(path):
    """What came of reading: `refused` with the sentence, or the project with its proof."""
    try:
        project = read_project(path)
        proof = prove(project)
        project.block.check(observed=False)
        return project, proof, None
    except InputError as error:
        return None, None, error


def facts(project, proof):
    """What must not change without a word: counts, and the largest residual."""
    block = project.block
    counts = tuple(
        len(getattr(block, table))
        for table in ("images", "tie_points", "marks", "points", "ground")
    )
    return counts, tuple(sorted(project.notes)), tuple(project.warnings), tuple(proof.sentences)


def silent(before, project, proof):
    """Whether the block differs from the whole one in a way nobody was told; a sentence."""
    counts, notes, warnings, sentences = facts(project, proof)
    told = (notes, warnings, sentences) != before[1:] or proof.verdict == "refused"
    if told:
        return None
    if counts != before[0]:
        return f"counts {before[0]} became {counts}"
    rows = rows_of(project.block, complete=False)
    length = np.linalg.norm(rows.residuals(), axis=1) if len(rows.image) else np.zeros(1)
    if len(length) and np.nanmax(length, initial=0) > _GROSS_PX:
        return f"a residual of {np.nanmax(length):.0f} px"
    return None


def _only_fewer(before, project):
    """Whether rows are missing and those that are left fit as well as before."""
    counts = facts(project, prove(project))[0]
    return all(now <= then for now, then in zip(counts, before[0], strict=True)) and (
        prove(project).verdict == "proved"
    )


def run(count: int, seed: int = 0, say=lambda text: None) -> Counter:
    """Damage `count` files; a Counter of outcomes. Raises AssertionError on a silent block."""
    rng = random.Random(seed)
    outcomes: Counter = Counter()
    with tempfile.TemporaryDirectory() as place:
        paths = write_all(Path(place) / "good")
        whole = {}
        for name, path in paths.items():
            project, proof, error = look(path)
            assert error is None, (name, error)
            whole[name] = facts(project, proof)
        names = sorted(paths)
        for k in range(count):
            name = rng.choice(names)
            home = paths[name] if paths[name].is_dir() else paths[name].parent
            files = sorted(f for f in home.rglob("*") if f.is_file() and _read(f))
            file = rng.choice(files)
            good = file.read_bytes()
            file.write_bytes(damage_bytes(good, rng))
            try:
                project, proof, error = look(paths[name])
                if error is not None:
                    sentence = str(error)
                    assert sentence.strip() and "\n" not in sentence, (name, file.name, sentence)
                    outcomes["refused"] += 1
                    outcomes["refused by the net"] += (
                        error.__cause__ is not None and not isinstance(error.__cause__, OSError)
                    )
                else:
                    lost = silent(whole[name], project, proof)
                    fewer = name in UNCOUNTED and _only_fewer(whole[name], project)
                    if lost is not None and fewer:
                        outcomes["lost a whole record that nothing counts"] += 1
                        continue
                    outcomes["told" if lost is None else "silent"] += 1
                    if lost is not None:
                        say(f"{k}: {name} {file.name}: {lost}")
                        outcomes[f"silent {name} {file.name}"] += 1
            except InputError:
                outcomes["refused"] += 1
            except Exception as error:
                keep = Path(tempfile.gettempdir()) / f"fuzz_{name}_{k}"
                shutil.copytree(home, keep, dirs_exist_ok=True)
                raise AssertionError(
                    f"{name}, {file.name}, damage {k}: {error!r}; see {keep}"
                ) from error
            finally:
                file.write_bytes(good)
    return outcomes


def _read(file):
    """Files that only accompany a project are not read back."""
    return file.name not in ("reference.txt", "exported_by_corridor.txt") and not (
        file.name.startswith("calibration_") or "GNSS" in file.parts
    )


if __name__ == "__main__":
    start = time.perf_counter()
    found = run(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0, print)
    print(dict(found), f"{time.perf_counter() - start:.0f} s")
