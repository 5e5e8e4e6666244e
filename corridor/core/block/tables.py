"""Which columns the tables of a block have, and the types they take in memory."""

import copy
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import numpy as np
import pandas as pd

from corridor.core.block.correlation import RHO
from corridor.core.errors import InputError, some

try:
    import pyarrow as pa
    import pyarrow.compute as pc
except ImportError:  # names are looked up by pandas then, and there is no .parquet
    pa = pc = None

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
QUATERNION = POSE[3:]
VELOCITY = ("vx", "vy", "vz")
RATES = ("wx", "wy", "wz")
SIGMAS = ("sx", "sy", "sz")
ANGLES = (("roll", "pitch", "yaw"), ("omega", "phi", "kappa"))
ANGLE_SIGMAS = ("sroll", "spitch", "syaw")
NAMES = frozenset(("image", "camera", "flight", "strip", "point", "role", "group", "from", "to"))
ROLES = ("control", "check", "unused")


@dataclass(frozen=True)
class Layout:
    """Columns of one table.

    needed: the column must be there. empty: needed columns whose cells may be unknown.
    coded: names that repeat so often that they are held as pandas Categorical.
    """

    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()
    empty: tuple[str, ...] = ()
    coded: tuple[str, ...] = ()

    @property
    def listed(self) -> tuple[str, ...]:
        return self.needed + self.optional

    @property
    def numbers(self) -> tuple[str, ...]:
        return tuple(name for name in self.listed if name not in NAMES)


_OBSERVATIONS = Layout(
    ("point", "image", "x", "y"), optional=("sigma", *SIGMAS[:2], RHO[0]), coded=("point", "image")
)
LAYOUTS = {
    "images": Layout(
        ("image", "camera"),
        optional=("flight", "strip", "time_s", "temperature_c", *POSE, *VELOCITY, *RATES),
    ),
    "tie_points": _OBSERVATIONS,
    "points": Layout(("point", "x", "y", "z"), optional=SIGMAS, empty=("x", "y", "z")),
    "marks": _OBSERVATIONS,
    "ground": Layout(("point", "x", "y", "z", "role"), optional=(*SIGMAS, *RHO, "group")),
    "gnss": Layout(("image", "x", "y", "z"), optional=(*SIGMAS, *RHO)),
    "attitudes": Layout(("image",), optional=(*ANGLES[0], *ANGLES[1], *QUATERNION, *ANGLE_SIGMAS)),
    "distances": Layout(("from", "to", "distance"), optional=("sigma",)),
    "rates": Layout(("time_s", *RATES), optional=("flight", "image")),
    "track": Layout(
        ("time_s", "x", "y", "z"), optional=("flight", *SIGMAS, *RHO, "quality", *VELOCITY)
    ),
}


def tidy(table: str, frame: pd.DataFrame | None, images: pd.Index | None = None) -> pd.DataFrame:
    """The table with the types of a block: names text, numbers float64, rows from 0.

    frame: None gives an empty table with the needed columns.
    images: names in the order of images.csv. Codes of the column `image` of tie_points and marks
        are then rows of images.csv (where all are known: the check names those that are not).
    Raises InputError where a needed column is missing or a number is text.
    """
    layout = LAYOUTS[table]
    if frame is None:
        frame = _empty(table)
    missing = [name for name in layout.needed if name not in frame.columns]
    if missing:
        raise InputError(missing_columns(f"{table}.csv", missing, list(frame.columns)))
    # Small tables are many: a column that is right is not even looked up.
    tidied = pd.DataFrame(frame)
    rows = pd.RangeIndex(len(frame))
    if not (isinstance(frame.index, pd.RangeIndex) and frame.index.equals(rows)):
        tidied.index = rows
    for name, kind in zip(frame.columns, frame.dtypes, strict=True):
        if name not in layout.listed:
            continue
        if name in layout.coded:
            given = tidied[name]
            column = _coded(given, images if name == "image" else None)
            if column is not given:
                tidied[name] = column
        elif name in NAMES:
            if not isinstance(kind, pd.StringDtype):
                tidied[name] = tidied[name].astype("str")
            if name == "role":
                tidied[name] = _roles(tidied[name])
        elif kind != np.float64:
            tidied[name] = _number(table, name, tidied[name])
    if table == "images" and set(QUATERNION) <= set(frame.columns):
        tidied = _unit_quaternions(tidied)
    return tidied


