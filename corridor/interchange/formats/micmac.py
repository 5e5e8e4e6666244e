"""MicMac: orientations and calibrations (MicMac 1 and MMVII), ground points, marks, tie points.

Conventions, where they differ from ours: the rotation (CodageMatr; AxeI, AxeJ, AxeK) is camera to
world; distortion works on pixels about its own centre, k_i = c_i F^(2i), p1 = P1 F (our order),
b1, b2 as ours. eConvApero_DistM2C takes the ray to the image as we do, eConvApero_DistC2M the image
to the ray. Whole pixels are pixel centres: no half pixel is moved. `FileInterne` may name a folder
that is elsewhere: the file is looked for beside the orientation first.

Source: MicMac documentation (DocMicMac, appendix "Formats"), and the pairs under `Verif` that the
orientation files themselves carry.
"""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.camera import Camera
from corridor.errors import InputError
from corridor.interchange.cameras import from_image_formula, standing_for
from corridor.interchange.columns import grouped, in_rows, plain_numbers, text_of_rows
from corridor.interchange.project import (
    Project,
    camera_from,
    ground_table,
    images_table,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)
from corridor.interchange.rows import camera_positions, rows_of
from corridor.interchange.text import lines, missing, numbers, opening
from corridor.interchange.xml import child, read_xml, values

NAME = "micmac"
TITLE = "MicMac or MMVII orientations, calibrations, ground points, tie points"
WRITES = ("micmac",)
HOLDS = "f, cx, cy, k1..k8, p1, p2, b1, b2"

_M2C, _C2M = "eConvApero_DistM2C", "eConvApero_DistC2M"
_RADIAL = 8


def recognise(path: Path) -> bool:
    """A folder of Orientation-*.xml or Ori-*.xml files, one with such a folder, or such a file."""
    if path.is_file():
        return path.suffix.lower() == ".xml" and _is_orientation(path)
    return bool(_orientations(path)) or bool(_ori_folders(path))


def _is_orientation(path):
    head = opening(path, 3000)
    return "<OrientationConique>" in head or "<CameraPose>" in head


def _orientations(folder):
    return sorted(folder.glob("Orientation-*.xml")) or [
        file for file in sorted(folder.glob("Ori-*.xml")) if file.is_file()
    ]


def _ori_folders(folder):
    found = [inner for inner in sorted(folder.glob("Ori-*")) if inner.is_dir()]
    if (folder / "Ori").is_dir():
        found += [inner for inner in sorted((folder / "Ori").iterdir()) if inner.is_dir()]
    if (folder / "MMVII-PhgrProj" / "Ori").is_dir() and not found:
        home = folder / "MMVII-PhgrProj" / "Ori"
        found += [inner for inner in sorted(home.iterdir()) if inner.is_dir()]
    return [inner for inner in found if _orientations(inner)]


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and element."""
    notes: list[str] = []
    warnings: list[str] = []
    if path.is_file():
        files, folder = [path], path.parent
    else:
        folder, files = path, _orientations(path)
        if not files:
            several = _ori_folders(path)
            if not several:
                raise InputError(f"{path} has no folder Ori-... with orientations; name it")
            if len(several) > 1:
                inside = ", ".join(inner.name for inner in several)
                raise InputError(f"{path} holds several orientations ({inside}); name one of them")
            folder = several[0]
            files = _orientations(folder)
    home = _home(folder, path)
    shots = [_shot(file, folder, home) for file in files]
    cameras, strange = {}, {}
    for shot in shots:
        file = shot["calibration"]
        if file.stem not in cameras and file.stem not in strange:
            try:
                cameras[file.stem] = _calibration(file, notes)
            except _NoModel as error:
                strange[file.stem] = str(error)
    for name, why in strange.items():
        lost = [shot["name"] for shot in shots if shot["calibration"].stem == name]
        warnings.append(f"{why}; its images were left out: {', '.join(lost[:5])}")
    shots = [shot for shot in shots if shot["calibration"].stem in cameras]
    if not shots:
        raise InputError(f"{folder}: {next(iter(strange.values()))}; nothing is left to import")
    names = [shot["name"] for shot in shots]
    block = Block(
        name=home.resolve().name,
        cameras=cameras,
        images=images_table(
            names, [shot["calibration"].stem for shot in shots],
            np.array([shot["centre"] for shot in shots]),
            rotations_to_columns(np.array([shot["rotation"] for shot in shots])),
        ),
    )  # fmt: skip
    _ground_and_marks(home, block, notes, warnings)
    _ties(home, block, notes, warnings)
    pairs = pd.DataFrame(
        [(shot["name"], *row) for shot in shots for row in shot["pairs"]],
        columns=["image", "x", "y", "X", "Y", "Z"],
    )
    return Project(
        NAME, folder, block, pairs=pairs if len(pairs) else None, notes=notes, warnings=warnings
    )


def _home(folder, path):
    """The project's folder: where ground points, marks and tie points lie."""
    if folder != path and path.is_dir():
        return path
    if folder.parent.name == "Ori":
        return folder.parent.parent.parent
    return folder.parent if folder.name.startswith("Ori-") else folder


