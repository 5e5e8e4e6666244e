"""The window into the equations: against numerical differences, and against its own promises."""

from dataclasses import replace

import numpy as np
import pytest
from dense_jacobian import jacobian, weighted
from strips import corridor_block

from corridor.core.adjustment import LinearSystem, Loss, Normal, Singular, make_problem, solve
from corridor.core.effects import find
from corridor.core.simulation import add_noise

NOISE = dict(tie_px=0.3, mark_px=0.3, gnss_m=0.02, control_m=0.005, seed=4)
SMALL = dict(images=8, strips=2, observations_per_image=25, control=3, check=2, seed=1)
CASES = {
    "free lever arms, two flights": dict(flights=2, height=(50.0, 65.0)),
    "effects of images, antenna and ground": dict(
        effects=["rolling_shutter", "gnss_bias", "control_datum"],
        lever_arm="fixed",
        priors={"control_datum.x": (0.01, 0.02), "control_datum.y": (0.0, 0.02),
                "control_datum.z": (0.0, 0.02), "camera.camlight.f": (5000.0, 3.0)},
    ),
    "an effect of each image": dict(
        effects=["time_rounding"], priors={"time_rounding.offset": (0.0, 0.2)}, camera="f,k1"
    ),
    "camera fixed, no GNSS": dict(gnss=False, camera="fixed"),
}  # fmt: skip


def made(**options):
    """Problem of a small noisy block."""
    options = SMALL | options
    arguments = {k: options.pop(k) for k in ("effects", "camera", "priors", "lever_arm")
                 if k in options}  # fmt: skip
    return make_problem(add_noise(corridor_block(**options), **NOISE), **arguments)


LONG = "free lever arms, two flights", "an effect of each image"
EACH = [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in CASES]


@pytest.fixture(scope="module", params=EACH)
def case(request):
    """Problem and its dense Jacobian by numerical differences, poses, shared, points."""
    problem = made(**CASES[request.param])
    return problem, jacobian(problem.start, problem)


def measured(problem):
    """Every measurement over its sigma, as `weighted` has the modelled ones."""
    block = problem.block
    used = problem.roles == "control"
    xyz = ["x", "y", "z"]
    return np.concatenate([
        (block.tie_points[["x", "y"]].to_numpy() / block.tie_sigma()[:, None]).ravel(),
        (block.marks[["x", "y"]].to_numpy() / block.mark_sigma()[:, None]).ravel(),
        (block.gnss[xyz].to_numpy() / block.gnss_sigma()).ravel(),
        (block.ground[xyz].to_numpy()[used] / block.ground_sigma()[used]).ravel(),
        problem.prior_value * np.sqrt(problem.prior_weight),
    ])  # fmt: skip


def without_points(problem, j):
    """N and t by dense algebra: everything but the points, which are eliminated."""
    n = problem.image_count * problem.d + problem.shared_count
    residual = measured(problem) - weighted(problem.start, problem)
    a, b = j[:, :n], j[:, n:]
    held = np.linalg.solve(b.T @ b, b.T @ np.column_stack([a, residual]))
    own = np.zeros(n)
    own[: n - problem.shared_count].reshape(-1, problem.d)[:, 6:] = problem.per_image_prior[1]
    return a.T @ (a - b @ held[:, :-1]) + np.diag(own), a.T @ (residual - b @ held[:, -1])


class TestAgainstNumericalDifferences:
    """They leave 1e-11 of the Jacobian, the elimination of points takes some digits more."""

    def test_matrix_and_right_side(self, case):
        problem, j = case
        matrix, right = without_points(problem, j)
        system = LinearSystem(problem, problem.start)
        size = np.sqrt(np.diag(matrix))
        assert np.abs((system.matrix.toarray() - matrix) / size[:, None] / size).max() < 1e-7
        assert np.abs((system.right - right) / size).max() < 1e-6 * np.abs(right / size).max()

    def test_rows_of_the_antenna(self, case):
        problem, j = case
        rows = LinearSystem(problem, problem.start).gnss
        first = 2 * len(problem.img)
        # The forward model has them in the order of gnss.csv, as the problem has.
        theirs = j[first : first + 3 * len(rows.names), : rows.jacobian.shape[1]]
        ours = rows.jacobian.toarray() / rows.sigma.ravel()[:, None]
        assert ours == pytest.approx(theirs, abs=1e-7 * np.abs(theirs).max(initial=1.0))

    def test_rows_of_the_control(self, case):
        problem, j = case
        rows = LinearSystem(problem, problem.start).control
        n, k = problem.image_count * problem.d + problem.shared_count, 3 * len(rows.names)
        first = 2 * len(problem.img) + 3 * len(problem.gnss_image)
        theirs = j[first : first + k, :n]
        ours = rows.jacobian.toarray() / rows.sigma.ravel()[:, None]
        assert ours == pytest.approx(theirs, abs=1e-7 * np.abs(theirs).max(initial=1.0))

    def test_the_gnss_kept_apart_is_what_is_missing(self, case):
        """N with the antenna positions is N without them and J' W J."""
        problem, _ = case
        whole = LinearSystem(problem, problem.start)
        apart = LinearSystem(problem, problem.start, gnss_counts=False)
        j, weight = apart.gnss.jacobian.toarray(), apart.gnss.sigma.ravel() ** -2.0
        together = apart.matrix.toarray() + j.T @ (weight[:, None] * j)
        assert together == pytest.approx(whole.matrix.toarray(), rel=1e-9, abs=1e-3)
        right = apart.right + j.T @ (weight * apart.gnss.residual.ravel())
        assert right == pytest.approx(whole.right, rel=1e-9, abs=1e-6)


