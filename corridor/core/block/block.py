"""The block in memory."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from corridor.core.block import checking, writing
from corridor.core.block.attitudes import put_rotations, rotations
from corridor.core.block.correlation import RHO
from corridor.core.block.reading import place, read_table
from corridor.core.block.rigs import exposures_of, members_of, without_cameras
from corridor.core.block.settings import FILE, SIGMA, read_settings
from corridor.core.block.summary import Summary, summarise
from corridor.core.block.tables import (
    ANGLE_SIGMAS,
    LAYOUTS,
    POSE,
    SIGMAS,
    composed,
    frugal,
    is_among,
    places,
    tidy,
)
from corridor.core.brief import in_words
from corridor.core.camera import Camera
from corridor.core.errors import InputError

# Exact coordinates: with this standard deviation results agree to all digits with those that hold
# them (sigma naught of a published block of fixed control to 6 digits, from 1e-8 m down to 1e-12).
EXACT_M = 1e-8
# Tables of what was measured in pictures, and the standard deviation in block.toml that they have.
PICTURES = {"tie_points": "tie_px", "marks": "mark_px"}


@dataclass(eq=False)
class Block:
    """One flight, or several: cameras, images, observations, ground points and GNSS.

    The tables are the files of a block folder, rows in the order of the file;
    a missing one is an empty table with its needed columns. Numbers are float64 (NaN: unknown),
    names are text, also those that look like numbers. Columns that are not listed are passed on.
    `point` and `image` of tie_points and marks are Categorical; the codes of `image` are rows of
    `images`, as long as every image is known there.

    sigma: "tie_px", "mark_px" (px), "gnss_m", "control_m" (3 numbers, m), "attitude_deg" (3
    numbers), defaults filled in.
    lever_arm: metres in the camera frame for each flight, or "default".
    offset: (3,) metres, world = coordinates + offset.
    extra: keys of block.toml that the package does not know; passed on.
    folder: where the block was read from.

    Tables handed in are brought to these types; `check` says whether they make sense.
    """

    name: str
    cameras: dict[str, Camera]
    images: pd.DataFrame
    tie_points: pd.DataFrame = None  # type: ignore[assignment]
    points: pd.DataFrame = None  # type: ignore[assignment]
    marks: pd.DataFrame = None  # type: ignore[assignment]
    ground: pd.DataFrame = None  # type: ignore[assignment]
    gnss: pd.DataFrame = None  # type: ignore[assignment]
    attitudes: pd.DataFrame = None  # type: ignore[assignment]
    distances: pd.DataFrame = None  # type: ignore[assignment]
    rates: pd.DataFrame = None  # type: ignore[assignment]
    track: pd.DataFrame = None  # type: ignore[assignment]
    sigma: dict = field(default_factory=dict)
    lever_arm: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    lever_arm_fixed: bool = False
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    crs: str | None = None
    description: str = ""
    source: str = ""
    licence: str = ""
    extra: dict = field(default_factory=dict)
    folder: Path | None = None
    _files: dict[str, Path] = field(default_factory=dict, repr=False)

    def __post_init__(self):
        self.images = tidy("images", self.images)
        names = pd.Index(self.images["image"])
        for table in LAYOUTS:
            if table != "images":
                setattr(self, table, tidy(table, getattr(self, table), names))
        self.sigma = {
            key: float(value) if key.endswith("_px") else np.broadcast_to(value, 3).astype(float)
            for key, value in (SIGMA | self.sigma).items()
        }
        self.offset = np.array(self.offset, dtype=float)

    def with_(self, **changes: Any) -> Block:
        """A block like this one but for some fields: `block.with_(images=table)`.

        Tables are brought to their types as if handed to `Block`; the others are shared.
        Raises TypeError for a name that is no field.
        """
        return replace(self, **changes)

    # --- looking things up -------------------------------------------------------------------

    def has(self, column: str) -> bool:
        """Whether a column such as `images.time_s` is there with at least one known value.

        `camera.readout_s`: whether a camera states it. `rig.member`: whether cameras hang together
        and took images together. `gnss`: whether the table has rows.
        `effect.SLUG.KEY`: whether block.toml states that constant.
        """
        table, _, name = column.partition(".")
        if table == "effect":
            slug, _, key = name.partition(".")
            return key in self.constants.get(slug, {})
        if table == "rig":
            return bool(members_of(self)) and len(exposures_of(self).member) > 0
        if table == "camera":
            return any(
                getattr(camera, name, camera.extra.get(name)) is not None
                for camera in self.cameras.values()
            )
        if table not in LAYOUTS:
            raise ValueError(f"a block has no table {table!r}")
        frame = getattr(self, table)
        if not name:
            return len(frame) > 0
        return name in frame and bool(frame[name].notna().any())

    def column(self, table: str, column: str) -> np.ndarray:
        """A column as float64, NaN where it is unknown or where the block has no such column.

        Raises InputError where the column holds text that is no number.
        """
        frame = getattr(self, table)
        if column not in frame:
            return np.full(len(frame), np.nan)
        values = frame[column]
        if values.dtype == np.float64:
            return values.to_numpy()
        numbers = pd.to_numeric(values, errors="coerce")
        wrong = (numbers.isna() & values.notna()).to_numpy()
        if wrong.any():
            row = int(wrong.argmax())
            raise InputError(
                f"{self.where(table, row)}: {column} = {values.iloc[row]!r} is not a number; "
                "write a number with a decimal point, or leave the cell empty if it is unknown"
            )
        return numbers.to_numpy(dtype=np.float64)

    def numbers(self, table: str, *columns: str) -> np.ndarray:
        """(n, columns) float64 of some columns, NaN where unknown.

        Of a few rows `frame[[...]].to_numpy()` takes ten times as long.
        """
        return np.array([self.column(table, name) for name in columns]).T

    def put(self, table: str, columns: Iterable[str], values: np.ndarray) -> None:
        """Fill columns of a table, there before or not, with values (n, columns)."""
        filled = dict(zip(columns, np.asarray(values).T, strict=True))
        setattr(self, table, getattr(self, table).assign(**filled))

    @property
    def poses(self) -> np.ndarray:
        """(images, 7): x, y, z and qw, qx, qy, qz of images.csv, NaN where unknown."""
        return np.ascontiguousarray(self.numbers("images", *POSE))

    @property
    def attitude_rotations(self) -> np.ndarray:
        """(n, 3, 3) world to camera, of the rows of attitudes.csv, NaN where unknown.

        Raises InputError where block.toml does not say of what they are.
        """
        return rotations(self)

    def put_attitudes(self, turned: np.ndarray) -> None:
        """Write rotations (n, 3, 3), world to camera, in the form that attitudes.csv has."""
        put_rotations(self, turned)

    @property
    def constants(self) -> dict[str, dict]:
        """What an effect has to know of this block: the tables [effect.SLUG] of block.toml."""
        return self.extra.get("effect", {})

    @property
    def image_flight(self) -> np.ndarray:
        """(images,) int: index into `flight_names`."""
        return self._flights[0]

    @property
    def image_camera(self) -> np.ndarray:
        """(images,) int: index into `cameras`, -1 for a camera that is not there."""
        return places(self.images["camera"], pd.Index(list(self.cameras))).astype(np.int64)

    @property
    def flight_names(self) -> list[str]:
        """Flights in order of appearance; images without a flight belong to flight "1"."""
        return list(self._flights[1])

    @property
    def ground_groups(self) -> np.ndarray:
        """(n,) names: from where each ground point was surveyed; "1" where nothing says it.

        Points of one group share the errors of its base station or datum.
        """
        if "group" not in self.ground:
            return np.full(len(self.ground), "1", dtype=object)
        return self.ground["group"].fillna("1").to_numpy(dtype=object)

    @property
    def distance_names(self) -> list[str]:
        """What each row of distances.csv is called, "A to B"; of two with the same ends "A to B
        (2)"."""
        ends = zip(self.distances["from"], self.distances["to"], strict=True)
        count: dict[str, int] = {}
        out = []
        for name in (f"{one} to {other}" for one, other in ends):
            count[name] = count.get(name, 0) + 1
            out.append(name if count[name] == 1 else f"{name} ({count[name]})")
        return out

    @property
    def _flights(self) -> tuple[np.ndarray, pd.api.extensions.ExtensionArray]:
        if "flight" not in self.images:
            return np.zeros(len(self.images), dtype=np.int64), pd.array(["1"], dtype="str")
        return pd.factorize(self.images["flight"].array.fillna("1"))

    def image_rows(self, table: str, kind: type = np.int64) -> np.ndarray:
        """(n,) of a kind: the row of `images` that each row of a table belongs to, -1 for none."""
        column, names = getattr(self, table)["image"], self.images["image"]
        if not isinstance(column.dtype, pd.CategoricalDtype):
            return places(column, names).astype(kind)
        place: np.ndarray = places(column.dtype.categories, names).astype(kind)
        return np.append(place, kind(-1))[column.array.codes]

    @frugal()
    def positions(self, table: str) -> np.ndarray:
        """(points, 3) of the categories of `point` of tie_points or marks, NaN where unknown.

        Marks take the coordinates of ground.csv, and those of points.csv where it has none.
        """
        names = getattr(self, table)["point"].dtype.categories
        out = np.full((len(names), 3), np.nan)
        for source in (self.points,) if table == "tie_points" else (self.points, self.ground):
            at = places(source["point"], names)
            xyz = np.stack([source[axis].to_numpy(float) for axis in "xyz"], axis=1)
            known = (at >= 0) & np.isfinite(xyz).all(axis=1)
            out[at[known]] = xyz[known]
        return out

    def outside(self, table: str) -> np.ndarray:
        """(n,) bool: which tie points or marks lie outside their picture."""
        sizes = {name: (one.width, one.height) for name, one in self.cameras.items()}
        size = np.array([sizes[name] for name in self.images["camera"]], dtype=float)
        pixels = self.numbers(table, "x", "y")
        return ((pixels < -0.5) | (pixels > size[self.image_rows(table)] - 0.5)).any(axis=1)

    @property
    def form(self) -> str:
        """How its observations were stored: "parquet", or "csv", also of a block made in memory."""
        files = [self._files[table] for table in ("tie_points", "marks") if table in self._files]
        return "parquet" if files and files[0].suffix == ".parquet" else "csv"

    def where(self, table: str, row: int) -> str:
        """`images.csv, row 3` for row 1 of the table (rows from 0): the line of the file.

        In a block that was made or selected in memory: the line it would be written to.
        """
        path = self._files.get(table, Path(f"{table}.csv"))
        return place(path, int(row))

    def named(self, table: str, row: int) -> str:
        """`marks.csv, row 3: point G1 in image A17` for row 1 (from 0), to begin a sentence."""
        cells = getattr(self, table).iloc[int(row)]
        names = [f"{name} {cells[name]}" for name in ("point", "image") if name in cells]
        return f"{self.where(table, row)}: {' in '.join(names)}"

    def demand(self, table: str, there: np.ndarray, fault: str, remedy: str) -> None:
        """Raise InputError for the first row where a mask (rows,), or (rows, n), is not True.

        fault: what is to be said of it: `has no time_s`. The sentence tells of how many it is true.
        """
        wrong = np.flatnonzero(~there.all(axis=tuple(range(1, there.ndim))))
        if len(wrong):
            many = f"{len(wrong)} of {len(there)} {'images' if table == 'images' else 'rows'}"
            raise InputError(f"{self.named(table, wrong[0])} {fault} ({many}): {remedy}")

    # --- standard deviations -----------------------------------------------------------------

    def tie_sigma(self) -> np.ndarray:
        """(n,) px of the tie observations, the default of block.toml where none is given.

        Of x and y with a covariance matrix: the fourth root of its determinant.
        """
        return self._sigma_px("tie_points")

    def mark_sigma(self) -> np.ndarray:
        """(n,) px of the marks, as `tie_sigma`."""
        return self._sigma_px("marks")

    def gnss_sigma(self) -> np.ndarray:
        """(n, 3) m of the antenna positions, the default of block.toml where none is given."""
        return self._filled("gnss", SIGMAS, "gnss_m")

    def attitude_sigma(self) -> np.ndarray:
        """(n, 3) rad of the attitudes, the default of block.toml where none is given; about level
        axes: of the heading, to the right of it, the vertical."""
        return np.radians(self._filled("attitudes", ANGLE_SIGMAS, "attitude_deg"))

    def ground_sigma(self) -> np.ndarray:
        """(n, 3) m of the ground points, the default of block.toml where none is given.

        A point that is exact, 0 in ground.csv, has one that no measurement comes near.
        """
        return np.maximum(self._filled("ground", SIGMAS, "control_m"), EXACT_M)

    def correlation(self, table: str) -> np.ndarray:
        """Correlations of the coordinates of a table's rows, 0 where none is given: (n, 3) x and y,
        x and z, y and z; (n, 1) of tie points and marks."""
        frame, names = getattr(self, table), RHO[: 1 if table in PICTURES else 3]
        if not set(names) & set(frame.columns):
            return np.broadcast_to(0.0, (len(frame), len(names)))
        return np.nan_to_num(self.numbers(table, *names))

    def in_pictures(self, table: str) -> tuple[np.ndarray, np.ndarray] | None:
        """Standard deviations (n, 2), px, and correlations (n, 1) of tie points or marks; None
        where the table states none of both coordinates."""
        frame = getattr(self, table)
        if not {"sx", "sy", RHO[0]} & set(frame.columns):
            return None
        sigma = np.repeat(self._filled(table, ("sigma",), PICTURES[table]), 2, axis=1)
        given = self.numbers(table, "sx", "sy")
        sigma = np.where(np.isnan(given), sigma, given)
        return sigma, self.correlation(table)

    def _sigma_px(self, table: str) -> np.ndarray:
        default = PICTURES[table]
        sigma = np.broadcast_to(self.sigma[default], len(getattr(self, table)))
        if "sigma" in getattr(self, table):
            sigma = self._filled(table, ("sigma",), default)[:, 0]
        both = self.in_pictures(table)
        if both is not None:
            sigma = np.sqrt(both[0].prod(axis=1) * np.sqrt(1.0 - both[1][:, 0] ** 2))
        # One number for all takes no room.
        return sigma

    def _filled(self, table: str, columns: tuple[str, ...], default: str) -> np.ndarray:
        frame = getattr(self, table)
        filled = np.empty((len(frame), len(columns)))
        filled[:] = self.sigma[default]
        for k, name in enumerate(columns):
            if name in frame:
                given = self.column(table, name)
                np.copyto(filled[:, k], given, where=~np.isnan(given))
        return filled

    # --- other blocks ------------------------------------------------------------------------

    def copy(self) -> Block:
        """A block of its own: what is changed in one is not changed in the other.

        pandas copies a column when one of the two is written to.
        """
        return self._with(
            cameras={
                name: replace(
                    camera, interior=camera.interior.copy(), extra=copy.deepcopy(camera.extra)
                )
                for name, camera in self.cameras.items()
            },
            lever_arm=dict(self.lever_arm),
            extra=copy.deepcopy(self.extra),
            _files=dict(self._files),
        )

    def _with(self, **changes) -> Block:
        """A block with other values of some fields, and no truth: that is of the old ones."""
        values = {one.name: getattr(self, one.name) for one in fields(Block)}
        return Block(**values | changes)

    def forget_folder(self) -> None:
        """What follows is no longer what stands in the files the block was read from."""
        self.folder, self._files = None, {}

    def select(
        self,
        images: Iterable[str] | None = None,
        flights: Iterable[str] | None = None,
        points: Iterable[str] | None = None,
    ) -> Block:
        """The part of the block with these images, of these flights, with these points.

        Names; what is not given does not restrict. Cameras, points and lever arms that lose all
        their images go, and so do epochs of flights that do.
        Raises InputError where a name is unknown or no observation is left.
        """
        chosen = np.ones(len(self.images), dtype=bool)
        if images is not None:
            listed = _chosen(images, self.images["image"], "image")
            chosen &= is_among(self.images["image"], listed)
        codes, names = self._flights
        if flights is not None:
            chosen &= is_among(names, _chosen(flights, names, "flight"))[codes]
        point_tables = ("tie_points", "marks", "points", "ground")
        if points is not None:
            known = pd.concat([pd.Series(self._points(table)) for table in point_tables])
            points = _chosen(points, known, "point")

        kept: dict = {"images": self.images[chosen]}
        for table in ("tie_points", "marks", "gnss", "attitudes"):
            kept[table] = getattr(self, table)[chosen[self.image_rows(table)]]
        for table in point_tables:
            frame = kept.get(table, getattr(self, table))
            kept[table] = frame if points is None else frame[is_among(frame["point"], points)]
        if not len(kept["tie_points"]) and not len(kept["marks"]):
            raise InputError("the selection leaves no observation; choose more images or points")
        for table in ("tie_points", "marks"):
            observed = kept[table]["point"].cat.remove_unused_categories().cat.categories
            lost = self._points(table).difference(observed, sort=False)
            for other in ("points", "ground"):
                kept[other] = kept[other][~is_among(kept[other]["point"], lost)]

        if len(self.distances):
            seen = pd.concat([kept[t]["point"].astype("str") for t in ("tie_points", "marks")])
            there = [is_among(self.distances[end], seen) for end in ("from", "to")]
            kept["distances"] = self.distances[there[0] & there[1]]
        lost = set(names) - set(names[np.unique(codes[chosen])])
        for table in ("rates", "track"):
            frame = getattr(self, table)
            if "flight" in frame:
                frame = frame[~is_among(frame["flight"], list(lost))]
            if "image" in frame:
                here = is_among(frame["image"], kept["images"]["image"])
                frame = frame[frame["image"].isna() | here]
            kept[table] = frame
        unused = set(self.images["camera"]) - set(kept["images"]["camera"])
        part = self._with(
            **kept,
            extra=without_cameras(self.extra, unused),
            cameras={name: c for name, c in self.cameras.items() if name not in unused},
            lever_arm={name: arm for name, arm in self.lever_arm.items() if name not in lost},
        )
        part.forget_folder()
        return part.copy()

    def _points(self, table: str) -> pd.Index:
        column = getattr(self, table)["point"]
        if isinstance(column.dtype, pd.CategoricalDtype):
            return column.cat.categories
        return pd.Index(column)

    # --- in and out --------------------------------------------------------------------------

    def check(self, observed: bool = True) -> None:
        """Raise InputError for the first fault: one sentence with file, row and remedy.

        observed: whether a block without observations is a fault.
        """
        checking.check(self, observed)

    def write(self, folder: str | os.PathLike, form: str = "csv", observed: bool = True) -> None:
        """Write the block folder, whole or not at all.

        form: "csv", or "parquet" for large blocks. Reading it gives the same block bit for bit.
        observed: False also writes a block without observations, to which somebody will add
        tie_points.csv or marks.csv: `read` refuses it until then.
        A block that is there already is replaced; files in its folder that are not of a block
        (a README, a licence) stay.
        Raises InputError where the block has a fault or the folder is something else.
        """
        if form not in ("csv", "parquet"):
            raise InputError(f"a block is not written as {form!r}; choose csv or parquet")
        self.check(observed)
        writing.write_block(self, folder, form)

    def summary(self, needs: Mapping[str, Iterable[str]] | None = None) -> Summary:
        """First look: counts, coverage, what is missing.

        needs: columns that each effect needs, by its name; the summary then also says which of
        them cannot be tested and why.
        """
        return summarise(self, needs or {})

    def __repr__(self) -> str:
        return (
            f"Block {self.name}: {len(self.images)} images, {len(self.tie_points)} tie "
            f"observations, {len(self.marks)} marks, {len(self.ground)} ground points, "
            f"{len(self.gnss)} GNSS positions"
        )

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


