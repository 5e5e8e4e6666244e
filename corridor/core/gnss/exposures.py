"""The moments of exposure."""

import re
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.core.errors import InputError, some
from corridor.core.gnss.pairing import paired

# Share of the usual interval that no camera undercuts; of the rows of which that is a slip.
_NEAR, _FEW = 0.01, 0.02
# Steps that programs round times to, s; a finer one is below what a receiver's noise hides. Of the
# step, what a time may be beside it: seconds since 1970 have 2e-7 s of a float.
_STEPS_S, _ON_STEP = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005), 1e-3
# A camera that is triggered exposes, and writes its time, within this, s.
_JITTER_S = 0.25
# Share of the exposures of which the photographs may be deleted: more is another folder.
_MOST_DELETED = 0.5


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
    counted: numbers are of events as a receiver counts them, not of image files
    """

    table: pd.DataFrame
    day: str | None
    time_system: str | None
    crs: str | None
    source: Path
    notes: tuple[str, ...] = ()
    resolution_s: float | None = None
    counted: bool = False

    def with_seen_step(self) -> "Exposures":
        """With the coarsest step whose multiples the times are, where nobody fired at it.

        A camera that fires at whole seconds, or tenths, does so evenly, or with gaps; rounded times
        are now and then a step farther apart. (So are those of a camera that fires each second
        where photographs are lost: its sigmas come out too large, and it is told why.)
        """
        time = np.sort(self.table["time_s"].dropna().to_numpy(float))
        if self.resolution_s is not None or len(time) < 2:
            return self
        for step in _STEPS_S:
            counts = (time - time[0]) / step
            if np.abs(counts - np.round(counts)).max() > _ON_STEP:
                continue
            apart, times = np.unique(np.diff(np.round(counts)), return_counts=True)
            often = set(apart[(times > 1) & (apart > 0)])
            rounded = any(one + 1.0 in often for one in often)
            return replace(self, resolution_s=step) if rounded else self
        return self

    def too_near(self) -> str | None:
        """A sentence where two exposures are nearer in time than any camera can take them.

        Of a rig of cameras that fire together many are; where few are, a time is wrong.
        """
        known = self.table["time_s"].dropna().sort_values(kind="stable")
        step = np.diff(known.to_numpy(float))
        near = np.flatnonzero(step < _NEAR * np.median(step)) if len(step) > 2 else np.zeros(0, int)
        if not len(near) or len(near) > max(_FEW * len(step), 1):
            return None
        names = self.table["image" if "image" in self.table else "number"]
        one, other = (names.loc[known.index[near[0] + k]] for k in (0, 1))
        return (
            f"{self.source.name}: {one} and {other} are {step[near[0]]:.4f} s apart, others "
            f"{np.median(step):.3g} s: is one of their times wrong?"
        )

    def out_of_order(self) -> str | None:
        """A sentence where times rise from row to row but for a few: these are wrong."""
        time = self.table["time_s"].to_numpy(float)
        rows = np.flatnonzero(np.isfinite(time)).tolist()
        # The longest part that rises: of each length, the row that ends one earliest, and when.
        ends: list[int] = []
        least: list[float] = []
        before: dict[int, int | None] = {}
        for row in rows:
            k = bisect_right(least, time[row])
            before[row] = ends[k - 1] if k else None
            ends[k : k + 1], least[k : k + 1] = [row], [time[row]]
        rising, last = set(), ends[-1] if ends else None
        while last is not None:
            rising.add(last)
            last = before[last]
        stray = [row for row in rows if row not in rising]
        if not stray or len(stray) > max(_FEW * len(rows), 1):
            return None
        name = self.table["image" if "image" in self.table else "number"].iloc[stray[0]]
        return (
            f"{self.source.name}: {name} was taken at {time[stray[0]]:.10g} s, out of the order of "
            "the others: is its time right?"
        )

    def named(self, images: list[str], taken: "Exposures | None" = None) -> "Exposures":
        """With the column `image`: each number is looked for in the names of image files.

        DJI writes the number as the last group of four or more digits between `_` and `_` or `.`.
        Exposures of a receiver that counts events (`counted`) get the images whose times, those of
        `taken` by the camera's clock, have the same rhythm; without these in the order of their
        names, where there are as many. An exposure whose image was deleted is left out, and named
        in a note.
        Raises InputError where most exposures have no image, or one has two.
        """
        if "image" in self.table:
            return self
        if self.counted:
            return self._in_order(sorted(images)) if taken is None else self._in_time(taken)
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
        has = self.table["number"].isin(list(by_number))
        lost = self.table["number"][~has].tolist()
        if len(lost) > _MOST_DELETED * len(self.table):
            raise InputError(
                f"{self.source.name}: no image has number {lost[0]} ({len(lost)} of "
                f"{len(self.table)} exposures are without image); name the folder with all images"
            )
        table = self.table[has].reset_index(drop=True)
        names = pd.Series([by_number[number] for number in table["number"]], dtype="str")
        notes = self.notes
        if lost:
            notes += (
                f"{self.source.name}: no image has number {some([str(n) for n in lost], 5)}: "
                f"{len(lost)} of {len(self.table)} exposures are left out (photographs deleted?)",
            )
        return replace(self, table=table.assign(image=names), notes=notes)

    def _in_time(self, taken: "Exposures") -> "Exposures":
        """With the images whose times go with the events'."""
        events = self.table.sort_values("time_s", kind="stable").reset_index(drop=True)
        images = taken.table.sort_values(["time_s", "image"], kind="stable")
        within = max(_JITTER_S, 0.6 * (taken.resolution_s or 0.0))
        rows = None
        if min(len(events), len(images)) > 1:
            one, other = (frame["time_s"].to_numpy(float) for frame in (events, images))
            rows = paired(one, other, within)
        if rows is None:
            raise InputError(
                f"{self.source.name} has {len(events)} events and there are {len(images)} images, "
                "whose times (EXIF) do not go with the events': one belongs to another flight, or "
                "all were taken at one interval, so that a missed event cannot be found. Name the "
                "images in the table yourself, or leave --photos out"
            )
        lost = np.delete(events["number"].to_numpy(), rows[:, 0])
        bare = np.delete(images["image"].to_numpy(), rows[:, 1])
        notes = [f"images were given to events by the rhythm of their times (to {within:g} s)"]
        for what, names in (("events have no image", lost), ("images have no event", bare)):
            if len(names):
                notes.append(
                    f"{self.source.name}: {len(names)} {what} ({some(names, 5)}): left out"
                )
        table = events.iloc[rows[:, 0]].reset_index(drop=True)
        names = pd.Series(images["image"].to_numpy()[rows[:, 1]], dtype="str")
        return replace(self, table=table.assign(image=names), notes=(*self.notes, *notes))

    def _in_order(self, images: list[str]) -> "Exposures":
        """With the names of image files in their order."""
        if len(images) != len(self.table):
            raise InputError(
                f"{self.source.name} has {len(self.table)} events and there are {len(images)} "
                "images: RTKLIB keeps one event an epoch, and a camera may miss one; delete or add "
                "rows until each event is that of an image, or leave --photos out and name the "
                "images in the table"
            )
        return replace(self, table=self.table.assign(image=pd.Series(images, dtype="str")))
