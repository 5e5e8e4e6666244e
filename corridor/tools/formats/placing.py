"""Time, place, temperature and gyroscope of a project's images, from photographs or a track."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import gnss
from corridor.core.block import POSE, VELOCITY, Block
from corridor.core.errors import InputError, some
from corridor.core.geometry import robust_scale, rotation_from_quaternion, similarity
from corridor.core.gnss import GEOGRAPHIC, Local, local_of
from corridor.core.photographs import (
    Metadata,
    global_shutter,
    of_picture,
    photographs_in,
    published_readouts,
    read_metadata,
)
from corridor.core.preparation import (
    AGREES,
    ARBITRARY,
    CONTRADICTS,
    FRAME,
    UNCHECKED,
    Witness,
    paired_speeds,
    velocity_warnings,
)
from corridor.tools.formats.control import moved_by
from corridor.tools.formats.focal import stated_focal
from corridor.tools.formats.frames import local_table
from corridor.tools.formats.ground import in_frame
from corridor.tools.formats.heights import unit_that_fits
from corridor.tools.formats.names import Names
from corridor.tools.formats.project import Project
from corridor.tools.formats.starting import rotations_of

_LEAST_PAIRS = 5
# Positions this near are one position; attitudes of gimbals and compasses are good to 5 degrees.
_SAME_PLACE_M, _ATTITUDE_RAD, _BESIDE = 0.01, 0.09, 2.0
# EXIF may be written to a hundredth of a second of arc, 0.3 m; farther apart are two positions.
_TWO_POSITIONS_M = 1.0
# By so many times the assumed standard deviation positions scatter about a way that fits.
_SCATTERS = 2.0
# A stated focal length this many sigmas from that of a project is contradicted.
_CONTRADICTED = 5.0
# A drone that takes no picture for so long, and for so many times the usual, has landed between:
# batteries are changed in some minutes, and the next line is begun in less.
_LANDED_S, _LANDED = 300.0, 20.0
# Published readout times that differ by more than this are of different modes.
_SAME_MODE = 1.15
# Where a maker gives no standard deviation: of a code receiver, of a float and a fixed solution.
_STATUS = {0: "no solution", 16: "a single position without corrections"}
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
    names, called = Names(images), {name.rpartition("/")[2] for name in images}
    # Copies in other formats may lie beside them.
    files = sorted(photographs_in(folder), key=lambda file: file.name not in called)
    mine: dict[int, Path] = {}
    for file in files:
        inside = file.relative_to(folder).as_posix()
        found = map(names.row, (inside, file.name, file.stem))
        row = next((row for row in found if row is not None), None)
        if row is not None:
            mine.setdefault(row, file)
    if not mine:
        raise InputError(
            f"none of the {len(files)} photographs of {folder} has the name of an image of the "
            f"project ({images.iloc[0]}, ...); name the folder of its photographs"
        )
    if len(mine) < len(images):
        project = project.warned(
            f"{len(images) - len(mine)} of {len(images)} images have no photograph in {folder.name}"
        )
    photos = {row: read_metadata(file) for row, file in sorted(mine.items())}
    project, exposures = _with_times(project, folder, photos)
    for step in (
        _with_flights,
        _with_sizes_compared,
        _with_resized_named,
        _with_temperatures,
        _with_readout,
        _with_focal,
    ):
        project = step(project, photos)
    project = _with_positions(project, photos, exposures)
    # A frame that comes with ground points is known only then.
    if has_north(project) or project.placed:
        project = with_motion(project, photos)
    return project, photos, exposures


def _with_times(project, folder, photos):
    homes: dict[Path, dict[int, Metadata]] = {}
    whole = len(_marks_in(folder)) == 1
    for row, photo in photos.items():
        homes.setdefault(folder if whole else photo.path.parent, {})[row] = photo
    parts, notes = [], []
    try:
        for home, mine in homes.items():
            marks = _marks_in(home)
            if len(marks) != 1:
                part, rows = gnss.of_photographs(home, list(mine.values())), list(mine)
            else:
                # All of the flight's photographs: the project may have used fewer.
                files = photographs_in(home)
                part = gnss.read_exposures(marks[0]).named(gnss.names_in(home, files))
                notes.append(f"times and positions: {marks[0].name} (GPS time)")
                of_path = {photo.path: row for row, photo in mine.items()}
                of_name = zip(gnss.names_in(home, files), map(of_path.get, files), strict=True)
                rows = part.table["image"].map(dict(of_name))
            parts.append(replace(part, table=part.table.assign(row=rows).dropna(subset=["row"])))
        exposures = on_one_clock(parts)
    except InputError as error:
        return project.warned(f"no times from the photographs: {error}"), None
    rows = exposures.table["row"].to_numpy(int)
    table = exposures.table.drop(columns="row")
    time = np.full(len(project.block.images), np.nan)
    time[rows] = table["time_s"]
    known = np.isfinite(time)
    if known.sum() > 1 and np.ptp(time[known]) == 0:
        return project.having(
            notes=notes, warnings=["all photographs have one time: their times were left out"]
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


def on_one_clock(parts: Sequence[gnss.Exposures]) -> gnss.Exposures:
    """The exposures of several folders as one, from the day of the first on.

    Raises InputError where their clocks are not of one time system.
    """
    first, systems = parts[0], sorted({part.time_system or "not named" for part in parts})
    if len(parts) == 1:
        return first
    if len(systems) > 1:
        raise InputError(
            f"the photographs lie in {len(parts)} folders, and their times are in different "
            f"systems ({', '.join(systems)})"
        )
    later = [gnss.DAY_S * gnss.days_between(first.day or "", part.day or "") for part in parts]
    tables = [part.table.assign(time_s=part.table["time_s"] + s)
              for part, s in zip(parts, later, strict=True)]  # fmt: skip
    return replace(
        first,
        table=pd.concat(tables, ignore_index=True),
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        resolution_s=max(part.resolution_s or 0.0 for part in parts) or None,
    )


def _marks_in(folder: Path) -> list[Path]:
    return sorted({*folder.glob("*.MRK"), *folder.glob("*.mrk")})


def _with_flights(project, photos):
    """Flights of images.csv: one of each drone, by its serial number, and of each long stay."""
    block = project.block
    if block.has("images.flight"):
        return project
    serial = np.array([""] * len(block.images), dtype=object)
    for row, photo in photos.items():
        serial[row] = photo.serial
    time = block.column("images", "time_s")
    drones = pd.factorize(serial)[0] if len(photos) == len(serial) and all(serial) else 0
    flight, witnesses = np.zeros(len(serial), int) + drones, []
    if np.max(drones) > 0:
        witnesses.append(Witness("serial numbers", AGREES, f"{np.max(drones) + 1} drones"))
    told = [photos[row].tags.get("FlightUUID", "") for row in photos]
    gaps = []
    if all(told) and len(photos) == len(serial):
        # Parrot numbers its flights.
        flight = pd.factorize(np.array(told)[np.argsort(list(photos))])[0]
        if flight.max() > 0:
            witnesses.append(Witness("FlightUUID", AGREES, f"{flight.max() + 1} flights"))
    for drone in () if all(told) else np.unique(flight):
        mine = np.flatnonzero((flight == drone) & np.isfinite(time))
        mine = mine[np.argsort(time[mine], kind="stable")]
        step = np.diff(time[mine])
        if not len(step):
            continue
        long = step > max(_LANDED_S, _LANDED * float(np.median(step)))
        gaps += step[long].tolist()
        flight[mine[1:]] += (np.max(flight) + 1) * np.cumsum(long)
    if gaps:
        witnesses.append(
            Witness("times", AGREES, f"a gap of {min(gaps):.0f} s and more between flights")
        )
    if not witnesses:
        return project
    order = {one: k for k, one in enumerate(dict.fromkeys(flight[np.argsort(time)].tolist()), 1)}
    names = pd.array([f"F{order[one]}" for one in flight.tolist()], dtype="str")
    told = f"{len(order)} flights: {', and '.join(f'{w.source} ({w.text})' for w in witnesses)}"
    project = project.having(notes=[told], images=_having(project, flight=names))
    return project.deriving("images.flight", "the photographs", None, told, witnesses=witnesses)


def _having(project, **columns):
    """images.csv with these columns."""
    return project.block.images.assign(**columns)


def _with_sizes_compared(project, photos):
    block = project.block
    for row, photo in photos.items():
        image, name = block.images[["image", "camera"]].iloc[row]
        camera = block.cameras[name]
        if project.form == "photos" and photo.width > camera.width:
            return project.noted(
                f"the block is of pictures made smaller: {camera.width} x {camera.height} px "
                f"in place of {photo.width} x {photo.height_px}"
            )
        if (photo.width, photo.height_px) != (camera.width, camera.height):
            return project.warned(
                f"photograph {image} has {photo.width} x {photo.height_px} px, its camera "
                f"{camera.width} x {camera.height}: another size was used in the project, or "
                "these are other photographs"
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
    return project.noted(
        f"{len(small)} of {len(photos)} photographs were made smaller after they were taken "
        f"({first.name}: {taken} to {stored} px); row times count the rows as taken"
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


def with_motion(project: Project, photos: dict[int, Metadata]) -> Project:
    """The project with the velocities of photographs, and the gyroscope's samples.

    Velocities are east, north, up: only a project whose frame has a north gets them.
    """
    block = project.block
    velocity = _per_image(project, photos, "velocity", 3)
    known = np.isfinite(velocity).all(axis=1)
    if known.any() and not set(VELOCITY) <= set(block.images.columns):
        said = sorted({photo.velocity_of for photo in photos.values() if photo.velocity_of})
        project = _with_velocities(project, velocity, f"{'; '.join(said)} of the photographs")
    time = block.column("images", "time_s")
    recorded = {row: photo for row, photo in photos.items() if photo.gyro is not None}
    if not recorded or len(block.rates):
        return project
    if not np.isfinite(time).any():
        return project.noted("the gyroscope's samples were left out: the images have no times")
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


def has_north(project: Project) -> bool:
    """Whether the project's axes are east, north, up in metres."""
    return project.block.crs is not None or local_of(project.block) is not None


