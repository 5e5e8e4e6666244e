"""Which readout to use: that of the flight, or the published one of the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from corridor.readout.flight import FlightReadout

# Sources of one camera differ by 5 to 10 per cent.
PUBLISHED_SHARE = 0.07


def use(found: FlightReadout) -> tuple[float | None, float | None, str]:
    """Which readout to use and its sigma, s, and why; None where none is known."""
    known = published_value(found)
    told = f"{1000 * found.readout:.1f} +- {1000 * found.sigma:.1f} ms"
    if known is None:
        if found.told:
            return found.readout, found.sigma, f"Use the flight's {told}: no other value is known."
        return None, None, (
            "No readout time is known: measure it from photographs (`corridor readout led --help`)"
            " or fly again as advised."
        )  # fmt: skip
    value, sigma, source = known
    word = f"{source} {1000 * value:.1f} ms"
    if not found.told:
        return value, sigma, f"Use the {word}: the flight neither proves nor disproves it."
    if abs(found.readout - value) > 2 * np.hypot(found.sigma, sigma):
        return found.readout, found.sigma, (
            f"The {word} contradicts the flight's {told}: use the flight's, and look whether the "
            "pictures were taken in another mode."
        )  # fmt: skip
    if found.sigma < sigma:
        return found.readout, found.sigma, f"Use the flight's {told}: the {word} agrees with it."
    return value, sigma, f"Use the {word}: the flight's {told} agrees and is less certain."


def published_value(found: FlightReadout) -> tuple[float, float, str] | None:
    """Published readout from the first to the last row, its sigma, s, and whose it is."""
    rows = max(found.rows, 2)
    if found.published:
        # Published times count all rows.
        each = [1e-3 * one.readout_ms * (rows - 1) / rows for one in found.published]
        value, source = float(np.median(each)), "published"
        scatter = float(np.std(each, ddof=1)) if len(each) > 1 else 0.0
    elif found.stated:
        value, scatter, source = found.stated, 0.0, "block's stated"
    else:
        return None
    return value, max(PUBLISHED_SHARE * value, scatter), source
