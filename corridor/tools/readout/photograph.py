"""Photographs as a sensor wrote them: grey values, linear light, and what their EXIF says."""

import io
import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from corridor.core.brief import brief
from corridor.core.errors import InputError, ReadoutFailed
from corridor.core.photographs import (
    FAULTS,
    MOST_PIXELS,
    Metadata,
    fault,
    open_picture,
    read_metadata,
)

_TURNS = {
    2: "mirrored",
    3: "turned by 180 degrees",
    4: "mirrored upside down",
    5: "mirrored and turned by 90 degrees",
    6: "turned by 90 degrees",
    7: "mirrored and turned by 270 degrees",
    8: "turned by 270 degrees",
}


class CannotMeasure(ReadoutFailed):
    """The pictures are readable and show no measurable readout: one sentence says why."""


@brief
@dataclass(frozen=True)
class Photograph:
    """A grey picture (height, width) uint8 as stored, and the facts beside it.

    exposure_s and focal_px (from the 35 mm equivalent) are None where the file has none.
    """

    name: str
    grey: np.ndarray
    make: str = ""
    model: str = ""
    exposure_s: float | None = None
    focal_px: float | None = None

    @property
    def width(self) -> int:
        """Columns of the stored picture."""
        return self.grey.shape[1]

    @property
    def height(self) -> int:
        """Rows of the stored picture."""
        return self.grey.shape[0]

    def shrunk(self, long_side: int) -> tuple[np.ndarray, float]:
        """The picture (float32) with a long side of so many pixels at most, and the size of its
        pixels: (x + 0.5) size - 0.5 is x of it in the photograph."""
        factor = max(1.0, max(self.grey.shape) / long_side)
        size = round(self.width / factor), round(self.height / factor)
        small = cv2.resize(self.grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return small, self.width / size[0]

    def light(self) -> np.ndarray:
        """Linear light (height, width) float32, 0 to 1, by the sRGB curve (IEC 61966-2-1)."""
        return cv2.LUT(self.grey, _LINEAR)


Photo = str | os.PathLike | Photograph


def read(photo: Photo) -> Photograph:
    """The photograph in a file; one that has been read is handed back.

    Raises InputError where there is none, or as `decode` does.
    """
    if isinstance(photo, Photograph):
        return photo
    path = Path(photo)
    if not path.is_file():
        raise InputError(f"{path}: there is no such photograph")
    return decode(path.read_bytes(), path)


def decode(content: bytes, path: str | os.PathLike, most_pixels: int = MOST_PIXELS) -> Photograph:
    """The photograph in the bytes of a file; `path` names it in messages.

    most_pixels: a larger picture is refused before it is decoded.
    Raises InputError where it is no picture, or where its rows are not those of the sensor: turned
    by an EXIF orientation, or resized since the camera wrote its size.
    """
    facts = _facts(content, Path(path), most_pixels)
    try:
        grey = _grey(content, most_pixels)
    except FAULTS as error:
        raise InputError(
            f"{path} is not a photograph that can be read ({fault(error)}): give a JPEG, PNG or "
            "TIFF"
            if content
            else f"{path} is empty: give a JPEG, PNG or TIFF"
        ) from None
    if facts.orientation in _TURNS:
        raise InputError(
            f"{path} is to be shown {_TURNS[facts.orientation]} (EXIF orientation "
            f"{facts.orientation}), so its rows may not be those of the sensor: save it as the "
            "sensor wrote it, with orientation 1"
        )
    height, width = grey.shape
    said = facts.written_size
    if said and said != (width, height):
        what = "turned" if said == (height, width) else "resized or cut"
        raise InputError(
            f"{path} has {width} x {height} pixels and its EXIF says {said[0]} x {said[1]}: it was "
            f"{what}, give the file as the camera wrote it"
        )
    if min(width, height) < 64:
        raise InputError(f"{path} has {width} x {height} pixels: too small to measure in")
    focal = facts.focal_35_mm
    return Photograph(
        name=Path(path).name,
        grey=grey,
        make=facts.make,
        model=facts.model,
        exposure_s=facts.exposure_s,
        focal_px=np.hypot(width, height) * focal / 43.27 if focal else None,
    )


def _grey(content: bytes, most_pixels: int) -> np.ndarray:
    """Grey values (height, width) uint8 as they are stored; of a JPEG its luminance."""
    with open_picture(io.BytesIO(content), most_pixels) as picture:
        picture.draft("L", picture.size)
        picture.load()  # raises for a file that is cut off; OpenCV would fill it up
        if picture.mode.startswith("I"):
            return (np.asarray(picture).astype(np.uint32) >> 8).astype(np.uint8)
        if picture.mode == "L":
            return np.array(picture)
        return cv2.cvtColor(np.asarray(picture.convert("RGB")), cv2.COLOR_RGB2GRAY)


def read_two(first: Photo, second: Photo) -> tuple[Photograph, Photograph]:
    """Two photographs of one camera. Raises InputError as `read`, or where their sizes differ."""
    first, second = read(first), read(second)
    if first.grey.shape != second.grey.shape:
        raise InputError(
            f"{first.name} has {first.width} x {first.height} pixels and {second.name} "
            f"{second.width} x {second.height}: give two photographs of one camera and size"
        )
    return first, second


def _facts(content: bytes, path: Path, most_pixels: int) -> Metadata:
    try:
        return read_metadata(path, content, most_pixels)
    except InputError:
        # A broken EXIF is no EXIF; the picture itself is judged later.
        return Metadata(path, 0, 0)


_CODED = np.arange(256) / 255
_LINEAR = np.where(_CODED <= 0.04045, _CODED / 12.92, ((_CODED + 0.055) / 1.055) ** 2.4).astype(
    np.float32
)
