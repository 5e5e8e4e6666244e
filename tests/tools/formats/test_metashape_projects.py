"""Metashape as it is saved and as real cameras are: .psx, rigs, groups, disabled cameras."""

import copy
import struct
import zipfile
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.tools.formats import export_project, prove, read_project

from .conftest import exact_block


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """cameras.xml and markers.xml of an exact block, and the block."""
    home = tmp_path_factory.mktemp("metashape")
    block = exact_block(seed=6, images=6, points=30, k1=-0.05, cx=1999.5, cy=1499.5)
    export_project(block, "metashape", home / "xml")
    return home / "xml", block


def _merged(folder):
    """One document with cameras and markers, as a project has it."""
    cameras = ElementTree.parse(folder / "cameras.xml").getroot()
    markers = ElementTree.parse(folder / "markers.xml").getroot()
    chunk = cameras.find("chunk")
    for tag in ("markers", "frames"):
        chunk.append(markers.find(f"chunk/{tag}"))
    return cameras, chunk


def _ply(columns, rows):
    kinds = {"f": "float", "i": "int"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property {kinds[kind]} {name}" for name, kind in columns]
    body = b"".join(struct.pack("<" + "".join(k for _, k in columns), *row) for row in rows)
    return ("\n".join([*head, "end_header"]) + "\n").encode() + body


def _psx(folder, chunk, block, name="river", tag="point_cloud"):
    """NAME.psx and NAME.files, as Metashape lays them out."""
    files = folder / f"{name}.files"

    def put(path, element, **members):
        path.parent.mkdir(parents=True, exist_ok=True)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("doc.xml", ElementTree.tostring(element))
            for key, data in members.items():
                archive.writestr(key.replace("__", "."), data)

    names = {p: k for k, p in enumerate(block.tie_points["point"].cat.categories)}
    places = block.positions("tie_points")
    cloud, members = ElementTree.Element(tag), {}
    ElementTree.SubElement(cloud, "points", path="points.ply")
    columns = [("x", "f"), ("y", "f"), ("z", "f"), ("id", "i")]
    members["points__ply"] = _ply(columns, [(*xyz, k) for k, xyz in enumerate(places)])
    columns = [("x", "f"), ("y", "f"), ("size", "f"), ("id", "i")]
    for camera in range(len(block.images)):
        mine = block.tie_points[block.image_rows("tie_points") == camera]
        rows = [
            (x + 0.5, y + 0.5, 2.0, names[point])
            for point, x, y in mine[["point", "x", "y"]].itertuples(index=False)
        ]
        ElementTree.SubElement(cloud, "projections", camera_id=str(camera), path=f"p{camera}.ply")
        members[f"p{camera}__ply"] = _ply(columns, rows)
    put(files / "0" / "0" / "point_cloud" / "point_cloud.zip", cloud, **members)
    chunk = copy.deepcopy(chunk)
    frames = chunk.find("frames")
    frame = frames.find("frame")
    ElementTree.SubElement(frame, tag, path="point_cloud/point_cloud.zip")
    put(files / "0" / "0" / "frame.zip", frame)
    frames.remove(frame)
    ElementTree.SubElement(frames, "frame", id="0", path="0/frame.zip")
    put(files / "0" / "chunk.zip", chunk)
    document = ElementTree.Element("document", version="1.2.0")
    chunks = ElementTree.SubElement(document, "chunks", next_id="2", active_id="0")
    ElementTree.SubElement(chunks, "chunk", id="0", path="0/chunk.zip")
    put(files / "project.zip", document)
    path = folder / f"{name}.psx"
    path.write_text('<document version="1.2.0" path="{projectname}.files/project.zip"/>')
    return path


@pytest.mark.parametrize(
    "form", ["file", "folder", "blanks in the name", "tie_points", "settings"],
)  # fmt: skip
def test_a_psx_has_its_tie_points(exported, tmp_path, form):
    folder, block = exported
    _, chunk = _merged(folder)
    if form == "settings":
        settings = ElementTree.SubElement(chunk, "settings")
        for name, value in (("accuracy_projections", "0.1"), ("accuracy_cameras", "0.03")):
            ElementTree.SubElement(settings, "property", name=name, value=value)
    name = "river 2 S\u00fcd" if form == "blanks in the name" else "river"
    tag = "tie_points" if form == "tie_points" else "point_cloud"
    path = _psx(tmp_path, chunk, block, name, tag)
    project = read_project(tmp_path if form == "folder" else path)
    proof = prove(project)
    assert proof.verdict == "proved" and len(project.block.tie_points) == len(block.tie_points)
    # PLY holds four bytes a number: a thousandth of a pixel, and 5 um of a hundred metres.
    assert proof.by_kind["tie points"].median < 2e-3
    assert proof.by_kind["marks"].median < 1e-6
    if form == "settings":
        assert project.block.sigma["mark_px"] == 0.1
        assert project.block.sigma["gnss_m"].tolist() == [0.03] * 3


def test_a_psx_without_its_folder_says_what_to_copy(exported, tmp_path):
    folder, block = exported
    _, chunk = _merged(folder)
    path = _psx(tmp_path, chunk, block)
    (tmp_path / "river.files").rename(tmp_path / "other")
    with pytest.raises(InputError, match="river.files beside it: copy both"):
        read_project(path)


def test_a_truncated_archive_is_named(exported, tmp_path):
    folder, block = exported
    _, chunk = _merged(folder)
    path = _psx(tmp_path, chunk, block)
    broken = tmp_path / "river.files" / "0" / "0" / "frame.zip"
    broken.write_bytes(broken.read_bytes()[:100])
    with pytest.raises(InputError, match="frame.zip is damaged"):
        read_project(path)


def _written(root, path):
    ElementTree.ElementTree(root).write(path)
    return path


@pytest.mark.parametrize("part", ["both", "rotation", "location", "none"])
def test_slaves_of_a_rig_have_the_pose_of_their_master_and_the_rig(exported, tmp_path, part):
    """x_master = R x_slave + l, in the chunk's units."""
    folder, block = exported
    root, chunk = _merged(folder)
    turn = rotation_from_vector(np.array([[0.002, -0.003, 0.001]]))[0]
    turn = turn if part in ("both", "rotation") else np.eye(3)
    shift = np.array([0.03, -0.02, 0.0]) if part in ("both", "location") else np.zeros(3)
    sensor = copy.deepcopy(chunk.find("sensors/sensor"))
    sensor.attrib.update(id="1", label="band 2", master_id="0")
    if part in ("both", "rotation"):
        ElementTree.SubElement(sensor, "rotation").text = " ".join(map(repr, turn.ravel().tolist()))
    if part in ("both", "location"):
        ElementTree.SubElement(sensor, "location").text = " ".join(map(repr, shift.tolist()))
    chunk.find("sensors").append(sensor)
    cameras = chunk.find("cameras")
    count = len(cameras)
    for k in range(count):
        ElementTree.SubElement(
            cameras, "camera", id=str(count + k), sensor_id="1", master_id=str(k), label=f"b2_{k}"
        )
    project = read_project(_written(root, tmp_path / "cameras.xml"))
    made, pose = project.block, block.poses
    assert len(made.images) == 2 * count and np.isfinite(made.poses).all()
    from corridor.core.geometry import rotation_from_quaternion

    master = rotation_from_quaternion(pose[:, 3:])
    slave = rotation_from_quaternion(made.poses[count:, 3:])
    assert np.abs(slave - turn.T @ master).max() < 1e-9
    centre = pose[:, :3] + np.einsum("nji,j->ni", master, shift)
    assert np.abs(made.poses[count:, :3] - centre).max() < 1e-9
    assert any("of a rig" in note for note in project.notes)
    assert made.images["exposure"].value_counts().unique().tolist() == [2]
    (table,) = made.extra["rig"].values()
    assert {table["base"], *table["member"]} == set(made.cameras)
    made.check()


@pytest.mark.parametrize("told", ["groups", "folders", "neither"])
def test_equal_labels_get_the_name_of_their_group_or_folder(exported, tmp_path, told):
    folder, _ = exported
    root, chunk = _merged(folder)
    cameras = chunk.find("cameras")
    parts = list(cameras)
    half = len(parts) // 2
    for k, part in enumerate(parts):
        part.set("label", f"DJI_{k % half + 1:04d}")
    if told == "groups":
        for number, mine in enumerate((parts[:half], parts[half:])):
            group = ElementTree.SubElement(cameras, "group", id=str(number), label=f"F{number + 1}")
            for part in mine:
                cameras.remove(part)
                group.append(part)
    if told == "folders":
        frame = ElementTree.SubElement(chunk.find("frames/frame"), "cameras")
        for k, part in enumerate(parts):
            camera = ElementTree.SubElement(frame, "camera", camera_id=part.get("id"))
            path = f"../DCIM/F{k // half + 1}/DJI_{k % half + 1:04d}.JPG"
            ElementTree.SubElement(camera, "photo", path=path)
    project = read_project(_written(root, tmp_path / "cameras.xml"))
    names = list(project.block.images["image"])
    last = "2/DJI_0001" if told == "neither" else "F2/DJI_0001"
    assert len(set(names)) == len(parts) and last in names
    assert prove(project).main.median < 1e-6
    assert any("labels belong to several cameras" in note for note in project.notes)


def test_disabled_cameras_are_left_out_and_told(exported, tmp_path):
    folder, _ = exported
    root, chunk = _merged(folder)
    first = chunk.find("cameras/camera")
    first.set("enabled", "false")
    project = read_project(_written(root, tmp_path / "cameras.xml"))
    assert first.get("label") not in set(project.block.images["image"])
    assert any("disabled cameras were left out" in note for note in project.notes)


def test_what_is_switched_off_or_has_no_sensor_is_told(exported, tmp_path):
    folder, block = exported
    _, chunk = _merged(folder)
    made = copy.deepcopy(chunk)
    for camera in made.iter("camera"):
        camera.set("enabled", "false")
    marker = made.find("markers/marker")
    marker.set("enabled", "false")
    project = read_project(_psx(tmp_path, made, block, "off"))
    assert any("all cameras are disabled: they were read" in told for told in project.warnings)
    assert any(f"{marker.get('label')} is switched off" in told for told in project.notes)
    assert marker.get("label") not in set(project.block.marks["point"])
    made = copy.deepcopy(chunk)
    for camera in list(made.iter("camera"))[:2]:
        camera.set("sensor_id", "7")
    project = read_project(_psx(tmp_path, made, block, "lost"))
    assert any("2 cameras name a sensor that the chunk has not" in t for t in project.warnings)
    assert len(project.block.images) == len(block.images) - 2


def test_equal_labels_of_markers_are_told(exported, tmp_path):
    folder, block = exported
    _, chunk = _merged(folder)
    made = copy.deepcopy(chunk)
    for marker in list(made.iter("marker"))[:2]:
        marker.set("label", "A")
    project = read_project(_psx(tmp_path, made, block))
    assert any("2 markers are called A" in told for told in project.notes)


def test_of_chunks_of_which_none_is_active_the_one_with_cameras_is_read(exported, tmp_path):
    folder, block = exported
    root, chunk = _merged(folder)
    root.insert(0, ElementTree.fromstring('<chunk label="empty"><sensors/><cameras/></chunk>'))
    chunk.set("label", "full")
    project = read_project(_written(root, tmp_path / "cameras.xml"))
    assert len(project.block.images) == len(block.images)
    assert any("2 chunks; that of the most cameras, full, was read" in n for n in project.notes)


def _bar(bars, ends, enabled="true", what="marker_id", **reference):
    bar = ElementTree.SubElement(bars, "scalebar", id=str(len(bars)), label="as a person likes")
    for end in ends:
        ElementTree.SubElement(bar, "endpoint", {what: end})
    ElementTree.SubElement(bar, "reference", reference, enabled=enabled)


def test_scale_bars_become_distances(exported, tmp_path):
    """Ends by the numbers of markers, in groups too; their own accuracy, else that of the chunk."""
    root, chunk = _merged(exported[0])
    number = {part.get("label"): part.get("id") for part in chunk.findall("markers/marker")}
    (one, first), (two, second), (three, third) = list(number.items())[:3]
    bars = ElementTree.SubElement(chunk, "scalebars")
    _bar(bars, (first, second), d="12.5")
    _bar(ElementTree.SubElement(bars, "group", id="0"), (second, third), d="3.25", sd="0.0004")
    _bar(bars, (first, third), d="9", enabled="false")
    _bar(bars, (first, third))
    _bar(bars, ("0", "1"), what="camera_id", d="1.2")
    settings = ElementTree.SubElement(chunk, "settings")
    ElementTree.SubElement(settings, "property", name="accuracy_scalebars", value="0.002")
    project = read_project(_written(root, tmp_path / "cameras.xml"))
    rows = sorted(project.block.distances.itertuples(index=False, name=None))
    assert rows == sorted([(one, two, 12.5, 0.002), (two, three, 3.25, 0.0004)])
    said = " ".join(project.notes)
    assert "2 scale bars without a length, or switched off" in said
    assert "1 scale bar not between two markers" in said


def test_distances_between_markers_are_written_as_scale_bars(exported, tmp_path):
    block = exported[1]
    names = block.ground["point"].tolist()
    table = {"from": [names[0], "T1"], "to": [names[1], names[2]], "distance": [7.5, 3.0]}
    bars = pd.DataFrame(table | {"sigma": [0.001, np.nan]})
    told = export_project(block.with_(distances=bars), "metashape", tmp_path / "out")
    assert "lost: 1 row of distances.csv" in str(told)
    again = read_project(tmp_path / "out").block.distances
    assert again.itertuples(index=False, name=None).__next__() == (*names[:2], 7.5, 0.001)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [("a.p4d", "<pix4d/>", "1_initial/params"), ("a.xlsx", "PK", "comma separated"),
     ("a.24o", "     3.04           OBSERVATION DATA    M                   RINEX VERSION / TYPE",
      "process it first"),
     ("a.nmea", "$GPGGA,1,2", "NMEA"),
     ("tracks.csv", "OPENSFM_TRACKS_VERSION_v2\n", "OpenSfM"),
     ("tracks.csv", "\t".join(["a.jpg", "3", "7", *["0.1"] * 5]), "OpenSfM"),
     ("a.txt", "POSPAC SBET export", "POSPac"),
     ("a.mg", "{}", "cameras.sfm")],
)  # fmt: skip
def test_files_of_the_trade_are_named_with_the_way_on(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=said):
        read_project(tmp_path / name)


def test_a_model_without_images_says_which_file_is_missing(tmp_path):
    for name in ("cameras.txt", "points3D.txt"):
        (tmp_path / name).write_text("# nothing\n")
    with pytest.raises(InputError, match="images.bin or images.txt is missing"):
        read_project(tmp_path)


@pytest.mark.parametrize("named", ["../../../elsewhere.zip", "{0}/elsewhere.zip"])
def test_an_archive_outside_the_project_is_not_read(exported, tmp_path, named):
    folder, block = exported
    _, chunk = _merged(folder)
    path = _psx(tmp_path / "here", chunk, block)
    files = tmp_path / "here" / "river.files"
    (files / "0" / "chunk.zip").rename(tmp_path / "elsewhere.zip")
    document = ElementTree.Element("document", version="1.2.0")
    chunks = ElementTree.SubElement(document, "chunks", next_id="2", active_id="0")
    ElementTree.SubElement(chunks, "chunk", id="0", path=named.format(tmp_path))
    with zipfile.ZipFile(files / "project.zip", "w") as archive:
        archive.writestr("doc.xml", ElementTree.tostring(document))
    with pytest.raises(InputError, match="outside the project's folder"):
        read_project(path)
