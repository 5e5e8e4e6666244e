"""What was measured beside what the believed model produces, before and after an effect is added.

Grey is the band that holds the whole curve of 95 % of the simulated counterparts; a measured curve
inside it is drawn quietly, one that leaves it dark, with its values outside marked.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from corridor.core.output import short
from corridor.interface.figures import style

if TYPE_CHECKING:
    from corridor.diagnosis import Compared, Comparison

BAND_COLOUR = "#d9d9d9"
# Panels of the first picture, and maps: more are not read.
MOST_PANELS = 5
MOST_MAPS = 4
MOST_AXES = 12
# Deviations from which on a cell is as dark or as light as can be.
DARKEST_SIGMAS = 8.0
CHANCE_LEVEL = 0.05
# Columns of a map beyond which there is no room for numbers in its cells.
CROWDED_COLUMNS = 10
SIGNATURES = "signatures of the physical effects"
# What tells most of a block in which nothing leaves its band.
USUAL_STATISTICS = (
    SIGNATURES,
    "check-point error, RMS",
    "size of tie residuals by row",
    "outward tie residuals by time",
    "GNSS z by time",
    "control z by point",
    "outward tie residuals by place along the corridor",
    "size of held-out tie residuals",
)
# Inches.
HEIGHT, BETWEEN, LEFT, PER_ROW = 1.1, 0.24, 0.65, 4
# Letters of a name, and the inches that one takes upright.
LONGEST_NAME, INCHES_A_LETTER = 26, 0.05


def counterpart(
    before: Comparison,
    after: Comparison | None = None,
    names: Sequence[str] | None = None,
    what: str = "",
) -> Figure:
    """Measured beside simulated, a small panel a statistic; below each other before and after.

    names: statistics to show; default: those that leave the band farthest before, then those that
    tell most of the block, five together. Curves only: `counterpart_maps` draws the maps.
    what: words of the title; default: what the picture says.
    """
    chosen = _chosen(before, names)
    title = f"{short(before.name, 40)}: {what or _message(before, after)}"
    if not chosen:
        return style.sentence("No statistic could be formed.", title)
    cases = [("before", before)] + ([("after", after)] if after is not None else [])
    wide = [name for name in chosen if name == SIGNATURES]
    small = [name for name in chosen if name != SIGNATURES]
    places, top = _places(before, wide, small, len(cases))
    figure = style.sheet(top, title, _note(before, after))
    for name, (left, upper, width) in places.items():
        found = [(word, _find(case, name)) for word, case in cases]
        statistic = found[0][1].statistic
        limits = _limits([one for _, one in found if one is not None])
        factor, unit = _unit(statistic.unit, limits)
        names = tuple(dict.fromkeys(n for _, one in found if one for n in one.statistic.labels))
        _title(figure, left, upper, name)
        for k, (word, one) in enumerate(found):
            axes = style.panel(figure, left, upper + k * (HEIGHT + BETWEEN), width, HEIGHT)
            style.open_frame(axes)
            axes.set_ylim(factor * limits[0], factor * limits[1])
            last = k == len(found) - 1
            if one is not None:
                _curve(axes, one, factor, names)
            if names:
                shown = names
                if statistic.kind == "signature":
                    shown = tuple(one.replace("_", " ") for one in names)
                _names(axes, shown, name in wide)
            axes.tick_params(labelbottom=last)
            if last and not _crowded(names):
                axes.set_xlabel(statistic.axis, size=style.SMALL, color=style.INK, labelpad=2)
            axes.set_ylabel(unit, size=style.SMALL, color=style.INK, labelpad=2)
            if len(cases) > 1:
                _word(axes, word if one is not None else f"{word}: cannot be formed")
    style.legend(figure, 0.86, _keys())
    return figure


def _places(before, wide, small, cases) -> tuple[dict, float]:
    """Left, top and width of each statistic's panels, inches, and the height of the sheet."""
    stack = cases * HEIGHT + (cases - 1) * BETWEEN
    top, places = 1.45, {}
    for name in wide:
        places[name] = LEFT, top, style.WIDTH - LEFT - 0.2
        top += stack + 1.25 + 0.42
    width = (style.WIDTH - 0.2 - PER_ROW * LEFT) / PER_ROW
    for first in range(0, len(small), PER_ROW):
        row = small[first : first + PER_ROW]
        for column, name in enumerate(row):
            places[name] = LEFT + column * (width + LEFT), top, width
        every = (_find(before, name).statistic.labels for name in row)
        upright = [len(one) for names in every if _crowded(names) for one in names]
        below = 0.15 + INCHES_A_LETTER * min(max(upright), LONGEST_NAME) if upright else 0.0
        top += stack + max(below, 0.48) + 0.42
    return places, top - 0.3


