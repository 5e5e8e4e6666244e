"""Make the shipped block: `python data_synthetic/make.py` writes data_synthetic/dike/.

What is true is written beside the folder, to data_synthetic/dike.truth.json, never into it.
The same script writes the same bytes.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.simulation import CAMLIGHT, add_noise, corridor_block

HERE = Path(__file__).parent
NAME = "dike"
SEED = 2019
NOISE = {"tie_px": 0.4, "mark_px": 0.4, "gnss_m": (0.02, 0.02, 0.04), "control_m": 0.005}
LEVER_ARM = (0.10, -0.05, 0.35)
# Sigmas by which poses and points are wrong to begin with.
START_ERROR = (0.5, np.radians(0.5), 1.0)
# What a first look at the lens would give: f off by 6 px, no distortion.
START_CAMERA = {
    "f": CAMLIGHT["f"] + 6.0,
    "cx": CAMLIGHT["cx"] - 5.0,
    "cy": CAMLIGHT["cy"] + 4.0,
} | dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0)

DESCRIPTION = (
    "Made by data_synthetic/make.py, nobody flew it. 42 nadir images of a 3 m high dike, 3 strips "
    "at 50 m in 2 flights, 80 % forward and 60 % side overlap, the drone turned round after each "
    "strip; a global shutter. Noise: 0.4 px on tie points and marks; 0.02, 0.02, 0.04 m on the "
    "antenna; 5 mm on the surveyed points, 5 control and 6 check, on alternating banks. The "
    "camera, the poses and the points are start values and wrong: f by 6 px, the principal point "
    "by 4 and 5 px, the distortion is left out, centres by 0.5 m, angles by 0.5 degrees, points "
    "by 1 m (sigmas). The lever arms are unknown. What is true stands in dike.truth.json beside "
    "this folder."
)


def flown(start_error: tuple[float, float, float] | None) -> Block:
    """The flight without errors of measurement."""
    return corridor_block(
        images=42,
        strips=3,
        height=50.0,
        observations_per_image=215,
        control=5,
        check=6,
        seed=SEED,
        flights=2,
        azimuth_deg=72.0,
        level=212.0,
        lever_arm=LEVER_ARM,
        start_error=start_error,
        name=NAME,
    )


def measured() -> Block:
    """The block that is shipped, with the digits that are written."""
    block = add_noise(flown(START_ERROR), **NOISE, seed=SEED)
    block.cameras = {CAMLIGHT.name: CAMLIGHT.with_values(**START_CAMERA)}
    block.lever_arm = {}
    block.description = DESCRIPTION
    block.source = "data_synthetic/make.py"
    block.licence = "BSD-3-Clause"
    digits = {
        "images": dict.fromkeys(("x", "y", "z", "time_s", "temperature_c"), 3)
        | dict.fromkeys(("vx", "vy", "vz"), 3)
        | dict.fromkeys(("wx", "wy", "wz"), 5)
        | dict.fromkeys(("qw", "qx", "qy", "qz"), 7),
        "tie_points": dict.fromkeys("xy", 2),
        "marks": dict.fromkeys("xy", 2),
        "points": dict.fromkeys("xyz", 2),
        "ground": dict.fromkeys("xyz", 4),
        "gnss": dict.fromkeys("xyz", 4),
    }
    for table, places in digits.items():
        setattr(block, table, getattr(block, table).round(places))
    return block


def truth() -> dict:
    """Everything that is true of the block."""
    block = flown(None)

    def rows(table: pd.DataFrame, name: str, columns: list[str], places: int) -> dict:
        values = table[columns].to_numpy().round(places).tolist()
        return dict(zip(table[name].tolist(), values, strict=True))

    return {
        "block": NAME,
        "seed": SEED,
        "noise": {key: value for key, value in NOISE.items()},
        "camera": {CAMLIGHT.name: CAMLIGHT.to_table()},
        "effects": {},
        "lever_arm": {flight: list(LEVER_ARM) for flight in block.flight_names},
        "centre": rows(block.images, "image", ["x", "y", "z"], 6),
        "quaternion": rows(block.images, "image", ["qw", "qx", "qy", "qz"], 9),
        "ground": rows(block.ground, "point", ["x", "y", "z"], 6),
        "points": rows(block.points, "point", ["x", "y", "z"], 6),
    }


def write(folder: Path = HERE) -> Path:
    """Write the block and its truth into a folder; returns the block's folder."""
    measured().write(folder / NAME)
    lines = ",\n".join(f"{json.dumps(key)}: {_lines(value)}" for key, value in truth().items())
    path = folder / f"{NAME}.truth.json"
    path.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8", newline="\n")
    return folder / NAME


def _lines(value: object) -> str:
    """JSON with one line for each name, so that a person can read it."""
    if isinstance(value, dict) and value and isinstance(next(iter(value.values())), list):
        inside = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items())
        return f"{{\n{inside}\n}}"
    return json.dumps(value)


if __name__ == "__main__":
    print(f"wrote {write()} and {NAME}.truth.json beside it")
