"""A measured readout time, and the folder it is saved in."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from corridor.errors import InputError
from corridor.readout.photograph import CannotMeasure
from corridor.report import check_folder, listed_in, whole_folder, write_json

_RESULT = "readout.json"
SENSES = ("cw", "ccw")


@dataclass(frozen=True)
class Readout:
    """One readout time with what belongs to it.

    readout_ms: first to last row. sigma_ms: one sigma, everything known included.
    row_axis: "y" where rows follow each other along y, else "x". row_direction and
    rotation_sense ("cw" or "ccw" in the stored picture) are None where the pictures do not tell.
    rotation_deg: turn of the target during the readout; frequency_hz: of the LED.
    drawing: arrays for `corridor.figures.readout_picture`; not saved.
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
    drawing: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self):
        if not (math.isfinite(self.readout_ms) and self.readout_ms > 0):
            raise CannotMeasure("no readout time that makes sense follows from these pictures")
        if not (math.isfinite(self.sigma_ms) and self.sigma_ms < self.readout_ms):
            raise CannotMeasure("the readout time is less certain than it is long")

    def as_dict(self) -> dict[str, Any]:
        """The content of readout.json without its pictures."""
        content = {
            "target": self.target,
            "method": self.method,
            "readout_ms": self.readout_ms,
            "sigma_ms": self.sigma_ms,
            "row_axis": self.row_axis,
            "row_direction": self.row_direction,
            "rows": self.rows,
        }
        if self.frequency_hz is not None:
            content["frequency_hz"] = self.frequency_hz
        else:
            content["rotation_sense"] = self.rotation_sense
            content["angular_velocity_deg_s"] = self.angular_velocity_deg_s
            content["rotation_during_readout_deg"] = self.rotation_deg
        content.update(self.extra)
        content["warnings"] = list(self.warnings)
        return content

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


def of_turning(
    axis: str,
    rows: int,
    rate: float,
    sigma: float,
    turns_per_second: float,
    speed_sigma_percent: float,
    sense: str | None,
    row_direction: str | None,
    *,
    warnings: tuple[str, ...] = (),
    **rest: Any,
) -> Readout:
    """The result from a target's rotation while the rows are read.

    axis, rows: of the readout. rate, sigma: radians from a row to the next, as `directions` has it.
    speed_sigma_percent: of the speed, which goes into the readout time one to one.
    rest: target, method, extra, drawing. Raises as `directions` and `Readout` do.
    """
    direction, found, look_alike = directions(axis, rate, sense, row_direction)
    omega = 2 * math.pi * turns_per_second
    readout = 1e3 * abs(rate) * (rows - 1) / omega
    return Readout(
        readout_ms=readout,
        sigma_ms=sigma_with_speed(readout, 1e3 * sigma * (rows - 1) / omega, speed_sigma_percent),
        row_axis=axis,
        row_direction=direction,
        rows=rows,
        rotation_sense=found,
        angular_velocity_deg_s=math.degrees(omega),
        rotation_deg=math.degrees(abs(rate)) * (rows - 1),
        warnings=(*warnings, *look_alike),
        **rest,
    )


def directions(
    axis: str,
    rate: float,
    sense: str | None,
    row_direction: str | None,
) -> tuple[str | None, str | None, tuple[str, ...]]:
    """Row direction, sense and warnings from the sign of the rotation per row.

    axis: "y" or "x". rate: radians the target turns from a row to the next in the order of
    growing y (x), clockwise positive. sense, row_direction: as given, or None.
    Raises InputError where what is given contradicts itself or the pictures.
    """
    forward, backward = ("down", "up") if axis == "y" else ("right", "left")
    if row_direction is not None and row_direction not in (forward, backward):
        raise InputError(
            f"--row-direction {row_direction} contradicts the pictures: their rows follow each "
            f"other along {axis}, use {forward} or {backward}"
        )
    with_rows = "cw" if rate > 0 else "ccw"
    against = "ccw" if rate > 0 else "cw"
    if row_direction is None and sense is None:
        return (
            None,
            None,
            (
                f"({forward}, {with_rows}) and ({backward}, {against}) look alike: give --sense "
                "or --row-direction to know which",
            ),
        )
    if row_direction is None:
        return (forward if sense == with_rows else backward), sense, ()
    found = with_rows if row_direction == forward else against
    if sense is not None and sense != found:
        raise InputError(
            f"sense {sense} with row direction {row_direction} contradicts the pictures, in which "
            f"rows {row_direction} go with {found}: correct one of the two"
        )
    return row_direction, found, ()


def sigma_with_speed(readout_ms: float, own_ms: float, speed_sigma_percent: float) -> float:
    """The sigma of a readout time with that of the speed, which goes in one to one."""
    return float(np.hypot(own_ms, readout_ms * speed_sigma_percent / 100))
