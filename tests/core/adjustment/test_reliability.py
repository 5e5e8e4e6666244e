"""Redundancy, tests and least errors against a dense inverse and against leaving out; snooping."""

from functools import partial

import numpy as np
import pytest
from dense_jacobian import jacobian, weighted
from scipy.stats import kstest, norm
from strips import corridor_block

import corridor
from corridor.core.adjustment import Covariance, LinearSystem, solve
from corridor.core.adjustment.cofactors import (
    of_antennas,
    of_control,
    of_points,
    shares_of_antennas,
)
from corridor.core.adjustment.reliability import DELTA, chance, critical
from corridor.core.adjustment.snooping import blunders, with_scale


def flown(seed=1, images=10, control=4, **options):
    block = corridor_block(
        images=images, strips=2, observations_per_image=60, seed=seed, control=control, check=2,
        relief=8.0, **options,
    )  # fmt: skip
    return corridor.simulation.add_noise(
        block, tie_px=0.5, mark_px=0.5, gnss_m=0.02, control_m=0.01, seed=seed
    )


def dense(adjusted):
    """Cofactors of all residuals in units of the stated sigmas; where GNSS and control begin."""
    p = adjusted.problem
    j = jacobian(adjusted.state, p)
    ties, marks = 2 * len(p.block.tie_points), 2 * len(p.block.marks)
    ends = np.cumsum([ties, marks, 3 * len(p.gnss_image), 3 * len(p.control_rows)])
    # Behind them stand priors, of which there are none.
    whole = (np.eye(len(j)) - j @ np.linalg.pinv(j))[: ends[-1], : ends[-1]]
    return whole, ends[1], ends[2]


def left_inverse(rows):
    """Of a matrix (n, u) of full rank: what gives the least squares (u, n)."""
    q, r = np.linalg.qr(rows)
    return np.linalg.solve(r, q.T)


MODELS = {
    "a free camera and arms": {},
    "an effect of each image": {"effects": ["rolling_shutter_rotation"]},
    "an effect of the ground": {"effects": ["control_datum"], "lever_arm": "fixed"},
}


class TestSumsOfRedundancies:
    def test_random_signs_know_them_as_well_as_they_say(self):
        """Sums r over 72 positions, in plan and in height: sqrt(2 r / 64), four of it."""
        adjusted = corridor.adjust(flown(images=72))
        exact = np.einsum("nii->ni", of_antennas(adjusted.covariance))
        found = shares_of_antennas(adjusted.covariance)
        for axes in (slice(0, 2), slice(2, 3)):
            r = exact[:, axes].sum()
            assert abs(found[:, axes].sum() - r) < 4.0 * np.sqrt(2.0 * r / 64.0)
            assert found[:, axes].sum() != r


class TestCofactors:
    @pytest.mark.parametrize("model", MODELS)
    def test_they_are_those_of_a_dense_inverse(self, model):
        adjusted = corridor.adjust(flown(), **MODELS[model])
        whole, gnss, control = dense(adjusted)
        p, tolerance = adjusted.problem, 1e-6
        for k, one in enumerate(of_antennas(adjusted.covariance)):
            part = slice(gnss + 3 * k, gnss + 3 * k + 3)
            assert np.abs(one - whole[part, part]).max() < tolerance
            assert np.abs(shares_of_antennas(adjusted.covariance)[k] - one.diagonal()).max() < 1e-9
        points = np.flatnonzero(p.point_kinds)
        found = list(of_points(adjusted.covariance, points))
        for one in found:
            rows = p.row[p.ptr[one.point] : p.ptr[one.point + 1]]
            at = (2 * rows[:, None] + np.arange(2)).ravel()
            if p.control[one.point] >= 0:
                at = np.append(at, control + 3 * p.control[one.point] + np.arange(3))
            assert np.abs(one.share - whole[np.ix_(at, at)]).max() < tolerance
        together = of_control(adjusted.covariance)
        assert np.abs(together - whole[control:, control:]).max() < tolerance

    def test_sparse_storage_gives_the_same(self):
        adjusted = corridor.adjust(flown())
        system = LinearSystem(adjusted.problem, adjusted.state, storage="sparse")
        other = Covariance(system)
        points = np.flatnonzero(adjusted.problem.point_kinds)
        for one, two in zip(
            of_points(adjusted.covariance, points), of_points(other, points), strict=True
        ):
            assert np.abs(one.share - two.share).max() < 1e-9

    def test_redundancies_of_all_kinds_are_the_redundancy(self):
        adjusted = corridor.adjust(flown())
        whole, *_ = dense(adjusted)
        assert np.trace(whole) == pytest.approx(adjusted.redundancy, abs=1e-5)
        table = adjusted.variance_components
        assert table["redundancy"].sum() == pytest.approx(adjusted.redundancy, abs=1e-6)


