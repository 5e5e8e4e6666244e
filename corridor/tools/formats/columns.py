"""Whole columns of numbers out of text files and into them, where a line at a time takes minutes.

What is plainly numbers is read at once; anything else line by line, which accepts more (byte order
marks, lone CR), and can say which line is wrong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from corridor.core.errors import InputError
from corridor.core.textfile import Line, missing, unpacked
from corridor.tools.formats.textfile import Following, filled

_CHUNK = 1 << 22  # bytes: little enough to stay in the processor's cache
_PLAIN = b"0123456789+-.eE \t\r\n"
_A_WORD_A_LINE = bytes.maketrans(b" \t\r", b"\n\n\n")
_NEWLINE = ord("\n")


@dataclass
class Plain:
    """Numbers of lines that hold nothing else.

    values (n,): finite. whole (n,): written with digits only. counts (m,): how many stand in each
    line that is not blank. size, lines: bytes and lines that were read, blank ones included.
    """

    values: np.ndarray
    whole: np.ndarray
    counts: np.ndarray
    size: int = 0
    lines: int = 0

    @property
    def starts(self) -> np.ndarray:
        """(m,): index of the first number of each line."""
        return np.cumsum(self.counts) - self.counts


class NumberLines(Plain):
    """The numbers of the next lines of a file, and where they stand."""

    def __init__(
        self, source: Following, most: int | None = None, names: Sequence[str] = ("a number",)
    ):
        """Read at most so many lines. names: of the words of a line, the last for all further ones.

        Raises InputError naming file and line of what is no number.
        """
        self._path, self._before, self._at = source.path, source.last, None
        plain = _at_once(source, most)
        if plain is not None:
            source.pass_by(plain.size, plain.lines)
        else:
            found = list(islice(source.rest(), most))
            self._at = [line.at for line in found]
            plain = _by_line(found, names)
        super().__init__(plain.values, plain.whole, plain.counts)

    def wrong(self, row: int, sentence: str) -> InputError:
        """The error that names file and line of a row."""
        if self._at is None:
            mine = (line.at for line in filled(self._path) if line.at > self._before)
            return Line(self._path, next(islice(mine, row, None)), "").wrong(sentence)
        return Line(self._path, self._at[row], "").wrong(sentence)

    def expect(self, good: np.ndarray, what: str) -> None:
        """Raise InputError at the first row (m,) that is not good, with the words that it has."""
        if not good.all():
            row = int(np.argmin(good))
            raise self.wrong(
                row, f"{self.counts[row]} words where {what}; the file is cut off or out of step"
            )


def _at_once(source: Following, most: int | None) -> Plain | None:
    # What was passed is read again, so the lines before must be few.
    try:
        with unpacked(source.path) as file:
            before = b"".join(file.readline() for _ in range(source.last))
            # Lines may not end with CR alone, nor be UTF-16.
            if before.count(b"\r") != before.count(b"\r\n") or b"\0" in before:
                return None
            plain = plain_numbers(file, most)
    except (OSError, EOFError) as error:
        raise missing(source.path, error) from error
    return plain and replace(plain, size=plain.size + len(before))


def _by_line(found: list[Line], names: Sequence[str]) -> Plain:
    values, whole, counts = [np.zeros(0)], [], []
    for line in found:
        words = line.text.split()
        counts.append(len(words))
        whole += [word.isdecimal() for word in words]
        try:
            values.append(line.numbers(words, names[-1]))
        except InputError:
            for k, word in enumerate(words):
                line.number(word, names[min(k, len(names) - 1)])
            raise
    return Plain(np.concatenate(values), np.array(whole, bool), np.array(counts, np.int64))


def plain_numbers(file: BinaryIO, most: int | None = None) -> Plain | None:
    """The numbers of a file from where it stands, or of its next `most` lines that are not blank.

    None where anything else than decimal numbers, blanks and line ends (LF, CR LF) stands there.
    """
    values, whole, counts = [np.zeros(0)], [np.zeros(0, bool)], [np.zeros(0, np.int64)]
    size, lines, left, rest = 0, 0, np.inf if most is None else most, b""
    while left > 0:
        piece = file.read(_CHUNK)
        data = rest + piece
        if not data:
            break
        end = data.rfind(b"\n") + 1 if piece else len(data)
        data, rest = data[:end], data[end:]
        starts, found, data = _words(data, left)
        numbers = _numbers(data, len(starts))
        if numbers is None:
            return None
        values.append(numbers)
        whole.append(_whole(data, starts))
        counts.append(found)
        size, lines, left = size + len(data), lines + data.count(b"\n"), left - len(found)
    return Plain(*map(np.concatenate, (values, whole, counts)), size, lines)


def _words(data, most):
    """Where words start, how many each line has that is not blank, and the data of `most` such."""
    codes = np.frombuffer(data, np.uint8)
    there = codes > ord(" ")
    first = there.copy()
    first[1:] &= ~there[:-1]
    starts, ends = np.flatnonzero(first), np.flatnonzero(codes == _NEWLINE)
    if not data.endswith(b"\n"):
        ends = np.append(ends, len(data))
    before = np.searchsorted(starts, ends)
    counts = np.diff(before, prepend=0)
    some = np.flatnonzero(counts)
    if len(some) > most:
        some = some[: int(most)]
        starts, data = starts[: before[some[-1]]], data[: ends[some[-1]] + 1]
    return starts, counts[some], data


def _numbers(data, count):
    if data.translate(None, _PLAIN):
        return None
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        return None
    if not count:
        return np.zeros(0)
    try:
        table = pa.csv.read_csv(
            pa.BufferReader(data.translate(_A_WORD_A_LINE)),
            read_options=pa.csv.ReadOptions(
                column_names=["number"], use_threads=False, block_size=len(data) + 1
            ),
            parse_options=pa.csv.ParseOptions(quote_char=False),
            convert_options=pa.csv.ConvertOptions(
                column_types={"number": pa.float64()}, null_values=[]
            ),
        )
    except pa.ArrowInvalid:
        return None
    values = table["number"].to_numpy()
    return values if len(values) == count and np.isfinite(values).all() else None


def _whole(data, starts):
    if not len(starts):
        return np.zeros(0, bool)
    codes = np.frombuffer(data, np.uint8)
    other = (codes > ord(" ")) & (codes - np.uint8(ord("0")) > 9)
    return ~np.logical_or.reduceat(other, starts)


def points_with_views(
    source: Following, points: int, images: int, lines_each: int, seer: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The points that follow: place, colour, number of views, views.

    A view is image, feature, x, y. All stand in one line, or place, colour and views in three.
    seer: what sees a point, in the format's word.
    Returns places (points, 3), and of each view point, image (m,) and x, y (m, 2).
    Raises InputError naming file and line.
    """
    table = NumberLines(source, points * lines_each)
    rows = len(table.counts)
    row = np.arange(rows)
    if lines_each == 3:
        table.expect((table.counts == 3) | (row % 3 == 2), "a point's place and colour have 3")
    # Where the views of a point begin, with their number.
    ahead, first = (0, table.starts[2::3]) if lines_each == 3 else (6, table.starts)
    seers = row[2::3] if lines_each == 3 else row
    enough = np.ones(rows, bool)
    enough[seers] = table.counts[seers] > ahead
    table.expect(enough, "a point has 7 or more")
    counted = table.whole[first + ahead]
    if not counted.all():
        raise table.wrong(
            int(seers[np.argmin(counted)]), "the number of views is not a whole number"
        )
    seen = table.values[first + ahead]
    enough[seers] = table.counts[seers] == ahead + 1 + 4 * seen
    table.expect(enough, "each view needs 4 and their number is promised")
    if rows < points * lines_each:
        source.next(f"point {rows // lines_each + 1} of {points}")
    view = np.ones(len(table.values), bool)
    begin = table.starts[::lines_each]
    view[begin[:, None] + np.arange(7)] = False
    views = table.values[view].reshape(-1, 4)
    point = np.repeat(np.arange(points), seen.astype(np.int64))
    image = views[:, 0]
    known = (image >= 0) & (image < images) & (image % 1 == 0)
    if not known.all():
        raise table.wrong(
            int(seers[point[np.argmin(known)]]),
            f"a view names {seer} that is not among the {images}; the file is out of step",
        )
    return (
        table.values[begin[:, None] + np.arange(3)],
        point,
        image.astype(np.int64),
        views[:, 2:].copy(),
    )


