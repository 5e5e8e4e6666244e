"""Pix4D: the text files of its folder `params`.

Conventions, where they differ from ours: K counts from the corner of the first pixel; tangential
T1, T2 are OpenCV's p1, p2 (our p2, p1); centre and rotation (world to camera, x right, y down, z
forward) are in a frame that lies `offset.xyz` from the world. Omega, phi, kappa of the external
parameters: R = diag(1, -1, -1) (Rx Ry Rz)'. BINGO tie points are in mm from the image centre, y
upwards, as measured (distortion not removed). Of a rig's secondary camera: its place in the
reference camera's frame, and M = (Rx Ry Rz)' from that camera to it; which images are of one
exposure no file says: their poses do.

Source: Pix4D support pages on the files of `params`; proved on real projects, the rig by the poses
of 253 exposures of five cameras.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from corridor.core.errors import InputError, some
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_angles,
    rotation_from_quaternion,
    vector_from_rotation,
)
from corridor.core.textfile import Line
from corridor.tools.formats.cameras import FLIP, camera_from, in_the_middle, shared
from corridor.tools.formats.frames import system_in
from corridor.tools.formats.names import Names, in_any_case
from corridor.tools.formats.programs.bingo import image_blocks
from corridor.tools.formats.project import (
    Contents,
    Project,
    Views,
    gnss_table,
    ground_table,
    hung_together,
)
from corridor.tools.formats.textfile import filled, opening

NAME = "pix4d"
TITLE = "Pix4D calibrated parameters and BINGO tie points"

_MAIN = "calibrated_camera_parameters.txt"
_EXTERNAL = "calibrated_external_camera_parameters.txt"
_SECONDARY = re.compile(r'(\d+)\s+".*"\s+(.*)')
# Images of one exposure put the reference camera at one place, m.
_SAME_M = 1e-3


def recognise(path: Path) -> bool:
    """A folder with calibrated_camera_parameters.txt, or one of Pix4D's parameter files."""
    if path.is_file():
        known = ("fileName imageWidth imageHeight", "imageName X Y Z Omega Phi Kappa")
        return opening(path, 200).startswith(known)
    return any(_find(folder, _MAIN) for folder in (path, in_any_case(path / "params")))


