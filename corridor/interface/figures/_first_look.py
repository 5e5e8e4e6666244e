"""What a block holds, before anything is computed."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.output import counted, short
from corridor.interface.figures import maps, style

MOST_POINTS = 6000
MOST_RAYS = 20
# Observations that are sorted into cells in one go.
ROWS_AT_ONCE = 1 << 20


def first_look(block: Block, camera: str | None = None) -> Figure:
    """Plan view of images and points, rays a point, and where in the image points were measured.

    block: any block, poses and points known or not.
    camera: whose image is shown; default the camera with most observations.
    Source of the layout: none; a long corridor lies across the sheet, north arrow beside it.
    """
    frame = maps.frame_of(block)
    cameras = frame.place(maps.centres(block))
    known = maps.columns(block.points)
    known = known[np.isfinite(known).all(axis=1)]
    step = max(-(-len(known) // MOST_POINTS), 1)
    # Where the map ends a twentieth of a river's points tells as well as all.
    points = frame.place(known[:: max(step // 20, 1)])
    ground = frame.place(maps.columns(block.ground))
    limits = maps.extent(cameras, maps.body(points), ground)
    long = (limits[1] - limits[0]) > 1.4 * (limits[3] - limits[2])
    title = f"{short(block.name, 60)}: first look"
    rays = _multiplicity(block.tie_points)
    rays = rays[rays > 0]
    counts = _counts(block, len(rays))
    camera = camera or _most_seen(block)
    if long:
        height = maps.map_height(limits, 8.5, 4.5)
        figure = style.sheet(1.15 + height + 0.95 + 2.3 + 0.55, title, counts)
        plan = maps.map_panel(figure, frame, limits, 0.8, 1.15, 8.5, height)
        top = 1.15 + height + 0.95
        _rays(style.panel(figure, 0.8, top, 3.7, 2.3), rays)
        _coverage(figure, block, camera, 5.35, top, 3.75, 2.3)
    else:
        height = maps.map_height(limits, 4.7, 5.55)
        lowest = max(1.15 + height, 3.85 + _fitted(block.cameras[camera], 2.35, 2.4)[1])
        figure = style.sheet(lowest + 0.65, title, counts)
        plan = maps.map_panel(figure, frame, limits, 0.8, 1.15, 4.7, height)
        _rays(style.panel(figure, 6.75, 1.25, 2.95, 1.75), rays)
        _coverage(figure, block, camera, 6.75, 3.85, 2.35, 2.4)
    style.legend(figure, 0.87, _plan(plan, frame, block, frame.place(known[::step]), step))
    return figure


def _counts(block: Block, tie_points: int) -> str:
    parts = [counted(len(block.images), "image")]
    flights = len(block.flight_names)
    if flights > 1:
        parts.append(counted(flights, "flight"))
    if len(block.cameras) > 1:
        parts.append(counted(len(block.cameras), "camera"))
    if len(block.tie_points):
        parts.append(counted(tie_points, "tie point"))
        parts.append(counted(len(block.tie_points), "tie observation"))
    if len(block.marks):
        parts.append(counted(len(block.marks), "mark"))
    parts.append(f"GNSS at {counted(len(block.gnss), 'image')}" if len(block.gnss) else "no GNSS")
    return " \u00b7 ".join(parts)


def _multiplicity(observations: pd.DataFrame) -> np.ndarray:
    """Number of images in which each point was measured, in the order of the point's code."""
    points = observations["point"].astype("category").array
    count = np.zeros(len(points.categories), dtype=np.int64)
    for first in range(0, len(points), 8 * ROWS_AT_ONCE):
        count += np.bincount(points.codes[first : first + 8 * ROWS_AT_ONCE], minlength=len(count))
    return count


def _plan(axes: Axes, frame: maps.MapFrame, block: Block, points: np.ndarray, step: int) -> list:
    """Cameras, one point in so many, and ground points; their keys."""
    keys = maps.draw_cameras(axes, frame, block)
    if len(points):
        axes.plot(*points.T, zorder=1, **style.dot("o", "#b0b0b0", 1.7, "none"))
        text = "tie points" + (f" (one in {step:,})" if step > 1 else "")
        keys.append(style.key(text, **style.dot("o", "#b0b0b0", 2.5, "none")))
    keys += maps.draw_ground(axes, frame, block)
    if not np.isfinite(maps.centres(block)).any() and not len(points):
        style.quiet(axes, "no position is known yet: the adjustment finds start values")
    return keys


def _rays(axes: Axes, rays: np.ndarray) -> None:
    """rays (n,): in how many images each tie point was measured."""
    style.open_frame(axes)
    style.caption(axes, "images a tie point was measured in")
    style.label(axes, "images", "points")
    # All digits of millions would leave the sheet.
    axes.yaxis.set_major_formatter(
        FuncFormatter(lambda n, _: f"{n:,.0f}" if n < 1e6 else f"{n / 1e6:g} M")
    )
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    if not len(rays):
        style.caption(axes, "no tie points")
        axes.set(xticks=[], yticks=[])
        return
    most = int(min(rays.max(), MOST_RAYS))
    count = np.bincount(np.minimum(rays, MOST_RAYS), minlength=most + 1)
    number = np.arange(len(count))
    colours = np.where(number[1:] == 1, style.LIGHT, style.DARK)
    axes.bar(number[1:], count[1:], width=0.8, color=colours, linewidth=0)
    axes.set_xlim(0.4 if count[1] else 1.4, max(len(count) - 0.4, 4.6))
    axes.set_ylim(0, 1.08 * count.max())
    axes.xaxis.set_major_locator(MaxNLocator(10, integer=True, steps=[1, 2, 5, 10]))
    if rays.max() > MOST_RAYS:
        axes.xaxis.set_major_formatter(
            FuncFormatter(
                lambda value, _: ("\u2265" if value == MOST_RAYS else "") + f"{value:.0f}"
            )
        )


