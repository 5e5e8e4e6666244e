"""From a track to the antenna at the moments of exposure, with a sigma that holds."""

from corridor.core.gnss.interpolation.interpolating import (
    MAX_SIGMA_M,
    METHODS,
    Interpolated,
    Interpolation,
    interpolate,
)
from corridor.core.gnss.interpolation.regimes import CORRELATION_S, SLOW_SHARES
from corridor.core.gnss.interpolation.segmenting import segments
