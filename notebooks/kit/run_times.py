"""How long the chapters run: measured, and said at the top of each.

`python -m kit.run_times` executes chapters and writes what they took into
`notebooks/run_times.csv`; named chapters only, or one form, where that is asked for.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pandas as pd

NOTEBOOKS = Path(__file__).resolve().parents[1]
TABLE = NOTEBOOKS / "run_times.csv"
FORMS = {"full_s": False, "fast_s": True}


def read(table: Path = TABLE) -> pd.DataFrame:
    """Processor seconds of each chapter: a row a notebook, the columns of `FORMS`."""
    return pd.read_csv(table, index_col="notebook")


def sentence(notebook: str, table: Path = TABLE) -> str:
    """What the top of a chapter says, in Markdown."""
    full, fast = (_words(seconds) for seconds in read(table).loc[notebook, list(FORMS)])
    return f"*Run time on one core: {full}; in the fast form {fast}.*"


def _words(seconds):
    # Another machine is faster or slower by a half: more digits would say nothing.
    if seconds < 110:
        return f"about {max(10, round(seconds, -1)):.0f} seconds"
    return f"about {seconds / 60:.0f} minutes"


def measure(notebook: str, fast: bool, folder: Path) -> float:
    """Processor seconds of executing a chapter; what was executed is written into the folder."""
    import papermill

    folder.mkdir(parents=True, exist_ok=True)
    before = _spent()
    papermill.execute_notebook(
        NOTEBOOKS / f"{notebook}.ipynb",
        folder / f"{notebook}{'.fast' if fast else ''}.ipynb",
        parameters={"fast": fast},
        cwd=str(NOTEBOOKS),
        kernel_name="python3",
        start_timeout=600,
        progress_bar=False,
    )
    return _spent() - before


def _spent():
    import resource  # Windows has none, and needs none to read the table

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(arguments: list[str] | None = None) -> int:
    """Execute chapters one at a time and write their processor seconds into the table."""
    parser = argparse.ArgumentParser(prog="python -m kit.run_times", description=main.__doc__)
    parser.add_argument("notebooks", nargs="*", help="such as 00_quickstart (default: all)")
    parser.add_argument("--form", choices=("full", "fast"), help="only this one")
    parser.add_argument("--out", type=Path, default=NOTEBOOKS.parent / "out" / "run_times")
    options = parser.parse_args(arguments)
    table = read() if TABLE.exists() else pd.DataFrame(columns=list(FORMS), dtype=float)
    for notebook in options.notebooks or sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")):
        for column, fast in FORMS.items():
            if options.form and column != f"{options.form}_s":
                continue
            seconds = measure(notebook, fast, options.out)
            table.loc[notebook, column] = round(seconds)
            print(f"{notebook} {column} {seconds:.0f}", flush=True)
            written = table.sort_index().rename_axis("notebook")
            written.to_csv(TABLE, float_format="%.0f", lineterminator="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