def _find(folder, *endings):
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    found = [file for end in endings for file in files if file.name.lower().endswith(end)]
    return found[0] if found else None


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and line."""
    folder = path if path.is_dir() else path.parent
    params = in_any_case(path / "params")
    if path.is_dir() and not _find(path, _MAIN) and params.is_dir():
        folder = params
    main = path if path.is_file() else _find(folder, _MAIN)
    if main is None:
        raise InputError(f"{folder} has no ..._{_MAIN}; name Pix4D's folder params")
    if opening(main, 200).startswith("imageName"):
        _external(main)
        raise InputError(
            f"{main.name} holds poses without a camera; put ..._{_MAIN} of the same project beside "
            "it and name the folder"
        )
    several = [f.name for f in sorted(folder.iterdir()) if f.name.lower().endswith(_MAIN)]
    if path.is_dir() and len(several) > 1:
        raise InputError(
            f"{folder} holds several projects ({', '.join(several[:3])}); name one of these files"
        )
    prefix = main.name[: -len(_MAIN)] if main.name.lower().endswith(_MAIN) else ""

    def beside(name: str) -> Path:
        return in_any_case(folder / f"{prefix}{name}")

    notes: list[str] = []
    warnings: list[str] = []
    shots = _shots(main)
    names = [shot.name for shot in shots]
    cameras, used = shared([shot.interior for shot in shots], "camera_{}".format, _camera)
    centre, rotation = (
        np.array([getattr(shot, key) for shot in shots]) for key in ("centre", "rotation")
    )
    external = beside(_EXTERNAL)
    offset = _offset(beside("offset.xyz"), external, dict(zip(names, centre, strict=True)), notes)
    if external.is_file():
        _compare(names, centre + offset, rotation, external, warnings)
    mine = [beside("tp_bingo.txt"), beside("bingo.txt")]
    bingo = next((file for file in mine if file.is_file()), None)
    bingo = bingo or _find(folder, "tp_bingo.txt", "bingo.txt")
    errors = beside(f"{_EXTERNAL[:-4]}_error.txt")
    project = Contents(
        name=folder.resolve().name
        if folder.name.lower() != "params"
        else folder.resolve().parent.name,
        cameras=cameras,
        images=names,
        used=used,
        centre=centre,
        rotation=rotation,
        ties=None if bingo is None else _bingo(bingo, names, used, cameras, notes),
        ground=_ground(beside("measured_estimated_gcps_position.txt"), offset),
        gnss=_gnss(errors, names, offset, notes),
        offset=offset,
        crs=_crs(beside("wkt.prj")),
        notes=notes,
        warnings=warnings,
    ).project(NAME, main)
    rig = beside("calibrated_rig_parameters.txt")
    return _with_rig(project, rig, _numbers(errors)) if rig.is_file() else project


def _cells(path):
    """Lines of a table between commas and their cells; none where there is no file."""
    for line in filled(path) if path.is_file() else ():
        yield line, [cell.strip() for cell in line.text.split(",")]


def _numbers(path):
    """Image -> the number that its camera has; what is not there is not known."""
    rows = [cells for _, cells in _cells(path)]
    known = rows and rows[0][:2] == ["imageName", "cameraIndex"]
    return {row[0]: row[1] for row in rows[1:]} if known else {}


def _with_rig(project, path, numbers):
    """The project with the rig of a file, its exposures by where images put the reference camera.

    Pix4D holds the places of the cameras and adjusts their turns.
    """
    mounted, reference = {}, None
    for line in filled(path, comment="#"):
        found = _SECONDARY.match(line.text.strip())
        if found and found[2].strip() == "reference":
            reference = found[1]
        elif found:
            *angles, x, y, z = line.numbers(found[2].split(), "the mounting")
            if len(angles) != 3:
                raise line.wrong(f"{3 + len(angles)} numbers where a mounting has six")
            mounted[found[1]] = rotation_from_angles(*angles).T, np.array([x, y, z])
    images = project.block.images["image"].tolist()
    number = np.array([numbers.get(image, "") for image in images])
    centre = project.block.poses[:, :3].copy()
    rotation = rotation_from_quaternion(project.block.poses[:, 3:])
    for key, (turn, place) in mounted.items():
        mine = number == key
        centre[mine] -= np.einsum("nji,j->ni", rotation[mine], turn @ place)
    first, others = np.flatnonzero(number == reference), np.flatnonzero(np.isin(number, [*mounted]))
    if not len(first) or not len(others):
        told = f"{path.name} states a rig, and no file says which images are of its cameras"
        return project.having(notes=[told])
    away, at = cKDTree(centre[first]).query(centre[others])
    near = away < _SAME_M
    leader = {images[i]: images[first[k]] for i, k in zip(others[near], at[near], strict=True)}
    # All images of an exposure state its one position; it is that of the reference camera.
    gnss = project.block.gnss
    copies = gnss["image"].isin(list(leader)) & gnss["image"].map(leader).isin(gnss["image"])
    project = hung_together(project.having(gnss=gnss[~copies].reset_index(drop=True)), leader)
    camera = dict(zip(number, project.block.images["camera"], strict=True))
    for rig in project.block.extra.get("rig", {}).values():
        for key in mounted:
            turn, place = mounted[key]
            if camera.get(key) in rig["member"]:
                quaternion = quaternion_from_rotation(turn)
                rig["member"][camera[key]] |= {
                    "xyz": place.tolist(), "quaternion": quaternion.tolist(), "sigma_m": 0.0
                }  # fmt: skip
    return project


@dataclass
class _Shot:
    """One image of the calibrated camera parameters.

    interior: width, height, fx, cx, fy, cy, K1, K2, K3, T1, T2.
    """

    name: str
    interior: tuple[float, ...]
    centre: np.ndarray
    rotation: np.ndarray


_PARTS = (
    *(("the camera matrix", 3),) * 3,
    ("the radial distortion", 3),
    ("the tangential distortion", 2),
    ("the position", 3),
    *(("the rotation", 3),) * 3,
)
_HEAD_LINES = 8


def _shots(path):
    found = filled(path)
    for count, line in enumerate(found, start=1):
        if line.text.strip().startswith("camera model"):
            break
        if count > _HEAD_LINES:
            raise line.wrong(
                "its eight lines of header are missing or another program's; export the "
                "calibrated camera parameters again"
            )
    shots: dict[str, _Shot] = {}
    for line in found:
        # The name may hold blanks; width and height are the last two.
        name, *size = line.text.strip().rsplit(maxsplit=2)
        if len(size) != 2 or not all(word.isdecimal() for word in size):
            raise line.wrong(
                f"{line.text.strip()[:40]!r} where an image name with width and height belongs; a "
                "line is missing or too many before it"
            )
        width, height = (line.whole(word, "the picture size", 2) for word in size)
        if name in shots:
            raise line.wrong(f"image {name!r} stands there twice")
        rows = []
        for what, count in _PARTS:
            line = next(found, None)
            if line is None:
                raise InputError(f"{path.name} ends within image {name!r}; it is cut off")
            rows.append(line.values(count, what))
        matrix = np.array(rows[:3])
        if matrix[0, 1] or matrix[1, 0] or matrix[2].tolist() != [0, 0, 1]:
            raise line.wrong(
                f"the camera matrix of {name!r} has skew or another last row than 0 0 1; the lines "
                "are out of step"
            )
        if min(matrix[0, 0], matrix[1, 1]) <= 0:
            raise InputError(f"camera of {name!r}: its focal length is not positive")
        inner = (width, height, *matrix[0, [0, 2]], *matrix[1, 1:], *rows[3], *rows[4])
        shots[name] = _Shot(name, inner, rows[5], np.array(rows[6:]))
    if not shots:
        raise InputError(f"{path.name} holds no image; export the project again")
    return list(shots.values())


def _camera(name, *interior):
    width, height, fx, cx, fy, cy, k1, k2, k3, t1, t2 = interior
    return camera_from(
        name, width, height, fy, cx - 0.5, cy - 0.5,
        k1=k1, k2=k2, k3=k3, p1=t2, p2=t1, b1=(fx - fy) / fy,
    )  # fmt: skip


def _offset(path, external, centre, notes):
    """From the frame of the poses to the world: of its file, else by the poses that are in it."""
    if not path.is_file():
        given = _external(external) if external.is_file() else {}
        both = [name for name in centre if name in given]
        apart = np.array([given[name][:3] - centre[name] for name in both]).reshape(-1, 3)
        if len(both) and np.ptp(apart, axis=0).max() < _SAME_M:
            notes.append(f"{path.name} is missing: its offset is that of {external.name}")
            return np.median(apart, axis=0)
        notes.append(f"{path.name} is missing: coordinates are those of the file")
        return np.zeros(3)
    for line in filled(path):
        return line.values(3, "the offset")
    raise InputError(f"{path.name} is empty; export the project again")


def _crs(path):
    """The system of the world: the EPSG code of its text, or the text; None without the file."""
    found = system_in(path, "--crs") if path.is_file() else None
    return found[0] if found and found[1].is_projected else None


def _external(path):
    """name -> centre (3,), omega, phi, kappa (degrees)."""
    found = {}
    for line in filled(path):
        if line.at > 1:
            name, *words = line.text.rsplit(maxsplit=6)
            if len(words) != 6:
                raise line.wrong(f"{len(words) + 1} words where a name and 6 numbers belong")
            found[name.strip()] = line.numbers(words, "the pose")
    return found


def _compare(names, centre, rotation, path, warnings):
    """The two files of poses must agree: then sense and offset are proved."""
    external = _external(path)
    rows = [k for k, name in enumerate(names) if name in external]
    if not rows:
        return
    pose = np.array([external[names[k]] for k in rows])
    away = np.abs(centre[rows] - pose[:, :3]).max()
    turned = np.array([rotation_from_angles(*angles) for angles in pose[:, 3:]])
    between = rotation[rows] @ turned @ FLIP.T
    off = np.linalg.norm(vector_from_rotation(between), axis=1).max()
    if away > 1e-3 or off > 2e-5:
        warnings.append(
            f"{path.name} and {_MAIN} disagree by up to {away:.3g} m and "
            f"{np.degrees(off):.2g} degrees; the latter was taken"
        )


def _gnss(path, names, offset, notes):
    wanted = ["imageName", *(f"{axis}_{kind}" for kind in ("gps", "acc") for axis in "XYZ")]
    rows, at = [], None
    for line, words in _cells(path):
        if at is None:
            if not set(wanted) <= set(words):
                return None
            at, width = [words.index(name) for name in wanted], len(words)
            continue
        if len(words) != width:
            raise line.wrong(f"{len(words)} cells where the header has {width}")
        if words[at[0]] in names:
            values = line.numbers([words[k] for k in at[1:]], "a position")
            rows.append((words[at[0]], *(values[:3] - offset), *values[3:]))
    if rows:
        notes.append("measured camera positions (X_gps, X_acc) became gnss.csv")
    return gnss_table(rows)


def _ground(path, offset):
    labels, places = [], []
    for line, words in _cells(path):
        if line.at == 1:
            continue
        if len(words) < 4:
            raise line.wrong(f"{len(words)} cells where 4 are needed")
        labels.append(words[0])
        places.append(line.numbers(words[1:4], "a measured position") - offset)
    return ground_table(labels, np.array(places)) if labels else None


def _bingo(path, names, used, cameras, notes):
    """An image with its size in mm (name H_width_height), its tie points, -99."""
    known, rows, lost = Names(names), [], []
    for head, points in image_blocks(path):
        name, width = _bingo_head(head)
        image = known.row(name)
        if image is None:
            lost.append(name)
        for line in points if image is not None else ():
            name, *xy = line.words(3, "a tie point")
            camera = cameras[used[image]]
            x, y = line.numbers(xy, "a tie point") * camera.width / width
            cx, cy = in_the_middle(camera.width, camera.height)
            rows.append((name, image, cx + x, cy - y))
    if lost:
        notes.append(
            f"{path.name}: {len(lost)} images are not among the calibrated ones, or their names "
            f"stand for several: left out ({some(lost, 5)})"
        )
    return Views.of(rows, "tie points")


def _bingo_head(line: Line) -> tuple[str, float]:
    # The name may hold blanks.
    name, *size = line.text.strip().rsplit(maxsplit=1)
    sides = size[0].split("_") if size else []
    if len(sides) != 3:
        raise line.wrong(
            f"{line.text.strip()[:40]!r} where an image with its size in mm (H_width_height) "
            "belongs; a line -99 is missing or too many"
        )
    width = line.number(sides[1], "the width in mm")
    if width <= 0:
        raise line.wrong(f"the width is {width:g} mm; write the width of the picture in mm")
    return name.strip(), width