class _NoModel(Exception):
    """A camera for which corridor has no model."""


# --- orientations ----------------------------------------------------------------------------


def _text(element, tag, path):
    found = element.find(tag)
    text = (found.text or "").strip().strip('"') if found is not None else ""
    if not text:
        raise InputError(f"{path.name}: <{tag}> is missing or empty; export it again")
    return text


def _shot(path, folder, home):
    root = read_xml(path)
    pose = root.find(".//CameraPose")
    if pose is not None:
        return _mmvii_shot(pose, path, folder)
    element = root if root.tag == "OrientationConique" else root.find(".//OrientationConique")
    if element is None:
        raise InputError(f"{path.name} holds no OrientationConique; name MicMac orientations")
    if (element.findtext("TypeProj") or "eProjStenope").strip() != "eProjStenope":
        raise InputError(f"{path.name}: only the projection eProjStenope is known")
    affine = element.find("OrIntImaM2C")
    if affine is not None:
        found = [values(child(affine, tag, path), path, 2) for tag in ("I00", "V10", "V01")]
        if np.abs(np.array(found) - [[0, 0], [1, 0], [0, 1]]).max() > 1e-12:
            raise InputError(
                f"{path.name}: OrIntImaM2C turns or scales the picture (a scan); corridor needs "
                "images that are their own camera frame"
            )
    outer = child(element, "Externe", path)
    convention = (outer.findtext("KnownConv") or _M2C).strip()
    if convention not in (_M2C, _C2M):
        raise InputError(f"{path.name}: the convention {convention} is unknown to corridor")
    coded = child(outer, "ParamRotation", path).find("CodageMatr")
    if coded is None:
        raise InputError(f"{path.name}: the rotation is not written as CodageMatr; export it so")
    matrix = np.array([values(child(coded, tag, path), path, 3) for tag in ("L1", "L2", "L3")])
    pairs = [
        (*values(child(pair, "Im", path), path, 2), *values(child(pair, "Ter", path), path, 3))
        for pair in element.findall("Verif/Appuis")
    ]
    inner = element.find("Interne")
    if inner is not None and element.find("FileInterne") is None:
        raise InputError(f"{path.name}: the calibration inside the file is not read; export it")
    file = _calibration_file(_text(element, "FileInterne", path), folder, home, path)
    name = path.stem.removeprefix("Orientation-")
    return {
        "name": name, "calibration": file, "centre": values(child(outer, "Centre", path), path, 3),
        "rotation": _camera_to_world(matrix, path).T, "pairs": pairs,
    }  # fmt: skip


def _camera_to_world(matrix, path):
    try:
        rotations_to_columns(matrix)
    except InputError:
        raise InputError(
            f"{path.name}: the matrix is no rotation (its lines are not perpendicular unit "
            "vectors); export the orientation again"
        ) from None
    return matrix


def _mmvii_shot(pose, path, folder):
    axes = child(pose, "RotMatrix", path)
    matrix = np.column_stack(
        [values(child(axes, tag, path), path, 3) for tag in ("AxeI", "AxeJ", "AxeK")]
    )
    name = _text(pose, "NameInternalCalib", path)
    file = folder / f"{name}.xml"
    if not file.is_file():
        raise InputError(f"{path.name}: its calibration {file.name} is not beside it; put it there")
    return {
        "name": _text(pose, "NameImage", path), "calibration": file, "pairs": [],
        "centre": values(child(pose, "Center", path), path, 3),
        "rotation": _camera_to_world(matrix, path).T,
    }  # fmt: skip


