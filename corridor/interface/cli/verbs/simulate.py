"""Simulate a flight plan: a block that nobody flew, and what is true of it.

examples:
  corridor simulate
      the plans that come with corridor
  corridor simulate thesis_50vt -o out/flown
      one of them: 42 nadir images of a dike, with ordinary noise
  corridor simulate thesis_50vt -o out/perfect --noise none
      the same free of error: all rays of a point meet in it
  corridor simulate thesis_50vt+thesis_50ob -o out/both --seed 3
      two of them, flown one after the other over the same ground
  corridor simulate thesis_50vt --show > PLAN.toml
      a copy of one, to make your own of
  corridor simulate PLAN.toml -o out/flown
      your own
  corridor simulate PLAN.toml -o out/shaken --effect rolling_shutter:readout=0.03
      with an effect of `corridor effects` on top of the plan's own
  corridor simulate --like BLOCK -o out/counterpart --camera fraser10 --effect rolling_shutter
      the counterpart of a measured block: what it would be if that model were the whole truth

BLOCK is a folder like that of a measured block, with start values that miss the truth. What is
true is written beside it, to BLOCK.truth.json. The same plan and seed give the same bytes.
A plan without a table [noise] is flown with ordinary noise; in Python, `corridor.simulate` adds
only the noise that it is given.

Keys of a plan (`corridor.simulation.Plan` and the types beside it say what each means):
  head          name, axis_m, bend_radius_m, gnss, attitudes, source, description
  [[flight]]    name, height_m, camera, strips, offsets_m, images, forward, side, speed_m_s,
                interval_s, stations_m, tilt_deg, look, heading, direction, long_side,
                attitude_jitter_deg, position_jitter_m, velocity_jitter_m_s, angular_rate_deg_s,
                wind_m_s, start_s, pause_s, turn_s, lever_arm_m, temperature_c, warming_c
  [terrain]     relief_m, level_m, roughness_m
  [tie_points]  per_image, border_px, match_angle_deg, match_scale
  [ground]      control, check, layout, every_m, offset_m, check_from_ties, within_m,
                bars, bar_m
  [noise]       tie_px, mark_px, gnss_m, control_m, attitude_deg, outliers, rounding_px, gnss_slow,
                gnss_slow_s, distance_m, image_rho, gnss_rho, control_rho
  [start]       centre_m, rotation_deg, points_m, camera
  [camera.NAME]  as in block.toml
  [rig.NAME]     as in block.toml: flights with the camera of its base carry the other members
  [effects.SLUG] PARAMETER = VALUE
  [effect.SLUG]  what that effect has to know of the block, as in block.toml

With --like, the block is adjusted with the model given (as to `corridor adjust`), and every
measurement is made anew: same images, points, gaps and control, noise as large and of the kinds
that the residuals show.
"""

import argparse
from pathlib import Path

from corridor.core.command.options import Bars, effect, flag, given_once, option, wrote

MARK = "block.toml"
OPTIONS = {
    "plan": option("a .toml file, or names of plans joined by +", "PLAN", nargs="?"),
    "--like": option(
        "in place of a plan: the simulated counterpart of this measured block", "BLOCK", Path
    ),
    "--output": {"metavar": "BLOCK"},
    "--effect": option(
        "add this effect; several parameters with commas (may be repeated); with --like, "
        "a SLUG alone is part of the model and estimated",
        "SLUG:PARAMETER=VALUE",
        effect,
        action="append",
    ),
    "--camera": option(
        "with --like: free camera parameters of the model, as for `corridor adjust`"
    ),
    "--noise": option(
        "ordinary, or none for a block free of error (default: as the plan's [noise] says, "
        "ordinary where it has none)",
        choices=("ordinary", "none"),
    ),
    "--show": flag("print the plan, as a file to start from"),
    "--seed": {},
}


