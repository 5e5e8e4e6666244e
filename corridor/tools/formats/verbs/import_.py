"""Import another program's project, and prove by reprojection that it was understood.

examples:
  corridor import auto PROJECT -o BLOCK
      COLMAP, OpenSfM or OpenDroneMap, Metashape, MicMac, Pix4D, Bundler, VisualSfM, BAL or
      PhotoModeler: recognised by the content
  corridor import colmap sparse/0 -o BLOCK --photos IMAGES
      with times, positions, velocities, temperatures of the photographs; they place a free model
  corridor import metashape cameras.xml -o BLOCK --ground markers.xml --track rover.pos
      with ground points and their marks, and the antenna from the receiver's track
  corridor import micmac PROJECT -o BLOCK --ground points.txt --crs EPSG:2154
      points.txt: name x y z a line; also gcp_list.txt, ground.csv, XML of MicMac or Metashape
  corridor import photos FOLDER -o BLOCK
      from photographs alone (needs the extra `images`); goes on where it was interrupted
  corridor import photos FOLDER -o BLOCK --size 1200 --share 2
      the same cheaply: smaller pictures, every second one

Every import ends with a proof: the imported points through the imported poses and camera. Where
the median is above 2 px, or a usual mistake of convention (origin, p1 and p2, sense of rotation, y
upwards, direction of distortion) would explain the residuals, nothing is written unless --force
is given, and the mistake is named.

What is derived (headings, flights, places, delays, sigmas) stands in the table `derived` of
block.toml with what else agrees with it, contradicts it or cannot check it; BLOCK/import.html shows
it, the photographs that did not join, a map, and what to do next. A project that nothing places
keeps its own frame and scale (`frame = "arbitrary"` in block.toml): velocities have no place in it.
"""

import argparse
import re
from pathlib import Path

from corridor.core.command.options import flag, option, picked, say, whole, wrote
from corridor.core.errors import InputError


def _size(text):
    if text.isdecimal() and int(text) >= 100:
        return int(text)
    match = re.fullmatch(r"(\d+)[xX](\d+)", text)
    if not match or min(map(int, match.groups())) < 2:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither WIDTHxHEIGHT, as 4000x3000, nor the PIXELS of the long side of "
            "photographs, as 2000"
        )
    return int(match[1]), int(match[2])


OPTIONS = {
    "form": option("auto, photos, or the name of a format", "FORMAT"),
    "project": option("its file or folder", "PROJECT", Path),
    "--output": option("folder to write", "BLOCK", required=True),
    "--photos": option("photographs: time, GNSS, velocity, temperature"),
    "--attitudes": flag("attitudes.csv from the photographs, as good as the poses say they are"),
    "--track": option("the receiver's track, as for `corridor gnss`", "FILE", Path),
    "--ground": option("ground points, with their marks if it has them", "FILE", Path),
    "--crs": option(
        "system of the block's coordinates, as EPSG:32647: a project that has a place on Earth is "
        "converted to it, for any other it says what its coordinates are",
        "CRS",
    ),
    "--ground-crs": option(
        "system of the ground points of --ground, where the file does not say", "CRS"
    ),
    "--to-crs": option(
        "adjust in a local frame (east, north, up: no grid scale, no curvature), and give results "
        "in this system",
        "CRS",
    ),
    "--size": option(
        "picture size WxH, for formats that have none; photos: reduce larger pictures to this "
        "many PIXELS along the long side, which is quicker",
        "SIZE",
        _size,
    ),
    "--share": option("photos: take every N-th photograph only", "N", whole("share", 1), default=1),
    "--track-system": option(
        "time system of the track, where the file does not say: GPST, UTC, UTC+hh:mm"
    ),
    "--images-system": option(
        "time system of the images' times, where the file does not say: GPST, UTC, UTC+hh:mm"
    ),
    "--form": option(
        "how to write the tables (parquet: smaller and faster for large blocks)",
        dest="table_form",
        choices=("csv", "parquet"),
        default="csv",
    ),
    "--force": flag("write the block although the proof refuses it"),
}


def run(options: argparse.Namespace) -> None:
    """Import, prove, write, and say what came of it."""
    from corridor.core.registry import room
    from corridor.tools import formats as interchange

    alone = options.form == "photos"
    if isinstance(options.size, int) != alone and options.size is not None:
        wanted = "PIXELS of the long side, as 2000" if alone else "WIDTHxHEIGHT, as 4000x3000"
        raise InputError(f"--size {options.size}: give {wanted}")
    made = interchange.import_project(
        options.project,
        options.form,
        options.output,
        size=None if alone else options.size,
        long_side=options.size if alone else None,
        progress=say,
        **picked(options, "photos track ground crs ground_crs to_crs share attitudes force"),
        **picked(options, "track_system images_system table_form"),
    )
    print(made)
    page = made.save(room("figures").first_look(made.block))
    wrote(options.output, page)
