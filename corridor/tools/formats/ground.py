"""Ground points and marks from files beside a project.

OpenDroneMap's gcp_list.txt, OpenSfM's ground_control_points.json, MicMac's and MMVII's XML,
Metashape's marker XML, ground.csv (with marks.csv beside it) of a block, and plain text
(`ground_text`). Coordinates go into the block's frame: by its crs, by its place on Earth, or as
they are; where they then lie far from what the images see, they are refused (`plausible`).
"""

import csv
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import LAYOUTS, Block, place, read_columns
from corridor.core.errors import InputError
from corridor.core.geometry import similarity
from corridor.core.gnss import GEOGRAPHIC, convert, known_crs, local_of, loose_way, outside_area
from corridor.core.textfile import Line, decimal_commas, with_point
from corridor.tools.formats.frames import height_unit, system_in
from corridor.tools.formats.ground_text import read_text
from corridor.tools.formats.names import Names
from corridor.tools.formats.plausible import remedy
from corridor.tools.formats.project import Project, Views, apart, ground_table
from corridor.tools.formats.textfile import filled, opening, says_number

_XYZ = ["x", "y", "z"]
# Points of one name are the same where they lie apart by less than this share of their extent.
_ALIKE = 0.05
# What begins a line that says nothing, in the lists that programs and people write.
_COMMENTS = ("#", "%", ";", "//")
_PICTURE = re.compile(r"(?i)\.(jpe?g|tiff?|png|dng)$")
_UTM = re.compile(r"(?i)WGS84\s+UTM\s+(\d{1,2})\s*([NS])")


