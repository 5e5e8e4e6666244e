"""What of a block was derived from its other columns: the table `derived` of its block.toml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from corridor.core.block import Block

_TABLE = "derived"


@dataclass(frozen=True)
class Derived:
    """One column, or columns of one kind, that a block did not have.

    column: `images.vx`, or a whole table, `gnss`. source: the file, or the columns, it came from.
    sigma: median standard deviation of one axis, in the column's unit; None where unknown.
    sentence: for a reader.
    """

    column: str
    source: str
    sigma: float | None
    sentence: str

    def to_dict(self) -> dict:
        """As in diagnosis.json and in the table `derived` of block.toml."""
        return {"column": self.column, "from": self.source, "sigma": self.sigma,
                "text": self.sentence}  # fmt: skip


def derived(block: Block) -> list[Derived]:
    """What of a prepared block nobody has measured, as its block.toml records it."""
    table = block.extra.get(_TABLE)
    if not isinstance(table, Mapping):
        return []
    return [
        Derived(column, str(one.get("from", "")), one.get("sigma"), str(one.get("text", "")))
        for column, one in table.items()
        if isinstance(one, Mapping)
    ]


def record(block: Block, column: str, source: str, sigma: np.ndarray | None, text: str) -> None:
    """Write into the block that a column is derived; see `Derived` for the words.

    sigma: standard deviations of any shape; None: unknown.
    """
    entry = {"from": source}
    if sigma is not None and np.isfinite(sigma).any():
        entry["sigma"] = float(np.nanmedian(sigma))
    block.extra[_TABLE] = {**block.extra.get(_TABLE, {}), column: {**entry, "text": text}}


def forget(block: Block, *columns: str) -> None:
    """Strike columns from what the block says is derived."""
    left = {k: v for k, v in block.extra.pop(_TABLE, {}).items() if k not in columns}
    if left:
        block.extra[_TABLE] = left
