"""One block: diagnosed, held against the truth and its twin, and given to the baselines."""

from __future__ import annotations

import time
from dataclasses import asdict

from benchmarks.diagnosis.baselines import baselines
from benchmarks.diagnosis.judge import judge
from benchmarks.diagnosis.signal import Signal, key_of, signals
from benchmarks.diagnosis.truth import Hidden, Truth
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import plain
from corridor.diagnosis.diagnosing import Diagnosis, diagnose
from corridor.diagnosis.verification.held_out import closure

# Check points that are this many times worse than the twin's have an excess to speak of.
EXCESS = 2.0


def assess(
    name: str, block: Block, twin: Block | None, truth: Truth, options: dict, rivals: bool = True
) -> dict:
    """Everything the benchmark keeps of a block, as JSON can hold it.

    options: of `diagnose`. rivals: whether the baselines are run. A diagnosis that fails is a
    result too: `failed` says why.
    """
    row: dict = {
        "name": name, "kind": truth.kind, "hidden": truth.label,
        "images": len(block.images), "observations": len(block.tie_points),
    }  # fmt: skip
    began = time.perf_counter()
    found = _diagnosed(block, options)
    if isinstance(found, str):
        return row | {"failed": found}
    row["seconds"] = time.perf_counter() - began
    said = found.to_dict()
    row |= {"said": said} | asdict(judge(said, truth, block))
    row["parameters"] = parameter_errors(said, truth)
    row["check_before"], row["check_after"] = _check(found)
    row["failed"] = None
    # A null block is its own twin.
    if twin is not None and truth.kind != "null":
        of_twin = _diagnosed(twin, options)
        if isinstance(of_twin, str):
            row["twin_failed"] = of_twin
        else:
            row |= _beside_twin(row, found, of_twin, truth, options)
    if rivals:
        row["baselines"] = baselines(found.believed, found.before)
    return plain(row)


def _diagnosed(block: Block, options: dict) -> Diagnosis | str:
    """The diagnosis, or why there is none."""
    try:
        return diagnose(block, **options)
    except (InputError, AdjustmentFailed) as error:
        return str(error)


def _check(found: Diagnosis) -> tuple[float | None, float | None]:
    gap = found.gap["check_m"] or {"before": None, "after": None}
    return gap["before"], gap["after"]


def _beside_twin(
    row: dict, diagnosis: Diagnosis, of_twin: Diagnosis, truth: Truth, options: dict
) -> dict:
    """What the twin says: the floor of the check points, a null block, signal and rivals.

    With an excess to speak of: what of it an adjustment closes that is told what is hidden.
    """
    block, twin = diagnosis.block, of_twin.block
    said = of_twin.to_dict()
    null = judge(said, Truth(), twin)
    first = next(one for one in of_twin.course.rounds if one.evidence is not None)
    found = signals(truth, first.evidence, block, twin, options, first.noises)
    hidden = [*truth.inside, *truth.outside]
    each = {key_of(one): found.get(key_of(one), Signal()) for one in hidden}
    out: dict = {
        "twin": asdict(null) | {"effects": said["effects"], "unknown": said["unknown"]},
        "signals": {
            k: asdict(s) | {"separable": s.separable, "alike": s.alike} for k, s in each.items()
        },
        "check_twin": _check(of_twin)[0],
    }
    before, after, floor = row["check_before"], row["check_after"], out["check_twin"]
    if None not in (before, after, floor) and floor > 0:
        out["excess"] = before / floor
        out["closure"] = closure(before, after, floor)
        out["after_over_twin"] = after / floor
        known = _knowing(diagnosis, truth) if before > EXCESS * floor else None
        if known is not None:
            out["check_known"] = known
            out["closure_known"] = closure(before, known, floor)
            out["known_over_twin"] = known / floor
    return out


def _knowing(found: Diagnosis, truth: Truth) -> float | None:
    """Check-point error, m, of the believed model with what is really missing from it.

    A flight that shows an effect may still say too little of its size: what no right name closes,
    no diagnosis can. None where an effect is no candidate, or the adjustment fails.
    """
    names = {effect.slug: effect for effect in found.course.candidates.effects}
    keys = [key_of(one) for one in truth.inside]
    if truth.outside or not {one.slug for one in truth.inside} <= set(names):
        return None
    if set(keys) == set(found.used):
        return _check(found)[1]
    try:
        return float(found.believed.adjust(found.course.members(keys)).check_rms.d3)
    except (InputError, AdjustmentFailed):
        return None


def parameter_errors(said: dict, truth: Truth) -> list[dict]:
    """Value, truth and sigma of each estimated parameter of which the truth has one number."""
    out = []
    for one in truth.inside:
        for effect in said["effects"]:
            if effect["slug"] != one.slug or effect.get("point") not in (None, one.point):
                continue
            for p in effect["parameters"]:
                true = _true(one, effect, p["name"])
                if "statistic" in p or true is None or not p["sigma"]:
                    continue
                out.append(
                    {
                        "slug": one.slug, "class": effect["class"], "name": p["name"],
                        "value": p["value"], "true": true, "sigma": p["sigma"],
                        "sigmas": (p["value"] - true) / p["sigma"],
                    }
                )  # fmt: skip
    return out


def _true(one: Hidden, effect: dict, name: str) -> float | None:
    kinds = ("flight", "point", "camera", "survey")
    owners = [*(effect.get(kind) for kind in kinds), "", None]
    found = [one.values[owner, name] for owner in owners if (owner, name) in one.values]
    return found[0] if found else None
