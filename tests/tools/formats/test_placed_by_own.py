"""Projects in a frame of their own that have control, and files that are no project at all."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Local, convert
from corridor.core.textfile import Xml
from corridor.tools.formats import Additions, complete, export_project, prove, read_project
from corridor.tools.formats.frames import local_table
from corridor.tools.formats.programs.metashape import chunk_of
from corridor.tools.formats.project import Project

from .conftest import exact_block
from .small_projects import _pix4d
from .test_other_programs import blocks_exchange

PLACE = Local(47.5, 8.7, 400.0)


@pytest.fixture(scope="module")
def block():
    made = exact_block(seed=3, images=6, points=30, k1=-0.05, k2=0.02)
    return replace(made, extra={"local_frame": local_table(PLACE)})


def test_a_chunk_without_transform_is_placed_by_its_own_markers(block, tmp_path):
    export_project(block, "metashape", tmp_path)
    file = tmp_path / "cameras.xml"
    text, count = re.subn(r"(?s)\n    <transform>\s*<rotation.*?</transform>", "", file.read_text())
    assert count == 1
    file.write_text(text)
    project = read_project(tmp_path)
    assert project.placed and "not metres" not in project.block.description
    made = project.block
    up = made.images["z"].to_numpy() - block.images["z"].to_numpy() - PLACE.height
    assert np.abs(up).max() < 1e-3
    assert prove(project).by_kind["marks"].median < 1e-3 and len(made.ground) == len(block.ground)


def test_a_chunk_without_transform_beside_a_local_system_is_placed_in_it(block, tmp_path):
    """Its markers and positions are metres of that system; its poses have no scale."""
    local = replace(block, extra={})
    export_project(local, "metashape", tmp_path)
    file = tmp_path / "cameras.xml"
    text, count = re.subn(r"(?s)\n    <transform>\s*<rotation.*?</transform>", "", file.read_text())
    assert count == 1
    file.write_text(re.sub(r"<transform>([^<]+)</transform>", _halved, text))
    project = complete(read_project(tmp_path), Additions())
    assert project.placed and "frame" not in project.block.extra
    assert np.abs(project.block.poses[:, :3] - local.poses[:, :3]).max() < 1e-3
    assert len(project.block.ground) == len(local.ground)


def _halved(match):
    """A camera's transform whose centre is half as far from the origin."""
    matrix = np.array(match[1].split(), dtype=float).reshape(4, 4)
    matrix[:3, 3] /= 2
    return f"<transform>{' '.join(map(repr, map(float, matrix.ravel())))}</transform>"


@pytest.mark.parametrize("listed", [False, True], ids=["alone", "with a list of control"])
def test_positions_without_a_place_on_earth_go_with_the_poses(block, tmp_path, listed):
    """OpenSfM without reference_lla: positions in the frame of the poses, metres."""
    pose, names = block.poses[:, :3], list(block.images["image"])
    gnss = pd.DataFrame({"image": names, "x": pose[:, 0], "y": pose[:, 1], "z": pose[:, 2]})
    ground = block.ground
    free = replace(block, extra={}, gnss=gnss, ground=ground.iloc[:0])
    project = Project("made", tmp_path, free, placed=False)
    added = Additions()
    if listed:
        far = ground[["y", "x", "z"]].to_numpy(float) * [-1, 1, 1] + [467000.0, 5428000.0, 0.0]
        rows = [" ".join(map(str, (n, *p))) for n, p in zip(ground["point"], far, strict=True)]
        (tmp_path / "points.txt").write_text("\n".join(rows) + "\n")
        added = Additions(ground=tmp_path / "points.txt", ground_crs="EPSG:25832")
    made = complete(project, added)
    assert made.placed and len(made.block.gnss) == len(names)
    off = made.block.numbers("gnss", *"xyz") - made.block.poses[:, :3]
    assert np.abs(off).max() < 1e-3


def test_markers_of_another_export_keep_the_system_of_their_file(block, tmp_path):
    export_project(block, "metashape", tmp_path)
    file = tmp_path / "markers.xml"
    text = file.read_text()

    def in_grid(match):
        place = convert([[float(word) for word in match.groups()]], "EPSG:4979", "EPSG:2056")[0]
        return '<reference x="{}" y="{}" z="{}"'.format(*place.tolist())

    text, count = re.subn('<reference x="([^"]+)" y="([^"]+)" z="([^"]+)"', in_grid, text)
    assert count == len(block.ground)
    text = re.sub(r"(?s)<reference>.*?</reference>", "<reference>EPSG:2056</reference>", text)
    file.write_text(text)
    made = read_project(tmp_path).block
    off = made.numbers("ground", *"xyz") - block.numbers("ground", *"xyz")
    assert np.ptp(off, axis=0).max() < 0.01 and len(made.ground) == len(block.ground)


def test_markers_without_a_height_are_not_left_out_in_silence(block, tmp_path):
    export_project(block, "metashape", tmp_path)
    file = tmp_path / "markers.xml"
    text, count = re.subn('(<reference x="[^"]+" y="[^"]+") z="[^"]+"', r"\1", file.read_text())
    file.write_text(text)
    made = read_project(tmp_path)
    assert not len(made.block.ground) and count > 1
    assert any(f"{count} markers have x and y and no height" in told for told in made.warnings)


