"""Time, place, temperature and gyroscope of a project's images, from photographs or a track."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import gnss
from corridor.core.block import POSE
from corridor.core.errors import InputError
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    similarity,
)
from corridor.core.gnss import GEOGRAPHIC, Local
from corridor.core.photographs import (
    Metadata,
    of_picture,
    photographs_in,
    published_readouts,
    read_metadata,
    stated_focal,
)
from corridor.core.preparation import record_derived
from corridor.tools.formats.ground import in_frame, rows_by_name
from corridor.tools.formats.project import Project, local_of, local_table

VELOCITY = ("vx", "vy", "vz")
# Published readout times that differ by more than this are of different modes.
_SAME_MODE = 1.15
# Where a maker gives no standard deviation: of a code receiver, of a float and a fixed solution.
_ASSUMED = {50: (0.03, 0.03, 0.06), 34: (0.5, 0.5, 1.0), 16: (3.0, 3.0, 6.0)}


@dataclass(frozen=True)
class Track:
    """A receiver's file; system, images_system: time systems that the files do not state."""

    path: Path
    system: str | None = None
    images_system: str | None = None


def picture_size(folder: Path) -> tuple[int, int]:
    """Width and height of the photographs, those of the first."""
    photo = read_metadata(photographs_in(folder)[0])
    return photo.width, photo.height_px


def add_photographs(
    project: Project, folder: Path
) -> tuple[Project, dict[int, Metadata], gnss.Exposures | None]:
    """The project with what the photographs of a folder say.

    Also what each says, by row of images.csv, and their times, for `add_track`.

    Raises InputError where no photograph belongs to an image of the project.
    """
    images = project.block.images["image"]
    files = photographs_in(folder)
    row_of = rows_by_name(list(images))
    mine: dict[int, Path] = {}
    for file in files:
        inside = file.relative_to(folder).as_posix()
        row = next(
            (row_of[name] for name in (inside, file.name, file.stem) if name in row_of), None
        )
        if row is not None:
            mine.setdefault(row, file)
    if not mine:
        raise InputError(
            f"none of the {len(files)} photographs of {folder} has the name of an image of the "
            f"project ({images.iloc[0]}, ...); name the folder of its photographs"
        )
    if len(mine) < len(images):
        project = project.having(
            warnings=[
                f"{len(images) - len(mine)} of {len(images)} images have no photograph in "
                f"{folder.name}"
            ]
        )
    photos = {row: read_metadata(file) for row, file in sorted(mine.items())}
    project, exposures = _with_times(project, folder, photos)
    for step in (
        _with_sizes_compared,
        _with_resized_named,
        _with_temperatures,
        _with_motion,
        _with_readout,
        _with_focal,
    ):
        project = step(project, photos)
    project = _with_positions(project, photos, exposures)
    return project, photos, exposures


def _with_times(project, folder, photos):
    names = {photo.name: row for row, photo in photos.items()}
    marks = sorted({*folder.glob("*.MRK"), *folder.glob("*.mrk")})
    notes = []
    try:
        if len(marks) == 1:
            # All of the flight's photographs: the project may have used fewer.
            flight = [file.name for file in photographs_in(marks[0].parent)]
            exposures = gnss.read_exposures(marks[0]).named(flight)
            notes.append(f"times and positions: {marks[0].name} (GPS time)")
        else:
            homes = {photo.path.parent for photo in photos.values()}
            if len(homes) > 1:
                raise InputError("the photographs lie in several folders")
            exposures = gnss.read_exposures(homes.pop())
    except InputError as error:
        return project.having(warnings=[f"no times from the photographs: {error}"]), None
    table = exposures.table[exposures.table["image"].isin(set(names))]
    rows = table["image"].map(names).to_numpy(int)
    time = np.full(len(project.block.images), np.nan)
    time[rows] = table["time_s"]
    known = np.isfinite(time)
    if known.sum() > 1 and np.ptp(time[known]) == 0:
        return project.having(
            notes=notes,
            warnings=["all photographs have one time: their times were left out"],
        ), None
    images = project.block.images["image"].to_numpy()[rows].astype(str)
    table = table.assign(image=pd.array(images, dtype="str")).reset_index(drop=True)
    # A change of two dates asks which of them came first.
    dated = {} if exposures.day is None else {"date": exposures.day}
    return (
        project.having(
            notes=[*notes, *exposures.notes],
            images=_having(project, time_s=time),
            extra={**project.block.extra, **dated},
        ),
        replace(exposures, table=table),
    )


def _having(project, **columns):
    """images.csv with these columns."""
    return project.block.images.assign(**columns)


