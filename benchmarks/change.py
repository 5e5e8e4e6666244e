"""How often a change of two dates says what is true: `python -m benchmarks.change -o FOLDER`.

rates: the same dike at rest with other noise, again and again: the scatter of displacements,
distances and volumes over their stated sigmas, false alarms, what is seen at the level of
detection. verdicts: the dike at rest, and with motions of the ground, with and without effects of
the camera. maps: against precision maps from simulated adjustments (James, Robson and Smith 2017),
and M3C2 of py4dgeo where that is installed. speed: many images and core points, seconds and memory
beyond the adjustments.

Every draw is kept in FOLDER as soon as it is done: the same command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections import Counter
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, hstack

import corridor
from benchmarks.diagnosis.rates import Rate
from benchmarks.draws import kept, ratio
from benchmarks.guarantees import table
from corridor.core import effects
from corridor.core.output import whole_file, write_json
from corridor.core.simulation import Noise, TiePoints, add_noise, perfect_block, read_plan
from corridor.tools.change import (
    Joint,
    Settlement,
    Slide,
    Tilt,
    clouds,
    make_cores,
    moved_ground,
    point_changes,
    surface_change,
    volume,
)

NOISE = Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005)
# What the camera does at the second date, and what is then adjusted.
CAMERAS = {
    "none": {},
    "rolling shutter": {"rolling_shutter": {"readout": 0.02}},
    "focal length": {"focal_per_flight": {"f": {"F1": 5.0, "F2": -5.0}}},
    "GNSS bias": {"gnss_bias": {"z": 0.06}},
    "lever arm": {"lever_arm": {"x": 0.1, "z": 0.1}},
    "thermal": {"thermal": {"scale": 0.3}},
}


def dike(per_image: int = 120, seed: int = 1):
    """The dike of the shipped plan, without any error."""
    plan = read_plan(Path(__file__).parents[1] / "data_synthetic" / "dike.toml")
    return perfect_block(replace(plan, tie_points=TiePoints(per_image)), seed)


def flown(block, draw, motion=None, added=None):
    """One flight over a block's ground."""
    block = moved_ground(block, motion) if motion else block
    block = effects.add(block, added) if added else block
    return add_noise(block, **asdict(NOISE), seed=draw)


def middle(block):
    return tuple(np.median(block.points[["x", "y"]].to_numpy(float), axis=0))


def motions(block) -> dict:
    """What the ground does between the dates, in the middle of the dike."""
    at = middle(block)
    return {
        "rest": None,
        **{f"bowl {mm} mm": Settlement(at, 10.0, mm / 1000, 0.5) for mm in (5, 10, 20)},
        "wide bowl 30 mm": Settlement(at, 15.0, 0.03, 0.5),
        "tilt 30 mm": Tilt(at, 10.0, 0.03),
        "slide 30 mm": Slide(at, 10.0, (0.03, 0.0, -0.03)),
    }


def draws(count: int, first: int = 5000, folder: Path | None = None) -> list[dict]:
    """Comparisons of the dike at rest: changes over their stated sigma, by kind (surface, points,
    volume); seen (2,): share of the surface that is significant at the level of detection and at
    twice; moved: whether a point is said to have moved.
    """
    draw = partial(_draw, dike(), first)
    return [draw(k) for k in range(count)] if folder is None else kept(folder, range(count), draw)


def _draw(block, first: int, k: int) -> dict:
    x, y = middle(block)
    polygon = np.array([[x - 15, y - 10], [x + 15, y - 10], [x + 15, y + 10], [x - 15, y + 10]])
    pair = [corridor.adjust(flown(block, first + 2 * k + n)) for n in (0, 1)]
    joint = Joint(*clouds(*pair, True))
    cores = make_cores(joint.before.xyz, joint.after.xyz, spacing=12.0)
    surface = surface_change(joint, cores, sampled=False)
    points = point_changes(joint, 0.01, "stated", "rigid")
    one = volume(joint, polygon, cores, sampled=False)
    # The distance is linear: a rise of its level of detection is added as such.
    risen = np.abs(surface.distance + np.outer([1, 2], surface.detection))
    return {
        "surface": surface.distance / surface.sigma,
        "points": (points.shift / points.sigma)[~points.held].ravel(),
        "volume": np.array([one.value / one.sigma]),
        "seen": (risen > surface.detection).mean(axis=1),
        "moved": points.moved.any(),
        "as_a_whole": points.overall.probability,
    }


