"""Small projects of every format: what corridor writes, and by hand those it only reads."""

import json

import numpy as np

from corridor.core.geometry import rotation_from_quaternion
from corridor.tools.formats import export_project

from .conftest import exact_block

FLIP = np.diag([1.0, -1.0, -1.0])
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


def block():
    """Five images, some forty points, a simple camera that every format holds."""
    return exact_block(seed=5, images=6, points=30, k1=-0.05, k2=0.02, cx=1999.5, cy=1499.5)


def write_all(folder):
    """A folder of each format; returns their paths by name, what `read_project` is given."""
    made = block()
    made.extra["local_frame"] = {"lat_deg": 47.5, "lon_deg": 8.7, "height": 400.0}
    paths = {}
    for form in ("colmap", "colmap-text", "opensfm", "micmac", "bundler", "metashape"):
        export_project(made, form, folder / form)
        paths[form] = folder / form
    for name, write in (("nvm", _nvm), ("bal", _bal), ("pix4d", _pix4d), ("odm", _odm)):
        (folder / name).mkdir()
        paths[name] = write(made, folder / name)
    return paths


def _poses(made):
    pose = made.images[POSE].to_numpy(float)
    rotation = rotation_from_quaternion(pose[:, 3:])
    return pose, rotation, -np.einsum("nij,nj->ni", rotation, pose[:, :3])


def _views(made):
    """point -> [(image row, x, y)] of tie points and marks, and places."""
    views = {}
    for table in (made.tie_points, made.marks):
        rows = made.image_rows("tie_points" if table is made.tie_points else "marks")
        for point, row, x, y in zip(table["point"], rows, table["x"], table["y"], strict=True):
            views.setdefault(point, []).append((int(row), x, y))
    places = made.points.set_index("point")[["x", "y", "z"]]
    return views, places


def _nvm(made, folder):
    """Without distortion of its own: observations are moved to an ideal camera."""
    export_project(made, "bundler", folder / "b")  # only to be sure the block is exportable
    pose, _, _ = _poses(made)
    views, places = _views(made)
    camera = made.cameras["P1"]
    rows = ["NVM_V3", "", str(len(pose))]
    for name, row in zip(made.images["image"], pose, strict=True):
        numbers = [camera["f"], *row[3:], *row[:3], 0.0, 0]
        rows.append(f"{name} " + " ".join(map(repr, map(float, numbers))))
    rows += ["", str(len(views))]
    from corridor.core.camera import undistort

    for point, seen in views.items():
        pixels = undistort(np.array([v[1:] for v in seen]), camera.interior) * camera["f"]
        text = " ".join(
            f"{v[0]} 0 {x!r} {y!r}" for v, (x, y) in zip(seen, pixels.tolist(), strict=True)
        )
        x, y, z = places.loc[point].tolist()
        rows.append(f"{x!r} {y!r} {z!r} 1 2 3 {len(seen)} {text}")
    for file in (folder / "b").iterdir():
        file.unlink()
    (folder / "b").rmdir()
    (folder / "model.nvm").write_text("\n".join(rows) + "\n\n0\n")
    return folder


def _bal(made, folder):
    _, rotation, shift = _poses(made)
    views, places = _views(made)
    camera = made.cameras["P1"]
    rows = [f"{len(rotation)} {len(views)} {sum(map(len, views.values()))}"]
    for k, seen in enumerate(views.values()):
        rows += [f"{i} {k}     {x - 1999.5!r} {1499.5 - y!r}" for i, x, y in seen]
    for turn, t in zip(rotation, shift, strict=True):
        turn = FLIP @ turn
        angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        axis *= angle / (2 * np.sin(angle))
        numbers = [*axis, *(FLIP @ t), camera["f"], camera["k1"], camera["k2"]]
        rows += [repr(float(v)) for v in numbers]
    for point in views:
        rows += [repr(v) for v in places.loc[point].tolist()]
    (folder / "problem.txt").write_text("\n".join(rows) + "\n")
    return folder / "problem.txt"


def _pix4d(made, folder):
    pose, rotation, _ = _poses(made)
    camera = made.cameras["P1"]
    head = ["fileName imageWidth imageHeight ", "camera matrix K [3x3]", "radial distortion [3x1]",
            "tangential distortion [2x1]", "camera position t [3x1]", "camera rotation R [3x3]",
            "camera model m = K [R|-Rt] X", ""]  # fmt: skip
    rows = list(head)
    f = camera["f"]
    for name, row, turn in zip(made.images["image"], pose, rotation, strict=True):
        rows += [f"{name} 4000 3000", f"{f} 0 2000.0", f"0 {f} 1500.0", "0 0 1"]
        rows += [f"{camera['k1']!r} {camera['k2']!r} 0", "0 0"]
        rows.append(" ".join(repr(v) for v in row[:3].tolist()))
        rows += [" ".join(repr(v) for v in line) for line in turn.tolist()]
    (folder / "s_calibrated_camera_parameters.txt").write_text("\n".join(rows) + "\n")
    (folder / "s_offset.xyz").write_text("1000.0 2000.0 4.0")
    rows = []
    for k, name in enumerate(made.images["image"]):
        rows.append(f"{name.rpartition('.')[0]} H_36.00000_27.00000")
        for table in ("tie_points", "marks"):
            frame = getattr(made, table)
            mine = frame[made.image_rows(table) == k]
            for point, x, y in zip(mine["point"], mine["x"], mine["y"], strict=True):
                rows.append(f"{point} {(x - 1999.5) * 0.009:.8f} {(1499.5 - y) * 0.009:.8f}")
        rows.append("-99")
    (folder / "s_tp_bingo.txt").write_text("\n".join(rows) + "\n")
    return folder


def _odm(made, folder):
    export_project(made, "opensfm", folder / "x")
    whole = json.loads((folder / "x" / "reconstruction.json").read_text())[0]
    (folder / "cameras.json").write_text(json.dumps(whole["cameras"]))
    features = []
    for name, shot in whole["shots"].items():
        centre = made.images.set_index("image").loc[name, ["x", "y", "z"]].tolist()
        table = {"filename": name, "focal": 0.9, "width": 4000, "height": 3000,
                 "translation": centre, "rotation": shot["rotation"]}  # fmt: skip
        features.append({"type": "Feature", "properties": table, "geometry": None})
    (folder / "odm_report").mkdir()
    whole = {"type": "FeatureCollection", "features": features}
    (folder / "odm_report" / "shots.geojson").write_text(json.dumps(whole))
    for file in (folder / "x").iterdir():
        file.unlink()
    (folder / "x").rmdir()
    return folder