def _with_sizes_compared(project, photos):
    block = project.block
    for row, photo in photos.items():
        image, name = block.images[["image", "camera"]].iloc[row]
        camera = block.cameras[name]
        if project.form == "photos" and photo.width > camera.width:
            return project.having(
                notes=[
                    f"the block is of pictures made smaller: {camera.width} x {camera.height} px "
                    f"in place of {photo.width} x {photo.height_px}"
                ]
            )
        if (photo.width, photo.height_px) != (camera.width, camera.height):
            return project.having(
                warnings=[
                    f"photograph {image} has {photo.width} x {photo.height_px} px, its camera "
                    f"{camera.width} x {camera.height}: another size was used in the project, or "
                    "these are other photographs"
                ]
            )
    return project


def _with_resized_named(project, photos):
    """Says so where pictures are smaller than they were taken: their rows are not the sensor's."""
    small = [photo for photo in photos.values() if photo.resized]
    if not small:
        return project
    first = small[0]
    taken, stored = (
        f"{width} x {height}"
        for width, height in (first.taken_size, (first.width, first.height_px))
    )
    return project.having(
        notes=[
            f"{len(small)} of {len(photos)} photographs were made smaller after they were taken "
            f"({first.name}: {taken} to {stored} px); row times count the rows as taken"
        ]
    )


def _per_image(project, photos, fact, *shape):
    """A field of the photographs by rows of images.csv; NaN where unknown."""
    values = np.full((len(project.block.images), *shape), np.nan)
    for row, photo in photos.items():
        if getattr(photo, fact) is not None:
            values[row] = getattr(photo, fact)
    return values


def _with_temperatures(project, photos):
    values = _per_image(project, photos, "temperature_c")
    if not np.isfinite(values).any():
        return project
    kinds = sorted({photo.temperature_of for photo in photos.values() if photo.temperature_of})
    return project.having(
        notes=[f"temperatures: {', '.join(kinds)} of the photographs"],
        images=_having(project, temperature_c=values),
    )


def _with_motion(project, photos):
    """Velocities, and the gyroscope's samples."""
    block = project.block
    velocity = _per_image(project, photos, "velocity", 3)
    if np.isfinite(velocity).all(axis=1).any():
        said = sorted({photo.velocity_of for photo in photos.values() if photo.velocity_of})
        project = project.having(
            notes=[f"velocities east, north, up: {'; '.join(said)} of the photographs"],
            images=_having(project, **dict(zip(VELOCITY, velocity.T, strict=True))),
        )
    time = block.column("images", "time_s")
    recorded = {row: photo for row, photo in photos.items() if photo.gyro is not None}
    if not recorded:
        return project
    if not np.isfinite(time).any():
        return project.having(
            notes=["the gyroscope's samples were left out: the images have no times"]
        )
    tables = [
        gyro_rates(photo, time[row]).assign(image=block.images["image"].iloc[row])
        for row, photo in recorded.items()
        if np.isfinite(time[row])
    ]
    return project.having(
        notes=[
            "gyroscope (Parrot): its samples are in rates.csv; its clock was found some 40 ms off "
            "in tests: `corridor readout flight` estimates it"
        ],
        rates=pd.concat(tables, ignore_index=True) if tables else block.rates,
    )


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
    middle = first_row + (photo.line_ns or 0.0) * 1e-9 * (photo.taken_size[1] - 1) / 2
    shift = 0.0 if time_s is None else time_s - middle
    x, y, z = (photo.gyro[axis].astype(float) for axis in "xyz")
    return pd.DataFrame({"time_s": sample + shift, "wx": y, "wy": -x, "wz": z, "image": photo.name})


def _by_camera(project, photos):
    """Each camera with its first photograph."""
    names = project.block.images["camera"]
    first = {names.iloc[row]: photo for row, photo in reversed(photos.items())}
    return [
        (camera, first[name]) for name, camera in project.block.cameras.items() if name in first
    ]


def _with_readout(project, photos):
    cameras, notes = dict(project.block.cameras), []
    for camera, photo in _by_camera(project, photos):
        if not photo.model or camera.readout_s is not None:
            continue
        name, (readout, source) = camera.name, readout_of(photo, camera.height)
        if readout is None:
            notes += [f"camera {name} ({photo.model}): {source}"] if source else []
            continue
        extra = {**camera.extra, "readout_from": source}
        cameras[name] = replace(camera, readout_s=readout, extra=extra)
        notes.append(
            f"camera {name}: readout {1000 * readout:.1f} ms, {source}; 0 if its shutter is global"
        )
    return project.having(notes=notes, cameras=cameras)


