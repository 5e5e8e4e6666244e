"""Agisoft Metashape and PhotoScan: camera XML, marker XML, and PhotoScan projects (.psz).

Conventions, where they differ from ours: (0.5, 0.5) is the centre of the top-left pixel; cx, cy are
counted from the image centre (in PhotoScan's older form, with fx and fy, from the corner); b1, b2
are in pixels and multiply the *distorted* ray. A camera's transform (4 x 4, row by row) is camera
to chunk; the transform of the chunk, or of its component, goes on to the world: geocentric if the
chunk has a geographic or projected system, local otherwise. Of the reference angles,
M = Rz(-yaw) Rx(pitch) Ry(roll) takes the camera (x right, y forward, z up) to east, north, up;
pitch 0 looks down.

Source: Agisoft Metashape manual, appendix "Camera models"; the rest as found on real files.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.camera import INTERIOR, Camera
from corridor.errors import InputError
from corridor.geometry import rotation_from_quaternion
from corridor.gnss import Local, convert
from corridor.interchange.cameras import standing_for
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
from corridor.interchange.rows import camera_positions
from corridor.interchange.text import missing, opening
from corridor.interchange.xml import attribute, child, parse_xml, read_xml, values

NAME = "metashape"
TITLE = "Metashape camera and marker XML, PhotoScan project (.psz)"
WRITES = ("metashape",)
HOLDS = "f, cx, cy, k1..k4, p1, p2 (b1, b2 without distortion)"

_FLIP = np.diag([1.0, -1.0, -1.0])
_EARTH_M = (6.2e6, 6.5e6)
_GEOCENTRIC, _GEOGRAPHIC = "EPSG:4978", "EPSG:4979"
_PLY = {
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8", "int": "<i4",
    "int32": "<i4", "uint": "<u4", "uint32": "<u4", "uchar": "u1", "uint8": "u1", "char": "i1",
    "short": "<i2", "ushort": "<u2",
}  # fmt: skip


def recognise(path: Path) -> bool:
    """An XML file with a chunk, a .psz, or a folder with one of them."""
    if path.is_file():
        return _looks(path)
    return any(_looks(file) for end in ("*.psz", "*.xml") for file in sorted(path.glob(end)))


def _looks(path):
    if path.suffix.lower() in (".psz", ".psx"):
        return True
    head = opening(path)
    return path.suffix.lower() == ".xml" and "<document" in head and "<chunk" in head


def _known_xml(path):
    return _looks(path) or "<calibration>" in opening(path)


@dataclass
class _Chunk:
    """What the XML files of one chunk say together.

    Cameras by label and sensors by label or number: two exports may number them differently.
    projections: marker number -> (camera label, element). sensor_of: camera label -> sensor.
    """

    sensors: dict[str, ElementTree.Element] = field(default_factory=dict)
    cameras: dict[str, ElementTree.Element] = field(default_factory=dict)
    markers: dict[str, ElementTree.Element] = field(default_factory=dict)
    projections: dict[str, list[tuple[str, ElementTree.Element]]] = field(default_factory=dict)
    sensor_of: dict[str, str] = field(default_factory=dict)
    components: dict[str, ElementTree.Element] = field(default_factory=dict)
    transform: ElementTree.Element | None = None
    crs: str | None = None
    marker_crs: str | None = None
    home: Path = Path()


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file or folder. Raises InputError naming file and line."""
    notes: list[str] = []
    warnings: list[str] = []
    archive = path if path.suffix.lower() == ".psz" and path.is_file() else None
    if path.is_dir() and not any(_looks(file) for file in path.glob("*.xml")):
        archive = next(iter(sorted(path.glob("*.psz"))), None)
    if archive is None and path.is_dir():
        packed = sorted(path.glob("*.psz"))
        archive = packed[0] if packed else None
    if path.suffix.lower() == ".psx":
        raise InputError(
            f"{path.name}: a .psx project is not read; export its cameras and markers as XML "
            "(File > Export), or save it as .psz"
        )
    if archive is not None:
        chunk, tie = _psz(archive, notes)
    else:
        files = [path] if path.is_file() else [f for f in sorted(path.glob("*.xml")) if _looks(f)]
        if not files:
            raise InputError(f"{path} holds no Metashape XML; name the exported file")
        if path.is_dir():
            strange = [f.name for f in sorted(path.glob("*.xml")) if not _known_xml(f)]
            warnings += [f"{name} is no XML of Metashape that corridor knows" for name in strange]
        chunk, tie = _together(files, notes, warnings), None
    return _project(chunk, tie, archive or path, notes, warnings)


