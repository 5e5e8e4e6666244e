"""Exports in coordinates of a grid: each point through PROJ, read again where it was."""

import re

import numpy as np
import pytest

from corridor import cli
from corridor.core.errors import InputError
from corridor.core.gnss import (
    Local,
    local_of,
)
from corridor.tools.formats import export_project, prove, read_project
from corridor.tools.formats.frames import local_table, moved

from .conftest import exact_block

PLACE = Local(49.01, 8.55, 110.0)
CRS = "EPSG:25832"


@pytest.fixture(scope="module")
def block():
    """Exact, on Earth, with an antenna position for each image."""
    made = exact_block(seed=3, k1=-0.05, k2=0.02, cx=1999.5, cy=1499.5)
    made.extra["local_frame"] = local_table(PLACE)
    positions = made.images[["image", "x", "y", "z"]].copy()
    made.gnss = positions.assign(sx=0.01, sy=0.02, sz=0.03)
    return made


@pytest.mark.parametrize("form", ["colmap", "colmap-text", "bundler", "micmac"])
def test_poses_go_out_in_the_grid(block, tmp_path, form):
    made = export_project(block, form, tmp_path / "project", to_crs=CRS)
    assert f"coordinates are in {CRS}" in made.sentences
    wanted = moved(block, CRS)
    again = read_project(tmp_path / "project").block
    # A format without an offset has coordinates less hundreds of metres, and says so.
    apart = again.poses[:, :3] + again.offset - wanted.poses[:, :3]
    shift = np.round(np.median(apart, axis=0) / 100) * 100
    assert np.abs(apart - shift).max() < 1e-3, (apart, made.sentences)


def test_metashape_gets_its_references_in_the_grid_and_comes_back(block, tmp_path):
    """A chunk in a projected system: geocentric transform, eastings and northings as references."""
    export_project(block, "metashape", tmp_path / "project", to_crs=CRS)
    text = (tmp_path / "project" / "cameras.xml").read_text(encoding="utf-8")
    assert 'PROJCS["ETRS89 / UTM zone 32N"' in text
    east = [float(x) for x in re.findall(r'<reference x="([0-9.]+)"', text)]
    wanted = moved(block, CRS)
    np.testing.assert_allclose(east, wanted.numbers("gnss", "x")[:, 0], atol=1e-6)
    project = read_project(tmp_path / "project")
    assert prove(project).main.median < 1e-4
    local = local_of(project.block)
    back = PLACE.from_geographic(local.to_geographic(project.block.poses[:, :3]))
    np.testing.assert_allclose(back, block.poses[:, :3], atol=1e-6)
    np.testing.assert_allclose(project.block.gnss_sigma(), block.gnss_sigma(), atol=1e-4)


def test_a_block_in_a_grid_keeps_its_system_in_metashape(block, tmp_path):
    """It went out as local metres without a system before."""
    export_project(moved(block, CRS), "metashape", tmp_path / "project")
    project = read_project(tmp_path / "project")
    assert local_of(project.block) is not None and prove(project).main.median < 0.05


def test_opensfm_keeps_the_place_of_a_block_in_a_grid_and_takes_no_grid(block, tmp_path):
    export_project(moved(block, CRS), "opensfm", tmp_path / "project")
    local = local_of(read_project(tmp_path / "project").block)
    assert abs(local.lat_deg - PLACE.lat_deg) < 0.01 and abs(local.lon_deg - PLACE.lon_deg) < 0.01
    with pytest.raises(InputError, match="leave --to-crs out"):
        export_project(block, "opensfm", tmp_path / "other", to_crs=CRS)


def test_without_a_place_on_earth_it_is_refused(tmp_path, capsys):
    bare = exact_block(seed=3, k1=-0.05)
    bare.write(tmp_path / "block")
    words = [
        "export",
        "colmap",
        str(tmp_path / "block"),
        "-o",
        str(tmp_path / "p"),
        "--to-crs",
        CRS,
    ]
    assert cli.main(words) == 2
    assert "where on Earth" in capsys.readouterr().err


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:2251", "EPSG:99999"])
def test_a_system_that_is_not_in_metres_of_a_grid_is_refused(block, tmp_path, crs):
    with pytest.raises(InputError, match="metres|known"):
        export_project(block, "colmap", tmp_path / "p", to_crs=crs)


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:3395"])
def test_metres_of_a_web_map_are_none(block, crs):
    """Mercator's scale is 1 / cos of the latitude: 1.52 at 49 degrees."""
    with pytest.raises(InputError, match=r"1\.52\d times as long .* as EPSG:32632"):
        moved(block, crs)
    assert moved(block, "EPSG:3035").crs == "EPSG:3035"


def test_a_system_of_ground_points_without_a_file_is_refused(block, tmp_path, capsys):
    export_project(block, "colmap", tmp_path / "project")
    words = ["import", "auto", str(tmp_path / "project"), "--ground-crs", CRS]
    assert cli.main([*words, "-o", str(tmp_path / "block")]) == 2
    assert "give the file with --ground" in capsys.readouterr().err
