"""What measurements and start values say of each other: where to look when nothing converged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from corridor.errors import AdjustmentFailed

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_NAMED = 3


def not_converged(adjustment: Adjustment) -> AdjustmentFailed:
    """The error that says so: numbers that are no result are not written."""
    return AdjustmentFailed(
        f"the adjustment of {adjustment.start.name} did not converge in {adjustment.iterations} "
        "iterations, so there is no result and nothing was written: check the axes, units and "
        "names of what lies farthest off above, or allow more with --iterations"
    )


def start_misfit(adjustment: Adjustment) -> list[str]:
    """Sentences on how far the measurements lie from the start values, and which lie farthest."""
    p = adjustment.problem
    left = replace(adjustment.system, state=p.start).residuals()
    out = []
    if len(left.gnss):
        out.append(_metres("GNSS positions", p.images.names[p.gnss_image], left.gnss))
    if len(left.control):
        out.append(_metres("control points", adjustment.system.control_names, left.control))
    length = np.linalg.norm(left.pixels, axis=1)
    found = [np.nanmedian(length[p.img == k]) for k in range(p.image_count)]
    worst = np.argsort(-np.nan_to_num(found, nan=np.inf))[:_NAMED]
    named = ", ".join(f"{p.images.names[k]} {found[k]:.0f} px" for k in worst)
    out.append(
        f"Image points lie {np.nanmedian(length):.0f} px (median) from where the start values put "
        f"them; most in {named}."
    )
    return out


def _metres(what: str, names, left: np.ndarray) -> str:
    median = ", ".join(
        f"{axis} {value:+.2f} m" for axis, value in zip("xyz", np.median(left, 0), strict=True)
    )
    length = np.linalg.norm(left, axis=1)
    named = ", ".join(f"{names[k]} {length[k]:.2f} m" for k in np.argsort(-length)[:_NAMED])
    return (
        f"{what[:1].upper()}{what[1:]} minus what the start values predict: median {median}; most "
        f"at {named}."
    )