def _together(files, notes, warnings):
    """The chunk of the file that says most, and of those that are of the same cameras."""
    parts = []
    for file in files:
        element = _document(read_xml(file), file, notes)
        labels = {part.get("label") for part in element.iter("camera") if part.get("label")}
        posed = sum(1 for _ in element.iterfind(".//camera/transform"))
        marked = sum(1 for _ in element.iterfind(".//location"))
        parts.append((marked + posed, file, element, labels))
    parts.sort(key=lambda part: -part[0])
    chunk = _Chunk()
    known = parts[0][3]
    for _, file, element, labels in parts:
        if labels and known and not (labels <= known or labels >= known):
            warnings.append(
                f"{file.name} is of other cameras than {parts[0][1].name} and was left out; name "
                "the file to import it"
            )
            continue
        _gather(chunk, element, file)
    return chunk


def _document(root, path, notes):
    chunks = root.findall("chunk") or root.findall("chunks/chunk")
    if root.tag != "document" or not chunks:
        raise InputError(f"{path.name} is no Metashape document with a chunk; export it again")
    if len(chunks) > 1:
        notes.append(f"{path.name} holds {len(chunks)} chunks; the first was read")
    return chunks[0]


def _gather(chunk, element, path):
    chunk.home = path
    here = {}
    for part in element.findall("sensors/sensor"):
        here[part.get("id", "")] = key = part.get("label") or f"sensor {part.get('id')}"
        twice = sum(1 for other in here.values() if other == key) > 1
        if twice:
            here[part.get("id", "")] = key = f"{key} {part.get('id')}"
        known = chunk.sensors.get(key)
        if known is None or known.find("calibration") is None:
            chunk.sensors[key] = part
    for part in element.findall("markers/marker"):
        chunk.markers.setdefault(part.get("id", ""), part)
    labels = {}
    # Cameras may stand in groups.
    for part in element.iter("camera"):
        label, number = part.get("label"), part.get("id")
        if label is None or number is None:
            continue
        if label in labels.values():
            raise InputError(f"{path.name}: two cameras are labelled {label!r}; rename one")
        labels[number] = label
        known = chunk.cameras.get(label)
        if known is None or len(part) > len(known):
            chunk.cameras[label] = part
            chunk.sensor_of[label] = here.get(part.get("sensor_id", ""), "")
    for part in element.findall("components/component"):
        chunk.components.setdefault(part.get("id", ""), part)
    frames = element.findall("frames/frame")
    for part in frames[0].findall("markers/marker") if frames else []:
        found = [
            (labels.get(location.get("camera_id", ""), ""), location)
            for location in part.findall("location")
        ]
        chunk.projections.setdefault(part.get("marker_id", ""), found)
    if element.find("transform") is not None:
        chunk.transform = element.find("transform")
    for tag, name in (("reference", "crs"), ("marker_reference", "marker_crs")):
        found = element.find(tag)
        if found is not None and (found.text or "").strip():
            setattr(chunk, name, found.text.strip())


# --- cameras ---------------------------------------------------------------------------------


