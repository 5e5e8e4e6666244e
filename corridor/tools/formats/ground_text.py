"""Ground points from plain text: a table with or without a header, as surveyors write it.

Columns are known by the words of the header (Easting, Northing, Elevation, lat, lon, PNEZD ...);
without a header they are name, x, y, z, then perhaps three standard deviations.
"""

import csv
import re
import unicodedata
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import ROLES, SIGMAS
from corridor.core.errors import InputError, did_you_mean
from corridor.core.gnss import GEOGRAPHIC, degrees
from corridor.core.textfile import Line, decimal_commas, with_point
from corridor.tools.formats.project import ground_table
from corridor.tools.formats.textfile import filled

# What columns are called, without units, accents, blanks and case. Several words for one column
# are those of receivers, of Metashape, Pix4D and OpenDroneMap, and of English, German, French,
# Italian and Spanish tables.
_WORDS = {
    "point": "point name id label pt gcp pointid pointname marker no nr number nummer punkt "
    "punktnummer pnr p pid station gcpname gcplabel pointnumber targetname target nom nome nombre "
    "punto ponto vertice piste pontszam cislobodu nazwa nazwapunktu nrpunktu noktano punktnavn pnt "
    "nrpkt noktaadi",
    "x": "x e dogu east easting eastings rechtswert rechts ost est este xeasting eastingx xe "
    "abscisse wschod itae kelet oest oestlig saga",
    "y": "y n kuzey north northing northings hochwert hoch nord norte ynorthing northingy yn "
    "ordonnee polnoc pohjoinen eszak nordlig yukari",
    "z": "z h height elevation elev el ele alt altitude hoehe u up zaltitude ht quota cota hoogte "
    "hoehen zelevation nn nhn nap naphoogte hauteur altura altezza cotaz "
    "yuekseklik vyska wysokosc korkeus hoejd hoeyde magassag kot",
    "lon": "lon long lng longitude laenge xlongitude longitud longitudine",
    "lat": "lat latitude breite ylatitude latitud latitudine",
    "sx": "sx seast se xm",
    "sy": "sy snorth sn ym",
    "sz": "sz sup sv sh",
    "sxy": "sxy hprec hrms horzacc",
    "role": "role use",
    # Roles only where all of its cells are.
    "type": "type kind",
    # What a surveyor adds and no adjustment needs.
    "": "description desc d code codes comment comments note notes remark remarks date time "
    "feature photo",
    # Metashape's tick: what has none is a check point.
    "enabled": "enabled",
}
_COLUMN = {word: column for column, words in _WORDS.items() for word in words.split()}
# What a receiver's program writes beside such a word, and it stays the same column.
_BESIDE = "(?:wgs84|etrs89|utm|gps|pos|gcp|grid|local|[ck]oord(?:inate|inaat|inata|onnee)?|"
_BESIDE += "(?:ell(?:ip)?|elip)(?:s(?:oid(?:ale?)?)?)?|orth?om?(?:etric[ao]?)?)*"
_SPREAD = "sigma|stdev|stddev|std|sd|accuracy|acc|precision|prec|rms|cq"
_AXES = {"sx": "x", "sy": "y", "sz": "z vertical vert vt v 1d", "sxyz": " xyz",
         "sxy": "xy horizontal horz hz lateral 2d"}  # fmt: skip
# Letters that are written otherwise; in East Asia X of plane coordinates is north.
_PLAIN = ("ö=oe ä=ae ü=ue ø=oe ł=l ı=i σημείο=name ανατολικά=east βόρεια=north υψόμετρο=height "
          "σ=sigma ß=ss 점번호=name 점명=name x좌표=north y좌표=east 북=north 동=east "
          "표고=height 위도=lat 경도=lon x坐标=north y坐标=east 大地高h=ellipsoidalheight "
          "大地高=ellipsoidalheight 纬度b=lat 经度l=lon 点名=name 点番号=name x座標=north "
          "y座標=east 標高=height 楕円体高=ellipsoidalheight 緯度=lat 経度=lon 点号=name "
          "北坐标=north 东坐标=east 高程=height 纬度=lat 经度=lon имя=name номер=no "
          "северная=north восточная=east высота=height север=north восток=east "
          "東=east 北=north จุด=name ตะวันออก=east เหนือ=north ความสูง=height ละติจูด=lat "
          "ลองจิจูด=lon")  # fmt: skip
