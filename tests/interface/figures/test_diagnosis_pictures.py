"""Evidence bars: what is drawn, on which scale, and told apart without colour."""

import pandas as pd
import pytest
from matplotlib.patches import Rectangle

from corridor.interface import figures

THRESHOLD = {"named": 4.0, "beside_noise": 3.0, "suspected": 2.5}


def table(**changes):
    rows = {
        "name": ["Shutter", "Shape", "Drift"],
        "generic": [False, True, False],
        "found": [True, False, False],
        "alone": [4000.0, 90.0, -2.0],
        "beside": [4000.0, -1.0, 3.0],
    }
    return pd.DataFrame(rows | changes)


def drawn(figure):
    figure.draw_without_rendering()
    (axes,) = figure.axes
    return axes


def bars(axes):
    return [p for p in axes.patches if isinstance(p, Rectangle)]


def test_a_bar_ends_at_its_evidence_on_a_logarithmic_scale():
    axes = drawn(figures.evidence_bars(table(), THRESHOLD))
    assert axes.get_xscale() == "log"
    assert [bar.get_x() + bar.get_width() for bar in bars(axes)] == pytest.approx([4000.0, 90.0])


def test_generic_shapes_are_hatched_and_physical_effects_full():
    axes = drawn(figures.evidence_bars(table(), THRESHOLD))
    assert [bool(bar.get_hatch()) for bar in bars(axes)] == [False, True]


def test_the_thresholds_are_where_they_are():
    axes = drawn(figures.evidence_bars(table(), THRESHOLD))
    upright = [
        (line.get_xdata()[0], line.get_linestyle())
        for line in axes.lines
        if len(line.get_xdata()) == 2
    ]
    assert upright == [(4.0, "-"), (2.5, "--")]


def test_what_was_found_has_a_mark_of_its_own_at_what_it_brings_beside_the_others():
    axes = drawn(figures.evidence_bars(table(), THRESHOLD))
    marks = [
        (line.get_marker(), line.get_xdata()[0])
        for line in axes.lines
        if len(line.get_xdata()) == 1
    ]
    # Below one a candidate explains nothing: it stands at the edge.
    assert marks == [("D", 4000.0), ("o", 1.0), ("o", 3.0)]


def test_names_are_written_one_a_row():
    figure = figures.evidence_bars(table(), THRESHOLD)
    texts = [text.get_text() for text in figure.texts]
    assert [name for name in texts if name in ("Shutter", "Shape", "Drift")] == [
        "Shutter", "Shape", "Drift",
    ]  # fmt: skip
    assert "4,000" in texts and "below 1" in texts


def test_without_candidates_it_says_so():
    figure = figures.evidence_bars(table().iloc[:0], THRESHOLD)
    assert not figure.axes
    assert any("No effect could be tested" in text.get_text() for text in figure.texts)
