"""Forms every statistic of a fit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from corridor.diagnosis.signatures import of_single_images, signatures
from corridor.diagnosis.statistics.antenna import add_gnss
from corridor.diagnosis.statistics.ground import add_ground
from corridor.diagnosis.statistics.statistic import Fit, Statistic
from corridor.diagnosis.statistics.ties import add_marks, add_ties
from corridor.effects import Images


class Ruler:
    """Forms every statistic of a fit; the same bins for a block and all its counterparts.

    believed: the model, its problem and its own fit. Call it with a `Fit`: (values,) of all
    statistics end to end.
    """

    def __init__(self, believed):
        self.statistics: list[Statistic] = []
        self.missing: dict[str, str] = {}
        self.unseen: tuple[str, ...] = ()
        self._parts: list[Callable[[Seen], np.ndarray]] = []
        self.believed = believed
        system = believed.system
        self.images: Images = system.images
        if believed.is_tie.any():
            add_ties(self)
        if (~believed.is_tie).any():
            add_marks(self)
        if len(system.gnss.names):
            add_gnss(self)
        control = system.control_rows
        if len(control):
            add_ground(self, "control", control, "control", lambda seen: seen.fit.control)
        if len(believed.check_rows):
            add_ground(self, "check", believed.check_rows, "check", lambda seen: seen.fit.check)
        self._signatures()

    def __call__(self, fit: Fit) -> np.ndarray:
        seen = Seen(fit, self)
        return np.concatenate([part(seen) for part in self._parts])

    @property
    def lengths(self) -> list[int]:
        """Values of each statistic."""
        return [len(one) for one in self.statistics]

    def add(self, statistic: Statistic, part: Callable[[Seen], np.ndarray]) -> None:
        if len(statistic):
            self.statistics.append(statistic)
            self._parts.append(part)

    def _signatures(self) -> None:
        found = signatures(self.believed)
        if found is not None:
            b, self.unseen = self.believed, found.absorbed
            self.add(
                Statistic(
                    "signatures of the physical effects", "signature", "stated deviations",
                    "effect", np.arange(len(found.names), dtype=float), found.names,
                ),
                lambda seen: found.strengths(seen.pixels(b), seen.fit.gnss, seen.fit.control),
            )  # fmt: skip
        single = of_single_images(self.believed)
        if single:
            names = tuple(name for name, *_ in single)
            forms = [self._single(pixels, gnss) for _, pixels, gnss in single]
            self.add(
                Statistic(
                    "signatures in single images", "signature", "stated deviations", "effect",
                    np.arange(len(names), dtype=float), names,
                ),
                lambda seen: np.array([form(seen) for form in forms]),
            )  # fmt: skip

    def _single(self, pixels: np.ndarray, gnss: np.ndarray) -> Callable[[Seen], float]:
        """RMS over the images of what residuals share with a signature, in stated deviations."""
        b, system = self.believed, self.believed.system
        rows, image = system.image_rows, system.gnss.image
        count = len(system.columns.images)
        heavy = pixels / rows.sigma[:, None] ** 2
        antenna = gnss / system.gnss.sigma**2
        square = np.bincount(rows.image, (heavy * pixels).sum(axis=1), count)
        square += np.bincount(image, (antenna * gnss).sum(axis=1), count)
        touched = square > 1e-6 * square.max()
        in_pixels, in_antenna = bool(np.any(pixels)), bool(np.any(gnss))

        def form(seen: Seen) -> float:
            share = np.zeros(count)
            if in_pixels:
                share += np.bincount(rows.image, (heavy * seen.pixels(b)).sum(axis=1), count)
            if in_antenna:
                share += np.bincount(image, (antenna * seen.gnss).sum(axis=1), count)
            return float(np.sqrt(np.mean(share[touched] ** 2 / square[touched])))

        return form


class Seen:
    """The residuals of one fit, cut and turned as the statistics need them."""

    def __init__(self, fit: Fit, ruler: Ruler):
        self.fit, self._ruler, b = fit, ruler, ruler.believed
        self._pixels = None
        if b.is_tie.any():
            limit = ruler.limit[:, None]
            self.ties = np.clip(fit.pixels[ruler.used], -limit[ruler.used], limit[ruler.used])
            self.held = np.clip(fit.pixels[ruler.held], -limit[ruler.held], limit[ruler.held])
            self.tie_square = (self.ties**2).sum(axis=1) / 2
            self.outward = ruler.weight * np.einsum("ni,ni->n", self.ties, ruler.across)
            if ruler.flow is not None:
                x, y = ruler.flow.T
                self.flowing = {
                    "along": self.ties[:, 0] * x + self.ties[:, 1] * y,
                    "across": self.ties[:, 1] * x - self.ties[:, 0] * y,
                }
        if (~b.is_tie).any():
            limit = ruler.mark_limit[:, None]
            self.marks = np.clip(fit.pixels[ruler.marks], -limit, limit)
        if len(fit.gnss):
            self.gnss = np.clip(fit.gnss, -ruler.gnss_limit, ruler.gnss_limit)
            rotation = ruler.images.rotation[b.system.gnss.image]
            self.gnss_in_camera = np.einsum("nij,nj->ni", rotation, self.gnss)

    def pixels(self, b) -> np.ndarray:
        """Residuals (n, 2) of all image observations, cut; zero where held out."""
        if self._pixels is not None:
            return self._pixels
        self._pixels = out = np.zeros_like(self.fit.pixels)
        if b.is_tie.any():
            out[self._ruler.used] = self.ties
        if (~b.is_tie).any():
            out[self._ruler.marks] = self.marks
        return out
