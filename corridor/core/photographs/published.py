"""What is published of cameras: readout times, a prior and a check of a measurement, and shutters.

The table beside this package, `published_readout_times.csv`, holds 1,223 of them with method and
source. They count all rows (rows times row time); `readout_ms` of `Readout` runs from the first
to the last. Modes of one camera differ by factors and sources by 5 to 10 per cent.
"""

import csv
import re
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

_TABLE, _GLOBAL = "published_readout_times.csv", "global_shutters.csv"
# EXIF writes 1/2000 s as 0.0005, or as 0.000499.
_EXPOSED = 0.99
# A picture has the shape, the number of pixels of a mode within these.
_SHAPE, _PIXELS = 0.02, 0.1


@dataclass(frozen=True)
class PublishedReadout:
    """One published readout time, all rows, milliseconds; sigma_ms None where there is none."""

    make: str
    model: str
    mode: str
    readout_ms: float
    sigma_ms: float | None
    method: str
    source: str


@dataclass(frozen=True)
class GlobalShutter:
    """A camera that exposes all rows at once.

    picture: size of its pictures as taken, "5280x3956", where other cameras share its name.
    shortest_s: shorter exposures are not its mechanical shutter's; None: there are none.
    """

    make: str
    model: str
    product: str
    picture: str
    shortest_s: float | None
    source: str

    def takes(self, size: tuple[int, int] | None = None, exposure_s: float | None = None) -> bool:
        """Whether a picture of this size, exposed so long, has its rows exposed at once."""
        fits = size is None or self.picture in ("", f"{size[0]}x{size[1]}")
        return fits and not (
            self.shortest_s and exposure_s and exposure_s < _EXPOSED * self.shortest_s
        )

    def __str__(self) -> str:
        return f"{self.make} {self.product} ({self.model}), {self.source}"


@lru_cache(maxsize=1)
def _global_table() -> dict[str, GlobalShutter]:
    """By the names that a camera goes by."""
    rows = (
        GlobalShutter(**row | {"shortest_s": _number(row["shortest_s"])}) for row in _rows(_GLOBAL)
    )
    return {
        plain_name(name): row
        for row in rows
        for called in (row.model, row.product)
        for name in (called, f"{row.make} {called}")
    }


def global_shutter(camera: str) -> GlobalShutter | None:
    """The camera of this model, or make and model, if it is known to expose all rows at once.

    camera: as EXIF or a person writes it ("DJI FC6310R", "Phantom 4 RTK").
    """
    return _global_table().get(plain_name(camera))


def _rows(table: str) -> list[dict[str, Any]]:
    text = (files("corridor.photographs") / table).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


def _number(cell: str) -> float | None:
    return float(cell) if cell else None


@lru_cache(maxsize=1)
def published_table() -> tuple[PublishedReadout, ...]:
    """All published readout times."""
    return tuple(
        PublishedReadout(**row | {key: _number(row[key]) for key in ("readout_ms", "sigma_ms")})
        for row in _rows(_TABLE)
    )


def published_readouts(camera: str) -> list[PublishedReadout]:
    """Published readout times of the cameras whose make and model contain every word of a name.

    camera: as EXIF or a person writes it ("Hasselblad L1D-20c", "mavic 2 pro"); case, blanks
    and dashes do not matter.
    """
    words = [plain_name(word) for word in re.split(r"[\s,]+", camera) if plain_name(word)]
    if not words:
        return []
    found = []
    for row in published_table():
        whole = plain_name(f"{row.make}{row.model}{row.mode}")
        if all(word in whole for word in words):
            found.append(row)
    return found


def of_picture(rows: list[PublishedReadout], size: tuple[int, int]) -> list[PublishedReadout]:
    """Those of one camera's published values whose mode can have given a picture of this size.

    size: width, height as taken, px. A mode that names this very size comes first, then modes of
    the same shape (16:9) or number of pixels (12 MP), then those that name neither; all of them
    where none fits.
    """
    width, height = max(size), min(size)
    ranked: dict[int, list] = {1: [], 2: [], 3: []}
    for row in rows:
        rank = _fit(row.mode, width, height)
        if rank:
            ranked[rank].append(row)
    return next((found for found in ranked.values() if found), rows)


def _fit(mode: str, width: int, height: int) -> int:
    """1: this size, 2: this shape, 3: it may be any, 0: another."""
    sizes = [(int(a), int(b)) for a, b in re.findall(r"(\d{3,5})x(\d{3,5})", mode)]
    if (width, height) in sizes:
        return 1
    if re.search(r"video|\d[\d.]*p\b", mode):
        lines = {"4K": 2160, "1080": 1080}
        named = [lines[word] for word in lines if re.search(rf"\b{word}\b", mode)]
        return 1 if not sizes and height in named and width / height > 1.7 else 0
    shapes = [(int(a), int(b)) for a, b in re.findall(r"\b(\d{1,2}):(\d{1,2})\b", mode)]
    if shapes or sizes:
        near = any(abs(width * b / (height * a) - 1) < _SHAPE for a, b in [*shapes, *sizes])
        return 2 if near else 0
    pixels = [float(n) for n in re.findall(r"([\d.]+) ?MP\b", mode)]
    if pixels:
        return 2 if any(abs(width * height * 1e-6 / n - 1) < _PIXELS for n in pixels) else 0
    return 3


def plain_name(text: str) -> str:
    """A name without case, blanks and dashes."""
    return re.sub(r"[^a-z0-9]+", "", text.lower())