# Minus signs and dashes; the decimal and thousands separators of Arabic tables.
_MARKS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u2010": "-", "\u066b": ".", "\u066c": "'"})
_OF_SCRIPTS = re.compile(r"[\W\d]*\d[.,٫．，][\W\d]*\d|[\W\d]*[-−–－]\s?\d+")
_PLACE = ("x", "y", "z")
_UNITS = ("(us|intl?|international|survey|us?survey)?(s?ft|feet|foot)(us|int)?", "[cdkm]m",
          "(centi|deci|kilo|milli)met(er|re)s?")  # fmt: skip
_UNIT = re.compile(rf"(?i)(.+?)[_\s]+({'|'.join(_UNITS)}|m|met(?:er|re)s?|deg|°)")
_UNIT_M = {"mm": 1e-3, "milli": 1e-3, "cm": 1e-2, "centi": 1e-2, "dm": 0.1, "deci": 0.1,
           "km": 1e3, "kilo": 1e3, "f": 0.3048}  # fmt: skip
# Degrees, or with minutes and seconds; the half of the Earth before or after.
_ANGLE = re.compile(
    r"""(?i)([NSEW]?)\s*([+-]?[\d.]+)(?:\s*[°º:\s-]\s*([\d.]+)(?:\s*['′’:\s-]\s*([\d.]+))?)?"""
    r"""\s*[°º'′’"″”]*\s*([NSEW]?)"""
)
_OFF = ("0", "false", "no")
_ROLE = {"gcp": "control", "controlpoint": "control", "checkpoint": "check", "3dgcp": "control"}
# A semicolon is none: before it a cell may be empty.
_COMMENTS = ("#", "%", "//")
_SEPARATORS = "\t;,|"
# What programs write where there is no coordinate.
_NOTHING = (-9999.0, -99999.0, -32768.0, -32767.0)
# Zeros so many times the width of a project beyond its points, of at least a kilometre, are none.
_BEYOND, _LEAST_WIDE_M, _DEGREE_M = 10.0, 1000.0, 1.11e5
# So many points of a map, whose coordinates are this large, are not all at whole decimetres.
_LEAST_ROWS, _OF_A_MAP, _COARSE_M = 3, 1e4, 0.1
_DOS_END = "\x1a \t\r\n"  # old programs end a text with a character
_BOTH = (
    "commas stand both between the cells and in the numbers; write numbers with a decimal point, "
    "or semicolons between the cells"
)
_LETTERS = {"P": "point", "N": "y", "E": "x", "Z": "z", "D": ""}


@dataclass
class Table:
    """Ground points as a text has them.

    table: as ground.csv. crs: EPSG:4979 where the header names latitude and longitude, else None.
    notes: sentences. unit: of the coordinates, where the header states another than metres.
    """

    table: pd.DataFrame
    crs: str | None = None
    notes: list[str] = field(default_factory=list)
    unit: str = ""


