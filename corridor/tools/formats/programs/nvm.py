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

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.tools.formats.cameras import camera_from, from_image_formula, in_the_middle
from corridor.tools.formats.columns import points_with_views
from corridor.tools.formats.project import Contents, Project, Views
from corridor.tools.formats.textfile import Following, beginning

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
    line = source.next("the header")
    if not line.text.startswith("NVM_V3"):
        raise line.wrong(f"{line.text[:30]!r} where NVM_V3 belongs")
    if "FixedK" in line.text:
        raise line.wrong("a fixed calibration (FixedK) is not read; export without it")
    line = source.next("the number of images")
    count = line.whole(line.text.strip(), "number of images", 1)
    names, rows = [], []
    for k in range(count):
        line = source.next(f"image {k + 1} of {count}")
        # A name may hold blanks: the ten numbers are counted from the end.
        words = line.text.rstrip().rsplit(maxsplit=10)
        if len(words) != 11:
            raise line.wrong(
                f"{len(words)} words where an image has a name and 10 numbers; the file is cut off "
                "or out of step"
            )
        names.append(words[0].strip().strip('"'))
        rows.append(line.numbers(words[1:], f"image {k + 1}"))
    line = source.next("the number of points")
    points = line.whole(line.text.strip(), "number of points")
    views = points_with_views(source, points, count, 1, "an image")
    notes: list[str] = []
    more = sum(1 for line in source.rest() if "." in line.text.split()[0])
    if more:
        notes.append(f"the file holds further models ({more} lines); the first was read")
    return _project(file, names, np.array(rows), views, size, notes)


def _project(file, names, rows, views, size, notes):
    focal, quaternion, centre, r = rows[:, 0], rows[:, 1:5], rows[:, 5:8], rows[:, 8]
    places, point, image, xy = views
    if (focal <= 0).any() or (np.linalg.norm(quaternion, axis=1) < 1e-9).any():
        raise InputError(f"{file.name}: an image has no focal length or a quaternion of zero")
    rotation = rotation_from_quaternion(quaternion)
    from_corner = len(xy) > 0 and (xy >= 0).all()
    if size is None:
        seen = np.einsum("nij,nj->ni", rotation[image], places[point] - centre[image])
        size = _estimated(xy, focal[image], r[image], seen, from_corner)
        notes.append(
            f"the file has no picture size: {size[0]} x {size[1]} px was estimated from the "
            "observations; --size WIDTHxHEIGHT or --photos states the real one"
        )
    middle = np.array(in_the_middle(*size))
    notes.append(
        "image coordinates are counted from "
        + ("the corner of the first pixel" if from_corner else "the image centre")
    )
    cameras, told = {}, []
    for k, (f, ratio) in enumerate(zip(focal, r, strict=True)):
        camera = camera_from(f"camera_{k}", *size, f, *middle, k1=-ratio)
        if ratio:
            camera, away = from_image_formula(camera, lambda p, c=camera, r=ratio: _ray(p, c, r))
            told.append(away)
        cameras[camera.name] = camera
    if told:
        notes.append(
            f"the distortion goes from the image to the ray: turned for each of {len(told)} "
            f"cameras, true to {max(told):.1g} px over the picture"
        )
    notes.append("the frame and its scale are those of the reconstruction, not metres")
    known = pd.Index(np.arange(len(places))).astype("str")
    # Pixels of the corner count (0.5, 0.5) as the centre of the first one.
    pixels = xy - 0.5 if from_corner else xy + middle
    return Contents(
        name=file.stem,
        cameras=cameras,
        images=names,
        used=list(cameras),
        centre=centre,
        rotation=rotation,
        ties=Views(point, known, image, pixels, "views"),
        points=(known, places),
        notes=notes,
    ).project(NAME, file, placed=False, image_to_ray=True)


def _ray(pixels, camera, r):
    measured = (pixels - [camera["cx"], camera["cy"]]) / camera["f"]
    return measured * (1 + r * (measured**2).sum(axis=1, keepdims=True))


def _estimated(xy, focal, r, seen, from_corner):
    """Picture size: that of the observations, or from the middle that fits them best.

    focal, r (m,): of the camera of each observation; seen (m, 3): its point in the camera.
    """
    if not len(xy):
        raise InputError("the project holds no observation; name a model with points")
    if not from_corner:
        # A pixel beyond all pictures makes a size that no camera has, which is refused then.
        return tuple(int(2 * np.ceil(min(side, 1e6) + 1)) for side in np.abs(xy).max(axis=0))
    ideal = seen[:, :2] / np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    for _ in range(20):
        measured = (xy - middle) / focal[:, None]
        bent = measured * (1 + r[:, None] * (measured**2).sum(axis=1, keepdims=True))
        shift = np.nanmedian((bent - ideal) * focal[:, None], axis=0)
        middle = middle + shift
        if np.abs(shift).max() < 1e-6:
            break
    size = 2 * np.round(middle)
    if not np.isfinite(size).all() or (size < 2).any():
        raise InputError("the picture size is not in the file; state it with --size WIDTHxHEIGHT")
    return tuple(int(side) for side in np.maximum(size, 2))
