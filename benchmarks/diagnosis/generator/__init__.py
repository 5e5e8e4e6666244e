"""Independent generator of blocks in which an effect is hidden.

Physics written without the package: a continuous flight, lenses that are not Fraser's, a receiver,
and noise. `generate(case, seed)` gives a block, its twin (same noise, no effect) and the truth.
"""

from .cases import CATALOGUE, NULLS, OUTSIDE, Case, null, perfect, single, together
from .noise import NOISES, Noise
from .trajectory import CALM, Air

__all__ = [
    "CALM",
    "CATALOGUE",
    "NOISES",
    "NULLS",
    "OUTSIDE",
    "Air",
    "Case",
    "Noise",
    "null",
    "perfect",
    "single",
    "together",
]
