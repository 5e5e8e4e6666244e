"""PhotoModeler text export (*-pmexport.txt).

Conventions, where they differ from ours: the camera has y up and looks along -z, so that
R = diag(1, -1, -1) (Rx(omega) Ry(phi) Rz(kappa))'; angles are written kappa, phi, omega in degrees.
The principal point is counted in mm from the top left corner, pixels from the corner of the first
one. Distortion (K1..K3, P1, P2, in mm) takes the image to the ray.

Source: DBAT (Börlin and Grussenmeyer), documentation of its loadpm; PhotoModeler's manual.
"""

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_angles
from corridor.core.textfile import Line, lines
from corridor.tools.formats.cameras import (
    FLIP,
    camera_from,
    from_image_formula,
    shared,
    turned_note,
)
from corridor.tools.formats.project import Contents, Project, Views, ground_table
from corridor.tools.formats.textfile import opening

NAME = "photomodeler"
TITLE = "PhotoModeler text export"


def recognise(path: Path) -> bool:
    """A text export, or a folder with one."""
    return _file(path) is not None


def _file(path):
    if path.is_file():
        return path if _looks(path) else None
    return next((file for file in sorted(path.glob("*.txt")) if _looks(file)), None)


def _looks(path):
    rows = opening(path, 2000).splitlines()
    if len(rows) < 6:
        return False
    try:
        widths = [len([float(word) for word in row.split()]) for row in rows[1:5]]
    except ValueError:
        return False
    # Some exports state no picture size.
    return widths[1:] == [9, 10, 10] and widths[0] in (2, 4)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of an export. Raises InputError naming file and line."""
    file = _file(path) or path
    groups = _groups(file)
    if len(groups) < 4:
        raise InputError(
            f"{file.name} holds {len(groups)} parts where photos, points and marks are needed; it "
            "is cut off or no PhotoModeler export"
        )
    head, *rest = groups
    if len(head) < 5:
        raise InputError(f"{file.name}: the head is too short; export the project again")
    if len(head[1].text.split()) != 2 or size is None:
        if len(head[1].text.split()) == 2:
            raise head[1].wrong("the export states no picture size; give it with --size WxH")
        words = head[1].words(4, "the line of the picture size")
        size = [head[1].whole(word, "the picture size", 2) for word in words[2:]]
    common = head[3].numbers(head[3].text.split(), "the camera of the head")
    photos, rest = _photos(head[4], head[5:], rest, common)
    control, points, marks = _tables(file, rest)
    notes: list[str] = []
    cameras, used = shared(
        [tuple(photo.inner) for photo in photos],
        lambda k: f"camera_{k}" if k else "camera",
        lambda name, *inner: _camera(name, inner, *size, notes),
    )
    turned = np.array([rotation_from_angles(*photo.angles[::-1]) for photo in photos])
    row_of = {photo.number: k for k, photo in enumerate(photos)}
    unknown = [photo for photo, *_ in marks if photo not in row_of]
    if unknown:
        raise InputError(f"{file.name}: a mark names photo {unknown[0]}, which is not there")
    given = {number for number, *_ in control}
    seen = {True: [], False: []}
    for photo, number, x, y, *sigma in marks:
        # One sigma for both axes; 0 is that of marks without one.
        one = np.sqrt(np.mean(np.square(sigma)))
        seen[number in given].append((str(number), row_of[photo], x - 0.5, y - 0.5, one))
    known = {str(number): values for number, *values in [*control, *points]}
    if control:
        notes.append(
            f"{len(given)} control points: the export writes the coordinates it adjusted; "
            "--ground FILE gives those that were surveyed"
        )
    sigma = np.array([values[3:] for _, *values in control]).reshape(-1, 3)
    return Contents(
        name=file.stem,
        cameras=cameras,
        images=[photo.name for photo in photos],
        used=used,
        centre=np.array([photo.centre for photo in photos]),
        rotation=FLIP @ turned.transpose(0, 2, 1),
        ties=Views.of(seen[False], "marks"),
        marks=Views.of(seen[True], "marks"),
        points=(list(known), np.array([values[:3] for values in known.values()])),
        ground=ground_table(
            [str(number) for number, *_ in control],
            np.array([values[:3] for _, *values in control]).reshape(-1, 3),
            np.where(sigma > 0, sigma, np.nan),
        ),
        notes=notes,
    ).project(NAME, file, rounding=_rounding([photo.printed for photo in photos]))


def _rounding(printed: list[list[str]]) -> tuple[float, float]:
    """Half a unit of the last digit of printed centres (m) and angles (rad)."""
    # A number with an exponent has all the digits that it needs.
    last = [
        0.0 if "e" in word.lower() else 0.5 * 10.0 ** -len(word.partition(".")[2])
        for words in printed
        for word in words
    ]
    each = np.array(last).reshape(-1, 6)
    return float(np.median(each[:, :3])), float(np.radians(np.median(each[:, 3:])))


@dataclass
class _Photo:
    """One photograph: centre (3,); angles kappa, phi, omega; inner: its camera (10,).

    printed: the six numbers of its pose as the file has them.
    """

    number: int
    name: str
    centre: np.ndarray
    angles: np.ndarray
    inner: np.ndarray
    printed: list[str]


def _groups(file) -> list[list[Line]]:
    """Lines in groups between blank lines; the first photo stands after the head."""
    parts = groupby(lines(file), lambda line: bool(line.text.strip()))
    return [list(group) for filled, group in parts if filled]


def _photos(head_line, first, rest, common):
    """Photos: three lines, a blank line, two lines of camera; the next one follows those."""
    photos, pending = [], first
    while rest and len(pending) == 3:
        head, pose, _ = pending
        number, *name = head.text.split()
        if not name:
            raise head.wrong("this is not a photo; export it again")
        number = head.whole(number, "a photo number")
        values = pose.values(7, f"the pose of photo {number}")[1:]
        camera, *rest = rest
        if len(camera) < 2:
            raise camera[0].wrong(
                f"this is not the camera of photo {number}; the file is cut off or out of step"
            )
        inner = camera[0].values(11, f"the camera of photo {number}")[1:]
        # The head prints the same camera with more digits.
        if len(common) == 10 and np.abs(inner - common).max() <= 0.00051:
            inner = common
        name = " ".join(name).replace("\\", "/").rpartition("/")[2]
        printed = pose.text.split()[1:]
        photos.append(_Photo(number, name, values[:3], values[3:], inner, printed))
        pending = camera[2:]
    if not photos:
        raise head_line.wrong("no photo follows the head; export the project again")
    return photos, rest


def _tables(file, rest):
    """Control points and points (number, place, sigma), marks (photo, number, x, y)."""
    found = []
    for wide, whole, what in ((7, 1, "control points"), (7, 1, "points"), (6, 2, "marks")):
        if not rest and what == "marks":
            raise InputError(f"{file.name} ends before its marks; it is cut off")
        group = rest[0] if rest and len(rest[0][0].text.split()) == wide else []
        rows = []
        for line in group:
            words = line.words(wide, f"a line of the {what}")
            values = line.numbers(words, f"a line of the {what}")
            rows.append((*(line.whole(w, "a number") for w in words[:whole]), *values[whole:]))
        rest = rest[1:] if group else rest
        found.append(rows)
    control, points, marks = found
    if control and not points and marks:  # one table of points only: they are no control
        control, points = [], control
    if not marks:
        raise InputError(f"{file.name} holds no marks; export the project again")
    return control, points, marks


def _camera(name, inner, width, height, notes):
    f, xp, yp, format_x, format_y, k1, k2, k3, p1, p2 = inner
    if min(f, format_x, format_y) <= 0:
        raise InputError(f"camera {name}: focal length and format must be positive; export again")
    mm_x, mm_y = format_x / width, format_y / height
    if abs(mm_x / mm_y - 1) > 1e-4:
        notes.append(f"camera {name}: pixels are not square ({mm_x:.6g} x {mm_y:.6g} mm)")
    camera = camera_from(
        name, width, height, f / mm_y, xp / mm_x - 0.5, yp / mm_y - 0.5,
        b1=mm_y / mm_x - 1 if abs(mm_x / mm_y - 1) > 1e-6 else 0.0, pixel_um=1000 * mm_y,
    )  # fmt: skip
    if not any((k1, k2, k3, p1, p2)):
        return camera

    def ray(pixels):
        x = (pixels[:, 0] + 0.5) * mm_x - xp
        y = yp - (pixels[:, 1] + 0.5) * mm_y  # mm, y up
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        corrected = (
            x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y,
            y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y,
        )
        return np.column_stack([corrected[0] / f, -corrected[1] / f])

    camera, away = from_image_formula(camera, ray)
    notes.append(turned_note(camera, away))
    return camera
