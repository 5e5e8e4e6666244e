"""The first sentence of a report: what a surveyor has to know, from the diagnosis alone."""

from __future__ import annotations

from dataclasses import replace

from corridor.core.effects import Effect
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.findings.findings import Estimate
from corridor.diagnosis.report.wording import (
    amount,
    effects_by_slug,
    falls,
    listed,
    placed,
    to_add,
    two_digits,
    upper,
    value_and_sigma,
)
from corridor.diagnosis.verification.held_out import check_alone, check_together

# Parameters told in the sentence; the table has them all.
MOST = 4
# Standard deviations from which on one of several parameters is worth a word.
CLEAR = 2.0
# A size that changes by less than this share has not changed.
SAME = 0.02
# Standard deviations by which check points are off, RMS, from which on that is told beside
# "nothing": by chance, of three coordinates of one point, one in 100,000 (chi square of 27).
OFF = 3.0
# Limits of detection told when nothing is missing.
LIMITS = 3


def sentence(diagnosis: Diagnosed) -> str:
    """What is missing, by how much, and what adding it does; two or three short sentences."""
    tell = {
        "named": _named,
        "ambiguous": _ambiguous,
        "unknown": _unknown,
        "suspected": _suspected,
        "nothing": _nothing,
    }
    told = tell[diagnosis.verdict](diagnosis)
    if diagnosis.verdict in ("named", "ambiguous", "unknown"):
        told += _still_off(diagnosis)
    unasked = f" {diagnosis.course.unasked}".rstrip()
    return told + _untold(diagnosis) + _halves(diagnosis) + unasked


def _untold(d: Diagnosed) -> str:
    """What explains the data, and has no size that could be told."""
    known = effects_by_slug(d.block)
    return "".join(
        f" {upper(placed(known[one.slug].called, one.where))} would explain some of it, but how "
        f"much of it there is cannot be told: {one.untold}."
        for one in d.findings.effects
        if one.untold
    )


def _still_off(d: Diagnosed) -> str:
    """Where check points are off by more than chance although what was found is in the model."""
    by, alone = _off_by(d)
    if not by or alone:
        return alone
    return (
        f" Check points are still off by {by}: what was found is not all that is missing, or "
        "stands for something else."
    )


def _off_by(d: Diagnosed) -> tuple[str, str]:
    """How far check points are off, and a sentence where one is so alone, or all are so
    together beside ground control; empty: by chance."""
    sigmas, error = d.check_sigmas, d.gap["check_m"]
    if not sigmas or not error or sigmas < OFF:
        return "", ""
    by = f"{amount(error['after'], 'm')}, {sigmas:.1f} times their standard deviations"
    found = check_alone(d.after, OFF)
    together = check_together(d.after, OFF)
    if found is None and together is not None and len(d.after.system.control_names) > 2:
        vector = ", ".join(f"{1000.0 * value:+.0f}" for value in together)
        return by, (
            f" But all check points lie off by the same vector, ({vector}) mm: were they surveyed "
            "from another base than the ground control, or in another height system?"
        )
    if found is None:
        return by, ""
    point, axis, size, others = found
    return by, (
        f" But check point {point} is off by {amount(size, 'm')} in {axis}, alone: the others "
        f"by {amount(others, 'm')} (3D RMS). Look up its survey and its marks."
    )


def _halves(d: Diagnosed) -> str:
    """Where two halves of the images contradict each other, whatever was found."""
    if not d.halves.alarm:
        return ""
    far = d.halves.farthest
    value, sigma, unit = value_and_sigma(far)
    half = "strips" if d.halves.by == "strips" else "images"
    return (
        f" But the odd and the even {half}, adjusted apart, contradict each other "
        f"({_chance(d.halves.p)}; most of all {far['name']}, by {value} +- {sigma} {unit}): "
        "something else bends the block."
    )


def _chance(p: float) -> str:
    """p = 0.46; p < 0.001."""
    return f"p = {two_digits(p)}" if p >= 0.001 else "p < 0.001"


def _named(d: Diagnosed) -> str:
    firm = [one for one in d.findings.effects if one.kind == "named"]
    told = _told(d, firm)
    if len(told) == 1:
        (name, values) = told[0]
        text = f"{upper(name)} is missing from the model{f': {values}' if values else ''}."
    else:
        parts = [f"{name} ({values})" if values else name for name, values in told]
        text = f"{upper(listed(parts))} are missing from the model."
    either = [_either(d, alike) for alike in _ambiguities(d)]
    beside = [f"Beside {'it' if len(told) == 1 else 'them'}, either {both}." for both in either]
    if any(one.kind == "unknown" for one in d.findings.unknown):
        beside.append(f"Something outside the catalogue is there too: {_places(d)}.")
    return " ".join([text, *beside, _effect_of_adding(d, len(told) + len(beside))])


