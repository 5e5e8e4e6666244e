"""How long a large project takes out and in again: 2,000 images, five million observations.

python benchmarks/interchange.py [--observations N] [--json FILE] [FORMAT ...]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import Camera, project
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector

PER_IMAGE = 2500
FORMATS = ("colmap", "colmap-text", "opensfm", "bundler", "micmac")


def large_block(observations: int) -> Block:
    """A strip seen five times over, with half a pixel of noise; Bundler can hold its camera."""
    noise = np.random.default_rng(0)
    count, points = max(observations // PER_IMAGE, 10), observations // 5
    camera = Camera.from_table(
        "P1", {"width": 8192, "height": 5460, "f": 8200.0, "k1": -0.05, "k2": 0.02}
    )
    along = 8.0 * np.arange(count)
    centre = np.column_stack([along, noise.normal(0, 1, (count, 2)) + [0, 120]])
    down = rotation_from_vector(np.array([[np.pi, 0.0, 0.0]]))
    rotation = rotation_from_vector(noise.normal(0, 0.02, (count, 3))) @ down
    ground = np.column_stack(
        [
            noise.uniform(24, along.max() - 24, points),
            noise.uniform(-25, 25, points),
            noise.uniform(0, 5, points),
        ]
    )
    first = np.clip((ground[:, 0] / 8).astype(int) - 2, 0, count - 5)
    image, point = (first[:, None] + np.arange(5)).ravel(), np.repeat(np.arange(points), 5)
    pixel = project(ground[point], centre[image], rotation[image], camera.interior)
    pixel += noise.normal(0, 0.5, pixel.shape)
    names = pd.Index([f"DJI_{number:04d}.JPG" for number in range(count)])
    labels = pd.Index(np.arange(1, points + 1)).astype("str")
    images = pd.DataFrame({"image": names, "camera": "P1"})
    images[["x", "y", "z"]] = centre
    images[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(rotation)
    places = pd.DataFrame({"point": labels})
    places[["x", "y", "z"]] = ground
    tie = pd.DataFrame(
        {
            "point": pd.Categorical.from_codes(point, labels),
            "image": pd.Categorical.from_codes(image, names),
            "x": pixel[:, 0],
            "y": pixel[:, 1],
        }
    )
    return Block(name="large", cameras={"P1": camera}, images=images, tie_points=tie, points=places)


def timed(*arguments: str) -> tuple[float, float, float]:
    """Seconds on the clock, seconds of processor and peak memory (MB) of one corridor command."""
    code = (
        "import resource, sys\n"
        "from corridor.interface.cli import main\n"
        "status = main(sys.argv[1:])\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)\n"
        "sys.exit(status)"
    )
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    processor, memory = map(float, done.stdout.split()[-2:])
    return time.perf_counter() - start, processor, memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("formats", metavar="FORMAT", nargs="*", default=FORMATS)
    parser.add_argument("--observations", type=int, default=5_000_000)
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    block = large_block(options.observations)
    figures = {"observations": len(block.tie_points), "images": len(block.images)}
    print(f"{len(block.tie_points):,} observations in {len(block.images):,} images")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        block.write(place / "block", form="parquet")
        for form in options.formats:
            out = "export", form, str(place / "block"), "-o", str(place / form)
            back = "import", "auto", str(place / form), "-o", str(place / f"{form}_block")
            for what, command in (("export", out), ("import", back)):
                clock, processor, memory = timed(*command)
                figures[f"{form} {what} s"] = round(clock, 1)
                figures[f"{form} {what} MB"] = round(memory)
                print(
                    f"{form:12s} {what}: {clock:6.1f} s ({processor:.1f} s of processor), "
                    f"{memory:,.0f} MB",
                    flush=True,
                )
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
