"""Sliders that redraw a picture; where no kernel runs, the picture they start with."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache


def slider(text: str, low: float, high: float, value: float, step: float, **options):
    """A slider that acts when it is let go; whole numbers where all of them are."""
    from ipywidgets import FloatSlider, IntSlider

    whole = all(isinstance(number, int) for number in (low, high, value, step))
    return (IntSlider if whole else FloatSlider)(
        description=text, min=low, max=high, value=value, step=step, continuous_update=False,
        style={"description_width": "13em"}, layout={"width": "34em"}, **options,
    )  # fmt: skip


def explore(draw: Callable, **sliders):
    """Sliders and the figure that `draw` makes of their values.

    Returns an ipywidgets box; saved in a notebook it is the figure of the values it starts with.
    """
    page = _page_class()(draw, **sliders)
    page.still = draw(**{name: one.value for name, one in sliders.items()})
    page.words = f"{len(sliders)} sliders: {', '.join(one.description for one in sliders.values())}"
    return page


def with_words(box, words: str):
    """The box, which says these words where no kernel runs."""

    class Page(type(box)):
        def _repr_mimebundle_(self, **more):
            bundle = super()._repr_mimebundle_(**more)
            bundle = dict(bundle[0] if isinstance(bundle, tuple) else bundle)
            return bundle | {"text/plain": words}

    return Page(box.children)


@lru_cache(maxsize=1)
def _page_class():
    """An `interactive` that is a picture where no kernel runs."""
    from ipywidgets import interactive

    class Page(interactive):
        def _repr_mimebundle_(self, **more):
            bundle = super()._repr_mimebundle_(**more)
            bundle = dict(bundle[0] if isinstance(bundle, tuple) else bundle)
            return bundle | {"text/plain": self.words, "image/png": self.still._repr_png_()}

    return Page
