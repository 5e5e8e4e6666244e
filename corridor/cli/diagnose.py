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

OUT holds report.html (one page: what is missing, the block beside its simulated counterparts
before and after, where, evidence, detection limits), diagnosis.json (every number), block/ (the
block adjusted with what was found), corrected/ (the measured block from which it has been taken
out, for any other program) and the pictures. It appears when all of it is written, or not at all;
an earlier diagnosis in OUT is replaced.
"""

import argparse
import os
import shlex
import sys

from corridor.cli import _model


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor diagnose`."""
    _model.configure(
        parser,
        camera="fraser10",
        effect="part of the model that is believed in (may be repeated; `corridor effects` lists "
        "them)",
        prior="what is known of camera.NAME.f, of SLUG.parameter, or of a candidate SLUG by its "
        "first parameter (may be repeated)",
        threads=min(2, os.cpu_count() or 1),
    )
    for option, text in (
        ("--only", "test these candidates alone (commas, may be repeated)"),
        ("--without", "leave these candidates out (commas, may be repeated)"),
    ):
        parser.add_argument(
            option, metavar="SLUG", action="extend", type=_slugs, default=[], help=text
        )
    parser.add_argument(
        "--level",
        metavar="P",
        type=float,
        default=0.01,
        help="probability of a false name in a block that lacks nothing (default 0.01)",
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        type=_model.whole("seed", 0),
        default=0,
        help="of everything drawn (default 0)",
    )
    parser.add_argument(
        "--counterparts",
        metavar="N",
        type=_model.whole("number of counterparts", 19),
        default=20,
        help="simulated blocks to stand beside the measured one, 19 or more (default 20)",
    )


def run(options: argparse.Namespace) -> None:
    """Diagnose, print what came of it, save what was asked for."""
    import corridor

    _model.announce_compilation()
    if options.output is not None:
        corridor.diagnosis.check_output(options.output)
    diagnosis = corridor.diagnose(
        corridor.read(options.block),
        camera=options.camera,
        effects=options.effect,
        control=options.control,
        check=options.check,
        priors=dict(options.prior) or None,
        only=options.only or None,
        without=options.without,
        level=options.level,
        seed=options.seed,
        threads=options.threads,
        progress=_progress,
    )
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
    )
    print("\nWrote", *written, sep="\n  ")


def _progress(step):
    if "message" not in step:
        return
    done, of = step.get("done"), step.get("of")
    if done is None:
        print(step["message"], file=sys.stderr, flush=True)
    elif done % 5 == 0 or done == of:
        print(f"{step['message']}: {done} of {of}", file=sys.stderr, flush=True)


def _slugs(text):
    found = [word.strip() for word in text.split(",") if word.strip()]
    if not found:
        raise argparse.ArgumentTypeError("no effect named; write SLUG or SLUG,SLUG")
    return found
