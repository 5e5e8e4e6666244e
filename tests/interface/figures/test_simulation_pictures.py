"""Pictures of the simulation chapter: error maps, curves, histograms, what cameras see."""

import numpy as np
import pandas as pd
import pytest
from made_up import corridor
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.quiver import Quiver

from corridor.interface import figures


def errors(count=400, plan=0.02, height=-0.03, seed=1):
    """Check points 300 m along a dike, all off by the same amounts in metres."""
    draw = np.random.default_rng(seed)
    along, across = draw.uniform(0, 300, count), draw.uniform(-20, 20, count)
    return pd.DataFrame({"x": across, "y": along, "dx": 0.0, "dy": plan, "dz": height})


def drawn(figure):
    """Length in inches of every arrow of each panel, with the panel's caption."""
    figure.draw_without_rendering()
    found = []
    for axes in figure.axes:
        inches = figure.get_size_inches()[0] * axes.get_position().width
        per_inch = np.ptp(axes.get_xlim()) / inches
        lengths = [
            np.hypot(q.U, q.V) / q.scale / per_inch
            for q in axes.collections
            if isinstance(q, Quiver)
        ]
        if axes.get_title(loc="left"):
            found.append((axes.get_title(loc="left"), np.concatenate(lengths)))
    return found


class TestErrorMaps:
    def test_the_rms_of_all_points_is_written(self):
        """2 cm along and 3 cm down everywhere: RMS 2 and 3 cm."""
        (plan, _), (height, _) = drawn(figures.error_maps({"case": errors()}))
        assert plan == "case: horizontal, RMS 2 cm"
        assert height == "height, RMS 3 cm"

    def test_plan_and_height_of_a_row_have_one_scale(self):
        (_, plan), (_, height) = drawn(figures.error_maps({"case": errors()}))
        assert plan.max() / height.max() == pytest.approx(0.02 / 0.03, rel=1e-6)

    def test_each_row_has_the_scale_that_suits_it(self):
        """A case ten times as bad has arrows of the same length, and another key."""
        figure = figures.error_maps({"mild": errors(), "bad": errors(plan=0.2, height=-0.3)})
        (_, mild), _, (_, bad), _ = drawn(figure)
        assert mild.max() == pytest.approx(bad.max(), rel=1e-6)
        keys = [text.get_text() for text in figure.texts]
        assert {"5 cm", "50 cm"} <= set(keys) or {"2 cm", "20 cm"} <= set(keys)

    def test_a_figure_has_one_unit(self):
        figure = figures.error_maps({"fine": errors(plan=2e-4, height=1e-4), "bad": errors()})
        words = [text for text, _ in drawn(figure)]
        assert words[:2] == ["fine: horizontal, RMS 0.02 cm", "height, RMS 0.01 cm"]

    def test_thousands_of_points_become_a_few_evenly_spread_arrows(self):
        (_, plan), _ = drawn(figures.error_maps({"case": errors(count=5000)}))
        assert 60 < len(plan) <= 200

    def test_points_without_error_are_drawn_without_complaint(self):
        texts = [text for text, _ in drawn(figures.error_maps({"still": errors(plan=0, height=0)}))]
        assert texts == ["still: horizontal, RMS 0 m", "height, RMS 0 m"]


class TestCurves:
    def test_the_line_is_the_median_and_the_band_the_range(self):
        x = np.array([1.0, 2.0])
        values = np.array([[1.0, 2.0, 6.0], [2.0, 4.0, 12.0]])
        figure = figures.curves([figures.Panel("t", x, {"a": values}, "x (px)", "y (cm)")], "title")
        axes = figure.axes[0]
        assert axes.lines[0].get_ydata().tolist() == [2.0, 4.0]
        (band,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
        corners = band.get_paths()[0].vertices
        assert corners[:, 1].min() == 1.0 and corners[:, 1].max() == 12.0
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (px)", "y (cm)")

    def test_a_name_has_one_line_style_in_every_panel(self):
        x = np.arange(3.0)
        panels = [
            figures.Panel("left", x, {"a": x, "b": x}, "x", "y"),
            figures.Panel("right", x, {"b": x}, "x", "y", zero=False),
        ]
        left, right = figures.curves(panels, "title").axes[:2]
        assert left.lines[1].get_linestyle() == right.lines[0].get_linestyle()
        assert left.lines[0].get_linestyle() != left.lines[1].get_linestyle()

    def test_every_draw_is_a_dot_and_the_truth_a_line(self):
        draws = np.random.default_rng(2).normal(100, 5, 60)
        axes = figures.estimates({"f (px)": draws}, {"f (px)": 101.0}, "title").axes[0]
        mean, truth, dots = axes.lines
        assert mean.get_xdata()[0] == pytest.approx(draws.mean())
        assert truth.get_xdata()[0] == 101.0
        assert dots.get_xdata().tolist() == sorted(draws)


class TestCameraViews:
    def test_every_image_has_its_footprint(self):
        """Straight down from 148 m over the points, P1 of the made-up block: 148 m wide."""
        block = corridor(strips=2, images=5)
        figure = figures.camera_views(block)
        (plan,) = [
            a for a in figure.axes if any(isinstance(c, LineCollection) for c in a.collections)
        ][:1]
        outlines = [
            path.vertices
            for c in plan.collections
            if isinstance(c, LineCollection)
            for path in c.get_paths()
        ]
        assert len(outlines) == len(block.images) == 10
        sides = np.linalg.norm(np.diff(outlines[0], axis=0), axis=1)
        assert max(sides) == pytest.approx(148 * 8191 / 8192, rel=1e-3)

    def test_a_block_without_poses_says_so(self):
        block = corridor(strips=1, images=5, length=300)
        block.images = block.images.drop(columns=["qw", "qx", "qy", "qz"])
        assert "No pose" in " ".join(t.get_text() for t in figures.camera_views(block).texts)
