"""Diagnose dirty blocks of growing size, and their doubles.

    python -m benchmarks.ladder -o OUT.json [--sizes 12,45,120,320] [--count 200] [--seed 0]
        [--once] [--figures docs/guarantees.json]

Of every size so many blocks by an independent generator: lenses that are no polynomial, rows that
shift, clusters of wrong matches, uneven overlap, missing positions, gaps, two cameras, control or
none. Nothing of the catalogue is in them: a diagnosis has to end, to name nothing, and to say of
two copies in a row (without positions: of half the points) what it says of the block. OUT holds
a row a block, kept when it is done: the same command goes on where it stopped. The sizes of the
whole ladder are 12, 45, 120, 320, 600, 1200 and 2500.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks.guarantees import table
from benchmarks.ladder.climb import climb, false_names, rates
from corridor.core.output import whole_file, write_json


def main(arguments: list[str] | None = None) -> None:
    """Climb, and print what came of it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ladder")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--sizes", default="12,45,120,320", help="images, commas")
    parser.add_argument("--count", type=int, default=200, help="blocks of each size")
    parser.add_argument("--seed", type=int, default=0, help="of the first block")
    parser.add_argument("--once", action="store_true", help="without the doubles")
    parser.add_argument("--figures", type=Path, help="docs/guarantees.json, to hold the figures")
    options = parser.parse_args(arguments)
    rows = json.loads(options.output.read_text())["rows"] if options.output.is_file() else {}
    for size in map(int, options.sizes.split(",")):
        for seed in range(options.seed, options.seed + options.count):
            name = f"{size}_{seed}"
            if name in rows:
                continue
            rows[name] = row = climb(size, seed, not options.once)
            told = [_told(row[key]) for key in ("once", "double") if key in row]
            apart = "" if row.get("agree", True) else "  APART"
            print(f"{name}: {' | '.join(told)}{apart}", flush=True)
            with whole_file(options.output) as part:
                write_json({"rates": rates(rows.values()), "rows": rows}, part)
    found = rates(rows.values())
    for size, figures in found.items():
        print(size, "; ".join(f"{name} {figure}" for name, figure in figures.items()))
    if options.figures is not None:
        table.store(options.figures, "ladder", found)
        table.write(options.figures)


def _told(one: dict) -> str:
    for key in ("crash", "refused"):
        if key in one:
            return f"{key}: {one[key]}"
    names = [f"{slug} ({kind})" for slug, kind, *_ in (*one["effects"], *one["unknown"])]
    false = " FALSE" if false_names(one) else ""
    return f"{one['verdict']} {', '.join(names)} {one['seconds']:.0f} s{false}"


if __name__ == "__main__":
    main()