def _camera(sensor, name, path, notes, strange):
    calibrations = sensor.findall("calibration")
    calibration = next(
        (part for part in calibrations if part.get("class") == "adjusted"),
        calibrations[-1] if calibrations else None,
    )
    kind = (calibration if calibration is not None else sensor).get("type", "frame")
    if kind != "frame":
        strange.append(f"sensor {name!r} is a {kind}, for which corridor has no model")
        return None
    resolution = child(sensor if calibration is None else calibration, "resolution", path)
    width, height = (attribute(resolution, key, path, 0.0) for key in ("width", "height"))
    middle = in_the_middle(width, height)
    properties = {part.get("name"): part for part in sensor.findall("property")}

    def of_sensor(key):
        return attribute(properties[key], "value", path) if key in properties else None

    pixel = of_sensor("pixel_width")
    pixel_um = {"pixel_um": 1000 * pixel} if pixel and pixel > 0 else {}
    if calibration is None:
        focal = of_sensor("focal_length")
        if not focal or not pixel or min(focal, pixel) <= 0:
            strange.append(f"sensor {name!r} has neither a calibration nor a focal length")
            return None
        notes.append(f"sensor {name!r} has no calibration: f from its focal length and pixel size")
        return camera_from(name, width, height, focal / pixel, *middle, **pixel_um)
    known = {part.tag: part for part in calibration}

    def value(key, default=0.0):
        return float(values(known[key], path, 1)[0]) if key in known else default

    k = [value(f"k{n}") for n in range(1, 5)]
    p1, p2, p3, p4 = (value(f"p{n}") for n in range(1, 5))
    if "fx" in known or "fy" in known:
        # PhotoScan's older form: cx, cy from the corner.
        f, fx = value("fy"), value("fx")
        cx, cy = value("cx") - 0.5, value("cy") - 0.5
        b1, b2 = fx - f, value("skew")
        if p1 or p2:
            notes.append(
                f"sensor {name!r}: the older form (fx, fy) does not say which of p1, p2 is which; "
                "they were read in today's order"
            )
    else:
        f = value("f")
        cx, cy = value("cx") + middle[0], value("cy") + middle[1]
        b1, b2 = value("b1"), value("b2")
    if not f > 0:
        raise InputError(f"{path.name}: sensor {name!r} has the focal length {f:g}; export again")
    camera = camera_from(
        name, width, height, f, cx, cy, k1=k[0], k2=k[1], k3=k[2], k4=k[3], p1=p1, p2=p2,
        b1=b1 / f, b2=b2 / f, **pixel_um,
    )  # fmt: skip

    def project(rays: np.ndarray) -> np.ndarray:
        u, v = rays.T
        r2 = u * u + v * v
        radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))
        more = 1 + r2 * (p3 + r2 * p4)
        x = u * radial + (p1 * (r2 + 2 * u * u) + 2 * p2 * u * v) * more
        y = v * radial + (p2 * (r2 + 2 * v * v) + 2 * p1 * u * v) * more
        return np.column_stack([cx + f * x + b1 * x + b2 * y, cy + f * y])

    return standing_for(camera, project, notes)


# --- from chunk to world ---------------------------------------------------------------------


@dataclass
class _World:
    """The world of a chunk: `to_world` of chunk coordinates, `of_reference` of measured ones."""

    local: Local | None = None
    placed: bool = True

    def point(self, places, crs):
        """Block coordinates (n, 3) of places in a CRS (None: local already)."""
        if self.local is None or crs is None:
            return np.asarray(places, dtype=float).reshape(-1, 3)
        return self.local.from_crs(np.asarray(places, dtype=float).reshape(-1, 3), crs)


def _similarity(element, path):
    rotation = values(child(element, "rotation", path), path, 9).reshape(3, 3)
    translation = values(child(element, "translation", path), path, 3)
    scale = float(values(child(element, "scale", path), path, 1)[0])
    # A rotation only: rotations_to_columns raises where it is none.
    rotations_to_columns(rotation)
    if not scale > 0:
        raise InputError(f"{path.name}: the transform's scale is {scale:g}; export it again")
    return scale, rotation, translation


def _is_local(crs):
    return crs is None or crs.startswith(("LOCAL_CS", "LOCAL"))