def _calibration_file(written, folder, home, path):
    written = written.replace("\\", "/")
    name = written.rpartition("/")[2]
    for place in (folder / name, home / written, folder / written, folder.parent / written):
        if place.is_file():
            return place
    raise InputError(
        f"{path.name}: its calibration {written} is not there, neither beside it nor in the "
        "project; put it beside the orientations"
    )


# --- calibrations ----------------------------------------------------------------------------


def _calibration(path: Path, notes: list[str]) -> Camera:
    root = read_xml(path)
    inner = root.find(".//InternalCalibration")
    if inner is not None:
        return _mmvii_calibration(inner, path, notes)
    element = root if root.tag == "CalibrationInternConique" else None
    element = root.find(".//CalibrationInternConique") if element is None else element
    if element is None:
        raise InputError(f"{path.name} holds no CalibrationInternConique; name a calibration")
    convention = (element.findtext("KnownConv") or _M2C).strip()
    if convention not in (_M2C, _C2M):
        raise InputError(f"{path.name}: the direction {convention} is unknown to corridor")
    point = values(child(element, "PP", path), path, 2)
    focal = float(values(child(element, "F", path), path, 1)[0])
    width, height = values(child(element, "SzIm", path), path, 2)
    if not focal > 0:
        raise InputError(f"{path.name}: F = {focal:g} is no focal length; export it again")
    distortions = element.findall("CalibDistortion")
    if len(distortions) > 1:
        raise _NoModel(f"{path.name}: {len(distortions)} distortions follow each other")
    coefficients, extra, centre = _distortion(distortions, point, path)
    k = {f"k{n + 1}": c * focal ** (2 * n + 2) for n, c in enumerate(coefficients)}
    p1, p2, b1, b2 = extra
    camera = camera_from(
        path.stem, width, height, focal, *point, **k, p1=p1 * focal, p2=p2 * focal, b1=b1, b2=b2
    )

    def bent(pixels: np.ndarray) -> np.ndarray:
        """MicMac's polynomial, pixels to pixels, about its own centre."""
        x, y = (pixels - centre).T
        r2 = x * x + y * y
        radial = r2 * np.polynomial.polynomial.polyval(r2, coefficients or [0.0])
        return pixels + np.column_stack(
            [
                x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y + b1 * x + b2 * y,
                y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y,
            ]
        )

    if convention == _C2M and (coefficients or any(extra)):
        start = camera_from(path.stem, width, height, focal, *point)
        return from_image_formula(
            start, lambda pixels: (bent(pixels) - point) / focal, notes, f"camera {path.stem}"
        )
    if np.array_equal(centre, point):
        return camera
    return standing_for(camera, lambda rays: bent(point + focal * rays), notes)


def _distortion(distortions, point, path):
    """Radial coefficients, (P1, P2, b1, b2), and the centre they are about, pixels."""
    nothing = [], (0.0, 0.0, 0.0, 0.0), point
    model = next(iter(distortions[0]), None) if distortions else None
    if model is None or model.tag == "ModNoDist":
        return nothing
    if model.tag == "ModRad":
        radial, extra = model, (0.0,) * 4
    elif model.tag == "ModPhgrStd":
        radial = child(model, "RadialePart", path)
        extra = tuple(
            float(values(model.find(tag), path, 1)[0]) if model.find(tag) is not None else 0.0
            for tag in ("P1", "P2", "b1", "b2")
        )
    else:
        kind = model.findtext("TypeModele") or model.tag
        raise _NoModel(f"{path.name} is a {kind.strip()}, for which corridor has no model")
    coefficients = [float(values(part, path, 1)[0]) for part in radial.findall("CoeffDist")]
    while coefficients and coefficients[-1] == 0.0:
        coefficients.pop()
    if len(coefficients) > _RADIAL:
        raise _NoModel(f"{path.name} has {len(coefficients)} radial coefficients, more than 8")
    return coefficients, extra, values(child(radial, "CDist", path), path, 2)


def _mmvii_calibration(element, path, notes):
    if _text(element, "Projection", path) != "Stenope":
        raise _NoModel(f"{path.name} is a {_text(element, 'Projection', path)} projection")
    width, height = values(child(child(element, "PixelFrame", path), "NbPix", path), path, 2)
    perfect = child(element, "PerfectProj", path)
    focal = float(values(child(perfect, "F", path), path, 1)[0])
    point = values(child(perfect, "PP", path), path, 2)
    known = {
        part.tag: float(values(part, path, 1)[0]) for part in element.findall("Distorsion/*/*")
    }
    strange = [tag for tag in known if tag not in _MMVII and known[tag] != 0.0]
    if strange:
        raise _NoModel(f"{path.name} has the distortion {strange[0]}, which corridor does not")
    names = {_MMVII[tag]: value for tag, value in known.items() if tag in _MMVII}
    return camera_from(path.stem, width, height, focal, *point, **names)