@dataclass
class Ground:
    """Ground points of a file.

    crs: of the coordinates; None: those of the block. table: as ground.csv; None: marks only.
    marks: point, image, x, y (px). notes: sentences. unit: of `ground_text.Table`.
    """

    path: Path
    crs: str | None
    table: pd.DataFrame | None
    marks: list[tuple[str, str, float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unit: str = ""


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
    of_block = {"point", *_XYZ} <= {word.strip() for word in head.split("\n", 1)[0].split(",")}
    if not of_block and is_gcp_list(head):
        return read_gcp_list(path)
    found = read_text(path, exact=of_block)
    marks = _marks_beside(path) if of_block else []
    crs = found.crs
    # Metashape's reference tables state their system in a remark.
    stated = re.search(r"(?im)^#\s*CoordinateSystem:\s*(\S.*)", head)
    if crs is None and stated and not stated[1].upper().startswith("LOCAL"):
        crs = known_crs(stated[1].strip()).to_wkt()
    if crs is None and (beside := system_beside(path)) is not None:
        crs = beside[1]
        found.notes.append(f"the system of {path.name} was read from {beside[0].name}: {beside[2]}")
    return Ground(path, crs, found.table, marks, found.notes, found.unit)


def system_beside(path: Path, option: str = "--ground-crs") -> tuple[Path, str, str] | None:
    """The .prj of a table or of a folder: its file, the system (an EPSG code, else its text), and
    what a person calls it. None without one; a .prj of a grid or of degrees alone is one. option:
    as of `system_in`.

    Raises InputError where it names no system.
    """
    files = [path.with_suffix(end) for end in (".prj", ".PRJ")]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() == ".prj")
        files = files if len(files) == 1 else []
    file = next((file for file in files if file.is_file()), None)
    found = system_in(file, option) if file else None
    if file is None or found is None:
        return None
    code, system = found
    return file, code, f"{system.name} ({code})" if code.startswith("EPSG:") else system.name


def is_gcp_list(head: str) -> bool:
    """Whether a text is a gcp_list.txt: lines of x y z column row image, or a system before all."""
    rows = [
        row for row in head.splitlines() if row.strip() and not row.lstrip().startswith(_COMMENTS)
    ]
    if not rows:
        return False
    if crs_of_line(rows[0]) is not None:
        return True
    # The last line of the head may be cut off.
    words = rows[1 if len(rows) > 1 else 0].split()
    listed = len(words) > 5 and all(map(says_number, words[:5])) and not says_number(words[5])
    return listed and "," not in "".join(words[:5])


def crs_of_line(text: str) -> str | None:
    """The reference system that the first line of a gcp_list.txt names, else None."""
    text = text.strip().strip('"')
    match = _UTM.fullmatch(text)
    if match:
        return f"EPSG:{(32600 if match[2].upper() == 'N' else 32700) + int(match[1])}"
    code = re.fullmatch(r"(?i)(?:EPSG[:\s]*)?(\d{4,6})\s*(?:\+\s*(?:EPSG:)?(\d+))?", text)
    if code:
        return f"EPSG:{code[1]}" + (f"+{code[2]}" if code[2] else "")
    if "+proj=" in text or re.match(r"[A-Z_]{4,}\s*\[", text):
        return text
    if re.match(r"(?i)urn:ogc:def:crs:|OGC:CRS", text) or " / " in text:
        return _by_name(text)
    return None


def read_gcp_list(path: Path) -> Ground:
    """OpenDroneMap's gcp_list.txt: system, then x y z column row image [name] a line.

    Points without a name are told apart by their coordinates. (0, 0) is the centre of the first
    pixel. Feet become metres, in height too. Raises InputError naming file and line.
    """
    rows, crs, commas, sure = [], None, [], False
    for line in filled(path, comment=_COMMENTS):
        if crs is None:
            crs = _known_system(line)
            continue
        # A name may stand in quotes, and have blanks in them.
        text = line.text.replace(";", " ") if line.text.count(";") > 4 else line.text
        spaced = [with_point(word) for word in text.split()[:5]]
        if not all(map(says_number, spaced)) and text.count(",") > 4:
            text = text.replace(",", " ")
        words = next(csv.reader([" ".join(text.split())], delimiter=" "))
        number = [says_number(with_point(word)) for word in words]
        if not rows and len(words) > 5 and not any(number):
            continue  # what the columns are called
        if number[3:5] == [True, False]:
            raise line.wrong(
                "a point without height (x y column row image), which is not a height of 0: write "
                "it behind y, or leave the point out"
            )
        if len(words) > 2 and not says_number(words[0]) and _PICTURE.search(words[0]):
            raise line.wrong(
                f"it lists photographs ({words[0]}) and where they were taken, as a geo.txt: that "
                "is no ground point; leave it out"
            )
        if len(words) < 6:
            line.numbers(words[:5], "a coordinate")
            raise line.wrong(
                f"{len(words)} words where x y z column row image [name] belong; separate them by "
                "blanks"
            )
        commas += [(line.at, word) for word in words[:5]]
        sure = sure or text is not line.text and ";" in line.text
        words[:5] = map(with_point, words[:5])
        place = line.numbers(words[:3], "a coordinate")
        pixel = line.numbers(words[3:5], "a pixel")
        rows.append((tuple(place), tuple(pixel), words[5], words[6] if len(words) > 6 else None))
    if crs is None or not rows:
        raise InputError(f"{path.name} holds no ground point; write one a line")
    decimal_commas(path, commas, sure)
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


def _by_name(text: str) -> str | None:
    """A system by its URN or its whole name (`WGS 84 / UTM zone 30N`), None where it is none."""
    try:
        system = known_crs(text)
    except InputError:
        return None
    # PROJ takes a part of a name for the whole.
    plain, known = (re.sub(r"[^a-z0-9]", "", name.lower()) for name in (text, system.name))
    return text if ":" in text or plain == known else None


def _known_system(line: Line) -> str:
    crs, text = crs_of_line(line.text), line.text.strip()
    if crs is None and re.match(r"(?i)wgs\s*-?84", text):
        raise line.wrong(
            f"{text[:40]!r} does not say which coordinates of WGS 84 they are; write EPSG:4326 for "
            "longitude, latitude, height, or the zone, as WGS84 UTM 16N"
        )
    if crs is None:
        raise line.wrong(
            f"{text[:40]!r} names no coordinate system; write it there, as EPSG:32616 or WGS84 UTM "
            "16N"
        )
    try:
        known_crs(crs)
    except InputError as error:
        raise line.wrong(str(error)) from None
    return crs


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


def _marks_of(table):
    named = table[["point", "image", "x", "y"]].astype({"point": str, "image": str})
    return list(named.itertuples(index=False, name=None))


def _marks_beside(path):
    """Marks of a block's marks.csv beside its ground.csv."""
    file = path.with_name("marks.csv")
    if not file.is_file():
        return []
    table = read_columns(file, LAYOUTS["marks"])
    empty = table[list(LAYOUTS["marks"].needed)].isna().to_numpy()
    if empty.any():
        row, column = np.argwhere(empty)[0]
        name = LAYOUTS["marks"].needed[column]
        raise InputError(f"{place(file, row)}: {name} is empty; write it there")
    return _marks_of(table)


def in_frame(block: Block, places: np.ndarray, crs: str | None, what: str) -> np.ndarray:
    """Places (n, 3) of a system in the block's coordinates.

    Raises InputError where the block has no place on Earth to bring them to.
    """
    places = np.asarray(places, dtype=float).reshape(-1, 3)
    if crs is None:
        return places - block.offset
    outside = outside_area(places, crs)
    if outside:
        raise InputError(f"{what}: {outside}")
    local, places = local_of(block), places * [1.0, 1.0, height_unit(crs)]
    if block.crs is not None:
        return convert(places, crs, block.crs) - block.offset
    if local is not None:
        return local.from_crs(places, crs) - block.offset
    raise InputError(
        f"{what} is in {crs[:60]}, and the block has no place on Earth; import it with --photos "
        "whose positions place it, or give coordinates of the block's own frame"
    )


def add_to(project: Project, ground: Ground) -> Project:
    """The project with these ground points and marks in the place of those of the same names.

    Tie points of their names are measurements of the same points, where the project has no marks
    of its own. Raises InputError where no mark belongs to an image, or the places cannot be right.
    """
    block, notes, warnings = project.block, list(ground.notes), []
    new = block.ground[:0] if ground.table is None else ground.table
    if new["point"].duplicated().any():
        twice = new["point"][new["point"].duplicated()].iloc[0]
        first, again = (new["point"] == twice).to_numpy().nonzero()[0][:2] + 1
        raise InputError(
            f"{ground.path.name}: ground point {twice!r} stands there twice, as point {first} and "
            f"{again} of the list; delete one of them, or rename it"
        )
    given = new[_XYZ].to_numpy(float)
    rows = _rows_of_marks(ground, block, notes, warnings)
    marks = block.marks
    if rows:
        old = zip(
            marks["point"].astype(str), block.image_rows("marks").tolist(), marks["x"], marks["y"],
            strict=True,
        )  # fmt: skip
        mine = {row[:2] for row in rows}
        rows += [row for row in old if row[:2] not in mine]
        marks = Views.of(rows, "marks").table(list(block.images["image"]), warnings)
    if len(new):
        try:
            places = in_frame(block, given, ground.crs, ground.path.name)
        except InputError as error:
            told = ""
            if ground.crs is not None and outside_area(given, ground.crs):
                marked = replace(block, marks=marks)
                told = remedy(marked, list(new["point"]), given, ground.crs, in_frame)
            raise InputError(f"{error}; {told}" if told else str(error)) from None
        new = new.assign(**dict(zip(_XYZ, places.T, strict=True)))
        warnings += loose_way(block, ground.crs)
    block = replace(block, marks=marks)
    if not ground.marks:
        block = _measured_already(block, new, project.placed, notes)
    block = apart(block, notes, [*new["point"], *(mark[0] for mark in ground.marks)])
    tables = {"tie_points": block.tie_points, "points": block.points, "marks": block.marks}
    if len(new):
        old = block.ground[~block.ground["point"].isin(new["point"])]
        tables["ground"] = pd.concat([old, new], ignore_index=True) if len(old) else new
    return project.having(notes=notes, warnings=warnings, **tables)


def called_as_marked(ground: Ground, block: Block) -> Ground:
    """The points with the names of their marks, where these differ in case and blanks alone."""
    if ground.table is None or not len(ground.table):
        return ground
    given = ground.table["point"].astype(str)
    marked = pd.Series([*block.marks["point"].cat.categories, *(row[0] for row in ground.marks)])
    marked = marked.drop_duplicates()
    plain, mine = (
        names.astype(str).str.casefold().str.replace(r"\s", "", regex=True)
        for names in (marked, given)
    )
    alone = ~plain.duplicated(keep=False)
    meant = mine.map(dict(zip(plain[alone], marked[alone], strict=True)))
    other = ~given.isin(set(marked)) & meant.notna() & ~mine.duplicated(keep=False)
    if not other.any():
        return ground
    note = (
        f"{ground.path.name}: {int(other.sum())} ground points are called as their marks, which "
        f"differ in case or blanks alone ({given[other].iloc[0]}: {meant[other].iloc[0]})"
    )
    table = ground.table.assign(point=given.where(~other, meant))
    return replace(ground, table=table, notes=[*ground.notes, note])


def _measured_already(block: Block, ground: pd.DataFrame, placed: bool, notes: list[str]) -> Block:
    """The block with its tie points of these names as marks, where they are the same points.

    Programs without a table of control measure all points alike. Numbers of tie points and of
    ground points are often alike by chance: three or more have to lie alike, too.
    """
    names = block.tie_points["point"].cat.categories
    same = names.isin(set(ground["point"]))
    if same.sum() < 3 or len(block.marks) or len(block.ground):
        return block
    mine = names[same]
    here = block.positions("tie_points")[same]
    there = ground.set_index("point").loc[mine, _XYZ].to_numpy(float)
    known = np.isfinite(here).all(axis=1)
    wide = float(np.linalg.norm(np.ptp(there[known], axis=0))) if known.any() else 0.0
    try:
        moved = here if placed else similarity(here[known], there[known]).apply(here)
    except InputError:
        return block
    away = np.linalg.norm(moved - there, axis=1)[known]
    if known.sum() < 3 or not np.median(away) < _ALIKE * wide:
        return block
    of_ground = same[block.tie_points["point"].cat.codes]
    marks = block.tie_points[of_ground].reset_index(drop=True)
    ties = block.tie_points[~of_ground].reset_index(drop=True)
    for table in (marks, ties):
        table["point"] = table["point"].cat.remove_unused_categories()
    notes.append(
        f"{len(mine)} points that the project measures {int(of_ground.sum())} times have the names "
        "of these ground points: their measurements became marks"
    )
    points = block.points[~block.points["point"].isin(set(mine))].reset_index(drop=True)
    return replace(block, tie_points=ties, marks=marks, points=points)


def _rows_of_marks(ground, block, notes, warnings) -> list[tuple[str, int, float, float]]:
    """Point, row of the image, x, y of the marks; those without image are told."""
    names = Names(block.images["image"])
    found = [(mark, names.row(mark[1])) for mark in ground.marks]
    lost = [mark[1] for mark, row in found if row is None]
    if lost:
        first = f"{ground.path.name}: {len(lost)} of {len(found)} marks are in images"
        have = block.images["image"].iloc[0]
        if len(lost) == len(found):
            raise InputError(
                f"{first} the project does not have, or has several of ({lost[0]}, ...; the "
                f"project has {have}, ...); correct the names, with their folders where needed"
            )
        others = ", ".join(list(dict.fromkeys(lost))[:5])
        warnings.append(
            f"{first} the project does not have, or has several of, and were left out: {others}"
        )
    notes += names.told(ground.path.name)
    return [(str(mark[0]), row, *mark[2:]) for mark, row in found if row is not None]
