"""VisualSFM: .nvm.

Conventions, where they differ from ours: the quaternion is world to camera, w first, z forward, and
the three numbers after it are the centre; one distortion number r takes the image to the ray:
ideal = measured (1 + r |measured|^2 / f^2). Coordinates are counted from the image centre, or from
the corner of the first pixel (other programs and some versions): told apart by whether negative
ones occur. The picture size is not in the file.

Source: VisualSFM documentation, "NVM format"; the direction and the origin as found on real files.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.interchange.cameras import from_image_formula
from corridor.interchange.following import Following, points_with_views
from corridor.interchange.project import (
    Project,
    camera_from,
    images_table,
    in_the_middle,
    observations_table,
    points_table,
    same_point_once,
)
from corridor.interchange.text import beginning, numbers, whole

NAME = "nvm"
TITLE = "VisualSFM .nvm"

_FILE = ("*.nvm", "NVM_V3")


def recognise(path: Path) -> bool:
    """A .nvm file, or a folder with one."""
    return beginning(path, *_FILE) is not None


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of the file's first model. Raises InputError naming file and line.

    size: of the pictures, pixels; without it the middle of the picture is estimated.
    """
    file = beginning(path, *_FILE) or path
    source = Following(file)
    line, text = source.next("the header")
    if not text.startswith("NVM_V3"):
        raise InputError(f"{file.name}, line {line}: {text[:30]!r} where NVM_V3 belongs")
    if "FixedK" in text:
        raise InputError(
            f"{file.name}, line {line}: a fixed calibration (FixedK) is not read; export without it"
        )
    notes, warnings = [], []
    line, text = source.next("the number of images")
    count = whole(text.strip(), file, line, "number of images", 1)
    names, rows = [], []
    for k in range(count):
        line, text = source.next(f"image {k + 1} of {count}")
        # A name may hold blanks: the eleven numbers are counted from the end.
        words = text.rstrip().rsplit(maxsplit=10)
        if len(words) != 11:
            words = text.replace("\t", " ").rstrip().rsplit(maxsplit=10)
        if len(words) != 11:
            raise InputError(
                f"{file.name}, line {line}: {len(words)} words where an image has a name and 10 "
                "numbers; the file is cut off or out of step"
            )
        names.append(words[0].strip().strip('"'))
        rows.append(numbers(words[1:], file, line, f"image {k + 1}"))
    line, text = source.next("the number of points")
    points = whole(text.strip(), file, line, "number of points")
    places, point, image, xy = points_with_views(source, points, count, 1, "an image")
    more = sum(1 for _, text in source.rest() if "." in text.split()[0])
    if more:
        notes.append(f"the file holds further models ({more} lines); the first was read")
    return _project(file, names, np.array(rows), places, point, image, xy, size, notes, warnings)


def _project(file, names, rows, places, point, image, xy, size, notes, warnings):
    focal, quaternion, centre, r = rows[:, 0], rows[:, 1:5], rows[:, 5:8], rows[:, 8]
    if (focal <= 0).any() or (np.linalg.norm(quaternion, axis=1) < 1e-9).any():
        raise InputError(f"{file.name}: an image has no focal length or a quaternion of zero")
    rotation = rotation_from_quaternion(quaternion)
    from_corner = len(xy) > 0 and (xy >= 0).all()
    if size is None:
        size = _estimated(xy, focal, r, rotation, centre, places, point, image, from_corner)
        notes.append(
            f"the file has no picture size: {size[0]} x {size[1]} px was estimated from the "
            "observations; --size WIDTHxHEIGHT or --photos states the real one"
        )
    middle = np.array(in_the_middle(*size))
    # Pixels of the corner count (0.5, 0.5) as the centre of the first one.
    pixels = xy - 0.5 if from_corner else xy + middle
    notes.append(
        "image coordinates are counted from "
        + ("the corner of the first pixel" if from_corner else "the image centre")
    )
    told: list[str] = []
    cameras, used = {}, []
    for k, (f, ratio) in enumerate(zip(focal, r, strict=True)):
        name = f"camera_{k}"
        start = camera_from(name, *size, f, *middle, k1=-ratio)
        cameras[name] = (
            from_image_formula(start, lambda p, c=start, r=ratio: _ray(p, c, r), told, "")
            if ratio
            else start
        )
        used.append(name)
    if told:
        worst = max(float(sentence.split("true to ")[1].split()[0]) for sentence in told)
        notes.append(
            f"the distortion goes from the image to the ray: turned for each of {len(told)} "
            f"cameras, true to {worst:.1g} px over the picture"
        )
    point_names = pd.Index(np.arange(len(places))).astype("str")
    block = Block(
        name=file.stem,
        cameras=cameras,
        images=images_table(names, used, centre, quaternion_from_rotation(rotation)),
        tie_points=same_point_once(
            observations_table(point, point_names, image, names, pixels), "views", warnings
        ),
        points=points_table(point_names, places),
    )
    notes.append("the frame and its scale are those of the reconstruction, not metres")
    return Project(
        NAME, file, block, notes=notes, warnings=warnings, placed=False, image_to_ray=True
    )


def _ray(pixels, camera, r):
    measured = (pixels - [camera["cx"], camera["cy"]]) / camera["f"]
    return measured * (1 + r * (measured**2).sum(axis=1, keepdims=True))


def _estimated(xy, focal, r, rotation, centre, places, point, image, from_corner):
    """Picture size: that of the observations, or from the middle that fits them best."""
    if not len(xy):
        raise InputError("the project holds no observation; name a model with points")
    if not from_corner:
        return tuple(int(2 * np.ceil(side + 1)) for side in np.abs(xy).max(axis=0))
    seen = np.einsum("nij,nj->ni", rotation[image], places[point] - centre[image])
    ideal = seen[:, :2] / np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    for _ in range(20):
        measured = (xy - middle) / focal[image][:, None]
        bent = measured * (1 + r[image][:, None] * (measured**2).sum(axis=1, keepdims=True))
        shift = np.nanmedian((bent - ideal) * focal[image][:, None], axis=0)
        middle = middle + shift
        if np.abs(shift).max() < 1e-6:
            break
    size = 2 * np.round(middle)
    if not np.isfinite(size).all() or (size < 2).any():
        raise InputError("the picture size is not in the file; state it with --size WIDTHxHEIGHT")
    return tuple(int(side) for side in np.maximum(size, 2))