def in_own_frame(project: Project) -> Project:
    """The project, which says so if it is in the free frame of a reconstruction."""
    if project.placed or has_north(project):
        return project
    extra = {**project.block.extra, FRAME: ARBITRARY}
    return project.having(
        extra=extra,
        warnings=[
            "nothing places the project: its frame and its scale are arbitrary (frame in "
            "block.toml), so lengths and speeds are in no unit"
        ],
    )


def _with_velocities(project: Project, velocity: np.ndarray, source: str) -> Project:
    """The project with velocities (images, 3) east, north, up, compared with the way flown."""
    told = f"velocities east, north, up: {source}"
    columns = dict(zip(VELOCITY, velocity.T, strict=True))
    made = project.having(notes=[told], images=_having(project, **columns))
    doubts, pairs = velocity_warnings(made.block), paired_speeds(made.block)
    if doubts:
        witness = Witness("positions and times", CONTRADICTS, doubts[0])
    elif len(pairs.told) < _LEAST_PAIRS:
        witness = Witness("positions and times", UNCHECKED, "too slow, or too few neighbours")
    else:
        length = f"{np.median(pairs.along):.2f} of the way flown, {len(pairs.told)} pairs"
        witness = Witness("positions and times", AGREES, length)
    # Without a place on Earth nothing but the way that was flown tells where north is.
    if not (has_north(project) or project.placed and witness.says == AGREES):
        return project.warned(
            f"{told}, were left out: nothing says where north is in the project's frame, or "
            "how long a metre; give ground points (--ground) with their system, or photographs "
            "with positions"
        )
    made = made.deriving("stated velocity", source, None, told, "east, north, up", [witness])
    return replace(made, warnings=[*made.warnings, *doubts])


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
    """Each camera with its photographs."""
    names, mine = project.block.images["camera"], {}
    for row, photo in photos.items():
        mine.setdefault(names.iloc[row], []).append(photo)
    return [(c, mine[name]) for name, c in project.block.cameras.items() if name in mine]


