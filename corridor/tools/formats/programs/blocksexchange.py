"""BlocksExchange XML: iTwin Capture, ContextCapture, and what DJI Terra and others write for them.

Conventions, where they differ from ours: the rotation takes the world, in the block's system, into
camera axes that CameraOrientation names; omega, phi, kappa are those of this matrix. Distortion is
Brown's from the ray to the image, its P1, P2 are ours. Pixels are ours: (0, 0) is the centre of the
first one. AspectRatio is fy / fx. In a geographic system rotations are about east, north, up at the
middle of the block.

Source: Bentley, BlocksExchange format and camera model; the angles proved on its own example.
"""

import re
from pathlib import Path, PurePosixPath

import numpy as np

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_angles
from corridor.core.gnss import Local, convert, known_crs
from corridor.core.textfile import Xml
from corridor.tools.formats.cameras import NoModel, in_the_middle, opencv_camera, where_known
from corridor.tools.formats.frames import elsewhere
from corridor.tools.formats.project import Contents, Project, Views, gnss_table, ground_table
from corridor.tools.formats.textfile import opening

NAME = "blocksexchange"
TITLE = "BlocksExchange XML (iTwin Capture, ContextCapture)"

# Camera axes in ours: right, down, forward.
_SIDES = {
    "Right": (1.0, 0.0, 0.0), "Left": (-1.0, 0.0, 0.0), "Down": (0.0, 1.0, 0.0),
    "Up": (0.0, -1.0, 0.0),
}  # fmt: skip


def recognise(path: Path) -> bool:
    """An XML file of BlocksExchange, or a folder with one."""
    return _file(path) is not None


