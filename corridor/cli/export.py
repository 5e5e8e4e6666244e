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

What the target cannot hold (b2 in COLMAP and OpenSfM, lever arms, effects) is always said. Without
--corrected or --lossy an export that would lose a camera parameter or an effect is refused. GNSS
goes out as camera centres: antenna minus lever arm. Poses and points are those of the block: adjust
it first, and export the result.
"""

import argparse
import sys
from pathlib import Path

from corridor.cli.simulate import effect_word


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor export`."""
    parser.add_argument("form", metavar="FORMAT", help="name of a format that is written")
    parser.add_argument(
        "block", metavar="BLOCK", type=Path, help="a block, or the result of `corridor adjust`"
    )
    parser.add_argument(
        "-o", "--output", metavar="PROJECT", type=Path, required=True, help="folder to write"
    )
    parser.add_argument(
        "--effect",
        metavar="SLUG:PARAMETER=VALUE",
        action="append",
        type=_effect,
        default=[],
        help="an effect that is in the measurements (may be repeated)",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--corrected", action="store_true", help="correct the measurements to what the target holds"
    )
    how.add_argument(
        "--lossy", action="store_true", help="drop what the target cannot hold, and say so"
    )


def run(options: argparse.Namespace) -> None:
    """Export, and say what the target holds and what not."""
    from corridor import interchange

    block, found = interchange.read_adjusted(options.block)
    effects = dict(found)
    for slug, values in options.effect:
        effects[slug] = {**effects.get(slug, {}), **values}
    made = interchange.export_project(
        block,
        options.form,
        options.output,
        effects=effects,
        corrected=options.corrected,
        lossy=options.lossy,
        progress=lambda what: print(what, file=sys.stderr, flush=True),
    )
    print(made)
    print(f"\nWrote {options.output}")


def _effect(text):
    slug, values = effect_word(text)
    if values is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not SLUG:PARAMETER=VALUE, for example rolling_shutter:readout=0.03"
        )
    return slug, values
