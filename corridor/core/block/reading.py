"""From the files of a block folder to tables.

A well-formed file takes the fast path. Only where something is wrong is it read again, as text,
to find the row and say what stands there.
"""

from __future__ import annotations

import csv
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.block.tables import LAYOUTS, NAMES, Layout, categorical, missing_columns, pa, pc
from corridor.core.errors import CorridorWarning, InputError
from corridor.core.textfile import check_growth, decimal_commas, disguised, lines, with_point

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

_NUMBER = r"^\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*$"
_MARKS = {",": "", ";": "semicolons", "\t": "tabs"}
_UNNAMED = "\0unnamed "
# A measured row takes more than a byte, however it is packed; fewer rows fill no memory.
_FEW_ROWS = 1_000_000


def read_table(folder: Path, table: str) -> tuple[pd.DataFrame, Path] | None:
    """The table and the file it came from; None where the folder has no such file.

    Unlisted columns come as text from a .csv, as they are from a .parquet.
    Raises InputError naming file and row where the file cannot be understood.
    """
    files = [folder / f"{table}.csv", folder / f"{table}.parquet"]
    found = [file for file in files if file.is_file()]
    if len(found) > 1:
        raise InputError(f"{files[0].name} and {files[1].name} are both there; keep one of them")
    if not found:
        return None
    return read_columns(found[0], LAYOUTS[table]), found[0]


def read_columns(path: Path, layout: Layout) -> pd.DataFrame:
    """The table in a .parquet, or in a file of comma separated text; as `read_table`."""
    try:
        return (_read_parquet if path.suffix == ".parquet" else _read_csv)(path, layout)
    except OSError as error:
        raise InputError(f"{path.name} cannot be read: {error.strerror or error}") from error


def place(path: Path, row: int) -> str:
    """`images.csv, row 3` for the data row `row` (from 0): the line in a .csv, header line 1.

    A .parquet has no header: there the first data row is row 1.
    """
    return f"{path.name}, row {row_numbers(path, row + 1)[row]}"


def row_numbers(path: Path, count: int) -> np.ndarray:
    """(count,) what the first data rows of a table are called; see `place`."""
    if path.suffix == ".parquet":
        return np.arange(1, count + 1)
    numbers = np.arange(2, count + 2)
    if path.is_file():
        status = path.stat()
        lines = _uneven_lines(path, status.st_mtime_ns, status.st_size)
        if lines is not None:
            numbers[: len(lines)] = lines[:count]
    return numbers


# --- from Arrow to pandas --------------------------------------------------------------------


def _kind(name: str, layout: Layout) -> pa.DataType:
    """What a column is read as."""
    if name in layout.coded:
        return pa.dictionary(pa.int32(), pa.string())
    return pa.float64() if name in layout.numbers else pa.string()


def _to_pandas(column: pa.ChunkedArray) -> pd.Series | np.ndarray:
    """A column of one of these kinds; unknown numbers are NaN."""
    if pa.types.is_dictionary(column.type):
        return _coded(column)
    if pa.types.is_string(column.type):
        return column.to_pandas()
    return np.require(column.to_numpy(), requirements="W")


def _coded(column: pa.ChunkedArray) -> pd.Series:
    """Categorical of a dictionary-encoded column, of which each chunk has names of its own."""
    column = column.unify_dictionaries()
    parts = [pc.fill_null(chunk.indices, -1).to_numpy() for chunk in column.chunks]
    names = column.chunk(0).dictionary.to_pandas() if parts else []
    codes = np.concatenate([np.zeros(0, np.int32), *parts])
    return pd.Series(categorical(codes, pd.Index(names, dtype="str")))


# --- .csv ------------------------------------------------------------------------------------


class _Otherwise(InputError):
    """A table whose text is not UTF-8, whose cells are not separated by commas, or whose numbers
    have decimal commas."""


def _read_csv(path: Path, layout: Layout) -> pd.DataFrame:
    """The table of a file, also of one that Excel saved as its computer's language has it."""
    try:
        return _read_utf8(path, layout)
    except _Otherwise:
        with TemporaryDirectory() as home:
            copy = Path(home) / path.name
            _rewrite(path, copy, layout)
            return _read_utf8(copy, layout)