def read_text(path: Path, exact: bool = False) -> Table:
    """Ground points of a text: cells between tabs, semicolons, commas or blanks, quoted or not.

    Comments begin with #, % or //; the header is the first line that is none. exact: a standard
    deviation of 0 says that a point is exact, as in a block; else that nobody stated one. Raises
    InputError naming file and line.
    """
    rows, titles, named, header, units = [], [], [], None, {}
    notes: list[str] = []
    found = [line for line in filled(path, comment=_COMMENTS) if line.text.strip(_DOS_END)]
    # Metashape begins its header with a #.
    commented = [line for line in filled(path) if line.text.lstrip().startswith("#")]
    separator = _separator(found)
    for n, line in enumerate(found):
        cells = _cells(line, separator)
        if not any(cell.strip("-:=") for cell in cells):
            continue  # an empty row of a spreadsheet, or a rule
        if header is not None and not rows and all(_UNIT.fullmatch(f"a {c or 'm'}") for c in cells):
            units = _units([f"{name} ({unit})" for name, unit in zip(named, cells, strict=False)])
        elif rows or header is not None:
            rows.append((line, cells))
        elif _is_whole(_columns(cells)):
            cells = _filled(cells, [_cells(other, separator) for other in found[n + 1 :]])
            header, units, named = _header(line, cells, notes), _units(cells), cells
        # A line with hardly a number is a header, or a title before it.
        elif sum(map(_is_place_like, cells)) < 2:
            titles.append((line, cells))
        else:
            rows.append((line, cells))
    if header is None and titles:
        header = _header(*titles[-1], notes)
    if header is None:
        header = next((made for line in commented if (made := _commented(line, notes))), None)
    if not rows:
        raise InputError(f"{path.name} holds no ground point; write name, x, y, z a line")
    if header is None:
        header = _guessed(rows, separator, notes)
    # Standard deviations come in metres; of coordinates the system may count in feet.
    rows = _with_points(path, rows, header, separator, notes)
    table = _table(rows, header, notes, exact)
    notes += _few_digits(path, rows, header)
    for column in set(SIGMAS) & set(table.table):
        table.table[column] *= _metres(units, column)
    return replace(table, unit=next((units[key] for key in _PLACE if key in units), ""))


# --- cells -----------------------------------------------------------------------------------


def _separator(lines: list[Line]) -> str | None:
    """The mark between the cells of all lines; None for blanks."""
    last = lines[-3:]  # of which one may be a remark
    if sum(_is_spaced(line.text) for line in last) > len(last) / 2:
        return None
    for mark in _SEPARATORS:
        if sum(mark in line.text for line in last) > len(last) / 2:
            return mark
    return None


def _is_spaced(text: str) -> bool:
    """Whether blanks stand between the cells and commas only in numbers."""
    cells = text.split()[1:]
    return not set("\t;") & set(text) and sum(cell != with_point(cell) for cell in cells) > 2


def _with_points(path, rows, columns, separator, notes):
    """The rows with decimal points for decimal commas. Raises InputError where they are doubtful.

    Commas in numbers and between cells cannot be told apart: whoever wrote them has more cells.
    """
    at = [
        k for k, column in enumerate(columns) if column and column not in ("point", "role", "type")
    ]
    wide = all(len(row) >= len(columns) + len(at) for _, row in rows)
    if separator == "," and wide and not any("." in cell for _, row in rows for cell in row):
        raise rows[0][0].wrong(_BOTH)
    cells = [(line.at, row[k]) for line, row in rows for k in at if k < len(row)]
    if not decimal_commas(path, cells, sure=separator == ";"):
        return rows
    notes.append(f"{path.name} has decimal commas")
    return [
        (line, [with_point(cell) if k in at else cell for k, cell in enumerate(row)])
        for line, row in rows
    ]


