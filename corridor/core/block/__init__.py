"""The block: one flight, or several, as plain tables. Read, check, select, write, summarise."""

from corridor.core.block.attitudes import level_axes
from corridor.core.block.block import EXACT_M, Block, files_of, is_block, read, with_equal_axes
from corridor.core.block.corners import corner_rays, footprints
from corridor.core.block.correlation import (
    RHO,
    along_axes,
    correlations,
    covariance_of,
    covariances,
    independent,
    made_possible,
    possible,
    turned,
)
from corridor.core.block.reading import place, read_columns, row_numbers
from corridor.core.block.record import forget_correction, record_correction, taken_out
from corridor.core.block.rigs import (
    EXPOSURE,
    Mounting,
    as_mounted,
    base_poses,
    exposures_of,
    members_of,
    mountings_of,
    relative,
    rigs_of,
    seen_together,
    with_rigid_poses,
)
from corridor.core.block.settings import SIGMA
from corridor.core.block.summary import Summary
from corridor.core.block.tables import (
    ANGLE_SIGMAS,
    ANGLES,
    LAYOUTS,
    POSE,
    QUATERNION,
    RATES,
    ROLES,
    SIGMAS,
    VELOCITY,
    Layout,
    frugal,
    is_among,
    places,
    values_of,
)