def _with_readout(project, photos):
    cameras, notes = dict(project.block.cameras), []
    turned = _turned_by_a_quarter(photos)
    if turned:
        project = project.warned(
            f"{len(turned)} of {len(photos)} photographs are turned by 90 degrees against the "
            f"others of their camera ({some(turned)}): they became a camera of their own, "
            "whose rows follow each other along x, or whose pixels a viewer has turned. It "
            "gets no readout time. Take the originals, or turn them back, and import again"
        )
    for camera, mine in _by_camera(project, photos):
        photo, name = mine[0], camera.name
        if not photo.model or camera.readout_s is not None or photo.name in turned:
            continue
        by_row = [one for one in mine if not at_once(one)]
        readout, source = readout_of(photo, camera.height)
        if by_row and len(by_row) < len(mine):
            readout = None
            source = (
                f"{len(by_row)} of {len(mine)} photographs were taken with the electronic "
                f"shutter (first: {by_row[0].name}), which reads row by row, the others with one "
                "that exposes all rows at once: no readout time was taken; import the two apart"
            )
        if readout is None:
            told = f"camera {name} ({photo.model}): {source}"
        elif readout:
            told = f"camera {name}: readout {1000 * readout:.1f} ms, {source}; 0 if its shutter is "
            told += "global"
        else:
            told = f"camera {name}: all rows are exposed at once, readout 0 ms ({source})"
        if not source:
            continue
        notes.append(told)
        extra = {**camera.extra, "readout_from": source}
        cameras[name] = replace(camera, readout_s=readout, extra=extra)
    return project.having(notes=notes, cameras=cameras)


