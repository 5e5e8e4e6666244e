"""How often the diagnosis names what is wrong with attitudes or a rig, at ten standard deviations.

    python -m benchmarks.rigs [-o FOLDER] [--count 20] [--nulls 30] [--first 0] [--kinds A,B]
        [--sigmas 10] [--figures docs/guarantees.json]

Small flights of drawn geometry (heights, overlaps, obliqueness, noise, pictures a second, shaking,
temperature that rises or goes up and down): 12 to 24 images with attitudes, or exposures of a head
of two or three cameras. In each one effect is hidden, in a drawn direction of its parameters, of
the size that an adjustment with it, and all else that is believed, tells from zero by ten standard
deviations (its own covariance matrix). `attitudes` and `rig` are those in which nothing is hidden.
An interrupted run goes on where it stopped. Prints for each effect how often it was named, stood in
a set of look-alikes, was missed, and what was named that is not there, with intervals (95 %); and
the values over their sigmas. --figures puts the counts into that file and the page beside it.
"""

import argparse
import warnings
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np

import corridor
from benchmarks.diagnosis.rates import Rate
from benchmarks.diagnosis.run import run
from benchmarks.diagnosis.trials import Trial
from benchmarks.diagnosis.truth import truth_of
from benchmarks.guarantees import table
from corridor.core.camera import Camera
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.core.simulation import (
    Flight,
    Ground,
    Noise,
    Plan,
    TiePoints,
    add_noise,
    perfect_block,
)

OF_ATTITUDES = (
    "boresight", "boresight_drift", "boresight_by_temperature", "attitude_clock_offset",
    "gimbal_lag",
)  # fmt: skip
OF_RIGS = ("mounting", "mounting_by_temperature", "mounting_step", "member_delay")
NULLS = ("attitudes", "rig")
SIGMAS = 10.0
# Start values miss the truth by, m and rad.
_MISSED_M, _MISSED_RAD = 0.3, 0.005
_SIZE = {"width": 4000, "height": 3000}


def made(kind, seed, sigmas=SIGMAS):
    """A block and what is hidden in it, `{slug: {parameter: {group: value}}}`."""
    rng = np.random.default_rng([seed, (*NULLS, *OF_ATTITUDES, *OF_RIGS).index(kind)])
    of_rig = kind == "rig" or kind in OF_RIGS
    plan = _plan(rng, of_rig, free=kind not in ("boresight", "mounting"))
    block = perfect_block(plan, seed)
    block = _warmed(block, rng, there_and_back=rng.random() < 0.7)
    if kind == "boresight":
        # What is stated as calibrated is not estimated: then it may be missing.
        block.extra["attitudes"] = {"calibrated": True}
    if kind in NULLS:
        return _measured(block, plan, rng), {}
    values = _values(_measured(block, plan, rng), kind, rng, sigmas)
    return _measured(corridor.effects.add(block, {kind: values}), plan, rng), {kind: values}


