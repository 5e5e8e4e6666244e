"""Are the two answers that need no catalogue right where nothing is missing? Nulls, and a test.

    python -m benchmarks.diagnosis.nulls -o OUT.json [--simulated 200] [--real 200] [--seed 0]
        [--figures docs/guarantees.json]

Simulated: clean blocks of the ladder, of 45 images. Real: parts of real flights that are adjusted;
what their model says becomes the truth, and their residuals are resampled by runs of images: each
image takes those of another one, of a run drawn with those that follow it, each observation one of
a near place of that picture. So tails, wrong matches, what the lens leaves and what hangs together
within a picture and from one to the next stay those of the flight, and whatever effect there was
is gone, or in the model. The probabilities `p_nothing` and that of the halves have to be uniform
(Kolmogorov-Smirnov). The first round of a diagnosis is made, which is where both are asked.
Source: Künsch 1989 (bootstrap of runs).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import kstest

import corridor
from benchmarks.diagnosis.rates import Rate
from benchmarks.diagnosis.real_noise import surveys
from benchmarks.guarantees import table
from benchmarks.ladder import Dirt, made
from corridor import Adjustment, Block
from corridor.core.adjustment import Model, adjustable_part
from corridor.core.output import whole_file, write_json
from corridor.core.preparation import prepare
from corridor.diagnosis.forward_selection import Question, course_of
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import changed
from corridor.diagnosis.verification.halves import compare_halves

SIMULATED = "sim45"
PARTS = ("s10_s11", "s12_s13", "even_s10_s11_s12", "pair")


def asked(block: Block, seed: int) -> dict:
    """What a block from which nothing is missing says of itself."""
    sound, _ = adjustable_part(prepare(block).block, Model(), False)
    believed = ReferenceModel.of(sound, Model())
    with changed(most_refits=0):
        course = course_of(believed, Question(seed=seed))
    halves = compare_halves(believed, [], course.last.noise, course.last.lens)
    return {"p": course.p_nothing, "halves": halves.p, "by": halves.by, "phi": halves.phi,
            "reason": halves.reason, "found": course.last.log["found"]}  # fmt: skip


def null(kind: str, seed: int) -> Block:
    """One null: of `SIMULATED`, or of a part of a real survey."""
    if kind != SIMULATED:
        return resampled(_adjusted(kind), seed)
    rng = np.random.default_rng([7, seed])
    dirt = Dirt(
        strips=int(rng.integers(1, 4)),
        control=int(rng.choice([0, 4, 6])),
        motion=bool(rng.integers(2)),
        heat=bool(rng.integers(2)),
        water=float(rng.choice([0.0, 0.7])),
        uneven=float(rng.choice([0.0, 0.2])),
    )
    return made(45, seed, dirt).block


@lru_cache
def _adjusted(part: str) -> Adjustment:
    return corridor.adjust(surveys()[part](), loss="cauchy:2")


def figures(rows: Mapping[str, Mapping]) -> dict[str, dict]:
    """Of simulated and real nulls: how many, share below 1 and 5 %, and the test, for both."""
    out = {}
    for kind, mine in (("simulated", True), ("real", False)):
        some = [row for name, row in rows.items() if name.startswith(SIMULATED) == mine]
        for what in ("p", "halves"):
            found = [row[what] for row in some if row.get(what) is not None]
            out[f"{kind}, {what}"] = _figure(found)
    return out


def _figure(found: list[float]) -> dict:
    if not found:
        return {"count": 0}
    return {
        "count": len(found),
        "ks": float(kstest(found, "uniform").pvalue),
        "below_1": str(Rate.of(p < 0.01 for p in found)),
        "below_5": str(Rate.of(p < 0.05 for p in found)),
    }


def wanted(simulated: int, real: int, seed: int) -> Iterator[tuple[str, int]]:
    """Kind and seed of each null, in turn."""
    for n in range(max(simulated, real)):
        if n < simulated:
            yield SIMULATED, seed + n
        if n < real:
            yield PARTS[n % len(PARTS)], seed + n // len(PARTS)


def run(nulls: Iterable[tuple[str, int]], out: Path) -> dict[str, dict]:
    """Name of each null -> what it says; kept in `out`, which an interrupted run goes on with."""
    rows = json.loads(out.read_text())["rows"] if out.is_file() else {}
    for kind, seed in nulls:
        name = f"{kind}_{seed}"
        if name not in rows:
            rows[name] = asked(null(kind, seed), seed)
            print(f"{name}: {rows[name]['p']:.3f} {rows[name]['halves']}", flush=True)
            with whole_file(out) as part:
                write_json({"rows": rows}, part)
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Ask the nulls, and print whether their answers are uniform."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.nulls")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--simulated", type=int, default=200)
    parser.add_argument("--real", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--figures", type=Path, help="docs/guarantees.json, to hold the figures")
    options = parser.parse_args(arguments)
    rows = run(wanted(options.simulated, options.real, options.seed), options.output)
    found = figures(rows)
    for name, figure in found.items():
        print(f"{name}: {figure}")
    if options.figures is not None:
        table.store(options.figures, "nulls", found)
        table.write(options.figures)


def resampled(adjustment: Adjustment, seed: int, run: int = 10) -> Block:
    """A block of an adjustment's truth with residuals of its own in other places."""
    rng = np.random.default_rng(seed)
    system, block = adjustment.system, adjustment.block.copy()
    rows, left = system.image_rows, system.residuals()
    pixels = np.nan_to_num(left.pixels)
    source = _sources(system, run, rng)
    # Poses, points and camera have taken up a share of what was measured.
    taken = 3 * len(system.points.names) + 6 * len(source)
    size = (1.0 - min(taken / (2 * len(pixels)), 0.9)) ** -0.5
    error = size * _moved(rows, pixels, source)
    for tie, name in ((True, "tie_points"), (False, "marks")):
        mine = rows.tie == tie
        at = rows.row[mine] - (0 if tie else len(block.tie_points))
        given = getattr(block, name)
        xy = np.array(given[["x", "y"]], dtype=float)
        xy[at] = (rows.xy - pixels + error)[mine]
        setattr(block, name, given.assign(x=xy[:, 0], y=xy[:, 1]))
    if len(block.gnss):
        gnss = system.gnss
        place = np.full(len(source), -1)
        place[gnss.image] = np.arange(len(gnss.image))
        other = place[source[gnss.image]]
        drawn = np.where(other[:, None] >= 0, gnss.residual[other], 0.0)
        xyz = gnss.given - gnss.residual + drawn
        rows_of = block.gnss.set_index(block.gnss["image"].astype(str))
        rows_of.loc[gnss.names.astype(str), ["x", "y", "z"]] = xyz
        block.gnss = rows_of.reset_index(drop=True)
    control = system.control
    if len(control.names):
        truth = control.given - control.residual
        ground = block.ground.set_index(block.ground["point"].astype(str))
        noise = control.sigma * rng.standard_normal(truth.shape)
        ground.loc[control.names.astype(str), ["x", "y", "z"]] = truth + noise
        block.ground = ground.reset_index(drop=True)
    return block


