"""Factor of image blocks front by front, solutions and the inverse, against the dense ones."""

import numpy as np
import pytest

from corridor.core.adjustment.fronts import FrontFactor, Fronts, least_fill
from corridor.core.adjustment.matrix import Singular, Sparse, neighbours
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


def sparse_of(storage, flat=None):
    made = Sparse.__new__(Sparse)
    super(Sparse, made).__init__(len(storage.neighbour_start) - 1, storage.stride)
    made.stride, made.neighbour_start, made.neighbour = storage[1:]
    made.flat = storage.flat if flat is None else flat
    return made


@pytest.fixture(scope="module", params=[(2, 1), (5, 6), (9, 2), (12, 3)], ids=str)
def made(request):
    side, d = request.param
    storage, dense = area(side, d)
    sparse = sparse_of(storage)
    return sparse, sparse.factor(np.zeros((side * side, d))), dense


@pytest.mark.parametrize("side", [1, 5, 12])
def test_every_later_image_is_its_parents_own_or_met_by_it(side):
    storage, _ = area(side, 1)
    images = side * side
    column = np.repeat(np.arange(images), np.diff(storage.neighbour_start))
    order, fronts = least_fill(storage.neighbour, column, images)
    assert sorted(order) == list(range(images)) and fronts.ends[-1] == images
    for n, (parent, later) in enumerate(zip(fronts.parent, fronts.later, strict=True)):
        assert (parent > n) if len(later) else (parent == -1)
        here = np.arange(fronts.starts[parent], fronts.ends[parent])
        assert not len(later) or np.isin(later, [*here, *fronts.later[parent]]).all()


@pytest.mark.parametrize("columns", [0, 1, 7])
def test_solutions_are_those_of_the_dense_matrix(made, columns):
    _, factor, dense = made
    right = np.random.default_rng(5).normal(size=(len(dense), columns))
    given = right.copy()
    half = factor.half(right)
    assert factor.other_half(half) == pytest.approx(np.linalg.solve(dense, right), rel=1e-9)
    assert half.T @ half == pytest.approx(right.T @ np.linalg.solve(dense, right), rel=1e-9)
    assert np.array_equal(right, given)


def test_the_determinant_is_in_the_pivots(made):
    _, factor, dense = made
    assert 2.0 * np.log(factor.pivots).sum() == pytest.approx(np.linalg.slogdet(dense)[1])


def test_the_inverse_within_the_pattern_is_that_of_the_dense_matrix(made):
    sparse, _, dense = made
    left, right = np.random.default_rng(7).normal(size=(2, len(dense), 2))
    flat, d = sparse.inverse(left, right).flat, sparse.d
    whole = np.linalg.inv(dense) + left @ right.T
    column = np.repeat(np.arange(sparse.images), np.diff(sparse.neighbour_start))
    expected = whole.reshape(-1, d, len(whole) // d, d)[sparse.neighbour, :, column]
    assert flat.reshape(-1, d, d).transpose(0, 2, 1) == pytest.approx(expected, rel=1e-9)


def test_a_column_that_nothing_determines_is_named():
    storage, _ = area(6, 3)
    column = np.repeat(np.arange(36), np.diff(storage.neighbour_start))
    blocks = storage.flat.reshape(-1, 3, 3).copy()
    blocks[storage.neighbour == 20, :, 1] = 0.0
    blocks[column == 20, 1] = 0.0
    with pytest.raises(Singular) as told:
        sparse_of(storage, blocks.ravel()).factor(np.ones((36, 3)))
    assert (told.value.image, told.value.own) == (20, 1)


def test_arms_that_meet_take_less_than_two_thirds_of_what_their_chain_takes():
    """Six corridors from one place, where each image meets the next twenty of its arm."""
    arms, length, reach = 6, 100, 20
    image = np.arange(arms * length).reshape(length, arms)
    pairs = [(image[: length - k].ravel(), image[k:].ravel()) for k in range(1, reach + 1)]
    pairs.append(np.triu_indices(arms, 1))
    one, other = (np.concatenate(each) for each in zip(*pairs, strict=True))
    _, tree = least_fill(one, other, image.size)
    ends = np.arange(12, image.size + 1, 12)
    ahead = [np.arange(end, min(end + arms * reach, image.size)) for end in ends]
    assert tree.products < 2 / 3 * Fronts(ends, ahead).products


def test_rows_of_images_that_do_not_hang_together_are_fronts_of_their_own():
    fronts = least_fill(np.arange(3), np.arange(3), 3)[1].of_rows(np.array([2, 2, 2]))
    own, link = [4.0 * np.eye(2, order="F") for _ in range(3)], [np.zeros((0, 2))] * 3
    assert FrontFactor(fronts, own, link).pivots == pytest.approx([2.0] * 6)
