"""One look for every picture of the package.

Charts stand in a grid that matplotlib lays out; maps, whose scale is stated, in inches from the
top left corner. All are drawn without pyplot, so that they are the same in a notebook, in a thread
and on a machine without a display, whatever style the reader has set.

Colours: P. Tol's "high-contrast" scheme, told apart by readers with any colour vision and,
because its lightness is graded, in grey print. A marker or a line style always says the same.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from corridor.core.output import png, printable, short

INK = "#222222"
QUIET = "#6f6f6f"
FAINT = "#c4c4c4"
DARK = "#004488"
MIDDLE = "#bb5566"
LIGHT = "#ddaa33"
SERIES = ((DARK, "o"), (LIGHT, "^"), (MIDDLE, "s"), (INK, "D"))
COUNTS = LinearSegmentedColormap.from_list("corridor_counts", ["#ffffff", "#9fb8d1", "#00305f"])
SIGNED = LinearSegmentedColormap.from_list(
    "corridor_signed", [LIGHT, "#f4e6bd", "#ffffff", "#a3b9d2", "#002a55"]
)
SHADES = LinearSegmentedColormap.from_list("corridor_shades", ["#ffffff", "#d3d3d3"])

TITLE, TEXT, SMALL = 11.0, 8.5, 7.5
WIDTH = 10.0


class Picture(Figure):
    """A matplotlib figure that shows itself in a notebook without pyplot."""

    def _repr_png_(self) -> bytes:
        return png(self, dpi=96)


def sheet(height: float, title: str, note: str = "", width: float = WIDTH) -> Picture:
    """An empty sheet, inches, with its title and one quiet line under it (0.75 inch together)."""
    figure = Picture(figsize=(width, height), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    write(figure, 0.25, 0.33, short(title, int((width - 0.5) / 0.105)), size=TITLE, weight="bold")
    if note:
        write(figure, 0.25, 0.56, note, size=TEXT, colour=QUIET)
    return figure


def write(
    figure: Figure,
    left: float,
    top: float,
    text: str,
    size: float = TEXT,
    colour: str = INK,
    weight: str = "normal",
    align: str = "left",
) -> None:
    """Text on the sheet with its baseline at (left, top) inches from the top left corner."""
    width, height = figure.get_size_inches()
    look = {"size": size, "color": colour, "weight": weight, "ha": align, "va": "baseline"}
    figure.text(left / width, 1 - top / height, text, **look, parse_math=False)


def charts(
    title: str,
    note: str,
    heights: Sequence[float],
    columns: int = 1,
    keys: Sequence = (),
    width: float = WIDTH,
    head: float | None = None,
    **options,
) -> tuple[Picture, np.ndarray]:
    """A sheet with a grid of open frames (rows, columns) below its title and keys.

    heights: of the rows, inches, with their numbers and names. head: room above them, by default
    what title and keys need. options: of `Figure.subplots`.
    """
    head = head or (1.15 if keys else 0.8)
    total = head + sum(heights)
    figure = sheet(total, title, note, width)
    legend(figure, 0.87, keys)
    figure.set_layout_engine(
        "constrained", rect=(0.01, 0, 0.98, 1 - head / total), h_pad=0.08, w_pad=0.1
    )
    panels = figure.subplots(
        len(heights), columns, squeeze=False, height_ratios=list(heights), **options
    )
    for (row, _), axes in np.ndenumerate(panels):
        _dress(axes, 0.75 * width / columns, 0.75 * heights[row])
        open_frame(axes)
    return figure, panels


def matrix(
    title: str,
    note: str,
    rows: Sequence[str],
    columns: Sequence[str],
    cell: float,
    keys: Sequence = (),
    above: bool = False,
) -> tuple[Picture, Axes]:
    """A sheet with square cells of `cell` inches, the names of rows and columns beside them.

    above: the names of the columns stand above the cells, else below.
    """
    left, names = (0.35 + 0.06 * max(map(len, words)) for words in (rows, columns))
    top = (1.2 if keys else 0.9) + (names - 0.2 if above else 0.0)
    wide, high = cell * len(columns), cell * len(rows)
    total = top + high + (0.35 if above else names)
    figure = sheet(total, title, note, width=max(left + wide + 0.35, 6.2))
    legend(figure, 0.87, keys)
    axes = panel(figure, left, top, wide, high)
    if above:
        axes.xaxis.tick_top()
    axes.set_xticks(range(len(columns)), columns, rotation=90, size=SMALL, parse_math=False)
    axes.set_yticks(range(len(rows)), rows, size=SMALL, parse_math=False)
    axes.tick_params(length=0)
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5))
    look = {"color": "#ebebeb", "lw": 0.5, "zorder": 0.5}
    axes.vlines(np.arange(0.5, len(columns) - 1), -0.5, len(rows) - 0.5, **look)
    axes.hlines(np.arange(0.5, len(rows) - 1), -0.5, len(columns) - 0.5, **look)
    return figure, axes


def panel(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Axes with their upper left corner at (left, top) inches from the top left corner."""
    across, high = figure.get_size_inches()
    box = left / across, 1 - (top + height) / high, width / across, height / high
    axes = figure.add_axes(box)
    _dress(axes, width, height)
    return axes


