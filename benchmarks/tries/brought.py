"""Tables and projects as offices of other countries, receivers and later versions write them.

The flight of `made` again; what a surveyor expects of each stands beside it.
"""

from __future__ import annotations

import gzip
import re
import zipfile
from pathlib import Path

from benchmarks.tries.forms import DEGREES, UTM, _points
from benchmarks.tries.running import Try
from benchmarks.tries.strangers import _changed, _copy


def _in_digits(text: str, zero: int) -> str:
    return text.translate({ord("0") + k: zero + k for k in range(10)})


def _grouped(value: float, thousands: str, point: str) -> str:
    return f"{value:,.3f}".replace(",", "#").replace(".", point).replace("#", thousands)


def _table(head: str, mark: str, order: str, write) -> list[str]:
    """Lines of a table; write: a cell of a number; order: n the northing, e, h."""

    def lines(points) -> list[str]:
        rows = []
        for name, *place in points:
            values = dict(zip("enh", place, strict=True))
            rows.append(mark.join([name, *(write(values[axis]) for axis in order)]))
        return [head, *rows]

    return lines


def _plain(value: float) -> str:
    return f"{value:.3f}"


def _comma(value: float) -> str:
    return f"{value:.3f}".replace(".", ",")


def _sexagesimal(value: float) -> str:
    minutes, seconds = divmod(round(abs(value) * 3600, 5), 60)
    return f"{int(minutes // 60)}°{int(minutes % 60):02d}'{seconds:08.5f}\""


def _geographic(head: str, mark: str, angle, height=_plain):
    """Rows of name, latitude, longitude, height."""

    def lines(points) -> list[str]:
        return [head, *(mark.join([n, *angle(y, x), height(z)]) for n, x, y, z in points)]

    return lines


def _signed(y: float, x: float) -> list[str]:
    return [f"{value:.9f}".replace("-", "\u2212") for value in (y, x)]


