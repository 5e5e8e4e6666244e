"""The cameras of polynomials of chapter 1: Ebner's and Gruen's."""

from types import SimpleNamespace

import numpy as np
import pytest
from kit.numerical import PolynomialCamera

SIZE = np.array([5120, 3840])
x, y = (one.ravel() for one in np.meshgrid(np.linspace(0, 5119, 11), np.linspace(0, 3839, 11)))
PICTURE = SimpleNamespace(pixel=np.column_stack([x, y]), size=np.tile(SIZE, (121, 1)))
X, Y = (2 * x - 5119) / 5120, (2 * y - 3839) / 5120
ZERO, ONE = np.zeros(121), np.ones(121)
# Shift in x and y, scale, rotation and two tilts: over flat ground a pose can do them.
POSE = [(ONE, ZERO), (ZERO, ONE), (X, Y), (Y, -X), (X * X, X * Y), (X * Y, Y * Y)]


def columns(*shifts):
    return np.column_stack([np.concatenate(shift) for shift in shifts])


def terms(degree):
    """(242, parameters): what the coefficients do to x, then to y."""
    derivative = PolynomialCamera(degree).derivative(PICTURE)
    return np.concatenate([derivative[:, 0], derivative[:, 1]])


@pytest.mark.parametrize(("degree", "count"), [(2, 12), (4, 44)])
def test_as_many_parameters_as_published_and_none_that_a_pose_can_take_up(degree, count):
    """Ebner 1976: 12; Gruen 1978: 44. With the six of a pose, all products of that degree."""
    own = terms(degree)
    assert own.shape[1] == count == len(PolynomialCamera(degree).parameters(None))
    assert np.linalg.matrix_rank(np.hstack([own, columns(*POSE)])) == count + 6
    products = [X**i * Y**j for i in range(degree + 1) for j in range(degree + 1)]
    every = columns(*((p, ZERO) for p in products), *((ZERO, p) for p in products))
    assert np.linalg.matrix_rank(np.hstack([own, columns(*POSE), every])) == count + 6


@pytest.mark.parametrize(("degree", "holds"), [(2, False), (4, True)])
def test_a_radial_distortion_of_the_third_order_is_gruens_and_not_ebners(degree, holds):
    r2 = X**2 + Y**2
    radial = np.concatenate([X * r2, Y * r2])
    basis = np.hstack([terms(degree), columns(*POSE)])
    left = radial - basis @ np.linalg.lstsq(basis, radial, rcond=None)[0]
    assert (np.abs(left).max() < 1e-12) == holds
