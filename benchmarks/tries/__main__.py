"""Run the tries, or some of them, and say which came out badly."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

from benchmarks.tries import made
from benchmarks.tries.listed import TRIES
from benchmarks.tries.running import judged


def main() -> int:
    """Status 1 where a try is bad."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tries", description=__doc__)
    parser.add_argument("--short", action="store_true", help="without those of many seconds")
    parser.add_argument("--only", help="numbers of tries, with commas between")
    parser.add_argument("--forms", action="store_true", help="those of a kind alone, and a table")
    parser.add_argument("--show", action="store_true", help="print what each command says")
    parser.add_argument("--world", type=Path, help="folder of the files, kept for the next time")
    options = parser.parse_args()
    only = set(options.only.split(",")) if options.only else None
    with tempfile.TemporaryDirectory() as folder:
        world = options.world or Path(folder) / "world"
        if not (world / "my.toml").is_file():
            print("making the files", file=sys.stderr)
            made.make(world, options.short)
        bad = count = 0
        kinds: dict[str, Counter] = defaultdict(Counter)
        for one in TRIES:
            if (only and one.number not in only) or (options.short and one.long):
                continue
            if options.forms and not one.kind:
                continue
            found = judged(one, world, Path(folder) / "out")
            count, bad = count + 1, bad + bool(found.fault)
            outcome = "bad" if found.fault else "told" if one.status else "right"
            kinds[one.kind][outcome] += bool(one.kind)
            print(
                f"{one.number:>5}  {'BAD  ' + found.fault if found.fault else 'good'}  {one.words}"
            )
            if options.show or found.fault:
                print("\n".join(f"         {line}" for line in found.text.splitlines()[-14:]))
    if options.forms:
        print("kind, forms, right or with a warning, refused with a sentence, bad")
        for kind, found in kinds.items():
            print(f"{kind}, {found.total()}, {found['right']}, {found['told']}, {found['bad']}")
    print(f"{count} tries, {bad} bad")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
