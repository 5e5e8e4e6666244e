"""The reduced system against plain dense algebra on numerical derivatives of the forward model."""

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve
from strips import CAMLIGHT, corridor_block

from corridor.core.adjustment import Model
from corridor.core.effects import candidates, predict
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.core.simulation import add_noise
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.noise.gnss import GnssNoise, stated_noise
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.system.elimination import Elimination, rows_of
from corridor.diagnosis.system.equations import Columns, Equations, equations

SLUGS = [
    "rolling_shutter", "thermal", "focal", "affine_distortion", "radial_distortion",
    "sensor_unflatness", "lever_arm", "clock_offset", "gnss_drift", "gnss_spline",
    "control_blunder", "control_datum", "row_polynomial", "time_rounding", "focal_per_image",
    "rolling_shutter_rotation",
]  # fmt: skip


@pytest.fixture(scope="module")
def tiny():
    """Block, equations and the adjusted block of 8 images."""
    camera = replace(CAMLIGHT, calibrated=True)
    block = corridor_block(
        images=8, strips=2, camera=camera, observations_per_image=40, control=4, check=0,
        relief=5.0, seed=3, angular_rate_deg_s=3.0,
    )  # fmt: skip
    block = add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.02, control_m=0.005, seed=4)
    block.lever_arm_fixed = True
    block.images["temperature_c"] = np.linspace(20, 31, len(block.images))
    believed = ReferenceModel.of(block, Model(camera="fixed"))
    adjustment = believed.adjust()
    system = adjustment.system
    chosen = candidates(block, system.free, [], system.control_names, SLUGS)
    assert [effect.slug for effect in chosen.effects] == sorted(SLUGS)
    e = equations(adjustment, chosen.effects, {})
    adjusted = adjustment.block
    at = adjusted.points.set_index("point")
    names = adjusted.ground["point"]
    adjusted.ground[["x", "y", "z"]] = at.loc[names, ["x", "y", "z"]].to_numpy()
    return block, e, adjusted


def observed(block, values=None):
    """Ties, marks, antennas and control as one vector."""
    made = predict(block, values or {})
    return np.concatenate([part.ravel() for part in (made.tie, made.mark, made.gnss, made.control)])


@pytest.fixture(scope="module")
def derivatives(tiny):
    """By poses and points, by all groups, and the groups' keys, by numerical differences."""
    block, e, adjusted = tiny
    m = len(block.images)
    ties, marks = len(block.tie_points), len(block.marks)
    rows = observed(adjusted).size
    image = np.concatenate([block.image_rows("tie_points"), block.image_rows("marks")])
    of_gnss = block.image_rows("gnss")
    owner = np.concatenate([np.repeat(image, 2), np.repeat(of_gnss, 3)])
    A = []
    for k, h in enumerate([1e-4] * 3 + [1e-6] * 3):
        moved = [_posed(adjusted, k, sign * h) for sign in (1, -1)]
        change = (observed(moved[0]) - observed(moved[1])) / (2 * h)
        for i in range(m):
            column = np.zeros(rows)
            mine = np.flatnonzero(owner == i)
            column[mine] = change[mine]
            A.append(column)
    point = np.concatenate(
        [block.tie_points["point"].astype(str), block.marks["point"].astype(str)]
    )
    for axis in "xyz":
        moved = []
        for sign in (1, -1):
            other = adjusted.copy()
            other.points[axis] += sign * 1e-4
            other.ground[axis] += sign * 1e-4
            moved.append(observed(other))
        change = (moved[0] - moved[1]) / 2e-4
        given = adjusted.ground["point"].astype(str).to_numpy()
        for name in np.unique(point):
            column = np.zeros(rows)
            mine = np.repeat(point == name, 2)
            column[: 2 * (ties + marks)][mine] = change[: 2 * (ties + marks)][mine]
            for n in np.flatnonzero(given == name):
                column[2 * (ties + marks) + 3 * len(of_gnss) + 3 * n + "xyz".index(axis)] = 1.0
            A.append(column)
    A = np.array(A).T

    names = list(block.images["image"])
    B, keys = [], []
    for group in e.groups:
        for scale, (owner_name, parameter, _) in zip(group.scale, group.labels, strict=True):
            h = 1e-3 * scale
            single = owner_name in names or group.effect.group == "point"
            value = {owner_name: h} if single else h
            back = {owner_name: -h} if single else -h
            there = observed(adjusted, {group.slug: {parameter: value}})
            here = observed(adjusted, {group.slug: {parameter: back}})
            B.append((there - here) / 2e-3)
        keys += [group.key] * len(group)
    return A, np.array(B).T, np.array(keys)