# (3X2+Y2, 2XY) and (2XY, X2+3Y2): our p1 and p2; (X, 0) and (Y, 0): our b1 and b2.
_MMVII = {f"K{n}": f"k{n}" for n in range(1, 9)} | {name: name for name in ("p1", "p2", "b1", "b2")}


# --- ground points, marks --------------------------------------------------------------------


def ground_of(path: Path) -> pd.DataFrame | None:
    """ground.csv of a DicoAppuisFlottant or an MMVII set of ground points; None for other XML."""
    root = read_xml(path)
    names, places, sigmas = [], [], []
    if root.tag == "DicoAppuisFlottant" or root.find("DicoAppuisFlottant") is not None:
        for part in root.iter("OneAppuisDAF"):
            names.append(_text(part, "NamePt", path))
            places.append(values(child(part, "Pt", path), path, 3))
            found = part.find("Incertitude")
            sigmas.append(values(found, path, 3) if found is not None else np.ones(3))
    elif root.find(".//SetGCP") is not None:
        for part in root.findall(".//SetGCP/Measures/el"):
            names.append(_text(part, "Name", path))
            places.append(values(child(part, "Pt", path), path, 3))
            sigmas.append(np.ones(3))
    else:
        return None
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path.name}: ground point {twice!r} stands there twice; delete one")
    sigmas = np.array(sigmas).reshape(-1, 3)
    # 1 1 1 is what MicMac writes when nobody said anything; negative ones switch a point off.
    told = (np.abs(sigmas) != 1.0).any(axis=1) & (sigmas > 0).all(axis=1)
    roles = np.where((sigmas < 0).any(axis=1), "check", "control")
    return ground_table(
        names, np.array(places).reshape(-1, 3), np.where(told[:, None], sigmas, np.nan), roles
    )


def marks_of(path: Path) -> list[tuple[str, str, float, float]] | None:
    """point, image, x, y of a SetOfMesureAppuisFlottants or MMVII marks; None for other XML."""
    root = read_xml(path)
    found = []
    if root.tag == "SetOfMesureAppuisFlottants" or root.find("SetOfMesureAppuisFlottants"):
        for picture in root.iter("MesureAppuiFlottant1Im"):
            image = _text(picture, "NameIm", path)
            for part in picture.findall("OneMesureAF1I"):
                x, y = values(child(part, "PtIm", path), path, 2)
                found.append((_text(part, "NamePt", path), image, x, y))
        return found
    if root.find(".//SetMesIm") is not None:
        for picture in root.iter("SetMesIm"):
            image = _text(picture, "NameIm", path)
            for part in picture.findall("Measures/el"):
                x, y = values(child(part, "Pt", path), path, 2)
                found.append((_text(part, "Name", path), image, x, y))
        return found
    return None


def _measure_files(home):
    yield from sorted(home.glob("*.xml"))
    if (home / "PointsMeasure").is_dir():
        inner = [place for place in sorted((home / "PointsMeasure").iterdir()) if place.is_dir()]
        if inner:
            yield from sorted(inner[0].glob("*.xml"))


def _ground_and_marks(home, block, notes, warnings):
    mmvii = home / "MMVII-PhgrProj"
    home = mmvii if mmvii.is_dir() and not list(home.glob("Ori-*")) else home
    marks = []
    for file in _measure_files(home):
        head = opening(file, 3000)
        if "DicoAppuisFlottant" in head or "<SetGCP>" in head:
            ground = ground_of(file)
            if ground is not None and len(block.ground):
                warnings.append(f"{file.name}: a second set of ground points was left out")
            elif ground is not None:
                block.ground = ground
        elif "SetOfMesureAppuisFlottants" in head or "<SetMesIm>" in head:
            marks += marks_of(file) or []
    images = list(block.images["image"])
    lost = sorted({image for _, image, _, _ in marks if image not in set(images)})
    if lost:
        notes.append(f"marks in {len(lost)} images without orientation were left out ({lost[0]})")
    marks = [mark for mark in marks if mark[1] in set(images)]
    if marks:
        codes, points = pd.factorize(np.array([mark[0] for mark in marks], dtype=object))
        at = pd.Index(images).get_indexer([mark[1] for mark in marks])
        pixels = np.array([mark[2:] for mark in marks])
        table = observations_table(codes, pd.Index(points, dtype="str"), at, images, pixels)
        block.marks = same_point_once(table, "marks", warnings)
        known = set(block.ground["point"])
        bare = [name for name in points if name not in known]
        if bare and known:
            notes.append(f"{len(bare)} marked points have no coordinates (first: {bare[0]})")
    block.__post_init__()


