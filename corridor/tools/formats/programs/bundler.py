"""Bundler: bundle.out (version 0.3), with list.txt beside it.

Conventions, where they differ from ours: the camera looks along -z with y up, so that
R = diag(1, -1, -1) R_file and C = -R_file' t; image coordinates are counted from the image centre,
y upwards; k1, k2 go from the ray to the image in units of f. The file has neither image names
(list.txt has) nor picture sizes: the centre is put at (w - 1) / 2, (h - 1) / 2. A camera of zeros
was not oriented.

Source: Bundler v0.4 user's manual (Snavely), "Output format".
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.tools.formats.cameras import FLIP, Held, camera_from, in_the_middle, shared
from corridor.tools.formats.columns import (
    grouped,
    in_groups,
    in_parts,
    in_rows,
    numbered,
    points_with_views,
    text_of,
    write_rows,
)
from corridor.tools.formats.project import Contents, Project, Views
from corridor.tools.formats.rows import rows_of
from corridor.tools.formats.textfile import Following, beginning, filled

NAME = "bundler"
TITLE = "Bundler .out"
WRITES = ("bundler",)
HOLDS = Held(("f", "k1", "k2"), centred=True)
LOSSES = {
    "marks": "ground points: their marks go as points, their coordinates and names do not",
    "GNSS": "GNSS",
    "names": "picture sizes, and names of cameras and points",
}

HEADER = "# Bundle file v0.3"
_FILE = ("*.out", "# Bundle file")
_FOCAL = re.compile(r"\s+0\s+[0-9.eE+-]+\s*$")
_FARTHEST = 200_000.0  # px from the middle: no picture is larger


def recognise(path: Path) -> bool:
    """A .out file that begins as Bundler's do, or a folder with exactly that."""
    return beginning(path, *_FILE) is not None


