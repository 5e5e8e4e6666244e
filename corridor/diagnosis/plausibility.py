"""Which of what explains the data is there for its own sake."""

from __future__ import annotations

from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.search import Found, contributions, tuned
from corridor.diagnosis.settings import SETTINGS


def plausible(evidence: Evidence, found: Found, model: list[str], threshold: float) -> Found:
    """What was found without what stands in for something else.

    model: keys of the groups that the adjustment at hand estimates. threshold: of a suspicion.
    """
    found = _kept(evidence, found, model)
    found = _at_any_size(evidence, found, threshold)
    return _without_parts(evidence, found)


def _kept(evidence: Evidence, found: Found, model: list[str]) -> Found:
    """The model that is in place, where another of its size is hardly better.

    Look-alikes would take turns for ever; that they are look-alikes is said in the verdict.
    """
    numbers = [evidence.number[key] for key in model if key in evidence.number]
    if not numbers or len(numbers) != len(found.chosen) or set(numbers) == set(found.chosen):
        return found
    mine = tuned(evidence, dict.fromkeys(numbers, 1.0))
    total = evidence.model(mine)[0]
    each = contributions(evidence, mine)
    if found.total - total > SETTINGS.model_log_odds:
        return found
    order = sorted(mine, key=lambda n: -each[n])
    return Found({n: mine[n] for n in order}, {n: each[n] for n in order}, total)


def _at_any_size(evidence: Evidence, found: Found, threshold: float) -> Found:
    """The model without what is there only because another effect was held small.

    One prior for all parameters of a group shrinks the few that are large, and a second group takes
    up what is left. With the others free to be as large as they like it has nothing to explain.
    """
    groups, chosen = evidence.groups, dict(found.chosen)
    for n in sorted(chosen, key=lambda n: found.evidence[n]):
        others = {
            k: kappa
            if groups[k].known or len(groups[k]) > SETTINGS.most_free
            else SETTINGS.implausible_size
            for k, kappa in chosen.items()
            if k != n
        }
        # The strongest is never a part of what is weaker.
        if not others or found.evidence[n] == max(found.evidence[k] for k in chosen):
            continue
        if evidence.given(others)[n].evidence < threshold:
            del chosen[n]
    if len(chosen) == len(found.chosen):
        return found
    chosen = tuned(evidence, chosen)
    return Found(chosen, contributions(evidence, chosen), evidence.model(chosen)[0])


def _without_parts(evidence: Evidence, found: Found) -> Found:
    """The model without named effects that are part of an unknown one, or what it leaves.

    Where a generic shape explains more than a named effect of the same side, the named one is
    not the cause, and makes up for what the shape is too coarse for.
    """
    groups = evidence.groups
    generic = [n for n in found.chosen if groups[n].generic]
    chosen = {
        n: kappa
        for n, kappa in found.chosen.items()
        if not any(
            _side(groups[n]) == _side(groups[k])
            and (
                found.evidence[n] < SETTINGS.share_beside_generic * found.evidence[k]
                or (kappa >= SETTINGS.implausible_size and not groups[n].generic)
            )
            for k in generic
            if k != n
        )
    }
    if len(chosen) == len(found.chosen):
        return found
    each = contributions(evidence, chosen)
    return Found(chosen, each, evidence.model(chosen)[0])


def _side(group) -> str:
    """Image, antenna or ground: where an effect shows."""
    return group.effect.place if group.effect.place in ("antenna", "ground") else "image"
