"""XML files of other programs, with messages that name file and line."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from corridor.errors import InputError
from corridor.interchange.text import missing, numbers


def read_xml(path: Path) -> ElementTree.Element:
    """Root of an XML file. Raises InputError where it is missing, cut off or no XML."""
    try:
        with path.open("rb") as file:
            return parse_xml(file.read(), path)
    except OSError as error:
        raise missing(path, error) from error


def parse_xml(data: bytes, path: Path) -> ElementTree.Element:
    """Root of XML in memory; path: for the sentence."""
    # Nobody's project needs entities of its own; in a damaged file they expand without end.
    if b"<!ENTITY" in data:
        raise InputError(f"{path.name} defines XML entities; export the project again")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        line = getattr(error, "position", (0,))[0]
        reason = str(error).partition(":")[0]
        raise InputError(
            f"{path.name}, line {line}: the XML is broken or ends early ({reason}); export the "
            "project again"
        ) from None


def child(element: ElementTree.Element, tag: str, path: Path) -> ElementTree.Element:
    """The child element. Raises InputError where it is missing."""
    found = element.find(tag)
    if found is None:
        raise InputError(f"{path.name}: <{element.tag}> has no <{tag}>; export the project again")
    return found


def values(element: ElementTree.Element | None, path: Path, count: int | None = None) -> np.ndarray:
    """Numbers in the text of an element.

    Raises InputError where there is none, or not `count` of them.
    """
    if element is None:
        raise InputError(f"{path.name}: an element with numbers is missing; export it again")
    words = (element.text or "").split()
    if not words or (count is not None and len(words) != count):
        raise InputError(
            f"{path.name}: <{element.tag}> holds {len(words)} numbers"
            + (f" where {count} belong" if count else "")
            + "; export the project again"
        )
    return _named(words, path, f"<{element.tag}>")


def attribute(
    element: ElementTree.Element, name: str, path: Path, default: float | None = None
) -> float | None:
    """A number in an attribute, the default where it is missing."""
    text = element.get(name)
    if text is None:
        return default
    return float(_named([text], path, f"{name} of <{element.tag}>")[0])


def _named(words, path, what):
    try:
        return numbers(words, path, 0, what)
    except InputError as error:
        # ElementTree keeps no line numbers of elements.
        raise InputError(str(error).replace(", line 0:", ":")) from None