def counterpart_axes(before: Comparison, after: Comparison | None = None) -> Figure:
    """Where the disagreement lies along time, temperature, row, flight, velocity, height, corridor.

    Of each axis, and of images, antenna, control and check points apart, the statistic that goes
    farthest from its counterparts, so that every axis is seen, whether it leaves its band or not.
    """
    best: dict[tuple[str, str], Compared] = {}
    for one in before.statistics:
        statistic = one.statistic
        if statistic.shape is not None or statistic.kind == "signature" or len(statistic) < 2:
            continue
        key = statistic.kind, statistic.axis
        if key not in best or _far(one) > _far(best[key]):
            best[key] = one
    chosen = sorted(best.values(), key=_far, reverse=True)[:MOST_AXES]
    names = [one.statistic.name for one in chosen]
    return counterpart(before, after, names, "where along each axis")


def _far(one: Compared) -> float:
    """Largest distance from the counterparts, in half widths of the band."""
    return float(np.abs(one.z).max(initial=0.0) / one.limit)


def counterpart_maps(before: Comparison, after: Comparison | None = None) -> Figure:
    """Where the disagreement lies: maps over the image and the ground, in deviations.

    Colour says by how many standard deviations of the counterparts the measured value is above or
    below them; a cell outside the band is framed. What poses and points absorb is in the band, so
    that structure is disagreement and an even cloud is noise.
    """
    title = f"{short(before.name, 40)}: where simulation and measurement disagree"
    chosen = _maps(before)
    if not chosen:
        return style.sentence("No statistic is a map.", title)
    cases = [("before", before)] + ([("after", after)] if after is not None else [])
    gap, width, height, above = 0.75, 1.5, 1.2, 1.62
    figure = style.sheet(above + len(cases) * (height + 0.62), title, _note(before, after))
    for k, (word, case) in enumerate(cases):
        top = above + k * (height + 0.55)
        for column, wanted in enumerate(chosen):
            left = LEFT + column * (width + gap)
            axes = style.panel(figure, left, top, width, height)
            if k == 0:
                _title(figure, left, top + 0.02 - 0.1 * (len(cases) > 1), wanted.statistic.name)
            one = _find(case, wanted.statistic.name)
            image = _map(axes, one)
            pixels = "image" in wanted.statistic.axis
            if k == len(cases) - 1:
                text = "x in the image (px)" if pixels else "along the corridor (m)"
                axes.set_xlabel(text, size=style.SMALL, color=style.INK, labelpad=2)
            text = "y (px)" if pixels else "across (m)"
            axes.set_ylabel(text, size=style.SMALL, color=style.INK, labelpad=1)
            if len(cases) > 1:
                _word(axes, word)
    style.shade_bar(figure, image, style.WIDTH - 0.72, above, height, "sigmas")
    keys = [
        Patch(fc="white", ec=style.INK, lw=1.2, label="outside the 95 % band, with its sigmas"),
        Patch(fc=style.LIGHT, hatch=style.HATCH, ec=style.INK, lw=0, label="measured below"),
        Patch(fc="#002a55", lw=0, label="above simulated"),
    ]
    style.legend(figure, 0.86, keys)
    return figure


# --- what is shown -------------------------------------------------------------------------------


def _chosen(before: Comparison, names: Sequence[str] | None) -> list[str]:
    if names is not None:
        return [name for name in names if _find(before, name) is not None]
    curves = [one for one in before.statistics if one.statistic.shape is None]
    leaving = sorted((one for one in curves if one.leaves), key=lambda one: -one.excess)
    # The signatures say at a glance what the rest is about: they stand first.
    out = [SIGNATURES] if _find(before, SIGNATURES) is not None else []
    out += [one.statistic.name for one in leaving if one.statistic.name != SIGNATURES]
    out = out[:MOST_PANELS]
    for name in [*USUAL_STATISTICS, *(one.statistic.name for one in curves)]:
        if len(out) >= min(MOST_PANELS, len(curves)):
            break
        if name not in out and _find(before, name) is not None:
            out.append(name)
    return out


