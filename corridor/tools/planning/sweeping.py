"""Many flight sets, each with several sets of control points: on one core, many, or a cluster."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import joblib
import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.options import options
from corridor.core.output import Progress, telling, with_units
from corridor.core.parallel import parallel
from corridor.core.simulation import Plan, Terrain, read_plan
from corridor.tools.planning.planner import Believed, Control, Planner, subset
from corridor.tools.planning.surveyed import Surveyed

# 31 flight sets; a picture of more says nothing.
_MOST_FLIGHTS = 5
# Columns in metres; transfers of a bias and correlations have no unit.
_LENGTHS = "xy z d3 stated_xy stated_z sigma_arm_z"


def flight_sets(plans: Sequence[Plan | str], combined: bool | None = None) -> list[Plan]:
    """The flight sets to be compared.

    combined: every non-empty combination of all flights, the small ones first; else each plan as
    it is. Default: combined where one plan with two or three flights is given. The same flight in
    several plans counts once. Raises InputError for more than five flights to combine, and for
    flights over different ground.
    """
    read = [plan if isinstance(plan, Plan) else read_plan(plan) for plan in plans]
    if combined is None:
        combined = len(read) == 1 and 2 <= len(read[0].flights) <= 3
    if not combined:
        return read
    for plan in read[1:]:
        if plan.terrain != read[0].terrain and plan.terrain != Terrain():
            raise InputError(
                f"plans {read[0].name} and {plan.name} state different ground in [terrain]: their "
                "flights cannot be combined; leave [terrain] out of all plans but the first"
            )
    whole = _joined(read)
    names = [flight.name for flight in whole.flights]
    if len(names) > _MOST_FLIGHTS:
        raise InputError(
            f"{len(names)} flights have {2 ** len(names) - 1} combinations: give at most "
            f"{_MOST_FLIGHTS}, or the flight sets one by one"
        )
    return [
        subset(whole, some)
        for count in range(1, len(names) + 1)
        for some in combinations(names, count)
    ]


@options(believed=Believed)
def sweep(
    plans: Sequence[Plan | str],
    control: Sequence[Control] = (0, 1, 3, 5),
    place: str = "spread",
    *,
    believed: Believed,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> pd.DataFrame:
    """Expected accuracy of each plan with each set of control points: a row each.

    plans: flight sets, each with its own name; those over one axis are compared at the same points.
    control: as of `Planner.expect`; place: numbers of points are `spread` or at the `best` places.
    camera to seed: of `Planner`; believed: these as a whole. jobs: processes. cluster: address of a
    Dask scheduler (extra `cluster`) whose workers have corridor, used in their place. progress:
    called with a `Progress` for each flight set. Columns: see `Expected.summary`.
    """
    return swept(plans, control, place, believed, jobs, cluster, progress)[0]


def swept(
    plans: Sequence[Plan | str],
    control: Sequence[Control],
    place: str,
    believed: Believed,
    jobs: int,
    cluster: str | None,
    progress: Callable[[Progress], None] | None,
) -> tuple[pd.DataFrame, dict[str, Block]]:
    """The table of `sweep`, and by flight set a block of its images and surveyed points."""
    read = [plan if isinstance(plan, Plan) else read_plan(plan) for plan in plans]
    if place not in ("spread", "best"):
        raise InputError(f"place = {place!r} is unknown: use spread or best")
    names = [plan.name for plan in read]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two flight sets are called {name}: give each its own name")
    grids: dict = {}
    for plan in read:
        grids.setdefault(plan.axis_m, []).append(plan)
    told = {
        axis: replace(believed, surveyed=believed.surveyed or Surveyed.grid(_joined(group)))
        for axis, group in grids.items()
    }
    say, rows = telling(progress), list[dict]()
    flown: dict[str, Block] = {}
    with parallel(jobs, cluster) as share_out:
        found = share_out(
            joblib.delayed(assess)(plan, list(control), place, told[plan.axis_m]) for plan in read
        )
        for done, (some, block) in enumerate(found, start=1):
            rows += some
            flown[read[done - 1].name] = block
            say("flight set", done, len(read))
    return with_units(pd.DataFrame(rows), {"m": _LENGTHS, "px": "sigma_f"}), flown


def assess(
    plan: Plan, control: list[Control], place: str, believed: Believed
) -> tuple[list[dict], Block]:
    """The rows of one flight set, its images and points.

    Lever arms are carried over to the flights that it has.
    """
    if believed.carried is not None:
        mine = believed.carried.for_flights(flight.name for flight in plan.flights)
        believed = replace(believed, carried=mine)
    planner = Planner(plan, believed=believed)
    rows = []
    for wanted in control:
        if place == "best" and isinstance(wanted, int | np.integer):
            wanted = planner.best(wanted)
        rows.append(planner.expect(wanted).summary())
    none = {name: getattr(planner.block, name).iloc[:0] for name in ("points", "tie_points")}
    return rows, replace(planner.block, **none)


def _joined(plans: Sequence[Plan]) -> Plan:
    """All flights of some plans, each once."""
    whole = plans[0]
    for plan in plans[1:]:
        known = {flight.name for flight in whole.flights}
        fresh = [flight.name for flight in plan.flights if flight.name not in known]
        whole = whole + subset(plan, fresh) if fresh else whole
    return whole
