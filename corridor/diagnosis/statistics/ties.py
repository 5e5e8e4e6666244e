"""Statistics of tie points, used and held out, and of marks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from corridor.diagnosis.statistics.bins import FEWEST, Curve, Grid, corridor_frame
from corridor.geometry import CLIPPED, robust_scale_of_lengths

if TYPE_CHECKING:
    from corridor.diagnosis.statistics.ruler import Ruler

ROWS, TIMES, PLACES = 12, 12, 14
COLUMNS = (8, 6)
COARSE = (6, 4)
# Ground points from which on they are not told apart.
MANY_POINTS = 40


def add_ties(ruler: Ruler) -> None:
    """Residuals of tie points by everything on which an effect would draw its signature."""
    b, images, rays = ruler.believed, ruler.images, ruler.believed.system.image_rows
    state, used = b.fit.state, b.is_tie & ~b.held_out
    ruler.used, ruler.held = np.flatnonzero(used), np.flatnonzero(b.held_out)
    length = np.hypot(*b.fit.pixels[used].T) / b.sigma[used]
    ruler.limit = CLIPPED * robust_scale_of_lengths(length, least=1e-9) * b.sigma
    image, point = rays.image[used], rays.point[used]
    half = (images.size[image] - 1) / 2
    xy = rays.xy[used]
    centred = xy - half
    ruler.across = centred / half.max(axis=1, keepdims=True)
    weight = np.median(b.sigma[used]) ** 2 / b.sigma[used] ** 2
    ruler.weight = weight
    ruler.square = weight * (ruler.across**2).sum(axis=1)

    whole = images.size[image]
    grid = Grid(xy / whole, COLUMNS, weight, images.size.max(axis=0))
    what = "place in the image (px)"
    for k, axis in enumerate("xy"):
        ruler.add(
            grid.statistic(f"tie {axis} by image position", "tie", "px", what),
            lambda seen, k=k: grid.mean(seen.ties[:, k]),
        )
    ruler.add(
        grid.statistic("tie size by image position", "tie", "px", what),
        lambda seen: grid.size(seen.tie_square),
    )
    row = images.row_of[image]
    pixel = np.where(row[:, 0] == 1, xy[:, 1], xy[:, 0])
    fraction = row[:, 1] * pixel + row[:, 2]
    rows = Curve.even(fraction, ROWS, weight)
    what = "row, as read (fraction of the picture)"
    for k, axis in enumerate("xy"):
        _mean(ruler, f"tie {axis} by row", what, rows, k)
    _size(ruler, "tie size by row", what, rows)

    velocity = images.velocity
    moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
    if moving.any():
        in_camera = np.einsum("nij,nj->ni", images.rotation, np.nan_to_num(velocity))[:, :2]
        speed = np.maximum(np.hypot(*in_camera.T), 1e-9)
        ruler.flow = np.where(moving[:, None], in_camera / speed[:, None], 0.0)[image]
        rows = Curve.even(np.where(moving[image], fraction, np.nan), ROWS, weight)
        for part in ("along", "across"):
            ruler.add(
                rows.statistic(f"tie {part} the velocity by row", "tie", "px", what),
                lambda seen, part=part, rows=rows: rows.mean(seen.flowing[part]),
            )
        sectors = Curve.sectors(velocity, moving, image, weight)
        if len(sectors.at) > 1:
            for name in ("along", "across"):
                ruler.add(
                    sectors.statistic(
                        f"tie {name} the velocity by its direction", "tie", "px",
                        "direction of the velocity",
                    ),
                    lambda seen, name=name: sectors.mean(seen.flowing[name]),
                )  # fmt: skip
            _outward_and_size(
                ruler, "direction of the velocity", sectors, "direction of the velocity"
            )
    else:
        ruler.flow = None
        ruler.missing["tie residuals by velocity"] = "images.vx, images.vy, images.vz"

    depth = np.einsum(
        "ni,ni->n", images.rotation[image, 2], state.points[point] - images.centre[image]
    )
    origin, axes = corridor_frame(images.centre)
    place = (state.points[point][:, :2] - origin) @ axes.T
    flights = images.flight[image].astype(float)
    regressors = {"time": images.time[image], "temperature": images.temperature[image]}
    for name, values, unit, column in (
        ("time", images.time[image], "s", "images.time_s"),
        ("temperature", images.temperature[image], "°C", "images.temperature_c"),
        ("depth", depth, "m", ""),
    ):
        if not np.isfinite(values).any() or np.nanmax(values) <= np.nanmin(values):
            if column:
                ruler.missing[f"tie residuals by {name}"] = column
            continue
        curve = Curve.equal(values, TIMES, weight)
        _outward_and_size(ruler, f"{name} ({unit})", curve, name)
    regressors["depth"] = depth
    along = Curve.even(place[:, 0], PLACES, weight)
    _outward_and_size(ruler, "along the corridor (m)", along, "place along the corridor")
    if len(images.flight_names) > 1:
        names = tuple(images.flight_names)
        curve = Curve.codes(flights, weight, names)
        _outward_and_size(ruler, "flight", curve, "flight")
    ground = Grid.of_places(place, weight)
    ruler.add(
        ground.statistic("tie size by place on the ground", "tie", "px", "ground (m)"),
        lambda seen: ground.size(seen.tie_square),
    )
    ruler.add(
        ground.statistic("tie outward by place on the ground", "tie", "px", "ground (m)"),
        lambda seen: ground.ratio(seen.outward, ruler.square),
    )

    if ruler.flow is not None:
        regressors["velocity x"] = np.where(moving, in_camera[:, 0], np.nan)[image]
        regressors["velocity y"] = np.where(moving, in_camera[:, 1], np.nan)[image]
    for name, values in regressors.items():
        known = np.isfinite(values)
        spread = float(np.std(values[known])) if known.any() else 0.0
        middle = float(np.mean(values[known])) if known.any() else 0.0
        if spread <= 1e-3 * max(abs(middle), 1e-9):
            continue
        g = np.where(known, (values - middle) / spread, 0.0)
        cells = Grid(xy / whole, COARSE, weight * g**2, images.size.max(axis=0), known)
        for k, axis in enumerate("xy"):
            ruler.add(
                cells.statistic(
                    f"tie {axis} by image position, growing with {name}", "tie", "px",
                    "place in the image (px)",
                ),
                lambda seen, k=k, g=g, cells=cells: cells.slope(seen.ties[:, k], weight * g),
            )  # fmt: skip
    _held_out(ruler)


def _held_out(ruler: Ruler) -> None:
    b, rays = ruler.believed, ruler.believed.system.image_rows
    if len(ruler.held) < FEWEST:
        ruler.missing["held-out tie observations"] = "tie points in four images or more"
        return
    image = rays.image[ruler.held]
    weight = np.median(b.sigma[ruler.held]) ** 2 / b.sigma[ruler.held] ** 2
    size = ruler.images.size
    grid = Grid(rays.xy[ruler.held] / size[image], (4, 3), weight, size.max(axis=0))
    what = "place in the image (px)"
    for k, axis in enumerate("xy"):
        ruler.add(
            grid.statistic(f"held-out tie {axis} by image position", "held_out", "px", what),
            lambda seen, k=k: grid.mean(seen.held[:, k]),
        )
    all_of_them = Curve(np.zeros(len(image), np.int64), np.zeros(1), weight, ("all together",))
    ruler.add(
        all_of_them.statistic("held-out tie size", "held_out", "px", ""),
        lambda seen: all_of_them.size((seen.held**2).sum(axis=1) / 2),
    )


def _mean(ruler: Ruler, name: str, axis: str, curve: Curve, k: int) -> None:
    ruler.add(curve.statistic(name, "tie", "px", axis), lambda seen: curve.mean(seen.ties[:, k]))


def _size(ruler: Ruler, name: str, axis: str, curve: Curve) -> None:
    ruler.add(curve.statistic(name, "tie", "px", axis), lambda seen: curve.size(seen.tie_square))


def _outward_and_size(ruler: Ruler, axis: str, curve: Curve, name: str) -> None:
    """Scale of the picture, px at the end of its long side, and the size of residuals."""
    if len(curve.at) < 2:
        return
    ruler.add(
        curve.statistic(f"tie outward by {name}", "tie", "px", axis),
        lambda seen: curve.ratio(seen.outward, ruler.square),
    )
    _size(ruler, f"tie size by {name}", axis, curve)


def add_marks(ruler: Ruler) -> None:
    """Residuals of marks by point."""
    b, rays = ruler.believed, ruler.believed.system.image_rows
    rows = np.flatnonzero(~b.is_tie)
    ruler.marks = rows
    length = np.hypot(*b.fit.pixels[rows].T) / b.sigma[rows]
    ruler.mark_limit = CLIPPED * robust_scale_of_lengths(length, least=1e-9) * b.sigma[rows]
    names, code = np.unique(rays.point[rows], return_inverse=True)
    if len(names) <= MANY_POINTS:
        curve = Curve.codes(
            code.astype(float), np.ones(len(rows)), tuple(map(str, b.system.points.names[names])), 2
        )
        ruler.add(
            curve.statistic("mark size by point", "mark", "px", "ground point"),
            lambda seen: curve.size((seen.marks**2).sum(axis=1) / 2),
        )
    size = ruler.images.size
    image = rays.image[rows]
    grid = Grid(rays.xy[rows] / size[image], (3, 2), np.ones(len(rows)), size.max(axis=0), least=8)
    for k, axis in enumerate("xy"):
        ruler.add(
            grid.statistic(
                f"mark {axis} by image position", "mark", "px", "place in the image (px)"
            ),
            lambda seen, k=k: grid.mean(seen.marks[:, k]),
        )
