"""Section by section, what the three works contain and where it is done again.

`python -m kit.coverage` writes `notebooks/coverage.md` from the register `notebooks/coverage.toml`.
"""

import argparse
import sys
import tomllib
from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[1]
STATUS = {
    "done": "done",
    "not applicable": "nothing to compute",
    "cannot": "cannot be done again",
    "open": "could be done, and is not",
}


def read(folder: Path = NOTEBOOKS) -> dict[str, dict]:
    """The register: work -> title and sections."""
    return tomllib.loads((folder / "coverage.toml").read_text(encoding="utf-8"))


def headings(notebook: str, folder: Path = NOTEBOOKS) -> set[str]:
    """Headings of a notebook, as its .py has them."""
    lines = (folder / f"{notebook}.py").read_text(encoding="utf-8").splitlines()
    marked = (line.removeprefix("# ") for line in lines if line.startswith("# #"))
    return {line.lstrip("#").strip() for line in marked}


def page(folder: Path = NOTEBOOKS) -> str:
    """Markdown page of the register."""
    parts = [
        "# What is done again, and where\n",
        "Section by section of the works that the chapters follow. Made from `coverage.toml` by",
        "`python -m kit.coverage`; do not edit.",
    ]
    for work in read(folder).values():
        rows = work["sections"]
        counts = {status: sum(r["status"] == status for r in rows) for status in STATUS}
        words = ", ".join(f"{n} {STATUS[s]}" for s, n in counts.items() if n)
        parts += [f"\n## {work['title']}\n", f"{words}.\n"]
        parts += ["| at | what | | where, or why not |", "| --- | --- | --- | --- |"]
        for row in rows:
            cells = row["at"], row["what"], STATUS[row["status"]], _answer(row)
            parts.append("| " + " | ".join(cells) + " |")
    return "\n".join(parts) + "\n"


def _answer(row):
    words = []
    if "where" in row:
        notebook, heading = row["where"].split("#", 1)
        words.append(f"[{notebook}]({notebook}.ipynb), {heading}")
    if "why" in row:
        words.append(row["why"])
    return "; ".join(words)


def main(arguments: list[str] | None = None) -> int:
    """Write the page."""
    argparse.ArgumentParser(prog="python -m kit.coverage", description=main.__doc__).parse_args(
        arguments
    )
    target = NOTEBOOKS / "coverage.md"
    target.write_text(page(), encoding="utf-8", newline="\n")
    print(f"wrote {target}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
