"""Adjust a block: poses, points, camera and effects from its images, GNSS and control.

examples:
  corridor adjust data_synthetic/dike -o out/dike
      as the block says: control, check points and sigmas from its files
  corridor adjust BLOCK -o out/a --camera fixed
      the camera as in block.toml; also: f,cx,cy,k1,k2 or fraser8 or fraser10
  corridor adjust BLOCK -o out/b --effect rolling_shutter --effect gnss_bias
      with effects of `corridor effects`; lever_arm@flight shares by flight
  corridor adjust BLOCK -o out/c --control GCP16 --check GCP11,GCP24 --loss huber:2
      other roles than those in ground.csv; `--control none` for none
  corridor adjust BLOCK -o out/d --prior camera.P1.f=8190+-5 --prior gnss_bias.z=0+-0.05
      what is known beforehand of single parameters

OUT holds report.html (tables and pictures on one page), adjustment.json (every number), block/
(the adjusted block, readable as any other) and the pictures. It appears when all of it is
written, or not at all; an earlier result in OUT is replaced.
"""

import argparse
import sys

from corridor.cli import _model


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor adjust`."""
    _model.configure(
        parser,
        camera="fraser8",
        effect="estimate this effect too (may be repeated; `corridor effects` lists them)",
        prior="prior of one parameter, camera.NAME.f or SLUG.parameter (may be repeated)",
        threads=1,
    )
    parser.add_argument(
        "--loss",
        metavar="LOSS",
        default="squares",
        help="squares (default), huber:2 or cauchy:2: from how many sigmas on residuals weigh less",
    )
    parser.add_argument(
        "--lever-arm",
        choices=("free", "fixed"),
        help="estimate the GNSS lever arm of each flight, or hold it (default: as block.toml says)",
    )
    parser.add_argument(
        "--reject-gnss",
        action="store_true",
        help="leave out antenna positions beyond five sigmas (false fixes) and adjust again",
    )


def run(options: argparse.Namespace) -> None:
    """Adjust, print the report, save what was asked for."""
    import corridor

    _model.announce_compilation()
    adjustment = corridor.adjust(
        corridor.read(options.block),
        camera=options.camera,
        effects=options.effect,
        control=options.control,
        check=options.check,
        loss=options.loss,
        priors=dict(options.prior) or None,
        lever_arm=options.lever_arm,
        threads=options.threads,
        progress=_progress,
        reject_gnss=options.reject_gnss,
    )
    print(adjustment)
    if options.output is None:
        print(
            "\nNothing was written: -o OUT saves the report, the pictures and the adjusted block."
        )
        return
    pictures = corridor.figures.of_adjustment(adjustment)
    written = adjustment.save(options.output, pictures)
    print("\nWrote", *written, sep="\n  ")


def _progress(step):
    if "message" in step:
        print(step["message"], file=sys.stderr, flush=True)
        return
    word = "" if step["accepted"] else "  rejected"
    print(
        f"iteration {step['iteration']:3d}  cost {step['cost']:.6e}  damping {step['damping']:.0e}"
        f"  step {step['step']:.1e}{word}",
        file=sys.stderr,
        flush=True,
    )
