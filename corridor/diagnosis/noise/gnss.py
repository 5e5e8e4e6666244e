"""The noise of the GNSS: white plus exponentially correlated, per flight and axis.

    Sigma_ij = w^2 s_i^2 delta_ij + c^2 exp(-|t_i - t_j| / tau)

s: the stated standard deviations, which know of epochs next to a gap or a kink; w, c, tau: see
`likelihood`. What remembers only its last value has a precision of neighbours, so slow noise is one
unknown a position in the equations of a block.

How slow noise can be large is a matter of its class: a fixed carrier-phase solution (RTK, PPK) is
good to centimetres, one from code to metres, whatever a model lacks.
Source: Rue and Held 2005, "Gaussian Markov random fields", 1.1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solveh_banded

from corridor.core.adjustment import LinearSystem
from corridor.core.geometry import robust_scale
from corridor.core.gnss import SlowNoise
from corridor.diagnosis.settings import SETTINGS

# Share of slow noise that is new after no time at all: two positions of one moment.
_FRESH = 1e-9


@dataclass
class GnssNoise:
    """Noise of antenna positions.

    flight, time: (k,) of each position. stated: (3k,) m. white: (flights, 3) factor on the stated
    standard deviation; coloured: (flights, 3) m; tau: (flights, 3) s. most: (2, 3) m, largest white
    and coloured part that such positions have.
    """

    flight: np.ndarray
    time: np.ndarray
    stated: np.ndarray
    white: np.ndarray
    coloured: np.ndarray
    tau: np.ndarray
    most: np.ndarray = field(default_factory=lambda: np.full((2, 3), np.inf))

    def blocks(self):
        """Rows (n,) of 3k, flight and axis of each block of the covariance."""
        for f in range(len(self.tau)):
            rows = np.flatnonzero(self.flight == f)
            if len(rows):
                for axis in range(3):
                    yield 3 * rows + axis, f, axis

    def parts(self, rows, f, axis):
        """White and coloured covariance (n, n) of a block."""
        white = np.diag((self.white[f, axis] * self.stated[rows]) ** 2)
        slow = SlowNoise(self.tau[f, axis]).correlation(self.time[rows // 3])
        return white, self.coloured[f, axis] ** 2 * slow

    @property
    def white_weight(self) -> np.ndarray:
        """Weights (3k,) of the white part alone, 1/m2."""
        axis = np.tile(np.arange(3), len(self.flight))
        return (self.white[np.repeat(self.flight, 3), axis] * self.stated) ** -2.0

    def slow_parts(self) -> Iterator[tuple[np.ndarray, float, np.ndarray]]:
        """Of each block its rows (n,) in the order of time, the size of its slow part, m, and the
        precision of that in units of the size: its diagonal and what is above it (2, n).
        """
        for rows, f, axis in self.blocks():
            rows = self.in_time(rows)
            precision, _ = precision_of(np.diff(self.time[rows // 3]), self.tau[f, axis])
            yield rows, float(self.coloured[f, axis]), precision

    def in_time(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n,) of 3k in the order of time."""
        return rows[np.argsort(self.time[rows // 3], kind="stable")]

    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (s,) of 3k with a slow part, its size (s,) m, and its precision in units of the
        size, (2, s): above its diagonal, and the diagonal. What is measured there less the slow
        part has the white part alone.
        """
        parts = [part for part in self.slow_parts() if part[1] > 0.0]
        if not parts:
            return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((2, 0))
        rows = np.concatenate([rows for rows, *_ in parts])
        size = np.concatenate([np.full(len(rows), size) for rows, size, _ in parts])
        return rows, size, np.concatenate([precision for *_, precision in parts], axis=1)

    def linked(self, states: np.ndarray) -> np.ndarray:
        """Whether each of some rows (s,) of 3k and the next are of one flight and axis (s - 1,)."""
        of = 3 * self.flight[states // 3] + states % 3
        return of[1:] == of[:-1]

    def weigh(self, rows):
        """Inverse covariance times dense rows (3k, ...)."""
        rows = np.asarray(rows)
        weight = self.white_weight.reshape((-1,) + (1,) * (rows.ndim - 1))
        out = weight * rows
        for at, size, precision in self.slow_parts():
            if size > 0.0:
                inside = precision.copy()
                inside[1] += size**2 * weight[at].ravel()
                out[at] -= size**2 * weight[at] * solveh_banded(inside, out[at])
        return out

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Covariance times dense rows (3k, n)."""
        out = rows / self.white_weight[:, None]
        for at, size, precision in self.slow_parts():
            if size > 0.0:
                out[at] += size**2 * solveh_banded(precision, rows[at])
        return out

    def draw(self, rng: np.random.Generator, many: int = 1) -> np.ndarray:
        """Errors (3k, many), m."""
        out = np.zeros((len(self.stated), many))
        for rows, f, axis in self.blocks():
            slow = SlowNoise(self.tau[f, axis]).draw(self.time[rows // 3], rng, many)
            size = self.white[f, axis] * self.stated[rows, None]
            white = size * rng.standard_normal((len(rows), many))
            out[rows] = white + self.coloured[f, axis] * slow
        return out

    @property
    def log_precision(self) -> float:
        """Logarithm of the determinant of the precision of the slow parts, in units of sizes."""
        out = 0.0
        for rows, f, axis in self.blocks():
            if self.coloured[f, axis] > 0.0:
                gaps = np.diff(self.time[self.in_time(rows) // 3])
                out += precision_of(gaps, self.tau[f, axis])[1]
        return out

    @property
    def size(self) -> np.ndarray:
        """Standard deviation (flights, 3), m, of one position."""
        out = np.zeros_like(self.coloured)
        for rows, f, axis in self.blocks():
            white = self.white[f, axis] ** 2 * np.mean(self.stated[rows] ** 2)
            out[f, axis] = np.sqrt(white + self.coloured[f, axis] ** 2)
        return out


def precision_of(gaps: np.ndarray, tau: float) -> tuple[np.ndarray, float]:
    """Precision of slow noise of size one: its diagonal and what is above it (2, n); log |it|.

    gaps (n - 1,): between the positions in the order of time, s.
    """
    kept = SlowNoise(tau).memory(gaps)
    fresh = np.maximum(1.0 - kept**2, _FRESH)
    out = np.zeros((2, len(gaps) + 1))
    out[1, 0] = 1.0
    out[1, 1:] = 1.0 / fresh
    out[1, :-1] += kept**2 / fresh
    out[0, 1:] = -kept / fresh
    return out, -float(np.log(fresh).sum())


def times_of(images, image: np.ndarray) -> np.ndarray:
    """Times (k,) of antenna positions; where they are unknown, one image is two seconds."""
    time = images.time[image]
    if np.isfinite(time).all():
        return time
    return SETTINGS.untimed_step * image.astype(float)


def stated_noise(system: LinearSystem, redundancy: np.ndarray | float = 1.0) -> GnssNoise:
    """The noise that gnss.csv states, white. redundancy: see `most_of_class`."""
    images, rows = system.images, system.gnss
    flights = len(images.flight_names)
    return GnssNoise(
        flight=images.flight[rows.image],
        time=times_of(images, rows.image),
        stated=rows.sigma.ravel(),
        white=np.ones((flights, 3)),
        coloured=np.zeros((flights, 3)),
        tau=np.full((flights, 3), SETTINGS.time_constant_prior[0]),
        most=most_of_class(system, redundancy),
    )


def bounds(redundancy: np.ndarray | float) -> np.ndarray:
    """Whether the scatter of residuals bounds that of positions (3,) with this redundancy."""
    return np.broadcast_to(redundancy, 3) * SETTINGS.white_of_scatter > 1.0


def most_of_class(system: LinearSystem, redundancy: np.ndarray | float = 1.0) -> np.ndarray:
    """Largest white and slow part (2, 3) m of antenna positions, by their class.

    redundancy (3,): mean of the positions' on each axis. Cameras follow positions that are stated
    much too well; that share of errors is left, and bounds nothing where it is small.

    The class is told by what is stated and by how much positions differ from one to the next, of
    which slow noise has no part: who states centimetres of a code solution is not believed.
    """
    rows, images = system.gnss, system.images
    if len(rows.image) < 2:
        return np.full((2, 3), np.inf)
    stated = np.median(rows.sigma, axis=0)
    order = np.lexsort((times_of(images, rows.image), images.flight[rows.image]))
    step = np.diff(rows.residual[order], axis=0) / np.sqrt(2.0)
    scatter = robust_scale(step, axis=0)
    if np.maximum(stated, scatter)[:2].max() > SETTINGS.carrier_phase_plan:
        return np.full((2, 3), np.inf)
    slow = np.maximum(SETTINGS.carrier_phase_slow, np.minimum(stated, scatter))
    return np.array(
        [np.where(bounds(redundancy), SETTINGS.white_of_scatter * scatter, np.inf), slow]
    )
