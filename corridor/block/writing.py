"""A block written as a folder of tables."""

import csv
import io
import os
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from corridor.block.settings import FILE, write_settings
from corridor.block.tables import LAYOUTS
from corridor.errors import InputError
from corridor.report import whole_folder


def write_block(block, folder: str | os.PathLike, form: str) -> None:
    """Write the tables as `form` ("csv" or "parquet") and block.toml."""
    with whole_folder(folder, FILE, _of_a_block) as part:
        write_settings(block, part)
        for table, layout in LAYOUTS.items():
            frame = getattr(block, table)
            if len(frame) or set(frame.columns) != set(layout.needed):
                write_table(frame, part / f"{table}.{form}")


def _of_a_block(name: str) -> bool:
    return name == FILE or Path(name).stem in LAYOUTS and Path(name).suffix in (".csv", ".parquet")


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """One table; numbers with the digits that give the same float64 back, unknown ones empty."""
    try:
        arrow = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path.name}: a column mixes text and numbers ({reason}); give it one type"
        ) from None
    if path.suffix == ".parquet":
        pa.parquet.write_table(arrow, path)
        return
    try:
        _write_csv(arrow, path, "none")
    except pa.ArrowInvalid:  # a comma, a quote or a line break in a text
        _write_csv(arrow, path, "needed")


def _write_csv(arrow: pa.Table, path: Path, quoting: str) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(arrow.column_names)
    with path.open("wb") as file:
        file.write(header.getvalue().encode())
        options = pa.csv.WriteOptions(include_header=False, quoting_style=quoting, batch_size=65536)
        pa.csv.write_csv(arrow, file, options)
