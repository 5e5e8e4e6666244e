"""Correlated measurements against a dense adjustment with the full matrix, and against draws."""

import numpy as np
import pytest
from dense_jacobian import jacobian
from scipy.linalg import block_diag
from strips import corridor_block

import corridor
from corridor.core.adjustment.reliability import DELTA
from corridor.core.block import RHO, covariances
from corridor.core.errors import InputError

GNSS_RHO, CONTROL_RHO, IMAGE_RHO = (0.6, -0.4, 0.3), (-0.5, 0.2, 0.7), 0.8
NOISE = {"tie_px": 0.5, "mark_px": 0.5, "gnss_m": (0.02, 0.03, 0.05), "control_m": 0.01}
MODELS = {
    "a free camera and arms": {},
    "a rolling shutter": {"effects": ["rolling_shutter"]},
    "an effect on the image": {"effects": ["affine_distortion"], "camera": "f,k1"},
    "an effect of the ground": {"effects": ["control_datum"], "lever_arm": "fixed"},
}


def flown(seed=1, images=10, pictures=True, control=4, **options):
    """A block whose measurements all are correlated, and whose marks have unlike x and y."""
    block = corridor_block(
        images=images, strips=2, observations_per_image=60, seed=seed, control=control, check=2,
        relief=8.0, **options,
    )  # fmt: skip
    noise = NOISE | {"gnss_rho": GNSS_RHO, "control_rho": CONTROL_RHO}
    if pictures:
        noise |= {"image_rho": IMAGE_RHO}
    block = corridor.simulation.add_noise(block, **noise, seed=seed)
    if pictures:
        block.put("marks", ("sx", "sy"), np.tile([0.4, 0.7], (len(block.marks), 1)))
    return block


def stated(problem):
    """Covariance of every row of `dense_jacobian.weighted` but the priors, and those rows' sigmas
    there, by hand."""
    block = problem.block
    used = problem.roles == "control"
    parts, sigmas = [], []
    for table, own in (("tie_points", block.tie_sigma()), ("marks", block.mark_sigma())):
        rho = getattr(block, table).get("rho_xy", np.zeros(len(own)))
        both = np.array([[0.5, 0.5]] if table == "tie_points" or "sx" not in block.marks
                        else [[0.4, 0.7]])  # fmt: skip
        for r in rho:
            x, y = both[0]
            parts.append(np.array([[x * x, r * x * y], [r * x * y, y * y]]))
        sigmas.append(np.repeat(own, 2))
    for sigma, rho, count in (
        (block.gnss_sigma(), GNSS_RHO, len(block.gnss)),
        (block.ground_sigma()[used], CONTROL_RHO, used.sum()),
    ):
        parts += list(covariances(sigma, np.tile(rho, (count, 1))))
        sigmas.append(sigma.ravel())
    return block_diag(*parts), np.concatenate(sigmas)


def dense(adjusted):
    """Design matrix (m), covariance of all measurements, and where GNSS and control begin."""
    p = adjusted.problem
    matrix, sigma = stated(p)
    j = jacobian(adjusted.state, p)[: len(sigma)] * sigma[:, None]
    ends = np.cumsum([2 * len(p.block.tie_points), 2 * len(p.block.marks), 3 * len(p.gnss_image)])
    return j, matrix, ends


def left_in(adjusted):
    """Residuals of all measurements in the order of `dense`."""
    tables = adjusted.residuals
    parts = [tables[kind][["vx", "vy"]] for kind in ("tie", "mark")]
    parts.append(tables["gnss"][["vx", "vy", "vz"]])
    parts.append(tables["control"][["vx", "vy", "vz"]])
    return np.concatenate([part.to_numpy().ravel() for part in parts])


