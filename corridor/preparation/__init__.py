"""What a block can know by itself: velocities, angular rates, antenna positions."""

from corridor.preparation.angular_rate import rates_from_gyro, rates_from_neighbours
from corridor.preparation.preparing import Prepared, prepare
from corridor.preparation.record import (
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
from corridor.preparation.record import record as record_derived
from corridor.preparation.slips import against, doubts, stray, unlike
from corridor.preparation.slips_of_motion import paired_speeds, velocity_doubts
from corridor.preparation.smoothing import rounding
from corridor.preparation.strips import strips_of, track_runs
from corridor.preparation.velocity import METHODS, Velocities, velocities

__all__ = [
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
    "paired_speeds",
    "prepare",
    "rates_from_gyro",
    "rates_from_neighbours",
    "record_derived",
    "rounding",
    "stray",
    "strips_of",
    "track_runs",
    "unlike",
    "velocities",
    "velocity_doubts",
]
