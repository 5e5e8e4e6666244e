"""COLMAP's text files.

images.txt has two lines an image: the pose and the name (the rest of the line: it may hold blanks
and folders), then x, y and point id of every measured point, -1 where it has none; that line may be
empty. Comments promise the counts.

Source: COLMAP documentation, format.rst.
"""

import io
import re
from pathlib import Path

import numpy as np

from corridor.errors import InputError
from corridor.interchange.columns import plain_numbers
from corridor.interchange.formats.colmap.cameras import MODELS
from corridor.interchange.formats.colmap.model import NO_POINT, Model
from corridor.interchange.text import lines, numbers, whole

# Beyond this a float64 does not tell one whole number from the next.
_EXACT = 2.0**53
_COUNT = re.compile(r"#\s*Number of \w+:\s*(\d+)")


def read_text(folder: Path) -> Model:
    """The model of cameras.txt, images.txt, points3D.txt, and rigs.txt, frames.txt if there."""
    model = Model(folder)
    _cameras(folder / "cameras.txt", model)
    _images(folder / "images.txt", model)
    _points(folder / "points3D.txt", model)
    if (folder / "frames.txt").is_file():
        _rigs(folder / "rigs.txt", model)
        _frames(folder / "frames.txt", model)
    return model


def _rows(path: Path, model: Model):
    """Line number and words of lines that are no comment; the promised count is checked."""
    stated, count = None, 0
    for line, text in lines(path):
        match = _COUNT.match(text)
        if match:
            stated = int(match[1])
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        count += 1
        yield line, text
    _counted(path, stated, count, model)


def _counted(path, stated, count, model):
    if stated is not None and stated != count:
        model.warnings.append(
            f"{path.name} promises {stated} entries and holds {count}: it may be cut off, or cut "
            "down by hand"
        )


def _short(path, line, count, what, needed):
    return InputError(
        f"{path.name}, line {line}: {count} words where {what} needs {needed}; the line is cut off "
        "or of another program"
    )


def _cameras(path, model):
    for line, text in _rows(path, model):
        words = text.split()
        if len(words) < 4:
            raise _short(path, line, len(words), "a camera", "4 or more")
        number = whole(words[0], path, line, "CAMERA_ID")
        if words[1] not in MODELS:
            raise InputError(
                f"{path.name}, line {line}: camera model {words[1][:40]!r} is unknown; use one of "
                "COLMAP's"
            )
        needed = MODELS[words[1]][1]
        params = numbers(words[4:], path, line, "PARAMS").tolist()
        if len(params) != needed:
            raise _short(path, line, len(params), f"a {words[1]}", f"{needed} parameters")
        if number in model.cameras:
            raise InputError(
                f"{path.name}, line {line}: camera {number} stands there twice; delete one"
            )
        size = [whole(word, path, line, "the picture size", 1) for word in words[2:4]]
        model.cameras[number] = (words[1], *size, params)


def _images(path, model):
    poses, pixels, points, rows = [], [], [], []
    stated, pending, known = None, False, set()
    for line, text in lines(path):
        if pending:
            pending = False
            found = _points2d(path, line, text)
            seen = found[:, 2] >= 0
            model.loose += int(len(found) - seen.sum())
            pixels.append(found[seen, :2])
            points.append(found[seen, 2].astype(np.int64))
            rows.append(len(found[seen]))
            continue
        match = _COUNT.match(text)
        stated = int(match[1]) if match else stated
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        words = text.split(maxsplit=9)
        if len(words) < 10:
            raise _short(path, line, len(words), "an image", "10")
        number = whole(words[0], path, line, "IMAGE_ID")
        camera = whole(words[8], path, line, "CAMERA_ID")
        if camera not in model.cameras:
            raise InputError(
                f"{path.name}, line {line}: camera {camera} is not in cameras.txt; take both files "
                "from one model"
            )
        if number in known:
            raise InputError(
                f"{path.name}, line {line}: image {number} stands there twice; delete one"
            )
        known.add(number)
        poses.append(numbers(words[1:8], path, line, "the pose"))
        model.image_id.append(number)
        model.image_camera.append(camera)
        model.image_name.append(words[9].strip())
        model.image_place.append(f"{path.name}, line {line}")
        pending = True
    if pending:
        rows.append(0)
    _counted(path, stated, len(model.image_id), model)
    if not poses:
        return
    model.pose = np.array(poses)
    model.xy = np.concatenate([*pixels, np.zeros((0, 2))])
    model.point = np.concatenate([*points, np.zeros(0, np.int64)])
    model.image = np.repeat(np.arange(len(rows), dtype=np.int32), rows)


def _points2d(path, line, text):
    plain = plain_numbers(io.BytesIO(text.encode()))
    if plain is not None and len(plain.values) % 3 == 0:
        return _by_three(plain.values, path, line)
    words = text.split()
    if len(words) % 3:
        raise InputError(
            f"{path.name}, line {line}: {len(words)} numbers where x, y, point id make threes; the "
            "file is cut off or a line is missing"
        )
    return _by_three(numbers(words, path, line, "an image point"), path, line)


