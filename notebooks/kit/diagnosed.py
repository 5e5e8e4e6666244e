"""The game of hiding effects, played by the program: what was hidden, and what was said.

`notebooks/diagnosed.csv` has a row for what was hidden, a column for each answer, and the number
of flights. `python -m kit.diagnosed OUT` makes it again: it flies, has the benchmark of the
diagnosis judge the flights, and goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from kit import hide
from kit.drawings import confusion_matrix

TABLE = Path(__file__).resolve().parents[1] / "diagnosed.csv"
NOTHING = "nothing"
# What the benchmark of the diagnosis calls an answer that names no effect for certain.
ANSWERS = ("its set", "another set", "unknown", "suspected", "nothing", "failed")


def read(table: Path = TABLE) -> pd.DataFrame:
    """Number of flights: what was hidden down, what was said across."""
    return pd.read_csv(table, index_col="hidden")


def picture(title: str, counts: pd.DataFrame) -> Figure:
    """The confusion matrix."""
    return confusion_matrix(list(counts.index), list(counts.columns), counts.to_numpy(), title)


def told(counts: pd.DataFrame) -> str:
    """How many flights were named rightly and wrongly, a line for effects and one for nothing."""
    names = counts[[answer for answer in counts if answer not in ANSWERS]]
    null = counts.index == NOTHING
    right = sum(names.loc[slug, slug] for slug in names.index.intersection(names.columns))
    named, all_of_them = names[~null].to_numpy().sum(), counts[~null].to_numpy().sum()
    return (
        f"an effect hidden in {all_of_them} flights: {right} named rightly, "
        f"{named - right} wrongly, {all_of_them - named} not named alone\n"
        f"nothing hidden in {counts[null].to_numpy().sum()} flights: "
        f"{names[null].to_numpy().sum()} given a name"
    )


def fly(folder: Path, rounds: int) -> None:
    """Flights with every effect of the game at every level, and with nothing as often.

    Each is a block NAME with what is hidden in it in NAME.truth.json, as the benchmark reads it.
    """
    for number in range(rounds):
        for rank, (effect, level) in enumerate((e, s) for e in hide.SIZES for s in hide.LEVELS):
            name = f"{number + 1}-{effect}-{level}"
            truth = folder / f"{name}.truth.json"
            if truth.exists():
                continue
            # A flight of its own for each: the same noise twice would be one flight.
            flown = hide.hide(folder / name, effect, level, seed=100 * number + rank)
            sealed = hide.open_seal(flown)
            content = [] if effect == NOTHING else [
                {"slug": sealed["hidden"], "parameters": sealed["values"]}
            ]  # fmt: skip
            truth.write_text(json.dumps({"effects": content}) + "\n", encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    """Fly, have the flights diagnosed, and keep the answers."""
    parser = argparse.ArgumentParser(prog="python -m kit.diagnosed", description=main.__doc__)
    parser.add_argument("out", type=Path, help="folder for flights and answers")
    parser.add_argument("--rounds", type=int, default=1, help="flights of each (default 1)")
    options = parser.parse_args(arguments)
    # Only the source tree has it: readers of the chapter do not need it.
    from benchmarks import diagnosis as benchmark

    fly(options.out / "flights", options.rounds)
    rows = benchmark.run(
        benchmark.of_folder(options.out / "flights"), options.out / "answers", rivals=False,
        progress=lambda step: print(step, flush=True),
    )  # fmt: skip
    found = benchmark.summary(rows)["confusion"]
    counts = pd.DataFrame(found["counts"], found["hidden"], found["answers"])
    counts.to_csv(TABLE, index_label="hidden", lineterminator="\n")
    print(f"wrote {TABLE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
