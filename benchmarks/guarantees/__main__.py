"""What is guaranteed, tried at length: `python -m benchmarks.guarantees --all`.

Each part writes its figures into docs/guarantees.json; docs/guarantees.md, the page, is written
from these, and from nothing else. Parts: malformed, interrupted, full, sigmas, order,
mutants.

examples:
  python -m benchmarks.guarantees malformed --cases 100000 --jobs 2
      all malformed inputs; --from K goes on from case K, and adds to the figures that are there,
      which are stored once a minute: --resume goes on where a run was stopped
  python -m benchmarks.guarantees malformed --case 4711
      one of them again, with all that it prints
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from benchmarks.guarantees import full, interrupted, malformed, mutants, order, sigmas, table

FIGURES = Path(__file__).parents[2] / "docs" / "guarantees.json"
PARTS = ("malformed", "interrupted", "full", "sigmas", "order", "mutants")


def main() -> int:
    """Run what is asked for; 1 where something that is guaranteed did not hold."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.guarantees",
        description=__doc__.partition("\n")[0],
        epilog=__doc__.partition("\n")[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("part", nargs="?", choices=(*PARTS, "page"))
    parser.add_argument("--all", action="store_true", help="every part, at full length")
    parser.add_argument("--cases", type=int, default=100_000, help="malformed inputs")
    parser.add_argument("--from", type=int, default=0, dest="first", help="number of the first")
    parser.add_argument("--resume", action="store_true", help="the cases that are left")
    parser.add_argument("--again", action="store_true", help="the faults once more")
    parser.add_argument("--case", type=int, help="this one alone, printed; no figures")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no case or verb after these"
    )
    parser.add_argument("--times", type=int, default=20, help="moments at which a verb is stopped")
    parser.add_argument("--draws", type=int, default=200, help="draws for errors over sigma")
    parser.add_argument(
        "--kinds", default="", help="sigmas of these (gnss,readout) alone; the others' figures stay"
    )
    parser.add_argument("--only", help="mutants with this in their mistake or file; no figures")
    parser.add_argument("--figures", type=Path, default=FIGURES, help="file of the figures")
    options = parser.parse_args()
    if options.case is not None:
        return _one(options)
    parts = PARTS if options.all else (options.part,) if options.part else ()
    if not parts:
        parser.error("name a part, or --all")
    sound = True
    for part in parts:
        sound &= part == "page" or _part(part, options)
    if not options.only:
        table.write(options.figures)
    return 0 if sound else 1


def _part(part, options) -> bool:
    """Run one part and store its figures; whether all holds."""
    known = table.stored(options.figures)
    if part == "malformed":
        figures = _malformed(known.get(part), options)
    elif part == "interrupted":
        figures = interrupted.run(options.times, options.seed, _say, options.minutes)
    elif part == "full":
        figures = full.run(_say, options.minutes)
    elif part == "sigmas":
        some = tuple(filter(None, options.kinds.split(",")))
        figures = sigmas.run(options.draws, options.seed, _say, some)
        if some:
            figures = sigmas.added(known.get(part), figures)
    elif part == "mutants":
        figures = mutants.run(options.only or "", _say)
        if options.only:
            return bool(figures["holds"])
    else:
        figures = order.run(options.seed)
    table.store(options.figures, part, figures)
    print(json.dumps({k: v for k, v in figures.items() if k != "faults"}, indent=1), flush=True)
    return bool(figures["holds"])


def _malformed(known, options) -> dict:
    """Run malformed cases; the figures with those that are there, stored once a minute."""
    cases = range(options.first, options.cases)
    if options.again:
        cases = [case["number"] for case in known["faults"]]
    elif options.resume:
        cases = malformed.left(known)

    def figures(found):
        now = malformed.figures(found)
        return malformed.added(known, now) if options.first or options.resume else now

    def store(found):
        table.store(options.figures, "malformed", figures(found))

    found = malformed.run(
        cases, options.seed, options.jobs, say=_say, minutes=options.minutes,
        store=None if options.again else store,
    )  # fmt: skip
    return malformed.retried(known, found) if options.again else figures(found)


def _say(what):
    print(what, flush=True)


def _one(options) -> int:
    """One malformed case, kept for looking at, with what the command printed."""
    home = Path(tempfile.mkdtemp(prefix="guarantees_"))
    found = malformed.run([options.case], options.seed, place=home, say=_say, keep=True)
    print(dict(found.outcomes), f"kept in {home}")
    return 1 if found.faults else 0


if __name__ == "__main__":
    sys.exit(main())
