"""Metashape projects as they are saved: one archive (.psz), or a folder of archives (.psx).

A .psx is a line of XML that names `NAME.files/project.zip`. Each archive holds a doc.xml, which
names the archives below it by paths from where it lies itself: project, chunk, frame, tie points.
The document of a .psz is the same tree in one piece. Tie points and their projections in each
picture are binary PLY.

Source: as found on real projects of PhotoScan 1.2 to Metashape 2.3.
"""

import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.textfile import Xml, check_growth, missing

_DOCUMENT = "doc.xml"
# What a frame keeps its tie points in.
_CLOUDS = ("point_cloud", "tie_points")
_PLY = {
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8", "int": "<i4",
    "int32": "<i4", "uint": "<u4", "uint32": "<u4", "uchar": "u1", "uint8": "u1", "char": "i1",
    "short": "<i2", "ushort": "<u2",
}  # fmt: skip
_DAMAGED = (
    zipfile.BadZipFile, zlib.error, KeyError, EOFError, NotImplementedError, OSError,
)  # fmt: skip
Members = Callable[[str], bytes]


class Archive:
    """A project that was saved. Within `with`, damage becomes an InputError that names the file."""

    def __init__(self, path: Path):
        self._path, self._at = path, path

    def __enter__(self) -> "Archive":
        return self

    def __exit__(self, kind, error, trace) -> None:
        if isinstance(error, InputError):
            return
        if isinstance(error, FileNotFoundError):
            raise missing(self._at, error) from error
        if isinstance(error, _DAMAGED):
            raise InputError(
                f"{self._at.name} is damaged or no archive of Metashape ({error}); save the "
                "project again"
            ) from None

    def document(self) -> Xml:
        """The document of the project: of a .psx that of the project.zip it names."""
        if self._path.suffix.lower() == ".psz":
            return self._read(self._path)
        named = Xml.read(self._path).get("path") or "{projectname}.files/project.zip"
        named = named.replace("{projectname}", self._path.stem).replace("\\", "/")
        home = self._path.parent / named
        if not home.is_file():
            beside = [folder.name for folder in self._path.parent.glob("*.files")]
            lies = f" ({beside[0]} lies there: give both one name)" if len(beside) == 1 else ""
            raise InputError(
                f"{self._path.name}: {named} is not there{lies}; a project is the .psx and the "
                f"folder {self._path.stem}.files beside it: copy both"
            )
        return self._read(home)

    def head(self, chunk: Xml) -> Xml:
        """A chunk without what its archive names in turn."""
        home = self._at
        found, self._at = self._below(chunk, home)[0], home
        return found

    def whole(self, chunk: Xml) -> tuple[Xml, Members]:
        """A chunk with its first frame and tie points in the place of the archives it names.

        Also what reads files of the archive of tie points.
        """
        chunk, home = self._below(chunk, self._at)
        frame = chunk.find("frames/frame")
        if frame is None:
            return chunk, self._members(home)
        inner, home = self._below(frame, home)
        _put(frame, inner)
        for tag in _CLOUDS:
            cloud = frame.find(tag)
            if cloud is not None:
                inner, home = self._below(cloud, home)
                _put(cloud, inner)
                break
        return chunk, self._members(home)

    def _below(self, element: Xml, home: Path) -> tuple[Xml, Path]:
        """What an element stands for, and the archive that it comes from."""
        named = element.get("path")
        if not named:
            return element, home
        path = home.parent / named.replace("\\", "/")
        return self._read(path), path

    def _read(self, path: Path) -> Xml:
        if not path.resolve().is_relative_to(self._path.parent.resolve()):
            raise InputError(
                f"{self._at.name} names {path}, which is outside the project's folder: a project "
                "of Metashape has all its archives below it; save it again"
            )
        self._at = path
        with zipfile.ZipFile(path) as archive:
            return Xml.parse(_unpacked(archive, _DOCUMENT), path)

    def _members(self, path: Path) -> Members:
        def read(name: str) -> bytes:
            self._at = path
            with zipfile.ZipFile(path) as archive:
                return _unpacked(archive, name)

        return read


def _unpacked(archive: zipfile.ZipFile, name: str) -> bytes:
    """The bytes of a member. Raises InputError where it is packed beyond all measure."""
    found = archive.getinfo(name)
    # What its head says is the most that is unpacked.
    check_growth(name, found.compress_size, found.file_size)
    return archive.read(found)


def _put(element: Xml, inner: Xml) -> None:
    """The parts of `inner` into an element that named its archive."""
    if inner.element is not element.element:
        element.element.extend(list(inner.element))


def read_ply(members: Members, element: Xml) -> np.ndarray:
    """Vertices of the binary little endian PLY that an element names, as a structured array.

    Raises InputError where it is no such file, or cut off.
    """
    name = element.get("path", "")
    data = members(name)
    end = data.find(b"end_header\n")
    head = data[: max(end, 0)].decode("ascii", errors="replace").split("\n")
    columns, count = [], None
    for row in head:
        words = row.split()
        if words[:2] == ["element", "vertex"] and len(words) == 3 and words[2].isdecimal():
            count = int(words[2])
        elif words[:1] == ["element"] and count is not None:
            break
        elif words[:1] == ["property"] and len(words) == 3 and words[1] in _PLY:
            columns.append((words[2], _PLY[words[1]]))
    if end < 0 or count is None or "binary_little_endian" not in head[1:2][0]:
        raise element.wrong(f"{name} is not a binary PLY; save the project again")
    kind = np.dtype(columns)
    start = end + len(b"end_header\n")
    if kind.itemsize == 0 or len(data) < start + count * kind.itemsize:
        raise element.wrong(f"{name} is cut off; save the project again")
    return np.frombuffer(data, kind, count, start)
