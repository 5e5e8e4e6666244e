"""What a file is that is no project, and the way on: by its ending and its first characters."""

import re
from itertools import islice
from pathlib import Path

from corridor.core.errors import InputError
from corridor.core.photographs import photographs_in
from corridor.core.textfile import disguised
from corridor.tools.formats.ground import is_gcp_list
from corridor.tools.formats.textfile import opening

# Ending -> what it is and what to do. Sentences go on after `PATH is`.
_ENDINGS = {
    ".p4d": "a Pix4D project, whose results stand in the folder beside it: name its folder "
    "1_initial/params, and export tie points as BINGO (Process > Output > Save Pix4D files)",
    ".p4b": "a Pix4D archive: unpack it, and name the folder 1_initial/params",
    ".abc": "Meshroom's result in Alembic: convert it to .sfm (node ConvertSfMFormat), and name "
    "that",
    ".db": "COLMAP's database of matches: name the folder of the model (sparse/0) that its mapper "
    "wrote",
    ".ods": "a spreadsheet: save the sheet as comma separated text (.csv), and name that",
    ".sbet": "a POSPac trajectory: give it with --track",
    ".out": "a file of a trajectory or of another program: a POSPac SBET belongs to --track",
    ".pdf": "a report: name the project that it is of",
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
    ".rcproj .rsproj .rspj": "a project of RealityCapture or RealityScan: export a Bundler file or "
    "a COLMAP model from it, and name that",
    ".xmp": "a photograph's sidecar, with its pose and no measurements: export a Bundler file or a "
    "COLMAP model from RealityCapture, and name that",
    ".heic .heif .cr2 .cr3 .nef .arw .rw2 .raf .orf": "a photograph in a form that is not "
    "read: convert all to JPEG with their EXIF",
    ".mp4 .mov .avi .mkv": "a video: take pictures out of it first, with their times",
    ".xlsx .xls": "an Excel workbook: save the sheet as comma separated text (.csv), and name that",
    ".las .laz .ply .e57 .pts .rcp .rcs": "a point cloud: a project has photographs, their poses "
    "and measurements",
    ".obj .fbx .stl .dae .glb .gltf .osgb .slpk .3mx .b3dm .3ds": "a model of the surface: a "
    "project has photographs, their poses and measurements",
    ".zip .rar .7z .tar .tgz .gz .bz2 .xz": "an archive: unpack it, and name the folder",
    ".p4m .p4s": "a project of Pix4Dmatic or Pix4Dsurvey: export its cameras and tie points, or "
    "name the folder of the photographs, as `corridor import photos FOLDER`",
    ".qgz .qgs .aprx .mxd": "a project of a map: name the project of the photographs",
    ".plan .waypoints .mission .wpml": "a mission of a drone: name the photographs that it took, "
    "as `corridor import photos FOLDER`",
    ".srt": "the subtitles of a drone's video, with one position a frame: corridor reads "
    "photographs, so name their folder",
    ".ulg .tlog .bbl .dat": "a log of a drone: give the GNSS receiver's processed track with "
    "--track",
    ".exe .msi .dmg .apk .iso": "a program: name the project",
    ".doc .docx .odt .ppt .pptx .rtf": "a document: name the project that it is about",
    ".kml .kmz .gpx .geojson .dxf .dwg .shp .gpkg": "a map: save its points as comma separated "
    "text (name, x, y, z), and name that",
    ".gsi .jxl .jobxml .job .rw5 .sdr .dc .dbx .crd .landxml": "a file of a surveying instrument: "
    "export its points as comma separated text (name, x, y, z), and name that",
}
_ENDINGS |= {end: told for ends, told in _ALIKE.items() for end in ends.split()}
# Names of files of programs that are a part of a project.
_PARTS = {
    r"calibration.*\.xml|.*camera.*calib.*\.xml": "a camera without photographs: name the XML of "
    "the cameras (File > Export > Export Cameras), or the folder of the project",
    r"cameras\.json|camera_models\.json": "a list of cameras of OpenSfM or OpenDroneMap: name the "
    "folder in which reconstruction.json is",
    r"project\.ini": "settings of COLMAP: name the folder of the model (sparse/0) that its mapper "
    "wrote",
    r".*_pmatrix\.txt": "projection matrices of Pix4D, without lens: name its folder params, with "
    "..._calibrated_camera_parameters.txt in it",
}
_PIX4D = re.compile(r"(?i).*(_pmatrix\.txt|_tp_bingo\.txt|_offset\.xyz|_wkt\.prj)$")
_GROUND = "a list of ground points: name the project, and give the list with --ground"
_PLAN = "a plan of a flight: `corridor plan PLAN` says how accurate it will be"
_MOST_FILES = 2000  # of a folder are looked at
_TABLE = (
    "a table of positions of photographs, without measurements in them: name a project with tie "
    "points, or the folder of the photographs, as `corridor import photos FOLDER`"
)
TEXT = (
    "a list of image coordinates (PATB, BINGO), which says neither unit nor angles: write "
    'convention.toml beside it (page "Check a project")'
)
_INPHO = (
    "an Inpho project: export image coordinates and orientations as PATB or BINGO, and name these"
)
_PICTURE = re.compile(
    r"(?i)^[^#%\n]*?\.(?:jpe?g|tiff?|png|dng|arw|heic)\"?[,;\s]+(.*)", re.MULTILINE
)
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?")
_MODEL = ("cameras", "images", "points3D")


