"""OpenMVG's sfm_data.json and AliceVision's (Meshroom's) sfm.json: one idea in two spellings.

Conventions, where they differ from ours: the rotation is world to camera, in OpenMVG row by row, in
AliceVision column by column, and beside it stands the centre; distortion goes from the ray to the
image, tangential coefficients and the fisheye of four terms are OpenCV's. OpenMVG's focal length
and principal point are pixels; AliceVision's are mm of sensorWidth, in older files pixels
(pxFocalLength), and pixels from the middle of the picture, before version 1.2.1 from its corner.
Pixels are counted from the centre of the first one.

Source: OpenMVG, sfm_data_io; AliceVision, sfmDataIO jsonIO and its list of changes; proved by
reprojection.
"""

from pathlib import Path, PurePosixPath

import numpy as np

from corridor.core.camera import MODELS
from corridor.core.errors import InputError
from corridor.tools.formats.cameras import NoModel, opencv_camera, where_known
from corridor.tools.formats.project import Contents, Project, Views
from corridor.tools.formats.textfile import Json, opening

NAME = "sfm-data"
TITLE = "OpenMVG sfm_data.json, AliceVision (Meshroom) sfm.json"

_FILES = ("sfm_data.json", "sfm.json", "cameras.sfm", "sfm.sfm")
# How many coefficients are radial; the rest are tangential.
_RADIAL = {
    "pinhole": 0, "none": 0, "pinhole_radial_k1": 1, "radial1": 1, "radialk1": 1,
    "pinhole_radial_k3": 3, "radial3": 3, "radialk3": 3, "pinhole_brown_t2": 3, "brown": 3,
    "fisheye": 4, "fisheye4": 4,
}  # fmt: skip


def recognise(path: Path) -> bool:
    """A file of one of the two, or a folder with one."""
    return _file(path) is not None


def _file(path: Path) -> Path | None:
    files = [path] if path.is_file() else [path / name for name in _FILES]
    return next((file for file in files if _looks(file)), None)


