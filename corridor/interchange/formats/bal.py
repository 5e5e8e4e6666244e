"""Bundle Adjustment in the Large: one text file, perhaps packed (.bz2, .gz).

Conventions as Bundler's (camera looks along -z, y up, image coordinates from the centre), the
rotation a vector (angle-axis). f, k1, k2 belong to each image. Neither names nor sizes.

Source: Agarwal et al. 2010, and the project's page.
"""

import bz2
import gzip
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from corridor.errors import InputError
from corridor.geometry import rotation_from_vector
from corridor.interchange.columns import plain_numbers
from corridor.interchange.formats.bundler import BundlerArrays
from corridor.interchange.project import Project
from corridor.textfile import Line, lines, missing

NAME = "bal"
TITLE = "Bundle Adjustment in the Large"

_HEAD = re.compile(r"\s*\d+\s+\d+\s+\d+\s*\n\s*\d+\s+\d+\s+[-+0-9.eE]+\s+[-+0-9.eE]+\s*\n")


def recognise(path: Path) -> bool:
    """A text file that begins with three counts and an observation of four numbers."""
    if not path.is_file() or path.suffix.lower() not in (".txt", ".bz2", ".gz", ".bal"):
        return False
    try:
        with _open(path) as file:
            head = file.read(300).decode("utf-8-sig", errors="replace")
    except (OSError, EOFError):
        return False
    return bool(_HEAD.match(head.replace("\r\n", "\n")))


def _open(path):
    if path.suffix == ".bz2":
        return bz2.open(path)
    return gzip.open(path) if path.suffix == ".gz" else path.open("rb")


def _rows(path) -> Iterator[Line]:
    if path.suffix not in (".bz2", ".gz"):
        yield from lines(path)
        return
    try:
        with _open(path) as file:
            for at, text in enumerate(file, start=1):
                yield Line(path, at, text.decode("ascii", errors="replace"))
    except FileNotFoundError as error:
        raise missing(path, error) from error
    except (OSError, EOFError) as error:
        raise InputError(f"{path.name} cannot be unpacked ({error}); fetch it again") from None


def _at_once(path):
    """Counts, observations and parameters of a whole file; None where `_by_line` must say why."""
    try:
        with _open(path) as file:
            plain = plain_numbers(file)
    except (OSError, EOFError):
        return None
    if plain is None or not len(plain.counts) or plain.counts[0] != 3 or not plain.whole[:3].all():
        return None
    cameras, points, count = map(int, plain.values[:3])
    end = 3 + 4 * count
    as_stated = (plain.counts[1 : count + 1] == 4).all() and min(cameras, points, count) > 0
    if not as_stated or len(plain.values) != end + 9 * cameras + 3 * points:
        return None
    return cameras, points, plain.values[3:end].reshape(-1, 4), plain.values[end:]


def _by_line(path):
    """The same, or InputError naming the line."""
    found = (line for line in _rows(path) if line.text.strip())
    line = next(found, Line(path, 1, ""))
    words = line.words(3, "the count of cameras, points and observations of a BAL file")
    cameras, points, count = (line.whole(word, "a count", 1) for word in words)
    views, rest = [], []
    for line in found:
        if len(views) < count:
            views.append(line.values(4, f"an observation ({len(views)} of {count} are there)"))
        else:
            rest.append(line.numbers(line.text.split(), "a parameter"))
    parameters = np.concatenate([*rest, np.zeros(0)])
    needed = 9 * cameras + 3 * points
    if len(views) < count or len(parameters) != needed:
        raise InputError(
            f"{path.name}: {cameras} cameras and {points} points need {needed} parameters, "
            f"{len(parameters)} are there; the file is cut off or its counts are wrong"
        )
    return cameras, points, np.array(views).reshape(-1, 4), parameters


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file. Raises InputError naming file and line."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; name the file of the BAL problem")
    cameras, points, views, parameters = _at_once(path) or _by_line(path)
    codes = views[:, :2]
    wrong = ((codes % 1 != 0) | (codes < 0) | (codes >= [cameras, points])).any(axis=1)
    if wrong.any():
        raise InputError(
            f"{path.name}: observation {int(np.argmax(wrong)) + 1} names a camera or point beyond "
            "the counts; the file is out of step"
        )
    camera = parameters[: 9 * cameras].reshape(-1, 9)
    image, point = codes.astype(np.int64).T
    return BundlerArrays(
        names=[f"camera {k}" for k in range(cameras)],
        interior=camera[:, 6:],
        rotation=rotation_from_vector(camera[:, :3]),
        shift=camera[:, 3:6],
        places=parameters[9 * cameras :].reshape(-1, 3),
        point=point,
        image=image,
        xy=views[:, 2:],
    ).project(NAME, path, size, ["images are named by their number"])
