"""COLMAP's binary files, little endian.

Source: COLMAP documentation, format.rst, and src/colmap/scene/reconstruction_io_binary.cc.
"""

import struct
from pathlib import Path

import numpy as np

from corridor.errors import InputError
from corridor.interchange.formats.colmap.cameras import BY_NUMBER, MODELS
from corridor.interchange.formats.colmap.model import Model
from corridor.interchange.text import missing

_POINT2D = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<u8")])
_NONE = np.uint64(2**64 - 1)


class _Bytes:
    """A file that says where it ends too early."""

    def __init__(self, path: Path):
        self.path, self.at = path, 0
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise missing(path, error) from error

    def take(self, form: str, what: str) -> tuple:
        size = struct.calcsize("<" + form)
        self._enough(size, what)
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += size
        return values

    def array(self, dtype, count: int, what: str) -> np.ndarray:
        self._enough(np.dtype(dtype).itemsize * count, what)
        values = np.frombuffer(self.data, dtype, count, self.at)
        self.at += values.nbytes
        return values

    def name(self, what: str) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            self._enough(len(self.data) + 1, what)
        try:
            text = self.data[self.at : end].decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(
                f"{self.path.name}, byte {self.at}: the name of {what} is not UTF-8; rename the "
                "image"
            ) from None
        self.at = end + 1
        return text

    def end(self) -> None:
        if self.at != len(self.data):
            raise InputError(
                f"{self.path.name} goes on after its {self.at} bytes of entries (it has "
                f"{len(self.data)}); its count is wrong, export the project again"
            )

    def _enough(self, size, what):
        if self.at + size > len(self.data):
            raise InputError(
                f"{self.path.name} ends at byte {len(self.data)}, within {what}; it is cut off, "
                "export the project again"
            )


def read_binary(folder: Path) -> Model:
    """The model of cameras.bin, images.bin, points3D.bin, and rigs.bin, frames.bin if there."""
    model = Model(folder)
    _cameras(_Bytes(folder / "cameras.bin"), model)
    _images(_Bytes(folder / "images.bin"), model)
    _points(_Bytes(folder / "points3D.bin"), model)
    if (folder / "frames.bin").is_file():
        _rigs(_Bytes(folder / "rigs.bin"), model)
        _frames(_Bytes(folder / "frames.bin"), model)
    return model


def _finite(values, file, what):
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all():
        raise InputError(
            f"{file.path.name}, byte {file.at}: {what} is not finite; export the project again"
        )
    return values


def _cameras(file, model):
    (count,) = file.take("Q", "its count")
    for k in range(count):
        what = f"camera {k + 1} of {count}"
        number, kind, width, height = file.take("IiQQ", what)
        if kind not in BY_NUMBER:
            raise InputError(f"{file.path.name}: {what} has the unknown model {kind}")
        name = BY_NUMBER[kind]
        params = file.take(f"{MODELS[name][1]}d", what)
        if number in model.cameras:
            raise InputError(f"{file.path.name}: camera {number} stands there twice")
        model.cameras[number] = (name, width, height, _finite(params, file, what).tolist())
    file.end()


def _images(file, model):
    (count,) = file.take("Q", "its count")
    poses, pixels, points, rows = [], [], [], []
    known = set()
    for k in range(count):
        what = f"image {k + 1} of {count}"
        number, *pose, camera = file.take("I7dI", what)
        name = file.name(what)
        if camera not in model.cameras:
            raise InputError(
                f"{file.path.name}: {what} ({name[:60]!r}) has camera {camera}, which cameras.bin "
                "does not have; take both files from one model"
            )
        if number in known:
            raise InputError(f"{file.path.name}: image {number} stands there twice")
        known.add(number)
        (measured,) = file.take("Q", what)
        found = file.array(_POINT2D, measured, what)
        seen = found["point"] != _NONE
        xy = np.column_stack([found["x"], found["y"]])[seen]
        ids = found["point"][seen]
        if len(ids) and ids.max() >= 2**63:
            raise InputError(f"{file.path.name}: {what} sees a point of an impossible number")
        model.loose += int(len(found) - len(xy))
        pixels.append(_finite(xy, file, what))
        points.append(ids.astype(np.int64))
        rows.append(len(xy))
        poses.append(_finite(pose, file, what))
        model.image_id.append(number)
        model.image_camera.append(camera)
        model.image_name.append(name.strip())
        model.image_place.append(f"{file.path.name}, {what} ({name[:60]})")
    file.end()
    if poses:
        model.pose = np.array(poses)
        model.xy = np.concatenate(pixels)
        model.point = np.concatenate(points)
        model.image = np.repeat(np.arange(len(rows), dtype=np.int32), rows)


def _points(file, model):
    (count,) = file.take("Q", "its count")
    # A point takes 51 bytes at least: a damaged count must not reserve memory.
    file._enough(51 * count, f"its {count} points")
    ids, places = np.empty(count, np.int64), np.empty((count, 3))
    data, at, size = file.data, file.at, len(file.data)
    unpack = struct.Struct("<q3d3Bd").unpack_from
    length = struct.Struct("<Q").unpack_from
    tracked = 0
    for k in range(count):
        if at + 51 > size:
            file.at = at
            file._enough(51, f"point {k + 1} of {count}")
        ids[k], places[k, 0], places[k, 1], places[k, 2], *_ = unpack(data, at)
        (track,) = length(data, at + 43)
        at += 51 + 8 * track
        tracked += track
        if at > size:
            file.at = size
            file._enough(1, f"point {k + 1} of {count}")
    file.at = at
    file.end()
    wrong = ~np.isfinite(places).all(axis=1) | (ids < 0)
    if wrong.any():
        raise InputError(
            f"{file.path.name}: point {int(np.argmax(wrong)) + 1} of {count} has no finite "
            "coordinates; export the project again"
        )
    model.point_id, model.point_xyz, model.tracked = ids, places, tracked


def _pose(file, what):
    pose = _finite(file.take("7d", what), file, what)
    if not np.linalg.norm(pose[:4]) > 0:
        raise InputError(f"{file.path.name}: the quaternion of {what} has length zero")
    return pose


def _rigs(file, model):
    (count,) = file.take("Q", "its count")
    for k in range(count):
        what = f"rig {k + 1} of {count}"
        rig, sensors = file.take("II", what)
        members: dict[int, np.ndarray | None] = {}
        for n in range(sensors):
            kind, number = file.take("iI", what)
            pose = None
            if n:
                (has,) = file.take("B", what)
                pose = _pose(file, what) if has else np.full(7, np.nan)
            if kind == 0:
                members[number] = pose
        model.rigs[rig] = members
    file.end()


def _frames(file, model):
    (count,) = file.take("Q", "its count")
    for k in range(count):
        what = f"frame {k + 1} of {count}"
        _, rig = file.take("II", what)
        pose = _pose(file, what)
        (length,) = file.take("I", what)
        data = []
        for _ in range(length):
            kind, number, image = file.take("iIQ", what)
            if kind == 0:
                data.append((number, image))
        model.frames.append((rig, pose, data))
    file.end()
