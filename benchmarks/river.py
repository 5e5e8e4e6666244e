"""What the adjustment of a whole river takes, from Parquet on disk to `adjustment.json`.

python benchmarks/river.py [--images 1000,10000,100000] [--folder DIR] [--threads N] [--flights N]
                           [--short] [--json FILE]

Three strips along a bent river, 50 m up, 80 % forward and 60 % side overlap, some 440 tie
observations an image; 0.5 px of noise, antenna positions to 0.02, 0.02, 0.04 m, a control and a
check point a kilometre; start values that miss by 0.3 m, 0.003 rad and 0.3 m, the camera and a
lever arm a flight to be estimated. What is timed is the command as it is typed, `corridor adjust
BLOCK -o OUT`, in a process of its own, start, imports, report, pictures and the adjusted block
too; kernels have been compiled before. The stages are told by the process itself: seconds of
processor and the largest resident set until the end of each, as the system counts it.
Exponent: growth of the processor time from one size to the next. What is found is held against
what is true. --folder keeps the blocks, for the next run to use.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.spent import spent
from corridor.core.block import Block
from corridor.core.camera import project
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.core.simulation import CAMLIGHT

SIZES, SHORT = (1000, 10_000, 100_000), (60, 120)
STRIPS, HEIGHT_M, BASE_M, APART_M = 3, 50.0, 7.0, 18.7
BENDS_M, BEND_M = 20_000.0, 400.0
# Points for an image: 440 observations come of them.
POINTS, SHORT_POINTS = 58, 15
TIE_PX, GNSS_M, CONTROL_M, ARM_M = 0.5, (0.02, 0.02, 0.04), 0.005, (0.1, 0.05, -0.2)
START = (0.3, 0.003, 0.3)
CHUNK = 1000  # bases whose points are made together

# Run by the process that adjusts: the verb, with a word at the end of each stage.
STAGES = """
import importlib, json, resource, sys, time
import corridor
from corridor.interface import cli
room = importlib.import_module("corridor.core.adjustment.adjusting")
def told(module, name, stage):
    work = getattr(module, name)
    def timed(*arguments, **options):
        try:
            return work(*arguments, **options)
        finally:
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print(json.dumps([stage, time.process_time(), peak]), file=sys.stderr, flush=True)
    setattr(module, name, timed)
