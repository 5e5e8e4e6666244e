"""What can be had: register.toml as types and as a table."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DataSet:
    """One set of data.

    kind: `shipped` (made by this project), `project` (of another program), `gnss` (a track with
    exposures), `readout` (a photograph of a blinking LED) or `photographs`. source, licence: whose
    it is and what one may do with it.
    address: what the files' paths follow. files: name -> (path, SHA-256, empty where none is
    known). known: figures that the files must come to; what they are depends on the kind.
    size_mb: of the download, None where unknown.
    """

    name: str
    kind: str
    about: str
    source: str
    licence: str
    size_mb: float | None = None
    address: str = ""
    files: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    known: Mapping[str, object] = field(default_factory=dict)

    @property
    def verified(self) -> bool:
        """Whether a hash is known of every file."""
        return all(digest for _, digest in self.files.values())


@lru_cache(maxsize=1)
def register() -> dict[str, DataSet]:
    """Every set by its name."""
    path = Path(__file__).with_name("register.toml")
    sets = {}
    for name, row in tomllib.loads(path.read_text(encoding="utf-8")).items():
        files = {one["name"]: (one["path"], one["sha256"]) for one in row.pop("file", [])}
        for photo in row.pop("photographs", []):
            files[Path(photo).name] = (photo, "")
        sets[name] = DataSet(name=name, files=files, **row)
    return sets


def table() -> pd.DataFrame:
    """A row a set: name, kind, size_mb, what it is, source, licence."""
    import pandas as pd  # at first use: the command's list does without

    columns = ("name", "kind", "size_mb", "about", "source", "licence")
    return pd.DataFrame([[getattr(one, c) for c in columns] for one in register().values()],
                        columns=columns)  # fmt: skip
