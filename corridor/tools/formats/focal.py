"""The focal length that a photograph states, in pixels.

Source: EXIF 2.32 (CIPA DC-008); Pix4D, "Specifications of xmp.camera tags"; DJI, "Guide to image
processing of the P4 Multispectral" (DewarpData, CalibratedFocalLength).
"""

from typing import NamedTuple

import numpy as np

from corridor.core.photographs import Metadata

# The 35 mm equivalent is of the picture's diagonal (43.27 mm) by some makers, of its width (36 mm)
# by others: for a picture of 4:3 these are 34.6 and 36 mm of width. The middle is within 2 %. Of a
# picture of 16:9 the diagonal may be its own (37.7 mm of width) or the sensor's.
_WIDTH_35, _SHAPE = 35.3, 1.5
# Relative standard deviations: a lens differs from its nominal focal length by a per cent or two,
# a maker's calibration of the single camera by less.
_MAKERS, _NOMINAL, _OF_35, _OF_35_WIDE = 0.01, 0.02, 0.025, 0.045


class StatedFocal(NamedTuple):
    """px: of the stored picture; sigma_px: its standard deviation. of: what says so."""

    px: float
    of: str
    sigma_px: float


def stated_focal(photo: Metadata, width: int | None = None) -> StatedFocal | None:
    """The focal length that a photograph states; None where it states none.

    width: of the pictures in question, px, where they are smaller than the stored one.
    """
    width = width or max(photo.width, photo.height_px)
    taken = max(photo.taken_size)
    maker = photo.number("PerspectiveFocalLength")
    single, nominal = _dewarp(photo), photo.number("CalibratedFocalLength")
    if single:
        said = StatedFocal(single / taken, "the maker's calibration, DewarpData in XMP", _MAKERS)
    elif nominal and nominal > 0:
        said = StatedFocal(nominal / taken, "the maker's CalibratedFocalLength in XMP", _NOMINAL)
    elif maker and maker > 0 and photo.pixels_per_mm:
        said = StatedFocal(maker * photo.pixels_per_mm / taken, "the maker's in XMP", _MAKERS)
    elif photo.focal_35_mm:
        width_over_height = taken / min(photo.taken_size)
        # Millimetres of 35 mm film are whole ones.
        rounding = 1 / np.sqrt(12) / photo.focal_35_mm
        sigma = _OF_35 if width_over_height < _SHAPE + 0.01 else _OF_35_WIDE
        sigma = float(np.hypot(sigma, rounding))
        said = StatedFocal(photo.focal_35_mm / _WIDTH_35, "EXIF's, of 35 mm film", sigma)
    elif photo.focal_mm and photo.pixels_per_mm:
        said = StatedFocal(photo.focal_mm * photo.pixels_per_mm / taken, "EXIF's", _NOMINAL)
    else:
        return None
    if not of_a_lens(said.px):
        return None
    px = said.px * width
    return said._replace(px=px, sigma_px=said.sigma_px * px)


def of_a_lens(focal: float) -> bool:
    """Whether a focal length, of the picture's long side, is of a lens of a survey, no mistake."""
    return 0.2 < focal < 20


def _dewarp(photo: Metadata) -> float | None:
    """The focal length, px of the picture as taken, of DJI's calibration of the single camera.

    DewarpData: the day; fx, fy, cx, cy (from the middle of the picture), k1, k2, p1, p2, k3.
    """
    numbers = photo.tags.get("DewarpData", "").rpartition(";")[2].split(",")
    try:
        fx, fy = float(numbers[0]), float(numbers[1])
    except (ValueError, IndexError):
        return None
    found = (fx + fy) / 2
    return found if np.isfinite(found) and found > 0 and abs(fx / fy - 1) < 0.05 else None