@frugal()
def read(folder: str | os.PathLike | Block) -> Block:
    """Block of a folder, checked; a block that has been read is itself.

    Somebody may have changed it: its observations are checked again.

    Raises InputError, one sentence naming file, row and remedy, where the folder, a file or a
    column is missing, or a file holds what a block must not.
    """
    if isinstance(folder, Block):
        checking.check_observations(folder)
        return folder
    if not isinstance(folder, str | os.PathLike):
        raise InputError(
            f"a block is a folder, or what `read` makes of one, not {in_words(folder)}"
        )
    folder = Path(folder)
    if folder.is_file():
        raise InputError(f"{folder} is a file; give the folder of a block")
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder of a block")
    if not (folder / FILE).is_file() and (folder / "block" / FILE).is_file():
        raise InputError(f"{folder} is a result; the block in it is {folder / 'block'}: give that")
    for needed in (FILE, "images.csv"):
        if not (folder / needed).is_file() and not (
            needed == "images.csv" and (folder / "images.parquet").is_file()
        ):
            raise InputError(
                f"{folder}: {needed} is missing; give the folder of a block "
                "(`corridor import auto PROJECT -o BLOCK` makes one of another program's project)"
            )
    settings = read_settings(folder)
    tables = {table: read_table(folder, table) for table in LAYOUTS}
    found = {table: pair for table, pair in tables.items() if pair is not None}
    block = Block(
        **settings,
        **{table: composed(frame) for table, (frame, _) in found.items()},
        folder=folder,
        _files={table: path for table, (_, path) in found.items()},
    )
    block.check()
    return block