def _rewrite(path: Path, copy: Path, layout: Layout) -> None:
    """The table in UTF-8, comma separated, with decimal points, every row in its line."""
    texts = [line.text for line in lines(path)]
    header = next((text for text in texts if text.strip()), "")
    mark = next((mark for mark in _MARKS if mark in header), ",")
    reader = csv.reader([f"{text}\n" for text in texts], delimiter=mark)
    try:
        rows = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise _not_a_table(path, 0, error) from None
    names = next(([name.strip() for name in row] for _, row in rows if row), [])
    at = [k for k, name in enumerate(names) if name in layout.numbers]
    cells = ((line, row[k].strip()) for line, row in rows[1:] for k in at if k < len(row))
    commas = decimal_commas(path, cells, sure=mark == ";")
    for _, row in rows[1:] if commas else ():
        for k in at:
            row[k : k + 1] = [with_point(cell.strip()) for cell in row[k : k + 1]]
    told = [f"{word} between the cells" for word in (_MARKS[mark],) if word]
    if commas:
        told.append("decimal commas")
    if told:
        sentence = f"{path.name} was read with {' and '.join(told)}"
        warnings.warn(sentence, CorridorWarning, stacklevel=2)
    with copy.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(row for _, row in rows)


def _read_utf8(path: Path, layout: Layout) -> pd.DataFrame:
    header, passed = _header(path)
    _check_names(path, layout, header, f"{path.name}, row 1")
    names = [name or f"{_UNNAMED}{index}" for index, name in enumerate(header)]
    if pa is None:
        return _read_plainly(path, layout, names)
    numbers = [name for name in names if name in layout.numbers]
    try:
        arrow = _parse(path, names, passed, {name: _kind(name, layout) for name in names})
        # "nan" and "inf" are numbers to the parser, not to us.
        sound = all(pc.all(pc.is_finite(arrow[name])).as_py() is not False for name in numbers)
    except pa.ArrowInvalid:
        sound = False
    if not sound:
        arrow = _parse_carefully(path, layout, names, passed, numbers)
    for index, name in enumerate(names):
        if name.startswith(_UNNAMED):
            if arrow[name].null_count < len(arrow):
                raise _nameless(path, index)
            arrow = arrow.drop_columns([name])
    columns = {}
    # One column after the other, so that the memory of each is free before the next is made.
    for name in arrow.column_names:
        column = arrow[name]
        arrow = arrow.drop_columns([name])
        columns[name] = _to_pandas(column)
    return pd.DataFrame(columns, copy=False)


def _read_plainly(path: Path, layout: Layout, names: list[str]) -> pd.DataFrame:
    """The same by Python's own reader, where Arrow is not installed."""
    try:
        rows = [row for _, row in _rows(path)][1:]
    except (UnicodeDecodeError, csv.Error) as error:
        raise _not_a_table(path, len(names), error) from None
    if any(len(row) != len(names) for row in rows):
        raise _not_a_table(path, len(names), ValueError("rows are of different lengths"))
    columns: dict[str, pd.Series] = {}
    for index, name in enumerate(names):
        text = pd.Series([row[index] or None for row in rows], dtype="str")
        if name.startswith(_UNNAMED):
            if text.notna().any():
                raise _nameless(path, index)
        elif name in layout.numbers:
            sound = text.isna() | text.str.match(_NUMBER)
            values = text.where(sound).astype(float)
            wrong = np.flatnonzero(~sound | np.isinf(values))
            if len(wrong):
                raise _not_a_number(path, layout, name, text.iloc[wrong[0]], int(wrong[0]))
            columns[name] = values
        elif name in layout.coded:
            columns[name] = pd.Series(categorical(*pd.factorize(text)))
        else:
            columns[name] = text
    return pd.DataFrame(columns, copy=False)


def _check_names(path: Path, layout: Layout, names: list[str], where: str) -> None:
    """Refuse a table without a column that it needs, or with one that is there twice."""
    missing = [name for name in layout.needed if name not in names]
    if missing:
        if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
            raise _Otherwise(
                f"{where}: the cells are not separated by commas; save the file comma separated, "
                "with decimal points"
            )
        if told := disguised(path):
            raise InputError(f"{path.name} is {told}")
        raise InputError(missing_columns(path.name, missing, names))
    twice = [name for name in names if name and names.count(name) > 1]
    if twice:
        raise InputError(f"{where}: column {twice[0]} is there twice; rename or delete one")


