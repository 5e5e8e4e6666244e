"""Bands of simulated counterparts, tried on blocks of the independent generator.

Nothing hidden: which share of the statistics leaves its 95 % band. One effect hidden: whether a
statistic leaves it, and how much of the gap is gone when the effect is added.

python benchmarks/counterparts.py                    30 null blocks, every effect once, timing
python benchmarks/counterparts.py --short            a few of each
"""

import argparse
import os
import sys
import time
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.diagnosis.generator import CATALOGUE, NULLS, null, single
from benchmarks.diagnosis.generator.generate import generate
from corridor.core.adjustment import Model
from corridor.core.effects import find
from corridor.diagnosis import Closing, ReferenceModel, compare, counterparts

SMALL = {"images": 45, "observations": 160}
SHORT = ("rolling_shutter", "lever_arm", "control_blunder", "sensor_unflatness")


def believed(block, *effects):
    """Adjusted as `corridor diagnose` does by default."""
    return ReferenceModel.of(block, Model()).adjust([find(e) for e in effects])


def null_block(kind, seed):
    """Statistics that leave, and how many there are."""
    block = generate(null(kind, **SMALL), seed).block
    found = compare(counterparts(believed(block), seed=seed))
    return kind, len(found.leaving), len(found.statistics)


def single_block(slug, seed):
    """Estimate over sigma, statistics that leave before, the gap before and after."""
    block = generate(single(slug, **SMALL), seed).block
    before = compare(counterparts(believed(block), seed=seed))
    with_effect = believed(block, slug)
    after = compare(counterparts(with_effect, seed=seed))
    mine = with_effect.effects[with_effect.effects["slug"] == slug]
    size = float((mine["value"].abs() / mine["sigma"]).max())
    return slug, size, len(before.leaving), before.gap, after.gap, Closing(before, after).closed


def timing():
    """Seconds for 20 counterparts of 180 images on two threads."""
    block = generate(null("everyday", images=180, observations=333), 1).block
    adjusted = believed(block)
    began = time.perf_counter()
    counterparts(adjusted, count=20, threads=2)
    return len(block.tie_points), time.perf_counter() - began


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--short", action="store_true", help="a few blocks of each kind")
    parser.add_argument("--skip-nulls", action="store_true", help="blocks with an effect only")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="blocks at once")
    options = parser.parse_args()
    work = Parallel(n_jobs=options.jobs, return_as="generator")

    nulls = [(kind, seed) for seed in range(6) for kind in NULLS]
    nulls = [] if options.skip_nulls else nulls[: 5 if options.short else 30]
    shares = []
    for kind, leaving, count in work(delayed(null_block)(*one) for one in nulls):
        shares.append(leaving / count)
        print(f"null, {kind:14s} {leaving:3d} of {count} leave the band", flush=True)
    if shares:
        print(f"null blocks: {100 * np.mean(shares):.1f} % of the statistics leave (5 allowed)")

    slugs = SHORT if options.short else CATALOGUE
    for slug, size, leaving, before, after, closed in work(
        delayed(single_block)(slug, 11) for slug in slugs
    ):
        print(
            f"{slug:28s} {size:6.1f} sigma, {leaving:3d} leave; gap {before:10.1f} before, "
            f"{after:8.1f} after, {100 * closed:4.0f} % closed",
            flush=True,
        )
    rows, seconds = timing()
    print(f"20 counterparts of 180 images, {rows} tie observations: {seconds:.1f} s")


if __name__ == "__main__":
    main()
