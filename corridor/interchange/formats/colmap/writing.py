"""A block as a COLMAP model, text or binary: five files, one rig a camera, one frame an image.

Ground points measured in images go out as points too; ground_points.csv beside the model says which
they are, and `reference.txt` holds the camera centres that GNSS gives (image x y z, as COLMAP's
model_aligner reads them). COLMAP itself knows neither.
"""

import io
import struct
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.interchange.columns import (
    grouped,
    in_groups,
    in_parts,
    in_rows,
    numbered,
    text_of,
    write_rows,
)
from corridor.interchange.formats.colmap.cameras import HALF, MODELS, params_of
from corridor.interchange.rows import Rows, camera_positions, rows_of
from corridor.interchange.text import lines

_GREY = 128


def write(block: Block, folder: Path, text: bool) -> None:
    """Write the model's files. The block must hold poses, points and cameras COLMAP can hold."""
    rows = rows_of(block)
    cameras = _numbers(list(block.cameras))
    points = _numbers(list(rows.point_names))
    pose = np.column_stack([rows.quaternion, rows.translation])
    order, starts = grouped(rows.image, len(rows.image_names))
    index = numbered(rows.image, len(rows.image_names))
    by_point, ends = grouped(rows.point, len(points))
    made = _Made(block, rows, cameras, points, pose, order, starts, index, by_point, ends)
    (_write_text if text else _write_binary)(made, folder)
    _write_ground(made, folder)


class _Made:
    def __init__(self, block, rows, cameras, points, pose, order, starts, index, by_point, ends):
        self.block, self.rows, self.cameras, self.points = block, rows, cameras, points
        self.pose, self.order, self.starts, self.index = pose, order, starts, index
        self.by_point, self.ends = by_point, ends
        self.camera = cameras[[list(block.cameras).index(n) for n in block.images["camera"]]]
        self.error = _mean_errors(rows, ends, by_point)


def _numbers(names: list[str]) -> np.ndarray:
    """COLMAP's numbers of names: the names themselves where all are numbers from 1, else 1, 2 ..

    Points keep 0 out too: some programs take it for "none".
    """
    text = pd.Index(names)
    if len(names) and text.str.fullmatch(r"[1-9][0-9]{0,8}").all():
        return text.astype(np.int64).to_numpy()
    return np.arange(1, len(names) + 1, dtype=np.int64)


def _mean_errors(rows: Rows, ends: np.ndarray, by_point: np.ndarray) -> np.ndarray:
    length = rows.residual_lengths()[by_point]
    sums = np.concatenate([[0.0], np.cumsum(length)])
    return (sums[ends[1:]] - sums[ends[:-1]]) / np.maximum(np.diff(ends), 1)


def _write_text(made: _Made, folder: Path) -> None:
    block, rows = made.block, made.rows
    with (folder / "cameras.txt").open("w", encoding="utf-8", newline="\n") as file:
        file.write("# Camera list with one line of data per camera:\n")
        file.write("#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n")
        file.write(f"# Number of cameras: {len(made.cameras)}\n")
        for number, camera in zip(made.cameras, block.cameras.values(), strict=True):
            model, params = params_of(camera)
            words = " ".join(map(repr, params))
            file.write(f"{number} {model} {camera.width} {camera.height} {words}\n")
    xy = rows.pixels[made.order] + HALF
    words = in_rows(*xy.T, made.points[rows.point[made.order]])
    found = in_groups(words, made.starts).to_pylist()
    poses = in_rows(*made.pose.T).to_pylist()
    count = len(rows.image_names)
    with (folder / "images.txt").open("w", encoding="utf-8", newline="\n") as file:
        file.write("# Image list with two lines of data per image:\n")
        file.write("#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n")
        file.write("#   POINTS2D[] as (X, Y, POINT3D_ID)\n")
        mean = len(rows.image) / count
        file.write(f"# Number of images: {count}, mean observations per image: {mean:g}\n")
        for k, name in enumerate(rows.image_names):
            file.write(f"{k + 1} {poses[k]} {made.camera[k]} {name}\n{found[k]}\n")
    with (folder / "points3D.txt").open("wb") as file:
        mean = len(rows.image) / max(len(made.points), 1)
        file.write(
            b"# 3D point list with one line of data per point:\n"
            b"#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
            + f"# Number of points: {len(made.points)}, mean track length: {mean:g}\n".encode()
        )
        for part, ends, seen in in_parts(made.by_point, made.ends):
            track = in_rows(rows.image[seen].astype(np.int64) + 1, made.index[seen])
            write_rows(
                file,
                in_rows(made.points[part], *rows.positions[part].T),
                f" {_GREY} {_GREY} {_GREY} ",
                text_of(made.error[part]),
                " ",
                in_groups(track, ends),
                "\n",
            )
    with (folder / "rigs.txt").open("w", encoding="utf-8", newline="\n") as file:
        file.write("# Rig calib list with one line of data per calib:\n")
        file.write(
            "#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, "
            "SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
        )
        file.write(f"# Number of rigs: {len(made.cameras)}\n")
        file.writelines(f"{number} 1 CAMERA {number}\n" for number in made.cameras)
    with (folder / "frames.txt").open("w", encoding="utf-8", newline="\n") as file:
        file.write("# Frame list with one line of data per frame:\n")
        file.write(
            "#   FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, "
            "DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)\n"
        )
        file.write(f"# Number of frames: {count}\n")
        for k in range(count):
            camera = made.camera[k]
            file.write(f"{k + 1} {camera} {poses[k]} 1 CAMERA {camera} {k + 1}\n")


