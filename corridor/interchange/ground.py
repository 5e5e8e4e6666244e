"""Ground points and marks from files beside a project.

OpenDroneMap's gcp_list.txt, OpenSfM's ground_control_points.json, MicMac's and MMVII's XML,
Metashape's marker XML, ground.csv (with marks.csv beside it) of a block, and plain text: name x y z
a line. Coordinates go into the block's frame: by its crs, by its place on Earth, or as they are.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.gnss import Local, convert
from corridor.interchange.faults import blaming
from corridor.interchange.project import (
    Project,
    ground_table,
    observations_table,
    same_point_once,
)
from corridor.interchange.text import lines, number, numbers, opening

_GEOGRAPHIC = "EPSG:4979"
_UTM = re.compile(r"(?i)WGS84\s+UTM\s+(\d{1,2})\s*([NS])")


@dataclass
class Ground:
    """Ground points of a file.

    crs: of the coordinates; None: those of the block. names, places (n, 3), sigmas, roles: as
    ground.csv. marks: point, image, x, y (px).
    """

    path: Path
    crs: str | None
    names: list[str]
    places: np.ndarray
    sigmas: np.ndarray | None = None
    roles: list[str] | None = None
    marks: list[tuple[str, str, float, float]] = field(default_factory=list)


def read_ground(path: Path, block: Block) -> Ground:
    """Ground points of a file; the format is told by the content.

    Raises InputError naming file and line.
    """
    if path.is_dir():
        path = path / "ground.csv"
    head = opening(path)
    if head.lstrip().startswith("<"):
        return _xml(path)
    if path.suffix.lower() == ".json":
        local = local_of(block)
        if local is None:
            raise InputError(
                f"{path.name} has latitude and longitude, and the block has no place on Earth; "
                "give ground points in the block's coordinates"
            )
        return read_opensfm(path, block, local)
    first = head.split("\n", 1)[0]
    if "point" in first.split(",") and {"x", "y", "z"} <= set(
        word.strip() for word in first.split(",")
    ):
        return _block_table(path)
    if crs_of_line(first) is not None or len(first.split()) >= 6 and "," not in first:
        return read_gcp_list(path)
    return _plain(path)


def crs_of_line(text: str) -> str | None:
    """The reference system that the first line of a gcp_list.txt names, else None."""
    text = text.strip()
    match = _UTM.fullmatch(text)
    if match:
        return f"EPSG:{(32600 if match[2].upper() == 'N' else 32700) + int(match[1])}"
    if re.fullmatch(r"(?i)EPSG:\d+", text) or text.startswith("+proj") or "+proj=" in text:
        return text
    return None


def read_gcp_list(path: Path) -> Ground:
    """OpenDroneMap's gcp_list.txt: system, then x y z column row image [name] a line.

    Points without a name are told apart by their coordinates. (0, 0) is the centre of the first
    pixel. Feet become metres, in height too. Raises InputError naming file and line.
    """
    rows, crs = [], None
    for line, text in lines(path):
        words = text.split()
        if not words:
            continue
        if crs is None:
            crs = crs_of_line(text)
            if crs is None:
                raise InputError(
                    f"{path.name}, line {line}: {text.strip()[:40]!r} names no coordinate system; "
                    "write it there, as EPSG:32616 or WGS84 UTM 16N"
                )
            _known(crs, path, line)
            continue
        if len(words) == 5 and not _is_number(words[4]):
            # x y column row image: a point without height
            words = [*words[:2], "0", *words[2:]]
        if len(words) < 6:
            for word in words[:5]:
                number(word, path, line, "a coordinate")
            raise InputError(
                f"{path.name}, line {line}: {len(words)} words where x y z column row image "
                "[name] belong; separate them by blanks"
            )
        place = numbers(words[:3], path, line, "a coordinate")
        pixel = numbers(words[3:5], path, line, "a pixel")
        rows.append((tuple(place), tuple(pixel), words[5], words[6] if len(words) > 6 else None))
    if crs is None or not rows:
        raise InputError(f"{path.name} holds no ground point; write one a line")
    places: dict[str, tuple] = {}
    unnamed: dict[tuple, str] = {}
    marks = []
    for place, pixel, image, name in rows:
        name = name or unnamed.setdefault(place, f"gcp{len(unnamed) + 1}")
        if places.setdefault(name, place) != place:
            raise InputError(
                f"{path.name}: ground point {name!r} has two different positions; correct one"
            )
        marks.append((name, image, *pixel))
    return Ground(path, crs, list(places), np.array(list(places.values())), marks=marks)


def _known(crs, path, line):
    import pyproj

    try:
        pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise InputError(
            f"{path.name}, line {line}: the coordinate system {crs[:60]!r} is not known; give a "
            "code, as EPSG:32616"
        ) from None


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_opensfm(path: Path, block: Block, local: Local | None) -> Ground:
    """OpenSfM's ground_control_points.json, in the frame about its reference; None: marks only."""
    from corridor.interchange.formats.opensfm import load_json, number_in, numbers_in

    found = load_json(path)
    points = found.get("points") if isinstance(found, dict) else None
    if not isinstance(points, list):
        raise InputError(f"{path.name} has no list of points; export it again")
    sizes = {
        image: (block.cameras[camera].width, block.cameras[camera].height)
        for image, camera in block.images[["image", "camera"]].itertuples(index=False)
    }
    names, places, roles, marks = [], [], [], []
    for k, point in enumerate(points):
        where = f"{path.name}: point {k + 1}"
        if not isinstance(point, dict) or not isinstance(point.get("id"), (str, int)):
            raise InputError(f"{where} has no id; export it again")
        name = str(point["id"])
        position = point.get("position")
        if isinstance(position, dict) and local is not None:
            lon, lat = (number_in(position, key, where) for key in ("longitude", "latitude"))
            height = number_in(position, "altitude", where, 0.0)
            names.append(name)
            places.append(local.from_geographic(np.array([[lon, lat, height]]))[0])
            role = point.get("role")
            roles.append("check" if role in ("check", "metrics_only") else "control")
        observations = point.get("observations") or []
        if not isinstance(observations, list):
            raise InputError(f"{where}: its observations are no list; export it again")
        for entry in observations:
            shot = entry.get("shot_id") if isinstance(entry, dict) else None
            if shot not in sizes:
                continue
            xy = numbers_in(entry.get("projection"), 2, f"{where}: projection")
            size = np.array(sizes[shot], dtype=float)
            marks.append((name, shot, *(xy * size.max() + (size - 1) / 2)))
    return Ground(path, None, names, np.array(places).reshape(-1, 3), None, roles, marks)