def _nameless(path: Path, index: int) -> InputError:
    return InputError(f"{path.name}, row 1: column {index + 1} has no name; name or delete it")


def _header(path: Path) -> tuple[list[str], int]:
    """Names of the columns, and how many lines of the file they take."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            for row in reader:
                if row:
                    return [name.strip() for name in row], reader.line_num
    except UnicodeDecodeError:
        raise _not_utf8(path) from None
    except csv.Error as error:
        raise InputError(f"{path.name} is not a table: {error}; save it comma separated") from None
    raise InputError(f"{path.name} is empty; write a header line, or delete the file")


def opened(path: Path, mode: str = "rb") -> pa.NativeFile:
    """A file for Arrow, whatever its name is: in the locale C it would refuse an umlaut."""
    return pa.OSFile(os.fsencode(path), mode)


def _parse(
    path: Path, names: list[str], skip: int, types: dict, multiline: bool = False
) -> pa.Table:
    from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions, read_csv

    return read_csv(
        opened(path),
        read_options=ReadOptions(column_names=names, skip_rows=skip),
        parse_options=ParseOptions(newlines_in_values=multiline),
        convert_options=ConvertOptions(
            column_types=types, null_values=[""], strings_can_be_null=True
        ),
    )


def _parse_carefully(
    path: Path, layout: Layout, names: list[str], skip: int, numbers: list[str]
) -> pa.Table:
    try:
        arrow = _parse(path, names, skip, dict.fromkeys(names, pa.string()), multiline=True)
    except pa.ArrowInvalid as error:
        raise _not_a_table(path, len(names), error) from None
    for name in numbers:
        text = arrow[name].combine_chunks()
        wrong = pc.invert(pc.match_substring_regex(text, _NUMBER))
        if pc.any(wrong).as_py():
            row = pc.index(wrong, True).as_py()
            raise _not_a_number(path, layout, name, text[row].as_py(), row)
        values = pc.cast(pc.utf8_ltrim(pc.utf8_trim_whitespace(text), "+"), pa.float64())
        endless = pc.is_inf(values)
        if pc.any(endless).as_py():
            row = pc.index(endless, True).as_py()
            raise _not_a_number(path, layout, name, text[row].as_py(), row)
        arrow = arrow.set_column(names.index(name), name, values)
    for name in layout.coded:
        coded = arrow[name].combine_chunks().dictionary_encode()
        arrow = arrow.set_column(names.index(name), name, coded)
    return arrow


def _not_a_number(path: Path, layout: Layout, name: str, value: str, row: int) -> InputError:
    if name in layout.needed and name not in layout.empty:
        remedy = "write a number with a decimal point, or delete the row"
    else:
        remedy = "write a number with a decimal point, or leave the cell empty if it is unknown"
    kind = _Otherwise if "," in value and with_point(value) != value else InputError
    return kind(f"{place(path, row)}: {name} = {value!r} is not a number; {remedy}")


def _not_a_table(path: Path, width: int, error: Exception) -> InputError:
    """Why the file is no table: not UTF-8, or a row with more or fewer cells than the header."""
    try:
        path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        return _not_utf8(path)
    try:
        for line, row in _rows(path):
            if len(row) != width:
                return InputError(
                    f"{path.name}, row {line}: {len(row)} cell{'s' * (len(row) != 1)} where "
                    f"the header has {width}; "
                    "separate cells by commas, and write numbers with a decimal point"
                )
    except csv.Error:
        pass
    reason = str(error).splitlines()[0].split(". ")[0].rstrip(".")
    return InputError(f"{path.name} is not a table ({reason}); save it comma separated")


def _not_utf8(path: Path) -> InputError:
    return _Otherwise(f"{path.name}: the text is not UTF-8; save the file as UTF-8")


def _rows(path: Path):
    """Line number and cells of every row that is not blank, the header first."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        before = 0
        for row in reader:
            if row:
                yield before + 1, row
            before = reader.line_num


