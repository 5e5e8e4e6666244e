"""How large the largest evidence of all groups becomes when nothing is missing.

Under the null hypothesis g ~ N(0, M) for all columns together, which tells at once how strongly
candidates are correlated: no correction for the number of tests is needed.
"""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.evidence import Evidence, Spectrum, averaged
from corridor.diagnosis.settings import SETTINGS


def thresholds(evidence: Evidence, level: float, rng: np.random.Generator) -> dict[str, float]:
    """Log evidence beyond which a group is `named` (`beside_noise`: the antenna's) and `suspected`.

    level: probability of a false name in a block without any; suspected: five times that, and
    5 % at most.
    """
    largest = largest_of_null(evidence, SETTINGS.null_draws, rng)
    rare = float(np.quantile(largest, 1.0 - level))
    at_suspicion = min(SETTINGS.suspected_level_factor * level, SETTINGS.suspected_level_most)
    less_rare = float(np.quantile(largest, 1.0 - max(at_suspicion, level)))
    return {
        "named": max(rare, SETTINGS.named_least),
        "beside_noise": max(rare, SETTINGS.beside_noise_least),
        "suspected": max(less_rare, SETTINGS.suspected_least),
    }


def largest_of_null(evidence: Evidence, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Largest evidence (draws,) over all groups in blocks without an effect.

    Blocks of per-image columns are drawn apart from the core: they share little with it.
    """
    r = evidence.reduced
    # No effect at all has the evidence zero.
    largest = np.zeros(draws)
    whole = Spectrum.of(r.M)
    core = whole.vector @ (np.sqrt(whole.value)[:, None] * rng.standard_normal((len(r.M), draws)))
    for n, group in enumerate(evidence.groups):
        if group.known or not len(group):
            continue
        spectrum = evidence.alone(n)
        if group.own is None:
            h = spectrum.vector.T @ core[group.columns]
        else:
            h = np.sqrt(spectrum.value)[:, None] * rng.standard_normal((len(group), draws))
        found = averaged(spectrum.log_bayes(h)) + group.log_prior
        np.maximum(largest, found, out=largest)
    return largest
