"""Perfect blocks adjust to their truth; disturbed ones stay as near to it as they can."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import (
    LinearSystem,
    Loss,
    Model,
    Normal,
    Run,
    make_problem,
    refit,
    similarity,
    solve,
)
from corridor.core.camera import FRASER10, INTERIOR, project
from corridor.core.effects import Images
from corridor.core.effects.forward import predict
from corridor.core.engine.interface import engine
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.simulation import CAMLIGHT, add_noise

START = (0.5, 0.005, 0.5)  # metres, radians, metres: 0.005 rad are 27 px
NANOMETRES = 1e-9


def perfect(start_error=START, **options):
    """A small block and the same with start values that miss."""
    options = {"images": 15, "strips": 3, "observations_per_image": 80, "seed": 3} | options
    return corridor_block(**options), corridor_block(**options, start_error=start_error)


def detuned(block, **changes):
    """The block with cameras that start elsewhere."""
    changes = changes or {"f": 5450.0, "cx": 2560.0, "cy": 1920.0, "k1": 0.0, "k2": 0.0, "k3": 0.0,
                          "p1": 0.0, "p2": 0.0}  # fmt: skip
    block = block.copy()
    block.cameras = {n: c.with_values(**changes) for n, c in block.cameras.items()}
    return block


def places(table, names, key):
    return table.set_index(key).loc[list(names), ["x", "y", "z"]].to_numpy(float)


def from_truth(adjustment, truth):
    """Distances (n,) of all tie points from the truth, m."""
    ties = adjustment.points[adjustment.points["kind"] == "tie"]
    return np.linalg.norm(
        ties[["x", "y", "z"]].to_numpy() - places(truth.points, ties["point"], "point"), axis=1
    )


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def spotless():
    return perfect(camera=CAMLIGHT.with_values(b1=3e-4, b2=-2e-4))


@pytest.fixture(scope="module")
def spotless_adjusted(spotless):
    return corridor.adjust(detuned(spotless[1], f=5450.0, cx=2560.0, k1=0.0, b1=0.0, b2=0.0),
                           camera="fraser10")  # fmt: skip


class TestAPerfectBlock:
    """Image coordinates in float64 hold 1e-12 px, which is 1e-14 m on the ground."""

    def test_check_points_are_hit_to_a_nanometre_with_ten_camera_parameters_free(
        self, spotless_adjusted
    ):
        assert spotless_adjusted.converged
        assert len(spotless_adjusted.check_points) >= 4
        assert spotless_adjusted.check_rms.d3 < NANOMETRES

    def test_tie_points_and_poses_too(self, spotless_adjusted, spotless):
        truth = spotless[0]
        assert rms(from_truth(spotless_adjusted, truth)) < NANOMETRES
        away = spotless_adjusted.block.images[["x", "y", "z"]] - truth.images[["x", "y", "z"]]
        assert rms(away) < NANOMETRES
        columns = ["qw", "qx", "qy", "qz"]
        turned = spotless_adjusted.block.images[columns] - truth.images[columns]
        assert np.abs(turned).max(axis=None) < 1e-11

    def test_the_camera_is_the_true_one(self, spotless_adjusted, spotless):
        """A nanometre at 50 m is 1e-7 px; the coefficients move a corner by a pixel at 1e-3."""
        (found,), (true,) = spotless_adjusted.block.cameras.values(), spotless[0].cameras.values()
        for name in FRASER10:
            tolerance = 1e-6 if name in ("f", "cx", "cy") else 1e-8
            assert found[name] == pytest.approx(true[name], abs=tolerance), name

    def test_the_start_leaves_no_trace(self, spotless_adjusted, spotless):
        """The adjusted block keeps nothing of where the iterations began."""
        again = corridor.adjust(spotless_adjusted.block, camera="fraser10")
        # Damping takes 1e-6, 1e-8, 1e-10 and none, at rest or not.
        assert again.iterations <= 4
        assert rms(again.state.centre - spotless_adjusted.state.centre) < NANOMETRES

    def test_coordinates_rounded_as_a_file_has_them_cost_a_few_nanometres(self, spotless):
        """1e-6 px of rounding is 9e-9 m on the ground for one ray, less for six."""
        block = spotless[1].copy()
        block.tie_points = block.tie_points.round({"x": 6, "y": 6})
        block.marks = block.marks.round({"x": 6, "y": 6})
        assert 0 < corridor.adjust(block, camera="fraser10").check_rms.d3 < 10 * NANOMETRES

    def test_sigma_naught_says_that_nothing_is_left(self, spotless_adjusted):
        assert spotless_adjusted.sigma0 < 1e-8
        assert spotless_adjusted.statistics["tie"]["rms"] < 1e-8

    @pytest.mark.parametrize("row_direction", ["down", "left"])
    def test_effects_are_found_with_the_rest(self, row_direction):
        """The truth's values go in through the forward model and come out of the adjustment."""
        from corridor.core.effects.forward import add

        truth, start = perfect(camera=dataclasses.replace(CAMLIGHT, row_direction=row_direction))
        flown = add(truth, {"rolling_shutter": {"readout": 0.0248}, "gnss_bias": {"z": 0.05}})
        flown.images, flown.points = start.images, start.points
        adjusted = corridor.adjust(flown, effects=["rolling_shutter", "gnss_bias"],
                                   lever_arm="fixed")  # fmt: skip
        value = adjusted.effects.set_index(["slug", "parameter"])["value"]
        # The row is the modelled one of the step before: the last steps shrink by a hundred each
        # and end at 1e-5 sigmas, which are 0.01 m of height for the common offset.
        assert value["rolling_shutter", "readout"] == pytest.approx(0.0248, abs=1e-9)
        assert value["gnss_bias", "z"] == pytest.approx(0.05, abs=1e-7)
        assert adjusted.check_rms.d3 < 10 * NANOMETRES


