"""Names of images: one file or program writes them otherwise than another, and means the same."""

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import pandas as pd

_ENDINGS = frozenset("jpg jpeg tif tiff png dng raw arw cr2 cr3 nef orf rw2 webp bmp gif".split())


def _folders(name: str) -> str:
    return unicodedata.normalize("NFC", name).replace("\\", "/").removeprefix("./")


def without_ending(name: str) -> str:
    """The name without the ending of a picture; other dots belong to it."""
    stem, _, ending = name.rpartition(".")
    return stem if stem and ending.lower() in _ENDINGS else name


# How alike two names are, from the same to the least alike, and what differs in a sentence.
_STEPS: tuple[tuple[str, Callable[[str], str]], ...] = (
    ("", str),
    ("", _folders),
    ("upper and lower case", lambda name: _folders(name).casefold()),
    ("the folder", lambda name: _folders(name).rpartition("/")[2]),
    ("the folder, upper and lower case", lambda name: _folders(name).rpartition("/")[2].casefold()),
    ("the ending", lambda name: without_ending(_folders(name)).casefold()),
    (
        "the folder and the ending",
        lambda name: without_ending(_folders(name).rpartition("/")[2]).casefold(),
    ),
)


def numbered(names: Iterable[str]) -> list[str]:
    """The names, with the number of its use before each that was there already: 2/NAME."""
    seen: Counter = Counter()
    made = []
    for name in names:
        seen[name] += 1
        made.append(name if seen[name] == 1 else f"{seen[name]}/{name}")
    return made


class Names:
    """Rows of images by their names, also where case, ending, folder or form of umlauts differ.

    A name that could be several images is none. What was matched so is kept, for a sentence.
    """

    def __init__(self, images: Iterable[str]):
        names = [str(name) for name in images]
        self._rows = []
        for _, make in _STEPS:
            made = pd.Series([make(name) for name in names], dtype="object")
            alone = made[~made.duplicated(keep=False)]
            self._rows.append(dict(zip(alone, alone.index, strict=True)))
        self._images, self._matched = names, {}

    def row(self, name: str) -> int | None:
        """The row of the image that a name means; None where there is none, or several."""
        for (differs, make), rows in zip(_STEPS, self._rows, strict=True):
            row = rows.get(make(name))
            if row is not None:
                if differs:
                    self._matched.setdefault(differs, {})[name] = self._images[row]
                return int(row)
        return None

    def told(self, what: str) -> list[str]:
        """Sentences on names that were matched although something differs."""
        return [
            f"{what}: names of {len(pairs)} images differ from the project's in {differs} "
            f"({next(iter(pairs))} is {next(iter(pairs.values()))}): matched"
            for differs, pairs in self._matched.items()
        ]


def in_any_case(path: Path) -> Path:
    """A path, or where there is none the file of its folder with that name in another case."""
    if path.exists() or not path.parent.is_dir():
        return path
    files = sorted(path.parent.iterdir())
    return next((file for file in files if file.name.lower() == path.name.lower()), path)