def _roles(column: pd.Series) -> pd.Series:
    """The roles, those that differ in case and blanks only as they are written here."""
    if column.isin(ROLES).all():
        return column
    plain = column.str.strip().str.lower()
    return column.where(~plain.isin(ROLES), plain)


def composed(frame: pd.DataFrame) -> pd.DataFrame:
    """A table whose names have their umlauts in one form (NFC): macOS writes `u` and two dots."""
    for name in NAMES & set(frame.columns):
        column = frame[name]
        coded = isinstance(column.dtype, pd.CategoricalDtype)
        names = pd.Series(column.dtype.categories if coded else column)
        if names.str.isascii().all():
            continue
        if not names.str.normalize("NFC").equals(names):
            frame = frame.assign(**{name: column.astype("str").str.normalize("NFC")})
    return frame


@cache
def _empty(table: str) -> pd.DataFrame:
    """A table without rows; who changes one of its copies changes no other."""
    return tidy(table, pd.DataFrame({name: [] for name in LAYOUTS[table].needed}))


def is_among(names: pd.Series | pd.Index, known: pd.Series | pd.Index | list) -> np.ndarray:
    """(n,) bool: which names are among the known ones; an empty cell is not.

    A hundred times faster than `isin` on a million names.
    """
    if isinstance(names.dtype, pd.CategoricalDtype):
        found = is_among(names.dtype.categories, known)
        return np.append(found, False)[names.array.codes]
    if not len(names):
        return np.zeros(0, dtype=bool)
    if pa is None:
        return pd.Index(names).isin(pd.Index(known).dropna())
    found = pc.is_in(arrow(names), value_set=arrow(known), skip_nulls=True)
    return found.to_numpy(zero_copy_only=False)


def values_of(frame: pd.DataFrame, *columns: str) -> np.ndarray:
    """(n, columns) float64 of some columns. Of few rows `frame[[...]]` takes five times as long."""
    return np.array([frame[name].to_numpy(dtype=np.float64) for name in columns]).T


def places(names: pd.Series | pd.Index, known: pd.Series | pd.Index) -> np.ndarray:
    """(n,) int32: where each name stands among the known ones, -1 where it does not.

    `Index.get_indexer` keeps a table of Python objects as long as the index lives.
    """
    if not len(names):
        return np.zeros(0, dtype=np.int32)
    if pa is None:
        among = pd.Index(known)
        rows = np.flatnonzero(among.notna() & ~among.duplicated())
        found = among[rows].get_indexer(pd.Index(names))
        return np.append(rows, -1)[found].astype(np.int32)
    wanted, among = arrow(names), arrow(known)
    if not wanted.null_count and wanted.equals(among.slice(0, len(wanted))):
        return np.arange(len(wanted), dtype=np.int32)
    found = pc.index_in(wanted, value_set=among, skip_nulls=True)
    return pc.fill_null(found, -1).to_numpy(zero_copy_only=False)


def arrow(names: pd.Series | pd.Index | list) -> "pa.Array":
    """Names as Arrow text, null where empty; on a few names pandas takes ten times as long."""
    # Of a Series Arrow would look at the rows' names as well.
    held = names.array if isinstance(names, pd.Series | pd.Index) else names
    found = pa.array(held, type=pa.large_string(), from_pandas=True)
    return found.combine_chunks() if isinstance(found, pa.ChunkedArray) else found


