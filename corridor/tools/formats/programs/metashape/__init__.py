"""Agisoft Metashape and PhotoScan: projects (.psx, .psz), camera XML and marker XML.

Conventions, where they differ from ours: (0.5, 0.5) is the centre of the top-left pixel; cx, cy are
counted from the image centre (in PhotoScan's older form, with fx and fy, from the corner); b1, b2
are in pixels and multiply the *distorted* ray. A camera's transform (4 x 4, row by row) is camera
to chunk; the transform of the chunk, or of its component, goes on to the world: geocentric if the
chunk has a geographic or projected system, local otherwise. Of the reference angles,
M = Rz(-yaw) Rx(pitch) Ry(roll) takes the camera (x right, y forward, z up) to east, north, up;
pitch 0 looks down. A camera of a rig has a master and no transform; its sensor states rotation R
and location l in the master's frame, x_master = R x_slave + l.

Source: Agisoft Metashape manual, appendix "Camera models"; the rest as found on real files.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.camera import MODELS
from corridor.core.errors import InputError, some
from corridor.core.geometry import rotation_from_roll_pitch_yaw
from corridor.core.gnss import GEOCENTRIC, GEOGRAPHIC, Local, known_crs
from corridor.core.output import counted
from corridor.core.textfile import Xml
from corridor.tools.formats.cameras import (
    Held,
    NoModel,
    camera_from,
    in_the_middle,
    standing_for,
    where_known,
)
from corridor.tools.formats.frames import elsewhere, height_unit
from corridor.tools.formats.names import numbered
from corridor.tools.formats.programs.metashape.archive import Archive, read_ply
from corridor.tools.formats.programs.metashape.writing import write as write
from corridor.tools.formats.project import (
    Contents,
    Project,
    Views,
    gnss_table,
    ground_table,
    hung_together,
    rotations_to_columns,
)
from corridor.tools.formats.textfile import opening

NAME = "metashape"
TITLE = "Metashape project (.psx, .psz), camera and marker XML"
WRITES = ("metashape",)
_HELD = ("f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
HOLDS = Held(_HELD, pinhole=("b1", "b2"), fisheye=(*_HELD, "b1", "b2"))
# What a lens makes of the angle theta from its axis, before the same distortion.
_RADIUS = {
    "frame": np.tan, "fisheye": np.positive, "equidistant_fisheye": np.positive,
    "equisolid_fisheye": lambda theta: 2.0 * np.sin(theta / 2.0),
}  # fmt: skip
DISTANCES = True
LOSSES = {
    "tie points": "tie points: Metashape takes none from XML, only markers",
    "GNSS": "lever arms: the references are the camera centres that GNSS gives",
    "unlike rigs": "rigs whose images do not stand as they say: adjust first; each image is alone",
    "rigs without base": "exposures without the rig's base camera: their images are alone",
}
RIGS = True

_UNSCALED = "chunk units: no scale, no place in the world (not metres)"
_EARTH_M = (6.2e6, 6.5e6)
# Settings of a chunk and the defaults of a block that they are: Metashape's accuracies.
_ACCURACIES = {
    "accuracy_tiepoints": "tie_px",
    "accuracy_projections": "mark_px",
    "accuracy_cameras": "gnss_m",
    "accuracy_markers": "control_m",
}


def recognise(path: Path) -> bool:
    """An XML file with a chunk, a .psx or .psz, or a folder with one of them."""
    if path.is_file():
        return _looks(path)
    return any(_looks(file) for file in _ending(path, ".psx", ".psz", ".xml"))


def _ending(folder: Path, *endings: str) -> list[Path]:
    """Files of a folder by their endings, in the order of these, in upper or lower case."""
    files = sorted(file for file in folder.iterdir() if file.is_file())
    return [file for end in endings for file in files if file.suffix.lower() == end]


def _looks(path):
    if path.suffix.lower() in (".psz", ".psx"):
        return True
    head = opening(path)
    return path.suffix.lower() == ".xml" and "<document" in head and "<chunk" in head


@dataclass
class _Chunk:
    """What the XML files of one chunk say together.

    Cameras by name and sensors by label or number: two exports may number them differently.
    projections: marker number -> (camera name, element). sensor_of: camera name -> sensor.
    masters: camera name -> name of the master in its rig. off: names of disabled cameras.
    markers_off: numbers of disabled markers.
    sigma: defaults of the block that the chunk states; bar_m: that of its scale bars.
    """

    sensors: dict[str, Xml] = field(default_factory=dict)
    cameras: dict[str, Xml] = field(default_factory=dict)
    markers: dict[str, Xml] = field(default_factory=dict)
    projections: dict[str, list[tuple[str, Xml]]] = field(default_factory=dict)
    sensor_of: dict[str, str] = field(default_factory=dict)
    masters: dict[str, str] = field(default_factory=dict)
    off: set[str] = field(default_factory=set)
    markers_off: set[str] = field(default_factory=set)
    components: dict[str, Xml] = field(default_factory=dict)
    transform: Xml | None = None
    crs: str | None = None
    marker_crs: str | None = None
    sigma: dict[str, float] = field(default_factory=dict)
    bars: list[Xml] = field(default_factory=list)
    bar_m: float = np.nan
    notes: list[str] = field(default_factory=list)

    def add(self, element: Xml) -> dict[str, str]:
        """What the chunk of one more file says; what is known already stays.

        Returns the names of its cameras by their numbers.
        """
        here = {}
        bars = element.all("scalebars/scalebar") + element.all("scalebars/group/scalebar")
        self.bars = self.bars or bars
        for part in element.all("sensors/sensor"):
            number = part.get("id", "")
            key = part.get("label") or f"sensor {number}"
            here[number] = key = f"{key} {number}" if key in here.values() else key
            known = self.sensors.get(key)
            if known is None or known.find("calibration") is None:
                self.sensors[key] = part
        for part in element.all("markers/marker") + element.all("markers/group/marker"):
            if not part.get("id"):
                raise part.wrong("a marker has no id; export the markers again")
            if _is_on(part, "enabled"):
                self.markers.setdefault(part.get("id"), part)
            elif part.get("id") not in self.markers_off:
                self.markers_off.add(part.get("id", ""))
                called = part.get("label") or part.get("id")
                self.notes.append(f"marker {called} is switched off: left out")
        placed = any(part.find("reference") is not None for part in self.markers.values())
        # Cameras may stand in groups.
        parts = [part for part in element.all(".//camera") if part.get("id") is not None]
        parts = [part for part in parts if part.get("label") is not None]
        names = _names_of(element, parts, self.notes)
        for part in parts:
            name = names[part.get("id")]
            known = self.cameras.get(name)
            if known is None or len(part.element) > len(known.element):
                self.cameras[name] = part
                self.sensor_of[name] = here.get(part.get("sensor_id", ""), "")
            master = part.get("master_id")
            if master in names and master != part.get("id"):
                self.masters[name] = names[master]
            if not _is_on(part, "enabled"):
                self.off.add(name)
        for part in element.all("components/component"):
            self.components.setdefault(part.get("id", ""), part)
        frames = len(element.all("frames/frame"))
        if frames > 1:
            self.notes.append(f"the chunk holds {frames} frames (dates): the first was read")
        for part in element.all("frames/frame[1]/markers/marker"):
            self.projections.setdefault(
                part.get("marker_id", ""),
                [
                    (names.get(place.get("camera_id", ""), ""), place)
                    for place in part.all("location")
                ],
            )
        self.transform = element.find("transform") or self.transform
        crs, of_markers = (
            (element.element.findtext(tag) or "").strip()
            for tag in ("reference", "marker_reference")
        )
        # Markers exported on their own may be in another system than the cameras.
        if any(len(part.element) for part in parts):
            self.crs = self.crs or crs or None
        if not self.marker_crs and (of_markers or placed):
            self.marker_crs = of_markers or crs or None
        for part in element.all("settings/property"):
            key = _ACCURACIES.get(part.get("name", ""))
            value = part.number("value") if key else None
            if value is not None and value > 0:
                self.sigma.setdefault(key, value)
            if part.get("name") == "accuracy_scalebars":
                self.bar_m = part.number("value", np.nan)
        return names


def _names_of(element: Xml, parts: list[Xml], notes: list[str]) -> dict[str, str]:
    """Names of cameras by their numbers: their labels, where these are different.

    Else the name of the group stands before them, or of the folder of the photograph, or a number.
    """
    names = {part.get("id", ""): part.get("label", "") for part in parts}
    twice = sum(count > 1 for count in Counter(names.values()).values())
    if not twice:
        return names
    groups = {
        part.get("id"): group.get("label")
        for group in element.all(".//group")
        for part in group.all(".//camera")
    }
    folders = {
        part.get("camera_id"): photo.get("path", "").replace("\\", "/").split("/")[-2:-1]
        for part in element.all("frames/frame[1]/cameras/camera")
        for photo in part.all("photo")[:1]
    }
    folders = {number: folder[0] for number, folder in folders.items() if folder}
    for what, owner in (("group", groups), ("folder", folders)):
        made = {n: f"{owner[n]}/{label}" if owner.get(n) else label for n, label in names.items()}
        if len(set(made.values())) == len(made):
            notes.append(
                f"{twice} labels belong to several cameras: the name of its {what} was put before "
                "the label of each"
            )
            return made
    made = dict(zip(names, numbered(names.values()), strict=True))
    notes.append(
        f"{twice} labels belong to several cameras, and neither groups nor folders distinguish "
        "them: the second is called 2/LABEL; put the cameras of each flight into a group to give "
        "them its name"
    )
    return made


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file or folder. Raises InputError naming file and line."""
    notes: list[str] = []
    warnings: list[str] = []
    projects = [path]
    if path.is_dir():
        projects = [*_ending(path, ".psx", ".psz"), path]
        # A copy of the .psx alone is none: its archives stay where they were.
        projects.sort(key=lambda file: not file.with_suffix(".files").is_dir())
    if projects[0].suffix.lower() in (".psz", ".psx"):
        path = projects[0]
        chunk, cloud = read_archive(path, notes)
    else:
        chunk, cloud = _together(path, notes, warnings), None
        warnings.append(
            "XML that Metashape exports has no tie points: name the .psx, with its .files folder "
            "beside it, or export the cameras as Blocks Exchange with tie points"
        )
    notes += dict.fromkeys(chunk.notes)
    return _project(chunk, cloud, path, notes, warnings)


