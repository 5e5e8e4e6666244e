"""Check a project in one command: is it good enough, what is wrong, what to take back?

examples:
  corridor check river.psx
      the answer goes into river_checked, beside where you are; -o names another folder
  corridor check river.psx -o out/river
      a Metashape project; also a folder of Pix4D, OpenDroneMap, COLMAP, MicMac, BlocksExchange ...
  corridor check PROJECT -o out/a --required 0.02
      whether check points are good to 2 cm
  corridor check PROJECT -o out/b --ground points.csv --ground-crs EPSG:25832 --photos DCIM
      with surveyed points and photographs that the project does not have
  corridor check DCIM -o out/c
      from photographs alone (needs the extra `images`)
  corridor check PROJECT -o out/d --json -
      the answer as JSON on standard output, for other programs
  corridor check data_synthetic/dike -o out/e --certificate full
      a block of corridor, with certificate.html and certificate.pdf of its adjustment

It recognises the project, imports it, adjusts it, asks what is missing from its model, and writes
one page, report.html, and check.json. take_back/ holds what the program imports again: settings,
camera, positions with their accuracy, control and its marks, and the whole project where its
format is written; all of it is proved by importing it again. A project in a grid is adjusted in a
local frame, and its coordinates go out in the grid. What was done when it was interrupted is kept,
and the same command goes on. The status is 0 where there is an answer, also a bad one.
"""

import argparse
import os
from pathlib import Path

from corridor.core.command.options import flag, option, picked, say, wrote

MARK = "check.state.json"


class _Project(argparse.Action):
    """What is checked; it also names the folder of the answer where -o does not."""

    def __call__(self, parser, namespace, values, option_string=None):
        namespace.project = values
        place = values.resolve()
        name = place.name if place.is_dir() else place.stem
        namespace.output = namespace.output or Path(f"{name}_checked")


OPTIONS = {
    "project": option(
        "file or folder of a project, photographs, or a block", "PROJECT", Path, action=_Project
    ),
    "--output": option("folder to write (default: PROJECT_checked)", "OUT"),
    "--required": {},
    "--form": option(
        "format of the project, where its content does not show it", "FORMAT", default="auto"
    ),
    "--photos": option("photographs of the project: time, position, temperature"),
    "--track": option("the receiver's track", "FILE", Path),
    "--ground": option("ground points, with their marks if it has them", "FILE", Path),
    "--crs": option("system of the project's coordinates, where it does not say", "CRS"),
    "--ground-crs": option("system of the ground points, where the file does not say", "CRS"),
    "--certificate": {},
    "--quick": flag(
        "leave out the search for what is missing from the model, which takes most of the time"
    ),
    "--threads": {"default": min(2, os.cpu_count() or 1)},
    "--json": option("also write the answer as JSON: a file, or - for standard output", "FILE"),
}


def run(options: argparse.Namespace) -> None:
    """Check, and say what came of it."""
    from corridor.core.command.options import announce_compilation
    from corridor.core.output import json_text
    from corridor.tools.check import check_project

    announce_compilation("half a minute", "core")
    told = picked(options, "photos track ground crs ground_crs")
    try:
        checked = check_project(
            options.project,
            options.output,
            added={key: value for key, value in told.items() if value is not None},
            diagnose=not options.quick,
            progress=say,
            **picked(options, "form required certificate threads"),
        )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"what is done is kept in {options.output}; the same command goes on"
        ) from None
    if options.json == "-":
        print(json_text(checked.to_dict()))
        say(checked)
        return
    print(checked)
    if options.json is not None:
        Path(options.json).write_text(json_text(checked.to_dict()), encoding="utf-8")
    wrote(*map(Path, checked.files))
