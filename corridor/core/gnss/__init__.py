"""The antenna's track: reading it, its coordinates, and where the antenna was at each exposure."""

from corridor.core.gnss.alignment import Alignment, align
from corridor.core.gnss.antenna_positions import Antenna, antenna, frame_of_block, of_block
from corridor.core.gnss.coordinates import (
    Local,
    convert,
    geographic_positions,
    known_crs,
    to_local,
)
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.formats.exif import photographs_in
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
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, QUALITY, Track, check_quality

__all__ = [
    "CORRELATION_S",
    "GEOCENTRIC",
    "GEOGRAPHIC",
    "MAX_SIGMA_M",
    "METHODS",
    "QUALITY",
    "SLOW_SHARES",
    "Alignment",
    "Antenna",
    "Exposures",
    "Interpolated",
    "Interpolation",
    "Local",
    "SlowNoise",
    "Track",
    "align",
    "antenna",
    "check_quality",
    "convert",
    "frame_of_block",
    "geographic_positions",
    "interpolate",
    "known_crs",
    "of_block",
    "photographs_in",
    "read_exposures",
    "read_track",
    "segments",
    "to_local",
]


def __dir__():
    return sorted(__all__)
