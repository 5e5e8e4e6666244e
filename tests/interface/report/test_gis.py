"""What goes to a GIS is read back by programs that share no line with what wrote it."""

import signal
import sqlite3
import struct
import sys

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.camera import project
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.output import Layer, write_geopackage
from corridor.core.simulation import add_noise
from corridor.interface.cli import main

OFFSET = np.array([717541.0, 1606017.0, 100.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    block = corridor_block(images=9, strips=3, observations_per_image=60, seed=4)
    block = add_noise(block, tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=4)
    block.crs, block.offset = "EPSG:32647", OFFSET
    path = tmp_path_factory.mktemp("blocks") / "small"
    block.write(path)
    return path


@pytest.fixture(scope="module")
def saved(folder, tmp_path_factory):
    pytest.importorskip("pyogrio")
    pytest.importorskip("laspy")
    adjustment = corridor.adjust(folder)
    out = tmp_path_factory.mktemp("results") / "out"
    written = adjustment.save(out, gis=True)
    assert {out / "adjustment.gpkg", out / "adjustment.las"} <= set(written)
    return adjustment, out


def rows(out, layer, columns):
    """Columns and geometries of a layer: a GeoPackage is a SQLite file."""
    with sqlite3.connect(out / "adjustment.gpkg") as file:
        table, srs = file.execute(
            "select table_name, srs_id from gpkg_geometry_columns where table_name = ?", (layer,)
        ).fetchone()
        assert srs == 32647
        found = file.execute(f"select {columns}, geom from {table} order by fid").fetchall()
    return [row[:-1] for row in found], [coordinates(row[-1]) for row in found]


def coordinates(blob):
    """Kind and coordinates (n, 3) of a geometry: well-known binary behind a short header."""
    assert blob[:2] == b"GP"
    wkb = blob[8 + {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}[(blob[3] >> 1) & 7] :]
    kind = struct.unpack_from("<I", wkb, 1)[0]
    begin = {1001: 5, 1002: 9, 1003: 13}[kind]
    return kind, np.frombuffer(wkb[begin:], dtype="<f8").reshape(-1, 3)


def test_points_lie_where_they_were_adjusted_in_the_system_of_the_block(saved):
    adjustment, out = saved
    told, places = rows(out, "points", "point, kind, rays, sx, sy, sz")
    table = adjustment.points
    assert [row[0] for row in told] == table["point"].tolist()
    assert {kind for kind, _ in places} == {1001}
    wanted = table[["x", "y", "z"]].to_numpy() + OFFSET
    np.testing.assert_allclose(np.concatenate([p for _, p in places]), wanted, rtol=0, atol=1e-9)
    np.testing.assert_allclose([row[3:] for row in told], adjustment.point_sigma)


def test_check_vectors_point_from_the_surveyed_to_the_adjusted_place(saved, folder):
    adjustment, out = saved
    told, lines = rows(out, "check_vectors", "point, dx, dy, dz, times")
    assert [row[0] for row in told] == adjustment.check_points["point"].tolist()
    surveyed = corridor.read(folder).ground.set_index("point")[["x", "y", "z"]]
    for (point, *off, times), (kind, (begin, end)) in zip(told, lines, strict=True):
        assert kind == 1002 and times in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
        np.testing.assert_allclose(begin, surveyed.loc[point] + OFFSET, rtol=0, atol=1e-9)
        np.testing.assert_allclose((end - begin) / times, off, rtol=0, atol=1e-8)


def test_cameras_stand_where_they_were_adjusted(saved):
    adjustment, out = saved
    told, places = rows(out, "cameras", "image, flight, sx, sy, sz, s_rx")
    wanted = adjustment.poses
    assert [row[0] for row in told] == wanted["image"].tolist()
    np.testing.assert_allclose(
        np.concatenate([p for _, p in places]), wanted[["x", "y", "z"]] + OFFSET, atol=1e-9, rtol=0
    )
    np.testing.assert_allclose([row[2:5] for row in told], wanted[["sx", "sy", "sz"]])


def test_the_corners_of_a_footprint_are_seen_in_the_corners_of_the_picture(saved):
    adjustment, out = saved
    told, rings = rows(out, "footprints", "image")
    block = adjustment.block
    camera = next(iter(block.cameras.values()))
    right, low = camera.width - 1.0, camera.height - 1.0
    assert [row[0] for row in told] == block.images["image"].tolist()
    rotation = rotation_from_quaternion(block.poses[:, 3:])
    for k, (kind, ring) in enumerate(rings):
        assert kind == 1003 and np.array_equal(ring[0], ring[-1]) and len(ring) == 5
        seen = project(ring[:4] - OFFSET, block.poses[k, :3], rotation[k], camera.interior)
        # Metres of seven digits before the point: 1e-9 m, at 50 m and 8,000 px some 1e-6 px.
        np.testing.assert_allclose(seen, [[0, 0], [right, 0], [right, low], [0, low]], atol=1e-4)


def test_the_las_file_has_the_points_with_their_sigmas(saved):
    """LAS 1.4, public header block: bounds at byte 179, count of points at 247."""
    adjustment, out = saved
    data = (out / "adjustment.las").read_bytes()
    assert data[:4] == b"LASF"
    assert struct.unpack("<Q", data[247:255])[0] == len(adjustment.points)
    high, low = struct.unpack("<2d", data[179:195])
    x = adjustment.points["x"] + OFFSET[0]
    assert (low, high) == (pytest.approx(x.min(), abs=1e-4), pytest.approx(x.max(), abs=1e-4))
    laspy = pytest.importorskip("laspy")
    read = laspy.read(out / "adjustment.las")
    assert read.header.parse_crs().to_epsg() == 32647
    np.testing.assert_array_equal(read["sz"], adjustment.point_sigma[:, 2])
    assert np.count_nonzero(read["mark"]) == (adjustment.points["kind"] == "mark").sum()


def test_files_for_a_gis_are_written_when_asked_for_alone(saved, tmp_path):
    adjustment, _ = saved
    written = adjustment.save(tmp_path / "out")
    assert not [path for path in written if path.suffix in (".gpkg", ".las")]


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of files there")
def test_a_disk_that_is_full_at_the_end_leaves_no_geopackage(tmp_path):
    """GDAL writes its indices as it closes the file, and keeps to itself that it could not."""
    pytest.importorskip("pyogrio")
    import resource

    layer = {"points": Layer(pd.DataFrame({"point": ["a", "b"]}), np.ones((2, 3)))}
    write_geopackage(tmp_path / "whole.gpkg", layer)
    most = (tmp_path / "whole.gpkg").stat().st_size - 100
    before = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[0][1]))
    try:
        with pytest.raises(OSError, match="space"):
            write_geopackage(tmp_path / "half.gpkg", layer)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before[0])
        signal.signal(signal.SIGXFSZ, before[1])
    assert not (tmp_path / "half.gpkg").exists()


