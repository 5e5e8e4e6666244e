"""What of a block was derived, and what else says so: the table `derived` of its block.toml.

What is derived is a hypothesis. Each record says what it was made from, in which frame, how good
it is, and which other measurements agree with it, contradict it, or cannot check it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from corridor.core.block import Block
from corridor.core.output import Table, short

_TABLE = "derived"


# Of block.toml: the block is in the free frame of a reconstruction, its lengths are in no unit.
FRAME, ARBITRARY = "frame", "arbitrary"
AGREES, CONTRADICTS, UNCHECKED = "agrees", "contradicts", "cannot be checked"


class Witness(NamedTuple):
    """What else could say so.

    source: a file, a column, a tag. says: AGREES, CONTRADICTS or UNCHECKED. text: with the number.
    """

    source: str
    says: str
    text: str = ""

    def __str__(self) -> str:
        return f"{self.source} {self.says}" + (f" ({self.text})" if self.text else "")


@dataclass(frozen=True)
class Derived:
    """One column, or columns of one kind, that a block did not have.

    column: `images.vx`, or a whole table, `gnss`. source: the file, or the columns, it came from.
    sigma: median standard deviation of one axis, in the column's unit; None where unknown.
    sentence: for a reader. frame: of the values; empty: the block's. witnesses: what else says so.
    """

    column: str
    source: str
    sigma: float | None
    sentence: str
    frame: str = ""
    witnesses: tuple[Witness, ...] = ()

    def to_dict(self) -> dict:
        """As in diagnosis.json."""
        return {"column": self.column, "from": self.source, "sigma": self.sigma,
                "text": self.sentence, "frame": self.frame,
                "witnesses": [_entry(one) for one in self.witnesses]}  # fmt: skip


def derived(block: Block) -> list[Derived]:
    """What of a prepared block nobody has measured, as its block.toml records it."""
    table = block.extra.get(_TABLE)
    if not isinstance(table, Mapping):
        return []
    return [
        Derived(
            column, str(one.get("from", "")), one.get("sigma"), str(one.get("text", "")),
            str(one.get("frame", "")),
            tuple(
                Witness(*(str(each.get(key, "")) for key in ("from", "says", "text")))
                for each in one.get("witnesses", ())
                if isinstance(each, Mapping)
            ),
        )
        for column, one in table.items()
        if isinstance(one, Mapping)
    ]  # fmt: skip


def record(
    block: Block,
    column: str | Iterable[str],
    source: str,
    sigma: np.ndarray | None,
    text: str,
    frame: str = "",
    witnesses: Iterable[Witness] = (),
) -> None:
    """Write into the block that a column is derived, or some; see `Derived` for the words.

    sigma: standard deviations of any shape; None: unknown.
    """
    entry: dict = {"from": source}
    if sigma is not None and np.isfinite(sigma).any():
        entry["sigma"] = float(np.nanmedian(sigma))
    entry["text"] = text
    if frame:
        entry["frame"] = frame
    told = [_entry(one) for one in witnesses]
    if told:
        entry["witnesses"] = told
    columns = [column] if isinstance(column, str) else column
    block.extra[_TABLE] = {**block.extra.get(_TABLE, {}), **{one: dict(entry) for one in columns}}


def _entry(witness: Witness) -> dict[str, str]:
    return {"from": witness.source, "says": witness.says, "text": witness.text}


def contradicted(block: Block) -> list[str]:
    """A sentence on each derived thing that something else contradicts, with what does so."""
    return [
        f"{one.sentence} Contradicted by {against.source}: {against.text or 'see there'}."
        for one in derived(block)
        for against in one.witnesses
        if against.says == CONTRADICTS
    ]


def derived_table(block: Block) -> Table | None:
    """What was derived as one table, each with what else says so; None where nothing was."""
    rows: dict[tuple, list[str]] = {}
    for one in derived(block):
        sigma = "" if one.sigma is None else f"{one.sigma:.2g}"
        checked = "; ".join(map(str, one.witnesses)) or "nothing else says so"
        rows.setdefault((one.source, sigma, checked), []).append(one.column)
    if not rows:
        return None
    told = [
        (_together(columns), short(source, 30), sigma, checked)
        for (source, sigma, checked), columns in rows.items()
    ]
    header = ("derived", "from", "sigma", "what else says so")
    return Table("Derived, not measured", header, tuple(told), "llrw")


def _together(columns: list[str]) -> str:
    """`images.vx, vy, vz` of columns of one table."""
    table = columns[0].partition(".")[0]
    return ", ".join([columns[0], *(column.removeprefix(f"{table}.") for column in columns[1:])])


def forget(block: Block, *columns: str) -> None:
    """Strike columns from what the block says is derived."""
    left = {k: v for k, v in block.extra.pop(_TABLE, {}).items() if k not in columns}
    if left:
        block.extra[_TABLE] = left
