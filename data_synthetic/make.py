"""Make the shipped block: `python data_synthetic/make.py` writes data_synthetic/dike/.

The flight is dike.toml; what is true is written beside the folder, to dike.truth.json, never into
it. The same script writes the same bytes.
"""

from pathlib import Path

import numpy as np

from corridor.simulation import Simulated, simulate

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


def write(folder: Path = HERE) -> Path:
    """Write the block and its truth into a folder; returns the block's folder."""
    flown().write(folder / NAME)
    return folder / NAME


if __name__ == "__main__":
    print(f"wrote {write()} and {NAME}.truth.json beside it")