def _by_three(values, path, line):
    found = values.reshape(-1, 3)
    ids = found[:, 2]
    if len(ids) and ((ids != np.floor(ids)) | (ids < NO_POINT)).any():
        raise InputError(
            f"{path.name}, line {line}: a point id is no whole number; the numbers are out of step"
        )
    # Old versions write the largest unsigned number for "no point".
    found[ids >= _EXACT, 2] = NO_POINT
    return found


def _points(path, model):
    if _points_at_once(path, model):
        return
    ids, places, tracked = [], [], 0
    for line, text in _rows(path, model):
        words = text.split(maxsplit=8)
        if len(words) < 8:
            raise _short(path, line, len(words), "a point", "8 or more")
        ids.append(whole(words[0], path, line, "POINT3D_ID"))
        places.append(
            [
                _coordinate(word, path, line, axis)
                for word, axis in zip(words[1:4], "XYZ", strict=True)
            ]
        )
        if len(words) > 8:
            count = len(words[8].split())
            if count % 2:
                raise InputError(
                    f"{path.name}, line {line}: the track has {count} numbers where image id and "
                    "index make pairs; the line is cut off"
                )
            tracked += count // 2
    model.point_id = np.array(ids, dtype=np.int64)
    model.point_xyz = np.array(places, dtype=float).reshape(-1, 3)
    model.tracked = tracked or None


def _points_at_once(path, model):
    """Whether a whole file could be read; where not, a line at a time says why."""
    head, plain = b"", None
    if path.is_file():
        with path.open("rb") as file:
            while (line := file.readline()).startswith(b"#"):
                head += line
            file.seek(len(head))
            if head.isascii() and head.count(b"\r") == head.count(b"\r\n"):
                plain = plain_numbers(file)
    if plain is None or b"\0" in head or (plain.counts < 8).any() or (plain.counts % 2).any():
        return False
    ids = plain.values[plain.starts]
    if not plain.whole[plain.starts].all() or (ids >= _EXACT).any():
        return False
    stated = [match for text in head.decode().splitlines() if (match := _COUNT.match(text))]
    _counted(path, int(stated[-1][1]) if stated else None, len(ids), model)
    model.point_id = ids.astype(np.int64)
    model.point_xyz = plain.values[plain.starts[:, None] + np.arange(1, 4)]
    model.tracked = int((plain.counts - 8).sum()) // 2 or None
    return True


def _coordinate(word, path, line, axis):
    return float(numbers([word], path, line, axis)[0])


def _sensors(words, path, line, count, size):
    """Groups of words of `count` sensors that follow each other."""
    if len(words) != count * size:
        raise _short(path, line, len(words), f"{count} sensors", count * size)
    return [words[size * k : size * (k + 1)] for k in range(count)]


def _rigs(path, model):
    for line, text in _rows(path, model):
        words = text.split()
        if len(words) < 2:
            raise _short(path, line, len(words), "a rig", "2 or more")
        rig = whole(words[0], path, line, "RIG_ID")
        count, at = whole(words[1], path, line, "NUM_SENSORS"), 2
        members: dict[int, np.ndarray | None] = {}
        for k in range(count):
            wide = 2 if k == 0 else 3
            if len(words) < at + wide:
                raise _short(path, line, len(words), "the sensors of a rig", "more")
            kind, number = words[at], whole(words[at + 1], path, line, "SENSOR_ID")
            pose = None
            if k and words[at + 2] not in ("0", "1"):
                raise InputError(
                    f"{path.name}, line {line}: HAS_POSE is neither 0 nor 1; export it again"
                )
            if k and words[at + 2] == "1":
                pose = numbers(words[at + 3 : at + 10], path, line, "the pose of a sensor")
                if len(pose) != 7 or not np.linalg.norm(pose[:4]) > 0:
                    raise _short(path, line, len(pose), "the pose of a sensor", 7)
                wide += 7
            elif k:
                pose = np.full(7, np.nan)
            if kind == "CAMERA":
                members[number] = pose
            at += wide
        model.rigs[rig] = members


def _frames(path, model):
    for line, text in _rows(path, model):
        words = text.split()
        if len(words) < 10:
            raise _short(path, line, len(words), "a frame", "10 or more")
        rig = whole(words[1], path, line, "RIG_ID")
        pose = numbers(words[2:9], path, line, "the pose of a frame")
        if not np.linalg.norm(pose[:4]) > 0:
            raise InputError(
                f"{path.name}, line {line}: the quaternion has length zero; export it again"
            )
        count = whole(words[9], path, line, "NUM_DATA_IDS")
        data = [
            (whole(number, path, line, "SENSOR_ID"), whole(image, path, line, "DATA_ID"))
            for kind, number, image in _sensors(words[10:], path, line, count, 3)
            if kind == "CAMERA"
        ]
        model.frames.append((rig, pose, data))
