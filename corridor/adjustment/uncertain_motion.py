"""Velocities are believed as well as they are known: what they are off, each image has for itself.

While its rows are read, image i moves by r v_i + m_i: r the readout time, v_i the velocity that the
block states, and m_i what the velocity is off, an unknown of that image with the prior

    m_i ~ N(0, (r s_i)^2),    s_i: the standard deviation svx, svy, svz (and swx, swy, swz of turns)

A velocity that was smoothed from positions is an expected value, of which the true one is
independent (Berkson's errors): then the estimate of r has no attenuation, and its variance holds,
because the m_i are estimated with it. r in the prior is the one of the adjustment before.

Source: Fuller 1987, sections 1.1 and 1.6.3 (error models); Carroll et al. 2006, chapter 4
(regression calibration); Förstner 1979 (v'Pv / r: how much of s_i the pictures confirm).
"""

from __future__ import annotations

import numpy as np

from corridor.adjustment.model import Model
from corridor.block import Block
from corridor.effects import Effect, every_effect

VELOCITY_SIGMA, RATE_SIGMA = ("svx", "svy", "svz"), ("swx", "swy", "swz")
# Of a shutter that nobody knows.
USUAL_S = 0.030
# Smaller deviations of a velocity than a millimetre a second are none.
_LEAST_M_S, _LEAST_RAD_S = 1e-3, 1e-6


def moves_by_velocity(effects: list[Effect]) -> bool:
    """Whether one of them moves the camera during the readout by the velocity of its image."""
    return any(e.place == "motion" and "images.vx" in (*e.needs, *e.takes) for e in effects)


def free_motion(block: Block, effects: list[Effect]) -> Effect | None:
    """The unknowns of each image beside effects that move it by its velocity; None: none needed.

    Turns are among them where the block has the deviations of angular rates.
    """
    if not moves_by_velocity(effects) or not np.any(_sigma(block, VELOCITY_SIGMA) > 0):
        return None
    if any(e.place == "motion" and e.group == "image" for e in effects):
        return None  # They are free already.
    wanted = 6 if np.any(_sigma(block, RATE_SIGMA) > 0) else 3
    free = [e for e in every_effect() if e.place == "motion" and e.generic and e.group == "image"]
    return next(e for e in free if len(e.parameters(block)) == wanted)


def prior_sigma(block: Block, count: int, model: Model) -> np.ndarray:
    """Standard deviation (images, count) of the unknowns of `free_motion`, m and rad."""
    moved = np.fmax(np.nan_to_num(_sigma(block, VELOCITY_SIGMA)), _LEAST_M_S)
    turned = np.fmax(np.nan_to_num(_sigma(block, RATE_SIGMA)), _LEAST_RAD_S)
    move_s, turn_s = model.motion_s or (USUAL_S, USUAL_S)
    return np.hstack([moved * move_s, turned * turn_s])[:, :count]


def _sigma(block: Block, columns: tuple[str, ...]) -> np.ndarray:
    return np.stack([block.column("images", axis) for axis in columns], axis=1)
