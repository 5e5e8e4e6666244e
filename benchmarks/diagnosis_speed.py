"""What a diagnosis takes as blocks grow: seconds, CPU, memory, and when it first says something.

python benchmarks/diagnosis_speed.py [--images 100,1000] [--threads N] [--short] [--json FILE]

Blocks of three strips, 333 observations an image, a camera to be calibrated, GNSS with slow errors,
8 control and 7 check points; nothing is missing from the model. What is timed is the command as it
is typed, `corridor diagnose BLOCK -o OUT`, in a process of its own, start and imports included,
report, both blocks and 20 simulated counterparts too; kernels have been compiled before. First
sentence: when the diagnosis is printed, before the counterparts. Memory: the largest resident set,
as the system counts it. Exponent: growth of the CPU time from one size to the next.
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

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from strips import corridor_block  # noqa: E402

from benchmarks.spent import spent  # noqa: E402
from corridor.core.simulation import add_noise  # noqa: E402

SIZES, SHORT = (100, 180, 1000, 5000), (24, 48)
NOISE = {"tie_px": 0.4, "mark_px": 0.4, "gnss_m": (0.012, 0.012, 0.02), "control_m": 0.005}
SLOW = {"gnss_slow": 0.6, "gnss_slow_s": 60.0}
PER_IMAGE = 333


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--images", help=f"sizes, commas (default {','.join(map(str, SIZES))})")
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--short", action="store_true", help=f"sizes {SHORT}, fewer observations")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    sizes = SHORT if options.short else SIZES
    if options.images:
        sizes = tuple(int(size) for size in options.images.split(","))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, size in enumerate((min(sizes), *sizes)):
            block = Path(folder) / f"block_{number}"
            made(size, 60 if options.short else PER_IMAGE).write(block)
            row = timed(block, Path(folder) / f"out_{number}", options.threads)
            if not number:
                continue  # it compiled the kernels
            row = {"images": size} | row | {"exponent": exponent(rows, size, row["cpu_s"])}
            rows.append(row)
            grown = "" if row["exponent"] is None else f", exponent {row['exponent']:.2f}"
            print(
                f"{size:6d} images: {row['wall_s']:6.1f} s, CPU {row['cpu_s']:6.1f} s{grown}; "
                f"first sentence {row['first_s']:6.1f} s; {row['peak_mb']:5.0f} MB",
                flush=True,
            )
    if options.json:
        options.json.write_text(json.dumps({"threads": options.threads, "rows": rows}, indent=1))


def made(images: int, observations: int):
    """A block of that many images from which nothing is missing."""
    block = corridor_block(
        images, strips=3, observations_per_image=observations, control=8, check=7, seed=1
    )
    return add_noise(block, **NOISE, **SLOW, seed=1)


def timed(block: Path, out: Path, threads: int) -> dict[str, float]:
    """Seconds, CPU seconds, seconds to the first sentence and peak MB of one diagnosis."""
    command = [sys.executable, "-m", "corridor", "diagnose", block, "-o", out]
    began, first = time.perf_counter(), None
    with subprocess.Popen(
        [*map(str, command), "--threads", str(threads)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:
        for _ in process.stdout:
            first = time.perf_counter() - began if first is None else first
        taken = spent(process)
    if process.returncode:
        raise SystemExit(f"the diagnosis of {block.name} ended with status {process.returncode}")
    return {"wall_s": time.perf_counter() - began, "first_s": first, **taken._asdict()}


def exponent(rows: list[dict], images: int, cpu: float) -> float | None:
    """With which power of the number of images the CPU time grew since the size before."""
    if not rows:
        return None
    last = rows[-1]
    return math.log(cpu / last["cpu_s"]) / math.log(images / last["images"])


if __name__ == "__main__":
    main()
