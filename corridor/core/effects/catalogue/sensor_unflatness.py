"""The sensor is not flat, or the lens has what Fraser's coefficients do not: smooth, of low degree.

Source: Tang et al. 2012, "A flexible mathematical method for camera calibration in digital aerial
photogrammetry" (Legendre polynomials over the picture).
"""

import numpy as np
from numpy.polynomial.legendre import legvander

from corridor.core.effects.contract import AlongAxes, Parameter

# Degrees along x and y. Below 2 the terms are principal point, focal length and affinity.
_TERMS = [(total - j, j) for total in (2, 3, 4) for j in range(total + 1)]


class SensorUnflatness(AlongAxes):
    slug = "sensor_unflatness"
    title = "Smooth deformation of the picture, degree 2 to 4"
    called = "an unevenness of the sensor"
    place = "image"
    group = "camera"
    stands_in_for = ("k1", "k2", "k3", "p1", "p2")
    revealed_by = "tie points in many images that fill the picture, with GNSS or control"
    unobservable_when = (
        "few rays a point, or points in a part of the picture only; terms of degree 2 are nearly "
        "tilts where neither GNSS nor control holds the poses"
    )
    unknowns = [Parameter(f"{axis}_{i}{j}", "px", scale=0.5) for axis in "xy" for i, j in _TERMS]

    def terms(self, context):
        """dx = sum x_ij P_i(x) P_j(y), dy alike; x, y from -1 to 1 over the picture."""
        place = 2.0 * context.pixel / (context.size - 1) - 1.0
        along, across = (legvander(place[:, k], 4) for k in range(2))
        return np.stack([along[:, i] * across[:, j] for i, j in _TERMS], axis=1)