# --- tie points ------------------------------------------------------------------------------


def _ties(home, block, notes, warnings):
    """Homol*/Pastis<image>/<image>.txt: x1 y1 x2 y2 of each pair of images."""
    folders = [place for place in sorted(home.glob("Homol*")) if place.is_dir()]
    folders = [place for place in folders if any(place.glob("Pastis*"))]
    if not folders:
        return
    if len(folders) > 1:
        inside = ", ".join(place.name for place in folders)
        notes.append(f"several sets of tie points ({inside}): {folders[0].name} was read")
    images = list(block.images["image"])
    at = {name: k for k, name in enumerate(images)}
    parts, binary = [], 0
    for place in sorted(folders[0].glob("Pastis*")):
        first = at.get(place.name.removeprefix("Pastis"))
        if first is None:
            continue
        files = {}
        for file in sorted(place.iterdir()):
            second = at.get(file.name.rpartition(".")[0])
            if second is None or second == first:
                continue
            if file.suffix != ".txt":
                binary += 1
                continue
            files[file] = second
        for second, rows in zip(files.values(), _pair_texts(list(files)), strict=True):
            if len(rows):
                parts.append((first, second, rows))
    if binary:
        warnings.append(
            f"{binary} files of tie points in {folders[0].name} are binary: left out; write them "
            "as text (ExpTxt=1)"
        )
    if not parts:
        return
    image, pixels, left, right = _nodes(parts)
    del parts
    point, conflicts = _joined(image, left, right)
    if conflicts:
        warnings.append(
            f"{conflicts} tie points were chained to two places of one image: they were left out"
        )
    kept = point >= 0
    codes, found = pd.factorize(point[kept])
    names = pd.Index(np.arange(len(found))).astype("str")
    taken = set(block.ground["point"]) | set(block.marks["point"].cat.categories)
    if names.isin(taken).any():
        names = ("t" + names).astype("str")
    table = observations_table(codes, names, image[kept], images, pixels[kept])
    block.tie_points = same_point_once(table, "tie points", warnings)
    block.__post_init__()
    rows = rows_of(block, complete=False)
    good = np.isfinite(rows.positions).all(axis=1)
    good[rows.ties :] = False
    block.points = points_table(rows.point_names[good], rows.positions[good])
    block.__post_init__()
    notes.append("MicMac writes tie points by pairs, without coordinates: joined and intersected")


# Words of a line of tie points: x1 y1 x2 y2, and perhaps a weight.
_PAIR = (4, 5)


def _pair_texts(files):
    """(n, 4) pixels of each file: all files of a folder at once, or line by line to name one."""
    texts = [_with_end(file) for file in files]
    plain = plain_numbers(io.BytesIO(b"".join(texts)))
    count = [text.count(b"\n") for text in texts]
    if plain is None or len(plain.counts) != sum(count) or not np.isin(plain.counts, _PAIR).all():
        return [_pair_text(file) for file in files]
    pixels = plain.values[plain.starts[:, None] + np.arange(4)]
    return np.split(pixels, np.cumsum(count)[:-1]) if files else []


def _with_end(path):
    try:
        text = path.read_bytes()
    except OSError as error:
        raise missing(path, error) from error
    return text if text.endswith(b"\n") else text + b"\n"


def _pair_text(path):
    rows = []
    for line, text in lines(path):
        words = text.split()
        if not words:
            continue
        if len(words) not in _PAIR:
            raise InputError(
                f"{path.parent.name}/{path.name}, line {line}: {len(words)} numbers where a pair "
                "of points has 4 (or 5 with a weight); the file is cut off"
            )
        rows.append(numbers(words, path, line, "a pair of points")[:4])
    return np.array(rows).reshape(-1, 4)


