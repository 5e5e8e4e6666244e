"""Vectors of three and rotations about them, for compiled functions."""

import numpy as np

from corridor.core.engine.compiled import SCALAR, njit


@njit(**SCALAR)
def dot(a, b):
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**SCALAR)
def cross(a, b):
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**SCALAR)
def sines(t):
    """sin(a) / a and (1 - cos(a)) / a^2 of the angle a = |t|."""
    a2 = dot(t, t)
    if a2 > 0.01:
        a = np.sqrt(a2)
        h = np.sin(0.5 * a)
        return np.sin(a) / a, 2.0 * h * h / a2
    # Nearly always, and ten times faster.
    return few_sines(a2)


@njit(**SCALAR)
def few_sines(a2):
    """`sines` of a small angle, of its square: the next terms are below 1e-17 up to 0.01."""
    s = 1.0 - a2 * (1 / 6 - a2 * (1 / 120 - a2 * (1 / 5040 - a2 * (1 / 362880))))
    q = 0.5 - a2 * (1 / 24 - a2 * (1 / 720 - a2 * (1 / 40320 - a2 * (1 / 3628800))))
    return s, q


@njit(**SCALAR)
def rotated(s, q, t, x):
    """Exp(t) applied to x; s, q: `sines` of t."""
    c = cross(t, x)
    e = cross(t, c)
    return x[0] + s * c[0] + q * e[0], x[1] + s * c[1] + q * e[1], x[2] + s * c[2] + q * e[2]


@njit(**SCALAR)
def left_jacobian(t, q):
    """Left Jacobian of Exp(t), to second order, applied to q: Exp(t + q) = Exp(Left q) Exp(t)."""
    e = cross(t, q)
    f = cross(t, e)
    return (
        q[0] + 0.5 * e[0] + f[0] / 6.0,
        q[1] + 0.5 * e[1] + f[1] / 6.0,
        q[2] + 0.5 * e[2] + f[2] / 6.0,
    )