def scatter(found: list[dict], kind: str) -> dict:
    """Root mean square of numbers over their stated sigma: 1 is right."""
    return ratio(np.array([np.mean(one[kind] ** 2) for one in found]))


def rates(count: int, folder: Path) -> dict:
    """Scatter over stated sigma (1 is right), false alarms, detection."""
    found = draws(count, folder=folder / "rates")
    seen = np.array([one["seen"] for one in found])
    off = 1.96 * seen.std(axis=0, ddof=1) / np.sqrt(count)
    return {
        "draws": count,
        "scatter_over_sigma": {k: scatter(found, k) for k in ("surface", "points", "volume")},
        "draws_with_a_false_point": Rate.of(one["moved"] for one in found).to_dict(),
        "points_as_a_whole_below_1_percent": Rate.of(
            one["as_a_whole"] < 0.01 for one in found
        ).to_dict(),
        "seen_at_level_of_detection_and_at_twice": seen.mean(axis=0).tolist(),
        "half_width_of_the_interval": off.tolist(),
    }


def verdicts(rest: int, moved: int, folder: Path) -> dict:
    """Verdicts, by what the ground and the camera did, of so many draws each at rest and moved.

    `+camera`: said to have moved, with an effect of the camera that is shown and modelled beside.
    """
    block = dike()
    pairs = [(m, c) for m in motions(block).items() for c in CAMERAS.items()]
    found = {}
    for number, ((motion, ground), (camera, added)) in enumerate(pairs):
        draw = partial(_verdict, block, 100_000 * (number + 1), ground, added)
        numbers = range(moved if ground else rest)
        every = kept(folder / "verdicts" / f"{motion}, {camera}", numbers, draw)
        if every:
            found[f"{motion}, {camera}"] = dict(Counter(str(one["verdict"]) for one in every))
    alone = [counts for name, counts in found.items() if name.startswith("rest, ")]
    false = [sum(n for word, n in one.items() if word.startswith("moved")) for one in alone]
    return found | {
        "moved_at_rest": Rate(false[0], rest).to_dict(),
        "moved_by_camera_alone": Rate(sum(false[1:]), rest * len(false[1:])).to_dict(),
    }


def _verdict(block, first: int, ground, added, k: int) -> dict:
    before = flown(block, first + 2 * k)
    after = flown(block, first + 2 * k + 1, ground, added)
    told = corridor.change(before, after, same_ties=True, spacing=8.0)
    both = "+camera" if told.verdict == "moved" and told.remaining else ""
    return {"verdict": told.verdict + both}


def speed(images: int, same_ties: bool) -> dict:
    """Seconds and memory (GB) of a comparison, the camera's part in it, beyond two adjustments."""
    plan = read_plan(Path(__file__).parents[1] / "data_synthetic" / "dike.toml")
    grown = images / 42
    axis = [(0.0, 0.0), (86.5 * grown, 28.1 * grown)]
    flights = tuple(replace(f, images=round(f.images * grown)) for f in plan.flights)
    plan = replace(plan, axis_m=axis, flights=flights, tie_points=TiePoints(200))
    block = perfect_block(plan, 1)
    pair = [corridor.adjust(flown(block, draw), threads=2) for draw in (1, 2)]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    began, worked = time.perf_counter(), time.process_time()
    # Core points as close as the most of them allow.
    found = corridor.change(*pair, threads=2, same_ties=same_ties, spacing=0.1)
    seconds, worked = time.perf_counter() - began, time.process_time() - worked
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "images": len(block.images),
        "observations": len(block.tie_points),
        "core_points": len(found.surface),
        "same_ties": same_ties,
        "seconds": seconds,
        "processor_seconds": worked,
        "peak_gb_before": before,
        "peak_gb_after": after,
    }


