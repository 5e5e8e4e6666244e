"""What a block can know by itself: velocities, angular rates, antenna positions."""

from corridor.core.preparation.angular_rate import rates_from_gyro, rates_from_neighbours
from corridor.core.preparation.half_turns import (
    quarters_of,
    turned_back,
    turned_by,
    turned_images,
    without_turned_starts,
)
from corridor.core.preparation.plausibility import (
    SLOWEST_READOUT_S,
    against,
    doubts,
    mirrored,
    stray,
    unlike,
)
from corridor.core.preparation.plausibility_of_motion import paired_speeds, velocity_doubts
from corridor.core.preparation.preparing import Prepared, prepare
from corridor.core.preparation.record import (
    AGREES,
    ARBITRARY,
    CONTRADICTS,
    FRAME,
    UNCHECKED,
    Derived,
    Witness,
    derived,
    derived_table,
)
from corridor.core.preparation.record import record as record_derived
from corridor.core.preparation.smoothing import rounding, unrounded
from corridor.core.preparation.strips import strips_of, track_runs
from corridor.core.preparation.velocity import METHODS, Velocities, velocities

__all__ = [
    "SLOWEST_READOUT_S",
    "AGREES",
    "ARBITRARY",
    "CONTRADICTS",
    "FRAME",
    "METHODS",
    "UNCHECKED",
    "Derived",
    "Prepared",
    "Velocities",
    "Witness",
    "against",
    "derived",
    "derived_table",
    "doubts",
    "mirrored",
    "paired_speeds",
    "prepare",
    "quarters_of",
    "rates_from_gyro",
    "rates_from_neighbours",
    "record_derived",
    "rounding",
    "stray",
    "strips_of",
    "track_runs",
    "turned_back",
    "turned_by",
    "turned_images",
    "unlike",
    "unrounded",
    "velocities",
    "velocity_doubts",
    "without_turned_starts",
]
