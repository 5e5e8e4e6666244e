"""Projects as other versions, other folders and other units write them."""

import json
import re
import shutil
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pyproj
import pytest
from PIL import Image

from corridor.core.errors import InputError
from corridor.core.gnss import (
    Exposures,
    Local,
    metric,
    read_exposures,
)
from corridor.core.photographs import photographs_in
from corridor.core.preparation import plausibility_warnings
from corridor.tools.formats import export_project, prove, read_project
from corridor.tools.formats.frames import local_table
from corridor.tools.formats.ground import crs_of_line, in_frame
from corridor.tools.formats.placing import add_photographs, on_one_clock

from .conftest import exact_block
from .small_projects import block, write_all
from .test_adding import photograph
from .test_metashape_projects import _merged, _psx, exported  # noqa: F401
from .test_other_programs import alice_vision, open_mvg

FOOT = 1200 / 3937


@pytest.fixture(scope="module")
def projects(tmp_path_factory):
    return write_all(tmp_path_factory.mktemp("projects"))


def _edited(path, *pairs):
    text = path.read_text()
    for old, new in pairs:
        text = re.sub(old, new, text, flags=re.MULTILINE)
    path.write_text(text)


def _copied(source, folder):
    for file in source.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.mark.parametrize("name", [r"C:/Flug 1/100MEDIA/\1", r"img_\2.jpg"])
def test_bingo_names_match_without_folders_endings_and_case(projects, tmp_path, name):
    home = _copied(projects["pix4d"], tmp_path)
    _edited(home / "s_calibrated_camera_parameters.txt", (r"^(IMG_(\d+).JPG)", name))
    assert len(read_project(home).block.tie_points) == 92


def test_a_project_in_feet_becomes_one_in_metres(projects, tmp_path):
    home = _copied(projects["pix4d"], tmp_path)
    (home / "s_offset.xyz").write_text("1500000 600000 0")
    (home / "s_wkt.prj").write_text(pyproj.CRS("EPSG:2263").to_wkt("WKT1_GDAL"))
    project = read_project(home)
    centre = project.block.poses[:, :3] + project.block.offset
    given = block().poses[:, :3] + [1_500_000, 600_000, 0]
    assert centre == pytest.approx(FOOT * given, abs=1e-6)
    there, here = (
        pyproj.Transformer.from_crs(crs, "EPSG:4269", always_xy=True).transform(*places[0, :2])
        for crs, places in (("EPSG:2263", given), (project.block.crs, centre))
    )
    assert here == pytest.approx(there, abs=1e-10)
    assert any("counts in US survey foot" in note for note in project.notes)
    assert metric("EPSG:25832") == ("EPSG:25832", 1.0)


@pytest.mark.parametrize("layout", ["bundle/bundle.out", "x.bundle.out", "bundle.out"])
def test_names_of_bundler_are_found_where_programs_leave_them(projects, tmp_path, layout):
    home = projects["bundler"]
    path = tmp_path / layout
    path.parent.mkdir(exist_ok=True)
    path.write_bytes((home / "bundle.out").read_bytes())
    listed = {"bundle.out": "bundle.out.list.txt", "x.bundle.out": "x.list.txt"}
    (tmp_path / listed.get(layout, "list.txt")).write_bytes((home / "list.txt").read_bytes())
    assert list(read_project(path).block.images["image"]) == list(block().images["image"])


def test_a_size_that_does_not_hold_the_points_is_refused(projects):
    with pytest.raises(InputError, match=r"96% of the image points .* 1000 x 800 px"):
        read_project(projects["bundler"], size=(1000, 800))


def test_an_image_that_stands_twice_in_json_is_refused(projects, tmp_path):
    home = _copied(projects["opensfm"], tmp_path)
    _edited(home / "reconstruction.json", ("IMG_0003", "IMG_0000"))
    with pytest.raises(InputError, match="'IMG_0000.JPG' stands twice"):
        read_project(home)


@pytest.mark.parametrize("version", [(1, 0, 0), (1, 2, 0), (1, 2, 1)])
def test_older_files_of_alice_vision_have_pixels(tmp_path, version):
    made = exact_block(seed=4, images=6, points=30, k1=-0.05, k2=0.02, k3=0.01)
    path = alice_vision(made, tmp_path / "sfm.json", "radialk3")
    whole = json.loads(path.read_text())
    inner = whole["intrinsics"][0]
    focal = repr(float(inner.pop("focalLength")) * 4000 / 36)
    inner["pxFocalLength"] = focal if version < (1, 2, 0) else [focal, focal]
    if version < (1, 2, 1):
        x, y = map(float, inner["principalPoint"])
        inner["principalPoint"] = [repr(x + 2000), repr(y + 1500)]
    inner["type"] = "radial3"
    del inner["distortionType"]
    whole["version"] = [str(part) for part in version]
    path.write_text(json.dumps(whole))
    assert prove(read_project(path)).main.median < 1e-6


