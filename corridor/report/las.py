"""Points with numbers of their own as LAS or LAZ, which CloudCompare shows as scalar fields.

Needs `laspy` (the extra `gis`); LAZ needs `lazrs` too, which comes with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from corridor.report.gis import check_gis

# Steps of the stored coordinates: a tenth of a millimetre.
STEP_M = 1e-4


def write_las(
    path: Path, xyz: np.ndarray, fields: Mapping[str, np.ndarray], crs: str | None = None
) -> None:
    """Writes points (n, 3), m, with fields of floating numbers; `.laz` is compressed.

    crs: as `EPSG:32647`; left out where unknown. Raises InputError where laspy is not installed.
    """
    check_gis(crs, ["laspy"])
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, STEP_M)
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
