"""A model with values for each image, which are eliminated first, against one matrix of it all."""

import numpy as np
import pytest

from corridor.diagnosis.evidence.joint import BesideImages, OfImages, Together
from corridor.diagnosis.system.elimination import Pieces

OWN, CORE, CHOSEN = 60, 9, np.array([1, 4, 5])
AT, REST = np.r_[0:1, 3 : 3 + OWN - 1], np.r_[1:3, OWN + 2]
SIZES = np.array([0.7, 2.0, 1.5])


@pytest.fixture(params=[1, 3], ids=["whole", "in pieces"])
def case(request):
    """The joint matrix with sizes, of which values for each image come in several pieces."""
    rng = np.random.default_rng(0)
    A = rng.standard_normal((200, OWN + CORE))
    N = A.T @ A
    ends = np.linspace(0, OWN, request.param + 1).astype(int)
    blocks = [N[a:b, a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)]
    D = Pieces(blocks)
    own = OfImages(D, N[:OWN, OWN:], 0.4)
    made = BesideImages(own, 7, AT, REST, CHOSEN, N[OWN:, OWN:], SIZES)
    joint = np.empty((OWN + 3,) * 2)
    joint[np.ix_(AT, AT)] = D.toarray()
    joint[np.ix_(AT, REST)] = N[:OWN, OWN + CHOSEN]
    joint[np.ix_(REST, AT)] = joint[np.ix_(AT, REST)].T
    joint[np.ix_(REST, REST)] = N[np.ix_(OWN + CHOSEN, OWN + CHOSEN)]
    kappa = np.empty(OWN + 3)
    kappa[AT], kappa[REST] = 0.4, SIZES
    across = np.empty((OWN + 3, CORE))
    across[AT], across[REST] = N[:OWN, OWN:], N[OWN + CHOSEN, OWN:]
    return made, joint, kappa, across


def test_it_solves_and_measures_as_one_matrix_does(case):
    made, joint, kappa, across = case
    whole = Together(joint, kappa)
    right = np.random.default_rng(1).standard_normal((OWN + 3, 4))
    assert made.solve(right) == pytest.approx(whole.solve(right), rel=1e-9, abs=1e-12)
    assert made.logdet == pytest.approx(whole.logdet, rel=1e-12)
    assert made.taken(across) == pytest.approx(whole.taken(across), rel=1e-9, abs=1e-9)


def test_parameters_that_others_share_follow_with_the_images_behind_them(case):
    made, joint, kappa, _ = case
    right = np.random.default_rng(2).standard_normal((3, 2))
    padded = np.zeros((OWN + 3, 2))
    padded[REST] = right
    assert made.solve_others(right) == pytest.approx(Together(joint, kappa).solve(padded)[REST])
    mean = np.zeros(OWN + 3)
    mean[REST] = 1.0, -2.0, 0.5
    assert made.times(mean) == pytest.approx(joint @ mean)


def test_the_covariance_of_what_is_shared_is_whole_and_of_images_its_diagonal(case):
    made, joint, kappa, _ = case
    right = np.random.default_rng(3).standard_normal(OWN + 3)
    inverse = np.linalg.inv(joint + np.diag(kappa**-2.0))
    found, covariance = made.determined(right, np.linalg.inv)
    assert found == pytest.approx(inverse @ right)
    assert covariance.diagonal() == pytest.approx(np.diag(inverse))
    assert covariance[REST][:, REST].toarray() == pytest.approx(inverse[np.ix_(REST, REST)])
