"""Measured beside simulated: what leaves the band is marked, before and after."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from test_pictures import assert_legible, written

from corridor import diagnosis
from corridor.diagnosis.bootstrap.statistics import Statistic
from corridor.interface import figures
from corridor.interface.figures import style

SIGNATURES = "signatures of the physical effects"


def compared(off=0.0, seed=1):
    """Three curves and a map; the third value of each is `off` deviations out."""
    draw = np.random.default_rng(seed)
    cells = np.array([0, 1, 2, 4, 5])
    middle = np.column_stack([cells % 3 + 0.5, cells // 3 + 0.5]) * [1000.0, 1500.0]
    names = ("rolling_shutter", "thermal", "focal_drift")
    statistics = [
        Statistic(SIGNATURES, "signature", "stated deviations", "effect", np.arange(3.0), names),
        Statistic(
            "tie residuals in x by row", "tie", "px", "row (fraction)", np.linspace(-0.4, 0.4, 6)
        ),
        Statistic("GNSS z by time", "gnss", "m", "time (s)", np.arange(8.0)),
        Statistic(
            "tie residuals in x by image position", "tie", "px", "place in the image (px)", middle,
            (), (3, 2), cells,
        ),
    ]  # fmt: skip
    scale = np.concatenate([np.full(len(s), 0.004 if s.unit == "m" else 0.02) for s in statistics])
    simulated = scale * draw.standard_normal((39, len(scale)))
    measured = np.zeros(len(scale))
    measured[np.cumsum([0] + [len(s) for s in statistics[:-1]]) + 2] = off
    block = SimpleNamespace(name="made up")
    return diagnosis.compare(
        SimpleNamespace(
            statistics=statistics, measured=scale * measured, simulated=simulated,
            absorbed=np.zeros(len(scale), bool), missing={}, unseen=(),
            replicator=SimpleNamespace(system=SimpleNamespace(block=block)),
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def pair():
    return compared(off=9.0), compared()


def panels(figure):
    figure.draw_without_rendering()
    return [axes for axes in figure.axes if axes.lines]


def diamonds(axes):
    return [xy for line in axes.lines if line.get_marker() == "D" for xy in line.get_xydata()]


class TestCurves:
    def test_before_and_after_stand_below_each_other(self, pair):
        drawn = panels(figures.counterpart(*pair))
        assert len(drawn) == 6
        above, below = (axes.get_position() for axes in drawn[:2])
        assert above.x0 == below.x0 and above.y0 > below.y1
        assert drawn[0].get_ylim() == drawn[1].get_ylim()

    def test_only_the_value_outside_is_marked(self, pair):
        before, *_ = panels(figures.counterpart(pair[0], names=["tie residuals in x by row"]))
        ((x, y),) = diamonds(before)
        assert x == pytest.approx(-0.4 + 2 * 0.16)
        assert y == pytest.approx(9 * 0.02)
        (after,) = panels(figures.counterpart(pair[1], names=["tie residuals in x by row"]))
        assert diamonds(after) == []

    def test_a_curve_that_leaves_is_dark_and_one_inside_quiet(self, pair):
        for case, colour in zip(pair, (style.INK, style.QUIET), strict=True):
            (axes,) = panels(figures.counterpart(case, names=["tie residuals in x by row"]))
            solid = [li for li in axes.lines if li.get_marker() == "o"]
            assert to_hex(solid[0].get_color()) == colour

    def test_millimetres_where_metres_are_small(self, pair):
        (axes,) = panels(figures.counterpart(pair[0], names=["GNSS z by time"]))
        assert axes.get_ylabel() == "mm"
        assert diamonds(axes)[0][1] == pytest.approx(36.0)

    def test_axes_carry_their_units(self, pair):
        (axes,) = panels(figures.counterpart(pair[0], names=["tie residuals in x by row"]))
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("row (fraction)", "px")

    def test_effects_are_named_under_their_signatures(self, pair):
        axes = panels(figures.counterpart(pair[0]))[0]
        shown = [text.get_text() for text in axes.get_xticklabels()]
        assert shown == ["rolling shutter", "thermal", "focal drift"]

    def test_the_note_tells_the_gap_before_and_after(self, pair):
        (note,) = [
            text.get_text() for text in figures.counterpart(*pair).texts if "gap" in text.get_text()
        ]
        assert note.startswith("4 of 4 statistics leave the band before, 0 of 4 after")


class TestMaps:
    def test_cells_outside_are_framed_and_carry_their_deviations(self, pair):
        figure = figures.counterpart_maps(*pair)
        figure.draw_without_rendering()
        before, after = (axes for axes in figure.axes if axes.get_ylabel() == "y (px)")
        assert len(before.lines) == 1 and len(after.lines) == 0
        # The third cell of a row of three: 2,000 to 3,000 px, 0 to 1,500 px.
        frame = before.lines[0].get_xydata()
        assert frame.min(axis=0).tolist() == [2000.0, 0.0]
        assert frame.max(axis=0).tolist() == [3000.0, 1500.0]
        written = [t.get_text() for t in before.texts if t.get_text().startswith("+")]
        assert len(written) == 1

    def test_rows_of_the_picture_count_downwards(self, pair):
        figure = figures.counterpart_maps(pair[0])
        axes = next(axes for axes in figure.axes if axes.get_ylabel() == "y (px)")
        low, high = axes.get_ylim()
        assert low > high

    def test_names_as_long_as_they_come_keep_clear_of_each_other(self):
        block = compared()
        of_map = next(one for one in block.statistics if one.statistic.shape is not None)
        name = of_map.statistic.name + ", growing with temperature"
        longer = replace(of_map, statistic=replace(of_map.statistic, name=name))
        maps = copy(block)
        maps.statistics = [longer, of_map]
        for cases in [(maps,), (maps, maps)]:
            figure = figures.counterpart_maps(*cases)
            assert_legible(figure)
            ends = [box for text, box in written(figure) if text.startswith("position")]
            assert ends[0].x1 + 5 < ends[1].x0

    def test_without_a_map_it_says_so(self, pair):
        flat = SimpleNamespace(**vars(pair[0]))
        flat.statistics = [one for one in pair[0].statistics if one.statistic.shape is None]
        texts = [t.get_text() for t in figures.counterpart_maps(flat).texts]
        assert "No statistic is a map." in texts


class TestAxes:
    def test_every_axis_is_there_once_farthest_first(self, pair):
        """The signatures are no axis; of row and time one statistic each."""
        drawn = panels(figures.counterpart_axes(pair[0]))
        labels = [axes.get_xlabel() for axes in drawn]
        assert sorted(labels) == ["row (fraction)", "time (s)"]
        far = [
            max(abs(pair[0][name].z)) / pair[0][name].limit
            for name in ("tie residuals in x by row", "GNSS z by time")
        ]
        assert labels[0] == ("row (fraction)" if far[0] > far[1] else "time (s)")

    def test_it_is_drawn_before_and_after(self, pair):
        assert len(panels(figures.counterpart_axes(*pair))) == 4
