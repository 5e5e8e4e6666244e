"""Photographs to try `corridor readout` with: what a shutter of known readout time would take."""

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from corridor.core.camera import Camera
from corridor.core.output import whole_folder, write_json
from corridor.tools.readout import render

MARK = "examples.json"
_SIZE = 1200, 900
_CAMERA = Camera.from_table("example", {"width": _SIZE[0], "height": _SIZE[1], "f": 1200.0})
_VIEW = render.View(_CAMERA, distance=0.98, tilt_deg=8.0, tilt_towards_deg=30.0)


@dataclass(frozen=True)
class Example:
    """Photographs of one target, the command that measures them, and the truth in milliseconds."""

    target: str
    photos: tuple[str, ...]
    options: str
    readout_ms: float

    def command(self, folder: str | os.PathLike) -> str:
        """What is typed to measure the photographs of a folder."""
        photos = " ".join(str(Path(folder) / name) for name in self.photos)
        out = Path(folder) / f"{self.target}_result"
        return f"corridor readout {self.target} {photos} {self.options} -o {out}"


EXAMPLES = (
    Example("star", ("star_still.jpg", "star_turning.jpg"), "--turns-per-second 2", 30.0),
    Example("wheel", ("wheel_still.jpg", "wheel_turning.jpg"), "--turns-per-second 1.5", 50.0),
    Example("led", ("led.jpg",), "--frequency 500", 20.0),
)


def write_examples(folder: str | os.PathLike) -> list[Path]:
    """Writes five photographs and examples.json, which says what is true of them; their paths.

    Whole or not at all. Raises InputError where `folder` holds something else.
    """
    folder = Path(folder)
    names = [name for example in EXAMPLES for name in example.photos]
    with whole_folder(folder, MARK, lambda name: name in (*names, MARK)) as part:
        for example in EXAMPLES:
            for name, picture in zip(example.photos, _photographs(example), strict=True):
                made = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
                (part / name).write_bytes(made.tobytes())
        truth = {
            one.target: {"photos": one.photos, "options": one.options, "readout_ms": one.readout_ms}
            for one in EXAMPLES
        }
        write_json(truth, part / MARK)
    return [folder / name for name in (*names, MARK)]


def _photographs(example: Example) -> list[np.ndarray]:
    shutter = render.Shutter(example.readout_ms / 1e3, 2e-4)
    if example.target == "led":
        return [_developed(render.led(_CAMERA, shutter, 500.0, light=0.5, ambient=0.05))]
    draw = {"star": render.star, "wheel": render.wheel}[example.target]
    turns = float(example.options.split()[-1])
    return [
        _developed(draw(_VIEW, render.Shutter(0.0), phase_deg=5.0), seed=1),
        _developed(draw(_VIEW, shutter, turns, phase_deg=20.0), seed=2),
    ]


def _developed(light: np.ndarray, seed: int = 0) -> np.ndarray:
    return render.develop(light, noise=0.004, blur_px=0.6, seed=seed)
