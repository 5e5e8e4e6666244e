"""What photographs say of themselves, and what is published of the cameras that took them.

The one reader of EXIF and XMP; it knows no block. A new source is a module beside `exif`, `xmp` and
`maker_note`, asked by `metadata`.
"""

from corridor.core.photographs.metadata import (
    SUFFIXES,
    Metadata,
    Taken,
    photographs_in,
    read_metadata,
)
from corridor.core.photographs.opening import FAULTS, MOST_PIXELS, fault, open_picture
from corridor.core.photographs.published import (
    GlobalShutter,
    PublishedReadout,
    global_shutter,
    of_picture,
    plain_name,
    published_readouts,
    published_table,
)
from corridor.core.registry import offered

__all__ = offered(globals())