def _turned_by_a_quarter(photos) -> list[str]:
    """Names of photographs of which more of the same camera have width and height exchanged.

    Of as many, those that stand upright: rows of sensors are long.
    """
    many = Counter((photo.model, photo.width, photo.height_px) for photo in photos.values())

    def turned(model: str, width: int, height: int) -> bool:
        own, others = many[model, width, height], many[model, height, width]
        return others > own or (others == own and height > width)

    return [p.name for p in photos.values() if turned(p.model, p.width, p.height_px)]


def _with_focal(project, photos):
    """Writes the focal length that photographs state, with its sigma: a prior of an adjustment."""
    cameras, notes = dict(project.block.cameras), []
    for camera, (photo, *_) in _by_camera(project, photos):
        same = abs(photo.width * camera.height / (photo.height_px * camera.width) - 1) < 0.01
        stated = stated_focal(photo, max(camera.width, camera.height)) if same else None
        extra = dict(camera.extra)
        measured = extra.pop("f_measured", None)
        cameras[camera.name] = replace(camera, extra=extra)
        if camera.calibrated or stated is None:
            continue
        # A statement that the pictures contradict is as good as it is contradicted.
        own = measured or camera["f"]
        away = abs(own - stated.px)
        contradicted = project.form != "photos" and away > _CONTRADICTED * stated.sigma_px
        sigma = max(stated.sigma_px, away if measured or contradicted else 0.0)
        extra["f_stated"] = [round(stated.px, 2), round(sigma, 2)]
        cameras[camera.name] = replace(camera, extra=extra)
        told = (
            f"; the project has {own:.0f} px: the difference is its sigma" if contradicted else ""
        )
        notes.append(
            f"camera {camera.name}: f stated {stated.px:.0f} +- {sigma:.0f} px "
            f"({stated.of}), a prior where f is estimated (f_stated in block.toml){told}"
        )
    return project.having(notes=notes, cameras=cameras)


