"""The moments at which values of single images jump, for effects that change at a moment.

The moments such an effect has by itself are those of pauses, or evenly spread; a lens is knocked or
refocused in between, and shows as values that every image has for itself until the moment is right.

Source: Scott and Knott 1974, "A cluster analysis method for grouping means in the analysis of
variance" (the split that explains most, and again in the parts).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from corridor.core.effects import AtMoments, Effect
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.search import Found

# A value that jumps and comes back jumps twice.
_MOST = 2


def with_jumps(effects: Iterable[Effect], evidence: Evidence, found: Found) -> list[Effect]:
    """The effects, those of moments with the moments at which values of images jump that were
    found, of the same place."""
    effects = list(effects)
    places = {effect.place for effect in effects if isinstance(effect, AtMoments)}
    images = evidence.reduced.elimination.equations.system.images
    times = dict(zip(images.names, images.time, strict=True))
    moments: dict[str, tuple[float, ...]] = {}
    for n in found.chosen:
        group = evidence.groups[n]
        if group.own is None or not group.generic or group.effect.place not in places:
            continue
        time = np.array([times[name] for name in dict.fromkeys(name for name, *_ in group.labels)])
        if np.isfinite(time).all() and len(time) > _MOST + 1:
            order = np.argsort(time, kind="stable")
            values = evidence.of_each_image(found.chosen, n).reshape(len(time), -1)
            moments[group.effect.place] = jumps(values[order], time[order])
    return [
        effect.with_moments(moments[effect.place])
        if isinstance(effect, AtMoments) and effect.place in moments
        else effect
        for effect in effects
    ]


def jumps(values: np.ndarray, time: np.ndarray) -> tuple[float, ...]:
    """Times, s, at which values (n, p) of successive times (n,) change most in the mean."""
    parts = [(0, len(values))]
    for _ in range(_MOST):
        _, k, first, last = max((*_split(values[a:b]), a, b) for a, b in parts if b - a > 1)
        parts.remove((first, last))
        parts += [(first, first + k), (first + k, last)]
    starts = sorted(first for first, _ in parts if first)
    return tuple(float(time[k - 1] + time[k]) / 2.0 for k in starts)


def _split(values: np.ndarray) -> tuple[float, int]:
    """What the best cut of values (n, p) takes of their squares, and where it is."""
    count = np.arange(1, len(values))[:, None]
    left = np.cumsum(values, axis=0)[:-1]
    right = values.sum(axis=0) - left
    gain = (left**2 / count + right**2 / (len(values) - count)).sum(axis=1)
    k = int(np.argmax(gain))
    return float(gain[k] - (values.sum(axis=0) ** 2).sum() / len(values)), k + 1