def _nodes(parts):
    """Different (image, x, y) of all pairs: image, pixels, and both ends of each pair."""
    # An image at a time: the ends of all pairs in one table would fill the memory.
    ends_in: dict[int, list] = {}
    first = 0
    for i, j, rows in parts:
        pairs = slice(first, first + len(rows))
        ends_in.setdefault(i, []).append((0, pairs, rows[:, :2]))
        ends_in.setdefault(j, []).append((1, pairs, rows[:, 2:]))
        first += len(rows)
    ends = np.empty((2, first), np.int32)
    image, pixels, count = [], [], 0
    for k, mine in ends_in.items():
        places = np.concatenate([xy for _, _, xy in mine])
        which, different = pd.factorize(places.view(complex).ravel())
        row = 0
        for side, pairs, xy in mine:
            ends[side, pairs] = count + which[row : row + len(xy)]
            row += len(xy)
        count += len(different)
        image.append(np.full(len(different), k))
        pixels.append(different.view(float).reshape(-1, 2))
    return np.concatenate(image), np.concatenate(pixels), *ends


def _joined(image, left, right):
    """The point of each node: nodes that pairs connect. -1 where two lie in one image."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(image)
    graph = coo_matrix((np.ones(len(left), bool), (left, right)), shape=(count, count))
    total, point = connected_components(graph, directed=False)
    key = point.astype(np.int64) * (image.max() + 1) + image
    order = np.sort(key)
    twice = np.unique(order[1:][order[1:] == order[:-1]] // (image.max() + 1))
    point = np.where(np.isin(point, twice), -1, point)
    return point, len(twice)


# --- out -------------------------------------------------------------------------------------


def unheld(camera: Camera) -> list[str]:
    """MicMac's Fraser calibration holds every interior parameter."""
    return []


def nearest(camera: Camera) -> Camera:
    """The camera itself."""
    return camera


def losses(block: Block) -> list[str]:
    """What MicMac's files cannot hold, and where it went instead."""
    lost = []
    if len(block.gnss):
        lost.append("lever arms: Centres-GNSS.xml holds the camera centres that GNSS gives")
    if len(block.tie_points):
        lost.append("names of tie points")
    if block.offset.any():
        lost.append("the offset of the block: coordinates are those of the block")
    return lost


def write(block: Block, folder: Path, name: str) -> None:
    """Write Ori-Corridor/, Homol/ (text), and XML of ground points and marks."""
    rows = rows_of(block)
    ori = folder / "Ori-Corridor"
    ori.mkdir()
    files = {name: f"AutoCal_{_plain(name)}" for name in block.cameras}
    for name, camera in block.cameras.items():
        _xml(_calibration_xml(camera), ori / f"{files[name]}.xml")
    for k, (image, camera) in enumerate(zip(rows.image_names, block.images["camera"], strict=True)):
        if "/" in image:
            raise InputError(
                f"image {image!r} lies in a folder, which MicMac does not allow; rename the images"
            )
        path = ori / f"Orientation-{image}.xml"
        _xml(_orientation_xml(rows, k, f"Ori-Corridor/{files[camera]}.xml"), path)
    if len(block.ground):
        _xml(_ground_xml(block), folder / "GroundPoints.xml")
    if len(block.marks):
        _xml(_marks_xml(block), folder / "GroundMarks.xml")
    positions = camera_positions(block)
    if len(positions):
        root = ElementTree.Element("DicoAppuisFlottant")
        for row in positions.itertuples(index=False):
            part = _leaf(root, "OneAppuisDAF")
            _leaf(part, "Pt", row.x, row.y, row.z)
            _leaf(part, "NamePt", row.image)
            _leaf(part, "Incertitude", row.sx, row.sy, row.sz)
        (folder / "GNSS").mkdir()
        _xml(root, folder / "GNSS" / "Centres-GNSS.xml")
    if len(block.tie_points):
        _write_ties(rows, len(block.tie_points), folder / "Homol")


def _plain(name):
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)


def _xml(root, path):
    ElementTree.indent(root, "     ")
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _leaf(parent, tag, *found):
    element = ElementTree.SubElement(parent, tag)
    if found:
        element.text = " ".join(v if isinstance(v, str) else repr(float(v)) for v in found)
    return element


