"""Readers of strangers' files against a fuzzer that looks at which lines an input reaches.

python -m benchmarks.guarantees.fuzz --seconds 600 --corpus FOLDER [--only colmap]

Needs atheris (pip install atheris; Linux, macOS). An input is a whole file or a folder of files,
packed into bytes: every format of `corridor.tools.formats` joins by itself, with the small projects
of the tests as its first inputs, and so do tracks, exposures, blocks, plans and photographs. A
reader may refuse (InputError, WorkFailed) or read; anything else is a fault, and its input is kept
in FOLDER/faults.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Between the files of an input, and between a file's name and what is in it.
_NEXT, _IN = b"\n\x00\x00file ", b"\x00\x00\n"
_MOST = 60_000  # bytes of an input: what lies beyond reaches no other lines


def packed(path: Path) -> bytes:
    """A file, or a folder with all that is in it, as one input."""
    if path.is_file():
        return b"".join((_NEXT, path.name.encode(), _IN, path.read_bytes()))
    return b"".join(
        _NEXT + file.relative_to(path).as_posix().encode() + _IN + file.read_bytes()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    )


def unpacked(data: bytes, folder: Path) -> Path:
    """The file of an input, or the folder of several, written below `folder`."""
    files = []
    for number, piece in enumerate(data.split(_NEXT)[1:20]):
        name, _, content = piece.partition(_IN)
        parts = name.decode("utf-8", "replace").replace("\\", "/").split("/")
        parts = [part for part in parts if part.strip(". \0") and len(part) < 60][:4]
        path = folder.joinpath(*(part.replace("\0", "") for part in parts or [f"file{number}"]))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError:  # a file where another has its folder
            continue
        files.append(path)
    return files[0] if len(files) == 1 else folder


def readers() -> dict[str, Callable[[Path], object]]:
    """What reads a path, by name."""
    from corridor.core.block import read
    from corridor.core.gnss import read_exposures, read_track
    from corridor.core.photographs import read_metadata
    from corridor.core.simulation import read_plan
    from corridor.tools.formats.programs import formats

    out = {name: module.read for name, module in formats().items()}
    out |= {f"is it {name}": module.recognise for name, module in formats().items()}
    return out | {
        "block": read,
        "track": read_track,
        "exposures": read_exposures,
        "photograph": read_metadata,
        "plan": read_plan,
    }


def first_inputs(folder: Path) -> dict[str, list[bytes]]:
    """Small sound inputs of the readers, by name."""
    sys.path[:0] = [str(ROOT / "tests" / "tools"), str(ROOT / "tests")]
    from formats import small_projects

    from corridor.tools.formats.programs import candidates

    out: dict[str, list[bytes]] = {}
    small_projects.write_all(folder)
    for place in sorted(folder.iterdir()):
        for name, path in candidates(place):
            if len(packed(path)) < 10 * _MOST:
                out.setdefault(name, []).append(packed(path))
    tracks = [packed(path) for path in (ROOT / "tests/core/gnss/data").iterdir() if path.is_file()]
    out["track"] = out["exposures"] = tracks
    out["plan"] = [packed(ROOT / "data_synthetic" / "dike.toml")]
    return out


def judged(reader: Callable[[Path], object], data: bytes) -> str:
    """What went wrong in reading an input, "" where it was read or refused."""
    from corridor.core.errors import CorridorError

    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            reader(unpacked(data, Path(place) / "input"))
        except CorridorError:
            return ""
        except (Exception, RecursionError):
            return traceback.format_exc()
        return ""


def main() -> int:
    """Fuzz until the time is up; 1 where something else than a refusal was raised."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--corpus", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--only", default="", help="readers with this in their name")
    options = parser.parse_args()
    import atheris

    # What numba compiles must stay as it was written: it is loaded before.
    import corridor.core.adjustment
    import corridor.core.simulation  # noqa: F401

    with atheris.instrument_imports(include=["corridor"]):
        known = readers()
    chosen = {name: one for name, one in known.items() if options.only in name}
    names, faults = sorted(chosen), options.corpus / "faults"
    inputs = options.corpus / "inputs"
    for folder in (faults, inputs):
        folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        for name, found in first_inputs(Path(place)).items():
            for data in found if name in names else []:
                _keep(inputs, bytes([names.index(name)]) + data[:_MOST])
    seen: set[str] = set()

    def one(data: bytes) -> None:
        name = names[data[0] % len(names)] if data else names[0]
        said = judged(chosen[name], data[1:])
        where = "".join(line for line in said.splitlines(True) if line.startswith("  File "))
        if said and where not in seen:
            seen.add(where)
            _keep(faults, data)
            print(f"== {name}\n{said}", flush=True)

    def changed(data: bytes, most: int, seed: int) -> bytes:
        """A change of bytes, or of a word: numbers that files have where others belong."""
        draw = random.Random(seed)
        if draw.random() < 0.5:
            return atheris.Mutate(data, most)
        words = data.split(b" ")
        odd = (b"nan", b"-1", b"0", b"1e308", b"99999999999999999999", b"", b"x", b"\xff", b"1,5")
        words[draw.randrange(len(words))] = draw.choice(odd)
        return b" ".join(words)[:most]

    arguments = [
        sys.argv[0], f"-max_total_time={options.seconds}", f"-max_len={_MOST}", "-timeout=60",
        "-rss_limit_mb=4000", "-print_final_stats=1", f"-artifact_prefix={faults}/", str(inputs),
    ]  # fmt: skip
    atheris.Setup(arguments, one, custom_mutator=changed)
    try:
        atheris.Fuzz()
    finally:
        shutil.rmtree(options.corpus / "tmp", ignore_errors=True)
        print(f"{len(seen)} faults", flush=True)
    return 1 if seen else 0


def _keep(folder, data):
    (folder / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)


if __name__ == "__main__":
    sys.exit(main())
