"""Ground points and marks from files beside a project.

OpenDroneMap's gcp_list.txt, OpenSfM's ground_control_points.json, MicMac's and MMVII's XML,
Metashape's marker XML, ground.csv (with marks.csv beside it) of a block, and plain text: name x y z
a line. Coordinates go into the block's frame: by its crs, by its place on Earth, or as they are.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import LAYOUTS, SIGMAS, Block, Layout, place, read_columns
from corridor.core.errors import InputError
from corridor.core.gnss import GEOGRAPHIC, convert, known_crs
from corridor.core.textfile import Line, filled, opening
from corridor.tools.formats.project import Project, Views, apart, ground_table, local_of

_XYZ = ["x", "y", "z"]
_UTM = re.compile(r"(?i)WGS84\s+UTM\s+(\d{1,2})\s*([NS])")


@dataclass
class Ground:
    """Ground points of a file.

    crs: of the coordinates; None: those of the block. table: as ground.csv; None: marks only.
    marks: point, image, x, y (px).
    """

    path: Path
    crs: str | None
    table: pd.DataFrame | None
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
        from corridor.tools.formats.programs import formats

        if local_of(block) is None:
            raise InputError(
                f"{path.name} has latitude and longitude, and the block has no place on Earth; "
                "give ground points in the block's coordinates"
            )
        return formats()["opensfm"].read_ground(path, block, local_of(block))
    first = head.split("\n", 1)[0]
    if {"point", "x", "y", "z"} <= {word.strip() for word in first.split(",")}:
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
    for line in filled(path):
        if crs is None:
            crs = _known_system(line)
            continue
        words = line.text.split()
        if len(words) == 5 and not _is_number(words[4]):
            # x y column row image: a point without height
            words = [*words[:2], "0", *words[2:]]
        if len(words) < 6:
            line.numbers(words[:5], "a coordinate")
            raise line.wrong(
                f"{len(words)} words where x y z column row image [name] belong; separate them by "
                "blanks"
            )
        place = line.numbers(words[:3], "a coordinate")
        pixel = line.numbers(words[3:5], "a pixel")
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
    return Ground(path, crs, ground_table(list(places), list(places.values())), marks)


def _known_system(line: Line) -> str:
    crs = crs_of_line(line.text)
    if crs is None:
        raise line.wrong(
            f"{line.text.strip()[:40]!r} names no coordinate system; write it there, as EPSG:32616 "
            "or WGS84 UTM 16N"
        )
    try:
        known_crs(crs)
    except InputError as error:
        raise line.wrong(str(error)) from None
    return crs


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def _xml(path):
    from corridor.tools.formats.programs import formats

    micmac = formats()["micmac"]
    ground, marks = micmac.ground_of(path), micmac.marks_of(path)
    if ground is not None or marks is not None:
        return Ground(path, None, ground, marks or [])
    other = formats()["metashape"].read(path).block
    local, ground = local_of(other), other.ground
    places = ground[_XYZ].to_numpy() + other.offset
    if local and len(places):
        places = local.to_geographic(places)
    ground = ground.assign(**dict(zip("xyz", places.T, strict=True)))
    return Ground(path, GEOGRAPHIC if local else None, ground, _marks_of(other.marks))


def _block_table(path):
    table = _columns(path, Layout(("point", *_XYZ), optional=(*SIGMAS, "role")))
    sigmas = None
    if set(SIGMAS) & set(table):
        sigmas = table.reindex(columns=SIGMAS).to_numpy(float)
    roles = table["role"].fillna("").replace("", "control") if "role" in table else None
    table = ground_table(list(table["point"]), table[_XYZ].to_numpy(), sigmas, roles)
    beside = path.with_name("marks.csv")
    marks = _marks_of(_columns(beside, LAYOUTS["marks"])) if beside.is_file() else []
    return Ground(path, None, table, marks)


def _marks_of(table):
    named = table[["point", "image", "x", "y"]].astype({"point": str, "image": str})
    return list(named.itertuples(index=False, name=None))


def _columns(path, layout):
    table = read_columns(path, layout)
    for name in layout.needed:
        if table[name].isna().any():
            row = int(np.argmax(table[name].isna()))
            raise InputError(f"{place(path, row)}: {name} is empty; write it there")
    return table


def _plain(path):
    """name x y z a line, separated by blanks, commas, tabs or semicolons."""
    names, places = [], []
    for line in filled(path, comment="#"):
        text = line.text.strip()
        separator = next((mark for mark in ("\t", ";", ",") if mark in text), None)
        words = [word.strip() for word in text.split(separator)]
        if len(words) < 4:
            raise line.wrong(f"{len(words)} words where a name and x, y, z belong")
        if not names and line.at == 1 and not _is_number(words[1]) and not words[1][:1].isdigit():
            continue  # a header
        names.append(words[0])
        places.append(line.numbers(words[1:4], "a coordinate"))
    if not names:
        raise InputError(f"{path.name} holds no ground point; write name, x, y, z a line")
    return Ground(path, None, ground_table(names, places))


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
    system = known_crs(crs)
    unit = system.axis_info[0].unit_conversion_factor if system.is_projected else 1.0
    geographic = convert(places, crs, GEOGRAPHIC)
    if unit != 1.0 and len(system.axis_info) == 2:
        geographic[:, 2] = places[:, 2] * unit
    return geographic


def add_to(project: Project, ground: Ground) -> Project:
    """The project with these ground points and marks in the place of those of the same names."""
    block, notes, warnings = project.block, [], []
    new = block.ground[:0] if ground.table is None else ground.table
    if new["point"].duplicated().any():
        twice = new["point"][new["point"].duplicated()].iloc[0]
        raise InputError(f"{ground.path.name}: ground point {twice!r} stands there twice")
    block = apart(block, notes, [*new["point"], *(mark[0] for mark in ground.marks)])
    tables = {"tie_points": block.tie_points, "points": block.points}
    if len(new):
        places = in_frame(block, new[_XYZ].to_numpy(), ground.crs, ground.path.name)
        new = new.assign(**dict(zip(_XYZ, places.T, strict=True)))
        old = block.ground[~block.ground["point"].isin(new["point"])]
        tables["ground"] = pd.concat([old, new], ignore_index=True) if len(old) else new
    images = list(block.images["image"])
    row_of = rows_by_name(images)
    rows = [
        (str(point), row_of[image], x, y) for point, image, x, y in ground.marks if image in row_of
    ]
    if len(rows) < len(ground.marks):
        lost = len(ground.marks) - len(rows)
        notes.append(f"{ground.path.name}: {lost} marks are in images the block does not have")
    if rows:
        old = zip(
            block.marks["point"].astype(str), block.image_rows("marks").tolist(),
            block.marks["x"], block.marks["y"], strict=True,
        )  # fmt: skip
        new = {row[:2] for row in rows}
        rows += [row for row in old if row[:2] not in new]
        tables["marks"] = Views.of(rows, "marks").table(images, warnings)
    return project.having(notes=[*notes, *warnings], **tables)


def rows_by_name(images: list[str]) -> dict[str, int]:
    """Rows by name, by name without folder, and by name without ending, where that is unique."""
    at = {}
    for make in (
        lambda name: name.rpartition("/")[2].rpartition(".")[0] or name,
        lambda name: name.rpartition("/")[2],
        lambda name: name,
    ):
        short = pd.Series([make(name) for name in images])
        at |= {name: k for k, name in short[~short.duplicated(keep=False)].items()}
    return at
