"""Where the nodes of a reference lie in a picture, how well that is known, whether it counts."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyvander2d

from corridor.tools.thermal import kernel

HALF = 32  # px from the middle of a window to its edge
_NODES_AT_1280 = 300  # and in proportion to the width: 1200 at 5120
_MOST_NODES = 1200
_ROUNDS = 30
_AT_REST = 1e-3  # px; Gauss-Newton's error is then far below a thousandth
# The gate. A window counts with a correlation coefficient, gain and slopes like these, with few
# saturated pixels, and with neighbours that moved alike.
_LEAST_LIKE = 0.8
_MOST_SIGMA = 0.1
_MOST_SATURATED = 0.02
_GAINS = (0.3, 3.0)
_MOST_SLOPE = 0.1
_MOST_APART = 6.0
_LEAST_SHARE = 0.1  # of the nodes, for a picture to count at all
_SATURATED = 254.0
# Standard deviation of rounding to whole grey levels: below it no residual is believed.
_ROUNDING = math.sqrt(1 / 12)


@dataclass(frozen=True)
class Match:
    """Nodes of the reference found in a picture.

    shift: (n, 2) px; NaN where not valid. sigma: (n,) px, standard deviation of either. valid:
    (n,). trouble: why no node is valid, empty where some are.
    """

    shift: np.ndarray
    sigma: np.ndarray
    valid: np.ndarray
    trouble: str = ""


def grid(width: int, height: int) -> tuple[np.ndarray, int]:
    """Nodes (n, 2), whole px, and half the width of their windows, for pictures of a size.

    At least 200 nodes, over 80 % of the width and 75 % of the height.
    """
    small = min(width, height)
    half = int(np.clip(0.055 * small, 8, HALF))
    # The surface looks 4 px beyond a window, and windows move.
    margin = half + 4 + int(np.clip(0.02 * small, 2, 16))
    count = np.clip(_NODES_AT_1280 * width / 1280, _NODES_AT_1280, _MOST_NODES)
    columns = round(math.sqrt(count * width / height))
    rows = math.ceil(count / columns)
    x = np.rint(np.linspace(margin, width - 1 - margin, columns)).astype(np.int64)
    y = np.rint(np.linspace(margin, height - 1 - margin, rows)).astype(np.int64)
    return np.stack([part.ravel() for part in np.meshgrid(x, y)], axis=1), half


class Matcher:
    """A reference, ready to be found in any number of pictures.

    reference: (height, width) grey values, 0 to 255. nodes, half: as `grid` makes them (default).
    trouble: why nothing can be found of it, or empty.
    """

    def __init__(self, reference: np.ndarray, nodes: np.ndarray | None = None, half: int = HALF):
        self.reference = np.ascontiguousarray(reference, dtype=np.float32)
        height, width = self.reference.shape
        if nodes is None:
            nodes, half = grid(width, height)
        self.nodes, self.half = nodes, half
        self._windows = kernel.prepare(self.reference, nodes, half)
        clear = saturated_share(self.reference, nodes, half) <= _MOST_SATURATED
        self._good = self._windows.good & clear
        self._small, _ = _small(self.reference)
        self.trouble = fault(self.reference)

    def find(self, picture: np.ndarray) -> Match:
        """The nodes in a picture (height, width) of the same size, grey values 0 to 255."""
        picture = np.ascontiguousarray(picture, dtype=np.float32)
        trouble = fault(picture)
        if trouble:
            return self._nothing(trouble)
        found = self._matched(picture, self._start(picture))
        lost = ~np.isfinite(found[0][:, 0])
        near = _smooth(self.nodes, found[0], ~lost)
        if lost.any() and near is not None:
            # Where the start was off, the others say where to look.
            again = self._matched(picture, np.where(lost[:, None], near, found[0]), lost)
            for kept, new in zip(found, again, strict=True):
                kept[lost] = new[lost]
        return self._gate(picture, *found)

    def _matched(self, picture, start, which=None):
        good = self._good if which is None else self._good & which
        return kernel.match(picture, self._windows, start, good, _ROUNDS, _AT_REST)[:5]

    def _gate(self, picture, shift, bend, gain, rest, like):
        smoothed = math.sqrt(kernel.SMOOTHED_NOISE)
        noise = np.maximum(rest / smoothed, _ROUNDING * math.sqrt(2))
        spread = self._windows.spread
        sigma = noise / np.abs(gain) * np.sqrt((spread[:, 0, 0] + spread[:, 1, 1]) / 2)
        with np.errstate(invalid="ignore"):
            valid = (
                (like >= _LEAST_LIKE)
                & (sigma <= _MOST_SIGMA)
                & (gain >= _GAINS[0])
                & (gain <= _GAINS[1])
                & (np.abs(bend).max(axis=1) <= _MOST_SLOPE * self.half)
            )
        if valid.any():
            at = self.nodes + np.where(np.isfinite(shift), np.rint(shift), 0).astype(np.int64)
            valid &= saturated_share(picture, at, self.half) <= _MOST_SATURATED
            valid &= _alike(self.nodes, shift, sigma, valid)
        if np.count_nonzero(valid) < max(_LEAST_SHARE * len(valid), 12):
            return self._nothing("it does not show what the reference shows")
        keep = valid[:, None]
        return Match(np.where(keep, shift, np.nan), np.where(valid, sigma, np.nan), valid)

    def _nothing(self, trouble):
        count = len(self.nodes)
        return Match(
            np.full((count, 2), np.nan), np.full(count, np.nan), np.zeros(count, bool), trouble
        )

    def _start(self, picture):
        """Start values (n, 2), px: one shift of the whole, then pyramids of Lucas and Kanade."""
        small, factor = _small(picture)
        rows, columns = (min(size, 1024) for size in small.shape)
        top, left = (small.shape[0] - rows) // 2, (small.shape[1] - columns) // 2
        middle = np.s_[top : top + rows, left : left + columns]
        window = cv2.createHanningWindow((columns, rows), cv2.CV_32F)
        whole, response = cv2.phaseCorrelate(
            self._small[middle].astype(np.float32), small[middle].astype(np.float32), window
        )
        # A response this low is a peak of noise.
        moved = np.array(whole) if response > 0.03 else np.zeros(2)
        places = (self.nodes / factor).astype(np.float32)
        first = (places + moved).astype(np.float32)
        flow, status, _ = cv2.calcOpticalFlowPyrLK(
            self._small, small, places, first, winSize=(21, 21), maxLevel=2,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        flow = factor * (flow - places).astype(float)
        smooth = _smooth(self.nodes, flow, (status.ravel() == 1) & np.isfinite(flow).all(axis=1))
        return np.tile(factor * moved, (len(self.nodes), 1)) if smooth is None else smooth


def fault(picture: np.ndarray) -> str:
    """Why a picture (height, width) cannot be matched, grey values 0 to 255; empty if it can."""
    share = float(np.mean(picture >= _SATURATED))
    if share > 0.5:
        return f"it is saturated, {100 * share:.0f} % of its pixels are at the limit"
    fine = picture - cv2.blur(picture, (21, 21))
    spread = float(fine.std())
    weights = np.array([1, 26, 66, 26, 1], dtype=np.float32) / 120
    left = float(cv2.sepFilter2D(fine, -1, weights, weights).std())
    # Smoothing leaves 0.4 of white noise (0.3 of what a Bayer pattern or JPEG makes of it).
    if spread < 0.5 or left < 0.5 * spread:
        return "it has no texture, only noise"
    return ""


def saturated_share(picture: np.ndarray, nodes: np.ndarray, half: int) -> np.ndarray:
    """Share (n,) of saturated pixels in the windows around nodes (n, 2)."""
    height, width = picture.shape
    total = cv2.integral((picture >= _SATURATED).astype(np.uint8), sdepth=cv2.CV_32S)
    x0, y0 = (np.clip(nodes[:, k] - half, 0, size) for k, size in ((0, width), (1, height)))
    x1, y1 = (np.clip(nodes[:, k] + half + 1, 0, size) for k, size in ((0, width), (1, height)))
    inside = total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0]
    return inside / (2 * half + 1) ** 2


def _small(picture):
    """8-bit copy, at most 2560 px long, for start values; and how much smaller it is."""
    factor = max(1.0, max(picture.shape) / 2560)
    # Gain and level go, or Lucas-Kanade takes them for motion.
    grey = 128 + 45 * (picture - picture.mean()) / max(float(picture.std()), 1e-6)
    if factor > 1:
        height, width = picture.shape
        grey = cv2.resize(
            grey, (round(width / factor), round(height / factor)), interpolation=cv2.INTER_AREA
        )
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), factor


def _shapes(nodes, degree):
    unit = nodes / nodes.max(axis=0) * 2.0 - 1.0
    powers = np.add.outer(np.arange(degree + 1), np.arange(degree + 1)).ravel()
    return polyvander2d(*unit.T, [degree, degree])[:, powers <= degree]


def _robust(shapes, values, used):
    """Values (n, 2) smoothed by shapes (n, k), outliers left out; and what is usual of the rest."""
    used = used.copy()
    for _ in range(4):
        if np.count_nonzero(used) < 2 * shapes.shape[1]:
            return None, math.nan
        amplitude, *_ = np.linalg.lstsq(shapes[used], values[used], rcond=None)
        smooth = shapes @ amplitude
        off = np.hypot(*np.nan_to_num(values - smooth, nan=np.inf).T)
        usual = float(np.median(off[used]))
        used = used & (off <= 5 * usual + 1e-6)
    return smooth, usual


def _smooth(nodes, shift, used):
    """Shifts (n, 2) of an affine map through those that are used; None with too few."""
    return _robust(_shapes(nodes, 1), shift, used)[0]


def _alike(nodes, shift, sigma, valid):
    """Whether each node moved as its neighbours did, by a cubic through all."""
    smooth, usual = _robust(_shapes(nodes, 3), shift, valid)
    if smooth is None:
        return np.zeros(len(nodes), bool)
    off = np.hypot(*np.nan_to_num(shift - smooth, nan=np.inf).T)
    # The median length of a vector of noise is 1.18 sigma.
    return off <= _MOST_APART * np.maximum(usual / 1.18, np.nan_to_num(sigma, nan=np.inf))
