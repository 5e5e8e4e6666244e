"""The same verdicts without velocities: blocks of the generator, diagnosed with them and without.

    python -m benchmarks.diagnosis.without_velocities OUT.json [--count 24] [--seed 7]

Few projects have velocities in a column; what a block can know of them by itself has to do. OUT
holds a row for each block, kept as soon as it is done.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import corridor
from benchmarks.diagnosis.generator.generate import generate
from benchmarks.diagnosis.generator.plan_of_benchmark import plan
from benchmarks.diagnosis.rates import Rate
from corridor.core.block import Block
from corridor.core.output import plain, whole_file, write_json

VELOCITY = ["vx", "vy", "vz"]


def without(block: Block) -> Block:
    """The block as a project that never wrote velocities."""
    out = block.copy()
    out.images = out.images.drop(columns=[name for name in VELOCITY if name in out.images])
    return out


def said(block: Block) -> dict:
    """Verdict, and what it is of."""
    found = plain(corridor.diagnose(block).to_dict())
    effects = sorted((one["slug"], one["class"]) for one in found["effects"])
    unknown = sorted((one["group"], one["class"]) for one in found["unknown"])
    return {"verdict": found["verdict"], "effects": effects, "unknown": unknown}


def main(arguments: list[str] | None = None) -> None:
    """Diagnose single effects both ways and print how often the verdict is the same."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.without_velocities")
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args(arguments)
    rows = json.loads(options.out.read_text())["rows"] if options.out.is_file() else {}
    for name, case, seed in plan("single", options.count, options.seed, short=True):
        if name not in rows:
            block = generate(case, seed).block
            rows[name] = {"with": said(block), "without": said(without(block))}
            with whole_file(options.out) as part:
                write_json({"rows": rows}, part)
        row = plain(rows[name])
        same = row["with"]["verdict"] == row["without"]["verdict"]
        print(f"{name}: {'same' if same else 'other'}; {row['with']}; {row['without']}", flush=True)
    both = [(row["with"], row["without"]) for row in rows.values()]
    print("same verdict:", Rate.of(a["verdict"] == b["verdict"] for a, b in both))
    print("same verdict of the same:", Rate.of(plain(a) == plain(b) for a, b in both))


if __name__ == "__main__":
    main()
