"""Values of effects: what was given, found or stated, and how every file holds it.

The only reader and writer of effect values: adjustment.json, diagnosis.json, NAME.truth.json, the
tables effect_SLUG.csv, `stated` and [corrected] of block.toml, and SLUG:parameter=value.
"""

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.effects.context import GROUPS, Images, control_names, group_names
from corridor.core.effects.contract import Effect, Parameter
from corridor.core.effects.registry import find
from corridor.core.errors import InputError
from corridor.core.output import as_it_was

# Groups from which on a JSON file holds a summary, and a table beside it the values.
MOST_GROUPS = 50
_COLUMNS = ["slug", "parameter", "group", "value", "sigma", "unit"]
# (group or None for all, parameter) -> value and sigma
_Cells = dict[tuple[str | None, str], tuple[float, float]]


@dataclass(eq=False, repr=False)
class EffectValues(Mapping):
    """Values of one effect, a set for each group of those that share one.

    groups: names. value, sigma: (groups, parameters) in the parameters' units; NaN where unknown.
    As a mapping: parameter -> number, or `{group: number}` where there are several groups.
    """

    effect: Effect
    groups: list[str]
    parameters: list[Parameter]
    value: np.ndarray
    sigma: np.ndarray

    def __repr__(self) -> str:
        names = ", ".join(f"{one.name} ({one.unit})" for one in self.parameters[:6])
        more = ", ..." if len(self.parameters) > 6 else ""
        shared = "the block" if self.kind == "block" else f"{len(self.groups)} x {self.kind}"
        return f"{self.slug}: {names}{more} of {shared}"

    @property
    def slug(self) -> str:
        """Public name of the effect."""
        return self.effect.slug

    @property
    def kind(self) -> str:
        """Who shares a set of values: one of `GROUPS`."""
        return self.effect.group

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [parameter.name for parameter in self.parameters]

    @property
    def filled(self) -> np.ndarray:
        """Values (groups, parameters), the start value where one is unknown."""
        return np.where(np.isnan(self.value), [p.start for p in self.parameters], self.value)

    def __iter__(self) -> Iterator[str]:
        known = np.isfinite(self.value).any(axis=0)
        return (name for name, any_known in zip(self.names, known, strict=True) if any_known)

    def __len__(self) -> int:
        return int(np.isfinite(self.value).any(axis=0).sum())

    def __getitem__(self, parameter: str) -> float | dict[str, float]:
        if parameter not in self.names:
            raise KeyError(parameter)
        column = self.value[:, self.names.index(parameter)]
        if len(self.groups) == 1:
            return float(column[0])
        rows = np.flatnonzero(np.isfinite(column))
        return {self.groups[g]: float(column[g]) for g in rows}

    def __str__(self) -> str:
        """SLUG:parameter=value,... as the command line takes it; means of several groups."""
        mean = {name: np.mean(list(_by_group(self[name]).values())) for name in self}
        return f"{self.slug}:" + ",".join(f"{name}={value:.6g}" for name, value in mean.items())

    @property
    def frame(self) -> pd.DataFrame:
        """Table slug, parameter, group, value, sigma, unit: one row a known number."""
        rows = [
            (self.slug, p.name, self.groups[g], self.value[g, k], self.sigma[g, k], p.unit)
            for k, p in enumerate(self.parameters)
            for g in np.flatnonzero(np.isfinite(self.value[:, k]))
        ]
        return pd.DataFrame(rows, columns=_COLUMNS)

    @property
    def table(self) -> str:
        """Name of the table beside a JSON file, empty where the file itself holds all values."""
        known = np.isfinite(self.value).any(axis=1).sum()
        return f"effect_{self.slug}.csv" if known > MOST_GROUPS else ""

    def to_json(self) -> dict:
        """{parameter: {value, sigma, unit}}, of several groups {group: {parameter: ...}}.

        Of more than `MOST_GROUPS` groups a summary for each parameter, which names the table.
        """
        if self.table:
            return {
                p.name: {
                    "groups": int(np.isfinite(value).sum()),
                    "mean": np.nanmean(value),
                    "std": np.nanstd(value, ddof=1),
                    "min": np.nanmin(value),
                    "max": np.nanmax(value),
                    "sigma": np.nanmedian(sigma) if np.isfinite(sigma).any() else None,
                    "unit": p.unit,
                    "table": self.table,
                }
                for p, value, sigma in zip(self.parameters, self.value.T, self.sigma.T, strict=True)
            }
        by_group = {}
        for g, group in enumerate(self.groups):
            mine = {
                p.name: {"value": self.value[g, k], "sigma": self.sigma[g, k], "unit": p.unit}
                for k, p in enumerate(self.parameters)
                if np.isfinite(self.value[g, k])
            }
            if mine:
                by_group[str(group)] = mine
        return next(iter(by_group.values())) if len(by_group) == 1 else by_group


