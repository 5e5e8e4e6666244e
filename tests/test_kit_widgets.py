"""Sliders of the chapters: a picture where no kernel runs."""

import pytest

from corridor.interface.figures import style

pytest.importorskip("ipywidgets", reason="the extra 'notebooks' is not installed")
from kit import widgets  # noqa: E402


def test_sliders_are_the_picture_they_start_with_where_no_kernel_runs():
    asked = []

    def draw(height):
        asked.append(height)
        return style.sheet(1.0, "a picture")

    page = widgets.explore(draw, height=widgets.slider("height (m)", 30, 120, 50, 5))
    bundle = page._repr_mimebundle_()
    assert bundle["image/png"].startswith(b"\x89PNG")
    assert bundle["text/plain"] == "1 sliders: height (m)"
    assert set(asked) == {50}


def test_a_slider_of_whole_numbers_gives_whole_numbers():
    assert widgets.slider("strips", 2, 5, 3, 1).value == 3
    assert isinstance(widgets.slider("strips", 2, 5, 3, 1).value, int)
    assert isinstance(widgets.slider("tilt", 0, 5, 3.0, 1).value, float)
