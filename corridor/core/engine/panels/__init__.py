"""The engine of large blocks: eight numbers at once, compiled by numba, in two threads."""

from functools import lru_cache

import numpy as np

from corridor.core.engine.compiled import is_kept
from corridor.core.engine.panels import rays, triangular
from corridor.core.engine.panels.band_inverse import invert_within
from corridor.core.engine.panels.kernels import BLOCK, look, make_assemble, substitute
from corridor.core.engine.panels.point_covariance import covariances, point_covariance
from corridor.core.engine.panels.rows import Out, fill, pass_points
from corridor.core.engine.scene import Asked, Equations, Inverse, Passing, Rays, Scene, Step

_assemble_for = lru_cache(make_assemble)


class Panels:
    """See `corridor.core.engine.interface.Engine`."""

    name, threads = "panels", 2

    def __init__(self, d: int, longest: int, sighted: bool) -> None:
        self.d, self.longest = d, longest
        self.kind = int(d), bool(sighted)

    @staticmethod
    def ready() -> bool:
        return is_kept(covariances)

    def residuals(self, scene: Scene, out: np.ndarray) -> np.ndarray:
        room = rays.make_room(BLOCK + self.longest, 6, 0)
        return np.array(look(scene.first, scene.last, scene, out, room))

    def rows(self, scene: Scene, row: np.ndarray, weight: np.ndarray) -> Rays:
        start, wide = scene.observations.start, scene.columns.wide
        d = self.d
        first, last = scene.first, scene.last
        room = rays.make_room(self.longest, d, wide)
        n = 2 * int(start[last] - start[first])
        own, point, shared = np.zeros(n * d), np.zeros(n * 3), np.zeros(n * wide)
        root = np.zeros((last - first, 6))
        out = Out(own, point, shared, root)
        fill(scene.first, scene.last, scene, weight, out, room, self.kind)
        image = scene.observations.image[start[first] : start[last]]
        begin = start[first : last + 1] - start[first]
        made = own.reshape(n, d), point.reshape(n, 3), shared.reshape(n, wide)
        return Rays(image, begin, *made, root, row)

    def assemble(self, scene: Scene, damping: float, into: Equations) -> np.ndarray:
        totals = np.zeros(3)
        kernel = _assemble_for(self.kind == (6, False))
        kernel(scene.first, scene.last, scene, damping, into, totals, self.longest, self.kind)
        return totals

    def factor(self, band: np.ndarray, ld: int, n: int) -> triangular.Factor:
        return triangular.Factor(band, ld, n)

    def substitute(self, scene: Scene, damping: float, step: Step, moved: np.ndarray) -> np.ndarray:
        totals = np.zeros(2)
        substitute(
            scene.first, scene.last, scene, damping, step, moved, totals, self.longest, self.kind
        )  # fmt: skip
        return totals

    def follow(self, rays: Rays, left: np.ndarray, to: Passing) -> None:
        pass_points(rays, left.ravel(), to)

    def inverse(
        self, band: np.ndarray, ld: int, n: int, left: np.ndarray, right: np.ndarray
    ) -> None:
        invert_within(band, n, ld, left, right)

    def point_covariance(self, scene: Scene, known: Inverse, asked: Asked) -> None:
        point_covariance(scene.first, scene.last, scene, self.d, known, self.longest, asked)
