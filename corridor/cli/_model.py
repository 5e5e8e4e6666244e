"""What `adjust` and `diagnose` have in common: the model one believes in, and news of its work."""

import argparse
import re
import sys
from pathlib import Path

_PRIOR = re.compile(r"(?P<name>[^=\s]+)=(?P<value>[^=]+?)(?:\+-|\+/-|±)(?P<sigma>[^=]+)")


def configure(
    parser: argparse.ArgumentParser, camera: str, effect: str, prior: str, threads: int
) -> None:
    """Options of the block and of the model; the texts say what differs between the verbs.

    camera: the default of --camera. effect, prior: help of --effect and --prior. threads: default.
    """
    parser.add_argument("block", metavar="BLOCK", type=Path, help="folder of the block")
    parser.add_argument(
        "-o", "--output", metavar="OUT", type=Path, help="folder for the results (none: print only)"
    )
    parser.add_argument(
        "--camera",
        metavar="WHAT",
        help="free camera parameters: fixed, a list such as f,cx,cy,k1,k2, fraser8 or fraser10 "
        f"(default: {camera}, fixed where block.toml says calibrated = true)",
    )
    parser.add_argument("--effect", metavar="SLUG", action="append", default=[], help=effect)
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
        "--prior",
        metavar="NAME=VALUE+-SIGMA",
        action="append",
        type=_prior,
        default=[],
        help=prior,
    )
    parser.add_argument(
        "--threads",
        metavar="N",
        type=whole("number of threads", 1),
        default=threads,
        help=f"threads to use (default {threads})",
    )


def whole(what: str, least: int):
    """A type of option: a whole number of at least so much."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not a {what} from {least}")
        return int(text)

    return number


def announce_compilation():
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
