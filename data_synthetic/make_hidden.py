"""Make the small set of blocks with hidden effects: `python data_synthetic/make_hidden.py`.

Writes data_synthetic/hidden/A to F by the generator in benchmarks/diagnosis; what is hidden in each
stands beside it, in NAME.truth.json, for whoever wants to look before guessing. Guess first:

    python -m benchmarks.diagnosis --blocks data_synthetic/hidden -o out/hidden

data_synthetic/stories holds the flights of chapter 5, some with their twin: the same flight and
noise, nothing hidden.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from benchmarks.diagnosis.generator import CALM, Case, null, single, together  # noqa: E402
from benchmarks.diagnosis.generator.generate import generate  # noqa: E402
from corridor import Block  # noqa: E402

# Decimals worth shipping: far below the noise.
DIGITS = {
    "images": dict.fromkeys(("x", "y", "z", "time_s", "temperature_c", "vx", "vy", "vz"), 3)
    | dict.fromkeys(("wx", "wy", "wz"), 5)
    | dict.fromkeys(("qw", "qx", "qy", "qz"), 7),
    "tie_points": dict.fromkeys("xy", 2),
    "marks": dict.fromkeys("xy", 2),
    "points": dict.fromkeys("xyz", 2),
    "ground": dict.fromkeys("xyz", 4),
    "gnss": dict.fromkeys("xyz", 4),
}
# Of what is true, that which a diagnosis is asked for; poses and points would weigh a megabyte.
TOLD = ("seed", "effects", "outside", "moved", "camera", "readout_s", "lever_arm")
SIZE = {"images": 30, "observations": 110, "check": 6}


def cases() -> dict[str, tuple[Case, int]]:
    """Name -> case and seed."""
    return {
        "A": (single("control_blunder", **SIZE), 41),
        "B": (single("local_bump", 1.5, **SIZE), 42),
        "C": (single("rolling_shutter", **SIZE), 43),
        "D": (null("everyday", **SIZE), 44),
        "E": (single("gnss_bias", 1.5, **SIZE), 45),
        "F": (together("radial_distortion", "control_blunder", **SIZE), 46),
    }


def stories() -> dict[str, tuple[Case, int]]:
    """Name -> case and seed of the flights of chapter 5."""
    size = {"images": 45, "observations": 160}
    return {
        "levee": (single("rolling_shutter", calibrated=True, air=CALM, **size), 3),
        "towpath": (together("rolling_shutter", "lever_arm", **size), 4),
        "viaduct": (single("thermal", **size), 6),
        "quay": (single("control_datum", **size), 7),
        "weir": (single("local_bump", **size), 5),
    }


def write(folder: Path, made: dict[str, tuple[Case, int]], twins: tuple[str, ...] = ()) -> Path:
    """Write blocks and their truth into a folder, and the twins of some; returns the folder."""
    for name, (case, seed) in made.items():
        hidden = generate(case, seed)
        _write(hidden.block, folder / name)
        if name in twins:
            _write(hidden.twin, folder / f"{name}_twin")
        truth = {key: hidden.truth[key] for key in TOLD}
        text = json.dumps(truth, indent=1)
        (folder / f"{name}.truth.json").write_text(text + "\n", encoding="utf-8", newline="\n")
    return folder


def _write(block: Block, folder: Path) -> None:
    block = replace(
        block, name=folder.name, licence="BSD-3-Clause",
        description="Something may be hidden in this block",
    )  # fmt: skip
    for table, places in DIGITS.items():
        setattr(block, table, getattr(block, table).round(places))
    block.write(folder)


if __name__ == "__main__":
    print(f"wrote {write(HERE / 'hidden', cases())}")
    print(f"wrote {write(HERE / 'stories', stories(), twins=('levee', 'towpath'))}")