@pytest.fixture(scope="module")
def two_cameras():
    truth, start = perfect(images=24, strips=4, flights=2, height=(50.0, 50.0, 65.0, 65.0))
    second = dataclasses.replace(
        CAMLIGHT, name="Second", interior=CAMLIGHT.with_values(f=5600.0, k1=0.03).interior
    )
    late = truth.images["flight"] == "F2"
    arms = {"F1": (0.10, -0.05, 0.35), "F2": (-0.20, 0.15, 0.30)}
    for block in (truth, start):
        block.cameras = {CAMLIGHT.name: CAMLIGHT, "Second": second}
        block.images.loc[late, "camera"] = "Second"
        block.lever_arm = dict(arms)
    seen = predict(truth)
    for block in (truth, start):
        block.tie_points = block.tie_points.assign(x=seen.tie[:, 0], y=seen.tie[:, 1])
        block.marks = block.marks.assign(x=seen.mark[:, 0], y=seen.mark[:, 1])
        block.gnss = block.gnss.assign(**dict(zip("xyz", seen.gnss.T, strict=True)))
    start.cameras = {
        CAMLIGHT.name: dataclasses.replace(CAMLIGHT, calibrated=True),
        "Second": second.with_values(f=5560.0, k1=0.0, cx=2560.0),
    }
    start.lever_arm = {"default": (0.0, 0.0, 0.0)}
    return truth, start


class TestSeveralCamerasAndFlights:
    """Flight F2 is flown with another camera; its arm differs from that of F1."""

    def test_a_calibrated_camera_is_held_and_the_other_found(self, two_cameras):
        truth, start = two_cameras
        adjusted = corridor.adjust(start)
        table = adjusted.camera.set_index(["camera", "parameter"])
        assert not table.loc[CAMLIGHT.name, "free"].any()
        assert (table.loc[CAMLIGHT.name, "sigma"] == 0).all()
        assert table.loc[("Second", "f"), "value"] == pytest.approx(5600.0, abs=1e-6)
        assert table.loc[("Second", "k1"), "value"] == pytest.approx(0.03, abs=1e-9)
        assert adjusted.check_rms.d3 < NANOMETRES

    def test_who_asks_for_it_gets_each_camera_as_he_wants_it(self, two_cameras):
        camera = {CAMLIGHT.name: "f,cx,cy", "Second": "fraser8"}
        adjusted = corridor.adjust(two_cameras[1], camera=camera)
        free = adjusted.camera[adjusted.camera["free"]].groupby("camera")["parameter"].agg(set)
        assert free[CAMLIGHT.name] == {"f", "cx", "cy"}
        assert len(free["Second"]) == 8
        assert adjusted.check_rms.d3 < NANOMETRES

    def test_the_lever_arm_of_each_flight_is_recovered(self, two_cameras):
        truth, start = two_cameras
        arms = corridor.adjust(start).lever_arm.set_index("flight")
        for flight, arm in truth.lever_arm.items():
            assert arms.loc[flight, list("xyz")].to_numpy(float) == pytest.approx(
                arm, abs=10 * NANOMETRES
            )
        assert not arms["fixed"].any()

    def test_a_wrong_arm_that_is_held_shows_in_the_gnss_residuals(self, two_cameras):
        """Held at zero, the arms of 0.1 to 0.35 m are left, less what poses and cameras hide."""
        adjusted = corridor.adjust(two_cameras[1], lever_arm="fixed")
        assert adjusted.lever_arm["fixed"].all()
        assert max(adjusted.statistics["gnss"]["rms"]) > 0.05
        free = corridor.adjust(two_cameras[1])
        assert max(free.statistics["gnss"]["rms"]) < NANOMETRES