def _xml(path):
    from corridor.interchange.formats import formats, micmac

    ground, marks = micmac.ground_of(path), micmac.marks_of(path)
    if ground is not None:
        sigmas = ground[["sx", "sy", "sz"]].to_numpy() if "sx" in ground else None
        return Ground(
            path, None, list(ground["point"]), ground[["x", "y", "z"]].to_numpy(), sigmas,
            list(ground["role"]), marks or [],
        )  # fmt: skip
    if marks is not None:
        return Ground(path, None, [], np.zeros((0, 3)), marks=marks)
    other = formats()["metashape"].read(path).block
    table, ground = other.marks, other.ground
    sigmas = ground[["sx", "sy", "sz"]].to_numpy() if "sx" in ground else None
    places = ground[["x", "y", "z"]].to_numpy() + other.offset
    local = local_of(other)
    return Ground(
        path, _GEOGRAPHIC if local else None, list(ground["point"]),
        local.to_geographic(places) if local and len(places) else places, sigmas,
        list(ground["role"]),
        [(str(p), str(i), x, y) for p, i, x, y in table[["point", "image", "x", "y"]].itertuples(
            index=False
        )],
    )  # fmt: skip


def _block_table(path):
    found = list(_cells(path))
    header = found[0][1]
    at = {name: header.index(name) for name in header}
    names, places, sigmas, roles = [], [], [], []
    for line, row in found[1:]:
        if len(row) != len(header):
            raise InputError(
                f"{path.name}, line {line}: {len(row)} cells where the header has {len(header)}; "
                "write numbers with a decimal point"
            )
        names.append(row[at["point"]])
        places.append(numbers([row[at[axis]] for axis in "xyz"], path, line, "a coordinate"))
        sigma = [row[at[key]] if key in at else "" for key in ("sx", "sy", "sz")]
        sigmas.append([number(word, path, line, "a sigma") if word else np.nan for word in sigma])
        role = row[at["role"]] if "role" in at and row[at["role"]] else "control"
        roles.append(role)
    marks = []
    beside = path.with_name("marks.csv")
    if beside.is_file():
        found = list(_cells(beside))
        header = found[0][1]
        if not {"point", "image", "x", "y"} <= set(header):
            raise InputError(f"{beside.name}, line 1: it needs the columns point, image, x, y")
        at = {name: header.index(name) for name in header}
        for line, row in found[1:]:
            if len(row) != len(header):
                raise InputError(f"{beside.name}, line {line}: {len(row)} cells, not {len(header)}")
            pixel = numbers([row[at["x"]], row[at["y"]]], beside, line, "a pixel")
            marks.append((row[at["point"]], row[at["image"]], *pixel))
    places = np.array(places).reshape(-1, 3)
    return Ground(path, None, names, places, np.array(sigmas).reshape(-1, 3), roles, marks)


