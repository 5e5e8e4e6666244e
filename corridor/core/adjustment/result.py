"""An adjustment: its tables, what is doubtful about them, and the report."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.misfit import misfit
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.precision import FAR, MOST, InDatum, chosen
from corridor.core.adjustment.solving import Solution
from corridor.core.adjustment.tables import Tables
from corridor.core.adjustment.warnings import warnings_of
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import with_units

if TYPE_CHECKING:
    from corridor.core.adjustment.along import PrecisionAlong

Again = Callable[..., "Adjustment"]


class Adjustment(Tables):
    """A block after adjustment, with everything one asks of it; see `print`.

    required: 3D RMS of the check points that is good enough, metres, for the report; may be set.
    doubts: what is probably a mistake in the block; see `corridor.preparation`. control_factor: by
    what its residuals say that standard deviations of ground control are too small.
    """

    required: float | None = None

    def __init__(
        self,
        start: Block,
        solution: Solution,
        covariance: Covariance,
        seconds: float,
        notes: list[str],
    ):
        super().__init__(start, solution, covariance, seconds)
        self._notes = notes
        self.doubts: list[str] = []
        self.control_factor = 1.0

    def begun_from(self, block: Block) -> None:
        """State the block that all began with: of it the images that are adjusted, for some are
        left out on the way."""
        images = self.problem.block.images["image"]
        whole = len(images) == len(block.images)
        self.start = block if whole else block.select(images=images)

    def __repr__(self) -> str:
        return (
            f"Adjustment of {self.start.name}: {self.problem.image_count} images, sigma naught "
            f"{self.sigma0:.3f}, {'converged' if self.converged else 'not converged'} in "
            f"{self.iterations} iterations"
        )

    def __str__(self) -> str:
        return str(registry.room("report").of_adjustment(self))

    def _repr_html_(self) -> str:
        return registry.room("report").of_adjustment(self).html()

    def to_dict(self) -> dict[str, Any]:
        """What `adjustment.json` holds: every number, by the names of the design's section 7."""
        return registry.room("report").adjustment_dict(self)

    def save(
        self,
        folder: str | os.PathLike,
        pictures: "Mapping[str, Any] | Callable[[Adjustment], Mapping[str, Any]] | None" = None,
        captions: Mapping[str, str] | None = None,
        gis: bool = False,
        beside: Mapping[str, bytes] | None = None,
    ) -> list[Path]:
        """Writes it into `folder`, whole or not at all: see `corridor.report.save_adjustment`."""
        return registry.room("report").save_adjustment(
            self, folder, pictures, captions, gis, beside
        )

    def write_gis(self, stem: Path) -> None:
        """Writes STEM.gpkg and STEM.las: see `corridor.report.write_gis`."""
        registry.room("report").write_gis(self, stem)

    @property
    def notes(self) -> list[str]:
        """What was left out or set aside on the way, a sentence each."""
        return list(self._notes)

    def start_misfit(self) -> list[str]:
        """Sentences on how far the measurements lie from the start values."""
        return misfit(replace(self.system, state=self.problem.start))

    def add_note(self, *sentences: str) -> None:
        """Sentences to stand first among the warnings, in this order."""
        self._notes[:0] = sentences
        self.__dict__.pop("warnings", None)

    def keep_notes(self, earlier: "Adjustment") -> None:
        """What was said of an earlier adjustment, of which this one is the continuation."""
        self._notes = [*(note for note in earlier._notes if note not in self._notes), *self._notes]

    def relative_precision(
        self, datum: Iterable[str] | None = None, scale: bool = True
    ) -> pd.DataFrame:
        """Standard deviations of the points among themselves: without what lies in the datum.

        datum: names of the points on which position, rotation and scale are laid (for a free
        network the datum of one's choice), or of two images: the pose of the first is held, and
        their base; default: all points that are determined. scale: whether the scale is laid on
        them, too; False: it is that of the measurements, of distances say.
        Columns: point, x, y, z, sx, sy, sz (m). Of more than 100,000 points an even choice.
        Raises InputError for names that are no points, and for points on one line.
        Source: Baarda 1973; James, Robson and Smith 2017. See `adjustment.precision`.
        """
        found = self.in_datum(datum, scale)
        table = pd.DataFrame({"point": np.asarray(self.problem.point_index)[found.points]})
        table[["x", "y", "z"]] = self.state.points[found.points]
        table[["sx", "sy", "sz"]] = self.sigma0 * np.sqrt(found.point_variances)
        return with_units(table, {"m": "x y z sx sy sz"})

    def relative_poses(
        self, datum: Iterable[str] | None = None, scale: bool = True
    ) -> pd.DataFrame:
        """Standard deviations of the poses without what lies in the datum.

        datum, scale: as of `relative_precision`. Columns as of `poses`, in the order of images.csv.
        """
        found, table = self.in_datum(datum, scale), self.poses.copy()
        variance = np.einsum("nii->ni", found.poses)[:, :6]
        sigma = np.empty(variance.shape)
        sigma[self.problem.order] = self.sigma0 * np.sqrt(np.maximum(variance, 0.0))
        table[["sx", "sy", "sz", "s_rx", "s_ry", "s_rz"]] = sigma
        return with_units(table, {"m": "x y z sx sy sz", "rad": "s_rx s_ry s_rz"})

    def in_datum(self, datum: Iterable[str] | None = None, scale: bool = True) -> InDatum:
        """Covariances of points and poses in a datum; arguments as of `relative_precision`."""
        p = self.problem
        names = p.point_index
        step = max(-(-len(names) // MOST), 1)
        rows = np.arange(0, len(names), step)
        place = {name: k for k, name in enumerate(p.images.names)}
        datum = [datum] if isinstance(datum, str) else datum
        base = [] if datum is None else list(datum)
        if len(base) == 2 and all(name in place for name in base):
            return InDatum.of_base(self.covariance, rows, (place[base[0]], place[base[1]]), scale)
        if datum is not None:
            wanted = np.flatnonzero(chosen(names, datum, np.ones(len(names), bool)))
            rows = np.union1d(rows, wanted)
        size = np.sqrt(self.covariance.points(rows)[:, [0, 2, 5]].sum(axis=1))
        # A point of nearly parallel rays carries no datum.
        sound = (size > 0) & (size < FAR * np.median(size[size > 0]))
        rows = rows[size > 0] if datum is None else rows
        sound = sound[size > 0] if datum is None else sound
        carrying = chosen(np.asarray(names)[rows], datum, sound)
        return InDatum.of_points(self.covariance, rows, carrying, scale)

    def precision_along(
        self, corners: np.ndarray, required: float | None = None
    ) -> "PrecisionAlong":
        """How precise the ground is along a line (n, 2), m, or at one place; `print` tells it.

        required: standard deviation that is good enough, m.
        See `corridor.core.adjustment.along.precision_along`.
        """
        from corridor.core.adjustment.along import precision_along

        return precision_along(self, corners, required)

    @cached_property
    def variance_components(self) -> pd.DataFrame:
        """Sigma naught of each kind of observation, of antenna positions of each flight, with its
        redundancy and its test; see `corridor.core.adjustment.variance_components.components`."""
        from corridor.core.adjustment.variance_components import components

        return components(self)

    @cached_property
    def warnings(self) -> list[str]:
        """What a reader should know before trusting the numbers, a sentence each."""
        return [*self._notes, *warnings_of(self)]


def from_where_it_ended(
    result: Adjustment, start: Block, model: Model, again: Again, **how
) -> Adjustment:
    """Adjusted with positions and stated arms of `start`, from the poses that were found.

    how: `steps`: so many iterations and no more, where what comes of it is asked for sizes alone.
    """
    ended = result.start_again
    ended.gnss, ended.lever_arm, ended.extra = start.gnss, start.lever_arm, start.extra
    ended.marks, ended.ground = start.marks, start.ground
    found = again(ended, model, begun=True, **how)
    found.begun_from(start)
    found.keep_notes(result)
    return found


def where_it_leads(attempt: Callable[..., Adjustment], *to) -> Adjustment | None:
    """What an attempt comes to; None where it fails, or does not converge."""
    try:
        found = attempt(*to)
    except (InputError, AdjustmentFailed):
        return None
    return found if found.converged else None


def not_converged(adjustment: Adjustment) -> AdjustmentFailed:
    """The error that says so: numbers that are no result are not written."""
    return AdjustmentFailed(
        f"the adjustment of {adjustment.start.name} did not converge in {adjustment.iterations} "
        "iterations, so there is no result and nothing was written: check the axes, units and "
        "names of what is listed above as farthest off, or allow more with --iterations"
    )
