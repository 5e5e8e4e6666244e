"""The one sentence that a reader wants first, and what would help where it says less."""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.effects import find
from corridor.core.output import DASH, fixed
from corridor.tools.change.explanation import Explanation
from corridor.tools.change.points import PointChanges
from corridor.tools.change.surface import SurfaceChange

# What tells an effect of this place from motion of the ground.
_HELP = {
    "camera": "a calibration of the camera at both dates, oblique images, or strips at two heights",
    "image": "crossed strips or oblique images, which turn the picture against the ground",
    "motion": "strips flown there and back, or a stated readout time of the camera",
    "antenna": "control points that stand still at both dates, beside what may move",
}


def millimetres(value: float, sigma: float) -> str:
    """`-14 +- 3 mm`, as many digits as the sigma is worth."""
    digits = 1 if 1000 * sigma < 2 else 0
    return f"{fixed(1000 * value, digits)} \u00b1 {fixed(1000 * sigma, digits)} mm"


def verdict_sentence(change) -> str:
    """What the two dates say, in one or two sentences; change: a `Change`."""
    surface, told = change.surface, change.explanation
    if change.verdict == "moved":
        besides = "" if told is None or not any(told.shown) else _besides(told)
        return _moved(surface, change.points) + besides
    if change.verdict == "camera":
        return _camera(told, _size(change.compared.surface))
    if change.verdict == "undecided":
        return _undecided(told, _size(change.compared.surface))
    said = f"No change is significant at the level of {100 * change.asked.level:g} %"
    if surface is None:
        return f"{said}."
    seen = 1000 * np.median(surface.detection)
    return f"{said}; half of the surface would show {seen:.0f} mm (95 %)."


def remedies(change, most: int = 3) -> list[str]:
    """What would tell ground and camera apart, by the effects that stand between them."""
    if change.explanation is None or change.verdict != "undecided":
        return []
    hiding = _hiding(change.explanation)
    if not len(hiding):
        return [
            "No single effect hides the change, several together do: control points that stand "
            "still at both dates would tell."
        ]
    out = []
    for place, rows in hiding.groupby("place", sort=False):
        out.append(f"Against {_listed(_called(rows))}: {_HELP[place]}.")
    return out[:most]


def _largest(surface: SurfaceChange) -> int:
    """The most significant core point."""
    z = np.abs(surface.distance / surface.total)
    return int(np.argmax(np.where(surface.moved, z, -1.0)))


def _moved(surface: SurfaceChange | None, points: PointChanges | None) -> str:
    if surface is not None and surface.moved.any():
        k = _largest(surface)
        z = surface.distance[k]
        way = "sank" if z < 0 else "rose"
        return (
            f"The ground moved: it {way} by {millimetres(abs(z), surface.total[k])} at station "
            f"{surface.cores.station[k]:.0f} m, {_aside(surface.cores.across[k])}; "
            f"{100 * surface.moved.mean():.0f} % of the surface moved significantly."
        )
    if points is not None and points.moved.any():
        k = int(np.argmin(np.where(points.moved, points.probability, 2.0)))
        d, s = points.shift[k], points.sigma[k]
        length = float(np.linalg.norm(d))
        sigma = float(np.sqrt(d**2 @ s**2) / max(length, 1e-12))
        return (
            f"The ground moved: point {points.names[k]} by {millimetres(length, sigma)}, "
            f"{points.moved.sum()} of {np.sum(~points.held)} points significantly."
        )
    return (
        "The ground moved: the change as a whole is beyond what its errors and every effect of the "
        "camera explain, though no single place is significant by itself."
    )


def _aside(across: float) -> str:
    """Where across the corridor, m."""
    if abs(across) < 0.5:
        return "on its axis"
    return f"{abs(across):.0f} m to the {'left' if across > 0 else 'right'}"


def _besides(told: Explanation) -> str:
    has = "is" if len(_every(told)) == 1 else "are"
    return f" Besides, the measurements show {_shown(told)}, which {has} modelled."


def _camera(told: Explanation, size: str) -> str:
    one = len(_every(told)) == 1
    share = told.table.loc[told.table["effect"].isin(_every(told)), "explained"].max()
    return (
        f"The camera explains it: {_shown(told)} {'makes' if one else 'make'} the change{size}, "
        f"{100 * share:.0f} % of it; with {'that' if one else 'those'} modelled nothing "
        "significant remains."
    )


def _undecided(told: Explanation, size: str) -> str:
    names = _called(_hiding(told)) or ["several effects together"]
    return (
        f"Ground and camera cannot be told apart: a change is there{size}, but {_listed(names)} in "
        "one of the epochs could make it, and the measurements do not say."
    )


def _size(surface: SurfaceChange | None) -> str:
    if surface is None or not surface.moved.any():
        return ""
    k = _largest(surface)
    return f" (up to {millimetres(surface.distance[k], surface.total[k])})"


def _every(told: Explanation) -> set[str]:
    return set().union(*told.shown)


def _hiding(told: Explanation) -> pd.DataFrame:
    """The rows of effects that alone could hide the change."""
    return told.table[told.table["hides"]] if len(told.table) else told.table


def _called(rows: pd.DataFrame, most: int = 3) -> list[str]:
    """Names of the first effects of a table."""
    slugs = dict.fromkeys(rows["effect"]) if len(rows) else {}
    return list(dict.fromkeys(find(slug).called for slug in slugs))[:most]


def _shown(told: Explanation) -> str:
    """Effects that the measurements show, by date."""
    dates = (" at the first date", " at the second date") if len(told.shown) == 2 else ("",)
    words = [
        " and ".join(find(slug).called for slug in sorted(slugs)) + date
        for date, slugs in zip(dates, told.shown, strict=True)
        if slugs
    ]
    return ", and ".join(words) or DASH


def _listed(names: list[str]) -> str:
    """Names that may hold commas of their own: a; b; or c."""
    if len(names) < 3:
        return " or ".join(names)
    return "; ".join(names[:-1]) + f"; or {names[-1]}"
