"""COLMAP's files as records: one layout for the text and the binary form (little endian).

A record is a row of fields, perhaps a name, perhaps rows of its own (image points, tracks). Text
has a line a record; images.txt two: the second holds x, y and point id of every measured point and
may be empty. Comments promise the counts.

Source: COLMAP documentation, format.rst, and src/colmap/scene/reconstruction_io_binary.cc.
"""

import io
import re
import struct
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.textfile import Line, lines, read_bytes
from corridor.tools.formats.columns import (
    NumberLines,
    in_groups,
    in_parts,
    in_rows,
    plain_numbers,
    text_of,
    write_rows,
)
from corridor.tools.formats.names import in_any_case
from corridor.tools.formats.programs.colmap.cameras import BY_NUMBER
from corridor.tools.formats.textfile import Following

# Kind and name of each field. m, s: a word in text, a number (i) in binary; d: a float64.
CAMERA = (("I", "CAMERA_ID"), ("m", "MODEL"), ("Q", "WIDTH"), ("Q", "HEIGHT"))
POSE = tuple(("d", name) for name in ("QW", "QX", "QY", "QZ", "TX", "TY", "TZ"))
IMAGE = (("I", "IMAGE_ID"), *POSE, ("I", "CAMERA_ID"))
POINT = (
    ("Q", "POINT3D_ID"), ("d", "X"), ("d", "Y"), ("d", "Z"),
    ("B", "R"), ("B", "G"), ("B", "B"), ("d", "ERROR"),
)  # fmt: skip
RIG = (("I", "RIG_ID"), ("I", "NUM_SENSORS"))
SENSOR = (("s", "SENSOR_TYPE"), ("I", "SENSOR_ID"))
OTHER_SENSOR = (*SENSOR, ("B", "HAS_POSE"))
FRAME = (("I", "FRAME_ID"), ("I", "RIG_ID"), *POSE, ("I", "NUM_DATA_IDS"))
DATA = (*SENSOR, ("Q", "DATA_ID"))
Layout = tuple[tuple[str, str], ...]

_NAMES = {"m": BY_NUMBER, "s": {0: "CAMERA", 1: "IMU"}}
_WORDS = {kind: {name: k for k, name in names.items()} for kind, names in _NAMES.items()}
_POINT2D = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<u8")])
_TRACK = np.dtype([("image", "<u4"), ("index", "<u4")])
_NO_POINT = np.uint64(2**64 - 1)
# Beyond this a float64 does not tell one whole number from the next.
_EXACT = 2.0**53
_COUNT = re.compile(r"#\s*Number of \w+:\s*(\d+)")
_GREY = 128


@lru_cache(maxsize=32)
def _struct(layout: Layout) -> tuple[struct.Struct, tuple[int, ...]]:
    kinds = [kind for kind, _ in layout]
    binary = "".join("i" if kind in _WORDS else kind for kind in kinds)
    return struct.Struct(f"<{binary}"), tuple(k for k, kind in enumerate(kinds) if kind == "d")


# --- in --------------------------------------------------------------------------------------


