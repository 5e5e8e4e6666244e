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
    """The square around each core point, closed, at its height."""
    plan = surface.cores.cells[:, [0, 1, 2, 3, 0]]
    height = np.broadcast_to(surface.cores.xyz[:, None, 2:], (len(plan), 5, 1))
    return Layer(surface.frame, polygons=list(np.concatenate([plan, height], axis=2) + offset))


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
