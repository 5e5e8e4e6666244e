"""Other forms of each kind of input: languages, units, axes, systems, and what editors leave.

The flight of `made`, also at other places on Earth, whose own systems its ground points are in.
Their coordinates come from PROJ itself, so that nothing of corridor is its own witness.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from benchmarks.tries.running import Try
from benchmarks.tries.strangers import _changed, _copy, _lines
from corridor.core.block import Block, read
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import Local

# Where the flight lies again, in the frame of each place.
PLACES = {
    "home": (49.01, 8.55), "china": (30.51, 114.02), "japan": (35.68, 139.55),
    "brazil": (-23.53, -46.61), "california": (38.52, -121.51), "england": (51.48, -1.02),
    "france": (48.85, 2.35), "korea": (37.5, 127.05), "poland": (52.2, 21.0),
    "norway": (59.9, 10.75), "australia": (-33.8, 151.1),
}  # fmt: skip
DEGREES, UTM = "EPSG:4979", "EPSG:25832"
FOOT, US_FOOT = 0.3048, 1200 / 3937


def _row(order: str, mark: str = ",", digits: int = 3, more: str = ""):
    """A row of name and coordinates: n the northing or latitude, e, h."""

    def written(name: str, *place: float) -> str:
        values = dict(zip("enh", place, strict=True))
        return mark.join([name, *(f"{values[axis]:.{digits}f}" for axis in order)]) + more

    return written


ENH, NEH, LAT = _row("enh"), _row("neh"), _row("neh", digits=9)
ENS, NES = _row("enh", ";"), _row("neh", ";")
# Kind, header, row, place, system of the numbers, system told, what must be said; empty: right.
HEADERS = (
    ("点号,X坐标,Y坐标,高程", NEH, "china", "EPSG:4547"),
    ("点名,北坐标(m),东坐标(m),大地高(m)", NEH, "china", "EPSG:4547"),
    ("点号,纬度B,经度L,大地高H", LAT, "china", DEGREES),
    ("점번호,X(북),Y(동),표고", NEH, "korea", "EPSG:5186"),
    ("Nr punktu;X;Y;H", NES, "poland", "EPSG:2178", "x and y are exchanged"),
    ("Nazwa;Północ;Wschód;Wysokość", NES, "poland", "EPSG:2178"),
    ("Punkt;Nord;Öst;Höjd", NES, "norway", UTM),
    ("Punktnavn;Nord;Øst;Høyde", NES, "norway", UTM),
    ("Ponto;Este (m);Norte (m);Altitude elipsoidal (m)", ENS, "brazil", "EPSG:31983"),
    ("Vértice;N (m);E (m);h (m)", NES, "brazil", "EPSG:31983"),
    ("Point;Abscisse;Ordonnée;Altitude", ENS, "france", "EPSG:2154"),
    ("Nom,Longitude (°),Latitude (°),Hauteur ellipsoïdale (m)", _row("enh", digits=9), "france", DEGREES),
    ("číslo bodu;Y;X;výška", ENS, "home", UTM, "x and y are exchanged"),
    ("Nokta No;Sağa (Y);Yukarı (X);Kot", ENS, "home", UTM),
    ("Piste;Pohjoinen;Itä;Korkeus", NES, "norway", UTM),
    ("Pontszám;Y (Kelet);X (Észak);Magasság", ENS, "home", UTM),
    ("Σημείο;Ανατολικά;Βόρεια;Υψόμετρο", ENS, "home", UTM),
    ("点名,X,Y,H", NEH, "japan", "EPSG:6677", "x and y are exchanged"),
    ("PNT,NORTH,EAST,ELEV,CODE", _row("neh", more=",GCP"), "home", UTM),
    ("Name,UTM Easting,UTM Northing,Ellipsoid height", ENH, "home", UTM),
    ("GCP Label,Pos X,Pos Y,Pos Z", ENH, "home", UTM),
    ("gcp_id,coord_e,coord_n,elev_m", ENH, "home", UTM),
    ("Name,GPS Latitude,GPS Longitude,GPS Altitude", LAT, "home", DEGREES),
    ("Name,Y(m),X(m),Z(m)", NEH, "home", UTM),
)  # fmt: skip


def _packed(angle: float) -> str:
    seconds = round(angle * 3600, 5)
    minutes, seconds = divmod(seconds, 60)
    return f"{int(minutes // 60)}.{int(minutes % 60):02d}{seconds * 1e5:07.0f}"


def _minutes(angle: float) -> str:
    return f"{100 * int(angle) + 60 * (angle % 1):.7f}"


def _told(head, row, said="", crs=UTM):
    return head, row, "home", crs, said


def _scaled(e=1.0, n=1.0, h=1.0, more="", digits=4):
    row = _row("enh", digits=digits, more=more)
    return lambda name, x, y, z: row(name, x / e, y / n, z / h)


def _angles(write):
    return lambda n, x, y, z: f"{n},{write(y)},{write(x)},{z:.3f}"


_HEAD, _GEO = "Name,E,N,H", "Name,lat,lon,h"
UNITS = (
    _told("Name,E (m),N (m),H (ft)", _scaled(h=FOOT), "gives the coordinates in ft"),
    _told("Name,E,N,Elevation_ft", _scaled(h=US_FOOT), "gives the coordinates in ft"),
    _told(_HEAD, _scaled(h=FOOT), "heights are in feet"),
    _told("Name,E [km],N [km],H [m]", _scaled(1e3, 1e3), "gives the coordinates in km"),
    _told(
        "P,E (US survey ft),N (US survey ft),H (US survey ft)",
        _scaled(*3 * [US_FOOT]),
        "in US survey ft",
    ),
    _told("Name,E,N,H,sE_mm,sN_mm,sH_mm", _scaled(more=",8,9,15")),
    _told("Name,E,N,H,sx (cm),sy (cm),sz (cm)", _scaled(more=",0.8,0.9,1.5")),
    _told(_GEO, _angles(lambda v: f"{np.radians(v):.12f}"), "are in radians", DEGREES),
    _told("Name,lat (gon),lon (gon),h", _angles(lambda v: f"{v / 0.9:.10f}"), "in gon", DEGREES),
    _told(_GEO, _angles(_packed), r"one number \(DD.MMSS\)", DEGREES),
    _told(_GEO, _angles(_minutes), r"one number \(DDMM.mmm\)", DEGREES),
)
# Place, system of the numbers, order, system told, what must be said.
SYSTEMS = (
    ("china", "EPSG:4547", ENH, "EPSG:4547"),
    ("china", "EPSG:4526", ENH, "EPSG:4526"),
    ("china", "EPSG:4526", ENH, "EPSG:4547", r"zone \(38\) stands before the easting"),
    ("china", DEGREES, _row("enh", digits=9), "EPSG:4490"),
    ("china", "EPSG:4547", NEH, "EPSG:4547", "x and y are exchanged"),
    ("japan", "EPSG:6677", ENH, "EPSG:6677"),
    ("japan", "EPSG:6677", NEH, "EPSG:6677", "x and y are exchanged"),
    ("japan", "EPSG:6677", ENH, "EPSG:6677+6695", "needs jp_gsi_gsigeo2011"),
    ("brazil", "EPSG:31983", ENH, "EPSG:31983"),
    ("brazil", "EPSG:31983", ENH, "EPSG:32623", "those of EPSG:32723"),
    ("brazil", "EPSG:31983", ENH, "", "give --ground-crs EPSG:32723"),
    ("brazil", "EPSG:31983", ENH, "urn:ogc:def:crs:EPSG::31983"),
    ("brazil", "EPSG:29193", ENH, "EPSG:29193"),
    ("brazil", "EPSG:4978", ENH, "EPSG:4978"),
    ("california", "EPSG:6418", _scaled(h=US_FOOT), "EPSG:6418"),
    ("california", "EPSG:6418", ENH, "EPSG:6418", "the heights are in metres, and EPSG:6418 counts"),
    ("california", "EPSG:6418", _scaled(h=US_FOOT), "EPSG:6417", "coordinates are in feet"),
    ("california", "EPSG:6417", ENH, "EPSG:6418", "outside the area of use"),
    ("england", "EPSG:27700", ENH, "EPSG:27700"),
    ("england", "EPSG:27700", ENH, "EPSG:27700+5701", "needs uk_os_OSGM15_GB"),
    ("france", "EPSG:3949", ENH, "EPSG:3949"),
    ("france", "EPSG:3949", ENH, "EPSG:3950", "outside the area of use"),
    ("korea", "EPSG:5186", ENH, "EPSG:5187", "km from where the rays|not in one system"),
    ("poland", "EPSG:2178", NEH, "EPSG:2178", "x and y are exchanged"),
    ("australia", "EPSG:7856", ENH, "'GDA2020 / MGA zone 56'"),
)  # fmt: skip


def _third(change):
    return lambda rows: [*rows[:3], change(rows[3]), *rows[4:]]


def _each(change):
    return lambda rows: [rows[0], *map(change, rows[1:])]


def _no_height(mark: str):
    return _third(lambda row: f"{row.rpartition(',')[0]},{mark}")


_QUOTED = _each(lambda row: ",".join(f'"{cell}"' for cell in row.split(",")))
# Ending of the file, change of the lines `Name,E,N,H`, end of a line, encoding, what is said.
SYNTAX = (
    ("csv", _QUOTED, "\r\n", "utf-8-sig", ""),
    ("csv", lambda rows: rows, "\r", "utf-8", ""),
    ("csv", lambda rows: rows, "\r\n", "utf-16", ""),
    ("csv", lambda rows: [row.replace(",", "\u00a0;\u00a0") for row in rows], "\n", "utf-8", ""),
    ("csv", _each(lambda row: row.replace(",", ",+")),
     "\n", "utf-8", ""),
    ("csv", lambda rows: [*(f"{row},,," for row in rows), ",,,,,,", ",,,,,,"], "\n", "utf-8", ""),
    ("csv", lambda rows: [*rows[:3], "# second day", "", *rows[3:5], "// more", *rows[5:]], "\n",
     "utf-8", ""),
    ("csv", lambda rows: [rows[0], ",m,m,m", *rows[1:]], "\n", "utf-8", ""),
    ("csv", lambda rows: [row.replace(",", "|") for row in rows], "\n", "utf-8", ""),
    ("md", lambda rows: ["| Name | E | N | H |", "|---|--:|--:|--:|",
                         *(f"| {row.replace(',', ' | ')} |" for row in rows[1:])], "\n", "utf-8", ""),
    ("csv", _each(lambda row: '="' + row.replace(",", '",', 1)), "\n", "utf-8", ""),
    ("csv", lambda rows: [*rows, rows[1].replace("G01", "g01")], "\n", "utf-8", "+G01, g01 differ in case"),
    ("csv", lambda rows: [*rows, rows[1].replace("G01", "G 01")], "\n", "utf-8", "+differ in case or blanks"),
    ("csv", _no_height("-9999"), "\n", "utf-8", "line 4: point G03 has no coordinates"),
    ("csv", _third(lambda row: "G03,0,0,0"), "\n", "utf-8", "line 4: point G03 has no coordinates"),
    ("csv", _no_height("-"), "\n", "utf-8", "line 4: .*not a number"),
    ("csv", _no_height(""), "\n", "utf-8", "line 4: .*fill in what is"),
    ("csv", lambda rows: [*rows[:4], rows[0], *rows[4:]], "\n", "utf-8", "line 5: .*not a number"),
    ("csv", _each(lambda row: row.replace(",", " m,")), "\n", "utf-8", "not a number"),
)  # fmt: skip
_NAMED = _row("enh")


def make(home: Path) -> None:
    """All of them below a folder in which `made.make` has been."""
    (home / "forms").mkdir(exist_ok=True)
    for name, (lat, lon) in PLACES.items():
        folder = _copy(home, "opensfm", f"at_{name}")
        # Where the ground points lie is what the tables say.
        unplaced = re.compile(r',\s*"position": \{[^}]*\}')
        _changed(folder / "ground_control_points.json", lambda t, gone=unplaced: gone.sub("", t))
        at = f'"latitude": {lat}, "longitude": {lon}'
        for file in ("reference_lla.json", "reconstruction.json"):
            other = re.compile(r'"latitude": 49.01,\s*"longitude": 8.55')
            _changed(folder / file, lambda t, old=other, new=at: old.sub(new, t))
    for kind, tables in (("h", HEADERS), ("u", UNITS)):
        for k, (head, row, place, crs, *_) in enumerate(tables):
            rows = [row(*point) for point in _points(home, place, crs)]
            _lines(home / "forms" / f"{kind}{k}.csv", head, *rows)
    for k, (place, crs, row, *_) in enumerate(SYSTEMS):
        _lines(home / "forms" / f"c{k}.csv", *(row(*point) for point in _points(home, place, crs)))
    rows = [_HEAD, *(_NAMED(*point) for point in _points(home, "home", UTM))]
    for k, (ending, change, end, encoding, _) in enumerate(SYNTAX):
        text = end.join([*change(rows), ""])
        (home / "forms" / f"s{k}.{ending}").write_bytes(text.encode(encoding))
    for name, (file, change, *_) in BLOCKS.items():
        _changed(_copy(home, "own", f"fb_{name}") / file, change)
    for name in CONVENTIONS:
        _convention(home, name)
    for name in PHOTOGRAPHS:
        _photographs(home, name)
    for name, (project, files, change, *_) in PROJECTS.items():
        folder = _copy(home, project, f"fp_{name}")
        for file in files:
            (folder / file).write_bytes(change((folder / file).read_bytes()))


@lru_cache
def _block(folder: Path) -> Block:
    return read(folder)


@lru_cache
def _points(home: Path, place: str, crs: str) -> list[tuple[str, float, float, float]]:
    own = _block(home / "own")
    there = Local(*PLACES[place]).to_geographic(own.numbers("ground", *"xyz"))
    places = np.column_stack(Transformer.from_crs(DEGREES, crs, always_xy=True).transform(*there.T))
    return [(str(n), *map(float, p)) for n, p in zip(own.ground["point"], places, strict=True)]


# --- options of a block, marks and cameras ------------------------------------------------------


def _arm(text: str):
    return lambda t: f"{t}\n[lever_arm]\n{text}\n"


def _swap(old: str, new: str):
    return lambda t: t.replace(old, new)


def _marks(change):
    """Every row of marks.csv with other x and y, px of a picture of 1056 x 792."""

    def changed(text: str) -> str:
        head, *rows = text.splitlines()
        cells = [row.split(",") for row in rows]
        new = [(*c[:2], *map(str, change(float(c[2]), float(c[3])))) for c in cells]
        return "\n".join([head, *map(",".join, new), ""])

    return changed


def _sigmas(*of_axes: float):
    """The same standard deviations in every row of a table."""
    more = ",".join(map(str, of_axes))

    def changed(text: str) -> str:
        head, *rows = text.splitlines()
        return "\n".join([f"{head},sx,sy,sz", *(f"{row},{more}" for row in rows), ""])

    return changed


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n"
_T = "block.toml"
# Name: file, change, kind, status, what is said.
BLOCKS = {
    "arm_mm": (_T, _arm("default = [0.0, 20.0, 35.0]"), "lever arms", 0, "lever arms are in metres"),
    "arm_held": (_T, _arm("default = [0, 20, 35]\nfixed = true"), "lever arms", 0, "arms are in metres"),
    "arm_cm": (_T, _arm("F1 = [0.0, 2.0, -12.0]"), "lever arms", 0, "lever arms are in metres"),
    "arm_text": (_T, _arm('default = "0 0.02 0.12"'), "lever arms", 2, "not three numbers"),
    "arm_unit": (_T, _arm('default = [0, 20, 120]\nunit = "mm"'), "lever arms", 2, "unit is no flight"),
    "arm_key": (_T, _arm("default_mm = [0.0, 20.0, 120.0]"), "lever arms", 2, "z] in metres"),
    "sigma_key": (_T, _swap("gnss_m", "gnss_mm"), "lever arms", 2, "has no gnss_mm"),
    "f_mm": (_T, _swap("f = 976.0", "f = 12.29"), "cameras", 0, "f is in pixels"),
    "f_35": (_T, _swap("f = 976.0", "f = 33.3"), "cameras", 0, "f is in pixels"),
    "f_minus": (_T, _swap("f = 976.0", "f = -976.0"), "cameras", 2, "not positive"),
    "middle": (_T, _swap("cx = 527.5", "cx = 0.003"), "cameras", 0, "counted from the middle"),
    "pixel_m": (_T, _swap("f = 976.0", "f = 976.0\npixel_um = 3.3e-6"), "cameras", 0, "micrometres"),
    "upright": (_T, _swap("width = 1056\nheight = 792", "width = 792\nheight = 1056"),
                "cameras", 0, "outside (its|their) picture"),
    "bom": (_T, lambda t: "\ufeff" + t.replace("\n", "\r\n"), "cameras", 0, "29 images"),
    "marks_up": ("marks.csv", _marks(lambda x, y: (x, 791 - y)), "marks", 0, "y were counted upwards"),
    "marks_mm": ("marks.csv", _marks(lambda x, y: ((x - 527.5) * 0.0044, (y - 395.5) * 0.0044)),
                 "marks", 0, "from the middle, in a unit of 227.3 px"),
    "marks_share": ("marks.csv", _marks(lambda x, y: ((x - 527.5) / 1056, (395.5 - y) / 1056)),
                    "marks", 0, "y upwards, in a unit of 1056 px"),
    "marks_percent": ("marks.csv", _marks(lambda x, y: (x / 10.56, y / 7.92)), "marks", 0, "one factor"),
    "marks_quarter": ("marks.csv", _marks(lambda x, y: (x / 4, y / 4)), "marks", 0, "by 3.9"),
    "marks_swapped": ("marks.csv", _marks(lambda x, y: (y, x)), "marks", 0, "x and y were exchanged"),
    "marks_names": ("marks.csv", _swap("\nG0", "\ng 0"), "marks", 0, "Is 'G01' of ground.csv 'g 01'"),
    "marks_comma": ("marks.csv", lambda t: t.replace(".JPG", "#").replace(",", ";").replace(".", ",")
                    .replace("#", ".JPG"), "marks", 0, "51 marks"),
    "sigma_gnss_mm": (_T, _swap("gnss_m = [0.01, 0.01, 0.02]", "gnss_m = [10, 10, 20]"),
                      "standard deviations", 0, "GNSS positions are stated to 10 m"),
    "sigma_gnss_cm": ("gnss.csv", _sigmas(1.0, 1.0, 2.0), "standard deviations", 0, "stated to 1 m"),
    "sigma_ground_mm": ("ground.csv", _sigmas(5.0, 5.0, 8.0), "standard deviations", 0,
                        "ground points are stated to 5 m"),
    "sigma_ground_cm": (_T, _swap("control_m = [0.005, 0.005, 0.005]", "control_m = 0.5"),
                        "standard deviations", 0, "ground points are stated to 0.5 m"),
    "lfs": ("tie_points.csv", lambda _: POINTER, "files that are something else", 2, "git lfs pull"),
    "workbook": ("images.csv", lambda _: "PK\3\4 and more", "files that are something else", 2,
                 "images.csv is an Excel workbook"),
    "page": ("ground.csv", lambda _: "<!DOCTYPE html><html></html>",
             "files that are something else", 2, "ground.csv is a page of the web"),
    "marks_nbsp": ("marks.csv", _swap("G01,", "G01\u00a0,"), "marks", 2, "row 2: .* blanks around it"),
}  # fmt: skip

# --- poses as text with a convention ------------------------------------------------------------

_OPK, _POK = "omega phi kappa", "phi omega kappa"
# Name: angles and unit told, what is written (order, factor of radians), unit of marks, status, says.
CONVENTIONS = {
    "gon": (_OPK, "gon", "XYZ", 200 / np.pi, "mm", 0, "0.39 px"),
    "grad": (_OPK, "grad", "XYZ", 200 / np.pi, "mm", 0, "0.39 px"),
    "degrees": ("Omega-Phi-Kappa", "Degrees", "XYZ", 180 / np.pi, "mm", 0, "0.39 px"),
    "radians": (_POK, "radians", "YXZ", 1.0, "mm", 0, "0.39 px"),
    "microns": (_POK, "gon", "YXZ", 200 / np.pi, "µm", 0, "0.39 px"),
    "quoted": (_OPK, "deg", "XYZ", 180 / np.pi, "mm", 0, "2,248 tie observations"),
    "semicolons": (_OPK, "deg", "XYZ", 180 / np.pi, "mm", 0, "2,248 tie observations"),
    "cc": (_OPK, "cc", "XYZ", 2e6 / np.pi, "mm", 2, "unit is 'cc'; write"),
    "roll": ("roll pitch yaw", "deg", "XYZ", 180 / np.pi, "mm", 2, "write .omega phi kappa"),
    "gon_as_deg": (_OPK, "deg", "XYZ", 200 / np.pi, "mm", 2, 'unit = "gon" would explain'),
    "deg_as_gon": (_OPK, "gon", "XYZ", 180 / np.pi, "mm", 2, 'unit = "deg" would explain'),
    "clockwise": (_OPK, "deg", "XYZ", -180 / np.pi, "mm", 2, "do not reproject"),
    "f_mm": (_OPK, "deg", "XYZ", 180 / np.pi, "mm", 2, "f is in pixels, 4.29 mm are 975"),
}  # fmt: skip


def _convention(home: Path, name: str) -> None:
    angles, unit, order, factor, marked, *_ = CONVENTIONS[name]
    block, folder = _block(home / "utm"), home / f"cv_{name}"
    folder.mkdir(exist_ok=True)
    flip = np.diag([1.0, -1.0, -1.0])
    turned = (flip @ rotation_from_quaternion(block.poses[:, 3:])).transpose(0, 2, 1)
    written = factor * Rotation.from_matrix(turned).as_euler(order)
    images = block.images["image"].astype(str)
    mark, quote = (";" if name == "semicolons" else " "), '"' * (name == "quoted")
    rows = [
        mark.join(
            [f"{quote}{image}{quote}", *(f"{v:.4f}" for v in pose), *(f"{v:.9f}" for v in turn)]
        )
        for image, pose, turn in zip(images, block.poses[:, :3], written, strict=True)
    ]
    _lines(folder / "poses.txt", *rows)
    scale, rows = (0.0044 if marked == "mm" else 4.4), []
    for image, mine in block.tie_points.groupby("image", observed=True):
        rows.append(str(image))
        for point, x, y in mine[["point", "x", "y"]].itertuples(index=False):
            rows.append(f"{point} {(x - 527.5) * scale:.6f} {(395.5 - y) * scale:.6f}")
        rows.append("-99")
    _lines(folder / "image.dat", *rows)
    _lines(folder / "convention.toml",
        f'[measurements]\nfile = "image.dat"\nunit = "{marked}"\norigin = "principal point"\ny = "up"',
        f'[poses]\nfile = "poses.txt"\nangles = "{angles}"\nunit = "{unit}"\ncrs = "{UTM}"',
        f"[camera.c]\nwidth = 1056\nheight = 792\nf = {4.29 if name == 'f_mm' else 976.0}\npixel_um = 4.4",
    )  # fmt: skip


# --- photographs --------------------------------------------------------------------------------


def _put(ifd: str, **tags):
    """Tags of the photograph's own or its GPS directory, as functions of what is there."""
    return ifd, {int(tag[1:]): value for tag, value in tags.items()}


_XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-'
    'syntax-ns#"><rdf:Description xmlns:d="http://made/1.0/" {}/></rdf:RDF></x:xmpmeta>'
)
_OFF_M = 160.0  # height of the take-off above the ellipsoid


def _height(change, side: int = 0, **xmp):
    """EXIF's height, its sign (1: below the sea) and heights of XMP, as functions of the true."""
    return "gps", {6: change, 5: lambda _: side.to_bytes()}, xmp


# Name: directory and its new tags, what the import must say.
PHOTOGRAPHS = {
    "f35_right": (_put("own", _41989=lambda v: 33), "f stated 987 ., 26 px|f stated 987"),
    "f35_wide": (_put("own", _41989=lambda v: 24), "f stated 718 .* the project has 976 px"),
    "f35_half": (_put("own", _41989=lambda v: 16), "f stated 479 .* the project has 976 px"),
    "f35_lens": (_put("own", _41989=lambda v: 12), "f stated 359 .* the project has 976 px"),
    "f35_none": (_put("own", _41989=lambda v: 0), "29 positions"),
    "south": (_put("gps", _1=lambda v: "S"), "the cameras look up"),
    "no_half": (_put("gps", _3=lambda v: ""), "photographs have no positions"),
    "dashes": (_put("own", _36867=lambda v: v.replace(":", "-", 2).replace(" ", "T")), "29 positions"),
    "no_date": (_put("own", _36867=lambda v: "0000:00:00 00:00:00"), "is not a date"),
    "one_time": (_put("own", _36867=lambda v: "1970:01:01 00:00:00"), "all photographs have one time"),
    "one_place": (_put("gps", _2=lambda v: (49.01, 0.0, 0.0), _4=lambda v: (8.55, 0.0, 0.0),
                       _6=lambda v: 210.0), "positions of the photographs are the same"),
    "minutes": (_put("gps", _2=lambda v: (49.0, 60 * (v[0] - 49), 0.0)), "29 positions"),
    "h_right": (_height(lambda h: h), "the ground lies at 160 m, 50 m below .* compare with a map"),
    "h_feet": (_height(lambda h: h / FOOT), "the ground lies at 6.. m, .* compare with a map"),
    "h_off": (_height(lambda h: h - _OFF_M), "and the cameras 50 m above it: do they count from the"),
    "h_off_xmp": (_height(lambda h: h - _OFF_M, RelativeAltitude=lambda h: h - _OFF_M + 0.3),
                  r"are their heights above the take-off \(XMP says 50"),
    "h_off_feet": (_height(lambda h: (h - _OFF_M) / FOOT), "16. feet: are they in feet"),
    "h_off_xmp_feet": (_height(lambda h: (h - _OFF_M) / FOOT, RelativeAltitude=lambda h: h - _OFF_M),
                       "heights above the take-off in feet"),
    "h_off_both": (_height(lambda h: h, AbsoluteAltitude=lambda h: h - _OFF_M,
                           RelativeAltitude=lambda h: h - _OFF_M), "above the take-off .XMP says 50"),
    "h_sea": (_height(lambda h: h - 47.9, AbsoluteAltitude=lambda h: h),
              "heights -47.9 m .median. from those of XMP.* above the sea"),
    "h_xmp": (_height(lambda h: h / FOOT, AbsoluteAltitude=lambda h: h), "EXIF's are in feet"),
    "h_below": (_height(lambda h: h, side=1), "ground lies at -2.. m, where no land is"),
    "h_mm": (_height(lambda h: h * 1e3), "where no land is"),
    "h_zero": (_height(lambda h: 0.0), "all heights of the photographs are 0"),
    "h_parrot": (_height(lambda h: h - _OFF_M, AboveGroundAltitude=lambda h: h - _OFF_M),
                 "heights above the take-off"),
}  # fmt: skip


