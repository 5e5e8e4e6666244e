"""Points followed by their views, as Bundler and VisualSFM write them."""

import numpy as np

from corridor.interchange.columns import NumberLines
from corridor.textfile import Following


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
        raise table.wrong(int(seers[np.argmin(counted)]), "the number of views is no whole number")
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