@pytest.fixture(scope="module")
def free():
    truth, start = perfect(gnss=False, control=0, check=0)
    return truth, detuned(start, f=5450.0, k1=0.0)


@pytest.fixture(scope="module")
def free_adjusted(free):
    return corridor.adjust(free[1], camera="fraser8")


class TestAFreeNetwork:
    """Neither control nor GNSS: the shape is determined, where it lies is not."""

    def test_the_truth_comes_out_up_to_a_similarity(self, free_adjusted, free):
        """Self-calibration from one height determines f through the relief and tilts alone."""
        truth = free[0]
        ties = free_adjusted.points
        given = places(truth.points, ties["point"], "point")
        found = ties[["x", "y", "z"]].to_numpy()
        laid = similarity(found, given)
        assert rms(np.linalg.norm(laid.apply(found) - given, axis=1)) < 10 * NANOMETRES
        assert free_adjusted.block.cameras[CAMLIGHT.name]["f"] == pytest.approx(5489.0, abs=1e-5)

    def test_it_needs_three_strong_points_to_have_a_similarity_at_all(self, free_adjusted, free):
        """Start poses miss by half a metre: the free network must not lie on the truth itself."""
        assert rms(from_truth(free_adjusted, free[0])) > 0.01

    def test_it_is_laid_on_its_start_poses_as_a_whole(self, free_adjusted, free):
        """No translation, growth or rotation is left that would bring it nearer to them.

        With angles weighed as metres at the typical distance: sums of the differences by hand.
        """
        start = free[1].images
        rows = free_adjusted.block.images
        centre = rows[["x", "y", "z"]].to_numpy()
        away = start[["x", "y", "z"]].to_numpy() - centre
        arm = centre - centre.mean(axis=0)
        quaternions = ["qw", "qx", "qy", "qz"]
        here, there = (rotation_from_quaternion(t[quaternions].to_numpy()) for t in (rows, start))
        points = free_adjusted.points[["x", "y", "z"]].to_numpy()
        distance = np.median(np.linalg.norm(centre - np.median(points, axis=0), axis=1))
        # R_start = exp([w]x) R: w in the camera frame, a turn of the world by -R' w.
        turn = there @ here.transpose(0, 2, 1)
        w = 0.5 * np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0],
                            turn[:, 1, 0] - turn[:, 0, 1]], axis=1)  # fmt: skip
        in_world = -np.einsum("nji,nj->ni", here, w)
        assert away.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-8)
        assert np.sum(arm * away) == pytest.approx(0.0, abs=1e-6)
        torque = np.cross(arm, away).sum(axis=0) + distance**2 * in_world.sum(axis=0)
        assert torque == pytest.approx(np.zeros(3), abs=1e-5)

    def test_redundancy_counts_the_seven_that_are_open(self, free_adjusted):
        observations = 2 * len(free_adjusted.start.tie_points)
        unknowns = 6 * 15 + 3 * len(free_adjusted.points) + 8
        assert free_adjusted.redundancy == observations - unknowns + 7

    def test_another_start_changes_where_it_lies_and_no_residual(self, free):
        noisy = add_noise(free[1], tie_px=0.5, seed=1)
        moved = noisy.copy()
        turn = rotation_from_quaternion(np.array([[0.9, 0.1, -0.2, 0.3]]) / np.sqrt(0.95))[0]
        from corridor.core.geometry import quaternion_from_rotation

        for table in (moved.images, moved.points):
            table[["x", "y", "z"]] = 3.0 * table[["x", "y", "z"]].to_numpy() @ turn.T + 7.0
        rotation = rotation_from_quaternion(moved.images[["qw", "qx", "qy", "qz"]].to_numpy())
        quaternion = quaternion_from_rotation(rotation @ turn.T)
        moved.images[["qw", "qx", "qy", "qz"]] = quaternion
        one, two = corridor.adjust(noisy), corridor.adjust(moved)
        # Both stop within 5e-5 of a standard deviation of the same optimum: 1e-9 of the cost.
        assert two.cost == pytest.approx(one.cost, rel=1e-8)
        assert two.redundancy == one.redundancy
        # A parameter's sigma belongs to the shape, a free network's lies in no datum.
        assert two.camera["sigma"].to_numpy() == pytest.approx(one.camera["sigma"].to_numpy(), 1e-4)
        growth = two.block.images["x"].std() / one.block.images["x"].std()
        assert 1.5 < growth < 4.0


