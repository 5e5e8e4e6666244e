"""Adjust or diagnose many blocks: on all cores or a cluster, one table and page for all.

examples:
  corridor batch adjust campaign/* -o out/campaign --required 0.02
      every block as `corridor adjust` does it, and one page: what needs attention first
  corridor batch diagnose campaign -o out/missing --camera fixed --jobs 4
      all blocks in a folder, four at a time; options of `adjust` and `diagnose` are for every block
  corridor batch adjust campaign/* -o out/campaign --scheduler tcp://host:8786
      on the workers of a Dask cluster (`dask scheduler`, and on each machine `dask worker
      tcp://host:8786 --nthreads 1 --nworkers 4`), which have corridor and share the disk

OUT holds report.html and batch.csv (a row a block, the most urgent first: verdict, sigma naught,
RMS of check points in metres, what to do first), batch.json, and for each block blocks/NAME, which
is what the verb writes. NAME is the part of a block's path that distinguishes it from the others.

The same command goes on where it was interrupted. What is done is not done again, unless the
block, the options or the version have changed; what failed is. A block that fails is a row with its
reason, the others go on, and the exit status is 1. A block whose worker died is tried once more
with nothing else running. One batch at a time writes to OUT. The numbers are those of one block at
a time, bit for bit.
"""

import argparse
import shlex
import sys
from pathlib import Path

from corridor.core import registry
from corridor.core.command.options import (
    BlockBar,
    add,
    announce_compilation,
    kinds,
    number,
    option,
    picked,
    wrote,
)
from corridor.core.errors import WorkFailed

MARK = "batch.json"
_adjust, _diagnose = registry.verb("adjust"), registry.verb("diagnose")


# What is asked of one block.
_ONE = ("--verbose", "--line")


def _of_many(options):
    """Options of a verb for one block, as they are for many."""
    return {name: told for name, told in options.items() if name not in _ONE} | {
        "block": option("folders of blocks, or folders that hold such folders", nargs="+"),
        "--output": option("folder for table, page and results", required=True),
    }


_SHARED_OUT = {
    "--jobs": option("processes (default: as many as there are cores for)", default=None),
    "--cluster": {},
    "--memory": option(
        "memory that each worker may use; a block that needs more fails (default: its share of "
        "the machine)",
        "GB",
        number("is not a memory size in GB above 0", above=0.0),
    ),
}
_VERBS = {
    "adjust": (
        "adjust every block",
        _of_many(_adjust.OPTIONS),
        """
campaign/* -o out/campaign --required 0.02
campaign/* -o out/campaign --camera fixed --effect rolling_shutter --jobs 4
""",
    ),
    "diagnose": (
        "diagnose every block",
        _of_many(_diagnose.OPTIONS),
        """
campaign/* -o out/missing
campaign/* -o out/missing --scheduler tcp://host:8786 --only rolling_shutter,clock_offset
""",
    ),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor batch`: those of the verb, and how it is shared out."""
    for one in kinds(parser, "batch", "what", "verb", _VERBS):
        add(one.add_argument_group("how it is shared out"), _SHARED_OUT)


def run(options: argparse.Namespace) -> None:
    """Do it, print what needs attention, and end with status 1 where a block failed."""
    from corridor.tools import batch

    announce_compilation("half a minute, and once in each new worker", "core")
    if options.verb == "diagnose":
        keywords = _diagnose.keywords(options) | {"counterparts": options.counterparts}
    else:
        keywords = _adjust.keywords(options)
    with BlockBar() as progress:
        try:
            result = batch.batch(
                options.verb,
                options.block,
                options.output,
                memory_gb=options.memory,
                progress=progress,
                **picked(options, "jobs cluster required gis"),
                command=_command(options.block),
                **keywords,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"the blocks that were done are kept in {options.output}; the same command goes on"
            ) from None
    print(result)
    wrote(*(options.output / name for name in ("batch.csv", "batch.json", "report.html")))
    failed = result.failed
    if failed:
        raise WorkFailed(
            f"{len(failed)} of {len(result.rows)} blocks, {failed[0].block} first; "
            f"{options.output / 'report.html'} says why, and the same command tries them again"
        )


def _command(blocks: list[Path]) -> str:
    """What was typed, with one word for all blocks."""
    named = {str(block) for block in blocks}
    words = [word for word in sys.argv[1:] if word not in named and str(Path(word)) not in named]
    return " ".join(["corridor", *map(shlex.quote, words[:2]), "BLOCKS", shlex.join(words[2:])])