def _maps(before: Comparison) -> list[Compared]:
    """The maps that tell most, each of another kind, one of the ground among them."""
    maps = [one for one in before.statistics if one.statistic.shape is not None]
    kinds: dict[tuple, Compared] = {}
    for one in sorted(maps, key=_far, reverse=True):
        # What grows with time, temperature or velocity shows the same picture again and again.
        name, grows, _ = one.statistic.name.partition(", growing with ")
        kinds.setdefault((name, bool(grows)), one)
    every = list(kinds.values())
    ground = [one for one in every if "image" not in one.statistic.axis][:1]
    rest = [one for one in every if one not in ground]
    return [*rest[: MOST_MAPS - len(ground)], *ground]


def _find(case: Comparison, name: str) -> Compared | None:
    return next((one for one in case.statistics if one.statistic.name == name), None)


def _note(before: Comparison, after: Comparison | None) -> str:
    text = f"{len(before.leaving)} of {len(before.statistics)} statistics leave the band"
    gap = f"gap {_number(before.gap)}"
    if after is None:
        return f"{text}, by chance {CHANCE_LEVEL * len(before.statistics):.0f} would \u00b7 {gap}"
    return (
        f"{text} before, {len(after.leaving)} of {len(after.statistics)} after, "
        f"{CHANCE_LEVEL * len(after.statistics):.0f} would by chance \u00b7 {gap} before, "
        f"{_number(after.gap)} after"
    )


def _message(before: Comparison, after: Comparison | None) -> str:
    """What a picture of curves says, for its title."""
    was = len(before.leaving)
    if after is None:
        return f"{was} statistics are not what the model would produce" if was else (
            "measured as the model would produce it"
        )  # fmt: skip
    return f"{was} statistics disagreed before, {len(after.leaving)} do after"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 10 else f"{value:.1f}"


def _keys() -> list:
    return [
        Patch(color=BAND_COLOUR, lw=0, label="band of 95 % of the simulated counterparts"),
        style.key("their mean", color=style.QUIET, lw=0.8, ls="--"),
        style.key("measured, inside", color=style.QUIET, marker="o", ms=2.5, lw=1.0),
        style.key("measured, leaves it", color=style.INK, marker="o", ms=2.5, lw=1.8),
        style.key("value outside", **style.dot("D", style.INK)),
    ]


def _title(figure: Figure, left: float, top: float, name: str) -> None:
    """Name of a panel in up to three lines above it, as wide as from one panel to the next."""
    lines = textwrap.wrap(name, 31, max_lines=3, placeholder=" ...")
    for n, line in enumerate(reversed(lines)):
        style.write(
            figure, left - 0.4, top - 0.17 - 0.14 * n, line, weight="bold", size=style.SMALL + 0.5
        )


def _word(axes: Axes, word: str) -> None:
    """Which of the two cases a panel shows, above its right corner."""
    look = {"ha": "right", "va": "bottom", "size": style.SMALL, "color": style.QUIET}
    axes.text(0.995, 1.0, word, transform=axes.transAxes, **look)


def _crowded(names: Sequence[str]) -> bool:
    return sum(len(str(name)) + 2 for name in names) > 34


# --- drawing -------------------------------------------------------------------------------------


def _limits(found: list[Compared]) -> tuple[float, float]:
    values = np.concatenate([np.concatenate([one.measured, one.low, one.high]) for one in found])
    low, high = float(values.min()), float(values.max())
    room = 0.12 * max(high - low, 1e-12 + 1e-6 * abs(high))
    return low - room, high + room


def _unit(unit: str, limits: tuple[float, float]) -> tuple[float, str]:
    most = max(abs(limits[0]), abs(limits[1]))
    if unit == "m" and most < 0.5:
        return 1e3, "mm"
    if unit == "s" and most < 0.5:
        return 1e3, "ms"
    if unit == "stated deviations":
        return 1.0, "sigmas"
    return 1.0, unit


