"""Text and XML that other programs wrote: every fault names file, place and remedy.

A line of a file is counted from 1. `Line` and `Xml` are a piece of a file that knows where it
stands, so that whoever reads it says only what should stand there.
"""

from __future__ import annotations

import bz2
import gzip
import io
import math
import re
import tomllib
import warnings
import zlib
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO, TypeGuard
from xml.etree import ElementTree

import numpy as np

from corridor.core.errors import CorridorWarning, InputError

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
# 5,25 and 467.124,409; 31,958, which may be of thousands; 5.25 and 467,124.409.
_COMMA = re.compile(r"[+-]?(\d*,\d+([eE][+-]?\d+)?|\d{1,3}([.'’ \xa0\u2009\u202f]\d{3})+,\d+)")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_POINT = re.compile(r"[+-]?(\d*\.\d+([eE][+-]?\d+)?|\d{1,3}((,\d{3})+\.\d*|(,\d{3}){2,}))")
# 1.5D+03, as programs in Fortran print it.
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d+$)")
# Bytes that are no UTF-8, and what they are in no word.
_FOREIGN = re.compile("[\udc80-\udcff]")
_NO_WORD = re.compile(r"[^\x00-\x7f]{3}|[\x80-\x9f]")
# Bytes that show an encoding.
_FIRST = 64
UTF16 = (b"\xff\xfe", b"\xfe\xff")
# Numbers as text are packed to a third or a tenth. What is packed to less than a hundredth holds
# nothing but repetition, and may have been made to fill a memory; so few bytes fill none.
_MOST_GROWTH, _ALWAYS = 100, 50_000_000
# Text that is held whole: a track of a day at 20 Hz, 150 bytes an epoch, has 260 MB.
_MOST_HELD = 300_000_000
_PIECE = 1 << 20


# --- numbers ---------------------------------------------------------------------------------


def number(text: str, path: Path, line: int, what: str, count: str = "line") -> float:
    """A finite number. Raises InputError naming file, line and what it should be.

    count: what lines are called: `row` in tables.
    """
    try:
        value, kind = float(_FORTRAN.sub("e", text)), "finite number"
    except (ValueError, OverflowError):
        value, kind = math.nan, "number"
    if math.isfinite(value) and "_" not in text:
        return value
    place = f"{path.name}, {count} {line}: {what} = {text[:40]!r}"
    if _DECIMAL_COMMA.fullmatch(text):
        raise InputError(f"{place} has a decimal comma; write numbers with a decimal point")
    raise InputError(
        f"{place} is not a {kind}; correct or delete the {count}, or export the file again"
    )


def decimal_commas(path: Path, cells: Iterable[tuple[int, str]], sure: bool = False) -> bool:
    """Whether the numbers of a table have decimal commas; cells: of numbers, with their lines.

    sure: semicolons stand between the cells, as they do for no other reason. Raises InputError
    where commas may be those of thousands, or stand beside decimal points.
    """
    comma = maybe = point = None
    for line, cell in cells:
        if _THOUSANDS.fullmatch(cell) and not sure:
            maybe = maybe or (line, cell)
        elif _COMMA.fullmatch(cell):
            comma = comma or (line, cell)
        elif _POINT.fullmatch(cell):
            point = point or (line, cell)
    found = comma or maybe
    if found is None or (comma is None and point is not None and "," in point[1]):
        return False
    remedy = "write all numbers with a decimal point"
    if point is not None:
        raise InputError(
            f"{path.name}, line {found[0]}: {found[1]!r} has a decimal comma, and {point[1]!r} in "
            f"line {point[0]} a decimal point; {remedy}"
        )
    if comma is None:
        raise InputError(
            f"{path.name}, line {found[0]}: {found[1]!r} may have a decimal comma or be "
            f"{found[1].replace(',', '')}; {remedy}"
        )
    return True


def with_point(cell: str) -> str:
    """A number with a decimal comma as one with a decimal point; any other text as it is."""
    if not _COMMA.fullmatch(cell):
        return cell
    return re.sub(r"[^\d,eE+-]", "", cell).replace(",", ".")


def numbers(words: list[str], path: Path, line: int, what: str) -> np.ndarray:
    """float64 of words, all finite. Raises InputError naming the first that is no number."""
    try:
        values = np.array(words, dtype=float)
    except (ValueError, OverflowError):
        values = np.array([math.nan])
    if not np.isfinite(values).all() or any("_" in word for word in words):
        return np.array([number(word, path, line, what) for word in words])
    return values


