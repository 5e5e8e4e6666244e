"""Matching one window: inverse-compositional Gauss-Newton between two quintic splines.

A picture I stands for the smooth surface sum_k I_k beta5(x - k): the quintic B-spline with the
grey values themselves as coefficients. That is presmoothing (sigma 0.71 px) and interpolation in
one, and the surface of the reference and of the picture are sampled alike, so that what the
smoothing leaves of aliasing is all that can lock the result to whole pixels.

    f(x + d + A x) = gain g(x) + offset + J(x) q,    J = grad g (1, X, Y)

f: picture, g: reference, x: pixels of the window, X, Y: the same from its middle, 1 at its edge.
The normal matrix belongs to the reference alone; a step is eight sums over the window.
Source: Baker and Matthews 2004, "Lucas-Kanade 20 years on" (inverse composition); Pan, Li and Tong
2013, "Fast, robust and accurate digital image correlation calculation without redundant
computations"; Sutton, Orteu and Schreier 2009 (presmoothing).
"""

from typing import NamedTuple

import cv2
import numpy as np

from corridor.core.engine.compiled import compiled

# beta5 and its slope at whole pixels.
_VALUE = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120
_SLOPE = np.array([-1.0, -10.0, 0.0, 10.0, 1.0]) / 24
_UNKNOWNS = 8  # shift x, y; their slopes along X and Y; offset; gain
# What smoothing leaves of the variance of white noise, in two dimensions.
SMOOTHED_NOISE = (_VALUE @ _VALUE) ** 2


class Windows(NamedTuple):
    """What matching needs of the reference at its nodes.

    nodes (n, 2): whole px x, y. half: px from the middle of a window to its edge. surface, slopes
    along x, y (n, w, w) float32, the surface less its mean (n,). inverse: of the normal matrix
    (n, 8, 8). spread (n, 2, 2): covariance of the shift for white noise of one grey level in the
    picture. good (n,): whether the matrix could be inverted.
    """

    nodes: np.ndarray
    half: int
    surface: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray
    mean: np.ndarray
    inverse: np.ndarray
    spread: np.ndarray
    good: np.ndarray


@compiled(fastmath={"contract"}, error_model="numpy")
def _inner(a):
    """beta5 at a, 0 to 1."""
    a2 = a * a
    return np.float32(11 / 20) - a2 * (
        np.float32(1 / 2) - a2 * (np.float32(1 / 4) - a * np.float32(1 / 12))
    )


@compiled(fastmath={"contract"}, error_model="numpy")
def _middle(a):
    """beta5 at 2 - a, a from 0 to 1."""
    curve = np.float32(1 / 12) + a * (np.float32(1.0) - a) * np.float32(1 / 24)
    return np.float32(1 / 120) + a * (np.float32(1 / 24) + a * (np.float32(1 / 12) + a * curve))


@compiled(fastmath={"contract"}, error_model="numpy")
def _outer(a):
    """beta5 at 3 - a, a from 0 to 1."""
    a2 = a * a
    return a2 * a2 * a * np.float32(1 / 120)


def prepare(reference, nodes, half):
    """The windows of a reference (height, width) float32, at least half + 4 px from its edge."""
    count, size = len(nodes), 2 * half + 1
    surface, slope_x, slope_y = (np.empty((count, size, size), np.float32) for _ in range(3))
    mean = np.empty(count)
    normal, noisy = (np.empty((count, _UNKNOWNS, _UNKNOWNS)) for _ in range(2))
    inner = np.s_[4:-4, 4:-4]
    for n, (x, y) in enumerate(nodes):
        patch = reference[y - half - 4 : y + half + 5, x - half - 4 : x + half + 5].astype(float)
        smooth = _filtered(patch, _VALUE, _VALUE)
        mean[n] = smooth[inner].mean()
        layers = (
            smooth - mean[n],
            _filtered(patch, _SLOPE, _VALUE),
            _filtered(patch, _VALUE, _SLOPE),
        )
        surface[n], slope_x[n], slope_y[n] = (layer[inner] for layer in layers)
        normal[n] = _normal(*(layer[inner] for layer in layers))
        # The noise of the picture, smoothed as its surface is, and weighed by the slopes.
        noisy[n] = _normal(*(_filtered(layer, _VALUE, _VALUE)[inner] for layer in layers))
    scale = np.sqrt(np.einsum("nii->ni", normal))
    good = scale.min(axis=1) > 0.0
    outer = scale[:, :, None] * scale[:, None, :]
    scaled = normal[good] / outer[good]
    good[good] = sound = np.linalg.cond(scaled) < 1e9
    inverse = np.zeros_like(normal)
    inverse[good] = np.linalg.inv(scaled[sound]) / outer[good]
    spread = (inverse @ noisy @ inverse)[:, :2, :2]
    return Windows(nodes, half, surface, slope_x, slope_y, mean, inverse, spread, good)


def _filtered(patch, along_x, along_y):
    return cv2.sepFilter2D(patch, cv2.CV_64F, along_x, along_y)


def _normal(grey, slope_x, slope_y):
    """J'J (8, 8) of a window, of its surface and slopes (w, w)."""
    across = np.linspace(-1, 1, len(grey))
    down = across[:, None]
    columns = [
        slope_x, slope_y, slope_x * across, slope_y * across, slope_x * down, slope_y * down,
        np.ones_like(grey), grey,
    ]  # fmt: skip
    design = np.stack(columns).reshape(_UNKNOWNS, -1)
    return design @ design.T