def strange(path: Path) -> str:
    """What a file or folder is that is no project of a known format, and what to do; or empty."""
    ending = path.suffix.lower()
    if path.is_dir():
        return _folder(path)
    if (path.parent / "block.toml").is_file():
        return f"a file of a block: name its folder, {path.parent}"
    for pattern, told in _PARTS.items():
        if re.fullmatch(pattern, path.name, re.IGNORECASE):
            return told
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
    told = _of_text(path)
    if told:
        return told
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    if ending in (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png"):
        return "one photograph: name the folder of all of them, as `corridor import photos FOLDER`"
    return ""


def _of_text(path: Path) -> str:
    """What a list is, by its first lines; or empty."""
    head = opening(path, 20_000)
    if is_gcp_list(head[:400]):
        return _GROUND
    if head.startswith("$PROJECT"):
        return _INPHO
    if re.search(r"(?m)^\s*-99\s*$", head):
        return TEXT
    row = _PICTURE.search(head)
    cells = re.split(r"[,;\s]+", row[1].strip()) if row else []
    if len(cells) > 2 and all(map(_NUMBER.fullmatch, cells[:3])):
        return _TABLE
    lines = [line.strip() for line in head.splitlines()[1:6] if line[:1] != "#"]
    rows = [re.split(r"[,;\t ]+", line) for line in lines if line]
    points = [len(r) > 3 and all(map(_NUMBER.fullmatch, r[1:4])) and "." not in r[0] for r in rows]
    return _GROUND if points and all(points) else ""


def not_text(path: Path) -> str:
    """What a file is that is no list of points as text, and what to do; or empty."""
    if told := disguised(path):
        return told
    head = opening(path, 400).lstrip()
    if re.match(r"\*?11\d{4}[+-]\S+ ", head) or "<LandXML" in head:
        return _ENDINGS[".gsi"]
    if re.search(r'<(kml|gpx)\b|"(FeatureCollection|Feature)"', head):
        return _ENDINGS[".kml"]
    return _ENDINGS.get(path.suffix.lower(), "")


def _is_tracks(head: str) -> bool:
    """Whether a text has the rows of OpenSfM's tracks.csv, whose first version has no header."""
    cells = head.split("\n", 1)[0].split("\t")
    return len(cells) >= 8 and all(map(str.isdecimal, cells[1:3]))


def _folder(path: Path) -> str:
    files = [file for file in islice(path.rglob("*"), _MOST_FILES) if file.is_file()]
    for home in (path, *path.glob("*.files")):
        if home.suffix.lower() == ".files" and (home / "project.zip").is_file():
            return (
                f"a part of a Metashape project: put {home.stem}.psx beside {home.name}, and name "
                f"{home.stem}.psx"
            )
    if not files:
        return "a folder without files: name the folder of a project"
    names = {file.name for file in files}
    if any(name != name.lower() == "block.toml" for name in names):
        return (
            "a block whose files are in other letters: call them block.toml, images.csv, "
            "tie_points.csv ..."
        )
    pix4d = [name for name in sorted(names) if _PIX4D.match(name)]
    if pix4d:
        return (
            f"a folder of Pix4D's parameters ({pix4d[0]}) without "
            "..._calibrated_camera_parameters.txt, in which the cameras are: put it there"
        )
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
    endings = {Path(name).suffix.lower() for name in names}
    texts = sorted(file for file in files if file.suffix.lower() not in _ENDINGS)
    told = next((told for file in texts[:20] if (told := _of_text(file))), "")
    if told:
        return f"a folder with {told}"
    known = next((end for end in _ENDINGS if end in endings), None)
    return f"a folder with {known}: that is {_ENDINGS[known]}" if known else ""