def at_once(photo: Metadata) -> str:
    """Who says that all rows of a photograph were exposed at once; empty where nobody does.

    DJI's XMP names the shutter (user manuals of Mavic 3M and Matrice 4, "ShutterType"); else the
    model, with the size of its picture and how long it was exposed.
    """
    known = global_shutter(f"{photo.make} {photo.model}") or global_shutter(photo.model)
    shutter = photo.tags.get("ShutterType", "")
    if "mechanical" in shutter.lower():
        return f"{shutter} shutter by its photographs"
    if not known or (shutter and known.shortest_s):
        return ""
    return str(known) if known.takes(photo.taken_size, photo.exposure_s) else ""


def readout_of(photo: Metadata, height: int) -> tuple[float | None, str]:
    """Seconds from the first to the last row and their source, or None and why, if anything.

    height: of the pictures in question, px.
    """
    if said := at_once(photo):
        return 0.0, said
    if photo.line_ns and photo.tags.get("ModelType", "perspective") == "perspective":
        rows = photo.taken_size[1]
        source = f"{photo.line_ns:g} ns a row by its photographs"
        source += f" of {rows} rows as they were taken" if photo.resized else ""
        return photo.line_ns * 1e-9 * (rows - 1), source
    named = f"{photo.make} {photo.model}"
    every = published_readouts(named) or published_readouts(photo.model)
    if not every:
        return None, (
            "its electronic shutter took them, which reads row by row; its readout time is not "
            "known"
            if global_shutter(photo.model)
            else ""
        )
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
    mode = found[0].mode if len(found) < len(every) else ""
    mode = mode and f", {mode}, the mode of its pictures"
    return float(readout), f"published for {photo.model}{mode} ({found[0].source})"


# --- where -----------------------------------------------------------------------------------


def _with_positions(project, photos: dict[int, Metadata], exposures):
    assumed = ""
    if exposures is not None and {"x", "y", "z"} <= set(exposures.table.columns):
        table = exposures.table.rename(columns={"x": "lon", "y": "lat", "z": "height"})
    else:
        images = project.block.images["image"].iloc[list(photos)]
        table, assumed, notes = _positions_of(dict(zip(images, photos.values(), strict=True)))
        project = project.having(notes=[assumed, *notes] if assumed else notes)
        apart = [photo.apart_m for photo in photos.values() if photo.apart_m is not None]
        apart = [metres for metres in apart if metres > _TWO_POSITIONS_M]
        if apart:
            project = project.warned(
                f"EXIF and XMP of {len(apart)} photographs put them {np.median(apart):,.1f} m "
                "(median) apart horizontally: XMP's positions were read; if a program wrote better "
                "ones into EXIF, take the XMP out of the photographs"
            )
        if len(table) and not project.block.lever_arm:
            project = project.having(
                notes=[
                    "lever arm: 0, held (fixed = true): the photographs' own positions are taken "
                    "as those of the camera; state another in block.toml"
                ],
                lever_arm={"default": (0.0, 0.0, 0.0)},
                lever_arm_fixed=True,
            )
    # A mark without a fix has a time and no place.
    table = table[table[["lon", "lat"]].notna().all(axis=1)]
    if not len(table):
        return project.noted("the photographs have no positions")
    columns = [name for name in ("sx", "sy", "sz") if name in table]
    turns = rotations_of(list(photos.values()))
    names = project.block.images["image"].iloc[list(photos)]
    attitudes = dict(zip(names, turns, strict=True))
    table = table[["image", "lon", "lat", "height", *columns]]
    project = _put(project, table, "the photographs", attitudes)
    if assumed and len(project.block.gnss):
        sigma = table[["sx", "sy"]].to_numpy(float)
        seen = [_scatter(project.block, float(np.median(sigma)))]
        return project.deriving("gnss.sx", "the kind of receiver", sigma, assumed, witnesses=seen)
    return project