def _photographs(home: Path, name: str) -> None:
    (which, changes, *written), _ = PHOTOGRAPHS[name]
    block, folder = _block(home / "own"), home / f"ph_{name}"
    folder.mkdir(exist_ok=True)
    picture = Image.fromarray(np.full((396, 528), 128, np.uint8))
    places = Local(*PLACES["home"]).to_geographic(block.poses[:, :3])
    for row, (lon, lat, height) in zip(block.images.itertuples(), places.tolist(), strict=True):
        exif = Image.Exif()
        own, gps = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
        when = datetime(2024, 5, 12) + timedelta(seconds=float(row.time_s))
        own.update({36867: when.strftime("%Y:%m:%d %H:%M:%S"), 37386: 12.29})
        gps.update({1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 6: height})
        table = own if which == "own" else gps
        table.update({tag: change(table.get(tag)) for tag, change in changes.items()})
        tags = (f'd:{key}="{of(height):+.3f}"' for key, of in dict(*written).items())
        more = {"xmp": _XMP.format(" ".join(tags)).encode()} if any(written) else {}
        picture.save(folder / str(row.image), exif=exif, quality=30, **more)


# --- projects -----------------------------------------------------------------------------------

_META = ("cameras.xml", "markers.xml")
_COLMAP = ("cameras.txt", "images.txt", "points3D.txt")


