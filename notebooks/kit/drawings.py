"""Pictures that only the chapters need, in the package's style."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import LogLocator, NullLocator

from corridor.core.block import Block
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.output import counted
from corridor.interface.figures import maps, style


def flight_directions(cases: Mapping[str, Block], title: str, note: str = "") -> Figure:
    """Strips of each case as arrows in the sense of flight, flights by colour and line."""
    flights = list(dict.fromkeys(n for block in cases.values() for n in block.flight_names))
    # Flights that lie on each other show all the same: each is thinner than the one below it.
    looks = {
        name: {
            "color": style.SERIES[k % 4][0],
            "ls": ("-", "--", "-.", ":")[k % 4],
            "lw": max(1.0, 2.2 - 0.6 * k),
        }
        for k, name in enumerate(flights)
    }
    keys = [style.key(name, **look) for name, look in looks.items()]
    first = next(iter(cases.values()))
    frame = maps.frame_of(first)
    columns = 2 if len(cases) > 3 else 1
    wide = 0.85 * style.WIDTH / columns
    spans = [np.ptp(frame.place(block.poses[:, :2]), axis=0) for block in cases.values()]
    heights = [0.8 + np.clip(1.4 * wide * y / x, 0.5, 2.6) for x, y in spans][::columns]
    figure, panels = style.charts(title, note, heights, columns, head=1.15)
    keys += [
        style.key(f"{role} point", **style.dot(marker, fill, 6.5, style.INK))
        for role, marker, fill in maps.GROUND
        if any(_shown(block)["role"].eq(role).any() for block in cases.values())
    ]
    style.legend(figure, 0.87, keys)
    for axes, (name, block) in zip(panels.flat, cases.items(), strict=True):
        style.caption(axes, name)
        x_name, y_name = frame.labels
        at_left, below = axes in panels[:, 0], axes in panels[-1]
        style.label(axes, x_name if below else None, y_name if at_left else None)
        images = block.images
        for (flight, _), strip in images.groupby(["flight", "strip"], sort=False, observed=True):
            track = frame.place(strip.sort_values("time_s")[["x", "y"]].to_numpy(float))
            axes.plot(*track.T, **looks[flight])
            # In the middle of the strip, along it there: a strip may bend, and its images shake.
            middle, near = len(track) // 2, max(len(track) // 6, 1)
            along = track[min(middle + near, len(track) - 1)] - track[middle - near]
            along *= 0.03 * np.linalg.norm(np.ptp(track, axis=0)) / np.linalg.norm(along)
            axes.annotate(
                "", track[middle] + along, track[middle],
                arrowprops={
                    "arrowstyle": "-|>", "color": looks[flight]["color"], "lw": 1,
                    "mutation_scale": 16,
                },
                zorder=7,
            )  # fmt: skip
        axes.set_aspect("equal", adjustable="datalim")
        surveyed = block.copy()
        surveyed.ground = _shown(block)
        maps.draw_ground(axes, frame, surveyed, names=False)
    return figure


def _shown(block):
    """Ground points, but for thousands of check points from tie points, which hide the strips."""
    many = len(block.ground) > maps.DOTS_FROM
    return block.ground[block.ground["role"] == "control"] if many else block.ground


def multiplicity(blocks: Mapping[str, Block], title: str) -> Figure:
    """Share of the tie points that so many images see: bars of the first block, lines of others."""
    first, *others = blocks
    looks = {
        name: {"color": colour, "marker": marker, "ls": ("-", "--", "-.")[k % 3], "lw": 1.2}
        for k, (name, (colour, marker)) in enumerate(zip(others, style.SERIES, strict=False))
    }
    keys = [Patch(label=first, color=style.FAINT)]
    keys += [style.key(name, ms=4, **look) for name, look in looks.items()]
    figure, ((axes,),) = style.charts(title, "how many images see a tie point", [3.0], 1, keys)
    for name, block in blocks.items():
        rays = block.tie_points.groupby("point", observed=True).size()
        share = 100 * rays.value_counts(normalize=True).sort_index()
        if name == first:
            axes.bar(share.index, share.to_numpy(), color=style.FAINT)
        else:
            axes.plot(share.index, share.to_numpy(), ms=3, **looks[name])
    style.label(axes, "images", "tie points (%)")
    axes.set_ylim(bottom=0)
    return figure


def pictures(shown: Mapping[str, np.ndarray], title: str) -> Figure:
    """Grey pictures side by side, each from its darkest to its lightest 0.5 per cent."""
    figure, (row,) = style.charts(title, "", [3.6], len(shown))
    for axes, (words, picture) in zip(row, shown.items(), strict=True):
        low, high = np.percentile(picture, (0.5, 99.5))
        axes.imshow(picture, cmap="gray", vmin=low, vmax=high)
        axes.set(xticks=[], yticks=[])
        style.caption(axes, f"{words}: {low:.0f} to {high:.0f} grey levels")
    return figure


def ring(block: Block, title: str) -> Figure:
    """Cameras around an object from above, with the way they look, points and targets."""
    figure, ((axes,),) = style.charts(
        title, "from above; ticks: the way a camera looks; triangles: targets", [4.6], width=6.2
    )
    points, marked = (t[["x", "y"]].to_numpy(float) for t in (block.points, block.ground))
    axes.plot(*points.T, ls="", marker=".", ms=1, color=style.FAINT)
    axes.plot(*marked.T, **style.dot("^", style.LIGHT, 6, style.INK))
    centre = block.images[["x", "y"]].to_numpy(float)
    rotation = rotation_from_quaternion(block.images[["qw", "qx", "qy", "qz"]].to_numpy(float))
    ahead = 0.9 * rotation[:, 2, :2]
    for start, way in zip(centre, ahead, strict=True):
        axes.plot(*np.array([start, start + way]).T, color=style.DARK, lw=1)
    axes.plot(*centre.T, **style.dot("o", style.DARK, 4))
    axes.set_aspect("equal")
    style.label(axes, "x (m)", "y (m)")
    return figure


def ground_residuals(cases: Mapping[str, tuple[Block, np.ndarray]], title: str) -> Figure:
    """Length of the residual at each ground point, mm, over its place along the block.

    cases: words -> block, residuals (points,) mm in the order of its ground points.
    """
    keys = [
        style.key(f"{words}: mean {np.mean(values):.1f} mm", **style.dot(marker, colour, 5))
        for (words, (_, values)), (colour, marker) in zip(cases.items(), style.SERIES, strict=False)
    ]
    figure, ((axes,),) = style.charts(title, "each ground point", [2.8], 1, keys)
    for (block, values), (colour, marker) in zip(cases.values(), style.SERIES, strict=False):
        frame = maps.frame_of(block)
        along = frame.place(block.ground[["x", "y"]].to_numpy(float))[:, 0]
        axes.vlines(along, 0, values, color=colour, lw=0.8, alpha=0.6)
        axes.plot(along, values, **style.dot(marker, colour, 5))
    axes.set_ylim(bottom=0)
    style.label(axes, "along the block (m)", "residual (mm)")
    return figure


def readout_scheme(readout_ms: float, exposure_ms: float) -> Figure:
    """When each row is exposed, and what that does to an upright bar that moves across.

    Left: a shutter that opens all rows at once; right: one that opens them in turn.
    """
    figure, ((left, right),) = style.charts(
        "each row is exposed for as long, but later than the one above it",
        f"{readout_ms:g} ms from the first row to the last, {exposure_ms:g} ms of exposure; "
        "in the frame: a bar that was upright",
        [3.2],
        2,
    )
    rows = np.linspace(0, 1, 15)
    for axes, late, words in (
        (left, 0.0, "all rows at once (global shutter)"),
        (right, readout_ms, "row after row (rolling shutter)"),
    ):
        style.caption(axes, words)
        for row in rows:
            axes.plot(
                [late * row, late * row + exposure_ms], [row, row], color=style.DARK, lw=3,
                solid_capstyle="butt",
            )  # fmt: skip
        axes.plot(late * rows + exposure_ms / 2, rows, color=style.LIGHT, lw=1.4)
        # The picture itself, as small as a stamp.
        frame = axes.inset_axes([0.76, 0.05, 0.22, 0.42])
        frame.set(xlim=(0, 1), ylim=(1, 0), xticks=[], yticks=[])
        frame.plot(0.3 + 0.4 * rows * (late > 0) + 0.2 * (late == 0), rows, color=style.INK, lw=4)
        axes.set(xlim=(-0.05 * readout_ms, 1.6 * readout_ms), ylim=(1.08, -0.08), yticks=[0, 1])
        axes.set_yticklabels(["first", "last"])
        style.label(axes, "time (ms)", "row")
    return figure


def beside_published(
    groups: Sequence[str],
    panels: Mapping[str, Mapping[str, np.ndarray]],
    title: str,
    note: str,
    unit: str,
    columns: int = 1,
) -> Figure:
    """A marker a number, a group a configuration, a panel for each case, on a logarithmic scale.

    panels: title -> name -> (groups,) numbers, or (draws, groups): their median, with a line from
    the lowest to the highest. NaN: nothing is drawn. All panels have one scale.
    """
    names = list(dict.fromkeys(name for one in panels.values() for name in one))
    marks = (("_", style.INK, 14), ("o", style.DARK, 5), ("^", style.LIGHT, 5.5),
             ("s", style.MIDDLE, 4.5), ("D", "white", 4.5))  # fmt: skip
    looks = {
        name: style.dot(shape, colour, size, style.INK, 1.8 if shape == "_" else 0.7)
        for name, (shape, colour, size) in zip(names, marks, strict=False)
    }
    keys = [style.key(name, **look) for name, look in looks.items()]
    lines = -(-len(panels) // columns)
    figure, grid = style.charts(title, note, [2.3] * lines, columns, keys)
    every = [np.asarray(v, float).ravel() for one in panels.values() for v in one.values()]
    low, high = np.nanmin(np.concatenate(every)), np.nanmax(np.concatenate(every))
    for axes, (words, one) in zip(grid.ravel(), panels.items(), strict=False):
        style.caption(axes, words)
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
        present = [name for name in names if name in one]
        for k, name in enumerate(present):
            values = np.atleast_2d(np.asarray(one[name], float))
            x = np.arange(len(groups)) + (k - (len(present) - 1) / 2) * 0.8 / len(present)
            if len(values) > 1:
                colour = looks[name]["mfc"] if "mfc" in looks[name] else style.INK
                axes.vlines(x, values.min(axis=0), values.max(axis=0), color=colour, lw=1.6)
            axes.plot(x, np.median(values, axis=0), **looks[name])
        axes.set_xticks(range(len(groups)), groups, size=style.SMALL)
        axes.set(ylim=(0.8 * low, 1.25 * high), xlim=(-0.5, len(groups) - 0.5))
        style.label(axes, None, unit)
    return figure


def likelihoods(curves: Mapping[str, Sequence], title: str, note: str) -> Figure:
    """Log likelihood over the amount of each cause, a panel a unit; the level of 95 % from the top.

    curves: unit -> judged causes (`kit.viabon.Judged`).
    """
    figure, (row,) = style.charts(title, note, [2.8], len(curves))
    top = max(one.likelihood.max() for several in curves.values() for one in several)
    for axes, (unit, several) in zip(row, curves.items(), strict=True):
        keys = []
        for k, one in enumerate(several):
            look = {"color": style.SERIES[k % 4][0], "ls": ("-", "--", "-.", ":")[k % 4], "lw": 1.6}
            axes.plot(one.amounts, one.likelihood, **look)
            keys.append(style.key(one.cause, **look))
        axes.axhline(top, color=style.FAINT, lw=0.8, zorder=0)
        axes.set(ylim=(top - 14, top + 1.5), xlim=(0, None))
        style.own_legend(axes, keys)
        first = axes is row[0]
        style.label(axes, unit, "log likelihood" if first else None)
    return figure


def rates(rows: Sequence[tuple[str, int, int, float, float]], title: str, note: str) -> Figure:
    """Shares with their 95 % intervals, one below the other.

    rows: words, how many, of how many, and the lower and upper end of the interval (shares).
    """
    figure, ((axes,),) = style.charts(title, note, [0.34 * len(rows) + 0.5])
    for k, (_, hits, count, low, high) in enumerate(rows):
        axes.plot([100 * low, 100 * high], [k, k], color=style.DARK, lw=2)
        axes.plot(100 * hits / count, k, **style.dot("o", style.DARK, 7))
        axes.text(103, k, f"{hits} of {count}", size=style.TEXT, va="center")
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.set(xlim=(-2, 115), ylim=(len(rows) - 0.5, -0.5), xticks=[0, 25, 50, 75, 100])
    style.label(axes, "share (%), bar: 95 % interval")
    return figure


def rate_of(text: str) -> tuple[int, int, float, float]:
    """Hits, count and the ends of the interval of `90.5 % (19 of 21; 71.1 to 97.3)`, as shares."""
    _, hits, count, low, high = (float(x) for x in re.findall(r"[0-9.]+", text))
    return int(hits), int(count), low / 100, high / 100


def intervals(
    values: Mapping[str, tuple[float, float]],
    known: tuple[float, float],
    unit: str,
    title: str,
    note: str,
) -> Figure:
    """Values with their sigmas, one below the other, beside a band in which they should lie."""
    figure, ((axes,),) = style.charts(title, note, [0.4 * len(values) + 0.5])
    axes.axvspan(*known, color=style.FAINT, zorder=0)
    for k, (value, sigma) in enumerate(values.values()):
        axes.plot([value - sigma, value + sigma], [k, k], color=style.DARK, lw=2)
        axes.plot(value, k, **style.dot("o", style.DARK, 6))
    axes.set_yticks(range(len(values)), list(values))
    axes.set_ylim(len(values) - 0.5, -0.5)
    style.label(axes, unit)
    return figure


def speeds_and_readout(
    block: Block,
    slow: np.ndarray,
    readouts: Mapping[str, tuple[float, float]],
    known_ms: float,
    title: str,
) -> Figure:
    """Speed of every photograph, the slow ones marked, and the readout with and without them."""
    figure, ((left, right),) = style.charts(
        title, "left: hollow squares are slow photographs; right: dashed is the published readout",
        [2.8], 2,
    )  # fmt: skip
    time = block.column("images", "time_s")
    speed = np.linalg.norm(block.images[["vx", "vy", "vz"]].to_numpy(float), axis=1)
    left.plot(time[~slow] - time.min(), speed[~slow], **style.dot("o", style.DARK, 4))
    left.plot(time[slow] - time.min(), speed[slow], **style.dot("s", "white", 6, style.INK, 1.4))
    style.label(left, "time (s)", "speed (m/s)")
    for k, (value, sigma) in enumerate(readouts.values()):
        right.plot([k, k], [value - sigma, value + sigma], color=style.DARK, lw=2)
        right.plot(k, value, **style.dot("o", style.DARK, 6))
    right.axhline(known_ms, color=style.INK, ls="--", lw=1)
    right.set_xticks(range(len(readouts)), list(readouts))
    right.set(xlim=(-0.6, len(readouts) - 0.4), ylim=(0, None))
    style.label(right, None, "readout (ms)")
    return figure


def confusion_matrix(
    hidden: Sequence[str],
    answers: Sequence[str],
    counts: Sequence[Sequence[int]],
    title: str = "What was hidden, and what was said",
) -> Figure:
    """A row for each hidden effect, a column for each answer, the number of blocks in the cell.

    counts: (hidden, answers). Cells are shaded by the share of their row; right names are framed.
    """
    table = np.asarray(counts, dtype=int).reshape(len(hidden), len(answers))
    if not table.size:
        return style.sentence("No block with one effect or none.", title)
    blocks = counted(int(table.sum()), "block")
    note = f"{blocks}; shade: share of the row; framed: the right name"
    names = [str(name).replace("_", " ") for name in hidden]
    said = [str(name).replace("_", " ") for name in answers]
    figure, axes = style.matrix(title, note, names, said, 0.27, above=True)
    total = np.maximum(table.sum(axis=1, keepdims=True), 1)
    axes.imshow(table / total, cmap=style.COUNTS, vmin=0, vmax=1, aspect="auto")
    for i, j in np.argwhere(table > 0):
        colour = "white" if table[i, j] > 0.55 * total[i, 0] else style.INK
        look = {"color": colour, "size": style.SMALL, "ha": "center", "va": "center"}
        axes.text(j, i, str(table[i, j]), **look)
    for i, name in enumerate(hidden):
        for j, answer in enumerate(answers):
            if name == answer:
                look = {"fill": False, "ec": style.INK, "lw": 1.2, "zorder": 5}
                axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, **look))
    return figure


def expected_and_drawn(
    expected: Mapping[str, Sequence[float]],
    drawn: Mapping[str, np.ndarray],
    title: str,
    note: str,
) -> Figure:
    """RMS of check points in x, y and z, cm: expected, and of each draw; a row a way of flying.

    expected: (3,); drawn: (draws, 3), of the same names.
    """
    looks = {
        "expected": style.dot("|", style.MIDDLE, 16, style.MIDDLE, 2.4),
        "a draw": style.dot("o", "white", 4, style.DARK, 0.9),
    }
    keys = [style.key(name, **look) for name, look in looks.items()]
    height = 0.34 * len(expected) + 0.7
    figure, (row,) = style.charts(title, note, [height], 3, keys, sharex=True, sharey=True)
    for k, (axes, words) in enumerate(zip(row, ("across", "along", "height"), strict=True)):
        style.caption(axes, words)
        for n, (name, values) in enumerate(expected.items()):
            axes.plot(drawn[name][:, k], np.full(len(drawn[name]), n), **looks["a draw"])
            axes.plot(values[k], n, **looks["expected"])
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_yticks(range(len(expected)), list(expected))
        axes.set_ylim(len(expected) - 0.5, -0.5)
        style.label(axes, "RMS (cm)")
    return figure


def height_by_focal(
    cases: Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray]]],
    slope: float,
    title: str,
    note: str,
) -> Figure:
    """Height errors, cm, over errors of the focal length, px: a panel a case, a mark a flight.

    slope: of the line that a wrong focal length alone would follow, cm per px.
    """
    names = list(next(iter(cases.values())))
    looks = {
        name: style.dot(shape, "white", 5, colour, 1.2)
        for name, (colour, shape) in zip(names, style.SERIES, strict=False)
    }
    line = {"color": style.FAINT, "lw": 1.4}
    keys = [style.key(name, **look) for name, look in looks.items()]
    keys.append(style.key("focal length alone", **line))
    figure, (row,) = style.charts(title, note, [2.8], len(cases), keys)
    for axes, (words, one) in zip(row, cases.items(), strict=True):
        style.caption(axes, words)
        ends = 1.1 * np.array([-1, 1]) * max(np.abs(f).max() for f, _ in one.values())
        axes.plot(ends, slope * ends, zorder=0, **line)
        for name, (f, height) in one.items():
            axes.plot(f, height, **looks[name])
        style.label(axes, "focal length off (px)", "height off (cm)" if axes is row[0] else None)
    return figure