class TestLeavingOut:
    """The prediction of a point by all others is that of an adjustment without it."""

    def test_of_control(self):
        block = flown(control=5)
        adjusted = corridor.adjust(block)
        control = adjusted.reliability.control
        for name in control["point"].unique()[:3]:
            others = [p for p in control["point"].unique() if p != name]
            without = corridor.adjust(block, control=others, check=[name])
            row = without.check_points.set_index("point").loc[name]
            mine = control[control["point"] == name]
            # Not linear by the bend of the projection over a hundredth of a sigma.
            assert np.allclose(mine["predicted"], -row[["dx", "dy", "dz"]], atol=2e-4)
            variance = row[["sx", "sy", "sz"]].to_numpy(float) ** 2 / without.sigma0**2
            assert np.allclose(mine["s_predicted"], np.sqrt(variance + 1e-4), rtol=2e-3)

    def test_of_antenna_positions(self):
        block = flown()
        adjusted = corridor.adjust(block)
        gnss = adjusted.reliability.gnss
        name = gnss["image"].iloc[0]
        part = block.copy()
        part.gnss = part.gnss[part.gnss["image"] != name].reset_index(drop=True)
        without = corridor.adjust(part)
        k = list(without.problem.images.names).index(name)
        arm = without.state.arms[without.problem.images.flight[k]]
        at = without.state.centre[k] + without.state.rotation[k].T @ arm
        given = block.gnss.set_index("image").loc[name, ["x", "y", "z"]].to_numpy(float)
        mine = gnss[gnss["image"] == name]
        assert np.allclose(mine["predicted"], given - at, atol=2e-4)