told(corridor, "read", "read")
told(room, "prepare", "prepare")
told(room, "make_problem", "order")
told(room, "solve", "solve")
told(corridor, "adjust", "covariance, tests")
told(corridor.report, "of_adjustment", "report, printed")
told(corridor.figures, "of_adjustment", "pictures")
told(corridor.Block, "write", "adjusted block")
told(corridor.Adjustment, "save", "report, tables")
sys.exit(cli.main(sys.argv[1:]))
"""


# --- the block ----------------------------------------------------------------------------------


def river(images: int, folder: Path, flights: int = 1, points: int = POINTS) -> int:
    """Writes the block into a folder, piece by piece; how many tie observations it has.

    What is true of the camera stands in simulation's `camlight`.
    """
    noise = np.random.default_rng(1)
    length = -(-images // STRIPS)
    centre, rotation, table = _flown(images, length, flights, noise)
    name, arm = table["image"].to_numpy(), np.array(ARM_M)
    start = rotation_from_vector(noise.normal(0, START[1], (images, 3))) @ rotation
    poses = np.concatenate(
        [centre + noise.normal(0, START[0], (images, 3)), quaternion_from_rotation(start)], axis=1
    )
    columns = ("x", "y", "z", "qw", "qx", "qy", "qz")
    antenna = centre + np.einsum("nji,j->ni", rotation, arm) + noise.normal(0, GNSS_M, (images, 3))
    seen = {"pairs": 0, "of_image": np.zeros(images, dtype=np.int64)}
    ground = _Seen(centre, rotation, length)
    marks, given = _ground_points(ground, images, length, name, noise)
    block = Block(
        name="river",
        cameras={"camlight": CAMLIGHT.with_values(f=CAMLIGHT["f"] + 5.0, k1=0.0, k2=0.0)},
        images=table.assign(**dict(zip(columns, poses.T, strict=True))),
        marks=marks,
        ground=given,
        gnss=pd.DataFrame({"image": name, **dict(zip("xyz", antenna.T, strict=True))}),
        sigma={"tie_px": TIE_PX, "mark_px": TIE_PX, "gnss_m": GNSS_M, "control_m": CONTROL_M},
    )
    block.write(folder, form="parquet", observed=False)
    names, text = pa.array(name), pa.string()
    coded = pa.dictionary(pa.int32(), text)
    pixels = [(axis, pa.float64()) for axis in "xy"]
    ties = pa.schema([("point", coded), ("image", coded), *pixels])
    world = pa.schema([("point", text), *((axis, pa.float64()) for axis in "xyz")])
    number = 0
    with (
        pq.ParquetWriter(folder / "tie_points.parquet", ties) as tie_file,
        pq.ParquetWriter(folder / "points.parquet", world) as point_file,
    ):
        for first in range(0, length, CHUNK):
            last = min(first + CHUNK, length)
            count = points * (last - first) * STRIPS
            along, across = noise.uniform(first, last, count), noise.uniform(-1, 1, count)
            xyz = ground.at(along * BASE_M, across * (APART_M + 23.0))
            point, image, pixel = ground.images_of(xyz, along)
            often = np.bincount(point, minlength=count)[point] > 1
            point, image, pixel = point[often], image[often], pixel[often]
            kept, point = np.unique(point, return_inverse=True)
            labels = pa.array(np.arange(number, number + len(kept))).cast(text)
            local, image_code = np.unique(image, return_inverse=True)
            pixel += noise.normal(0, TIE_PX, pixel.shape)
            tie_file.write_table(
                pa.table(
                    [
                        pa.DictionaryArray.from_arrays(point.astype(np.int32), labels),
                        pa.DictionaryArray.from_arrays(
                            image_code.astype(np.int32), names.take(pa.array(local))
                        ),
                        *pixel.T,
                    ],
                    schema=ties,
                )
            )
            near = xyz[kept] + noise.normal(0, START[2], (len(kept), 3))
            point_file.write_table(pa.table([labels, *near.T], schema=world))
            number += len(kept)
            seen["pairs"] += len(image)
    return seen["pairs"]


def _flown(images: int, length: int, flights: int, noise):
    """Centres (n, 3), rotations (n, 3, 3) and images.csv without poses."""
    number = np.arange(images)
    strip, place = number // length, number % length
    along = place * BASE_M
    centre = _river(along, (strip - (STRIPS - 1) / 2) * APART_M)
    centre[:, 2] = HEIGHT_M
    centre += noise.normal(0, 0.3, (images, 3))
    back = np.where(strip % 2, length - 1 - place, place)  # the second strip is flown back
    time_s = strip * (length * 2.2 + 60.0) + back * 2.2
    slope = _heading(along)
    c, s, zero = np.cos(slope), np.sin(slope), np.zeros(images)
    rows = [np.stack(row, 1) for row in ((s, -c, zero), (-c, -s, zero), (zero, zero, zero - 1.0))]
    rotation = rotation_from_vector(noise.normal(0, 0.02, (images, 3))) @ np.stack(rows, axis=1)
    table = pd.DataFrame(
        {
            "image": [f"S{s + 1}_{k:06d}.jpg" for s, k in zip(strip, place, strict=True)],
            "camera": "camlight",
            "flight": [f"F{k + 1}" for k in place * flights // length],
            "strip": (strip + 1).astype(str),
            "time_s": time_s,
        }
    )
    return centre, rotation, table


def _heading(along):
    bend = 2 * np.pi / BENDS_M
    return np.arctan(BEND_M * bend * np.cos(bend * along))


def _river(along, across):
    """Places (n, 3) beside the middle of the river; z = 0."""
    slope = _heading(along)
    x = along - across * np.sin(slope)
    y = BEND_M * np.sin(2 * np.pi / BENDS_M * along) + across * np.cos(slope)
    return np.stack([x, y, np.zeros(len(x))], axis=1)


class _Seen:
    """The ground, and which images show it. centre, rotation: as flown; length: of a strip."""

    def __init__(self, centre, rotation, length):
        self.centre, self.rotation, self.length = centre, rotation, length

    def at(self, along, across):
        """Ground points (n, 3): a dike of 3 m on gentle land."""
        xyz = _river(along, across)
        xyz[:, 2] = 3.0 * np.exp(-((across / 6.0) ** 2)) + np.sin(along / 40.0)
        return xyz

    def images_of(self, xyz, along):
        """Point, image and pixel (k, 2) of every sight of the points, by point."""
        near = np.round(along).astype(np.int64)
        camera, found = CAMLIGHT, []
        rows = np.arange(len(xyz))
        for strip in range(STRIPS):
            for step in range(-4, 5):
                place = near + step
                image = strip * self.length + place
                there = (place >= 0) & (place < self.length) & (image < len(self.centre))
                image = image[there]
                pixel = project(
                    xyz[there], self.centre[image], self.rotation[image], camera.interior
                )
                limit = (camera.width - 0.5, camera.height - 0.5)
                inside = ((pixel > -0.5) & (pixel < limit)).all(axis=1)
                found.append((rows[there][inside], image[inside], pixel[inside]))
        point, image, pixel = (np.concatenate(part) for part in zip(*found, strict=True))
        by_point = np.argsort(point, kind="stable")
        return point[by_point], image[by_point], pixel[by_point]


def _ground_points(ground, images, length, names, noise):
    """marks.csv and ground.csv: a control and a check point a kilometre, and at least four each."""
    count = 2 * max(4, round(length * BASE_M / 1000.0))
    along = (np.arange(count) + 0.5) * length / count
    xyz = ground.at(along * BASE_M, np.where(np.arange(count) // 2 % 2, 15.0, -15.0))
    point, image, pixel = ground.images_of(xyz, along)
    label = np.array([f"G{k + 1}" for k in range(count)])
    pixel = pixel + noise.normal(0, TIE_PX, pixel.shape)
    marks = {"point": label[point], "image": names[image], "x": pixel[:, 0], "y": pixel[:, 1]}
    given = xyz + noise.normal(0, CONTROL_M, xyz.shape)
    role = np.where(np.arange(count) % 2, "check", "control")
    table = {"point": label, **dict(zip("xyz", given.T, strict=True)), "role": role}
    return pd.DataFrame(marks), pd.DataFrame(table)


# --- what it takes ------------------------------------------------------------------------------


def timed(block: Path, out: Path, threads: int) -> dict:
    """Seconds, processor seconds and peak MB of an adjustment, also until the end of each stage."""
    command = [sys.executable, "-c", STAGES, "adjust", str(block), "-o", str(out)]
    log = out.with_name(out.name + ".log")
    began = time.perf_counter()
    with log.open("w+") as told:
        process = subprocess.Popen(
            [*command, "--threads", str(threads)], stdout=subprocess.DEVNULL, stderr=told
        )
        taken = spent(process)
        wall = time.perf_counter() - began
        told.seek(0)
        lines = told.read().splitlines()
    if process.returncode:
        raise SystemExit("\n".join(["the adjustment failed:", *lines[-5:]]))
    unit = 1024**2 if sys.platform == "darwin" else 1024
    stages = [json.loads(line) for line in lines if line.startswith("[")]
    return {
        "wall_s": wall,
        **taken._asdict(),
        "stages": [[stage, cpu, peak / unit] for stage, cpu, peak in stages],
    }


def found(out: Path) -> dict:
    """What came out, and how far from the truth."""
    told = json.loads((out / "adjustment.json").read_text(encoding="utf-8"))
    f = told["camera"]["camlight"]["f"]
    return {
        "iterations": told["iterations"],
        "sigma0": told["sigma0"],
        "f_over_sigma": (f["value"] - CAMLIGHT["f"]) / f["sigma"],
        "check_3d_m": told["check_points"]["rms"]["3d"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--images", help=f"sizes, commas (default {','.join(map(str, SIZES))})")
    parser.add_argument("--folder", type=Path, help="keep the blocks here, use those that are")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--flights", type=int, default=1)
    parser.add_argument("--short", action="store_true", help=f"sizes {SHORT}, fewer observations")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    sizes = SHORT if options.short else SIZES
    if options.images:
        sizes = tuple(int(size) for size in options.images.split(","))
    points = SHORT_POINTS if options.short else POINTS
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as scratch:
        keep = options.folder or Path(scratch)
        for number, size in enumerate((min(min(sizes), 300), *sizes)):
            block = keep / f"river_{size}_{options.flights}_{points}"
            if not (block / "points.parquet").is_file():
                river(size, block, options.flights, points)
            out = Path(scratch) / f"out_{number}"
            row = timed(block, out, options.threads)
            if not number:
                continue  # it compiled the kernels
            count = pq.read_metadata(block / "tie_points.parquet").num_rows
            growth = None
            if rows and rows[-1]["images"] != size:
                growth = math.log(row["cpu_s"] / rows[-1]["cpu_s"])
                growth /= math.log(size / rows[-1]["images"])
            head = {"images": size, "observations": count, "load": os.getloadavg()[0]}
            row = head | row | found(out) | {"exponent": growth}
            rows.append(row)
            print(told_of(row), flush=True)
    if options.json:
        content = {"threads": options.threads, "flights": options.flights, "rows": rows}
        options.json.write_text(json.dumps(content, indent=1))


def told_of(row: dict) -> str:
    """The figures of one size in lines."""
    grown = "" if row["exponent"] is None else f", exponent {row['exponent']:.2f}"
    lines = [
        f"{row['images']:,} images, {row['observations']:,} observations: {row['wall_s']:.1f} s, "
        f"processor {row['cpu_s']:.1f} s{grown}; {row['peak_mb']:.0f} MB; load {row['load']:.1f}",
        f"    {row['iterations']} iterations, sigma naught {row['sigma0']:.4f}, f off by "
        f"{row['f_over_sigma']:+.1f} sigma, check points {1000 * row['check_3d_m']:.1f} mm",
    ]
    before = 0.0
    for stage, cpu, peak in row["stages"]:
        lines.append(f"    {stage:18s} {cpu - before:7.1f} s, until then {peak:6.0f} MB")
        before = cpu
    return "\n".join(lines)


if __name__ == "__main__":
    main()
