"""Tables with a geometry as a GeoPackage, which QGIS and every other GIS opens.

Needs `pyogrio` (the extra `gis`); geometries are written as well-known binary, so nothing else.
"""

from __future__ import annotations

import errno
import os
import sqlite3
import struct
import tempfile
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.report.gis import check_gis

# What a block without a CRS is in: metres on a plane, wherever.
_LOCAL = 'LOCAL_CS["local metres",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'


@dataclass(frozen=True)
class Layer:
    """One layer: table (n rows) and a geometry for each.

    points (n, 3), or polygons: (n) arrays (k, 2) or (k, 3), closed or not, or lines alike; m, in
    the system of the layer.
    """

    table: pd.DataFrame
    points: np.ndarray | None = None
    polygons: list[np.ndarray] | None = None
    lines: list[np.ndarray] | None = None

    @property
    def kind(self) -> str:
        """Name of the geometry."""
        if self.points is not None:
            return "Point Z"
        return "Polygon Z" if self.polygons is not None else "LineString Z"

    @property
    def binary(self) -> list[bytes]:
        """Well-known binary of each row."""
        if self.points is not None:
            return [_point(p) for p in self.points]
        if self.polygons is not None:
            return [_polygon(p) for p in self.polygons]
        return [_line(p) for p in self.lines or []]


def write_geopackage(path: Path, layers: Mapping[str, Layer], crs: str | None = None) -> None:
    """Writes layers into one new file; crs: as `EPSG:32647`, None for local metres.

    Raises InputError where pyogrio is not installed, or knows no such CRS.
    """
    check_gis(crs, ["pyogrio"])
    from pyogrio import raw

    with tempfile.TemporaryDirectory() as folder:
        # SQLite wants to lock its file, which not every place a result is written to lets it do.
        made = Path(folder) / "layers.gpkg"
        for number, (name, layer) in enumerate(layers.items()):
            fields = [column for column in layer.table.columns]
            data = [_values(layer.table[column]) for column in fields]
            raw.write(
                str(made),
                np.array(layer.binary, dtype=object),
                data,
                np.array(fields, dtype=object),
                layer=name,
                driver="GPKG",
                geometry_type=layer.kind,
                crs=crs or _LOCAL,
                append=number > 0,
            )
        _check_whole(made, len(layers))
        path.write_bytes(made.read_bytes())


def _check_whole(made, layers):
    """GDAL says nothing of a disk that is full when it closes its file: the indices are missing."""
    asked = "SELECT count(*) FROM gpkg_extensions WHERE extension_name = 'gpkg_rtree_index'"
    with closing(sqlite3.connect(made)) as file:
        try:
            whole = file.execute(asked).fetchone()[0] == layers
        except sqlite3.DatabaseError:
            whole = False
    if not whole:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(made.parent))


def _values(column: pd.Series) -> np.ndarray:
    values = column.to_numpy()
    if values.dtype.kind in "iuf":
        return values
    if values.dtype.kind == "b":
        return values.astype(np.int32)
    return column.astype(str).to_numpy(dtype=object)


def _xyz(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, dtype=float)
    if points.shape[-1] == 2:
        points = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
    return points


def _point(point: np.ndarray) -> bytes:
    return struct.pack("<BI3d", 1, 1001, *_xyz(point))


def _line(points: np.ndarray) -> bytes:
    points = _xyz(points)
    return struct.pack("<BII", 1, 1002, len(points)) + points.astype("<f8").tobytes()


def _polygon(points: np.ndarray) -> bytes:
    points = _xyz(points)
    if not np.array_equal(points[0], points[-1]):
        points = np.concatenate([points, points[:1]])
    head = struct.pack("<BIII", 1, 1003, 1, len(points))
    return head + points.astype("<f8").tobytes()
