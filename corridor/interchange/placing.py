"""Time, place, temperature and gyroscope of a project's images, from photographs or a track."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor import adjustment, gnss
from corridor.block import Block
from corridor.errors import InputError
from corridor.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.gnss import Local
from corridor.interchange.ground import in_frame, local_of, rows_by_name
from corridor.interchange.project import POSE, Project
from corridor.photographs import (
    Metadata,
    photographs_in,
    published_readouts,
    read_metadata,
)

_GEOGRAPHIC = "EPSG:4979"
# Published readout times that differ by more than this are of different modes.
_SAME_MODE = 1.15
# Where a maker gives no standard deviation: of a code receiver, of a float and a fixed solution.
_ASSUMED = {50: (0.03, 0.03, 0.06), 34: (0.5, 0.5, 1.0), 16: (3.0, 3.0, 6.0)}


def picture_size(folder: Path) -> tuple[int, int]:
    """Width and height of the photographs, those of the first."""
    photo = read_metadata(photographs_in(folder)[0])
    return photo.width, photo.height_px


def add_photographs(project: Project, folder: Path) -> gnss.Exposures | None:
    """Add what the photographs of a folder say; returns their times, for `add_track`.

    Raises InputError where no photograph belongs to an image of the project.
    """
    block = project.block
    files = photographs_in(folder)
    at = rows_by_name(list(block.images["image"]))
    mine: dict[int, Path] = {}
    for file in files:
        inside = file.relative_to(folder).as_posix()
        row = next((at[name] for name in (inside, file.name, file.stem) if name in at), None)
        if row is not None:
            mine.setdefault(row, file)
    if not mine:
        raise InputError(
            f"none of the {len(files)} photographs of {folder} has the name of an image of the "
            f"project ({block.images['image'].iloc[0]}, ...); name the folder of its photographs"
        )
    if len(mine) < len(block.images):
        project.warnings.append(
            f"{len(block.images) - len(mine)} of {len(block.images)} images have no photograph in "
            f"{folder.name}"
        )
    photos = {row: read_metadata(file) for row, file in sorted(mine.items())}
    names = block.images["image"].to_numpy()
    exposures = _times(project, folder, photos, names)
    _sizes(project, photos, names)
    _temperatures(project, photos)
    _gyroscope(project, photos, names)
    _readout(project, photos)
    _positions(project, photos, exposures, names)
    return exposures


def _times(project, folder, photos, names):
    marks = sorted({*folder.glob("*.MRK"), *folder.glob("*.mrk")})
    block = project.block
    try:
        if len(marks) == 1:
            # All of the flight's photographs: the project may have used fewer.
            flight = [file.name for file in photographs_in(marks[0].parent)]
            exposures = gnss.read_exposures(marks[0]).named(flight)
            project.notes.append(f"times and positions: {marks[0].name} (GPS time)")
        else:
            homes = {photo.path.parent for photo in photos.values()}
            if len(homes) > 1:
                raise InputError("the photographs lie in several folders")
            exposures = gnss.read_exposures(homes.pop())
    except InputError as error:
        project.warnings.append(f"no times from the photographs: {error}")
        return None
    time = dict(zip(exposures.table["image"], exposures.table["time_s"], strict=True))
    values = np.full(len(block.images), np.nan)
    rows = {row: photo.name for row, photo in photos.items()}
    for row, name in rows.items():
        values[row] = time.get(name, np.nan)
    known = np.isfinite(values)
    if known.sum() > 1 and np.ptp(values[known]) == 0:
        project.warnings.append("all photographs have one time: their times were left out")
        return None
    block.images["time_s"] = values
    project.notes += list(exposures.notes)
    table = exposures.table[exposures.table["image"].isin(set(rows.values()))]
    back = {name: names[row] for row, name in rows.items()}
    table = table.assign(image=table["image"].map(back).astype("str"))
    return replace(exposures, table=table.reset_index(drop=True))


def _sizes(project, photos, names):
    block = project.block
    for row, photo in photos.items():
        camera = block.cameras[block.images["camera"].iloc[row]]
        if (photo.width, photo.height_px) != (camera.width, camera.height):
            project.warnings.append(
                f"photograph {names[row]} has {photo.width} x {photo.height_px} px, its camera "
                f"{camera.width} x {camera.height}: another size was used in the project, or these "
                "are other photographs"
            )
            return


def _temperatures(project, photos):
    values = np.full(len(project.block.images), np.nan)
    for row, photo in photos.items():
        if photo.temperature_c is not None:
            values[row] = photo.temperature_c
    if np.isfinite(values).any():
        project.block.images["temperature_c"] = values
        kinds = sorted({photo.temperature_of for photo in photos.values() if photo.temperature_of})
        project.notes.append(f"temperatures: {', '.join(kinds)} of the photographs")


def _gyroscope(project, photos, names):
    tables = []
    velocity = np.full((len(project.block.images), 3), np.nan)
    time = project.block.column("images", "time_s")
    clock = np.isfinite(time).any()
    for row, photo in photos.items():
        if photo.velocity is not None:
            velocity[row] = photo.velocity
        if photo.gyro is None or (clock and not np.isfinite(time[row])):
            continue
        tables.append(gyro_rates(photo, time[row] if clock else None).assign(image=names[row]))
    if tables and not clock:
        tables = []
        project.notes.append("the gyroscope's samples were left out: the images have no times")
    if tables:
        project.block.rates = pd.concat(tables, ignore_index=True)
        project.notes.append(
            "gyroscope (Parrot): its samples are in rates.csv; its clock was found some 40 ms off "
            "in tests, estimate it (rolling_shutter_rotation)"
        )
    if np.isfinite(velocity).all(axis=1).any():
        project.block.images[["vx", "vy", "vz"]] = velocity
        said = sorted({photo.velocity_of for photo in photos.values() if photo.velocity_of})
        project.notes.append(f"velocities east, north, up: {'; '.join(said)} of the photographs")


def gyro_rates(photo: Metadata, time_s: float | None) -> pd.DataFrame | None:
    """rates.csv of one photograph: time_s, wx, wy, wz (rad/s, camera frame), image.

    time_s: of the middle row, on the block's clock; None: seconds since the camera's start.
    Parrot's axes are x forward, y right, z down; the top of the picture is forward: wx = y,
    wy = -x, wz = z. The first row lies IMUTimeOffset after the first sample. None without samples.
    """
    if photo.gyro is None:
        return None
    sample = photo.gyro["us"].astype(float) * 1e-6
    first_row = sample[0] + (photo.number("IMUTimeOffset") or 0.0) * 1e-9
    middle = first_row + (photo.line_ns or 0.0) * 1e-9 * (photo.height_px - 1) / 2
    shift = 0.0 if time_s is None else time_s - middle
    x, y, z = (photo.gyro[axis].astype(float) for axis in "xyz")
    return pd.DataFrame({"time_s": sample + shift, "wx": y, "wy": -x, "wz": z, "image": photo.name})


def _readout(project, photos):
    block = project.block
    for name, camera in list(block.cameras.items()):
        mine = [
            photo
            for row, photo in photos.items()
            if block.images["camera"].iloc[row] == name and photo.model
        ]
        if not mine or camera.readout_s is not None:
            continue
        photo = mine[0]
        if photo.line_ns and photo.tags.get("ModelType", "perspective") == "perspective":
            readout = photo.line_ns * 1e-9 * (camera.height - 1)
            source = f"{photo.line_ns:g} ns a row by its photographs"
        else:
            found = published_readouts(f"{photo.make} {photo.model}") or published_readouts(
                photo.model
            )
            values = [row.readout_ms for row in found]
            if not values:
                continue
            if max(values) > _SAME_MODE * min(values):
                project.notes.append(
                    f"camera {name} ({photo.model}): published readout times run from "
                    f"{min(values):g} to {max(values):g} ms by mode; none was taken"
                )
                continue
            # Published times count all rows, ours from the first to the last.
            readout = np.median(values) * 1e-3 * (camera.height - 1) / camera.height
            source = f"published for {photo.model} ({found[0].source})"
        block.cameras[name] = replace(camera, readout_s=float(readout))
        project.notes.append(
            f"camera {name}: readout {1000 * readout:.1f} ms, {source}; 0 if its shutter is global"
        )


# --- where -----------------------------------------------------------------------------------


def _positions(project, photos: dict[int, Metadata], exposures, names):
    if exposures is not None and {"x", "y", "z"} <= set(exposures.table.columns):
        table = exposures.table.rename(columns={"x": "lon", "y": "lat", "z": "height"})
    else:
        table = _positions_of(list(photos.values()), project.notes)
        back = {photo.name: names[row] for row, photo in photos.items()}
        table["image"] = table["image"].map(back).astype("str")
    if not len(table):
        project.notes.append("the photographs have no positions")
        return
    columns = [name for name in ("sx", "sy", "sz") if name in table]
    _put(project, table[["image", "lon", "lat", "height", *columns]], "the photographs")


def _positions_of(photos: list[Metadata], notes: list[str]) -> pd.DataFrame:
    """image, lon, lat, height, sx, sy, sz (m) of the photographs that have a position.

    Where the maker states no sigma, that of the kind of solution is assumed, and said.
    """
    rows, assumed, without = [], 0, 0
    for photo in photos:
        if photo.lat_deg is None:
            continue
        without += photo.height is None
        sigma = photo.sigma
        if sigma is None:
            assumed += 1
            flag = photo.flag if photo.flag is not None else 16
            kind = 50 if flag == 50 else 34 if 32 <= flag <= 49 else 16
            sigma = _ASSUMED[kind]
        rows.append((photo.name, photo.lon_deg, photo.lat_deg, photo.height or 0.0, *sigma))
    if assumed:
        notes.append(
            f"{assumed} of {len(rows)} positions come without a standard deviation: 3 m in plan "
            "and 6 m in height were assumed where no RTK flag says better"
        )
    if without:
        notes.append(f"{without} positions have no height: 0 was taken")
    return pd.DataFrame(rows, columns=["image", "lon", "lat", "height", "sx", "sy", "sz"])


def _put(project: Project, table: pd.DataFrame, what: str) -> None:
    """Geographic positions as gnss.csv, in the block's frame; the block is placed by them if need.

    table: image, lon, lat, height, sx, sy, sz.
    """
    block = project.block
    places = table[["lon", "lat", "height"]].to_numpy(float)
    if not project.placed and block.crs is None and local_of(block) is None:
        _place(project, table["image"], places, what)
    if block.crs is None and local_of(block) is None:
        project.warnings.append(
            f"positions of {what} were left out: nothing says where on Earth the project's "
            "coordinates are; name their system with --crs"
        )
        return
    out = pd.DataFrame({"image": table["image"].to_numpy()})
    out[["x", "y", "z"]] = in_frame(block, places, _GEOGRAPHIC, f"positions of {what}")
    for name in ("sx", "sy", "sz"):
        if name in table:
            sigma = table[name].to_numpy(float)
            out[name] = np.where(sigma > 0, sigma, np.nan)
    block.gnss = out
    block.__post_init__()
    project.notes.append(f"gnss.csv: {len(out)} positions of {what}")


def _place(project: Project, images: pd.Series, places: np.ndarray, what: str) -> None:
    """Turn, scale and shift a free reconstruction onto positions, robustly."""
    block = project.block
    lon, lat, _ = np.median(places, axis=0)
    local = Local(round(float(lat), 4), round(float(lon), 4), 0.0)
    target = local.from_geographic(places)
    at = pd.Index(block.images["image"]).get_indexer(images)
    good = at >= 0
    source = np.full((len(places), 3), np.nan)
    source[good] = block.images[list(POSE[:3])].to_numpy(float)[at[good]]
    known = np.isfinite(source).all(axis=1)
    weight = known.astype(float)
    try:
        for _ in range(10):
            found = adjustment.similarity(source, target, weight)
            away = np.linalg.norm(found.apply(np.nan_to_num(source)) - target, axis=1)
            typical = max(float(np.median(away[known])), 1e-6)
            weight = known / (1 + (away / (2 * typical)) ** 2)
    except InputError as error:
        project.warnings.append(
            f"the project stays in its own frame: positions of {what} do not place it ({error})"
        )
        return
    _apply(block, found)
    block.extra["local_frame"] = {
        "lat_deg": local.lat_deg, "lon_deg": local.lon_deg, "height": local.height
    }  # fmt: skip
    project.placed = True
    project.notes.append(
        f"placed by positions of {what}: scale {found.scale:.6g}, camera centres {typical:.2g} m "
        f"(median) from them; world: east, north, up about {local.lat_deg:g}, {local.lon_deg:g}"
    )


def _apply(block: Block, found) -> None:
    pose = block.images[list(POSE)].to_numpy(float)
    known = np.isfinite(pose).all(axis=1)
    pose[known, :3] = found.apply(pose[known, :3])
    turned = found.apply_to_rotations(rotation_from_quaternion(pose[known, 3:]))
    pose[known, 3:] = quaternion_from_rotation(turned)
    block.images[list(POSE)] = pose
    for table in (block.points, block.ground):
        if len(table):
            table[["x", "y", "z"]] = found.apply(table[["x", "y", "z"]].to_numpy(float))
    block.offset = np.zeros(3)


def add_track(
    project: Project,
    path: Path,
    exposures: gnss.Exposures | None,
    track_system: str | None = None,
    images_system: str | None = None,
) -> None:
    """Antenna positions and velocities at the exposures, from a receiver's track.

    exposures: as `add_photographs` returned them; None: the times the project itself has.
    Raises InputError where there are no times, or track and times do not fit.
    """
    block = project.block
    if exposures is None:
        if not block.has("images.time_s"):
            raise InputError(
                f"{path.name}: the project's images have no times; give the photographs "
                "(--photos FOLDER), whose EXIF has them"
            )
        table = pd.DataFrame(
            {"image": block.images["image"], "time_s": block.column("images", "time_s")}
        )
        exposures = gnss.Exposures(table, None, None, None, project.source)
    track = gnss.read_track(path)
    found = gnss.antenna(
        track, exposures, crs=_GEOGRAPHIC if track.crs is not None else None,
        track_system=track_system, exposures_system=images_system,
    )  # fmt: skip
    project.notes += list(found.notes)
    if len(found.refused):
        project.warnings.append(
            f"{len(found.refused)} of {len(block.images)} images got no position from {path.name} "
            f"(first: {found.refused['image'].iloc[0]}, {found.refused['why'].iloc[0]})"
        )
    if track.crs is None:
        block.gnss = found.gnss
        block.__post_init__()
        project.notes.append(f"gnss.csv: {len(found.gnss)} positions in {path.name}'s own metres")
    else:
        table = found.gnss.rename(columns={"x": "lon", "y": "lat", "z": "height"})
        _put(project, table, path.name)
    _velocities(block, found, exposures)


def _velocities(block, found, exposures):
    made = found.interpolated.table
    if not {"vx", "vy", "vz"} <= set(made.columns):
        return
    rows = pd.Index(block.images["image"]).get_indexer(exposures.table["image"].astype(str))
    velocity = np.full((len(block.images), 3), np.nan)
    good = rows >= 0
    velocity[rows[good]] = made[["vx", "vy", "vz"]].to_numpy()[good]
    if np.isfinite(velocity).all(axis=1).any():
        velocity[~np.isfinite(velocity).all(axis=1)] = np.nan
        block.images[["vx", "vy", "vz"]] = velocity
