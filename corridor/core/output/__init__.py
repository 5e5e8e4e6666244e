"""Data as a table, a text, a page, a JSON file, a folder: one way for every result.

A result that wants to be read hands over a `Report`: an opening, warnings, tables of texts. What
is shown holds no time, no path and no address, and every number is rounded to what its standard
deviation justifies, so that a notebook can be compared with an earlier run; full numbers go to
JSON and CSV. Files and folders appear whole or not at all.
"""

from corridor.core.output.files import (
    as_it_was,
    check_folder,
    check_writable,
    file_lines,
    files_in,
    folder_of,
    forget_parts,
    listed_in,
    png,
    sole,
    whole_file,
    whole_files,
    whole_folder,
    write_csv,
    write_json,
    write_picture,
)
from corridor.core.output.gis import LOCAL_CRS, Layer, check_gis, write_geopackage, write_las
from corridor.core.output.json import json_text, plain
from corridor.core.output.letters import CODED, NOTE, printable
from corridor.core.output.numbers import (
    DASH,
    coefficient,
    counted,
    fixed,
    metre_digits,
    millimetres,
    nice,
    readable,
    rounded,
    scaled,
    short,
    significant,
    times,
)
from corridor.core.output.pages import Report, numbered, page
from corridor.core.output.progress import Progress, silent, telling
from corridor.core.output.table import WIDTH, Link, Table
from corridor.core.output.units import UnitTable, named_with_units, with_units