def _scatter(block: Block, sigma: float) -> Witness:
    """What the mapped centres say of an assumed standard deviation in plan, m."""
    source, rows = "the mapped centres", block.image_rows("gnss")
    off = block.numbers("gnss", *"xy") - block.numbers("images", *"xy")[rows]
    off = off[np.isfinite(off).all(axis=1)]
    if len(off) < _LEAST_PAIRS:
        return Witness(source, UNCHECKED, "too few images have both")
    scatter = float(robust_scale(off))
    # Errors that all positions share are not in it: less is no contradiction.
    says = CONTRADICTS if scatter > _SCATTERS * sigma else AGREES
    return Witness(source, says, f"{scatter:.2g} m about them")


def _positions_of(photos: Mapping[str, Metadata]) -> tuple[pd.DataFrame, str, list[str]]:
    """image, lon, lat, height, sx, sy, sz (m) of the photographs that have a position, and notes.

    Where the maker states no sigma, that of the kind of solution is assumed: a sentence, or "".
    """
    rows, notes, assumed, without, told = [], [], 0, 0, ""
    poor: Counter[int] = Counter()
    for image, photo in photos.items():
        if photo.lat_deg is None:
            continue
        without += photo.height is None
        flag, sigma = photo.flag, photo.sigma
        kind = 50 if flag == 50 else 34 if flag is not None and 32 <= flag <= 49 else 16
        poor[flag] += flag not in (None, 50)
        if sigma is None:
            assumed += 1
            sigma = _ASSUMED[kind]
        elif flag not in (None, 50):
            # What a receiver states of a position that is no fix is its noise, not its error.
            sigma = tuple(np.maximum(sigma, _ASSUMED[kind]))
        height = np.nan if photo.height is None else photo.height
        rows.append((image, photo.lon_deg, photo.lat_deg, height, *sigma))
    if assumed:
        told = (
            f"{assumed} of {len(rows)} positions come without a standard deviation: 3 m "
            "horizontally and 6 m in height were assumed where no RTK flag says better"
        )
    for flag, many in sorted((f, n) for f, n in poor.items() if n):
        what = "a float solution" if 32 <= flag <= 49 else _STATUS.get(flag, "which is not a fix")
        notes.append(
            f"{many} of {len(rows)} positions have RtkFlag {flag}, {what}: they count as good to "
            f"{_ASSUMED[34 if 32 <= flag <= 49 else 16][0]:g} m horizontally, whatever they state"
        )
    if without:
        notes.append(
            f"{without} positions have no height: they may place the project, and are no "
            "measurements of it"
        )
    columns = ["image", "lon", "lat", "height", "sx", "sy", "sz"]
    return pd.DataFrame(rows, columns=columns), told, notes


def _put(
    project: Project,
    table: pd.DataFrame,
    what: str,
    attitudes: Mapping[str, np.ndarray] | None = None,
) -> Project:
    """Geographic positions as gnss.csv, in the block's frame; the block is placed by them if need.

    table: image, lon, lat, height (NaN: unknown), sx, sy, sz. attitudes: (3, 3) world to camera,
    by image.
    """
    places = table[["lon", "lat", "height"]].to_numpy(float, copy=True)
    known = np.isfinite(places[:, 2])
    places[~known, 2] = np.median(places[known, 2]) if known.any() else 0.0
    if not project.placed and project.block.crs is None and local_of(project.block) is None:
        project = _placed(project, table, places, what, attitudes or {})
    block = project.block
    if block.crs is None and local_of(block) is None:
        return project.warned(
            f"positions of {what} were left out: nothing says where on Earth the project's "
            "coordinates are; name their system with --crs"
        )
    out = pd.DataFrame({"image": table["image"].to_numpy()})
    out[["x", "y", "z"]] = in_frame(block, places, GEOGRAPHIC, f"positions of {what}")
    for name in ("sx", "sy", "sz"):
        if name in table:
            sigma = table[name].to_numpy(float)
            out[name] = np.where(sigma > 0, sigma, np.nan)
    out = out[known].reset_index(drop=True)
    if not len(out):
        return project
    return project.having(notes=[f"gnss.csv: {len(out)} positions of {what}"], gnss=out)


