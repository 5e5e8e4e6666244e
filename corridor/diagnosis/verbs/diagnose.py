"""Diagnose a block: which effect is missing from the model, how sure, and what it does.

examples:
  corridor diagnose data_synthetic/dike -o out/missing
      from the model that `corridor adjust` would have, with ten camera parameters free
  corridor diagnose BLOCK -o out/a --camera fixed --effect rolling_shutter
      from another model: what is missing beside a rolling shutter, with the camera as stated?
  corridor diagnose BLOCK -o out/b --prior thermal=0.075+-0.01
      with what a laboratory knows of a candidate
  corridor diagnose BLOCK --only rolling_shutter,clock_offset
      these candidates alone, and nothing written; also: --without SLUG

OUT holds report.html (one page: what is missing, what to do, the check points before and after,
then the evidence: the block beside its simulated counterparts), diagnosis.json (every number),
block/ (the block adjusted with what was found), corrected/ (the measured block from which it has
been taken out, for any other program) and the pictures; with --gis also diagnosis.gpkg and
diagnosis.las of what is in block/, as `corridor adjust --gis` writes them. It appears when all of
it is written, or not at all; an earlier diagnosis in OUT is replaced.
"""

import argparse
import os
import shlex
import sys

from corridor.core.command import model as _model
from corridor.core.command.options import announce_compilation, names, option, say, whole, wrote

_SLUGS = {"metavar": "SLUG", "action": "extend", "type": names("slug"), "default": []}
OPTIONS = _model.table(
    camera="fraser10",
    effect="part of the model that is believed in (commas, may be repeated; "
    "`corridor effects` lists them)",
    prior="what is known of camera.NAME.f, of SLUG.parameter, or of a candidate SLUG by its "
    "first parameter (may be repeated)",
    threads=min(2, os.cpu_count() or 1),
) | {
    "--only": _SLUGS | option("test these candidates alone (commas, may be repeated)"),
    "--without": _SLUGS | option("leave these candidates out (commas, may be repeated)"),
    "--level": {},
    "--seed": {},
    "--counterparts": option(
        "simulated blocks to stand beside the measured one, 19 or more (default 20)",
        "N",
        whole("number of counterparts", 19),
        default=20,
    ),
    "--gis": {},
}


def keywords(options: argparse.Namespace) -> dict:
    """What the options say to `corridor.diagnose`."""
    return {
        "model": _model.of_options(options),
        "threads": options.threads,
        "only": options.only or None,
        "without": options.without,
        "level": options.level,
        "seed": options.seed,
        "max_iterations": options.iterations,
        "strict": options.strict,
    }


def run(options: argparse.Namespace) -> None:
    """Diagnose, print what came of it, save what was asked for."""
    from corridor import diagnosis as room
    from corridor.core.block import read
    from corridor.core.gnss import world_crs
    from corridor.core.output import check_gis

    announce_compilation("half a minute", "core")
    if options.output is not None:
        room.check_output(options.output)
    block = read(options.block)
    if options.gis:
        check_gis(world_crs(block))
    diagnosis = room.diagnose(block, progress=_progress, **keywords(options))
    diagnosis.required = options.required
    print(diagnosis)
    if options.output is None:
        print("\nNothing was written: -o OUT saves the report, both blocks and the pictures.")
        return
    written = diagnosis.save(
        options.output,
        options.counterparts,
        options.threads,
        command=shlex.join(["corridor", *sys.argv[1:]]),
        progress=_progress,
        gis=options.gis,
    )
    wrote(*written)


def _progress(step):
    if step.done % 5 == 0 or step.done == step.of:
        say(step)