def read_archive(path: Path, notes: list[str]):
    """The chunk of a .psx or .psz, and its points and their projections by camera, or None."""
    with Archive(path) as archive:
        element = chunk_of(archive.document(), notes, archive.head)
        element, members = archive.whole(element)
        chunk = _Chunk()
        names = chunk.add(element)
        frame = element.find("frames/frame")
        cloud = frame and (frame.find("point_cloud") or frame.find("tie_points"))
        points = cloud and cloud.find("points")
        if not points or not points.get("path"):
            notes.append("the project has no tie points yet")
            return chunk, None
        places = read_ply(members, points)
        found = {
            names.get(part.get("camera_id", ""), ""): read_ply(members, part)
            for part in cloud.all("projections")
            if part.get("path")
        }
        return chunk, (places, found)


def _together(path, notes, warnings):
    """The chunk of the file that says most, and of those that are of the same cameras."""
    files = [path] if path.is_file() else [f for f in _ending(path, ".xml") if _looks(f)]
    if not files:
        raise InputError(f"{path} holds no Metashape XML; name the exported file")
    if path.is_dir():
        warnings += [
            f"{file.name} is not a Metashape XML that corridor can read"
            for file in _ending(path, ".xml")
            if not _looks(file) and "<calibration>" not in opening(file)
        ]
    parts = [chunk_of(Xml.read(file), notes) for file in files]
    parts.sort(key=lambda part: -len(part.all(".//camera/transform") + part.all(".//location")))
    chunk = _Chunk()
    known = _labels(parts[0])
    for part in parts:
        labels = _labels(part)
        if labels and known and not (labels <= known or labels >= known):
            warnings.append(
                f"{part.path.name} is of other cameras than {parts[0].path.name} and was left out; "
                "name the file to import it"
            )
        else:
            chunk.add(part)
    return chunk