def _looks(file: Path) -> bool:
    if file.suffix.lower() not in (".json", ".sfm"):
        return False
    head = opening(file, 20_000)
    return '"views"' in head and ('"sfm_data_version"' in head or '"viewId"' in head)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file. Raises InputError naming file and place."""
    file = _file(path) or path
    whole = Json.read(file)
    if not isinstance(whole.value, dict):
        raise InputError(f"{file.name} holds no project; export it again")
    spelling = _OpenMvg if "sfm_data_version" in whole.value else _AliceVision
    return spelling(whole).project(file)


class _Spelling:
    """What both have in common, once views, poses, cameras and points are read."""

    def __init__(self, whole: Json):
        self.whole, self.notes = whole, []

    def project(self, file: Path) -> Project:
        views = self.views()
        if not views:
            raise InputError(f"{file.name} holds no view; export it again")
        entries, poses = self.intrinsics(), self.poses()
        known = [pose in poses for _, _, pose, _ in views]
        if not any(known):
            raise InputError(
                f"{file.name} holds no pose: it is the project before reconstruction; name the "
                "file of the result"
            )
        paths = [path.replace("\\", "/") for _, path, _, _ in views]
        names = [PurePosixPath(path).name for path in paths]
        names = names if len(set(names)) == len(names) else paths
        none = np.full((3, 4), np.nan)
        matrices = np.array([poses.get(pose, none) for _, _, pose, _ in views])
        if not all(known):
            self.notes.append(f"{known.count(False)} of {len(known)} images have no pose")
        used = [f"camera_{number}" for *_, number in views]
        cameras = where_known(used, lambda name: self.camera(name, entries))
        row = {number: k for k, (number, *_) in enumerate(views)}
        ties, points = self.points(row)
        self.notes.append("the model is in its own frame and scale unless it was aligned")
        return Contents(
            name=file.parent.resolve().name,
            cameras=cameras,
            images=names,
            used=used,
            centre=matrices[:, :, 3],
            rotation=matrices[:, :, :3],
            ties=ties,
            points=points,
            notes=self.notes,
        ).project(NAME, file, placed=False)

    def camera(self, name: str, entries: dict[str, Json]):
        number = name.removeprefix("camera_")
        if number not in entries:
            raise self.whole.wrong(f"has a view of camera {number}, which it does not describe")
        kind, size, focal, middle, values = self.interior(entries[number])
        if kind not in _RADIAL:
            raise NoModel(f"camera {number} is a {kind}, for which corridor has no model")
        count = _RADIAL[kind]
        model = MODELS[kind.startswith("fisheye")]
        radial = (*values[:count], *4 * (0.0,))[: max(count, 3)]
        p1, p2 = (list(values[count:]) + [0.0, 0.0])[:2]
        return opencv_camera(name, size, focal, middle, radial, p1, p2, self.notes, model)

    def _seen(self, row, entries):
        """Views and places of entries (name, place, [(view, x, y)])."""
        names, places, seen = [], [], []
        for name, place, views in entries:
            names.append(name)
            places.append(place)
            seen += [(name, row[view], x, y) for view, x, y in views if view in row]
        if not seen:
            self.notes.append("the file holds no image points; export it with its structure")
            return None, None
        return Views.of(seen), (names, np.array(places))


class _OpenMvg(_Spelling):
    def _all(self, key: str) -> list[tuple[str, Json]]:
        rows = self.whole.rows(key, key) if self.whole.get(key) else []
        return [(str(row.get("key")), row.at("value")) for row in rows]

    def _data(self, value: Json) -> Json:
        return value.at("ptr_wrapper").at("data")

    def views(self):
        found = []
        for _, value in self._all("views"):
            data = self._data(value)
            folder = str(data.get("local_path") or "").strip("/\\")
            path = f"{folder}/{data.text('filename')}" if folder else data.text("filename")
            found.append((str(data.get("id_view")), path,
                          str(data.get("id_pose")), str(data.get("id_intrinsic"))))  # fmt: skip
        return found

    def intrinsics(self):
        return dict(self._all("intrinsics"))

    def poses(self):
        return {
            key: np.column_stack(
                [value.numbers("rotation", 9).reshape(3, 3), value.numbers("center", 3)]
            )
            for key, value in self._all("extrinsics")
        }

    def interior(self, value: Json):
        data = self._data(value)
        kind = value.get("polymorphic_name") or self._kinds(data)
        base = data.at("value0") if isinstance(data.get("value0"), dict) else data
        size = [base.number(key) for key in ("width", "height")]
        focal = base.number("focal_length")
        middle = base.numbers("principal_point", 2)
        key = next((key for key in data.value if key.startswith(("disto", "fisheye"))), None)
        values = np.ravel(data.value[key]).astype(float) if key else np.zeros(0)
        return kind, size, (focal, focal), middle, values

    def _kinds(self, data: Json) -> str:
        """The model by its coefficients: the name stands only where it is used first."""
        names = {"disto_k1": "pinhole_radial_k1", "disto_k3": "pinhole_radial_k3",
                 "disto_t2": "pinhole_brown_t2", "fisheye": "fisheye"}  # fmt: skip
        return next((kind for key, kind in names.items() if key in data.value), "pinhole")

    def points(self, row):
        def entries():
            for key, value in self._all("structure"):
                seen = [
                    (str(one.get("key")), *one.at("value").numbers("x", 2))
                    for one in value.rows("observations", "observation")
                ]
                yield key, value.numbers("X", 3), seen

        return self._seen(row, entries())


class _AliceVision(_Spelling):
    def views(self):
        return [
            (str(view.get("viewId")), view.text("path"), str(view.get("poseId")),
             str(view.get("intrinsicId")))
            for view in self.whole.rows("views", "view")
        ]  # fmt: skip

    def intrinsics(self):
        rows = self.whole.rows("intrinsics", "intrinsic")
        return {str(row.get("intrinsicId")): row for row in rows}

    def poses(self):
        found = {}
        for row in self.whole.rows("poses", "pose") if self.whole.get("poses") else []:
            place = row.at("pose").at("transform")
            turn = place.numbers("rotation", 9).reshape(3, 3).T
            found[str(row.get("poseId"))] = np.column_stack([turn, place.numbers("center", 3)])
        return found

    def interior(self, row: Json):
        size = [float(row.numbers(key, 1)[0]) for key in ("width", "height")]
        kind = str(row.get("distortionType") or row.get("type") or "pinhole")
        if row.get("type") not in (None, "pinhole", *_RADIAL):
            kind = str(row.get("type"))
        older = row.get("pxFocalLength")
        if older is not None:
            focal = np.resize(row.numbers("pxFocalLength", np.size(older)), 2)
        else:
            ratio = float(row.numbers("pixelRatio", 1)[0]) if row.get("pixelRatio") else 1.0
            focal = row.numbers("focalLength", 1) * size[0] * np.array([1.0, ratio])
            focal /= row.numbers("sensorWidth", 1)
        middle = np.array(size) / 2
        if row.get("principalPoint"):
            of_corner = tuple(map(int, self.whole.get("version") or (1, 2, 1))) < (1, 2, 1)
            middle = row.numbers("principalPoint", 2) + (0 if of_corner else middle)
        given = row.get("distortionParams") or []
        values = row.numbers("distortionParams", len(given)) if given else np.zeros(0)
        return kind, size, focal, middle, values

    def points(self, row):
        def entries():
            for point in self.whole.rows("structure", "landmark"):
                seen = [
                    (str(one.get("observationId")), *one.numbers("x", 2))
                    for one in point.rows("observations", "observation")
                ]
                yield str(point.get("landmarkId")), point.numbers("X", 3), seen

        return self._seen(row, entries() if self.whole.get("structure") else ())
