"""The simulated counterpart: this very block, had the believed model been the whole truth.

Same images, points, gaps, control and epochs; every observation anew, from the adjusted model and
noise of the sizes and kinds that the residuals show; then fitted again. What many counterparts
have in common is what the believed model produces after poses and points have absorbed what they
can, and beside it stands what was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.core.engine.memory import give_back
from corridor.core.engine.scene import PANEL
from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.output import Progress, telling
from corridor.diagnosis.bootstrap.replicator import EstimatedNoise, Replicator
from corridor.diagnosis.bootstrap.statistics import Statistic, SummaryStatistics

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

# With 39 counterparts the second largest of 40 is the 95 % limit, exactly.
COUNT = 39
LEAST = 19
# Share of the raw noise below which a value says nothing: the adjustment makes it zero.
ABSORBED = 0.01
# Counterparts that are fitted together: as many as go through the points at once.
AT_ONCE = PANEL


@brief
@dataclass(eq=False)
class Counterparts:
    """What was measured beside what the believed model produces.

    statistics: what is compared, their values laid end to end; measured: (values,) of the block;
    simulated: (count, values) of its counterparts. missing: statistics that could not be formed,
    with the column to add. absorbed: (values,) bool, values of which poses and points leave
    nothing but rounding; unseen: effects of which they leave no signature. replicator: the model
    and its noise.
    """

    statistics: list[Statistic]
    measured: np.ndarray
    simulated: np.ndarray
    absorbed: np.ndarray
    missing: dict[str, str]
    unseen: tuple[str, ...]
    replicator: Replicator

    @property
    def noise(self) -> EstimatedNoise:
        """The noise that was drawn."""
        return self.replicator.noise

    @property
    def table(self) -> pd.DataFrame:
        """Statistics of the measured block, a row a value: see `measure`."""
        return _table(self.statistics, self.measured)


def counterparts(
    adjustment: Adjustment,
    count: int = COUNT,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> Counterparts:
    """Simulate the block of an adjustment again and again, and fit the same model to it.

    count: how many counterparts, at least 19; 39 make the 95 % limits exact. threads: 1 or 2.
    progress: called with a `Progress`.
    Same adjustment, count and seed: same numbers, whatever the threads. Raises InputError where
    count is too small for a band.
    """
    if count < LEAST:
        raise InputError(f"{count} counterparts make no 95 % band: ask for {LEAST} or more")
    # Threads that each limit the libraries' own would leave the limit behind them.
    with one_thread():
        replicator = Replicator(adjustment)
        summary = SummaryStatistics(replicator)
        (measured,) = summary([replicator.fit])
        simulated = np.empty((count, len(measured)))
        # Many sets of residuals need the room that all before them has left.
        give_back()

        def work(first: int) -> int:
            several = range(first, min(first + AT_ONCE, count))
            drawn = (replicator.draw(np.random.default_rng([seed, k])) for k in several)
            simulated[first : several.stop] = summary(replicator.fits(drawn))
            return len(several)

        done, say = 0, telling(progress)
        for more in _each(work, range(0, count, AT_ONCE), threads):
            done += more
            say("simulating counterparts", done, count)
        give_back()
        streams = np.random.default_rng([seed, count]).spawn(AT_ONCE)
        raw = summary([replicator.errors(replicator.draw(rng)) for rng in streams])
    # Signatures are normed to what is left of them.
    normed = np.repeat([s.kind == "signature" for s in summary.statistics], summary.lengths)
    absorbed = (_spread(simulated) < ABSORBED * _spread(raw)) & ~normed
    return Counterparts(
        summary.statistics,
        measured,
        simulated,
        absorbed,
        summary.missing,
        summary.unseen,
        replicator,
    )


def _spread(values: np.ndarray) -> np.ndarray:
    """Half the values lie in it: one that was cut in a single draw does not count."""
    return np.subtract(*np.percentile(values, [75, 25], axis=0))


def _each(work: Callable[[int], int], each: Sequence[int], threads: int) -> Iterator[int]:
    if threads < 2:
        yield from map(work, each)
        return
    with ThreadPoolExecutor(min(threads, 2)) as pool:
        for job in as_completed([pool.submit(work, k) for k in each]):
            yield job.result()


def measure(adjustment: Adjustment) -> pd.DataFrame:
    """Every statistic of an adjusted block, a row a value.

    statistic, kind, unit; axis and the position on it (x, and y where it is a map), label; value.
    Held-out tie observations are taken from the fit, which is repeated without them.
    """
    with one_thread():
        replicator = Replicator(adjustment)
        summary = SummaryStatistics(replicator)
        return _table(summary.statistics, summary([replicator.fit])[0])


def _table(statistics: list[Statistic], values: np.ndarray) -> pd.DataFrame:
    parts, first = [], 0
    for one in statistics:
        at = one.at if one.at.ndim == 2 else np.column_stack([one.at, np.full(len(one.at), np.nan)])
        parts.append(
            pd.DataFrame(
                {
                    "statistic": one.name,
                    "kind": one.kind,
                    "axis": one.axis,
                    "x": at[:, 0],
                    "y": at[:, 1],
                    "label": one.labels or "",
                    "value": values[first : first + len(one)],
                    "unit": one.unit,
                }
            )
        )
        first += len(one)
    return pd.concat(parts, ignore_index=True)
