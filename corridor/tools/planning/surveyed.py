"""Where points could be surveyed: the candidates for ground control, and the check points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.core.camera import project, undistort
from corridor.core.effects import Images
from corridor.core.errors import InputError
from corridor.core.simulation import Dike, Plan, bank_of, strips_of

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


def on_the_ground(plan: Plan, seed: int, station, across) -> np.ndarray:
    """Positions (n, 3), metres, at stations and distances to the right of the axis (n,)."""
    ground = Dike(plan.terrain.relief_m, plan.terrain.level_m, seed, plan.terrain.roughness_m)
    station, across = np.atleast_1d(station).astype(float), np.atleast_1d(across).astype(float)
    return np.column_stack([plan.axis.place(station, across), ground.height(station, across)])


def seen_by(images: Images, points: np.ndarray, border_px: float) -> list[np.ndarray]:
    """Rows of the images that show each point (n, 3), at least border_px from the edge."""
    out = []
    for point in np.asarray(points, dtype=float).reshape(-1, 3):
        rays = np.einsum("nij,nj->ni", images.rotation, point - images.centre)
        pixel = project(
            np.broadcast_to(point, images.centre.shape), images.centre, images.rotation,
            images.interior, np.arange(len(images.centre)),
        )  # fmt: skip
        inside = (pixel >= border_px) & (pixel <= images.size - 1 - border_px)
        rows = np.flatnonzero(inside.all(axis=1))
        if len(rows):
            # Beyond a fold of the distortion a far point would seem to lie inside.
            back = undistort(pixel[rows], images.interior[rows], np.arange(len(rows)))
            straight = rays[rows, :2] / rays[rows, 2:]
            rows = rows[np.abs(back - straight).max(axis=1) < 1e-6]
        out.append(rows)
    return out


def marks_of(images: Images, names: Sequence[str], points: np.ndarray, seen) -> pd.DataFrame:
    """The table of marks: what images measure of points (n, 3), free of error."""
    image = np.concatenate(seen)
    point = np.repeat(np.arange(len(points)), [len(rows) for rows in seen])
    pixel = project(
        points[point], images.centre[image], images.rotation[image], images.interior, image
    )
    return pd.DataFrame(
        {
            "point": np.array(names, dtype=object)[point],
            "image": images.names[image],
            "x": pixel[:, 0],
            "y": pixel[:, 1],
        }
    )
