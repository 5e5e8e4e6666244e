"""Plan a flight: its expected accuracy before it is flown, without and with ground control.

examples:
  corridor plan PLAN.toml -o out/plan
      with 0, 1, 3 and 5 control points; a plan of two or three flights: every combination of them
  corridor plan thesis_s2_n50+thesis_s2_o50 --control 0,1 -o out/plan
      two of the plans that come with corridor, flown one after the other
  corridor plan A.toml B.toml C.toml -o out/plan
      three flight sets beside each other; --combine: every combination of their flights
  corridor plan PLAN.toml --bias 0,0,0.07 --correlated 0.5 -o out/plan
      GNSS that is wrong by 7 cm in height, half its noise with a memory
  corridor plan PLAN.toml --effect gnss_bias --prior gnss_bias.z=0.05 -o out/plan
      the adjustment estimates a bias of the GNSS, in height known beforehand to 5 cm
  corridor plan thesis_s1_n50 --carry-over thesis_s2_n50+thesis_s2_o50 --mounted s1-n50=s2-n50
      camera and lever arm of another flight set taken over, its own adjustment with --carry-control

Sigmas are those of the plan's table [noise]. Nothing is drawn at random but the ground and the
small unrest of the flight (--seed). OUT holds plan.csv and plan.json (metres), accuracy.png and
advice.txt.
"""

import argparse
import sys
import textwrap
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor plan`."""
    add = parser.add_argument
    add("plans", metavar="PLAN", nargs="+", help="a .toml file, or names of plans joined by +")
    add("-o", "--output", metavar="OUT", type=Path, help="folder to write (none: print only)")
    add(
        "--control",
        metavar="N,N",
        type=_counts,
        default=[0, 1, 3, 5],
        help="numbers of control points (default 0,1,3,5)",
    )
    add(
        "--place",
        choices=("spread", "best"),
        default="spread",
        help="control spread evenly (default), or where each point helps most",
    )
    add(
        "--goal",
        metavar="M,M",
        type=_goals,
        default=[0.01, 0.03],
        help="accuracies that the advice is about, m (default 0.01,0.03)",
    )
    sets = parser.add_mutually_exclusive_group()
    sets.add_argument(
        "--combine",
        dest="combined",
        action="store_true",
        default=None,
        help="compare every combination of the flights",
    )
    sets.add_argument(
        "--as-given", dest="combined", action="store_false", help="compare the plans as they are"
    )
    add(
        "--camera",
        metavar="WHAT",
        help="free camera parameters, as of `corridor adjust`: "
        "fixed for a pre-calibrated camera (default fraser8)",
    )
    add(
        "--lever-arm",
        choices=("free", "fixed"),
        default="free",
        help="estimate the lever arm of each flight (default), or hold it",
    )
    add(
        "--gnss-sigma",
        metavar="X,Y,Z",
        type=_three,
        help="true noise of the GNSS, m, where it is not what the plan states",
    )
    add("--bias", metavar="X,Y,Z", type=_three, help="constant error of the GNSS, m")
    add(
        "--bias-sigma",
        metavar="X,Y,Z",
        type=_three,
        help="standard deviation of an unknown constant error, m",
    )
    add(
        "--bias-per",
        choices=("block", "flight"),
        default="block",
        help="one constant error for all flights (default), or one each",
    )
    add(
        "--effect",
        metavar="SLUG",
        action="append",
        default=[],
        help="estimate this effect of the antenna too (may be repeated)",
    )
    add(
        "--prior",
        metavar="NAME=SIGMA",
        action="append",
        type=_prior,
        default=[],
        help="what is known of a parameter, as in gnss_bias.z=0.05 (may be repeated)",
    )
    add(
        "--correlated",
        metavar="SHARE[:SECONDS]",
        type=_memory,
        default=(0.0, 30.0),
        help="share of the GNSS's variance that has a memory (default 0:30)",
    )
    add("--carry-over", metavar="PLAN", help="flight set whose camera is carried over")
    add(
        "--carry-control",
        metavar="N",
        type=int,
        default=5,
        help="control points of that flight set (default 5)",
    )
    add(
        "--mounted",
        metavar="FLIGHT=FLIGHT",
        action="append",
        type=_pair,
        default=[],
        help="carry a lever arm over too: flight here = there (may be repeated)",
    )
    add("--held", action="store_true", help="hold what is carried over instead of weighing it")
    add("--jobs", metavar="N", type=int, default=1, help="processes (default 1)")
    add("--cluster", metavar="ADDRESS", help="Dask scheduler that does the work")
    add("--seed", metavar="N", type=int, default=0, help="of the ground and the flight (default 0)")


def run(options: argparse.Namespace) -> None:
    """Plan, print the table and the advice, save what was asked for."""
    from corridor import planning

    noise = planning.GnssNoise(
        sigma_m=options.gnss_sigma,
        correlated=options.correlated[0],
        correlation_s=options.correlated[1],
        bias_m=options.bias,
        bias_sigma_m=options.bias_sigma,
        bias_per=options.bias_per,
    )
    known = {
        "noise": noise,
        "lever_arm": options.lever_arm,
        "effects": options.effect,
        "priors": dict(options.prior),
        "seed": options.seed,
    }
    carried = None
    if options.carry_over is not None:
        other = planning.Planner(options.carry_over, **known).expect(options.carry_control)
        carried = other.carried(dict(options.mounted), held=options.held)
    table = planning.sweep(
        planning.flight_sets(options.plans, options.combined),
        options.control,
        options.place,
        options.jobs,
        options.cluster,
        progress=_progress,
        camera=options.camera,
        carried=carried,
        **known,
    )
    said = planning.advice(table, options.goal)
    print(planning.as_text(table))
    print("", *textwrap.wrap(said, 99), sep="\n")
    if options.output is None:
        print("\nNothing was written: -o OUT saves the table, the picture and the advice.")
        return
    aside = ("run", "output", "jobs", "cluster")
    settings = {key: value for key, value in vars(options).items() if key not in aside}
    written = planning.save(table, said, options.output, settings)
    print("\nWrote", *written, sep="\n  ")


def _progress(done, of):
    if of > 1:
        print(f"flight set {done} of {of}", file=sys.stderr, flush=True)


def _counts(text):
    try:
        counts = sorted({int(word) for word in text.split(",")})
    except ValueError:
        counts = [-1]
    if counts[0] < 0:
        raise argparse.ArgumentTypeError(f"{text!r} are no numbers of control points: write 0,1,3")
    return counts


def _goals(text):
    try:
        goals = [float(word) for word in text.split(",")]
    except ValueError:
        goals = [-1.0]
    if not min(goals) > 0:
        raise argparse.ArgumentTypeError(f"{text!r} are no accuracies in metres: write 0.01,0.03")
    return goals


def _three(text):
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3):
        raise argparse.ArgumentTypeError(f"{text!r} is not one number or three: write 0.03,0.01,0")
    return tuple(numbers * (3 // len(numbers)))


def _memory(text):
    share, colon, seconds = text.partition(":")
    try:
        return float(share), float(seconds) if colon else 30.0
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not SHARE:SECONDS, for example 0.5:30"
        ) from None


def _prior(text):
    name, _, sigma = text.partition("=")
    try:
        value = float(sigma)
    except ValueError:
        value = -1.0
    if not (name and value > 0):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME=SIGMA, for example camera.NAME.f=2.5"
        )
    return name, value


def _pair(text):
    here, equals, there = text.partition("=")
    if not (here and equals and there):
        raise argparse.ArgumentTypeError(f"{text!r} is not FLIGHT=FLIGHT, here = there")
    return here, there
