"""Measure and model how heat moves the picture of a camera.

examples:
  corridor thermal map SERIES -o out/maps.npz
      deformation maps of pictures of a textured wall, taken by a camera that stands still
  corridor thermal fit out/maps.npz -o out/heat.json
      the thermal model: what a point moves by, at any place and temperature
  corridor thermal apply out/heat.json --points POINTS.csv --temperature 41.5 -o out/moved.csv
      shifts of points; --inverse leads points seen at that temperature back
  corridor adjust BLOCK $(corridor thermal prior out/heat.json BLOCK) -o out/a
      adjust with the effect, and with what the model knows of it as a prior

SERIES is a folder of pictures and series.csv: picture (file), time_s, temperature_c, reference
(1 for the pictures whose mean is the reference). Warm up and cool down, 25 to 50 pictures, five
degrees more on either side than the flight will have. `map` goes on where it was interrupted.
Beside MAPS.npz and MODEL.json lies a picture of the same name. A block is corrected with
`corridor correct BLOCK --effect thermal --model MODEL.json -o BLOCK2`.
"""

import argparse
from pathlib import Path

from corridor.core.command.options import Bars, flag, kinds, number, option, warn, wrote

_MAPS = {"metavar": "MAPS.npz", "type": Path}
_MODEL = {"metavar": "MODEL.json", "type": Path}
_FILE = option("file to write", required=True)
_STEPS = {
    "map": (
        "deformation maps from pictures",
        {
            "folder": option("pictures and series.csv", "FOLDER", Path),
            "--output": _FILE | {"metavar": "MAPS.npz"},
        },
        "data_synthetic/wall -o out/maps.npz",
    ),
    "fit": (
        "the thermal model from maps",
        {"maps": _MAPS | option("what `map` wrote"), "--output": _FILE | {"metavar": "MODEL.json"}},
        "out/maps.npz -o out/heat.json",
    ),
    "apply": (
        "shifts of points from the model",
        {
            "model": _MODEL | option("what `fit` wrote"),
            "--points": option(
                "columns x, y (px) and temperature_c (C, of the optics)",
                "POINTS.csv",
                Path,
                required=True,
            ),
            "--temperature": option(
                "one temperature for all points", "C", number("is not a number")
            ),
            "--inverse": flag(
                "x, y are seen at that temperature; dx, dy lead back to the model's t0"
            ),
            "--output": _FILE | {"metavar": "OUT.csv"},
        },
        """
out/heat.json --points POINTS.csv --temperature 41.5 -o out/moved.csv
out/heat.json --points POINTS.csv --temperature 41.5 --inverse -o out/back.csv
""",
    ),
    "prior": (
        "print what the model says of a block's effect, as options of `adjust`",
        {"model": _MODEL | option("what `fit` wrote"), "block": {}},
        "out/heat.json BLOCK",
    ),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor thermal`, one set for each step."""
    kinds(parser, "thermal", "steps", "step", _STEPS)


def run(options: argparse.Namespace) -> None:
    """Do one step, write it, and print what came of it."""
    {"map": _map, "fit": _fit, "apply": _apply, "prior": _prior}[options.step](options)


def _map(options):
    from corridor.core import output as report
    from corridor.core import registry
    from corridor.core.errors import InputError
    from corridor.tools import thermal

    picture = _beside(options)
    if picture.parent.resolve() == options.folder.resolve() and picture.exists():
        raise InputError(
            f"{picture} is in the folder of the series and would be replaced: write the maps to "
            "another folder"
        )
    keep, lock = (
        options.output.with_name(f"{options.output.name}.{end}") for end in ("part", "lock")
    )
    with report.folder_of(lock), report.sole(lock) as ours:
        if not ours:
            raise InputError(
                f"{options.output}: another `corridor thermal map` is writing it; wait until it is "
                "done, or name another file"
            )
        try:
            with Bars() as progress:
                maps = thermal.measure_maps(options.folder, keep, progress)
            warn(maps.warnings)
            with report.whole_file(picture) as part:
                report.write_picture(registry.room("figures").deformation_maps(maps), part)
                maps.write(options.output)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"the finished pictures are kept in {keep}, the same command goes on from there"
            ) from None
        thermal.forget(keep)
    usable = maps.valid.any(axis=1)
    print(
        f"{len(maps.picture)} pictures of {maps.width} x {maps.height} px, {usable.sum()} of them "
        f"matched at {100 * maps.valid[usable].mean():.1f} % of {len(maps.x)} nodes"
    )
    wrote(options.output, picture)


def _fit(options):
    from corridor.core import output as report
    from corridor.core import registry
    from corridor.tools import thermal

    picture = _beside(options)
    fit = thermal.fit(thermal.read_maps(options.maps))
    model = fit.model
    warn(model.warnings)
    with report.whole_file(picture) as part:
        report.write_picture(registry.room("figures").thermal_parameters(fit), part)
        model.write(options.output)
    low, high = model.range_c
    print(
        f"{model.kind}, powers of T up to {len(model.dx)}: {model.residual_px:.4f} px RMS left, "
        f"from {low:.1f} to {high:.1f} C, zero at {model.t0_c:.1f} C"
    )
    if model.lag_s is not None:
        print(f"the optics lag {model.lag_s:.0f} +- {model.lag_sigma_s:.0f} s behind")
    wrote(options.output, picture)


def _apply(options):
    from corridor.tools import thermal

    model = thermal.read_model(options.model)
    table, notes = thermal.apply(model, options.points, options.temperature, options.inverse)
    warn(notes)
    thermal.write_points(table, options.output)
    print(f"{len(table)} points")
    wrote(options.output)


def _prior(options):
    from corridor.core.block import read
    from corridor.tools import thermal

    known = thermal.laboratory_prior(thermal.read_model(options.model), read(options.block))
    words = ["--effect", "thermal"]
    for name, (value, sigma) in known.items():
        words += ["--prior", f"{name}={value:.6g}+-{sigma:.3g}"]
    print(*words)


def _beside(options):
    """The picture that goes with the output."""
    from corridor.core.errors import InputError

    if options.output.is_dir():
        raise InputError(f"{options.output} is a folder: name a file to write")
    picture = options.output.with_suffix(".png")
    if picture == options.output:
        raise InputError(f"{picture} would be replaced by its own picture: name it otherwise")
    return picture