def categorical(codes: np.ndarray, names: pd.Index) -> pd.Categorical:
    """Categorical of codes (-1: empty) and different names.

    pandas asks whether the names differ through a table of Python objects, 70 bytes a name, which
    takes longer than reading them, and keeps it as long as the index lives: it is not asked, in
    versions of pandas that can be told so. A deep copy comes without the table.
    """
    unasked = getattr(pd.CategoricalDtype, "_from_fastpath", None)
    kind = (
        copy.deepcopy(pd.CategoricalDtype(names))
        if unasked is None
        else unasked(copy.deepcopy(names), ordered=False)
    )
    return pd.Categorical.from_codes(codes, dtype=kind)


@contextmanager
def frugal():
    """Arrow gives back at the end what it keeps for its next allocation, often 100 MB."""
    try:
        yield
    finally:
        if pa is not None:
            pa.default_memory_pool().release_unused()


def missing_columns(file: str, missing: list[str], header: list[str]) -> str:
    """The sentence for needed columns that a file lacks."""
    plural = len(missing) > 1
    return (
        f"{file}, row 1: {'columns' if plural else 'column'} {', '.join(missing)} "
        f"{'are' if plural else 'is'} missing; add {'them' if plural else 'it'} to the header "
        f"(it has {some(header) or 'nothing'})"
    )


def _number(table: str, name: str, column: pd.Series) -> pd.Series:
    try:
        return column.astype(np.float64)
    except (TypeError, ValueError):
        numbers = pd.to_numeric(column, errors="coerce")
        row = int(np.argmax((numbers.isna() & column.notna()).to_numpy()))
        raise InputError(
            f"{table}.csv, row {row + 2}: {name} = {column.iloc[row]!r} is not a number; "
            "write a number with a decimal point"
        ) from None


def _coded(column: pd.Series, order: pd.Index | None) -> pd.Series:
    """Categorical of text; categories in `order`, else as they first appear."""
    if not isinstance(column.dtype, pd.CategoricalDtype):
        text = isinstance(column.dtype, pd.StringDtype)
        codes, names = pd.factorize(column if text else column.astype("str"))
    else:
        codes, names = column.array.codes, column.dtype.categories
    names = names if isinstance(names, pd.Index) else pd.Index(names)
    if not isinstance(names.dtype, pd.StringDtype):
        names = names.astype("str")
    if order is not None:
        if names.equals(order):
            return _categorical(column, codes, order)
        place = order.get_indexer(names) if order.is_unique else np.full(len(names), -1)
        place = place.astype(np.int32)
        # A name that no row has need not be known.
        if (place < 0).any() and (place[codes[codes >= 0]] < 0).any():
            order = None
    if order is None:  # as they first appear, so that reading what was written changes nothing
        used = pd.unique(codes)
        used = used[used >= 0]
        if np.array_equal(used, np.arange(len(names))):
            return _categorical(column, codes, names)
        place = np.full(len(names), -1, dtype=np.int32)
        place[used] = np.arange(len(used))
        order = names[used]
    # The last place is that of code -1, the empty cell.
    return _categorical(column, np.append(place, np.int32(-1))[codes], order)


def _categorical(column: pd.Series, codes: np.ndarray, names: pd.Index) -> pd.Series:
    kind = column.dtype
    held = isinstance(kind, pd.CategoricalDtype) and not kind.ordered
    if held and kind.categories.identical(names):
        return column
    return pd.Series(categorical(codes, names), index=column.index, name=column.name)


def _unit_quaternions(images: pd.DataFrame) -> pd.DataFrame:
    """Quaternions written with a few digits made unit; those far from unit are left to the check.

    One that is unit to the last bit but two is not touched: reading what was written is exact.
    """
    quaternion = np.column_stack([images[name].to_numpy() for name in QUATERNION])
    length = np.linalg.norm(quaternion, axis=1)
    off = np.abs(length - 1.0)
    rows = (off > 2e-15) & (off <= 0.01)
    if not rows.any():
        return images
    quaternion = np.where(
        rows[:, None], quaternion / np.where(rows, length, 1.0)[:, None], quaternion
    )
    return images.assign(**dict(zip(QUATERNION, quaternion.T, strict=True)))
