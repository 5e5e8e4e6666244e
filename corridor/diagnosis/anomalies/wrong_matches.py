"""Tie observations that a robust fit has set aside, and whether they are more than wrong matches.

Matches go wrong anywhere and in any direction. Their number in every square of the picture, small
and large, and in every run of images is held against their share in the whole block. Images have
good and bad days, so that as many of them count as images differ by chance alone: a binomial test
of what is left when numbers are divided by the spread from image to image.

Where a pane covers part of the picture, single observations cross its rim: each of them is set
aside as a wrong match, no shape that is fitted to all of them sees it, and what gives it away is
that they lie together and point one way. Two observations of one point that lie close together in
the picture, one on either side of a line, differ by noise; by the shift where the line is the rim.
For upright and level lines all over the picture the pairs that jump by more than `detection_sigma`
in one direction are counted. By chance as many would as at all other lines, and as many as in the
other direction. Two images are matched in one go, and where they go wrong many of their points do
so alike: in the end it is pairs of images that count, each by the median of its points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import bdtrc, chdtri, ndtri

from corridor.core.adjustment import Adjustment
from corridor.core.effects import every_effect
from corridor.diagnosis.findings.findings import Unknown
from corridor.diagnosis.noise.image import scale_of
from corridor.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class Ties:
    """Tie observations (n,) of one camera, by point.

    place: (n, 2) px where the model puts them: measured, a wrong match moves its own place.
    residual: (n, 2) in scales of Student's t; scale_px: (n,) what one of them is. size: (2,) px.
    """

    point: np.ndarray
    image: np.ndarray
    place: np.ndarray
    residual: np.ndarray
    scale_px: np.ndarray
    size: np.ndarray

    @property
    def far(self) -> np.ndarray:
        """Which of them the fit has set aside."""
        return (self.residual**2).sum(axis=1) > SETTINGS.detection_sigma**2


def ties_by_camera(adjustment: Adjustment) -> list[Ties]:
    """The tie observations that an adjustment can see, a camera each."""
    system = adjustment.system
    rows, images = system.image_rows, system.images
    found = system.residuals().pixels
    good = rows.tie & np.isfinite(found).all(axis=1)
    if not good.any():
        return []
    point, image, xy = rows.point[good], rows.image[good], rows.xy[good]
    found, sigma = found[good], rows.sigma[good]
    scale = scale_of(((found / sigma[:, None]) ** 2).sum(axis=1)) * sigma
    camera = images.camera[image]
    out = []
    for number in np.unique(camera):
        k = camera == number
        out.append(
            Ties(
                point[k],
                image[k],
                (xy - found)[k],
                (found / scale[:, None])[k],
                scale[k],
                images.size[image[k][0]].astype(float),
            )
        )
    return out


def outlier_clusters(adjustment: Adjustment) -> list[dict]:
    """Alarms as `variance_alarms` makes them: `quantity` is `wrong matches`.

    `ratio`: their share there over their share in the block.
    """
    every = ties_by_camera(adjustment)
    out = [alarm for ties in every if (alarm := _in_the_picture(ties))]
    timely = _in_the_flight(every, adjustment.system.images)
    return out + ([timely] if timely else [])


def _in_the_picture(ties: Ties) -> dict | None:
    """Squares of the picture, from one cell to a quarter of it."""
    far, images = ties.far, int(ties.image.max()) + 1
    cells = 2 * np.array(SETTINGS.places)
    cell = np.clip((ties.place / ties.size * cells).astype(int), 0, cells - 1)
    code = np.ravel_multi_index((*cell.T, ties.image), (*cells, images))
    count = (np.bincount(code, weight, cells.prod() * images) for weight in (None, far))
    seen, wrong = (one.reshape(*cells, images) for one in count)
    windows = []
    for side in _doubling(cells.max() // 4):
        n, k = (_squares(one, side) for one in (seen, wrong))
        # From image to image within the square.
        share = k.sum(axis=2) / np.maximum(n.sum(axis=2), 1)
        spread = ((k - share[..., None] * n) ** 2).sum(axis=2)
        spread /= np.maximum(n.sum(axis=2) * share * (1 - share), 1e-9)
        k[(k > 0).sum(axis=2) < SETTINGS.fewest_images] = 0.0
        windows.append((side, k.sum(axis=2), n.sum(axis=2), spread))
    found = _crowd(windows, far.mean())
    if found is None:
        return None
    log_p, side, at, k, n = found
    step = (ties.size - 1) / cells
    box = [*(at * step).tolist(), *((at + side) * step).tolist()]
    rest = (far.sum() - k) / max(len(far) - n, 1)
    where = f"between x = {box[0]:.0f} and {box[2]:.0f} px, y = {box[1]:.0f} and {box[3]:.0f} px"
    return _alarm(log_p, k / n, far.mean(), rest, where, {"image": box})


def _in_the_flight(every: list[Ties], images) -> dict | None:
    """Runs of images in the order of time."""
    m = len(images.names)
    seen = sum((np.bincount(t.image, minlength=m) for t in every), np.zeros(m))
    wrong = sum((np.bincount(t.image, t.far, m) for t in every), np.zeros(m))
    order = np.lexsort((np.arange(m), images.time))
    order = order[seen[order] > 0]
    lengths = _doubling(SETTINGS.run_of_images)
    if len(order) < 2 * lengths[-1] or not wrong.any():
        return None
    seen, wrong = seen[order], wrong[order]
    usual = wrong.sum() / seen.sum()
    # The median, so that the crowd does not excuse itself.
    spread = np.median((wrong - usual * seen) ** 2 / (seen * usual * (1 - usual))) / chdtri(1, 0.5)
    windows = []
    for length in lengths:
        n, k = (np.convolve(one, np.ones(length), "valid") for one in (seen, wrong))
        windows.append((length, k, n, spread))
    found = _crowd(windows, usual)
    if found is None:
        return None
    log_p, length, (first,), k, n = found
    run = order[first : first + length]
    names, middle = [images.names[k] for k in run], run[length // 2]
    where = {"flight": str(images.flight_names[images.flight[middle]])}
    if np.isfinite(images.time[run]).all():
        where["time_s"] = float(images.time[run].mean())
    rest = (wrong.sum() - k) / max(seen.sum() - n, 1)
    who = f"image {names[0]}" if length == 1 else f"the images from {names[0]} to {names[-1]}"
    return _alarm(log_p, k / n, usual, rest, f"in {who}", where)


def _doubling(most: int) -> list[int]:
    """1, 2, 4 and so on up to `most`."""
    return [2**n for n in range(int(most).bit_length())]


def _crowd(windows: list[tuple], usual: float) -> tuple | None:
    """The window least likely by chance: log p over all, its size and place, wrong ones and all.

    windows: of each size the numbers of wrong ones and of all, and their spread. None where that
    is not beyond the level.
    """
    best, tested = None, 0
    for size, k, n, spread in windows:
        log_p = _by_chance(k, n, usual, spread)
        tested += log_p.size
        at = np.unravel_index(np.argmin(log_p), log_p.shape)
        if best is None or log_p[at] < best[0]:
            best = float(log_p[at]), size, np.array(at), int(k[at]), int(n[at])
    log_p = best[0] + float(np.log(tested))
    # Squares of the picture and runs of the flight have half of the level each.
    return None if log_p > np.log(SETTINGS.control_level / 2) else (log_p, *best[1:])


def _log_chance(k, n, p) -> np.ndarray:
    """Logarithm of the probability of k and more of n, where one has p."""
    with np.errstate(divide="ignore"):
        return np.log(bdtrc(k - 1.0, np.asarray(n, dtype=np.int64), p))


def _by_chance(k, n, usual: float, spread) -> np.ndarray:
    """Logarithm of how likely k and more of n are wrong; zero where that would be no crowd."""
    spread = np.maximum(spread, 1.0)
    log_p = _log_chance(np.ceil(k / spread), np.maximum(np.ceil(n / spread), 1), usual)
    crowd = (k >= SETTINGS.fewest_images) & (k > SETTINGS.cluster_ratio * usual * n)
    return np.where(crowd, log_p, 0.0)


def _squares(cells: np.ndarray, side: int) -> np.ndarray:
    """Sums over all squares of so many cells a side; cells: (columns, rows, images)."""
    columns, rows, _ = cells.shape
    out = 0.0
    for i in range(side):
        for j in range(side):
            out = out + cells[i : columns - side + 1 + i, j : rows - side + 1 + j]
    return out


def _alarm(log_p: float, share: float, usual: float, rest: float, where: str, location) -> dict:
    """share: of wrong ones there; usual, rest: in the block, and elsewhere."""
    return {
        "quantity": "wrong matches",
        "ratio": float(share / usual),
        "z": float(-ndtri(np.exp(max(log_p, -600.0)))),
        "where": f"wrong matches crowd {where}: {100 * share:.0f} % there, {100 * rest:.0f} % "
        "elsewhere",
        "location": location,
    }


@dataclass(frozen=True)
class Line:
    """What jumps at a line: pairs of `of` that cross it. log_p: of chance, over all lines."""

    axis: int
    at: float
    jumped: int
    of: int
    shift: np.ndarray
    log_p: float


def shows_as() -> list[str]:
    """Slugs of the effects of the catalogue that a broken picture may be told as."""
    return [effect.slug for effect in every_effect() if effect.sudden]


def broken_picture(adjustment: Adjustment) -> Unknown | None:
    """The line at which the picture is broken, or none.

    It is told as the first sudden effect of the catalogue; without one nothing is.
    """
    if not shows_as():
        return None
    found = [(line, ties) for ties in ties_by_camera(adjustment) if (line := _worst(ties))]
    if not found:
        return None
    line, ties = min(found, key=lambda one: one[0].log_p)
    first = ties.place[:, line.axis] < line.at
    # A pane covers the side on which less is seen.
    low, high = np.zeros(2), ties.size - 1
    (high if first.mean() < 0.5 else low)[line.axis] = line.at
    # No minus before a zero.
    dx, dy = np.round(line.shift, 1) + 0.0
    name, way = ("x", "upright") if line.axis == 0 else ("y", "level")
    where = (
        f"across the {way} line {name} = {line.at:.0f} px, where {line.jumped} of {line.of} points "
        f"that are seen on both sides of it jump by x = {dx:.1f}, y = {dy:.1f} px"
    )
    location = {"image": [*low.tolist(), *high.tolist()]}
    return Unknown(shows_as()[0], "unknown", -line.log_p, where, location, "none")


def _worst(ties: Ties) -> Line | None:
    """The line that is the least likely by chance, where that is beyond the level."""
    longer = float(ties.size.max())
    # Farther apart, a smooth deformation tells two of one point apart too.
    reach = longer / (2 * max(SETTINGS.places))
    tested, best = 0, None
    for axis in (0, 1):
        order = np.lexsort((ties.place[:, axis], ties.point))
        place, point = ties.place[order, axis], ties.point[order]
        near = np.flatnonzero((point[1:] == point[:-1]) & (place[1:] - place[:-1] < reach))
        count = int(round(SETTINGS.lines * ties.size[axis] / longer))
        lines = np.arange(1, count) / count * (ties.size[axis] - 1)
        below = np.searchsorted(lines, place[near])
        above = np.searchsorted(lines, place[near + 1])
        one, other = order[near], order[near + 1]
        jump = ties.residual[other] - ties.residual[one]

        def crossing(which, below=below, above=above, count=count):
            begun = np.bincount(below[which], minlength=count)
            return np.cumsum(begun - np.bincount(above[which], minlength=count))[: count - 1]

        every = crossing(np.ones(len(near), dtype=bool))
        for along in (0, 1):
            ways = [sign * jump[:, along] > SETTINGS.detection_sigma for sign in (1, -1)]
            counts = [crossing(way) for way in ways]
            usual = 0.5 * sum(k.sum() for k in counts) / max(every.sum(), 1)
            for sign, (way, mine, against) in enumerate(
                zip(ways, counts, counts[::-1], strict=True)
            ):
                # Noise that is larger at this place jumps the other way as often.
                chance = (against + SETTINGS.clusters_of_prior * usual) / (
                    every + SETTINGS.clusters_of_prior
                )
                chance = np.maximum(usual, chance)
                log_p = _log_chance(mine, every, np.minimum(chance, 1.0))
                tested += len(lines)
                log_p[2 * mine < every] = 0.0
                k = int(np.argmin(log_p))
                over = (below <= k) & (k < above)
                if len(np.unique(ties.image[other[over & way]])) < SETTINGS.fewest_images:
                    continue
                pairs = np.column_stack([ties.image[one[over]], ties.image[other[over]]])
                jumped, of = _of_images(pairs, jump[over, along], (1, -1)[sign])
                chance_of_all = float(_log_chance(jumped, of, min(chance[k], 1.0)))
                if 2 * jumped < of:
                    continue
                if best is not None and chance_of_all >= best.log_p:
                    continue
                px = (jump * ties.scale_px[other][:, None])[over]
                best = Line(
                    axis,
                    float(lines[k]),
                    int(mine[k]),
                    int(every[k]),
                    np.median(px, axis=0),
                    chance_of_all,
                )
    if best is None:
        return None
    best = replace(best, log_p=best.log_p + float(np.log(tested)))
    return best if best.log_p < np.log(SETTINGS.control_level) else None


def _of_images(pairs: np.ndarray, jump: np.ndarray, sign: int) -> tuple[int, int]:
    """Pairs of images whose points jump one way, and all: pairs (n, 2), jump (n,) in scales."""
    _, number = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    count = int(number.max(initial=-1)) + 1
    middle = np.array([np.median(jump[number == k]) for k in range(count)])
    return int((sign * middle > SETTINGS.detection_sigma).sum()), count
