"""The one sentence that a reader wants first, and what would help where it says less."""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.effects import find
from corridor.core.errors import some
from corridor.core.output import DASH, fixed
from corridor.tools.change.admission import BOTH_DATES
from corridor.tools.change.explanation import Explanation

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
    if change.verdict == "unfit":
        return _unfit(change.objections)
    if change.verdict == "cover":
        return _cover(change.final)
    besides = "" if told is None or not any(told.shown) else _besides(told)
    if change.verdict == "moved":
        return _moved(change.final) + besides
    if change.verdict == "camera":
        return _camera(told, _size(change.compared))
    if change.verdict == "undecided" and change.points is not None and change.points.alone.any():
        return _alone(change.final) + besides
    if change.verdict == "undecided":
        return _undecided(told, _size(change.compared)) + besides
    apart = change.final.apart
    what = "change of the ground" if apart else "change"
    said = f"No {what} is significant at the level of {100 * change.asked.level:g} %"
    if surface is not None:
        seen = 1000 * np.median(surface.detection)
        said += f"; in half of the surface a change of {seen:.0f} mm would be detected (95 %)"
    return " ".join([f"{said}.", *apart[:1]])


def _unfit(objections) -> str:
    """Who does not fit, and how: the first of each."""
    first = objections[0]
    how = [one.what for one in objections if one.who == first.who][:2]
    if first.who == BOTH_DATES:
        return f"Cannot be determined: {first.who} {how[0]}."
    return f"Cannot be determined: {first.who} does not fit its own model: {'; '.join(how)}."


def remedies(change, most: int = 3) -> list[str]:
    """What would tell ground and camera apart, by the effects that stand between them; what to do
    where an epoch does not fit."""
    if change.objections:
        return list(dict.fromkeys(one.remedy for one in change.objections))[:most]
    if change.verdict != "undecided":
        return []
    if change.points is not None and change.points.alone.any():
        names = some([str(name) for name in change.points.names[change.points.alone]], 6)
        return [f"Compare the photographs of both dates at {names}: is it the same mark?"]
    if change.explanation is None:
        return []
    hiding = _hiding(change.explanation)
    if not len(hiding):
        return [
            "No single effect hides the change, several together do: control points that stand "
            "still at both dates would decide."
        ]
    out = []
    for place, rows in hiding.groupby("place", sort=False):
        out.append(f"Against {_listed(_called(rows))}: {_HELP[place]}.")
    return out[:most]


def _moved(found) -> str:
    """What carries the most significance first: points, then patches; found: a `Compared`."""
    points, said = found.points, []
    if points is not None and points.moved.any():
        order = points.leading
        first, names = order[0], [str(points.names[k]) for k in order]
        way = _way(points.shift[first], points.sigma[first])
        said.append(
            f"The ground moved: point {names[0]} {way}{_where(found, first)}; {len(order)} of "
            f"{np.sum(~points.held)} points moved significantly ({some(names, 6)})."
        )
    for one in sorted(found.patches, key=lambda p: -abs(p.change / p.sigma))[:1]:
        way = "sank" if one.change < 0 else "rose"
        against = " against the surface around it" if one.local else ""
        what = (
            f"patch of {one.area:.0f} m\u00b2 of the surface {way} by "
            f"{millimetres(abs(one.change), one.sigma)} in the mean{against}, around station "
            f"{one.station:.0f} m, {_aside(one.across)}."
        )
        alone = (
            f"The surface moved: a {what} No marked point says whether it is the ground, or what "
            "lies, stands, grows or flows on it."
        )
        said.append(f"A {what}" if said else alone)
    return " ".join(said)


def _cover(found) -> str:
    """What lies or grows on the ground, and whether the ground may have moved too; found: a
    `Compared`."""
    cover, patch = found.cover, found.cover.patch
    doubt = (
        f" Yet {_doubted(found.points)}: the ground, its mark, or an effect of the camera."
        if found.doubted
        else ""
    )
    return (
        f"Not the ground, but what covers it: {patch.area:.0f} m\u00b2 of the surface "
        f"{'sank' if patch.change < 0 else 'rose'} by "
        f"{millimetres(abs(patch.change), patch.sigma)} in the mean, while {cover.points} marked "
        f"points of it stand still ({millimetres(cover.still, cover.sigma)}): vegetation, snow or "
        f"material that was added or removed, or other targets.{doubt}"
    )


def patch_apart(patch, why: str) -> str:
    """That a patch is no ground; why: how that shows."""
    return (
        f"A patch of {patch.area:.0f} m\u00b2 around station {patch.station:.0f} m, "
        f"{_aside(patch.across)}, does not count: {why}"
    )


def strips_apart(times: float, date: str) -> str:
    """How much worse matches are between strips than within them."""
    return (
        f"At {date} matches between strips are {fixed(times, 1)} times as uncertain as within "
        "them, off by the same in all pictures of a strip; so much larger all standard deviations "
        "count. More overlap across, or crossed strips, would lower them."
    )


