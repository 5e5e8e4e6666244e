"""How often a flight tells its camera's readout time, and whether its sigma holds.

python benchmarks/readout_flight.py [--count 100] [--first 0] [--json FILE] [--untold] [--rocking]
    [--short] [--velocities]

Simulated surveys of the independent generator (`benchmarks/diagnosis/generator`): a continuous
flight that brakes, stands and turns, a shaken camera whose turning nobody writes down, lenses that
are not Fraser's, GNSS with slow errors. Readouts of 5 to 60 ms, several plans, and velocities as
they come: written by the flight controller to 0.1 m/s and with a delay, or derived from positions,
from whole seconds, from a track. Prints for each the error over the stated sigma, or why it was
refused; with --untold for surveys that cannot tell, which are all to be refused; with --rocking for
cameras that rock while they are read, with a gyroscope that records it. With --velocities: what
`adjust` finds in small blocks (`benchmarks/flown.py`) of one speed, two speeds and braking, with
velocities derived and true.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.diagnosis.generator import CALM, NOISES, Air, Case
from benchmarks.diagnosis.generator.generate import draw, make_scene, streams, write_down
from benchmarks.diagnosis.generator.trajectory import ACCELERATION
from benchmarks.diagnosis.generator.world import World
from benchmarks.flown import KINDS, READOUT, flown
from corridor.core.adjustment import adjust
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.tools.readout import readout_from_flight

VELOCITIES = ("written", "positions", "whole seconds", "track")
GEOMETRIES = ("nadir", "fixed_yaw", "cross", "oblique", "multi_height")
_COLUMNS = ["vx", "vy", "vz"]
# Positions of one receiver, and of two.
_COARSE_M, _RTK_M = (1.0, 1.0, 2.0), NOISES["everyday"].gnss_white_m
# As on a fixed wing, some 5 degrees a second, another rate in 0.4 s; data/garfield turns by 22.
ROCKING = Air(shake_deg=2.0, shake_s=0.4)
# Standard deviation of the delay of what the flight controller writes, s.
DELAY_S = 0.15


def survey(seed, images=(28, 42), observations=80, untold=False, rocking=False):
    """A block, its readout (s) and how it was made, of a number.

    untold: of those that cannot tell it: in calm air at one speed in the camera's frame, with
    positions to a metre, or, every other one, stop and go with velocities from positions.
    rocking: the camera rocks as on a fixed wing, and rates.csv records it.
    """
    rng = np.random.default_rng([seed, 18])
    readout, speed = rng.uniform(0.005, 0.060), rng.uniform(4.0, 11.0)
    kind, geometry = VELOCITIES[seed % 4], str(rng.choice(GEOMETRIES))
    # To where the drone stands: run in, braking, and up to three seconds of standing.
    beyond = 1.5 * speed / ACCELERATION + 2.0 + rng.uniform(0.0, 3.0)
    beyond = beyond if rng.random() < 0.75 else 0.0
    stands, steady = untold and seed % 2 == 1, untold and seed % 2 == 0
    if untold:
        kind = "positions" if stands else "written"
        geometry, beyond = "fixed_yaw" if stands else "nadir", 0.0
    case = Case(
        geometry=geometry, images=int(rng.integers(*images)), height=rng.uniform(40, 90),
        strips=0 if geometry in ("cross", "multi_height") else int(rng.integers(2, 5)),
        speed=speed, forward=rng.uniform(0.68, 0.78), beyond_s=beyond,
        gnss="track" if kind == "track" else "exposures", gyro="rates" if rocking else "none",
        control=2, check=0,
        row_direction=str(rng.choice(["down", "up", "left", "right"])),
        observations=observations, air=CALM if untold else ROCKING if rocking else Air(),
        noise=replace(NOISES["everyday"], gnss_white_m=_COARSE_M if steady else _RTK_M),
    )  # fmt: skip
    draws = streams(seed)
    scene = make_scene(case, draws)
    world = World()
    # Where the drone stands while it photographs, rows show no motion.
    world.readout = 0.0 if stands else readout
    block, _ = write_down(scene, world, case, draw(scene, case, draws), f"survey_{seed}")
    # Ordinary surveys from photographs have no ground control.
    block.marks, block.ground = block.marks.iloc[:0], block.ground.iloc[:0]
    if kind == "written":
        late = rng.normal(0, DELAY_S)
        seen = scene.trajectory.velocity(scene.trajectory.exposure - late)
        block.images[_COLUMNS] = np.round(seen, 1)
    else:
        block.images = block.images.drop(columns=_COLUMNS)
    if kind == "whole seconds":
        block.images["time_s"] = np.floor(block.images["time_s"])
    made = {"seed": seed, "velocities": kind, "geometry": geometry, "beyond_s": round(beyond, 1)}
    return block, readout, made | {"images": len(block.images), "true_ms": 1000 * readout}


def measured(seed, **more):
    """One row: what was simulated, and what the flight told."""
    block, readout, row = survey(seed, **more)
    began = time.process_time()
    try:
        found = readout_from_flight(block, advise=False)
    except (InputError, AdjustmentFailed) as failed:
        return row | {"told": False, "why": str(failed)}
    return row | {
        "told": found.told,
        "why": " ".join(found.reasons),
        "readout_ms": 1000 * found.readout,
        "sigma_ms": 1000 * found.sigma,
        "formal_ms": 1000 * found.formal,
        "jackknife_ms": 1000 * found.jackknife,
        "ratio": (found.readout - readout) / found.sigma,
        "delay_s": found.delay[0],
        "seconds": time.process_time() - began,
    }


def summary(rows):
    """Errors over sigma of what was told, and of what was refused but estimated."""
    told = np.array([row["ratio"] for row in rows if row["told"]])
    other = np.array([row["ratio"] for row in rows if not row["told"] and "ratio" in row])
    formal = np.array(
        [(r["readout_ms"] - r["true_ms"]) / r["formal_ms"] for r in rows if r["told"]]
    )
    return {
        "surveys": len(rows),
        "told": len(told),
        "error_over_sigma": _rms(told),
        "beyond_2_sigma": int((np.abs(told) > 2).sum()),
        "beyond_3_sigma": int((np.abs(told) > 3).sum()),
        "error_over_formal_sigma": _rms(np.array(formal)),
        "error_over_sigma_of_refused": _rms(other),
    }


def by_velocities(numbers):
    """Rows: errors over sigma of `adjust` with one readout, of each kind of small block."""
    for random, kind, derived in product(("wind", "steps"), KINDS, (True, False)):
        pulls = []
        for seed in numbers:
            with TemporaryDirectory() as folder:
                block = flown(Path(folder), seed, kind, random, derived)
            found = adjust(block, camera="f,cx,cy,k1", effects=["rolling_shutter"]).effects.iloc[0]
            pulls.append((found["value"] - READOUT) / found["sigma"])
        yield {
            "gusts": random,
            "kind": kind,
            "velocities": "derived" if derived else "true",
            "blocks": len(pulls),
            "error_over_sigma": _rms(np.array(pulls)),
            "mean": float(np.mean(pulls)),
        }


def _rms(values):
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="surveys (default 100)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--untold", action="store_true", help="surveys that cannot tell it")
    parser.add_argument("--rocking", action="store_true", help="a gyroscope on a rocking camera")
    parser.add_argument("--short", action="store_true", help="twelve small ones")
    parser.add_argument("--json", type=Path, help="write the rows and the summary to this file")
    parser.add_argument("--velocities", action="store_true", help="small blocks by velocity")
    options = parser.parse_args()
    if options.velocities:
        found = []
        for row in by_velocities(range(options.first, options.first + options.count)):
            found.append(row)
            print(
                f"{row['gusts']:5s} {row['kind']:10s} {row['velocities']:7s} errors over sigma "
                f"{row['error_over_sigma']:.2f}, mean {row['mean']:+.2f}",
                flush=True,
            )
        if options.json:
            options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return
    small = {"images": (24, 30), "observations": 60} if options.short else {}
    small |= {"untold": options.untold, "rocking": options.rocking}
    rows = []
    for seed in range(options.first, options.first + (12 if options.short else options.count)):
        rows.append(measured(seed, **small))
        row = rows[-1]
        said = row["why"]
        if row["told"]:
            said = f"{row['readout_ms']:.2f} +- {row['sigma_ms']:.2f} ms: {row['ratio']:+.2f} sigma"
        print(
            f"{seed:3d} {row['velocities']:13s} {row['geometry']:12s} {row['images']:3d} images, "
            f"true {row['true_ms']:.2f} ms; {said}",
            flush=True,
        )
        if options.json:
            content = {"summary": summary(rows), "surveys": rows}
            options.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    json.dump(summary(rows), sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
