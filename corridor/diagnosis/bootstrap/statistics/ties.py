"""Statistics of tie points, used and held out, and of marks.

A table: by what (name and axis, with its bins), and which quantities of the residuals.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from corridor.core.geometry import CLIPPED, robust_scale_of_lengths
from corridor.diagnosis.bootstrap.statistics.statistic import (
    FEWEST,
    Curve,
    Form,
    Grid,
    corridor_frame,
)

ROWS, TIMES, PLACES = 12, 12, 14
COLUMNS = (8, 6)
# Ground points from which on they are not told apart.
MANY_POINTS = 40
IN_THE_IMAGE = "place in the image (px)"
# Quantity -> name, and value of each bin. Outward: scale of the picture, px at the end of its long
# side.
QUANTITIES = {
    "x": ("tie residuals in x", lambda r, bins: bins.mean(r.ties[:, 0])),
    "y": ("tie residuals in y", lambda r, bins: bins.mean(r.ties[:, 1])),
    "size": ("size of tie residuals", lambda r, bins: bins.size(r.tie_square)),
    "outward": ("outward tie residuals", lambda r, bins: bins.ratio(r.outward, r.frame.square)),
    "along": ("tie residuals along the flight", lambda r, bins: bins.mean(r.along)),
    "across": ("tie residuals across the flight", lambda r, bins: bins.mean(r.across)),
}


class TieFrame:
    """Where the tie points that a fit uses lie, in images, time and space; the same in all fits.

    used, held: rows of those that are fitted and of those held out. limit (n,): px at which each
    residual is cut. across (u, 2): from the picture's middle, 1 at the end of its long side; flow
    (u, 2): direction of the velocity in the picture, None where none is known. missing: what could
    not be formed, and the column to add.
    """

    def __init__(self, replicator):
        b, rays = replicator, replicator.system.image_rows
        self.images, self.missing = b.system.images, {}
        used = b.is_tie & ~b.held_out
        self.used, self.held = np.flatnonzero(used), np.flatnonzero(b.held_out)
        length = np.hypot(*b.fit.pixels[used].T) / b.sigma[used]
        self.limit = CLIPPED * robust_scale_of_lengths(length, least=1e-9) * b.sigma
        self.weight = _weight(b.sigma[used])
        self.held_weight = _weight(b.sigma[self.held])
        self.image, self.xy = rays.image[used], rays.xy[used]
        self.held_image, self.held_xy = rays.image[b.held_out], rays.xy[b.held_out]
        self.position = b.fit.state.points[rays.point[used]]
        half = (self.images.size[self.image] - 1) / 2
        self.across = (self.xy - half) / half.max(axis=1, keepdims=True)
        self.square = self.weight * (self.across**2).sum(axis=1)
        velocity = self.images.velocity
        self.moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
        self.flow = None
        if self.moving.any():
            turned = np.einsum("nij,nj->ni", self.images.rotation, np.nan_to_num(velocity))
            self.in_camera = turned[:, :2]
            speed = np.maximum(np.hypot(*self.in_camera.T), 1e-9)[:, None]
            self.flow = np.where(self.moving[:, None], self.in_camera / speed, 0.0)[self.image]

    def rows(self) -> Iterator[tuple]:
        """By what, its axis, bins, quantities, and the fewest bins that say something."""
        images, image, weight = self.images, self.image, self.weight
        share, size = self.xy / images.size[image], images.size.max(axis=0)
        yield "image position", IN_THE_IMAGE, Grid(share, COLUMNS, weight, size), "x y size", 1
        row = images.row_of[image]
        pixel = np.where(row[:, 0] == 1, self.xy[:, 1], self.xy[:, 0])
        fraction = row[:, 1] * pixel + row[:, 2]
        what = "row, as read (fraction of the picture)"
        yield "row", what, Curve.even(fraction, ROWS, weight), "x y size", 1
        if self.flow is None:
            self.missing["tie residuals by velocity"] = "images.vx, images.vy, images.vz"
        else:
            moved = Curve.even(np.where(self.moving[image], fraction, np.nan), ROWS, weight)
            yield "row", what, moved, "along across", 1
            sectors = Curve.sectors(images.velocity, self.moving, image, weight)
            what = "direction of the velocity"
            yield "its direction", what, sectors, "along across", 2
            yield what, what, sectors, "outward size", 2
        away = self.position - images.centre[image]
        depth = np.einsum("ni,ni->n", images.rotation[image, 2], away)
        followed = {
            "time": (images.time[image], "s", "images.time_s"),
            "temperature": (images.temperature[image], "°C", "images.temperature_c"),
            "depth": (depth, "m", ""),
        }
        for name, (values, unit, column) in followed.items():
            if np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values):
                bins = Curve.equal(values, TIMES, weight)
                yield name, f"{name} ({unit})", bins, "outward size", 2
            elif column:
                self.missing[f"tie residuals by {name}"] = column
        origin, axes = corridor_frame(images.centre)
        place = (self.position[:, :2] - origin) @ axes.T
        along = Curve.even(place[:, 0], PLACES, weight)
        yield "place along the corridor", "along the corridor (m)", along, "outward size", 2
        if len(images.flight_names) > 1:
            flights = images.flight[image].astype(float)
            bins = Curve.codes(flights, weight, tuple(images.flight_names))
            yield "flight", "flight", bins, "outward size", 2
        yield "place on the ground", "ground (m)", Grid.of_places(place, weight), "size outward", 1


def _weight(sigma: np.ndarray) -> np.ndarray:
    """Weights (n,) of observations with these standard deviations, 1 for the usual one."""
    return np.median(sigma) ** 2 / sigma**2 if len(sigma) else sigma


def tie_forms(frame: TieFrame) -> Iterator[Form]:
    """Residuals of tie points by everything on which an effect would draw its signature."""
    for by, axis, bins, quantities, fewest in frame.rows():
        if len(bins.at) < fewest:
            continue
        for quantity in quantities.split():
            name, value = QUANTITIES[quantity]
            yield Form(
                bins.statistic(f"{name} by {by}", "tie", "px", axis),
                lambda r, value=value, bins=bins: value(r, bins),
            )
    if len(frame.held) < FEWEST:
        frame.missing["held-out tie observations"] = "tie points in four images or more"
        return
    size, weight = frame.images.size, frame.held_weight
    grid = Grid(frame.held_xy / size[frame.held_image], (4, 3), weight, size.max(axis=0))
    for k, axis in enumerate("xy"):
        name = f"held-out tie residuals in {axis} by image position"
        yield Form(
            grid.statistic(name, "held_out", "px", IN_THE_IMAGE),
            lambda r, k=k: grid.mean(r.held[:, k]),
        )
    together = Curve(np.zeros(len(weight), np.int64), np.zeros(1), weight, ("all together",))
    yield Form(
        together.statistic("size of held-out tie residuals", "held_out", "px", ""),
        lambda r: together.size((r.held**2).sum(axis=1) / 2),
    )


def mark_forms(replicator, marks: np.ndarray) -> Iterator[Form]:
    """Residuals of marks (rows) by point and by place in the image."""
    system = replicator.system
    rays, size = system.image_rows, system.images.size
    names, code = np.unique(rays.point[marks], return_inverse=True)
    one = np.ones(len(marks))
    if len(names) <= MANY_POINTS:
        points = tuple(map(str, system.points.names[names]))
        curve = Curve.codes(code.astype(float), one, points, 2)
        yield Form(
            curve.statistic("mark size by point", "mark", "px", "ground point"),
            lambda r: curve.size((r.marks**2).sum(axis=1) / 2),
        )
    share = rays.xy[marks] / size[rays.image[marks]]
    grid = Grid(share, (3, 2), one, size.max(axis=0), least=8)
    for k, axis in enumerate("xy"):
        yield Form(
            grid.statistic(f"mark {axis} by image position", "mark", "px", IN_THE_IMAGE),
            lambda r, k=k: grid.mean(r.marks[:, k]),
        )