class TestNames:
    def test_every_column_has_a_name_of_its_own(self, case):
        columns = LinearSystem(case[0], case[0].start).columns
        assert len(set(columns.labels)) == len(columns) == len(columns.scale)

    def test_columns_are_found_by_name(self):
        problem = made(effects=["rolling_shutter", "time_rounding"], lever_arm="free",
                       priors={"time_rounding.offset": (0.0, 0.2)})  # fmt: skip
        system = LinearSystem(problem, problem.start)
        columns, name = system.columns, problem.images.names[3]
        assert columns.labels[columns.pose[3, 2]] == f"{name}.z"
        (at,) = columns.of("rolling_shutter")
        assert columns.labels[at] == "rolling_shutter.readout"
        at = columns.of_image["time_rounding"][3, 0]
        assert columns.labels[at] == f"{name}.time_rounding.offset"
        assert columns.prior_weight[at] == pytest.approx(0.2**-2)
        # One image's clock moves that image's antenna, and no other.
        moved = np.flatnonzero(np.abs(system.gnss.jacobian[:, [at]].toarray()).sum(axis=1))
        assert set(system.gnss.names[moved // 3]) == {name}


class TestTestedEffects:
    EFFECTS = ("rolling_shutter", "affine_distortion", "control_datum", "focal_per_image")
    ANTENNA = ("gnss_drift", "clock_offset", "time_rounding")

    def test_columns_of_images_and_ground_are_those_of_an_estimation(self):
        """Estimated with a prior, less the prior."""
        wide = {f"{slug}.{p.name}": (0.0, 1e3) for slug in self.EFFECTS
                for p in find(slug).parameters(corridor_block(**SMALL))}  # fmt: skip
        estimated = made(effects=self.EFFECTS, priors=wide)
        tested = LinearSystem(made(), made().start).testing(map(find, self.EFFECTS))
        own = np.zeros_like(estimated.per_image_prior)
        weight = np.zeros_like(estimated.prior_weight)
        plain = replace(estimated, prior_weight=weight, per_image_prior=own)
        ours = LinearSystem(plain, tested.state, gnss_counts=False)
        assert tested.columns.labels == ours.columns.labels
        assert tested.matrix.toarray() == pytest.approx(ours.matrix.toarray(), rel=1e-12)
        assert tested.right == pytest.approx(ours.right, rel=1e-12)
        assert not tested.columns.prior_weight.any()

    def test_rows_of_the_antenna_are_those_of_an_estimation(self):
        estimated = made(effects=self.ANTENNA)
        theirs = LinearSystem(estimated, estimated.start)
        plain = made()
        ours = LinearSystem(plain, plain.start).testing(map(find, self.ANTENNA))
        number = {label: n for n, label in enumerate(ours.columns.labels)}
        at = [number[label] for label in theirs.columns.labels]
        assert sorted(at) == list(range(len(ours.columns)))
        found = ours.gnss.jacobian.toarray()[:, at]
        # The other's derivatives by the pose are numerical where an effect sees it.
        assert found == pytest.approx(theirs.gnss.jacobian.toarray(), abs=1e-6)

    def test_what_an_adjustment_estimated_stands_where_it_left_it(self):
        """Residuals are those of the whole model, and its own effect is the only difference."""
        problem = made(effects=["gnss_bias"])
        state = replace(problem.start, effects={"gnss_bias": np.array([[0.3, 0.0, -0.1]])})
        here = LinearSystem(problem, state)
        tested = here.testing([find("gnss_bias"), find("gnss_drift")])
        assert tested.gnss.residual == pytest.approx(here.gnss.residual, abs=1e-12)
        at = tested.columns.of("gnss_bias")
        assert tested.columns.value[at] == pytest.approx([0.3, 0.0, -0.1])
        assert not tested.columns.value[tested.columns.of("gnss_drift")].any()

    def test_priors_of_all_else_stay(self):
        """Also that of a lever arm, which is an effect by name as well."""
        priors = {"lever_arm.F1.z": (0.35, 0.01), "camera.camlight.f": (5000.0, 3.0)}
        problem = made(priors=priors)
        system = LinearSystem(problem, problem.start).testing([find("lever_arm"), find("focal")])
        weight = dict(zip(system.columns.labels, system.columns.prior_weight, strict=True))
        assert weight["lever_arm.F1.z"] == pytest.approx(0.01**-2)
        assert weight["camera.camlight.f"] == pytest.approx(3.0**-2)
        assert sum(v > 0 for v in weight.values()) == 2


@pytest.fixture(scope="module")
def moving():
    """Rows that move while they are read, under effects that look at the picture."""
    problem = made(effects=["rolling_shutter", "row_polynomial", "gnss_bias"],
                   lever_arm="fixed", angular_rate_deg_s=3.0)  # fmt: skip
    values = {slug: v + 1e-2 for slug, v in problem.start.effects.items()}
    return problem, replace(problem.start, effects=values)


class TestPurity:
    """Two systems of one problem at one state are equal bit for bit, whatever was asked before."""

    def test_in_any_order(self, moving):
        problem, state = moving
        first, second = (LinearSystem(problem, state) for _ in range(2))
        right, matrix = first.right, first.matrix
        second.solve(np.eye(len(second.columns)))
        second.at(problem.start).step()
        second.residuals()
        assert np.array_equal(second.residuals().pixels, first.residuals().pixels)
        assert np.array_equal(second.matrix.toarray(), matrix.toarray())
        assert np.array_equal(second.right, right)
        assert np.array_equal(second.step().points, first.step().points)

    def test_the_cost_of_a_state_does_not_know_what_was_looked_at_before(self, moving):
        """Bit for bit; and rows of a step before lead to the same cost within the rounding."""
        problem, state = moving
        far = replace(state, centre=state.centre + [3.0, -2.0, 5.0])
        fresh, used = (Normal(problem, Loss()) for _ in range(2))
        used.assemble(far, 1e-3)
        used.residuals(far)
        near = used.modelled_at(far)
        assert used.cost_at(state) == fresh.cost_at(state)
        used.assemble(state, 0.0)
        fresh.assemble(state, 0.0)
        assert used.cost == fresh.cost
        assert np.array_equal(used.gradient, fresh.gradient)
        used.assemble(state, 0.0, near)
        assert used.cost == pytest.approx(fresh.cost, rel=1e-9)

    def test_the_problem_is_left_as_it_was(self, moving):
        problem, state = moving
        before = {k: v.copy() for k, v in vars(problem).items() if isinstance(v, np.ndarray)}
        system = LinearSystem(problem, state).testing([find("focal"), find("gnss_drift")])
        system.measuring(xy=problem.xy + 1.0, sigma=np.full(len(problem.img), 0.7)).matrix  # noqa: B018
        for name, value in before.items():
            assert np.array_equal(getattr(problem, name), value), name

    def test_rows_are_at_rest(self, moving):
        """Residuals are those of the forward model, which iterates each row to the end."""
        problem, state = moving
        modelled = weighted(state, problem)[: 2 * len(problem.img)]
        theirs = (measured(problem)[: 2 * len(problem.img)] - modelled).reshape(-1, 2)
        sigma = np.concatenate([problem.block.tie_sigma(), problem.block.mark_sigma()])
        theirs = (theirs * sigma[:, None])[problem.row]
        assert LinearSystem(problem, state).residuals().pixels == pytest.approx(theirs, abs=1e-7)


def test_a_step_of_newton_finds_the_minimum_of_what_is_linear():
    """A perfect block with other control: as an adjustment would, in one step.

    A tenth of a millimetre at 50 m bends nothing that a hundredth of a micrometre would show.
    """
    problem = make_problem(corridor_block(**SMALL))
    moved = replace(problem, control_given=problem.control_given + [1e-4, 0.0, -1e-4])
    there = LinearSystem(moved, problem.start).step()
    again = solve(Normal(moved, Loss()), tolerance=1e-9).state
    assert there.points == pytest.approx(again.points, abs=1e-8)
    assert there.centre == pytest.approx(again.centre, abs=1e-8)


def test_the_null_space_of_a_free_network_is_its_seven_motions():
    """Moved, turned and grown as a whole, a block without control and GNSS fits as before."""
    problem = made(gnss=False, control=0, check=0, camera="fixed")
    system = LinearSystem(problem, problem.start)
    motion = system.motions / np.linalg.norm(system.motions, axis=0)
    reference = np.abs(motion).T @ (system.reference[:, None] * np.abs(motion))
    assert np.abs(motion.T @ (system.matrix @ motion)).max() < 1e-9 * reference.max()


def test_a_factor_that_fails_leaves_no_spoilt_equations_behind():
    """Factorised in place as far as it went: who asks what is singular needs the equations."""
    problem = make_problem(
        add_noise(corridor_block(**SMALL | {"gnss": False}), **NOISE), control=[]
    )
    system = LinearSystem(problem, problem.start, Loss())
    other = LinearSystem(problem, problem.start, Loss())
    with pytest.raises(Singular):
        _ = system.factor
    x = np.random.default_rng(1).normal(size=(len(system.columns), 2))
    assert np.array_equal(system.multiply(x), other.multiply(x))