@compiled(fastmath={"contract"}, error_model="numpy")
def _sums(picture, windows, n, p, right):
    """Right-hand side: the picture under the warp p, less the mean, times each column of J.

    Returns the sum of squares, or -1 where the warp leaves the picture.
    """
    height, width = picture.shape
    half, cx, cy = windows.half, windows.nodes[n, 0], windows.nodes[n, 1]
    surface, slope_x, slope_y = windows.surface[n], windows.slope_x[n], windows.slope_y[n]
    low = windows.mean[n]
    size = 2 * half + 1
    right[:] = 0.0
    squares = 0.0
    weight = np.empty(6, np.float32)
    # The corners bound an affine warp.
    for k in range(4):
        across, down = (-1.0 if k % 2 else 1.0), (-1.0 if k // 2 else 1.0)
        x = cx + half * across + p[0] + p[2] * across + p[4] * down
        y = cy + half * down + p[1] + p[3] * across + p[5] * down
        if not (x >= 2.0 and y >= 2.0 and x < width - 4.0 and y < height - 4.0):
            return -1.0
    for r in range(size):
        down = (r - half) / half
        base_x = cx - half + p[0] + p[4] * down
        base_y = cy + (r - half) + p[1] + p[5] * down
        a0 = a1 = a2 = a3 = grey_sum = gain_sum = 0.0
        for c in range(size):
            across = (c - half) / half
            x = base_x + c + p[2] * across
            y = base_y + p[3] * across
            ix, iy = int(x), int(y)
            t = np.float32(y - iy)
            s = np.float32(1.0) - t
            weight[0], weight[1], weight[2] = _outer(s), _middle(s), _inner(t)
            weight[3], weight[4], weight[5] = _inner(s), _middle(t), _outer(t)
            t = np.float32(x - ix)
            s = np.float32(1.0) - t
            w0, w1, w2, w3, w4, w5 = (
                _outer(s), _middle(s), _inner(t), _inner(s), _middle(t), _outer(t),
            )  # fmt: skip
            total = np.float32(0.0)
            for j in range(6):
                line = picture[iy + j - 2]
                part = (
                    w0 * line[ix - 2] + w1 * line[ix - 1] + w2 * line[ix]
                    + w3 * line[ix + 1] + w4 * line[ix + 2] + w5 * line[ix + 3]
                )  # fmt: skip
                total += weight[j] * part
            grey = np.float64(total) - low
            a, b = slope_x[r, c] * grey, slope_y[r, c] * grey
            a0 += a
            a1 += b
            a2 += a * across
            a3 += b * across
            grey_sum += grey
            gain_sum += grey * surface[r, c]
            squares += grey * grey
        right[0] += a0
        right[1] += a1
        right[2] += a2
        right[3] += a3
        right[4] += a0 * down
        right[5] += a1 * down
        right[6] += grey_sum
        right[7] += gain_sum
    return squares


@compiled()
def match(picture, windows, start, chosen, rounds, least):
    """Shift of each node's window from the reference to the picture.

    start: (n, 2) px. chosen: (n,) nodes to match. rounds: most steps. least: px, step at which a
    node has come to rest.
    Returns shift (n, 2), slopes (n, 4) px at the window's edge, gain, standard deviation of the
    residual (grey levels, of the smoothed surfaces), correlation coefficient (n,) each, and steps
    taken (n,), 0 where the node did not come to rest.
    """
    count, half = len(windows.nodes), windows.half
    shift, bend = np.full((count, 2), np.nan), np.full((count, 4), np.nan)
    gain, rest, like = np.full(count, np.nan), np.full(count, np.nan), np.full(count, np.nan)
    steps = np.zeros(count, np.int64)
    pixels = (2 * half + 1) ** 2
    right = np.empty(_UNKNOWNS)
    for n in range(count):
        if not chosen[n]:
            continue
        p, warp = np.zeros(6), np.eye(3)
        p[:2] = warp[:2, 2] = start[n]
        for k in range(rounds):
            squares = _sums(picture, windows, n, p, right)
            if squares < 0.0:
                break
            q = windows.inverse[n] @ right
            if not q[7] > 0.05:  # what is darker there is lighter here: another place
                break
            d = q[:6] / q[7]
            # W(p) after the inverse of W(d): both are x -> x + shift + slopes X / half.
            moved = np.eye(3)
            moved[:2, 0] += d[2:4] / half
            moved[:2, 1] += d[4:] / half
            moved[:2, 2] = d[:2]
            if not abs(np.linalg.det(moved) - 1.0) < 0.5:
                break
            warp = warp @ np.linalg.inv(moved)
            slopes = half * (warp - np.eye(3))
            p[:2], p[2:4], p[4:] = warp[:2, 2], slopes[:2, 0], slopes[:2, 1]
            if np.abs(d).max() < least:
                left, total = squares - q @ right, squares - right[6] ** 2 / pixels
                shift[n], bend[n] = p[:2], p[2:]
                gain[n] = q[7]
                rest[n] = np.sqrt(max(left, 0.0) / (pixels - _UNKNOWNS))
                like[n] = np.sqrt(max(0.0, 1.0 - left / total)) if total > 0.0 else 0.0
                steps[n] = k + 1
                break
    return shift, bend, gain, rest, like, steps