@pytest.mark.parametrize("verb", ["adjust", "diagnose"])
@pytest.mark.parametrize("package", ["pyogrio", "laspy"])
def test_without_the_extra_it_is_said_before_the_work(
    folder, tmp_path, capsys, monkeypatch, verb, package
):
    if package == "laspy":
        pytest.importorskip("pyogrio")
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr(corridor, verb, None)  # work would be a fault
    assert main([verb, str(folder), "-o", str(tmp_path / "out"), "--gis"]) == 2
    assert f"needs {package}: pip install 'corridor[gis]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_system_that_nobody_knows_is_said_before_the_work(folder, tmp_path, capsys, monkeypatch):
    pytest.importorskip("pyogrio")
    block = corridor.read(folder)
    block.crs = "EPSG:999999"
    block.write(tmp_path / "block")
    monkeypatch.setattr(corridor, "adjust", None)
    words = ["adjust", str(tmp_path / "block"), "-o", str(tmp_path / "out"), "--gis"]
    assert main(words) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "crs = 'EPSG:999999' is not a known coordinate system" in last


@pytest.mark.slow
def test_a_diagnosis_writes_what_its_block_holds(folder, tmp_path):
    pytest.importorskip("pyogrio")
    diagnosis = corridor.diagnose(folder, only=["clock_offset", "focal"])
    written = diagnosis.save(tmp_path / "out", counterparts=19, gis=True)
    assert tmp_path / "out" / "diagnosis.las" in written
    with sqlite3.connect(tmp_path / "out" / "diagnosis.gpkg") as file:
        count = file.execute("select count(*) from points").fetchone()[0]
    assert count == len(corridor.read(tmp_path / "out" / "block").points)
