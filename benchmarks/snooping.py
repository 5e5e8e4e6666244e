"""How often data snooping names the control that is wrong, and nothing else.

    python -m benchmarks.snooping [--draws 1000] [--adjusted 200]

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

Adjusted: so many adjustments of the first network with new noise, w of its control and antennas
against the normal distribution (Kolmogorov-Smirnov), and again with the least error in one
coordinate, in turn, of which 80 % should be found (|w| beyond 3.29).
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.stats import kstest, norm

import corridor
from corridor.core.simulation import (
    Flight,
    Ground,
    Noise,
    Plan,
    add_noise,
    perfect_block,
    simulate,
)

NETWORKS = (6, 9, 14)
LEAST, MOST = 5.0, 30.0
LEVEL = 0.01


def planned(points: int) -> Plan:
    """A flown network with so many control points."""
    return Plan(
        f"{points} points", (Flight("F1", 50.0, images=20, strips=2),),
        axis_m=((0.0, 0.0), (0.0, 200.0)), ground=Ground(control=points, check=2),
        noise=Noise(tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), control_m=0.01),
    )  # fmt: skip


def cofactors(points: int) -> np.ndarray:
    """R (3 c, 3 c) of the control of a network, in standard deviations."""
    made = simulate(planned(points), seed=points)
    return corridor.adjust(made).reliability.control_cofactors


def adjusted(draws: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """w of control (draws, 3 c) and of antennas (draws, 3 k), and w (draws,) of a coordinate of
    control with the least error in it, by adjustments of new noise each."""
    plan = planned(NETWORKS[0])
    perfect = perfect_block(plan, seed=NETWORKS[0])
    of_control, of_antennas, spoilt = [], [], []
    for draw in range(draws):
        block = add_noise(perfect, noise=plan.noise, seed=draw)
        reliability = corridor.adjust(block, weights="stated").reliability
        of_control.append(reliability.control["w"].to_numpy())
        of_antennas.append(reliability.gnss["w"].to_numpy())
        row = reliability.control.iloc[draw % len(reliability.control)]
        at = block.ground["point"] == row["point"]
        block.ground.loc[at, row["axis"]] += row["least_error"] * (-1) ** draw
        table = corridor.adjust(block, weights="stated").reliability.control
        spoilt.append(table["w"].iloc[draw % len(table)])
    return np.array(of_control), np.array(of_antennas), np.array(spoilt)


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
    parser.add_argument("--adjusted", type=int, default=0)
    options = parser.parse_args()
    draws = options.draws
    if options.adjusted:
        control, antennas, spoilt = adjusted(options.adjusted)
        for name, w in (("control", control), ("antennas", antennas)):
            p = [kstest(one, "norm").pvalue for one in w.T]
            print(
                f"w of {name}, {len(w)} adjustments: RMS {np.sqrt(np.mean(w**2)):.3f}; "
                f"Kolmogorov-Smirnov of {len(p)} coordinates: least p {min(p):.3f}, below 0.05 "
                f"{np.mean(np.array(p) < 0.05):.3f}, uniform p {kstest(p, 'uniform').pvalue:.2f}"
            )
        found = np.abs(spoilt) > norm.isf(0.0005)
        spread = 100 * np.sqrt(0.16 / len(found))
        print(f"least error found: {100 * np.mean(found):.1f} +- {spread:.1f} % (80 % asked)")
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