def dense(tiny, derivatives, covariance):
    """M and g of all groups; covariance (3k, 3k) of the antennas."""
    block, e, adjusted = tiny
    A, B, keys = derivatives
    system, rows = e.system, len(A)
    ties, marks = len(block.tie_points), len(block.marks)
    sigma = np.empty(ties + marks)
    pixels = np.empty((ties + marks, 2))
    row = system.image_rows.row
    sigma[row], pixels[row] = e.scales.of_observation, e.pixels
    W = np.zeros((rows, rows))
    n = 2 * (ties + marks)
    W[:n, :n] = np.diag(np.repeat(sigma**-2.0, 2))
    order = np.argsort(
        system.image_order[e.image]
    )  # antennas of the problem in the order of gnss.csv
    index = (3 * order[:, None] + np.arange(3)).ravel()
    k = len(index)
    W[n : n + k, n : n + k] = np.linalg.inv(covariance[np.ix_(index, index)])
    W[n + k :, n + k :] = np.diag(block.ground_sigma().ravel() ** -2.0)
    r = np.concatenate(
        [
            pixels.ravel(),
            (block.gnss[["x", "y", "z"]].to_numpy()).ravel() - observed(adjusted)[n : n + k],
            (block.ground[["x", "y", "z"]] - adjusted.ground[["x", "y", "z"]]).to_numpy().ravel(),
        ]
    )
    unit = 1.0 / np.sqrt(np.einsum("ij,ij->j", A, W @ A))
    A = A * unit
    solve = np.linalg.solve(A.T @ W @ A, A.T @ W @ np.column_stack([B, r]))
    QB, Qr = B - A @ solve[:, :-1], r - A @ solve[:, -1]
    return B.T @ W @ QB, B.T @ W @ Qr, keys


def _posed(block, k, h):
    out = block.copy()
    if k < 3:
        out.images["xyz"[k]] += h
        return out
    columns = ["qw", "qx", "qy", "qz"]
    R = rotation_from_quaternion(block.images[columns].to_numpy())
    out.images[columns] = quaternion_from_rotation(rotation_from_vector(h * np.eye(3)[k - 3]) @ R)
    return out


@pytest.mark.parametrize("coloured", [False, True], ids=["white", "coloured"])
def test_the_reduced_system_is_that_of_dense_algebra(tiny, derivatives, coloured):
    """B'WQB and B'WQr with poses and points eliminated by one dense solution."""
    e = tiny[1]
    noise = None
    covariance = np.diag(e.stated**2)
    if coloured:
        plain = stated_noise(e.system)
        flights = len(plain.tau)
        noise = GnssNoise(
            plain.flight, plain.time, plain.stated, np.full((flights, 3), 0.6),
            np.full((flights, 3), 0.015), np.full((flights, 3), 20.0),
        )  # fmt: skip
        covariance = np.zeros((len(e.stated),) * 2)
        for rows, f, axis in noise.blocks():
            white, slow = noise.parts(rows, f, axis)
            covariance[np.ix_(rows, rows)] = white + slow
    made = Elimination(e, noise)
    expected, right, keys = dense(tiny, derivatives, covariance)
    size = np.sqrt(np.abs(np.diag(expected)))
    scale = np.maximum(size[:, None] * size, 1e-6)
    at = {group.key: np.flatnonzero(keys == group.key) for group in e.groups}
    order = np.argsort(np.concatenate([g.columns for g in e.groups if g.own is None]))
    core = np.concatenate([at[g.key] for g in e.groups if g.own is None])[order]
    M, g = made.core
    for group in (group for group in e.groups if group.own is None):
        mine, rows = at[group.key], group.columns
        assert (
            np.abs((M[rows] - expected[np.ix_(mine, core)]) / scale[np.ix_(mine, core)]).max()
            < 2e-3
        )
        assert np.abs((g[rows] - right[mine]) / np.maximum(size[mine], 1e-3)).max() < 2e-2
    for group in (group for group in e.groups if group.own is not None):
        mine = at[group.key]
        M, _ = made.spread(group, np.eye(len(group)))
        assert np.abs((M - expected[np.ix_(mine, mine)]) / scale[np.ix_(mine, mine)]).max() < 2e-3
        # Beside values for each image the core meets what they leave of it.
        left = made.reduced().beside(rows_of([(group, 0.7)]))
        inside = expected[np.ix_(mine, mine)] + np.eye(len(mine)) / 0.7**2
        solved = np.linalg.solve(inside, np.column_stack([expected[mine], right[mine]]))
        M = (expected - expected[:, mine] @ solved[:, :-1])[np.ix_(core, core)]
        g = (right - expected[:, mine] @ solved[:, -1])[core]
        assert np.abs((left.M - M) / scale[np.ix_(core, core)]).max() < 2e-3, group.key
        assert np.abs((left.g - g) / np.maximum(size[core], 1e-3)).max() < 2e-2, group.key
        assert left.fit - made.fit == pytest.approx(0.5 * right[mine] @ solved[:, -1], abs=2e-2)
        cost = 0.5 * np.linalg.slogdet(inside * 0.7**2)[1]
        assert left.cost - made.cost == pytest.approx(cost, rel=2e-3, abs=1e-3)