# --- lines -----------------------------------------------------------------------------------


class Line:
    """A line of a text file. path, at: where it stands; text: without its end."""

    __slots__ = ("at", "path", "text")

    def __init__(self, path: Path, at: int, text: str):
        self.path, self.at, self.text = path, at, text

    def wrong(self, sentence: str) -> InputError:
        """The error that names file and line before the sentence."""
        return InputError(f"{self.path.name}, line {self.at}: {sentence}")

    def words(self, count: int, what: str) -> list[str]:
        """The words of the line. Raises InputError where they are not `count`."""
        found = self.text.split()
        if len(found) != count:
            raise self.wrong(
                f"{len(found)} words where {what} has {count}; the file is cut off or out of step"
            )
        return found

    def values(self, count: int, what: str) -> np.ndarray:
        """The `count` numbers of the line."""
        return self.numbers(self.words(count, what), what)

    def number(self, word: str, what: str) -> float:
        """A finite number."""
        return number(word, self.path, self.at, what)

    def numbers(self, words: list[str], what: str) -> np.ndarray:
        """float64 of words, all finite."""
        return numbers(words, self.path, self.at, what)

    def whole(self, word: str, what: str, least: int = 0) -> int:
        """A whole number from `least`. Raises InputError where it is none."""
        try:
            value = int(word)
        except ValueError:
            value = least - 1
        if value < least or "_" in word or value >= 2**63:
            raise self.wrong(
                f"{what} = {word[:40]!r} is not a whole number from {least}; correct the line, or "
                "export the file again"
            )
        return value


def unpacked(path: Path) -> BinaryIO:
    """The bytes of a file, also of one packed by bzip2 or gzip (.bz2, .gz).

    Reading raises InputError where a packed file grows beyond all measure.
    """
    if path.suffix == ".bz2":
        return _bounded(bz2.open(path), path)
    return _bounded(gzip.open(path), path) if path.suffix == ".gz" else path.open("rb")


def _bounded(file: bz2.BZ2File | gzip.GzipFile, path: Path) -> io.BufferedReader:
    return io.BufferedReader(_Bounded(file, path), _PIECE)


class _Bounded(io.RawIOBase):
    """The bytes of a packed file, so long as they are no more than such a file can hold."""

    def __init__(self, file: bz2.BZ2File | gzip.GzipFile, path: Path):
        self._file, self._path, self._packed = file, path, path.stat().st_size

    def readable(self):
        return True

    def seekable(self):
        return True

    def seek(self, offset, whence=io.SEEK_SET):
        return self._file.seek(offset, whence)

    def tell(self):
        return self._file.tell()

    def readinto(self, buffer):
        try:
            data = self._file.read(min(len(buffer), _PIECE))
        except zlib.error as error:
            raise OSError(f"it is damaged: {error}") from None
        buffer[: len(data)] = data
        check_growth(self._path.name, self._packed, self._file.tell())
        return len(data)

    def close(self):
        self._file.close()
        super().close()


def check_growth(name: str, packed: int, size: int) -> None:
    """Raises InputError where something packed is or becomes larger than it can honestly be.

    name: of the file, or of the member of an archive. packed, size: bytes.
    """
    if size > max(_MOST_GROWTH * packed, _ALWAYS):
        raise InputError(
            f"{name} unpacks to more than {_MOST_GROWTH} times its size, so it holds nothing but "
            "repetition; unpack and look at it, or fetch it again"
        )


def lines(path: Path, size: int = 0, passed: int = 0) -> Iterator[Line]:
    """Every line, also of a packed file; CR LF, CR and LF may be mixed.

    UTF-8 with or without byte order mark, or UTF-16 with one; what is neither, as Excel saves it,
    is read as Windows-1252 where that is plausible, with a warning. size, passed: the bytes and
    lines at its beginning that are left out.
    Raises InputError where the file cannot be read or is no text.
    """
    at, told = passed, False
    try:
        with unpacked(path) as data:
            encoding = encoding_of(data.read(_FIRST))
            data.seek(size)
            # A byte that is no UTF-8 waits as half a character for what it may be.
            with io.TextIOWrapper(data, encoding, errors="surrogateescape") as texts:
                for at, text in enumerate(texts, start=passed + 1):
                    line = Line(path, at, text.rstrip("\n"))
                    if not text.isascii() and _FOREIGN.search(text):
                        line.text = _western(line)
                        # Blanks between thousands are the same in every western code page.
                        words = re.split(r"[;,\s]+", line.text)
                        word = next((word for word in words if not word.isascii()), "")
                        if word and not told:
                            warnings.warn(
                                f"{path.name}, line {at}: the text is not UTF-8 and was read as "
                                f"Windows-1252 ({word[:40]!r}); where names come out wrong, save "
                                "the file as UTF-8",
                                CorridorWarning,
                                stacklevel=2,
                            )
                        told = told or bool(word)
                    if "\0" in text:
                        raise line.wrong("this is not text; give a text")
                    yield line
    except UnicodeError:
        raise Line(path, at + 1, "").wrong(
            "the text is not UTF-8; save the file as UTF-8"
        ) from None
    except (OSError, EOFError) as error:
        raise missing(path, error) from error


