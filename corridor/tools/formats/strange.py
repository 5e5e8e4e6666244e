"""What a file is that is no project, and the way on: by its ending and its first characters."""

import re
from itertools import islice
from pathlib import Path

from corridor.core.errors import InputError
from corridor.core.photographs import photographs_in
from corridor.tools.formats.ground import is_gcp_list
from corridor.tools.formats.textfile import opening

# Ending -> what it is and what to do. Sentences go on after `PATH is`.
_ENDINGS = {
    ".p4d": "a Pix4D project, whose results stand in the folder beside it: name its folder "
    "1_initial/params, and export tie points as BINGO (Process > Output > Save Pix4D files)",
    ".p4b": "a Pix4D archive: unpack it, and name the folder 1_initial/params",
    ".rcproj": "a RealityCapture project: export a Bundler file or a COLMAP model from it, and "
    "name that",
    ".rsproj": "a RealityScan project: export a Bundler file or a COLMAP model from it, and name "
    "that",
    ".ods": "a spreadsheet: save the sheet as comma separated text (.csv), and name that",
    ".sbet": "a POSPac trajectory in binary form: export it from POSPac as text",
    ".out": "a file of a trajectory or of another program: of POSPac, export it as text",
    ".pdf": "a report: name the project that it is of",
    ".zip": "an archive: unpack it, and name the folder",
    ".xmlz": "a packed BlocksExchange: unpack it like a .zip, and name the .xml in it",
    ".mg": "a Meshroom graph: name the sfm.json or cameras.sfm that its node StructureFromMotion "
    "wrote (MeshroomCache/StructureFromMotion/.../)",
    ".pos": "a receiver's track: give it with --track, beside a project",
    ".mrk": "DJI's time marks: name the folder of the photographs, or the project",
    ".obs": "raw data of a receiver (RINEX): process it first, with RTKLIB or the maker's program, "
    "and give the track with --track",
    ".nmea": "a receiver's NMEA log: its positions have no standard deviations; process the raw "
    "data, and give the track with --track",
}
_ALIKE = {
    ".xlsx .xls": "an Excel workbook: save the sheet as comma separated text (.csv), and name that",
    ".las .laz .ply": "a point cloud: a project has photographs, their poses and measurements",
    ".kml .kmz .gpx .geojson .dxf .dwg .shp .gpkg": "a map: save its points as comma separated "
    "text (name, x, y, z), and name that",
    ".gsi .jxl .jobxml .job .rw5 .sdr .dc .dbx .crd .landxml": "a file of a surveying instrument: "
    "export its points as comma separated text (name, x, y, z), and name that",
}
_ENDINGS |= {end: told for ends, told in _ALIKE.items() for end in ends.split()}
_GROUND = "a list of ground points: name the project, and give the list with --ground"
_PLAN = "a plan of a flight: `corridor plan PLAN` says how accurate it will be"
_MOST_FILES = 2000  # of a folder are looked at
_MODEL = ("cameras", "images", "points3D")


def strange(path: Path) -> str:
    """What a file or folder is that is no project of a known format, and what to do; or empty."""
    ending = path.suffix.lower()
    if path.is_dir():
        return _folder(path)
    head = opening(path, 400)
    if "RINEX VERSION" in head or (len(ending) == 4 and ending[1:3].isdecimal() and
                                   ending[3] in "ondg"):  # fmt: skip
        return _ENDINGS[".obs"]
    if head.startswith(("$GP", "$GN")):
        return _ENDINGS[".nmea"]
    if "POSPAC" in head.upper() or "SBET" in head.upper():
        return (
            "a trajectory of POSPac: give it with --track where it is text with time and positions"
        )
    if head.startswith("OPENSFM_TRACKS") or _is_tracks(head):
        return "the tracks of an OpenSfM project: name the folder in which reconstruction.json is"
    if ending == ".toml" and "[[flight]]" in opening(path):
        return _PLAN
    if is_gcp_list(head):
        return _GROUND
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    if ending in (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png"):
        return "one photograph: name the folder of all of them, as `corridor import photos FOLDER`"
    return ""


def not_text(path: Path) -> str:
    """What a file is that is no list of points as text, and what to do; or empty."""
    head = opening(path, 400).lstrip()
    if head.lower().startswith(("<!doctype html", "<html")):
        return "a page of the web: download the file itself"
    if re.match(r"\*?11\d{4}[+-]\S+ ", head) or "<LandXML" in head:
        return _ENDINGS[".gsi"]
    if re.search(r'<(kml|gpx)\b|"(FeatureCollection|Feature)"', head):
        return _ENDINGS[".kml"]
    ending = path.suffix.lower()
    if head.startswith("PK\3\4") and ending not in _ENDINGS:
        ending = ".xlsx"
    return _ENDINGS.get(ending, "")


def _is_tracks(head: str) -> bool:
    """Whether a text has the rows of OpenSfM's tracks.csv, whose first version has no header."""
    cells = head.split("\n", 1)[0].split("\t")
    return len(cells) >= 8 and all(map(str.isdecimal, cells[1:3]))


def _folder(path: Path) -> str:
    files = [file for file in islice(path.rglob("*"), _MOST_FILES) if file.is_file()]
    if path.suffix.lower() == ".files" and (path / "project.zip").is_file():
        return f"a part of a Metashape project: name {path.stem}.psx, which lies beside it"
    names = {file.name for file in files}
    for home in (path, path / "sparse", path / "sparse" / "0"):
        inside = {file.name for file in home.iterdir()} if home.is_dir() else set()
        there = [key for key in _MODEL if {f"{key}.txt", f"{key}.bin"} & inside]
        lacks = [key for key in _MODEL if key not in there]
        if len(there) >= 2 and lacks:
            what = f"{lacks[0]}.bin or {lacks[0]}.txt"
            return f"a COLMAP model in which {what} is missing; export the model again"
    tables = [name for name in names if name.lower().endswith((".csv", ".txt"))]
    try:
        count = len(photographs_in(path))
    except InputError:
        count = 0
    if count > 1:
        return (
            f"a folder of {count} photographs and no project: `corridor import photos {path} -o "
            "BLOCK` makes one from them"
        )
    if tables and any("reference" in name.lower() or "marker" in name.lower() for name in tables):
        return (
            "a folder of reference tables without a project: export the cameras of Metashape as "
            "XML (File > Export > Export Cameras), or name its .psx"
        )
    plans = (file for file in files if file.suffix.lower() == ".toml")
    if any("[[flight]]" in opening(file) for file in plans):
        return f"a folder with {_PLAN}"
    texts = sorted(file for file in files if file.suffix.lower() in (".csv", ".txt"))
    if any(is_gcp_list(opening(file, 400)) for file in texts[:20]):
        return f"a folder with {_GROUND}"
    endings = {Path(name).suffix.lower() for name in names}
    known = next((end for end in _ENDINGS if end in endings), None)
    return f"a folder with {known}: that is {_ENDINGS[known]}" if known else ""
