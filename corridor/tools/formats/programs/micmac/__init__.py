"""MicMac: orientations and calibrations (MicMac 1 and MMVII), ground points, marks, tie points.

Conventions, where they differ from ours: the rotation (CodageMatr; AxeI, AxeJ, AxeK) is camera to
world; distortion works on pixels about its own centre, k_i = c_i F^(2i), p1 = P1 F (our order),
b1, b2 as ours. eConvApero_DistM2C takes the ray to the image as we do, eConvApero_DistC2M the image
to the ray. Whole pixels are pixel centres: no half pixel is moved. `FileInterne` may name a folder
that is elsewhere: the file is looked for beside the orientation first. Of a rigid block of MMVII a
pattern of image names says by two of its groups which camera took an image, and when.

Source: MicMac documentation (DocMicMac, appendix "Formats"), and the pairs under `Verif` that the
orientation files themselves carry; of rigid blocks MMVII's source, MMVII_BlocRig.h.
"""

import io
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.camera import INTERIOR, Camera
from corridor.core.errors import InputError
from corridor.core.textfile import Xml, read_bytes
from corridor.tools.formats.cameras import (
    Held,
    NoModel,
    camera_from,
    from_image_formula,
    standing_for,
    turned_note,
    where_known,
)
from corridor.tools.formats.columns import NumberLines, plain_numbers
from corridor.tools.formats.names import Names
from corridor.tools.formats.programs.micmac.writing import M2C, RADIAL
from corridor.tools.formats.programs.micmac.writing import write as write
from corridor.tools.formats.project import (
    Contents,
    Project,
    Views,
    ground_table,
    hung_together,
    rotations_to_columns,
)
from corridor.tools.formats.textfile import Following, opening

NAME = "micmac"
TITLE = "MicMac or MMVII orientations, calibrations, ground points, tie points"
WRITES = ("micmac",)
HOLDS = Held(INTERIOR)
LOSSES = {
    "GNSS": "lever arms: Centres-GNSS.xml holds the camera centres that GNSS gives",
    "tie points": "names of tie points",
    "offset": "the offset of the block: coordinates are those of the block",
}

_C2M = "eConvApero_DistC2M"


def recognise(path: Path) -> bool:
    """A folder of Orientation-*.xml or Ori-*.xml files, one with such a folder, or such a file."""
    if not path.is_file():
        return bool(_orientations(path)) or bool(_ori_folders(path))
    head = opening(path, 3000) if path.suffix.lower() == ".xml" else ""
    return "<OrientationConique>" in head or "<CameraPose>" in head


def _orientations(folder):
    return sorted(folder.glob("Orientation-*.xml")) or [
        file for file in sorted(folder.glob("Ori-*.xml")) if file.is_file()
    ]


def _folders(home, pattern="*"):
    return [inner for inner in sorted(home.glob(pattern)) if inner.is_dir()]


def _ori_folders(folder):
    found = _folders(folder, "Ori-*") + _folders(folder / "Ori")
    found = found or _folders(folder / "MMVII-PhgrProj" / "Ori")
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
            if len(several) != 1:
                inside = ", ".join(inner.name for inner in several)
                raise InputError(
                    f"{path} holds several orientations ({inside}); name one of them"
                    if several
                    else f"{path} has no folder Ori-... with orientations; name it"
                )
            folder = several[0]
            files = _orientations(folder)
    home = _home(folder, path)
    shots = [_shot(file, folder, home) for file in files]
    images = [shot.name for shot in shots]
    files = {shot.calibration.stem: shot.calibration for shot in shots}
    cameras = where_known(files, lambda name: _calibration(files[name], notes))
    used = [shot.calibration.stem for shot in shots]
    ground, marks = _ground_and_marks(home, images, notes, warnings)
    leader = _leaders(home, images, notes)
    project = Contents(
        name=home.resolve().name,
        cameras=cameras,
        images=images,
        used=used,
        centre=np.array([shot.centre for shot in shots]),
        rotation=np.array([shot.rotation for shot in shots]),
        ties=_ties(home, images, notes, warnings),
        marks=marks,
        ground=ground,
        notes=notes,
        warnings=warnings,
    ).project(NAME, folder)
    project = hung_together(project, leader)
    kept = set(project.block.images["image"])
    pairs = [(shot.name, *row) for shot in shots for row in shot.pairs if shot.name in kept]
    if pairs:
        project.pairs = pd.DataFrame(pairs, columns=["image", "x", "y", "X", "Y", "Z"])
    return project


