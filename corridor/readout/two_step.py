"""The two-step correction: adjust blind, find velocities, take the shutter out, adjust again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from corridor import adjustment as least_squares
from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.brief import brief
from corridor.effects import correct
from corridor.preparation import Velocities, velocities


@brief
@dataclass
class TwoStep:
    """What the correction did.

    before, after: adjustments of the measured and of the corrected block. velocities: the ones
    that were used. block: corrected measurements with the poses of `before`.
    """

    before: Adjustment
    after: Adjustment
    velocities: Velocities
    block: Block

    @property
    def gain(self) -> float:
        """By how much the 3D RMS of the check points became smaller, as a share of it before."""
        return 1.0 - self.after.check_rms.d3 / self.before.check_rms.d3


def two_step(
    block: Block,
    values: Mapping[str, Mapping | None],
    velocity: str = "auto",
    before: Adjustment | None = None,
    **options,
) -> TwoStep:
    """Correct the measurements of a block for effects of motion, and adjust before and after.

    values: `{slug: {parameter: number}}`, None for what the block states. velocity: see
    `velocities`. before: a blind adjustment that is there already. options: of `adjust`, the same
    for both.

    With pi(O, P) the point P in the picture at the pose O of the middle row, and O_c the pose of
    the row that shows it, an observation p becomes p - [pi(O_c, P) - pi(O, P)]: where the
    picture would show it had all rows been exposed at once. (Zhou 2019, section 7.5; read
    literally, its eq. 7.16 with 7.11 adds the difference and doubles the error when row l is
    exposed at tau (l - L/2) / L.)
    Raises what `adjust`, `velocities` and `correct` raise.
    """
    before = least_squares.adjust(block, **options) if before is None else before
    found = velocities(before.block, velocity)
    corrected = correct(found.on(before.block), values, str(found).splitlines(), velocity=None)
    return TwoStep(before, least_squares.adjust(corrected, **options), found, corrected)
