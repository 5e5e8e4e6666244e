"""The ground or its survey has moved along the corridor: a dike settles, a traverse bends.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import Effect, Parameter, along_each, linear
from corridor.core.effects.splines import coefficients, curve

_MOST = 6


class GroundMotion(Effect):
    slug = "ground_motion"
    title = "Motion of the ground control along the corridor, smooth from end to end"
    called = "a motion of the ground control that changes along the corridor"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    generic = True
    revealed_by = "GNSS all along the corridor and control points that disagree with it smoothly"
    unobservable_when = "there are few control points, or no GNSS"

    def parameters(self, block):
        count = self._count(Images.of(block), block)
        return [Parameter(f"{a}_{k}", "m", scale=0.05) for a in "xyz" for k in range(1, count)]

    def shift(self, context, values):
        """Each axis moves by sum_k value_k curve_k(station), station along the images' axis."""
        stations, axis = _along(context.images)
        # The control of the block, which this may be some of, says how many there are.
        count = values.shape[-1] // 3 + 1
        at = (context.position - context.images.middle) @ axis
        derivative = along_each(curve(at, stations, count))
        return linear(derivative, values), derivative

    @staticmethod
    def _count(images, block):
        """No more coefficients than control points can bear."""
        given = int((block.ground["role"] == "control").sum())
        return min(coefficients(_along(images)[0], _MOST), max(given - 1, 2) if given else _MOST)


def _along(images: Images) -> tuple[np.ndarray, np.ndarray]:
    """Stations of the images (m,) along their longest axis in plan, m, and that axis (3,)."""
    away = images.start_centre - images.middle
    if not np.isfinite(away).all():
        return np.full(len(away), np.nan), np.zeros(3)
    _, _, axes = np.linalg.svd(away[:, :2], full_matrices=True)
    axis = np.append(axes[0] * np.sign(axes[0][np.argmax(np.abs(axes[0]))]), 0.0)
    return away @ axis, axis
