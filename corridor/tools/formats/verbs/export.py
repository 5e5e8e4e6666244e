"""Export a block to another program, corrected to what that program can hold.

examples:
  corridor export colmap BLOCK -o PROJECT
      binary model; also colmap-text, opensfm, metashape, micmac, bundler
  corridor export colmap OUT -o PROJECT --corrected
      OUT of `corridor adjust`: its estimated effects are taken out of the measurements, and these
      moved to a camera that COLMAP holds
  corridor export opensfm BLOCK -o PROJECT --effect rolling_shutter:readout=0.03 --corrected
      with an effect whose values are known
  corridor export bundler BLOCK -o PROJECT --lossy
      what Bundler cannot hold is dropped; the list of it is printed and written beside
  corridor export metashape OUT -o PROJECT --to-crs EPSG:25832
      in coordinates of a grid, point by point through PROJ

What the target cannot hold (b2 in COLMAP and OpenSfM, lever arms, effects) is always said. Without
--corrected or --lossy an export that would lose a camera parameter or an effect is refused. GNSS
goes out as camera centres: antenna minus lever arm. Poses and points are those of the block: adjust
it first, and export the result.
"""

import argparse

from corridor.core.command.options import (
    flag,
    given_once,
    option,
    picked,
    say,
    valued_effect,
    wrote,
)

MARK = "exported_by_corridor.txt"
OPTIONS = {
    "form": option("name of a format that is written", "FORMAT"),
    "block": option("a block, or the result of `corridor adjust`"),
    "--output": option("folder to write", "PROJECT", required=True),
    "--effect": option(
        "an effect that is in the measurements (may be repeated)",
        "SLUG:PARAMETER=VALUE",
        valued_effect,
        action="append",
    ),
    "--corrected": flag("correct the measurements to what the target holds", one_of="at most"),
    "--lossy": flag("drop what the target cannot hold, and say so", one_of="at most"),
    "--to-crs": option("convert the coordinates to this grid in metres, as EPSG:25832", "CRS"),
}


def run(options: argparse.Namespace) -> None:
    """Export, and say what the target holds and what not."""
    from corridor.tools import formats

    made = formats.export_project(
        options.block,
        options.form,
        options.output,
        effects=given_once(options.effect),
        progress=say,
        **picked(options, "corrected lossy to_crs"),
    )
    print(made)
    wrote(options.output)
