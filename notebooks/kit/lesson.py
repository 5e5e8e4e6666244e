"""The lesson with a bicycle wheel: its picture as a shutter reads it, and its readout measured.

`photograph` and `measure` are the lesson; `kit.classroom` serves its page to a browser.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from corridor.core.camera import Camera
from corridor.core.errors import InputError, WorkFailed
from corridor.core.photographs import MOST_PIXELS
from corridor.tools.readout import Photograph, Readout, readout_from_wheel, render
from corridor.tools.readout.photograph import decode

SIZE = 480, 360  # px: as many as can be drawn ten times a second
_CAMERA = Camera.from_table("lesson", {"width": SIZE[0], "height": SIZE[1], "f": 480.0})
# A little from the side, as one stands; thick spokes, so that the last row of a class sees them.
_VIEW = render.View(_CAMERA, distance=0.975, tilt_deg=8.0, tilt_towards_deg=30.0)
_WHEEL = {"spokes": 20, "crosses": 2, "spoke_width": 0.004}


@dataclass(frozen=True)
class Setting:
    """A wheel and a shutter: what the sliders of the page say."""

    readout_ms: float = 30.0
    turns_per_second: float = 2.0
    sense: str = "cw"
    exposure_ms: float = 0.5
    row_direction: str = "down"

    @classmethod
    def of(cls, words: Mapping[str, str]) -> Setting:
        """The setting that an address names. Raises InputError for one that the page cannot ask."""
        numbers = {"readout_ms": (0, 200), "turns_per_second": (0, 10), "exposure_ms": (0, 20)}
        texts = {"sense": ("cw", "ccw"), "row_direction": ("down", "up", "left", "right")}
        out: dict[str, float | str] = {}
        for name, word in words.items():
            if name in texts and word in texts[name]:
                out[name] = word
                continue
            try:
                low, high = numbers[name]
                out[name] = round(float(word), 3)
            except (KeyError, ValueError):
                raise InputError(f"{name} = {word} is not a setting of the wheel") from None
            if not low <= out[name] <= high:
                raise InputError(f"{name} = {word} is not between {low} and {high}")
        return cls(**out)

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


def or_sentence(work, *arguments):
    """The result, or the sentence that says why there is none."""
    try:
        return work(*arguments)
    except (WorkFailed, InputError) as reason:
        return str(reason)


def told(found: Readout) -> str:
    """A readout in words, for a page."""
    sigma = max(found.sigma_ms, 0.05)
    return (
        f"measured {found.readout_ms:.1f} ± {sigma:.1f} ms, in which the wheel turned "
        f"{found.rotation_deg:.1f}°"
    )


def number_typed(text: object) -> float:
    """A number above zero as a person types it: 1.6 or 1,6."""
    try:
        number = float(str(text).strip().replace(",", "."))
    except ValueError:
        number = 0.0
    if not 0 < number < 1000:
        raise InputError("Give the turns a second, a number greater than 0, such as 1.6")
    return number


def measure_own(
    static: tuple[str, bytes],
    rotating: tuple[str, bytes],
    turns_per_second: float,
    sense: str | None = None,
    most_pixels: int = MOST_PIXELS,
) -> Readout:
    """Readout time from two uploaded photographs, each a name and the bytes of its file.

    most_pixels: of one; a larger one is refused before it is decoded.
    Raises InputError or CannotMeasure with a sentence for the person who took them.
    """
    photos = [decode(content, name, most_pixels) for name, content in (static, rotating)]
    return readout_from_wheel(*photos, turns_per_second, sense=sense)
