"""What the antenna feels, judged beside noise of the GNSS that may do the same."""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.evidence import Evidence, effect_sizes
from corridor.diagnosis.noise_model import NoiseModel
from corridor.diagnosis.search import Found
from corridor.diagnosis.settings import SETTINGS


def through_noise(
    noises: NoiseModel,
    plain: Evidence,
    evidence: Evidence,
    found: Found,
    threshold: dict[str, float],
    model: list[str],
) -> dict[int, float] | None:
    """A model with one more group, where noise and group together explain the data better.

    None where nothing hides in the noise, or strong effects wait to be adjusted first. plain,
    evidence: with the stated noise, and with that of the model. model: keys of what has been
    adjusted. The shortlist is what would win if the GNSS were as good as it says.
    """
    if noises.few:
        return None
    strong = [
        evidence.groups[n].key for n, v in found.evidence.items() if v > SETTINGS.clear_evidence
    ]
    if not set(strong) <= set(model):
        return None
    here = evidence.given(found.chosen)
    if max((gain.evidence for gain in here), default=0.0) > SETTINGS.clear_evidence:
        return None
    if not found.chosen or min(found.evidence.values()) < SETTINGS.clear_evidence:
        base = {
            n: k for n, k in found.chosen.items() if found.evidence[n] >= SETTINGS.clear_evidence
        }
    else:
        base = dict(found.chosen)
    base = {n: max(k, 1.0) for n, k in base.items()}
    at_stated = plain.given(base)
    order = sorted(range(len(at_stated)), key=lambda n: -at_stated[n].evidence)
    short = [n for n in order if at_stated[n].evidence > threshold["named"]][: SETTINGS.shortlist]
    ranked = sorted(range(len(here)), key=lambda n: -here[n].evidence)
    short += [n for n in ranked[:2] if n not in short and here[n].evidence > 0.0]
    short = [n for n in short if n not in base and noises.touches(n) > SETTINGS.gnss_share]
    if not short:
        return None
    _, total = noises.given(base)
    best = None
    for n in short:
        found_total, kappa = _probability(noises, base, n, at_stated[n].kappa)
        if best is None or found_total > best[0]:
            best = found_total, base | {n: kappa}
    return best[1] if best[0] - total > threshold["suspected"] else None


def beyond_noise(noises: NoiseModel, found: Found, threshold: float) -> Found:
    """The model with the evidence of what the antenna feels against noise that may do the same.

    Noise that was estimated with an effect in the model leaves all of it to the effect. What is
    missing without the effect is what noise of another size and slowness cannot make up for.
    """
    if noises.few:
        return found
    each = dict(found.evidence)
    for n, gain in found.evidence.items():
        clear = n in found.kept or gain > SETTINGS.clear_evidence
        if clear or noises.touches(n) <= SETTINGS.gnss_share:
            continue
        rest = {
            k: kappa
            for k, kappa in found.chosen.items()
            if k != n and noises.evidence.block(noises.evidence.groups[k])[0] is not None
        }
        _, without = noises.given(rest)
        total, _ = _probability(noises, rest, n, found.chosen[n])
        each[n] = min(gain, total - without)
    return found.beyond(each, threshold)


def _probability(
    noises: NoiseModel, base: dict[int, float], n: int, kappa: float
) -> tuple[float, float]:
    """Log probability of the data with one more group, averaged over its sizes, and the likeliest.

    The noise is estimated with the group in the model, of size `kappa`.
    """
    found, total = noises.given(base | {n: kappa})
    if noises.evidence.groups[n].known:
        return total, kappa
    each: dict[int, float] = {}
    sizes, _ = effect_sizes()
    begin = int(np.argmin(np.abs(np.log(sizes / kappa))))
    for upwards in (range(begin, len(sizes)), range(begin - 1, -1, -1)):
        for k in upwards:
            each[k] = noises.at(base | {n: float(sizes[k])}, found)
            if each[k] < max(each.values()) - SETTINGS.model_log_odds:
                break
    return float(np.logaddexp.reduce(list(each.values()))), float(sizes[max(each, key=each.get)])
