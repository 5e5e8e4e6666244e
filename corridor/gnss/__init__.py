"""The antenna's track: reading it, its coordinates, and where the antenna was at each exposure."""

from corridor.gnss.alignment import Alignment, align
from corridor.gnss.antenna import Antenna, antenna, frame_of_block, of_block
from corridor.gnss.coordinates import (
    Local,
    convert,
    geographic_positions,
    known_crs,
    to_local,
)
from corridor.gnss.exposures import Exposures
from corridor.gnss.formats.exif import photographs_in
from corridor.gnss.interpolation import (
    CORRELATION_S,
    MAX_SIGMA_M,
    METHODS,
    SLOW_SHARES,
    Interpolated,
    Interpolation,
    interpolate,
    segments,
)
from corridor.gnss.reading import read_exposures, read_track
from corridor.gnss.slow_noise import SlowNoise
from corridor.gnss.track import GEOCENTRIC, GEOGRAPHIC, QUALITY, Track, check_quality

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