def _plan(rng, of_rig, free):
    height = rng.uniform(40, 90)
    camera = "nadir" if of_rig else "camlight"
    fly = partial(
        Flight, camera=camera, forward=rng.uniform(0.65, 0.75), interval_s=rng.uniform(1.5, 3.0),
        angular_rate_deg_s=rng.uniform(2.0, 6.0), attitude_jitter_deg=rng.uniform(1.0, 3.0),
        speed_m_s=None, warming_c=0.0,
    )  # fmt: skip
    if of_rig:
        flights = (fly("F1", height, strips=2, images=int(rng.integers(12, 17))),)
    else:
        flights = (
            fly("F1", height, strips=2, images=int(rng.integers(10, 15))),
            fly("F2", height * rng.uniform(1.0, 1.3), strips=1, images=int(rng.integers(6, 9)),
                tilt_deg=rng.uniform(10, 25)),
        )  # fmt: skip
    members = {}
    for name in ("left", "right")[: 1 + int(rng.integers(2))] if of_rig else ():
        side = -1.0 if name == "left" else 1.0
        turn = [rng.normal(0, 0.05), side * rng.uniform(0.3, 0.6), rng.normal(0, 0.05)]
        members[name] = {
            "xyz": [side * rng.uniform(0.05, 0.15), *rng.normal(0, 0.03, 2)],
            "quaternion": quaternion_from_rotation(rotation_from_vector(np.array(turn))).tolist(),
            # `mounting` is believed where it is not exact, and a candidate where it is.
            "sigma_m": 0.002 if free else 0.0, "sigma_deg": 0.02 if free else 0.0,
        }  # fmt: skip
    cameras = {
        name: Camera.from_table(name, _SIZE | {"f": rng.uniform(3000, 4500), "calibrated": True})
        for name in ("nadir", *members)
        if of_rig
    }
    attitude = rng.uniform(0.02, 0.1)
    return Plan(
        "rigs", flights, tie_points=TiePoints(per_image=80), cameras=cameras,
        ground=Ground(control=int(rng.integers(3, 6)), check=4, layout="spread"),
        attitudes=not of_rig, rig={"head": {"base": "nadir", "member": members}} if members else {},
        noise=Noise(tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.03), control_m=0.01,
                    attitude_deg=(attitude, attitude, 2 * attitude)),
    )  # fmt: skip


def _warmed(block, rng, there_and_back):
    """Temperatures of the camera: it warms by some degrees, or goes through sun and shade."""
    time = block.column("images", "time_s")
    along = (time - time.min()) / np.ptp(time)
    # By the order of exposures: pauses between flights are long beside them.
    order = np.unique(time, return_inverse=True)[1] / (len(np.unique(time)) - 1)
    warm = 5 * np.sin(2 * np.pi * (1.3 * order + rng.uniform())) if there_and_back else 8 * along
    block.put("images", ("temperature_c",), (20.0 + warm)[:, None])
    return block


def _measured(block, plan, rng):
    """With the noise of the plan, and start values that miss the truth."""
    block = add_noise(block, noise=plan.noise, seed=int(rng.integers(1 << 31)))
    poses = block.poses.copy()
    poses[:, :3] += _MISSED_M * rng.standard_normal((len(poses), 3))
    turn = rotation_from_vector(_MISSED_RAD * rng.standard_normal((len(poses), 3)))
    rotation = turn @ corridor.core.geometry.rotation_from_quaternion(poses[:, 3:])
    poses[:, 3:] = quaternion_from_rotation(rotation)
    block.put("images", corridor.core.block.POSE, poses)
    block.lever_arm = {}
    return block


def _values(block, slug, rng, sigmas):
    """Values in a drawn direction that an adjustment tells from zero by so many sigmas."""
    if slug == "mounting":
        # Stated exactly it has no sigma: how well the pictures tell it is asked of a free one.
        block = block.copy()
        for member in block.extra["rig"]["head"]["member"].values():
            member |= {"sigma_m": 1.0, "sigma_deg": 10.0}
    free = corridor.adjust(block, effects=[slug])
    columns = free.system.columns
    mine = np.array([u.owner == slug for u in columns.shared])
    covariance = free.covariance.shared[np.ix_(mine, mine)]
    direction = np.linalg.cholesky(covariance) @ rng.standard_normal(mine.sum())
    length = np.sqrt(direction @ np.linalg.solve(covariance, direction))
    out = {}
    for unknown, value in zip(
        [u for u in columns.shared if u.owner == slug], sigmas * direction / length, strict=True
    ):
        out.setdefault(unknown.name, {})[unknown.group] = float(value)
    return out


def _loaded(kind, seed, sigmas):
    block, hidden = made(kind, seed, sigmas)
    return block, None, truth_of({"effects": hidden})


