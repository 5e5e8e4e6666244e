"""What the cells of the template call to show something."""

from __future__ import annotations

import pickle
from html import escape
from pathlib import Path

import pandas as pd
from IPython.display import HTML, Image, display
from matplotlib.figure import Figure


class Page:
    """The contents of a report, shown piece by piece."""

    def __init__(self, contents: str, pictures: str):
        with open(contents, "rb") as file:
            self._contents = pickle.load(file)
        self._pictures = Path(pictures)

    def __getattr__(self, name: str):
        return getattr(self._contents, name)

    @property
    def nothing(self) -> bool:
        """Whether nothing is missing."""
        return self._contents.verdict == "nothing"

    def opening(self) -> None:
        """Title, the sentence, and what did not go as usual."""
        c = self._contents
        parts = [f"<h1>What is missing from the model of {escape(c.name)}?</h1>"]
        parts.append(f'<p class="sentence">{_text(c.sentence)}</p>')
        parts += [f'<p class="note">{_text(note)}</p>' for note in c.notes]
        display(HTML("\n".join(parts)))

    def picture(self, name: str, figure: Figure) -> None:
        """A picture on the page and as a file."""
        path = self._pictures / f"{name}.png"
        figure.savefig(path, format="png", dpi=144, metadata={"Software": None})
        display(Image(filename=str(path), alt=name.replace("_", " ")))

    def table(self, name: str) -> None:
        """A table, where there is one of that name."""
        if name in self._contents.tables:
            display(HTML(html_table(self._contents.tables[name])))

    def again(self) -> None:
        """The command and the versions."""
        if self._contents.command:
            display(HTML(f"<pre>{escape(self._contents.command)}</pre>"))
        self.table("versions")


def html_table(frame: pd.DataFrame) -> str:
    """A table of texts; columns of numbers end on the right."""
    right = [_numbers(frame[name]) for name in frame]

    def row(tag: str, cells) -> str:
        kinds = ("<{0} class='number'>{1}</{0}>" if r else "<{0}>{1}</{0}>" for r in right)
        return "".join(k.format(tag, _text(c)) for k, c in zip(kinds, cells, strict=True))

    body = "\n".join(f"<tr>{row('td', cells)}</tr>" for cells in frame.itertuples(index=False))
    head = f"<thead><tr>{row('th', frame.columns)}</tr></thead>"
    return f'<div class="wide"><table>{head}\n<tbody>{body}</tbody></table></div>'


def _numbers(column: pd.Series) -> bool:
    """Whether numbers prevail where anything stands in a column."""
    told = [text for text in column if any(letter.isalnum() for letter in text)]
    numbers = [text for text in told if text.lstrip("+-\u00b1 ")[:1].isdigit()]
    return len(numbers) > len(told) / 2


def _text(text: object) -> str:
    return escape(str(text).replace("+-", "\u00b1"))
