"""What is hidden in a block, read from NAME.truth.json.

The least that does: `{"effects": [{"slug": "rolling_shutter"}]}`, or the slugs as a list, or
`{"effects": {"rolling_shutter": {"readout": 0.025}}}`. Names, units and
signs: those of the effects' files.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from corridor.core.effects import every_effect
from corridor.core.errors import InputError


@dataclass(frozen=True)
class Hidden:
    """One hidden effect.

    values: (owner, parameter) -> number; the owner is a flight, an image, a control point, or a
    survey, empty for the block. where: keys of `location` in diagnosis.json.
    """

    slug: str
    values: dict[tuple[str, str], float] = field(default_factory=dict)
    point: str | None = None
    where: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Truth:
    """inside: hidden effects of the catalogue, one a slug and control point; outside: others."""

    inside: tuple[Hidden, ...] = ()
    outside: tuple[Hidden, ...] = ()

    @property
    def kind(self) -> str:
        """null, single, together or unknown."""
        if self.outside:
            return "unknown"
        return ("null", "single")[len(self.inside)] if len(self.inside) < 2 else "together"

    @property
    def label(self) -> str:
        """Slugs joined by +; nothing."""
        return "+".join(one.slug for one in (*self.inside, *self.outside)) or "nothing"


def read_truth(file: Path) -> Truth:
    """The truth of a block. Raises InputError where the file says nothing on effects."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read as JSON ({error}): repair or remove it") from None
    return truth_of(content, str(file))


def truth_of(content: Mapping, source: str = "the truth") -> Truth:
    """The truth from what the file holds."""
    entries = content.get("effects") if isinstance(content, Mapping) else None
    if entries is None:
        raise InputError(f"{source} has no key effects: name there what is hidden, or []")
    if isinstance(entries, Mapping):
        entries = [
            {"slug": slug, "parameters": values if isinstance(values, Mapping) else {}}
            for slug, values in entries.items()
        ]
    physical = {effect.slug for effect in every_effect() if not effect.generic}
    stated = set(content.get("outside") or ())
    found: dict[tuple, Hidden] = {}
    for entry in entries:
        one = _hidden({"slug": entry} if isinstance(entry, str) else entry, source)
        key = one.slug, one.point
        if key in found:
            found[key].values.update(one.values)
            found[key].where.update(one.where)
        else:
            found[key] = one
    outside = [one for one in found.values() if one.slug in stated or one.slug not in physical]
    inside = [one for one in found.values() if one not in outside]
    return Truth(tuple(inside), tuple(outside))


def _hidden(entry: Mapping, source: str) -> Hidden:
    if not isinstance(entry, Mapping) or not entry.get("slug"):
        raise InputError(f"{source}: an entry of effects has no slug; name the effect")
    point = entry.get("point")
    owner = str(entry.get("flight") or point or entry.get("survey") or "")
    values: dict[tuple[str, str], float] = {}
    given = entry.get("parameters") or {}
    if not isinstance(given, Mapping):
        given = {p["name"]: p.get("value") for p in given if "name" in p}
    for name, value in given.items():
        for group, number in _numbers(value):
            values[group or owner, str(name)] = number
    for names, table in (entry.get("per_image") or {}).items():
        parts = [part.strip() for part in str(names).split(",")]
        for image, value in table.items():
            row = value if isinstance(value, (list, tuple)) else [value]
            for name, number in zip(parts, row, strict=False):
                if isinstance(number, (int, float)):
                    values[str(image), name] = float(number)
    where = entry.get("where") or entry.get("location")
    return Hidden(
        str(entry["slug"]), values, None if point is None else str(point),
        dict(where) if isinstance(where, Mapping) else {},
    )  # fmt: skip


def _numbers(value):
    """One number for all, or a number for each group."""
    if isinstance(value, Mapping):
        return [(str(k), float(v)) for k, v in value.items() if isinstance(v, (int, float))]
    return [("", float(value))] if isinstance(value, (int, float)) else []