def _ambiguous(d: Diagnosed) -> str:
    first, *others = _ambiguities(d)
    text = f"Either {_either(d, first)} is missing from the model; this flight cannot separate them"
    text += f". What would: {first[0].separate}." if first[0].separate else "."
    more = [alike for alike in others if alike[0].slug not in first[0].alternatives]
    if more:
        text += f" Also missing: {listed(_either(d, alike) for alike in more)}."
    if any(one.kind == "unknown" for one in d.findings.unknown):
        text += f" Something outside the catalogue is there too: {_places(d)}."
    return f"{text} {_effect_of_adding(d, 1 + len(more), 'one of them')}"


def _unknown(d: Diagnosed) -> str:
    text = f"Something outside the catalogue is missing from the model: {_places(d)}."
    known = effects_by_slug(d.block)

    def called(key):
        slugs = dict.fromkeys(slug for one in d.findings.unknown for slug in getattr(one, key))
        return listed((known[slug].called for slug in slugs), "or")

    if names := called("alike"):
        text += f" The fit alone takes {names} as well; check points separate them."
    if names := called("parts"):
        text += f" It overlaps with {names}, which would explain a part of it only."
    text += "".join(_looks_like(d))
    if all(one.correction == "none" for one in d.findings.unknown):
        return f"{text} The fit takes them for wrong matches, so nothing was added."
    if not all(one.correction == "helps" for one in d.findings.unknown):
        return f"{text} What was found of it does not help data that the fit has not used."
    return f"{text} {_effect_of_adding(d, 1, 'what was found of it')}"


def _looks_like(d: Diagnosed) -> list[str]:
    """Named effects that show as an unknown does and lack a column: which, and what to hand in."""
    known, lacking = effects_by_slug(d.block), {}
    tested = {effect.slug for effect in d.course.candidates.effects}
    for one in d.untestable:
        effect = known[one["slug"]]
        # One value for all has been tested, and is not what was found.
        if effect.refines in tested:
            continue
        if any(_alike(known[shape.group], effect) for shape in d.findings.unknown):
            missing = ", ".join(effect.missing(d.block)) or one["missing"]
            lacking.setdefault(missing, []).append(effect.called)
    return [
        f" So would {listed(names, 'or')} look, which could not be tested: add {to_add(missing)}."
        for missing, names in lacking.items()
    ]


def _alike(shape: Effect, effect: Effect) -> bool:
    """Whether both differ from row to row, or both change the camera while the flight goes on."""
    if effect.generic:
        return False
    if shape.by_row:
        return effect.place == "motion"
    with_time = "images.time_s" in shape.needs and shape.place in ("image", "camera")
    return with_time and "images.temperature_c" in effect.needs


def _suspected(d: Diagnosed) -> str:
    told = _told(d, [one for one in d.findings.effects if one.kind == "suspected"])
    parts = [f"{name} ({values})" if values else name for name, values in told]
    if d.findings.unknown:
        parts.append(f"something outside the catalogue ({_places(d)})")
    return (
        f"Nothing is missing for certain; suspected is {listed(parts)}. "
        f"{100 * (1 - d.level):.3g} % certainty is not reached, so nothing was changed: look at "
        f"it in the next flight.{_off(d)}"
    )


def _nothing(d: Diagnosed) -> str:
    text = "Nothing is missing from the model that this flight could show."
    text += _off(d)
    limits = seen_best(d)
    if limits:
        text += f" Would have been seen: {'; '.join(limits)}."
    if d.p_nothing < d.level:
        text += (
            f" But all tests together show more than chance does ({_chance(d.p_nothing)}): "
            "something may be missing that no single test bears out."
        )
    else:
        text += f" If nothing is missing, signs as strong come by chance: {_chance(d.p_nothing)}."
    for alarm in d.alarms[:1]:
        text += f" But the image noise is uneven: {alarm['where']}."
    return text


def _off(d: Diagnosed) -> str:
    """What check points say that nothing found explains; nothing where they are off by chance."""
    by, alone = _off_by(d)
    if not by or alone:
        return alone
    text = f" But check points are off by {by}"
    if not len(d.block.gnss):
        return f"{text}: something bends the block that these images do not show."
    return (
        f"{text}. An error that GNSS positions share, or that changes slowly, counts as their "
        "noise here: `corridor adjust BLOCK --effect gnss_bias` estimates it; control at both ends "
        "of the flight would show it."
    )


def seen_best(d: Diagnosed) -> list[str]:
    """Limits of detection of the effects that this block shows best, beside what is usual."""
    known, found = effects_by_slug(d.block), []
    for slug, limits in d.detection_limits.items():
        effect = known[slug]
        for parameter in effect.parameters(d.block)[:1]:
            limit = limits.get(parameter.name)
            # Told are physical effects whose number speaks for itself.
            if limit and parameter.unit != "1":
                found.append((limit / parameter.scale, effect, parameter, limit))
    found.sort(key=lambda one: one[0])
    return [
        f"{effect.called} from {parameter.name} {amount(limit, parameter.unit)} on"
        for _, effect, parameter, limit in found[:LIMITS]
    ]


