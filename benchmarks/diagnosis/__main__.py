"""Benchmark the diagnosis on blocks in which an effect is hidden.

examples:
  python -m benchmarks.diagnosis --cases all --short -o out/benchmark
      blocks of 40 images by the independent generator, each case once
  python -m benchmarks.diagnosis --cases null --count 100 --jobs 2 -o out/nulls
      a hundred blocks in which nothing is hidden; kinds: null, single, lookalike, together,
      unknown (outside the catalogue), perfect (no noise), all
  python -m benchmarks.diagnosis --blocks FOLDER -o out/theirs
      blocks of anybody's: FOLDER/NAME with FOLDER/NAME.truth.json and, where there is one,
      FOLDER/NAME_twin, the same block without the effect
  python -m benchmarks.diagnosis --cases single --cluster tcp://host:8786 -o out/single
      on the workers of a Dask cluster, which need corridor and nothing else

The truth needs {"effects": [{"slug": "rolling_shutter"}]}; with parameters (name, value, unit; the
names and units of the effects), errors and signal-to-noise ratios come too, with a twin the closing
of the gap. An interrupted run goes on where it stopped when the same command is given again.

OUT holds benchmark.json, benchmark.csv (a row a block), report.txt, confusion.png, rates.png and,
for each block, blocks/NAME.json, written as soon as it is done.
"""

import argparse
import sys
from pathlib import Path

from benchmarks import diagnosis as benchmark
from corridor.core.command.options import (
    BlockBar,
    checked,
    flag,
    number,
    option,
    say,
    several,
    whole,
    wrote,
)
from corridor.core.output import counted
from corridor.interface import cli

# A block of 40 images, its diagnosis and the baselines on one idle core: 7 to 14 s.
_SECONDS = 10.0
KINDS = ("null", "single", "lookalike", "together", "unknown", "perfect", "all")


_KINDS = several(
    checked(str, KINDS.__contains__, ""), f"names an unknown kind: use {', '.join(KINDS)}"
)
OPTIONS = {
    "--blocks": option("folder of blocks and truths", "FOLDER", Path, one_of="exactly"),
    "--cases": option(
        f"made on demand: {', '.join(KINDS)}; or A,B", "KIND", _KINDS, one_of="exactly"
    ),
    "--output": option("folder to write", required=True),
    "--count": option("blocks of each kind (default: its cases)", "N", whole("whole number", 1)),
    "--short": flag("blocks of 40 images in place of 80"),
    "--seed": option("of the blocks (default 0)"),
    "--jobs": {},
    "--cluster": {},
    "--level": option(
        "of a false name (default 0.01)",
        of=number("is not a probability between 0 and 1", above=0.0, below=1.0),
    ),
    "--without-baselines": flag("leave out what others would say"),
    "--again": flag("diagnose blocks anew that are done already"),
}


def run(options: argparse.Namespace) -> None:
    """Run, print the table, save it."""
    if options.blocks is not None:
        trials = benchmark.of_folder(options.blocks)
    else:
        trials = benchmark.of_generator(options.cases, options.count, options.seed, options.short)
    say(_how_long(trials, options))
    try:
        with BlockBar() as bar:
            rows = benchmark.run(
                trials,
                options.output,
                options.jobs,
                options.cluster,
                options.again,
                not options.without_baselines,
                bar,
                level=options.level,
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"the blocks that were done are kept in {options.output}; the same command goes on"
        ) from None
    found = benchmark.summary(rows)
    aside = ("run", "output", "jobs", "cluster", "again")
    settings = {k: str(v) for k, v in vars(options).items() if k not in aside and v is not None}
    written = benchmark.save(rows, found, options.output, settings)
    print(benchmark.as_text(found))
    wrote(*written, options.output / benchmark.KEPT)


def main(arguments: list[str] | None = None) -> int:
    """Run it as a command; the exit status is as that of `corridor`."""
    return cli.alone(sys.modules[__name__], "python -m benchmarks.diagnosis", arguments)


def _how_long(trials, options):
    """How many blocks there are, and how long they take, before the first is begun."""
    blocks = counted(len(trials), "block")
    if options.cluster is not None:
        return f"{blocks}, on the workers of {options.cluster}"
    if not options.short:
        return f"{blocks}; Ctrl-C keeps what is done"
    minutes = max(round(len(trials) * _SECONDS / options.jobs / 60), 1)
    long = f"{minutes / 60:.1f} hours" if minutes >= 90 else counted(minutes, "minute")
    return (
        f"{blocks}: about {long} on an idle machine ({_SECONDS:.0f} s a block and process); Ctrl-C "
        "keeps what is done"
    )


if __name__ == "__main__":
    sys.exit(main())
