"""OpenSfM: reconstruction.json, tracks.csv, reference_lla.json, ground_control_points.json.

Conventions, where they differ from ours: image coordinates are counted from the image centre in
units of max(width, height): pixel = x max(w, h) + (w - 1) / 2; focal lengths alike. The rotation is
a vector (angle-axis) world to camera, the translation t = -R C. p1, p2 of `brown` are OpenCV's.
tracks.csv is tab separated. The world is east, north, up about reference_lla.

Source: OpenSfM, camera_distortions_functions.h and doc/source/geometry.rst.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv

from corridor.block import Block
from corridor.camera import INTERIOR, Camera
from corridor.errors import InputError
from corridor.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.gnss import Local
from corridor.interchange.cameras import standing_for
from corridor.interchange.columns import numbered, text_of, write_rows
from corridor.interchange.project import (
    Project,
    camera_from,
    images_table,
    in_the_middle,
    observations_table,
    points_table,
    same_point_once,
)
from corridor.interchange.rows import camera_positions, rows_of
from corridor.interchange.text import lines, missing, opening

NAME = "opensfm"
TITLE = "OpenSfM, or OpenDroneMap's opensfm folder"
WRITES = ("opensfm",)
HOLDS = "f, cx, cy, k1, k2, k3, p1, p2 (b1 without distortion)"

_MAIN = "reconstruction.json"
_HEADER = "OPENSFM_TRACKS_VERSION_v"
# Columns of a track line by version: image, track, feature, x, y, [scale], r, g, b, [segment..].
_WIDTH = {0: 8, 1: 9, 2: 11}


def recognise(path: Path) -> bool:
    """A folder with reconstruction.json (perhaps under opensfm/), or that file."""
    if path.is_file():
        return path.name.endswith(".json") and '"shots"' in opening(path, 2_000_000)
    return (path / _MAIN).is_file() or (path / "opensfm" / _MAIN).is_file()


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and place."""
    main = path if path.is_file() else path / _MAIN
    if path.is_dir() and not main.is_file() and (path / "opensfm" / _MAIN).is_file():
        main = path / "opensfm" / _MAIN
    folder = main.parent
    notes: list[str] = []
    warnings: list[str] = []
    whole = _reconstruction(main, notes)
    cameras = _cameras(whole, main, notes, warnings)
    images, gnss = _shots(whole, cameras, main, notes)
    used = set(images["camera"])
    names = list(images["image"])
    point_names, positions = _points(whole, main)
    codes = _tracks(folder / "tracks.csv", names, point_names, notes)
    tie = _pixels(*codes, point_names, images, cameras)
    reference = _reference(whole, folder)
    block = Block(
        name=folder.resolve().name,
        cameras={name: camera for name, camera in cameras.items() if name in used},
        images=images,
        tie_points=same_point_once(tie, "track lines", warnings),
        points=points_table(point_names, positions),
        gnss=gnss,
    )
    if reference is not None:
        block.extra["local_frame"] = {
            "lat_deg": reference.lat_deg, "lon_deg": reference.lon_deg, "height": reference.height
        }  # fmt: skip
    else:
        notes.append("no reference_lla: the frame and its scale have no place in the world")
    _ground(folder, block, reference, notes)
    return Project(NAME, main, block, notes=notes, warnings=warnings, placed=reference is not None)


