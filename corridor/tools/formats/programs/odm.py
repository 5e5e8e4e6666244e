"""OpenDroneMap's results: odm_report/shots.geojson, cameras.json, proj.txt.

Conventions, where they differ from ours: `translation` is the camera centre in the projected system
here (not OpenSfM's t); `rotation` is a vector (angle-axis) world to camera; cameras as OpenSfM's.
There are no tie points in these files; the folder opensfm/ of the same run holds them.
"""

from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.tools.formats.programs.opensfm import camera_of
from corridor.tools.formats.project import Contents, Project
from corridor.tools.formats.textfile import Json, filled, opening

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
    found = Json.read(home / "cameras.json")
    if not isinstance(found.value, dict) or not found.value:
        raise InputError("cameras.json holds no camera; export the project again")
    cameras = {name: camera_of(name, found.at(name, "camera"), notes) for name in found.value}
    shots = Json.read(main).rows("features", "shot")
    if not shots:
        raise InputError(f"{main.name} holds no shots; export the project again")
    shots = [shot.at("properties") if shot.get("properties") else shot for shot in shots]
    warnings = ["OpenDroneMap's results hold no tie points; name the project's folder opensfm/"]
    return Contents(
        name=home.resolve().name,
        cameras=cameras,
        images=[shot.text("filename") for shot in shots],
        used=[_camera(shot, cameras) for shot in shots],
        centre=np.array([shot.numbers("translation", 3) for shot in shots]),
        rotation=rotation_from_vector(np.array([shot.numbers("rotation", 3) for shot in shots])),
        crs=_crs(home),
        notes=notes,
        warnings=warnings,
    ).project(NAME, main)


def _camera(shot, cameras):
    if len(cameras) == 1:
        return next(iter(cameras))
    if shot.get("camera") in cameras:
        return shot.text("camera")
    size = [shot.number(key) for key in ("width", "height")]
    focal = shot.number("focal")
    near = {
        name: abs(camera["f"] / max(camera.width, camera.height) - focal)
        for name, camera in cameras.items()
        if [camera.width, camera.height] == size
    }
    if not near:
        raise InputError(f"{shot.where}: cameras.json has no camera of its size; export it again")
    return min(near, key=near.get)


def _crs(home):
    for folder in (home / "odm_georeferencing", home):
        path = folder / "proj.txt"
        if path.is_file():
            return next((line.text.strip() for line in filled(path)), None)
    return None
