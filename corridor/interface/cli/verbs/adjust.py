"""Adjust a block: poses, points, camera and effects from its images, GNSS and control.

examples:
  corridor adjust data_synthetic/dike -o out/dike
      as the block says: control, check points and sigmas from its files
  corridor adjust BLOCK -o out/a --required 0.02
      is it good enough? the report begins with that, what is wrong, and what to do
  corridor adjust BLOCK -o out/a --camera fixed
      the camera as in block.toml; also: f,cx,cy,k1,k2 or fraser8 or fraser10
  corridor adjust BLOCK -o out/b --effect rolling_shutter --effect gnss_bias
      with effects of `corridor effects`; lever_arm@flight shares by flight
  corridor adjust BLOCK -o out/c --control GCP16 --check GCP11,GCP24 --loss huber:2
      other roles than those in ground.csv; `--control none` for none
  corridor adjust BLOCK -o out/d --prior camera.P1.f=8190+-5 --prior gnss_bias.z=0+-0.05
      what is known beforehand of single parameters
  corridor adjust BLOCK -o out/e --gis
      for QGIS and CloudCompare too: adjustment.gpkg, adjustment.las
  corridor adjust BLOCK -o out/f --certificate full
      certificate.html and certificate.pdf for an authority: `asprs`, `din18740` or `full`
  corridor adjust BLOCK --line axis.csv --required 0.01
      may one centimetre be believed along the axis of the road? (one row: at that place)

OUT holds report.html (tables and pictures on one page), adjustment.json (every number), block/
(the adjusted block, .parquet where BLOCK is) and the pictures; with --gis also adjustment.gpkg
(layers points, check_vectors, cameras, footprints; standard deviations sx, sy, sz in metres) and
adjustment.las (the points), in the block's CRS with its offset added. It appears when all of it is
written, or not at all; an earlier result in OUT is replaced. An adjustment that did not converge
is not a result: the status is 1, nothing is written, and what lies far from the start values is
printed.
"""

import argparse
import sys
from pathlib import Path

from corridor.core.command import model as _model
from corridor.core.command.options import announce_compilation, flag, option, say, wrote

_COLUMNS = """\
cost: half the sum of squared residuals over their sigmas; damping: 0 is a full Gauss-Newton step;
step: how far the unknowns moved (RMS, in their sigmas)
iteration          cost  damping     step"""

MARK = "adjustment.json"
OPTIONS = _model.table(
    camera="fraser8",
    effect="estimate this effect too (commas, may be repeated; `corridor effects` lists them)",
    prior="prior of one parameter, camera.NAME.f or SLUG.parameter (may be repeated)",
) | {
    "--loss": {},
    "--lever-arm": {},
    "--reject-gnss": flag(
        "leave out antenna positions beyond five sigmas (false fixes) and adjust again"
    ),
    "--gis": {},
    "--line": option(
        "how precise the ground is along this line, or at one place (CSV with x, y): may the "
        "accuracy of --required be believed there? also OUT/line.csv",
        "FILE",
        Path,
    ),
    "--certificate": {},
    "--verbose": flag("print every iteration"),
}


def keywords(options: argparse.Namespace) -> dict:
    """What the options say to `corridor.adjust`."""
    return {
        "model": _model.of_options(options),
        "threads": options.threads,
        "max_iterations": options.iterations or 100,
        "reject_gnss": options.reject_gnss,
        "strict": options.strict,
    }


def run(options: argparse.Namespace) -> None:
    """Adjust, print the report, save what was asked for."""
    from corridor.core.adjustment import precompiled_aside

    announce_compilation("half a minute", "core")
    # The report asks for covariances, whose kernel is late as well.
    with precompiled_aside():
        _run(options)


def _run(options: argparse.Namespace) -> None:
    import corridor
    from corridor.core.adjustment import not_converged, read_corners
    from corridor.core.errors import InputError
    from corridor.core.output import check_gis

    if options.certificate is not None and options.output is None:
        raise InputError("a certificate is a file: give the folder to write it to with -o OUT")
    corners = None if options.line is None else read_corners(options.line)
    with _Iterations(options.verbose) as progress:
        block = corridor.read(options.block)
        if options.gis:
            check_gis(corridor.gnss.world_crs(block))
        adjustment = corridor.adjust(block, progress=progress, **keywords(options))
    adjustment.required = options.required
    if not adjustment.converged:
        print("What measurements and start values say of each other:")
        for sentence in (*adjustment.doubts, *adjustment.start_misfit()):
            print(f"  {sentence}")
        raise not_converged(adjustment)
    print(adjustment)
    beside = {}
    if corners is not None:
        line = adjustment.precision_along(corners, options.required)
        print(f"\n{options.line.name}: {line}")
        text = line.table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        beside["line.csv"] = text.encode()
    if options.output is None:
        print(
            "\nNothing was written: -o OUT saves the report, the pictures and the adjusted block."
        )
        return
    if options.certificate is not None:
        made = corridor.certificate.certify(
            options.block, options.certificate, required=options.required, adjustment=adjustment,
            **keywords(options),
        )  # fmt: skip
        beside |= made.files
    pictures = corridor.figures.of_adjustment
    wrote(*adjustment.save(options.output, pictures, gis=options.gis, beside=beside))


class _Iterations:
    """News of the iterations: which one is under way, or with `verbose` what each has done."""

    def __init__(self, verbose: bool):
        self.verbose, self.begun = verbose, False

    def __enter__(self):
        from tqdm import tqdm

        # One line that the next one replaces; on a terminal only, after two seconds.
        line = {"bar_format": "{desc}", "delay": 2.0, "leave": False, "file": sys.stderr}
        self.line = tqdm(disable=None, mininterval=0.0, miniters=1, **line)
        return self

    def __exit__(self, *_):
        self.line.close()

    def __call__(self, progress) -> None:
        step = progress.result
        if step is None:
            self.line.clear()
            say(progress)
        elif not self.verbose:
            self.line.set_description_str(f"adjusting: iteration {progress.done} done", False)
            self.line.update()
        else:
            if not self.begun:
                say(_COLUMNS)
            self.begun = True
            word = "" if step["accepted"] else "  rejected: it would make them larger"
            say(
                f"{step['iteration']:9d}  {step['cost']:.6e}  {step['damping']:7.0e}"
                f"  {step['step']:.1e}{word}"
            )