def _labels(part):
    return {camera.get("label") for camera in part.all(".//camera") if camera.get("label")}


def chunk_of(root: Xml, notes: list[str], opened: Callable[[Xml], Xml] = lambda part: part) -> Xml:
    """The chunk of a document: the active one of several if it has cameras, else that of the most.

    opened: what a chunk that only names its archive stands for.
    """
    chunks = root.all("chunk") or root.all("chunks/chunk")
    if root.tag != "document" or not chunks:
        raise root.wrong("it is not a Metashape document with a chunk; export it again")
    if len(chunks) == 1:
        return chunks[0]
    home = root.find("chunks")
    active = home and home.get("active_id")
    which, whole = "the active one", []
    for chunk in sorted(chunks, key=lambda chunk: chunk.get("id") != active):
        whole.append((chunk, opened(chunk)))
        if active and chunk.get("id") == active and whole[0][1].find(".//camera"):
            break
    else:
        which = "that of the most cameras"
        whole.sort(key=lambda pair: -len(pair[1].all(".//camera")))
    chosen, inner = whole[0]
    label = inner.get("label", "")
    notes.append(f"{root.path.name} holds {len(chunks)} chunks; {which}, {label}, was read")
    return chosen


# --- cameras ---------------------------------------------------------------------------------


def _camera(sensor, name, notes):
    """Our camera of a sensor. Raises NoModel."""
    calibrations = sensor.all("calibration")
    adjusted = [part for part in calibrations if part.get("class") == "adjusted"]
    calibration = (adjusted or calibrations[::-1] or [None])[0]
    kind = (calibration or sensor).get("type", "frame")
    if kind not in _RADIUS:
        raise NoModel(f"sensor {name!r} is a {kind}, for which corridor has no model")
    model = MODELS[kind != "frame"]
    resolution = (calibration or sensor).child("resolution")
    size = [resolution.number(key, 0.0) for key in ("width", "height")]
    middle = in_the_middle(*size)
    pixel, focal = (_stated(sensor, key) for key in ("pixel_width", "focal_length"))
    pixel_um = {"pixel_um": 1000 * pixel} if pixel and pixel > 0 else {}
    if calibration is None:
        if not focal or not pixel or min(focal, pixel) <= 0:
            raise NoModel(f"sensor {name!r} has neither a calibration nor a focal length")
        notes.append(f"sensor {name!r} has no calibration: f from its focal length and pixel size")
        return camera_from(name, *size, focal / pixel, *middle, **pixel_um).with_model(model)
    k1, k2, k3, k4, p1, p2, p3, p4 = (
        calibration.value(f"{letter}{n}", 0.0) for letter in "kp" for n in range(1, 5)
    )
    cx, cy = (calibration.value(key, 0.0) for key in ("cx", "cy"))
    if calibration.find("fx") or calibration.find("fy"):
        # PhotoScan's older form: cx, cy from the corner.
        f, fx = calibration.value("fy", 0.0), calibration.value("fx", 0.0)
        cx, cy = cx - 0.5, cy - 0.5
        b1, b2 = fx - f, calibration.value("skew", 0.0)
        if p1 or p2:
            notes.append(
                f"sensor {name!r}: the older form (fx, fy) does not say which of p1, p2 is which; "
                "they were read in today's order"
            )
    else:
        cx, cy = cx + middle[0], cy + middle[1]
        f, b1, b2 = (calibration.value(key, 0.0) for key in ("f", "b1", "b2"))
    if not f > 0:
        raise sensor.wrong(f"sensor {name!r} has the focal length {f:g}; export again")
    camera = camera_from(
        name, *size, f, cx, cy, k1=k1, k2=k2, k3=k3, k4=k4, p1=p1, p2=p2, b1=b1 / f, b2=b2 / f,
        **pixel_um,
    ).with_model(model)  # fmt: skip

    def project(rays: np.ndarray) -> np.ndarray:
        r = np.maximum(np.hypot(*rays.T), 1e-12)
        u, v = rays.T * (_RADIUS[kind](np.arctan(r)) / r)
        r2 = u * u + v * v
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        more = 1 + r2 * (p3 + r2 * p4)
        x = u * radial + (p1 * (r2 + 2 * u * u) + 2 * p2 * u * v) * more
        y = v * radial + (p2 * (r2 + 2 * v * v) + 2 * p1 * u * v) * more
        return np.column_stack([cx + f * x + b1 * x + b2 * y, cy + f * y])

    return _as_stated(sensor, standing_for(camera, project, notes), notes)


