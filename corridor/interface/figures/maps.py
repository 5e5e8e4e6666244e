"""Maps of a block: turned so that a long corridor lies across the sheet."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from corridor.core.block import Block
from corridor.core.output import short
from corridor.interface.figures import style

TURNED_FROM = 2.0  # length over breadth of the cameras from which on the map is turned
DOTS_FROM = 200  # ground points of one role from which on they are drawn as dots
STACKED_FROM = 2.2  # length over breadth from which on two maps stand one above the other


@dataclass(frozen=True)
class MapFrame:
    """From world x, y (metres) to the sheet: turned by `angle` about `origin`, or left alone."""

    angle: float
    origin: np.ndarray
    turned: bool
    north: str

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (n, 2) in the world as they lie on the sheet."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        vectors = np.asarray(vectors, dtype=float).reshape(-1, 2)
        x, y = vectors.T
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)

    def place(self, xy: np.ndarray) -> np.ndarray:
        """Positions (n, 2) in the world as they lie on the sheet, metres."""
        return self.turn(np.asarray(xy, dtype=float).reshape(-1, 2) - self.origin)

    @property
    def labels(self) -> tuple[str, str]:
        if self.turned:
            return "along the block (m)", "across (m)"
        return "x (m)", "y (m)"


def columns(frame: pd.DataFrame, names: tuple[str, ...] = ("x", "y")) -> np.ndarray:
    """Columns of a table as (n, k) float64, NaN where a column or a value is missing."""
    known = frame.reindex(columns=list(names))
    return known.to_numpy(dtype=float, na_value=np.nan, copy=True)


def centres(block: Block) -> np.ndarray:
    """Camera centres (images, 2) in plan, metres; where a pose is unknown the antenna's place."""
    xy = columns(block.images)
    missing = ~np.isfinite(xy).all(axis=1)
    if missing.any() and len(block.gnss):
        antenna = pd.DataFrame(columns(block.gnss), index=block.gnss["image"].astype(str))
        found = antenna.reindex(block.images["image"].astype(str)).to_numpy()
        xy[missing] = found[missing]
    return xy


def frame_of(block: Block) -> MapFrame:
    """The frame in which a block is drawn: turned when it is clearly longer than broad."""
    return frame_through(centres(block), "N" if getattr(block, "crs", None) else "y")


def frame_through(xy: np.ndarray, north: str = "N") -> MapFrame:
    """The frame for positions (n, 2): turned when they are clearly longer than broad.

    north: what stands at the arrow that points along y.
    """
    upright = MapFrame(0.0, np.zeros(2), False, north)
    known = xy[np.isfinite(xy).all(axis=1)]
    if len(known) < 3:
        return upright
    middle = known.mean(axis=0)
    _, _, axes = np.linalg.svd(known - middle, full_matrices=False)
    spread = np.ptp((known - middle) @ axes.T, axis=0)
    if spread[0] < TURNED_FROM * spread[1]:
        return upright
    direction = axes[0]
    # A corridor within a degree or so of north is read northwards, any other eastwards.
    if direction[0] < -0.02 or (abs(direction[0]) <= 0.02 and direction[1] < 0):
        direction = -direction
    angle = float(np.arctan2(direction[1], direction[0]))
    across = np.array([-direction[1], direction[0]])
    first = ((known - middle) @ direction).min()
    mid = np.mean([((known - middle) @ across).min(), ((known - middle) @ across).max()])
    return MapFrame(angle, middle + first * direction + mid * across, True, north)


def body(places: np.ndarray) -> np.ndarray:
    """The rows of (n, 2) that a map should hold: all but a half per cent at each end.

    A tie point of two nearly parallel rays may lie kilometres away.
    """
    places = places[np.isfinite(places).all(axis=1)]
    if len(places) < 50:
        return places
    low, high = np.percentile(places, [0.5, 99.5], axis=0)
    return places[((places >= low) & (places <= high)).all(axis=1)]


def extent(*places: np.ndarray, margin: float = 0.04) -> tuple[float, float, float, float]:
    """left, right, low, high of all positions, metres, with a margin on each side."""
    every = np.vstack([np.asarray(p, dtype=float).reshape(-1, 2) for p in places])
    every = every[np.isfinite(every).all(axis=1)]
    if not len(every):
        return -1.0, 1.0, -1.0, 1.0
    low, high = every.min(axis=0), every.max(axis=0)
    room = margin * max(float((high - low).max()), 1.0)
    return low[0] - room, high[0] + room, low[1] - room, high[1] + room


def map_height(limits: tuple[float, float, float, float], width: float, most: float) -> float:
    """Height in inches of a map `width` inches wide, between 1.3 and `most`."""
    left, right, low, high = limits
    return float(np.clip(width * (high - low) / (right - left), 1.3, most))


def map_panel(
    figure: Figure,
    frame: MapFrame,
    limits: tuple[float, float, float, float],
    left: float,
    top: float,
    width: float,
    height: float,
) -> Axes:
    """A map whose scale is the same in both directions and which fills its panel.

    The north arrow stands outside, right of the map, and needs half an inch there.
    """
    axes = style.panel(figure, left, top, width, height)
    at_one_scale(axes, limits, width, height)
    axes.set_aspect("equal", adjustable="box")
    style.label(axes, *frame.labels)
    _north_arrow(figure, frame, left + width + 0.3, top + 0.35)
    return axes