def _cells(line: Line, separator: str | None) -> list[str]:
    text = line.text.strip("\r\n")
    if separator is None:
        text = " ".join(text.split())
    if separator == "|":
        text = text.strip().removeprefix("|")
    if separator and re.fullmatch(r'"[^"]+"', text) and separator in text:
        text = text[1:-1]  # a spreadsheet that took the whole row for one cell
    cells = next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))
    # A spreadsheet keeps a text as ="G01".
    cells = [_plain_marks(re.sub(r'^="(.*)"$', r"\1", cell.strip())) for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _filled(cells: list[str], rows: list[list[str]]) -> list[str]:
    """A header without the names of columns that are all empty, where another one says the same:
    of two heights, or of two systems."""
    columns = _columns(cells)
    have = {k for k in range(len(cells)) if any(_cell(row, k) for row in rows)}
    given = {columns[k] for k in have}
    whole = {"lat", "lon"} <= given or {"x", "y"} <= given
    spare = given | ({"lat", "lon", "x", "y"} if whole else set())
    spared = {k for k in range(len(cells)) if k not in have and columns[k] in spare} if rows else ()
    return ["" if k in spared else cell for k, cell in enumerate(cells)]


def _plain_marks(cell: str) -> str:
    """A number with the signs, points and commas of other scripts as one with those of ASCII; any
    other text as it is."""
    if cell.isascii() or not _OF_SCRIPTS.fullmatch(cell):
        return cell
    return unicodedata.normalize("NFKC", cell).translate(_MARKS)


def _number(cell: str) -> float | None:
    """The number of a cell, None where it is none; 467,312.1 and 4,67,312.1 (quoted) and 467'312.1
    are some."""
    if re.fullmatch(r"[+-]?\d{1,3}((,\d{2,3})*,\d{3}\.\d*|(['’ \xa0\u202f]\d{3})+(\.\d*)?)", cell):
        cell = re.sub(r"[^\d.+-]", "", cell)
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None


def _is_place_like(cell: str) -> bool:
    return _number(cell) is not None or _number(with_point(cell)) is not None


# --- which column is which -------------------------------------------------------------------


def _word(cell: str) -> str:
    """`Höhe [m]` as hoehe, `Accuracy_XY (m)` as accuracyxy."""
    text = cell.lower()
    for mark, plain in (pair.split("=") for pair in _PLAIN.split()):
        text = unicodedata.normalize("NFC", text).replace(mark, plain)
    text = re.sub(r"\(.*?\)|\[.*?\]", "", text)
    return re.sub(r"[^a-z0-9]", "", unicodedata.normalize("NFD", text))


def _stated(cell: str) -> tuple[str, str]:
    """A cell of a header without its unit, and this: in brackets, or the last word, as elev_m."""
    brackets = re.search(r"[(\[]\s*([^)\]]*?)\s*[)\]]", cell)
    behind = None if brackets or _word(cell) in _COLUMN else _UNIT.fullmatch(cell.strip())
    return behind.group(1, 2) if behind else (cell, brackets[1] if brackets else "")


def _column(cell: str) -> str | None:
    """The column that a cell of a header names, by the words it is made of; None: not known."""
    cell, beside = _stated(cell)
    word, axis = _word(cell), _COLUMN.get(_word(beside))
    if word in ("x", "y") and axis in ("x", "y"):
        return axis  # X (N)
    if word in _COLUMN:
        return _COLUMN[word]
    spread = re.fullmatch(f"(?:{_SPREAD})(.*)|(.*?)(?:{_SPREAD})", word)
    if spread is None:
        return _COLUMN.get(re.fullmatch(f"{_BESIDE}(.*?){_BESIDE}", word)[1])
    # Of 95 %, say, it is no standard deviation.
    axis = next(word for word in spread.groups() if word is not None)
    found = [key for key, words in _AXES.items() if (_COLUMN.get(axis) or axis) in words.split(" ")]
    return found[0] if found and "%" not in cell else None


def _columns(cells: list[str]) -> list[str | None]:
    """The columns that the words of a header name, None for a word that is not known."""
    if len(cells) == 1 and re.fullmatch(r"[PNEZD]{4,5}", cells[0].upper()):
        return [_LETTERS[letter] for letter in cells[0].upper()]
    return [_column(cell) for cell in cells]


def _units(cells: list[str]) -> dict[str, str]:
    """The units that a header states in brackets, of the columns where it is none of metres."""
    found = {}
    for cell in cells:
        stated, column = _stated(cell)[1], _column(cell)
        unit = re.sub(r"[^a-z]", "", stated.lower())
        if column and re.fullmatch("|".join(_UNITS), unit):
            found[column] = stated
    return found


def _metres(units: dict[str, str], column: str) -> float:
    """Metres of the unit of a column of standard deviations."""
    every = ("sxyz",) if column == "sz" else ("sxy", "sxyz")
    unit = next((units[key] for key in (column, *every) if key in units), "").lower()
    return next((metres for word, metres in _UNIT_M.items() if word in unit), 1.0)


def _is_whole(columns: list[str | None]) -> bool:
    return {"x", "y", "z"} <= set(columns) or {"lat", "lon"} <= set(columns)


def _commented(line: Line, notes: list[str]) -> list[str | None] | None:
    """The columns of a commented line that names all of them, as Metashape writes its header."""
    text = Line(line.path, line.at, line.text.strip().lstrip("#"))
    cells = _cells(text, _separator([text]))
    return _header(text, cells, notes) if _is_whole(_columns(cells)) else None


def _of_one_system(cells: list[str], notes: list[str]) -> list[str | None]:
    """The columns; of a table in two systems longitude, latitude and their height alone."""
    columns = _columns(cells)
    if not {"lat", "lon"} <= set(columns):
        return columns
    heights = [k for k, column in enumerate(columns) if column == "z"]
    own = [k for k in heights if "ell" in _word(cells[k])]
    if {"x", "y"} <= set(columns):
        notes.append("latitude and longitude were read, not the other coordinates of the table")
        after = max(columns.index("lat"), columns.index("lon")) + 1
        own = own or [k for k in heights if k == after]
    left = {k for k in heights if k not in own} if len(own) == 1 else set()
    left |= {k for k, column in enumerate(columns) if column in ("x", "y")}
    return ["" if k in left else column for k, column in enumerate(columns)]


def _header(line: Line, cells: list[str], notes: list[str]) -> list[str | None]:
    columns = _of_one_system(cells, notes)
    named = [column for column in columns if column]
    twice = next((column for column in named if named.count(column) > 1), None)
    if twice:
        twice = {"point": "names of points", "z": "heights"}.get(twice, twice)
        raise line.wrong(f"two columns of the header are {twice}; keep one of them, or rename it")
    if {"x", "y"} <= set(columns) and "z" not in columns:
        raise line.wrong(f"the header ({', '.join(cells)}) names no height; call its column z")
    if not _is_whole(columns):
        unknown = [cell for cell, column in zip(cells, columns, strict=True) if column is None]
        told = f" ({', '.join(unknown[:4])})" if unknown else ""
        raise line.wrong(
            f"the header does not name the coordinates{told}; name the columns point, x, y, z, or "
            "Easting, Northing, Elevation, or lat, lon, height"
        )
    if "z" not in columns:
        raise line.wrong("the header names no height; add a column z")
    if not {"x", "y"} <= set(columns) and not {"lat", "lon"} <= set(columns):
        raise line.wrong("the header names no x, y; add the column that is missing")
    if "point" not in columns and columns[0] is None:
        notes.append(f"names were read from the first column, {cells[0]}")
        columns[0] = "point"
    if "point" not in columns:
        raise line.wrong("the header names no column of names; add one called point")
    named_so = zip(cells, columns, strict=False)
    unused = [cell for cell, column in named_so if cell and column is None]
    if unused:
        notes.append(f"columns of the header that are not known, unused: {', '.join(unused)}")
    return columns


def _guessed(rows: list[tuple[Line, list[str]]], separator: str | None, notes: list[str]):
    """Columns of a table without header, by its first row: names stand first, else last.

    Between blanks a name may hold blanks: it is then as long as makes all names different.
    """
    line, cells = rows[0]
    count = len(cells)
    decimals = all("." not in cell for _, row in rows for cell in row[1:])
    if separator == "," and count == 7 and decimals:
        raise line.wrong(_BOTH)
    if count < 4:
        raise line.wrong(f"{count} cells where a name and x, y, z belong")
    numeric = [_is_place_like(cell) for cell in cells]
    if not numeric[-1] and all(numeric[:3]) and count == 4:
        notes.append("names were read from the last column")
        return ["x", "y", "z", "point"]
    firsts = [row[0] for _, row in rows]
    longest = max(len(row) for _, row in rows)
    if separator is None and len(set(firsts)) < len(firsts) and longest > 4:
        # Names of several words: the words before the coordinates belong to the name.
        for more in (6, 3):
            if all(len(row) > more and all(map(_is_place_like, row[-more:])) for _, row in rows):
                names = {" ".join(row[:-more]) for _, row in rows}
                if len(names) == len(rows):
                    for _, row in rows:
                        row[:-more] = [" ".join(row[:-more])]
                    return ["point", *_PLACE, *SIGMAS][: more + 1]
    columns: list[str | None] = ["point", *_PLACE]
    if count >= 7 and all(numeric[4:7]) and all(0 <= (_number(c) or 0) < 10 for c in cells[4:7]):
        notes.append("columns 5 to 7 were read as standard deviations, m")
        columns += SIGMAS
    return columns


# --- the table -------------------------------------------------------------------------------


def _table(rows, columns, notes, exact) -> Table:
    at = {column: k for k, column in enumerate(columns) if column}
    geographic = "lat" in at
    keys = ("lon", "lat", "z") if geographic else _PLACE
    sigma_keys = [key for key in (*SIGMAS, "sxy", "sxyz") if key in at]
    names, places, sigmas, roles = [], [], [], []
    for line, cells in rows:
        needed = max(at[key] for key in (*keys, "point"))
        if len(cells) <= needed:
            raise line.wrong(
                f"{len(cells)} cells where a name and {', '.join(keys)} belong; fill in what is "
                "missing or delete the line"
            )
        name = cells[at["point"]]
        if not name:
            raise line.wrong("the point has no name; write it there")
        if re.match(r"(?i)epsg:", name):
            raise line.wrong(
                "the coordinate system stands in a row; write it once, in the first line alone, or "
                "give it with --ground-crs"
            )
        names.append(name)
        places.append([_coordinate(line, cells[at[key]], key) for key in keys])
        sigmas.append(_sigmas(line, {key: _cell(cells, at[key]) for key in sigma_keys}, exact))
        roles.append(_role(line, _cell(cells, at["role"])) if "role" in at else "control")
    for k in np.flatnonzero(_nowhere(np.array(places), geographic)):
        (line, cells), name = rows[k], names[k]
        raise line.wrong(
            f"point {name} has no coordinates ({', '.join(cells[at[key]] for key in keys)}): "
            "write them there or delete the line"
        )
    off = [_cell(cells, at["enabled"]).lower() in _OFF for _, cells in rows if "enabled" in at]
    if "role" not in at and any(off):
        notes.append(f"{sum(off)} points are switched off (Enabled): read as check points")
        roles = ["check" if out else "control" for out in off]
    if "role" not in at and "type" in at:
        roles = _roles_of_type([_cell(cells, at["type"]) for _, cells in rows], notes) or roles
    table = ground_table(names, np.array(places), np.array(sigmas), roles)
    alike = (
        pd.Series(names).str.casefold().str.replace(r"\s", "", regex=True).duplicated(keep=False)
    )
    if table["point"].is_unique and alike.any():
        notes.append(
            f"{', '.join(table['point'][alike.to_numpy()].head(4))} differ in case or blanks only: "
            "they are several points; if they are one, delete all but one"
        )
    return Table(table, GEOGRAPHIC if geographic else None, notes)


def _nowhere(places: np.ndarray, geographic: bool) -> np.ndarray:
    """Which of places (n, 3) are none (n,): what programs write for nothing, or zeros far beyond
    the others. The origin of a local frame is a place."""
    none, zero = np.isin(places, _NOTHING).any(axis=1), (places == 0.0).all(axis=1)
    there = places[~none & ~zero, :2] * (_DEGREE_M if geographic else 1.0)
    if zero.any() and len(there):
        wide = max(float(np.ptp(there, axis=0).max()), _LEAST_WIDE_M)
        none |= zero & (np.linalg.norm(there, axis=1).min() > _BEYOND * wide)
    return none


def _few_digits(path: Path, rows: list, columns: list) -> list[str]:
    """A sentence where the coordinates of a map are written to decimetres at best, and no standard
    deviation says so. Raises InputError where a spreadsheet has cut them to powers of ten."""
    if len(rows) < _LEAST_ROWS or not {"x", "y"} <= set(columns) or "sx" in columns:
        return []
    at, steps = [columns.index(axis) for axis in "xy"], []
    for line, cells in rows:
        for cell in (cells[k] for k in at):
            value = _number(cell)
            if value is None or abs(value) < _OF_A_MAP:
                return []
            mantissa, _, power = cell.lower().partition("e")
            steps.append(10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))
            if power and steps[-1] >= 1:
                raise line.wrong(
                    f"{cell} is cut to {steps[-1]:g} m: a spreadsheet shows long numbers so; "
                    "format the cells as numbers with three decimals, and save the sheet again"
                )
    if min(steps) < _COARSE_M or {"sxy", "sxyz"} & set(columns):
        return []
    return [
        f"{path.name}: x and y are written in steps of {min(steps):g} m, so they are off by up to "
        f"{min(steps) / 2:g} m: give them with all digits, or their standard deviation (sx, sy)"
    ]