def files_of(folder: Path) -> list[Path]:
    """The files of a block folder that are read, by name; whether they can be read or not."""
    known = [FILE, *(f"{table}.{kind}" for table in LAYOUTS for kind in ("csv", "parquet"))]
    return sorted(folder / name for name in known if (folder / name).is_file())


def is_block(folder: Path) -> bool:
    """Whether a folder is that of a block."""
    return (folder / FILE).is_file()


def _chosen(names: Iterable[str], known: pd.Series | pd.Index, what: str) -> list[str]:
    names = [names] if isinstance(names, str) else [str(name) for name in names]
    unknown = pd.Index(names).difference(pd.Index(known), sort=False)
    if len(unknown):
        raise InputError(f"the block has no {what} {unknown[0]!r}; correct the name")
    return names


def with_equal_axes(block: Block) -> tuple[Block, list[str]]:
    """A block in which x and y of each image point are equally good and independent, and a sentence
    on that where they were not: for whoever takes them so."""
    changed = {}
    for table in PICTURES:
        if block.in_pictures(table) is not None:
            frame = getattr(block, table).drop(columns=["sx", "sy", RHO[0]], errors="ignore")
            changed[table] = frame.assign(sigma=block._sigma_px(table))
    if not changed:
        return block, []
    names = " and ".join(f"{table}.csv" for table in changed)
    note = (
        f"{names}: x and y of an image point count here as equally good and independent; "
        "`corridor adjust` uses sx, sy and rho_xy."
    )
    return block.with_(**changed), [note]