def _project(chunk, tie, path, notes, warnings):
    home = chunk.home
    strange: list[str] = []
    cameras = {}
    for name, sensor in chunk.sensors.items():
        cameras[name] = _camera(sensor, name, home, notes, strange)
    warnings += [f"{sentence}: its images were left out" for sentence in strange]
    rows = {
        label: part
        for label, part in chunk.cameras.items()
        if cameras.get(chunk.sensor_of[label]) is not None
    }
    if not rows:
        raise InputError(
            f"{path.name} holds no image of a frame camera"
            + (f" ({strange[0]})" if strange else "")
            + "; export the cameras of a chunk with frame cameras"
        )
    centre, rotation, known, geocentric, scaled = _poses(chunk, rows, home, notes)
    place = np.full((len(rows), 3), np.nan)
    angle = np.full((len(rows), 3), np.nan)
    sigma = np.full((len(rows), 3), np.nan)
    enabled = np.zeros(len(rows), dtype=bool)
    for k, part in enumerate(rows.values()):
        _reference(part.find("reference"), home, k, place, angle, sigma, enabled)
    crs = None if _is_local(chunk.crs) else _crs(chunk.crs, home)
    world = _World(placed=scaled or (not known.any() and np.isfinite(place).any()))
    free = bool(known.any()) and not scaled
    if (crs is not None or geocentric) and not free:
        world.local = _local(centre[known] if geocentric else None, place, crs)
    if geocentric:
        turn = world.local.rotation()
        centre[known] = world.local.from_crs(centre[known], _GEOCENTRIC)
        rotation[known] = rotation[known] @ turn.T
    reference = np.full_like(place, np.nan)
    # Measured positions mean nothing in a frame of its own.
    have = np.isfinite(place).all(axis=1) & (not free)
    reference[have] = world.point(place[have], crs)
    taken = have & np.isfinite(angle).all(axis=1) & ~known.any()
    if taken.any():
        rotation[taken], centre[taken] = _of_angles(angle[taken]), reference[taken]
        known = known | taken
        notes.append(
            f"{int(taken.sum())} cameras are not aligned: their poses are the measured positions "
            "and angles (start values)"
        )
    if not scaled and known.any() and not taken.all():
        notes.append(
            "the chunk has no transform: its coordinates have no scale and no place, they are not "
            "metres"
        )
    quaternion = np.full((len(rows), 4), np.nan)
    quaternion[known] = rotations_to_columns(rotation[known])
    centre[~known] = np.nan
    names = list(rows)
    used = [chunk.sensor_of[label] for label in rows]
    gnss = _gnss(names, reference, sigma, enabled & have, have, world, notes)
    block = Block(
        name=path.stem,
        cameras={c.name: c for c in cameras.values() if c is not None and c.name in used},
        images=images_table(names, used, centre, quaternion),
        gnss=gnss,
    )
    if world.local is not None:
        lat, lon, height = world.local.origin
        block.extra["local_frame"] = {"lat_deg": lat, "lon_deg": lon, "height": height}
        notes.append(f"world: east, north, up about {lat:g}, {lon:g} degrees, height {height:g} m")
    _markers(chunk, rows, block, world, crs, home, notes, warnings)
    if tie is not None:
        _ties(tie, chunk, rows, block, world, geocentric, scaled, home, warnings)
    if not scaled and not taken.all():
        block.description = "chunk units: no scale, no place in the world (not metres)"
    return Project(NAME, path, block, notes=notes, warnings=warnings, placed=bool(world.placed))


def _poses(chunk, rows, path, notes):
    count = len(rows)
    centre, rotation = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    known = np.zeros(count, dtype=bool)
    scaled, far = True, []
    for k, part in enumerate(rows.values()):
        element = part.find("transform")
        if element is None:
            continue
        matrix = values(element, path, 16).reshape(4, 4)
        own = chunk.components.get(part.get("component_id", ""))
        own = own.find("transform") if own is not None else None
        element = own if own is not None else chunk.transform
        # A transform may be there with nothing but a region in it.
        if element is None or element.find("rotation") is None:
            scale, turn, shift = 1.0, np.eye(3), np.zeros(3)
            scaled = False
        else:
            scale, turn, shift = _similarity(element, path)
        far.append(np.linalg.norm(shift))
        try:
            rotations_to_columns(matrix[:3, :3])
        except InputError as error:
            raise InputError(f"{path.name}: camera {part.get('label')!r}: {error}") from None
        centre[k] = scale * turn @ matrix[:3, 3] + shift
        rotation[k] = (turn @ matrix[:3, :3]).T
        known[k] = True
    if not known.all() and known.any():
        notes.append(f"{int((~known).sum())} of {count} cameras are not aligned")
    on_earth = [_EARTH_M[0] < length < _EARTH_M[1] for length in far]
    geocentric = bool(known.any()) and not _is_local(chunk.crs) and scaled
    if geocentric and not all(on_earth):
        raise InputError(
            f"{path.name}: the chunk's system is geographic or projected, but its transform is not "
            "geocentric; export the cameras again from Metashape"
        )
    return centre, rotation, known, geocentric, scaled


