"""Bundler: bundle.out (version 0.3), with list.txt beside it.

Conventions, where they differ from ours: the camera looks along -z with y up, so that
R = diag(1, -1, -1) R_file and C = -R_file' t; image coordinates are counted from the image centre,
y upwards; k1, k2 go from the ray to the image in units of f. The file has neither image names
(list.txt has) nor picture sizes: the centre is put at (w - 1) / 2, (h - 1) / 2. A camera of zeros
was not oriented.

Source: Bundler v0.4 user's manual (Snavely), "Output format".
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.camera import Camera
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
from corridor.interchange.following import Following, points_with_views
from corridor.interchange.project import (
    Project,
    camera_from,
    images_table,
    in_the_middle,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)
from corridor.interchange.rows import rows_of
from corridor.interchange.text import beginning, lines, whole

NAME = "bundler"
TITLE = "Bundler .out"
WRITES = ("bundler",)
HOLDS = "f, k1, k2, the principal point in the middle of the picture"

_HELD = ("f", "k1", "k2")
HEADER = "# Bundle file v0.3"
_FILE = ("*.out", "# Bundle file")
_FOCAL = re.compile(r"\s+0\s+[0-9.eE+-]+\s*$")
FLIP = np.diag([1.0, -1.0, -1.0])


def recognise(path: Path) -> bool:
    """A .out file that begins as Bundler's do, or a folder with exactly that."""
    return beginning(path, *_FILE) is not None


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a .out file. Raises InputError naming file and line.

    size: of the pictures, pixels; without it one is made up that holds every observation.
    """
    file = beginning(path, *_FILE) or path
    source = Following(file)
    line, text = source.next("the header")
    if text.strip() != HEADER:
        raise InputError(
            f"{file.name}, line {line}: {text[:40]!r} where {HEADER!r} belongs; corridor reads "
            "version 0.3"
        )
    words, line = source.words(2, "number of cameras and points")
    count = whole(words[0], file, line, "number of cameras", 1)
    points = whole(words[1], file, line, "number of points")
    interior, rotation, shift = [], [], []
    for k in range(count):
        what = f"camera {k} of {count}"
        interior.append(source.values(3, what))
        rotation.append(np.array([source.values(3, what) for _ in range(3)]))
        shift.append(source.values(3, what))
    places, code, image, xy = points_with_views(source, points, count, 3, "a camera")
    for line, _ in source.rest():
        raise InputError(
            f"{file.name}, line {line}: the file goes on after its {points} points; its counts are "
            "wrong"
        )
    warnings: list[str] = []
    notes: list[str] = []
    project = assemble(
        NAME, file, _names(file, count, notes), np.array(interior), np.array(rotation),
        np.array(shift), places, code, image, xy, size, notes, warnings,
    )  # fmt: skip
    return project


def _names(file, count, notes):
    path = file.with_name("list.txt")
    if path.is_file():
        # A line is the name, perhaps with "0 focal" after it.
        found = [_FOCAL.sub("", text).strip() for _, text in lines(path) if text.strip()]
        if len(found) != count:
            raise InputError(
                f"{path.name} lists {len(found)} images where {file.name} has {count}; take both "
                "from one run"
            )
        return found
    notes.append("no list.txt beside the file: images are named by their number")
    return [f"camera {k}" for k in range(count)]


def assemble(
    form, file, names, interior, rotation, shift, places, point, image, xy, size, notes, warnings
) -> Project:
    """The project of arrays as Bundler and BAL have them; interior (n, 3): f, k1, k2."""
    oriented = (interior[:, 0] > 0) & (np.abs(rotation).sum(axis=(1, 2)) > 0)
    if (interior[:, 0] < 0).any():
        bad = int(np.argmin(interior[:, 0]))
        raise InputError(f"{file.name}: camera {bad} has the focal length {interior[bad, 0]:g}")
    if not oriented.any():
        raise InputError(f"{file.name} holds no oriented camera; run the reconstruction again")
    if not oriented.all():
        lost = np.flatnonzero(~oriented)
        notes.append(
            f"{len(lost)} cameras were not oriented (first: number {lost[0]}); they and their "
            f"{int((~oriented)[image].sum())} observations were left out"
        )
    keep = oriented[image]
    point, image, xy = point[keep], image[keep], xy[keep]
    width, height = size or _made_up(xy, interior, notes)
    middle = np.array(in_the_middle(width, height))
    pixels = xy * [1.0, -1.0] + middle
    row = np.cumsum(oriented) - 1
    kept = np.flatnonzero(oriented)
    cameras, used = _cameras(interior[kept], width, height)
    centre = -np.einsum("nji,nj->ni", rotation[kept], shift[kept])
    point_names = pd.Index(np.arange(len(places))).astype("str")
    chosen = [names[k] for k in kept]
    block = Block(
        name=file.stem,
        cameras=cameras,
        images=images_table(chosen, used, centre, rotations_to_columns(FLIP @ rotation[kept])),
        tie_points=same_point_once(
            observations_table(point, point_names, row[image], chosen, pixels),
            "observations",
            warnings,
        ),
        points=points_table(point_names, places),
    )
    notes.append("the frame and its scale are those of the reconstruction, not metres")
    return Project(form, file, block, notes=notes, warnings=warnings, placed=False)


def _made_up(xy, interior, notes):
    """A picture that holds every observation, all images alike."""
    reach = np.abs(xy).max(axis=0, initial=1.0)
    width, height = (int(2 * np.ceil(side + 1)) for side in reach)
    notes.append(
        f"the file has no picture size: {width} x {height} px was made up around the "
        "observations; --size WIDTHxHEIGHT or --photos states the real one"
    )
    return width, height


def _cameras(interior, width, height):
    """One camera where all images share f, k1, k2, else one an image."""
    cx, cy = in_the_middle(width, height)

    def camera(name, row):
        return camera_from(name, width, height, row[0], cx, cy, k1=row[1], k2=row[2])

    if (interior == interior[0]).all():
        return {"camera": camera("camera", interior[0])}, ["camera"] * len(interior)
    # Images that were calibrated alike share a camera.
    rows, which = np.unique(interior, axis=0, return_inverse=True)
    order = pd.unique(which.ravel())
    names = {old: f"camera_{new}" for new, old in enumerate(order)}
    cameras = {names[old]: camera(names[old], rows[old]) for old in order}
    return cameras, [names[k] for k in which.ravel()]


# --- out -------------------------------------------------------------------------------------


def unheld(camera: Camera) -> list[str]:
    """Interior parameters that Bundler cannot hold."""
    middle = dict(zip(("cx", "cy"), in_the_middle(camera.width, camera.height), strict=True))
    zero = [f"k{n}" for n in range(3, 9)] + ["p1", "p2", "b1", "b2"]
    return [name for name, value in middle.items() if camera[name] != value] + [
        name for name in zero if camera[name] != 0.0
    ]


def nearest(camera: Camera) -> Camera:
    """The same focal length, k1, k2, and the principal point in the middle."""
    middle = dict(zip(("cx", "cy"), in_the_middle(camera.width, camera.height), strict=True))
    return camera.with_values(**{name: middle.get(name, 0.0) for name in unheld(camera)})


def losses(block: Block) -> list[str]:
    """What else Bundler cannot hold."""
    lost = []
    if len(block.marks):
        lost.append("ground points: their marks go as points, their coordinates and names do not")
    if len(block.gnss):
        lost.append("GNSS")
    lost.append("picture sizes, and names of cameras and points")
    return lost


def write(block: Block, folder: Path, name: str) -> None:
    """Write bundle.out and list.txt."""
    rows = rows_of(block)
    sizes = [(block.cameras[c].width, block.cameras[c].height) for c in block.images["camera"]]
    middle = (np.array(sizes) - 1) / 2
    feature = numbered(rows.image, len(sizes))
    with (folder / "bundle.out").open("wb") as file:
        file.write(f"{HEADER}\n{len(sizes)} {len(rows.point_names)}\n".encode())
        interior = np.array([[block.cameras[c][k] for k in _HELD] for c in block.images["camera"]])
        turned = np.concatenate([FLIP @ rows.rotation, (rows.translation @ FLIP)[:, None]], axis=1)
        cameras = np.concatenate([interior[:, None], turned], axis=1).reshape(-1, 3)
        write_rows(file, in_rows(*cameras.T), "\n")
        for part, starts, seen in in_parts(*grouped(rows.point, len(rows.point_names))):
            image = rows.image[seen]
            xy = (rows.pixels[seen] - middle[image]) * [1.0, -1.0]
            place = in_rows(*rows.positions[part].T)
            count = text_of(np.diff(starts))
            views = in_groups(in_rows(image, feature[seen], *xy.T), starts)
            write_rows(file, place, "\n128 128 128\n", count, " ", views, "\n")
    text = "".join(f"{name}\n" for name in rows.image_names)
    (folder / "list.txt").write_text(text, encoding="utf-8", newline="\n")
