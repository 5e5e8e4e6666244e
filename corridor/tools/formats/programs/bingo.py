"""Image coordinates of PATB and BINGO, with poses, as text: a folder with convention.toml.

Such text states neither unit, origin nor angles: the file convention.toml beside it does.

[measurements]
file = "image.dat"          # an image and its camera or focal length; lines of point x y; -99
unit = "mm"                 # mm, um or px
origin = "principal point"  # or "centre", "corner", "pixel" (middle of the first) of the picture
y = "up"                    # or "down"
[poses]
file = "poses.txt"          # image, x, y, z, then three angles or nine numbers a line
angles = "omega phi kappa"  # or "phi omega kappa", "matrix to ground", "matrix to image"
unit = "deg"                # deg, gon or rad
crs = "EPSG:32647"          # optional
[camera.NAME]               # as in block.toml (f in px; pixel_um where the unit is mm or um)
images = "X*"               # which images it took, where there are several cameras

The first angle turns first: R = Rx(omega) Ry(phi) Rz(kappa), or Ry(phi) Rx(omega) Rz(kappa), from
the image (x right, y up, z back) to the ground; matrices are written row by row. Measurements are
as measured, with distortion. Control comes with --ground: measurements of its points become marks.

Source: angles and frames, Kraus 2007; layout of the image coordinates as real
Pix4D exports for BINGO have it. What a file means is proved by reprojection.
"""

import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from corridor.core.camera import Camera
from corridor.core.errors import InputError, did_you_mean
from corridor.core.geometry import GROSS
from corridor.core.gnss import in_metres
from corridor.core.output import counted
from corridor.core.textfile import Line, read_toml
from corridor.tools.formats.cameras import FLIP, in_the_middle
from corridor.tools.formats.names import Names
from corridor.tools.formats.project import Contents, Project, Views
from corridor.tools.formats.rows import rows_of
from corridor.tools.formats.textfile import filled, says_number

NAME = "bingo"
TITLE = "PATB or BINGO text with convention.toml"

CONVENTION = "convention.toml"
END = "-99"
_MISS_PX = 2.0  # above it an import is refused
_FOCAL = 1.2  # a focal length of a calibration and a nominal one differ by less
# So many observations, and such a logarithm of two likelihoods' ratio, decide between two orders.
_LEAST, _SURE = 20, 10.0
_UNSEEN = (
    'the order of the angles cannot be checked: at such small angles the rays meet as well if "{}" '
    "was meant. If poses are given to an adjustment, it finds them either way"
)
_COMMA = re.compile(r"[+-]?\d+,\d+")
# Keys of the two tables with their values; None: any text.
_UNITS = {"mm": 1000.0, "um": 1.0, "px": None}
_TURNS = {"deg": 1.0, "gon": 0.9, "rad": 180.0 / np.pi}
# What people call them; "grad" is nearly "rad", and means gon.
_CALLED = {
    "grad": "gon", "grads": "gon", "grade": "gon", "grades": "gon", "gons": "gon", "degree": "deg",
    "degrees": "deg", "radian": "rad", "radians": "rad", "µm": "um", "μm": "um", "micron": "um",
    "microns": "um", "pixel": "px", "pixels": "px", "millimetres": "mm", "millimeters": "mm",
}  # fmt: skip
_ANGLES = {"omega phi kappa": "XYZ", "phi omega kappa": "YXZ"}
_KEYS = {
    "measurements": {
        "file": None,
        "unit": tuple(_UNITS),
        "origin": ("principal point", "centre", "corner", "pixel"),
        "y": ("up", "down"),
    },
    "poses": {
        "file": None,
        "angles": (*_ANGLES, "matrix to ground", "matrix to image"),
        "unit": tuple(_TURNS),
    },
}