def _file(path: Path) -> Path | None:
    files = [path] if path.is_file() else sorted(path.glob("*.xml"))
    files = [file for file in files if file.suffix.lower() == ".xml"]
    return next((file for file in files if "<BlocksExchange" in opening(file)), None)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file. Raises InputError naming file and element."""
    file = _file(path) or path
    root = Xml.read(file)
    notes: list[str] = []
    blocks = root.all("Block")
    if not blocks:
        raise root.wrong("it holds no block; export the block again")
    if len(blocks) > 1:
        notes.append(f"{file.name} holds {len(blocks)} blocks; the first was read")
    return _Block(root, blocks[0], notes).project(file)


class _Block:
    """A block, its photographs and the frame it is read into."""

    def __init__(self, root: Xml, block: Xml, notes: list[str]):
        self.notes, self._block = notes, block
        self._odd: dict[str, str] = {}
        self._systems = {
            part.text("Id"): part.text("Definition")
            for part in root.all("SpatialReferenceSystems/SRS")
        }
        self._system = self._system_of(block, None)
        groups = block.all("Photogroups/Photogroup")
        called = [(group.element.findtext("Name") or "camera").strip() for group in groups]
        if len(set(called)) < len(called):
            called = [f"{name} {k + 1}" for k, name in enumerate(called)]
        self.groups = dict(zip(called, groups, strict=True))
        self.photos = [(name, photo) for name, g in self.groups.items() for photo in g.all("Photo")]
        if not self.photos:
            raise block.wrong("the block has no photograph in a photogroup; export it again")
        self.ids = [photo.text("Id") for _, photo in self.photos]
        paths = [photo.text("ImagePath").replace("\\", "/") for _, photo in self.photos]
        self.names = _without_common(paths)

    def _system_of(self, element: Xml, default: str | None) -> str | None:
        """The system an element names; None for a local one."""
        number = (element.element.findtext("SRSId") or "").strip()
        if not number:
            return default
        if number not in self._systems:
            raise element.wrong(f"SRSId {number} names no system of the file; export it again")
        text = self._systems[number].strip()
        if re.match(r"(?i)local", text):
            return None
        known_crs(text)
        return text

    def project(self, file: Path) -> Project:
        centre = np.array([_place(photo.find("Pose/Center")) for _, photo in self.photos])
        rotation = np.array([self._rotation(group, photo) for group, photo in self.photos])
        known = np.isfinite(centre).all(axis=1)
        self.local = self._frame(centre[known])
        if self.local is not None and known_crs(self._system).is_geocentric:
            rotation = rotation @ self.local.rotation().T
        centre = self._framed(centre, self._system)
        lost = int((~known).sum())
        if lost:
            self.notes.append(f"{lost} of {len(known)} photographs have no pose")
        row = {number: k for k, number in enumerate(self.ids)}
        ties, points = self._points(row)
        ground, marks = self._ground(row)
        projected = self._system is not None and self.local is None
        return Contents(
            name=(self._block.element.findtext("Name") or file.stem).strip() or file.stem,
            cameras=where_known(self.groups, self._camera),
            images=self.names,
            used=[group for group, _ in self.photos],
            centre=centre,
            rotation=rotation,
            ties=ties,
            points=points,
            marks=marks,
            ground=ground,
            gnss=self._measured(),
            local=self.local,
            crs=self._system if projected else None,
            notes=self.notes,
            warnings=[*filter(None, self._odd.values())],
        ).project(NAME, file, placed=self._system is not None)

    def _frame(self, places: np.ndarray) -> Local | None:
        """East, north, up about the middle of places in a system that is no grid."""
        if self._system is None or known_crs(self._system).is_projected or not len(places):
            return None
        return Local.amid(places, self._system)

    def _framed(self, places: np.ndarray, system: str | None) -> np.ndarray:
        """Places (n, 3) of a system in the project's frame."""
        places = np.asarray(places, dtype=float).reshape(-1, 3)
        known = np.isfinite(places).all(axis=1)
        out = np.full_like(places, np.nan)
        if system is not None:
            self._odd[system] = self._odd.get(system) or elsewhere(places, system)
        if self.local is not None and system is not None:
            out[known] = self.local.from_crs(places[known], system)
        elif self._system is not None and system is not None:
            out[known] = convert(places[known], system, self._system)
        else:
            out = places
        return out

    # --- cameras and poses --------------------------------------------------------------------

    def _camera(self, name: str):
        group = self.groups[name]
        kind = (group.element.findtext("CameraModelType") or "Perspective").strip()
        if kind != "Perspective":
            raise NoModel(f"photogroup {name!r} is {kind}, for which corridor has no model")
        size = [group.child("ImageDimensions").value(key) for key in ("Width", "Height")]
        pixel = group.value("PixelSize", 0.0) or group.value("SensorSize", 0.0) / max(size)
        focal = group.value("FocalLengthPixels", 0.0)
        if not focal:
            if not pixel > 0:
                raise group.wrong(
                    f"photogroup {name!r} has neither FocalLengthPixels nor SensorSize; export it "
                    "again"
                )
            focal = group.value("FocalLength") / pixel
        cx, cy = in_the_middle(*size)
        point = group.find("PrincipalPoint")
        if point is not None and point.find("x") is not None:
            cx, cy = point.value("x"), point.value("y")
        elif point is not None and point.find("xmm") is not None:
            away = np.array([point.value("xmm"), point.value("ymm"), 0.0]) / pixel
            away = self._axes(group).T @ away
            cx, cy = cx + away[0], cy + away[1]
        given = {
            key: group.value(f"Distortion/{key}", 0.0) for key in ("K1", "K2", "K3", "P1", "P2")
        }
        if group.value("Skew", 0.0):
            self.notes.append(f"photogroup {name!r}: its skew was left out")
        aspect = group.value("AspectRatio", 1.0)
        radial = (given["K1"], given["K2"], given["K3"])
        return opencv_camera(
            name, size, (focal, focal * aspect), (cx, cy), radial, given["P2"], given["P1"],
            self.notes,
        )  # fmt: skip

    def _axes(self, group: Xml) -> np.ndarray:
        """(3, 3): our camera axes to those of a photogroup."""
        text = (group.element.findtext("CameraOrientation") or "XRightYDown").strip()
        match = re.fullmatch(r"X(Right|Left|Up|Down)Y(Right|Left|Up|Down)", text)
        if match is None:
            raise group.wrong(f"CameraOrientation {text[:30]!r} is unknown; export it again")
        x, y = (np.array(_SIDES[side]) for side in match.groups())
        if x @ y:
            raise group.wrong(f"CameraOrientation {text!r} has two axes alike; export it again")
        return np.array([x, y, np.cross(x, y)])

    def _rotation(self, group: str, photo: Xml) -> np.ndarray:
        part = photo.find("Pose/Rotation")
        if part is None:
            return np.full((3, 3), np.nan)
        if part.find("M_00") is not None:
            turn = np.array([[part.value(f"M_{i}{j}") for j in range(3)] for i in range(3)])
        elif part.find("Omega") is not None:
            angles = [part.value(key) for key in ("Omega", "Phi", "Kappa")]
            turn = rotation_from_angles(*angles).T
        else:
            raise part.wrong(
                f"photo {photo.text('Id')} has angles that are not read (heading, pitch, roll); "
                "export rotations as matrices or omega, phi, kappa"
            )
        return self._axes(self.groups[group]).T @ turn

    def _measured(self):
        """gnss.csv of the positions that the photographs' metadata state."""
        rows = []
        for name, (_, photo) in zip(self.names, self.photos, strict=True):
            part = photo.find("Pose/Metadata")
            place = _place(part.find("Center")) if part is not None else [np.nan] * 3
            if np.isfinite(place).all():
                system = self._system_of(part, self._system)
                sigma = [part.value(f"Accuracy/{axis}", np.nan) for axis in "xyz"]
                rows.append((name, *self._framed(place, system)[0], *sigma))
        return gnss_table(rows)

    # --- points -------------------------------------------------------------------------------

    def _points(self, row):
        """Views of the tie points, and their names and places, or None: by their rays."""
        home = self._block.find("TiePoints")
        if home is None:
            return None, None
        system = self._system_of(home, self._system)
        parts = home.all("TiePoint")
        names = [(part.element.findtext("Name") or str(k)).strip() for k, part in enumerate(parts)]
        if len(set(names)) < len(names):
            names = [str(k) for k in range(len(parts))]
        places = [_place(part.find("Position")) for part in parts]
        views = [
            (name, *view)
            for name, part in zip(names, parts, strict=True)
            for view in self._views(part, row)
        ]
        places = self._framed(places, system)
        known = np.isfinite(places).all(axis=1)
        points = (names, places) if known.all() and len(known) else None
        return Views.of(views, "tie points"), points

    def _views(self, part: Xml, row):
        for measured in part.all("Measurement"):
            number = measured.text("PhotoId")
            if number not in row:
                raise measured.wrong(f"a measurement names photo {number}, which is not there")
            if measured.find("x") is None:
                raise measured.wrong(
                    "a measurement is in millimetres (xmm, ymm); export measurements in pixels"
                )
            yield row[number], measured.value("x"), measured.value("y")

    def _ground(self, row):
        home = self._block.find("ControlPoints")
        if home is None:
            return None, None
        system = self._system_of(home, self._system)
        names, places, sigmas, roles, marks = [], [], [], [], []
        for k, part in enumerate(home.all("ControlPoint")):
            name = (part.element.findtext("Name") or f"control {k + 1}").strip()
            marks += [(name, *view) for view in self._views(part, row)]
            place = _place(part.find("Position"))
            if not np.isfinite(place).all():
                self.notes.append(f"control point {name} has no full position: it is not control")
                continue
            own = self._system_of(part, system)
            if self._system is None and own is not None and self.local is None:
                # The poses of a local block come into the frame of its control later.
                self.local = Local.amid(np.array([place]), own)
            names.append(name)
            places.append(self._framed(place, own)[0])
            level = part.value("HorizontalAccuracy", np.nan)
            sigmas.append([level, level, part.value("VerticalAccuracy", np.nan)])
            check = (part.element.findtext("CheckPoint") or "").strip().lower() == "true"
            roles.append("check" if check else "control")
        ground = ground_table(names, np.array(places), np.array(sigmas), roles) if names else None
        return ground, Views.of(marks, "measurements")


def _place(element: Xml | None) -> list[float]:
    """x, y, z of an element; NaN where there is none."""
    if element is None:
        return [np.nan] * 3
    return [element.value(axis, np.nan) for axis in "xyz"]


def _without_common(paths: list[str]) -> list[str]:
    """Paths without the folder that all of them have, or the file names where these differ."""
    bare = [PurePosixPath(path).name for path in paths]
    if len(set(bare)) == len(bare):
        return bare
    parts = [PurePosixPath(path).parts for path in paths]
    common = 0
    while all(len(p) > common + 1 and p[common] == parts[0][common] for p in parts):
        common += 1
    names = ["/".join(p[common:]) for p in parts]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"two photographs have the path {twice!r}; export the block again")
    return names