def _reference(element, path, k, place, angle, sigma, enabled):
    if element is None:
        return
    if all(element.get(key) is not None for key in "xyz"):
        place[k] = [attribute(element, key, path) for key in "xyz"]
        enabled[k] = element.get("enabled", "true").lower() in ("true", "1")
    if all(element.get(key) is not None for key in ("yaw", "pitch", "roll")):
        angle[k] = [attribute(element, key, path) for key in ("yaw", "pitch", "roll")]
    sigma[k] = _sigmas(element, path)


def _sigmas(element, path):
    """sx, sy, sz of the attributes sxyz, or sxy and sz, or sx, sy, sz; NaN where unknown."""
    if element.get("sxyz"):
        # "sx/sy/sz" or one number for all.
        words = element.get("sxyz").split("/")
        try:
            found = np.array([float(word) for word in words])
        except ValueError:
            found = np.array([np.nan])
        found = np.broadcast_to(found, 3) if len(found) in (1, 3) else np.full(3, np.nan)
    else:
        both = attribute(element, "sxy", path, np.nan)
        found = np.array([attribute(element, key, path, both) for key in ("sx", "sy")])
        found = np.append(found, attribute(element, "sz", path, np.nan))
    return np.where(found > 0, found, np.nan)


def _of_angles(angles):
    """Rotations (n, 3, 3), world to camera, of yaw, pitch, roll (n, 3) degrees."""
    yaw, pitch, roll = np.radians(angles).T
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)

    def stacked(*rows):
        return np.array(rows).reshape(3, 3, -1).transpose(2, 0, 1)

    sy, cy, sp, cp, sr, cr = (f(a) for a in (-yaw, pitch, roll) for f in (np.sin, np.cos))
    about_z = stacked(cy, -sy, zero, sy, cy, zero, zero, zero, one)
    about_x = stacked(one, zero, zero, zero, cp, -sp, zero, sp, cp)
    about_y = stacked(cr, zero, sr, zero, one, zero, -sr, zero, cr)
    return _FLIP @ (about_z @ about_x @ about_y).transpose(0, 2, 1)


def _crs(text, path):
    import pyproj

    try:
        return pyproj.CRS.from_user_input(text).to_wkt()
    except pyproj.exceptions.CRSError:
        raise InputError(f"{path.name}: the reference system {text[:60]!r} is not known") from None


def _local(geocentric, place, crs):
    """A frame about the middle of the cameras, on round numbers."""
    if geocentric is not None and len(geocentric):
        geographic = convert(geocentric, _GEOCENTRIC, _GEOGRAPHIC)
    else:
        have = np.isfinite(place).all(axis=1)
        if not have.any():
            return None
        geographic = convert(place[have], crs, _GEOGRAPHIC)
    lon, lat, _ = np.median(geographic, axis=0)
    return Local(round(float(lat), 3), round(float(lon), 3), 0.0)


def _gnss(names, reference, sigma, enabled, have, world, notes):
    unused = have & ~enabled
    if unused.any():
        notes.append(f"{int(unused.sum())} measured camera positions are switched off: left out")
    if not enabled.any():
        return None
    chosen = [name for name, on in zip(names, enabled, strict=True) if on]
    table = points_table(chosen, reference[enabled])
    table = table.rename(columns={"point": "image"})
    if np.isfinite(sigma[enabled]).any():
        table[["sx", "sy", "sz"]] = sigma[enabled]
    return table