def _as_stated(sensor, camera, notes):
    """The camera, held where the project holds its calibration (the box `Fixed`)."""
    told = {part.get("name"): part.get("value", "") for part in sensor.all("property")}
    fixed = told.get("fixed", "") or told.get("fixed_calibration", "")
    if fixed.lower() not in ("true", "1"):
        return camera
    notes.append(f"camera {camera.name}: its calibration is fixed in the project, and is held")
    return replace(camera, calibrated=True)


def _stated(sensor, name):
    part = sensor.find(f"property[@name='{name}']")
    return None if part is None else part.number("value")


# --- from chunk to world ---------------------------------------------------------------------


@dataclass
class _World:
    """Where a chunk lies.

    local: its frame on Earth; None: metres of a local system, or none at all. scaled: the chunk's
    coordinates are metres. geocentric: they are geocentric. metric_heights: heights beside a grid
    in feet are metres. odd: sentences on systems that do not hold their coordinates.
    """

    local: Local | None = None
    scaled: bool = True
    geocentric: bool = False
    metric_heights: bool = False
    odd: dict[str, str] = field(default_factory=dict)

    def points(self, places: np.ndarray, crs: str | None) -> np.ndarray:
        """Block coordinates (n, 3) of places in a CRS (None: local already)."""
        places = np.asarray(places, dtype=float).reshape(-1, 3)
        if self.local is None or crs is None:
            return places
        self.odd[crs] = self.odd.get(crs) or elsewhere(places, crs)
        up = 1.0 if self.metric_heights else height_unit(crs)
        return self.local.from_crs(places * [1.0, 1.0, up], crs)


