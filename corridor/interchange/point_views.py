"""Points followed by their views, as Bundler and VisualSFM write them."""

import numpy as np

from corridor.interchange.columns import plain_numbers
from corridor.textfile import Following


class PointViews(Following):
    """A text file in which each line says what must follow, points with views at the end."""

    def points(
        self, points: int, images: int, lines_each: int, seer: str
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The points that follow: place, colour, number of views, views.

        A view is image, feature, x, y. All stand in one line, or place, colour and views in three.
        seer: what sees a point, in the format's word.
        Returns places (points, 3), and of each view point, image (m,) and x, y (m, 2).
        Raises InputError naming file and line.
        """
        found = self._at_once(points, images, lines_each)
        return found or self._by_line(points, images, lines_each, seer)

    def _by_line(self, points, images, lines_each, seer):
        places, seen, image, xy = np.empty((points, 3)), [], [], []
        for k in range(points):
            what, before = f"point {k + 1} of {points}", 0
            if lines_each == 3:
                places[k] = self.values(3, what)
                self.values(3, f"the colour of {what}")
                line = self.next(f"the views of {what}")
                words = line.text.split()
            else:
                line = self.next(what)
                words, before = line.text.split(), 6
                if len(words) <= before:
                    raise line.wrong(f"{len(words)} words where a point has 7 or more")
            count = line.whole(words[before], "number of views")
            needed = before + 1 + 4 * count
            if len(words) != needed:
                raise line.wrong(
                    f"{len(words)} words where {count} views need {needed}; the file is cut off or "
                    "out of step"
                )
            if before:
                places[k] = line.numbers(words[:3], "a point")
            views = line.numbers(words[before + 1 :], "a view").reshape(-1, 4)
            if not _known(views, images):
                raise line.wrong(
                    f"a view names {seer} that is not among the {images}; the file is out of step"
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

    def _at_once(self, points, images, lines_each):
        """The same of a whole file; None where it is not as it should be, for the loop to say."""
        with self.path.open("rb") as file:
            # What follows is read again, so the lines before must be few.
            before = b"".join(file.readline() for _ in range(self.last))
            if before.count(b"\r") != before.count(b"\r\n"):  # lines that end with CR alone
                return None
            plain = plain_numbers(file, points * lines_each)
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
        self.pass_by(len(before) + plain.size, plain.lines)
        return (
            plain.values[first[:, None] + np.arange(3)],
            np.repeat(np.arange(points), seen.astype(np.int64)),
            views[:, 0].astype(np.int64),
            views[:, 2:].copy(),
        )


def _known(views, images):
    image = views[:, 0]
    return ((image >= 0) & (image < images) & (image % 1 == 0)).all()