def test_equal_names_in_two_folders_of_open_mvg(tmp_path):
    made = exact_block(seed=4, images=6, points=30, k1=-0.05, k2=0.02, k3=0.01)
    path = open_mvg(made, tmp_path / "sfm_data.json", "pinhole_radial_k3")
    whole = json.loads(path.read_text())
    for k, view in enumerate(whole["views"]):
        data = view["value"]["ptr_wrapper"]["data"]
        data["local_path"], data["filename"] = f"10{k // 3}MEDIA", f"DJI_{k % 3}.JPG"
    path.write_text(json.dumps(whole))
    names = list(read_project(path).block.images["image"])
    assert names == [f"10{k // 3}MEDIA/DJI_{k % 3}.JPG" for k in range(6)]


def _in_components(chunk, transforms):
    """Two components, of four and two cameras, with a transform where it says so."""
    whole = chunk.find("transform")
    parts = ElementTree.SubElement(chunk, "components")
    for number, has in enumerate(transforms):
        part = ElementTree.SubElement(parts, "component", id=str(number))
        if has:
            part.append(whole)
    for k, camera in enumerate(chunk.findall(".//camera")):
        camera.set("component_id", str(int(k >= 4)))
    if any(transforms):
        chunk.remove(whole)


@pytest.mark.parametrize("transforms", [(True, False), (False, False), (True, True)])
def test_components_without_a_place_do_not_get_that_of_others(exported, tmp_path, transforms):  # noqa: F811
    folder, made = exported
    _, chunk = _merged(folder)
    chunk.find("transform/scale").text = "2"
    _in_components(chunk, transforms)
    project = read_project(_psx(tmp_path, chunk, made))
    posed = np.isfinite(project.block.poses).all(axis=1)
    assert posed.tolist() == [True] * 4 + [all(transforms)] * 2
    assert project.block.poses[:4, :3] == pytest.approx(2 * made.poses[:4, :3], abs=1e-6)
    assert prove(project).verdict == "proved"
    assert any("2 of 6 aligned cameras" in w for w in project.warnings) != all(transforms)


def test_two_markers_of_one_label_stay_two(exported, tmp_path):  # noqa: F811
    folder, _ = exported
    root, chunk = _merged(folder)
    for marker in chunk.findall("markers/marker")[:2]:
        marker.set("label", "point")
    ElementTree.ElementTree(root).write(tmp_path / "all.xml")
    block = read_project(tmp_path / "all.xml").block
    assert [name for name in block.ground["point"] if "(" in name] == ["point (0)", "point (1)"]


def test_a_copy_of_a_psx_and_capital_endings_do_not_hide_the_project(exported, tmp_path):  # noqa: F811
    folder, made = exported
    _, chunk = _merged(folder)
    path = _psx(tmp_path, chunk, made)
    path.with_name("old.psx").write_bytes(path.read_bytes())
    path.rename(path.with_suffix(".PSX"))
    assert len(read_project(tmp_path).block.images) == 6
    with pytest.raises(InputError, match="name river.psx"):
        read_project(tmp_path / "river.files")