def _similarity(element):
    """Scale, rotation, translation; None where a transform holds nothing but a region."""
    if element is None or element.find("rotation") is None:
        return None
    rotation = element.values("rotation", 9).reshape(3, 3)
    translation = element.values("translation", 3)
    scale = element.value("scale")
    try:
        rotations_to_columns(rotation)
    except ValueError as error:
        raise element.wrong(f"the transform: {error}") from None
    if not scale > 0:
        raise element.wrong(f"the transform's scale is {scale:g}; export it again")
    return scale, rotation, translation


def _is_local(crs):
    return crs is None or crs.startswith("LOCAL")


def _crs(text):
    return None if _is_local(text) else text if text == GEOGRAPHIC else known_crs(text).to_wkt()


def _project(chunk, cloud, path, notes, warnings):
    cameras = where_known(chunk.sensors, lambda name: _camera(chunk.sensors[name], name, notes))
    labels = [label for label in chunk.cameras if chunk.sensor_of[label] in cameras]
    if lost := sum(sensor not in chunk.sensors for sensor in chunk.sensor_of.values()):
        warnings.append(f"{lost} cameras name a sensor that the chunk has not: left out")
    off = [label for label in labels if label in chunk.off]
    if off and len(off) == len(labels):
        warnings.append("all cameras are disabled: they were read as if they were not")
    elif off:
        notes.append(f"{len(off)} disabled cameras were left out: {some(off, 5)}")
        labels = [label for label in labels if label not in chunk.off]
    _told_of_shutters(chunk, labels, warnings)
    if not labels:
        raise InputError(
            f"{path.name} holds no image of a frame camera; export the cameras of a chunk with "
            "frame cameras"
        )
    parts = [chunk.cameras[label] for label in labels]
    _with_degrees(chunk, parts, notes)
    chunk.crs = chunk.crs or chunk.marker_crs
    crs = _crs(chunk.crs)
    moves, component = _components(chunk, labels, warnings)
    centre, rotation, world = _poses(chunk, labels, moves, component, notes)
    known = np.isfinite(centre).all(axis=1)
    measured = _Reference([part.find("reference") for part in parts])
    have = np.isfinite(measured.place).all(axis=1)
    # Poses in a frame of its own come into that of the measured positions later.
    free = bool(known.any()) and not world.scaled
    local = chunk.crs is not None and crs is None
    if crs is None:
        have &= not free or local
    elif free:
        marked = _Reference([part.find("reference") for part in chunk.markers.values()]).place
        stated = np.concatenate([measured.place[have], marked[np.isfinite(marked).all(axis=1)]])
        world.local = _amid(stated, crs)
    if (crs is not None or world.geocentric) and not free:
        earth = (centre[known], GEOCENTRIC) if world.geocentric else (measured.place[have], crs)
        world.local = _amid(*earth)
    if world.geocentric:
        turn = world.local.rotation()
        centre[known] = world.local.from_crs(centre[known], GEOCENTRIC)
        rotation[known] = rotation[known] @ turn.T
    both = have & known
    if world.geocentric and crs is not None and both.any():
        # Where a grid counts in feet, the mapped centres say whether heights do.
        off = []
        for world.metric_heights in (True, False):
            made = world.points(measured.place[both], crs)
            off.append(float(np.median(np.abs(made - centre[both])[:, 2])))
        world.metric_heights = off[0] < off[1]
    reference = np.full_like(centre, np.nan)
    reference[have] = world.points(measured.place[have], crs)
    taken = have & np.isfinite(measured.angle).all(axis=1) & (not known.any())
    if taken.any():
        rotation[taken] = rotation_from_roll_pitch_yaw(measured.angle[taken][:, ::-1], "body")
        centre[taken] = reference[taken]
        notes.append(
            f"{int(taken.sum())} cameras are not aligned: their poses are the measured positions "
            "and angles (start values)"
        )
    if free:
        notes.append(
            "the chunk has no transform: its coordinates have no scale and no place, they are not "
            "metres"
        )
    if world.local is not None:
        lat, lon, height = world.local.origin
        notes.append(f"world: east, north, up about {lat:g}, {lon:g} degrees, height {height:g} m")
    placed = world.scaled or (not known.any() and np.isfinite(measured.place).any())
    ties, points = _ties(*cloud, labels, world, moves, component) if cloud else (None, None)
    called = _called(chunk, notes)
    made = Contents(
        name=path.stem,
        cameras=cameras,
        images=labels,
        used=[chunk.sensor_of[label] for label in labels],
        centre=centre,
        rotation=rotation,
        ties=ties,
        points=points,
        marks=_marks(chunk, labels, called, notes),
        ground=_ground(chunk, world, called, warnings) if placed or world.local or local else None,
        gnss=_gnss(labels, reference, measured, have, notes),
        distances=_distances(chunk, called, notes),
        local=world.local,
        description=_UNSCALED if free else "",
        sigma=chunk.sigma,
        notes=notes,
        warnings=[*warnings, *filter(None, world.odd.values())],
    ).project(NAME, path, placed=bool(placed), apart=free and local)
    return hung_together(made, chunk.masters)


