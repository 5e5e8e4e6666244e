"""Take an effect out of a block's measurements, so that any other program can go on with it.

examples:
  corridor correct out/a/block --effect rolling_shutter -o out/corrected
      with the readout time that block.toml states; velocities from images.csv, GNSS or neighbours
  corridor correct out/a/block --effect rolling_shutter:readout=0.0564 -o out/corrected
      with a value of your own; several parameters with commas
  corridor correct out/a/block --effect gnss_bias --from out/a/adjustment.json -o out/corrected
      with what an adjustment (or a diagnosis.json) found
  corridor correct out/a/block --effect rolling_shutter --velocity strip -o out/corrected
      velocities from a smooth flight along each strip: for time stamps in whole seconds
  corridor correct BLOCK --effect thermal --model MODEL.json -o out/corrected
      with the model of `corridor thermal fit`, by each image's temperature; needs no poses

Otherwise BLOCK needs poses and points: adjust it first and correct OUT/block. BLOCK2 appears whole
or not at all. Its block.toml says in the table [corrected] what was taken out, with which values
and velocities, and what was wrong with the time stamps.
"""

import argparse
from pathlib import Path

from corridor.core.command.options import effect, given_once, option, warn, wrote

MARK = "block.toml"
OPTIONS = {
    "block": {},
    "--effect": option(
        "take out this effect of `corridor effects`; without values, those that the block "
        "states or --from holds (may be repeated)",
        "SLUG[:PARAMETER=VALUE]",
        effect,
        action="append",
        required=True,
    ),
    "--from": option(
        "adjustment.json or diagnosis.json that holds the values", "FILE", Path, dest="source"
    ),
    "--model": option("thermal model that a laboratory has fitted", "MODEL", Path),
    "--velocity": option(
        "where velocities come from, for effects that need them: vx, vy, vz of images.csv "
        "(metadata), antenna positions (gnss), a smooth flight along each strip (strip), the "
        "images before and after (neighbours); default: the first of these that the block has",
        choices=("auto", "metadata", "gnss", "strip", "neighbours"),
        default="auto",
    ),
    "--turning": option(
        "where angular rates come from, for effects that take them: wx, wy, wz of images.csv if "
        "they are there (metadata, default), attitudes of the images before and after",
        choices=("metadata", "neighbours"),
        default="metadata",
    ),
    "--output": option("folder to write", "BLOCK2", required=True),
}


def run(options: argparse.Namespace) -> None:
    """Take the effect out, say what was done and write the block."""
    import corridor

    there = options.output / MARK
    if there.is_file() and "[corrected]" not in there.read_text(encoding="utf-8", errors="replace"):
        raise corridor.InputError(
            f"{options.output} is a block of which nothing was taken out, so it is not replaced; "
            "name a new folder"
        )
    block = corridor.read(options.block)
    if options.model is not None:
        _by_model(block, options)
        return
    values = given_once(options.effect)
    corrected = corridor.correct(
        block, values, source=options.source, velocity=options.velocity, turning=options.turning
    )
    for note in corrected.extra["corrected"].get("notes", ()):
        print(note)
    _tell(block, corrected, values)
    corrected.write(options.output)
    wrote(options.output)


def _by_model(block, options):
    import corridor

    if options.effect != [("thermal", None)] or options.source is not None:
        raise corridor.InputError(
            "--model holds a thermal model and all its values: use it with --effect thermal alone"
        )
    model = corridor.thermal.read_model(options.model)
    corrected, warnings = corridor.thermal.correct(block, model)
    warn(warnings)
    _moved(block, corrected)
    corrected.write(options.output)
    wrote(options.output)


def _tell(block, corrected, values):
    from corridor.core.block import taken_out

    for name in values:
        slug = name.partition("@")[0]
        told = taken_out(corrected)[slug].items()
        words = (f"{k} = {v:.6g}" if isinstance(v, float) else f"{k} of {len(v)}" for k, v in told)
        print(f"without {slug}: {', '.join(words)}")
    _moved(block, corrected)


def _moved(block, corrected):
    import numpy as np

    for table, columns, unit in (
        ("tie_points", ["x", "y"], "px"),
        ("marks", ["x", "y"], "px"),
        ("gnss", ["x", "y", "z"], "m"),
        ("ground", ["x", "y", "z"], "m"),
    ):
        before, after = (getattr(b, table)[columns].to_numpy(float) for b in (block, corrected))
        length = np.linalg.norm(after - before, axis=1)
        if len(length) and np.nanmax(length) > 0:
            print(
                f"{table}: {np.count_nonzero(length):,} of {len(length):,} rows moved, median "
                f"{np.nanmedian(length):.3g} {unit}, largest {np.nanmax(length):.3g} {unit}"
            )
