"""The lens as a nuisance with a size."""

import numpy as np
import pytest

from corridor.core.effects import find
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.lens import Lens, lens_of
from corridor.diagnosis.system.elimination import Antennas, Pieces, Reduced
from corridor.diagnosis.system.groups import Group

SHAPE, OTHERS, OWN, ANTENNA = 12, 3, 4, 5


def whole(rng):
    """Normal equations of lens, two candidates, one of single images, and antennas; chi square."""
    A = rng.standard_normal((400, SHAPE + OTHERS + OWN + ANTENNA))
    return A.T @ A, A


def groups():
    def made(key, columns, own=None):
        labels = [("", f"p{k}", "px") for k in range(len(columns))]
        return Group(key, find(key), own, columns, np.ones(len(columns)), labels)

    core = np.arange(SHAPE + OTHERS)
    return [
        made("image_deformation", core[:SHAPE]),
        made("rolling_shutter", core[SHAPE:]),
        made("row_polynomial", np.arange(OWN), 0),
    ]


def reduced(N, t):
    core = np.arange(SHAPE + OTHERS)
    own = len(core) + np.arange(OWN)
    return Reduced(
        N[np.ix_(core, core)], t[core], [Pieces([N[np.ix_(own, own)]])], [t[own]],
        [N[np.ix_(own, core)]], {}, groups(),
    )  # fmt: skip


def test_what_is_left_is_what_the_equations_with_a_prior_leave():
    """Schur complement of the lens with its prior: of core, per-image columns and antennas."""
    rng = np.random.default_rng(1)
    N, A = whole(rng)
    t = A.T @ rng.standard_normal(len(A))
    before = reduced(N, t)
    lens = Lens(before.groups[0], 0.3)
    core, own = np.arange(SHAPE + OTHERS), SHAPE + OTHERS + np.arange(OWN)
    at = own[-1] + 1 + np.arange(ANTENNA)
    shape = core[:SHAPE]
    inverse = np.linalg.inv(N[np.ix_(shape, shape)] + np.eye(SHAPE) / 0.3**2)
    left = N - N[:, shape] @ inverse @ N[shape]
    g = t - N[:, shape] @ inverse @ t[shape]
    after = lens.out_of(before)
    assert after.M == pytest.approx(left[np.ix_(core, core)])
    assert after.g == pytest.approx(g[core])
    assert after.own_matrix[0].toarray() == pytest.approx(left[np.ix_(own, own)])
    assert after.own_g[0] == pytest.approx(g[own])
    assert after.between[0] == pytest.approx(left[np.ix_(own, core)])
    own_columns = N[np.ix_(at, own)]
    antennas = Antennas(
        N[np.ix_(at, at)], t[at], N[np.ix_(at, core)], [lambda some: own_columns[:, some]]
    )
    felt = lens.out_of_antennas(antennas, before)
    assert felt.P.toarray() == pytest.approx(left[np.ix_(at, at)])
    assert felt.rho == pytest.approx(g[at])
    assert felt.core == pytest.approx(left[np.ix_(at, core)])
    assert felt.own[0](slice(None)) == pytest.approx(left[np.ix_(at, own)])


def test_the_data_choose_its_size_and_whether_there_is_any():
    """Of 40 lenses of size 0.3 none is missed; of 40 blocks without one, one in a hundred is."""
    seen = {0.0: [], 0.3: []}
    for seed in range(40):
        rng = np.random.default_rng(seed)
        N, A = whole(rng)
        for size, sizes in seen.items():
            theta = np.zeros(len(N))
            theta[:SHAPE] = size * rng.standard_normal(SHAPE)
            evidence = Evidence(reduced(N, A.T @ (A @ theta + rng.standard_normal(len(A)))))
            found = lens_of(evidence, evidence.groups[0], {})
            sizes.append(found and found.size)
    assert sum(size is not None for size in seen[0.0]) <= 3
    assert None not in seen[0.3]
    assert np.median(seen[0.3]) == pytest.approx(0.3, abs=0.1)


def test_what_explains_as_much_leaves_no_lens():
    """An effect that is the same shape, and in the model, has the better name."""
    rng = np.random.default_rng(2)
    N, A = whole(rng)
    A[:, SHAPE] = A[:, :SHAPE] @ np.ones(SHAPE)
    N = A.T @ A
    theta = np.zeros(len(N))
    theta[SHAPE] = 0.5
    evidence = Evidence(reduced(N, A.T @ (A @ theta + rng.standard_normal(len(A)))))
    group = evidence.groups[0]
    assert lens_of(evidence, group, {}) is not None
    assert lens_of(evidence, group, {evidence.number["rolling_shutter"]: 1.0}) is None
