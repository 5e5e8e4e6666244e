"""A change for a GIS and for programs of point clouds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from corridor.change.surface import SurfaceChange
from corridor.errors import InputError
from corridor.report import Layer, write_geopackage, write_las

if TYPE_CHECKING:
    from corridor.change.result import Change


def write_gis(change: Change, folder: Path) -> list[str]:
    """Writes change.gpkg (points, cells) and change.las into a folder; what could not be.

    A sentence each.
    """
    block = change.compared.adjustments[0].block
    return [
        *_tried(lambda: _geopackage(change, folder / "change.gpkg", block)),
        *_tried(lambda: _las(change, folder / "change.las", block)),
    ]


def _tried(write) -> list[str]:
    try:
        write()
    except InputError as missing:
        return [str(missing)]
    return []


def _geopackage(change: Change, path: Path, block) -> None:
    layers = {}
    if change.points is not None:
        points = change.points
        layers["points"] = Layer(points.frame, points=points.xyz + block.offset)
    if change.surface is not None and len(change.surface):
        layers["cells"] = _cells(change.surface, block.offset)
    if layers:
        write_geopackage(path, layers, block.crs)


def _cells(surface: SurfaceChange, offset: np.ndarray) -> Layer:
    """A square around each core point, in plan."""
    cores = surface.cores
    half = 0.5 * cores.spacing
    # Along the corridor, as the grid lies: two core points of one row tell the direction.
    away = np.column_stack([cores.station, cores.across])
    turn = _turn(cores.xyz[:, :2], away)
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) @ turn
    polygons = []
    for xyz in cores.xyz + offset:
        ring = np.empty((5, 3))
        ring[:, :2], ring[:, 2] = xyz[:2] + corners, xyz[2]
        polygons.append(ring)
    return Layer(surface.frame, polygons=polygons)


def _turn(xy: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Rows: directions in plan of station and across."""
    if len(xy) < 3:
        return np.eye(2)
    a, b = away - away.mean(axis=0), xy - xy.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    return left @ right


def _las(change: Change, path: Path, block) -> None:
    surface = change.surface
    if surface is None or not len(surface):
        return
    fields = {
        "change": surface.distance,
        "sigma": surface.sigma,
        "sampling": surface.sampling,
        "detection_95": surface.detection,
        "significant": surface.moved.astype(np.int32),
    }
    write_las(path, surface.cores.xyz + block.offset, fields, block.crs)
