"""COLMAP sparse models: cameras, images, points3D, and since COLMAP 3.12 rigs and frames.

Conventions, where they differ from ours: (0.5, 0.5) is the centre of the top-left pixel; p1, p2 are
OpenCV's; the pose is the quaternion world to camera and t = -R C, not the centre. The same model
may be there as text and as binary files; the binary ones are taken then.

Ground points measured in images go out as points too; ground_points.csv beside the model says which
they are, and reference.txt holds the camera centres that GNSS gives (image x y z, as COLMAP's
model_aligner reads them). COLMAP itself knows neither.
"""

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.tools.formats.cameras import where_known
from corridor.tools.formats.columns import grouped, numbered
from corridor.tools.formats.names import in_any_case
from corridor.tools.formats.programs.colmap import records
from corridor.tools.formats.programs.colmap.cameras import (
    BY_NUMBER,
    HALF,
    MODELS,
    camera_of,
    params_of,
)
from corridor.tools.formats.programs.colmap.cameras import HOLDS as HOLDS
from corridor.tools.formats.programs.colmap.frames import write_rigs
from corridor.tools.formats.programs.colmap.ground import read_ground, write_ground
from corridor.tools.formats.project import (
    Contents,
    Project,
    Views,
    ground_table,
    hung_together,
    matrices_of,
)
from corridor.tools.formats.rows import Rows, camera_positions, rows_of

NAME = "colmap"
TITLE = "COLMAP sparse model, text or binary"
WRITES = ("colmap", "colmap-text")
LOSSES = {
    "marks": "ground points: they go as points, ground_points.csv says which and where",
    "GNSS": "GNSS: the camera centres it gives are in reference.txt",
    "sigmas": "sigmas of single observations",
    "unlike rigs": "rigs whose images do not stand as they say: adjust first; each image is alone",
}
RIGS = True

_FILES = ("cameras", "images", "points3D")


def recognise(path: Path) -> bool:
    """A folder with the files of a model, or one of them."""
    folder = path if path.is_dir() else path.parent
    stems = [stem.lower() for stem in (*_FILES, "rigs", "frames")]
    if path.is_file() and path.stem.lower() not in stems:
        return False
    return _has(folder, "images") and _has(folder, "cameras")


def _has(folder: Path, stem: str) -> bool:
    return any(in_any_case(folder / f"{stem}{end}").is_file() for end in (".bin", ".txt"))


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a model's folder. Raises InputError naming file, line or byte."""
    folder = path if path.is_dir() else path.parent
    for inner in (".", "sparse", "sparse/0"):
        if _has(folder / inner, "images"):
            folder = folder / inner
            break
    binary = in_any_case(folder / "images.bin").is_file()
    if not binary and not _has(folder, "images"):
        raise InputError(f"{folder} has neither images.bin nor images.txt; name a COLMAP model")
    project = _Model(folder, binary).project()
    if binary and (folder / "images.txt").is_file():
        project.notes.append("the folder holds the model twice; its binary files were read")
    ground = read_ground(folder)
    return project if ground is None else _with_ground(project, ground)


def _with_ground(project: Project, ground: pd.DataFrame) -> Project:
    """Points that corridor wrote from marks become marks again."""
    block = project.block
    names = dict(zip(ground["POINT3D_ID"], ground["point"], strict=True))
    lost = set(names) - set(block.points["point"])
    if lost:
        raise InputError(
            f"ground_points.csv names point {min(lost)}, which the model does not have; delete it "
            "or take both from one export"
        )
    marked = block.tie_points["point"].isin(names)
    ties, marks = block.tie_points[~marked].copy(), block.tie_points[marked].copy()
    ties["point"] = ties["point"].cat.remove_unused_categories()
    marks["point"] = marks["point"].cat.remove_unused_categories().cat.rename_categories(names)
    given = ground[ground[["x", "y", "z"]].notna().all(axis=1)]
    return project.having(
        notes=[
            f"ground_points.csv names {len(ground)} ground points, {len(given)} with coordinates"
        ],
        tie_points=ties.reset_index(drop=True),
        marks=marks.reset_index(drop=True),
        points=block.points.assign(point=block.points["point"].replace(names)),
        ground=ground_table(
            list(given["point"]),
            given[["x", "y", "z"]].to_numpy(),
            given[["sx", "sy", "sz"]].to_numpy() if "sx" in given else None,
            list(given["role"]),
        ),
    )