def _home(folder, path):
    """The project's folder: where ground points, marks and tie points lie."""
    if folder != path and path.is_dir():
        return path
    if folder.parent.name == "Ori":
        return folder.parent.parent.parent
    return folder.parent if folder.name.startswith("Ori-") else folder


# --- orientations ----------------------------------------------------------------------------


@dataclass
class _Shot:
    """One orientation: centre (3,), rotation (3, 3) world to camera, pairs of image and ground."""

    name: str
    calibration: Path
    centre: np.ndarray
    rotation: np.ndarray
    pairs: list[tuple] = field(default_factory=list)


def _shot(path, folder, home):
    root = Xml.read(path)
    pose = root.find(".//CameraPose")
    if pose is not None:
        return _mmvii_shot(pose, folder)
    element = _root_or_inner(root, "OrientationConique")
    if element is None:
        raise root.wrong("it holds no OrientationConique; name MicMac orientations")
    if element.text("TypeProj", "eProjStenope") != "eProjStenope":
        raise root.wrong("only the projection eProjStenope is known")
    affine = element.find("OrIntImaM2C")
    if affine is not None:
        found = [affine.values(tag, 2) for tag in ("I00", "V10", "V01")]
        if np.abs(np.array(found) - [[0, 0], [1, 0], [0, 1]]).max() > 1e-12:
            raise root.wrong(
                "OrIntImaM2C turns or scales the picture (a scan); corridor needs images that are "
                "their own camera frame"
            )
    outer = element.child("Externe")
    _direction(outer)
    coded = outer.child("ParamRotation").find("CodageMatr")
    if coded is None:
        raise root.wrong("the rotation is not written as CodageMatr; export it so")
    matrix = np.array([coded.values(tag, 3) for tag in ("L1", "L2", "L3")])
    if element.find("Interne") is not None and element.find("FileInterne") is None:
        raise root.wrong("the calibration inside the file is not read; export it")
    return _Shot(
        path.stem.removeprefix("Orientation-"),
        _calibration_file(element.text("FileInterne"), folder, home, root),
        outer.values("Centre", 3),
        _camera_to_world(matrix, root).T,
        [(*pair.values("Im", 2), *pair.values("Ter", 3)) for pair in element.all("Verif/Appuis")],
    )


def _root_or_inner(root, tag):
    return root if root.tag == tag else root.find(f".//{tag}")


def _direction(element):
    """Whether the distortion takes the image to the ray. Raises InputError where neither."""
    convention = element.text("KnownConv", M2C)
    if convention not in (M2C, _C2M):
        raise element.wrong(f"the convention {convention} is unknown to corridor")
    return convention == _C2M


def _camera_to_world(matrix, root):
    try:
        rotations_to_columns(matrix)
    except ValueError:
        raise root.wrong(
            "the matrix is not a rotation (its lines are not perpendicular unit vectors); export "
            "the orientation again"
        ) from None
    return matrix


def _mmvii_shot(pose, folder):
    axes = pose.child("RotMatrix")
    matrix = np.column_stack([axes.values(tag, 3) for tag in ("AxeI", "AxeJ", "AxeK")])
    file = folder / f"{pose.text('NameInternalCalib')}.xml"
    if not file.is_file():
        raise pose.wrong(f"its calibration {file.name} is not beside it; put it there")
    return _Shot(
        pose.text("NameImage"), file, pose.values("Center", 3), _camera_to_world(matrix, pose).T
    )