class TestAgainstADenseAdjustment:
    @pytest.mark.parametrize("model", MODELS)
    def test_the_result_is_that_of_the_full_matrix(self, model):
        """The gradient is zero, and covariances are those of (J' S^-1 J)^-1."""
        adjusted = corridor.adjust(flown(), **MODELS[model])
        assert adjusted.converged
        p, v = adjusted.problem, left_in(adjusted)
        j, matrix, _ = dense(adjusted)
        heavy = np.linalg.solve(matrix, j)
        assert 2 * adjusted.cost == pytest.approx(v @ np.linalg.solve(matrix, v), rel=1e-9)
        scale = np.sqrt(np.einsum("ij,ij->j", j, heavy))
        normal = (j.T @ heavy) / scale[:, None] / scale
        # A step of Gauss and Newton from here, in standard deviations.
        covariance = np.linalg.inv(normal)
        step = covariance @ (heavy.T @ v / scale)
        assert np.abs(step / np.sqrt(np.diag(covariance))).max() < 2e-3
        whole = covariance / scale[:, None] / scale
        m, q = p.image_count * p.d, p.shared_count
        ours = adjusted.covariance.shared
        theirs = whole[m : m + q, m : m + q]
        size = np.sqrt(np.diag(theirs))
        assert np.abs((ours - theirs) / size[:, None] / size).max() < 1e-5
        points = adjusted.covariance.points(np.arange(len(p.ptr) - 1))
        for k, six in enumerate(points):
            at = m + q + 3 * k + np.arange(3)
            theirs = whole[np.ix_(at, at)]
            size = np.sqrt(np.diag(theirs))
            ours = six[[[0, 1, 3], [1, 2, 4], [3, 4, 5]]]
            assert np.abs((ours - theirs) / size[:, None] / size).max() < 1e-5

    @pytest.mark.parametrize("model", ["a free camera and arms", "an effect of the ground"])
    def test_tests_and_least_errors_are_those_of_correlated_measurements(self, model):
        """w = (P v) / sqrt(P Q P), least error DELTA / sqrt(P Q P), redundancy (Q P): by hand."""
        adjusted = corridor.adjust(flown(), **MODELS[model])
        j, matrix, ends = dense(adjusted)
        v, weight = left_in(adjusted), np.linalg.inv(matrix)
        cofactors = matrix - j @ np.linalg.solve(j.T @ weight @ j, j.T)
        share, seen = cofactors @ weight, weight @ cofactors @ weight
        root = np.sqrt(np.diag(seen))
        reliability = adjusted.reliability
        for table, part in (
            (reliability.gnss, slice(ends[1], ends[2])),
            (reliability.control, slice(ends[2], None)),
        ):
            assert table["redundancy"].to_numpy() == pytest.approx(np.diag(share)[part], abs=1e-5)
            assert table["w"].to_numpy() == pytest.approx((weight @ v / root)[part], abs=1e-5)
            assert table["least_error"].to_numpy() == pytest.approx(DELTA / root[part], rel=1e-5)
        p = adjusted.problem
        marks = reliability.marks
        table = p.block.marks
        names = zip(table["point"].astype(str), table["image"].astype(str), strict=True)
        rows = {pair: k for k, pair in enumerate(names)}
        at = [
            ends[0] + 2 * rows[row.point, row.image] + "xy".index(row.axis)
            for row in marks.itertuples()
        ]
        s = adjusted.sigma0
        assert marks["redundancy"].to_numpy() == pytest.approx(np.diag(share)[at], abs=1e-5)
        assert marks["w"].to_numpy() == pytest.approx((weight @ v / root)[at] / s, abs=1e-5)
        assert np.trace(share) == pytest.approx(adjusted.redundancy, abs=1e-4)
        components = adjusted.variance_components
        assert components["redundancy"].sum() == pytest.approx(adjusted.redundancy, abs=1e-4)

    def test_leaving_a_point_out_predicts_it_as_the_table_says(self):
        block = flown(control=6)
        adjusted = corridor.adjust(block)
        table = adjusted.reliability.control
        name = table["point"].iloc[3]
        mine = table[table["point"] == name]
        ground = block.ground.copy()
        ground.loc[ground["point"] == name, "role"] = "check"
        check = corridor.adjust(block.with_(ground=ground)).check_points.set_index("point")
        # Linear up to a thousandth of a sigma of 10 mm.
        moved = -check.loc[name, ["dx", "dy", "dz"]].to_numpy(float)
        assert mine["predicted"].to_numpy() == pytest.approx(moved, abs=2e-5)

    def test_an_error_that_is_not_found_moves_points_as_the_table_says(self):
        block = flown()
        table = corridor.adjust(block).reliability.external
        row = table.iloc[4]
        moved = block.ground.copy()
        at = moved["point"] == row["point"]
        moved.loc[at, row["axis"]] += row["least_error"]
        one, other = (
            corridor.adjust(b).points.set_index("point")[["x", "y", "z"]]
            for b in (block, block.with_(ground=moved))
        )
        shift = np.linalg.norm(other - one, axis=1)
        assert shift.max() == pytest.approx(row["moved"], rel=0.02)


