"""Where the surveyed points lie, and which tie points serve as check points."""

import numpy as np

from corridor.core.errors import InputError
from corridor.core.simulation.plan import MOST_SURVEYED, Ground


def surveyed(
    ground: Ground, begin: float, end: float, bank: float, draw: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stations, distances to the right of the axis (n,) m and roles of the surveyed points.

    begin, end: of the part that is flown. bank: distance of a bank from the axis, metres.
    """
    length = end - begin
    count, control = ground.control + ground.check, ground.control
    if ground.every_m is not None:
        check_every(ground, length)
        if control:
            control = max(2, round(control / max(count, 1) * (length / ground.every_m + 1)))
        count = int(length / ground.every_m) + 1
        control = min(control, count)
        first = begin + (length - (count - 1) * ground.every_m) / 2
        station = first + ground.every_m * np.arange(count)
    else:
        share = np.linspace(0.04, 0.96, count) if count > 1 else np.ones(count)
        station = begin + share * length
    side = np.where(np.arange(count) % 2, -1.0, 1.0)
    if ground.layout == "spread":
        # Both banks and the axis in turn, so that a plane through them is held across as well.
        side = np.resize([-1.0, 1.0, 0.0], count)
    across = side * bank * draw.uniform(0.85, 1.0, count)
    # No point comes near its neighbour's place.
    shake = min(0.02, 0.25 * np.ptp(station[:2]) / length) if count > 1 else 0.02
    station = station + draw.uniform(-shake, shake, count) * length
    role = np.full(count, "check", dtype=object)
    if control:
        role[np.round(np.linspace(0, count - 1, control)).astype(int)] = "control"
    return station, across, role


def check_every(ground: Ground, length: float) -> None:
    """Raise InputError where a point each `every_m` over a length (m) is too many points."""
    if ground.every_m is not None and length / ground.every_m > MOST_SURVEYED:
        raise InputError(
            f"ground: every_m = {ground.every_m:g} makes more than {MOST_SURVEYED} points: "
            "give more"
        )


def evenly(
    station: np.ndarray, across: np.ndarray, count: int, draw: np.random.Generator
) -> np.ndarray:
    """Indices of `count` points spread evenly over the ground: one a cell, then another a cell."""
    if count >= len(station):
        return np.arange(len(station))
    span = np.ptp(station), np.ptp(across)
    side = np.sqrt(max(span[0] * span[1], 1e-9) / count)
    cell = np.floor((station - station.min()) / side) * 1e6 + np.floor(
        (across - across.min()) / side
    )
    turn = draw.permutation(len(station))
    order = turn[np.argsort(cell[turn], kind="stable")]
    sorted_cell = cell[order]
    first = np.concatenate([[True], np.diff(sorted_cell) != 0])
    begin = np.flatnonzero(first)
    rank = np.arange(len(order)) - np.repeat(begin, np.diff([*begin, len(order)]))
    return np.sort(order[np.lexsort((turn, rank))][:count])
