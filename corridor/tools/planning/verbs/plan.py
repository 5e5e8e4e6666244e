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
  corridor plan PLAN.toml --control 5 --change -o out/plan
      also the level of detection of two flights like the advised ones, as a map

Sigmas are those of the plan's table [noise], and are printed. Nothing is drawn at random but the
ground and the small unrest of the flight (--seed), and with --change the noise of one flight. OUT
holds advice.txt, control.csv and control.png (where control is to be), plan.csv and plan.json
(metres) and accuracy.png; with --change also detection.png and detection.csv.
"""

import argparse

from corridor.core.command.options import (
    checked,
    flag,
    number,
    option,
    picked,
    say,
    several,
    whole,
    wrote,
)

MARK = "plan.json"


def _three(text):
    numbers = several(
        number("is no number"), "is not one number or three: write 0.03,0.01,0", counts=(1, 3)
    )(text)
    return tuple(numbers * (3 // len(numbers)))


def _memory(text):
    share, colon, seconds = text.partition(":")
    of = number("is not SHARE:SECONDS, for example 0.5:30")
    return of(share), of(seconds) if colon else 30.0


def _prior(text):
    name, _, sigma = text.partition("=")
    of = number("is not the SIGMA of NAME=SIGMA, for example camera.NAME.f=2.5", above=0.0)
    return name, of(sigma if name else "")


_pair = checked(
    lambda text: text.split("=", 1),
    lambda pair: len(pair) == 2 and all(pair),
    "is not FLIGHT=FLIGHT, here = there",
)
OPTIONS = {
    "plans": option("a .toml file, or names of plans joined by +", "PLAN", nargs="+"),
    "--output": {},
    "--control": option(
        "numbers of control points (default 0,1,3,5; may be repeated)",
        "N,N",
        several(whole("count", 0), "are not numbers of control points: write 0,1,3"),
        action="extend",
        default=None,
    ),
    "--place": option(
        "control spread evenly (default), or where each point helps most",
        choices=("spread", "best"),
        default="spread",
    ),
    "--goal": option(
        "accuracies that the advice is about, m (default 0.01,0.03; may be repeated)",
        "M,M",
        several(
            number("is not an accuracy", above=0.0), "are not accuracies in metres: write 0.01,0.03"
        ),
        action="extend",
        default=None,
    ),
    "--combine": flag(
        "compare every combination of the flights", dest="combined", default=None, one_of="at most"
    ),
    "--as-given": option(
        "compare the plans as they are", dest="combined", action="store_false", one_of="at most"
    ),
    "--change": flag("also: where would two such flights show which change of the ground?"),
    "--camera": option(
        "free camera parameters, as of `corridor adjust`: "
        "fixed for a pre-calibrated camera (default fraser8)"
    ),
    "--lever-arm": option(
        "estimate the lever arm of each flight (default), or hold it", default="free"
    ),
    "--gnss-sigma": option(
        "true noise of the GNSS, m, where it is not what the plan states", "X,Y,Z", _three
    ),
    "--bias": option("constant error of the GNSS, m", "X,Y,Z", _three),
    "--bias-sigma": option("standard deviation of an unknown constant error, m", "X,Y,Z", _three),
    "--bias-per": option(
        "one constant error for all flights (default), or one each",
        choices=("block", "flight"),
        default="block",
    ),
    "--effect": option("estimate this effect of the antenna too (commas, may be repeated)"),
    "--prior": option(
        "what is known of a parameter, as in gnss_bias.z=0.05 (may be repeated)",
        "NAME=SIGMA",
        _prior,
        action="append",
        default=[],
    ),
    "--correlated": option(
        "share of the GNSS's variance that has a memory (default 0:30)",
        "SHARE[:SECONDS]",
        _memory,
        default=(0.0, 30.0),
    ),
    "--carry-over": option("flight set whose camera is carried over", "PLAN"),
    "--carry-control": option(
        "control points of that flight set (default 5)",
        "N",
        whole("number of control points", 0),
        default=5,
    ),
    "--mounted": option(
        "carry a lever arm over too: flight here = there (may be repeated)",
        "FLIGHT=FLIGHT",
        _pair,
        action="append",
        default=[],
    ),
    "--held": flag("hold what is carried over instead of weighing it"),
    "--jobs": {},
    "--cluster": {},
    "--seed": option("of the ground and the flight (default 0)"),
}


def run(options: argparse.Namespace) -> None:
    """Plan, print the advice and the tables, save what was asked for."""
    from corridor.tools import planning

    options.control = sorted(set(options.control or (0, 1, 3, 5)))
    options.goal = options.goal or [0.01, 0.03]
    noise = planning.GnssNoise(
        options.gnss_sigma, *options.correlated, options.bias, options.bias_sigma, options.bias_per
    )
    known = {"noise": noise, "effects": options.effect, "priors": dict(options.prior)}
    known |= picked(options, "lever_arm seed")
    from corridor.core.errors import InputError

    carried = None
    if options.carry_over is None and (options.mounted or options.held):
        what = "--mounted" if options.mounted else "--held"
        raise InputError(f"{what} is of what is carried over: give --carry-over PLAN too")
    if options.carry_over is not None:
        other = planning.Planner(options.carry_over, **known).expect(options.carry_control)
        carried = other.carried(dict(options.mounted), held=options.held)
    planned = planning.plan(
        options.plans,
        options.control,
        options.place,
        options.goal,
        options.combined,
        options.change,
        progress=lambda step: say(step) if step.of > 1 else None,
        jobs=options.jobs,
        cluster=options.cluster,
        camera=options.camera,
        carried=carried,
        **known,
    )
    print(planned)
    if options.output is None:
        print("\nNothing was written: -o OUT saves the tables, the map and the advice.")
        return
    aside = ("run", "output", "jobs", "cluster")
    planned.settings = {key: value for key, value in vars(options).items() if key not in aside}
    wrote(*planned.save(options.output))