class TestLeavingOutOfTheEquations:
    """Tests and predictions are those of the same equations with rows left out, or with an error as
    one more unknown: dense, no line shared with the package, to a millionth of a sigma.

    Whole adjustments without a measurement differ by more (`TestLeavingOut`): they are linear about
    another state, by the bend of the projection over the step between both.
    """

    @pytest.mark.parametrize("model", MODELS)
    def test_of_every_kind(self, model, monkeypatch):
        # Adjustments end some 1e-5 of a sigma from the optimum, of which the tables know nothing.
        at_rest, near = partial(solve, tolerance=1e-9), 1e-6
        if model == "an effect of each image":
            # The row in which a turning camera reads a point is found to 1e-5 px.
            near = 1e-5
        monkeypatch.setattr("corridor.core.adjustment.adjusting.solve", at_rest)
        adjusted = corridor.adjust(flown(), **MODELS[model])
        p = adjusted.problem
        block, used = p.block, p.roles == "control"
        j = jacobian(adjusted.state, p)
        given = np.concatenate([
            (block.numbers("tie_points", "x", "y") / block.tie_sigma()[:, None]).ravel(),
            (block.numbers("marks", "x", "y") / block.mark_sigma()[:, None]).ravel(),
            (block.numbers("gnss", *"xyz") / block.gnss_sigma()).ravel(),
            (block.numbers("ground", *"xyz")[used] / block.ground_sigma()[used]).ravel(),
        ])  # fmt: skip
        v = given - weighted(adjusted.state, p)[: len(given)]
        j = j[: len(v)] / np.linalg.norm(j, axis=0)
        _, _, at_control = dense(adjusted)
        at_mark = 2 * len(block.tie_points)
        at_gnss, scale = at_mark + 2 * len(block.marks), adjusted.reliability.image_scale
        tables = (
            ("control", at_control, 3, 1.0, block.ground_sigma()[used].ravel(), 4),
            ("gnss", at_gnss, 3, 1.0, block.gnss_sigma().ravel(), 3),
            ("marks", at_mark, 2, scale, np.repeat(block.mark_sigma(), 2), 3),
        )
        for kind, first, axes, by, sigma, most in tables:
            table = getattr(adjusted.reliability, kind)
            if kind == "marks":  # In the order of the file.
                keys = block.marks[["point", "image"]].astype(str)
                table = table.set_index(["point", "image", "axis"])
                order = [(*key, axis) for key in keys.itertuples(index=False) for axis in "xy"]
                table = table.loc[order].reset_index()
            for k in range(most):
                own = slice(axes * k, axes * (k + 1))
                rows = np.arange(first + axes * k, first + axes * (k + 1))
                others = np.delete(np.arange(len(v)), rows)
                inverse = left_inverse(j[others])
                predicted = v[rows] - j[rows] @ (inverse @ v[others])
                spread = np.eye(axes) + (j[rows] @ inverse) @ (j[rows] @ inverse).T
                mine = table.iloc[own]
                unit = by * sigma[own]
                assert np.abs((mine["predicted"] - sigma[own] * predicted) / unit).max() < near
                found = mine["s_predicted"].to_numpy() / unit
                assert np.abs(found - np.sqrt(np.diag(spread))).max() < 1e-6
                for axis, row in enumerate(rows):
                    error = np.zeros(len(v))
                    error[row] = 1.0
                    both = left_inverse(np.column_stack([j, error]))
                    size = np.linalg.norm(both[-1])  # The estimated error's standard deviation.
                    one = mine.iloc[axis]
                    assert one["w"] == pytest.approx(both[-1] @ v / size / by, abs=near)
                    assert one["redundancy"] == pytest.approx(size**-2.0, abs=1e-6)
                    assert one["least_error"] / unit[axis] == pytest.approx(DELTA * size, rel=1e-6)


class TestCriticalValues:
    def test_of_few_redundancies_tau_is_smaller_than_of_the_normal(self):
        """Pope 1976: w of one redundancy is always 1, and of f never beyond sqrt(f)."""
        assert critical(0.001) == pytest.approx(3.2905, abs=1e-4)
        assert critical(0.001, 1) == 1.0
        assert critical(1e-9, 10) < np.sqrt(10.0)
        assert critical(0.001, 1e7) == pytest.approx(critical(0.001), abs=1e-5)

    def test_good_measurements_exceed_it_as_often_as_it_says(self):
        """20,000 fits of a line to 8 points, sigma naught by their own residuals: 5 % of them."""
        rng, count = np.random.default_rng(3), 20_000
        a = np.column_stack([np.ones(8), np.arange(8.0)])
        share = np.eye(8) - a @ np.linalg.pinv(a)
        v = rng.normal(size=(count, 8)) @ share
        w = v[:, 3] / np.sqrt(share[3, 3]) / np.sqrt((v**2).sum(axis=1) / 6)
        beyond = np.mean(np.abs(w) > critical(0.05, 6))
        assert abs(beyond - 0.05) < 3.0 * np.sqrt(0.05 * 0.95 / count)
        # As a whole, two of the points: their square is a Beta.
        part = share[np.ix_([2, 5], [2, 5])]
        test = np.einsum("ni,ij,nj->n", v[:, [2, 5]], np.linalg.inv(part), v[:, [2, 5]])
        p = chance(2, test / ((v**2).sum(axis=1) / 6), 6)
        assert kstest(p, "uniform").pvalue > 0.001


