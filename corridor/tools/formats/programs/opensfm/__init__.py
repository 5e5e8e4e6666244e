"""OpenSfM: reconstruction.json, tracks.csv, reference_lla.json, ground_control_points.json.

Conventions, where they differ from ours: image coordinates are counted from the image centre in
units of max(width, height): pixel = x max(w, h) + (w - 1) / 2; focal lengths alike. The rotation is
a vector (angle-axis) world to camera, the translation t = -R C. p1, p2 of `brown` are OpenCV's.
tracks.csv is tab separated. The world is east, north, up about reference_lla. Rig cameras have
poses in the frame of their rig, rig instances those of the rig; the shots' own are both together.

Source: OpenSfM, camera_distortions_functions.h, doc/source/geometry.rst and rig.rst.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv

from corridor.core.block import Block
from corridor.core.camera import FISHEYE, MODELS, Camera
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.core.gnss import Local
from corridor.core.textfile import lines
from corridor.tools.formats.cameras import Held, NoModel, in_the_middle, opencv_camera, where_known
from corridor.tools.formats.ground import Ground, add_to
from corridor.tools.formats.names import Names
from corridor.tools.formats.programs.opensfm.writing import HEADER, MAIN, WIDTH
from corridor.tools.formats.programs.opensfm.writing import write as write
from corridor.tools.formats.project import (
    Contents,
    Project,
    Views,
    gnss_table,
    ground_table,
    hung_together,
)
from corridor.tools.formats.textfile import Json, opening

NAME = "opensfm"
TITLE = "OpenSfM, or OpenDroneMap's opensfm folder"
WRITES = ("opensfm",)
HOLDS = Held(
    ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2"),
    pinhole=("b1",),
    fisheye=(*FISHEYE, "k5", "k6", "p1", "p2", "b1"),
)
# Its world is east, north, up about the place of reference_lla: no grid.
GRIDS = False
LOSSES = {
    "GNSS": "lever arms: gps_position is the camera centre that GNSS gives",
    "ground without place": (
        "coordinates of ground points (no latitude and longitude of the block's frame is known): "
        "their image measurements go"
    ),
    "sigmas": "sigmas of single observations",
    "unlike rigs": "rigs whose images do not stand as they say: adjust first; each image is alone",
}
RIGS = True


def recognise(path: Path) -> bool:
    """A folder with reconstruction.json (perhaps under opensfm/), or that file."""
    if path.is_file():
        return path.name.endswith(".json") and '"shots"' in opening(path, 2_000_000)
    return (path / MAIN).is_file() or (path / "opensfm" / MAIN).is_file()


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and place."""
    main = path if path.is_file() else path / MAIN
    if path.is_dir() and not main.is_file() and (path / "opensfm" / MAIN).is_file():
        main = path / "opensfm" / MAIN
    folder = main.parent
    notes: list[str] = []
    whole = _largest(Json.read(main), notes)
    shots = whole.objects("shots", "shot")
    used = [shot.text("camera") for shot in shots.values()]
    rotation = rotation_from_vector(
        np.array([shot.numbers("rotation", 3) for shot in shots.values()])
    )
    shift = np.array([shot.numbers("translation", 3) for shot in shots.values()])
    names, places = _points(whole)
    cameras = _cameras(whole, used, notes)
    local = _reference(whole, folder)
    if local is None:
        notes.append("no reference_lla: the frame and its scale have no place in the world")
    project = Contents(
        name=folder.resolve().name,
        cameras=cameras,
        images=list(shots),
        used=used,
        centre=-np.einsum("nji,nj->ni", rotation, shift),
        rotation=rotation,
        columns=_times(shots, notes),
        ties=_tracks(folder / "tracks.csv", list(shots), used, names, whole, notes),
        points=(names, places),
        gnss=_gnss(whole, shots, notes),
        local=local,
        notes=notes,
    ).project(NAME, main, placed=local is not None)
    project = hung_together(project, _leaders(whole))
    ground = folder / "ground_control_points.json"
    return (
        add_to(project, read_ground(ground, project.block, local)) if ground.is_file() else project
    )


def _leaders(whole):
    """Shot -> that of its rig instance whose camera is named first among the rig's."""
    cameras = whole.get("rig_cameras")
    order = {name: k for k, name in enumerate(cameras if isinstance(cameras, dict) else ())}
    leader = {}
    instances = whole.objects("rig_instances", "rig instance") if order else {}
    for instance in instances.values():
        taken = instance.get("rig_camera_ids")
        if not isinstance(taken, dict) or not all(str(name) in order for name in taken.values()):
            raise instance.wrong("rig_camera_ids names no rig camera; export the project again")
        if taken:
            leader |= dict.fromkeys(taken, min(taken, key=lambda shot: order[taken[shot]]))
    return leader