def _calibration_xml(camera):
    root = ElementTree.Element("ExportAPERO")
    inner = _leaf(root, "CalibrationInternConique")
    _leaf(inner, "KnownConv", _M2C)
    point, f = (camera["cx"], camera["cy"]), camera["f"]
    _leaf(inner, "PP", *point)
    _leaf(inner, "F", f)
    _leaf(inner, "SzIm", str(camera.width), str(camera.height))
    model = _leaf(_leaf(inner, "CalibDistortion"), "ModPhgrStd")
    radial = _leaf(model, "RadialePart")
    _leaf(radial, "CDist", *point)
    k = [camera[f"k{n}"] for n in range(1, _RADIAL + 1)]
    while len(k) > 3 and k[-1] == 0.0:
        k.pop()
    for n, value in enumerate(k, start=1):
        _leaf(radial, "CoeffDist", value / f ** (2 * n))
    _leaf(radial, "PPaEqPPs", "true")
    for key in ("p1", "p2"):
        _leaf(model, key.upper(), camera[key] / f)
    for key in ("b1", "b2"):
        _leaf(model, key, camera[key])
    return root


def _orientation_xml(rows, k, calibration):
    root = ElementTree.Element("ExportAPERO")
    element = _leaf(root, "OrientationConique")
    affine = _leaf(element, "OrIntImaM2C")
    for tag, pair in (("I00", "0 0"), ("V10", "1 0"), ("V01", "0 1")):
        _leaf(affine, tag, pair)
    _leaf(element, "TypeProj", "eProjStenope")
    _leaf(element, "ZoneUtileInPixel", "true")
    _leaf(element, "FileInterne", calibration)
    _leaf(element, "RelativeNameFI", "true")
    outer = _leaf(element, "Externe")
    _leaf(outer, "KnownConv", _M2C)
    _leaf(outer, "Centre", *rows.centre[k])
    coded = _leaf(_leaf(outer, "ParamRotation"), "CodageMatr")
    for tag, line in zip(("L1", "L2", "L3"), rows.rotation[k].T, strict=True):
        _leaf(coded, tag, *line)
    _leaf(_leaf(element, "ConvOri"), "KnownConv", _M2C)
    return root


def _ground_xml(block):
    root = ElementTree.Element("DicoAppuisFlottant")
    for row, sigma in zip(block.ground.itertuples(index=False), block.ground_sigma(), strict=True):
        part = _leaf(root, "OneAppuisDAF")
        _leaf(part, "Pt", row.x, row.y, row.z)
        _leaf(part, "NamePt", row.point)
        # A negative uncertainty is MicMac's way of saying "not for the adjustment".
        _leaf(part, "Incertitude", *(sigma if row.role == "control" else -sigma))
    return root


def _marks_xml(block):
    root = ElementTree.Element("SetOfMesureAppuisFlottants")
    for image, table in block.marks.groupby("image", observed=True, sort=False):
        picture = _leaf(root, "MesureAppuiFlottant1Im")
        _leaf(picture, "NameIm", str(image))
        for row in table.itertuples(index=False):
            part = _leaf(picture, "OneMesureAF1I")
            _leaf(part, "NamePt", str(row.point))
            _leaf(part, "PtIm", row.x, row.y)
    return root


def _write_ties(rows, count, folder):
    """Every pair of images with common points, both ways, as MicMac's own text export has it."""
    image, point = rows.image[:count], rows.point[:count]
    words = in_rows(*rows.pixels[:count].T)
    by_point, points = grouped(point, rows.ties)
    views = np.diff(points)
    by_image, images = grouped(image, len(rows.image_names))
    for i, name in enumerate(rows.image_names):
        mine = by_image[images[i] : images[i + 1]]
        mine = mine[np.argsort(point[mine], kind="stable")]
        # Each of its observations beside all the views of the same point.
        many = views[point[mine]]
        before = np.repeat(points[point[mine]] - np.cumsum(many) + many, many)
        left, right = np.repeat(mine, many), by_point[before + np.arange(len(before))]
        order = np.argsort(image[right], kind="stable")
        left, right = (side[order][image[right][order] != i] for side in (left, right))
        if not len(left):
            continue
        text, starts = text_of_rows(words.take(left), " ", words.take(right), "\n")
        others, first = np.unique(image[right], return_index=True)
        place = folder / f"Pastis{name}"
        place.mkdir(parents=True)
        for j, start, end in zip(others, starts[first], starts[[*first[1:], -1]], strict=True):
            (place / f"{rows.image_names[j]}.txt").write_bytes(text[int(start) : int(end)])
