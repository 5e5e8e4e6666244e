"""Noise of satellite positions that changes slowly: what an epoch is off, the next one is too."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SlowNoise:
    """A first-order Gauss-Markov process of unit variance: correlation exp(-|dt| / constant_s).

    constant_s: time constant, in seconds, or in whatever unit times are given.
    Source: Gelb 1974, "Applied optimal estimation", section 3.8.
    """

    constant_s: float

    def memory(self, step: np.ndarray) -> np.ndarray:
        """Share of the error that is left after `step` (..., not negative)."""
        return np.exp(-step / self.constant_s)

    def correlation(self, time: np.ndarray) -> np.ndarray:
        """Correlation (n, n) of the errors at times (n,)."""
        return self.memory(np.abs(time[:, None] - time))

    def draw(
        self,
        time: np.ndarray,
        rng: np.random.Generator,
        axes: int = 1,
        flight: np.ndarray | None = None,
    ) -> np.ndarray:
        """Errors (n, axes) at times (n,), axes independent of each other.

        flight: (n,) number of the flight of each row; each begins anew. None: one flight.
        """
        flight = np.zeros(len(time), dtype=np.int64) if flight is None else flight
        order = np.lexsort((time, flight))
        memory = self.memory(np.diff(time[order], prepend=time[order[:1]]))
        memory[np.diff(flight[order], prepend=-1) != 0] = 0.0
        fresh = np.sqrt(1 - memory**2)[:, None] * rng.standard_normal((len(order), axes))
        out, last = np.empty_like(fresh), np.zeros(axes)
        for n, row in enumerate(order):
            last = memory[n] * last + fresh[n]
            out[row] = last
        return out
