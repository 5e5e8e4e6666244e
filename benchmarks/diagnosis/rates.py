"""A share of blocks with its confidence interval."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from scipy.stats import binomtest


@dataclass(frozen=True)
class Rate:
    """`hits` of `count` blocks; low, high: 95 % confidence interval (Wilson 1927)."""

    hits: int
    count: int

    @classmethod
    def of(cls, answers: Iterable[bool]) -> Rate:
        """The share of answers that are true."""
        answers = [bool(answer) for answer in answers]
        return cls(sum(answers), len(answers))

    @property
    def share(self) -> float | None:
        """hits / count, None of no blocks."""
        return self.hits / self.count if self.count else None

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """low, high."""
        if not self.count:
            return None, None
        found = binomtest(self.hits, self.count).proportion_ci(0.95, method="wilson")
        return float(found.low), float(found.high)

    def to_dict(self) -> dict:
        """For benchmark.json."""
        low, high = self.interval
        return {
            "hits": self.hits, "count": self.count, "share": self.share, "low": low, "high": high
        }  # fmt: skip

    def __str__(self) -> str:
        if not self.count:
            return "no block"
        low, high = self.interval
        return (
            f"{100 * self.share:.1f} % ({self.hits} of {self.count}; {100 * low:.1f} to "
            f"{100 * high:.1f})"
        )