def _dress(axes: Axes, width: float, height: float) -> None:
    """Spines, ticks and numbers of a panel of so many inches."""
    axes.set_facecolor("white")
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(color=QUIET, linewidth=0.6)
    axes.tick_params(
        which="both", labelsize=SMALL, colors=INK, color=QUIET, length=3, width=0.6, direction="out"
    )
    axes.xaxis.set_major_locator(MaxNLocator(max(2, int(width / 0.75)), steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(max(2, int(height / 0.4)), steps=[1, 2, 5, 10]))


def dot(shape: str, fill: str, size: float = 5.0, edge: str | None = None, line: float = 0.9):
    """Look of a marker without a line, for `plot` and for `key`."""
    edge = fill if edge is None else edge
    return {"ls": "", "marker": shape, "ms": size, "mfc": fill, "mec": edge, "mew": line}


def key(text: str, **look) -> Line2D:
    """What a look means, for a legend."""
    return Line2D([], [], label=text, **look)


def quiet(axes: Axes, text: str) -> None:
    """A sentence in the middle of a panel that has nothing to show."""
    axes.text(
        0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", size=TEXT, color=QUIET
    )


def caption(axes: Axes, text: str) -> None:
    """Name of one panel, above its upper left corner."""
    axes.set_title(
        text, loc="left", y=1.0, size=TEXT, color=INK, weight="bold", pad=5, parse_math=False
    )


def label(axes: Axes, x: str | None = None, y: str | None = None) -> None:
    """Names of the axes, with their units."""
    if x is not None:
        axes.set_xlabel(x, size=TEXT, color=INK, labelpad=3)
    if y is not None:
        axes.set_ylabel(y, size=TEXT, color=INK, labelpad=4)


def in_pixels(axes: Axes, picture, room: float = 0.0, outlined: bool = False) -> None:
    """Axes over a picture (width, height), from edge to edge and a share of it more on each side.

    outlined: with a line around the picture.
    """
    wide, high = picture.width, picture.height
    axes.set(
        xlim=(-0.5 - room * wide, wide - 0.5 + room * wide),
        ylim=(high - 0.5 + room * high, -0.5 - room * high),
    )
    label(axes, "x (px)", "y (px)")
    if outlined:
        axes.add_patch(Rectangle((-0.5, -0.5), wide, high, fill=False, ec=QUIET, lw=0.6))


def open_frame(axes: Axes) -> None:
    """Only the left and lower edge of a panel: for curves and bars, not for maps."""
    axes.spines["top"].set_visible(False)
    axes.spines["right"].set_visible(False)


def legend(figure: Figure, top: float, handles: Sequence, left: float = 0.25) -> None:
    """One row of keys, its middle `top` inches below the upper edge."""
    if not handles:
        return
    width, height = figure.get_size_inches()
    place = {"loc": "center left", "bbox_to_anchor": (left / width, 1 - top / height)}
    room = {"borderpad": 0, "borderaxespad": 0, "columnspacing": 1.6, "handletextpad": 0.5}
    _one_row(figure, handles, **place, **room)


def own_legend(axes: Axes, handles: Sequence) -> None:
    """Keys of one panel, in one row above its right corner."""
    room = {"borderaxespad": 0.2, "handletextpad": 0.3}
    _one_row(axes, handles, loc="lower right", bbox_to_anchor=(1, 1), **room)


def _one_row(owner: Figure | Axes, handles: Sequence, **place) -> None:
    look = {"ncols": len(handles), "frameon": False, "fontsize": TEXT, "labelcolor": INK}
    for text in owner.legend(handles=list(handles), **look, **place).get_texts():
        text.set_parse_math(False)


def shade_bar(
    figure: Figure, image, left: float, top: float, height: float, text: str, whole: bool = False
) -> None:
    """Slim upright key of a shaded panel; whole: with whole numbers."""
    axes = panel(figure, left, top, 0.1, height)
    figure.colorbar(image, cax=axes)
    axes.yaxis.set_major_locator(MaxNLocator(max(2, int(height / 0.5)), integer=whole))
    axes.tick_params(labelsize=SMALL, colors=INK, color=QUIET, length=2, width=0.6)
    for spine in axes.spines.values():
        spine.set(color=QUIET, linewidth=0.6)
    label(axes, y=text)


HATCH = "////"


def hatch_below(axes: Axes, corners: np.ndarray, values: np.ndarray) -> None:
    """Hatches the cells of a signed map that lie below zero, so that grey print shows the sign.

    corners: (n, 4, 2) data coordinates; values: (n,).
    """
    # Thin lines: the shade stays readable below them.
    with rc_context({"hatch.linewidth": 0.5}):
        below = PolyCollection(corners[values < 0], facecolor="none", edgecolor=INK, lw=0)
        below.set(hatch=HATCH, zorder=3)
        axes.add_collection(below)


def cells_of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(rows x columns, 4, 2) corners of the cells between edges along x and along y, row by row."""
    left, low = (edges.ravel() for edges in np.meshgrid(x[:-1], y[:-1]))
    right, high = (edges.ravel() for edges in np.meshgrid(x[1:], y[1:]))
    around = [(left, low), (right, low), (right, high), (left, high)]
    return np.stack([np.column_stack(corner) for corner in around], axis=1)


def sentence(text: str, title: str) -> Picture:
    """A small picture that says why there is nothing to draw."""
    figure = sheet(1.1, title)
    write(figure, 0.25, 0.72, text, colour=QUIET)
    return figure


def name_points(axes: Axes, xy: np.ndarray, names: Sequence[str], keep_clear=None) -> None:
    """Writes names beside points (n, 2); a name that finds no free place is left out.

    keep_clear: (m, 2) data coordinates of further places no name may cover.
    """
    renderer = axes.figure.canvas.get_renderer()
    inside = axes.get_window_extent(renderer)
    taken: list = []
    xy = np.asarray(xy, dtype=float).reshape(-1, 2)
    closed = marks = axes.transData.transform(xy)
    if keep_clear is not None and len(keep_clear):
        closed = np.vstack([marks, axes.transData.transform(np.asarray(keep_clear, dtype=float))])
    for point, mark, name in zip(xy, marks, names, strict=True):
        others = closed[np.hypot(*(closed - mark).T) > 1e-6]
        for dx, dy in _PLACES:
            beside = ("center", "left", "right")[int(np.sign(dx))]
            above = ("center", "bottom", "top")[int(np.sign(dy))]
            look = {"size": SMALL, "color": INK, "ha": beside, "va": above, "zorder": 9}
            place = {"xytext": (dx, dy), "textcoords": "offset points"}
            told = short(printable(str(name)), 18)
            text = axes.annotate(told, point, **place, **look, parse_math=False)
            box = text.get_window_extent(renderer).padded(1.5)
            wide = box.padded(4.0)
            free = (
                (inside.min <= box.min).all()
                and (box.max <= inside.max).all()
                and not any(box.overlaps(other) for other in taken)
                and not ((others > wide.p0) & (others < wide.p1)).all(axis=1).any()
            )
            if free:
                taken.append(box)
                break
            text.remove()


# Where a name may stand beside its point, points of print.
_PLACES = ((6, 0), (-6, 0), (0, 6), (0, -6), (5, 5), (5, -5), (-5, 5), (-5, -5))
