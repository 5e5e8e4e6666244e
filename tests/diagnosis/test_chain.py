"""The factor of a chain of equations against dense algebra."""

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array

from corridor.core.adjustment import fronts
from corridor.diagnosis.system import chain as chain_module
from corridor.diagnosis.system.chain import Chain, blocks_of

IMAGES, OWN, REACH, BORDER = 120, 3, 17, 4


def chained(branches=False, seed=0):
    """Symmetric (n, n), images meeting the next ones and a border; blocks of their rows."""
    rng = np.random.default_rng(seed)
    n = IMAGES * OWN
    image = np.repeat(np.arange(IMAGES), OWN)
    near = np.abs(np.subtract.outer(image, image)) <= REACH
    if branches:
        # Six strips, of which the images meet those of their own.
        near &= np.subtract.outer(image, image) % 6 == 0
    A = np.zeros((n + BORDER,) * 2)
    A[:n, :n] = np.where(near, rng.standard_normal((n, n)), 0.0)
    A[n:, :n] = 0.3 * rng.standard_normal((BORDER, n))
    A = A + A.T
    A[np.diag_indices_from(A)] = np.abs(A).sum(axis=1) + 0.1
    one, other = np.nonzero(np.triu(near[::OWN, ::OWN]))
    order, blocks = blocks_of(one, other, np.full(IMAGES, OWN))
    rows = np.append((order[:, None] * OWN + np.arange(OWN)).ravel(), n + np.arange(BORDER))
    return A[rows][:, rows], blocks


@pytest.fixture(scope="module", params=[False, True], ids=["corridor", "branches"])
def chain(request):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chain_module, "_QUICK", 0.0 if request.param else np.inf)
        # Of so few images it would not be worth while.
        patch.setattr(fronts, "_FRONT", 0.0)
        A, blocks = chained(request.param)
    assert (np.diff(blocks.parent)[:-1] != 1).any() == request.param
    assert len(blocks) > 5
    return A, Chain.of(csc_array(A), blocks, BORDER)


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
    A, blocks = chained()
    A[7, 7] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        Chain.of(csc_array(A), blocks, BORDER)


def test_blocks_reach_as_far_as_any_image_until_there():
    """Reach of 20, then of 1: the window follows, and never falls back."""
    near = np.arange(200)
    reach = np.minimum(near + np.where(near < 100, 20, 1), 199)
    order, blocks = blocks_of(near, reach, np.ones(200, dtype=int))
    ends, later = blocks.ends, blocks.later
    behind = np.array(
        [rows[-1] + 1 if len(rows) else end for end, rows in zip(ends, later, strict=True)]
    )
    assert np.array_equal(order, near)
    assert ends[-1] == behind[-1] == 200 and (np.diff(ends) > 0).all()
    assert (np.diff(behind) >= 0).all() and (behind >= ends).all()
    block = np.searchsorted(ends, near, side="right")
    assert (reach < behind[block]).all()
    assert (behind - ends).max() == 20 and (behind - ends)[-3:].max() <= 1
