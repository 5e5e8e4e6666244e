"""What flights are worth before they are flown: the answer, the numbers, and where control lies."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from corridor.core.block import Block
from corridor.core.options import options
from corridor.core.output import Progress, counted, with_units
from corridor.core.simulation import ORDINARY_NOISE, Noise, Plan
from corridor.tools.planning.advising import advice, cheapest
from corridor.tools.planning.detection import detectable
from corridor.tools.planning.planner import Believed, Control
from corridor.tools.planning.report import report_of, save
from corridor.tools.planning.sweeping import flight_sets, swept

if TYPE_CHECKING:
    from corridor.tools.change import SurfaceChange


@dataclass(repr=False)
class Planned:
    """Expected accuracy of flight sets, each with several sets of control points.

    table: a row a flight set and control set, as of `planning.sweep`, metres.
    flown: flight set -> a block of its images and of all points that could be surveyed.
    goals: 3D RMS of check points that was asked for, metres. sigmas: a sentence on what is assumed
    of the measurements. settings: what was asked, kept in plan.json. detection: the surface with
    its levels of detection, of two flights like the row that the advice names first; None where
    it was not asked for.
    """

    table: pd.DataFrame
    flown: dict[str, Block]
    goals: Sequence[float]
    sigmas: str
    settings: dict = field(default_factory=dict)
    detection: SurfaceChange | None = None

    @property
    def advice(self) -> str:
        """The cheapest way to each accuracy, and what it rests on."""
        return advice(self.table, self.goals)

    @property
    def chosen(self) -> pd.Series | None:
        """The row that the advice names first; None where no flight set can be adjusted."""
        return cheapest(self.table, self.goals)

    @property
    def control(self) -> pd.DataFrame:
        """Control of the row that the advice names first: point, x, y, z (m, of the plan)."""
        columns = ["point", "x", "y", "z"]
        none = pd.DataFrame(columns=[*columns, "role"])
        ground = none if self.chosen is None else self.laid_out().ground
        mine = ground.loc[ground["role"] == "control", columns]
        return with_units(mine.reset_index(drop=True), {"m": "x y z"})

    def laid_out(self) -> Block:
        """The chosen flight set: its images, its control points, and the check points."""
        row = self.chosen
        block = self.flown[row["flights"]].copy()
        chosen = block.ground["point"].isin(str(row["points"]).split())
        kept = chosen | (block.ground["role"] == "check")
        role = chosen.map({True: "control", False: "check"})
        block.ground = block.ground.assign(role=role)[kept].reset_index(drop=True)
        return block

    def __repr__(self) -> str:
        sets, first = len(self.flown), self.advice.partition("; ")[0].partition(". ")[0]
        return f"Plan of {sets} flight set{'s' * (sets > 1)}: {first.rstrip('.')}"

    def __str__(self) -> str:
        return str(report_of(self))

    def _repr_html_(self) -> str:
        return report_of(self).html()

    def save(self, folder: str | os.PathLike) -> list[Path]:
        """Writes plan.csv, plan.json, control.csv, advice.txt, accuracy.png and control.png.

        Where a level of detection was asked for, also detection.csv and detection.png. Whole or
        not at all; metres, NaN is null, an empty cell. Raises InputError where `folder` holds
        something else.
        """
        return save(self, folder)


@options(believed=Believed)
def plan(
    plans: Plan | str | os.PathLike | Sequence[Plan | str],
    control: int | Sequence[Control] = (0, 1, 3, 5),
    place: str = "spread",
    goals: float | Sequence[float] = (0.01, 0.03),
    combined: bool | None = None,
    detection: bool = False,
    progress: Callable[[Progress], None] | None = None,
    *,
    believed: Believed,
    jobs: int = 1,
    cluster: str | None = None,
) -> Planned:
    """Expected accuracy of flights before they are flown, without and with ground control.

    plans: a `.toml` file, names of ready-made plans joined by +, a `Plan`, or several of them.
    control: numbers of control points, or sets of points as of `Planner.expect`. place: numbers of
        points are `spread` evenly, or at the `best` places.
    goals: accuracies that the advice is about, 3D RMS of check points, metres.
    combined: compare every combination of the flights; default: where one plan has two or three.
    detection: also where two flights like the advised ones would show which change of the ground.
    progress: called with a `Progress` for each flight set.
    camera to seed: of `planning.Planner`; believed: these as a whole. jobs, cluster: of
        `planning.sweep`.
    A plan without a table [noise] is taken to be flown with ordinary noise, as `corridor simulate`
    does.
    Raises InputError for a plan that cannot be flown, or leaves a parameter undetermined.
    """
    alone = not isinstance(plans, list | tuple)
    sets = [
        replace(one, noise=ORDINARY_NOISE) if one.noise == Noise() else one
        for one in flight_sets([plans] if alone else plans, combined)
    ]
    counts = [control] if isinstance(control, int) else list(control)
    table, flown = swept(sets, counts, place, believed, jobs, cluster, progress)
    wanted = [goals] if isinstance(goals, int | float) else list(goals)
    planned = Planned(table, flown, wanted, _sigmas(sets, flown))
    if detection and planned.chosen is not None:
        (chosen,) = (one for one in sets if one.name == planned.chosen["flights"])
        planned.detection = detectable(chosen, planned.laid_out(), believed)
    return planned


def _sigmas(sets: Sequence[Plan], flown: dict[str, Block]) -> str:
    """The sigmas that the adjustment of each flight set works with, in a sentence."""
    told: dict[str, list[str]] = {}
    for one in sets:
        sigma = flown[one.name].sigma
        three = {key: "/".join(f"{v:g}" for v in sigma[f"{key}_m"]) for key in ("gnss", "control")}
        gnss = f"GNSS {three['gnss']} m" if one.gnss else "no GNSS"
        if one.attitudes:
            gnss += f", attitudes {'/'.join(f'{v:g}' for v in sigma['attitude_deg'])} degrees"
        words = (
            f"image points {sigma['tie_px']:g} px, marks {sigma['mark_px']:g} px, {gnss}, "
            f"control {three['control']} m (x/y/z)"
        )
        if count := len(flown[one.name].distances):
            words += f", {counted(count, 'distance')} {one.noise.distance_m:g} m"
        elif one.ground.bars:
            words += ", bars left out as [noise] states no distance_m"
        if one.noise == ORDINARY_NOISE:
            words += ", ordinary ones as the plan states none"
        told.setdefault(words, []).append(one.name)
    if len(told) == 1:
        return f"Assumed standard deviations: {next(iter(told))}."
    parts = (f"{words} for {', '.join(names)}" for words, names in told.items())
    return f"Assumed standard deviations: {'; '.join(parts)}."
