"""The focal length that a photograph states, in pixels.

Source: EXIF 2.32 (CIPA DC-008); Pix4D, "Specifications of xmp.camera tags".
"""

from __future__ import annotations

from typing import NamedTuple

from corridor.core.photographs.metadata import Metadata

# The 35 mm equivalent is of the picture's diagonal (43.27 mm) by some makers, of its width (36 mm)
# by others: for a picture of 4:3 these are 34.6 and 36 mm of width. The middle is within 2 %.
_WIDTH_35 = 35.3
# Relative standard deviations: a lens differs from its nominal focal length by a per cent or two,
# a maker's calibration of the single camera by less; millimetres of 35 mm film are whole ones, and
# of the diagonal or the width.
_MAKERS, _NOMINAL, _OF_35 = 0.01, 0.02, 0.03


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
    if maker and maker > 0 and photo.pixels_per_mm:
        said = StatedFocal(maker * photo.pixels_per_mm / taken, "the maker's in XMP", _MAKERS)
    elif photo.focal_35_mm:
        said = StatedFocal(photo.focal_35_mm / _WIDTH_35, "EXIF's, of 35 mm film", _OF_35)
    elif photo.focal_mm and photo.pixels_per_mm:
        said = StatedFocal(photo.focal_mm * photo.pixels_per_mm / taken, "EXIF's", _NOMINAL)
    else:
        return None
    # Of the picture's long side; beyond this it is no lens of a survey but a mistake.
    if not 0.2 < said.px < 20:
        return None
    px = said.px * width
    return said._replace(px=px, sigma_px=said.sigma_px * px)
