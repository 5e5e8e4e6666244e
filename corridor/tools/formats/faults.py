"""A damaged file ends in a sentence, whatever it makes a library raise."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from corridor.core.errors import InputError, WorkFailed

# What numpy, json, struct, pyproj and others raise on contents nobody thought of.
_FAULTS = (
    ValueError, TypeError, RuntimeError, KeyError, IndexError, AttributeError, ArithmeticError,
    UnicodeError, AssertionError, EOFError, StopIteration, zlib.error, ElementTree.ParseError,
)  # fmt: skip


@contextmanager
def blaming(path: Path, what: str) -> Iterator[None]:
    """Within: what goes wrong is the fault of a file, and becomes an InputError that names it.

    what: what the file was taken for, `a project of colmap`.
    """
    try:
        yield
    except WorkFailed:
        raise
    except InputError as error:
        if str(path) in str(error) or path.name in str(error):
            raise
        raise InputError(f"{path}: {error}") from None
    except _FAULTS as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(
            f"{path} is damaged or is not {what} ({reason}); export it again"
        ) from error
