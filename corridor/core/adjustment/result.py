"""An adjustment: its tables, what is doubtful about them, and the report."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from corridor.core import registry
from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.export import write_gis
from corridor.core.adjustment.misfit import misfit
from corridor.core.adjustment.solving import Solution
from corridor.core.adjustment.tables import Tables
from corridor.core.adjustment.warnings import warnings_of
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed


class Adjustment(Tables):
    """A block after adjustment, with everything one asks of it; see `print`.

    required: 3D RMS of the check points that is good enough, metres, for the report; may be set.
    doubts: what is probably a mistake in the block; see `corridor.preparation`.
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
        pictures: Mapping[str, Any] | Callable[[Adjustment], Mapping[str, Any]] | None = None,
        captions: Mapping[str, str] | None = None,
        gis: bool = False,
    ) -> list[Path]:
        """Writes it into `folder`, whole or not at all: see `corridor.report.save_adjustment`."""
        return registry.room("report").save_adjustment(self, folder, pictures, captions, gis)

    write_gis = write_gis

    @property
    def notes(self) -> list[str]:
        """What was left out or set aside on the way, a sentence each."""
        return list(self._notes)

    def start_misfit(self) -> list[str]:
        """Sentences on how far the measurements lie from the start values."""
        return misfit(replace(self.system, state=self.problem.start))

    def add_note(self, sentence: str) -> None:
        """A sentence to stand first among the warnings."""
        self._notes.insert(0, sentence)
        self.__dict__.pop("warnings", None)

    def keep_notes(self, earlier: Adjustment) -> None:
        """What was said of an earlier adjustment, of which this one is the continuation."""
        self._notes = [*(note for note in earlier._notes if note not in self._notes), *self._notes]

    @cached_property
    def variance_components(self) -> pd.DataFrame:
        """Sigma naught of each kind of observation, of antenna positions of each flight, with its
        redundancy and its test; see `corridor.core.adjustment.group_variances.components`."""
        from corridor.core.adjustment.group_variances import components

        return components(self)

    @cached_property
    def warnings(self) -> list[str]:
        """What a reader should know before trusting the numbers, a sentence each."""
        return [*self._notes, *warnings_of(self)]


def not_converged(adjustment: Adjustment) -> AdjustmentFailed:
    """The error that says so: numbers that are no result are not written."""
    return AdjustmentFailed(
        f"the adjustment of {adjustment.start.name} did not converge in {adjustment.iterations} "
        "iterations, so there is no result and nothing was written: check the axes, units and "
        "names of what is listed above as farthest off, or allow more with --iterations"
    )