class Values(Mapping):
    """Values of several effects: slug -> `EffectValues`.

    Whatever takes `{slug: {parameter: number or {group: number}}}` takes it as well.
    """

    def __init__(self, effects: Iterable[EffectValues] = ()):
        self._effects: dict[str, EffectValues] = {}
        for one in effects:
            if one.slug in self._effects:
                raise InputError(f"effect {one.slug} is given twice: give it once")
            self._effects[one.slug] = one

    def __getitem__(self, slug: str) -> EffectValues:
        return self._effects[slug]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def __str__(self) -> str:
        return "\n".join(str(one) for one in self.values())

    def __repr__(self) -> str:
        return f"Values of {', '.join(map(repr, self.values())) or 'no effect'}"

    @classmethod
    def of(cls, block: Block, given: Mapping, images: Images | None = None) -> "Values":
        """Values that a person gives, for the groups of a block.

        given: by slug, `slug@flight` or effect: `{parameter: number or {group: number}}`, an array
        (groups, parameters), or None for what the block states. images: those of the block, where
        they are known already. Raises InputError for unknown names, and where the block states
        nothing.
        """
        images, points = images or Images.of(block), control_names(block)
        out = []
        for name, mine in given.items():
            effect = (mine.effect if isinstance(mine, EffectValues) else effect_of(name)).form(
                block
            )
            if mine is None:
                mine = _stated(effect, block)
            if isinstance(mine, Mapping):
                cells = _given_cells(mine)
                effect = _grouped(effect, name, cells, images, points)
                out.append(_filled(effect, cells, block, images, points))
            else:
                found = _filled(effect, {}, block, images, points)
                found.value[:] = np.asarray(mine, dtype=float)
                out.append(found)
        return cls(out)

    @classmethod
    def read(
        cls, path: str | os.PathLike, block: Block, effects: Iterable[str | Effect] | None = None
    ) -> "Values":
        """Values in adjustment.json, diagnosis.json or NAME.truth.json, for a block's groups.

        effects: slugs (`slug@flight`) or effects to be read; default: all that the file holds.
        Groups that the block does not have are left out. Raises InputError where the file does not
        hold the values.
        """
        path = Path(path)
        try:
            told = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(
                f"{path} cannot be read ({error.strerror}): give a JSON file"
            ) from error
        except ValueError as error:
            raise InputError(f"{path} is not JSON ({error}): give adjustment.json") from error
        try:
            return cls._read(path, told, block, effects)
        except InputError:
            raise
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(
                f"{path} cannot be read ({error!r}): adjust or diagnose the block again"
            ) from error

    @classmethod
    def _read(cls, path: Path, told: Mapping, block: Block, wanted) -> "Values":
        held = told["effects"] if isinstance(told, dict) and told.get("effects") else {}
        kinds = dict(told.get("effect_groups", {})) if isinstance(told, dict) else {}
        slugs = [e["slug"] for e in held] if isinstance(held, list) else list(held)
        slugs = [slug.partition("@")[0] for slug in slugs]
        names = list(dict.fromkeys(slugs)) if wanted is None else list(wanted)
        images, points = Images.of(block), block.ground["point"].tolist()
        out = []
        for name in names:
            effect = effect_of(name).form(block)
            slug = effect.slug
            if isinstance(held, list):
                cells, kind = _diagnosis_cells(held, slug, path)
            else:
                entry: Mapping = next((held[k] for k in held if k.partition("@")[0] == slug), {})
                cells, kind = _cells(entry, path.parent), kinds.get(slug)
            if not cells:
                raise InputError(
                    f"{path} holds no values of effect {slug}: adjust with --effect {slug}, or "
                    f"give the values as {slug}:parameter=value"
                )
            if kind is not None and effect_name(name) == slug:
                effect = effect.per(kind)
            else:
                effect = _grouped(effect, name, cells, images, points)
            known = set(group_names(images, effect.group, points))
            cells = {at: cell for at, cell in cells.items() if at[0] is None or at[0] in known}
            out.append(_filled(effect, cells, block, images, points))
        return cls(out)

    @property
    def frame(self) -> pd.DataFrame:
        """Table slug, parameter, group, value, sigma, unit: one row a known number."""
        frames = [one.frame for one in self.values() if len(one)]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=_COLUMNS)

    def plain(self) -> dict[str, dict]:
        """Numbers alone, `{slug: {parameter: number or {group: number}}}`: block.toml, truths."""
        return {slug: dict(one) for slug, one in self.items()}

    def to_json(self) -> dict[str, dict]:
        """The key `effects` of adjustment.json."""
        return {slug: one.to_json() for slug, one in self.items()}

    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables effect_SLUG.csv, by name, of the effects of more than `MOST_GROUPS` groups."""
        return {one.table: one.frame.drop(columns="slug") for one in self.values() if one.table}


def effect_of(name: str | Effect) -> Effect:
    """The effect that is meant: itself, or that of a slug or `slug@flight`."""
    return name if isinstance(name, Effect) else find(name)


def effect_name(name: str | Effect) -> str:
    """What was asked for: `slug`, or `slug@flight`."""
    return name.slug if isinstance(name, Effect) else name


def parse_word(text: str) -> tuple[str, dict[str, float | dict[str, float]] | None]:
    """Slug and values of SLUG:parameter=value,...; None where it is a SLUG alone.

    `parameter.group=value` is the value of one group: `lag.2=0.06` of flight 2.
    Raises ValueError where it is neither.
    """
    slug, colon, rest = text.partition(":")
    if slug and not colon and not any(mark in slug for mark in "=, "):
        return slug.strip(), None
    pairs = [word.partition("=") for word in rest.split(",")]
    values: dict = {}
    for word, _, number in pairs:
        name, dot, group = word.strip().partition(".")
        here = values.setdefault(name, {}) if dot else values
        if not name or not isinstance(here, dict) or (dot and not group):
            raise ValueError(text)
        key = group if dot else name
        if key in here:
            raise ValueError(text)
        here[key] = float(number)
    if not slug:
        raise ValueError(text)
    return slug.strip(), values


def _stated(effect: Effect, block: Block) -> Mapping:
    stated = effect.stated(block)
    if stated is None:
        names = ", ".join(f"{p.name}=..." for p in effect.parameters(block)[:3])
        raise InputError(
            f"effect {effect.slug} needs values, the block states none: write "
            f"{effect.slug}:{names}, or take them from an adjustment (--from OUT/adjustment.json; "
            "in Python, its `values`)"
        )
    return stated


def _grouped(effect: Effect, name, cells: _Cells, images: Images, points: list[str]) -> Effect:
    """The effect with the kind of groups that the values are of, where no one has said which."""
    groups = {group for group, _ in cells if group is not None}
    if not groups or effect_name(name) != effect.slug:
        return effect
    for kind in (effect.group, *GROUPS):
        if groups <= set(group_names(images, kind, points)):
            return effect if kind == effect.group else effect.per(kind)
    return effect


def _filled(effect, cells: _Cells, block: Block, images: Images, points: list[str]) -> EffectValues:
    """The values in an array; raises InputError for names that the effect does not have."""
    parameters = effect.parameters(block)
    groups = group_names(images, effect.group, points)
    names = [parameter.name for parameter in parameters]
    value = np.full((len(groups), len(names)), np.nan)
    sigma = value.copy()
    row = {group: g for g, group in enumerate(groups)}
    for (group, parameter), (number, error) in cells.items():
        if parameter not in names:
            raise InputError(
                f"effect {effect.slug} has no parameter {parameter!r}: it has {', '.join(names)}"
            )
        if group is not None and group not in row:
            if effect.group == "block":
                raise InputError(
                    f"effect {effect.slug} has one value for the whole block and none for "
                    f"{group!r}: leave that out, or name a flight "
                    f"({', '.join(images.flight_names[:10])})"
                )
            raise InputError(
                f"effect {effect.slug} has no {effect.group} {group!r}: it has "
                f"{', '.join(groups[:10])}"
            )
        at = slice(None) if group is None else row[group], names.index(parameter)
        value[at], sigma[at] = number, error
    return EffectValues(effect, groups, parameters, value, sigma)


def _by_group(value: float | Mapping) -> Mapping:
    return value if isinstance(value, Mapping) else {None: value}


def _given_cells(given: Mapping) -> _Cells:
    """Cells of `{parameter: number or {group: number}}`; raises InputError for nan or infinity."""
    out: _Cells = {}
    for parameter, value in given.items():
        for group, number in _by_group(value).items():
            if not math.isfinite(number):
                raise InputError(f"{parameter} = {number} is not a number")
            out[group, parameter] = float(number), np.nan
    return out


def _cells(entry: Mapping, folder: Path) -> _Cells:
    """Cells of one effect in any of the forms that files have; folder: where its tables are."""
    out: _Cells = {}
    for name, inner in entry.items():
        if isinstance(inner, Real):
            out[None, name] = float(inner), np.nan
        elif "table" in inner:
            out |= _table_cells(folder / inner["table"], name)
        elif "value" in inner:
            out[None, name] = _cell(inner)
        else:
            for second, leaf in inner.items():
                if isinstance(leaf, Real):
                    out[second, name] = float(leaf), np.nan
                else:
                    out[name, second] = _cell(leaf)
    return out


def _cell(leaf: Mapping) -> tuple[float, float]:
    value, sigma = leaf["value"], leaf.get("sigma")
    return (np.nan if value is None else float(value), np.nan if sigma is None else float(sigma))


def _table_cells(path: Path, parameter: str) -> _Cells:
    try:
        table = pd.read_csv(path, dtype={"group": str, "parameter": str})
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}): it belongs beside the JSON file"
        ) from error
    table = table[table["parameter"] == parameter]
    columns = (
        table["group"].map(as_it_was, na_action="ignore"),
        table["value"].tolist(),
        table["sigma"].tolist(),
    )
    return {(group, parameter): (v, s) for group, v, s in zip(*columns, strict=True)}


def _diagnosis_cells(entries: list, slug: str, path: Path) -> tuple[_Cells, str | None]:
    """Cells of an effect of diagnosis.json, and the kind of its groups where that is told."""
    out: _Cells = {}
    kind = None
    for entry in entries:
        if entry.get("slug") != slug:
            continue
        if "values" in entry:
            out |= _cells(entry["values"], path.parent)
            kind = entry["group"]
            continue
        own = next((k for k in GROUPS if entry.get(k) is not None), None)
        kind = own or kind
        for parameter in entry["parameters"]:
            if "statistic" in parameter:
                raise InputError(
                    f"{path} holds the {parameter['statistic']} of effect {slug}, not their "
                    f"values: diagnose the block again, or adjust it with --effect {slug}"
                )
            out[None if own is None else str(entry[own]), parameter["name"]] = _cell(parameter)
    return out, kind