def encoding_of(start: bytes) -> str:
    """UTF-16 with a byte order mark, or without one where every second byte of the first ones is
    zero, as of a table in Latin letters; else UTF-8."""
    if start[:2] in UTF16:
        return "utf-16"
    for order, zeros, others in (("le", start[1::2], start[::2]), ("be", start[::2], start[1::2])):
        if 2 * zeros.count(0) > len(zeros) > 0 and 0 not in others:
            return f"utf-16-{order}"
    return "utf-8-sig"


def _western(line: Line) -> str:
    """A line that is not UTF-8, as Windows-1252 has it. Raises InputError where it looks like
    another code page: no western language has three accented letters in a row."""
    try:
        text = line.text.encode("utf-8", "surrogateescape").decode("cp1252")
    except UnicodeError:
        text = ""
    if not text or _NO_WORD.search(text):
        raise line.wrong(
            "the text is not UTF-8, and of which code page it is does not show; save the file as "
            "UTF-8"
        )
    return text


def read_toml(path: Path) -> dict:
    """The table of a TOML file in UTF-8, with a byte order mark or without.

    Raises InputError where the file cannot be read or is none.
    """
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): correct the path") from error
    except UnicodeDecodeError:
        raise InputError(f"{path} is not UTF-8: save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        text = path.read_text(encoding="utf-8-sig")
        comma = re.search(r"(?m)^[^#\"'\n]*?[=\[\s]([+-]?0,\d+|(?<==)\s*[+-]?\d+,\d+)", text)
        if comma:
            line, found = text.count("\n", 0, comma.start(1)) + 1, comma[1].strip()
            raise InputError(
                f"{path}, line {line}: {found!r} has a decimal comma; write {with_point(found)}"
            ) from None
        raise InputError(f"{path} is not valid TOML ({error}): correct it") from None


def read_lines(path: Path) -> list[str]:
    """All lines of a text file without line ends; also of one packed by gzip (.gz).

    UTF-8, or UTF-16 with a byte order mark; what is neither is read as Latin-1, which can only
    happen in comments and names.
    Raises InputError where the file cannot be read or is no text.
    """
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        with _bounded(gzip.open(path), path) if packed else path.open("rb") as file:
            # In one piece, room for all of it would be made at once.
            pieces = iter(lambda: file.read(_PIECE), b"")
            data = b"".join(islice(pieces, _MOST_HELD // _PIECE + 1))
    except (OSError, EOFError) as error:
        raise missing(path, error) from error
    if len(data) > _MOST_HELD:
        raise InputError(
            f"{path.name} holds more than {_MOST_HELD / 1e6:.0f} MB of text; give the part that "
            "the flight needs"
        )
    if data.startswith(UTF16):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        raise InputError(f"{path.name} is not a text file; name a track or image times as text")
    return re.split(r"\r\n|\n|\r", text.rstrip("\r\n"))


def read_bytes(path: Path) -> bytes:
    """What a file holds. Raises InputError where it is missing or cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise missing(path, error) from error


def disguised(path: Path) -> str:
    """What stands in a file instead of what its name says, and what to do; empty elsewhere.

    A pointer of Git LFS, a page of the web that was saved, a workbook that was called .csv.
    """
    try:
        with path.open("rb") as file:
            head = file.read(200).removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    except OSError:
        return ""
    ending = path.suffix.lower()
    if head.startswith(b"version https://git-lfs"):
        return "a pointer of Git LFS: fetch the file itself (git lfs pull)"
    if head.startswith((b"<!doctype html", b"<html")) and ending not in (".html", ".htm"):
        return "a page of the web: download the file itself"
    if head.startswith(b"pk\3\4") and ending in (".csv", ".txt"):
        return "an Excel workbook: save the sheet as comma separated text (.csv), and name that"
    return ""


def missing(path: Path, error: Exception) -> InputError:
    """The sentence for a file that is not there or cannot be read."""
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path} is missing; put it there or name the whole project")
    reason = getattr(error, "strerror", None) or error
    return InputError(f"{path} cannot be read ({reason}); correct the path, or fetch it again")


# --- XML -------------------------------------------------------------------------------------


class Xml:
    """An element of an XML file. ElementTree keeps no line numbers: elements are named."""

    __slots__ = ("element", "path")

    def __init__(self, element: ElementTree.Element, path: Path):
        self.element, self.path = element, path

    @classmethod
    def read(cls, path: Path) -> Xml:
        """Root of an XML file. Raises InputError where it is missing, cut off or no XML."""
        return cls.parse(read_bytes(path), path)

    @classmethod
    def parse(cls, data: bytes, path: Path) -> Xml:
        """Root of XML in memory; path: for the sentence."""
        # Nobody's project needs entities of its own; in a damaged file they expand without end.
        if data.startswith(UTF16) and b"e\0n\0c\0o\0d\0i\0n\0g\0" in data[:400]:
            # Saved again by an editor: the text still states the encoding that it had.
            text = data.decode("utf-16", errors="replace")
            data = re.sub(r"\A<\?xml.*?\?>", "", text, flags=re.DOTALL).encode()
        if b"<!ENTITY" in data:
            raise InputError(f"{path.name} defines XML entities; export the project again")
        try:
            root = ElementTree.fromstring(data)
            # What a program calls its namespace tells nothing.
            for element in root.iter() if b"xmlns" in data else ():
                element.tag = element.tag.rpartition("}")[2]
            return cls(root, path)
        except (ElementTree.ParseError, LookupError, ValueError) as error:
            line = getattr(error, "position", (0,))[0]
            reason = str(error).partition(":")[0]
            raise Line(path, line, "").wrong(
                f"the XML is broken or ends early ({reason}); export the project again"
            ) from None

    @property
    def tag(self) -> str:
        """Name of the element."""
        return self.element.tag

    def wrong(self, sentence: str) -> InputError:
        """The error that names the file before the sentence."""
        return InputError(f"{self.path.name}: {sentence}")

    def __iter__(self) -> Iterator[Xml]:
        return (Xml(part, self.path) for part in self.element)

    def all(self, place: str) -> list[Xml]:
        """Every element at an XPath."""
        return [Xml(part, self.path) for part in self.element.iterfind(place)]

    def find(self, place: str) -> Xml | None:
        """The first element at an XPath, None where there is none."""
        part = self.element.find(place)
        return None if part is None else Xml(part, self.path)

    def child(self, place: str) -> Xml:
        """The same. Raises InputError where it is missing."""
        part = self.find(place)
        if part is None:
            raise self.wrong(f"<{self.tag}> has no <{place}>; export the project again")
        return part

    def text(self, place: str, default: str | None = None) -> str:
        """Text of the element at an XPath, without quotes; raises InputError where it is empty."""
        text = (self.element.findtext(place) or default or "").strip().strip('"')
        if not text:
            raise self.wrong(f"<{place}> is missing or empty; export it again")
        return text

    def values(self, place: str = ".", count: int | None = None) -> np.ndarray:
        """Numbers in the text of the element at an XPath.

        Raises InputError where there is none, or not `count` of them.
        """
        part = self.element if place == "." else self.child(place).element
        words = (part.text or "").split()
        if not words or (count is not None and len(words) != count):
            raise self.wrong(
                f"<{part.tag}> holds {len(words)} numbers"
                + (f" where {count} belong" if count else "")
                + "; export the project again"
            )
        return self._named(words, f"<{part.tag}>")

    def value(self, place: str, default: float | None = None) -> float:
        """The one number in the text of an element; the default where it is missing."""
        if default is not None and self.element.find(place) is None:
            return default
        return float(self.values(place, 1)[0])

    def get(self, name: str, default: str | None = None) -> str | None:
        """Text of an attribute."""
        return self.element.get(name, default)

    def number(self, name: str, default: float | None = None) -> float | None:
        """A number in an attribute, the default where it is missing."""
        text = self.element.get(name)
        if text is None:
            return default
        return float(self._named([text], f"{name} of <{self.tag}>")[0])

    def _named(self, words, what):
        try:
            return numbers(words, self.path, 0, what)
        except InputError as error:
            raise InputError(str(error).replace(", line 0:", ":")) from None


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether a value of TOML or JSON is a finite number; whole ones there may have any length."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
