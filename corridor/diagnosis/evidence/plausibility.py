"""Which of what explains the data is there for its own sake, and of a size that happens."""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.search import Found, tuned
from corridor.diagnosis.settings import SETTINGS


def plausible(evidence: Evidence, found: Found, threshold: float) -> Found:
    """What was found without what stands in for something else.

    threshold: of a suspicion.
    """
    found = _at_any_size(evidence, found, threshold)
    return _without_parts(evidence, found)


def impossible(evidence: Evidence, found: Found) -> dict[str, str]:
    """Groups of a model that would need a size which does not happen: key -> sentence.

    In a flight that cannot tell two effects apart each fits as well with a huge value, made good by
    a huge value of the other.
    """
    free = evidence.freed(found.chosen, SETTINGS.free_size)
    if not any(_bounded(evidence.groups[n]) for n in free):
        return {}
    theta, covariance = evidence.solution(free, each_image=False)
    out: dict[str, str] = {}
    for n in theta:
        group = evidence.groups[n]
        if not _bounded(group):
            continue
        sigma = np.sqrt(np.maximum(covariance[n].diagonal(), 0.0))
        value, doubt = theta[n] * group.scale, sigma * group.scale
        beyond = (np.abs(value) - SETTINGS.implausible_sigma * doubt) / group.most
        worst = int(np.argmax(beyond))
        within = _within(group, theta[n], covariance[n])
        if beyond[worst] > 1.0 and within < SETTINGS.same_fit_share:
            _, name, unit = group.labels[worst]
            unit = "" if unit == "1" else f" {unit}"
            out[group.key] = (
                f"{group.effect.called[0].upper()}{group.effect.called[1:]} would fit, but with "
                f"{name} {value[worst]:.3g}{unit}, and more than {group.most[worst]:.3g}{unit} "
                "does not happen: it is not taken for the cause."
            )
    return out


def nameless(evidence: Evidence, found: Found, moving: bool) -> dict[str, str]:
    """Groups of values for each image that nothing makes what they are called: key -> sentence.

    moving: the block states a readout, or rates of the camera. A shape in each image follows
    whatever differs from image to image: its name needs what nothing else looks like (`proper`), or
    a motion during the readout that all images share.
    """
    groups = evidence.groups
    shared = (n for n in found.chosen if groups[n].own is None)
    if moving or any(groups[n].effect.during_readout for n in shared):
        return {}
    out: dict[str, str] = {}
    for n, kappa in found.chosen.items():
        group = groups[n]
        proper = np.array([name in group.effect.proper for _, name, _ in group.labels])
        if group.own is None or not proper.any():
            continue
        without = {**found.chosen, n: np.where(proper, 1.0 / SETTINGS.free_size, kappa)}
        # The name rests on this alone: it has to show as any name has to.
        if evidence.total(found.chosen) - evidence.total(without) <= SETTINGS.named_least:
            called = f"{group.effect.called[0].upper()}{group.effect.called[1:]}"
            out[group.key] = (
                f"{called} would fit, but neither the block nor its measurements show a readout, "
                f"nor clearly {', '.join(group.effect.proper)}, which nothing else looks like: it "
                "is not taken for the cause. readout_s in block.toml, or rates.csv, would tell."
            )
    return out


def _within(group, theta: np.ndarray, covariance: np.ndarray) -> float:
    """Share of what a group explains that is left where none of its parameters is beyond its most.

    theta (p,), covariance (p, p): beside all others. To leave the group out costs
    theta' C^-1 theta / 2 of log likelihood; to hold some parameters at b, of which C_b is the
    covariance, (theta_b - b)' C_b^-1 (theta_b - b) / 2.
    """
    most = group.most / group.scale
    over = np.clip(theta, -most, most) != theta
    away = theta[over] - np.clip(theta, -most, most)[over]
    whole = theta @ np.linalg.lstsq(covariance, theta, rcond=None)[0]
    held = away @ np.linalg.lstsq(covariance[np.ix_(over, over)], away, rcond=None)[0]
    return float(1.0 - held / whole) if whole > 0.0 else 0.0


def _bounded(group) -> bool:
    return group.most is not None and bool(np.isfinite(group.most).any()) and not group.known


def _at_any_size(evidence: Evidence, found: Found, threshold: float) -> Found:
    """The model without what is there only because another effect was held small.

    One prior for all parameters of a group shrinks the few that are large, and a second group takes
    up what is left. With the others free to be as large as they like it has nothing to explain.
    """
    chosen = dict(found.chosen)
    for n in sorted(chosen, key=lambda n: found.evidence[n]):
        others = {k: kappa for k, kappa in chosen.items() if k != n}
        others = evidence.freed(others, SETTINGS.implausible_size)
        # The strongest is never a part of what is weaker.
        strongest = found.evidence[n] == max(found.evidence[k] for k in chosen)
        if n in found.kept or strongest or not others:
            continue
        if evidence.given(others, only=n)[n].evidence < threshold:
            del chosen[n]
    if len(chosen) == len(found.chosen):
        return found
    return Found.of(evidence, tuned(evidence, chosen), found.kept)


def _without_parts(evidence: Evidence, found: Found) -> Found:
    """The model without named effects that are part of an unknown one, or what it leaves.

    Where a generic shape explains more than a named effect that shows in the same way, the named
    one is not the cause, and makes up for what the shape is too coarse for. Every lens leaves a
    shape that all pictures share; what goes with the speed of each picture is no part of that, and
    what brings as much without the shape as beside it has nothing to do with it.
    """
    groups = evidence.groups
    generic = [n for n in found.chosen if groups[n].generic]
    chosen = {
        n: kappa
        for n, kappa in found.chosen.items()
        if n in found.kept
        or not any(
            _shows(groups[n]) == _shows(groups[k])
            and (
                found.evidence[n] < SETTINGS.same_fit_share * found.evidence[k]
                or (kappa >= SETTINGS.implausible_size and not groups[n].generic)
            )
            and _overlap(evidence, found, n, k)
            for k in generic
            if k != n
        )
    }
    if len(chosen) == len(found.chosen):
        return found
    return Found.of(evidence, chosen, found.kept)


def _overlap(evidence: Evidence, found: Found, n: int, shape: int) -> bool:
    """Whether the n-th group brings another amount beside a shape than without it."""
    rest = {k: kappa for k, kappa in found.chosen.items() if k not in (n, shape)}
    bare, beside = evidence.given(rest)[n].evidence, found.evidence[n]
    return min(bare, beside) < SETTINGS.same_fit_share * max(bare, beside)


def _shows(group) -> str:
    """How an effect shows: in the antenna, on the ground, by the rows of a moving camera, or in
    the picture.
    """
    return "image" if group.effect.place == "camera" else group.effect.place