def recognise(path: Path) -> bool:
    """A folder with convention.toml, or that file."""
    return path.name == CONVENTION if path.is_file() else (path / CONVENTION).is_file()


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and line."""
    folder = path if path.is_dir() else path.parent
    table = _convention(folder / CONVENTION)
    project, posed = _read(folder, table), table["poses"]
    if posed["angles"] not in _ANGLES:
        return project
    if _miss(project) < _MISS_PX:
        return _with_order_told(project, folder, table)
    for angles, unit in product(_ANGLES, _TURNS):
        other = {**table, "poses": {**posed, "angles": angles, "unit": unit}}
        if (left := _miss(_read(folder, other))) < _MISS_PX:
            told = f'{CONVENTION}: [poses] angles = "{angles}" and unit = "{unit}" would explain it'
            return project.warned(f"{told}: {left:.2f} px (median)")
    return project


def _with_order_told(project: Project, folder: Path, table: dict) -> Project:
    """The project with a sentence on whether its rays show which angle turns first.

    At small angles both orders nearly agree, and either fits. Of two sums of squares, each with
    its own variance, the logarithm of the likelihoods' ratio is n/2 times that of theirs; gross
    residuals, beyond the same multiple of the median in both, do not count.
    """
    stated = table["poses"]["angles"]
    (other,) = _ANGLES.keys() - {stated}
    again = _read(folder, {**table, "poses": {**table["poses"], "angles": other}})
    lengths = [_lengths(one) for one in (project, again)]
    if len(lengths[0]) != len(lengths[1]) or len(lengths[0]) < _LEAST:
        return project if len(lengths[0]) >= _LEAST else project.noted(_UNSEEN.format(other))
    good = np.all([one < GROSS * np.median(one) for one in lengths], axis=0)
    size, turned = (float(np.sqrt(np.mean(one[good] ** 2))) for one in lengths)
    surer = good.sum() * float(np.log(turned / size)) if size and turned else 0.0
    if surer < -_SURE:
        return project.warned(
            f'{CONVENTION}: the rays meet better if [poses] angles = "{other}" ({turned:.2f} px '
            f"RMS in place of {size:.2f}): correct it, unless the poses are of another adjustment"
        )
    return project if surer > _SURE else project.noted(_UNSEEN.format(other))


def _lengths(project: Project) -> np.ndarray:
    """Residuals of the tie observations whose rays meet, px."""
    with np.errstate(all="ignore"):
        rows = rows_of(project.block, complete=False).usable()
        return np.linalg.norm(rows.residuals(), axis=1)


def _miss(project: Project) -> float:
    """By how much image points miss, px, median; infinite where most rays do not meet."""
    if not len(project.block.tie_points):
        return 0.0
    length = _lengths(project)
    few = 2 * len(length) < len(project.block.tie_points)
    return np.inf if few else float(np.median(np.nan_to_num(length, nan=np.inf)))


def _read(folder: Path, table: dict) -> Project:
    """The project by a convention."""
    measured, posed = table["measurements"], table["poses"]
    poses = _poses(folder / posed["file"], posed)
    names = list(poses)
    cameras = {name: Camera.from_table(name, one) for name, one in table["camera"].items()}
    used = [_camera_of(name, table["images"]) for name in names]
    notes: list[str] = []
    crs = posed.get("crs")
    if crs is not None:
        in_metres(crs)
    return Contents(
        name=folder.resolve().name,
        cameras=cameras,
        images=names,
        used=used,
        centre=np.array([centre for centre, _ in poses.values()]),
        rotation=np.array([rotation for _, rotation in poses.values()]),
        ties=_views(folder / measured["file"], measured, names, used, cameras, notes),
        crs=crs,
        notes=notes,
    ).project(NAME, folder)


def _convention(path: Path) -> dict:
    """The tables of the file, checked; `images`: the patterns of the cameras, taken out of them."""
    table = read_toml(path)
    for name, keys in _KEYS.items():
        part = table.get(name)
        if not isinstance(part, dict):
            raise InputError(f"{path.name} has no table [{name}]; add {', '.join(keys)} there")
        if str(part.get("angles")).startswith("matrix"):
            part.setdefault("unit", "deg")
        for key, allowed in keys.items():
            value = part.get(key)
            if allowed and isinstance(value, str):
                value = re.sub(r"[\s,_-]+", " ", value.strip().lower())
                value = _CALLED.get(value, value) if key == "unit" else value
                part[key] = value
            if not isinstance(value, str) or (allowed and value not in allowed):
                which = " or ".join(f'"{one}"' for one in allowed) if allowed else "a file's name"
                near = did_you_mean(str(value), allowed) if allowed and value else ""
                raise InputError(
                    f"{path.name}: [{name}] {key} is {value!r}; write {which}{near}"
                    if value is not None
                    else f"{path.name}: [{name}] has no {key}; write {which}"
                )
    cameras = table.get("camera")
    if not isinstance(cameras, dict) or not all(isinstance(one, dict) for one in cameras.values()):
        raise InputError(f"{path.name} has no table [camera.NAME]; add one with width, height, f")
    table["images"] = {name: str(one.pop("images", "*")) for name, one in cameras.items()}
    if _UNITS[table["measurements"]["unit"]]:
        for name, one in cameras.items():
            if "pixel_um" not in one:
                raise InputError(
                    f"{path.name}: [camera.{name}] has no pixel_um, which measurements in "
                    f"{table['measurements']['unit']} need; add the size of a pixel"
                )
    return table


def _camera_of(image: str, patterns: dict[str, str]) -> str:
    found = [name for name, pattern in patterns.items() if fnmatchcase(image, pattern)]
    if len(found) != 1:
        which = f"are {' and '.join(found)}" if found else "is not named"
        raise InputError(
            f"{CONVENTION}: the camera of image {image} {which}; give each [camera.NAME] its "
            'images = "PATTERN"'
        )
    return found[0]


def _poses(path: Path, posed: dict) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Image -> centre (3,) and rotation (3, 3), world to camera."""
    order = _ANGLES.get(posed["angles"])
    count = 6 if order else 12
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for line in filled(path, "#"):
        words = _words(line)
        if not found and len(words) > 1 and not says_number(words[1]):
            continue  # a header
        if len(words) < count + 1:
            raise line.wrong(f"{len(words)} words where an image and {count} numbers belong")
        values = line.numbers(words[1 : count + 1], "the pose")
        if words[0] in found:
            raise line.wrong(f"image {words[0]!r} stands there twice")
        if order:
            angles = values[3:] * _TURNS[posed["unit"]]
            turned = Rotation.from_euler(order, angles, degrees=True).as_matrix()
        else:
            turned = values[3:].reshape(3, 3)
            turned = turned if posed["angles"].endswith("ground") else turned.T
        found[words[0]] = values[:3], FLIP @ turned.T
    if not found:
        raise InputError(f"{path.name} holds no pose; write image, x, y, z and angles a line")
    return found


