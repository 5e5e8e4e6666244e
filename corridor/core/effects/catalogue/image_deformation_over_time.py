"""A deformation of the picture grows while the flight goes on.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.contract import AlongAxes, Parameter
from corridor.core.effects.splines import surface

COLUMNS, ROWS = 5, 4


class ImageDeformationOverTime(AlongAxes):
    slug = "image_deformation_over_time"
    title = "Coarse deformation of the picture that grows with time, B-splines on a grid of 5 x 4"
    called = "a deformation of the picture that grows with time"
    place = "image"
    needs = ("images.time_s",)
    generic = True
    revealed_by = "the same ground in images that are minutes apart"
    unobservable_when = "the flight is short, or no ground is seen twice"
    # 0.5 px in 10 minutes.
    unknowns = [
        Parameter(f"{axis}_{k}", "px/s", scale=0.5 / 600.0)
        for axis in "xy"
        for k in range(1, COLUMNS * ROWS - 2)
    ]

    def terms(self, context):
        """dx = t sum x_k surface_k(x, y), dy alike; t in seconds from the middle of the block."""
        surfaces = surface(2.0 * context.pixel / (context.size - 1) - 1.0, COLUMNS, ROWS)
        return surfaces * context.time[:, None]
