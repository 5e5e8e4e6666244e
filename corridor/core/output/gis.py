"""Results for a GIS and for programs of point clouds: GeoPackage, and LAS or LAZ.

A GeoPackage opens in QGIS and every other GIS; LAS shows in CloudCompare, with numbers of points
as scalar fields. Needs the extra `gis`: `pyogrio` (geometries are written as well-known binary, so
nothing else), `rasterio`, `laspy`, and for LAZ `lazrs`, which comes with it.
"""

import errno
import os
import sqlite3
import struct
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.errors import InputError

# Packages of the extra `gis`, and what they write.
_WRITERS = {"pyogrio": "a GeoPackage", "laspy": "LAS", "rasterio": "a GeoTIFF"}
# What a block without a CRS is in: metres on a plane, wherever.
LOCAL_CRS = 'LOCAL_CS["local metres",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'
# Steps of the coordinates in LAS: a tenth of a millimetre.
_STEP_M = 1e-4
# Geometries and their numbers in well-known binary.
_KINDS = {"Point Z": 1001, "LineString Z": 1002, "Polygon Z": 1003}


@dataclass(frozen=True)
class Layer:
    """One layer: table (n rows) and a geometry for each.

    places: (n, 3) points, or n lines or polygons (k, 2) or (k, 3), polygons closed or not; m, in
    the system of the layer. kind: `Point Z`, `LineString Z` or `Polygon Z`.
    """

    table: pd.DataFrame
    places: Sequence[np.ndarray] | np.ndarray
    kind: str = "Point Z"


def check_gis(crs: str | None, packages: Iterable[str] = ("pyogrio", "laspy")) -> None:
    """Raises InputError where a package of the extra `gis` is missing, or nobody knows the CRS.

    crs: of the block, as `EPSG:32647`; None for local metres.
    """
    for package in packages:
        if find_spec(package) is None:
            raise InputError(
                f"{_WRITERS[package]} needs {package}: pip install 'corridor[gis]', or take the "
                "CSV tables"
            )
    if crs is None:
        return
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        CRS.from_user_input(crs)
    except CRSError:
        raise InputError(
            f"block.toml: crs = {crs!r} is not a known coordinate system; write it as EPSG:2154, "
            "or leave it out"
        ) from None


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
            fields = list(layer.table)
            binary = [_well_known(layer.kind, places) for places in layer.places]
            raw.write(
                str(made),
                np.array(binary, dtype=object),
                [_values(layer.table[column]) for column in fields],
                np.array(fields, dtype=object),
                layer=name,
                driver="GPKG",
                geometry_type=layer.kind,
                crs=crs or LOCAL_CRS,
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


def _well_known(kind: str, places: np.ndarray) -> bytes:
    """Well-known binary of a point (3,), or of a line or polygon (k, 2 or 3)."""
    xyz = np.atleast_2d(np.asarray(places, dtype=float))
    xyz = np.pad(xyz, ((0, 0), (0, 3 - xyz.shape[1])))
    if kind == "Polygon Z" and not np.array_equal(xyz[0], xyz[-1]):
        xyz = np.concatenate([xyz, xyz[:1]])
    counts = {"Point Z": (), "LineString Z": (len(xyz),), "Polygon Z": (1, len(xyz))}[kind]
    head = struct.pack(f"<BI{len(counts)}I", 1, _KINDS[kind], *counts)
    return head + xyz.astype("<f8").tobytes()


def write_las(
    path: Path, xyz: np.ndarray, fields: Mapping[str, np.ndarray], crs: str | None = None
) -> None:
    """Writes points (n, 3), m, with fields of floating numbers; `.laz` is compressed.

    crs: as `EPSG:32647`; left out where unknown. Raises InputError where laspy is not installed.
    """
    check_gis(crs, ["laspy"])
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, _STEP_M)
    header.offsets = np.floor(xyz.min(axis=0))
    for name, values in fields.items():
        kind = np.int32 if np.asarray(values).dtype.kind in "iub" else np.float64
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
    if crs is not None:
        from pyproj import CRS

        header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.asarray(xyz, float).T
    for name, values in fields.items():
        las[name] = np.asarray(values)
    las.write(str(path))
