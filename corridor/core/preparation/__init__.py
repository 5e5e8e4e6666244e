"""What a block can know by itself: velocities, angular rates, antenna positions."""

from corridor.core.preparation.angular_rate import rates_from_neighbours
from corridor.core.preparation.half_turns import (
    as_posed,
    quarters_of,
    sampled,
    turned_back,
    turned_by,
    turned_images,
    without_starts,
)
from corridor.core.preparation.plausibility import (
    AXES,
    coarse_sigmas,
    marks_of_another_size,
    mirrored,
    passed_over,
    plausibility_warnings,
    position_difference,
    position_disagreement,
    position_outliers,
    without_impossible_points,
)
from corridor.core.preparation.plausibility_of_motion import paired_speeds, velocity_warnings
from corridor.core.preparation.plausibility_of_rows import astray
from corridor.core.preparation.preparing import Prepared, prepare
from corridor.core.preparation.record import (
    AGREES,
    ARBITRARY,
    CONTRADICTS,
    FRAME,
    UNCHECKED,
    Derived,
    Witness,
    contradicted,
    derived,
    derived_table,
)
from corridor.core.preparation.record import record as record_derived
from corridor.core.preparation.smoothing import rounding, unrounded
from corridor.core.preparation.strips import strips_of, track_runs
from corridor.core.preparation.units import (
    LARGE_UNITS,
    UNITS_M,
    apart,
    apart_in_shape,
    other_unit,
    unit_of,
)
from corridor.core.preparation.velocity import METHODS, Velocities, times, velocities
