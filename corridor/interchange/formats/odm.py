"""OpenDroneMap's results: odm_report/shots.geojson, cameras.json, proj.txt.

Conventions, where they differ from ours: `translation` is the camera centre in the projected system
here (not OpenSfM's t); `rotation` is a vector (angle-axis) world to camera; cameras as OpenSfM's.
There are no tie points in these files; the folder opensfm/ of the same run holds them.
"""

from pathlib import Path

import numpy as np

from corridor.block import Block
from corridor.errors import InputError
from corridor.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.interchange.formats.opensfm import camera_of, load_json, number_in, numbers_in
from corridor.interchange.project import Project, images_table
from corridor.interchange.text import lines, opening

NAME = "odm"
TITLE = "OpenDroneMap results (shots.geojson, cameras.json), without tie points"

_SHOTS = ("odm_report/shots.geojson", "shots.geojson")


def recognise(path: Path) -> bool:
    """A folder with shots.geojson and no OpenSfM reconstruction, or that file."""
    if path.is_file():
        return path.name == "shots.geojson" and "FeatureCollection" in opening(path)
    if (path / "opensfm" / "reconstruction.json").is_file():
        return False
    return any((path / name).is_file() for name in _SHOTS)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and place."""
    main = path
    if path.is_dir():
        main = next((path / name for name in _SHOTS if (path / name).is_file()), path / _SHOTS[0])
    notes: list[str] = []
    home = main.parent.parent if main.parent.name == "odm_report" else main.parent
    found = load_json(home / "cameras.json")
    if not isinstance(found, dict) or not found:
        raise InputError("cameras.json holds no camera; export the project again")
    cameras = {
        name: camera_of(name, table, f"cameras.json: camera {name!r}", notes)
        for name, table in found.items()
    }
    shots = load_json(main)
    features = shots.get("features") if isinstance(shots, dict) else None
    if not isinstance(features, list) or not features:
        raise InputError(f"{main.name} holds no shots; export the project again")
    names, used, centres, vectors = [], [], [], []
    for k, feature in enumerate(features):
        where = f"{main.name}: shot {k + 1}"
        table = feature.get("properties") if isinstance(feature, dict) else None
        if not isinstance(table, dict) or not isinstance(table.get("filename"), str):
            raise InputError(f"{where} has no filename; export the project again")
        names.append(table["filename"])
        used.append(_camera(table, cameras, where))
        centres.append(numbers_in(table.get("translation"), 3, f"{where}: translation"))
        vectors.append(numbers_in(table.get("rotation"), 3, f"{where}: rotation"))
    quaternion = quaternion_from_rotation(rotation_from_vector(np.array(vectors)))
    block = Block(
        name=home.resolve().name,
        cameras={name: camera for name, camera in cameras.items() if name in set(used)},
        images=images_table(names, used, np.array(centres), quaternion),
        crs=_crs(home),
    )
    notes.append("OpenDroneMap's results hold no tie points; its folder opensfm/ does")
    return Project(NAME, main, block, notes=notes)


def _camera(table, cameras, where):
    if len(cameras) == 1:
        return next(iter(cameras))
    size = [number_in(table, key, where) for key in ("width", "height")]
    focal = number_in(table, "focal", where)
    near = {
        name: abs(camera["f"] / max(camera.width, camera.height) - focal)
        for name, camera in cameras.items()
        if [camera.width, camera.height] == size
    }
    if not near:
        raise InputError(f"{where}: cameras.json has no camera of its size; export it again")
    return min(near, key=near.get)


def _crs(home):
    for folder in (home / "odm_georeferencing", home):
        path = folder / "proj.txt"
        if path.is_file():
            return next((text.strip() for _, text in lines(path) if text.strip()), None)
    return None
