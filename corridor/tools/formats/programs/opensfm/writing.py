"""A block as OpenSfM's files: reconstruction, tracks, reference, ground points."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion, vector_from_rotation
from corridor.core.gnss import about_the_middle, local_of
from corridor.tools.formats.cameras import in_the_middle
from corridor.tools.formats.columns import numbered, text_of, write_rows
from corridor.tools.formats.frames import moved
from corridor.tools.formats.hanging import Hanging
from corridor.tools.formats.rows import camera_positions, rows_of

MAIN = "reconstruction.json"
HEADER = "OPENSFM_TRACKS_VERSION_v"
# Columns of a track line by version: image, track, feature, x, y, [scale], r, g, b, [segment..].
WIDTH = {0: 8, 1: 9, 2: 11}


def write(block: Block, folder: Path, name: str) -> None:
    """Write reconstruction.json, tracks.csv, reference_lla.json, ground_control_points.json."""
    if block.crs is not None and local_of(block) is None:
        block = moved(block, about_the_middle(block), block.crs)
    rows = rows_of(block)
    shots = {}
    positions = camera_positions(block).set_index("image")
    times = np.nan_to_num(block.column("images", "time_s"), posinf=0.0, neginf=0.0)
    vector = vector_from_rotation(rows.rotation)
    for k, (image, camera) in enumerate(zip(rows.image_names, block.images["camera"], strict=True)):
        shots[image] = {
            "rotation": vector[k].tolist(),
            "translation": rows.translation[k].tolist(),
            "camera": camera,
            "orientation": 1,
            "capture_time": float(times[k]),
        }
        if image in positions.index:
            place = positions.loc[image]
            shots[image]["gps_position"] = [float(place[axis]) for axis in "xyz"]
            shots[image]["gps_dop"] = float(np.sqrt(place["sx"] * place["sy"]))
    cameras = {name: _table(camera) for name, camera in block.cameras.items()}
    whole = {"cameras": cameras, "shots": shots} | _rigs(block, Hanging.of(block))
    local = local_of(block)
    if local:
        whole["reference_lla"] = {
            "latitude": local.lat_deg,
            "longitude": local.lon_deg,
            "altitude": local.height,
        }
        _dump(whole["reference_lla"], folder / "reference_lla.json")
    _write_reconstruction(whole, rows, folder / MAIN)
    ties = len(block.tie_points)
    size = 2 * rows.middle + 1
    pixels = rows.pixels - rows.middle[rows.image]
    xy = pixels / size.max(axis=1)[rows.image, None]
    _write_tracks(rows, xy[:ties], folder / "tracks.csv")
    if len(block.marks):
        _write_ground(block, rows, xy[ties:], folder / "ground_control_points.json", local)


def _rigs(block, hanging):
    """rig_cameras and rig_instances: OpenSfM wants every shot in one, or none."""
    if not hanging.mounted:
        return {}
    names = block.images[["image", "camera"]].to_numpy(object)
    cameras = {name: (np.eye(3), np.zeros(3)) for name in block.cameras}
    cameras |= {name: (one.rotation, one.place) for name, one in hanging.members().items()}
    turned = rotation_from_quaternion(hanging.pose[:, 3:])
    return {
        "rig_cameras": {name: _pose(*pose) for name, pose in cameras.items()},
        "rig_instances": {
            names[rows[0], 0]: _pose(turned[rows[0]], hanging.pose[rows[0], :3])
            | {"rig_camera_ids": dict(names[rows].tolist())}
            for rows in hanging.frames()
        },
    }


def _pose(rotation, centre):
    """rotation (3, 3), into the camera, and centre as OpenSfM has them."""
    return {
        "rotation": vector_from_rotation(rotation[None])[0].tolist(),
        "translation": (-rotation @ centre).tolist(),
    }


def _dump(what, path):
    path.write_text(json.dumps(what, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_reconstruction(whole, rows, path):
    """Points one a line: a million of them as one object would fill the memory."""
    head = json.dumps(whole, ensure_ascii=False)
    names = rows.point_names[: rows.ties]
    quoted = json.JSONEncoder(ensure_ascii=False).encode
    step = 100_000
    with path.open("wb") as file:
        file.write(f'[{head[:-1]}, "points": {{\n'.encode())
        for first in range(0, rows.ties, step):
            part = slice(first, min(first + step, rows.ties))
            x, y, z = map(text_of, rows.positions[part].T)
            comma = pa.array([","] * (len(x) - 1) + ["," * (part.stop < rows.ties)])
            write_rows(
                file,
                pa.array(list(map(quoted, names[part]))),
                ': {"color": [128, 128, 128], "coordinates": [', x, ", ", y, ", ", z, "]}",
                comma, "\n",
            )  # fmt: skip
        file.write(b"}}]\n")


def _table(camera):
    scale = max(camera.width, camera.height)
    cx, cy = in_the_middle(camera.width, camera.height)
    radial, kind = 3, "brown"
    if camera.fisheye:
        # The simpler of two kinds, where it is enough.
        more = any(camera[name] for name in ("k5", "k6", "p1", "p2"))
        radial, kind = (6, "fisheye62") if more else (4, "fisheye_opencv")
    decentred = {} if kind == "fisheye_opencv" else {"p1": camera["p2"], "p2": camera["p1"]}
    return {
        "projection_type": kind,
        "width": camera.width,
        "height": camera.height,
        "focal_x": camera["f"] * (1 + camera["b1"]) / scale,
        "focal_y": camera["f"] / scale,
        "c_x": (camera["cx"] - cx) / scale,
        "c_y": (camera["cy"] - cy) / scale,
        **{f"k{n}": camera[f"k{n}"] for n in range(1, radial + 1)},
        **decentred,
    }


def _write_tracks(rows, xy, path):
    part = slice(0, len(xy))
    image = pa.DictionaryArray.from_arrays(rows.image[part].astype(np.int32), rows.image_names)
    point = pa.DictionaryArray.from_arrays(
        rows.point[part].astype(np.int32), pa.array(rows.point_names[: rows.ties], pa.string())
    )
    feature = numbered(rows.image[part])
    same = [pa.array(np.full(len(xy), value)) for value in (0.001, 128, 128, 128, -1, -1)]
    table = pa.table(
        [image.cast(pa.string()), point.cast(pa.string()), feature, xy[:, 0], xy[:, 1], *same],
        names=[str(k) for k in range(WIDTH[2])],
    )
    with path.open("wb") as file:
        file.write(f"{HEADER}2\n".encode())
        options = pa.csv.WriteOptions(
            include_header=False, delimiter="\t", quoting_style="none", batch_size=65536
        )
        try:
            pa.csv.write_csv(table, file, options)
        except pa.ArrowInvalid:
            raise InputError(
                "a name of an image or a point has a tab, a quote or a line break, which tracks.csv"
                " of OpenSfM cannot hold: rename it in tie_points.csv and images.csv"
            ) from None


def _write_ground(block, rows, xy, path, local):
    given = block.ground.set_index("point")
    points = {}
    for name in dict.fromkeys(block.marks["point"]):
        points[name] = {"id": name, "observations": []}
        if name in given.index and local is not None:
            world = given.loc[[name], ["x", "y", "z"]].to_numpy()
            lon, lat, height = local.to_geographic(world)[0].tolist()
            place = {"latitude": lat, "longitude": lon, "altitude": height}
            points[name] |= {"position": place, "role": str(given.loc[name, "role"])}
    image = rows.image[len(block.tie_points) :]
    for name, k, pixel in zip(block.marks["point"], image, xy.tolist(), strict=True):
        points[name]["observations"].append({"shot_id": rows.image_names[k], "projection": pixel})
    _dump({"points": list(points.values())}, path)
