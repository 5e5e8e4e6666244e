"""How often data snooping names the control that is wrong, and nothing else.

    python -m benchmarks.snooping [--draws 1000]

Three networks of 6, 9 and 14 control points with GNSS, adjusted once each; then draws of all
residuals of control together from their cofactors R, with errors of 5 to 30 standard deviations in
one or two coordinates of different points: v = R^1/2 n + R e, which is what an adjustment of every
draw would give as far as it is linear. Named: every wrong coordinate, by point and axis. False: any
other. Nulls: draws without an error in which something is named (1 % is the level). Of size: the
same of the draws in which every error is larger than the least that a search at that level finds
with 80 %: smaller ones hide in the noise, whatever looks for them. Bound: what a test at the same
level finds that knows where the errors are, and of each the size of the other: of the coordinate i

    P(w > z) with w about |e_i| sqrt(R_ii), z of level / 2 / coordinates

No search that looks at all coordinates with that level can name more.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.stats import norm

import corridor
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate

NETWORKS = (6, 9, 14)
LEAST, MOST = 5.0, 30.0
LEVEL = 0.01


def cofactors(points: int) -> np.ndarray:
    """R (3 c, 3 c) of the control of a flown network, in standard deviations."""
    plan = Plan(
        f"{points} points", (Flight("F1", 50.0, images=20, strips=2),),
        axis_m=((0.0, 0.0), (0.0, 200.0)), ground=Ground(control=points, check=2),
        noise=Noise(tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), control_m=0.01),
    )  # fmt: skip
    return corridor.adjust(simulate(plan, seed=points)).reliability.control_cofactors


def counted(
    share: np.ndarray, wrong: int, draws: int, seed: int
) -> tuple[int, int, int, int, float]:
    """Of so many draws: in how many every error is named, and in how many something else is; how
    many have errors of size, and in how many of these every error is named; and the bound."""
    redundancy = np.clip(np.diag(share), 1e-12, 1.0)
    least = (norm.isf(LEVEL / 2 / len(share)) + norm.isf(0.2)) / np.sqrt(redundancy)
    size, axes = np.linalg.eigh(share)
    root = axes * np.sqrt(np.clip(size, 0.0, None))
    random = np.random.default_rng(seed)
    named = false = sized = found_of_size = 0
    bound, level = 0.0, norm.isf(LEVEL / 2 / len(share))
    for _ in range(draws):
        error = np.zeros(len(share))
        points = random.choice(len(share) // 3, size=wrong, replace=False)
        at = 3 * points + random.integers(3, size=wrong)
        error[at] = random.uniform(LEAST, MOST, wrong) * random.choice((-1.0, 1.0), wrong)
        v = root @ random.standard_normal(len(share)) + share @ error
        found = {one.number for one in corridor.adjustment.blunders(v, share)}
        whole, large = set(at.tolist()) <= found, bool((np.abs(error) > least)[at].all())
        named, sized, found_of_size = named + whole, sized + large, found_of_size + whole * large
        false += bool(found - set(at.tolist()))
        bound += float(np.prod(norm.cdf(np.abs(error[at]) * np.sqrt(redundancy[at]) - level)))
    return named, false, sized, found_of_size, bound


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=1000)
    draws = parser.parse_args().draws
    print("points  errors     named     bound  false name  of size: draws     named")
    for points in NETWORKS:
        share = cofactors(points)
        for wrong in (0, 1, 2):
            named, false, sized, of_size, bound = counted(share, wrong, draws, 100 * points + wrong)
            told = f"{100 * named / draws:6.1f} %  {100 * bound / draws:6.1f} %"
            told = told if wrong else f"{'-':>8}  {'-':>8}"
            more = f"{sized:15d}  {100 * of_size / max(sized, 1):6.1f} %" if wrong else ""
            print(
                f"{points:6d}  {wrong:6d}  {told}  {100 * false / draws:8.2f} %  {more}", flush=True
            )


if __name__ == "__main__":
    main()