def run(options: argparse.Namespace) -> None:
    """Simulate, say what came of it, write it; or list the plans."""
    if options.plan is None and options.like is None and options.output is None:
        _list_plans()
        return
    if options.show:
        _show(options)
        return
    believed = [slug for slug, values in options.effect if values is None]
    added = given_once((slug, values) for slug, values in options.effect if values is not None)
    _check(options, believed)
    from corridor.core.output import telling

    with Bars() as bars:
        say = telling(bars)
        if options.like is None:
            import corridor

            plan = corridor.simulation.read_plan(options.plan)
            noise, why = _noise(options.noise, plan)
            block = corridor.simulate(plan, added, options.seed, noise=noise, progress=bars)
        else:
            block = _like(options, believed, added, say)
        rays = len(block.tie_points) / max(len(block.points), 1)
        print(
            f"{block.name}: {len(block.images)} images in {len(block.flight_names)} flight(s), "
            f"{len(block.tie_points):,} tie observations of {len(block.points):,} points "
            f"({rays:.1f} images a point), {len(block.ground):,} ground points, "
            f"{len(block.gnss)} GNSS positions"
        )
        if options.like is None:
            print(_told(noise, why))
        for slug, values in block.truth["effects"].items():
            print(f"with {slug}: " + ", ".join(f"{k} = {v}" for k, v in values.items()))
        if options.output is None:
            print("Nothing was written: -o BLOCK writes the block and its truth.")
            return
        say("writing files", 0.0, 1.0)
        block.write(options.output)
        say("writing files", 1.0, 1.0)
    wrote(options.output, f"{options.output}.truth.json")


def _show(options):
    """Print the file of a plan."""
    from corridor.core.errors import InputError
    from corridor.core.simulation import read_plan, ready_made

    known = ready_made()
    if options.plan not in known:
        read_plan(options.plan or "")
        raise InputError(f"--show prints one plan that comes with corridor: {', '.join(known)}")
    print(known[options.plan].read_text(encoding="utf-8"), end="")


def _check(options, believed):
    from corridor.core.errors import InputError

    there = options.output is not None and (options.output / MARK).is_file()
    if there and not Path(f"{options.output}.truth.json").is_file():
        raise InputError(
            f"{options.output} is a block without {options.output.name}.truth.json beside it, so "
            "not a simulated one, and is not replaced; name a new folder"
        )
    if options.like is None:
        if options.plan is None and options.output is not None:
            raise InputError(
                "-o BLOCK needs a PLAN, or --like BLOCK; without both, plans are listed"
            )
        if believed:
            raise InputError(
                f"--effect {believed[0]} is not SLUG:PARAMETER=VALUE, for example "
                "rolling_shutter:readout=0.03; a SLUG alone goes with --like"
            )
        if options.camera is not None:
            raise InputError("--camera says what is adjusted: it goes with --like BLOCK")
    elif options.noise is not None:
        raise InputError("--noise is of a plan: a counterpart has the noise of the measured block")
    elif options.plan is not None:
        raise InputError(f"a plan ({options.plan}) and --like {options.like}: give one of them")


def _noise(wanted, plan):
    """The errors of measurement of a flight, and why these."""
    from corridor.core.simulation import ORDINARY_NOISE, Noise

    if wanted == "none":
        return Noise(), ""
    if wanted == "ordinary" or plan.noise == Noise():
        return ORDINARY_NOISE, "ordinary; --noise none for a block free of error"
    return plan.noise, "as the plan says"


def _told(noise, why):
    from corridor.core.simulation import Noise

    if noise == Noise():
        return "noise: none, all rays of a point meet in it"
    metres = [
        "/".join(f"{v:g}" for v in (m if isinstance(m, tuple) else (m,)))
        for m in (noise.gnss_m, noise.control_m)
    ]
    return (
        f"noise: tie points {noise.tie_px:g} px, marks {noise.mark_px:g} px, GNSS {metres[0]} m, "
        f"ground points {metres[1]} m ({why})"
    )


def _like(options, believed, added, say):
    """The counterpart of a measured block, with effects on top of it where values are given."""
    import corridor
    from corridor.core.errors import WorkFailed

    say("adjusting", 0.0, 1.0)
    measured = corridor.read(options.like)
    adjustment = corridor.adjust(measured, camera=options.camera, effects=believed)
    if not adjustment.converged:
        raise WorkFailed(
            f"the adjustment of {measured.name} did not converge: `corridor adjust` prints what "
            "lies far from the start values"
        )
    say("adjusting", 1.0, 1.0)
    say("simulating", 0.0, 1.0)
    block = corridor.diagnosis.counterpart(adjustment, options.seed, added)
    say("simulating", 1.0, 1.0)
    return block


def _list_plans():
    from corridor.core.simulation import read_plan, ready_made

    for name in ready_made():
        plan = read_plan(name)
        print(f"{name}\n  {plan.description}\n  {plan.source}")
    print("\n`corridor simulate NAME -o BLOCK` flies one, NAME+NAME several over the same ground.")
