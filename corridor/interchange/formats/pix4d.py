"""Pix4D: the text files of its folder `params`.

Conventions, where they differ from ours: K counts from the corner of the first pixel; tangential
T1, T2 are OpenCV's p1, p2 (our p2, p1); centre and rotation (world to camera, x right, y down, z
forward) are in a frame that lies `offset.xyz` from the world. Omega, phi, kappa of the external
parameters: R = diag(1, -1, -1) (Rx Ry Rz)'. BINGO tie points are in mm from the image centre, y
upwards, as measured (distortion not removed).

Source: Pix4D support pages on the files of `params`; proved on a real project.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.geometry import rotation_from_angles
from corridor.interchange.project import (
    Project,
    camera_from,
    ground_table,
    images_table,
    in_the_middle,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)
from corridor.interchange.rows import rows_of
from corridor.interchange.text import lines, number, numbers, opening, whole

NAME = "pix4d"
TITLE = "Pix4D calibrated parameters and BINGO tie points"

_MAIN = "calibrated_camera_parameters.txt"
_EXTERNAL = "calibrated_external_camera_parameters.txt"
_FLIP = np.diag([1.0, -1.0, -1.0])


def recognise(path: Path) -> bool:
    """A folder with calibrated_camera_parameters.txt, or one of Pix4D's parameter files."""
    if path.is_file():
        head = opening(path, 200)
        return head.startswith("fileName imageWidth imageHeight") or head.startswith(
            "imageName X Y Z Omega Phi Kappa"
        )
    return any(path.glob(f"*{_MAIN}")) or any((path / "params").glob(f"*{_MAIN}"))