def maps(count: int, folder: Path) -> dict:
    """Sigmas of one date from so many simulated adjustments against ours, and processor seconds.

    Of tie points, as precision maps have them; of the surface at core points; of a volume.
    """
    block = dike()
    began = time.process_time()
    one = corridor.adjust(flown(block, 1))
    ours = one.point_sigma / one.sigma0
    exact = time.process_time() - began
    surface = surface_over(one, corridor.adjust(flown(block, 2)))
    inside = np.ones((1, len(surface))) / len(surface)
    functions = [surface.joint.sides(f)[0] for f in (surface.functions, surface.sums(inside))]
    stated = [one_sided(surface.joint, rows) / one.sigma0 for rows in functions]
    names = surface.joint.before.epoch.names

    def draw(k: int) -> dict:
        began = time.process_time()
        points = corridor.adjust(flown(block, 100 + k)).points.set_index("point")
        xyz = points.loc[names, ["x", "y", "z"]].to_numpy(float)
        return {"xyz": xyz, "seconds": time.process_time() - began}

    found = kept(folder / "maps", range(count), draw)
    drawn = np.array([one["xyz"] for one in found])
    spread = np.std(drawn, axis=0, ddof=1)[[list(names).index(n) for n in one.points["point"]]]
    values = [drawn.reshape(count, -1) @ rows.T for rows in functions]
    ratios = [np.std(v, axis=0, ddof=1) / s for v, s in zip(values, stated, strict=True)]
    return {
        "draws": count,
        "standard_error": float(np.sqrt(0.5 / (count - 1))),
        "scatter_over_sigma_xyz": np.sqrt(np.mean((spread / ours) ** 2, axis=0)).tolist(),
        "scatter_over_sigma_surface": float(np.sqrt(np.mean(ratios[0] ** 2))),
        "scatter_over_sigma_volume": float(ratios[1][0]),
        "seconds_simulated": float(sum(one["seconds"] for one in found)),
        "seconds_exact": exact,
    }


def surface_over(before, after):
    """The change of the surface in the polygon of the volumes, upright cells."""
    joint = Joint(*clouds(before, after, True))
    x, y = np.median(joint.before.xyz[:, :2], axis=0)
    grid = np.stack(np.meshgrid(np.arange(-13.5, 15, 3), np.arange(-8.5, 10, 3)), axis=-1)
    places = grid.reshape(-1, 2) + [x, y]
    first, second = joint.before.xyz, joint.after.xyz
    return surface_change(
        joint, make_cores(first, second, normal="vertical", at=places), sampled=False
    )


def one_sided(joint, rows) -> np.ndarray:
    """Standard deviations (r,), m, of functions of the points of the first date alone."""
    none = csr_array((rows.shape[0], 3 * len(joint.after.epoch.names)))
    return np.sqrt(joint.variance(hstack([rows, none], format="csr")))


def m3c2() -> dict | None:
    """Differences (m) of our distances from those of py4dgeo on the same clouds; None without."""
    try:
        import py4dgeo
    except ImportError:
        return None
    block = dike()
    bowl = Settlement(middle(block), 15.0, 0.03, 0.5)
    pair = [corridor.adjust(flown(block, 1)), corridor.adjust(flown(block, 2, bowl))]
    joint = Joint(*clouds(*pair, False))
    first, second = joint.before.xyz, joint.after.xyz
    cores = make_cores(first, second, spacing=6.0)
    ours = surface_change(joint, cores)
    theirs = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(first.copy()), py4dgeo.Epoch(second.copy())),
        corepoints=ours.cores.xyz.copy(),
        corepoint_normals=ours.cores.normal.copy(),
        cyl_radius=ours.cores.radius,
        max_distance=ours.cores.reach,
    )
    distance, uncertainty = theirs.run()
    away = np.abs(ours.distance - distance)
    return {
        "core_points": len(ours),
        "largest_difference_m": float(np.nanmax(away)),
        "median_detection_ours_m": float(np.median(ours.detection)),
        "median_detection_theirs_m": float(np.nanmedian(uncertainty["lodetection"])),
    }


def main(arguments: list[str] | None = None) -> None:
    """Run what was asked for, write change.json, and the page of guarantees."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--verdicts", type=int, default=50, help="draws of each camera at rest")
    parser.add_argument("--moved", type=int, default=10, help="draws of each camera and motion")
    parser.add_argument("--maps", type=int, default=1000)
    parser.add_argument("--images", type=int, default=1000, help="of the timing; 0: none")
    parser.add_argument("--figures", type=Path, help="docs/guarantees.json, to hold the figures")
    options = parser.parse_args(arguments)
    folder = options.output
    found = {
        "rates": rates(options.draws, folder) if options.draws else None,
        "verdicts": verdicts(options.verdicts, options.moved, folder) if options.verdicts else None,
        "maps": maps(options.maps, folder) if options.maps else None,
        "m3c2": m3c2(),
        "speed": [speed(options.images, same) for same in (True, False) if options.images],
    }
    print(found)
    with whole_file(folder / "change.json") as part:
        write_json(found, part)
    if options.figures is not None:
        known = table.stored(options.figures).get("change", {})
        run = {part: figures for part, figures in found.items() if figures}
        table.store(options.figures, "change", known | run)
        table.write(options.figures)


if __name__ == "__main__":
    main()
