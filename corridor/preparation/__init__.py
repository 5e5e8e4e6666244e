"""What a block can know by itself: velocities, angular rates, antenna positions."""

from corridor.preparation.angular_rate import rates_from_gyro, rates_from_neighbours
from corridor.preparation.preparing import Prepared, prepare
from corridor.preparation.record import Derived, derived
from corridor.preparation.record import record as record_derived
from corridor.preparation.slips import against, doubts, stray, unlike
from corridor.preparation.smoothing import rounding
from corridor.preparation.strips import strips_of, track_runs
from corridor.preparation.velocity import METHODS, Velocities, velocities

__all__ = [
    "METHODS",
    "Derived",
    "Prepared",
    "Velocities",
    "against",
    "derived",
    "doubts",
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
]