def _markers(chunk, rows, block, world, crs, path, notes, warnings):
    at = {number: k for k, number in enumerate(rows)}
    images = list(block.images["image"])
    own = chunk.marker_crs
    own = crs if own is None else (None if _is_local(own) else _crs(own, path))
    labels, place, sigma, roles = [], [], [], []
    names = {number: part.get("label") or number for number, part in chunk.markers.items()}
    if world.placed:
        for number, part in chunk.markers.items():
            element = part.find("reference")
            if element is None or any(element.get(key) is None for key in "xyz"):
                continue
            labels.append(names[number])
            place.append([attribute(element, key, path) for key in "xyz"])
            sigma.append(_sigmas(element, path))
            roles.append("control" if element.get("enabled", "true") in ("true", "1") else "check")
    point, image, pixels, loose, lost = [], [], [], 0, 0
    order = list(dict.fromkeys([*names, *chunk.projections]))
    for k, number in enumerate(order):
        for label, element in chunk.projections.get(number, []):
            if element.get("pinned", "true").lower() not in ("true", "1"):
                loose += 1
                continue
            if label not in at:
                lost += 1
                continue
            x, y = (attribute(element, key, path) for key in "xy")
            if x is None or y is None:
                raise InputError(f"{path.name}: a projection of marker {number} has no x, y")
            point.append(k)
            image.append(at[label])
            pixels.append((x - 0.5, y - 0.5))
    if loose:
        notes.append(f"{loose} marker projections are not pinned (guessed): left out")
    if lost:
        notes.append(f"{lost} marker projections are in images that were not imported")
    if point:
        table = observations_table(
            np.array(point), [names.get(n, n) for n in order], np.array(image), images,
            np.array(pixels),
        )  # fmt: skip
        block.marks = same_point_once(table, "marker projections", warnings)
        block.marks["point"] = block.marks["point"].cat.remove_unused_categories()
    if labels:
        block.ground = ground_table(
            labels, world.point(np.array(place), own), np.array(sigma), roles
        )
        block.__post_init__()


# --- PhotoScan's .psz ------------------------------------------------------------------------


def _psz(path, notes):
    try:
        with zipfile.ZipFile(path) as archive:
            chunk = _Chunk(home=path)
            root = parse_xml(archive.read("doc.xml"), path)
            element = _document(root, path, notes)
            _gather(chunk, element, path)
            number_of = {part.get("id"): part.get("label") for part in element.iter("camera")}
            cloud = element.find("frames/frame/point_cloud")
            if cloud is None:
                return chunk, None
            points = cloud.find("points")
            name = points.get("path", "") if points is not None else ""
            places = _ply(archive.read(name), f"{path.name}: {name}") if name else None
            found = {
                number_of.get(part.get("camera_id"), ""): _ply(
                    archive.read(part.get("path", "")), f"{path.name}: {part.get('path')}"
                )
                for part in cloud.findall("projections")
            }
            return chunk, (places, found)
    except FileNotFoundError as error:
        raise missing(path, error) from error
    except (zipfile.BadZipFile, KeyError, EOFError, NotImplementedError, OSError) as error:
        raise InputError(
            f"{path.name} is damaged or no PhotoScan archive ({error}); save the project again"
        ) from None
    except zipfile.zlib.error as error:
        raise InputError(f"{path.name} is damaged ({error}); save the project again") from None


def _ply(data, where):
    """Vertices of a binary little endian PLY as a structured array."""
    end = data.find(b"end_header\n")
    head = data[: max(end, 0)].decode("ascii", errors="replace").split("\n")
    columns, count = [], None
    for row in head:
        words = row.split()
        if words[:2] == ["element", "vertex"] and len(words) == 3 and words[2].isdecimal():
            count = int(words[2])
        elif words[:1] == ["property"] and len(words) == 3 and words[1] in _PLY:
            columns.append((words[2], _PLY[words[1]]))
    if end < 0 or count is None or "binary_little_endian" not in head[1:2][0]:
        raise InputError(f"{where} is no binary PLY; save the project again")
    kind = np.dtype(columns)
    start = end + len(b"end_header\n")
    if kind.itemsize == 0 or len(data) < start + count * kind.itemsize:
        raise InputError(f"{where} is cut off; save the project again")
    return np.frombuffer(data, kind, count, start)


