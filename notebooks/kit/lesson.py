"""The teaching page: a bicycle wheel that bends as the sliders move, and its readout measured.

`photograph` and `measure` work without a notebook. `wheel_page` and `own_photos` are its widgets
(ipywidgets, which come with `corridor[notebooks]`): pictures follow the sliders at once, the
measurement, which looks at nothing but the pictures, follows when they rest.
"""

from __future__ import annotations

import contextvars
import html
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from corridor import figures
from corridor.camera import Camera
from corridor.errors import AdjustmentFailed, InputError
from corridor.readout import render
from corridor.readout.measure import readout_from_wheel
from corridor.readout.photograph import Photograph, decode
from corridor.readout.result import Readout

SIZE = 480, 360  # px: as many as can be drawn ten times a second
_CAMERA = Camera.from_table("lesson", {"width": SIZE[0], "height": SIZE[1], "f": 480.0})
# A little from the side, as one stands; thick spokes, so that the last row of a class sees them.
_VIEW = render.View(_CAMERA, distance=0.975, tilt_deg=8.0, tilt_towards_deg=30.0)
_WHEEL = {"spokes": 20, "crosses": 2, "spoke_width": 0.004}
_REST_S = 0.4  # after which a slider counts as resting


@dataclass(frozen=True)
class Setting:
    """A wheel and a shutter: what the sliders of the page say."""

    readout_ms: float = 30.0
    turns_per_second: float = 2.0
    sense: str = "cw"
    exposure_ms: float = 0.5
    row_direction: str = "down"

    def __str__(self) -> str:
        """What is set, in a line."""
        sense = {"cw": "clockwise", "ccw": "counter-clockwise"}[self.sense]
        return (
            f"readout {self.readout_ms:g} ms, {self.turns_per_second:g} turns a second {sense}, "
            f"exposure {self.exposure_ms:g} ms, rows {self.row_direction}"
        )


def photograph(setting: Setting) -> np.ndarray:
    """Picture (360, 480) uint8 of the turning wheel, with the noise of a phone's camera."""
    shutter = render.Shutter(
        setting.readout_ms / 1e3, setting.exposure_ms / 1e3, setting.row_direction
    )
    turns = setting.turns_per_second * (1 if setting.sense == "cw" else -1)
    return _developed(render.wheel(_VIEW, shutter, turns, phase_deg=20.0, **_WHEEL), seed=1)


@lru_cache(maxsize=1)
def photograph_at_rest() -> np.ndarray:
    """Picture (360, 480) uint8 of the same wheel before it was spun."""
    return _developed(render.wheel(_VIEW, render.Shutter(0.0), phase_deg=5.0, **_WHEEL), seed=2)


def _developed(light, seed):
    return render.develop(light, noise=0.004, blur_px=0.6, seed=seed)


def measure(setting: Setting, picture: np.ndarray | None = None) -> Readout:
    """Readout time measured in the pictures, knowing turns a second and sense.

    picture: what `photograph` made of the setting, if it is there already.
    Raises CannotMeasure where they do not show it, for instance of a wheel that stands still.
    """
    turning = photograph(setting) if picture is None else picture
    return readout_from_wheel(
        Photograph("the picture at rest", photograph_at_rest()),
        Photograph("the turning picture", turning),
        max(setting.turns_per_second, 1e-3),  # at rest any speed will do: nothing is measured
        sense=setting.sense,
    )


def png(picture: np.ndarray) -> bytes:
    """The bytes of a PNG file."""
    return cv2.imencode(".png", picture)[1].tobytes()


class _WhenResting:
    """Does a piece of work for the latest request, a moment after it, in a thread."""

    def __init__(self, work: Callable, done: Callable):
        self.work, self.done = work, done
        self.latest, self.timer = 0, None
        self.busy = threading.Lock()

    def ask(self, *wanted):
        """`done(work(*wanted))`, unless another request comes first."""
        self.latest += 1
        if self.timer is not None:
            self.timer.cancel()
        # What a kernel's output belongs to is kept in the context.
        run = contextvars.copy_context().run
        self.timer = threading.Timer(_REST_S, run, (self._run, self.latest, wanted))
        self.timer.daemon = True
        self.timer.start()

    def _run(self, number, wanted):
        with self.busy:
            if number == self.latest:
                answer = self.work(*wanted)
                if number == self.latest:
                    self.done(answer)


