"""Smooth curves and surfaces for effects that stand for the unknown.

Cubic B-splines with knots where the data are, and curves without their constant: what is constant
over the block belongs to the camera, the lever arm or a named effect.

Source: de Boor 2001, "A practical guide to splines", chapter IX.
"""

from functools import cache

import numpy as np
from scipy.linalg import helmert, null_space

from corridor.core.effects.context import Images
from corridor.core.effects.contract import LinearEffect, Parameter, of_interior

_DEGREE = 3


def coefficients(values: np.ndarray, most: int) -> int:
    """How many coefficients values (n,) can bear: 2 to most, and most where none is known."""
    distinct = len(np.unique(values[np.isfinite(values)]))
    return min(most, max(distinct, 2)) if distinct else most


def curve(at: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Curves (rows, count - 1) at places (rows,), orthonormal in their coefficients.

    values: (n,) where data are: as many between any two knots, so that a pause between flights
    leaves no coefficient without data. The constant is no sum of these curves. Beyond the data a
    curve goes on level. NaN where a place is unknown; zero where all values are the same.
    """
    out = np.full((len(at), count - 1), np.nan)
    known = np.isfinite(at)
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < 2:
        out[known] = 0.0
        return out
    knots = np.quantile(distinct, np.linspace(0.0, 1.0, count - _degree(count) + 1))
    out[known] = _splines(at[known], knots, count) @ helmert(count).T
    return out


def surface(at: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Surfaces (n, columns * rows - 3) at places x, y (n, 2) of -1..1 each.

    Sums, orthonormal in their coefficients, of evenly spaced B-splines on a grid. What is constant
    or linear in x and y is no sum of them: turning the camera in its mount does nearly the same
    to every image, and the poses cannot be told from it.
    """
    across, down = _across_and_down(at, columns, rows)
    tensor = (down[:, :, None] * across[:, None, :]).reshape(len(at), rows * columns)
    return tensor @ _bent(columns, rows)


def on_surface(at: np.ndarray, values: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """`surface` times values (columns * rows - 3, k), a tenth of the work: (n, k)."""
    across, down = _across_and_down(at, columns, rows)
    grid = _bent(columns, rows) @ values
    by_column = (down @ grid.reshape(rows, -1)).reshape(len(at), columns, values.shape[1])
    return np.einsum("nc,nck->nk", across, by_column)


def _across_and_down(at: np.ndarray, columns: int, rows: int) -> list[np.ndarray]:
    """B-splines (n, columns) and (n, rows) of places (n, 2)."""
    counts = enumerate((columns, rows))
    return [_splines(at[:, k], _even(count), count) for k, count in counts]


@cache
def _bent(columns: int, rows: int) -> np.ndarray:
    """Coefficients of the grid (columns * rows, columns * rows - 3), free of planes."""
    x, y = np.meshgrid(_sites(columns), _sites(rows))
    return null_space(np.stack([np.ones(x.size), x.ravel(), y.ravel()]))


def _sites(count: int) -> np.ndarray:
    """Coefficients (count,) of evenly spaced B-splines that make the function x itself."""
    degree = _degree(count)
    knots = _clamped(_even(count), degree)
    return np.array([knots[k + 1 : k + 1 + degree].mean() for k in range(count)])


def _degree(count: int) -> int:
    return min(_DEGREE, count - 1)


def _even(count: int) -> np.ndarray:
    return np.linspace(-1.0, 1.0, count - _degree(count) + 1)


def _clamped(inner: np.ndarray, degree: int) -> np.ndarray:
    return np.concatenate([inner[:1].repeat(degree), inner, inner[-1:].repeat(degree)])


def _splines(at: np.ndarray, inner: np.ndarray, count: int) -> np.ndarray:
    """B-splines (rows, count) between and beyond knots, which include both ends."""
    degree = _degree(count)
    if not len(at):
        return np.zeros((0, count))
    from scipy.interpolate import BSpline  # at first use: few models have a curve

    # Of what is not known, a point behind a camera say, neither are these.
    inside = np.where(np.isfinite(at), np.clip(at, inner[0], inner[-1]), np.nan)
    return BSpline(_clamped(inner, degree), np.eye(count), degree)(inside)


class CameraCurve(LinearEffect):
    """Focal length and principal point as smooth curves of a quantity that each image has.

    most: coefficients of one curve, its constant among them.
    """

    place = "camera"
    generic = True
    most = 6
    moved = ("f", "cx", "cy")

    def quantity(self, images: Images) -> np.ndarray:
        """What the camera follows (images,); it must not depend on the poses being adjusted."""
        raise NotImplementedError

    def parameters(self, block):
        count = coefficients(self.quantity(Images.of(block)), self.most)
        return [
            Parameter(f"{name}_{k}", "px", scale=2.0)
            for name in self.moved
            for k in range(1, count)
        ]

    def derivative(self, context):
        """f, cx, cy move by sum_k value_k curve_k(quantity)."""
        of_images = self.quantity(context.images)
        curves = curve(of_images, of_images, coefficients(of_images, self.most))[context.image]
        return of_interior(context, **dict.fromkeys(self.moved, curves))
