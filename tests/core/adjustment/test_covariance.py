"""Covariances against a dense inverse, and against the spread of many noisy draws."""

from dataclasses import replace

import numpy as np
import pytest
from dense_jacobian import jacobian
from strips import corridor_block

import corridor
from corridor.core.adjustment import Covariance, LinearSystem, make_problem
from corridor.core.adjustment.datum import free_network
from corridor.core.adjustment.normal import shared_values
from corridor.core.simulation import add_noise, read_plan

# --- the dense inverse -----------------------------------------------------------------------


def dense(state, problem, free=False):
    """Covariance of everything; of a free network in the datum laid on the start poses."""
    j = jacobian(state, problem)
    scale = np.linalg.norm(j, axis=0)
    j = j / scale
    if not free:
        # No normal equations here: they would square the condition.
        half = np.linalg.inv(np.linalg.qr(j, mode="r"))
        return half @ half.T / scale[:, None] / scale
    normal = j.T @ j
    m, d = problem.image_count, problem.d
    null = np.linalg.svd(j)[2][-7:].T / scale[:, None]
    middle = np.median(state.points, axis=0)
    weight = np.zeros(len(scale))
    pose = weight[: m * d].reshape(m, d)
    pose[:, :3] = 1.0
    pose[:, 3:6] = np.median(np.linalg.norm(state.centre - middle, axis=1)) ** 2
    # Unknowns that make G' W x = 0 smallest in the weighted poses: a bordered inverse.
    border = (weight[:, None] * null) / scale[:, None]
    border /= np.linalg.norm(border, axis=0)
    whole = np.block([[normal, border], [border.T, np.zeros((7, 7))]])
    return np.linalg.inv(whole)[: len(scale), : len(scale)] / scale[:, None] / scale


def small_block(**options):
    options = {"images": 8, "strips": 2, "observations_per_image": 25, "seed": 1} | options
    return corridor_block(**{"control": 3, "check": 2} | options)


# A turn during the readout is hard to tell from attitude and principal point over flat ground,
# and the normal equations square that condition.
HILLY = dict(images=10, observations_per_image=80, relief=10.0)
CASES = {
    "GNSS and control": dict(effects=[]),
    "free lever arms, two flights": dict(effects=[], flights=2, height=(50.0, 65.0)),
    "an effect of the block": dict(effects=["rolling_shutter"]),
    "an effect of the cameras": dict(effects=["focal_drift", "gnss_bias"], lever_arm="fixed"),
    "an effect of each image": dict(effects=["rolling_shutter_rotation"], **HILLY),
    "effects of both kinds": dict(
        effects=["rolling_shutter_rotation", "gnss_bias"], lever_arm="fixed", **HILLY
    ),
    "a prior": dict(effects=["clock_offset"], priors={"clock_offset.offset": (0.0, 0.01)}),
    "ten camera parameters": dict(effects=[], camera="fraser10"),
    "camera fixed": dict(effects=[], camera="fixed", lever_arm="fixed"),
    "free network": dict(effects=[], gnss=False, control=0, check=0, free=True),
    "free network with an effect": dict(
        effects=["rolling_shutter"], gnss=False, control=0, check=0, free=True
    ),
}


# What the others say in another way: each dense inverse takes a second.
LONG = {
    "GNSS and control", "an effect of the cameras", "effects of both kinds", "a prior",
    "free network with an effect",
}  # fmt: skip
EACH = [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in CASES]


@pytest.fixture(scope="module", params=EACH)
def case(request):
    """Problem, state, dense covariance; whether the network is free."""
    options = dict(CASES[request.param])
    arguments = {
        key: options.pop(key) for key in ("effects", "camera", "priors", "lever_arm")
        if key in options
    }  # fmt: skip
    free = options.pop("free", False)
    # At a perfect block every effect is zero, where its derivative by the row vanishes: that one
    # the kernels leave out (the shift is a contraction), the forward model does not.
    problem = make_problem(small_block(**options), **arguments)
    return problem, problem.start, dense(problem.start, problem, free), free


