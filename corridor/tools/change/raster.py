"""Changes as a raster for a GIS: a GeoTIFF, and its style for QGIS (needs the extra `gis`)."""

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.output import LOCAL_CRS, check_gis


def write_geotiff(
    path: Path,
    places: np.ndarray,
    spacing: float,
    bands: Mapping[str, np.ndarray],
    crs: str | None = None,
) -> None:
    """Writes numbers of square cells into a raster that lies north up, a band each, beside them
    `.qml`: how QGIS shows the first band.

    places (n, 2), m: centres of the cells, on a grid along x and y of this spacing; a pixel without
    one is NaN. bands: by name (n,). crs: as `EPSG:32647`, None for local metres. Raises InputError
    where rasterio is not installed, or where the places lie on no such grid.
    """
    check_gis(crs, ["rasterio"])
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    low = places.min(axis=0)
    step = (places - low) / spacing
    cell = np.round(step).astype(int)
    if np.abs(step - cell).max() > 1e-3 or len(np.unique(cell, axis=0)) < len(cell):
        raise InputError("a GeoTIFF needs cells on a grid along x and y: take the CSV table")
    width, height = cell.max(axis=0) + 1
    row, column = height - 1 - cell[:, 1], cell[:, 0]
    left, top = low[0] - 0.5 * spacing, low[1] + (height - 0.5) * spacing
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path, "w", driver="GTiff", width=width, height=height, count=len(bands),
            dtype="float64", nodata=np.nan, crs=crs or LOCAL_CRS, compress="deflate",
            transform=rasterio.Affine(spacing, 0.0, left, 0.0, -spacing, top),
        ) as raster:  # fmt: skip
            for number, (name, values) in enumerate(bands.items(), 1):
                band = np.full((height, width), np.nan)
                band[row, column] = values
                raster.write(band, number)
                raster.set_band_description(number, name)
    most = float(np.percentile(np.abs(next(iter(bands.values()))), 99))
    path.with_suffix(".qml").write_text(_style(max(most, 1e-6)), encoding="utf-8")


def on_north_grid(places: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres (m, 2) of the cells of a grid along x and y, and the row of `places` next to each.

    places (n, 2), m: centres of square cells of this spacing on a grid in another direction, as
    that of a local frame is in the grid of a map. A cell of the new grid belongs to the nearest of
    them (nearest neighbour) within half the diagonal of a cell, so no value is averaged.
    """
    from scipy.spatial import cKDTree

    low = np.floor(places.min(axis=0) / spacing)
    high = np.ceil(places.max(axis=0) / spacing)
    axes = [np.arange(a, b + 1) * spacing for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    reach = spacing / np.sqrt(2)
    distance, row = cKDTree(places).query(grid, distance_upper_bound=reach * (1 + 1e-9))
    return grid[np.isfinite(distance)], row[np.isfinite(distance)]


def _style(most: float) -> str:
    """A style of QGIS: what sank blue, what rose red, from -most to most; nothing white."""
    items = "".join(
        f'<item value="{s * most:.6g}" color="{colour}" label="{s * most:+.3f}" alpha="255"/>'
        for s, colour in ((-1.0, "#2166ac"), (0.0, "#f7f7f7"), (1.0, "#b2182b"))
    )
    return (
        '<!DOCTYPE qgis PUBLIC "http://mrcc.com/qgis.dtd" "SYSTEM">\n<qgis version="3.22">'
        '<pipe><rasterrenderer type="singlebandpseudocolor" band="1" opacity="1" '
        f'classificationMin="{-most:.6g}" classificationMax="{most:.6g}"><rastershader>'
        f'<colorrampshader colorRampType="INTERPOLATED" minimumValue="{-most:.6g}" '
        f'maximumValue="{most:.6g}">{items}</colorrampshader></rastershader></rasterrenderer>'
        "</pipe></qgis>\n"
    )