def _with_focal(project, photos):
    """Writes the focal length that photographs state, with its sigma: a prior of an adjustment."""
    cameras, notes = dict(project.block.cameras), []
    for camera, photo in _by_camera(project, photos):
        same = abs(photo.width * camera.height / (photo.height_px * camera.width) - 1) < 0.01
        stated = stated_focal(photo, max(camera.width, camera.height)) if same else None
        if camera.calibrated or stated is None:
            continue
        prior = [round(stated.px, 2), round(stated.sigma_px, 2)]
        cameras[camera.name] = replace(camera, extra={**camera.extra, "f_stated": prior})
        notes.append(
            f"camera {camera.name}: f stated {stated.px:.0f} +- {stated.sigma_px:.0f} px "
            f"({stated.of}), a prior where f is estimated (f_stated in block.toml)"
        )
    return project.having(notes=notes, cameras=cameras)


def readout_of(photo: Metadata, height: int) -> tuple[float | None, str]:
    """Seconds from the first to the last row and their source, or None and why, if anything.

    height: of the pictures in question, px.
    """
    if photo.line_ns and photo.tags.get("ModelType", "perspective") == "perspective":
        rows = photo.taken_size[1]
        source = f"{photo.line_ns:g} ns a row by its photographs"
        source += f" of {rows} rows as they were taken" if photo.resized else ""
        return photo.line_ns * 1e-9 * (rows - 1), source
    named = f"{photo.make} {photo.model}"
    every = published_readouts(named) or published_readouts(photo.model)
    if not every:
        return None, ""
    found = of_picture(every, photo.taken_size)
    values = [row.readout_ms for row in found]
    if max(values) > _SAME_MODE * min(values):
        each = {f"{row.readout_ms:g} ms ({row.mode or 'mode not stated'})": 1 for row in found}
        told = ", ".join([*each][:6]) + (", ..." if len(each) > 6 else "")
        return None, (
            "several readout times are published and a picture of {} x {} px does not tell which "
            "is its own: {}; none was taken, give readout_s in block.toml"
        ).format(*photo.taken_size, told)
    # Published times count all rows, ours from the first to the last.
    readout = np.median(values) * 1e-3 * (height - 1) / height
    mode = f", {found[0].mode}, the mode of its pictures" if len(found) < len(every) else ""
    return float(readout), f"published for {photo.model}{mode} ({found[0].source})"


# --- where -----------------------------------------------------------------------------------


def _with_positions(project, photos: dict[int, Metadata], exposures):
    assumed = ""
    if exposures is not None and {"x", "y", "z"} <= set(exposures.table.columns):
        table = exposures.table.rename(columns={"x": "lon", "y": "lat", "z": "height"})
    else:
        table, assumed, notes = _positions_of(list(photos.values()))
        project = project.having(notes=[assumed, *notes] if assumed else notes)
        back = {photo.name: project.block.images["image"].iloc[k] for k, photo in photos.items()}
        table["image"] = table["image"].map(back).astype("str")
        if len(table) and not project.block.lever_arm:
            project = project.having(
                notes=[
                    "lever arm: 0, held (fixed = true): the photographs' own positions are taken "
                    "as those of the camera; state another in block.toml"
                ],
                lever_arm={"default": (0.0, 0.0, 0.0)},
                lever_arm_fixed=True,
            )
    if not len(table):
        return project.having(notes=["the photographs have no positions"])
    columns = [name for name in ("sx", "sy", "sz") if name in table]
    project = _put(project, table[["image", "lon", "lat", "height", *columns]], "the photographs")
    if assumed and len(project.block.gnss):
        sigma = table[["sx", "sy"]].to_numpy(float)
        record_derived(project.block, "gnss.sx", "the kind of receiver", sigma, f"{assumed}.")
    return project


def _positions_of(photos: list[Metadata]) -> tuple[pd.DataFrame, str, list[str]]:
    """image, lon, lat, height, sx, sy, sz (m) of the photographs that have a position, and notes.

    Where the maker states no sigma, that of the kind of solution is assumed: a sentence, or "".
    """
    rows, notes, assumed, without, told = [], [], 0, 0, ""
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
        told = (
            f"{assumed} of {len(rows)} positions come without a standard deviation: 3 m in plan "
            "and 6 m in height were assumed where no RTK flag says better"
        )
    if without:
        notes.append(f"{without} positions have no height: 0 was taken")
    columns = ["image", "lon", "lat", "height", "sx", "sy", "sz"]
    return pd.DataFrame(rows, columns=columns), told, notes


def _put(project: Project, table: pd.DataFrame, what: str) -> Project:
    """Geographic positions as gnss.csv, in the block's frame; the block is placed by them if need.

    table: image, lon, lat, height, sx, sy, sz.
    """
    places = table[["lon", "lat", "height"]].to_numpy(float)
    if not project.placed and project.block.crs is None and local_of(project.block) is None:
        project = _placed(project, table["image"], places, what)
    block = project.block
    if block.crs is None and local_of(block) is None:
        return project.having(
            warnings=[
                f"positions of {what} were left out: nothing says where on Earth the project's "
                "coordinates are; name their system with --crs"
            ]
        )
    out = pd.DataFrame({"image": table["image"].to_numpy()})
    out[["x", "y", "z"]] = in_frame(block, places, GEOGRAPHIC, f"positions of {what}")
    for name in ("sx", "sy", "sz"):
        if name in table:
            sigma = table[name].to_numpy(float)
            out[name] = np.where(sigma > 0, sigma, np.nan)
    return project.having(notes=[f"gnss.csv: {len(out)} positions of {what}"], gnss=out)


