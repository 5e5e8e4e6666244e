"""What the block cannot tell apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from corridor.adjustment.report.numbers import coefficient, counted, fixed, short, significant
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_STRONG = 0.95
_MOST = 12


def correlations(adjustment: Adjustment) -> Table | None:
    """Focal length and lever arm with the heights they can stand in for."""
    rows = tuple(
        (
            short(c["a"], 30),
            short(c["b"], 28),
            coefficient(c["mean"]),
            fixed(c["std"], 3),
            significant(c["sigma_a"]),
            significant(c["sigma_b"]),
        )
        for c in adjustment.correlations
    )
    if not rows:
        return None
    header = ("of", "with", "mean", "STD", "sigma of", "sigma with")
    note = "over all images or points the second name stands for; sigmas in px (f) and m"
    return Table("Correlations with position", header, rows, "llrrrr", (note,))


def strong_correlations(adjustment: Adjustment) -> Table | None:
    """Parameters that can hardly be told apart, the strongest first."""
    pairs = sorted(adjustment.high_correlations, key=lambda c: -abs(c["value"]))
    names, _ = adjustment.correlation_matrix
    if not pairs:
        if len(names) < 2:
            return None
        note = f"none of the {len(names):,} parameters' correlations is above {_STRONG}"
        return Table("Strong correlations", notes=(note,))
    shown = pairs[:_MOST]
    rows = tuple((short(c["a"], 38), short(c["b"], 38), coefficient(c["value"])) for c in shown)
    notes = [f"between parameters, above {_STRONG} in size"]
    if len(pairs) > len(shown):
        notes.append(f"{counted(len(pairs) - len(shown), 'further pair')} above it left out")
    header = ("of", "with", "correlation")
    return Table("Strong correlations", header, rows, "llr", tuple(notes))