def _or_sentence(work, *arguments):
    """The result, or the sentence that says why there is none."""
    try:
        return work(*arguments)
    except (AdjustmentFailed, InputError) as reason:
        return str(reason)


def _said(text):
    return f"<span style='font-size: 115%'>{text}</span>"


def _measured(answer):
    """HTML of a readout, or of the sentence why there is none."""
    if isinstance(answer, str):
        return _said(f"<b>not measured</b>: {html.escape(answer)}")
    return _said(
        f"<b>measured {answer.readout_ms:.1f} ± {max(answer.sigma_ms, 0.05):.1f} ms</b>, "
        f"{answer.rotation_deg:.1f}° during the readout"
    )


def wheel_page(setting: Setting | None = None):
    """Sliders, the wheel at rest and turning, the readout that was set and the one measured.

    setting: what the sliders start from. Returns an ipywidgets box with `.setting()`, `.picture`
    (an Image of PNG bytes) and `.answer` (HTML). Where no kernel runs it is the picture of the
    measurement it starts with.
    """
    from ipywidgets import (
        HTML,
        Checkbox,
        Dropdown,
        FloatSlider,
        HBox,
        Image,
        Label,
        Layout,
        VBox,
    )

    start = setting or Setting()
    wide = {"style": {"description_width": "9.5em"}, "layout": Layout(width="27em")}

    def slider(text, name, low, high, step, digits):
        return FloatSlider(
            getattr(start, name), min=low, max=high, step=step, description=text,
            readout_format=f".{digits}f", **wide,
        )  # fmt: skip

    knobs = {
        "readout_ms": slider("readout time (ms)", "readout_ms", 1, 80, 1, 0),
        "turns_per_second": slider("turns a second", "turns_per_second", 0, 3, 0.1, 1),
        "sense": Dropdown(
            options=[("clockwise", "cw"), ("counter-clockwise", "ccw")],
            value=start.sense,
            description="direction",
            **wide,
        ),
        "exposure_ms": slider("exposure (ms)", "exposure_ms", 0, 5, 0.1, 1),
        "row_direction": Dropdown(
            options=[
                ("from top to bottom", "down"),
                ("from bottom to top", "up"),
                ("from left to right", "right"),
                ("from right to left", "left"),
            ],
            value=start.row_direction,
            description="rows are read",
            **wide,
        ),
    }

    def now():
        return Setting(**{name: knob.value for name, knob in knobs.items()})

    drawn = photograph(start)
    first = _or_sentence(measure, start, drawn)
    framed = Layout(width=f"{SIZE[0]}px", height=f"{SIZE[1]}px")
    small = Layout(width=f"{SIZE[0] // 2}px", height=f"{SIZE[1] // 2}px")
    picture = Image(value=png(drawn), format="png", layout=framed)
    resting = Image(value=png(photograph_at_rest()), format="png", layout=small)
    answer = HTML(_measured(first))
    truth = HTML(_said(f"set {start.readout_ms:.1f} ms"))
    why = Image(format="png", layout=Layout(display="none", max_width="100%"))
    show = Checkbox(False, description="show how it was measured", indent=False)
    last = {"answer": first}

    def explain():
        """The picture of the measurement, as long as it is wanted and there is one."""
        wanted = show.value and not isinstance(last["answer"], str)
        if wanted:
            why.value = figures.readout_picture(last["answer"])._repr_png_()
        why.layout.display = None if wanted else "none"

    def done(found):
        last["answer"] = found
        answer.value = _measured(found)
        explain()

    worker = _WhenResting(lambda *wanted: _or_sentence(measure, *wanted), done)

    def changed(_):
        wanted = now()
        drawn = photograph(wanted)
        picture.value = png(drawn)
        truth.value = _said(f"set {wanted.readout_ms:.1f} ms")
        answer.value = _said("measuring …")
        worker.ask(wanted, drawn)

    for knob in knobs.values():
        knob.observe(changed, "value")
    show.observe(lambda _: explain(), "value")
    left = VBox([*knobs.values(), Label("at rest:"), resting])
    right = VBox([picture, truth, answer, show])
    page = _page_class()([HBox([left, right], layout=Layout(flex_flow="row wrap")), why])
    page.setting, page.picture, page.answer, page.truth = now, picture, answer, truth
    page.still = first if isinstance(first, Readout) else None
    page.words = f"Sliders and a turning wheel: {start}"
    return page


