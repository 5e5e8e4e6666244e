"""Tables of draws: simulated surveys are flown and adjusted once, and a chapter reads the numbers.

A table is a file in `notebooks/draws/`, a row a draw. `python -m kit.draws` makes the draws that
the tables lack, `python -m kit.draws NAME --again` all of one table. A chapter makes a draw of its
own where the table lacks it (another seed, another tilt), and some again, to compare.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

FOLDER = Path(__file__).resolve().parents[1] / "draws"


@dataclass(frozen=True)
class Table:
    """Draws of one study.

    columns: what a draw is told by, planned: those that the table has, draw: makes one, a number a
    measure. decimals: of the numbers kept (None: six digits); least: what is smaller is zero.
    """

    name: str
    columns: Sequence[str]
    planned: Sequence[tuple]
    draw: Callable[..., dict[str, float]]
    decimals: int | None = None
    least: float = 0.0

    @property
    def path(self) -> Path:
        """The file."""
        return FOLDER / f"{self.name}.csv"

    def read(self) -> pd.DataFrame:
        """All draws that are kept, a row a draw: `columns`, then a column a measure."""
        if not self.path.exists():
            return pd.DataFrame(columns=list(self.columns))
        return pd.read_csv(self.path)

    @cached_property
    def _kept(self):
        rows = self.read().set_index(list(self.columns))
        return {head: row.dropna() for head, row in rows.iterrows()}

    def of(self, *head) -> dict[str, float]:
        """The numbers of one draw: as kept, or made now where the table lacks it."""
        kept = self._kept.get(head)
        return self.draw(*head) if kept is None else kept.to_dict()

    def some(self, heads: Sequence[tuple]) -> pd.DataFrame:
        """The numbers of several draws, a row each."""
        return pd.DataFrame([self.of(*head) for head in heads])

    def again(self, *head, made: dict[str, float] | None = None) -> str:
        """Makes a draw anew (or takes what was made) and says whether it is the one that is kept.

        Two machines differ in the last digits: to a thousandth of a number, or of the table's
        median of such numbers, it is the same one.
        """
        words = " ".join(str(part) for part in head)
        if head not in self._kept:
            return f"{words}: not among the draws that are kept"
        made = self.draw(*head) if made is None else made
        kept = self._kept[head]
        middle = self.read()[list(made)].abs().median()
        off = [
            name for name, value in made.items()
            if abs(value - kept[name])
            > max(1e-3 * abs(kept[name]), 1e-3 * middle[name], self._step / 2, self.least)
        ]  # fmt: skip
        return f"{words}, made again: {'NOT as kept: ' + ', '.join(off) if off else 'as kept'}"

    def missing(self, kept: pd.DataFrame) -> list[tuple]:
        """Planned draws that are not among these."""
        there = set(kept[list(self.columns)].itertuples(index=False, name=None))
        return [head for head in self.planned if head not in there]

    def complete(self, again: bool = False) -> None:
        """Makes the draws that the table lacks, or all; what is not planned any more goes."""
        columns = list(self.columns)
        kept = pd.DataFrame(columns=columns) if again else self.read()
        for head in self.missing(kept):
            print(f"{self.name}: {', '.join(str(part) for part in head)}", flush=True)
            row = dict(zip(columns, head, strict=True)) | {
                name: self._rounded(value) for name, value in self.draw(*head).items()
            }
            # Written after each: who interrupts goes on from there.
            kept = pd.concat([kept, pd.DataFrame([row])]).drop_duplicates(columns, keep="last")
            self._write(kept)
        print(f"{self.path}: {len(kept)} draws")

    def _write(self, kept):
        FOLDER.mkdir(exist_ok=True)
        kept = kept.sort_values(list(self.columns))
        kept.to_csv(self.path, index=False, float_format="%.10g", lineterminator="\n")

    @property
    def _step(self):
        return 0.0 if self.decimals is None else 10.0**-self.decimals

    def _rounded(self, value):
        if self.decimals is None:
            return float(f"{value:.6g}")
        return round(float(value), self.decimals)


def tables() -> dict[str, Table]:
    """All tables of the kit, by name: those of the modules that make one."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if "\nfrom kit.draws import Table\n" in path.read_text(encoding="utf-8"):
            module = vars(importlib.import_module(f"kit.{path.stem}"))
            found |= {one.name: one for one in module.values() if isinstance(one, Table)}
    return found


def main(arguments: list[str] | None = None) -> int:
    """Fly and adjust the draws that the tables lack, and write them."""
    parser = argparse.ArgumentParser(prog="python -m kit.draws", description=main.__doc__)
    known = tables()
    parser.add_argument("tables", nargs="*", help=f"of {', '.join(known)} (default: all)")
    parser.add_argument("--again", action="store_true", help="make all draws anew")
    options = parser.parse_args(arguments)
    for name in options.tables or known:
        if name not in known:
            parser.error(f"no table {name!r}: there are {', '.join(known)}")
        known[name].complete(options.again)
    return 0


if __name__ == "__main__":
    # Run as a program, this module is a second one, and its `Table` not that of the others.
    sys.exit(importlib.import_module("kit.draws").main())