def _told_of_shutters(chunk, labels, warnings):
    """A sentence where Metashape has modelled a rolling shutter: its poses are not ours."""
    for name in {chunk.sensor_of[label] for label in labels}:
        said = [
            part.get("value", part.element.text or "true")
            for part in chunk.sensors[name].all(".//*")
            if "rolling_shutter" in (part.get("name") or part.tag)
        ]
        if any(value.strip().lower() not in ("", "false", "0", "disabled") for value in said):
            warnings.append(
                f"sensor {name!r} has Metashape's rolling shutter compensation, which is not in "
                "the file: poses are its poses without it; adjust with --effect rolling_shutter"
            )


def _with_degrees(chunk, parts, notes):
    """The chunk's system where the file does not say it and the positions are plainly degrees."""
    transform = chunk.transform
    if chunk.crs is not None or transform is None or transform.find("translation") is None:
        return
    far = np.linalg.norm(transform.values("translation", 3))
    place = _Reference([part.find("reference") for part in parts]).place
    place = place[np.isfinite(place).all(axis=1)]
    if _EARTH_M[0] < far < _EARTH_M[1] and len(place) and (np.abs(place[:, :2]) <= 180).all():
        chunk.crs = GEOGRAPHIC
        notes.append(
            "the file states no system: measured positions were read as longitude, latitude and "
            "height of WGS 84"
        )


def _transform(chunk, label):
    """4 x 4, camera to chunk, of a camera or of its master and its place in the rig; None."""
    part = chunk.cameras[label]
    if part.find("transform") is not None:
        return part, part.values("transform", 16).reshape(4, 4)
    master = chunk.masters.get(label)
    if master is None or chunk.cameras[master].find("transform") is None:
        return part, None
    sensor, place = chunk.sensors[chunk.sensor_of[label]], np.eye(4)
    if sensor.find("rotation") is not None:
        place[:3, :3] = sensor.values("rotation", 9).reshape(3, 3)
    if sensor.find("location") is not None:
        place[:3, 3] = sensor.values("location", 3)
    part = chunk.cameras[master]
    return part, part.values("transform", 16).reshape(4, 4) @ place


def _components(chunk, labels, warnings):
    """Similarities from components to the world, None where one has no scale and no place; and in
    which of them images are (n,), -1: in none.

    Parts of a chunk that no match joins have frames of their own. One without a transform has the
    chunk's only where it is the largest and no other has one; else its images are in none.
    """
    pairs = [_transform(chunk, label) for label in labels]
    names = [None if matrix is None else part.get("component_id", "") for part, matrix in pairs]
    count = Counter(name for name in names if name is not None)
    own = {name: part.find("transform") for name, part in chunk.components.items() if name in count}
    placed = {name: move for name in own if (move := _similarity(own[name])) is not None}
    if count and not placed:
        placed = {count.most_common(1)[0][0]: _similarity(chunk.transform)}
    lost = sum(number for name, number in count.items() if name not in placed)
    if lost:
        warnings.append(
            f"{lost} of {count.total()} aligned cameras are in components of the chunk that have "
            "no place of their own: their poses were not taken; join the components with markers "
            "(Merge components), and save again"
        )
    order = {name: k for k, name in enumerate(placed)}
    return list(placed.values()), np.array([order.get(name, -1) for name in names])