def _placed(project: Project, images: pd.Series, places: np.ndarray, what: str) -> Project:
    """A free reconstruction turned, scaled and shifted onto positions, robustly."""
    block = project.block
    lon, lat, _ = np.median(places, axis=0)
    local = Local(round(float(lat), 4), round(float(lon), 4), 0.0)
    target = local.from_geographic(places)
    at = pd.Index(block.images["image"]).get_indexer(images)
    source = block.poses[at, :3]
    source[at < 0] = np.nan
    known = np.isfinite(source).all(axis=1)
    weight = known.astype(float)
    try:
        for _ in range(10):
            found = similarity(source, target, weight)
            away = np.linalg.norm(found.apply(np.nan_to_num(source)) - target, axis=1)
            typical = max(float(np.median(away[known])), 1e-6)
            weight = known / (1 + (away / (2 * typical)) ** 2)
    except InputError as error:
        return project.having(
            warnings=[
                f"the project stays in its own frame: positions of {what} do not place it ({error})"
            ]
        )
    pose = block.poses
    known = np.isfinite(pose).all(axis=1)
    pose[known, :3] = found.apply(pose[known, :3])
    turned = found.apply_to_rotations(rotation_from_quaternion(pose[known, 3:]))
    pose[known, 3:] = quaternion_from_rotation(turned)
    moved = {}
    for name in ("points", "ground"):
        xyz = getattr(block, name)[list(POSE[:3])].to_numpy(float)
        if len(xyz):
            columns = dict(zip(POSE[:3], found.apply(xyz).T, strict=True))
            moved[name] = getattr(block, name).assign(**columns)
    return project.having(
        placed=True,
        notes=[
            f"placed by positions of {what}: scale {found.scale:.6g}, camera centres {typical:.2g} "
            f"m (median) from them; world: east, north, up about {local.lat_deg:g}, "
            f"{local.lon_deg:g}"
        ],
        images=_having(project, **dict(zip(POSE, pose.T, strict=True))),
        offset=np.zeros(3),
        extra={**block.extra, "local_frame": local_table(local)},
        **moved,
    )


def add_track(project: Project, exposures: gnss.Exposures | None, track: Track) -> Project:
    """The project with antenna positions and velocities at the exposures, from a receiver's track.

    exposures: as `add_photographs` returned them; None: the times the project itself has.
    Raises InputError where there are no times, or track and times do not fit.
    """
    block, name = project.block, track.path.name
    if exposures is None:
        if not block.has("images.time_s"):
            raise InputError(
                f"{name}: the project's images have no times; give the photographs "
                "(--photos FOLDER), whose EXIF has them"
            )
        time = block.column("images", "time_s")
        table = pd.DataFrame({"image": block.images["image"], "time_s": time})
        exposures = gnss.Exposures(table, None, None, None, project.source)
    # Positions of a receiver are those of its antenna, whatever the photographs' own were.
    project = project.having(lever_arm={}, lever_arm_fixed=False)
    epochs = gnss.read_track(track.path)
    found = gnss.antenna(
        epochs,
        exposures,
        crs=GEOGRAPHIC if epochs.crs is not None else None,
        track_system=track.system,
        exposures_system=track.images_system,
    )
    project = project.having(notes=found.notes)
    if len(found.refused):
        first = found.refused.iloc[0]
        project = project.having(
            warnings=[
                f"{len(found.refused)} of {len(block.images)} images got no position from {name} "
                f"(first: {first['image']}, {first['why']})"
            ]
        )
    if epochs.crs is None:
        project = project.having(
            notes=[f"gnss.csv: {len(found.gnss)} positions in {name}'s own metres"],
            gnss=found.gnss,
        )
    else:
        table = found.gnss.rename(columns={"x": "lon", "y": "lat", "z": "height"})
        project = _put(project, table, name)
    made = found.interpolated.table
    if not set(VELOCITY) <= set(made.columns):
        return project
    rows = pd.Index(block.images["image"]).get_indexer(exposures.table["image"].astype(str))
    good = rows >= 0
    velocity = np.full((len(block.images), 3), np.nan)
    velocity[rows[good]] = made[list(VELOCITY)].to_numpy()[good]
    velocity[~np.isfinite(velocity).all(axis=1)] = np.nan
    if np.isnan(velocity).all():
        return project
    columns = dict(zip(VELOCITY, velocity.T, strict=True))
    return project.having(images=_having(project, **columns))
