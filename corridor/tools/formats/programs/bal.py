"""Bundle Adjustment in the Large: one text file, perhaps packed (.bz2, .gz).

Conventions as Bundler's (camera looks along -z, y up, image coordinates from the centre), the
rotation a vector (angle-axis). f, k1, k2 belong to each image. Neither names nor sizes.

Source: Agarwal et al. 2010, and the project's page.
"""

import re
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.tools.formats.columns import NumberLines
from corridor.tools.formats.programs.bundler import BundlerArrays
from corridor.tools.formats.project import Project
from corridor.tools.formats.textfile import Following, opening

NAME = "bal"
TITLE = "Bundle Adjustment in the Large"

_HEAD = re.compile(r"\s*\d+\s+\d+\s+\d+\s*\n\s*\d+\s+\d+\s+[-+0-9.eE]+\s+[-+0-9.eE]+\s*\n")


def recognise(path: Path) -> bool:
    """A text file that begins with three counts and an observation of four numbers."""
    if not path.is_file() or path.suffix.lower() not in (".txt", ".bz2", ".gz", ".bal"):
        return False
    return bool(_HEAD.match(opening(path, 300).replace("\r\n", "\n")))


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file. Raises InputError naming file and line."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; name the file of the BAL problem")
    source = Following(path)
    line = source.next("the count of cameras, points and observations")
    words = line.words(3, "the count of cameras, points and observations of a BAL file")
    cameras, points, count = (line.whole(word, "a count", 1) for word in words)
    table = NumberLines(source)
    table.expect(
        (table.counts == 4) | (np.arange(len(table.counts)) >= count),
        f"an observation has 4 ({count} are promised)",
    )
    parameters = table.values[4 * count :]
    needed = 9 * cameras + 3 * points
    if len(parameters) != needed:
        raise InputError(
            f"{path.name}: {cameras} cameras and {points} points need {needed} parameters, "
            f"{len(parameters)} are there; the file is cut off or its counts are wrong"
        )
    views = table.values[: 4 * count].reshape(-1, 4)
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
