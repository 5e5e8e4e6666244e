"""The flight plan over a corridor, its ground, and which image sees which point."""

import numpy as np

from .trajectory import Strip

# With the number of strips along the corridor where none is asked for.
STRIPS = {"nadir": 2, "fixed_yaw": 2, "oblique": 4, "multi_height": 4, "cross": 2}
OBLIQUE = np.radians(30.0)
BORDER_PX = 40.0  # effects move points; none may leave the picture


def plan(geometry, images, strips, height, footprint, forward, side, azimuth):
    """Strips (list) of a geometry and the corridor's length, m.

    footprint: (2,) size of the picture on the ground along and across, per metre of height.
    azimuth: rad. `nadir` turns the camera with the strip, `fixed_yaw` does not; `oblique` tilts
    every other strip forward; `multi_height` flies at 0.6 and 1.4 times the height; `cross` spends
    a third of its images on strips across.
    """
    if geometry not in STRIPS:
        raise ValueError(f"geometry {geometry!r}: use one of {', '.join(STRIPS)}")
    strips = strips or STRIPS[geometry]
    along = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    across = images // 3 if geometry == "cross" else 0
    heights = np.full(strips, height)
    if geometry == "multi_height":
        heights = height * np.where(np.arange(strips) < (strips + 1) // 2, 0.6, 1.4)
    base = (1 - forward) * footprint[0] * heights
    count = _shares(images - across, 1 / base)
    length = float(np.max((count - 1) * base))
    level = np.unique(heights)
    out = []
    for n in range(strips):
        peers = np.flatnonzero(heights == heights[n])
        tilted = geometry == "oblique" and n % 2 == 1
        lane, lanes = int(np.searchsorted(peers, n)), len(peers)
        if geometry == "oblique":
            lane, lanes = n // 2, (strips + 1) // 2
        spacing = (1 - side) * footprint[1] * (heights[n] if len(level) > 1 else height)
        off = (lane - (lanes - 1) / 2) * spacing
        # Every height and every tilt is flown both ways.
        back = bool((n // 2 + n) % 2) if geometry == "oblique" else n % 2 == 1
        ends = [k * length * along + off * right + [0, 0, heights[n]] for k in (0, 1)]
        turn = np.pi if back and geometry != "fixed_yaw" else 0.0
        out.append(
            Strip(*(ends[::-1] if back else ends), azimuth + turn, OBLIQUE * tilted, int(count[n]))
        )
    if across:
        lines = max(2, round(across / 8))
        for n, number in enumerate(_shares(across, np.ones(lines))):
            at = (n + 0.5) / lines * length * along + [0, 0, height]
            half = (number - 1) / 2 * (1 - forward) * footprint[0] * height * right
            back = n % 2 == 1
            ends = [at - half, at + half]
            turn = np.pi / 2 + (np.pi if back else 0.0)
            out.append(Strip(*(ends[::-1] if back else ends), azimuth + turn, 0.0, int(number)))
    return out, length


def _shares(total, weight):
    """Whole numbers (n,) that add up to total, in proportion to weight."""
    upto = np.round(np.cumsum(weight / weight.sum() * total) + 1e-9).astype(int)
    return np.diff(upto, prepend=0)


def terrain(s, t, relief, rng):
    """Height (n,), m, at s along and t across a bank 20 m wide on undulating ground, and bushes."""
    bank = 1 / (1 + np.exp((np.abs(t + 3 * np.sin(s / 70)) - 10.0) / 1.5))
    wave = 0.15 * np.sin(s / 37 + t / 23) + 0.1 * np.sin(t / 11 - s / 51)
    bush = np.where(rng.random(len(s)) < 0.15, rng.gamma(2.0, 0.4, len(s)), 0.0)
    return relief * (bank + wave) + bush * min(relief, 1.0)


def choose(views, images, target, keep, rng):
    """Which points to take and in which of their images: realistic numbers of rays.

    views: (points, images) bool, which point lies in which image. A point is found in each of its
    images with a probability of its own, Beta distributed with mean `keep`; then points are taken
    in random order as long as their images together lack observations.
    Returns indices (n,) of the points taken, and (o,), (o,) of point among them and image.
    """
    share = rng.beta(4 * keep, 4 * (1 - keep), len(views))
    found = views & (rng.random(views.shape) < share[:, None])
    rays = found.sum(axis=1)
    lack = np.full(images, float(target))
    taken = []
    for p in rng.permutation(np.flatnonzero(rays >= 2)):
        mine = found[p]
        if lack @ mine > 0:
            taken.append(p)
            lack -= mine
    taken = np.sort(taken)
    return taken, *np.nonzero(found[taken])