def _cells(path):
    rows = list(lines(path))
    try:
        for (line, _), row in zip(rows, csv.reader(text for _, text in rows), strict=False):
            if any(cell.strip() for cell in row):
                yield line, [cell.strip() for cell in row]
    except csv.Error as error:
        raise InputError(f"{path.name} is not a table ({error}); save it comma separated") from None


def _plain(path):
    """name x y z a line, separated by blanks, commas, tabs or semicolons."""
    names, places = [], []
    for line, text in lines(path):
        text = text.strip()
        if not text or text.startswith("#"):
            continue
        separator = next((mark for mark in ("\t", ";", ",") if mark in text), None)
        words = [word.strip() for word in text.split(separator)]
        if len(words) < 4:
            raise InputError(
                f"{path.name}, line {line}: {len(words)} words where a name and x, y, z belong"
            )
        if not names and line == 1 and not _is_number(words[1]) and not words[1][:1].isdigit():
            continue  # a header
        names.append(words[0])
        places.append(numbers(words[1:4], path, line, "a coordinate"))
    if not names:
        raise InputError(f"{path.name} holds no ground point; write name, x, y, z a line")
    return Ground(path, None, names, np.array(places))


def local_of(block: Block) -> Local | None:
    """The block's east, north, up frame on Earth, None where it has none."""
    local = block.extra.get("local_frame")
    return Local(local["lat_deg"], local["lon_deg"], local["height"]) if local else None


def in_frame(block: Block, places: np.ndarray, crs: str | None, what: str) -> np.ndarray:
    """Places (n, 3) of a system in the block's coordinates.

    Raises InputError where the block has no place on Earth to bring them to.
    """
    places = np.asarray(places, dtype=float).reshape(-1, 3)
    if crs is None:
        return places - block.offset
    if block.crs is not None:
        return convert(places, crs, block.crs) - block.offset
    local = local_of(block)
    if local is not None:
        return local.from_geographic(_metres(places, crs)) - block.offset
    raise InputError(
        f"{what} is in {crs[:60]}, and the block has no place on Earth; import it with --photos "
        "whose positions place it, or give coordinates of the block's own frame"
    )


