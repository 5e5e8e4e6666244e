"""What is written is read back by programs that share no line with it."""

import copy
import json
import sqlite3
import struct

import numpy as np
import pytest
from made import flown

import corridor
from corridor.core.gnss import (
    Local,
    in_world,
)
from corridor.tools.change import save
from corridor.tools.formats.frames import local_table


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    pytest.importorskip("pyogrio")
    pytest.importorskip("laspy")
    first, second = flown(10), flown(11)
    for block in (first, second):
        block.crs, block.offset = "EPSG:32647", np.array([717541.0, 1606017.0, 0.0])
    found = corridor.change(first, second, camera=False, same_ties=True, spacing=12.0)
    folder = tmp_path_factory.mktemp("change") / "out"
    save(found, folder)
    return found, folder


def test_the_page_says_one_sentence_first(saved):
    found, folder = saved
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.index(corridor.change.verdict_sentence(found)[:40]) < page.index("<table")
    told = json.loads((folder / "change.json").read_text(encoding="utf-8"))
    assert told["verdict"] == found.verdict and told["not_written"] == []


def test_sqlite_finds_points_and_cells_in_their_system(saved):
    """A GeoPackage is a SQLite file: two layers, well-known binary behind a short header."""
    found, folder = saved
    with sqlite3.connect(folder / "change.gpkg") as file:
        assert file.execute("select distinct srs_id from gpkg_geometry_columns").fetchall() == [
            (32647,)
        ]
        rows = file.execute("select point, dz, sz, geom from points").fetchall()
        cells = file.execute("select count(*) from cells").fetchone()[0]
    assert cells == len(found.surface)
    assert [row[0] for row in rows] == list(found.points.names)
    np.testing.assert_allclose([row[2] for row in rows], found.points.sigma[:, 2])
    header = 8 + {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}[(rows[0][3][3] >> 1) & 7]
    kind, *xyz = struct.unpack("<I3d", rows[0][3][header + 1 : header + 29])
    assert kind == 1001
    np.testing.assert_allclose(xyz, found.points.xyz[0] + [717541.0, 1606017.0, 0.0])


def test_the_las_header_counts_and_bounds_the_core_points(saved):
    """LAS 1.4, public header block: bounds at byte 179, count of points at 247."""
    found, folder = saved
    data = (folder / "change.las").read_bytes()
    assert data[:4] == b"LASF"
    assert struct.unpack("<Q", data[247:255])[0] == len(found.surface)
    high_x, low_x = struct.unpack("<2d", data[179:195])
    x = found.surface.cores.xyz[:, 0] + 717541.0
    assert low_x == pytest.approx(x.min(), abs=1e-4) and high_x == pytest.approx(x.max(), abs=1e-4)
    assert b"change" in data and b"detection_95" in data


def test_the_raster_is_read_back_as_it_was_computed(saved):
    """By rasterio: in its system, north up, every cell where its core point is, NaN elsewhere."""
    rasterio = pytest.importorskip("rasterio")
    found, folder = saved
    surface = found.surface
    with rasterio.open(folder / "change.tif") as raster:
        assert raster.crs.to_epsg() == 32647 and raster.descriptions[:2] == ("change", "sigma")
        assert raster.transform.b == raster.transform.d == 0.0 > raster.transform.e
        bands = raster.read()
        rows, columns = rasterio.transform.rowcol(
            raster.transform, *(surface.cores.xyz[:, :2] + [717541.0, 1606017.0]).T
        )
    for band, values in zip(
        bands, (surface.distance, surface.total, surface.detection), strict=True
    ):
        np.testing.assert_array_equal(band[rows, columns], values)
        assert np.isfinite(band).sum() == len(values)
        assert np.nanmean(band) == pytest.approx(values.mean(), rel=1e-12, abs=1e-15)
        assert np.nanstd(band) == pytest.approx(values.std(), rel=1e-12)
    assert "singlebandpseudocolor" in (folder / "change.qml").read_text(encoding="utf-8")


def test_las_knows_its_system(saved):
    laspy = pytest.importorskip("laspy")
    assert laspy.read(saved[1] / "change.las").header.parse_crs().to_epsg() == 32647


def test_the_raster_of_a_local_frame_lies_on_the_map(saved, tmp_path):
    """Each pixel has the value of the cell below it, in the system that the GeoPackage has too."""
    rasterio = pytest.importorskip("rasterio")
    found = copy.deepcopy(saved[0])
    for adjustment in found.compared.adjustments:
        block = adjustment.block
        # 2 degrees east of the middle of its zone the axes are turned by 1.6 degrees.
        block.crs, block.offset = None, np.zeros(3)
        block.extra["local_frame"] = local_table(Local(53.5, 11.0, 0.0), "EPSG:25832")
    save(found, tmp_path / "out")
    surface = found.surface
    block = found.compared.adjustments[0].block
    places = in_world(block, surface.cores.xyz)
    spacing = surface.cores.spacing
    with rasterio.open(tmp_path / "out" / "change.tif") as raster:
        assert raster.crs.to_epsg() == 25832 and raster.res == (spacing, spacing)
        change = raster.read(1)
        rows, columns = np.nonzero(np.isfinite(change))
        centres = np.column_stack(rasterio.transform.xy(raster.transform, rows, columns))
    away = np.linalg.norm(centres[:, None] - places[None, :, :2], axis=2)
    np.testing.assert_array_equal(change[rows, columns], surface.distance[away.argmin(axis=1)])
    assert away.min(axis=1).max() <= spacing / np.sqrt(2) * (1 + 1e-9)
    # As many pixels as cells, but for the border.
    assert abs(len(rows) - len(surface)) <= 0.2 * len(surface) + 4
    assert len(np.unique(away.argmin(axis=1))) > 0.8 * len(surface)