@lru_cache(maxsize=1)
def _page_class():
    """A box of widgets that is a picture where no kernel runs."""
    from ipywidgets import VBox

    class Page(VBox):
        def _repr_mimebundle_(self, **more):
            bundle = super()._repr_mimebundle_(**more)
            bundle = dict(bundle[0] if isinstance(bundle, tuple) else bundle)
            bundle["text/plain"] = self.words
            if self.still is not None:
                bundle["image/png"] = figures.readout_picture(self.still)._repr_png_()
            return bundle

    return Page


def measure_own(
    static: tuple[str, bytes],
    rotating: tuple[str, bytes],
    turns_per_second: float,
    sense: str | None = None,
) -> Readout:
    """Readout time from two uploaded photographs, each a name and the bytes of its file.

    Raises InputError or CannotMeasure with a sentence for the person who took them.
    """
    if not turns_per_second > 0:
        raise InputError("Give the turns a second, a number greater than 0")
    photos = [decode(content, name) for name, content in (static, rotating)]
    return readout_from_wheel(*photos, turns_per_second, sense=sense)


def own_photos():
    """Two uploads, the turns a second, and what the package reads off the photographs.

    Returns an ipywidgets box with `.answer` (HTML) and `.picture` (an Image of PNG bytes).
    """
    from ipywidgets import HTML, BoundedFloatText, Button, Dropdown, FileUpload, HBox, Image, Layout

    wide = {"style": {"description_width": "9.5em"}, "layout": Layout(width="22em")}
    static = FileUpload(accept="image/*", description="wheel at rest", layout=Layout(width="14em"))
    rotating = FileUpload(
        accept="image/*", description="wheel turning", layout=Layout(width="14em")
    )
    turns = BoundedFloatText(
        1.0, min=0.0, max=100.0, step=0.01, description="turns a second", **wide
    )
    sense = Dropdown(
        options=[("not known", None), ("clockwise", "cw"), ("counter-clockwise", "ccw")],
        description="direction",
        **wide,
    )
    go = Button(description="measure", button_style="primary")
    answer = HTML(_said("Choose both photographs."))
    picture = Image(format="png", layout=Layout(display="none", max_width="100%"))

    def work(*wanted):
        found = _or_sentence(measure_own, *wanted)
        return found, None if isinstance(found, str) else figures.readout_picture(found)

    def done(result):
        found, drawn = result
        warnings = () if isinstance(found, str) else found.warnings
        if drawn is not None:
            picture.value = drawn._repr_png_()
        picture.layout.display = None if drawn is not None else "none"
        answer.value = "<br>".join([_measured(found), *map(html.escape, warnings)])

    worker = _WhenResting(work, done)

    def clicked(_):
        if not (static.value and rotating.value):
            answer.value = _said("Choose both photographs.")
            return
        files = [
            (one.value[0]["name"], bytes(one.value[0]["content"])) for one in (static, rotating)
        ]
        answer.value = _said("measuring …")
        worker.ask(*files, turns.value, sense.value)

    go.on_click(clicked)
    page = _page_class()([HBox([static, rotating]), turns, sense, go, answer, picture])
    page.still, page.words = None, "Two uploads, the turns a second, a button"
    page.answer, page.picture = answer, picture
    page.static, page.rotating, page.turns, page.go = static, rotating, turns, go
    return page
