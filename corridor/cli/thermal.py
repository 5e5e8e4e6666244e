"""Measure and model how heat moves the picture of a camera.

examples:
  corridor thermal map SERIES -o out/maps.npz
      deformation maps of pictures of a textured wall, taken by a camera that stands still
  corridor thermal fit out/maps.npz -o out/thermal.json
      the thermal model: what a point moves by, at any place and temperature
  corridor thermal apply out/thermal.json --points POINTS.csv --temperature 41.5 -o out/moved.csv
      shifts of points; --inverse leads points seen at that temperature back
  corridor adjust BLOCK $(corridor thermal prior out/thermal.json BLOCK) -o out/a
      adjust with the effect, and with what the model knows of it as a prior

SERIES is a folder of pictures and series.csv: picture (file), time_s, temperature_c, reference
(1 for the pictures whose mean is the reference). Warm up and cool down, 25 to 50 pictures, five
degrees more on either side than the flight will have. `map` goes on where it was interrupted.
Beside MAPS.npz and MODEL.json lies a picture of the same name. A block is corrected with
`corridor correct BLOCK --effect thermal --model MODEL.json -o BLOCK2`.
"""

import argparse
import math
import sys
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor thermal`, one set for each step."""
    steps = parser.add_subparsers(title="steps", metavar="STEP", dest="step", required=True)
    maps = steps.add_parser("map", help="deformation maps from pictures")
    maps.add_argument("folder", metavar="FOLDER", type=Path, help="pictures and series.csv")
    fit = steps.add_parser("fit", help="the thermal model from maps")
    fit.add_argument("maps", metavar="MAPS.npz", type=Path, help="what `map` wrote")
    apply = steps.add_parser("apply", help="shifts of points from the model")
    apply.add_argument("model", metavar="MODEL.json", type=Path, help="what `fit` wrote")
    apply.add_argument(
        "--points",
        metavar="POINTS.csv",
        type=Path,
        required=True,
        help="columns x, y (px) and temperature_c (C, of the optics)",
    )
    apply.add_argument(
        "--temperature", metavar="C", type=_number, help="one temperature for all points"
    )
    apply.add_argument(
        "--inverse",
        action="store_true",
        help="x, y are seen at that temperature; dx, dy lead back to the model's t0",
    )
    prior = steps.add_parser(
        "prior", help="print what the model says of a block's effect, as options of `adjust`"
    )
    prior.add_argument("model", metavar="MODEL.json", type=Path, help="what `fit` wrote")
    prior.add_argument("block", metavar="BLOCK", type=Path, help="folder of the block")
    for step, name in ((maps, "MAPS.npz"), (fit, "MODEL.json"), (apply, "OUT.csv")):
        step.add_argument(
            "-o", "--output", metavar=name, type=Path, required=True, help="file to write"
        )


def run(options: argparse.Namespace) -> None:
    """Do one step, write it, and print what came of it."""
    {"map": _map, "fit": _fit, "apply": _apply, "prior": _prior}[options.step](options)


def _map(options):
    from tqdm import tqdm

    from corridor import figures, thermal
    from corridor.errors import InputError

    picture = _beside(options)
    if picture.parent.resolve() == options.folder.resolve() and picture.exists():
        raise InputError(
            f"{picture} is in the folder of the series and would be replaced: write the maps to "
            "another folder"
        )
    keep = options.output.with_name(f"{options.output.name}.part")
    bar = tqdm(desc="matching", unit="picture", delay=1.0, leave=False)

    def progress(done, of, name):
        bar.total = of
        bar.update(done - bar.n)

    try:
        maps = thermal.measure_maps(options.folder, keep, progress)
        _warn(maps.warnings)
        drawn = figures.png(figures.deformation_maps(maps))
        maps.write(options.output)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"the finished pictures are kept in {keep}, the same command goes on from there"
        ) from None
    finally:
        bar.close()
    picture.write_bytes(drawn)
    thermal.forget(keep)
    usable = maps.valid.any(axis=1)
    print(
        f"{len(maps.picture)} pictures of {maps.width} x {maps.height} px, {usable.sum()} of them "
        f"matched at {100 * maps.valid[usable].mean():.1f} % of {len(maps.x)} nodes"
    )
    print("\nWrote", options.output, picture, sep="\n  ")


def _fit(options):
    from corridor import figures, thermal

    picture = _beside(options)
    fit = thermal.fit(thermal.read_maps(options.maps))
    model = fit.model
    _warn(model.warnings)
    drawn = figures.png(figures.thermal_parameters(fit))
    model.write(options.output)
    picture.write_bytes(drawn)
    low, high = model.range_c
    print(
        f"{model.kind}, powers of T up to {len(model.dx)}: {model.residual_px:.4f} px RMS left, "
        f"from {low:.1f} to {high:.1f} C, zero at {model.t0_c:.1f} C"
    )
    if model.lag_s is not None:
        print(f"the optics lag {model.lag_s:.0f} +- {model.lag_sigma_s:.0f} s behind")
    print("\nWrote", options.output, picture, sep="\n  ")


def _apply(options):
    from corridor import thermal

    model = thermal.read_model(options.model)
    table, notes = thermal.apply(model, options.points, options.temperature, options.inverse)
    _warn(notes)
    thermal.write_points(table, options.output)
    print(f"{len(table)} points\n\nWrote\n  {options.output}")


def _prior(options):
    import corridor
    from corridor import thermal

    known = thermal.laboratory_prior(
        thermal.read_model(options.model), corridor.read(options.block)
    )
    words = ["--effect", "thermal"]
    for name, (value, sigma) in known.items():
        words += ["--prior", f"{name}={value:.6g}+-{sigma:.3g}"]
    print(*words)


def _beside(options):
    """The picture that goes with the output."""
    from corridor.errors import InputError

    if options.output.is_dir():
        raise InputError(f"{options.output} is a folder: name a file to write")
    picture = options.output.with_suffix(".png")
    if picture == options.output:
        raise InputError(f"{picture} would be replaced by its own picture: name it otherwise")
    return picture


def _warn(sentences):
    for sentence in sentences:
        print(f"warning: {sentence}", file=sys.stderr)


def _number(text):
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value