# Name: lines of points, system of the numbers, place, encoding, system told, what is said; a
# sentence that begins with ! is that of a refusal.
GROUND = {
    "fullwidth": (_table("点名,E,N,H", ",", "enh", lambda v: _in_digits(_plain(v), 0xFF10)), UTM, "home", "utf-8", UTM, ""),
    "fullwidth_sjis": (_table("点名,東,北,標高", ",", "enh", lambda v: _in_digits(_plain(v), 0xFF10).replace(".", "．")), UTM, "home", "cp932", UTM, "!save the file as UTF-8"),
    "thai": (_table("จุด,ตะวันออก,เหนือ,ความสูง", ",", "enh", _plain), UTM, "home", "utf-8-sig", UTM, ""),
    "thai_digits": (_table("Name,E,N,H", ",", "enh", lambda v: _in_digits(_plain(v), 0x0E50)), UTM, "home", "utf-8-sig", UTM, ""),
    "fullwidth_points": (_table("点名,東,北,標高", ",", "enh", lambda v: _in_digits(_plain(v), 0xFF10).replace(".", "．")), UTM, "home", "utf-8", UTM, ""),
    "turkish": (_table("Nokta Adı;Doğu;Kuzey;Yükseklik", ";", "enh", _comma), UTM, "home", "utf-8", UTM, ""),
    "russian": (_table("Имя;Север;Восток;Высота", ";", "neh", _comma), UTM, "home", "utf-8", UTM, ""),
    "thai_code_page": (_table("จุด,ตะวันออก,เหนือ,ความสูง", ",", "enh", _plain), UTM, "home", "cp874", UTM, "!save the file as UTF-8"),
    "arabic_digits": (_table("Name;E;N;H", ";", "enh", lambda v: _in_digits(_plain(v), 0x0660).replace(".", "٫")), UTM, "home", "utf-8", UTM, ""),
    "minus": (_geographic("Name,lat,lon,h", ",", _signed), DEGREES, "brazil", "utf-8", DEGREES, ""),
    "minus_dash": (_geographic("Name,lat,lon,h", ",", lambda y, x: [v.replace("\u2212", "\u2013") for v in _signed(y, x)]), DEGREES, "brazil", "utf-8", DEGREES, ""),
    "narrow_space": (_table("Point;Est;Nord;Altitude", ";", "enh", lambda v: _grouped(v, "\u202f", ",")), UTM, "home", "utf-8-sig", UTM, ""),
    "thin_space": (_table("Point;Est;Nord;Altitude", ";", "enh", lambda v: _grouped(v, "\u2009", ",")), UTM, "home", "utf-8-sig", UTM, ""),
    "no_break_1252": (_table("Point;Est;Nord;Altitude", ";", "enh", lambda v: _grouped(v, "\u00a0", ",")), UTM, "home", "cp1252", UTM, ""),
    "german_dots": (_table("Punktnummer;Rechtswert;Hochwert;Höhe", ";", "enh", lambda v: _grouped(v, ".", ",")), UTM, "home", "cp1252", UTM, ""),
    "swiss_apostrophe": (_table("Nr;E;N;H", ";", "enh", lambda v: _grouped(v, "\u2019", ".")), UTM, "home", "utf-8", UTM, ""),
    "swiss_typewriter": (_table("Nr;E;N;H", ";", "enh", lambda v: _grouped(v, "'", ".")), UTM, "home", "utf-8", UTM, ""),
    "indian": (_table("Name;E;N;H", ";", "enh", lambda v: re.sub(r"(\d)(?=(\d\d)+\d{3}\.)", r"\1,", _plain(v)) if v < 1000 else re.sub(r"(\d)(?=(\d\d)*\d{3}\.)", r"\1,", _plain(v))), UTM, "home", "utf-8", UTM, ""),
    "polish_1250": (_table("Nr pkt;Północ;Wschód;Wysokość", ";", "neh", _comma), UTM, "home", "cp1250", UTM, "!save the file as UTF-8"),
    "turkish_1254": (_table("Nokta Adı;Doğu;Kuzey;Yükseklik", ";", "enh", _comma), UTM, "home", "cp1254", UTM, "!save the file as UTF-8"),
    "russian_1251": (_table("Имя;Север;Восток;Высота", ";", "neh", _comma), UTM, "home", "cp1251", UTM, "!save the file as UTF-8"),
    "chinese_gbk": (_table("点名,东坐标,北坐标,高程", ",", "enh", _plain), UTM, "home", "gbk", UTM, "!save the file as UTF-8"),
    "unicode_text": (_table("Punkt\tOst\tNord\tHöhe", "\t", "enh", _comma), UTM, "home", "utf-16", UTM, ""),
    "utf16_no_mark": (_table("Name,E,N,H", ",", "enh", _plain), UTM, "home", "utf-16-le", UTM, ""),
    "exponent_comma": (_table("Name;E;N;H", ";", "enh", lambda v: f"{v:.9E}".replace(".", ",")), UTM, "home", "utf-8", UTM, ""),
    "degree_signs": (_geographic("Name;Latitude;Longitude;Ell.Height(m)", ";", lambda y, x: [_sexagesimal(y) + "N", _sexagesimal(x) + "E"]), DEGREES, "home", "utf-8", DEGREES, ""),
    "degree_primes": (_geographic("Name;Latitude;Longitude;Ell.Height(m)", ";", lambda y, x: [v.replace("'", "\u2032").replace('"', "\u2033") for v in ("N " + _sexagesimal(y), "E " + _sexagesimal(x))]), DEGREES, "home", "utf-8", DEGREES, ""),
    "degree_comma": (_geographic("Name;Breite;Länge;Höhe", ";", lambda y, x: [f"{v:.9f}".replace(".", ",") for v in (y, x)], _comma), DEGREES, "home", "cp1252", DEGREES, ""),
    "emlid_flow": (lambda points: [
        "Name,Code,Code description,Easting,Northing,Elevation,Description,Longitude,Latitude,Ellipsoidal height,Origin,Tilt angle,Easting RMS,Northing RMS,Elevation RMS,Lateral RMS,Antenna height,Solution status,CS name",
        *(f"{n},,,{x:.3f},{y:.3f},{z:.3f},,,,,Global,,0.008,0.007,0.015,0.011,1.8,FIX,ETRS89 / UTM zone 32N" for n, x, y, z in points)], UTM, "home", "utf-8-sig", UTM, ""),
    "carlson": (lambda points: ["Point,Northing,Easting,Elevation,Description", *(f"{n},{y:.3f},{x:.3f},{z:.3f},GCP /HRMS:0.010" for n, x, y, z in points)], UTM, "home", "utf-8", UTM, ""),
    "two_heights": (lambda points: ["Name,E,N,H ortho,h ellips", *(f"{n},{x:.3f},{y:.3f},{z - 47.9:.3f},{z:.3f}" for n, x, y, z in points)], UTM, "home", "utf-8", UTM, "!"),
    "whole_rows_quoted": (lambda points: ['"Name,E,N,H"', *(f'"{n},{x:.3f},{y:.3f},{z:.3f}"' for n, x, y, z in points)], UTM, "home", "utf-8", UTM, ""),
}  # fmt: skip

