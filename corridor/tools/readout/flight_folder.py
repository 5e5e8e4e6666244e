"""The folder of what a flight tells of a readout time: page, picture and numbers."""

import os
from pathlib import Path

from corridor.core import registry
from corridor.core.output import check_folder, png, whole_folder, write_json
from corridor.tools.readout.flight_report import (
    PICTURE,
    FlightReadout,
    published_value,
    report_of,
    to_dict,
)

_PAGE = "report.html"
# A readout that was not told is none: whoever reads readout.json finds no number.
_RESULT = {True: "readout.json", False: "refused.json"}
_OURS = (_PAGE, PICTURE, *_RESULT.values())


def can_save_flight(folder: str | os.PathLike) -> None:
    """Raises InputError, before any work is done, where `save_flight` would refuse `folder`."""
    check_folder(folder, _PAGE)


def save_flight(found: FlightReadout, folder: str | os.PathLike) -> list[Path]:
    """Writes report.html, readout.png and readout.json, whole or not at all; returns the paths.

    Where the flight does not tell, refused.json stands in place of readout.json.
    Raises InputError where `folder` is a file or a folder of something else.
    """
    picture = png(registry.room("figures").flight_readout(found, published_value(found)))
    caption = (
        "Left: the readout time by the whole flight (thick bar: the honest sigma), without each "
        "strip, with eight camera parameters, and as published. Right: where the images were taken "
        "and how fast the drone flew; circles: where four more photographs would help most."
    )
    page = report_of(found).page([("Readout time from the flight", caption, picture)])
    files = (_RESULT[found.told], _PAGE, PICTURE)
    with whole_folder(folder, _PAGE, lambda name: name in _OURS) as part:
        (part / PICTURE).write_bytes(picture)
        (part / _PAGE).write_text(page, encoding="utf-8", newline="\n")
        write_json(to_dict(found), part / files[0])
    return [Path(folder) / name for name in files]
