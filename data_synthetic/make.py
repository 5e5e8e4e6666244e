"""Make the shipped data: `python data_synthetic/make.py` writes dike/, dike_track.csv and wall/.

dike: a block; the flight is dike.toml. dike_track.csv: where the antenna was during that flight,
five times a second, for `corridor gnss`. wall: pictures of a wall by a camera that warms and cools,
for `corridor thermal`. What is true is written beside the folders, to NAME.truth.json, never into
them. The same script writes the same bytes.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import PchipInterpolator

from corridor.core.geometry import rotation_from_quaternion
from corridor.core.simulation import Simulated, simulate
from corridor.tools.thermal import simple_model
from notebooks.kit.wall import Course, Sensor, Shots, Wall

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


def tracked(block: Simulated) -> pd.DataFrame:
    """The receiver's track of a block: smooth through its true antennas, white noise of a fix."""
    names, rng = block.images["image"].to_numpy(object), np.random.default_rng(SEED)
    centre = np.array([block.truth["centre"][name] for name in names])
    turned = rotation_from_quaternion(np.array([block.truth["quaternion"][n] for n in names]))
    flights = np.array(block.flight_names, dtype=object)[block.image_flight]
    sigma, parts = np.array([0.008, 0.008, 0.015]), []
    for flight in block.flight_names:
        mine = flights == flight
        antenna = centre[mine] + turned[mine].transpose(0, 2, 1) @ block.truth["lever_arm"][flight]
        at = block.images["time_s"].to_numpy(float)[mine]
        time = np.arange(np.ceil(at[0] - 2.0), at[-1] + 2.0, 0.2)
        xyz = PchipInterpolator(at, antenna)(np.clip(time, at[0], at[-1]))
        # Before the first image and after the last one it flies on as there.
        for end, rows in ((0, time < at[0]), (-1, time > at[-1])):
            speed = PchipInterpolator(at, antenna).derivative()(at[end])
            xyz[rows] += (time[rows] - at[end])[:, None] * speed
        xyz += sigma * rng.standard_normal(xyz.shape)
        part = pd.DataFrame({"time_s": time.round(1), "flight": flight, "quality": 1})
        part[["x", "y", "z"]], part[["sx", "sy", "sz"]] = xyz.round(4), sigma
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def filmed() -> Shots:
    """The series that is shipped: 13 small pictures, warming for 15 minutes and cooling for 15.

    The optics lag a minute behind a thermometer that is read to a tenth of a degree.
    """
    width, height = 400, 300
    model = simple_model(
        width, height, 24.0, (24.0, 48.0), scale=(4.0e-5, 2.0e-7), radial=(1.0e-3,),
        shift=((-0.01, 0.02),),
    )  # fmt: skip
    course = Course(np.linspace(0, 1800, 13), off_s=900, lag_s=60, rounding_c=0.1)
    wall = Wall(width, height, seed=SEED)
    return Shots(wall, course, model, Sensor(vignetting=0.2, seed=SEED))


def write(folder: Path = HERE) -> Path:
    """Write the block and its truth into a folder; returns the block's folder."""
    block = flown()
    block.write(folder / NAME)
    tracked(block).to_csv(folder / f"{NAME}_track.csv", index=False, lineterminator="\n")
    return folder / NAME


if __name__ == "__main__":
    for path in (write(), filmed().write(HERE / "wall")):
        print(f"wrote {path} and {path.name}.truth.json beside it")