def test_the_reduced_matrix_has_no_negative_direction(tiny):
    """It is a variance."""
    M, _ = Elimination(tiny[1], None).core
    values = np.linalg.eigvalsh(M)
    assert values.min() > -1e-8 * values.max()


@pytest.mark.parametrize("core", [(), ("thermal", "control_datum")])
@pytest.mark.parametrize("own", ["time_rounding", "focal_per_image"])
def test_a_model_explains_the_same_by_its_own_columns_as_by_all(tiny, own, core):
    e = tiny[1]
    chosen = {n: 0.7 for n, group in enumerate(e.groups) if group.effect.slug in (own, *core)}
    assert len(chosen) > len(core)
    alone, all_of_them = (Evidence(Elimination(e, None).reduced()) for _ in range(2))
    left = all_of_them.beside(chosen)
    assert left.M.shape == 2 * all_of_them.reduced.g.shape and not alone._systems
    expected = left.fit, left.cost
    assert alone.explained(chosen) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert not alone._systems
    assert all_of_them.explained(chosen) == expected


def test_the_elimination_grows_with_the_images_and_not_with_their_square():
    """2,000 images of 6 unknowns that meet their neighbour: one matrix of them would be 1.15 GB."""
    images, own = 2000, 6
    n = images * own
    offsets = [0, -1, -own, 1, own]
    values = [np.full(n - abs(k), 4.0 if k == 0 else 0.5) for k in offsets]
    gnss = SimpleNamespace(
        residual=np.zeros((0, 3)), sigma=np.zeros((0, 3)), image=np.zeros(0, dtype=int)
    )
    nothing = np.zeros(0, dtype=int)
    e = Equations(
        SimpleNamespace(gnss=gnss), csc_array(diags_array(values, offsets=offsets)), np.ones(n),
        csr_array((0, n)),
        Columns(np.zeros((n, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)), np.zeros(0)),
        [], [], {}, [], np.repeat(np.arange(images), own), np.arange(n), nothing, [], np.ones(n),
    )  # fmt: skip
    tracemalloc.start()
    made = Elimination(e, None)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.04 * 8 * n * n
    found = made.solve(e.right[:, None])[:, 0]
    assert found == pytest.approx(spsolve(e.matrix, e.right), rel=1e-9)


@pytest.mark.parametrize("turned", [False, True], ids=["to and fro", "always the same way"])
def test_slow_noise_is_that_of_a_dense_covariance(tiny, turned):
    """J' Sigma^-1 J added to the equations: the same solution, whatever the order of time."""
    e = tiny[1]
    plain = stated_noise(e.system)
    time = plain.time[::-1].copy() if not turned else np.roll(plain.time, 3)
    noise = GnssNoise(
        plain.flight, time, plain.stated, np.full((1, 3), 0.6), np.array([[0.02, 0.0, 0.03]]),
        np.array([[20.0, 60.0, 45.0]]),
    )  # fmt: skip
    covariance = np.zeros((len(e.stated),) * 2)
    for rows, f, axis in noise.blocks():
        covariance[np.ix_(rows, rows)] = np.add(*noise.parts(rows, f, axis))
    inverse = np.linalg.inv(covariance)
    assert noise.weigh(np.eye(len(inverse))) == pytest.approx(inverse, rel=1e-9, abs=1e-6)
    assert noise.spread(np.eye(len(inverse))) == pytest.approx(covariance, rel=1e-6)
    J = e.jacobian.toarray()
    right = np.random.default_rng(1).standard_normal((len(e.right), 3))
    expected = np.linalg.solve(e.matrix.toarray() + J.T @ inverse @ J, right)
    found = Elimination(e, noise).solve(right)
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()
