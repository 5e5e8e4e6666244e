"""PhotoModeler text export (*-pmexport.txt).

Conventions, where they differ from ours: the camera has y up and looks along -z, so that
R = diag(1, -1, -1) (Rx(omega) Ry(phi) Rz(kappa))'; angles are written kappa, phi, omega in degrees.
The principal point is counted in mm from the top left corner, pixels from the corner of the first
one. Distortion (K1..K3, P1, P2, in mm) takes the image to the ray.

Source: DBAT (Börlin and Grussenmeyer), documentation of its loadpm; PhotoModeler's manual.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.geometry import rotation_from_angles
from corridor.interchange.cameras import from_image_formula
from corridor.interchange.project import (
    Project,
    camera_from,
    ground_table,
    images_table,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)
from corridor.interchange.text import lines, numbers, opening, whole

NAME = "photomodeler"
TITLE = "PhotoModeler text export"

_FLIP = np.diag([1.0, -1.0, -1.0])


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
    return widths == [4, 9, 10, 10]


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
    line, words = head[1]
    if len(words) != 4:
        raise InputError(f"{file.name}, line {line}: {len(words)} words where 4 belong")
    width, height = (whole(word, file, line, "the picture size", 2) for word in words[2:])
    notes: list[str] = []
    warnings: list[str] = []
    photos, rest = _photos(file, head[5:], rest)
    line, words = head[3]
    common = numbers(words, file, line, "the camera of the head")
    for photo in photos:
        # The head prints the same camera with more digits.
        if len(common) == 10 and np.abs(photo["inner"] - common).max() <= 0.00051:
            photo["inner"] = common
    control, points, marks = _tables(file, rest)
    cameras, used = _cameras(photos, width, height, notes)
    rotation = np.array(
        [_FLIP @ rotation_from_angles(*photo["angles"][::-1]).T for photo in photos]
    )
    centre = np.array([photo["centre"] for photo in photos])
    names = [photo["name"] for photo in photos]
    codes = {photo["number"]: k for k, photo in enumerate(photos)}
    unknown = [row for row in marks if row[0] not in codes]
    if unknown:
        raise InputError(f"{file.name}: a mark names photo {unknown[0][0]}, which is not there")
    everything = pd.Index(dict.fromkeys(str(row[1]) for row in marks), dtype="str")
    table = observations_table(
        everything.get_indexer([str(row[1]) for row in marks]),
        everything,
        np.array([codes[row[0]] for row in marks], dtype=np.int64),
        names,
        np.array([row[2:4] for row in marks]).reshape(-1, 2) - 0.5,
    )
    table = same_point_once(table, "marks", warnings)
    given = {str(number): (place, sigma) for number, place, sigma in control}
    known = {str(number): place for number, place, _ in [*control, *points]}
    is_ground = table["point"].isin(given).to_numpy()
    block = Block(
        name=file.stem,
        cameras=cameras,
        images=images_table(names, used, centre, rotations_to_columns(rotation)),
        tie_points=_only(table, ~is_ground),
        marks=_only(table, is_ground),
        points=points_table(list(known), np.array(list(known.values()))),
        ground=ground_table(
            list(given), np.array([p for p, _ in given.values()]).reshape(-1, 3),
            np.array([np.where(s > 0, s, np.nan) for _, s in given.values()]).reshape(-1, 3),
        ),
    )  # fmt: skip
    if given:
        notes.append(
            f"{len(given)} control points: the export writes the coordinates it adjusted; "
            "--ground FILE gives those that were surveyed"
        )
    return Project(NAME, file, block, notes=notes, warnings=warnings)


def _only(table, rows):
    kept = table[rows].reset_index(drop=True)
    kept["point"] = kept["point"].cat.remove_unused_categories()
    return kept


def _groups(file):
    """Lines as words, in groups between blank lines; the first photo stands after the head."""
    groups, group = [], []
    for line, text in lines(file):
        if text.strip():
            group.append((line, text.split()))
        elif group:
            groups.append(group)
            group = []
    return [*groups, group] if group else groups


def _photos(file, first, rest):
    """Photos: three lines, a blank line, two lines of camera; the next one follows those."""
    photos, pending = [], first
    while rest:
        if len(pending) != 3:
            break
        (line, name), (pose_line, pose), _ = pending
        if len(name) < 2 or len(pose) != 7:
            raise InputError(f"{file.name}, line {line}: this is no photo; export it again")
        number = whole(name[0], file, line, "a photo number")
        values = numbers(pose[1:], file, pose_line, f"the pose of photo {number}")
        camera, *after = rest
        if len(camera) < 2 or len(camera[0][1]) != 11:
            raise InputError(
                f"{file.name}, line {camera[0][0]}: this is no camera of photo {number}; the file "
                "is cut off or out of step"
            )
        inner = numbers(camera[0][1][1:], file, camera[0][0], f"the camera of photo {number}")
        photos.append(
            {
                "number": number,
                "name": " ".join(name[1:]).replace("\\", "/").rpartition("/")[2],
                "centre": values[:3],
                "angles": values[3:],
                "inner": inner,
            }
        )
        pending, rest = camera[2:], after
    if not photos:
        raise InputError(f"{file.name} holds no photo; export the project again")
    return photos, rest


def _tables(file, rest):
    """Control points, points (number, place, sigma) and marks (photo, number, x, y)."""
    found = []
    for wide, what in ((7, "control points"), (7, "points"), (6, "marks")):
        rows = []
        if not rest and what == "marks":
            raise InputError(f"{file.name} ends before its marks; it is cut off")
        group = rest[0] if rest and len(rest[0][0][1]) == wide else []
        for line, words in group:
            if len(words) != wide:
                raise InputError(
                    f"{file.name}, line {line}: {len(words)} words where {what} have {wide}; the "
                    "file is cut off or out of step"
                )
            values = numbers(words, file, line, f"a line of the {what}")
            if wide == 7:
                rows.append((whole(words[0], file, line, "a number"), values[1:4], values[4:]))
            else:
                photo, point = (whole(word, file, line, "a number") for word in words[:2])
                rows.append((photo, point, *values[2:4]))
        rest = rest[1:] if group else rest
        found.append(rows)
    control, points, marks = found
    if control and not points and marks:  # one table of points only: they are no control
        control, points = [], control
    if not marks:
        raise InputError(f"{file.name} holds no marks; export the project again")
    return control, points, marks


def _cameras(photos, width, height, notes):
    cameras, used, known = {}, [], {}
    for photo in photos:
        key = tuple(photo["inner"])
        if key not in known:
            known[key] = name = "camera" if not known else f"camera_{len(known)}"
            cameras[name] = _camera(name, photo["inner"], width, height, notes)
        used.append(known[key])
    return cameras, used


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

    return from_image_formula(camera, ray, notes, f"camera {name}")