def _curve(axes: Axes, one: Compared, factor: float, names: Sequence[str]) -> None:
    statistic = one.statistic
    named = bool(statistic.labels)
    # Names are in the order of the statistic; numbers in theirs.
    order = np.arange(len(one.measured)) if named else np.argsort(statistic.at)
    at = statistic.at[order]
    if named:
        # Before and after may lack one another's: a name keeps its place.
        at = np.array([names.index(name) for name in statistic.labels], dtype=float)
    low, high = factor * one.low[order], factor * one.high[order]
    middle, value = factor * one.middle[order], factor * one.measured[order]
    outside = one.outside[order]
    colour, weight = (style.INK, 1.8) if one.leaves else (style.QUIET, 1.0)
    if named:
        for x, a, b, m in zip(at, low, high, middle, strict=True):
            axes.fill_between([x - 0.36, x + 0.36], a, b, color=BAND_COLOUR, lw=0, zorder=1)
            axes.plot([x - 0.36, x + 0.36], [m, m], color=style.QUIET, lw=0.8, ls="--", zorder=2)
        axes.plot(at, value, ls="", marker="o", ms=2.8, color=colour, zorder=4)
    else:
        axes.fill_between(at, low, high, color=BAND_COLOUR, lw=0, zorder=1)
        axes.plot(at, middle, color=style.QUIET, lw=0.8, ls="--", zorder=2)
        axes.plot(at, value, color=colour, lw=weight, marker="o", ms=2.2, zorder=4)
    axes.plot(at[outside], value[outside], ls="", marker="D", ms=5, color=style.INK, zorder=5)


def _names(axes: Axes, names: Sequence[str], wide: bool) -> None:
    """Names under the values, upright where they would touch; every second one where too many."""
    axes.set_xlim(-0.6, len(names) - 0.4)
    step = -(-len(names) // (48 if wide else 16))
    at = np.arange(0, len(names), step)
    crowded = _crowded(names)
    axes.set_xticks(at)
    axes.set_xticklabels(
        [short(names[k], LONGEST_NAME) for k in at],
        rotation=(38 if wide else 90) if crowded else 0,
        ha="right" if crowded and wide else "center",
        rotation_mode="anchor" if crowded and wide else "default",
        size=style.SMALL - (1.0 if crowded else 0),
        parse_math=False,
    )


def _map(axes: Axes, one: Compared | None):
    shades = {"cmap": style.SIGNED, "vmin": -DARKEST_SIGMAS, "vmax": DARKEST_SIGMAS}
    if one is None:
        axes.set_axis_off()
        return axes.imshow(np.zeros((1, 1)), **shades)
    statistic = one.statistic
    columns, rows = statistic.shape
    grid = np.full(rows * columns, np.nan)
    grid[statistic.cells] = one.z
    at = statistic.at
    step = _steps(at, statistic.cells, columns)
    first = at[0] - np.array([statistic.cells[0] % columns, statistic.cells[0] // columns]) * step
    x = first[0] + step[0] * (np.arange(columns + 1) - 0.5)
    y = first[1] + step[1] * (np.arange(rows + 1) - 0.5)
    image = axes.pcolormesh(x, y, grid.reshape(rows, columns), **shades)
    style.hatch_below(axes, style.cells_of(x, y), np.nan_to_num(grid))
    for cell, out in zip(statistic.cells, one.outside, strict=True):
        if out:
            i, j = cell % columns, cell // columns
            around = x[i + np.array([0, 1, 1, 0, 0])], y[j + np.array([0, 0, 1, 1, 0])]
            axes.plot(*around, color=style.INK, lw=1.3, zorder=5)
            if columns > CROWDED_COLUMNS:
                continue
            z, middle = grid[cell], (x[i : i + 2].mean(), y[j : j + 2].mean())
            look = {"size": style.SMALL - 1.5, "color": "white" if z > 5 else style.INK}
            axes.text(*middle, f"{z:+.0f}", ha="center", va="center", **look)
    if "image" in statistic.axis:
        # Pixels count downwards.
        axes.invert_yaxis()
    return image


def _steps(at: np.ndarray, cells: np.ndarray, columns: int) -> np.ndarray:
    """Size of a cell along both axes, from the middles of those that have values."""
    out = np.ones(2)
    for k, number in enumerate((cells % columns, cells // columns)):
        far = int(np.argmax(number)), int(np.argmin(number))
        if number[far[0]] > number[far[1]]:
            out[k] = (at[far[0], k] - at[far[1], k]) / (number[far[0]] - number[far[1]])
    return out
