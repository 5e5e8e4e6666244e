"""A COLMAP model in memory, as its files have it, and how it becomes a project."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.interchange.formats.colmap.cameras import HALF, camera_of
from corridor.interchange.project import (
    Project,
    images_table,
    matrices_of,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)

# COLMAP's "no point", as the text files and as the binary files write it.
NO_POINT = -1


@dataclass
class Model:
    """Everything a sparse model holds that we use.

    cameras: id -> model, width, height, parameters. pose: (n, 7) qw qx qy qz tx ty tz, world to
    camera. xy (m, 2), point (m,), image (m,: row of images): observations with a point.
    pose_place: file and line of each image, for sentences. rigs: id -> {camera id: (7,) pose of the
    camera in the rig, or None for the reference}. frames: rig id, pose (7,), [(camera id, image
    id)]. stated: counts that comments or headers promise.
    """

    path: Path
    cameras: dict[int, tuple[str, int, int, list[float]]] = field(default_factory=dict)
    image_id: list[int] = field(default_factory=list)
    image_name: list[str] = field(default_factory=list)
    image_camera: list[int] = field(default_factory=list)
    image_place: list[str] = field(default_factory=list)
    pose: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    xy: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    point: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    image: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    loose: int = 0
    point_id: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    point_xyz: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    tracked: int | None = None
    rigs: dict[int, dict[int, np.ndarray | None]] = field(default_factory=dict)
    frames: list[tuple[int, np.ndarray, list[tuple[int, int]]]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def project_of(model: Model, form: str, source: Path) -> Project:
    """The project of a model. Raises InputError where the files contradict each other."""
    if not model.image_id:
        raise InputError(f"{source} holds no image; name a model with registered images")
    notes: list[str] = []
    warnings = list(model.warnings)
    cameras, strange = _cameras(model, notes)
    rotation, translation = _poses(model, warnings)
    centre = -np.einsum("nji,nj->ni", rotation, translation)
    used = np.array([camera not in strange for camera in model.image_camera])
    for camera, why in strange.items():
        lost = sum(1 for other in model.image_camera if other == camera)
        warnings.append(f"{why}: its {lost} images were left out")
    if not used.any():
        raise InputError(f"{source}: {next(iter(strange.values()))}; nothing is left to import")

    names = [name for name, kept in zip(model.image_name, used, strict=True) if kept]
    tie = _observations(model, used, names, warnings)
    block = Block(
        name=source.resolve().name,
        cameras=cameras,
        images=images_table(
            names,
            [str(c) for c, kept in zip(model.image_camera, used, strict=True) if kept],
            centre[used],
            rotations_to_columns(rotation[used]),
        ),
        tie_points=same_point_once(tie, "observations", warnings),
        points=points_table(pd.Index(model.point_id).astype("str"), model.point_xyz),
    )
    if model.loose:
        notes.append(f"{model.loose} measured image points belong to no point and were left out")
    if any(pose is not None for rig in model.rigs.values() for pose in rig.values()):
        notes.append("cameras of a rig: each image keeps its own pose, the rig's ties are not kept")
    notes.append("a COLMAP model is in its own frame and scale unless it was aligned")
    return Project(form, source, block, notes=notes, warnings=warnings, placed=False)


def _cameras(model, notes):
    cameras, strange = {}, {}
    for number, (kind, width, height, params) in model.cameras.items():
        if number not in set(model.image_camera):
            continue
        try:
            cameras[str(number)] = camera_of(str(number), kind, width, height, params, notes)
        except InputError as error:
            if "has no model" not in str(error):
                raise InputError(f"{model.path}: {error}") from None
            strange[number] = str(error)
    return cameras, strange


def _poses(model, warnings):
    length = np.linalg.norm(model.pose[:, :4], axis=1)
    for row in np.flatnonzero(~(length > 1e-9)):
        raise InputError(
            f"{model.image_place[row]}: the quaternion has length zero; export the project again"
        )
    if (np.abs(length - 1) > 0.01).any():
        row = int(np.argmax(np.abs(length - 1)))
        warnings.append(
            f"{model.image_place[row]}: the quaternion has length {length[row]:.3g}; it was made "
            "a unit quaternion, as COLMAP does"
        )
    rotation, translation = matrices_of(model.pose[:, :4]), model.pose[:, 4:]
    if not model.frames:
        return rotation, translation
    # Since rigs exist, COLMAP itself takes the poses from the frames.
    row_of = {number: row for row, number in enumerate(model.image_id)}
    rotation, translation = rotation.copy(), translation.copy()
    moved = []
    for rig, pose, data in model.frames:
        turn, shift = matrices_of(pose[:4])[0], pose[4:]
        for camera, image in data:
            if image not in row_of:
                continue
            if rig not in model.rigs or camera not in model.rigs[rig]:
                raise InputError(
                    f"{model.path}: frames name camera {camera} of rig {rig}, which the rigs do "
                    "not have; export the project again"
                )
            sensor = model.rigs[rig][camera]
            if sensor is not None and np.isnan(sensor).any():
                continue  # a rig that was never calibrated: the image's own pose stands
            if sensor is None:
                found = turn, shift
            else:
                own = matrices_of(sensor[:4])[0]
                found = own @ turn, own @ shift + sensor[4:]
            row = row_of[image]
            away = np.linalg.norm(found[0].T @ found[1] - rotation[row].T @ translation[row])
            size = 1e-6 * (1 + np.linalg.norm(translation[row]))
            if np.abs(found[0] - rotation[row]).max() > 1e-6 or away > size:
                moved.append(model.image_name[row])
            rotation[row], translation[row] = found
    if moved:
        warnings.append(
            f"{len(moved)} images have another pose in the frames than in the images (first: "
            f"{moved[0]}); those of the frames were taken, as COLMAP does"
        )
    return rotation, translation


def _observations(model, used, names, warnings):
    keep = used[model.image]
    xy, point, image = model.xy[keep], model.point[keep], model.image[keep]
    order = np.argsort(model.point_id, kind="stable")
    ids = model.point_id[order]
    twice = np.flatnonzero(ids[1:] == ids[:-1])
    if len(twice):
        raise InputError(
            f"{model.path}: point {ids[twice[0]]} stands twice in the points; export it again"
        )
    at = np.searchsorted(ids, point)
    found = (at < len(ids)) & (ids[np.minimum(at, len(ids) - 1)] == point) if len(ids) else at < 0
    if not found.all():
        row = int(np.argmax(~found))
        raise InputError(
            f"{model.path}: image {names[(np.cumsum(used) - 1)[image[row]]]!r} sees point "
            f"{point[row]}, which the points do not have ({int((~found).sum())} such "
            "observations); the points are cut off or belong to another model"
        )
    if model.tracked is not None and model.tracked != len(model.point):
        warnings.append(
            f"the tracks of the points count {model.tracked} observations, the images "
            f"{len(model.point)}; those of the images were taken"
        )
    return observations_table(
        order[at],
        pd.Index(model.point_id).astype("str"),
        (np.cumsum(used) - 1)[image],
        names,
        xy - HALF,
    )
