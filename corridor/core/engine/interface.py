"""The wall: what the adjustment asks of an engine, and which engine answers.

Four calls make an adjustment: `assemble`, `factor`, `substitute` and `inverse` (within the pattern
of the equations). Beside them stand those parts of them that somebody asks for alone: `residuals`
and `rows` are half of an assembly, `follow` substitutes for many right sides, and
`point_covariance` takes the inverse on to the points. The scene and what is filled are arrays
(`corridor.core.engine.scene`); what an engine does with them is its own.

`panels` is compiled by numba and runs in two threads; `plain` is NumPy and SciPy, for blocks of
some hundred images and for reading. Both find the same numbers. The variable CORRIDOR_ENGINE names
one; without it `panels` is taken, and `plain` where numba is missing.
"""

import os
import warnings
from functools import cache
from typing import Protocol

import numpy as np

from corridor.core.engine.scene import Asked, Equations, Inverse, Passing, Rays, Scene, Step
from corridor.core.errors import InputError, SlowerWarning

NAMES = ("panels", "plain")
VARIABLE = "CORRIDOR_ENGINE"


class Factor(Protocol):
    """Cholesky factor L of a band, in the place of the band. weak: the first column that is not
    positive, None where all are: without a factor there are no solutions."""

    weak: int | None

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right for right (n, k)."""

    def other_half(self, right: np.ndarray) -> np.ndarray:
        """L'^-1 right for right (n, k)."""


class Engine(Protocol):
    """For images, or exposures, with `d` unknowns; longest: the most rays of a point; sighted:
    whether effects on the image see object points. A scene says which of its points are meant.

    `assemble` and `point_covariance` have the unknowns of exposures, `rows` and `substitute` those
    of images."""

    name: str
    threads: int
    d: int

    def __init__(self, d: int, longest: int, sighted: bool) -> None: ...

    @staticmethod
    def ready() -> bool:
        """Whether nothing is left to be compiled."""

    def residuals(self, scene: Scene, out: np.ndarray) -> np.ndarray:
        """Sum of rho over the rays and how many are behind a camera (2,). out (n, 2) or (0, 2):
        receives the residuals times the root of their weight, NaN of those behind."""

    def rows(self, scene: Scene, row: np.ndarray, weight: np.ndarray) -> Rays:
        """Weighted Jacobian rows; row (points,): of `Rays`; weight (points, 6): of the points."""

    def assemble(self, scene: Scene, damping: float, into: Equations) -> np.ndarray:
        """Add the reduced normal equations; cost, rays behind a camera, weak directions (3,)."""

    def factor(self, band: np.ndarray, ld: int, n: int) -> Factor:
        """Factorise in place the first n columns of a band, entry (i, j) at j ld + i - j."""

    def substitute(self, scene: Scene, damping: float, step: Step, moved: np.ndarray) -> np.ndarray:
        """Move points by a step: moved (points, 3) receives them. Their part (2,) of
        step . gradient and of step . diagonal . step."""

    def follow(self, rays: Rays, left: np.ndarray, to: Passing) -> None:
        """Residuals (2 n, sets) left, in place, less what the points follow."""

    def inverse(
        self, band: np.ndarray, ld: int, n: int, left: np.ndarray, right: np.ndarray
    ) -> None:
        """Entries of (L L')^-1 + left right' inside a band, in place of its factor L."""

    def point_covariance(self, scene: Scene, known: Inverse, asked: Asked) -> None:
        """Covariances of points from those of images and of what these share."""


def engine() -> type[Engine]:
    """The engine that CORRIDOR_ENGINE names. Raises InputError for a name that is none."""
    name = os.environ.get(VARIABLE) or NAMES[0]
    if name not in NAMES:
        raise InputError(f"{VARIABLE} is {name!r}: use {' or '.join(NAMES)}")
    return _panels() if name == NAMES[0] else _plain()


def _plain() -> type[Engine]:
    from corridor.core.engine.plain import Plain

    return Plain


@cache
def _panels() -> type[Engine]:
    """Raises nothing: where numba, or what the panels need of it, is missing, the plain engine."""
    try:
        from corridor.core.engine.panels import Panels
    except (ImportError, AttributeError) as fault:
        warnings.warn(
            f"numba cannot be used ({fault}): the engine 'plain' computes, with the same results "
            "but more slowly; install numba 0.64 to 0.68 for large blocks",
            SlowerWarning,
            stacklevel=2,
        )
        return _plain()
    return Panels