class _Model:
    """A sparse model as its files have it.

    cameras: id -> model, width, height, parameters. ids, names, used, places: of the images: id,
    name, camera id, file and line for sentences. pose (n, 7): qw qx qy qz tx ty tz, world to
    camera. xy (m, 2), point (m,), image (m,: row of images): observations with a point.
    """

    def __init__(self, folder: Path, binary: bool):
        self.folder, self.notes, self.warnings = folder, [], []
        self._kind = records.BinaryFile if binary else records.TextFile
        self.cameras = self._cameras()
        self._images()
        self.point_ids, self.point_places, self.tracked = self._file("points3D").points()
        with_frames = in_any_case(folder / f"frames{'.bin' if binary else '.txt'}").is_file()
        self.rigs = self._rigs() if with_frames else {}
        self.frames = self._frames() if with_frames else []

    def _file(self, stem):
        return self._kind(self.folder, stem, self.warnings)

    # --- files ---------------------------------------------------------------------------

    def _cameras(self):
        cameras = {}
        for record in self._file("cameras").records():
            number, kind, width, height = record.take(records.CAMERA)
            if kind not in BY_NUMBER:
                raise record.wrong(f"camera model {kind} is unknown; use one of COLMAP's")
            if number in cameras:
                raise record.wrong(f"camera {number} stands there twice; delete one")
            model = BY_NUMBER[kind]
            params = record.take((("d", "PARAMS"),) * MODELS[model][1])
            cameras[number] = model, width, height, params
        return cameras

    def _images(self):
        found, seen, loose = {}, [], 0
        for record in self._file("images").records(split=9):
            number, *pose, camera = record.take(records.IMAGE)
            name = record.name().strip()
            if camera not in self.cameras:
                file = f"cameras{record.path.suffix}"
                raise record.wrong(
                    f"camera {camera} is not in {file}; take both files from one model"
                )
            if number in found:
                raise record.wrong(f"image {number} stands there twice; delete one")
            found[number] = name, camera, record.place, pose
            xy, ids = record.image_points()
            known = ids >= 0
            if not np.isfinite(xy[known]).all():
                raise record.wrong("an image point is not finite; export the project again")
            seen.append((xy[known], ids[known]))
            loose += int((~known).sum())
        if not found:
            raise InputError(f"{self.folder} holds no image; name a model with registered images")
        self.ids = list(found)
        self.names, self.used, self.places, poses = map(list, zip(*found.values(), strict=True))
        self.pose = np.array(poses)
        self.xy, self.point = map(np.concatenate, zip(*seen, strict=True))
        count = [len(ids) for _, ids in seen]
        self.image = np.repeat(np.arange(len(count), dtype=np.int32), count)
        if loose:
            self.notes.append(f"{loose} measured image points belong to no point and were left out")

    def _rigs(self):
        """Rig id -> {camera id: (7,) its pose in the rig; None for the reference, NaN unknown}."""
        rigs = {}
        for record in self._file("rigs").records():
            rig, sensors = record.take(records.RIG)
            members = rigs.setdefault(rig, {})
            for k in range(sensors):
                kind, number, *has = record.take(records.OTHER_SENSOR if k else records.SENSOR)
                if has and has[0] not in (0, 1):
                    raise record.wrong("HAS_POSE is neither 0 nor 1; export it again")
                pose = np.full(7, np.nan) if has else None
                if has == [1]:
                    pose = _with_length(np.array(record.take(records.POSE)), record)
                if kind == 0:
                    members[number] = pose
        return rigs

    def _frames(self):
        """Rig id, pose (7,), [(camera id, image id)] of each frame."""
        frames = []
        for record in self._file("frames").records():
            _, rig, *pose, count = record.take(records.FRAME)
            data = [record.take(records.DATA) for _ in range(count)]
            images = [(number, image) for kind, number, image in data if kind == 0]
            frames.append((rig, _with_length(np.array(pose), record), images))
        return frames

    # --- project -------------------------------------------------------------------------

    def project(self) -> Project:
        """The project of the model. Raises InputError where the files contradict each other."""
        twice = next((name for name, times in Counter(self.names).items() if times > 1), None)
        if twice is not None:
            raise InputError(
                f"{self.folder}: two images are named {twice!r}, and a COLMAP model has each name "
                "once; write the model again, with the folders of the photographs in their names"
            )
        rotation, translation = self._poses()
        ties = self._ties()
        pieces = Contents(
            name=self.folder.resolve().name,
            cameras=where_known(map(str, self.used), self._camera),
            images=self.names,
            used=[str(number) for number in self.used],
            centre=-np.einsum("nji,nj->ni", rotation, translation),
            rotation=rotation,
            ties=ties,
            points=(ties.names, self.point_places),
            notes=self.notes,
            warnings=self.warnings,
        )
        self.notes.append("a COLMAP model is in its own frame and scale unless it was aligned")
        return hung_together(pieces.project(NAME, self.folder, placed=False), self._leaders())

    def _leaders(self):
        """Image -> that of the reference sensor of its frame, or where it lacks that the first."""
        name, leaders = dict(zip(self.ids, self.names, strict=True)), {}
        for rig, _, data in self.frames:
            data = [(camera, image) for camera, image in data if image in name]
            first = [image for camera, image in data if self.rigs[rig].get(camera, 0) is None]
            if data and len(first) < 2:
                first = (first or [data[0][1]])[0]
                leaders |= {name[image]: name[first] for _, image in data}
        return leaders

    def _camera(self, name):
        return camera_of(name, *self.cameras[int(name)], self.notes)

    def _poses(self):
        length = np.linalg.norm(self.pose[:, :4], axis=1)
        for row in np.flatnonzero(~(length > 1e-9)):
            raise InputError(
                f"{self.places[row]}: the quaternion has length zero; export the project again"
            )
        if (np.abs(length - 1) > 0.01).any():
            row = int(np.argmax(np.abs(length - 1)))
            self.warnings.append(
                f"{self.places[row]}: the quaternion has length {length[row]:.3g}; it was made "
                "a unit quaternion, as COLMAP does"
            )
        rotation, translation = matrices_of(self.pose[:, :4]), self.pose[:, 4:].copy()
        # Since rigs exist, COLMAP itself takes the poses from the frames.
        row_of = {number: row for row, number in enumerate(self.ids)}
        moved = []
        for rig, pose, data in self.frames:
            for camera, image in data:
                row, found = row_of.get(image), self._of_frame(rig, pose, camera)
                if row is None or found is None:
                    continue
                away = np.linalg.norm(found[0].T @ found[1] - rotation[row].T @ translation[row])
                size = 1e-6 * (1 + np.linalg.norm(translation[row]))
                if np.abs(found[0] - rotation[row]).max() > 1e-6 or away > size:
                    moved.append(self.names[row])
                rotation[row], translation[row] = found
        if moved:
            self.warnings.append(
                f"{len(moved)} images have another pose in the frames than in the images (first: "
                f"{moved[0]}); those of the frames were taken, as COLMAP does"
            )
        return rotation, translation

    def _of_frame(self, rig, pose, camera):
        """Rotation and translation of a camera of a frame; None: the rig was never calibrated."""
        if camera not in self.rigs.get(rig, ()):
            raise InputError(
                f"{self.folder}: frames name camera {camera} of rig {rig}, which the rigs do "
                "not have; export the project again"
            )
        turn, shift = matrices_of(pose[:4])[0], pose[4:]
        sensor = self.rigs[rig][camera]
        if sensor is None:
            return turn, shift
        if np.isnan(sensor).any():
            return None
        own = matrices_of(sensor[:4])[0]
        return own @ turn, own @ shift + sensor[4:]

    def _ties(self):
        ids = pd.Index(self.point_ids)
        twice = ids.duplicated()
        if twice.any():
            raise InputError(
                f"{self.folder}: point {ids[twice][0]} stands twice in the points; export it again"
            )
        at = ids.get_indexer(self.point)
        lost = at < 0
        if lost.any():
            row = int(np.argmax(lost))
            raise InputError(
                f"{self.folder}: image {self.names[self.image[row]]!r} sees point "
                f"{self.point[row]}, which the points do not have ({int(lost.sum())} such "
                "observations); the points are cut off or belong to another model"
            )
        if self.tracked is not None and self.tracked != len(self.point):
            self.warnings.append(
                f"the tracks of the points count {self.tracked} observations, the images "
                f"{len(self.point)}; those of the images were taken"
            )
        return Views(at, ids.astype("str"), self.image, self.xy - HALF)