def _placed(
    project: Project,
    table: pd.DataFrame,
    places: np.ndarray,
    what: str,
    attitudes: Mapping[str, np.ndarray],
) -> Project:
    """A free reconstruction turned, scaled and shifted onto positions and attitudes, robustly.

    Attitudes are asked only for what positions on one line leave open, the turn about it.
    """
    block = project.block
    local = Local.amid(places, GEOGRAPHIC)
    target = local.from_geographic(places)
    at = pd.Index(block.images["image"]).get_indexer(table["image"])
    source = block.poses[at, :3]
    source[at < 0] = np.nan
    known = np.isfinite(source).all(axis=1)
    if known.any() and np.ptp(target[known], axis=0).max() < _SAME_PLACE_M:
        why = (
            "all positions of {} are the same, they place"
            if known.sum() > 1
            else ("one position of {} alone places")
        )
        return project.warned(f"the project stays in its own frame: {why.format(what)} nothing")
    stated = table["sx"].to_numpy(float) if "sx" in table else np.zeros(0)
    sigma = float(np.nanmedian(stated)) if np.isfinite(stated).any() else _ASSUMED[16][0]
    turns = np.array([attitudes.get(name, np.full((3, 3), np.nan)) for name in table["image"]])
    asked = _by_axes(block.poses[at], source, target, turns, sigma)
    axes, directions, axes_weight = asked or (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    if len(axes) and (off := _turned_away(axes, directions, source, target, sigma)):
        project = project.warned(
            f"the attitudes of {what} are turned by {np.degrees(off):.0f} degrees against their "
            "positions and were left aside: does the camera look sideways in its mount, or count "
            "another angle from north?"
        )
        axes, directions, axes_weight = axes[:0], directions[:0], axes_weight[:0]
    weight = known.astype(float)
    try:
        for _ in range(10):
            found = similarity(
                np.concatenate([source, axes]),
                np.concatenate([target, directions]),
                np.concatenate([weight, axes_weight]),
            )
            away = np.linalg.norm(found.apply(np.nan_to_num(source)) - target, axis=1)
            typical = max(float(np.median(away[known])), 1e-6)
            weight = known / (1 + (away / (2 * typical)) ** 2)
    except InputError as error:
        return project.warned(
            f"the project stays in its own frame: positions of {what} do not place it ({error})"
        )
    xyz = found.apply(block.ground[list(POSE[:3])].to_numpy(float))
    with_attitudes = " and their attitudes" if len(axes) else ""
    moved, warnings = moved_by(project, found), []
    if told := unit_that_fits(f"positions of {what}", source, target):
        warnings.append(
            f"{told}, by the shape of the flight: write metres, for until then the block is bent "
            "to them"
        )
    if np.nanmedian(rotation_from_quaternion(moved.block.poses[:, 3:])[:, 2, 2]) > 0:
        # A mirrored flight fits upside down, for its positions lie nearly in a plane.
        warnings.append(
            f"placed by positions of {what} the cameras look up: unless they were taken from "
            "below, the positions are mirrored; is the sign of latitude or longitude lost (N, S, "
            "E, W), or are the two exchanged?"
        )
    return moved.having(
        placed=True,
        warnings=warnings,
        notes=[
            f"placed by positions of {what}{with_attitudes}: scale {found.scale:.6g}, camera "
            f"centres {typical:.2g} m (median) from them; world: east, north, up about "
            f"{local.lat_deg:g}, {local.lon_deg:g}"
        ],
        offset=np.zeros(3),
        extra={**block.extra, "local_frame": local_table(local)},
        ground=block.ground.assign(**dict(zip(POSE[:3], xyz.T, strict=True))),
    )


def _by_axes(pose, source, target, turns, sigma):
    """Points on the axes of the cameras, in both frames, and their weights beside a position's.

    pose: (n, 7) in the frame of source (n, 3). turns: (n, 3, 3) world to camera, as stated. sigma:
    of a position, m.
    """
    good = np.isfinite(turns).all(axis=(1, 2)) & np.isfinite(source).all(axis=1)
    good &= np.isfinite(pose).all(axis=1)
    wide, spread = (
        float(np.median(np.linalg.norm(one - np.median(one, axis=0), axis=1)))
        for one in (target[good], source[good])
    ) if good.sum() >= 3 else (0.0, 0.0)  # fmt: skip
    # Positions beside the line by more than their errors tell the turn about it better.
    middle = target[good] - target[good].mean(axis=0) if good.any() else target[good]
    beside = np.linalg.svd(middle, compute_uv=False)[1] / np.sqrt(good.sum()) if wide else 0.0
    if not (wide > 0 and spread > 0) or beside > _BESIDE * sigma:
        return None
    seen = rotation_from_quaternion(pose[good, 3:])
    axes = (source[good][:, None] + spread * seen).reshape(-1, 3)
    directions = (target[good][:, None] + wide * turns[good]).reshape(-1, 3)
    # Gimbals and compasses are wrong alike in all images: many are no better than one.
    weight = (sigma / (_ATTITUDE_RAD * wide)) ** 2 / len(axes)
    return axes, directions, np.full(len(axes), weight)


def _turned_away(axes, directions, source, target, sigma) -> float:
    """The angle between the turn that attitudes say and the one that positions say, radians; 0
    where it is no more than three times what either may be wrong by. Arguments as of `_by_axes`."""
    known = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    own, goal = (one[known] - one[known].mean(axis=0) for one in (source, target))
    seen, said = (
        one.reshape(-1, 3, 3) - one.reshape(-1, 3, 3).mean(axis=1, keepdims=True)
        for one in (axes, directions)
    )
    u, _, vt = np.linalg.svd(np.einsum("nki,nkj->ij", said, seen))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    # The largest that any turn can make of it is the sum of the singular values.
    most = np.linalg.svd(goal.T @ own, compute_uv=False).sum()
    off = np.arccos(np.clip(np.sum(goal * (own @ turn.T)) / most, -1.0, 1.0)) if most else 0.0
    wide = np.sqrt(np.mean(np.sum(goal**2, axis=1)))
    limit = 3 * np.hypot(_ATTITUDE_RAD, sigma / (wide * np.sqrt(len(goal)))) if wide else np.inf
    return float(off) if off > limit else 0.0


def _with_witness(exposures: gnss.Exposures, block: Block) -> gnss.Exposures:
    """The exposures with the positions that the block has: witnesses of the clock."""
    local = local_of(block)
    nowhere = local is None and block.crs is None
    if "x" in exposures.table or "image" not in exposures.table or not len(block.gnss) or nowhere:
        return exposures
    places = block.numbers("gnss", *"xyz") + block.offset
    places = local.to_geographic(places) if local else gnss.convert(places, block.crs, GEOGRAPHIC)
    told = pd.DataFrame(places, columns=list("xyz"), index=block.gnss["image"].astype(str))
    told[["sx", "sy", "sz"]] = block.gnss_sigma()
    names = exposures.table["image"].astype(str)
    table = exposures.table.assign(**{key: names.map(told[key]) for key in told})
    return replace(exposures, table=table, crs=GEOGRAPHIC)


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
        _with_witness(exposures, block),
        crs=GEOGRAPHIC if epochs.crs is not None else None,
        track_system=track.system,
        exposures_system=track.images_system,
    )
    project = project.having(notes=found.notes)
    if len(found.refused):
        first = found.refused.iloc[0]
        project = project.warned(
            f"{len(found.refused)} of {len(block.images)} images got no position from {name} "
            f"(first: {first['image']}, {first['why']})"
        )
    if epochs.crs is None:
        project = project.having(
            notes=[f"gnss.csv: {len(found.gnss)} positions in {name}'s own metres"], gnss=found.gnss
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
