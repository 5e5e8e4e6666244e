"""The ways in which a call can end badly: every one is a `CorridorError`."""

import difflib
from collections.abc import Iterable


class CorridorError(Exception):
    """What every error of this package is: one sentence for the person who asked."""


class InputError(CorridorError, ValueError):
    """The input is wrong: one sentence that names the file, the row and what to do."""


class WorkFailed(CorridorError, RuntimeError):
    """The input is readable but the work cannot be done: one sentence says why."""


class AdjustmentFailed(WorkFailed):
    """The unknowns of a block cannot be determined, or the iteration does not end."""


class StartFailed(AdjustmentFailed):
    """Start values are so far off that no step leads anywhere; others may do."""


class ReadoutFailed(WorkFailed):
    """A photograph or a flight does not show how long the camera takes to read its rows."""


class FetchFailed(WorkFailed):
    """A file cannot be had from its source, or is not the one that is known."""


class CorridorWarning(RuntimeWarning):
    """What a call does in another way than one may think: one sentence, also at the prompt."""


class SlowerWarning(CorridorWarning):
    """The results are the same but take longer: one sentence says why and what to install."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The nearest of the known words as a question, with a blank before it; else nothing."""
    plain = word.strip().lower().replace("-", "_").replace(" ", "_")
    near = difflib.get_close_matches(plain, list(known), 1)
    return f" (did you mean {near[0]}?)" if near else ""


def some(names: Iterable[str], most: int = 8) -> str:
    """The first names, for a sentence."""
    names = [name if len(name) <= 40 else f"{name[:37]}..." for name in map(str, names)]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
