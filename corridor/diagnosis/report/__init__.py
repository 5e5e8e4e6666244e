"""What a diagnosis found, as a folder: report.html, diagnosis.json, two blocks and pictures.

report.html is made by executing a notebook, `template.py`, with the `Contents` of a diagnosis.
"""

from corridor.diagnosis.report.beside import beside
from corridor.diagnosis.report.contents import Contents
from corridor.diagnosis.report.corrected import corrected
from corridor.diagnosis.report.folder import check_output, save
from corridor.diagnosis.report.tables import evidence
from corridor.diagnosis.report.text import as_html, as_text

__all__ = [
    "Contents",
    "as_html",
    "as_text",
    "beside",
    "check_output",
    "corrected",
    "evidence",
    "save",
]