class TestStartValues:
    def test_images_without_a_pose_and_points_without_coordinates_get_theirs(self):
        truth, start = perfect(start_error=(0.05, 0.001, 0.1))
        pose = ["x", "y", "z", "qw", "qx", "qy", "qz"]
        start.images.loc[[2, 3, 9], pose] = np.nan
        start.points.loc[::7, ["x", "y", "z"]] = np.nan
        adjusted = corridor.adjust(start)
        assert adjusted.check_rms.d3 < NANOMETRES
        assert rms(adjusted.block.images[["x", "y", "z"]] - truth.images[["x", "y", "z"]]) < 1e-8

    def test_the_block_that_was_handed_in_is_left_alone(self):
        _, start = perfect()
        before = start.copy()
        corridor.adjust(start)
        for table in ("images", "tie_points", "points", "marks", "ground", "gnss"):
            pd.testing.assert_frame_equal(getattr(start, table), getattr(before, table))
        assert start.cameras[CAMLIGHT.name].interior.tolist() == CAMLIGHT.interior.tolist()


@pytest.fixture(scope="module")
def noisy_block():
    truth, start = perfect(start_error=(0.02, 0.0005, 0.05))
    return add_noise(start, tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=2)


class TestPriors:
    def test_what_only_a_prior_determines_has_the_prior_as_its_posterior(self):
        """Without control a GNSS offset and a shift of the block are one: the prior decides."""
        _, start = perfect(control=0)
        start.lever_arm_fixed = True
        priors = {"gnss_bias.x": (0.01, 0.03), "gnss_bias.y": (0.0, 0.02),
                  "gnss_bias.z": (-0.02, 0.05)}  # fmt: skip
        adjusted = corridor.adjust(start, effects=["gnss_bias"], priors=priors)
        table = adjusted.effects.set_index("parameter")
        covariance = adjusted.covariance.shared[-3:, -3:]
        for k, (axis, (value, sigma)) in enumerate(zip("xyz", priors.values(), strict=True)):
            assert table.loc[axis, "value"] == pytest.approx(value, abs=1e-8)
            assert np.sqrt(covariance[k, k]) == pytest.approx(sigma, rel=1e-6)

    def test_measurement_and_prior_meet_at_their_weighted_mean(self, noisy_block):
        """One dimension, by hand: weights add up, the values are averaged with them.

        f is a linear function of the measurements up to (change / f)^2: 1e-7 here.
        """
        free = corridor.adjust(noisy_block)
        n = next(k for k, u in enumerate(free.problem.unknowns) if u.label.endswith(".f"))
        value = free.camera.set_index("parameter").loc["f", "value"]
        weight = 1 / free.covariance.shared[n, n]
        given, own = value + 2 * weight**-0.5, weight / 0.7
        with_prior = corridor.adjust(
            noisy_block, priors={f"camera.{CAMLIGHT.name}.f": (given, own**-0.5)}
        )
        found = with_prior.camera.set_index("parameter").loc["f", "value"]
        mean = (weight * value + own * given) / (weight + own)
        assert abs(found - mean) < 1e-3 * weight**-0.5
        assert with_prior.covariance.shared[n, n] == pytest.approx(1 / (weight + own), rel=1e-3)
        assert with_prior.redundancy == free.redundancy + 1

    def test_a_tight_prior_is_as_good_as_holding(self, noisy_block):
        tight = corridor.adjust(noisy_block, priors={f"camera.{CAMLIGHT.name}.f": (5489.0, 1e-6)})
        held = corridor.adjust(noisy_block, camera="cx,cy,k1,k2,k3,p1,p2")
        assert tight.camera.loc[0, "value"] == pytest.approx(5489.0, abs=1e-6)
        assert tight.check_points["dz"].to_numpy() == pytest.approx(
            held.check_points["dz"].to_numpy(), abs=1e-7
        )

    def test_a_prior_without_a_group_holds_for_every_group(self, noisy_block):
        noisy = noisy_block.copy()
        noisy.lever_arm_fixed = True
        priors = {"lever_arm.z": (0.0, 0.01)}
        adjusted = corridor.adjust(noisy, effects=["lever_arm"], priors=priors)
        assert (adjusted.problem.prior_weight > 0).sum() == len(noisy.flight_names)


