"""The factor of a chain of equations against dense algebra."""

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array

from corridor.diagnosis.system.chain import Chain, blocks_of

IMAGES, OWN, REACH, BORDER = 120, 3, 17, 4


def chained(seed=0):
    """Symmetric (n, n), images meeting the next two and a border; ends of the blocks,
    and of what each meets."""
    rng = np.random.default_rng(seed)
    n = IMAGES * OWN
    image = np.repeat(np.arange(IMAGES), OWN)
    near = np.abs(np.subtract.outer(image, image)) <= REACH
    A = np.zeros((n + BORDER,) * 2)
    A[:n, :n] = np.where(near, rng.standard_normal((n, n)), 0.0)
    A[n:, :n] = 0.3 * rng.standard_normal((BORDER, n))
    A = A + A.T
    A[np.diag_indices_from(A)] = np.abs(A).sum(axis=1) + 0.1
    ends, reach = blocks_of(np.minimum(np.arange(IMAGES) + REACH, IMAGES - 1))
    return A, ends * OWN, reach * OWN


@pytest.fixture(scope="module")
def chain():
    A, ends, reach = chained()
    assert len(ends) > 5
    return A, Chain.of(csc_array(A), ends, reach, BORDER)


def test_solutions_are_those_of_the_dense_matrix(chain):
    A, factor = chain
    right = np.random.default_rng(1).standard_normal((len(A), 7))
    assert factor.solve(right) == pytest.approx(np.linalg.solve(A, right), rel=1e-9, abs=1e-12)


def test_halves_multiply_to_what_the_elimination_takes_away(chain):
    A, factor = chain
    right = np.random.default_rng(2).standard_normal((len(A), 5))
    half = factor.half(right)
    assert half.T @ half == pytest.approx(right.T @ np.linalg.solve(A, right), rel=1e-9, abs=1e-10)
    assert factor.logdet == pytest.approx(np.linalg.slogdet(A)[1], rel=1e-12)


def test_the_inverse_within_the_pattern_is_that_of_the_dense_matrix(chain):
    """Its diagonal, pairs of rows that lie near each other or in the border, and variances."""
    A, factor = chain
    inverse, found = np.linalg.inv(A), factor.inverse()
    assert found.diagonal() == pytest.approx(np.diag(inverse), rel=1e-9)
    one = np.array([0, 5, 40, 200, len(A) - 1, 300, len(A) - 2])
    other = np.array([0, 8, 37, 204, len(A) - 3, len(A) - 1, 12])
    assert found.between(one, other) == pytest.approx(inverse[one, other], rel=1e-9, abs=1e-12)
    rows = np.zeros((3, len(A)))
    rows[0, [3, 4]], rows[1, [77, len(A) - 1]], rows[2, len(A) - 2] = (1.0, -2.0), (0.5, 3.0), 1.0
    expected = np.einsum("ij,jk,ik->i", rows, inverse, rows)
    assert found.variances(csr_array(rows)) == pytest.approx(expected, rel=1e-9)


def test_a_matrix_that_is_none_of_a_variance_is_refused():
    A, ends, reach = chained()
    A[7, 7] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        Chain.of(csc_array(A), ends, reach, BORDER)


def test_blocks_reach_as_far_as_any_image_until_there():
    """Reach of 20, then of 1: the window follows, and never falls back."""
    reach = np.minimum(np.arange(200) + np.where(np.arange(200) < 100, 20, 1), 199)
    ends, behind = blocks_of(reach)
    assert ends[-1] == behind[-1] == 200 and (np.diff(ends) > 0).all()
    assert (np.diff(behind) >= 0).all() and (behind >= ends).all()
    block = np.searchsorted(ends, np.arange(200), side="right")
    assert (reach < behind[block]).all()
    assert (behind - ends).max() == 20 and (behind - ends)[-3:].max() <= 1
