"""Which settings of a diagnosis matter: each is halved and doubled over small blocks of many kinds.

    python -m benchmarks.diagnosis.sensitivity [-o FILE] [--blocks NAME,...] [SETTING ...]

A setting matters where it changes a verdict, the set of what is found, or a value by more than a
fifth of its standard deviation. Settings are changed several at a time, and apart where that
changes anything: where nothing does, none of them is asked alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import corridor
from benchmarks.diagnosis.generator import NOISES, null, single, together
from benchmarks.diagnosis.generator.generate import generate
from benchmarks.ladder.blocks import made
from corridor import Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import plain
from corridor.diagnosis.settings import Settings

# Sigmas by which a value may change without mattering.
SAME = 0.2
# Settings that are changed together first.
AT_ONCE = 8
_SMALL = {"images": 24, "observations": 100}
_CASES = {
    "blunder": single("control_blunder", **_SMALL),
    "clock": single("clock_offset", 2.0, **_SMALL),
    "bias": single("gnss_bias", 1.5, **_SMALL),
    "thermal": single("thermal", 2.0, **_SMALL),
    "window": single("window", **_SMALL),
    "jello": single("jello", **_SMALL),
    "slow": null("coloured_gnss", **_SMALL),
    "two": together("rolling_shutter", "control_blunder", **_SMALL),
    "per flight": single("principal_point_per_flight", 1.5, **_SMALL),
    "wrong matches": single("lever_arm", noise=NOISES["outliers"], **_SMALL),
}


def bench() -> dict[str, Callable[[], Block]]:
    """Blocks of 12 to 24 images by name, made when they are asked for."""
    out: dict[str, Callable[[], Block]] = {
        name: partial(_generated, name, seed) for seed, name in enumerate(_CASES, start=3)
    }
    return out | {f"ladder {seed}": partial(_rung, seed) for seed in (1, 5)}


@cache
def _generated(name: str, seed: int) -> Block:
    return generate(_CASES[name], seed).block


@cache
def _rung(seed: int) -> Block:
    return made(12, seed).block


def told(block: Block, settings: Settings | None = None) -> dict:
    """What a diagnosis says: the verdict, and what is found with values and standard deviations."""
    try:
        found = plain(corridor.diagnose(block, settings=settings).to_dict())
    except (InputError, AdjustmentFailed) as refused:
        return {"verdict": f"refused: {refused}", "found": [], "values": []}
    keys = ("point", "flight", "camera")
    effects = [[e["slug"], e["class"], *(e[k] for k in keys if k in e)] for e in found["effects"]]
    return {
        "verdict": found["verdict"],
        "sentence": found["sentence"],
        "found": sorted(
            map(str, [*effects, *([u["group"], u["class"]] for u in found["unknown"])])
        ),
        "alarms": sorted(one["quantity"] for one in found["variance"]),
        "p_nothing": found["p_nothing"],
        "p_halves": found["halves"]["p"],
        "values": {
            f"{e['slug']} {e.get('point', '')}{e.get('flight', '')} {p['name']}": (
                p["value"],
                p["sigma"],
            )
            for e in found["effects"]
            for p in e["parameters"]
        },
    }


def differs(one: Mapping, other: Mapping) -> str:
    """What differs between two of `told` that matters; empty where nothing does."""
    for key in ("verdict", "found", "alarms"):
        if one[key] != other[key]:
            return f"{key} {one[key]} -> {other[key]}"
    for name, (value, sigma) in one["values"].items():
        moved = abs(other["values"][name][0] - value) / max(sigma, 1e-30)
        ratio = other["values"][name][1] / max(sigma, 1e-30)
        if moved > SAME or abs(ratio - 1.0) > SAME:
            return f"{name} by {moved:.2f} sigma, sigma times {ratio:.2f}"
    return ""


def times(value, factor: float):
    """A setting times a factor; of whole numbers a whole one, of levels and shares below one."""
    if isinstance(value, tuple):
        return tuple(times(one, factor) for one in value)
    if isinstance(value, int):
        return max(round(value * factor), 1)
    return min(value * factor, 0.5 * (1.0 + value)) if 0.0 < value < 1.0 else value * factor


def matter(
    names: Iterable[str], factor: float, usual: Mapping[str, dict], say: Callable = print
) -> dict[str, str]:
    """Of some settings those that matter, and where it showed first."""
    names, out = list(names), {}
    for start in range(0, len(names), AT_ONCE):
        _apart(names[start : start + AT_ONCE], factor, usual, out, say)
    return out


def _apart(names: list[str], factor: float, usual: Mapping, out: dict, say: Callable) -> None:
    found = _changed(names, factor, usual)
    say(f"times {factor:g}: {' '.join(names)}: {found or 'nothing'}")
    if found and len(names) == 1:
        out[names[0]] = found
    elif found:
        half = len(names) // 2
        _apart(names[:half], factor, usual, out, say)
        _apart(names[half:], factor, usual, out, say)


def _changed(names: list[str], factor: float, usual: Mapping[str, dict]) -> str:
    """The first difference over the bench."""
    given = Settings()
    blocks = bench()
    settings = replace(given, **{name: times(getattr(given, name), factor) for name in names})
    for name in usual:
        found, block = "it fails", blocks[name]
        # A number that makes it fail matters.
        with suppress(ArithmeticError, IndexError, ValueError):
            found = differs(usual[name], told(block(), settings))
        if found:
            return f"{name}: {found}"
    return ""


def main() -> None:
    """Run it, and print and write what matters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="settings (default: all)")
    parser.add_argument("--blocks", type=lambda text: text.split(","), default=list(bench()))
    parser.add_argument("-o", "--output", type=Path, help="JSON file of what matters")
    given = parser.parse_args()
    names = given.names or list(vars(Settings()))
    usual = {name: told(bench()[name]()) for name in given.blocks}
    say = partial(print, flush=True)
    out = {f"times {factor:g}": matter(names, factor, usual, say) for factor in (0.5, 2.0)}
    idle = [name for name in names if not any(name in found for found in out.values())]
    say(f"{len(idle)} of {len(names)} change nothing: {' '.join(idle)}")
    if given.output:
        given.output.write_text(json.dumps(out | {"idle": idle}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
