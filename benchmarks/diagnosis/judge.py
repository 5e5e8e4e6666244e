"""What was said of a block held against what is true.

A statement is an effect or an unknown of diagnosis.json beyond the level of a false name: classes
`named`, `ambiguous` and `unknown`; what is only suspected is counted apart. It is

    right        named, and hidden in the block (the same slug; of a control point, the same point)
    set          ambiguous, and one of the set is hidden
    wrong        named, and not hidden: the worst that can be said
    set_without  ambiguous, and nothing of the set is hidden
    unknown      of no catalogue
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.diagnosis.truth import Hidden, Truth
from corridor.core.block import Block

FIRM = ("named", "ambiguous", "unknown")
# How far a place may be off: on the ground and in time, of the block's extent.
NEAR = 0.15
LEAST_S = 10.0


@dataclass
class Judged:
    """detected: something was stated. suspected: something was suspected, and nothing stated.

    named, inside: hidden slugs (with their control point) that were named, and that were named or
    in a stated set. wrong: slugs named that are not hidden. extras: statements that are neither
    right nor a set with a hidden effect; where something outside the catalogue is hidden, one
    unknown and named effects that it lists as its parts are none. unknown: an unknown or a
    variance alarm was stated. place: whether it is at the right place or time, None where the
    truth tells none. score: mean over the hidden effects of 1 named, 1/2 in a set, less 1 for
    each wrong name; a null block has 1 where nothing is stated.
    """

    verdict: str
    detected: bool
    suspected: bool
    named: list[str] = field(default_factory=list)
    inside: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    ambiguous: bool = False
    extras: int = 0
    unknown: bool = False
    place: bool | None = None
    score: float = 0.0


def judge(said: Mapping, truth: Truth, block: Block) -> Judged:
    """said: diagnosis.json as a dictionary."""
    effects = [one for one in said["effects"] if one["class"] in FIRM]
    unknown = [one for one in said["unknown"] if one.get("class", "unknown") in FIRM]
    alarms = said.get("variance") or []
    out = Judged(
        said["verdict"],
        detected=bool(effects or unknown or (alarms and truth.outside)),
        suspected=said["verdict"] == "suspected",
        ambiguous=any(one["class"] == "ambiguous" for one in effects),
        unknown=bool(unknown or alarms),
    )
    hidden = list(truth.inside)
    for one in effects:
        mine = [h for h in hidden if _is(one, h)]
        alike = [h for h in hidden if h.slug in one["cannot_be_told_apart_from"]]
        if one["class"] == "named":
            out.named += [_key(h) for h in mine]
            out.inside += [_key(h) for h in mine]
            if not mine:
                out.wrong.append(one["slug"])
        else:
            out.inside += [_key(h) for h in (*mine, *alike)]
        right = mine or (one["class"] == "ambiguous" and alike)
        # Effects of several flights or cameras are one statement: a row each, one slug.
        out.extras += not right and one is _first(effects, one)
    for names in (out.named, out.inside, out.wrong):
        names[:] = dict.fromkeys(names)
    out.extras += max(len(unknown) - len(truth.outside), 0)
    if truth.outside:
        out.place = _placed([*unknown, *alarms], truth.outside[0], block)
    out.score = _score(out, truth)
    return out


def _first(effects, one):
    return next(
        e for e in effects if (e["slug"], e.get("point")) == (one["slug"], one.get("point"))
    )


def _is(said: Mapping, hidden: Hidden) -> bool:
    same_point = hidden.point is None or said.get("point") in (None, hidden.point)
    return said["slug"] == hidden.slug and same_point


def _key(hidden: Hidden) -> str:
    return hidden.slug if hidden.point is None else f"{hidden.slug}.{hidden.point}"


def _score(out: Judged, truth: Truth) -> float:
    if truth.outside:
        good = float(out.unknown)
    elif truth.inside:
        keys = [_key(h) for h in truth.inside]
        each = [1.0 if k in out.named else 0.5 if k in out.inside else 0.0 for k in keys]
        good = float(np.mean(each))
    else:
        good = float(not out.detected)
    return good - len(out.wrong)


def _placed(stated: list, hidden: Hidden, block: Block) -> bool | None:
    """Whether one unknown or alarm lies where the truth does; None where no key is shared."""
    answers = []
    for one in stated:
        said = one.get("location") or {}
        shared = [_near(key, said, hidden.where, block) for key in ("image", "xy", "time_s", "row")]
        shared = [answer for answer in shared if answer is not None]
        if shared:
            answers.append(any(shared))
    if not any(_known(key, hidden.where) for key in ("image", "xy", "time_s", "row")):
        return None
    return any(answers)


def _known(key: str, where: Mapping) -> bool:
    if key == "row":
        return where.get(key) is not None
    value = [where.get("x"), where.get("y")] if key == "xy" else where.get(key)
    numbers = value if isinstance(value, (list, tuple)) else [value]
    wanted = {"xy": 2, "image": 4, "time_s": 1}[key]
    return len(numbers) == wanted and all(isinstance(one, (int, float)) for one in numbers)


def _near(key: str, said: Mapping, true: Mapping, block: Block) -> bool | None:
    """image: the middle of one box lies in the other. xy: within 15 % of the flight's length.

    time_s: within 15 % of the time from first to last image, 10 s at least. row: always.
    """
    if not (_known(key, said) and _known(key, true)):
        return None
    if key == "image":
        a, b = np.array(said["image"], float), np.array(true["image"], float)
        return _holds(a, b) or _holds(b, a)
    if key == "xy":
        place = block.images[["x", "y"]].to_numpy(float)
        length = float(np.linalg.norm(np.nanmax(place, axis=0) - np.nanmin(place, axis=0)))
        off = np.hypot(said["x"] - true["x"], said["y"] - true["y"])
        return bool(off <= NEAR * length)
    if key == "time_s":
        time = block.column("images", "time_s")
        reach = max(NEAR * float(np.nanmax(time) - np.nanmin(time)), LEAST_S)
        return bool(abs(said["time_s"] - true["time_s"]) <= reach)
    return True


def _holds(box: np.ndarray, other: np.ndarray) -> bool:
    middle = (other[:2] + other[2:]) / 2
    return bool((box[:2] <= middle).all() and (middle <= box[2:]).all())
