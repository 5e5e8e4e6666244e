"""Projects of iTwin Capture, AliceVision, OpenMVG and nerfstudio, written here by their formats."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import (
    Local,
)
from corridor.tools.formats import Additions, complete, prove, read_project
from corridor.tools.formats.frames import local_table, moved

from .conftest import exact_block

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
PLACE = Local(47.5, 8.7, 400.0)


@pytest.fixture(scope="module")
def block():
    """Exact to the last digit: what is read has to reproject to nothing."""
    return exact_block(seed=3, images=6, points=30, k1=-0.05, k2=0.02, p1=4e-4, p2=-3e-4)


def _views(block, table):
    frame = getattr(block, table)
    views = {}
    rows = zip(frame["point"], block.image_rows(table), frame["x"], frame["y"], strict=True)
    for point, image, x, y in rows:
        views.setdefault(point, []).append((int(image), x, y))
    return views


def _add(parent, tag, text=None, **children):
    element = ElementTree.SubElement(parent, tag)
    element.text = None if text is None else str(text)
    for key, value in children.items():
        _add(element, key, repr(float(value)))
    return element


def _xyz(parent, tag, place):
    return _add(parent, tag, **dict(zip("xyz", place, strict=True)))


def blocks_exchange(block, path, axes="XRightYDown", angles=False, place=None, srs=None,
                    mm=False, positions=True, geocentric=False):  # fmt: skip
    """A block as BlocksExchange; place: of a point of the block in the system."""
    place = place or (lambda xyz: xyz)
    turn = {"XRightYDown": np.eye(3), "XRightYUp": np.diag([1.0, -1, -1]),
            "XDownYLeft": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])}[axes]  # fmt: skip
    root = ElementTree.Element("BlocksExchange", version="2.1")
    if srs is not None:
        system = _add(_add(root, "SpatialReferenceSystems"), "SRS")
        _add(system, "Id", 0)
        _add(system, "Definition", srs)
    home = _add(root, "Block")
    _add(home, "Name", "river")
    if srs is not None:
        _add(home, "SRSId", 0)
    camera = block.cameras["P1"]
    group = _add(_add(home, "Photogroups"), "Photogroup")
    _add(group, "ImageDimensions", Width=camera.width, Height=camera.height)
    _add(group, "CameraOrientation", axes)
    if mm:
        pixel = 36.0 / camera.width
        _add(group, "SensorSize", 36.0)
        _add(group, "FocalLength", repr(camera["f"] * pixel))
        away = turn @ [camera["cx"] - 1999.5, camera["cy"] - 1499.5, 0.0] * pixel
        _add(group, "PrincipalPoint", xmm=away[0], ymm=away[1])
    else:
        _add(group, "FocalLengthPixels", repr(camera["f"]))
        _add(group, "PrincipalPoint", x=camera["cx"], y=camera["cy"])
    _add(group, "Distortion", K1=camera["k1"], K2=camera["k2"], K3=camera["k3"],
         P1=camera["p1"], P2=camera["p2"])  # fmt: skip
    pose = block.images[POSE].to_numpy(float)
    rotation = rotation_from_quaternion(pose[:, 3:])
    for k, (name, matrix) in enumerate(zip(block.images["image"], rotation, strict=True)):
        photo = _add(group, "Photo")
        _add(photo, "Id", k)
        _add(photo, "ImagePath", f"D:\\flight\\{name}")
        matrix = turn @ matrix @ (PLACE.rotation() if geocentric else np.eye(3))
        where = _add(photo, "Pose")
        part = _add(where, "Rotation")
        if angles:
            found = Rotation.from_matrix(matrix.T).as_euler("XYZ", degrees=True)
            for key, value in zip(("Omega", "Phi", "Kappa"), found, strict=True):
                _add(part, key, repr(float(value)))
        else:
            for i in range(3):
                for j in range(3):
                    _add(part, f"M_{i}{j}", repr(float(matrix[i, j])))
        _xyz(where, "Center", place(pose[k : k + 1, :3])[0])
    control = _add(home, "ControlPoints")
    for point, x, y, z in block.ground[["point", "x", "y", "z"]].itertuples(index=False):
        part = _add(control, "ControlPoint")
        _add(part, "Name", point)
        _xyz(part, "Position", place(np.array([[x, y, z]]))[0])
        _add(part, "HorizontalAccuracy", 0.01)
        _add(part, "VerticalAccuracy", 0.03)
        for image, x, y in _views(block, "marks").get(point, ()):
            _add(part, "Measurement", PhotoId=image, x=x, y=y)[0].text = str(image)
    ties = _add(home, "TiePoints")
    known = block.points.set_index("point")[["x", "y", "z"]]
    for point, views in _views(block, "tie_points").items():
        part = _add(ties, "TiePoint")
        if positions:
            _xyz(part, "Position", place(known.loc[[point]].to_numpy(float))[0])
        for image, x, y in views:
            _add(part, "Measurement", PhotoId=image, x=x, y=y)[0].text = str(image)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def to(crs):
    return lambda xyz: PLACE.to_crs(xyz, crs)


@pytest.mark.parametrize(
    "form",
    [{}, {"axes": "XRightYUp"}, {"axes": "XDownYLeft"}, {"angles": True}, {"mm": True},
     {"positions": False}, {"srs": "LOCAL"},
     {"srs": "EPSG:4978", "place": to("EPSG:4978"), "geocentric": True},
     {"srs": "EPSG:4979", "place": to("EPSG:4979")}],
    ids=lambda form: "-".join(f"{k}={v}" for k, v in form.items() if k != "place") or "plain",
)  # fmt: skip
def test_blocks_exchange_reprojects_to_nothing_in_every_spelling(block, tmp_path, form):
    project = read_project(blocks_exchange(block, tmp_path / "block.xml", **form))
    proof = prove(project)
    assert project.form == "blocksexchange" and proof.verdict == "proved"
    # About another point east, north, up differ by 1e-4 rad over a degree's thousandths.
    assert proof.main.median < (0.05 if form.get("srs") == "EPSG:4979" else 1e-6)
    made = project.block
    assert list(made.images["image"]) == list(block.images["image"])
    assert made.ground["sz"].tolist() == [0.03] * len(made.ground)
    assert len(made.marks) == len(block.marks)


def test_blocks_exchange_in_a_grid_keeps_its_system(block, tmp_path):
    here = block.copy()
    here.extra["local_frame"] = local_table(PLACE)
    grid = moved(here, "EPSG:2056")
    path = blocks_exchange(grid, tmp_path / "b.xml", srs="EPSG:2056")
    project = read_project(path)
    assert project.block.crs == "EPSG:2056" and project.block.offset[0] > 2e6
    # A grid is no Cartesian frame, but nearly one over a hundred metres.
    assert prove(project).main.median < 0.5


def test_blocks_exchange_with_heading_names_what_to_export(block, tmp_path):
    path = blocks_exchange(block, tmp_path / "b.xml", angles=True)
    text = path.read_text(encoding="utf-8")
    for old, new in (("Omega", "Heading"), ("Phi", "Pitch"), ("Kappa", "Roll")):
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="as matrices or omega, phi, kappa"):
        read_project(path)


def _sfm(block):
    """Poses, camera, points and views of a block with a pinhole in the middle."""
    pose = block.images[POSE].to_numpy(float)
    rotation = rotation_from_quaternion(pose[:, 3:])
    known = block.points.set_index("point")[["x", "y", "z"]]
    return pose, rotation, known, _views(block, "tie_points"), block.cameras["P1"]


def alice_vision(block, path, radial="radialk3"):
    pose, rotation, known, views, camera = _sfm(block)
    text = {"views": [], "poses": [], "structure": []}
    for k, name in enumerate(block.images["image"]):
        view = {"viewId": str(100 + k), "poseId": str(k), "intrinsicId": "7"}
        text["views"].append(view | {"path": f"/data/{name}", "width": "4000", "height": "3000"})
        transform = {"rotation": [repr(v) for v in rotation[k].T.ravel().tolist()],
                     "center": [repr(v) for v in pose[k, :3].tolist()]}  # fmt: skip
        text["poses"].append({"poseId": str(k), "pose": {"transform": transform, "locked": "0"}})
    values = [camera["k1"], camera["k2"], camera["k3"]]
    if radial == "brown":
        values += [camera["p2"], camera["p1"]]
    text["intrinsics"] = [{
        "intrinsicId": "7", "width": "4000", "height": "3000", "sensorWidth": "36",
        "sensorHeight": "27", "type": "pinhole", "distortionType": radial,
        "focalLength": repr(camera["f"] * 36 / 4000), "pixelRatio": "1",
        "principalPoint": [repr(camera["cx"] - 2000), repr(camera["cy"] - 1500)],
        "distortionParams": [repr(v) for v in values],
    }]  # fmt: skip
    for number, (point, seen) in enumerate(views.items()):
        text["structure"].append({
            "landmarkId": str(number), "X": [repr(v) for v in known.loc[point].tolist()],
            "observations": [{"observationId": str(100 + image), "x": [repr(x), repr(y)]}
                             for image, x, y in seen],
        })  # fmt: skip
    path.write_text(json.dumps(text))
    return path


def open_mvg(block, path, kind="pinhole_brown_t2"):
    pose, rotation, known, views, camera = _sfm(block)

    def wrapped(data, **more):
        return {"polymorphic_id": 1, **more, "ptr_wrapper": {"id": 5, "data": data}}

    common = {"width": 4000, "height": 3000, "focal_length": camera["f"],
              "principal_point": [camera["cx"], camera["cy"]]}  # fmt: skip
    k = [camera["k1"], camera["k2"], camera["k3"]]
    inner = {
        "pinhole_radial_k3": common | {"disto_k3": k},
        "pinhole_brown_t2": {"value0": common, "disto_t2": [*k, camera["p2"], camera["p1"]]},
    }[kind]
    text = {
        "sfm_data_version": "0.3", "root_path": "/data",
        "views": [{"key": i, "value": wrapped({
            "local_path": "", "filename": name, "width": 4000, "height": 3000, "id_view": i,
            "id_intrinsic": 0, "id_pose": i})} for i, name in enumerate(block.images["image"])],
        "intrinsics": [{"key": 0, "value": wrapped(inner, polymorphic_name=kind)}],
        "extrinsics": [{"key": i, "value": {"rotation": rotation[i].tolist(),
                                            "center": pose[i, :3].tolist()}}
                       for i in range(len(pose))],
        "structure": [{"key": n, "value": {
            "X": known.loc[point].tolist(),
            "observations": [{"key": i, "value": {"id_feat": 0, "x": [x, y]}}
                             for i, x, y in seen]}}
            for n, (point, seen) in enumerate(views.items())],
        "control_points": [],
    }  # fmt: skip
    path.write_text(json.dumps(text))
    return path


@pytest.fixture(scope="module")
def radial():
    return exact_block(seed=4, images=6, points=30, k1=-0.05, k2=0.02, k3=0.01)


@pytest.mark.parametrize(("write", "kind"), [
    (alice_vision, "brown"), (open_mvg, "pinhole_brown_t2"), (alice_vision, "radialk3"),
    (open_mvg, "pinhole_radial_k3"),
])  # fmt: skip
def test_models_of_alice_vision_and_open_mvg_reproject_to_nothing(
    block, radial, tmp_path, write, kind
):
    made = block if kind in ("brown", "pinhole_brown_t2") else radial
    project = read_project(write(made, tmp_path / "sfm_data.json", kind))
    proof = prove(project)
    assert proof.verdict == "proved" and proof.main.median < 1e-6
    assert project.block.images[POSE].to_numpy(float) == pytest.approx(
        made.images[POSE].to_numpy(float), abs=1e-9
    )


def test_a_model_before_reconstruction_says_so(block, tmp_path):
    path = alice_vision(block, tmp_path / "sfm.json")
    text = json.loads(path.read_text())
    path.write_text(json.dumps(text | {"poses": []}))
    with pytest.raises(InputError, match="before reconstruction"):
        read_project(path)


def test_nerfstudio_poses_are_ours(block, tmp_path):
    pose, rotation, _, _, camera = _sfm(block)
    frames = []
    for k, name in enumerate(block.images["image"]):
        matrix = np.eye(4)
        matrix[:3, :3] = (np.diag([1.0, -1, -1]) @ rotation[k]).T
        matrix[:3, 3] = pose[k, :3]
        frames.append({"file_path": f"./images/{name}", "transform_matrix": matrix.tolist()})
    text = {"camera_model": "OPENCV", "w": 4000, "h": 3000, "fl_x": camera["f"],
            "fl_y": camera["f"], "cx": camera["cx"] + 0.5, "cy": camera["cy"] + 0.5,
            "k1": camera["k1"], "k2": camera["k2"], "p1": camera["p2"], "p2": camera["p1"],
            "frames": frames}  # fmt: skip
    (tmp_path / "transforms.json").write_text(json.dumps(text))
    project = read_project(tmp_path)
    assert project.form == "nerfstudio" and prove(project).verdict == "unproved"
    made = project.block
    assert made.images[POSE].to_numpy(float) == pytest.approx(
        block.images[POSE].to_numpy(float), abs=1e-9
    )
    assert made.cameras["camera"].interior == pytest.approx(camera.interior)


def test_what_has_no_place_on_earth_gets_no_system(block, tmp_path):
    project = read_project(alice_vision(block, tmp_path / "sfm.json"))
    with pytest.raises(InputError, match="coordinates are not in it"):
        complete(project, Additions(crs="EPSG:25832"))
