"""Spatial shapes of a deformation, as polynomials in the picture.

Source: Zhou 2019, eq. 6.2 (similarity) and 6.3 (polynomial); Fraser 1997 (radial, decentring).
"""

import numpy as np


def terms_of(kind: str, order: int = 4) -> np.ndarray:
    """Shapes (k, 2, order * order): each moves x and y by a polynomial of X^i Y^j,
    i, j = 0 .. order - 1, j running fastest (`numpy.polynomial.polynomial.polyvander2d`).

    similarity: shift x, shift y, scale, rotation; radial adds r^2 (X, Y); decentring adds
    (r^2 + 2 X^2, 2 X Y) and (2 X Y, r^2 + 2 Y^2). polynomial: every monomial with i, j = 0..3 on
    either axis; printed: those with i, j = 1..4.
    """
    if kind in ("polynomial", "printed"):
        low = 1 if kind == "printed" else 0
        top = low + 3
        keep = [i * order + j for i in range(low, top + 1) for j in range(low, top + 1)]
        out = np.zeros((2 * len(keep), 2, order * order))
        for n, place in enumerate(keep):
            out[2 * n, 0, place] = out[2 * n + 1, 1, place] = 1.0
        return out
    shapes = [
        ({(0, 0): 1}, {}),
        ({}, {(0, 0): 1}),
        ({(1, 0): 1}, {(0, 1): 1}),
        ({(0, 1): -1}, {(1, 0): 1}),
    ]
    if kind in ("radial", "decentring"):
        shapes.append(({(3, 0): 1, (1, 2): 1}, {(0, 3): 1, (2, 1): 1}))
    if kind == "decentring":
        shapes.append(({(2, 0): 3, (0, 2): 1}, {(1, 1): 2}))
        shapes.append(({(1, 1): 2}, {(0, 2): 3, (2, 0): 1}))
    if kind not in ("similarity", "radial", "decentring"):
        raise ValueError(f"no shapes of the kind {kind!r}")
    out = np.zeros((len(shapes), 2, order * order))
    for n, axes in enumerate(shapes):
        for axis, polynomial in enumerate(axes):
            for (i, j), value in polynomial.items():
                out[n, axis, i * order + j] = value
    return out