def test_control_in_the_frame_of_a_local_block_places_it_as_it_is(block, tmp_path):
    blocks_exchange(block, tmp_path / "block.xml")
    project = complete(read_project(tmp_path), Additions())
    assert project.placed and "frame" not in project.block.extra
    assert np.allclose(project.block.poses[:, :3], block.poses[:, :3])


def test_a_namespace_hides_no_element(block, tmp_path):
    blocks_exchange(block, tmp_path / "plain.xml")
    plain = read_project(tmp_path / "plain.xml")
    text = (tmp_path / "plain.xml").read_text()
    text = text.replace("<BlocksExchange ", '<BlocksExchange xmlns="http://example.org/x" ', 1)
    (tmp_path / "named.xml").write_text(text)
    assert read_project(tmp_path / "named.xml").block.images.equals(plain.block.images)


def test_a_project_without_poses_is_told_so_and_is_in_no_frame_of_its_own(block, tmp_path):
    blocks_exchange(block, tmp_path / "block.xml")
    text = re.sub(r"(?s)<Pose>.*?</Pose>", "", (tmp_path / "block.xml").read_text())
    (tmp_path / "block.xml").write_text(text)
    project = complete(read_project(tmp_path), Additions())
    assert "frame" not in project.block.extra
    assert "no image has a pose" in prove(project).refusal()


CHUNKS = """<document><chunks{}><chunk id="0" label="old"/><chunk id="1" label="river">
<cameras><camera id="0"/></cameras></chunk><chunk id="2" label="start"><cameras/></chunk>
</chunks></document>"""


@pytest.mark.parametrize("active", ["", ' active_id="0"', ' active_id="2"', ' active_id="7"'])
def test_of_several_chunks_one_with_cameras_is_read_and_named(tmp_path, active):
    notes = []
    root = Xml.parse(CHUNKS.format(active).encode(), tmp_path / "project.zip")
    assert chunk_of(root, notes).get("label") == "river"
    assert notes == ["project.zip holds 3 chunks; that of the most cameras, river, was read"]


FILES = {
    "poses.csv": ("#name,x,y,alt,heading\nDSC 1.JPG,5.1,6.2,7,90\n", "positions of photographs"),
    "flight.ori.txt": ("1 153.0\n1001 10.5 -3.2\n-99\n", "convention.toml"),
    "points.csv": ("#name,x,y,alt\nA1,581695.1,5339094.1,298.3\n", "--ground"),
    "block.prj": ("$PROJECT 7.1\n$PHOTO\n", "Inpho"),
    "river.rspj": ("x", "RealityScan"),
    "DSC1.xmp": ("<x/>", "sidecar"),
    "DSC1.HEIC": ("x", "JPEG"),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("inside", [False, True])
def test_what_is_no_project_is_called_what_it_is(tmp_path, name, inside):
    text, said = FILES[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=re.escape(said)):
        read_project(tmp_path if inside else tmp_path / name)


def test_an_empty_folder_and_half_a_metashape_project_are_told(tmp_path):
    with pytest.raises(InputError, match="without files"):
        read_project(tmp_path)
    (tmp_path / "river.files").mkdir()
    (tmp_path / "river.files" / "project.zip").write_bytes(b"PK")
    with pytest.raises(InputError, match="put river.psx beside river.files"):
        read_project(tmp_path)


def test_positions_of_photographs_are_no_ground_points(block, tmp_path):
    blocks_exchange(block, tmp_path / "block.xml")
    rows = zip(block.images["image"], block.poses[:, :3].tolist(), strict=True)
    file = tmp_path / "external.csv"
    file.write_text("name,x,y,z\n" + "".join(f"{n},{x},{y},{z}\n" for n, (x, y, z) in rows))
    with pytest.raises(InputError, match="lists photographs"):
        complete(read_project(tmp_path / "block.xml"), Additions(ground=file))


def test_an_offset_of_pix4d_that_was_not_copied_follows_from_its_other_poses(block, tmp_path):
    """Else UTM would be the label of coordinates about 0."""
    made = replace(block, extra={})
    _pix4d(made, tmp_path)
    offset = np.array([float(word) for word in (tmp_path / "s_offset.xyz").read_text().split()])
    plain = read_project(tmp_path)
    rows = [
        f"{name} {x:.6f} {y:.6f} {z:.6f} 0 0 0"
        for name, (x, y, z) in zip(
            plain.block.images["image"],
            plain.block.poses[:, :3] + plain.block.offset,
            strict=True,
        )
    ]
    (tmp_path / "s_offset.xyz").unlink()
    assert not np.allclose(read_project(tmp_path).block.offset, plain.block.offset)
    text = "\n".join(["imageName X Y Z Omega Phi Kappa", *rows])
    (tmp_path / "s_calibrated_external_camera_parameters.txt").write_text(text + "\n")
    again = read_project(tmp_path)
    assert np.allclose(again.block.offset, plain.block.offset, atol=1e-5) and offset.any()
    assert any("its offset is that of" in note for note in again.notes)