class TestNoise:
    def test_errors_are_as_large_as_covariances_say_and_larger_than_those_without(self):
        """200 draws of all measurements, solved as the equations say; Loesler, Eschelbach and
        Lehmann 2025: neglected correlations make standard deviations too small."""
        block = corridor_block(
            images=8, strips=2, observations_per_image=40, control=0, check=2, relief=8.0
        )
        block.sigma |= {"tie_px": 0.5, "mark_px": 0.5, "gnss_m": np.array([0.02, 0.02, 0.02])}
        bare = corridor.adjust(block, camera="fixed", lever_arm="fixed")
        block = block.copy()
        block.put("gnss", RHO, np.tile(GNSS_RHO, (len(block.gnss), 1)))
        for table in ("tie_points", "marks"):
            block.put(table, ("rho_xy",), np.full((len(getattr(block, table)), 1), IMAGE_RHO))
        adjusted = corridor.adjust(block, camera="fixed", lever_arm="fixed")
        system, random, gnss = adjusted.system, np.random.default_rng(1), block.gnss
        of_image = np.linalg.cholesky([[0.25, 0.25 * IMAGE_RHO], [0.25 * IMAGE_RHO, 0.25]])
        whole = covariances(np.full((1, 3), 0.02), np.array([GNSS_RHO]))[0]
        of_gnss = np.linalg.cholesky(whole)
        size, axes = np.linalg.eigh(whole)
        along = axes[:, -1]  # in which errors are larger than each axis says
        known = adjusted.covariance.each_point[:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
        # Where the block as a whole lies: the mean of all centres.
        mean = np.zeros((len(system.columns), 1))
        mean[system.columns.pose[:, :3].ravel(), 0] = np.tile(along, len(gnss)) / len(gnss)
        variance, naive = ((mean.T @ one.covariance.solve(mean)).item() for one in (adjusted, bare))
        squares, true, without = [], [], []
        for _ in range(200):
            rows, gnss = system.image_rows, system.gnss
            xy = rows.xy + random.standard_normal(rows.xy.shape) @ of_image.T
            antenna = random.standard_normal(gnss.given.shape) @ of_gnss.T
            other = np.einsum("nij,nj->ni", gnss.turn, antenna)
            state = system.measuring(xy=xy, gnss=gnss.given + other).step()
            error = state.points - system.state.points
            squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(known), error) / 3)
            true.append(((state.centre - system.state.centre).mean(axis=0) @ along) ** 2 / variance)
            state = bare.system.measuring(xy=xy, gnss=bare.system.gnss.given + antenna).step()
            moved = (state.centre - bare.state.centre).mean(axis=0)
            without.append((moved @ along) ** 2 / naive)
        # All points of a draw may err together: chi-square of 3 and of 1, 200 times.
        assert np.mean(squares) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 3 / 200))
        assert np.mean(true) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 200))
        assert np.mean(without) > 0.75 * size[-1] / 0.02**2 > 1.15

    def test_drawn_errors_have_the_correlations_asked_for(self):
        block = corridor_block(images=40, strips=2, observations_per_image=60, seed=0, control=4)
        noisy = corridor.simulation.add_noise(
            block, **NOISE, image_rho=IMAGE_RHO, gnss_rho=GNSS_RHO, control_rho=CONTROL_RHO, seed=3
        )
        error = noisy.numbers("tie_points", "x", "y") - block.numbers("tie_points", "x", "y")
        assert np.corrcoef(error.T)[0, 1] == pytest.approx(IMAGE_RHO, abs=0.03)
        assert error.std(axis=0) == pytest.approx([0.5, 0.5], abs=0.03)
        error = noisy.numbers("gnss", *"xyz") - block.numbers("gnss", *"xyz")
        found = np.corrcoef(error.T)[[0, 0, 1], [1, 2, 2]]
        assert found == pytest.approx(GNSS_RHO, abs=4 / np.sqrt(len(error)))
        assert noisy.numbers("ground", *RHO)[0] == pytest.approx(CONTROL_RHO)


