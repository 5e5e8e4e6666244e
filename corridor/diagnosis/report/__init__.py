"""What a diagnosis found, for a terminal, a notebook, and a folder with one page and two blocks."""

from corridor.diagnosis.report.actions import actions
from corridor.diagnosis.report.folder import check_output, save
from corridor.diagnosis.report.sentence import sentence
from corridor.diagnosis.report.tables import evidence
from corridor.diagnosis.report.text import as_html, as_text

__all__ = ["actions", "as_html", "as_text", "check_output", "evidence", "save", "sentence"]