def _bytes(change):
    return lambda data: change(data.decode()).encode()


def _in_system(code: str):
    return _bytes(
        lambda t: re.sub("(?s)<reference>.*?</reference>", f"<reference>{code}</reference>", t)
    )


# Name: project, files, change of their bytes, status, what is said.
PROJECTS = {
    "ms_bom": ("metashape", _META, lambda data: b"\xef\xbb\xbf" + data, 0, "51 marks"),
    "ms_crlf": ("metashape", _META, lambda data: data.replace(b"\n", b"\r\n"), 0, "51 marks"),
    "ms_blank": ("metashape", _META, _bytes(lambda t: t.replace('"G02"', '"G02 "')), 0, "51 marks"),
    "ms_jgd": ("metashape", _META, _in_system("EPSG:6667"), 0, "51 marks"),
    "ms_china": ("metashape", _META, _in_system("EPSG:4490"), 0, "51 marks"),
    "ms_nad": ("metashape", _META, _in_system("EPSG:6318"), 0, "of another place.*United States"),
    "ms_gda": ("metashape", _META, _in_system("EPSG:4283"), 0, "of another place.*Australia"),
    "bg_albers": ("cv_degrees", ("convention.toml",),
                  _bytes(lambda t: t.replace("25832", "3577")), 0, "of another place"),
    "ms_page": ("metashape", _META[:1], lambda _: b"<html>Sign in</html>", 2, "a page of the web"),
    "cm_pointer": ("colmap-text", _COLMAP[2:], lambda _: POINTER.encode(), 2, "points3D.txt .*lfs pull"),
    "os_pointer": ("opensfm", ("reconstruction.json",), lambda _: POINTER.encode(), 2, "lfs pull"),
    "p4_empty": ("pix4d", ("s_tp_bingo.txt",), lambda _: b"", 2, "s_tp_bingo.txt is empty"),
    "p4_page": ("pix4d", ("s_tp_bingo.txt",), lambda _: b"<!doctype html>", 2, "a page of the web"),
    "ms_f": ("metashape", _META, _bytes(lambda t: re.sub("<f>[^<]*", "<f>4.29", t)), 2, "f is in pixels"),
    "ms_comma": ("metashape", _META, _bytes(lambda t: re.sub(r"(\d)\.(\d+ )", r"\1,\2", t)), 2, ""),
    "cm_bom": ("colmap-text", _COLMAP, lambda data: b"\xef\xbb\xbf" + data, 0, "2,248 tie"),
    "cm_crlf": ("colmap-text", _COLMAP, lambda data: data.replace(b"\n", b"\r\n"), 0, "2,248 tie"),
    "cm_f": ("colmap-text", _COLMAP[:1], _bytes(lambda t: t.replace("976.0", "4.29")), 2, "in pixels"),
    "p4_crlf": ("pix4d", ("s_calibrated_camera_parameters.txt", "s_tp_bingo.txt"),
                lambda data: data.replace(b"\n", b"\r\n"), 0, "2,248 tie"),
    "p4_comma": ("pix4d", ("s_calibrated_camera_parameters.txt",),
                 _bytes(lambda t: re.sub(r"(\d)\.(\d)", r"\1,\2", t)), 2, ""),
    "os_lla": ("opensfm", ("reconstruction.json",),
               _bytes(lambda t: t.replace('"latitude": 49.01', '"latitude": "49.01"')), 2, ""),
}  # fmt: skip


