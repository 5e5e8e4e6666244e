"""In every image the rows are shifted by a polynomial of their own: jello, or what looks like it.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class RowPolynomial(LinearEffect):
    slug = "row_polynomial"
    title = "Shift of the rows of each image, linear and quadratic in the row"
    called = "a shift of the rows that differs from image to image"
    place = "image"
    group = "image"
    generic = True
    by_row = True
    revealed_by = "many tie points in every image, over all of its rows"
    unobservable_when = "an image has few points, or points in few rows"
    unknowns = [
        Parameter(name, "px", scale=0.5)
        for name in ("x_linear", "y_linear", "x_quadratic", "y_quadratic")
    ]

    def derivative(self, context):
        """dx = x_linear s + x_quadratic s^2, dy alike; s from -1 (read first) to 1 (read last)."""
        row = 2.0 * context.row
        derivative = np.zeros((len(context), 2, 4))
        derivative[:, 0, 0] = derivative[:, 1, 1] = row
        derivative[:, 0, 2] = derivative[:, 1, 3] = row * row
        return derivative
