"""Pictures of a benchmark: what is where, and nothing that overlaps."""

import numpy as np
import pytest

from benchmarks.diagnosis.pictures import confusion_matrix, naming_rates

HIDDEN = ["nothing", "rolling_shutter", "rolling_shutter_rotation", "jello"]
ANSWERS = ["rolling_shutter", "rolling_shutter_rotation", "unknown", "nothing"]
COUNTS = [[0, 0, 1, 12], [9, 2, 0, 0], [0, 3, 0, 0], [0, 0, 4, 0]]


def rate(hits, count):
    share = hits / count if count else None
    return {"hits": hits, "count": count, "share": share, "low": share and share - 0.1,
            "high": share and min(share + 0.05, 1.0)}  # fmt: skip


BINS = [
    {"from": low, "to": high, "detected": rate(d, n), "named": rate(m, n), "inside": rate(d, n)}
    for low, high, d, m, n in ((0, 4, 3, 2, 9), (4, 8, 0, 0, 0), (8, None, 20, 19, 20))
]


class TestConfusion:
    def test_every_count_stands_in_its_cell_and_zeros_stay_empty(self):
        (axes,) = confusion_matrix(HIDDEN, ANSWERS, COUNTS).axes
        written = {text.get_position(): int(text.get_text()) for text in axes.texts}
        for (column, row), count in written.items():
            assert COUNTS[int(row)][int(column)] == count
        assert len(written) == np.count_nonzero(COUNTS)

    def test_right_names_are_framed(self):
        (axes,) = confusion_matrix(HIDDEN, ANSWERS, COUNTS).axes
        framed = {(HIDDEN[round(p.get_y() + 0.5)], ANSWERS[round(p.get_x() + 0.5)])
                  for p in axes.patches}  # fmt: skip
        assert framed == {(name, name) for name in HIDDEN if name in ANSWERS}

    def test_names_do_not_leave_the_sheet(self):
        figure = confusion_matrix(HIDDEN, ANSWERS, COUNTS)
        figure.draw_without_rendering()
        width, height = figure.canvas.get_width_height()
        for text in (*figure.axes[0].get_xticklabels(), *figure.axes[0].get_yticklabels()):
            box = text.get_window_extent()
            assert box.x0 > 0 and box.y0 > 0 and box.x1 < width and box.y1 < height

    def test_no_blocks_are_said_in_a_sentence(self):
        assert not confusion_matrix([], [], []).axes


class TestRates:
    def test_bins_without_blocks_are_left_out(self):
        (axes,) = naming_rates(BINS).axes
        labels = [text.get_text() for text in axes.get_xticklabels()]
        assert labels == ["0 to 4\n(9)", "8 and more\n(20)"]

    def test_shares_are_in_per_cent(self):
        (axes,) = naming_rates(BINS).axes
        shown = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == 2]
        assert any(np.allclose(y, [100 * 3 / 9, 100.0]) for y in shown)

    @pytest.mark.parametrize("bins", [[], BINS[1:2]])
    def test_nothing_to_draw_is_said_in_a_sentence(self, bins):
        assert not naming_rates(bins).axes
