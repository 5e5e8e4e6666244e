"""Text files in which each line says what must follow: counts, cameras, points with their views."""

import numpy as np

from corridor.errors import InputError
from corridor.interchange.columns import Plain, plain_numbers
from corridor.interchange.text import lines, numbers, whole


class Following:
    """Lines with something on them, one after the other; the end is told with the place."""

    def __init__(self, path):
        self.path, self.last, self._lines = path, 0, lines(path)

    def next(self, what: str) -> tuple[int, str]:
        """Number and text of the next line. Raises InputError where the file ends before."""
        for line, text in self.rest():
            return line, text
        raise InputError(
            f"{self.path.name}, line {self.last}: the file ends where {what} should follow; it is "
            "cut off or its counts are wrong"
        )

    def words(self, count: int, what: str) -> tuple[list[str], int]:
        """The `count` words of the next line, and its number."""
        line, text = self.next(what)
        words = text.split()
        if len(words) != count:
            raise InputError(
                f"{self.path.name}, line {line}: {len(words)} words where {what} needs {count}; "
                "the file is cut off or out of step"
            )
        return words, line

    def values(self, count: int, what: str) -> np.ndarray:
        """The `count` numbers of the next line."""
        words, line = self.words(count, what)
        return numbers(words, self.path, line, what)

    def rest(self):
        """Number and text of the lines that are left."""
        for line, text in self._lines:
            self.last = line
            if text.strip():
                yield line, text

    def plain(self, count: int) -> Plain | None:
        """The numbers of the next `count` lines, without passing them; None where it is not sure.

        What follows is read again, so the lines before must be few.
        """
        with self.path.open("rb") as file:
            before = b"".join(file.readline() for _ in range(self.last))
            if before.count(b"\r") != before.count(b"\r\n"):  # lines that end with CR alone
                return None
            found = plain_numbers(file, count)
        self._passed = len(before)
        return found

    def take(self, found: Plain) -> None:
        """Pass the lines that `plain` has read."""
        self.last += found.lines
        self._lines = lines(self.path, self._passed + found.size, self.last)


def points_with_views(
    source: Following, points: int, images: int, lines_each: int, seer: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points as Bundler and VisualSFM write them: place, colour, number of views, views.

    A view is image, feature, x, y. All stand in one line, or place, colour and views in three.
    seer: what sees a point, in the format's word.
    Returns places (points, 3), and of each view point, image (m,) and x, y (m, 2).
    Raises InputError naming file and line.
    """
    found = _at_once(source, points, images, lines_each)
    if found is not None:
        return found
    places, seen, image, xy = np.empty((points, 3)), [], [], []
    for k in range(points):
        what, before = f"point {k + 1} of {points}", 0
        if lines_each == 3:
            places[k] = source.values(3, what)
            source.values(3, f"the colour of {what}")
            line, text = source.next(f"the views of {what}")
            words = text.split()
        else:
            line, text = source.next(what)
            words, before = text.split(), 6
            if len(words) <= before:
                raise InputError(
                    f"{source.path.name}, line {line}: {len(words)} words where a point has 7 or "
                    "more"
                )
        count = whole(words[before], source.path, line, "number of views")
        needed = before + 1 + 4 * count
        if len(words) != needed:
            raise InputError(
                f"{source.path.name}, line {line}: {len(words)} words where {count} views need "
                f"{needed}; the file is cut off or out of step"
            )
        if before:
            places[k] = numbers(words[:3], source.path, line, "a point")
        views = numbers(words[before + 1 :], source.path, line, "a view").reshape(-1, 4)
        if not _known(views, images):
            raise InputError(
                f"{source.path.name}, line {line}: a view names {seer} that is not among the "
                f"{images}; the file is out of step"
            )
        seen.append(count)
        image.append(views[:, 0].astype(np.int64))
        xy.append(views[:, 2:])
    return (
        places,
        np.repeat(np.arange(points), seen),
        np.concatenate([*image, np.zeros(0, np.int64)]),
        np.concatenate([*xy, np.zeros((0, 2))]),
    )


def _known(views, images):
    image = views[:, 0]
    return ((image >= 0) & (image < images) & (image % 1 == 0)).all()


def _at_once(source, points, images, lines_each):
    """The same of a whole file; None where it is not as it should be, for the loop to say why."""
    plain = source.plain(points * lines_each)
    if plain is None or len(plain.counts) != points * lines_each:
        return None
    counts = plain.counts.reshape(points, lines_each)
    if lines_each == 3 and (counts[:, :2] != 3).any():
        return None
    counts = counts.sum(axis=1)
    first = np.cumsum(counts) - counts
    if (counts < 7).any() or not plain.whole[first + 6].all():
        return None
    seen = plain.values[first + 6]
    if (counts != 7 + 4 * seen).any():
        return None
    view = np.ones(len(plain.values), bool)
    view[first[:, None] + np.arange(7)] = False
    views = plain.values[view].reshape(-1, 4)
    if not _known(views, images):
        return None
    source.take(plain)
    return (
        plain.values[first[:, None] + np.arange(3)],
        np.repeat(np.arange(points), seen.astype(np.int64)),
        views[:, 0].astype(np.int64),
        views[:, 2:].copy(),
    )
