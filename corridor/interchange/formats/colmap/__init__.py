"""COLMAP sparse models: cameras, images, points3D, and since COLMAP 3.12 rigs and frames.

Conventions, where they differ from ours: (0.5, 0.5) is the centre of the top-left pixel; p1, p2 are
OpenCV's; the pose is the quaternion world to camera and t = -R C, not the centre. The same model
may be there as text and as binary files; the binary ones are taken then.
"""

from pathlib import Path

import pandas as pd

from corridor.block import Block
from corridor.camera import Camera
from corridor.errors import InputError
from corridor.interchange.formats.colmap import writing
from corridor.interchange.formats.colmap.binary import read_binary
from corridor.interchange.formats.colmap.cameras import holdable, not_held
from corridor.interchange.formats.colmap.model import project_of
from corridor.interchange.formats.colmap.text import read_text
from corridor.interchange.project import Project, ground_table

NAME = "colmap"
TITLE = "COLMAP sparse model, text or binary"
WRITES = ("colmap", "colmap-text")
HOLDS = "f, cx, cy, k1, k2, k3, p1, p2 (b1 without distortion)"

_FILES = ("cameras", "images", "points3D")


def recognise(path: Path) -> bool:
    """A folder with the files of a model, or one of them."""
    folder = path if path.is_dir() else path.parent
    if path.is_file() and path.stem not in (*_FILES, "rigs", "frames"):
        return False
    return any((folder / f"images{end}").is_file() for end in (".bin", ".txt")) and any(
        (folder / f"cameras{end}").is_file() for end in (".bin", ".txt")
    )


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a model's folder. Raises InputError naming file, line or byte."""
    folder = path if path.is_dir() else path.parent
    for inner in (".", "sparse", "sparse/0"):
        if any((folder / inner / f"images{end}").is_file() for end in (".bin", ".txt")):
            folder = folder / inner
            break
    binary = (folder / "images.bin").is_file()
    if not binary and not (folder / "images.txt").is_file():
        raise InputError(f"{folder} has neither images.bin nor images.txt; name a COLMAP model")
    project = project_of((read_binary if binary else read_text)(folder), NAME, folder)
    if binary and (folder / "images.txt").is_file():
        project.notes.append("the folder holds the model twice; its binary files were read")
    ground = writing.read_ground(folder)
    if ground is not None:
        _name_ground(project, ground)
    return project


def _name_ground(project: Project, ground: pd.DataFrame) -> None:
    """Points that corridor wrote from marks become marks again."""
    block = project.block
    names = dict(zip(ground["POINT3D_ID"], ground["point"], strict=True))
    lost = set(names) - set(block.points["point"])
    if lost:
        raise InputError(
            f"ground_points.csv names point {min(lost)}, which the model does not have; delete it "
            "or take both from one export"
        )
    marks = block.tie_points["point"].isin(names)
    table = block.tie_points[marks].copy()
    table["point"] = table["point"].cat.remove_unused_categories().cat.rename_categories(names)
    table["image"] = table["image"].cat.set_categories(list(block.images["image"]))
    ties = block.tie_points[~marks].copy()
    ties["point"] = ties["point"].cat.remove_unused_categories()
    points = block.points.assign(point=block.points["point"].replace(names))
    given = ground[ground[["x", "y", "z"]].notna().all(axis=1)]
    project.notes.append(
        f"ground_points.csv names {len(ground)} ground points, {len(given)} with coordinates"
    )
    project.block = Block(
        **{
            **vars(block),
            "tie_points": ties.reset_index(drop=True),
            "marks": table.reset_index(drop=True),
            "points": points,
            "ground": ground_table(
                list(given["point"]),
                given[["x", "y", "z"]].to_numpy(),
                given[["sx", "sy", "sz"]].to_numpy() if "sx" in given else None,
                list(given["role"]),
            ),
        }
    )


def unheld(camera: Camera) -> list[str]:
    """Interior parameters, not zero, that the format cannot hold."""
    return not_held(camera)


def nearest(camera: Camera) -> Camera:
    """The nearest camera that the format holds."""
    return holdable(camera)


def losses(block: Block) -> list[str]:
    """What else the format cannot hold, and where it went instead."""
    lost = []
    if len(block.marks):
        lost.append("ground points: they go as points, ground_points.csv says which and where")
    if len(block.gnss):
        lost.append("GNSS: the camera centres it gives are in reference.txt")
    if len(block.tie_points) and "sigma" in block.tie_points:
        lost.append("sigmas of single observations")
    return lost


def write(block: Block, folder: Path, name: str) -> None:
    """Write the model into a folder; name: colmap (binary) or colmap-text."""
    writing.write(block, folder, text=name == "colmap-text")