def _metres(places, crs):
    """Longitude, latitude, height; a height in feet of a system in feet becomes metres."""
    import pyproj

    system = pyproj.CRS.from_user_input(crs)
    unit = system.axis_info[0].unit_conversion_factor if system.is_projected else 1.0
    geographic = convert(places, crs, _GEOGRAPHIC)
    if unit != 1.0 and len(system.axis_info) == 2:
        geographic[:, 2] = places[:, 2] * unit
    return geographic


def add_to(block: Block, ground: Ground, notes: list[str]) -> None:
    """Put ground points and marks into the block; those it had of the same name are replaced."""
    warnings: list[str] = []
    places = in_frame(block, ground.places, ground.crs, ground.path.name)
    if len(set(ground.names)) < len(ground.names):
        twice = next(name for name in ground.names if ground.names.count(name) > 1)
        raise InputError(f"{ground.path.name}: ground point {twice!r} stands there twice")
    ties = block.tie_points["point"].cat.categories
    if set(ground.names) & set(ties) or {mark[0] for mark in ground.marks} & set(ties):
        # Numbers name tie points and ground points alike in many programs.
        names = ("t" + ties).astype("str")
        block.tie_points["point"] = block.tie_points["point"].cat.rename_categories(names)
        is_tie = block.points["point"].isin(ties)
        block.points["point"] = block.points["point"].where(~is_tie, "t" + block.points["point"])
        notes.append("tie points got a t before their names, which ground points have too")
    if ground.names:
        old = block.ground[~block.ground["point"].isin(ground.names)]
        new = ground_table(ground.names, places, ground.sigmas, ground.roles)
        block.ground = pd.concat([old, new], ignore_index=True) if len(old) else new
    images = list(block.images["image"])
    at = rows_by_name(images)
    marks = [(point, at.get(image), x, y) for point, image, x, y in ground.marks]
    lost = sum(1 for mark in marks if mark[1] is None)
    if lost:
        notes.append(f"{ground.path.name}: {lost} marks are in images the block does not have")
    marks = [mark for mark in marks if mark[1] is not None]
    if marks:
        old = block.marks[["point", "image", "x", "y"]]
        rows = [(str(p), images[i], x, y) for p, i, x, y in marks]
        rows += [
            tuple(row)
            for row in old.astype({"point": str, "image": str}).itertuples(index=False)
            if (row[0], row[1]) not in {(p, images[i]) for p, i, _, _ in marks}
        ]
        codes, names = pd.factorize(np.array([row[0] for row in rows], dtype=object))
        table = observations_table(
            codes, pd.Index(names, dtype="str"), pd.Index(images).get_indexer([r[1] for r in rows]),
            images, np.array([row[2:] for row in rows], dtype=float),
        )  # fmt: skip
        block.marks = same_point_once(table, "marks", warnings)
        notes += warnings
    block.__post_init__()


def rows_by_name(images: list[str]) -> dict[str, int]:
    """Row of an image by its name, also without folder or ending where that is unique."""
    """Rows by name, by name without folder, and by name without ending, where that is unique."""
    at = {}
    for make in (
        lambda name: name.rpartition("/")[2].rpartition(".")[0] or name,
        lambda name: name.rpartition("/")[2],
        lambda name: name,
    ):
        short = [make(name) for name in images]
        at |= {name: k for k, name in enumerate(short) if short.count(name) == 1}
    return at


def add_ground(project: Project, path: Path) -> None:
    """Ground points (and marks) of a file into a project. Raises InputError."""
    block = project.block
    with blaming(path, "a file of ground points"):
        ground = read_ground(path, block)
        add_to(block, ground, project.notes)
    project.notes.append(
        f"{path.name}: {len(ground.names)} ground points, {len(ground.marks)} marks"
    )
    unseen = set(ground.names) - set(block.marks["point"].cat.categories)
    if unseen:
        project.notes.append(f"{len(unseen)} ground points are measured in no image")
