"""What a form states, and what it has to go by."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.output import Table, counted, millimetres, png, readable

# Points of one kind that are listed; of more, the farthest off.
MOST_LISTED = 40
# What the column `vegetated` of ground.csv may hold; a spreadsheet makes 1.0 of 1.
_VEGETATED = (
    {"": None}
    | dict.fromkeys(("1", "1.0", "true", "yes"), True)
    | dict.fromkeys(("0", "0.0", "false", "no"), False)
)


@dataclass(frozen=True)
class Statement:
    """What a certificate states, in one form.

    opening: the claim, or why there is none. doubts: what speaks against the figures. tables and
    pictures (name, caption, PNG). untested: sentences. figures: numbers by name, for comparison.
    """

    opening: str
    doubts: Sequence[str]
    tables: Sequence[Table]
    untested: Sequence[str]
    figures: dict[str, Any]
    pictures: list[tuple[str, str, bytes]] = field(default_factory=list)


@dataclass(frozen=True)
class Subject:
    """A block as read, its adjustment, and the accuracy that is asked for (m, 3D) if one is."""

    block: Block
    adjustment: Adjustment
    required: float | None

    @cached_property
    def checked(self) -> "CheckPoints":
        """The check points, with their survey."""
        return CheckPoints.of(self.adjustment)

    @cached_property
    def reported(self) -> dict[str, Table]:
        """Tables of the adjustment's report, by their titles."""
        tables = registry.room("report").of_adjustment(self.adjustment).tables
        return {table.title: table for table in tables}

    @cached_property
    def tied_to_ground(self) -> bool:
        """Whether control or GNSS determine where the block lies."""
        p = self.adjustment.problem
        return bool(len(p.control_rows) or len(p.gnss_image))

    def compared(self, found: float) -> str:
        """Whether a 3D error, m, is within what is required: a sentence, or nothing."""
        if self.required is None:
            return ""
        word = "within" if found <= self.required else "beyond"
        wanted = millimetres(self.required)
        return f" In 3D that is {millimetres(found)}, {word} the required {wanted}."

    def picture(self, name: str, of: Any, caption: str) -> tuple[str, str, bytes]:
        """A picture by the name of its function in `corridor.figures`."""
        figure = getattr(registry.room("figures"), name)(of)
        return name.replace("_", " "), caption, png(figure, dpi=110)

    @property
    def reference(self) -> str:
        """Coordinate system and heights, in a sentence."""
        block = self.block
        local = block.extra.get("local_frame")
        if block.crs:
            named = f"The coordinates are in {block.crs}"
        elif local:
            named = f"The coordinates are in a local frame (block.toml: local_frame = {local})"
        else:
            named = "No coordinate system is stated: coordinates are local"
        shift = ", ".join(readable(value) for value in block.offset)
        moved = f", with the offset {shift} m to be added" if np.any(block.offset) else ""
        return (
            f"{named}{moved}. Heights are those of the ground points and antenna positions as "
            "given; no height system was converted or tested."
        )


@dataclass(frozen=True)
class CheckPoints:
    """Differences adjusted minus given (n, 3), m; survey (n, 3): standard deviations of the given,
    m; stated (n,): whether ground.csv states these for the point, rather than a default; names;
    xyz (n, 3): where; vegetated (n,): True, False or None where nothing says it."""

    names: list[str]
    difference: np.ndarray
    survey: np.ndarray
    stated: np.ndarray
    xyz: np.ndarray
    sigma: np.ndarray
    vegetated: list[bool | None]

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, adjustment: Adjustment) -> "CheckPoints":
        """Those of an adjustment that images show."""
        table, block = adjustment.check_points, adjustment.problem.block
        ground = block.ground
        at = pd.Index(ground["point"].astype(str)).get_indexer(table["point"].astype(str))
        stated = np.isfinite(block.numbers("ground", "sx", "sy", "sz")[at]).all(axis=1)
        cover: list[bool | None] = [None] * len(at)
        if "vegetated" in ground:
            words = ground["vegetated"].astype("string").fillna("").str.strip()
            odd = words.index[~words.str.lower().isin(_VEGETATED)]
            if len(odd):
                row = words.index.get_loc(odd[0]) + 2
                raise InputError(
                    f"ground.csv, row {row}: vegetated = {words[odd[0]]!r} is not 1 (in "
                    "vegetation), 0 or an empty cell"
                )
            cover = [_VEGETATED[word] for word in words.str.lower().iloc[at]]
        return cls(
            table["point"].astype(str).tolist(),
            table[["dx", "dy", "dz"]].to_numpy(float).reshape(-1, 3),
            block.ground_sigma()[at].reshape(-1, 3),
            stated,
            block.numbers("ground", *"xyz")[at].reshape(-1, 3),
            table[["sx", "sy", "sz"]].to_numpy(float).reshape(-1, 3),
            cover,
        )

    def listed(self) -> Table:
        """Each point, or of many the farthest off, in millimetres."""
        away = np.linalg.norm(self.difference, axis=1)
        rows = np.argsort(-away, kind="stable")[:MOST_LISTED]
        rows = np.sort(rows)
        cells = tuple(
            (self.names[k], *(f"{1e3 * value:.1f}" for value in self.difference[k]),
             *(f"{1e3 * value:.1f}" for value in self.sigma[k]),
             *(f"{1e3 * value:.1f}" for value in self.survey[k]))
            for k in rows
        )  # fmt: skip
        notes = [
            "dx, dy, dz: adjusted minus given; sx, sy, sz: standard deviations of the adjusted "
            "point; survey: those of the given point; mm"
        ]
        if len(rows) < len(self):
            notes.append(f"the {len(rows)} farthest off of {counted(len(self), 'point')}")
        header = ("check point", "dx", "dy", "dz", "sx", "sy", "sz", "survey x", "y", "z")
        return Table("Check points", header, cells, "l" + 9 * "r", tuple(notes))
