"""The picture is deformed, the same in all images, in a way that no named effect has.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.contract import AlongAxes, Parameter
from corridor.core.effects.splines import on_surface, surface

COLUMNS, ROWS = 9, 7


class ImageDeformation(AlongAxes):
    slug = "image_deformation"
    title = "Any smooth deformation of the picture, B-splines on a grid of 9 x 7"
    called = "a deformation of the picture, the same in all images"
    place = "image"
    group = "camera"
    stands_in_for = ("k1", "k2", "k3", "p1", "p2")
    generic = True
    revealed_by = "many tie points in all parts of the picture, seen in several images each"
    unobservable_when = "parts of the picture have no points, or points have few rays"
    unknowns = [
        Parameter(f"{axis}_{k}", "px", scale=0.5)
        for axis in "xy"
        for k in range(1, COLUMNS * ROWS - 2)
    ]

    def terms(self, context):
        """dx = sum x_k surface_k(x, y), dy alike; x, y from -1 to 1 over the picture."""
        return surface(_place(context), COLUMNS, ROWS)

    def moved(self, context, values):
        return on_surface(_place(context), values, COLUMNS, ROWS)


def _place(context):
    """Where in their picture (rows, 2) points lie, from -1 to 1."""
    return 2.0 * context.pixel / (context.size - 1) - 1.0
