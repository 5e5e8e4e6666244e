"""Compare two dates: what moved, what the camera explains, how sure.

examples:
  corridor change BEFORE AFTER -o out/moved
      named points, the surface and its level of detection; what effects of the camera explain
  corridor change BEFORE AFTER --datum stable --motion similarity -o out/b
      both dates aligned on what stands still: for free networks, or GNSS of metres
  corridor change BEFORE AFTER --together -o out/c
      both dates in one adjustment, with the points that stand still common to both
  corridor import photos BOTH -o both
  corridor change both --dates 2023/,2024/ --together --same-ties -o out/e
      the photographs of both dates in one folder, matched with each other
  corridor change BEFORE AFTER --polygon toe.csv -o out/d
      the change of volume in a polygon (columns x, y), with its standard deviation
  corridor change BLOCK_OR_PLAN
      one date or one plan alone: where could which change be seen?

OUT holds report.html (one sentence first), change.json (every number), points.csv, surface.csv,
the pictures, and with the extra `gis` change.gpkg (points and cells for a GIS) and change.las
(change and sigma as fields for programs of point clouds). It appears when all of it is written,
or not at all; an earlier result in OUT is replaced.
"""

import argparse
from pathlib import Path

from corridor.core.command import model as _model
from corridor.core.command.options import (
    announce_compilation,
    flag,
    names,
    number,
    option,
    say,
    several,
    whole,
    wrote,
)

_POSITIVE = number("is not a number of metres above 0", above=0.0)
OPTIONS = _model.table(
    camera="fraser8",
    effect="estimate this effect in both dates (commas, may be repeated)",
    prior="prior of one parameter, camera.NAME.f or SLUG.parameter (may be repeated)",
) | {
    "--loss": {},
    "--lever-arm": {},
    "--reject-gnss": flag("leave out antenna positions beyond five sigmas (false fixes)"),
    "block": option("folder of the block of the first date, or a plan"),
    "after": option("folder of the block of the second date", "AFTER", Path, nargs="?"),
    "--dates": option(
        "BLOCK holds both dates, matched with each other: what the names of the images of each "
        "begin with",
        "BEFORE/,AFTER/",
        names("folder"),
    ),
    "--common": option(
        "errors that both dates share, of control, priors, gnss, or none (default: control,priors)",
        "KIND,KIND",
        names("kind"),
        default=["control", "priors"],
    ),
    "--gnss-bias": option(
        "standard deviation (m) of a constant error of the GNSS: one number, or three",
        "S or X,Y,Z",
        several(
            number("", least=0.0), "is not one number of metres from 0, or three", counts=(1, 3)
        ),
    ),
    "--datum": option(
        "as control and GNSS of each date state it, or aligned on what stands still "
        "(default: stated; stable where a date hangs on GNSS of metres alone)",
        choices=("stated", "stable"),
    ),
    "--motion": option(
        "what registration together may do (default: rigid)",
        choices=("translation", "rigid", "similarity"),
        default="rigid",
    ),
    "--together": flag("both dates in one adjustment"),
    "--stable": option(
        "ground points that stand still, one point in both (default: found)",
        "ID,ID",
        names("point"),
    ),
    "--same-camera": flag("with --together: one calibration for both dates"),
    "--same-ties": flag("tie points of one name are one point of the ground at both dates"),
    "--spacing": option("distance of core points, m (default: half the radius)", "M", _POSITIVE),
    "--radius": option("of the cylinder in which points count, m (default: some 15 points)", "M",
                       _POSITIVE),
    "--normal": option("along which the surface is compared (default: local)",
                       choices=("local", "vertical"), default="local"),
    "--fit": option("surface in the cylinder: 0 the mean (M3C2), 1 a plane, 2 curved (default: the "
                    "one that shows most at the roughness at hand)", "DEGREE", whole("degree", 0)),
    "--profile": option("core points along this line: CSV with x, y", "FILE", Path),
    "--polygon": option("volume in this polygon: CSV with x, y (may be repeated)", "FILE", Path,
                        action="append", default=[]),
    "--rays": option("images that must show a tie point (default 3)", "N", whole("number", 2),
                     default=3),
    "--largest-motion": option("of a named point, m; beyond it the name is wrong (default 5)", "M",
                               _POSITIVE, default=5.0),
    "--points-only": flag("named points, no surface"),
    "--no-camera": flag("leave out the test of what effects of the camera explain"),
    "--level": option("false discovery rate, and level of the global tests (default 0.01)", "P",
                      number("is not a probability between 0 and 1", above=0.0, below=1.0),
                      default=0.01),
}  # fmt: skip


def run(options: argparse.Namespace) -> None:
    """Compare, print the report, save what was asked for."""
    from corridor.core.block import read
    from corridor.core.errors import InputError
    from corridor.core.output import check_folder
    from corridor.tools import change

    announce_compilation("half a minute", "core")
    model = _model.of_options(options)
    asked = _comparison(options)
    before, after = options.block, options.after
    if options.dates is not None:
        if after is not None:
            raise InputError("--dates are of one block that holds both; two are given")
        before, after = change.dates_of(read(before), options.dates)
    if after is None:
        surface = change.detection(options.block, model, **asked)
        print(change.detection_report(surface))
        return
    if options.output is not None:
        check_folder(options.output, "change.json")
    found = change(before, after, model=model, threads=options.threads, progress=say, **asked)
    print(found)
    if options.output is None:
        print("\nNothing was written: -o OUT saves the report, the tables and the pictures.")
        return
    wrote(*change.save(found, options.output))


def _comparison(options: argparse.Namespace) -> dict:
    """What was asked for, as options of `corridor.change`."""
    from dataclasses import fields

    from corridor.tools.change import Comparison, read_line

    same = [field.name for field in fields(Comparison) if hasattr(options, field.name)]
    return {name: getattr(options, name) for name in same} | {
        "surface": not options.points_only,
        "camera": not options.no_camera,
        "largest": options.largest_motion,
        "degree": options.fit,
        "profile": None if options.profile is None else read_line(options.profile),
        "polygons": {path.stem: read_line(path) for path in options.polygon},
    }
