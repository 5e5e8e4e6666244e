"""The moments of exposure."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from corridor.brief import brief
from corridor.errors import InputError


@brief
@dataclass(frozen=True)
class Exposures:
    """Moments of exposure.

    table: one row an exposure
        image (text) or number (Int64)
        time_s: float64, seconds since `day` 00:00 of `time_system`; NaN where unknown
        x, y, z, sx, sy, sz: positions that the file has too, as in a Track; optional
        offset_e, offset_n, offset_u: metres from the antenna to the camera; optional
        flag: DJI's quality: 50 fix, 34 (32 to 49) float, 16 single, 0 none; optional
        flight: text; optional
    resolution_s: step of the printed times (a time is off by up to half of it); None: not coarse
    day, time_system, crs, source, notes: as in a Track
    """

    table: pd.DataFrame
    day: str | None
    time_system: str | None
    crs: str | None
    source: Path
    notes: tuple[str, ...] = ()
    resolution_s: float | None = None

    def named(self, images: list[str]) -> "Exposures":
        """With the column `image`: each number is looked for in the names of image files.

        DJI writes the number as the last group of four or more digits between `_` and `_` or `.`.
        Raises InputError where an exposure has no image, or two.
        """
        if "image" in self.table:
            return self
        by_number: dict[int, str] = {}
        for name in sorted(images):
            groups = re.findall(r"_(\d{4,5})(?=[_.])", name)
            if not groups:
                continue
            number = int(groups[-1])
            if number in by_number:
                raise InputError(
                    f"{self.source.name}: images {by_number[number]} and {name} both have number "
                    f"{number}; name the images of one flight and one lens"
                )
            by_number[number] = name
        lost = [number for number in self.table["number"] if number not in by_number]
        if lost:
            raise InputError(
                f"{self.source.name}: no image has number {lost[0]} ({len(lost)} of "
                f"{len(self.table)} exposures are without image); name the folder with all images"
            )
        names = [by_number[number] for number in self.table["number"]]
        return replace(self, table=self.table.assign(image=pd.Series(names, dtype="str")))