# --- the tries ----------------------------------------------------------------------------------


def _of_ground(kind: str, letter: str, tables) -> Iterator[Try]:
    for k, (_, _, place, crs, *said) in enumerate(tables):
        words = f"import auto {{w}}/at_{place} -o {{o}}/b --ground {{w}}/forms/{letter}{k}.csv"
        words += "" if crs == DEGREES else f" --ground-crs {crs}"
        yield _try(f"{letter}{k}", words, said[0] if said else "", kind)


def _try(number: str, words: str, said: str, kind: str) -> Try:
    """Refused with what is said, or right where nothing is or what begins with a plus."""
    refused = bool(said) and not said.startswith("+")
    return Try(number, words, 2 * refused, said.removeprefix("+"), kind=kind, here=not refused)


def _listed() -> Iterator[Try]:
    yield from _of_ground("words of a header", "h", HEADERS)
    yield from _of_ground("units and angles of ground points", "u", UNITS)
    for k, (place, _, _, told, *said) in enumerate(SYSTEMS):
        words = f"import auto {{w}}/at_{place} -o {{o}}/b --ground {{w}}/forms/c{k}.csv"
        words += f" --ground-crs {told}" if told else ""
        yield _try(f"c{k}", words, said[0] if said else "", "coordinate systems and heights")
    for k, (ending, _, _, _, said) in enumerate(SYNTAX):
        words = f"import auto {{w}}/at_home -o {{o}}/b --ground {{w}}/forms/s{k}.{ending}"
        yield _try(f"s{k}", f"{words} --ground-crs {UTM}", said, "cells, rows and encodings")
    for name, (_, _, kind, status, said) in BLOCKS.items():
        yield Try(name, f"summary {{w}}/fb_{name}", status, said, kind=kind)
    for name, (*_, status, said) in CONVENTIONS.items():
        words = f"import auto {{w}}/cv_{name} -o {{o}}/b"
        yield Try(f"cv_{name}", words, status, said, kind="conventions of angles")
    for name, (_, said) in PHOTOGRAPHS.items():
        words = f"import colmap {{w}}/colmap_free --photos {{w}}/ph_{name} -o {{o}}/b"
        yield Try(f"ph_{name}", words, 0, said, kind="photographs, EXIF and times")
    for name, (*_, status, said) in PROJECTS.items():
        words = f"import auto {{w}}/fp_{name} -o {{o}}/b"
        yield Try(name, words, status, said, kind="projects of other programs")


FORMS = tuple(_listed())