def _with_length(pose, record):
    if not np.linalg.norm(pose[:4]) > 0:
        raise record.wrong("the quaternion has length zero; export the project again")
    return pose


# --- out -------------------------------------------------------------------------------------


def write(block: Block, folder: Path, name: str) -> None:
    """Write a model; name: colmap (binary), colmap-text."""
    file = records.TextWriter if name == "colmap-text" else records.BinaryWriter
    rows = rows_of(block)
    cameras = dict(zip(block.cameras, _numbers(list(block.cameras)).tolist(), strict=True))
    points = _numbers(list(rows.point_names))
    with file(folder, "cameras", len(cameras)) as out:
        for key, number in cameras.items():
            camera = block.cameras[key]
            model, params = params_of(camera)
            out.put(records.CAMERA, number, MODELS[model][0], camera.width, camera.height)
            out.reals(params)
            out.end()
    pose = np.column_stack([block.poses[:, 3:], rows.translation])
    order, starts = grouped(rows.image, len(rows.image_names))
    images = list(zip(rows.image_names, block.images["camera"].map(cameras), strict=True))
    with file(folder, "images", len(images)) as out:
        for k, (image, camera) in enumerate(images):
            mine = order[starts[k] : starts[k + 1]]
            out.put(records.IMAGE, k + 1, *pose[k], camera)
            out.name(image)
            out.image_points(rows.pixels[mine] + HALF, points[rows.point[mine]])
            out.end()
    by_point, ends = grouped(rows.point, len(points))
    with file(folder, "points3D", len(points)) as out:
        out.points(
            points, rows.positions, _mean_errors(rows, ends, by_point),
            rows.image.astype(np.int64) + 1, numbered(rows.image), by_point, ends,
        )  # fmt: skip
    write_rigs(block, folder, file, records, cameras)
    write_ground(block, points[rows.ties :], rows.point_names[rows.ties :], folder)
    positions = camera_positions(block)
    if len(positions):
        text = "".join(
            f"{image} {float(x)!r} {float(y)!r} {float(z)!r}\n"
            for image, x, y, z in positions[["image", "x", "y", "z"]].itertuples(index=False)
        )
        (folder / "reference.txt").write_text(text, encoding="utf-8", newline="\n")


def _numbers(names: list[str]) -> np.ndarray:
    """COLMAP's numbers of names: the names themselves where all are numbers from 1, else 1, 2 ..

    Points keep 0 out too: some programs take it for "none".
    """
    text = pd.Index(names)
    if len(names) and text.str.fullmatch(r"[1-9][0-9]{0,8}").all():
        return text.astype(np.int64).to_numpy()
    return np.arange(1, len(names) + 1, dtype=np.int64)


def _mean_errors(rows: Rows, ends: np.ndarray, by_point: np.ndarray) -> np.ndarray:
    length = np.nan_to_num(np.linalg.norm(rows.residuals(), axis=1))[by_point]
    sums = np.concatenate([[0.0], np.cumsum(length)])
    return (sums[ends[1:]] - sums[ends[:-1]]) / np.maximum(np.diff(ends), 1)
