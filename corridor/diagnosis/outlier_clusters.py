"""Wrong matches that cluster in a part of the picture, or in a stretch of the flight.

Their number in every square of the picture, small and large, and in every run of images is held
against their share in the whole block. Images have good and bad days, so that as many of them
count as images differ by chance alone: a binomial test of what is left when numbers are divided
by the spread from image to image.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import binom, chi2, norm

from corridor.adjustment import Adjustment
from corridor.diagnosis.outliers import Ties, ties_by_camera
from corridor.diagnosis.settings import SETTINGS


def outlier_clusters(adjustment: Adjustment) -> list[dict]:
    """Alarms as `variance_alarms` makes them: `quantity` is `wrong matches`.

    `ratio`: their share there over their share in the block.
    """
    every = ties_by_camera(adjustment)
    out = [alarm for ties in every if (alarm := _in_the_picture(ties))]
    timely = _in_the_flight(every, adjustment.system.images)
    return out + ([timely] if timely else [])


def _in_the_picture(ties: Ties) -> dict | None:
    far, m = ties.far, int(ties.image.max()) + 1
    cell = np.clip(
        (ties.place / ties.size * SETTINGS.cluster_cells).astype(int),
        0,
        np.array(SETTINGS.cluster_cells) - 1,
    )
    code = (cell[:, 0] * SETTINGS.cluster_cells[1] + cell[:, 1]) * m + ties.image
    whole = [
        np.bincount(
            code, weight, SETTINGS.cluster_cells[0] * SETTINGS.cluster_cells[1] * m
        ).reshape(*SETTINGS.cluster_cells, m)
        for weight in (None, far)
    ]
    best, tested = None, 0
    for side in SETTINGS.cluster_squares:
        seen, wrong = (_squares(one, side) for one in whole)
        # From image to image within the square.
        n, k = seen.sum(axis=2), wrong.sum(axis=2)
        share = k / np.maximum(n, 1)
        spread = ((wrong - share[..., None] * seen) ** 2).sum(axis=2)
        spread /= np.maximum(n * share * (1 - share), 1e-9)
        log_p = _by_chance(k, n, far.mean(), spread)
        log_p[(wrong > 0).sum(axis=2) < SETTINGS.cluster_images] = 0.0
        tested += log_p.size
        at = np.unravel_index(np.argmin(log_p), log_p.shape)
        if best is None or log_p[at] < best[0]:
            best = float(log_p[at]), np.array(at), side, int(k[at]), int(n[at])
    log_p, at, side, k, n = best
    log_p += np.log(tested)
    if log_p > np.log(SETTINGS.outlier_level):
        return None
    step = (ties.size - 1) / SETTINGS.cluster_cells
    box = [*(at * step).tolist(), *((at + side) * step).tolist()]
    rest = (far.sum() - k) / max(len(far) - n, 1)
    return _alarm(
        log_p,
        k / n / far.mean(),
        f"wrong matches crowd between x = {box[0]:.0f} and {box[2]:.0f} px, y = {box[1]:.0f} and "
        f"{box[3]:.0f} px: {100 * k / n:.0f} % there, {100 * rest:.0f} % elsewhere",
        {"image": box},
    )


def _in_the_flight(every: list[Ties], images) -> dict | None:
    """Runs of images in the order of time."""
    m = len(images.names)
    seen = sum((np.bincount(t.image, minlength=m) for t in every), np.zeros(m))
    wrong = sum((np.bincount(t.image, t.far, m) for t in every), np.zeros(m))
    order = np.lexsort((np.arange(m), images.time))
    order = order[seen[order] > 0]
    if len(order) < 2 * SETTINGS.cluster_runs[-1] or not wrong.any():
        return None
    seen, wrong = seen[order], wrong[order]
    usual = wrong.sum() / seen.sum()
    # The median, so that the crowd does not excuse itself.
    each = (wrong - usual * seen) ** 2 / (seen * usual * (1 - usual))
    spread = np.median(each) / chi2.median(1)
    best, tested = None, 0
    for length in SETTINGS.cluster_runs:
        n, k = (np.convolve(one, np.ones(length), "valid") for one in (seen, wrong))
        log_p = _by_chance(k, n, usual, np.full(len(n), spread))
        tested += len(log_p)
        first = int(np.argmin(log_p))
        if best is None or log_p[first] < best[0]:
            best = float(log_p[first]), first, length, int(k[first]), int(n[first])
    log_p, first, length, k, n = best
    log_p += np.log(tested)
    if log_p > np.log(SETTINGS.outlier_level):
        return None
    run = order[first : first + length]
    names = [images.names[i] for i in run]
    middle = run[length // 2]
    where = {"flight": str(images.flight_names[images.flight[middle]])}
    if np.isfinite(images.time[run]).all():
        where["time_s"] = float(images.time[run].mean())
    rest = (wrong.sum() - k) / max(seen.sum() - n, 1)
    who = f"image {names[0]}" if length == 1 else f"the images from {names[0]} to {names[-1]}"
    return _alarm(
        log_p,
        k / n / usual,
        f"wrong matches crowd in {who}: {100 * k / n:.0f} % there, {100 * rest:.0f} % elsewhere",
        where,
    )


def _by_chance(k, n, usual: float, spread) -> np.ndarray:
    """Logarithm of how likely k and more of n are wrong; zero where that would be no crowd."""
    spread = np.maximum(spread, 1.0)
    log_p = binom.logsf(np.ceil(k / spread) - 1, np.maximum(np.ceil(n / spread), 1), usual)
    return np.where(
        (k >= SETTINGS.cluster_fewest) & (k > SETTINGS.cluster_ratio * usual * n), log_p, 0.0
    )


def _squares(cells: np.ndarray, side: int) -> np.ndarray:
    """Sums over all squares of so many cells a side; cells: (columns, rows, images)."""
    columns, rows, _ = cells.shape
    out = 0.0
    for i in range(side):
        for j in range(side):
            out = out + cells[i : columns - side + 1 + i, j : rows - side + 1 + j]
    return out


def _alarm(log_p: float, ratio: float, where: str, location: dict) -> dict:
    z = float(norm.isf(np.exp(max(log_p, -600.0))))
    return {
        "quantity": "wrong matches",
        "ratio": float(ratio),
        "z": z,
        "where": where,
        "location": location,
    }