def _told(d: Diagnosed, estimates: list[Estimate]) -> list[tuple[str, str]]:
    """What each effect is called, and its values; of flights or cameras apart, once."""
    known, out = effects_by_slug(d.block), []
    for slug in dict.fromkeys(one.slug for one in estimates):
        mine = [one for one in estimates if one.slug == slug]
        if len(mine) == 1:
            out.append((placed(known[slug].called, mine[0].where), _values(mine[0])))
            continue
        if {"point", "distance"} & set(mine[0].where):
            out += [(placed(known[slug].called, one.where), _values(one)) for one in mine]
            continue
        parts = []
        for one in mine:
            if known[slug].stands_in_for and any(each.change for each in mine):
                # What flights have in common may be the camera's: how they differ is known.
                changed = _values(replace(one, parameters=one.change)) if one.change else ""
                parts.append(f"from flight {one.where['flight']} on {changed} more" * bool(changed))
                continue
            values = _values(one)
            parts.append(f"{listed(one.where.values())}: {values}" if values else "")
        out.append((known[slug].called, "; ".join(part for part in parts if part)))
    return out


def _values(estimate: Estimate) -> str:
    """readout 24.8 +- 0.5 ms; x 60 +- 3, y -40 +- 3 mm; nothing where it cannot be told."""
    rows = [] if estimate.untold else estimate.parameters
    if len(rows) > 1:
        clear = [p for p in rows if abs(p["value"]) > CLEAR * p["sigma"]]
        rows = clear or rows
    if len(rows) > MOST:
        return f"{len(estimate.parameters)} parameters"
    told, units = [], []
    for p in rows:
        value, sigma, unit = value_and_sigma(p)
        spread = " RMS of the images" if "statistic" in p else ""
        told.append((f"{p['name']} {value} +- {sigma}", spread))
        units.append(unit)
    out = []
    for n, (text, spread) in enumerate(told):
        last = n == len(told) - 1 or units[n + 1] != units[n]
        out.append(f"{text} {units[n]}".rstrip() + spread if last else text)
    return ", ".join(out)


def _ambiguities(d: Diagnosed) -> list[list[Estimate]]:
    """Estimates that have look-alikes, those of one effect together."""
    out: dict[str, list[Estimate]] = {}
    for one in d.findings.effects:
        if one.kind == "ambiguous":
            out.setdefault(one.slug, []).append(one)
    return list(out.values())


def _either(d: Diagnosed, estimates: list[Estimate]) -> str:
    """An effect with its values, or its look-alikes."""
    known = effects_by_slug(d.block)
    mine = listed(f"{name} ({values})" if values else name for name, values in _told(d, estimates))
    others = [known[slug].called for slug in estimates[0].alternatives]
    instead = [f"of {one.instead}" for one in estimates[:1] if one.instead]
    return " or ".join([mine, *instead, *others])


def _places(d: Diagnosed) -> str:
    known = effects_by_slug(d.block)
    return "; ".join(f"{known[one.group].called}, {one.where}" for one in d.findings.unknown)


def _effect_of_adding(d: Diagnosed, number: int, what: str = "") -> str:
    """What becomes of data that the fit has not used; only what the numbers show."""
    adding = f"Adding {what or ('it' if number == 1 else 'them')}"
    check, tie = d.gap["check_m"], d.gap["tie_px"]
    out = []
    if check:
        out.append((check, "the check-point error", 1e3, "mm"))
    if tie["before"] is not None and tie["after"] is not None:
        out.append((tie, "the error of image points held out", 1.0, "px"))
    told = [(_change(gap), gap, name, factor, unit) for gap, name, factor, unit in out]
    if not told:
        return "No check points and too few tie points: what adding it does could not be measured."
    # Check points speak first; where they do not move, the image points may.
    change, gap, name, factor, unit = told[0]
    before, after = falls(gap["before"], gap["after"], factor, unit)
    if change == "lowers":
        return f"{adding} lowers {name} from {before} to {after}."
    text = f"{adding} leaves {name} at {after}"
    if change == "raises":
        text = f"{adding} raises {name} from {before} to {after}"
        if gap is check:
            # What takes check points further away than their noise is never added (see `harms`).
            text = f"{adding} changes {name} from {before} to {after}, which is within its noise"
    if len(told) > 1 and told[1][0] == "lowers":
        _, gap, name, factor, unit = told[1]
        before, after = falls(gap["before"], gap["after"], factor, unit)
        text += f" and lowers {name} from {before} to {after}"
    return f"{text}."


def _change(gap: dict) -> str:
    ratio = gap["after"] / gap["before"] if gap["before"] else 1.0
    return "leaves" if abs(ratio - 1.0) < SAME else "lowers" if ratio < 1.0 else "raises"
