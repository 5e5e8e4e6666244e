"""Lenses: from the ray (u, v, 1) to the picture at unit focal length.

Real lenses do not follow Fraser's polynomial. Each family here bends the rays by another law,
about an axis that misses the middle, with a fine texture on top. What a calibration would state of
such a lens is its best fit by Fraser's ten parameters.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lens:
    """A lens and its sensor.

    family: `fraser`, `fisheye`, `rational` or `division`. f: px. point: principal point, px.
    axis: of the lens, in u and v. strength: coefficients of the family.
    texture: (terms, 6) waves over the picture: size of dx and dy in px, wave numbers of x and y
    (half waves over the picture) and phases, rad.
    """

    family: str
    width: int
    height: int
    f: float
    point: tuple[float, float]
    axis: tuple[float, float]
    strength: tuple[float, ...]
    texture: np.ndarray

    def bend(self, u, v):
        """Where a ray (n,) falls at unit focal length, texture left out."""
        if self.family == "fraser":
            return fraser(u, v, self.strength)
        return FAMILIES[self.family](u, v, self.axis, self.strength)

    def wave(self, x, y):
        """Texture (n,), (n,) px at pixels (n,)."""
        dx, dy = np.zeros_like(x), np.zeros_like(y)
        for ax, ay, p, q, phase_x, phase_y in self.texture:
            turn = np.pi * (p * x / self.width + q * y / self.height)
            dx += ax * np.sin(turn + phase_x)
            dy += ay * np.sin(turn + phase_y)
        return dx, dy


def fraser(u, v, strength):
    """Fraser 1997 in normalised units; strength: k1, k2, k3, p1, p2, b1, b2."""
    k1, k2, k3, p1, p2, b1, b2 = strength
    r2 = u**2 + v**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x = u * radial + p1 * (3 * u**2 + v**2) + 2 * p2 * u * v + b1 * u + b2 * v
    y = v * radial + p2 * (u**2 + 3 * v**2) + 2 * p1 * u * v
    return x, y


def _about(u, v, axis, law):
    """A radial law r -> r' about an axis that misses the middle."""
    a, b = u - axis[0], v - axis[1]
    r = np.hypot(a, b)
    factor = law(np.maximum(r, 1e-12)) / np.maximum(r, 1e-12)
    return axis[0] + a * factor, axis[1] + b * factor


def _fisheye(u, v, axis, strength):
    """Part of the rays' tangent replaced by the angle (equidistant projection)."""
    share = strength[0]
    return _about(u, v, axis, lambda r: (1 - share) * r + share * np.arctan(r))


def _rational(u, v, axis, strength):
    """Ratio of two polynomials of the radius (Claus and Fitzgibbon 2005, radial part)."""
    a, b, c, d = strength

    def law(r):
        q = r * r
        return r * (1 + q * (a + b * q)) / (1 + q * (c + d * q))

    return _about(u, v, axis, law)


def _division(u, v, axis, strength):
    """r = r' / (1 + s r'^2), solved for r' (Fitzgibbon 2001)."""
    s = strength[0]
    return _about(u, v, axis, lambda r: 2 * r / (1 + np.sqrt(1 - 4 * s * r * r)))


FAMILIES = {"fisheye": _fisheye, "rational": _rational, "division": _division}
_STRENGTH = {
    "fraser": (-0.042, 0.028, -0.006, 2.0e-4, -1.5e-4, 1.0e-4, -0.6e-4),
    "fisheye": (0.12,),
    "rational": (0.21, 0.05, 0.25, 0.04),
    "division": (-0.045,),
}


def make_lens(family, width, height, f, texture_px, rng):
    """A lens of a family (`any`: of one that is not Fraser's), different with every draw.

    texture_px: root mean square of the texture.
    """
    if family == "any":
        family = str(rng.choice(list(FAMILIES)))
    point = tuple((np.array([width, height]) - 1) / 2 + rng.normal(0, 6, 2))
    strength = np.array(_STRENGTH[family]) * (1 + 0.05 * rng.standard_normal())
    waves = np.empty((4, 6))
    waves[:, :2] = rng.normal(0, 1, (4, 2))
    waves[:, :2] *= texture_px * np.sqrt(2) / np.linalg.norm(waves[:, :2], axis=0)
    waves[:, 2:4] = rng.uniform(-3, 3, (4, 2))
    waves[:, 4:] = rng.uniform(0, 2 * np.pi, (4, 2))
    axis = tuple(rng.normal(0, 6e-4, 2))
    return Lens(
        family, width, height, f + rng.normal(0, 3), point, axis, tuple(strength.tolist()),
        waves if family != "fraser" else waves[:0],
    )  # fmt: skip


def calibration(lens):
    """Fraser's ten parameters that fit a lens best, and the rms of what is left, px.

    Linear least squares over a grid of rays: all but f enter the picture multiplied by f.
    """
    reach = np.array([lens.width, lens.height]) / 2 / lens.f * 1.02
    u, v = (g.ravel() for g in np.meshgrid(*(np.linspace(-r, r, 41) for r in reach)))
    x, y = lens.bend(u, v)
    x, y = lens.point[0] + lens.f * x, lens.point[1] + lens.f * y
    dx, dy = lens.wave(x, y)
    inside = (x > 0) & (x < lens.width - 1) & (y > 0) & (y < lens.height - 1)
    zero, r2 = np.zeros_like(u), u**2 + v**2
    columns = [
        (u, v), (1 + zero, zero), (zero, 1 + zero),
        *((u * r2**n, v * r2**n) for n in (1, 2, 3)),
        (3 * u**2 + v**2, 2 * u * v), (2 * u * v, u**2 + 3 * v**2), (u, zero), (v, zero),
    ]  # fmt: skip
    design = np.stack([np.concatenate([a[inside], b[inside]]) for a, b in columns], axis=1)
    target = np.concatenate([(x + dx)[inside], (y + dy)[inside]])
    scale = np.abs(design).max(axis=0)
    found = np.linalg.lstsq(design / scale, target, rcond=None)[0] / scale
    rest = target - design @ found
    names = ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2", "b1", "b2")
    found[3:] /= found[0]
    return dict(zip(names, found.tolist(), strict=True)), float(np.sqrt(np.mean(rest**2)))
