"""Factor of image blocks front by front, solutions and the inverse, against the dense ones."""

import numpy as np
import pytest
from scipy.sparse import coo_array

from corridor.core.adjustment.fronts import FrontFactor, Tree
from corridor.core.adjustment.matrix import neighbours
from corridor.core.engine.scene import Storage


def area(side, d, seed=3):
    """Images (side, side) of which each meets those around it: storage, and the dense matrix."""
    rng = np.random.default_rng(seed)
    places = np.indices((side, side)).reshape(2, -1).T[rng.permutation(side * side)]
    near = np.abs(places[:, None] - places).max(axis=2) <= 1
    images = len(places)
    one, other = np.nonzero(np.triu(near, 1))
    ptr, img = 2 * np.arange(len(one) + 1), np.stack([one, other], axis=1).ravel()
    start, neighbour = neighbours(images, ptr, img)
    some = np.tril(rng.normal(size=(images * d, images * d)))
    dense = (some @ some.T) * np.kron(near, np.ones((d, d)))
    dense += (np.abs(dense).sum(axis=1).max()) * np.eye(len(dense))
    column = np.repeat(np.arange(images), np.diff(start))
    blocks = dense.reshape(images, d, images, d)[neighbour, :, column].transpose(0, 2, 1).copy()
    blocks[neighbour == column] = np.triu(blocks[neighbour == column])  # the rest is not looked at
    return Storage(blocks.ravel(), d, start, neighbour), dense


@pytest.fixture(scope="module", params=[(2, 1), (5, 6), (9, 2), (12, 3)], ids=str)
def made(request):
    side, d = request.param
    storage, dense = area(side, d)
    tree = Tree(storage.neighbour_start, storage.neighbour)
    return FrontFactor(tree, storage.flat, d), storage, dense


def test_every_image_is_eliminated_once_and_before_the_later_ones_of_its_front(made):
    factor, storage, _ = made
    tree = factor.tree
    assert sorted(tree.order) == list(range(len(storage.neighbour_start) - 1))
    own = [front.images[: front.own] for front in tree.fronts]
    assert np.array_equal(np.concatenate(own), np.arange(len(tree.order)))
    for n, front in enumerate(tree.fronts):
        assert (np.diff(front.images) > 0).all()
        assert front.parent == -1 or front.parent > n


@pytest.mark.parametrize("columns", [1, 7])
def test_solutions_are_those_of_the_dense_matrix(made, columns):
    factor, _, dense = made
    right = np.random.default_rng(5).normal(size=(len(dense), columns))
    given = right.copy()
    half = factor.half(right)
    assert factor.other_half(half) == pytest.approx(np.linalg.solve(dense, right), rel=1e-11)
    assert half.T @ half == pytest.approx(right.T @ np.linalg.solve(dense, right), rel=1e-11)
    assert np.array_equal(right, given)


def test_the_determinant_is_in_the_pivots(made):
    factor, _, dense = made
    assert 2.0 * np.log(factor.pivots).sum() == pytest.approx(np.linalg.slogdet(dense)[1])


def test_the_inverse_within_the_pattern_is_that_of_the_dense_matrix(made):
    factor, storage, dense = made
    left, right = np.random.default_rng(7).normal(size=(2, len(dense), 2))
    flat = factor.inverse(storage, left, right)
    d, whole = factor.d, np.linalg.inv(dense) + left @ right.T
    column = np.repeat(
        np.arange(len(storage.neighbour_start) - 1), np.diff(storage.neighbour_start)
    )
    expected = whole.reshape(-1, d, len(whole) // d, d)[storage.neighbour, :, column]
    assert flat.reshape(-1, d, d).transpose(0, 2, 1) == pytest.approx(expected, rel=1e-9)


def test_a_column_that_nothing_determines_is_named():
    storage, _ = area(6, 3)
    d, column = 3, np.repeat(np.arange(36), np.diff(storage.neighbour_start))
    blocks = storage.flat.reshape(-1, d, d).copy()
    blocks[storage.neighbour == 20, :, 1] = 0.0
    blocks[column == 20, 1] = 0.0
    weak = FrontFactor(Tree(storage.neighbour_start, storage.neighbour), blocks.ravel(), d).weak
    assert weak == (20, 1)


def test_an_area_has_fewer_fronts_than_images_and_no_chain_of_them():
    storage, _ = area(12, 3)
    tree = Tree(storage.neighbour_start, storage.neighbour)
    assert len(tree.fronts) < 72  # of 144 images
    assert max(len(front.images) for front in tree.fronts) < 72


def test_blocks_that_do_not_hang_together_are_factored_too():
    storage = Storage(np.full(3, 4.0), 1, np.arange(4), np.arange(3))
    factor = FrontFactor(Tree(storage.neighbour_start, storage.neighbour), storage.flat, 1)
    assert coo_array(factor.pivots).data == pytest.approx([2.0, 2.0, 2.0])