def _sources(system, run: int, rng) -> np.ndarray:
    """Number (images,) of the image whose residuals each takes: of its own camera."""
    images = system.images
    order = np.lexsort((system.image_order, np.nan_to_num(images.time), images.flight))
    out = np.arange(len(order))
    for camera in np.unique(images.camera):
        mine = order[images.camera[order] == camera]
        for first in range(0, len(mine), run):
            taken = rng.integers(len(mine)) + np.arange(len(mine[first : first + run]))
            out[mine[first : first + run]] = mine[taken % len(mine)]
    return out


def _moved(rows, pixels: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Residuals (n, 2) px of near places in each observation's source image, each taken once.

    One that is taken twice would be an error that two matches share.
    """
    out = np.zeros_like(pixels)
    order = np.argsort(rows.image, kind="stable")
    ends = np.searchsorted(rows.image[order], np.arange(len(source) + 1))
    for n, other in enumerate(source):
        mine, theirs = order[ends[n] : ends[n + 1]], order[ends[other] : ends[other + 1]]
        theirs = theirs[rows.tie[theirs]]
        while len(mine) and len(theirs):
            one, near = linear_sum_assignment(cdist(rows.xy[mine], rows.xy[theirs]))
            out[mine[one]] = pixels[theirs[near]]
            # Where there are more than the source has, the next round takes them again.
            mine = np.delete(mine, one)
    return out


if __name__ == "__main__":
    main()