_POINT2D = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<u8")])
_TRACK = np.dtype([("image", "<u4"), ("index", "<u4")])


def _write_binary(made: _Made, folder: Path) -> None:
    block, rows = made.block, made.rows
    with (folder / "cameras.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(made.cameras)))
        for number, camera in zip(made.cameras, block.cameras.values(), strict=True):
            model, params = params_of(camera)
            head = number, MODELS[model][0], camera.width, camera.height
            file.write(struct.pack(f"<IiQQ{len(params)}d", *head, *params))
    found = np.empty(len(rows.image), _POINT2D)
    found["x"], found["y"] = (rows.pixels[made.order] + HALF).T
    found["point"] = made.points[rows.point[made.order]]
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(rows.image_names)))
        for k, name in enumerate(rows.image_names):
            file.write(struct.pack("<I7dI", k + 1, *made.pose[k], made.camera[k]))
            mine = found[made.starts[k] : made.starts[k + 1]]
            file.write(name.encode() + b"\0" + struct.pack("<Q", len(mine)) + mine.tobytes())
    tracks = np.empty(len(rows.image), _TRACK)
    tracks["image"] = rows.image[made.by_point] + 1
    tracks["index"] = made.index[made.by_point]
    tracks, ends = tracks.tobytes(), (made.ends * _TRACK.itemsize).tolist()
    head = struct.Struct("<Qddd3BdQ").pack
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(made.points)))
        for k, (number, place, error) in enumerate(
            zip(made.points.tolist(), rows.positions.tolist(), made.error.tolist(), strict=True)
        ):
            track = tracks[ends[k] : ends[k + 1]]
            length = len(track) // _TRACK.itemsize
            file.write(head(number, *place, _GREY, _GREY, _GREY, error, length) + track)
    with (folder / "rigs.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(made.cameras)))
        for number in made.cameras:
            file.write(struct.pack("<IIiI", number, 1, 0, number))
    with (folder / "frames.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(rows.image_names)))
        for k, pose in enumerate(made.pose):
            camera = made.camera[k]
            file.write(struct.pack("<II7dI", k + 1, camera, *pose, 1))
            file.write(struct.pack("<iIQ", 0, camera, k + 1))


def _write_ground(made: _Made, folder: Path) -> None:
    block, rows = made.block, made.rows
    if rows.ties < len(rows.point_names):
        names = rows.point_names[rows.ties :]
        table = pd.DataFrame({"POINT3D_ID": made.points[rows.ties :], "point": names})
        ground = block.ground.set_index("point").reindex(names).reset_index(drop=True)
        table = pd.concat([table, ground], axis=1)
        text = table.to_csv(index=False, lineterminator="\n")
        (folder / _GROUND_FILE).write_text(
            f"# Number of ground points: {len(table)}\n{text}", encoding="utf-8", newline="\n"
        )
    positions = camera_positions(block)
    if len(positions):
        with (folder / "reference.txt").open("w", encoding="utf-8", newline="\n") as file:
            for name, *place in positions[["image", "x", "y", "z"]].itertuples(index=False):
                file.write(" ".join([name, *map(repr, map(float, place))]) + "\n")


_GROUND_FILE = "ground_points.csv"
_GROUND = ("POINT3D_ID", "point", "x", "y", "z", "role")


def read_ground(folder: Path) -> pd.DataFrame | None:
    """ground_points.csv that `write` leaves beside a model; None where there is none.

    Raises InputError where it is damaged: without it ground points would become tie points.
    """
    path = folder / _GROUND_FILE
    if not path.is_file():
        return None
    text = "".join(f"{line}\n" for _, line in lines(path))
    head, _, text = text.partition("\n")
    try:
        table = pd.read_csv(
            io.StringIO(text), dtype={k: str for k in ("POINT3D_ID", "point", "role")}
        )
        numbers = [name for name in ("x", "y", "z", "sx", "sy", "sz") if name in table]
        table[numbers] = table[numbers].astype(float)
    except (ValueError, KeyError) as error:
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(
            f"{path.name} is damaged ({reason}); delete it (ground points are tie points then) or "
            "export the block again"
        ) from None
    missing = [name for name in _GROUND if name not in table]
    given = table[[name for name in ("x", "y", "z") if name in table]]
    bad = not head.startswith("#") or head.rpartition(" ")[2] != str(len(table))
    bad = bad or missing or table["POINT3D_ID"].isna().any() or table["point"].isna().any()
    if (
        bad
        or np.isinf(given.to_numpy()).any()
        or not len(table)
        or table["point"].duplicated().any()
    ):
        raise InputError(
            f"{path.name} is damaged ({'no column ' + missing[0] if missing else 'a bad cell'}); "
            "delete it (ground points are tie points then) or export the block again"
        )
    return table