def _cell(cells: list[str], k: int) -> str:
    return cells[k] if k < len(cells) else ""


def _coordinate(line: Line, cell: str, key: str) -> float:
    value, angle = _number(cell), _ANGLE.fullmatch(cell.replace(",", "."))
    if value is not None and np.isfinite(value):
        return value
    if re.search(r"(?i)\.(jpe?g|tiff?|png|dng)\b", line.text):
        raise line.wrong(
            "a photograph stands beside the point: this lists where points are seen, not where "
            "they are; give a gcp_list.txt (x y z column row image name), which says both"
        )
    if key in _PLACE or angle is None:
        return line.number(cell, "a coordinate")
    half = (angle[1] or angle[5]).upper()
    if half and (half in "NS") != (key == "lat"):
        raise line.wrong(f"{cell!r} stands in the column {key}; exchange lat and lon in the header")
    size = degrees([part for part in angle.group(2, 3, 4) if part], line.path, line.at, key)
    return -abs(size) if half and half in "SW" else size


def _sigmas(line: Line, cells: dict[str, str], exact: bool) -> list[float]:
    """sx, sy, sz of a row, NaN where unknown."""
    known = {}
    for key, cell in cells.items():
        value = line.number(cell, "a standard deviation") if cell else np.nan
        known[key] = value if value > 0 or exact and value == 0 else np.nan
    every = known.get("sxyz", np.nan)
    level = known.get("sxy", every)
    return [known.get("sx", level), known.get("sy", level), known.get("sz", every)]


def _role(line: Line, cell: str) -> str:
    role = role_of(cell)
    if role is None:
        near = did_you_mean(cell.lower(), ROLES)
        raise line.wrong(f"role {cell!r} is unknown{near}; write one of {', '.join(ROLES)}")
    return role


def _roles_of_type(cells: list[str], notes: list[str]) -> list[str] | None:
    """Roles from a column of types, where all of them are some; None elsewhere.

    CP beside GCP is a check point.
    """
    found = ["check" if _word(cell) == "cp" else role_of(cell) for cell in cells]
    if None in found or "check" not in found or "control" not in found:
        if any(_word(cell) == "cp" for cell in cells):
            notes.append(
                "types CP were not read: they may be control or check points; call the column "
                "role, with control or check in it"
            )
        return None
    notes.append(f"types were read as roles: {found.count('check')} check points")
    return [role for role in found if role]


def role_of(text: str) -> str | None:
    """The role that a text names, in any case; empty: control; None for a word that is not known.

    CP alone is not taken: it stands for control point and for check point.
    """
    word = _word(text)
    word = _ROLE.get(word, word)
    return word if word in ROLES else "control" if not word else None