class TestNoise:
    def test_w_is_normal_and_a_least_error_is_found_in_four_of_five(self):
        """Linear: residuals are R times errors; 400 draws, so 80 +- 2 % by the binomial."""
        adjusted = corridor.adjust(flown(control=5))
        share = adjusted.reliability.control_cofactors
        table = adjusted.reliability.control
        assert np.allclose(np.diag(share), table["redundancy"])
        rng = np.random.default_rng(0)
        # Residuals of the stated noise have the cofactors themselves.
        size, axes = np.linalg.eigh(share)
        root = axes * np.sqrt(np.clip(size, 0.0, None))
        v = root @ rng.normal(size=(len(share), 4000))
        scale = np.sqrt(np.diag(share))[:, None]
        assert kstest((v / scale)[0], "norm").pvalue > 0.001
        # An error of one coordinate moves all residuals by its column of R.
        sigma = adjusted.residuals["control"][["sx", "sy", "sz"]].to_numpy().ravel()
        for k in range(0, len(share), 4):
            error = table["least_error"].iloc[k] / sigma[k]
            w = (v[k] + share[k, k] * error) / scale[k]
            assert np.mean(np.abs(w) > norm.isf(0.0005)) == pytest.approx(0.8, abs=0.02)

    def test_the_least_error_is_that_of_baarda(self):
        """Sqrt of lambda_0 = 17.07 for alpha_0 = 0.1 % and a power of 80 % (Baarda 1968)."""
        assert pytest.approx(17.07, abs=0.01) == DELTA**2


def spoilt(errors, seed, control=7, **options):
    """A block with errors of control: {(number, axis): sigmas}."""
    block = flown(seed, images=14, control=control, **options)
    rows = np.flatnonzero(block.ground["role"] == "control")
    for (number, axis), size in errors.items():
        block.ground.loc[rows[number], axis] += 0.01 * size
    return block, block.ground["point"].to_numpy()[rows]