@pytest.fixture(scope="module", params=["band", pytest.param("sparse", marks=pytest.mark.slow)])
def covariance(request, case):
    problem, state, _, free = case
    system = LinearSystem(problem, state, storage=request.param)
    if not free:
        return Covariance(system)
    datum = free_network(system)
    return Covariance(replace(system, held=datum.held), datum.null_space)


def agree(case, ours, theirs, sigma_rows, sigma_columns=None):
    """Within 1e-8 of the product of the standard deviations: correlations to eight digits.

    Normal equations lose what their condition takes from 2e-16: with three unknowns an image that
    nearly are its attitude it is 8e8 (1e6 else), and band and sparse storage differ by 1e-8.
    """
    tolerance = 1e-8 if case[0].d == 6 else 5e-8
    sigma_columns = sigma_rows if sigma_columns is None else sigma_columns
    away = np.abs(ours - theirs) / (sigma_rows[:, None] * sigma_columns)
    assert away.max(initial=0.0) < tolerance


def test_some_points_are_those_of_all():
    """Check points are few: their sigmas do not wait for those of all others."""
    problem = make_problem(small_block(), effects=[])
    system = LinearSystem(problem, problem.start, storage="band")
    some = Covariance(system).points(np.array([5, 2]))
    assert some == pytest.approx(Covariance(system).each_point[[5, 2]], rel=1e-12)


def test_what_is_asked_twice_in_whatever_order_is_the_same():
    """Entries of all images take the factor's place, which is made anew for what needs it."""
    problem = make_problem(small_block(), effects=[])
    system = LinearSystem(problem, problem.start, storage="band")
    first, other = Covariance(system), Covariance(system)
    variances = first.point_variances
    assert variances == pytest.approx(first.each_point[:, [0, 2, 5]], rel=1e-12)
    assert other.poses_shared == pytest.approx(first.poses_shared, rel=1e-9, abs=1e-15)
    d = problem.d
    for covariance in (first, other):
        assert covariance.poses([3]) == pytest.approx(covariance.each_pose[3], rel=1e-9, abs=1e-15)
        unit = np.zeros((len(system.columns), 1))
        unit[3 * d] = 1.0
        assert covariance.solve(unit)[3 * d] == pytest.approx(covariance.each_pose[3, 0, 0])
    # After all points those of marks are made anew, as reliability asks for them.
    before = Covariance(system).of_marked
    assert len(before) > 0
    for point, found in first.of_marked.items():
        assert found == pytest.approx(before[point], rel=1e-9, abs=1e-15)


class TestAgainstADenseInverse:
    """Numerical differences leave 1e-11 of the Jacobian; what is nearly undetermined takes some
    of that: 1e-8 of the standard deviations is the tolerance."""

    def parts(self, case):
        problem, _, full, _ = case
        n = problem.image_count * problem.d
        poses = slice(0, n)
        shared = slice(n, n + problem.shared_count)
        points = slice(n + problem.shared_count, None)
        return full, np.sqrt(np.diag(full)), poses, shared, points

    def test_shared_unknowns(self, case, covariance):
        full, sigma, _, shared, _ = self.parts(case)
        agree(case, covariance.shared, full[shared, shared], sigma[shared])

    def test_every_pose(self, case, covariance):
        full, sigma, poses, *_ = self.parts(case)
        d = case[0].d
        for k, ours in enumerate(covariance.each_pose):
            at = slice(k * d, (k + 1) * d)
            agree(case, ours, full[at, at], sigma[at])

    def test_all_poses_together(self, case, covariance):
        full, sigma, poses, *_ = self.parts(case)
        agree(
            case, covariance.poses(np.arange(case[0].image_count)), full[poses, poses], sigma[poses]
        )

    def test_poses_with_shared_unknowns(self, case, covariance):
        full, sigma, poses, shared, _ = self.parts(case)
        agree(case, covariance.poses_shared, full[poses, shared], sigma[poses], sigma[shared])

    def test_every_point(self, case, covariance):
        full, sigma, _, _, points = self.parts(case)
        blocks = full[points, points]
        for p, ours in enumerate(covariance.each_point):
            at = slice(3 * p, 3 * p + 3)
            xx, yx, yy, zx, zy, zz = ours
            whole = np.array([[xx, yx, zx], [yx, yy, zy], [zx, zy, zz]])
            agree(case, whole, blocks[at, at], sigma[points][at])

    def test_points_with_shared_unknowns(self, case, covariance):
        full, sigma, _, shared, points = self.parts(case)
        q = case[0].shared_count
        ours = covariance.between(slice(None), range(q)).reshape(3 * len(case[1].points), q)
        agree(case, ours, full[points, shared], sigma[points], sigma[shared])

    def test_sums_of_poses_and_shared_unknowns(self, case, covariance):
        full, sigma, _, shared, _ = self.parts(case)
        n, q = case[0].image_count * case[0].d, case[0].shared_count
        sigma = sigma[: n + q]
        # Each sum takes every unknown in units of its own standard deviation.
        factors = np.random.default_rng(5).standard_normal((n + q, 3)) / sigma[:, None]
        ours = covariance.solve(factors)
        theirs = full[: n + q, : n + q] @ factors
        # A sum of n + q terms that agree to 1e-8 each.
        assert np.abs(ours - theirs).max(axis=1) / sigma == pytest.approx(
            np.zeros(n + q), abs=5e-8 * (n + q)
        )