def load_json(path: Path):
    """What a JSON file holds. Raises InputError naming file and line."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise missing(path, error) from error
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return json.loads(data.decode(encoding))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path.name}, line {line}: not UTF-8; save the file as UTF-8") from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path.name}, line {error.lineno}: the JSON is broken or ends early ({error.msg}); "
            "export the project again"
        ) from None
    except RecursionError:
        raise InputError(f"{path.name} is nested without end; export the project again") from None


def numbers_in(values, count: int, where: str) -> np.ndarray:
    """`count` finite numbers of a JSON list. Raises InputError naming the place."""
    good = isinstance(values, list) and len(values) == count
    if good and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
        try:
            array = np.array(values, dtype=float)
        except OverflowError:
            array = np.array([np.nan])
        if np.isfinite(array).all():
            return array
    raise InputError(f"{where} is not {count} finite numbers; export the project again")


def number_in(table: dict, key: str, where: str, default: float | None = None) -> float:
    """A finite number of a JSON object. Raises InputError naming the place."""
    value = table.get(key, default)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value):
        return float(value)
    raise InputError(f"{where} has no number {key} ({value!r}); export the project again")


def _reconstruction(path, notes):
    found = load_json(path)
    if isinstance(found, dict):
        found = [found]
    parts = [part for part in found if isinstance(part, dict)] if isinstance(found, list) else []
    for part in parts:
        for key in ("cameras", "shots", "points"):
            if not isinstance(part.get(key), dict):
                raise InputError(
                    f"{path.name}: a reconstruction has no {key}; export the project again"
                )
    parts.sort(key=lambda part: len(part["shots"]), reverse=True)
    if not parts or not parts[0]["shots"]:
        raise InputError(f"{path.name} holds no reconstruction with images; run the mapper again")
    if len(parts) > 1:
        lost = sum(len(part["shots"]) for part in parts[1:])
        notes.append(
            f"{path.name} holds {len(parts)} separate reconstructions: the largest was taken, "
            f"{lost} images of the others were left out"
        )
    return parts[0]


class NoModel(InputError):
    """A camera for which corridor has no model."""


def camera_of(name: str, table: dict, where: str, notes: list[str]) -> Camera:
    """Our camera of an entry of `cameras`. Raises NoModel, InputError."""
    if not isinstance(table, dict):
        raise InputError(f"{where} is no camera; export the project again")
    kind = table.get("projection_type")
    width, height = (number_in(table, key, where) for key in ("width", "height"))
    scale = max(width, height)
    if kind == "perspective":
        fx = fy = number_in(table, "focal", where)
        keys = ("k1", "k2")
    elif kind in ("brown", "simple_radial", "radial"):
        fx, fy = (number_in(table, key, where) for key in ("focal_x", "focal_y"))
        keys = {"brown": ("k1", "k2", "k3", "p1", "p2"), "radial": ("k1", "k2")}.get(kind, ("k1",))
    else:
        raise NoModel(f"{where} is {kind!r}, for which corridor has no model")
    k = {key: number_in(table, key, where, 0.0) for key in keys}
    k = {key: k.get(key, 0.0) for key in ("k1", "k2", "k3", "p1", "p2")}
    middle = in_the_middle(width, height)
    cx, cy = (
        number_in(table, key, where, 0.0) * scale + half
        for key, half in zip(("c_x", "c_y"), middle, strict=True)
    )
    if fx <= 0 or fy <= 0:
        raise InputError(f"{where}: the focal length is not positive; export the project again")
    camera = camera_from(
        name, width, height, fy * scale, cx, cy,
        k1=k["k1"], k2=k["k2"], k3=k["k3"], p1=k["p2"], p2=k["p1"], b1=(fx - fy) / fy,
    )  # fmt: skip

    def project(rays: np.ndarray) -> np.ndarray:
        u, v = rays.T
        r2 = u * u + v * v
        radial = 1 + r2 * (k["k1"] + r2 * (k["k2"] + r2 * k["k3"]))
        x = u * radial + 2 * k["p1"] * u * v + k["p2"] * (r2 + 2 * u * u)
        y = v * radial + 2 * k["p2"] * u * v + k["p1"] * (r2 + 2 * v * v)
        return np.column_stack([cx + fx * scale * x, cy + fy * scale * y])

    if fx == fy or not any(k.values()):
        return camera
    return standing_for(camera, project, notes)


def _cameras(whole, path, notes, warnings):
    """Cameras of the shots; shots of cameras for which we have no model are taken out."""
    shots = whole["shots"]
    cameras = {}
    named = [shot.get("camera") if isinstance(shot, dict) else None for shot in shots.values()]
    for name in dict.fromkeys(named):
        where = f"{path.name}: camera {name!r}"
        if name not in whole["cameras"]:
            raise InputError(
                f"{path.name}: a shot has {where[len(path.name) + 2 :]}, which `cameras` does not "
                "have; export the project again"
            )
        try:
            cameras[name] = camera_of(name, whole["cameras"][name], where, notes)
        except NoModel as error:
            lost = named.count(name)
            warnings.append(f"{error}: its {lost} images were left out")
            whole["shots"] = {k: v for k, v in whole["shots"].items() if v.get("camera") != name}
    if not cameras:
        raise InputError(f"{warnings[-1]}; nothing is left to import")
    return cameras


def _shots(whole, cameras, path, notes):
    shots = whole["shots"]
    vectors, shifts, used, times, places = [], [], [], [], []
    for name, shot in shots.items():
        where = f"{path.name}: shot {name!r}"
        if not isinstance(shot, dict) or shot.get("camera") not in cameras:
            raise InputError(f"{where} has no camera of `cameras`; export the project again")
        used.append(shot["camera"])
        vectors.append(numbers_in(shot.get("rotation"), 3, f"{where}: rotation"))
        shifts.append(numbers_in(shot.get("translation"), 3, f"{where}: translation"))
        time = shot.get("capture_time", 0.0)
        times.append(float(time) if isinstance(time, (int, float)) else 0.0)
        gps, dop = shot.get("gps_position"), shot.get("gps_dop", 0.0)
        if gps is not None:
            gps = numbers_in(gps, 3, f"{where}: gps_position")
            dop = dop if isinstance(dop, (int, float)) and np.isfinite(dop) and dop > 0 else np.nan
            places.append((name, *gps, dop))
    rotation = rotation_from_vector(np.array(vectors))
    centre = -np.einsum("nji,nj->ni", rotation, np.array(shifts))
    images = images_table(list(shots), used, centre, quaternion_from_rotation(rotation))
    times = np.array(times)
    if np.isfinite(times).all() and (times > 0).all() and np.ptp(times) > 0:
        midnight = 86400 * np.floor(times.min() / 86400)
        images.insert(2, "time_s", times - midnight)
        notes.append("times: seconds of the day of capture_time, the camera's clock")
    gnss = pd.DataFrame(places, columns=["image", "x", "y", "z", "sx"]) if places else None
    if gnss is not None:
        gnss["sy"] = gnss["sz"] = gnss["sx"]
        gnss = gnss if gnss["sx"].notna().any() else gnss[["image", "x", "y", "z"]]
        biases = whole.get("biases")
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
    return images, gnss


def _points(whole, path):
    names = list(whole["points"])
    try:
        places = np.array(
            [point["coordinates"] for point in whole["points"].values()], dtype=float
        ).reshape(-1, 3)
        good = np.isfinite(places).all(axis=1) if len(places) == len(names) else None
    except (TypeError, KeyError, ValueError, OverflowError):
        good = None
    if good is None or not good.all():
        for name, point in whole["points"].items():
            values = point.get("coordinates") if isinstance(point, dict) else None
            numbers_in(values, 3, f"{path.name}: coordinates of point {name!r}")
    return pd.Index(names, dtype="str"), places


def _version(path):
    for _, text in lines(path):
        if text.startswith(_HEADER):
            version = text[len(_HEADER) :].strip()
            if version.isdecimal() and int(version) in _WIDTH:
                return int(version), 1
            raise InputError(
                f"{path.name}, line 1: version {version[:20]!r} of the tracks is unknown; "
                "corridor knows 0, 1 and 2"
            )
        width = len(text.split("\t"))
        if width != _WIDTH[0]:
            raise InputError(
                f"{path.name}, line 1: there is no version line, and {width} columns where such a "
                "file has 8 (image, track, feature, x, y, r, g, b); put its first line back, for "
                f"example {_HEADER}2"
            )
        return 0, 0
    raise InputError(f"{path.name} is empty; export the tracks again")


def _tracks(path, images, points, notes):
    """Image codes, point codes, x, y (normalised) of the lines of reconstructed points."""
    version, skip = _version(path)
    width = _WIDTH[version]
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
    return image[kept], point[kept], x[kept], y[kept]


def _codes(column, known):
    known = pd.Index(known, dtype="str")
    out = np.empty(len(column), dtype=np.int32)
    row = 0
    for chunk in column.chunks:
        place = known.get_indexer(pd.Index(chunk.dictionary.to_pandas(), dtype="str"))
        out[row : row + len(chunk)] = place[chunk.indices.to_numpy()]
        row += len(chunk)
    return out


def _bad_track(path, width, skip, error):
    """The line that is wrong: the fast reader does not say."""
    for number, line in lines(path):
        if number <= skip or not line:
            continue
        words = line.split("\t")
        if len(words) != width:
            return InputError(
                f"{path.name}, line {number}: {len(words)} columns where the version has {width}; "
                "the file is cut off or was changed"
            )
        for what, word in zip("xy", words[3:5], strict=True):
            try:
                good = np.isfinite(float(word)) and "_" not in word
            except ValueError:
                good = False
            if not good:
                hint = "has a decimal comma" if "," in word else "is not a finite number"
                return InputError(
                    f"{path.name}, line {number}: {what} = {word[:40]!r} {hint}; export it again"
                )
    return InputError(f"{path.name} cannot be read ({str(error).splitlines()[0]}); export it again")


def _pixels(image, point, x, y, point_names, images, cameras):
    row = {name: k for k, name in enumerate(cameras)}
    sizes = np.array([(c.width, c.height) for c in cameras.values()], dtype=float)
    camera = np.array([row[name] for name in images["camera"]], dtype=np.int64)[image]
    size = sizes[camera]
    scale = size.max(axis=1) if len(size) else np.zeros(0)
    pixels = np.column_stack([x, y]) * scale[:, None] + (size - 1) / 2
    return observations_table(point, point_names, image, list(images["image"]), pixels)


def _reference(whole, folder):
    table = whole.get("reference_lla")
    path = folder / "reference_lla.json"
    if not isinstance(table, dict) and path.is_file():
        table = load_json(path)
    if not isinstance(table, dict):
        return None
    where = "reference_lla"
    place = [number_in(table, key, where) for key in ("latitude", "longitude")]
    if place == [0.0, 0.0]:
        return None
    return Local(*place, number_in(table, "altitude", where, 0.0))


def _ground(folder, block, reference, notes):
    path = folder / "ground_control_points.json"
    if not path.is_file():
        return
    from corridor.interchange.ground import add_to, read_opensfm

    add_to(block, read_opensfm(path, block, reference), notes)


# --- out -------------------------------------------------------------------------------------


def unheld(camera: Camera) -> list[str]:
    """Interior parameters, not zero, that a brown camera cannot hold."""
    held = {"f", "cx", "cy", "k1", "k2", "k3", "p1", "p2"}
    bent = any(camera[name] for name in INTERIOR if name not in ("f", "cx", "cy", "b1"))
    if not bent:
        held.add("b1")
    return [name for name in INTERIOR if name not in held and camera[name] != 0.0]


def nearest(camera: Camera) -> Camera:
    """The nearest brown camera."""
    return camera.with_values(**{name: 0.0 for name in unheld(camera)})


def losses(block: Block) -> list[str]:
    """What else OpenSfM cannot hold, and where it went instead."""
    lost = []
    if block.gnss is not None and len(block.gnss):
        lost.append("lever arms: gps_position is the camera centre that GNSS gives")
    if "local_frame" not in block.extra and len(block.ground):
        lost.append(
            "coordinates of ground points (no latitude and longitude of the block's frame is "
            "known): their image measurements go"
        )
    if "sigma" in block.tie_points:
        lost.append("sigmas of single observations")
    return lost


def write(block: Block, folder: Path, name: str) -> None:
    """Write reconstruction.json, tracks.csv, reference_lla.json, ground_control_points.json."""
    rows = rows_of(block)
    cameras = {name: _table(camera) for name, camera in block.cameras.items()}
    shots = {}
    positions = camera_positions(block).set_index("image")
    times = block.column("images", "time_s")
    vector = _vectors(rows.quaternion)
    for k, (image, camera) in enumerate(zip(rows.image_names, block.images["camera"], strict=True)):
        shots[image] = {
            "rotation": vector[k].tolist(),
            "translation": rows.translation[k].tolist(),
            "camera": camera,
            "orientation": 1,
            "capture_time": float(times[k]) if np.isfinite(times[k]) else 0.0,
        }
        if image in positions.index:
            place = positions.loc[image]
            shots[image]["gps_position"] = [float(place[axis]) for axis in "xyz"]
            shots[image]["gps_dop"] = float(np.sqrt(place["sx"] * place["sy"]))
    whole = {"cameras": cameras, "shots": shots, "points": {}}
    local = block.extra.get("local_frame")
    if local:
        whole["reference_lla"] = {
            "latitude": local["lat_deg"], "longitude": local["lon_deg"],
            "altitude": local["height"],
        }  # fmt: skip
        _dump(whole["reference_lla"], folder / "reference_lla.json")
    _write_reconstruction(whole, rows, folder / _MAIN)
    _write_tracks(block, rows, folder / "tracks.csv")
    if len(block.marks):
        _write_ground(block, folder / "ground_control_points.json", local)


def _dump(what, path):
    path.write_text(json.dumps(what, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _write_reconstruction(whole, rows, path):
    """Points one a line: a million of them as one object would fill the memory."""
    head = json.dumps({k: v for k, v in whole.items() if k != "points"}, ensure_ascii=False)
    names = rows.point_names[: rows.ties]
    quoted = json.JSONEncoder(ensure_ascii=False).encode
    step = 100_000
    with path.open("wb") as file:
        file.write(f'[{head[:-1]}, "points": {{\n'.encode())
        for first in range(0, rows.ties, step):
            part = slice(first, min(first + step, rows.ties))
            x, y, z = map(text_of, rows.positions[part].T)
            comma = pa.array([","] * (len(x) - 1) + ["," * (part.stop < rows.ties)])
            write_rows(
                file,
                pa.array(list(map(quoted, names[part]))),
                ': {"color": [128, 128, 128], "coordinates": [', x, ", ", y, ", ", z, "]}",
                comma, "\n",
            )  # fmt: skip
        file.write(b"}}]\n")


def _table(camera):
    scale = max(camera.width, camera.height)
    cx, cy = in_the_middle(camera.width, camera.height)
    return {
        "projection_type": "brown",
        "width": camera.width,
        "height": camera.height,
        "focal_x": camera["f"] * (1 + camera["b1"]) / scale,
        "focal_y": camera["f"] / scale,
        "c_x": (camera["cx"] - cx) / scale,
        "c_y": (camera["cy"] - cy) / scale,
        "k1": camera["k1"],
        "k2": camera["k2"],
        "k3": camera["k3"],
        "p1": camera["p2"],
        "p2": camera["p1"],
    }


def _vectors(quaternion):
    """Angle-axis (n, 3) of quaternions, radians."""
    q = np.where(quaternion[:, :1] < 0, -quaternion, quaternion)
    length = np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(length, q[:, :1])
    small = length < 1e-12
    return q[:, 1:] * np.where(small, 2.0, angle / np.where(small, 1.0, length))


def _normalised(block, rows, part):
    size = np.array([(c.width, c.height) for c in block.cameras.values()], dtype=float)
    at = {name: k for k, name in enumerate(block.cameras)}
    camera = np.array([at[name] for name in block.images["camera"]])[rows.image[part]]
    return (rows.pixels[part] - (size[camera] - 1) / 2) / size[camera].max(axis=1)[:, None]


def _write_tracks(block, rows, path):
    count = len(block.tie_points)
    part = slice(0, count)
    xy = _normalised(block, rows, part)
    image = pa.DictionaryArray.from_arrays(rows.image[part].astype(np.int32), rows.image_names)
    point = pa.DictionaryArray.from_arrays(
        rows.point[part].astype(np.int32), pa.array(rows.point_names[: rows.ties], pa.string())
    )
    feature = numbered(rows.image[part], len(rows.image_names))
    same = [pa.array(np.full(count, value)) for value in (0.001, 128, 128, 128, -1, -1)]
    table = pa.table(
        [image.cast(pa.string()), point.cast(pa.string()), feature, xy[:, 0], xy[:, 1], *same],
        names=[str(k) for k in range(_WIDTH[2])],
    )
    with path.open("wb") as file:
        file.write(f"{_HEADER}2\n".encode())
        options = pa.csv.WriteOptions(
            include_header=False, delimiter="\t", quoting_style="none", batch_size=65536
        )
        pa.csv.write_csv(table, file, options)


def _write_ground(block, path, local):
    rows = rows_of(block, complete=False)
    part = slice(len(block.tie_points), None)
    xy = _normalised(block, rows, part)
    given = block.ground.set_index("point")[["x", "y", "z"]]
    roles = block.ground.set_index("point")["role"]
    place = Local(local["lat_deg"], local["lon_deg"], local["height"]) if local else None
    points = {}
    for name, image, pixel in zip(block.marks["point"], rows.image[part], xy.tolist(), strict=True):
        entry = points.setdefault(name, {"id": name, "observations": []})
        entry["observations"].append({"shot_id": rows.image_names[image], "projection": pixel})
        if name in given.index and "position" not in entry and place is not None:
            world = given.loc[name].to_numpy()[None]
            lon, lat, height = place.to_geographic(world)[0].tolist()
            entry["position"] = {"latitude": lat, "longitude": lon, "altitude": height}
            entry["role"] = str(roles[name])
    _dump({"points": list(points.values())}, path)