def _find(folder, ending):
    found = [file for file in sorted(folder.glob(f"*{ending}"))]
    return found[0] if found else None


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and line."""
    folder = path if path.is_dir() else path.parent
    if path.is_dir() and not any(path.glob(f"*{_MAIN}")) and (path / "params").is_dir():
        folder = path / "params"
    main = path if path.is_file() else _find(folder, _MAIN)
    if main is None:
        raise InputError(f"{folder} has no ..._{_MAIN}; name Pix4D's folder params")
    if opening(main, 200).startswith("imageName"):
        _external(main)
        raise InputError(
            f"{main.name} holds poses without a camera; put ..._{_MAIN} of the same project beside "
            "it and name the folder"
        )
    prefix = main.name[: -len(_MAIN)] if main.name.endswith(_MAIN) else ""
    notes: list[str] = []
    warnings: list[str] = []
    shots = _shots(main)
    offset = _offset(folder / f"{prefix}offset.xyz", notes)
    cameras, used = _cameras(shots)
    names = [shot["name"] for shot in shots]
    block = Block(
        name=folder.resolve().name if folder.name != "params" else folder.resolve().parent.name,
        cameras=cameras,
        images=images_table(
            names, used, np.array([shot["centre"] for shot in shots]),
            rotations_to_columns(np.array([shot["rotation"] for shot in shots])),
        ),
        offset=offset,
    )  # fmt: skip
    external = folder / f"{prefix}{_EXTERNAL}"
    if external.is_file():
        _compare(block, _external(external), warnings, external.name)
    block.gnss = _gnss(folder / f"{prefix}{_EXTERNAL[:-4]}_error.txt", names, offset, notes)
    block.ground = _ground(folder / f"{prefix}measured_estimated_gcps_position.txt", offset)
    block.__post_init__()
    bingo = next(
        (file for ending in ("tp_bingo.txt", "bingo.txt") if (file := _find(folder, ending))), None
    )
    if bingo is not None:
        _bingo(bingo, block, notes, warnings)
    return Project(NAME, main, block, notes=notes, warnings=warnings)


_PARTS = (
    ("the camera matrix", 3), ("the camera matrix", 3), ("the camera matrix", 3),
    ("the radial distortion", 3), ("the tangential distortion", 2), ("the position", 3),
    ("the rotation", 3), ("the rotation", 3), ("the rotation", 3),
)  # fmt: skip


def _shots(path):
    found = ((line, text) for line, text in lines(path) if text.strip())
    head = []
    for line, text in found:
        head.append((line, text.strip()))
        if text.strip().startswith("camera model"):
            break
        if len(head) > 8:
            raise InputError(
                f"{path.name}, line {line}: its eight lines of header are missing or another "
                "program's; export the calibrated camera parameters again"
            )
    shots, known = [], set()
    for line, text in found:
        words = text.split()
        # The name may hold blanks; width and height are the last two.
        if len(words) < 3 or not (words[-1].isdecimal() and words[-2].isdecimal()):
            raise InputError(
                f"{path.name}, line {line}: {text.strip()[:40]!r} where an image name with width "
                "and height belongs; a line is missing or too many before it"
            )
        name = text.rsplit(maxsplit=2)[0].strip()
        width, height = (whole(word, path, line, "the picture size", 2) for word in words[-2:])
        if name in known:
            raise InputError(f"{path.name}, line {line}: image {name!r} stands there twice")
        known.add(name)
        rows = []
        for what, count in _PARTS:
            line, text = next(found, (line, None))
            if text is None:
                raise InputError(f"{path.name} ends within image {name!r}; it is cut off")
            words = text.split()
            if len(words) != count:
                raise InputError(
                    f"{path.name}, line {line}: {len(words)} numbers where {what} of {name!r} has "
                    f"{count}; a line is missing or cut off"
                )
            rows.append(numbers(words, path, line, what))
        matrix = np.array(rows[:3])
        if matrix[0, 1] or matrix[1, 0] or matrix[2].tolist() != [0, 0, 1]:
            raise InputError(
                f"{path.name}, line {line}: the camera matrix of {name!r} has skew or another last "
                "row than 0 0 1; the lines are out of step"
            )
        shots.append(
            {
                "name": name, "width": width, "height": height, "matrix": matrix,
                "radial": rows[3], "tangential": rows[4], "centre": rows[5],
                "rotation": np.array(rows[6:]),
            }
        )  # fmt: skip
    if not shots:
        raise InputError(f"{path.name} holds no image; export the project again")
    return shots


def _cameras(shots):
    cameras, used, known = {}, [], {}
    for shot in shots:
        inner = (
            shot["width"], shot["height"], *shot["matrix"].ravel(), *shot["radial"],
            *shot["tangential"],
        )  # fmt: skip
        if inner not in known:
            known[inner] = name = f"camera_{len(known)}"
            fx, fy = shot["matrix"][0, 0], shot["matrix"][1, 1]
            if not (fx > 0 and fy > 0):
                raise InputError(f"camera of {shot['name']!r}: its focal length is not positive")
            k, (t1, t2) = shot["radial"], shot["tangential"]
            cameras[name] = camera_from(
                name, shot["width"], shot["height"], fy, shot["matrix"][0, 2] - 0.5,
                shot["matrix"][1, 2] - 0.5, k1=k[0], k2=k[1], k3=k[2], p1=t2, p2=t1,
                b1=(fx - fy) / fy,
            )  # fmt: skip
        used.append(known[inner])
    return cameras, used


def _offset(path, notes):
    if not path.is_file():
        notes.append(f"{path.name} is missing: coordinates are those of the file")
        return np.zeros(3)
    for line, text in lines(path):
        if text.strip():
            words = text.split()
            if len(words) != 3:
                raise InputError(f"{path.name}, line {line}: {len(words)} numbers where 3 belong")
            return numbers(words, path, line, "the offset")
    raise InputError(f"{path.name} is empty; export the project again")


def _external(path):
    """name -> centre (3,), omega, phi, kappa (degrees)."""
    found = {}
    for line, text in lines(path):
        if line == 1 or not text.strip():
            continue
        words = text.rsplit(maxsplit=6)
        if len(words) != 7:
            raise InputError(
                f"{path.name}, line {line}: {len(words)} words where a name and 6 numbers belong"
            )
        found[words[0].strip()] = numbers(words[1:], path, line, "the pose")
    return found


def _compare(block, external, warnings, file):
    """The two files of poses must agree: then sense and offset are proved."""
    names = list(block.images["image"])
    rows = [k for k, name in enumerate(names) if name in external]
    if not rows:
        return
    pose = np.array([external[names[k]] for k in rows])
    away = np.abs(block.images[["x", "y", "z"]].to_numpy()[rows] + block.offset - pose[:, :3]).max()
    turned = np.array([_FLIP @ rotation_from_angles(*angles).T for angles in pose[:, 3:]])
    quaternion = block.images[["qw", "qx", "qy", "qz"]].to_numpy()[rows]
    near = np.abs((rotations_to_columns(turned) * quaternion).sum(axis=1)).min()
    if away > 1e-3 or near < np.cos(1e-5):
        warnings.append(
            f"{file} and {_MAIN} disagree by up to {away:.3g} m and "
            f"{np.degrees(2 * np.arccos(min(near, 1.0))):.2g} degrees; the latter was taken"
        )


def _gnss(path, names, offset, notes):
    if not path.is_file():
        return None
    rows, header = [], None
    for line, text in lines(path):
        words = [word.strip() for word in text.split(",")]
        if header is None:
            header = words
            wanted = ["imageName", *(f"{axis}_{kind}" for kind in ("gps", "acc") for axis in "XYZ")]
            if not set(wanted) <= set(header):
                return None
            at = [header.index(name) for name in wanted]
        elif text.strip():
            if len(words) != len(header):
                raise InputError(
                    f"{path.name}, line {line}: {len(words)} cells where the header has "
                    f"{len(header)}"
                )
            if words[at[0]] in names:
                values = numbers([words[k] for k in at[1:]], path, line, "a position")
                rows.append((words[at[0]], *(values[:3] - offset), *values[3:]))
    if not rows:
        return None
    notes.append("measured camera positions (X_gps, X_acc) became gnss.csv")
    table = pd.DataFrame(rows, columns=["image", "x", "y", "z", "sx", "sy", "sz"])
    sigma = table[["sx", "sy", "sz"]]
    table[["sx", "sy", "sz"]] = sigma.where(sigma > 0)
    return table


def _ground(path, offset):
    if not path.is_file():
        return None
    labels, places = [], []
    for line, text in lines(path):
        words = [word.strip() for word in text.split(",")]
        if line == 1 or not text.strip():
            continue
        if len(words) < 4:
            raise InputError(f"{path.name}, line {line}: {len(words)} cells where 4 are needed")
        labels.append(words[0])
        places.append(numbers(words[1:4], path, line, "a measured position") - offset)
    return ground_table(labels, np.array(places)) if labels else None


def _bingo(path, block, notes, warnings):
    names = list(block.images["image"])
    stems: dict[str, int] = {}
    for k, name in enumerate(names):
        stems.setdefault(name, k)
        stems.setdefault(name.rpartition(".")[0] or name, k)
    sizes = [
        (block.cameras[camera].width, block.cameras[camera].height)
        for camera in block.images["camera"]
    ]
    point, image, pixels = [], [], []
    current, lost, scale, middle, unfinished = None, 0, 1.0, (0.0, 0.0), False
    for line, text in lines(path):
        words = text.split()
        if not words:
            continue
        if words == ["-99"]:
            current, unfinished = None, False
            continue
        if not unfinished:
            # name H_width_height: the name may hold blanks
            head = text.rsplit(maxsplit=1)
            sides = head[-1].split("_") if len(head) == 2 else []
            if len(sides) != 3:
                raise InputError(
                    f"{path.name}, line {line}: {text.strip()[:40]!r} where an image with its size "
                    "in mm (H_width_height) belongs; a line -99 is missing or too many"
                )
            width = number(sides[1], path, line, "the width in mm")
            current, unfinished = stems.get(head[0].strip(), -1), True
            lost += current < 0
            if width <= 0:
                raise InputError(f"{path.name}, line {line}: the width {width:g} mm is none")
            if current >= 0:
                scale = sizes[current][0] / width
                middle = in_the_middle(*sizes[current])
            continue
        if len(words) != 3:
            raise InputError(
                f"{path.name}, line {line}: {len(words)} words where a tie point has 3; the file "
                "is cut off or out of step"
            )
        if current < 0:
            continue
        x, y = (number(word, path, line, "a tie point") for word in words[1:])
        point.append(words[0])
        image.append(current)
        pixels.append((x * scale + middle[0], middle[1] - y * scale))
    if unfinished:
        raise InputError(f"{path.name} ends without -99 after the last image; it is cut off")
    if lost:
        notes.append(f"{path.name}: {lost} images are not among the calibrated ones: left out")
    if not point:
        return
    codes, found = pd.factorize(np.array(point, dtype=object))
    table = observations_table(
        codes, pd.Index(found, dtype="str"), np.array(image), names, np.array(pixels)
    )
    taken = set(block.ground["point"])
    if taken & set(found):
        table["point"] = table["point"].cat.rename_categories(lambda name: f"t{name}")
    block.tie_points = same_point_once(table, "tie points", warnings)
    block.__post_init__()
    rows = rows_of(block, complete=False)
    good = np.isfinite(rows.positions).all(axis=1)
    good[rows.ties :] = False
    block.points = points_table(rows.point_names[good], rows.positions[good])
    block.__post_init__()
    notes.append("Pix4D exports no coordinates of tie points: they were intersected from the rays")