def _ties(tie, chunk, rows, block, world, geocentric, scaled, path, warnings):
    places, found = tie
    if places is None or not found:
        return
    at = {number: k for k, number in enumerate(rows)}
    ids, images, pixels = [], [], []
    for number, table in found.items():
        if number not in at or not {"x", "y", "id"} <= set(table.dtype.names or ()):
            continue
        ids.append(table["id"].astype(np.int64))
        images.append(np.full(len(table), at[number]))
        pixels.append(np.column_stack([table["x"], table["y"]]).astype(float) - 0.5)
    if not ids or not {"x", "y", "z", "id"} <= set(places.dtype.names or ()):
        return
    ids, images, pixels = np.concatenate(ids), np.concatenate(images), np.concatenate(pixels)
    known = places["id"].astype(np.int64)
    order = np.argsort(known)
    near = np.minimum(np.searchsorted(known[order], ids), len(known) - 1)
    kept = known[order][near] == ids
    xyz = np.column_stack([places[axis].astype(float) for axis in "xyz"])
    if not (np.isfinite(xyz).all() and np.isfinite(pixels[kept]).all()):
        raise InputError(f"{path.name}: a tie point is not finite; save the project again")
    if chunk.transform is not None and scaled:
        scale, turn, shift = _similarity(chunk.transform, path)
        xyz = scale * xyz @ turn.T + shift
        if geocentric:
            xyz = world.local.from_crs(xyz, _GEOCENTRIC)
    # Marker labels are often plain numbers: tie points get a letter.
    names = ("t" + pd.Index(known).astype("str")).astype("str")
    table = observations_table(
        order[near][kept], names, images[kept], list(block.images["image"]), pixels[kept]
    )
    block.tie_points = same_point_once(table, "tie points", warnings)
    block.points = points_table(names, xyz)
    block.__post_init__()


# --- out -------------------------------------------------------------------------------------


def unheld(camera: Camera) -> list[str]:
    """Interior parameters, not zero, that Metashape cannot hold exactly."""
    held = {"f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2"}
    bent = any(camera[name] for name in INTERIOR if name not in ("f", "cx", "cy", "b1", "b2"))
    if not bent:
        held |= {"b1", "b2"}
    return [name for name in INTERIOR if name not in held and camera[name] != 0.0]


def nearest(camera: Camera) -> Camera:
    """The nearest camera that Metashape holds."""
    return camera.with_values(**{name: 0.0 for name in unheld(camera)})


def losses(block: Block) -> list[str]:
    """What else the XML cannot hold, and where it went instead."""
    lost = []
    if len(block.tie_points):
        lost.append("tie points: Metashape takes none from XML, only markers")
    if len(block.gnss):
        lost.append("lever arms: the references are the camera centres that GNSS gives")
    return lost


def write(block: Block, folder: Path, name: str) -> None:
    """Write cameras.xml (poses and references), markers.xml and calibration_NAME.xml."""
    local = block.extra.get("local_frame")
    if local:
        place = Local(local["lat_deg"], local["lon_deg"], local["height"])

        def world(points):
            return place.to_geographic(points)

        wkt = (
            'GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,'
            '298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.01745329251994328],'
            'AUTHORITY["EPSG","4326"]]'
        )
    else:

        def world(points):
            return points + block.offset

        wkt = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'
    _tree(_cameras_xml(block, world, wkt, local), folder / "cameras.xml")
    if len(block.marks) or len(block.ground):
        _tree(_markers_xml(block, world, wkt), folder / "markers.xml")
    for number, camera in enumerate(block.cameras.values()):
        _tree(_calibration_xml(camera), folder / f"calibration_{number}.xml")


def _tree(root, path):
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add(parent, tag, text=None, **attributes):
    element = ElementTree.SubElement(
        parent, tag, {k: v if isinstance(v, str) else repr(v) for k, v in attributes.items()}
    )
    if text is not None:
        element.text = text if isinstance(text, str) else repr(float(text))
    return element


def _inner(parent, camera):
    cx, cy = in_the_middle(camera.width, camera.height)
    f = camera["f"]
    _add(parent, "f", f)
    _add(parent, "cx", camera["cx"] - cx)
    _add(parent, "cy", camera["cy"] - cy)
    for key in ("b1", "b2"):
        if camera[key]:
            _add(parent, key, camera[key] * f)
    for key in ("k1", "k2", "k3", "k4", "p1", "p2"):
        if camera[key]:
            _add(parent, key, camera[key])


def _calibration_xml(camera):
    root = ElementTree.Element("calibration")
    _add(root, "projection", "frame")
    _add(root, "width", str(camera.width))
    _add(root, "height", str(camera.height))
    _inner(root, camera)
    return root