def mark_apart(points, found) -> str:
    """That a point does not count, as the surface around it contradicts it; found: a
    `Contradiction`."""
    way = _way(points.shift[found.point], points.sigma[found.point])
    return (
        f"Point {points.names[found.point]} {way}, which the surface within {found.radius:.2g} m "
        f"of it contradicts: along its normal that changed by "
        f"{millimetres(found.surface, found.surface_sigma)}, the point by "
        f"{millimetres(found.moved, found.moved_sigma)}. The mark was moved, or measured in "
        "another place; it does not count."
    )


def patch_level(found) -> str:
    """Its points share one height at both dates, or at one; found: a `Level`."""
    level = f"level within {1000 * found.within:.0f} mm as still water is"
    if len(found.dates) < 2:
        date = ("the first date", "the second date")[found.dates[0]]
        return f"at {date} its points share one height, {level}."
    rise = found.heights[1] - found.heights[0]
    way = "higher" if rise > 0 else "lower"
    return (
        f"at each date its points share one height, {level}, which is {abs(rise):.2f} m {way} at "
        "the second date."
    )


def patch_layers(found, date: str) -> str:
    """The strips of a date show two surfaces; found: `Layers`."""
    way = "above" if found.above > 0 else "below"
    return (
        f"at {date} images {found.strip} show a surface {abs(found.above):.2f} m {way} that of the "
        "others there. Tie points on water, traffic or leaves move while they are photographed: "
        "mask them, and match again."
    )


def patch_some(moved: float, date: str, radius: float) -> str:
    """Some points alone lie higher at one date; moved, m: the typical one. radius, m."""
    return (
        f"some of its tie points lie higher at {date}, the typical one moved by {moved:+.3f} m. "
        "Vehicles, material or plants stood there. If the ground itself rose on a place narrower "
        f"than {radius:.2g} m, compare again with a smaller --radius."
    )


def lower(surface) -> str:
    """The level of detection of a surface, what makes it, and what would lower it."""
    middle, floor = (1000 * float(np.median(v)) for v in (surface.detection, surface.floor))
    said = f"Half of the surface shows a change of {middle:.0f} mm (95 %)"
    if floor > 0.8 * middle:
        return (
            f"{said}, as far as the measurements allow: more control or marks that stand still, or "
            "both dates in one adjustment (--together), would lower it."
        )
    more = np.hypot(surface.sigma, 0.5 * surface.sampling) * surface.detection / surface.total
    return (
        f"{said}; the measurements alone would show {floor:.0f} mm, the rest is rough ground "
        f"between {np.median(surface.count):.0f} tie points in a cylinder of "
        f"{surface.cores.radius:.1f} m. Four times as many tie points (or a lower flight) would "
        f"show {1000 * np.median(more):.0f} mm, photographs of both dates matched with each other "
        f"(--same-ties) {floor:.0f} mm."
    )


def _way(shift: np.ndarray, sigma: np.ndarray) -> str:
    """How a point moved: by its height, or horizontally, whichever is the more significant."""
    flat = float(np.hypot(*shift[:2]))
    flat_sigma = float(np.sqrt(shift[:2] ** 2 @ sigma[:2] ** 2) / max(flat, 1e-12))
    if abs(shift[2]) / sigma[2] >= flat / flat_sigma:
        way = "sank" if shift[2] < 0 else "rose"
        return f"{way} by {millimetres(abs(shift[2]), sigma[2])}"
    towards = np.degrees(np.arctan2(shift[0], shift[1])) % 360
    return (
        f"moved by {millimetres(flat, flat_sigma)} horizontally (towards {towards:.0f} degrees "
        "from the y axis)"
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


def _alone(found) -> str:
    """That points moved each by itself, the most significant one first; found: a `Compared`."""
    points, names = found.points, [str(n) for n in found.points.names[found.points.alone]]
    size = np.where(points.alone, np.sum((points.shift / points.sigma) ** 2, axis=1), -1.0)
    first = int(np.argmax(size))
    others = f" ({len(names)} points each their own way: {some(names, 6)})" * (len(names) > 1)
    return (
        f"Ground and mark cannot be told apart: point {points.names[first]} "
        f"{_way(points.shift[first], points.sigma[first])}{_where(found, first)}, and neither "
        f"another point nor the surface says the same{others}. The ground moved there, or the mark "
        "was moved, exchanged or measured in another place."
    )


def _where(found, k: int) -> str:
    """Where along the corridor a point is, by its number; nothing is known without a surface."""
    if found.surface is None:
        return ""
    station, across = found.surface.cores.along(found.points.xyz[k : k + 1])
    return f" at station {station[0]:.0f} m, {_aside(across[0])}"


def _size(found) -> str:
    """The largest of a change that is not said to be one of the ground; found: a `Compared`."""
    if found.patches:
        one = max(found.patches, key=lambda p: abs(p.change / p.sigma))
        return f" (a patch by {millimetres(one.change, one.sigma)})"
    return f" ({_doubted(found.points)})" if found.doubted else ""


def _doubted(points) -> str:
    """The most significant of the points that an effect could have moved."""
    size = np.sum((points.shift / points.sigma) ** 2, axis=1)
    k = int(np.argmax(np.where(points.undecided, size, -1.0)))
    return f"point {points.names[k]} {_way(points.shift[k], points.sigma[k]).partition(' (')[0]}"


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