def _poses(chunk, labels, moves, component, notes):
    """Centres and rotations (world to camera) by the transforms, NaN without; their world."""
    count, rigs = len(labels), 0
    centre, rotation = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    scaled, far = True, []
    for k, label in enumerate(labels):
        # The component is that of the master.
        part, matrix = _transform(chunk, label)
        if matrix is None:
            continue
        rigs += part is not chunk.cameras[label]
        if component[k] < 0:
            continue
        found = moves[component[k]]
        scaled &= found is not None
        scale, turn, shift = found or (1.0, np.eye(3), np.zeros(3))
        far.append(np.linalg.norm(shift))
        try:
            rotations_to_columns(matrix[:3, :3])
        except ValueError as error:
            raise part.wrong(f"camera {label!r}: {error}") from None
        centre[k] = scale * turn @ matrix[:3, 3] + shift
        rotation[k] = (turn @ matrix[:3, :3]).T
    if rigs:
        notes.append(f"{rigs} cameras of a rig have the poses of their masters and of the rig")
    if far and len(far) < count:
        notes.append(f"{count - len(far)} of {count} cameras are not aligned")
    geocentric = bool(far) and not _is_local(chunk.crs) and scaled
    if geocentric and not all(_EARTH_M[0] < length < _EARTH_M[1] for length in far):
        raise chunk.cameras[labels[0]].wrong(
            "the chunk's system is geographic or projected, but its transform is not "
            "geocentric; export the cameras again from Metashape"
        )
    return centre, rotation, _World(scaled=scaled, geocentric=geocentric)


class _Reference:
    """Measured place, angle (yaw, pitch, roll), sigma (n, 3), NaN where unknown; enabled (n,)."""

    def __init__(self, elements: list[Xml | None]):
        self.place, self.angle, self.sigma = (np.full((len(elements), 3), np.nan) for _ in range(3))
        self.enabled = np.zeros(len(elements), dtype=bool)
        for k, element in enumerate(elements):
            if element is None:
                continue
            place, angle = (
                [element.number(key, np.nan) for key in keys]
                for keys in ("xyz", ("yaw", "pitch", "roll"))
            )
            if np.isfinite(place).all():
                self.place[k], self.enabled[k] = place, _is_on(element, "enabled")
            if np.isfinite(angle).all():
                self.angle[k] = angle
            self.sigma[k] = _sigmas(element)


def _is_on(element, name):
    return element.get(name, "true").lower() in ("true", "1")


def _sigmas(element):
    """sx, sy, sz of the attributes sxyz, or sxy and sz, or sx, sy, sz; NaN where unknown."""
    if element.get("sxyz"):
        # "sx/sy/sz" or one number for all.
        try:
            found = np.array([float(word) for word in element.get("sxyz").split("/")])
        except ValueError:
            found = np.array([np.nan])
        if np.isinf(found).any():
            raise element.wrong(
                f"sxyz of <{element.tag}> = {element.get('sxyz')} is infinite; correct it, or "
                "export the project again"
            )
        found = np.broadcast_to(found, 3) if len(found) in (1, 3) else np.full(3, np.nan)
    else:
        both = element.number("sxy", np.nan)
        defaults = {"sx": both, "sy": both, "sz": np.nan}
        found = np.array([element.number(key, value) for key, value in defaults.items()])
    return np.where(found > 0, found, np.nan)


def _amid(places, crs):
    """A frame about the middle of places (n, 3) in a system, on round numbers; None without any."""
    return Local.amid(places, crs, digits=3) if len(places) else None


def _gnss(names, reference, measured, have, notes):
    unused = have & ~measured.enabled
    if unused.any():
        notes.append(f"{int(unused.sum())} measured camera positions are switched off: left out")
    rows = np.flatnonzero(have & measured.enabled)
    return gnss_table([(names[k], *reference[k], *measured.sigma[k]) for k in rows])


def _called(chunk, notes):
    """Names of markers by their numbers: labels, with the number behind one that several have."""
    labels = {
        number: (part.get("label") or number).strip() for number, part in chunk.markers.items()
    }
    many = Counter(labels.values())
    for label in (label for label, count in many.items() if count > 1):
        notes.append(f"{many[label]} markers are called {label}: their numbers stand behind it")
    return {n: f"{label} ({n})" if many[label] > 1 else label for n, label in labels.items()}


def _ground(chunk, world, called, warnings):
    """ground.csv of the markers with a reference; None without any."""
    numbers = list(chunk.markers)
    found = _Reference([chunk.markers[number].find("reference") for number in numbers])
    rows = np.flatnonzero(np.isfinite(found.place).all(axis=1))
    stated = [chunk.markers[number].find("reference[@x]") is not None for number in numbers]
    if lost := sum(stated) - len(rows):
        told = f"{lost} markers have x and y and no height (z), so they are no ground points"
        warnings.append(f"{told}: give them a height and its accuracy")
    if numbers and not any(stated):
        told = f"{counted(len(numbers), 'marker')} without coordinates: no ground point"
        warnings.append(f"{told}; where they were surveyed, give that with --ground")
    if not len(rows):
        return None
    return ground_table(
        [called[numbers[k]] for k in rows],
        world.points(found.place[rows], _crs(chunk.marker_crs or chunk.crs)),
        found.sigma[rows],
        np.where(found.enabled[rows], "control", "check"),
    )