def at_one_scale(axes: Axes, limits: tuple, width: float, height: float) -> None:
    """Axes of so many inches that show all of `limits`, at the same scale in both directions."""
    x0, x1, y0, y1 = limits
    scale = max((x1 - x0) / width, (y1 - y0) / height)
    x_mid, y_mid = (x0 + x1) / 2, (y0 + y1) / 2
    axes.set_xlim(x_mid - scale * width / 2, x_mid + scale * width / 2)
    axes.set_ylim(y_mid - scale * height / 2, y_mid + scale * height / 2)


def _north_arrow(figure: Figure, frame: MapFrame, left: float, top: float) -> None:
    axes = style.panel(figure, left - 0.28, top - 0.28, 0.56, 0.56)
    axes.set_axis_off()
    axes.set(xlim=(-1, 1), ylim=(-1, 1))
    direction = frame.turn(np.array([[0.0, 1.0]]))[0]
    arrow = {"arrowstyle": "-|>", "color": style.INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", 0.5 * direction, -0.75 * direction, arrowprops=arrow)
    look = {"size": style.SMALL, "weight": "bold", "color": style.INK}
    axes.text(*(0.78 * direction), frame.north, ha="center", va="center", **look)


def groups(block: Block) -> list[tuple[str, np.ndarray]]:
    """Rows of the images by flight, or by strip where there is one flight: (name, rows)."""
    if len(block.flight_names) > 1:
        kind, names = "flight", list(block.flight_names)
        of_image = np.array(names, dtype=object)[block.image_flight]
    else:
        kind, of_image = "strip", _strips(block)
        names = list(dict.fromkeys(of_image))
    if len(names) < 2:
        return [("images", np.arange(len(block.images)))]
    return [
        (f"{kind} {short(name, 12)}" if name else f"no {kind}", np.flatnonzero(of_image == name))
        for name in names
    ]


def _strips(block: Block) -> np.ndarray:
    """Name of the strip (images,) of each image, empty where none is stated."""
    images = block.images
    strip = images["strip"] if "strip" in images else pd.Series("", images.index)
    return strip.astype("string").fillna("").to_numpy(dtype=object)


def lines(block: Block) -> list[np.ndarray]:
    """Rows of the images of each strip, in the order of exposure; empty when none is stated."""
    flights, strip = np.asarray(block.image_flight), _strips(block)
    found: dict[tuple, list[int]] = {}
    for row in np.argsort(columns(block.images, ("time_s",))[:, 0], kind="stable"):
        if strip[row]:
            found.setdefault((flights[row], strip[row]), []).append(int(row))
    return [np.array(rows) for rows in found.values()]


def group_styles(block: Block) -> list[tuple[str, np.ndarray, str, str]]:
    """(name, rows, colour, marker) of each flight or strip; one style when there are many."""
    parts = groups(block)
    if len(parts) > len(style.SERIES):
        kind = "flights" if len(block.flight_names) > 1 else "strips"
        everything = np.sort(np.concatenate([rows for _, rows in parts]))
        parts = [(f"images in {len(parts)} {kind}", everything)]
    return [(name, rows, *style.SERIES[number]) for number, (name, rows) in enumerate(parts)]


def draw_cameras(axes: Axes, frame: MapFrame, block: Block, faint: bool = False) -> list[Line2D]:
    """Camera centres by flight or strip; returns the keys for the legend."""
    places = frame.place(centres(block))
    size = float(np.clip(60 / np.sqrt(max(len(places), 1)), 1.8, 5.0))
    if faint:
        look = style.dot(".", style.FAINT, 0.7 * size)
        return axes.plot(*places.T, zorder=2, label="images", **look)
    for rows in lines(block):
        axes.plot(*places[rows].T, color=style.QUIET, lw=0.5, zorder=3)
    keys = []
    for name, rows, colour, marker in group_styles(block):
        text = f"{len(rows):,} {name}" if name.startswith("images") else name
        axes.plot(*places[rows].T, zorder=4, **style.dot(marker, colour, size, style.INK, 0.3))
        keys.append(style.key(text, **style.dot(marker, colour)))
    return keys


GROUND = (("control", "^", style.INK), ("check", "o", "white"), ("unused", "x", style.QUIET))


def draw_ground(axes: Axes, frame: MapFrame, block: Block, names: bool = True) -> list[Line2D]:
    """Ground points by role, with their names where there is room; returns the keys."""
    if not len(block.ground):
        return []
    places = frame.place(columns(block.ground))
    role = block.ground["role"].astype(str).to_numpy()
    keys = []
    for name, marker, fill in GROUND:
        rows = np.flatnonzero(role == name)
        if len(rows):
            look, order = style.dot(marker, fill, 6.5, style.INK), 6.0
            if len(rows) > DOTS_FROM:
                # Thousands of check points would hide the flight: small and below it.
                look, order = style.dot(marker, style.INK, 1.6, line=0.0), 1.5
            axes.plot(*places[rows].T, zorder=order, **look)
            text = f"{len(rows):,} {name}"
            keys.append(style.key(text, **look | {"ms": max(look["ms"], 3.0)}))
    if names and len(places) <= 40:
        known = np.isfinite(places).all(axis=1)
        named = block.ground["point"].astype(str).to_numpy()[known]
        style.name_points(axes, places[known], named, frame.place(centres(block)))
    return keys