@lru_cache(maxsize=16)
def _uneven_lines(path: Path, _modified: int, _size: int) -> np.ndarray | None:
    """Line of every data row, where blank lines or line breaks in cells make it uneven."""
    data = path.read_bytes().replace(b"\r\n", b"\n").removeprefix(b"\xef\xbb\xbf")
    if b"\n\n" not in data and b'"' not in data and not data.startswith(b"\n"):
        return None
    del data
    try:
        return np.array([line for line, _ in _rows(path)][1:])
    except csv.Error:
        return None


# --- .parquet --------------------------------------------------------------------------------


def _opened(path: Path, layout: Layout) -> ParquetFile:
    from pyarrow.parquet import ParquetFile  # a tenth of a second, for few blocks

    return ParquetFile(opened(path), memory_map=False, read_dictionary=list(layout.coded))


def _read_parquet(path: Path, layout: Layout) -> pd.DataFrame:
    if pa is None:
        raise InputError(f"{path.name} needs pyarrow; install it, or write the table as .csv")
    try:
        with _opened(path, layout) as file:
            rows, size = file.metadata.num_rows, path.stat().st_size
            groups = (file.metadata.row_group(k) for k in range(file.metadata.num_row_groups))
            check_growth(path.name, size, sum(one.total_byte_size for one in groups))
            if rows > max(_FEW_ROWS, size):
                raise InputError(
                    f"{path.name} says that it has {rows:,} rows, more than bytes: it holds "
                    "nothing but repetition; write it again"
                )
            _check_names(path, layout, file.schema_arrow.names, path.name)
            for field in file.schema_arrow:
                if field.name in layout.listed:
                    _check_type(path, field)
            columns = _columns(file, path, layout)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
        reason = str(error).splitlines()[0].split(". ")[0].rstrip(".")
        raise InputError(f"{path.name} is not a Parquet file ({reason}); write it again") from None
    return pd.DataFrame(columns, copy=False)


def _check_type(path: Path, field: pa.Field) -> None:
    """Refuse a listed column that holds neither names nor numbers, as it should."""
    kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
    known = pa.types.is_integer(kind) or pa.types.is_null(kind)
    if field.name in NAMES:
        if not (known or pa.types.is_string(kind) or pa.types.is_large_string(kind)):
            raise InputError(f"{path.name}: column {field.name} holds {kind}; store names as text")
    elif not (known or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise InputError(
            f"{path.name}: column {field.name} holds {kind}; store it as floating-point numbers"
        )


def _columns(file: ParquetFile, path: Path, layout: Layout) -> dict[str, pd.Series | np.ndarray]:
    """Every column, its first and its second half of the row groups by two threads.

    While the names of one are brought together the next are read.
    """
    middle, groups = file.num_row_groups // 2, file.num_row_groups
    halves = [half for half in (range(middle), range(middle, groups)) if half]
    names = file.schema_arrow.names
    with ThreadPoolExecutor(2) as pool:
        read = {
            name: [pool.submit(_part, path, layout, name, half) for half in halves]
            for name in names
            if name in layout.listed
        }
        columns = {}
        for name in names:
            if name not in read:
                columns[name] = file.read(columns=[name])[name].to_pandas()
                continue
            chunks = [chunk for job in read.pop(name) for chunk in job.result().chunks]
            columns[name] = _to_pandas(pa.chunked_array(chunks, type=_kind(name, layout)))
    return columns


def _part(path: Path, layout: Layout, name: str, groups: range) -> pa.ChunkedArray:
    """Some row groups of a column."""
    with _opened(path, layout) as file:
        column = file.read_row_groups(list(groups), [name], use_threads=False)[name]
    if name in layout.coded:
        return _encoded(column)
    return pc.cast(_plain(column), _kind(name, layout), safe=False)


def _encoded(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """A column of names by codes, without a copy of every name where it is stored so already."""
    if pa.types.is_dictionary(column.type) and column.type.index_type == pa.int32():
        chunks = [
            pa.DictionaryArray.from_arrays(c.indices, pc.cast(c.dictionary, pa.string()))
            for c in column.chunks
        ]
        return pa.chunked_array(chunks, type=pa.dictionary(pa.int32(), pa.string()))
    return pc.cast(_plain(column), pa.string()).dictionary_encode()


def _plain(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """A column without a dictionary."""
    if pa.types.is_dictionary(column.type):
        return pc.cast(column, column.type.value_type)
    return column
