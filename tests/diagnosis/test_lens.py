"""The lens as a nuisance with a size."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import find
from corridor.core.simulation import add_noise
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.lens import Lens, lens_group, lens_of
from corridor.diagnosis.system.elimination import Elimination, Reduced, rows_of
from corridor.diagnosis.system.equations import equations
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
    return Reduced(N[np.ix_(core, core)], t[core], groups())


def test_what_is_left_is_what_the_equations_with_a_prior_leave():
    """Schur complement of the lens with its prior, as a row of the elimination."""
    block = corridor_block(images=12, strips=2, observations_per_image=60, control=4, seed=3)
    block = add_noise(block, tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.005, seed=3)
    effects = [find(s) for s in ("image_deformation", "rolling_shutter", "row_polynomial")]
    e = equations(corridor.adjust(block), effects, {})
    plain = Elimination(e, None)
    lens = Lens(lens_group(e), 0.3)
    at = lens.group.columns
    N, t = plain.core
    inverse = np.linalg.inv(N[np.ix_(at, at)] + np.eye(len(at)) / 0.3**2)
    M, g = Elimination(e, None, lens.rows).core
    others = np.setdiff1d(np.arange(len(g)), at)
    assert M[np.ix_(others, others)] == pytest.approx(
        (N - N[:, at] @ inverse @ N[at])[np.ix_(others, others)], rel=1e-6
    )
    assert g[others] == pytest.approx((t - N[:, at] @ inverse @ t[at])[others], rel=1e-6)
    single = next(group for group in e.groups if group.own is not None)
    beside = plain.reduced().beside(rows_of([(lens.group, 0.3), (single, 0.5)]))
    other_way = Elimination(e, None, rows_of([(single, 0.5)])).reduced()
    inside = other_way.M[np.ix_(at, at)] + np.eye(len(at)) / 0.3**2
    left = other_way.M - other_way.M[:, at] @ np.linalg.solve(inside, other_way.M[at])
    assert beside.M[np.ix_(others, others)] == pytest.approx(left[np.ix_(others, others)], rel=1e-6)


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