class TestWithoutCorrelations:
    def test_zeros_change_nothing_bit_for_bit(self):
        block = corridor.simulation.add_noise(
            corridor_block(images=8, strips=2, observations_per_image=60, control=4), **NOISE
        )
        with_zeros = block.copy()
        for table in ("gnss", "ground"):
            with_zeros.put(table, RHO, np.zeros((len(getattr(block, table)), 3)))
        for table in ("tie_points", "marks"):
            rows = len(getattr(block, table))
            with_zeros.put(table, ("sx", "sy", "rho_xy"), np.tile([0.5, 0.5, 0.0], (rows, 1)))
        one, other = corridor.adjust(block), corridor.adjust(with_zeros)
        assert (one.state.points == other.state.points).all()
        assert (one.reliability.control["w"] == other.reliability.control["w"]).all()


class TestBlock:
    def test_correlations_that_cannot_be_are_refused_with_their_row(self):
        block = flown()
        block.put("gnss", RHO, np.tile([0.9, 0.9, -0.9], (len(block.gnss), 1)))
        with pytest.raises(InputError, match=r"gnss.csv, row 2: .*rho_xy.*no measurement has"):
            block.check()
        block = flown()
        block.put("marks", ("rho_xy",), np.full((len(block.marks), 1), 1.0))
        with pytest.raises(InputError, match=r"marks.csv, row 2: .*rho_xy"):
            block.check()

    def test_a_block_that_is_written_and_read_keeps_them(self, tmp_path):
        block = flown()
        block.write(tmp_path / "b")
        again = corridor.read(tmp_path / "b")
        assert again.correlation("gnss") == pytest.approx(block.correlation("gnss"))
        assert again.in_pictures("marks")[0] == pytest.approx(block.in_pictures("marks")[0])

    def test_sigma_of_an_image_point_is_the_fourth_root_of_the_determinant(self):
        block = flown()
        sigma, rho = block.in_pictures("marks")
        whole = covariances(sigma, rho)
        assert block.mark_sigma() ** 4 == pytest.approx(np.linalg.det(whole))


class TestReport:
    def test_the_report_says_which_measurements_are_correlated(self):
        told = "adjusted with the correlations of their coordinates"
        adjusted = corridor.adjust(flown())
        assert adjusted.correlated_kinds == ["tie", "mark", "gnss", "control"]
        assert f"{told}: tie points, marks, GNSS, control" in str(adjusted)
        adjusted = corridor.adjust(flown(pictures=False))
        assert adjusted.correlated_kinds == ["gnss", "control"]
        block = corridor_block(images=10, strips=2, observations_per_image=60, control=4)
        assert told not in str(corridor.adjust(block))


class TestWrongControl:
    def test_a_wrong_coordinate_of_correlated_control_is_named(self):
        block = flown(control=6)
        ground = block.ground.copy()
        row = np.flatnonzero(ground["role"] == "control")[2]
        ground.loc[row, "z"] += 0.15
        found = corridor.adjust(block.with_(ground=ground), weights="stated")
        found = found.reliability.wrong_control
        assert found["point"].tolist() == [ground["point"].iloc[row]]
        assert found["axis"].tolist() == ["z"]
        assert abs(found["error"].iloc[0] - 0.15) < 4 * found["sigma"].iloc[0]