class BinaryFile:
    """A .bin file, a record after another; it says where it ends too early."""

    def __init__(self, folder: Path, stem: str, warnings: list[str]):
        self.path, self._at, self.place = in_any_case(folder / f"{stem}.bin"), 0, ""
        self._kind = stem.rstrip("s").replace("points3D", "point")
        self._data = read_bytes(self.path)

    def wrong(self, sentence: str) -> InputError:
        """The error that names file and record before the sentence."""
        return InputError(f"{self.path.name}, {self.place}: {sentence}")

    def records(self, split: int = -1) -> "Iterator[BinaryFile]":
        """The file itself, at each of its records."""
        self.place = "its count"
        (count,) = self.take((("Q", "count"),))
        for k in range(count):
            self.place = f"{self._kind} {k + 1} of {count}"
            yield self
        if self._at != len(self._data):
            raise InputError(
                f"{self.path.name} goes on after its {self._at} bytes of entries (it has "
                f"{len(self._data)}); its count is wrong, export the project again"
            )

    def take(self, layout: Layout) -> tuple:
        """The next fields of the record."""
        form, real = _struct(layout)
        self._enough(form.size)
        values = form.unpack_from(self._data, self._at)
        self._at += form.size
        for k in real:
            if not -np.inf < values[k] < np.inf:
                raise self.wrong(f"{layout[k][1]} is not finite; export the project again")
        return values

    def name(self) -> str:
        """The name that ends here."""
        end = self._data.find(b"\0", self._at)
        if end < 0:
            self._enough(len(self._data) + 1)
        try:
            text = self._data[self._at : end].decode("utf-8")
        except UnicodeDecodeError:
            raise self.wrong("its name is not UTF-8; rename the image") from None
        self._at = end + 1
        return text

    def image_points(self) -> tuple[np.ndarray, np.ndarray]:
        """x, y (n, 2) and point ids (n,), -1 where there is none."""
        found = self._rows(_POINT2D)
        ids = found["point"]
        seen = ids != _NO_POINT
        if (ids[seen] >= 2**63).any():
            raise self.wrong("it sees a point of an impossible number; export the project again")
        return np.column_stack([found["x"], found["y"]]), np.where(seen, ids, 0).astype(
            np.int64
        ) - ~seen

    def points(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Ids (n,), places (n, 3) of the points, and how many observations their tracks count."""
        ids, places, tracked = [], [], 0
        for record in self.records():
            number, *place = record.take(POINT)[:4]
            if number >= 2**63:
                raise self.wrong("its number is impossible; export the project again")
            ids.append(number)
            places.append(place)
            tracked += len(self._rows(_TRACK))
        return np.array(ids, np.int64), np.array(places).reshape(-1, 3), tracked

    def _rows(self, dtype):
        (count,) = self.take((("Q", "count"),))
        self._enough(dtype.itemsize * count)
        rows = np.frombuffer(self._data, dtype, count, self._at)
        self._at += rows.nbytes
        return rows

    def _enough(self, size):
        if self._at + size > len(self._data):
            raise InputError(
                f"{self.path.name} ends at byte {len(self._data)}, within {self.place}; it is cut "
                "off, export the project again"
            )


class TextFile:
    """A .txt file, a record a line; the counts that its comments promise are compared."""

    def __init__(self, folder: Path, stem: str, warnings: list[str]):
        self.path, self._warnings = in_any_case(folder / f"{stem}.txt"), warnings
        self._lines = lines(self.path)
        self._line, self._words, self._at = Line(self.path, 1, ""), [], 0

    @property
    def place(self) -> str:
        """File and line of the record."""
        return f"{self.path.name}, line {self._line.at}"

    def wrong(self, sentence: str) -> InputError:
        """The error that names file and line before the sentence."""
        return self._line.wrong(sentence)

    def records(self, split: int = -1) -> "Iterator[TextFile]":
        """The file itself, at each of its records. split: how many words before a name."""
        stated, count = None, 0
        for line in self._lines:
            match = _COUNT.match(line.text)
            stated = int(match[1]) if match else stated
            if not line.text.strip() or line.text.lstrip().startswith("#"):
                continue
            count += 1
            self._line, self._words, self._at = line, line.text.split(maxsplit=split), 0
            yield self
            if self._at < len(self._words):
                raise self.wrong(
                    f"{len(self._words)} words where {self._at} belong; the line is of another "
                    "program"
                )
        self._counted(stated, count)

    def _counted(self, stated, count):
        if stated is not None and stated != count:
            self._warnings.append(
                f"{self.path.name} promises {stated} entries and holds {count}: it may be cut off, "
                "or cut down by hand"
            )

    def take(self, layout: Layout) -> tuple:
        """The next fields of the record."""
        words = self._words[self._at : self._at + len(layout)]
        if len(words) < len(layout):
            raise self.wrong(
                f"{len(self._words)} words where {self._at + len(layout)} or more belong; the line "
                "is cut off or of another program"
            )
        self._at += len(layout)
        return tuple(self._field(*field) for field in zip(layout, words, strict=True))

    def _field(self, field, word):
        kind, name = field
        if kind == "d":
            return self._line.number(word, name)
        if kind in _WORDS:
            if word not in _WORDS[kind]:
                raise self.wrong(f"{name} {word[:40]!r} is unknown; use one of COLMAP's")
            return _WORDS[kind][word]
        return self._line.whole(word, name)

    def name(self) -> str:
        """The rest of the line: a name may hold blanks."""
        if self._at >= len(self._words):
            raise self.wrong(
                f"{len(self._words)} words where an image has 10; the line is cut off or of "
                "another program"
            )
        self._at += 1
        return self._words[-1]

    def image_points(self) -> tuple[np.ndarray, np.ndarray]:
        """x, y (n, 2) and point ids (n,), -1 where there is none, of the line that follows."""
        line = next(self._lines, Line(self.path, self._line.at, ""))
        plain = plain_numbers(io.BytesIO(line.text.encode()))
        values = plain.values if plain is not None else None
        if values is None or len(values) % 3:
            words = line.text.split()
            if len(words) % 3:
                raise line.wrong(
                    f"{len(words)} numbers where x, y, point id make threes; the file is cut off "
                    "or a line is missing"
                )
            values = line.numbers(words, "an image point")
        found = values.reshape(-1, 3)
        ids = found[:, 2]
        if ((ids != np.floor(ids)) | (ids < -1)).any():
            raise line.wrong("a point id is not a whole number; the numbers are out of step")
        # Old versions write the largest unsigned number for "no point".
        return found[:, :2], np.where(ids >= _EXACT, -1, ids).astype(np.int64)

    def points(self) -> tuple[np.ndarray, np.ndarray, int | None]:
        """The same as of a binary file; no count where no point has a track."""
        source = Following(self.path, comment="#")
        stated = [match for line in source.comments() if (match := _COUNT.match(line.text))]
        table = NumberLines(source, names=[*(name for _, name in POINT), "the track"])
        self._counted(int(stated[-1][1]) if stated else None, len(table.counts))
        table.expect(table.counts >= len(POINT), f"a point has {len(POINT)} or more")
        table.expect(table.counts % 2 == 0, "image id and index of a track make pairs")
        ids = table.values[table.starts]
        good = table.whole[table.starts] & (ids < _EXACT)
        if not good.all():
            raise table.wrong(int(np.argmin(good)), "POINT3D_ID is not a whole number that can be")
        places = table.values[table.starts[:, None] + np.arange(1, 4)]
        tracked = int((table.counts - len(POINT)).sum()) // 2
        return ids.astype(np.int64), places, tracked or None


# --- out -------------------------------------------------------------------------------------


class BinaryWriter:
    """A .bin file, to be used in a with statement."""

    def __init__(self, folder: Path, stem: str, count: int):
        self._path, self._count = folder / f"{stem}.bin", count

    def __enter__(self) -> "BinaryWriter":
        self._file = self._path.open("wb")
        self._file.write(struct.pack("<Q", self._count))
        return self

    def __exit__(self, *_):
        self._file.close()

    def put(self, layout: Layout, *values: float) -> None:
        """Fields of a record."""
        self._file.write(_struct(layout)[0].pack(*values))

    def reals(self, values: list[float]) -> None:
        """Numbers of a record without names."""
        self._file.write(struct.pack(f"<{len(values)}d", *values))

    def name(self, text: str) -> None:
        """The name of a record."""
        self._file.write(text.encode() + b"\0")

    def end(self) -> None:
        """The record is whole."""

    def image_points(self, xy: np.ndarray, ids: np.ndarray) -> None:
        """The image points of a record."""
        found = np.empty(len(ids), _POINT2D)
        found["x"], found["y"] = xy.T
        found["point"] = ids
        self._file.write(struct.pack("<Q", len(found)) + found.tobytes())

    def points(self, ids, places, errors, image, index, order, starts) -> None:
        """All points; image, index: of each observation; order, starts: of `grouped`."""
        tracks = np.empty(len(order), _TRACK)
        tracks["image"], tracks["index"] = image[order], index[order]
        tracks, ends = tracks.tobytes(), (starts * _TRACK.itemsize).tolist()
        head = struct.Struct("<Qddd3BdQ").pack
        every = zip(ids.tolist(), places.tolist(), errors.tolist(), strict=True)
        for k, (number, place, error) in enumerate(every):
            track = tracks[ends[k] : ends[k + 1]]
            length = len(track) // _TRACK.itemsize
            self._file.write(head(number, *place, _GREY, _GREY, _GREY, error, length) + track)


class TextWriter(BinaryWriter):
    """A .txt file of the same records."""

    def __init__(self, folder: Path, stem: str, count: int):
        self._path, self._count, self._stem = folder / f"{stem}.txt", count, stem
        self._words: list[str] = []

    def __enter__(self) -> "TextWriter":
        self._file = self._path.open("wb")
        self._file.write(f"# Number of {self._stem}: {self._count}\n".encode())
        return self

    def put(self, layout: Layout, *values: float) -> None:
        for (kind, _), value in zip(layout, values, strict=True):
            if kind in _NAMES:
                self._words.append(_NAMES[kind][value])
            else:
                self._words.append(repr(float(value)) if kind == "d" else str(value))

    def reals(self, values: list[float]) -> None:
        self._words += map(repr, map(float, values))

    def name(self, text: str) -> None:
        self._words.append(text)

    def end(self) -> None:
        self._file.write(f"{' '.join(self._words)}\n".encode())
        self._words = []

    def image_points(self, xy: np.ndarray, ids: np.ndarray) -> None:
        self.end()
        words = in_groups(in_rows(*xy.T, ids), np.array([0, len(ids)]))
        write_rows(self._file, words)
        self._words = [""]

    def points(self, ids, places, errors, image, index, order, starts) -> None:
        for part, ends, seen in in_parts(order, starts):
            write_rows(
                self._file,
                in_rows(ids[part], *places[part].T),
                f" {_GREY} {_GREY} {_GREY} ",
                text_of(errors[part]),
                " ",
                in_groups(in_rows(image[seen], index[seen]), ends),
                "\n",
            )
