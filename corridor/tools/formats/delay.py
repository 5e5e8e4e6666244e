"""How late the positions of photographs are, by the camera's way through its own positions.

Mapped centres and logged positions differ by a similarity, by noise, and, where a position is that
of another moment than the picture's, by the way flown in between: along the flight, to and fro with
the strips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from corridor.core.block import Block
from corridor.core.geometry import helmert_motions, robust_scale
from corridor.core.preparation import CONTRADICTS, Witness, record_derived, track_runs
from corridor.tools.formats.project import Project

# A delay of so many sigmas is told; one that is shorter is that of any receiver.
_SIGMAS, _LEAST_S, _FEWEST = 5.0, 0.3, 10
# Positions are those of one time constant of a receiver's filter, or of the flight's turns, alike.
_PARTS = 5


class Delay(NamedTuple):
    """seconds: of how much later a moment than the picture's positions are; below 0 they are late,
    as positions of an earlier moment are. sigma: s."""

    seconds: float
    sigma: float


def with_delay_told(project: Project) -> Project:
    """The project with a warning where its positions are late, or early, with the value."""
    found = delay_of(project.block)
    if found is None or abs(found.seconds) < max(_SIGMAS * found.sigma, _LEAST_S):
        return project
    late, when = ("late", "before") if found.seconds < 0 else ("early", "after")
    told = (
        f"the positions of the photographs are {abs(found.seconds):.1f} +- {found.sigma:.1f} s "
        f"{late}: each lies where the camera was so long {when} its picture, by its own way from "
        "picture to picture; `corridor adjust BLOCK --effect clock_offset` estimates it with the "
        "rest"
    )
    block = project.block.copy()
    way = Witness("the mapped way", CONTRADICTS, f"{found.seconds:+.1f} s")
    record_derived(
        block, "moments of gnss.csv", "the photographs' own positions", np.array([found.sigma]),
        f"{told[0].upper()}{told[1:]}.", "s", [way],
    )  # fmt: skip
    return project.having(warnings=[told], extra=block.extra)


def delay_of(block: Block) -> Delay | None:
    """By how much the positions of gnss.csv are those of a later moment than images.csv says.

    None where fewer than ten images of two directions have times, poses and positions. The sigma
    is of parts of the flight left out in turn: errors of a receiver are alike for a minute.
    """
    time, centre = block.column("images", "time_s"), block.numbers("images", *"xyz")
    place = np.full(centre.shape, np.nan)
    rows = block.image_rows("gnss")
    place[rows[rows >= 0]] = block.numbers("gnss", *"xyz")[rows >= 0]
    known = np.isfinite(centre).all(axis=1) & np.isfinite(place).all(axis=1) & np.isfinite(time)
    if known.sum() < _FEWEST:
        return None
    velocity = np.full(centre.shape, np.nan)
    for run in track_runs(block, np.where(known, time, np.nan), centre, []):
        run = run[known[run]]
        if len(run) > 2 and (np.diff(time[run]) > 0).all():
            velocity[run] = np.gradient(centre[run], time[run], axis=0)
    used = known & np.isfinite(velocity).all(axis=1)
    if used.sum() < _FEWEST:
        return None
    order = np.flatnonzero(used)[np.argsort(time[used], kind="stable")]
    off, way = (place - centre)[order], velocity[order]
    design = np.concatenate([helmert_motions(centre[order]), way[:, :, None]], axis=2)[:, :2]
    off = off[:, :2]
    every = _fitted(design, off)
    if every is None:
        return None
    parts = np.array_split(np.arange(len(order)), min(_PARTS, len(order) // 4))
    left = [_fitted(np.delete(design, part, 0), np.delete(off, part, 0)) for part in parts]
    left = np.array([one[0] for one in left if one is not None])
    if len(left) < 3:
        return None
    # Of a jackknife with parts left out (Shao and Tu 1995, eq. 2.9).
    spread = np.sqrt((len(left) - 1) / len(left) * np.sum((left - left.mean()) ** 2))
    return Delay(every[0], float(max(spread, every[1])))


def _fitted(design: np.ndarray, off: np.ndarray) -> tuple[float, float] | None:
    """The delay and its formal sigma, robustly; None where one direction tells none.

    design: (n, 2, 8), off: (n, 2).
    """
    a, b = design.reshape(-1, design.shape[2]), off.reshape(-1)
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-12)
    weight = np.ones(len(b))
    for _ in range(15):
        root = np.sqrt(weight)[:, None]
        u, singular, vt = np.linalg.svd(root * a / scale, full_matrices=False)
        good = singular > 1e-6 * singular[0]
        inverse = vt[good].T / singular[good]
        found = inverse @ (u[:, good].T @ (root[:, 0] * b))
        residual = b - a / scale @ found
        typical = max(float(robust_scale(residual, centred=False)), 1e-9)
        weight = 1.0 / (1.0 + (residual / (2 * typical)) ** 2)
    # A direction without a delay of its own: what is open in it is open in the delay.
    if not good.all() and np.abs(vt[~good, -1]).max() > 0.1:
        return None
    sigma = typical * np.sqrt(np.sum(inverse[-1] ** 2)) / scale[-1]
    return float(found[-1] / scale[-1]), float(sigma)