_KML = ('<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>G01'
        '</name><Point><coordinates>8.55,49.01,160</coordinates></Point></Placemark></Document></kml>')  # fmt: skip
# Name, text of a file that is no table, what is said of it.
NO_TABLES = {
    "points.kml": (_KML, "map"),
    "points.gpx": ('<?xml version="1.0"?><gpx version="1.1"><wpt lat="49.01" lon="8.55"><name>G01</name></wpt></gpx>', "map"),
    "job.jxl": ('<?xml version="1.0"?><JOBFile jobName="a"><FieldBook><PointRecord/></FieldBook></JOBFile>', "surveying instrument"),
    "site.xml": ('<?xml version="1.0"?><LandXML version="1.2"><CgPoints><CgPoint name="G01">5428690 467112 160</CgPoint></CgPoints></LandXML>', "surveying instrument"),
    "points.dxf": ("0\nSECTION\n2\nENTITIES\n0\nPOINT\n10\n467112.1\n20\n5428690.2\n30\n160.0\n0\nENDSEC\n0\nEOF\n", "is a map"),
    "job.rw5": ("JB,NMjob,DT05-14-2024,TM08:20:00\nMO,AD0,UN1,SF1.00000000,EC0,EO0.0,AU0\nSP,PNG01,N 5428690.2,E 467112.1,EL160.0,--GCP\n", "surveying instrument"),
}  # fmt: skip


def _ecef(row: list[str]) -> str:
    from pyproj import Transformer

    way = Transformer.from_crs(DEGREES, "EPSG:4978", always_xy=True)
    xyz = way.transform(float(row[3]), float(row[2]), float(row[4]))
    return " ".join([*row[:2], *(f"{v:.4f}" for v in xyz), *row[5:]])


def _as_dms(row: list[str]) -> str:
    angles = []
    for cell in row[2:4]:
        minutes, seconds = divmod(float(cell) * 3600, 60)
        angles.append(f"{int(minutes // 60)} {int(minutes % 60):02d} {seconds:08.5f}")
    return " ".join([*row[:2], *angles, *row[4:]])


_HEAD = "%  GPST                  latitude(deg) longitude(deg)  height(m)"
# Name: header in place of _HEAD, row, status, what is said.
TRACKS = {
    "ecef": ("%  GPST                  x-ecef(m)      y-ecef(m)      z-ecef(m)", _ecef, 0, ""),
    "dms": ("%  GPST                  latitude(d'\")   longitude(d'\")  height(m)", _as_dms, 0, ""),
    "comma_points": (_HEAD, lambda row: " ".join(row).replace(".", ","), 2, "decimal"),
    "baseline": ("%  GPST                  e-baseline(m)  n-baseline(m)  u-baseline(m)",
                 lambda row: " ".join([*row[:2], "12.1", "3.4", "50.1", *row[5:]]), 0, "no ref pos"),
}  # fmt: skip


def make(home: Path) -> None:
    """All of them below a folder in which `made.make` has been."""
    (home / "brought").mkdir(exist_ok=True)
    for name, (lines, crs, place, encoding, *_) in GROUND.items():
        text = "\r\n".join([*lines(_points(home, place, crs)), ""])
        (home / "brought" / f"{name}.csv").write_bytes(text.encode(encoding))
    for name, (text, _) in NO_TABLES.items():
        (home / "brought" / name).write_text(text, encoding="utf-8")
    rover = (home / "gnss" / "rover.pos").read_text(encoding="utf-8").splitlines()
    for name, (head, row, *_) in TRACKS.items():
        lines = [
            line.replace(_HEAD, head) if line[0] == "%" else row(line.split()) for line in rover
        ]
        (home / "brought" / f"{name}.pos").write_text("\n".join([*lines, ""]), encoding="utf-8")
    _lists(home)
    _projects(home)


