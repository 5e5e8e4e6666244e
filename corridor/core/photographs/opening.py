"""The one way in which pictures are opened: by formats that are meant, up to a number of pixels.

Pillow tells a format by the content of a file, whatever its name is, and has some forty readers;
the one of PostScript starts Ghostscript, which runs what the file says. So a picture of a stranger
is opened by no reader but those of a camera's formats.
"""

import os
import struct
from typing import BinaryIO

from PIL import Image, UnidentifiedImageError

# A JPEG with several pictures in it (MPO) and a DNG are opened by these as well.
FORMATS = ("JPEG", "PNG", "TIFF")
# The largest sensor of an aerial camera in one piece has 14204 x 10652 = 151 million pixels (Phase
# One iXM-RS150F). Decoded in colour such a picture takes half a gigabyte.
MOST_PIXELS = 160_000_000
# What Pillow raises on damaged files.
FAULTS = (
    OSError, SyntaxError, ValueError, KeyError, TypeError, IndexError, OverflowError,
    AttributeError, struct.error, Image.DecompressionBombError,
)  # fmt: skip


def open_picture(
    source: str | os.PathLike | BinaryIO, most_pixels: int = MOST_PIXELS
) -> Image.Image:
    """A picture whose head is read and whose pixels are not yet; close it, or use `with`.

    source: a file, or a stream of its bytes. most_pixels: width times height, beyond which it is
    refused. Of a PNG, EXIF alone already takes all pixels: it may stand at the end.
    Raises one of FAULTS where it is no JPEG, PNG or TIFF, or larger; `fault` puts it in words.
    """
    picture = Image.open(source, formats=FORMATS)
    width, height = picture.size
    if width * height > most_pixels:
        picture.close()
        raise ValueError(
            f"{width} x {height} pixels are more than the {most_pixels / 1e6:g} million that are "
            "read"
        )
    return picture


def fault(error: Exception) -> str:
    """Why a picture cannot be opened or decoded, for the brackets of a sentence."""
    if isinstance(error, UnidentifiedImageError):
        return "no picture of these formats is in it: JPEG, PNG, TIFF"
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