def test_information_from_elsewhere_counts_like_a_prior():
    """A prior is a measurement of one unknown; a matrix of them of several together."""
    priors = {"camera.camlight.f": (0.0, 0.7), "lever_arm.F1.z": (0.0, 0.02)}
    block = small_block()
    asked = make_problem(block, priors=priors)
    with_prior = Covariance(LinearSystem(asked, asked.start))
    plain = make_problem(block)
    information = np.zeros((plain.shared_count, plain.shared_count))
    for n, unknown in enumerate(plain.unknowns):
        if unknown.label in priors:
            information[n, n] = priors[unknown.label][1] ** -2
    assert np.count_nonzero(information) == 2
    given = Covariance(LinearSystem(plain, plain.start, information=information))
    assert given.shared == pytest.approx(with_prior.shared, rel=1e-9)
    assert given.each_pose == pytest.approx(with_prior.each_pose, rel=1e-6, abs=1e-12)


def test_the_datum_of_a_free_network_does_not_matter_to_what_has_none():
    """Camera parameters are the same whichever seven unknowns are held (Baarda 1973)."""
    problem = make_problem(small_block(gnss=False, control=0, check=0))
    system = LinearSystem(problem, problem.start)
    datum = free_network(system)
    system = replace(system, held=datum.held)
    laid = Covariance(system, datum.null_space)
    shared = laid.shared
    held = np.sqrt(np.einsum("nii->ni", laid.each_pose))
    plain = Covariance(system)  # the datum of the held unknowns
    assert plain.shared == pytest.approx(shared, rel=1e-6)
    assert not np.allclose(np.sqrt(np.abs(np.einsum("nii->ni", plain.each_pose))), held, rtol=0.1)


# --- the spread of draws ---------------------------------------------------------------------

DRAWS = 200
NOISE = dict(tie_px=0.5, mark_px=0.3, gnss_m=(0.02, 0.02, 0.03), control_m=0.01)


def errors_in_sigmas(truth, adjusted):
    """Adjusted minus true over the predicted standard deviation for unit weight, by kind."""
    covariance, state, p = adjusted.covariance, adjusted.state, adjusted.problem
    start = p.start  # the draws change measurements only: start values are the truth
    sigma = np.sqrt(np.diag(covariance.shared))
    shared = (shared_values(p, state) - shared_values(p, start)) / sigma
    kinds = np.array([unknown.kind for unknown in p.unknowns])
    poses = np.sqrt(np.einsum("nii->ni", covariance.each_pose))
    turn = np.einsum("nij,nkj->nik", state.rotation, start.rotation)
    angles = 0.5 * np.stack(
        [turn[:, k - 1, k - 2] - turn[:, k - 2, k - 1] for k in range(3)], axis=1
    )
    marks = p.point_kinds
    true = start.points.copy()
    ground = truth.ground.set_index("point")[["x", "y", "z"]]
    true[marks] = ground.loc[list(p.point_names[marks])].to_numpy()
    points = (state.points - true) / np.sqrt(covariance.each_point[:, [0, 2, 5]])
    return {
        "camera": shared[kinds == "camera"],
        "lever arms": shared[kinds == "lever_arm"],
        "effect": shared[kinds == "effect"],
        "centres": (state.centre - start.centre) / poses[:, :3],
        "rotations": angles / poses[:, 3:6],
        "tie points": points[~marks],
        "ground points": points[marks],
        "sigma naught": np.array([adjusted.sigma0]),
    }


