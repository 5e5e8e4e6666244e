"""Distances between points as observations: scale bars, tapes.

The kernels eliminate each point by itself, and a distance ties two together. So the ends of
distances get their coordinates among the unknowns that images share: with p the point, g where it
starts and e three shared unknowns,

    g - e - p = 0      with a weight w that is `TIGHT` times what the images know of the point
    d = |p_1 - p_2|    by the unknowns e of its two ends

The first adds three numbers and three unknowns for each end, and a share 1 / TIGHT to the variance
of the point. A larger weight would lose digits where the point is eliminated (1e-16 TIGHT), and
hide from the search for what is open (`datum.OPEN`) that a distance of some decimetres' standard
deviation gives a scale.
Source: Triggs et al. 2000, section 6 (elimination of the points); Luhmann et al., "Close-range
photogrammetry and 3D imaging", section 4.4.3 (scale by distances).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.adjustment.model import Loss
from corridor.core.adjustment.observations import Control, Network
from corridor.core.adjustment.unknowns import State, Unknown, Unknowns
from corridor.core.block import Block
from corridor.core.effects import Context
from corridor.core.engine.scene import robust
from corridor.core.errors import some
from corridor.core.output import with_units

if TYPE_CHECKING:
    from corridor.core.adjustment.covariance import Covariance
    from corridor.core.adjustment.problem import Problem

# Kind of an unknown, and where its value lives among those of the effects.
END, ENDS = "distance", "distance ends"
TIGHT = 1e5
# What a bar or a tape is known to where distances.csv does not say it, m.
SIGMA_M = 0.001


@dataclass
class Distances:
    """Measured distances between points.

    end_names (e,): of the points at their ends; end_start (e, 3): where they start, m.
    distance_ends (k, 2): among them; distance_given (k,), m; distance_weight (k,), 1/m^2;
    distance_rows (k,): of distances.csv.
    """

    end_names: list[str]
    end_start: np.ndarray
    distance_ends: np.ndarray
    distance_given: np.ndarray
    distance_weight: np.ndarray
    distance_rows: np.ndarray


def distances_of(
    block: Block, network: Network, control: Control
) -> tuple[Distances, Control, list[str]]:
    """The distances of a block, its control with a row for each of their ends, and sentences on
    what is not used: ends that no image shows, or that are control points, which hold them."""
    notes: list[str] = []
    table = block.distances
    known = _numbers(block, network)
    at: dict[int, int] = {}
    rows, ends = [], []
    lost: dict[str, list[str]] = {"no image shows": [], "control holds": []}
    for row, pair in enumerate(zip(table["from"], table["to"], strict=True)):
        numbers = [known.get(name, -1) for name in pair]
        hidden = [name for name, number in zip(pair, numbers, strict=True) if number < 0]
        held = [
            name
            for name, number in zip(pair, numbers, strict=True)
            if number >= 0 and control.control[number] >= 0
        ]
        if hidden or held:
            lost["no image shows" if hidden else "control holds"] += hidden or held
            continue
        rows.append(row)
        ends.append([at.setdefault(number, len(at)) for number in numbers])
    for why, names in lost.items():
        if names:
            notes.append(
                f"Distances to {some(dict.fromkeys(names), 5)} are not used: {why} "
                f"{'this point' if len(set(names)) == 1 else 'these points'}."
            )
    points = np.array(list(at), dtype=np.int64)
    start = network.point_start[points].reshape(-1, 3)
    c = len(control.control_rows)
    of_point = control.control.copy()
    of_point[points] = c + np.arange(len(points))
    weight = TIGHT * _information(block, network, points)
    control = replace(
        control,
        control=of_point,
        control_given=np.concatenate([control.control_given, start]),
        control_turn=np.concatenate([control.control_turn, np.tile(np.eye(3), (len(start), 1, 1))]),
        control_weight=np.concatenate([control.control_weight, weight]),
    )
    named = {number: name for name, number in known.items()}
    given = block.column("distances", "distance")[rows]
    sigma = block.column("distances", "sigma")[rows]
    found = Distances(
        [named[number] for number in points.tolist()],
        start,
        np.array(ends, dtype=np.int64).reshape(-1, 2),
        given,
        np.where(np.isnan(sigma), SIGMA_M, sigma) ** -2.0,
        np.array(rows, dtype=np.int64),
    )
    return found, control, notes


def _numbers(block: Block, network: Network) -> dict[str, int]:
    """Number in the network of each point that a distance names."""
    if not len(block.distances):
        return {}
    ties, marks = (t["point"].dtype.categories for t in (block.tie_points, block.marks))
    names = (ties.append(marks) if len(marks) else ties).to_numpy(dtype=object)
    named = set(block.distances["from"]) | set(block.distances["to"])
    mine = np.flatnonzero(np.isin(names, list(named)))
    place = np.full(len(names), -1)
    place[network.point_codes] = np.arange(len(network.point_codes))
    return {str(names[code]): int(place[code]) for code in mine if place[code] >= 0}


def _information(block: Block, network: Network, points: np.ndarray) -> np.ndarray:
    """About what images know of each coordinate of points (e, 3), 1/m^2: f / (depth sigma), each
    ray squared."""
    out = np.zeros((len(points), 3))
    if not len(points):
        return out
    centre = block.numbers("images", *"xyz")[network.order]
    focal = np.array([camera["f"] for camera in block.cameras.values()])
    focal = focal[block.image_camera[network.order]]
    weight = np.broadcast_to(network.weight, len(network.img))
    for k, point in enumerate(points):
        rays = slice(network.ptr[point], network.ptr[point + 1])
        image = network.img[rays]
        depth = np.linalg.norm(network.point_start[point] - centre[image], axis=1)
        out[k] = np.sum((focal[image] * weight[rays] / np.maximum(depth, 1e-9)) ** 2)
    return out


def with_ends(unknowns: Unknowns, distances: Distances) -> Unknowns:
    """The unknowns, with the coordinates of the ends behind those that images share."""
    e = len(distances.end_names)
    if not e:
        return unknowns
    first, before = len(unknowns.unknowns), unknowns.ground_column
    shared = [
        *unknowns.unknowns,
        *(Unknown(END, ENDS, axis, name, "m", (k, at))
          for k, name in enumerate(distances.end_names) for at, axis in enumerate("xyz")),
    ]  # fmt: skip
    column = np.full((len(before) + e, before.shape[1] + 3), -1)
    column[: len(before), :-3] = before
    column[len(before) :, -3:] = first + np.arange(3 * e).reshape(e, 3)
    return replace(unknowns, unknowns=shared, ground_column=column)


def ground_with_ends(
    p: Problem, state: State, residual: np.ndarray, derivative: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (c + e, 3), m, and derivatives (c + e, 3, k + 3) of control with those of ends."""
    e, c = len(p.end_names), len(residual)
    if not e:
        return residual, derivative
    points = np.empty((c + e, 3))
    rows = np.flatnonzero(p.control >= 0)
    points[p.control[rows]] = state.points[rows]
    of_ends = p.end_start - points[c:] - state.effects[ENDS]
    out = np.zeros((c + e, 3, derivative.shape[2] + 3))
    out[:c, :, :-3] = derivative
    out[c:, :, -3:] = np.eye(3)
    return np.concatenate([residual, of_ends]), out