@dataclass
class BundlerArrays:
    """What a file of Bundler's conventions holds, BAL's alike.

    interior (n, 3): f, k1, k2. rotation (n, 3, 3), shift (n, 3): of the cameras. places (p, 3).
    point, image (m,), xy (m, 2): the views, from the image centre, y upwards.
    """

    names: list[str]
    interior: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray
    places: np.ndarray
    point: np.ndarray
    image: np.ndarray
    xy: np.ndarray

    def project(
        self, form: str, file: Path, size: tuple[int, int] | None, notes: list[str]
    ) -> Project:
        """The project; size: of the pictures, else one that holds every observation."""
        focal = self.interior[:, 0]
        if (focal < 0).any():
            bad = int(np.argmin(focal))
            raise InputError(f"{file.name}: camera {bad} has the focal length {focal[bad]:g}")
        oriented = (focal > 0) & (np.abs(self.rotation).sum(axis=(1, 2)) > 0)
        if not oriented.any():
            raise InputError(f"{file.name} holds no oriented camera; run the reconstruction again")
        keep = oriented[self.image]
        if not oriented.all():
            lost = np.flatnonzero(~oriented)
            notes.append(
                f"{len(lost)} cameras were not oriented (first: number {lost[0]}); they and their "
                f"{int((~keep).sum())} observations were left out"
            )
        xy = self.xy[keep]
        width, height = size or _made_up(file, xy, self.image[keep], notes)
        kept = np.flatnonzero(oriented)
        interiors, middle = list(map(tuple, self.interior[kept])), in_the_middle(width, height)
        one = len(set(interiors)) == 1
        cameras, used = shared(
            interiors,
            lambda k: "camera" if one else f"camera_{k}",
            lambda name, f, k1, k2: camera_from(name, width, height, f, *middle, k1=k1, k2=k2),
        )
        rotation = self.rotation[kept]
        names = pd.Index(np.arange(len(self.places))).astype("str")
        notes.append("the frame and its scale are those of the reconstruction, not metres")
        return Contents(
            name=file.stem,
            cameras=cameras,
            images=[self.names[k] for k in kept],
            used=used,
            centre=-np.einsum("nji,nj->ni", rotation, self.shift[kept]),
            rotation=FLIP @ rotation,
            ties=Views(
                self.point[keep],
                names,
                (np.cumsum(oriented) - 1)[self.image[keep]],
                xy * [1.0, -1.0] + middle,
            ),
            points=(names, self.places),
            notes=notes,
        ).project(form, file, placed=False)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a .out file. Raises InputError naming file and line.

    size: of the pictures, pixels; without it one is made up that holds every observation.
    """
    file = beginning(path, *_FILE) or path
    source = Following(file)
    line = source.next("the header")
    if line.text.strip() != HEADER:
        raise line.wrong(
            f"{line.text.strip()[:40]!r} where {HEADER!r} belongs; corridor reads version 0.3"
        )
    line = source.next("the number of cameras and points")
    words = line.words(2, "the number of cameras and points")
    count, points = (line.whole(word, "a number of cameras or points", 1) for word in words)
    # f, k1, k2; three rows of the rotation; t.
    rows = [[source.values(3, f"camera {k} of {count}") for _ in range(5)] for k in range(count)]
    rows = np.array(rows)
    views = points_with_views(source, points, count, 3, "a camera")
    for line in source.rest():
        raise line.wrong(f"the file goes on after its {points} points; its counts are wrong")
    notes: list[str] = []
    names = _names(file, count, notes)
    return BundlerArrays(names, rows[:, 0], rows[:, 1:4], rows[:, 4], *views).project(
        NAME, file, size, notes
    )


def _names(file, count, notes):
    # As Bundler itself (bundle/bundle.out), COLMAP (NAME.bundle.out) and others leave it.
    stems = ("", f"{file.name}.", f"{file.stem.removesuffix('.bundle')}.")
    places = [file.with_name(f"{stem}list.txt") for stem in stems]
    places += [file.parent.parent / "list.txt"] * (file.parent.name == "bundle")
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        notes.append("no list.txt beside the file: images are named by their number")
        return [f"camera {k}" for k in range(count)]
    # A line is the name, perhaps with "0 focal" after it.
    found = [_FOCAL.sub("", line.text).strip() for line in filled(path)]
    if len(found) != count:
        raise InputError(
            f"{path.name} lists {len(found)} images where {file.name} has {count}; take both from "
            "one run"
        )
    return found


def _made_up(file, xy, image, notes):
    """A picture that holds every observation, all images alike."""
    reach = np.abs(xy).max(axis=0, initial=1.0)
    if reach.max() > _FARTHEST:
        far = int(np.argmax(np.abs(xy).max(axis=1)))
        raise InputError(
            f"{file.name}: camera {image[far]} sees a point at ({xy[far, 0]:.10g}, "
            f"{xy[far, 1]:.10g}) px from its middle, in no picture; correct or delete it"
        )
    width, height = (int(2 * np.ceil(side + 1)) for side in reach)
    notes.append(
        f"the file has no picture size: {width} x {height} px was made up around the "
        "observations; --size WIDTHxHEIGHT or --photos states the real one"
    )
    return width, height


# --- out -------------------------------------------------------------------------------------


def write(block: Block, folder: Path, name: str) -> None:
    """Write bundle.out and list.txt."""
    rows = rows_of(block)
    feature = numbered(rows.image)
    interior = np.array(
        [[block.cameras[c][k] for k in HOLDS.names] for c in block.images["camera"]]
    )
    turned = np.concatenate([FLIP @ rows.rotation, (rows.translation @ FLIP)[:, None]], axis=1)
    cameras = np.concatenate([interior[:, None], turned], axis=1).reshape(-1, 3)
    with (folder / "bundle.out").open("wb") as file:
        file.write(f"{HEADER}\n{len(interior)} {len(rows.point_names)}\n".encode())
        write_rows(file, in_rows(*cameras.T), "\n")
        for part, starts, seen in in_parts(*grouped(rows.point, len(rows.point_names))):
            image = rows.image[seen]
            xy = (rows.pixels[seen] - rows.middle[image]) * [1.0, -1.0]
            place = in_rows(*rows.positions[part].T)
            count = text_of(np.diff(starts))
            views = in_groups(in_rows(image, feature[seen], *xy.T), starts)
            write_rows(file, place, "\n128 128 128\n", count, " ", views, "\n")
    text = "".join(f"{name}\n" for name in rows.image_names)
    (folder / "list.txt").write_text(text, encoding="utf-8", newline="\n")
