"""Where points could be surveyed: the candidates for ground control, and the check points."""

from dataclasses import dataclass

import numpy as np

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.simulation import Plan, bank_of, on_the_ground, strips_of

# Share of the flown length between its ends and the first and last surveyed point.
_MARGIN = 0.04


@brief
@dataclass(frozen=True)
class Surveyed:
    """Ground points that images show and that somebody could survey.

    names (n,); station, across (n,): metres along the corridor's axis and to the right of it;
    check (n,): True for check points, False for candidates.
    """

    names: tuple[str, ...]
    station: np.ndarray
    across: np.ndarray
    check: np.ndarray

    @classmethod
    def grid(cls, plan: Plan, stations: int = 13, check: int | None = None) -> "Surveyed":
        """Candidates on both banks and the axis at so many stations, check points between them.

        stations: places along the corridor with candidates L (left of the axis), M (on it) and R.
        check: how many check points, on alternating banks; default: as many as the plan has, at
        least 6. What `Plan.ground` says of control is left aside: control is what is asked for.
        """
        begin, end, bank = reach(plan)
        check = max(plan.ground.check, 6) if check is None else check
        if stations < 2 or check < 1:
            raise InputError(
                f"{stations} stations with {check} check points say nothing: give 2 and 1 or more"
            )
        length = end - begin
        along = begin + length * np.linspace(_MARGIN, 1 - _MARGIN, stations)
        names = [f"{side}{k + 1}" for k in range(stations) for side in "LMR"]
        side = np.tile([-1.0, 0.0, 1.0], stations)
        between = begin + length * (np.arange(check) + 0.5) / check
        return cls(
            names=(*names, *(f"C{k + 1}" for k in range(check))),
            station=np.concatenate([np.repeat(along, 3), between]),
            across=bank * np.concatenate([side, np.resize([0.7, -0.7], check)]),
            check=np.arange(3 * stations + check) >= 3 * stations,
        )

    def place(self, plan: Plan, seed: int) -> np.ndarray:
        """Positions (n, 3), metres, on the ground of a plan."""
        return on_the_ground(plan, seed, self.station, self.across)


def reach(plan: Plan) -> tuple[float, float, float]:
    """First and last station (m) that all flights cover, and the bank's distance from the axis.

    Where no station is common to all flights, from the first to the last of any. The bank is
    `Ground.offset_m`, or what follows from the narrowest pictures in place of it.
    """
    begin, end = [], []
    # Flights along lines of their own cover what the others do, or nothing tells what that is.
    along = [flight for flight in plan.flights if flight.axis_m is None]
    for flight in along or plan.flights:
        strips = strips_of(flight, plan.camera(flight), plan.axis_of(flight))
        if not along:
            line = plan.axis_of(flight)
            seen = line.at(np.linspace(0.0, line.length, 50))[0]
            station = plan.axis.nearest(seen)
            begin.append(float(station.min()))
            end.append(float(station.max()))
            continue
        begin.append(float(np.min(strips.first)))
        end.append(float(np.max(strips.first + strips.length)))
    first, last = max(begin), min(end)
    if not last > first:
        first, last = min(begin), max(end)
    return first, last, bank_of(plan)