def trials(kinds, count, nulls, first=0, sigmas=SIGMAS):
    """Of each kind as many as asked for, in turns: an early end has some of each."""
    pairs = [
        (kind, first + n)
        for n in range(max(count, nulls))
        for kind in kinds
        if n < (nulls if kind in NULLS else count)
    ]
    return [
        Trial(f"{kind}-{n:03d}", f"{kind}, {n}, {sigmas}", partial(_loaded, kind, n, sigmas))
        for kind, n in pairs
    ]


def report(rows):
    """Lines of text, a row a kind."""
    lines = [f"{'':26}{'named':>20}{'in the set':>20}{'missed':>9}{'false':>20}   value over sigma"]
    for kind in (*OF_ATTITUDES, *OF_RIGS, *NULLS):
        mine = [row for row in rows if row["name"].rsplit("-", 1)[0] == kind]
        done = [row for row in mine if not row["failed"]]
        if not mine:
            continue
        named = Rate.of(kind in row["named"] for row in done)
        inside = Rate.of(kind in row["inside"] for row in done)
        false = Rate.of(bool(row["wrong"] or row["extras"]) for row in done)
        off = [p["sigmas"] for row in done for p in row["parameters"]]
        rms = f"{np.sqrt(np.mean(np.square(off))):.2f} ({len(off)})" if off else ""
        cells = (_short(named), _short(inside)) if kind not in NULLS else ("", "")
        missed = "" if kind in NULLS else len(done) - inside.hits
        lines.append(f"{kind:26}{cells[0]:>20}{cells[1]:>20}{missed:>9}{_short(false):>20}   {rms}")
        lines += [f"    failed {row['name']}: {row['failed']}" for row in mine if row["failed"]]
        for sets, times in Counter(_said(row) for row in done).most_common(6):
            lines.append(f"    {times:3d}  {sets}")
    return lines


def counts(rows):
    """What of the rows stands in the guarantees: of each kind how many were done, named, in the set
    that was named, and how many had something false."""
    out = {}
    for kind in (*OF_ATTITUDES, *OF_RIGS, *NULLS):
        done = [r for r in rows if r["name"].rsplit("-", 1)[0] == kind and not r["failed"]]
        out[kind] = {
            "done": len(done),
            "named": sum(kind in row["named"] for row in done),
            "inside": sum(kind in row["inside"] for row in done),
            "false": sum(bool(row["wrong"] or row["extras"]) for row in done),
        }
    return out


def _said(row):
    """What was stated firmly of a block, in words."""
    parts = [
        effect["slug"]
        + (f" ({effect['flight']})" if "flight" in effect else "")
        + ("" if effect["class"] == "named" else f" [{effect['class']}")
        + "".join(f" or {other}" for other in effect["cannot_be_told_apart_from"])
        + ("" if effect["class"] == "named" else "]")
        for effect in row["said"]["effects"]
    ]
    parts += [f"unknown: {one['group']}" for one in row["said"]["unknown"]]
    return "; ".join(dict.fromkeys(parts)) or "nothing"


def _short(rate):
    low, high = rate.interval
    return f"{rate.hits}/{rate.count}" + (
        f" ({100 * low:.0f}-{100 * high:.0f} %)" if rate.count else ""
    )


def main(arguments=None):
    """Run it as a command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/rigs"))
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--nulls", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", default=",".join((*NULLS, *OF_ATTITUDES, *OF_RIGS)))
    parser.add_argument("--sigmas", type=float, default=SIGMAS)
    parser.add_argument("--figures", type=Path)
    options = parser.parse_args(arguments)
    kinds = options.kinds.split(",")
    chosen = trials(kinds, options.count, options.nulls, options.first, options.sigmas)
    warnings.simplefilter("ignore")
    rows = run(chosen, options.output, rivals=False)
    print("\n".join(report(rows)))
    if options.figures:
        first, sigmas = options.first, options.sigmas
        found = {"kinds": counts(rows), "first": first, "sigmas": sigmas, "nulls": list(NULLS)}
        table.store(options.figures, "rigs", found)
        table.write(options.figures)


if __name__ == "__main__":
    main()
