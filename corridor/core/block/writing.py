"""A block written as a folder of tables."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import pandas as pd

from corridor.core.block.reading import opened
from corridor.core.block.settings import FILE, write_settings
from corridor.core.block.tables import LAYOUTS, pa
from corridor.core.errors import InputError
from corridor.core.output import whole_folder

# Rows that a .parquet holds together.
_GROUP = 1 << 20


def write_block(block, folder: str | os.PathLike, form: str) -> None:
    """Write the tables as `form` ("csv" or "parquet") and block.toml."""
    with whole_folder(folder, FILE, _of_a_block) as part:
        write_settings(block, part)
        for table, layout in LAYOUTS.items():
            frame = getattr(block, table)
            if len(frame) or set(frame.columns) != set(layout.needed):
                write_table(frame, part / f"{table}.{form}")


def _of_a_block(name: str) -> bool:
    if "/" in name:
        return False
    return name == FILE or Path(name).stem in LAYOUTS and Path(name).suffix in (".csv", ".parquet")


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """One table; numbers with the digits that give the same float64 back, unknown ones empty."""
    if pa is None:
        _write_plainly(frame, path)
        return
    try:
        arrow = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path.name}: a column mixes text and numbers ({reason}); give it one type"
        ) from None
    if path.suffix == ".parquet":
        _write_parquet(arrow, path)
        return
    arrow = _without_empty_chunks(arrow)
    try:
        _write_csv(arrow, path, "none")
    except pa.ArrowInvalid:  # a comma, a quote or a line break in a text
        _write_csv(arrow, path, "needed")


def _write_plainly(frame: pd.DataFrame, path: Path) -> None:
    """The same where Arrow is not installed."""
    if path.suffix == ".parquet":
        raise InputError(f"{path.name} needs pyarrow; install it, or write the table as .csv")
    for name, column in frame.items():
        if pd.api.types.infer_dtype(column, skipna=True).startswith("mixed"):
            raise InputError(f"{path.name}: column {name} mixes text and numbers; give it one type")
    frame.to_csv(path, index=False, lineterminator="\n")


def _write_parquet(arrow: pa.Table, path: Path) -> None:
    """In groups of rows, each with the names that it needs and no others."""
    from pyarrow.parquet import ParquetWriter  # a tenth of a second, for few blocks

    numbers = [f.name for f in arrow.schema if pa.types.is_floating(f.type)]
    names = [f.name for f in arrow.schema if f.name not in numbers]
    schema = pa.schema([(f.name, _narrow(f.type)) for f in arrow.schema])
    # Least and largest name of each group of rows take longer than all else, and nobody asks.
    with (
        opened(path, "wb") as stream,
        ParquetWriter(stream, schema, use_dictionary=names, write_statistics=numbers) as file,
    ):
        for first in range(0, max(arrow.num_rows, 1), _GROUP):
            part = arrow.slice(first, _GROUP)
            columns = [
                column.cast(kind.value_type).dictionary_encode()
                if pa.types.is_dictionary(kind)
                else column
                for column, kind in zip(part.columns, schema.types, strict=True)
            ]
            file.write_table(pa.Table.from_arrays(columns, schema=schema))


def _without_empty_chunks(arrow: pa.Table) -> pa.Table:
    """The same table: pyarrow (26.0) writes foreign memory for a chunk of texts without rows."""
    columns = [
        pa.chunked_array([chunk for chunk in column.chunks if len(chunk)], column.type)
        for column in arrow.columns
    ]
    return pa.Table.from_arrays(columns, schema=arrow.schema)


def _narrow(kind: pa.DataType) -> pa.DataType:
    return pa.dictionary(pa.int32(), kind.value_type) if pa.types.is_dictionary(kind) else kind


def _write_csv(arrow: pa.Table, path: Path, quoting: str) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(arrow.column_names)
    from pyarrow.csv import WriteOptions, write_csv

    with path.open("wb") as file:
        file.write(header.getvalue().encode())
        options = WriteOptions(include_header=False, quoting_style=quoting, batch_size=65536)
        write_csv(arrow, file, options)
