"""A measured readout time, and the folder it is saved in."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from corridor.core.brief import brief
from corridor.core.output import check_folder, listed_in, whole_folder, write_json
from corridor.core.photographs import PublishedReadout, plain_name, published_table
from corridor.tools.readout.photograph import CannotMeasure, Photograph

_RESULT = "readout.json"
_FAR = 0.2  # of the nearest published value: further off is worth a word


@dataclass(frozen=True, eq=False)
class StripesDrawing:
    """How stripes were measured: the photograph, and the light (rows,) of its rows, measured and
    fitted, 0 to 1."""

    photo: Photograph
    signal: np.ndarray
    model: np.ndarray


@brief
@dataclass(frozen=True)
class Readout:
    """One readout time with what belongs to it.

    readout_ms: first to last row. sigma_ms: one sigma, everything known included.
    row_axis: "y" where rows follow each other along y, else "x". row_direction and
    rotation_sense ("cw" or "ccw" in the stored picture) are None where the pictures do not tell.
    rotation_deg: turn of the target during the readout; frequency_hz: of the LED.
    drawing: what `corridor.figures.readout_picture` shows, a `turning.Turning` or a
    `StripesDrawing`; not saved.
    """

    target: str
    method: str
    readout_ms: float
    sigma_ms: float
    row_axis: str
    rows: int
    row_direction: str | None = None
    rotation_sense: str | None = None
    angular_velocity_deg_s: float | None = None
    rotation_deg: float | None = None
    frequency_hz: float | None = None
    warnings: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    drawing: Any = field(default=None, repr=False, compare=False)

    def __post_init__(self):
        if not (math.isfinite(self.readout_ms) and self.readout_ms > 0):
            raise CannotMeasure("these pictures give no possible readout time")
        if not (math.isfinite(self.sigma_ms) and self.sigma_ms < self.readout_ms):
            raise CannotMeasure("the readout time is less certain than it is long")

    def beside_published(self, photo: Photograph) -> "Readout":
        """The result with what others have published of the camera, as far as EXIF names it."""
        found, warning = compared(photo.make, photo.model, self.readout_ms)
        if not found:
            return self
        published = sorted({row.readout_ms for row in found})
        warnings = (*self.warnings, warning) if warning else self.warnings
        return replace(self, warnings=warnings, extra={**self.extra, "published_ms": published})

    def as_dict(self) -> dict[str, Any]:
        """The content of readout.json without its pictures."""
        keys = ("target", "method", "readout_ms", "sigma_ms", "row_axis", "row_direction", "rows")
        content = {key: getattr(self, key) for key in keys}
        if self.frequency_hz is not None:
            content["frequency_hz"] = self.frequency_hz
        else:
            content["rotation_sense"] = self.rotation_sense
            content["angular_velocity_deg_s"] = self.angular_velocity_deg_s
            content["rotation_during_readout_deg"] = self.rotation_deg
        return {**content, **self.extra, "warnings": list(self.warnings)}

    def __str__(self) -> str:
        """The result in a few lines."""
        decimals = 2 if self.sigma_ms <= 0 else max(0, 1 - math.floor(math.log10(self.sigma_ms)))
        decimals = min(decimals, 5)
        axis = "rows follow each other along " + self.row_axis
        lines = [
            f"readout time {self.readout_ms:.{decimals}f} +- {self.sigma_ms:.{decimals}f} ms, "
            f"first to last of {self.rows} rows",
            axis + (f", {self.row_direction}" if self.row_direction else ""),
        ]
        if self.frequency_hz is not None:
            lines.append(f"light blinking {self.frequency_hz:g} times a second")
        else:
            sense = {"cw": ", clockwise", "ccw": ", counter-clockwise"}.get(self.rotation_sense, "")
            lines.append(
                f"target turning {self.angular_velocity_deg_s / 360:.5g} times a second{sense}: "
                f"{self.rotation_deg:.4g} degrees during the readout"
            )
        lines += [f"warning: {text}" for text in self.warnings]
        return "\n".join(lines)


def can_save_readout(folder: str | os.PathLike) -> None:
    """Raises InputError, before any work is done, where `save_readout` would refuse `folder`."""
    check_folder(folder, _RESULT)


def save_readout(
    readout: Readout, folder: str | os.PathLike, pictures: Mapping[str, bytes]
) -> list[Path]:
    """Writes readout.json and its pictures (PNG bytes by name), whole or not at all.

    Returns the paths. An earlier result in `folder` is replaced; what else lies there stays.
    Raises InputError where `folder` is a file or a folder of something else.
    """
    names = [f"{name}.png" for name in pictures]
    earlier = listed_in(folder, _RESULT, "pictures")
    with whole_folder(folder, _RESULT, lambda name: name in names or earlier(name)) as part:
        for name, content in zip(names, pictures.values(), strict=True):
            (part / name).write_bytes(content)
        write_json(readout.as_dict() | {"pictures": names}, part / _RESULT)
    return [Path(folder) / name for name in (_RESULT, *names)]


def sigma_with_speed(readout_ms: float, own_ms: float, speed_sigma_percent: float) -> float:
    """The sigma of a readout time with that of the speed, which goes in one to one."""
    return float(np.hypot(own_ms, readout_ms * speed_sigma_percent / 100))


def compared(make: str, model: str, readout_ms: float) -> tuple[list[PublishedReadout], str | None]:
    """Published values of the camera that took a photograph, and a warning where all are far.

    make, model: from EXIF; empty: nothing is known.
    """
    if not model:
        return [], None
    wanted = plain_name(model)
    found = [
        row
        for row in published_table()
        if plain_name(row.model) == wanted
        and (
            not make
            or plain_name(row.make) in plain_name(make)
            or plain_name(make) in plain_name(row.make)
        )
    ]
    if not found:
        return [], None
    nearest = min(found, key=lambda row: abs(row.readout_ms / readout_ms - 1))
    if abs(nearest.readout_ms / readout_ms - 1) <= _FAR:
        return found, None
    return found, (
        f"the nearest published readout time of a {model} is {nearest.readout_ms:g} ms "
        f"({nearest.mode or 'mode not stated'}; {nearest.source}): check speed, picture size and "
        "mode"
    )
