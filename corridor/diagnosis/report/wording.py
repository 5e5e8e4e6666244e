"""Numbers as a surveyor says them: milliseconds, millimetres, pixels in ten minutes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from corridor.core.block import Block
from corridor.core.effects import Effect, every_effect
from corridor.core.errors import InputError
from corridor.core.output import rounded, scaled
from corridor.diagnosis.findings.findings import Findings


def value_and_sigma(parameter: dict) -> tuple[str, str, str]:
    """Value, standard deviation and unit of a parameter of diagnosis.json, for people."""
    value, sigma = parameter["value"], parameter["sigma"]
    factor, unit = scaled(parameter["unit"], value, sigma, name=parameter.get("name", ""))
    return *rounded(factor * value, factor * sigma), unit


def amount(value: float, unit: str) -> str:
    """A value of no stated precision, two digits: "4.1 ms"."""
    factor, unit = scaled(unit, value)
    return f"{two_digits(factor * value)} {unit}".strip()


def two_digits(value: float) -> str:
    """Two significant digits, never as a power of ten."""
    if not value or not math.isfinite(value):
        return "0" if value == 0 else "\u2013"
    digits = max(1 - math.floor(math.log10(float(f"{abs(value):.1e}"))), 0)
    return f"{float(f'{value:.1e}'):,.{digits}f}"


def falls(before: float, after: float, factor: float, unit: str) -> tuple[str, str]:
    """Two sizes with as many decimals as tell them apart: "19.5", "4.1 mm"."""
    least = factor * min(abs(before), abs(after))
    digits = 0 if least >= 100 else 1 if least >= 1 else 3
    return f"{factor * before:.{digits}f}", f"{factor * after:.{digits}f} {unit}"


def listed(words: Iterable[str], last: str = "and") -> str:
    """a, b and c."""
    words = list(words)
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def upper(text: str) -> str:
    """The same, as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def effects_by_slug(block: Block | None = None) -> dict[str, Effect]:
    """The catalogue, by slug; as the data of a block let the effects be, where one is given."""
    every = every_effect()
    return {effect.slug: effect if block is None else effect.form(block) for effect in every}


def placed(called: str, where: dict) -> str:
    """An effect of one control point, distance, flight or camera: "... of control point P7"."""
    words = {
        "point": "control point", "distance": "measured distance", "flight": "flight",
        "camera": "camera",
    }  # fmt: skip
    for key, word in words.items():
        if key not in where:
            continue
        mine = f"{word} {where[key]}"
        general = next((g for g in (f"a {word}", f"each {word}") if g in called), None)
        called = called.replace(general, mine) if general else f"{called} of {mine}"
    return called


def to_add(missing: str) -> str:
    """What to hand in so that something can be tested: "time_s in images.csv for every image".

    missing: `table.column`, several with commas; another sentence is handed back as it is.
    """
    held = re.fullmatch(r"camera\.(.+)\.calibrated", missing)
    if held:
        return (
            f"a calibration of the camera (calibrated = true for camera {held[1]} in block.toml, "
            "or --camera fixed); as it is, the adjustment estimates these values itself"
        )
    if not re.fullmatch(r"\w+\.\w+(, *\w+\.\w+)*", missing):
        return missing
    if missing == "images.flight":
        return "a second flight (flight in images.csv)"
    columns: dict[str, list[str]] = {}
    for word in missing.split(","):
        table, _, name = word.strip().partition(".")
        columns.setdefault(table, []).append(name)
    return listed(_files(table, names) for table, names in columns.items())


def _files(table: str, names: list[str]) -> str:
    if table == "camera":
        return f"{listed(names)} in [camera.NAME] of block.toml"
    if table == "gnss":
        return "antenna positions (gnss.csv, or track.csv and time_s in images.csv)"
    if table == "attitudes":
        return "attitudes of the camera (attitudes.csv)"
    if table == "ground":
        return "control points (role control in ground.csv, measured in marks.csv)"
    every = " for every image" if table == "images" else ""
    return f"{listed(names)} in {table}.csv{every}"


def cannot_separate(block: Block, rows: list[dict]) -> list[str]:
    """A sentence on each value of `not_separated` that another effect would change."""
    known, out = effects_by_slug(block), []
    for one in rows:
        factor, unit = scaled(one["unit"], one["sigma_beside"])
        out.append(
            f"This flight cannot separate {' and '.join(one['parameters'])} of "
            f"{known[one['slug']].called} from {known[one['from']].called}: with one of usual size "
            f"it is known to {factor * one['sigma_beside']:.2g} {unit}, not to "
            f"{factor * one['sigma']:.2g}."
        )
    return out


def unseen_statements(block: Block, found: Findings, limits: dict) -> list[str]:
    """A sentence on each value that the block states of an effect, and that it would have shown.

    limits: as of `detection_limits`.
    """
    known, out = effects_by_slug(block), []
    seen = {slug for one in found.effects for slug in (one.slug, *one.alternatives)}
    # A camera that is seen to move while its rows are read has a readout.
    read = any(known[slug].during_readout for slug in seen if slug in known)
    for slug, effect in known.items():
        if slug in seen or slug not in limits or (read and effect.during_readout):
            continue
        try:
            stated = effect.stated(block) or {}
        except InputError:  # one for each camera, and not of all
            continue
        for parameter in effect.parameters(block):
            value, limit = stated.get(parameter.name), limits[slug].get(parameter.name)
            if isinstance(value, float) and limit and limit < abs(value) <= parameter.most:
                factor, unit = scaled(parameter.unit, value)
                out.append(
                    f"block.toml states {effect.called} with {parameter.name} {factor * value:.3g} "
                    f"{unit}, and the images show none: it would have been seen from "
                    f"{factor * limit:.2g} {unit} on. Is it that of another camera, or were the "
                    "images corrected for it?"
                )
    return out
