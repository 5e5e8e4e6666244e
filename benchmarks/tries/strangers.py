"""More files that newcomers have lying about: of Metashape, Pix4D, ODM, COLMAP and a classroom.

Made from the projects of `made`, each with one thing as its program or its owner leaves it.
"""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np

from corridor.core.gnss import convert


def make(home: Path) -> None:
    """All of them below a folder in which `made.make` has been."""
    _metashape(home)
    _pix4d(home)
    _odm(home)
    _colmap(home)
    _classroom(home)
    _surveyors(home)
    _offices(home)


def _copy(home: Path, old: str, new: str) -> Path:
    shutil.copytree(home / old, home / new, dirs_exist_ok=True)
    return home / new


def _changed(path: Path, change, encoding: str = "utf-8") -> None:
    old = path.read_text(encoding="utf-8")
    new = change(old)
    path.write_text(new, encoding=encoding)


def _lines(path: Path, *lines: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _metashape(home: Path) -> None:
    half = re.compile(r'(label="DJI_00[12]\d.JPG">\s*)<transform>[^<]*</transform>')
    system = re.compile("(?s)<reference>.*?</reference>")
    changes = {
        "stems": lambda t: t.replace('.JPG"', '"'),
        "half": lambda t: half.sub(r"\1", t),
        "spherical": lambda t: t.replace('type="frame"', 'type="spherical"'),
        "unaligned": lambda t: re.sub(r"<transform>[0-9e. -]*</transform>", "", t),
        "feet": lambda t: system.sub("<reference>EPSG:2263</reference>", t),
        "cut": lambda t: t[: len(t) // 2],
    }
    for name, change in changes.items():
        folder = _copy(home, "metashape", f"ms_{name}")
        for file in ("cameras.xml", "markers.xml"):
            _changed(folder / file, change)
    folder = _copy(home, "metashape", "ms_utf16")
    for file in ("cameras.xml", "markers.xml"):
        _changed(folder / file, str, "utf-16")
    text = (home / "metashape" / "cameras.xml").read_text(encoding="utf-8")
    names = re.findall(r'label="(DJI[^"]*)"', text)
    head = "# Cameras (29)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23"
    row = "8.55,49.01,210.1,0.1,-0.2,12.0,1,0,0,0,1,0"
    _lines(home / "opk.txt", head, *(f"{name},{row}" for name in names))
    _packed(
        home / "empty.psz",
        {"doc.xml": '<document version="1.2.0"><chunks next_id="0"/></document>'},
    )
    stated = '<document version="1.2.0" path="{projectname}.files/project.zip"/>'
    _lines(home / "noframe.psx", stated)
    chunk = '<chunk id="0" path="0/chunk.zip"/>'
    (home / "noframe.files" / "0").mkdir(parents=True, exist_ok=True)
    _packed(
        home / "noframe.files" / "project.zip",
        {"doc.xml": f'<document><chunks next_id="1" active_id="0">{chunk}</chunks></document>'},
    )


def _packed(path: Path, texts: dict[str, str]) -> None:
    with zipfile.ZipFile(path, "w") as packed:
        for name, text in texts.items():
            packed.writestr(name, text)


def _pix4d(home: Path) -> None:
    _copy(home, "pix4d", "p4_root/1_initial/params")
    (home / "p4_root" / "2_densification").mkdir(parents=True, exist_ok=True)
    (_copy(home, "pix4d", "p4_no_bingo") / "s_tp_bingo.txt").unlink()
    (_copy(home, "pix4d", "p4_no_cameras") / "s_calibrated_camera_parameters.txt").unlink()
    (_copy(home, "pix4d", "p4_no_offset") / "s_offset.xyz").unlink()
    two = _copy(home, "pix4d", "p4_two")
    for file in sorted(two.glob("s_*")):
        shutil.copy(file, two / f"t{file.name[1:]}")
    _lines(_copy(home, "pix4d", "p4_prj") / "s_wkt.prj", 'PROJCS["a grid of my own"]')
    _lines(home / "pmatrix" / "s_pmatrix.txt", "DJI_0001.JPG 1 0 0 0 0 1 0 0 0 0 1 0")
    utm = (home / "ground" / "blanks.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in utm]
    yxz = [f"{p},{y},{x},{z},0.02,0.03" for p, x, y, z in rows]
    _lines(home / "ground" / "p4_yxz.csv", "Label,Y,X,Z,Accuracy Horz [m],Accuracy Vert [m]", *yxz)
    checks = [f"{p},{x},{y},{z},{'CP' if k > 3 else 'GCP'}" for k, (p, x, y, z) in enumerate(rows)]
    _lines(home / "ground" / "p4_types.csv", "Label,X,Y,Z,Type", *checks)
    only = [line.replace(",GCP", ",CP") for line in checks]
    _lines(home / "ground" / "p4_cp.csv", "Label,X,Y,Z,Type", *only)
    mixed = [f"{p};{x.replace('.', ',')};{y};{z}" for p, x, y, z in rows]
    _lines(home / "ground" / "semicolons_mixed.csv", *mixed)
    _lines(home / "ground" / "sep.csv", "sep=;", "Name;E;N;H", *(";".join(row) for row in rows))
    empty = [f"{p},,,," if p == "GCP3" else ",".join((p, x, y, z)) for p, x, y, z in rows]
    _lines(home / "ground" / "row_empty.csv", "Name,E,N,H", *empty)


def _odm(home: Path) -> None:
    name = "reconstruction.json"
    _changed(_copy(home, "opensfm", "odm_none") / name, lambda t: "[]")
    _changed(_copy(home, "opensfm", "odm_two") / name, _parted)
    _changed(
        _copy(home, "opensfm", "odm_sphere") / name,
        lambda t: re.sub('"projection_type": "[a-z]+"', '"projection_type": "spherical"', t),
    )
    (_copy(home, "opensfm", "odm_no_tracks") / "tracks.csv").unlink()
    cameras = json.loads((home / "opensfm" / name).read_text(encoding="utf-8"))[0]["cameras"]
    _lines(home / "odm_files" / "cameras.json", json.dumps(cameras))
    _lines(home / "odm_files" / "shots.geojson", '{"type": "FeatureCollection", "features": []}')
    with zipfile.ZipFile(home / "odm_files" / "all.zip", "w") as packed:
        packed.writestr("odm_report/report.pdf", "%PDF")
    old = (home / "ground" / "gcp_list.txt").read_text(encoding="utf-8")
    _lines(
        home / "ground" / "gcp_paths.txt",
        re.sub(r"DJI_(\d+)", r"/datasets/code/images/DJI_\1", old),
    )
    _lines(
        home / "ground" / "gcp_windows.txt",
        "# my points\r\n\r\nWGS84 UTM 32N\r",
        *(f"{line}  \r" for line in old.splitlines()[1:]),
    )
    _lines(home / "ground" / "gcp_no_head.txt", *old.splitlines()[1:])
    geo = ["EPSG:4326", *(f"DJI_{k:04d}.JPG 8.55 49.01 {200 + k}" for k in range(1, 30))]
    _lines(home / "ground" / "geo.txt", *geo)


def _parted(text: str) -> str:
    """Two reconstructions, as where photographs did not connect."""
    made = json.loads(text)
    other = json.loads(text)[0]
    names = sorted(made[0]["shots"])
    made[0]["shots"] = {name: made[0]["shots"][name] for name in names[:20]}
    other["shots"] = {name: other["shots"][name] for name in names[20:]}
    return json.dumps([made[0], other])


def _colmap(home: Path) -> None:
    model = "colmap-text"
    for part in ("0", "1"):
        _copy(home, model, f"cm_parts/sparse/{part}")
    _copy(home, model, "cm_dense/sparse")
    (home / "cm_dense" / "stereo").mkdir(parents=True, exist_ok=True)
    blank = lambda t: re.sub(r"(?m)^(\d+ .*JPG)\n.*$", "\\1\n", t)  # noqa: E731
    _changed(_copy(home, model, "cm_unseen") / "images.txt", blank)
    fov = lambda t: t.replace("SIMPLE_PINHOLE 1056 792 976.0", "FOV 1056 792 976.0 976.0")  # noqa: E731
    _changed(
        _copy(home, model, "cm_fov") / "cameras.txt",
        lambda t: re.sub("396.0$", "396.0 0.1", fov(t)),
    )
    sizes = lambda t: t.replace("1056 792", "528 396")  # noqa: E731
    _changed(_copy(home, model, "cm_half_size") / "cameras.txt", sizes)
    double = re.compile(r"(?m)^(\d+) (\S+) (\S+) (\S+) (\S+) (.*JPG)$")
    _changed(
        _copy(home, model, "cm_double") / "images.txt",
        lambda t: double.sub(
            lambda m: " ".join([m[1], *(str(2 * float(q)) for q in m.groups()[1:5]), m[6]]), t
        ),
    )
    _lines(home / "cm_files" / "project.ini", "log_to_stderr=true", "database_path=db.db")
    _lines(home / "cm_files" / "database.db", "SQLite format 3")
    for name in ("cameras", "images", "points3D"):
        (home / "cm_empty").mkdir(exist_ok=True)
        (home / "cm_empty" / f"{name}.bin").write_bytes(b"")
    frames = [
        {
            "file_path": "a.jpg",
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }
    ]
    _lines(
        home / "cm_files" / "nerf" / "transforms.json",
        json.dumps({"fl_x": 976, "w": 1056, "h": 792, "frames": frames}),
    )


def _classroom(home: Path) -> None:
    lying = _copy(home, "own", "cl_lying")
    for name in ("~$ground.csv", ".DS_Store", "Thumbs.db", "images (1).csv", "ground - Kopie.csv"):
        (lying / name).write_bytes(b"\0\1")
    german = _copy(home, "own", "cl_german")
    _changed(german / "images.csv", lambda t: t.replace("image,camera", "Bild,Kamera", 1))
    unused = _copy(home, "own", "cl_unused")
    _changed(unused / "ground.csv", lambda t: re.sub(",(control|check)", ",unused", t))
    (home / "cl_empty").mkdir(exist_ok=True)
    (home / "cl_word.docx").write_bytes(b"PK\3\4 word")
    with zipfile.ZipFile(home / "cl_own.zip", "w") as packed:
        for file in (home / "own").iterdir():
            packed.write(file, f"own/{file.name}")
    _copy(home, "own", "cl_deep/own")
    one = home / "cl_one_photo"
    one.mkdir(exist_ok=True)
    shutil.copy(home / "photos" / "DJI_0001.JPG", one / "DJI_0001.JPG")
    upper = home / "cl_upper"
    upper.mkdir(exist_ok=True)
    for file in (home / "own").iterdir():
        shutil.copy(file, upper / file.name.upper())
    (_copy(home, "own", "cl_no_ties") / "tie_points.csv").unlink()
    header = _copy(home, "own", "cl_header_only")
    _changed(header / "tie_points.csv", lambda t: t.splitlines()[0] + "\n")


def _surveyors(home: Path) -> None:
    """Ground points as other countries, programs and spreadsheets write them."""
    rows = [line.split() for line in (home / "ground" / "blanks.txt").read_text().splitlines()]
    names, utm = [row[0] for row in rows], np.array([row[1:] for row in rows], float)
    degrees = convert(utm, "EPSG:25832", "EPSG:4979")

    def table(name, head, row, places=utm, **more):
        lines = [row(n, *map(float, place)) for n, place in zip(names, places, strict=True)]
        _lines(home / "ground" / name, head, *lines, **more)

    def plain(name, places):
        table(name, "name,x,y,z", lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}", places)

    north_first = lambda n, x, y, z: f"{n};{y:.3f};{x:.3f};{z:.3f}"  # noqa: E731
    table("nl.csv", "Punt;Y-coordinaat;X-coordinaat;NAP-hoogte", north_first)
    table("ru.csv", "Имя;Северная;Восточная;Высота", north_first)
    table("brackets.csv", "Nr;X (N);Y (E);H", north_first)
    table("variances.csv", "id;northing;easting;elevation;variance_n",
          lambda *point: f"{north_first(*point)};0.0001")  # fmt: skip
    table("cut.csv", "name,x,y,z", lambda n, x, y, z: f"{n},{x:.2E},{y:.2E},{z:.3f}")
    table("whole.csv", "name,x,y,z", lambda n, x, y, z: f"{n},{x:.0f},{y:.0f},{z:.0f}")
    table("ticks.csv", "#Label,X/Easting,Y/Northing,Z/Altitude,Enabled",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f},{int(n != 'GCP2')}")  # fmt: skip
    table("minutes.csv", "name,lat,lon,h", lambda n, x, y, z: (
        f"{n},{int(y)} {60 * (y % 1):.6f},{int(x)} {60 * (x % 1):.6f},{z:.3f}"), degrees)  # fmt: skip
    plain("mm.csv", 1000 * utm)
    plain("zone33.csv", convert(degrees, "EPSG:4979", "EPSG:25833"))
    plain("gk3.csv", convert(degrees, "EPSG:4979", "EPSG:31467"))
    plain("web.csv", convert(degrees, "EPSG:4979", "EPSG:3857"))
    table("gon.csv", "name,lat,lon,h",
          lambda n, x, y, z: f"{n},{y / 0.9:.9f},{x / 0.9:.9f},{z:.3f}", degrees)  # fmt: skip
    head, *marks = (home / "ground" / "gcp_list.txt").read_text().splitlines()
    half = [row.split() for row in marks]
    for row in half:
        if row[5] == half[0][5]:
            row[3:5] = [str(float(value) / 2) for value in row[3:5]]
    _lines(home / "ground" / "gcp_one_half.txt", head, *map(" ".join, half))
    _lines(home / "ground" / "gcp_proj4.txt", "+proj=utm +zone=32 +ellps=GRS80 +units=m", *marks)


def _offices(home: Path) -> None:
    """Projects with something switched off, twice, missing, or of another size."""
    changes = {
        "marker_off": lambda t: t.replace('label="G02"', 'label="G02" enabled="false"'),
        "marker_twice": lambda t: t.replace('label="G02"', 'label="G01"'),
        "all_off": lambda t: t.replace("<camera id", '<camera enabled="0" id'),
        "no_sensor": lambda t: re.sub(
            r'sensor_id="0" (label="DJI_000[1-3])', r'sensor_id="9" \1', t
        ),
        "double": lambda t: t.replace('width="1056" height="792"', 'width="2112" height="1584"'),
    }
    for name, change in changes.items():
        folder = _copy(home, "metashape", f"ms_{name}")
        for file in ("cameras.xml", "markers.xml"):
            _changed(folder / file, change)
    folder = _copy(home, "pix4d", "p4_double")
    _changed(
        folder / "s_calibrated_camera_parameters.txt", lambda t: t.replace("1056 792", "2112 1584")
    )