def _apart(p: Problem, state: State) -> tuple[np.ndarray, np.ndarray]:
    """From the second to the first end of each distance (k, 3), and how far (k,), m."""
    place = p.end_start - state.effects.get(ENDS, 0.0)
    apart = place[p.distance_ends[:, 0]] - place[p.distance_ends[:, 1]]
    return apart, np.linalg.norm(apart, axis=1)


def distance_rows(p: Problem, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (k,), measured minus modelled, m, with the derivatives (k, 6 + q) of the modelled
    and the columns (k, 6 + q) among the shared unknowns that they are by: the ends, and what
    effects of distances have."""
    apart, length = _apart(p, state)
    unit = apart / np.maximum(length, 1e-300)[:, None]
    first = p.shared_count - 3 * len(p.end_names)
    columns = first + 3 * p.distance_ends[:, :, None] + np.arange(3)
    by = np.concatenate([-unit, unit], axis=1)
    context = Context(p.images, distance=p.distance_rows, length=p.distance_given)
    shift, of_effects = p.stack.evaluate("distance", context, state.effects)
    there = p.distance_column >= 0
    by = np.concatenate([by, np.where(there, of_effects[:, 0], 0.0)], axis=1)
    more = np.where(there, p.distance_column, first)
    columns = np.concatenate([columns.reshape(-1, 6), more], axis=1)
    return p.distance_given - length - shift[:, 0], by, columns


def add_distances(normal, p: Problem, state: State, matrix: bool | None) -> float:
    """Add the distances to what images share (matrix None: nothing); twice their cost.

    A robust loss is theirs too, in their own standard deviations: beside image points that give
    way, a wrong distance would draw its ends to itself, and look right.
    """
    if not len(p.distance_given):
        return 0.0
    residual, by, columns = distance_rows(p, state)
    loss = normal.loss._replace(width=max(normal.loss.width, Loss().width))
    cost, soft = robust(loss, p.distance_weight * residual**2)
    weights = p.distance_weight * soft**2
    if matrix is not None:
        np.add.at(normal.shared_gradient, columns, by * (weights * residual)[:, None])
    if matrix:
        for row, at, weight in zip(by, columns, weights, strict=True):
            block = weight * np.outer(row, row)
            lower = np.where(at[:, None] >= at, block, 0.0)
            np.add.at(normal.shared_block, (at[:, None], at), lower)
            np.add.at(normal.shared_reference, at, np.diag(block))
    return float(np.sum(cost))


def ends_at_points(p: Problem, state: State) -> State:
    """The state with the coordinates of the ends where their points are."""
    if not p.end_names:
        return state
    at = np.flatnonzero(p.control >= len(p.control_rows))
    ends = np.empty_like(p.end_start)
    ends[p.control[at] - len(p.control_rows)] = state.points[at]
    return replace(state, effects=state.effects | {ENDS: p.end_start - ends})


def scale_of(p: Problem, state: State) -> float:
    """By how much the points are too small for the distances: the median ratio, of the longer
    half."""
    _, length = _apart(p, state)
    return float(np.median((p.distance_given / length)[length >= np.median(length)]))


def table_of(p: Problem, state: State, covariance: Covariance, sigma0: float) -> pd.DataFrame:
    """Each distance with its test: from, to, given, sigma, v (given minus adjusted), m, redundancy,
    w, least_error (found with 80 % where one good of a thousand is accused), m.
    """
    from corridor.core.adjustment.reliability import DELTA

    residual, _, whole = tested(p, state, covariance)
    share = np.diag(whole)
    root = np.sqrt(np.where(share > 0.0, share, np.nan))
    sigma = p.distance_weight**-0.5
    frame = ends_named(p)
    frame["given"], frame["sigma"], frame["v"] = p.distance_given, sigma, sigma * residual
    frame["s_adjusted"] = sigma0 * sigma * np.sqrt(1.0 - share)
    frame["redundancy"] = share
    frame["w"] = residual / root
    frame["least_error"] = np.where(share > 0.0, DELTA * sigma / root, np.inf)
    return with_units(frame, {"m": "given sigma v s_adjusted least_error"})


def ends_named(p: Problem) -> pd.DataFrame:
    """The ends of each distance."""
    return p.block.distances.iloc[p.distance_rows][["from", "to"]].reset_index(drop=True)


def tested(
    p: Problem, state: State, covariance: Covariance
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (k,) of the distances, what they see of the shared unknowns (k, q) and their
    cofactors (k, k), in their standard deviations; zero of those that nothing else shows."""
    from corridor.core.adjustment.reliability import LEAST_SHOWN_SHARE

    root = np.sqrt(p.distance_weight)
    rows = np.zeros((len(root), len(covariance.shared)))
    if not len(root):
        return root, rows, np.zeros((0, 0))
    residual, by, columns = distance_rows(p, state)
    np.add.at(rows, (np.arange(len(root))[:, None], columns), root[:, None] * by)
    share = np.eye(len(root)) - rows @ covariance.shared @ rows.T
    shown = np.diag(share) > max(LEAST_SHOWN_SHARE, 10.0 / TIGHT)
    rows[~shown] = 0.0
    return root * residual, rows, np.where(shown[:, None] & shown, share, 0.0)