LISTS = {
    "lower": ("epsg:25832", 0, "51 marks"),
    "proj": ("+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs", 0, "51 marks"),
    "proj_grs": ("+proj=utm +zone=32 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs +type=crs", 0, "51 marks"),
    "name": ("ETRS89 / UTM zone 32N", 0, "51 marks"),
    "name_quoted": ('"ETRS89 / UTM zone 32N"', 0, "51 marks"),
    "urn": ("urn:ogc:def:crs:EPSG::25832", 0, "51 marks"),
    "utm_north": ("UTM 32N", 2, "WGS84 UTM 16N"),
    "comment": ("# made by hand\nEPSG:25832", 0, "51 marks"),
    "columns": ("EPSG:25832\ngeo_x geo_y geo_z im_x im_y image_name gcp_name", 0, "51 marks"),
    "blank_lines": ("\n\nEPSG:25832\n", 0, "51 marks"),
}  # fmt: skip


def _lists(home: Path) -> None:
    _, *rows = (home / "ground" / "gcp_list.txt").read_text(encoding="utf-8").splitlines()
    for name, (head, *_) in LISTS.items():
        text = "\n".join([head, *rows, ""])
        (home / "brought" / f"list_{name}.txt").write_text(text, encoding="utf-8")


def _projects(home: Path) -> None:
    folder = home / "brought"
    text = (home / "metashape" / "cameras.xml").read_bytes()
    (folder / "cameras.xml.gz").write_bytes(gzip.compress(text))
    with zipfile.ZipFile(folder / "cameras.zip", "w") as packed:
        packed.writestr("cameras.xml", text)
    for name in ("rigs.txt", "frames.txt"):
        _copy(home, "colmap-text", "br_empty_rigs").joinpath(name).write_text("# none\n")
    gps = _copy(home, "opensfm", "br_indented") / "reconstruction.json"
    _changed(gps, lambda t: "\ufeff" + t)
    two = _copy(home, "pix4d", "br_gcp_files")
    rows = (home / "ground" / "blanks.txt").read_text(encoding="utf-8").splitlines()
    for k, part in enumerate((rows[:3], rows[3:])):
        lines = [",".join(row.split()) for row in part]
        (two / f"gcp_{k}.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    bare = _copy(home, "metashape", "br_no_places")
    gone = re.compile(r"(<marker [^>]*>\s*)<reference [^>]*/>")
    for file in ("cameras.xml", "markers.xml"):
        _changed(bare / file, lambda t: gone.sub(r"\1", t))


BROUGHT = (
    *(Try(f"g-{name}", f"import auto {{w}}/at_{place} -o {{o}}/b --ground {{w}}/brought/{name}.csv "
          f"--ground-crs '{crs}'", 2 if said.startswith("!") else 0, said.lstrip("!"), kind="tables of offices",
          here=not said.startswith("!"))
      for name, (_, _, place, _, crs, said) in GROUND.items()),
    *(Try(f"n-{name}", f"import auto {{w}}/opensfm -o {{o}}/b --ground {{w}}/brought/{name} --ground-crs {UTM}",
          2, said, kind="files that are no tables") for name, (_, said) in NO_TABLES.items()),
    *(Try(f"t-{name}", f"gnss {{w}}/brought/{name}.pos --images {{w}}/gnss/flight.MRK -o {{o}}/g.csv",
          status, said, kind="forms of tracks") for name, (_, _, status, said) in TRACKS.items()),
    *(Try(f"l-{name}", f"import auto {{w}}/opensfm -o {{o}}/b --ground {{w}}/brought/list_{name}.txt",
          status, said, kind="gcp lists", here=not status) for name, (_, status, said) in LISTS.items()),
    Try("p-gz", "import auto {w}/brought/cameras.xml.gz -o {o}/b", 2, "unpack", kind="projects"),
    Try("p-zip", "import auto {w}/brought/cameras.zip -o {o}/b", 2, "unpack", kind="projects"),
    Try("p-empty-rigs", "import auto {w}/br_empty_rigs -o {o}/b", 0, "px", kind="projects"),
    Try("p-bom", "import auto {w}/br_indented -o {o}/b", 0, "px", kind="projects"),
    Try("p-gcp-files", "import auto {w}/br_gcp_files -o {o}/b", 0, "px", kind="projects"),
    Try("p-no-places", "import auto {w}/br_no_places -o {o}/b", 0, "6 markers without coordinates", kind="projects"),
)  # fmt: skip
