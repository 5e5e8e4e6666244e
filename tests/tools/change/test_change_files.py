"""What is written is read back by programs that share no line with it."""

import json
import sqlite3
import struct

import numpy as np
import pytest
from made import flown

import corridor
from corridor.tools.change import save


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