# --- out -------------------------------------------------------------------------------------


def text_of(values: np.ndarray) -> pa.Array:
    """Numbers as text, with the digits that give the same float64 back."""
    return pc.cast(pa.array(np.ascontiguousarray(values)), pa.string())


def in_rows(*columns: np.ndarray) -> pa.Array:
    """The numbers of each row, one blank between them."""
    return pc.binary_join_element_wise(*map(text_of, columns), " ")


def in_groups(words: pa.Array, starts: np.ndarray) -> pa.Array:
    """The words of each group of rows, blanks between; starts (groups + 1,): their first rows."""
    groups = pa.ListArray.from_arrays(pa.array(starts, pa.int32()), words)
    return pc.binary_join(groups, " ")


def grouped(codes: np.ndarray, groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows in the order of their groups, and (groups + 1,) where each group begins among them."""
    order = np.argsort(codes, kind="stable")
    return order, np.searchsorted(codes[order], np.arange(groups + 1))


def numbered(codes: np.ndarray) -> np.ndarray:
    """Each row's number within its group, from 0."""
    return pd.Series(codes).groupby(codes, sort=False).cumcount().to_numpy()


def in_parts(
    order: np.ndarray, starts: np.ndarray, step: int = 100_000
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Some groups at a time: which, where each begins, counted from the first, and their rows.

    order, starts: of `grouped`.
    """
    for first in range(0, len(starts) - 1, step):
        part = slice(first, first + step)
        mine = starts[first : first + step + 1]
        yield part, mine - mine[0], order[mine[0] : mine[-1]]


def text_of_rows(*parts: pa.Array | str) -> tuple[pa.Buffer, np.ndarray]:
    """The parts of each row, nothing between them, as one text, and where in it each row begins.

    A str stands in every row. The second (rows + 1,) has the end of the last row too.
    """
    made = pc.binary_join_element_wise(*parts, "")
    _, offsets, data = made.buffers()
    if not len(made):
        return pa.py_buffer(b""), np.zeros(1, np.int32)
    return data, np.frombuffer(offsets, np.int32)[: len(made) + 1]


def write_rows(file: BinaryIO, *parts: pa.Array | str) -> None:
    """Write what `text_of_rows` makes of the parts."""
    data, starts = text_of_rows(*parts)
    file.write(data.slice(0, int(starts[-1])))
