"""The two ways in which a call can end badly."""

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """The input is wrong: one sentence that names the file, the row and what to do."""


class AdjustmentFailed(RuntimeError):
    """The input is readable but the work cannot be done: one sentence says why."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The nearest of the known words as a question, with a blank before it; else nothing."""
    plain = word.strip().lower().replace("-", "_").replace(" ", "_")
    near = difflib.get_close_matches(plain, list(known), 1)
    return f" (did you mean {near[0]}?)" if near else ""


def some(names: Iterable[str], most: int = 8) -> str:
    """The first names, for a sentence."""
    names = [name if len(name) <= 40 else f"{name[:37]}..." for name in map(str, names)]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