def _coverage(
    figure: Figure, block: Block, camera: str, left: float, top: float, width: float, height: float
) -> None:
    """Counts of observations over the image; the panel is at most width by height inches."""
    tables = [table for table in (block.tie_points, block.marks) if len(table)]
    chosen = [np.asarray(camera_of(block, table) == camera) for table in tables]
    size = block.cameras[camera]
    wide, high = _fitted(size, width, height)
    axes = style.panel(figure, left, top, wide, high)
    number = int(sum(np.count_nonzero(mine) for mine in chosen))
    edges_x, edges_y = cells(size.width, size.height, number, most=32)
    count = np.zeros((len(edges_y) - 1, len(edges_x) - 1))
    for table, mine in zip(tables, chosen, strict=True):
        count = count + in_cells(table, mine, edges_x, edges_y)[0]
    image = axes.pcolormesh(
        edges_x, edges_y, count, cmap=style.COUNTS, vmin=0, vmax=max(count.max(), 1)
    )
    style.in_pixels(axes, size)
    axes.set_aspect("equal", adjustable="box")
    axes.xaxis.set_major_locator(MaxNLocator(max(2, int(wide / 0.55)), steps=[1, 2, 4, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(max(2, int(high / 0.45)), steps=[1, 2, 4, 5, 10]))
    text = "where in the image"
    if len(block.cameras) > 1:
        text += f", camera {short(camera, 14)}"
    style.caption(axes, text)
    style.shade_bar(figure, image, left + wide + 0.12, top, high, "observations a cell", True)


def _most_seen(block: Block) -> str:
    """The camera with most observations."""
    if len(block.cameras) == 1:
        return next(iter(block.cameras))
    count = np.zeros(len(block.cameras))
    for table in (block.tie_points, block.marks):
        codes = camera_of(block, table).codes
        count += [np.count_nonzero(codes == n) for n in range(len(count))]
    return list(block.cameras)[int(count.argmax())]


def _fitted(camera: Camera, width: float, height: float) -> tuple[float, float]:
    """Breadth and height, inches, of a picture that fits into so much room."""
    scale = min(width / camera.width, height / camera.height)
    return scale * camera.width, scale * camera.height


def camera_of(block: Block, table: pd.DataFrame) -> pd.Categorical:
    """(n,) the camera of each row of a table of observations or residuals."""
    of_image = pd.Series(
        block.images["camera"].astype(str).to_numpy(), index=block.images["image"].astype(str)
    )
    image = table["image"].astype("category")
    names = of_image.reindex(image.cat.categories.astype(str))
    codes = pd.Index(list(block.cameras)).get_indexer(names).astype(np.int16)
    kind = pd.CategoricalDtype(list(block.cameras))
    return pd.Categorical.from_codes(codes[image.array.codes], dtype=kind, validate=False)


def in_cells(
    table: pd.DataFrame, chosen: np.ndarray, edges_x: np.ndarray, edges_y: np.ndarray, *sums: str
) -> np.ndarray:
    """Number of rows in each cell of an image, and their sums: (1 + 2 k, rows, columns).

    table: with x and y, px; chosen (n,): its rows that count. edges: of even cells. sums: columns
    of the table; of each the sum of its values, then that of their squares.
    """
    shape = len(edges_y) - 1, len(edges_x) - 1
    out = np.zeros((1 + 2 * len(sums), shape[0] * shape[1]))
    values = [table[name].to_numpy(dtype=float) for name in ("x", "y", *sums)]
    for first in range(0, len(table), ROWS_AT_ONCE):
        part = slice(first, first + ROWS_AT_ONCE)
        x, y, *rest = (column[part] for column in values)
        inside = (x >= edges_x[0]) & (x <= edges_x[-1]) & (y >= edges_y[0]) & (y <= edges_y[-1])
        inside &= chosen[part]
        if not inside.all():
            x, y, *rest = (column[inside] for column in (x, y, *rest))
        # What lies on the last edge belongs to the last cell.
        column = ((x - edges_x[0]) / (edges_x[1] - edges_x[0])).astype(np.int32)
        row = ((y - edges_y[0]) / (edges_y[1] - edges_y[0])).astype(np.int32)
        cell = np.minimum(row, shape[0] - 1) * shape[1] + np.minimum(column, shape[1] - 1)
        for k, weights in enumerate([None, *(w for v in rest for w in (v, v**2))]):
            out[k] += np.bincount(cell, weights, minlength=out.shape[1])
    return out.reshape(-1, *shape)


def cells(
    width: float, height: float, count: int, most: int, wanted: float = 20.0
) -> tuple[np.ndarray, np.ndarray]:
    """Edges in x and in y (px) of square cells over an image, about `wanted` observations each."""
    across = np.sqrt(max(count, 1) / wanted * width / height)
    columns = int(np.clip(round(across), 4, most))
    rows = max(3, round(columns * height / width))
    return np.linspace(-0.5, width - 0.5, columns + 1), np.linspace(-0.5, height - 0.5, rows + 1)
