"""Angles of rays and correlations within points, and precision in a datum of one's choice."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from strips import corridor_block
from test_distances import flown

import corridor
from corridor.core.adjustment import LinearSystem, point_regression, without_depth
from corridor.core.adjustment.linear_system import motions
from corridor.core.errors import InputError
from corridor.core.geometry import helmert_motions


@pytest.fixture(scope="module")
def adjusted():
    block = corridor_block(
        images=8, strips=2, observations_per_image=25, control=3, check=2, seed=1
    )
    return corridor.adjust(block, camera="fixed")


def whole(adjusted):
    """Covariance (3 n, 3 n) of all points together, for unit weight."""
    count = len(adjusted.points)
    regression = point_regression(adjusted.system, np.arange(count))
    k = regression.gain.toarray()
    out = k.T @ adjusted.covariance.solve(k)
    for n, own in enumerate(regression.own):
        out[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] += own
    return out


def test_angles_are_those_between_every_two_rays(adjusted):
    p, state = adjusted.problem, adjusted.state
    table = adjusted.point_quality
    for n in range(0, len(table), 7):
        rays = state.points[n] - state.centre[p.img[p.ptr[n] : p.ptr[n + 1]]]
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        angles = [np.degrees(np.arccos(min(abs(a @ b), 1.0))) for a in rays for b in rays]
        assert table["angle"].iloc[n] == pytest.approx(max(angles), abs=1e-5)


def test_points_of_parallel_rays_have_no_depth(adjusted):
    p, state = adjusted.problem, adjusted.state
    assert not without_depth(adjusted.system, 1.0)
    ties = np.flatnonzero(~p.point_kinds)
    points = state.points.copy()
    for n in ties[:3]:
        points[n] += 1e6 * (points[n] - state.centre[p.img[p.ptr[n]]])
    there = LinearSystem(p, replace(state, points=points))
    assert without_depth(there, 1.0) == set(p.point_names[ties[:3]])
    # Where so many are, the block is of another kind.
    points[ties] += 1e6 * (points[ties] - state.centre[0])
    assert not without_depth(LinearSystem(p, replace(state, points=points)), 1.0)


def test_correlations_are_those_of_the_covariance_of_the_point(adjusted):
    full = whole(adjusted)
    for n in (0, 11, 30):
        part = full[3 * n : 3 * n + 3, 3 * n : 3 * n + 3]
        size = np.sqrt(np.diag(part))
        found = np.abs(part / size[:, None] / size)[np.triu_indices(3, 1)].max()
        assert adjusted.point_quality["correlation"].iloc[n] == pytest.approx(found, abs=1e-8)


@pytest.mark.parametrize("scale", [True, False])
def test_precision_without_the_datum_is_that_of_the_whole_covariance_transformed(adjusted, scale):
    """S C S' with all points at once, by a dense matrix."""
    c = whole(adjusted)
    xyz = adjusted.state.points
    g = helmert_motions(xyz).reshape(-1, 7)[:, : 7 if scale else 6]
    table = adjusted.relative_precision(scale=scale)
    assert len(table) == len(xyz)
    s = np.eye(len(c)) - g @ np.linalg.pinv(g)
    expected = adjusted.sigma0 * np.sqrt(np.diag(s @ c @ s.T)).reshape(-1, 3)
    assert table[["sx", "sy", "sz"]].to_numpy() == pytest.approx(expected, rel=1e-6, abs=1e-9)


def everything(adjusted):
    """Covariance of poses, what images share and points, and G of all of it, dense."""
    p, state = adjusted.problem, adjusted.state
    n, count = p.image_count * p.d + p.shared_count, len(state.points)
    regression = point_regression(adjusted.system, np.arange(count))
    c = adjusted.covariance.solve(np.eye(n))
    k = regression.gain.toarray()
    own = block_diag(*regression.own)
    whole = np.block([[c, -c @ k], [-(k.T @ c), k.T @ c @ k + own]])
    middle = state.points.mean(axis=0)
    shared = np.zeros((p.shared_count, 7))
    moved = [motions(state, p.d, middle), shared, helmert_motions(state.points, middle)]
    return whole, np.concatenate([part.reshape(-1, 7) for part in moved])


@pytest.mark.parametrize("scale", [True, False])
@pytest.mark.parametrize("on", ["points", "a base"])
def test_poses_and_points_in_a_datum_are_those_of_the_whole_covariance(adjusted, on, scale):
    """S C S' of everything at once; the first photograph and its base have no error left."""
    p, state = adjusted.problem, adjusted.state
    c, g = everything(adjusted)
    g = g[:, : 7 if scale else 6]
    d, n = p.d, p.image_count * p.d + p.shared_count
    b = np.zeros(g.shape)
    names = list(map(str, p.images.names))
    if on == "points":
        b[n:] = g[n:]
        asked = None
    else:
        asked = (names[2], names[7])
        b[2 * d + np.arange(6), np.arange(6)] = 1.0
        if scale:
            base = state.centre[7] - state.centre[2]
            b[7 * d + np.arange(3), 6], b[2 * d + np.arange(3), 6] = base, -base
    s = np.eye(len(c)) - g @ np.linalg.inv(b.T @ g) @ b.T
    size = np.sqrt(np.diag(c))
    c = s @ c @ s.T
    found = adjusted.in_datum(asked, scale)
    poses = c[: p.image_count * d, : p.image_count * d].reshape(p.image_count, d, -1, d)
    for k in range(p.image_count):
        own = size[k * d : k * d + d]
        away = found.poses[k] - poses[k, :, k]
        assert np.abs(away / own[:, None] / own).max() < 1e-5
        with_shared = c[k * d : k * d + d, p.image_count * d : n]
        away = found.poses_shared[k] - with_shared
        assert np.abs(away / own[:, None] / size[p.image_count * d : n]).max() < 1e-5
    left = np.sqrt(np.diag(c)[n:])
    assert np.sqrt(found.point_variances).ravel() == pytest.approx(left, rel=1e-5, abs=1e-8)
    table = adjusted.relative_poses(asked, scale).set_index("image")
    if on == "a base":
        assert table.loc[names[2], ["sx", "sy", "sz", "s_rx", "s_ry", "s_rz"]].max() < 1e-7


def test_the_datum_of_a_free_network_does_not_depend_on_where_it_was_laid():
    """The same points carry it whether the network came with control, or free."""
    tied = corridor.adjust(flown(free=False, noise=False), camera="fixed", lever_arm="fixed")
    names = [f"{name}" for name in tied.points["point"].iloc[::40]]
    one = tied.relative_precision(names)
    assert set(names) <= set(one["point"])
    carried = one[one["point"].isin(names)][["sx", "sy", "sz"]].to_numpy()
    assert np.median(carried) < np.median(one[["sx", "sy", "sz"]].to_numpy())


def test_points_on_a_line_and_unknown_names_are_refused(adjusted):
    with pytest.raises(InputError, match="cannot carry a datum"):
        adjusted.relative_precision(adjusted.points["point"].iloc[:1])
    with pytest.raises(InputError, match="no adjusted point"):
        adjusted.relative_precision(["nobody"])
