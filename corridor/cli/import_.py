"""Import another program's project, and prove by reprojection that it was understood.

examples:
  corridor import auto PROJECT -o BLOCK
      COLMAP, OpenSfM or OpenDroneMap, Metashape, MicMac, Pix4D, Bundler, VisualSfM, BAL or
      PhotoModeler: told by the content
  corridor import colmap sparse/0 -o BLOCK --photos IMAGES
      with times, positions, temperatures of the photographs; a free model is placed by them
  corridor import metashape cameras.xml -o BLOCK --ground markers.xml --track rover.pos
      with ground points and their marks, and the antenna from the receiver's track
  corridor import micmac PROJECT -o BLOCK --ground points.txt --crs EPSG:2154
      points.txt: name x y z a line; also gcp_list.txt, ground.csv, XML of MicMac or Metashape
  corridor import photos FOLDER -o BLOCK
      from photographs alone (needs the extra `images`); goes on where it was interrupted

Every import ends with a proof: the imported points through the imported poses and camera. Where
the median is above 2 px, or a usual mistake of convention (origin, p1 and p2, sense of rotation, y
upwards, direction of distortion) would explain the residuals, nothing is written unless --force
is given, and the mistake is named.
"""

import argparse
import re
import sys
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor import`."""
    parser.add_argument("form", metavar="FORMAT", help="auto, photos, or the name of a format")
    parser.add_argument("project", metavar="PROJECT", type=Path, help="its file or folder")
    parser.add_argument(
        "-o", "--output", metavar="BLOCK", type=Path, required=True, help="folder to write"
    )
    parser.add_argument(
        "--photos", metavar="FOLDER", type=Path, help="photographs: time, GNSS, temperature"
    )
    parser.add_argument(
        "--track", metavar="FILE", type=Path, help="the receiver's track, as for `corridor gnss`"
    )
    parser.add_argument(
        "--ground", metavar="FILE", type=Path, help="ground points, with their marks if it has them"
    )
    parser.add_argument(
        "--crs", metavar="CRS", help="system of the project's coordinates, as EPSG:32647"
    )
    parser.add_argument(
        "--size", metavar="WxH", type=_size, help="picture size, for formats that have none"
    )
    for name, what in (("track", "the track"), ("images", "the images' times")):
        parser.add_argument(
            f"--{name}-system",
            metavar="SYSTEM",
            help=f"time system of {what}, where the file does not say: GPST, UTC, UTC+hh:mm",
        )
    parser.add_argument(
        "--form",
        dest="table_form",
        choices=("csv", "parquet"),
        default="csv",
        help="how to write the tables (parquet: smaller and faster for large blocks)",
    )
    parser.add_argument(
        "--force", action="store_true", help="write the block although the proof refuses it"
    )


def run(options: argparse.Namespace) -> None:
    """Import, prove, write, and say what came of it."""
    from corridor import interchange

    said = _Said()
    made = interchange.import_project(
        options.project,
        options.form,
        options.output,
        photos=options.photos,
        track=options.track,
        ground=options.ground,
        crs=options.crs,
        size=options.size,
        track_system=options.track_system,
        images_system=options.images_system,
        table_form=options.table_form,
        force=options.force,
        progress=said,
    )
    print(made)
    print(f"\nWrote {options.output}")


class _Said:
    """What is being done, one line a step, and bars for long ones; on stderr."""

    def __call__(self, what: str) -> None:
        print(what, file=sys.stderr, flush=True)


def _size(text):
    match = re.fullmatch(r"(\d+)[xX](\d+)", text)
    if not match or min(map(int, match.groups())) < 2:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, for example 4000x3000")
    return int(match[1]), int(match[2])
