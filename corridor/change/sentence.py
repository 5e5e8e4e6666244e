"""The one sentence that a reader wants first, and what would help where it says less."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from corridor.change.surface import SurfaceChange
from corridor.effects import find
from corridor.report import DASH, fixed

if TYPE_CHECKING:
    from corridor.change.result import Change

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


def verdict_sentence(change: Change) -> str:
    """What the two dates say, in one or two sentences."""
    said = {
        "moved": _moved,
        "camera": _camera,
        "undecided": _undecided,
        "nothing": _nothing,
    }[change.verdict](change)
    both = change.explanation is not None and change.verdict == "moved"
    if both and any(change.explanation.shown):
        said += f" Besides, the measurements show {_shown(change)}, which {_has(change)} modelled."
    return said


def remedies(change: Change, most: int = 3) -> list[str]:
    """What would tell ground and camera apart, by the effects that stand between them."""
    if change.explanation is None or change.verdict != "undecided":
        return []
    table = change.explanation.table
    hiding = table[table["hides"]] if len(table) else table
    if not len(hiding):
        return [
            "No single effect hides the change, several together do: control points that stand "
            "still at both dates would tell."
        ]
    out = []
    for place, rows in hiding.groupby("place", sort=False):
        names = list(dict.fromkeys(find(slug).called for slug in rows["effect"]))[:3]
        out.append(f"Against {_listed(names)}: {_HELP[place]}.")
    return out[:most]


def _largest(surface: SurfaceChange) -> int:
    """The most significant core point."""
    z = np.abs(surface.distance / surface.total)
    return int(np.argmax(np.where(surface.moved, z, -1.0)))


def _moved(change: Change) -> str:
    surface, points = change.surface, change.points
    if surface is not None and surface.moved.any():
        k = _largest(surface)
        share = surface.moved.mean()
        z = surface.distance[k]
        way = "sank" if z < 0 else "rose"
        return (
            f"The ground moved: it {way} by {millimetres(abs(z), surface.total[k])} at station "
            f"{surface.cores.station[k]:.0f} m, {_aside(surface.cores.across[k])}; "
            f"{100 * share:.0f} % of the surface moved significantly."
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


def _camera(change: Change) -> str:
    table = change.explanation.table
    mine = table[[slug in _every(change) for slug in table["effect"]]]
    share = mine["explained"].max()
    size = _size(change.compared.surface)
    return (
        f"The camera explains it: {_shown(change)} {_makes(change)} the change{size}, "
        f"{100 * share:.0f} % of it; with {'that' if len(_every(change)) == 1 else 'those'} "
        "modelled nothing significant remains."
    )


def _undecided(change: Change) -> str:
    table = change.explanation.table
    hiding = list(dict.fromkeys(table.loc[table["hides"], "effect"])) if len(table) else []
    names = [find(slug).called for slug in hiding[:3]] or ["several effects together"]
    size = _size(change.compared.surface)
    return (
        f"Ground and camera cannot be told apart: a change is there{size}, but {_listed(names)} in "
        "one of the epochs could make it, and the measurements do not say."
    )


def _nothing(change: Change) -> str:
    surface = change.surface
    if surface is None or not len(surface):
        return f"No change is significant at the level of {100 * change.asked.level:g} %."
    seen = 1000 * np.median(surface.detection)
    return (
        f"No change is significant at the level of {100 * change.asked.level:g} %; half of the "
        f"surface would show {seen:.0f} mm (95 %)."
    )


def _size(surface: SurfaceChange | None) -> str:
    if surface is None or not surface.moved.any():
        return ""
    k = _largest(surface)
    return f" (up to {millimetres(surface.distance[k], surface.total[k])})"


def _every(change: Change) -> list[str]:
    return sorted(set().union(*change.explanation.shown))


def _shown(change: Change) -> str:
    """Effects that the measurements show, by date."""
    shown = change.explanation.shown
    dates = (" at the first date", " at the second date") if len(shown) == 2 else ("",)
    words = [
        " and ".join(find(slug).called for slug in sorted(slugs)) + date
        for date, slugs in zip(dates, shown, strict=True)
        if slugs
    ]
    return ", and ".join(words) or DASH


def _listed(names: list[str]) -> str:
    """Names that may hold commas of their own: a; b; or c."""
    if len(names) < 3:
        return " or ".join(names)
    return "; ".join(names[:-1]) + f"; or {names[-1]}"


def _has(change: Change) -> str:
    return "is" if len(_every(change)) == 1 else "are"


def _makes(change: Change) -> str:
    return "makes" if len(_every(change)) == 1 else "make"
