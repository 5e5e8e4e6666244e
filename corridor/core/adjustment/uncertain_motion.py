"""Velocities are believed as well as they are known: what they are off is estimated beside them.

While its rows are read, image i moves by r v_i + k d_i + m_i: r the readout time, v_i the velocity
that the block states, d_i an error of one sigma that all velocities may have together (columns
dvx, dvy, dvz), m_i what each is off by itself. k and the m_i are unknowns with the priors

    k ~ N(0, r^2),   m_i ~ N(0, (r s_i)^2),   s_i: the standard deviations svx, svy, svz

and the same of turns by swx, swy, swz. A velocity derived as a mean between two positions is an
expected value, of which the true one is independent (Berkson's errors): the estimate of r is not
attenuated, and its variance holds because k and the m_i are estimated with it. r in the priors
is that of the adjustment before, and s_i are as large as the pictures say: all smaller by a factor,
or all with the same more (`as_seen`).

Source: Fuller 1987, sections 1.1 and 1.6.3 (error models); Carroll et al. 2006, chapter 4
(regression calibration); Förstner 1979 (v'Pv / r: how much of s_i the pictures confirm).
"""

from typing import NamedTuple

import numpy as np

from corridor.core.block import Block
from corridor.core.effects import (
    COMMON,
    RATE_SIGMA,
    VELOCITY_SIGMA,
    CommonVelocityError,
    Effect,
    OwnVelocityError,
)

# Smaller deviations of a velocity than a millimetre a second are none.
_LEAST_M_S, _LEAST_RAD_S = 1e-3, 1e-6


class MotionScale(NamedTuple):
    """By what deviations of velocities count: the readout time, s, and a factor on the usual one of
    an image, of velocities and of angular rates."""

    readout: float = 0.030
    moved: float = 1.0
    turned: float = 1.0


def velocity_errors(block: Block, effects: list[Effect]) -> list[Effect]:
    """The errors to be estimated beside effects that move images by their velocity; [] for none."""
    if not any(e.during_readout and "images.vx" in (*e.needs, *e.takes) for e in effects):
        return []
    out: list[Effect] = []
    if np.any(_numbers(block, COMMON) != 0):
        out.append(CommonVelocityError())
    moved, turned = (np.any(_numbers(block, of) > 0) for of in (VELOCITY_SIGMA, RATE_SIGMA))
    # A motion of each image, whoever asked for it, takes what its velocity is off.
    own = any(e.during_readout and e.group == "image" for e in effects)
    if (moved or turned) and not own:
        of_images = OwnVelocityError()
        of_images.turns = bool(turned)
        out.append(of_images)
    return out


def prior_sigma(block: Block, effect: Effect, scale: MotionScale) -> np.ndarray:
    """Standard deviations (images, parameters) of an error's unknowns, m and rad; s of the common
    one (1, 1)."""
    if isinstance(effect, CommonVelocityError):
        return np.full((1, 1), scale.readout)
    moved = np.maximum(as_seen(_numbers(block, VELOCITY_SIGMA), scale.moved), _LEAST_M_S)
    turned = np.maximum(as_seen(_numbers(block, RATE_SIGMA), scale.turned), _LEAST_RAD_S)
    return scale.readout * (
        np.hstack([moved, turned]) if getattr(effect, "turns", False) else moved
    )


def as_seen(sigma: np.ndarray, factor: float) -> np.ndarray:
    """Deviations (images, 3) that are as large as stated times a factor below one.

    More than is stated is motion that nobody knows of, which all images have alike: it makes the
    usual deviation `factor` times as large, and leaves a large one what it is.
    """
    if factor <= 1.0:
        return factor * sigma
    usual = float(np.median(np.sqrt(np.mean(sigma**2, axis=1))))
    return np.sqrt(sigma**2 + (factor**2 - 1.0) * usual**2)


def _numbers(block: Block, columns: tuple[str, ...]) -> np.ndarray:
    return np.nan_to_num(np.stack([block.column("images", axis) for axis in columns], axis=1))