def _largest(found, notes):
    parts = found.value if isinstance(found.value, list) else [found.value]
    parts = [Json(part, found.where) for part in parts if isinstance(part, dict)]
    for part in parts:
        for key in ("cameras", "shots", "points"):
            part.objects(key)
    parts.sort(key=lambda part: len(part.value["shots"]), reverse=True)
    if not parts or not parts[0].value["shots"]:
        raise InputError(f"{found.where} holds no reconstruction with images; run the mapper again")
    if len(parts) > 1:
        lost = sum(len(part.value["shots"]) for part in parts[1:])
        notes.append(
            f"{found.where} holds {len(parts)} separate reconstructions: the largest was taken, "
            f"{lost} images of the others were left out"
        )
    return parts[0]


# How many radial coefficients each kind has, and which have p1 and p2. Those of a fisheye stand
# at the angle from the axis, its p1 and p2 too.
_RADIALS = {
    "perspective": 2, "brown": 3, "simple_radial": 1, "radial": 2, "fisheye": 2,
    "fisheye_opencv": 4, "fisheye62": 6,
}  # fmt: skip
_DECENTRED = ("brown", "fisheye62")


def camera_of(name: str, table: Json, notes: list[str]) -> Camera:
    """Our camera of an entry of `cameras`. Raises NoModel, InputError."""
    kind = table.get("projection_type")
    width, height = (table.number(key) for key in ("width", "height"))
    scale = max(width, height)
    if kind not in _RADIALS:
        raise NoModel(f"{table.where} is {kind!r}, for which corridor has no model")
    if kind in ("perspective", "fisheye"):
        fx = fy = table.number("focal")
    else:
        fx, fy = (table.number(key) for key in ("focal_x", "focal_y"))
    radial = [table.number(f"k{n + 1}", 0.0) for n in range(_RADIALS[kind])]
    p1, p2 = (table.number(key, 0.0) if kind in _DECENTRED else 0.0 for key in ("p1", "p2"))
    cx, cy = (
        table.number(key, 0.0) * scale + half
        for key, half in zip(("c_x", "c_y"), in_the_middle(width, height), strict=True)
    )
    if min(fx, fy) <= 0:
        raise table.wrong("has a focal length that is not positive")
    return opencv_camera(
        name, (width, height), (fx * scale, fy * scale), (cx, cy), (*radial, *3 * (0.0,))[:6], p1,
        p2, notes, MODELS[kind.startswith("fisheye")],
    )  # fmt: skip


def _cameras(whole, used, notes):
    """Our cameras of the shots by name; NoModel where we have none."""
    entries = whole.objects("cameras", "camera")
    strange = [name for name in used if name not in entries]
    if strange:
        raise whole.wrong(f"has a shot of camera {strange[0]!r}, which `cameras` does not have")
    return where_known(used, lambda name: camera_of(name, entries[name], notes))


def _times(shots, notes):
    times = [shot.get("capture_time") for shot in shots.values()]
    times = np.array([float(t) if isinstance(t, (int, float)) else 0.0 for t in times])
    if not (np.isfinite(times).all() and (times > 0).all() and np.ptp(times) > 0):
        return {}
    notes.append("times: seconds of the day of capture_time, the camera's clock")
    return {"time_s": times - 86400 * np.floor(times.min() / 86400)}


def _gnss(whole, shots, notes):
    rows = []
    for name, shot in shots.items():
        if shot.get("gps_position") is None:
            continue
        dop = shot.get("gps_dop")
        dop = dop if isinstance(dop, (int, float)) and np.isfinite(dop) and dop > 0 else np.nan
        rows.append((name, *shot.numbers("gps_position", 3), dop, dop, dop))
    biases = whole.get("biases") if rows else None
    shifted = [
        name
        for name, bias in (biases.items() if isinstance(biases, dict) else ())
        if isinstance(bias, dict) and np.any(np.abs(bias.get("translation") or 0) > 1e-9)
    ]
    if shifted:
        notes.append(
            f"OpenSfM estimated a bias of the GPS of {', '.join(shifted)}: gnss.csv holds the "
            "positions as they were measured"
        )
    return gnss_table(rows)


def _points(whole):
    names = list(whole.value["points"])
    try:
        places = np.array(
            [point["coordinates"] for point in whole.value["points"].values()], dtype=float
        ).reshape(-1, 3)
        good = len(places) == len(names) and np.isfinite(places).all()
    except (TypeError, KeyError, ValueError, OverflowError):
        good = False
    if not good:
        for point in whole.objects("points", "point").values():
            point.numbers("coordinates", 3)
    return pd.Index(names, dtype="str"), places


def _version(path):
    for line in lines(path):
        if line.text.startswith(HEADER):
            version = line.text[len(HEADER) :].strip()
            if version.isdecimal() and int(version) in WIDTH:
                return int(version), 1
            raise line.wrong(
                f"version {version[:20]!r} of the tracks is unknown; corridor knows 0, 1 and 2"
            )
        width = len(line.text.split("\t"))
        if width != WIDTH[0]:
            raise line.wrong(
                f"there is no version line, and {width} columns where such a file has 8 (image, "
                f"track, feature, x, y, r, g, b); put its first line back, for example {HEADER}2"
            )
        return 0, 0
    raise InputError(f"{path.name} is empty; export the tracks again")


