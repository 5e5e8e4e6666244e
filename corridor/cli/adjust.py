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
import re
import sys
from pathlib import Path

_PRIOR = re.compile(r"(?P<name>[^=\s]+)=(?P<value>[^=]+?)(?:\+-|\+/-|±)(?P<sigma>[^=]+)")


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor adjust`."""
    parser.add_argument("block", metavar="BLOCK", type=Path, help="folder of the block")
    parser.add_argument(
        "-o", "--output", metavar="OUT", type=Path, help="folder for the results (none: print only)"
    )
    parser.add_argument(
        "--camera",
        metavar="WHAT",
        help="free camera parameters: fixed, a list such as f,cx,cy,k1,k2, fraser8 or fraser10 "
        "(default: fraser8, fixed where block.toml says calibrated = true)",
    )
    parser.add_argument(
        "--effect",
        metavar="SLUG",
        action="append",
        default=[],
        help="estimate this effect too (may be repeated; `corridor effects` lists them)",
    )
    parser.add_argument(
        "--control",
        metavar="ID,ID",
        type=_identifiers,
        help="ground points held as control (default: the roles in ground.csv; none: no control)",
    )
    parser.add_argument(
        "--check", metavar="ID,ID", type=_identifiers, help="ground points to be compared with"
    )
    parser.add_argument(
        "--loss",
        metavar="LOSS",
        default="squares",
        help="squares (default), huber:2 or cauchy:2: from how many sigmas on residuals weigh less",
    )
    parser.add_argument(
        "--prior",
        metavar="NAME=VALUE+-SIGMA",
        action="append",
        type=_prior,
        default=[],
        help="prior of one parameter, camera.NAME.f or SLUG.parameter (may be repeated)",
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
    parser.add_argument(
        "--threads", metavar="N", type=_positive, default=1, help="threads to use (default 1)"
    )


def run(options: argparse.Namespace) -> None:
    """Adjust, print the report, save what was asked for."""
    import corridor

    _announce_compilation()
    block = corridor.read(options.block)
    if len(block.track) and not len(block.gnss):
        found = corridor.gnss.of_block(block)
        block.gnss = found.gnss
        print(f"antenna at the exposures from track.csv: {len(found.gnss)} of {len(block.images)}")
    adjustment = corridor.adjust(
        block,
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
    written = corridor.figures.save_adjustment(adjustment, options.output)
    print("\nWrote", *written, sep="\n  ")


def _announce_compilation():
    """Say so once where the kernels are not compiled yet: half a minute of silence looks broken."""
    from numba.core import event

    class Once(event.Listener):
        said = False

        def on_start(self, compilation):
            kernel = compilation.data["dispatcher"].py_func
            if not self.said and kernel.__name__ == "assemble":
                self.said = True
                print(
                    "compiling for this machine, once (half a minute)", file=sys.stderr, flush=True
                )

        def on_end(self, compilation):
            pass

    event.register("numba:compile", Once())


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


def _identifiers(text):
    if text == "none":
        return []
    found = [word.strip() for word in text.split(",") if word.strip()]
    if not found:
        raise argparse.ArgumentTypeError("no point named; write ID,ID or none")
    return found


def _prior(text):
    match = _PRIOR.fullmatch(text.strip())
    try:
        value, sigma = float(match["value"]), float(match["sigma"])
    except (TypeError, ValueError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME=VALUE+-SIGMA, for example camera.P1.f=8190+-5"
        ) from None
    if not sigma > 0:
        raise argparse.ArgumentTypeError(f"{text!r}: the sigma of a prior is greater than 0")
    return match["name"], (value, sigma)


def _positive(text):
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of threads")
    return int(text)
