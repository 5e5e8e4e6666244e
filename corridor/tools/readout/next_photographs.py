"""Which photographs, taken on top of a flight, would tell the camera's readout time."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from corridor.core.adjustment import Adjustment, Covariance, LinearSystem, Loss, make_problem
from corridor.core.block import VELOCITY, Block
from corridor.core.effects import COMMON, RATE_SIGMA, VELOCITY_SIGMA
from corridor.core.errors import InputError
from corridor.tools.readout.motion import Motion

COUNT = 4
_NEW = "next_"
# A hovering drone's speed, and one that is read from a steady flight, m/s.
_KNOWN_M_S = 0.1


@dataclass(frozen=True)
class Advice:
    """COUNT photographs and the sigma of the readout, s, that they would bring it to.

    how: a sentence's part: "hovering", ... images: of the flight, where to take them again.
    """

    how: str
    images: tuple[str, ...]
    sigma: float


def advice(adjustment: Adjustment, motion: Motion, number: int, widened: float) -> Advice | None:
    """The best of three ways to take four photographs of the flight again.

    Hovering, flown back along the strip, or across it, all with the heading that the camera had:
    what each brings follows from the equations. motion: in the order of images.csv. number: of the
    readout among what images share. widened: honest over formal sigma. None where no image moved.
    """
    block = adjustment.block
    rows = _spread(block, motion)
    if rows is None:
        return None
    moved = motion.velocity[rows]
    level = np.stack([-moved[:, 1], moved[:, 0], np.zeros(COUNT)], axis=1)
    ways = {
        "while the drone hovers": 0 * moved,
        "while the drone flies back along the strip without turning": -moved,
        "while the drone flies across the strip without turning": level,
    }
    names = tuple(block.images["image"].iloc[rows].astype(str))
    best = None
    for how, velocity in ways.items():
        try:
            sigma = _with(adjustment, block, number, rows, velocity)
        except InputError:
            continue
        if best is None or sigma * widened < best.sigma:
            best = Advice(how, names, sigma * widened)
    return best


def _spread(block: Block, motion: Motion) -> np.ndarray | None:
    """Rows of COUNT moving images with many points, far from each other."""
    points = block.tie_points["image"].astype(str).value_counts()
    count = points.reindex(block.images["image"].astype(str)).fillna(0).to_numpy()
    speed = np.linalg.norm(motion.velocity, axis=1)
    good = np.flatnonzero((count >= np.median(count)) & (speed >= np.median(speed)))
    if len(good) < COUNT or not speed[good].max() > 0:
        return None
    place = block.numbers("images", *"xyz")[good]
    chosen = [int(np.argmin(np.linalg.norm(place - place.mean(axis=0), axis=1)))]
    while len(chosen) < COUNT:
        away = np.linalg.norm(place[:, None] - place[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(away)))
    return good[chosen]


def _with(adjustment, block, number, rows, velocity) -> float:
    """Sigma of the readout, s, of the flight with images taken again at other velocities."""
    again = block.images.iloc[rows].copy()
    old = again["image"].astype(str)
    again["image"] = _NEW + old
    again[list(VELOCITY)] = velocity
    again[list(VELOCITY_SIGMA)] = _KNOWN_M_S
    again[list(COMMON)] = 0.0
    again[list(RATE_SIGMA)] = block.numbers("images", *RATE_SIGMA).min(axis=0)
    ties = block.tie_points.assign(image=block.tie_points["image"].astype(str))
    more = ties[ties["image"].isin(old)].copy()
    more["image"] = _NEW + more["image"]
    images = pd.concat([block.images, again], ignore_index=True)
    ties = pd.concat([ties, more], ignore_index=True)
    ties["image"] = pd.Categorical(ties["image"], categories=images["image"].astype(str))
    rates = block.rates
    if "image" in rates:
        # The camera turns as it did: whoever takes the photographs again flies as before.
        turned = rates[rates["image"].astype(str).isin(old)]
        turned = turned.assign(image=_NEW + turned["image"].astype(str))
        rates = pd.concat([rates, turned], ignore_index=True)
    whole = replace(block.copy(), images=images, tie_points=ties, rates=rates)
    problem = make_problem(whole, adjustment.problem.model)
    system = LinearSystem(problem, problem.start, Loss.parse(problem.model.loss))
    return float(adjustment.sigma0 * np.sqrt(Covariance(system).shared[number, number]))
