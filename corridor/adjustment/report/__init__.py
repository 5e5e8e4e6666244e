"""What an adjustment found, for a terminal, a notebook, another program and a folder.

`as_text` and `as_html` show the same tables: neither holds a time, a path or an address, and
every number is rounded to what its standard deviation justifies, so that a notebook can be
compared with an earlier run. `as_dict` holds full numbers.
"""

from corridor.adjustment.report.contents import tables
from corridor.adjustment.report.dictionary import as_dict
from corridor.adjustment.report.folder import save
from corridor.adjustment.report.numbers import rounded
from corridor.adjustment.report.opening import headline
from corridor.adjustment.report.page import as_html, as_page
from corridor.adjustment.report.table import Table
from corridor.adjustment.report.text import as_text

__all__ = [
    "Table",
    "as_dict",
    "as_html",
    "as_page",
    "as_text",
    "headline",
    "rounded",
    "save",
    "tables",
]