def _tracks(path, images, used, points, whole, notes):
    """The views of reconstructed points; pixels by the size that the camera of a shot states."""
    version, skip = _version(path)
    width = WIDTH[version]
    names = ["image", "track", "feature", "x", "y", *map(str, range(width - 5))]
    text = pa.dictionary(pa.int32(), pa.string())
    try:
        table = pa.csv.read_csv(
            path,
            read_options=pa.csv.ReadOptions(
                column_names=names, skip_rows=skip, use_threads=False, block_size=1 << 22
            ),
            parse_options=pa.csv.ParseOptions(delimiter="\t", quote_char=False),
            convert_options=pa.csv.ConvertOptions(
                column_types={"image": text, "track": text, "x": pa.float64(), "y": pa.float64()},
                include_columns=["image", "track", "x", "y"],
                null_values=[],
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        raise _bad_track(path, width, skip, error) from None
    x, y = (table[name].to_numpy() for name in ("x", "y"))
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise _bad_track(path, width, skip, "a coordinate is not finite")
    image, point = (
        _codes(table[column], known) for column, known in (("image", images), ("track", points))
    )
    kept = (image >= 0) & (point >= 0)
    if not kept.all():
        notes.append(
            f"{int((~kept).sum())} of {len(kept)} track lines belong to images or points that are "
            "not in the reconstruction and were left out"
        )
    entries = whole.objects("cameras", "camera")
    sizes = {name: [entries[name].number(key) for key in ("width", "height")] for name in {*used}}
    size = np.array([sizes[name] for name in used])[image[kept]]
    scale = size.max(axis=1)
    pixels = np.column_stack([x[kept], y[kept]]) * scale[:, None] + (size - 1) / 2
    return Views(point[kept], points, image[kept], pixels, "track lines")


def _codes(column, known):
    column = column.unify_dictionaries()
    names = column.chunk(0).dictionary.to_pandas() if column.num_chunks else []
    place = pd.Index(known, dtype="str").get_indexer(pd.Index(names, dtype="str"))
    codes = [place[chunk.indices.to_numpy()] for chunk in column.chunks]
    return np.concatenate([np.zeros(0, np.int32), *codes]).astype(np.int32)


def _bad_track(path, width, skip, error):
    """The line that is wrong: the fast reader does not say."""
    for line in lines(path):
        if line.at <= skip or not line.text:
            continue
        words = line.text.split("\t")
        if len(words) != width:
            return line.wrong(
                f"{len(words)} columns where the version has {width}; the file is cut off or was "
                "changed"
            )
        try:
            for what, word in zip("xy", words[3:5], strict=True):
                line.number(word, what)
        except InputError as wrong:
            return wrong
    return InputError(f"{path.name} cannot be read ({str(error).splitlines()[0]}); export it again")


def _reference(whole, folder):
    path = folder / "reference_lla.json"
    if isinstance(whole.get("reference_lla"), dict):
        table = whole.at("reference_lla")
    elif path.is_file():
        table = Json.read(path)
    else:
        return None
    if not isinstance(table.value, dict):
        return None
    place = [table.number(key) for key in ("latitude", "longitude")]
    return None if place == [0.0, 0.0] else Local(*place, table.number("altitude", 0.0))


def read_ground(path: Path, block: Block, local: Local | None) -> Ground:
    """ground_control_points.json, in the frame about its reference; None: marks only."""
    cameras = [block.cameras[name] for name in block.images["camera"]]
    known = Names(block.images["image"])
    names, places, roles, marks = [], [], [], []
    for point in Json.read(path).rows("points", "point"):
        if not isinstance(point.get("id"), (str, int)):
            raise point.wrong("has no id")
        name = str(point.get("id"))
        if isinstance(point.get("position"), dict) and local is not None:
            position = point.at("position")
            lon, lat = (position.number(key) for key in ("longitude", "latitude"))
            names.append(name)
            places.append([lon, lat, position.number("altitude", 0.0)])
            check = point.get("role") in ("check", "metrics_only")
            roles.append("check" if check else "control")
        for entry in point.rows("observations", "observation") if point.get("observations") else ():
            row = known.row(str(entry.get("shot_id")))
            if row is not None:
                size = np.array([cameras[row].width, cameras[row].height], dtype=float)
                pixel = entry.numbers("projection", 2) * size.max() + (size - 1) / 2
                marks.append((name, block.images["image"].iloc[row], *pixel))
    if not names:
        return Ground(path, None, None, marks)
    places = local.from_geographic(np.array(places))
    return Ground(path, None, ground_table(names, places, None, roles), marks)