def _words(line: Line) -> list[str]:
    """What stands in a line, between blanks or commas. Raises InputError for decimal commas."""
    words = line.text.replace('"', " ").replace(";", " ").split()
    comma = next((word for word in words[1:] if _COMMA.fullmatch(word)), None)
    if comma is not None and not any("." in word for word in words[1:]):
        raise line.wrong(f"{comma} has a decimal comma; write numbers with a decimal point")
    return " ".join(words).replace(",", " ").split()


def _views(path, measured, names, used, cameras, notes) -> Views | None:
    known, rows, lost = Names(names), [], 0
    up = -1.0 if measured["y"] == "up" else 1.0
    for head, points in image_blocks(path):
        image = _image_of(head, known)
        lost += image is None
        if image is None:
            continue
        camera = cameras[used[image]]
        unit = _UNITS[measured["unit"]]
        scale = 1.0 if unit is None else unit / camera.pixel_um
        if unit is not None:
            _compare_focal(head, used[image], camera)
        origin = {
            "principal point": camera.interior[1:3],
            "centre": in_the_middle(camera.width, camera.height),
            "corner": (-0.5, -0.5 if up > 0 else camera.height - 0.5),
            "pixel": (0.0, 0.0 if up > 0 else camera.height - 1.0),
        }[measured["origin"]]
        for line in points:
            name, x, y, *_ = _words(line) + [""] * 2
            x, y = line.numbers([x, y], "a measurement") * scale
            rows.append((name, image, origin[0] + x, origin[1] + up * y))
    if lost:
        notes.append(f"{path.name}: {counted(lost, 'image')} left out, without a pose")
    notes += known.told(path.name)
    return Views.of(rows, "tie points")


def _compare_focal(head: Line, name: str, camera: Camera) -> None:
    """Raises InputError where a focal length behind the name of an image, in mm, is far from that
    of the convention: then pixel_um or f is wrong."""
    word = head.text.split()[-1]
    stated, known = float(word) if says_number(word) else 0.0, camera["f"] * camera.pixel_um / 1000
    if 1.0 < stated < 1000.0 and not 1 / _FOCAL < known / stated < _FOCAL:
        raise head.wrong(
            f"the image has a focal length of {stated:g} mm, [camera.{name}] of {CONVENTION} "
            f"{known:.4g} mm (f = {camera['f']:g} px of {camera.pixel_um:g} um): correct pixel_um "
            "or f"
        )


def _image_of(head: Line, known: Names) -> int | None:
    """The row of the image that a line begins; its camera or focal length may follow the name."""
    words = head.text.split()
    rows = (known.row(" ".join(words[:count])) for count in range(len(words), 0, -1))
    return next((row for row in rows if row is not None), None)


def image_blocks(path: Path) -> Iterator[tuple[Line, list[Line]]]:
    """The line that names an image, and those of its points, up to the next -99.

    Raises InputError where the file ends without one.
    """
    if not path.stat().st_size:
        raise InputError(f"{path.name} is empty; export it again")
    head, points = None, []
    for line in filled(path):
        if line.text.split() == [END]:
            if head is not None:
                yield head, points
            head, points = None, []
        elif head is None:
            head = line
        else:
            points.append(line)
    if head is not None:
        raise InputError(f"{path.name} ends without {END} after the last image; it is cut off")
