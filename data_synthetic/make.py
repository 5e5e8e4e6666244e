"""Make the shipped data: `python data_synthetic/make.py` writes dike/ and wall/.

dike: a block; the flight is dike.toml. wall: pictures of a wall by a camera that warms and cools,
for `corridor thermal`. What is true is written beside the folders, to NAME.truth.json, never into
them. The same script writes the same bytes.
"""

from pathlib import Path

import numpy as np

from corridor.simulation import Simulated, simulate
from corridor.thermal import render, simple_model

HERE = Path(__file__).parent
NAME = "dike"
SEED = 2019
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
TRUE_DIGITS = {"centre": 6, "quaternion": 9, "ground": 6, "points": 6}


def flown() -> Simulated:
    """The block that is shipped, with the digits that are written."""
    block = simulate(HERE / f"{NAME}.toml", seed=SEED)
    block.licence = "BSD-3-Clause"
    for table, places in DIGITS.items():
        setattr(block, table, getattr(block, table).round(places))
    for key, places in TRUE_DIGITS.items():
        known = block.truth[key]
        block.truth[key] = {name: np.round(row, places).tolist() for name, row in known.items()}
    return block


def filmed() -> render.Shots:
    """The series that is shipped: 13 small pictures, warming for 15 minutes and cooling for 15.

    The optics lag a minute behind a thermometer that is read to a tenth of a degree.
    """
    width, height = 400, 300
    model = simple_model(
        width, height, 24.0, (24.0, 48.0), scale=(4.0e-5, 2.0e-7), radial=(1.0e-3,),
        shift=((-0.01, 0.02),),
    )  # fmt: skip
    course = render.Course(np.linspace(0, 1800, 13), off_s=900, lag_s=60, rounding_c=0.1)
    wall = render.Wall(width, height, seed=SEED)
    return render.Shots(wall, course, model, render.Sensor(vignetting=0.2, seed=SEED))


def write(folder: Path = HERE) -> Path:
    """Write the block and its truth into a folder; returns the block's folder."""
    flown().write(folder / NAME)
    return folder / NAME


if __name__ == "__main__":
    for path in (write(), filmed().write(HERE / "wall")):
        print(f"wrote {path} and {path.name}.truth.json beside it")