@pytest.fixture(scope="module")
def clean_and_dirty():
    options = dict(images=15, strips=3, observations_per_image=150, seed=5)
    start = corridor_block(**options, start_error=(0.05, 0.001, 0.1))
    noise = dict(tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=6)
    return add_noise(start, **noise), add_noise(start, **noise, outliers=0.05)


@pytest.fixture(scope="module")
def displaced(clean_and_dirty):
    clean, dirty = (b.tie_points[["x", "y"]].to_numpy() for b in clean_and_dirty)
    return np.linalg.norm(dirty - clean, axis=1) > 1.0


@pytest.fixture(scope="module")
def robust_truth():
    return corridor_block(images=15, strips=3, observations_per_image=150, seed=5)


class TestRobustLosses:
    """One observation in twenty is displaced by 5 to 50 px, ten to a hundred sigmas."""

    @pytest.mark.parametrize("loss", ["squares", "huber:2", "cauchy:2"])
    def test_the_block_stays_where_it_is_without_outliers(
        self, clean_and_dirty, robust_truth, loss
    ):
        """Camera centres: squares alone are thrown off, a robust loss keeps them near the clean
        ones, and an adjustment by squares leaves out what the loss shows.

        Huber's bounds an outlier's pull and does not end it: twice the clean error is allowed.
        """
        true = robust_truth.images[["x", "y", "z"]]
        first, second = clean_and_dirty
        clean, robust, squares = (
            rms(found.block.images[["x", "y", "z"]] - true)
            for found in (
                corridor.adjust(first),
                corridor.adjust(second, loss=loss),
                refit(second, Model(), Run()),
            )
        )
        assert squares > 3 * clean
        assert robust < 2 * clean

    @pytest.mark.parametrize("loss", ["huber:2", "cauchy:2"])
    def test_outliers_are_flagged_and_counted(self, clean_and_dirty, displaced, loss):
        """Ten sigmas and more, less what two-ray points hide; flags begin at five."""
        adjusted = corridor.adjust(clean_and_dirty[1], loss=loss)
        frame = adjusted.residuals["tie"]
        flagged = frame["outlier"].to_numpy()
        assert flagged[displaced].mean() > 0.9
        assert flagged[~displaced].mean() < 0.02
        found = adjusted.statistics["tie"]
        assert found["outliers"] == flagged.sum()
        assert found["gross"] == frame["gross"].sum() > 0
        assert any(f"{flagged.sum()} of {len(frame)}" in w for w in adjusted.warnings)

    def test_a_kind_that_stands_out_altogether_is_not_left_out(self, clean_and_dirty):
        """Ties said to be good to 10,000 px: no mark is gross, by the scatter of the marks."""
        block = clean_and_dirty[0].copy()
        block.sigma["tie_px"] = 1e4
        adjusted = corridor.adjust(block)
        frame, found = adjusted.residuals["mark"], adjusted.statistics["mark"]
        assert not frame["gross"].any() and found["gross"] == 0
        assert found["rms"] == pytest.approx(rms(frame[["vx", "vy"]]))

    def test_the_cauchy_weights_are_those_of_the_loss(self, clean_and_dirty):
        """1 / (1 + (v / (2 sigma))^2): the derivative of log(1 + s^2) over s."""
        frame = corridor.adjust(clean_and_dirty[1], loss="cauchy:2").residuals["tie"]
        length = np.hypot(frame["vx"], frame["vy"]) / frame["sigma"]
        assert frame["weight"].to_numpy() == pytest.approx(1 / (1 + (length / 2) ** 2))

    def test_a_loss_that_bends_nowhere_is_squares(self, clean_and_dirty):
        wide = corridor.adjust(clean_and_dirty[0], loss="huber:1000")
        plain = corridor.adjust(clean_and_dirty[0])
        assert wide.cost == pytest.approx(plain.cost, rel=1e-7)