def _calibration_file(written, folder, home, root):
    written = written.replace("\\", "/")
    name = written.rpartition("/")[2]
    for place in (folder / name, home / written, folder / written, folder.parent / written):
        if place.is_file():
            return place
    raise root.wrong(
        f"its calibration {written} is not there, neither beside it nor in the project; put it "
        "beside the orientations"
    )


# --- rigs ------------------------------------------------------------------------------------


def _leaders(home, images, notes):
    """Image -> that of the master camera of its exposure, or where it did not fire another one.

    The mountings that the file states too are means over these poses.
    """
    files = sorted((home / "MMVII-PhgrProj").glob("*/*/RigidBloc_*.xml"))
    if not files:
        return {}
    if len(files) > 1:
        notes.append(f"{len(files)} files of rigid blocks: {files[0].name} was read")
    rig = Xml.read(files[0]).child(".//RigidBlocCam")
    camera, moment = (int(rig.value(tag)) for tag in ("KPatBloc", "KPatSync"))
    try:
        pattern = re.compile(rig.text("Pattern"))
    except re.error as error:
        raise rig.wrong(f"Pattern is no regular expression ({error}); correct it") from None
    if not 0 <= min(camera, moment) <= max(camera, moment) <= pattern.groups:
        raise rig.wrong(
            f"KPatBloc = {camera} and KPatSync = {moment}, but Pattern has {pattern.groups} groups "
            "in brackets; correct them"
        )
    found = {image: pattern.fullmatch(image) for image in images}
    if lost := [image for image, match in found.items() if match is None]:
        notes.append(f"{len(lost)} images are in no rigid block (first: {lost[0]})")
    taken: dict[str, list[tuple[bool, str]]] = {}
    for image, match in found.items():
        if match is not None:
            other = match[camera] != rig.text("Master")
            taken.setdefault(match[moment], []).append((other, image))
    return {image: min(together)[1] for together in taken.values() for _, image in together}


# --- calibrations ----------------------------------------------------------------------------


def _calibration(path: Path, notes: list[str]) -> Camera:
    root = Xml.read(path)
    inner = root.find(".//InternalCalibration")
    if inner is not None:
        return _mmvii_calibration(inner, path)
    element = _root_or_inner(root, "CalibrationInternConique")
    if element is None:
        raise root.wrong("it holds no CalibrationInternConique; name a calibration")
    backwards = _direction(element)
    point = element.values("PP", 2)
    focal = element.value("F")
    if not focal > 0:
        raise root.wrong(f"F = {focal:g} is not a focal length; export it again")
    bent = _Distortion.of(element.all("CalibDistortion"), point)
    start = camera_from(path.stem, *element.values("SzIm", 2), focal, *point)
    if backwards and (bent.radial or any(bent.extra)):
        camera, away = from_image_formula(start, lambda pixels: (bent(pixels) - point) / focal)
        notes.append(turned_note(camera, away))
        return camera
    p1, p2, b1, b2 = bent.extra
    k = {f"k{n + 1}": c * focal ** (2 * n + 2) for n, c in enumerate(bent.radial)}
    camera = start.with_values(**k, p1=p1 * focal, p2=p2 * focal, b1=b1, b2=b2)
    if np.array_equal(bent.centre, point):
        return camera
    return standing_for(camera, lambda rays: bent(point + focal * rays), notes)


