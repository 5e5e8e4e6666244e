"""The antenna's track: reading it, its coordinates, and where the antenna was at each exposure."""

from corridor.core.gnss.alignment import Alignment, align
from corridor.core.gnss.antenna_positions import Antenna, antenna, frame_of_block, of_block
from corridor.core.gnss.coordinates import (
    Local,
    convert,
    geographic_positions,
    known_crs,
    outside_area,
    to_local,
)
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.formats.exif import names_in, of_photographs
from corridor.core.gnss.frames import FRAME as LOCAL_FRAME
from corridor.core.gnss.frames import (
    about_the_middle,
    convert_within,
    grid_distortion,
    in_metres,
    in_world,
    local_of,
    loose_way,
    metric,
    places_of,
    world_crs,
)
from corridor.core.gnss.interpolation import (
    CORRELATION_S,
    MAX_SIGMA_M,
    METHODS,
    SLOW_SHARES,
    Interpolated,
    Interpolation,
    interpolate,
    segments,
)
from corridor.core.gnss.reading import read_exposures, read_track
from corridor.core.gnss.slow_noise import SlowNoise
from corridor.core.gnss.text import degrees
from corridor.core.gnss.time import DAY_S, days_between
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track, check_quality
from corridor.core.registry import offered

__all__ = offered(globals())
