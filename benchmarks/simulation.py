"""What a long simulated flight takes: seconds, processor seconds and memory.

python benchmarks/simulation.py [--images 1000,10000] [--short] [--json FILE]

Three strips along a bent axis, 50 m up, some 440 tie observations an image, 50 ground points and
antenna positions, with ordinary noise. What is timed is the command as it is typed, `corridor
simulate PLAN -o BLOCK`, which writes the block and what is true of it, in a process of its own.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.spent import spent

SIZES, SHORT = (1000, 10_000), (60, 120)
PLAN = """\
axis_m = [[0, 0], [{third}, {side}], [{two_thirds}, 0], [{length}, {side}]]
bend_radius_m = {bend}
gnss = true

[tie_points]
per_image = 440

[ground]
control = 25
check = 25
layout = "spread"
offset_m = 12

[[flight]]
name = "river"
height_m = 50
strips = 3
images = {images}
speed_m_s = 3
interval_s = 2.5
side = 0.7
attitude_jitter_deg = [1.2, 1.2, 0.3]
"""
BASE_M, STRIPS = 7.5, 3


def plan(images: int) -> str:
    """A flight of that many images, as the text of a plan."""
    length = images / STRIPS * BASE_M
    return PLAN.format(
        images=images, length=length, third=length / 3, two_thirds=2 * length / 3,
        side=length / 9, bend=min(400.0, length / 9),
    )  # fmt: skip


def timed(images: int, folder: Path) -> dict[str, float]:
    """What one simulation takes."""
    written = folder / f"{images}.toml"
    written.write_text(plan(images), encoding="utf-8")
    command = [sys.executable, "-m", "corridor", "simulate", written, "-o", folder / str(images)]
    began = time.perf_counter()
    with subprocess.Popen(
        list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        taken = spent(process)
    if process.returncode:
        raise SystemExit(f"the simulation of {images} images ended with {process.returncode}")
    wall = time.perf_counter() - began
    return {"images": images, "wall_s": wall, **taken._asdict(), "load": os.getloadavg()[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--images", help=f"sizes, commas (default {','.join(map(str, SIZES))})")
    parser.add_argument("--short", action="store_true", help=f"sizes {SHORT}")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    sizes = SHORT if options.short else SIZES
    if options.images:
        sizes = tuple(int(size) for size in options.images.split(","))
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for size in sizes:
            row = timed(size, Path(scratch))
            rows.append(row)
            print(
                f"{size:,} images: {row['wall_s']:.1f} s, processor {row['cpu_s']:.1f} s, "
                f"{row['peak_mb']:.0f} MB; load {row['load']:.1f}",
                flush=True,
            )
    if options.json:
        options.json.write_text(json.dumps({"rows": rows}, indent=1))


if __name__ == "__main__":
    main()
