"""The model that `adjust` and `diagnose` are told: the one place that makes it from options."""

import argparse
import re

from corridor.core.command.options import SHARED, flag, option

_PRIOR = re.compile(r"(?P<name>[^=\s]+)=(?P<value>[^=]+?)(?:\+-|\+/-|±)(?P<sigma>[^=]+)")


def table(camera: str, effect: str, prior: str, threads: int = 1) -> dict[str, dict]:
    """Options of the block and of the model; the texts say what differs between the verbs.

    camera: the default of --camera. effect, prior: help of these. threads: default.
    """
    default = f"(default: {camera}, with k4 of a fisheye, fixed where calibrated = true)"
    return {
        "block": {},
        "--output": option("folder for the results (none: print only)"),
        "--camera": option(f"{SHARED['--camera']['help']} {default}"),
        "--effect": option(effect),
        "--control": {},
        "--check": {},
        "--prior": option(prior, "NAME=VALUE+-SIGMA", _prior, action="append", default=[]),
        "--threads": {"default": threads},
        "--iterations": {},
        "--required": {},
        "--strict": flag(
            "refuse cells that cannot be true, points seen in one image only, images with fewer "
            "than 3 points, and set no match, mark, ground point or image aside that contradicts "
            "the rest (default: leave them out and say so)"
        ),
    }


def of_options(options: argparse.Namespace):
    """The `corridor.Model` that the options say."""
    from corridor.core.adjustment import Model

    more = {name: vars(options)[name] for name in ("loss", "lever_arm") if name in options}
    return Model(
        camera=options.camera,
        effects=options.effect,
        control=options.control,
        check=options.check,
        priors=dict(options.prior),
        **more,
    )


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
