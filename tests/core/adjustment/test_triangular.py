"""Factor of a band, solutions with it and the inverse inside it, against the dense ones."""

import numpy as np
import pytest

from corridor.core.adjustment.partition import Pieces
from corridor.core.engine.panels import triangular
from corridor.core.engine.panels.band_inverse import invert_within

SHAPES = [(1, 1), (5, 3), (9, 2), (16, 4), (23, 1), (31, 16), (37, 37), (100, 20), (700, 108)]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def band_of(dense, ld):
    """A lower band, column by column; behind the last one stands no number."""
    n = len(dense)
    band = np.full(n * ld + 20, np.nan)
    for column in range(n):
        rows = min(ld, n - column)
        band[column * ld : (column + 1) * ld] = 0.0
        band[column * ld :][:rows] = dense[column : column + rows, column]
    return band


def positive(n, ld, rng):
    near = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) < ld
    some = np.tril(rng.normal(size=(n, n))) * near
    return some @ some.T * near + 2.0 * ld * np.eye(n)


@pytest.mark.parametrize(("n", "ld"), SHAPES)
def test_the_factor_is_that_of_the_dense_matrix(n, ld, rng):
    dense = positive(n, ld, rng)
    band = band_of(dense, ld)
    assert triangular.factor(band, ld, n) is None
    factor = band_of(np.linalg.cholesky(dense), ld)
    assert band == pytest.approx(factor, rel=1e-12, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize("columns", [1, 3, 8, 13])
@pytest.mark.parametrize(("n", "ld"), SHAPES)
def test_solutions_are_those_of_the_dense_factor(n, ld, columns, rng):
    factor = np.linalg.cholesky(positive(n, ld, rng))
    band, right = band_of(factor, ld), rng.normal(size=(n, columns))
    given = right.copy()
    forward = triangular.forward(band, ld, n, right)
    backward = triangular.backward(band, ld, n, right)
    assert forward == pytest.approx(np.linalg.solve(factor, right), rel=1e-11, abs=1e-13)
    assert backward == pytest.approx(np.linalg.solve(factor.T, right), rel=1e-11, abs=1e-13)
    assert np.array_equal(right, given)


@pytest.mark.parametrize("columns", [0, 1, 5])
@pytest.mark.parametrize(("n", "ld"), SHAPES)
def test_the_inverse_inside_the_band_is_that_of_the_dense_matrix(n, ld, columns, rng):
    dense = positive(n, ld, rng)
    left, right = rng.normal(size=(2, n, columns))
    band = band_of(np.linalg.cholesky(dense), ld)
    invert_within(band, n, ld, left, right)
    inverse = band_of(np.linalg.inv(dense) + left @ right.T, ld)
    assert band == pytest.approx(inverse, rel=1e-11, abs=1e-13, nan_ok=True)


@pytest.mark.parametrize("ld", [20, 480])
@pytest.mark.parametrize("column", [0, 3, 8, 498])
def test_the_first_column_that_is_not_positive_is_named(ld, column, rng):
    """Narrow bands by ours, wide ones by LAPACK."""
    dense = positive(500, ld, rng)
    dense[column, column] = -1.0
    assert triangular.factor(band_of(dense, ld), ld, 500) == column


def test_wide_bands_have_the_same_factor_both_ways(rng, monkeypatch):
    dense = positive(600, 470, rng)
    ours, lapack = band_of(dense, 470), band_of(dense, 470)
    triangular.factor(lapack, 470, 600)
    monkeypatch.setattr(triangular, "_WIDE", 1000)
    triangular.factor(ours, 470, 600)
    assert ours == pytest.approx(lapack, rel=1e-12, abs=1e-12, nan_ok=True)


def test_what_pieces_add_is_what_one_adds():
    """Points in images i to i + 2, in pieces that begin with images 0, 3 and 5 of seven."""
    pieces = Pieces([0, 3, 5, 7], [0, 3, 5, 7], spare=3, threads=2)
    rows, whole = np.full((7 + pieces.apart, 2), 9.0), np.zeros((7, 2))

    def work(piece, first, last):
        pieces.clear(piece, rows)
        split, further = pieces.shift(piece)
        for point in range(first, last):
            for image in range(point, min(point + 3, 7)):
                rows[image if image < split else image + further] += point + 1.0

    for point in range(7):
        whole[point : point + 3] += point + 1.0
    pieces.run(work)
    pieces.fold(rows)
    assert np.array_equal(rows[:7], whole)