def test_photographs_of_two_folders_keep_their_own_times_and_positions(tmp_path):
    made = exact_block(k1=-0.05, k2=0.02)
    names = [f"10{k // 6}MEDIA/DJI_{k % 6:04d}.JPG" for k in range(12)]
    here = made.copy()
    new = dict(zip(made.images["image"], names, strict=True))
    here.images["image"] = names
    for table in (here.tie_points, here.marks):
        table["image"] = table["image"].cat.rename_categories(new)
    export_project(here, "colmap", tmp_path / "model")
    for k, (name, place) in enumerate(zip(names, made.poses[:, :3], strict=True)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        photograph(tmp_path / name, k, place)
        # Neither a raw picture beside it nor a picture of something else is in the way.
        (tmp_path / name).with_suffix(".DNG").write_bytes(b"II*\0")
    Image.new("L", (8, 8)).save(tmp_path / "100MEDIA" / "screen.png")
    assert len(photographs_in(tmp_path)) == 13
    project, _, exposures = add_photographs(read_project(tmp_path / "model"), tmp_path)
    time = project.block.images.set_index("image")["time_s"]
    assert time[names].tolist() == (37200.25 + 2.0 * np.arange(12)).tolist()
    assert sorted(project.block.gnss["image"]) == sorted(exposures.table["image"]) == names
    at = project.block.images.set_index("image").loc[project.block.gnss["image"], ["x", "y", "z"]]
    assert np.abs(at.to_numpy() - project.block.gnss[["x", "y", "z"]].to_numpy()).max() < 0.01
    # Times alone, for `corridor gnss`.
    (tmp_path / "100MEDIA" / "screen.png").unlink()
    assert list(read_exposures(tmp_path).table["image"]) == names


def test_times_of_folders_on_different_clocks_are_not_joined(tmp_path):
    table = pd.DataFrame({"image": ["a"], "time_s": [5.0]})
    first = Exposures(table, "2024-06-24", "UTC", None, tmp_path)
    later = on_one_clock([first, replace(first, day="2024-06-25")])
    assert later.table["time_s"].tolist() == [5.0, 86405.0] and later.day == "2024-06-24"
    with pytest.raises(InputError, match="in different systems"):
        on_one_clock([first, replace(first, time_system="GPST")])


def test_a_gcp_list_in_a_system_in_words_is_read():
    text = pyproj.CRS("EPSG:25832").to_wkt("WKT1_ESRI")
    named = pyproj.CRS("EPSG:25832").to_wkt()
    assert " / " in named and crs_of_line(named) == named and crs_of_line(text) == text


def test_heights_in_feet_become_metres_in_a_block_in_a_grid():
    made = replace(block(), crs="EPSG:32118")
    places = in_frame(made, np.array([[984250.0, 190000.0, 100.0]]), "EPSG:2263", "points")
    assert places[0] == pytest.approx([300000.0, 190000 * FOOT, 100 * FOOT], abs=1e-6)


@pytest.mark.parametrize("unit", [1.0, FOOT])
def test_heights_beside_a_grid_in_feet_are_those_of_the_mapped_centres(tmp_path, unit):
    made, place = exact_block(seed=6, images=6, points=30), Local(40.7, -74.0, 30.0)
    made.extra["local_frame"] = local_table(place)
    export_project(made, "metashape", tmp_path)
    root = ElementTree.parse(tmp_path / "cameras.xml").getroot()
    root.find("chunk/reference").text = pyproj.CRS("EPSG:2263").to_wkt("WKT1_GDAL")
    places = place.to_crs(made.poses[:, :3], "EPSG:2263") / [1, 1, unit]
    for camera, xyz in zip(root.iter("camera"), places, strict=True):
        told = dict(zip("xyz", map(repr, xyz.tolist()), strict=True))
        ElementTree.SubElement(camera, "reference", enabled="true", **told)
    ElementTree.ElementTree(root).write(tmp_path / "cameras.xml")
    block = read_project(tmp_path / "cameras.xml").block
    assert np.abs(block.gnss[["x", "y", "z"]].to_numpy() - block.poses[:, :3]).max() < 1e-4


@pytest.mark.parametrize(
    ("form", "file"), [("micmac", "GroundMarks.xml"), ("opensfm", "ground_control_points.json")]
)
def test_marks_in_images_of_another_case_are_not_lost(projects, tmp_path, form, file):
    shutil.copytree(projects[form], tmp_path / "project")
    _edited(tmp_path / "project" / file, (r"IMG_(\d+)\.JPG", r"img_\1.jpg"))
    assert len(read_project(tmp_path / "project").block.marks) == 13


def test_exponents_of_fortran_are_read(projects, tmp_path):
    home = _copied(projects["pix4d"], tmp_path)
    for file in ("s_calibrated_camera_parameters.txt", "s_tp_bingo.txt"):
        text = (home / file).read_text()
        digits = re.compile(r"(?<![\w.])-?\d+\.\d+(?![\w.])")
        made = digits.sub(lambda found: f"{float(found[0]):.16E}".replace("E", "D"), text)
        assert "D-0" in made
        (home / file).write_text(made)
    assert prove(read_project(home)).main.median < 1e-5


def test_a_block_in_a_grid_of_feet_is_told():
    made = replace(block(), crs="EPSG:2263", offset=np.array([984_250.0, 190_000.0, 0.0]))
    assert any("counts in US survey foot" in told for told in plausibility_warnings(made))


@pytest.mark.parametrize("form", ["colmap", "pix4d"])
def test_files_in_capitals_are_the_same_files(form, projects, tmp_path):
    """As a card, or a share of another system, hands them on."""
    home = _copied(projects[form], tmp_path)
    plain = read_project(home)
    for file in [file for file in home.rglob("*") if file.is_file()]:
        file.rename(file.with_name(file.name.upper()))
    again = read_project(home)
    assert again.form == form
    assert again.block.images.equals(plain.block.images)
    assert len(again.block.tie_points) == len(plain.block.tie_points) > 0
    assert again.block.ground.equals(plain.block.ground)