def _distances(chunk, called, notes):
    """distances.csv of the scale bars; None without any.

    A bar has two ends, of which markers alone have a place in distances.csv, and a reference with
    its length d and, where it is not that of the chunk, standard deviation sd, m.
    """
    rows, off, other = [], 0, 0
    for part in chunk.bars:
        ends = [called.get(end.get("marker_id", "")) for end in part.all("endpoint")]
        stated = part.find("reference")
        length = stated and stated.number("d", stated.number("distance"))
        if not (length and length > 0 and _is_on(stated, "enabled") and _is_on(part, "enabled")):
            off += 1
        elif len(ends) != 2 or None in ends or ends[0] == ends[1]:
            other += 1
        else:
            sigma = stated.number("sd", stated.number("accuracy", chunk.bar_m))
            rows.append((*ends, length, sigma if sigma > 0 else np.nan))
    if off:
        notes.append(f"{counted(off, 'scale bar')} without a length, or switched off: left out")
    if other:
        notes.append(
            f"{counted(other, 'scale bar')} not between two markers (of cameras, say): left out; "
            "distances.csv is of marked points"
        )
    return pd.DataFrame(rows, columns=["from", "to", "distance", "sigma"]) if rows else None


def _marks(chunk, labels, called, notes):
    at = {label: k for k, label in enumerate(labels)}
    rows, loose, lost = [], 0, 0
    for number in dict.fromkeys([*chunk.markers, *chunk.projections]):
        if number in chunk.markers_off:
            continue
        for label, element in chunk.projections.get(number, []):
            x, y = (element.number(key) for key in "xy")
            if not _is_on(element, "pinned"):
                loose += 1
            elif label not in at:
                lost += 1
            elif x is None or y is None:
                raise element.wrong(f"a projection of marker {number} has no x, y")
            else:
                rows.append((called.get(number, number), at[label], x - 0.5, y - 0.5))
    if loose:
        notes.append(f"{loose} marker projections are not pinned (guessed): left out")
    if lost:
        notes.append(f"{lost} marker projections are in images that were not imported")
    return Views.of(rows, "marker projections")


# --- tie points ------------------------------------------------------------------------------


def _ties(places, found, labels, world, moves, component):
    """Views of the tie points, and names and places of the points; None, None without any.

    moves: of the components that have a place; component (n,): which one an image is in, -1: none.
    """
    at = {label: k for k, label in enumerate(labels)}
    ids, images, pixels = [], [], []
    for label, table in found.items():
        if label in at and {"x", "y", "id"} <= set(table.dtype.names or ()):
            ids.append(table["id"].astype(np.int64))
            images.append(np.full(len(table), at[label]))
            pixels.append(np.column_stack([table["x"], table["y"]]).astype(float) - 0.5)
    if not ids or not {"x", "y", "z", "id"} <= set(places.dtype.names or ()):
        return None, None
    ids, images, pixels = np.concatenate(ids), np.concatenate(images), np.concatenate(pixels)
    known = places["id"].astype(np.int64)
    order = np.argsort(known)
    near = np.minimum(np.searchsorted(known[order], ids), len(known) - 1)
    kept = known[order][near] == ids
    xyz = np.column_stack([places[axis].astype(float) for axis in "xyz"])
    if not (np.isfinite(xyz).all() and np.isfinite(pixels[kept]).all()):
        raise InputError("a tie point of the archive is not finite; save the project again")
    point, image = order[near][kept], images[kept]
    # A point is seen in one component; those that nothing sees go with the first.
    where = np.full(len(known), -1)
    np.maximum.at(where, point, component[image])
    where[~np.isin(np.arange(len(known)), point)] = 0
    if world.scaled:
        for k, (scale, turn, shift) in enumerate(moves):
            xyz[where == k] = scale * xyz[where == k] @ turn.T + shift
        xyz = world.points(xyz, GEOCENTRIC if world.geocentric else None)
    # Marker labels are often plain numbers: tie points get a letter.
    names = ("t" + pd.Index(known).astype("str")).astype("str")
    views = Views(point, names, image, pixels[kept], "tie points")
    return views, (names[where >= 0], xyz[where >= 0])
