"""How long a large block takes to write and to read: five million observations by default.

python benchmarks/block_io.py [--observations N] [--json FILE]
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

import corridor.core.block
from corridor.core.camera import Camera

PER_IMAGE = 440


def large_block(observations: int) -> corridor.block.Block:
    """A block of about that many tie observations, six images a point, numbers of full length."""
    noise = np.random.default_rng(1)
    points = max(observations // 6, 1)
    images = max(observations // PER_IMAGE, 10)
    first = np.sort(noise.integers(0, images - 5, points))
    point, image = np.repeat(np.arange(points), 6), (first[:, None] + np.arange(6)).ravel()
    names = pd.Index([f"DJI_{number:06d}.JPG" for number in range(images)])
    pose = {axis: noise.uniform(0, 5000, images) for axis in "xyz"}
    table = {"image": names, "camera": "P1", "time_s": np.arange(images) * 0.7, **pose}
    table |= {"qw": 0.0, "qx": 1.0, "qy": 0.0, "qz": 0.0}
    labels = pd.Index(np.arange(points).astype(str))
    return corridor.block.Block(
        name="large",
        cameras={"P1": Camera.from_table("P1", {"width": 8192, "height": 5460, "f": 8192.0})},
        images=pd.DataFrame(table),
        tie_points=pd.DataFrame(
            {
                "point": pd.Categorical.from_codes(point, labels),
                "image": pd.Categorical.from_codes(image, names),
                "x": noise.uniform(0, 8191, len(point)),
                "y": noise.uniform(0, 5459, len(point)),
            }
        ),
        points=pd.DataFrame(
            {"point": labels, **{axis: noise.uniform(0, 5000, points) for axis in "xyz"}}
        ),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--observations", type=int, default=5_000_000)
    parser.add_argument("--json", type=Path, help="write the seconds to this file as well")
    options = parser.parse_args()
    block = large_block(options.observations)
    seconds = {"observations": len(block.tie_points), "images": len(block.images)}
    print(f"{len(block.tie_points):,} observations in {len(block.images):,} images")
    with tempfile.TemporaryDirectory() as folder:
        for form in ("csv", "parquet"):
            where = Path(folder) / form
            start = time.perf_counter()
            block.write(where, form=form)
            written = time.perf_counter()
            again = corridor.block.read(where)
            done = time.perf_counter()
            same = again.tie_points.equals(block.tie_points) and again.points.equals(block.points)
            size = sum(file.stat().st_size for file in where.iterdir()) / 1e6
            seconds[form] = {"write_s": written - start, "read_s": done - written, "mb": size}
            print(
                f"{form:8} write {written - start:5.2f} s   read {done - written:5.2f} s   "
                f"{size:6.0f} MB   {'identical' if same else 'DIFFERENT'}"
            )
        start = time.perf_counter()
        again.summary()
        seconds["summary_s"] = time.perf_counter() - start
        print(f"summary  {seconds['summary_s']:.2f} s")
        start = time.perf_counter()
        again.select(images=again.images["image"][::2])
        seconds["select_s"] = time.perf_counter() - start
        print(f"select   {seconds['select_s']:.2f} s")
    if options.json:
        options.json.write_text(json.dumps(seconds, indent=1))


if __name__ == "__main__":
    main()