@pytest.fixture(scope="module")
def spread():
    """Errors (draws, quantities) by kind."""
    # Two heights determine f, so that the model is linear over the noise.
    truth = corridor_block(
        images=12, strips=2, height=(50.0, 65.0), flights=2, observations_per_image=40, control=4,
        check=3, seed=7,
    )  # fmt: skip
    draws = []
    for draw in range(DRAWS):
        noisy = add_noise(truth, **NOISE, seed=1000 + draw)
        adjusted = corridor.adjust(noisy, effects=["rolling_shutter"])
        draws.append(errors_in_sigmas(truth, adjusted))
    return {kind: np.array([np.ravel(draw[kind]) for draw in draws]) for kind in draws[0]}


@pytest.mark.slow
class TestAgainstTheSpreadOfDraws:
    """200 adjustments of the same block with other noise.

    Errors over their predicted standard deviations have the spread 1. The spread of 200 numbers
    is known to 5 %, of several that are not the same to better: 10 % is two to many sigmas.
    """

    @pytest.mark.parametrize(
        "name",
        ["camera", "lever arms", "effect", "centres", "rotations", "tie points", "ground points"],
    )
    def test_errors_are_as_large_as_predicted(self, spread, name):
        z = spread[name]
        assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.10)
        # Every single quantity: 200 draws know its spread to 5 %, one in many may be off by four.
        assert np.abs(z.std(axis=0) - 1.0).max() < 0.22

    @pytest.mark.parametrize("name", ["camera", "centres", "tie points"])
    def test_errors_have_no_mean(self, spread, name):
        """Of 200 draws the mean is known to 0.07."""
        assert np.abs(spread[name].mean(axis=0)).max() < 4.5 / np.sqrt(DRAWS)

    def test_sigma_naught_is_one(self, spread):
        """Its mean over 200 draws: 1 within 1 / sqrt(2 r 200) or 0.0025 here, four of them."""
        assert spread["sigma naught"].mean() == pytest.approx(1.0, abs=0.01)


def test_sigmas_of_a_chain_that_is_hardly_held_are_those_of_single_solutions():
    """Motions of single images: what rounding makes uneven would grow along the strip to 1e-3."""
    plan = read_plan("thesis_viabon_n40")
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=50))
    block = corridor.simulate(plan, seed=0).copy()
    spare = ["vx", "vy", "vz", "wx", "wy", "wz"]
    block.images = block.images.drop(columns=[c for c in spare if c in block.images])
    found = corridor.adjust(block, camera="fraser8", effects=["motion_per_image"])
    some = np.arange(0, len(block.images), 7)
    alone = np.array([np.diag(found.covariance.poses([image])) for image in some])
    among = np.array([np.diag(one) for one in found.covariance.each_pose[some]])
    assert among == pytest.approx(alone, rel=1e-7)


def test_the_sigma_of_a_check_point_is_that_of_the_difference():
    """That of the adjusted point and 30 mm of the survey, as a right angle adds them."""
    block = small_block()
    block.ground[["sx", "sy", "sz"]] = 0.03
    adjusted = corridor.adjust(add_noise(block, tie_px=0.5, seed=1))
    check = adjusted.check_points.set_index("point")
    points = adjusted.points["point"].isin(check.index).to_numpy()
    names = adjusted.points["point"][points]
    own = adjusted.point_sigma[points]
    assert np.allclose(check.loc[names, ["sx", "sy", "sz"]], own, rtol=1e-9)
    assert np.allclose(check.loc[names, ["s_dx", "s_dy", "s_dz"]], np.hypot(own, 0.03), rtol=1e-9)
