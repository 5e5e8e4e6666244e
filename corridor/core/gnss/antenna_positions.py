"""From a track and moments of exposure to the table gnss.csv of a block."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import QUATERNION, RHO, Block, correlations, covariances
from corridor.core.brief import brief
from corridor.core.errors import InputError, WorkFailed
from corridor.core.geometry import robust_scale
from corridor.core.gnss.alignment import align
from corridor.core.gnss.coordinates import Local, known_crs, loosely_known, to_local
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.frames import FRAME, convert_within, in_metres, local_frame
from corridor.core.gnss.interpolation import Interpolated, Interpolation, interpolate
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track, check_quality
from corridor.core.gnss.track_attitudes import attitudes_at, axes_at, stated
from corridor.core.gnss.witnesses import contradicted
from corridor.core.options import options
from corridor.core.output import whole_files, write_picture
from corridor.core.textfile import read_toml

_COLUMNS = ["image", "x", "y", "z", "sx", "sy", "sz"]
_SETTINGS = "block.toml"
# Third differences of positions in metres scatter by more than this; of the last digit, what the
# arithmetic of a float leaves.
_NO_METRES, _ON_STEP = 2e-5, 1e-3
# No flight goes so far in degrees, nor so short a way in metres.
_FLIGHT = 1.0
_LEAST_OF_FLIGHT = 3  # images, for one of them to stand out
# So many times that are whole seconds by chance: one in 1000^5 where they are printed in ms.
_LEAST_WHOLE = 5
# A drone that takes photographs for so long and moves by less is not on a survey.
_STOOD_S, _STOOD_M = 20.0, 1.0


@brief
@dataclass(frozen=True)
class Antenna:
    """The antenna at the moments of exposure.

    gnss: image, x, y, z, sx, sy, sz (m), as in gnss.csv, refused images left out; the sigmas are
        missing where the track states none and the method finds none
    refused: image, time_s (of the track), why
    interpolated: all of it in the frame of `track`
    track: in local metres; name: of its file; frame: the coordinates of `gnss`, in words
    notes: sentences worth telling
    attitudes: as in attitudes.csv, of a track that states roll, pitch and yaw
    """

    gnss: pd.DataFrame
    refused: pd.DataFrame
    interpolated: Interpolated
    track: Track
    frame: str
    geographic: bool
    notes: tuple[str, ...] = ()
    attitudes: pd.DataFrame | None = None

    def __str__(self) -> str:
        """What came of it, for a terminal."""
        pieces = len(self.interpolated.segments)
        lines = [
            f"{self.track.source.name}: {len(self.track.table):,} epochs in "
            f"{pieces} piece{'s' * (pieces > 1)}; method: {self.interpolated.method}",
            f"{len(self.gnss)} images with antenna, {len(self.refused)} refused; {self.frame}",
        ]
        if len(self.gnss) and "sx" in self.gnss:
            sigma = 1000 * self.gnss[["sx", "sy", "sz"]].to_numpy()
            lines += ["", "sigma (mm)       x      y      z"]
            for word, row in (
                ("median", np.median(sigma, axis=0)),
                ("95 %", np.percentile(sigma, 95, axis=0)),
                ("largest", sigma.max(axis=0)),
            ):
                lines.append(f"  {word:10s}" + "".join(f"{value:7.1f}" for value in row))
        lines += self._why()
        if self.notes:
            lines += ["", *(f"note: {note}" for note in self.notes)]
        return "\n".join(lines)

    def _why(self) -> list[str]:
        if not len(self.refused):
            return []
        lines = ["", "refused:"]
        shown = self.refused.head(8)
        lines += [f"  {row.image}: {row.why}" for row in shown.itertuples()]
        if len(self.refused) > len(shown):
            lines.append(f"  and {len(self.refused) - len(shown)} more")
        return lines

    def save(
        self, path: str | os.PathLike, picture=None, attitudes: str | os.PathLike | None = None
    ) -> list[Path]:
        """Writes the table and, beside it, the picture; all or none. Returns the paths.

        path: a .csv, or a folder (the file is gnss.csv then). An earlier gnss.csv is replaced.
        picture: a matplotlib figure, as `corridor.figures.antenna` makes it.
        attitudes: a .csv for the attitudes too, in the same folder.
        Raises InputError where `path` is another kind of file, or the track has no attitudes.
        """
        path = Path(path)
        if path.is_dir():
            path = path / "gnss.csv"
        drawn = [] if picture is None else [path.with_suffix(".png")]
        turned = [] if attitudes is None else [Path(attitudes)]
        tables = [("gnss.csv", path, _COLUMNS[:4])]
        tables += [("attitudes.csv", one, ["image", *QUATERNION]) for one in turned]
        for name, file, columns in tables:
            if file.suffix.lower() != ".csv":
                raise InputError(f"{file} is not a .csv; name the table to write, as {name}")
            if file.exists() and not _has(file, columns):
                raise InputError(
                    f"{file} is there and is no {name} ({', '.join(columns)}), so it is not "
                    "replaced; name another file"
                )
        if turned and self.attitudes is None:
            raise InputError(
                f"{self.track.source.name} states no attitudes (roll, pitch and yaw); leave "
                "--attitudes out"
            )
        if turned and (turned[0].resolve().parent != path.resolve().parent or turned[0] == path):
            raise InputError(f"{turned[0]} is not beside {path}; name a file in the same folder")
        # The picture first: a table is never there without one.
        with whole_files(*drawn, *turned, path) as parts:
            if picture is not None:
                write_picture(picture, parts[0])
            if self.attitudes is not None and turned:
                self.attitudes.to_csv(
                    parts[-2], index=False, float_format="%.10g", lineterminator="\n",
                    encoding="utf-8",
                )  # fmt: skip
            self._write(parts[-1])
        return [path, *turned, *drawn]

    def _write(self, path: Path) -> None:
        table = self.gnss.copy()
        # A tenth of a millimetre, in degrees as in metres.
        for name in table.columns[1:]:
            digits = 10 if self.geographic and name in ("x", "y") else 5
            table[name] = table[name].map(f"{{:.{digits}f}}".format)
        table.to_csv(path, index=False, lineterminator="\n", encoding="utf-8")


@options(interpolation=Interpolation)
def antenna(
    track: Track,
    exposures: Exposures,
    *,
    interpolation: Interpolation,
    crs: str | None = None,
    offset: tuple[float, float, float] | np.ndarray = (0.0, 0.0, 0.0),
    about: Local | None = None,
    track_system: str | None = None,
    exposures_system: str | None = None,
) -> Antenna:
    """The antenna at the exposures, in the coordinates of a block.

    method, max_sigma, slow_share, velocities: see `Interpolation`, which may be given in their
        place as interpolation.
    crs, offset: of the block (world = coordinates + offset). about: its local frame, in place of a
        crs. Without both a track with a place in the world gives local east, north, up about its
        middle, and a local track its own metres.
        Sigmas are east, north, up: a grid's own north is taken for north.
    track_system, exposures_system: see `align`.
    Exposures without names get their number as `image`.
    Raises InputError for a track or times that do not fit, and for a crs that is not of that
    place or not in metres (or degrees); WorkFailed where no exposure is left.
    """
    check_quality(track)
    exposures = exposures.with_seen_step()
    _check_metres(track)
    alignment = align(track, exposures, track_system, exposures_system)
    local, coarse = _with_seen_digits(track)
    times = exposures.table["time_s"].to_numpy(dtype=float) + alignment.offset_s
    flight = None
    if "flight" in exposures.table and "flight" in track.table:
        flight = exposures.table["flight"].astype(str).to_numpy()
    try:
        made = interpolate(local.table, times, interpolation=interpolation, flight=flight)
    except InputError as error:
        raise InputError(f"{track.source.name}: {error}") from None
    if exposures.resolution_s:
        made = _with_resolution(made, exposures.resolution_s)
    names = exposures.table["image" if "image" in exposures.table else "number"].astype(str)
    made = contradicted(made, local, exposures, names.to_numpy(), alignment.delay_s)
    good = (made.table["why"] == "").to_numpy()
    if not good.any():
        why = made.table["why"].value_counts()
        more = [note for note in (*coarse, *made.notes) if not note.startswith("segment")]
        more += _of_resolution(exposures, made)
        raise WorkFailed(
            f"no position was found for any of the {len(times)} exposures ({why.index[0]}: "
            f"{why.iloc[0]}){''.join(f'; {one}' for one in more)}"
        )
    places = made.table.loc[good, ["x", "y", "z"]].to_numpy(float)
    points, frame = _in_frame(local, places, crs, offset, about)
    gnss = pd.DataFrame({"image": names.to_numpy()[good]})
    gnss[["x", "y", "z"]] = points
    sigma = made.table.loc[good, ["sx", "sy", "sz"]].to_numpy()
    if np.isfinite(sigma).all():
        gnss[["sx", "sy", "sz"]] = sigma
        if set(RHO) <= set(made.table):
            gnss[list(RHO)] = made.table.loc[good, list(RHO)].to_numpy()
    refused = made.table.loc[~good, ["time_s", "why"]].reset_index(drop=True)
    refused.insert(0, "image", names.to_numpy()[~good])
    notes = (*track.notes, *coarse, *exposures.notes, *alignment.notes, *made.notes)
    notes += _of_strays(names.to_numpy(), exposures.table, made.table["segment"].to_numpy())
    notes += tuple(filter(None, (exposures.too_near(), exposures.out_of_order())))
    notes += (*_of_resolution(exposures, made), *_of_standing(made))
    if crs is not None and local.origin is not None:
        notes += tuple(filter(None, [loosely_known(*local.origin[1::-1], crs, GEOGRAPHIC)]))
    degrees = crs is not None and known_crs(crs).is_geographic
    turned = None
    if stated(track) and not degrees:
        own = None if local.origin is None else Local(*local.origin)
        axes = axes_at(places, own, lambda p: _in_frame(local, p, crs, offset, about)[0])
        turned = attitudes_at(track, gnss["image"].to_numpy(), times[good], axes)
        notes += (f"{track.source.name} states attitudes too, of {len(turned)} of {len(gnss)} "
                  "images with epochs near enough: --attitudes writes them",)  # fmt: skip
    notes = tuple(dict.fromkeys(notes))
    return Antenna(gnss, refused, made, local, frame, degrees, notes, turned)


def _check_metres(track: Track) -> None:
    """Raises InputError where x and y of a track without a system are degrees."""
    plan = track.table[["x", "y"]].to_numpy(float)
    if track.crs is not None or track.origin is not None or len(plan) < _LEAST_OF_FLIGHT + 3:
        return
    scatter, way = robust_scale(np.diff(plan, 3, axis=0)), np.ptp(plan, axis=0).max()
    if (np.abs(plan) <= [180, 90]).all() and 0 < scatter < _NO_METRES and way < _FLIGHT:
        raise InputError(
            f"{track.source.name}: x and y look like longitude and latitude in degrees; convert "
            "them to metres, or give the receiver's own file"
        )


def _with_seen_digits(track: Track) -> tuple[Track, tuple[str, ...]]:
    """The track in local metres; what its last digit is worth is in its sigmas, and is told."""
    local = to_local(track)
    if not set(_COLUMNS[4:]) <= set(local.table):
        return local, ()
    step = np.array([_digit(track.table[axis].to_numpy(float)) for axis in "xyz"])
    if track.crs == GEOGRAPHIC:
        step[:2] *= 111_195.0  # metres of a degree
        step[0] *= np.cos(np.radians(np.median(track.table["y"])))
    rounding, sigma = step / np.sqrt(12), local.table[_COLUMNS[4:]].to_numpy()
    usual = np.median(sigma, axis=0)
    if track.crs == GEOCENTRIC or not (rounding > 0.5 * usual)[usual > 0].any():
        return local, ()
    note = (
        f"{track.source.name} prints positions in steps of {100 * step.max():.2g} cm, which is in "
        "the sigmas: write more digits"
    )
    table = local.table.copy()
    table[_COLUMNS[4:]] = np.hypot(sigma, rounding)
    return replace(local, table=table), (note,)


def _digit(values: np.ndarray) -> float:
    """The largest decimal step from 1 down to 1e-7 whose multiples all values are; else 0."""
    for step in 10.0 ** -np.arange(8):
        counts = np.round(values / step)
        if np.ptp(counts) > 1 and np.abs(values / step - counts).max() < _ON_STEP:
            # Of what was computed with round numbers nothing was rounded.
            return float(step) if np.diff(counts, 3).any() else 0.0
    return 0.0


def _of_strays(names: np.ndarray, exposures: pd.DataFrame, segment: np.ndarray) -> tuple:
    """Sentences on single images that lie in another piece of the track than their flight."""
    if "flight" not in exposures:
        return ()
    table = pd.DataFrame({"flight": exposures["flight"].astype(str).to_numpy(), "piece": segment})
    alone = table.groupby(["flight", "piece"])["piece"].transform("size") == 1
    many = table.groupby("flight")["piece"].transform("size") >= _LEAST_OF_FLIGHT
    return tuple(
        f"image {names[row]} lies in another piece of the track than the other images of flight "
        f"{table['flight'][row]}: is its time right?"
        for row in np.flatnonzero(alone & many & (segment >= 0))
    )


def _of_standing(made: Interpolated) -> tuple:
    """A sentence where the antenna stood still at all exposures, which lasted long."""
    good = made.good
    span = np.ptp(good[["x", "y"]].to_numpy(), axis=0)
    lasted = float(np.ptp(good["time_s"]))
    if len(good) < _LEAST_OF_FLIGHT or lasted < _STOOD_S or span.max() > _STOOD_M:
        return ()
    return (
        f"the antenna stands still (within {100 * span.max():.0f} cm for {lasted:.0f} s) at all "
        "exposures: is it the track of this flight, and is the clock of the images right?",
    )


def of_block(block: Block, **options) -> Antenna:
    """The antenna at the exposures of a block, from its own track.csv.

    options: as of `antenna`. Times of images and track share one clock; where they do not, the
    InputError says so: nothing is stretched.
    """
    folder = block.folder or Path(block.name)
    images = pd.DataFrame({"image": block.images["image"].astype(str)})
    images["time_s"] = block.column("images", "time_s")
    track = block.track.copy()
    if "flight" in block.images and "flight" in track:
        images["flight"] = block.images["flight"].astype(str)
    return antenna(
        Track(table=track, source=folder / "track.csv", day=None, time_system=None, crs=None),
        Exposures(images, None, None, None, folder / "images.csv"),
        **options,
    )


def _with_resolution(made: Interpolated, step: float) -> Interpolated:
    """Positions with what the antenna flies within a step of printed times in their sigmas.

    Whether a clock rounds or cuts off is not known: the error is as of one that cuts off, even
    between 0 and the step, about 0.
    """
    table = made.table.copy()
    speed = np.nan_to_num(table[["vx", "vy", "vz"]].to_numpy())
    sigma = np.hypot(table[["sx", "sy", "sz"]].to_numpy(), speed * step / np.sqrt(3))
    largest = np.nan_to_num(sigma).max(axis=1)
    weak = (table["why"] == "").to_numpy() & (largest > made.max_sigma)
    if set(RHO) <= set(table):
        # What is flown within a step is an error along the way, of all axes together.
        rho = np.nan_to_num(table[list(RHO)].to_numpy())
        along = step / np.sqrt(3) * speed
        whole = covariances(np.nan_to_num(table[["sx", "sy", "sz"]].to_numpy()), rho)
        table[list(RHO)] = correlations(whole + along[:, :, None] * along[:, None])
    table[["sx", "sy", "sz"]] = sigma
    table.loc[weak, "why"] = [
        f"sigma {value:.2f} m is above {made.max_sigma:g} m" for value in largest[weak]
    ]
    return replace(made, table=table)


def _of_resolution(exposures: Exposures, made: Interpolated) -> Iterator[str]:
    speed = np.nanmedian(np.linalg.norm(made.table[["vx", "vy", "vz"]].to_numpy(), axis=1))
    step = exposures.resolution_s
    if not step:
        time = exposures.table["time_s"].dropna().to_numpy(float)
        if {"number", "flag"} & set(exposures.table) or exposures.counted:
            return  # marks of a receiver
        if len(time) >= _LEAST_WHOLE and (time == np.round(time)).all() and speed > 0:
            yield (
                f"all {len(time)} times of {exposures.source.name} are whole seconds: if the "
                f"camera did not fire at those but printed no more, positions are off by up to "
                f"{speed:.1f} m along the track, which no sigma here says; `corridor adjust ... "
                "--effect clock_offset` determines it"
            )
        return
    shift = speed * step / np.sqrt(3)
    yield (
        f"{exposures.source.name} prints times in steps of {1000 * step:.0f} ms: at {speed:.1f} "
        f"m/s {100 * shift:.1f} cm (1 sigma) along the track, which the sigmas include"
    )


def _in_frame(
    local: Track, points: np.ndarray, crs, offset, about: Local | None
) -> tuple[np.ndarray, str]:
    offset = np.asarray(offset, dtype=float)
    if local.origin is None:
        return points, "in the track's own local metres"
    own = Local(*local.origin)
    if crs is None:
        if about is not None:
            points = about.from_geographic(own.to_geographic(points)) - offset
        frame = about or own
        return points, (
            f"local east, north, up about {frame.lat_deg:.4f}, {frame.lon_deg:.4f} degrees, "
            f"height {frame.height:g} m"
        )
    if not known_crs(crs).is_geographic:
        in_metres(crs)
    moved = convert_within(own.to_geographic(points), crs) - offset
    shifted = f" minus {', '.join(f'{value:.10g}' for value in offset)}" if offset.any() else ""
    return moved, f"{crs}{shifted}"


def frame_of_block(images: str | os.PathLike) -> tuple[str | None, np.ndarray, Local | None]:
    """crs, offset (3,) and local frame of the block that a folder or its images.csv belongs to.

    None, zeros and None where there is no block.toml. Raises InputError where it cannot be read.
    """
    path = Path(images)
    path = (path if path.is_dir() else path.parent) / _SETTINGS
    if not path.is_file():
        return None, np.zeros(3), None
    table = read_toml(path)
    try:
        offset = np.array(table.get("offset", [0.0, 0.0, 0.0]), dtype=float).reshape(3)
    except (TypeError, ValueError):
        raise InputError(
            f"{path}: offset is not three numbers; write offset = [x, y, z] in metres"
        ) from None
    return table.get("crs") or None, offset, local_frame(table.get(FRAME))


def _has(path: Path, columns: list[str]) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        header = [cell.strip() for cell in file.readline().split(",")]
    return set(columns) <= set(header)