def _document_xml(block):
    root = ElementTree.Element("document", {"version": "2.0.0"})
    chunk = _add(root, "chunk", label=block.name, enabled="true")
    sensors = _add(chunk, "sensors", next_id=str(len(block.cameras)))
    for number, camera in enumerate(block.cameras.values()):
        sensor = _add(sensors, "sensor", id=str(number), label=camera.name, type="frame")
        _add(sensor, "resolution", width=str(camera.width), height=str(camera.height))
        if camera.pixel_um:
            for key in ("pixel_width", "pixel_height"):
                _add(sensor, "property", name=key, value=camera.pixel_um / 1000)
        calibration = _add(sensor, "calibration", type="frame", **{"class": "adjusted"})
        _add(calibration, "resolution", width=str(camera.width), height=str(camera.height))
        _inner(calibration, camera)
    cameras = _add(chunk, "cameras", next_id=str(len(block.images)), next_group_id="0")
    number = {name: str(k) for k, name in enumerate(block.cameras)}
    for k, (image, camera) in enumerate(block.images[["image", "camera"]].itertuples(index=False)):
        _add(cameras, "camera", id=str(k), sensor_id=number[camera], label=image)
    return root, chunk, cameras


def _words(array):
    return " ".join(repr(float(value)) for value in np.ravel(array))


def _cameras_xml(block, world, wkt, local):
    root, chunk, cameras = _document_xml(block)
    if local:
        place = Local(local["lat_deg"], local["lon_deg"], local["height"])
        turn = place.rotation().T
        shift = convert(place.to_geographic(np.zeros((1, 3))), _GEOGRAPHIC, _GEOCENTRIC)[0]
    else:
        turn, shift = np.eye(3), block.offset
    positions = camera_positions(block).set_index("image")
    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    posed = set(names) <= set(block.images.columns)
    for element, (_, row) in zip(cameras, block.images.iterrows(), strict=True):
        if posed and np.isfinite(row[names].to_numpy(float)).all():
            matrix = np.eye(4)
            quaternion = row[names[3:]].to_numpy(float)[None]
            matrix[:3, :3] = rotation_from_quaternion(quaternion)[0].T
            matrix[:3, 3] = row[names[:3]].to_numpy(float)
            _add(element, "transform", _words(matrix))
        if row["image"] in positions.index:
            mine = positions.loc[row["image"]]
            x, y, z = world(mine[["x", "y", "z"]].to_numpy(float)[None])[0].tolist()
            sigma = "/".join(repr(float(mine[key])) for key in ("sx", "sy", "sz"))
            _add(element, "reference", x=x, y=y, z=z, sxyz=sigma, enabled="true")
    _add(chunk, "reference", wkt)
    transform = _add(chunk, "transform")
    _add(transform, "rotation", _words(turn))
    _add(transform, "translation", _words(shift))
    _add(transform, "scale", "1")
    return root


def _markers_xml(block, world, wkt):
    root, chunk, _ = _document_xml(block)
    ground = block.ground.set_index("point")
    sigmas = pd.DataFrame(block.ground_sigma(), index=ground.index, columns=["sx", "sy", "sz"])
    marked = block.marks["point"].cat.categories
    names = list(dict.fromkeys([*ground.index, *marked]))
    markers = _add(chunk, "markers", next_id=str(len(names)), next_group_id="0")
    for k, name in enumerate(names):
        element = _add(markers, "marker", id=str(k), label=name)
        if name in ground.index:
            x, y, z = world(ground.loc[name, ["x", "y", "z"]].to_numpy(float)[None])[0].tolist()
            sigma = "/".join(repr(float(value)) for value in sigmas.loc[name])
            on = "true" if ground.loc[name, "role"] == "control" else "false"
            _add(element, "reference", x=x, y=y, z=z, sxyz=sigma, enabled=on)
    frames = _add(chunk, "frames", next_id="1")
    found = _add(_add(frames, "frame", id="0"), "markers")
    rows = block.image_rows("marks")
    point = pd.Index(names).get_indexer(marked)[block.marks["point"].cat.codes]
    pixels = block.marks[["x", "y"]].to_numpy() + 0.5
    for k in range(len(names)):
        mine = np.flatnonzero(point == k)
        if not len(mine):
            continue
        element = _add(found, "marker", marker_id=str(k))
        for row in mine:
            x, y = pixels[row].tolist()
            _add(element, "location", camera_id=str(rows[row]), pinned="true", x=x, y=y)
    _add(chunk, "reference", wkt)
    return root