@dataclass
class _Distortion:
    """MicMac's polynomial, pixels to pixels about its own centre; extra: P1, P2, b1, b2."""

    centre: np.ndarray
    radial: list[float] = field(default_factory=list)
    extra: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, distortions: list[Xml], point: np.ndarray) -> "_Distortion":
        """That of the elements of a calibration. Raises NoModel."""
        if len(distortions) > 1:
            name = distortions[0].path.name
            raise NoModel(f"{name}: {len(distortions)} distortions follow each other")
        model = next(iter(distortions[0]), None) if distortions else None
        if model is None or model.tag == "ModNoDist":
            return cls(point)
        name = model.path.name
        if model.tag not in ("ModRad", "ModPhgrStd"):
            kind = model.text("TypeModele", model.tag)
            raise NoModel(f"{name} is a {kind}, for which corridor has no model")
        extra, radial = (0.0,) * 4, model
        if model.tag == "ModPhgrStd":
            extra = tuple(model.value(tag, 0.0) for tag in ("P1", "P2", "b1", "b2"))
            radial = model.child("RadialePart")
        coefficients = [float(part.values(count=1)[0]) for part in radial.all("CoeffDist")]
        while coefficients and coefficients[-1] == 0.0:
            coefficients.pop()
        if len(coefficients) > RADIAL:
            raise NoModel(f"{name} has {len(coefficients)} radial coefficients, more than 8")
        return cls(radial.values("CDist", 2), coefficients, extra)

    def __call__(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of pixels (n, 2)."""
        p1, p2, b1, b2 = self.extra
        x, y = (pixels - self.centre).T
        r2 = x * x + y * y
        radial = r2 * np.polynomial.polynomial.polyval(r2, self.radial or [0.0])
        return pixels + np.column_stack(
            [
                x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y + b1 * x + b2 * y,
                y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y,
            ]
        )


# (3X2+Y2, 2XY) and (2XY, X2+3Y2): our p1 and p2; (X, 0) and (Y, 0): our b1 and b2.
_MMVII = {f"K{n}": f"k{n}" for n in range(1, 9)} | {name: name for name in ("p1", "p2", "b1", "b2")}


def _mmvii_calibration(element, path):
    projection = element.text("Projection")
    if projection != "Stenope":
        raise NoModel(f"{path.name} is a {projection} projection")
    perfect = element.child("PerfectProj")
    known = {part.tag: float(part.values(count=1)[0]) for part in element.all("Distorsion/*/*")}
    strange = [tag for tag in known if tag not in _MMVII and known[tag] != 0.0]
    if strange:
        raise NoModel(f"{path.name} has the distortion {strange[0]}, which corridor does not")
    return camera_from(
        path.stem,
        *element.child("PixelFrame").values("NbPix", 2),
        perfect.value("F"),
        *perfect.values("PP", 2),
        **{_MMVII[tag]: value for tag, value in known.items() if tag in _MMVII},
    )


# --- ground points, marks --------------------------------------------------------------------


def ground_of(path: Path) -> pd.DataFrame | None:
    """ground.csv of a DicoAppuisFlottant or an MMVII set of ground points; None for other XML."""
    root = Xml.read(path)
    if _root_or_inner(root, "DicoAppuisFlottant"):
        parts, key = root.all(".//OneAppuisDAF"), "NamePt"
    elif root.find(".//SetGCP"):
        parts, key = root.all(".//SetGCP/Measures/el"), "Name"
    else:
        return None
    names = [part.text(key) for part in parts]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise root.wrong(f"ground point {twice!r} stands there twice; delete one")
    places = np.array([part.values("Pt", 3) for part in parts]).reshape(-1, 3)
    # 1 1 1 is what MicMac writes when nobody said anything; negative ones switch a point off.
    sigmas = np.array(
        [
            part.values("Incertitude", 3) if part.find("Incertitude") else np.ones(3)
            for part in parts
        ]
    ).reshape(-1, 3)
    told = (np.abs(sigmas) != 1.0).any(axis=1) & (sigmas > 0).all(axis=1)
    roles = np.where((sigmas < 0).any(axis=1), "check", "control")
    return ground_table(names, places, np.where(told[:, None], sigmas, np.nan), roles)


def marks_of(path: Path) -> list[tuple[str, str, float, float]] | None:
    """point, image, x, y of a SetOfMesureAppuisFlottants or MMVII marks; None for other XML."""
    root = Xml.read(path)
    if _root_or_inner(root, "SetOfMesureAppuisFlottants"):
        pictures = root.all(".//MesureAppuiFlottant1Im")
        each, name, place = "OneMesureAF1I", "NamePt", "PtIm"
    elif root.find(".//SetMesIm") or root.tag == "SetMesIm":
        pictures = root.all(".//SetMesIm")
        each, name, place = "Measures/el", "Name", "Pt"
    else:
        return None
    return [
        (part.text(name), picture.text("NameIm"), *part.values(place, 2))
        for picture in pictures
        for part in picture.all(each)
    ]


def _ground_and_marks(home, images, notes, warnings):
    mmvii = home / "MMVII-PhgrProj"
    home = mmvii if mmvii.is_dir() and not list(home.glob("Ori-*")) else home
    ground, marks = None, []
    homes = [home, *_folders(home / "PointsMeasure")[:1]]
    for file in (file for place in homes for file in sorted(place.glob("*.xml"))):
        head = opening(file, 3000)
        if "DicoAppuisFlottant" in head or "<SetGCP>" in head:
            found = ground_of(file)
            if found is not None and ground is not None:
                warnings.append(f"{file.name}: a second set of ground points was left out")
            ground = found if ground is None else ground
        elif "SetOfMesureAppuisFlottants" in head or "<SetMesIm>" in head:
            marks += marks_of(file) or []
    names = Names(images)
    row_of = {image: names.row(image) for _, image, _, _ in marks}
    lost = sorted(image for image, row in row_of.items() if row is None)
    if lost:
        warnings.append(
            f"marks in {len(lost)} images without orientation were left out ({lost[0]})"
        )
    notes += names.told("marks")
    rows = [(p, row, x, y) for p, image, x, y in marks if (row := row_of[image]) is not None]
    known = set() if ground is None else set(ground["point"])
    bare = [name for name in dict.fromkeys(row[0] for row in rows) if name not in known]
    if bare and known:
        notes.append(f"{len(bare)} marked points have no coordinates (first: {bare[0]})")
    return ground, Views.of(rows, "marks")


# --- tie points ------------------------------------------------------------------------------


def _ties(home, images, notes, warnings):
    """Homol*/Pastis<image>/<image>.txt: x1 y1 x2 y2 of each pair of images."""
    folders = [place for place in _folders(home, "Homol*") if any(place.glob("Pastis*"))]
    if not folders:
        return None
    if len(folders) > 1:
        inside = ", ".join(place.name for place in folders)
        notes.append(f"several sets of tie points ({inside}): {folders[0].name} was read")
    at = {name: k for k, name in enumerate(images)}
    parts, binary = [], 0
    for place in sorted(folders[0].glob("Pastis*")):
        first = at.get(place.name.removeprefix("Pastis"))
        if first is None:
            continue
        files = {file: at.get(file.name.rpartition(".")[0]) for file in sorted(place.iterdir())}
        files = {file: k for file, k in files.items() if k is not None and k != first}
        texts = [file for file in files if file.suffix == ".txt"]
        binary += len(files) - len(texts)
        for file, rows in zip(texts, _pair_texts(texts), strict=True):
            if len(rows):
                parts.append((first, files[file], rows))
    if binary:
        warnings.append(
            f"{binary} files of tie points in {folders[0].name} are binary: left out; write them "
            "as text (ExpTxt=1)"
        )
    if not parts:
        return None
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
    return Views(codes, names, image[kept], pixels[kept], "tie points")


# Words of a line of tie points: x1 y1 x2 y2, and perhaps a weight.
_PAIR = (4, 5)


def _pair_texts(files):
    """(n, 4) pixels of each file: all files of a folder at once, or each alone to name one."""
    texts = [_with_end(file) for file in files]
    plain = plain_numbers(io.BytesIO(b"".join(texts)))
    count = [text.count(b"\n") for text in texts]
    if plain is None or len(plain.counts) != sum(count) or not np.isin(plain.counts, _PAIR).all():
        tables = [NumberLines(Following(file)) for file in files]
        for table in tables:
            table.expect(np.isin(table.counts, _PAIR), "a pair of points has 4, or 5 with a weight")
        return [table.values[table.starts[:, None] + np.arange(4)] for table in tables]
    pixels = plain.values[plain.starts[:, None] + np.arange(4)]
    return np.split(pixels, np.cumsum(count)[:-1]) if files else []


def _with_end(path):
    text = read_bytes(path)
    return text if text.endswith(b"\n") else text + b"\n"


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