class TestWrongControl:
    @pytest.mark.parametrize(
        "errors",
        [
            {(2, "z"): 15.0},
            {(0, "x"): -12.0},
            {(1, "z"): 20.0, (2, "z"): 20.0},
            {(3, "y"): 14.0, (5, "z"): -18.0},
        ],
    )
    def test_point_and_coordinate_are_named_and_nothing_else(self, errors):
        block, names = spoilt(errors, seed=3)
        adjusted = corridor.adjust(block, weights="stated")
        found = adjusted.reliability.wrong_control
        assert set(zip(found["point"], found["axis"], strict=True)) == {
            (names[k], axis) for k, axis in errors
        }
        for row in found.itertuples():
            true = 0.01 * errors[list(names).index(row.point), row.axis]
            assert abs(row.error - true) < 4 * row.sigma
        told = next(s for s in adjusted.warnings if s.startswith("Ground control is wrong"))
        assert all(names[k] in told for k, _ in errors)

    def test_an_error_that_draws_the_block_to_itself_is_told(self):
        """Of a height that little else shows, seven of its sigmas leave a residual of two."""
        block = flown(control=6)
        block = block.with_(gnss=block.gnss.iloc[:0])
        known = corridor.adjust(block).reliability.control.query("axis == 'z'")
        worst = known.loc[known["redundancy"].idxmin()]
        ground = block.ground.copy()
        ground.loc[ground["point"] == worst["point"], "z"] += (
            0.01 * 7.0 / np.sqrt(worst["redundancy"])
        )
        adjusted = corridor.adjust(block.with_(ground=ground))
        assert adjusted.residuals["control"][["vx", "vy", "vz"]].abs().to_numpy().max() < 0.025
        told = next(s for s in adjusted.warnings if s.startswith("Ground control is wrong"))
        assert f"{worst['point']} in height" in told

    def test_nothing_is_named_where_nothing_is_wrong(self):
        """300 sets of residuals of pure noise: 1 % of them, 7 at the most in 99 %."""
        adjusted = corridor.adjust(flown(control=6))
        share = adjusted.reliability.control_cofactors
        size, axes = np.linalg.eigh(share)
        root = axes * np.sqrt(np.clip(size, 0.0, None))
        rng = np.random.default_rng(1)
        named = sum(bool(blunders(root @ rng.normal(size=len(share)), share)) for _ in range(300))
        assert named <= 7

    @pytest.mark.parametrize("others", [1.0, 1.5, 3.0])
    def test_nor_where_all_else_scatters_more_than_is_stated(self, others):
        """300 sets of residuals R l, of which l but for the control is `others` times as large."""
        rng = np.random.default_rng(2)
        design = rng.normal(size=(40, 10)) * np.r_[np.full(12, 0.3), np.ones(28)][:, None]
        whole = np.eye(40) - design @ np.linalg.pinv(design)
        scatter = np.r_[np.ones(12), np.full(28, others)]
        v = (whole @ (scatter[:, None] * rng.normal(size=(40, 300))))[:12]
        named = sum(bool(blunders(*with_scale(one, whole[:12, :12], others))) for one in v.T)
        assert named <= 7
        e = np.eye(12)[4] * 30.0 * others
        found = blunders(*with_scale(v[:, 0] + whole[:12, :12] @ e, whole[:12, :12], others))
        assert [one.number for one in found] == [4]
        assert abs(found[0].error - e[4]) < 4.0 * found[0].sigma

    def test_a_masked_pair_is_found_where_no_single_one_stands_out(self):
        """Two of four heights on a plane, equal errors: each looks like the other two's."""
        at = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [2, 0.2], [2, 1.1]], float)
        a = np.column_stack([np.ones(6), at])
        share = np.eye(6) - a @ np.linalg.pinv(a)
        error = np.zeros(6)
        error[[4, 5]] = 12.0
        found = blunders(share @ error + share @ np.random.default_rng(0).normal(size=6), share)
        assert {b.number for b in found} <= {4, 5} or any(b.rivals for b in found)

    def test_a_set_of_one_is_not_accused(self):
        assert blunders(np.array([50.0]), np.array([[0.5]])) == []


class TestExternal:
    @pytest.mark.parametrize("model", MODELS)
    def test_an_undetected_error_moves_the_points_as_an_adjustment_with_it_does(self, model):
        """The same block with the error in it, adjusted: points move by as much, to 1 %."""
        block = flown()
        adjusted = corridor.adjust(block, **MODELS[model], weights="stated")
        table = adjusted.reliability.external
        row = int(table["moved"].where(np.isfinite(table["least_error"])).idxmax())
        one = table.iloc[row]
        # Small, so that it is linear.
        size = 1e-3
        spoilt = block.copy()
        at = spoilt.ground.index[spoilt.ground["point"] == one["point"]][0]
        spoilt.ground.loc[at, one["axis"]] += size
        other = corridor.adjust(spoilt, **MODELS[model], weights="stated")
        away = other.state.points - adjusted.state.points
        length = np.linalg.norm(away, axis=1) * one["least_error"] / size
        assert length.max() == pytest.approx(one["moved"], rel=0.01)
        assert str(adjusted.problem.point_index[length.argmax()]) == one["at"]
        plan = np.hypot(away[:, 0], away[:, 1]).max() * one["least_error"] / size
        assert plan == pytest.approx(one["plan"], rel=0.01)

    def test_without_control_there_is_an_empty_table_and_a_report(self):
        adjusted = corridor.adjust(flown(control=0))
        assert len(adjusted.reliability.external) == 0
        assert "moves no point" not in str(adjusted)

    def test_a_coordinate_that_nothing_checks_has_no_largest_move(self):
        adjusted = corridor.adjust(flown(gnss=False, control=3), camera="fixed")
        table = adjusted.reliability.external
        assert len(table) == 9 and set(table["axis"]) == set("xyz")
