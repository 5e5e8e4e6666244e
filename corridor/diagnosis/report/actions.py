"""What to do next, from the diagnosis alone: at most three sentences, each with its command."""

from __future__ import annotations

from corridor.core.adjustment import tested_by
from corridor.core.effects import every_effect
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.report.tables import by_remedy
from corridor.diagnosis.report.wording import effects_by_slug, listed, upper

MOST = 3


def actions(d: Diagnosed) -> list[str]:
    """At most three sentences on what to do, the first one first.

    BLOCK is the folder that was diagnosed, OUT the one that the diagnosis was written to.
    """
    steps = [
        *_corrected(d),
        *_surveyed(d),
        *_stated(d),
        *_added(d),
        *_told_apart(d),
        *_looked_at(d),
        *_waited(d),
    ]
    if not steps:
        steps = _accurate_enough(d)
    steps = [*steps, *_handed_in(d)][:MOST]
    return [step if step.endswith("?") else f"{step}." for step in steps]


def _corrected(d: Diagnosed) -> list[str]:
    """What is probably a mistake in the block: all that was found may follow from it."""
    return [
        f"Correct the block first, what was found may come from it alone: {doubt.rstrip('.')}"
        for doubt in d.doubts[:1]
    ]


def _surveyed(d: Diagnosed) -> list[str]:
    """Single ground points and distances that are wrong."""
    points, distances = (
        [
            str(one.where[kind])
            for one in d.findings.effects
            if one.kind == "named" and kind in one.where
        ]
        for kind in ("point", "distance")
    )
    out = []
    if distances:
        out.append(
            f"Measure the distance {listed(distances)} again; until then take the row out of "
            "distances.csv and adjust without it"
        )
    if not points:
        return out
    system = d.before.system
    names = system.block.ground["point"].to_numpy(object)[system.roles == "control"]
    others = ",".join(str(name) for name in names if str(name) not in points)
    command = f"corridor adjust BLOCK --control {others or 'none'} -o OUT2"
    again = f"Look up or survey control {listed(points)} again"
    return [f"{again}; until then adjust without, `{command}`", *out]


def _added(d: Diagnosed) -> list[str]:
    """Effects that were found, as an option of the command, and the blocks that have them."""
    # What is wrong with one point is no effect of the model.
    known, free = effects_by_slug(), d.after.problem.free.values()
    slugs = [key for key in d.used if "." not in key and not known[key].remedy]
    if not slugs:
        return []
    doubled = {name for slug in slugs for name in known[slug].stands_in_for}
    if any(doubled & set(names) for names in free):
        # Beside a free camera the command would ask for a prior that the diagnosis has given it.
        return [
            "Go on with OUT/block, which is adjusted with what was found; OUT/corrected is for "
            "programs that do not know it"
        ]
    return [
        f"Adjust with what was found: `corridor adjust BLOCK --effect {','.join(slugs)} -o OUT2`, "
        "or go on with OUT/block; OUT/corrected is for programs that do not know it"
    ]


def _stated(d: Diagnosed) -> list[str]:
    """What the block should state otherwise."""
    remedies = {effect.slug: effect.remedy for effect in every_effect()}
    found = dict.fromkeys(one.group for one in d.findings.unknown if one.kind == "unknown")
    return [upper(remedies[slug]) for slug in found if remedies.get(slug)]


def _told_apart(d: Diagnosed) -> list[str]:
    """What would separate causes that look alike."""
    known, out = effects_by_slug(), {}
    for one in d.findings.effects:
        if one.kind == "ambiguous" and one.separate:
            instead = [f"an error of {one.instead}"] if one.instead else []
            called = [known[s].called for s in (one.slug, *one.alternatives)]
            names = listed([*called, *instead], "or")
            out[one.slug] = f"To know whether it is {names}: {one.separate}"
    return list(out.values())


def _looked_at(d: Diagnosed) -> list[str]:
    """Where something outside the catalogue shows."""
    known, found = effects_by_slug(), [one for one in d.findings.unknown if one.kind == "unknown"]
    found = [one for one in found if one.group not in known or not known[one.group].remedy]
    if not found:
        return []
    antenna = found[0].group in known and known[found[0].group].place == "antenna"
    look = "up in the receiver's log what happened" if antenna else "at the pictures where it shows"
    return [f"Look {look}: {found[0].where}"]


def _waited(d: Diagnosed) -> list[str]:
    """What is only suspected changes nothing."""
    if d.verdict != "suspected":
        return []
    return [
        "Change nothing yet: fly again with more control or at a second height, and diagnose that"
    ]


def _accurate_enough(d: Diagnosed) -> list[str]:
    """What is left to say where nothing is missing."""
    check, required = d.gap["check_m"], d.required
    if check and required is not None and check["after"] > required:
        return ["The model is not what is wrong: plan more control or images, `corridor plan PLAN`"]
    return [] if check else [tested_by(d.block)]


def _handed_in(d: Diagnosed) -> list[str]:
    """The one thing to add to the block that lets most be tested."""
    remedies = by_remedy(d)
    if not remedies:
        return []
    remedy, names = max(remedies.items(), key=lambda item: len(item[1]))
    more = f"{len(names)} more causes" if len(names) > 1 else names[0]
    return [f"To have {more} tested, add {remedy}"]