@pytest.fixture(scope="module")
def forty_images():
    block = corridor_block(images=40, strips=2, observations_per_image=100, seed=8,
                           start_error=(0.05, 0.001, 0.1))  # fmt: skip
    return add_noise(block, tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=8)


class TestTwoWaysToTheSameNumbers:
    @pytest.mark.parametrize("effects", [[], ["rolling_shutter"], ["rolling_shutter_rotation"]])
    def test_two_threads_give_what_one_gives(self, forty_images, effects, monkeypatch):
        """Sums in another order: rounding of the normal equations, 1e-16 of their condition."""
        monkeypatch.setattr("corridor.core.adjustment.partition._LEAST", 100)
        one, two = (corridor.adjust(forty_images, effects=effects, threads=n) for n in (1, 2))
        pieces = [len(Normal(one.problem, Loss(), threads).pieces) for threads in (1, 2)]
        assert pieces[0] == 1 and (pieces[1] > 3 or engine().threads == 1)
        assert two.cost == pytest.approx(one.cost, rel=1e-10)
        assert two.state.centre == pytest.approx(one.state.centre, abs=1e-8)
        assert two.camera["sigma"].to_numpy() == pytest.approx(one.camera["sigma"].to_numpy())

    @pytest.mark.parametrize("effects", [[], ["rolling_shutter", "gnss_bias"]])
    def test_sparse_storage_gives_what_the_band_gives(self, forty_images, effects):
        problem = make_problem(forty_images, effects=effects)
        band, sparse = (
            solve(Normal(problem, Loss(), storage=storage)) for storage in ("band", "sparse")
        )
        assert sparse.iterations == band.iterations
        assert sparse.cost == pytest.approx(band.cost, rel=1e-10)
        assert sparse.state.centre == pytest.approx(band.state.centre, abs=1e-8)
        assert sparse.state.interior[:, 0] == pytest.approx(band.state.interior[:, 0], abs=1e-6)
        # The parameters, and which lens it is.
        assert len(INTERIOR) + 1 == band.state.interior.shape[1]

    def test_steps_of_the_free_network_are_the_same_in_both_storages(self):
        _, start = perfect(gnss=False, control=0, check=0)
        problem = make_problem(start)
        from corridor.core.adjustment.datum import free_network

        costs = []
        for storage in ("band", "sparse"):
            normal = Normal(problem, Loss(), storage=storage)
            system = LinearSystem(problem, problem.start, storage=storage)
            normal.held = free_network(system).held
            costs.append(solve(normal).cost)
        assert max(costs) < 1e-9


def test_a_point_at_infinity_has_no_sigma_and_can_be_written(tmp_path):
    """Rays that are parallel say nothing of how far it is: unknown, and not known to 0 m."""
    block = corridor_block(images=8, seed=1)
    images = Images.of(block)
    centre, rotation = images.centre[2:4], images.rotation[2:4]
    xyz = centre[0] + 1e11 * rotation[0, 2]
    pixel = project(np.stack([xyz, xyz]), centre, rotation, CAMLIGHT.interior)
    seen = pd.DataFrame(
        {"point": "far", "image": images.names[2:4], "x": pixel[:, 0], "y": pixel[:, 1]}
    )
    text = {"point": str, "image": str}
    ties = pd.concat([block.tie_points.astype(text), seen], ignore_index=True)
    there = pd.DataFrame({"point": ["far"], **dict(zip("xyz", xyz[:, None], strict=True))})
    points = pd.concat([block.points, there], ignore_index=True)
    far = dataclasses.replace(block, tie_points=ties, points=points)
    result = corridor.adjust(far)
    unknown = (result.points["point"] == "far").to_numpy()
    assert np.isnan(result.point_sigma).all(axis=1).tolist() == unknown.tolist()
    result.block.write(tmp_path / "block")
    written = corridor.read(tmp_path / "block").points.set_index("point")
    assert written.loc["far", ["sx", "sy", "sz"]].isna().all()
