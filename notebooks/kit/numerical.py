"""Cameras of polynomials that stand for no physics: Ebner's 12 and Gruen's 44 parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import legvander2d

import corridor
from corridor.core.block import Block
from corridor.core.effects.contract import LinearEffect, Parameter
from kit.draws import Table


class PolynomialCamera(LinearEffect):
    """Products of Legendre polynomials over the picture, up to a degree in x and in y alike.

    Degree 2 spans Ebner's (1976) 12 parameters, degree 4 Gruen's (1978) 44; the count is
    2 (degree + 1)^2 - 6, since shift, scale, rotation and the two tilts are those of the pose and
    of f, cx, cy (Tang, Fritsch and Cramer 2012).
    """

    title = "A camera of polynomials"
    called = "a camera of polynomials"
    place = "image"
    group = "camera"
    generic = True
    searched = False
    stands_in_for = ("k1", "k2", "k3", "p1", "p2", "b1", "b2")

    def __init__(self, degree: int):
        super().__init__()
        self.degree, self.slug = degree, f"polynomials_{degree}"

    def parameters(self, block):
        """The coefficients, px."""
        return [Parameter(f"c{k}", "px", scale=5.0) for k in range(2 * (self.degree + 1) ** 2 - 6)]

    def derivative(self, context):
        """d(dx, dy) by the coefficients: of a pose's own motion nothing, of the rest each alone."""
        # Both axes in one unit, or a rotation would not be one.
        x, y = ((2.0 * context.pixel - context.size + 1) / context.size.max()).T
        value = legvander2d(x, y, (self.degree, self.degree))
        names = [(i, j) for i in range(self.degree + 1) for j in range(self.degree + 1)]
        of = dict(zip(names, value.T, strict=True))
        zero = np.zeros_like(x)
        # Affinity, and what is left of the six quadratic terms when two tilts are taken away.
        along = [of[1, 0], of[0, 1], of[0, 2], zero, of[2, 0], -of[1, 1]]
        across = [-of[0, 1], of[1, 0], zero, of[2, 0], -of[1, 1], of[0, 2]]
        rest = [of[i, j] for i, j in names if i + j > 2]
        along += [*rest, *(zero for _ in rest)]
        across += [*(zero for _ in rest), *rest]
        return np.stack([np.column_stack(along), np.column_stack(across)], axis=1)


MODELS = {
    "Fraser, 10": {"camera": "fraser10"},
    "Ebner, 12": {"camera": "f,cx,cy", "effects": [PolynomialCamera(2)]},
    "Gruen, 44": {"camera": "f,cx,cy", "effects": [PolynomialCamera(4)]},
}
_BLOCKS = Path(__file__).resolve().parents[2] / "data_synthetic"


def _without_distortion(block: Block) -> Block:
    """The block as somebody believes it who knows nothing of its lens."""
    block = block.copy()
    nothing = dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0)
    block.cameras = {name: c.with_values(**nothing) for name, c in block.cameras.items()}
    return block


STARTS = {
    "dike, lens unknown": lambda: _without_distortion(
        corridor.adjust(corridor.read(_BLOCKS / "dike")).start
    ),
    "levee, lens unknown": lambda: _without_distortion(
        corridor.read(_BLOCKS / "stories" / "levee_twin")
    ),
    "levee, as calibrated": lambda: corridor.read(_BLOCKS / "stories" / "levee_twin"),
}


def _adjusted(start, model):
    """Residuals of the tie points, and RMS of the check points."""
    found = corridor.adjust(STARTS[start](), strict=True, **MODELS[model])
    return {
        "tie residuals (px)": found.observations.loc["tie", "rms_px"],
        "horizontal (mm)": 1000 * found.check_rms.xy,
        "height (mm)": 1000 * found.check_rms.z,
    }


TABLE = Table(
    "cameras", ("start", "model"), [(start, model) for start in STARTS for model in MODELS],
    _adjusted,
)  # fmt: skip
