"""A fisheye lens: the formula of OpenCV, perfect blocks, and what is said of a wrong lens."""

import dataclasses

import cv2
import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import LinearSystem, make_problem
from corridor.core.adjustment.misfit import misfit
from corridor.core.camera import (
    FISHEYE,
    INTERIOR,
    Camera,
    interior_derivatives,
    project,
    project_rays,
    projection_derivatives,
    ray_derivatives,
    undistort,
    without_distortion,
)
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.preparation import plausibility_warnings
from corridor.core.simulation import CAMLIGHT, add_noise

# An action camera: 131 degrees across, 163 from corner to corner.
TABLE = {
    "width": 4000, "height": 3000, "model": "fisheye", "f": 1760.0, "cx": 1990.0, "cy": 1510.0,
    "k1": 0.03, "k2": -0.01, "k3": 0.004, "k4": -0.001,
}  # fmt: skip
ACTION = Camera.from_table("action", TABLE)
MORE = ACTION.with_values(p1=4e-4, p2=-3e-4, b1=5e-4, b2=-4e-4, k5=2e-4)
# Tangents up to 80 degrees from the axis, the axis itself, and both sides of where a series ends.
RAYS = np.concatenate(
    [
        np.random.default_rng(1).uniform(-4.0, 4.0, (60, 2)),
        [[0.0, 0.0], [1e-9, 0.0], [0.0316, 0.0], [0.0, 0.0317]],
    ]
)


def own_pixels(points, pose, camera):
    """The formula once more, from the angle between point and axis."""
    x, y, z = rotation_from_quaternion(pose[3:]) @ (points - pose[:3]).T
    theta = np.arctan2(np.hypot(x, y), z)
    radius = theta * (1 + sum(camera[f"k{n}"] * theta ** (2 * n) for n in range(1, 5)))
    about = np.arctan2(y, x)
    return np.stack(
        [
            camera["cx"] + camera["f"] * radius * np.cos(about),
            camera["cy"] + camera["f"] * radius * np.sin(about),
        ],
        axis=1,
    )


class TestTheFormula:
    def test_opencv_has_the_same_pixels(self):
        """cv2.fisheye.projectPoints, its fx = f (1 + b1), fx alpha = f b2: rounding only."""
        lens = ACTION.with_values(b1=6e-3, b2=-2e-3)
        matrix = np.array([[1760.0 * 1.006, 0, 1990.0], [0, 1760.0, 1510.0], [0, 0, 1]])
        ahead = np.column_stack([RAYS, np.ones(len(RAYS))])[:, None]
        terms = np.array([lens[f"k{n}"] for n in range(1, 5)])
        theirs, _ = cv2.fisheye.projectPoints(
            ahead, np.zeros(3), np.zeros(3), matrix, terms, alpha=-2e-3 / 1.006
        )
        assert np.abs(project_rays(RAYS, lens.interior) - theirs[:, 0]).max() < 1e-9

    def test_by_hand_at_45_degrees(self):
        """theta = pi / 4, so x = cx + f pi / 4 (1 + k1 (pi / 4)^2) and p1 adds 3 p1 (pi / 4)^2."""
        lens = Camera.from_table(
            "c", {"width": 2001, "height": 2001, "f": 1000.0, "model": "fisheye", "k1": 0.1}
        )
        quarter = np.pi / 4
        seen = project_rays(np.array([[1.0, 0.0]]), lens.interior)[0]
        assert seen == pytest.approx([1000 + 1000 * quarter * (1 + 0.1 * quarter**2), 1000.0])
        seen = project_rays(np.array([[1.0, 0.0]]), lens.with_values(p1=1e-3).interior)[0]
        assert seen[0] == pytest.approx(
            1000 + 1000 * (quarter * (1 + 0.1 * quarter**2) + 3e-3 * quarter**2)
        )

    def test_undistort_undoes_it_over_the_whole_picture(self):
        x, y = np.meshgrid(np.linspace(0, 3999, 31), np.linspace(0, 2999, 31))
        pixels = np.column_stack([x.ravel(), y.ravel()])
        again = project_rays(undistort(pixels, MORE.interior), MORE.interior)
        assert np.abs(again - pixels).max() < 1e-9
        bare = ACTION.with_values(k1=0.0, k2=0.0, k3=0.0, k4=0.0).interior
        assert without_distortion(pixels, bare) == pytest.approx(undistort(pixels, bare), rel=1e-9)

    @pytest.mark.parametrize("parameter", INTERIOR)
    def test_derivatives_by_the_interior_are_differences(self, parameter):
        k = INTERIOR.index(parameter)
        step = 1e-3 * np.eye(len(INTERIOR), 16)[k] * (100 if k < 3 else 1)
        high, low = (project_rays(RAYS, MORE.interior + s) for s in (step, -step))
        analytic = interior_derivatives(RAYS, MORE.interior)[:, :, k]
        off = np.abs(analytic - (high - low) / (2 * step[k])).max()
        assert off < 1e-6 * np.abs(analytic).max()

    def test_derivatives_by_the_ray_and_by_point_and_pose_are_differences(self):
        h = 1e-6
        found = ray_derivatives(RAYS, MORE.interior)
        for k, step in enumerate(h * np.eye(2)):
            numeric = project_rays(RAYS + step, MORE.interior)
            numeric = (numeric - project_rays(RAYS - step, MORE.interior)) / (2 * h)
            assert found[:, :, k] == pytest.approx(numeric, abs=1e-5)
        points = np.column_stack([RAYS, np.ones(len(RAYS))]) * 30.0
        found = projection_derivatives(points, np.zeros(3), np.eye(3), MORE.interior)
        for k, step in enumerate(1e-5 * np.eye(3)):
            moved = [project(points + s, np.zeros(3), np.eye(3), MORE.interior)
                     for s in (step, -step)]  # fmt: skip
            numeric = (moved[0] - moved[1]) / 2e-5
            assert found.by_point[:, :, k] == pytest.approx(numeric, abs=1e-5)

    def test_a_pixel_at_90_degrees_or_more_has_no_ray(self):
        lens = Camera.from_table(
            "c", {"width": 4001, "height": 11, "f": 1000.0} | {"model": "fisheye"}
        )
        x = 2000.0 + 1000 * np.radians([0.0, 89.9, 90.1, 100.0])
        rays = undistort(np.column_stack([x, np.full(4, 5.0)]), lens.interior)
        assert np.isfinite(rays).all(axis=1).tolist() == [True, True, False, False]
        assert rays[1, 0] == pytest.approx(np.tan(np.radians(89.9)), rel=1e-9)

    def test_without_a_16th_number_a_vector_is_a_central_projection(self):
        vector = np.array([CAMLIGHT[name] for name in INTERIOR])
        rays = 0.1 * RAYS
        assert np.array_equal(project_rays(rays, vector), project_rays(rays, CAMLIGHT.interior))
        assert Camera("c", 5120, 3840, vector).model == "central"


class TestTheTable:
    def test_comes_back_as_it_was(self):
        assert ACTION.to_table() == TABLE
        assert ACTION.fisheye and "fisheye" in repr(ACTION)

    @pytest.mark.parametrize("model", ["fish-eye", "OPENCV_FISHEYE", 5, None])
    def test_an_unknown_model_is_refused(self, model):
        with pytest.raises(InputError, match=r"\[camera.action\] model = .* central, fisheye"):
            Camera.from_table("action", TABLE | {"model": model})


def flown(camera=ACTION, **options):
    small = dict(images=15, strips=3, observations_per_image=80, seed=3, camera=camera)
    return corridor_block(**small | options)


def straightened(block):
    """The block with cameras that start without their distortion."""
    block = block.copy()
    for name, camera in block.cameras.items():
        zero = {n: 0.0 for n in INTERIOR if n[0] in "kp"}
        block.cameras[name] = camera.with_values(f=camera["f"] - 8.0, cx=camera["cx"] + 4.0, **zero)
    return block


class TestBlocks:
    def test_a_perfect_block_calibrates_itself_to_nanometres(self):
        """Its pixels are those of the formula written once more; it starts from k = 0."""
        truth, block = flown(), straightened(flown(start_error=(0.5, 0.005, 0.5)))
        row = truth.image_rows("tie_points")
        places = truth.positions("tie_points")[truth.tie_points["point"].array.codes]
        pixels = np.empty((len(row), 2))
        for k in np.unique(row):
            mine = row == k
            pixels[mine] = own_pixels(places[mine], truth.poses[k], ACTION)
        assert np.abs(pixels - truth.tie_points[["x", "y"]].to_numpy(float)).max() < 1e-8
        block.tie_points = block.tie_points.assign(x=pixels[:, 0], y=pixels[:, 1])
        found = corridor.adjust(block, camera="fisheye")
        assert found.converged and found.check_rms.d3 < 1e-9
        for name in FISHEYE:
            assert found.block.cameras["action"][name] == pytest.approx(ACTION[name], abs=1e-7)

    def test_its_fourth_term_is_free_by_default_and_that_of_an_ordinary_lens_is_not(self):
        assert set(make_problem(flown()).free["action"]) == {*FISHEYE, "p1", "p2"}
        assert "k4" not in make_problem(flown(CAMLIGHT)).free[CAMLIGHT.name]
        held = dataclasses.replace(ACTION, calibrated=True)
        assert make_problem(flown(held)).free["action"] == ()

    def test_without_start_poses_it_ends_at_the_same_place(self):
        block = add_noise(flown(), tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.01, seed=1)
        bare = block.copy()
        bare.images = bare.images.drop(columns=[*"xyz", "qw", "qx", "qy", "qz"])
        bare.points = bare.points.iloc[:0]
        found, other = (corridor.adjust(b, camera="fisheye") for b in (block, bare))
        away = np.linalg.norm(found.state.centre - other.state.centre, axis=1)
        assert other.converged and away.max() < 1e-4

    def test_errors_are_as_large_as_the_covariance_says(self):
        """14 draws of 7 parameters: errors over their covariance are 98 squares, 1 +- 0.14."""
        truth, squares = flown(images=9), []
        true = np.array([ACTION[name] for name in FISHEYE])
        for seed in range(14):
            noise = dict(tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.01, seed=seed)
            found = corridor.adjust(add_noise(truth, **noise), camera="fisheye", lever_arm="fixed")
            off = np.array([found.block.cameras["action"][name] for name in FISHEYE]) - true
            covariance = found.covariance.shared
            assert covariance.shape == (7, 7)
            squares.append(off @ np.linalg.solve(covariance, off) / 7)
        assert np.mean(squares) == pytest.approx(1.0, abs=3 * np.sqrt(2 / 98))

    def test_an_ordinary_lens_beside_it_keeps_its_own(self):
        """One image in two through each: the truth comes back, the models too."""
        truth = flown(start_error=None)
        narrow = dataclasses.replace(
            CAMLIGHT.with_values(f=2400.0, cx=1999.5, cy=1499.5), name="narrow", width=4000,
            height=3000,
        )  # fmt: skip
        block = truth.copy()
        block.cameras["narrow"] = narrow
        block.images["camera"] = np.where(np.arange(len(block.images)) % 2, "action", "narrow")
        from corridor.core.effects.forward import predict

        seen = predict(block)
        for table, pixels in (("tie_points", seen.tie), ("marks", seen.mark)):
            frame = getattr(block, table)
            frame[["x", "y"]] = pixels
            inside = (pixels >= 0).all(1) & (pixels < [4000, 3000]).all(1)
            setattr(block, table, frame[inside].reset_index(drop=True))
        found = corridor.adjust(straightened(block), camera="f,cx,cy,k1,k2,k3,k4,p1,p2")
        assert found.check_rms.d3 < 1e-8
        models = [camera.model for camera in found.block.cameras.values()]
        assert models == ["fisheye", "central"]


@pytest.mark.slow
def test_a_diagnosis_names_a_rolling_shutter_of_ten_sigmas():
    """12 ms, more than ten standard deviations, behind a lens that calibrates itself."""
    from corridor.core.effects.forward import add

    truth = corridor_block(
        images=40, strips=2, observations_per_image=120, seed=3, camera=ACTION, height=30.0,
        attitude_jitter_deg=(1.2, 1.2, 0.3),
    )  # fmt: skip
    shaken = add(truth, {"rolling_shutter": {"readout": 0.012}})
    noisy = add_noise(shaken, tie_px=0.5, mark_px=0.5, gnss_m=0.02, control_m=0.01, seed=1)
    with_it = corridor.adjust(noisy, effects=["rolling_shutter"]).effects
    assert (with_it["value"] / with_it["sigma"]).abs().max() > 10
    quiet = add_noise(truth, tie_px=0.5, mark_px=0.5, gnss_m=0.02, control_m=0.01, seed=1)
    found, nothing = (corridor.diagnose(block).to_dict()["effects"] for block in (noisy, quiet))
    assert [(one["slug"], one["class"]) for one in found] == [("rolling_shutter", "named")]
    assert nothing == []


class TestAWrongLens:
    def test_an_ordinary_lens_stated_as_a_fisheye_is_told_after_the_adjustment(self):
        block = flown(CAMLIGHT)
        block.cameras = {n: c.with_model("fisheye") for n, c in block.cameras.items()}
        block = add_noise(block, tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.01, seed=1)
        found = corridor.adjust(straightened(block))
        told = [s for s in found.warnings if "Is it an ordinary lens?" in s]
        assert len(told) == 1 and "came out as that of a central projection" in told[0]
        right = corridor.adjust(
            add_noise(flown(), tie_px=0.4, mark_px=0.4, seed=1), camera="fisheye"
        )
        assert not [s for s in right.warnings if "lens" in s]

    def test_a_fisheye_stated_as_an_ordinary_lens_is_told_where_start_values_miss(self):
        block = flown()
        block.cameras = {n: c.with_model("central") for n, c in block.cameras.items()}
        problem = make_problem(block)
        told = misfit(LinearSystem(problem, problem.start))
        assert 'model = "fisheye" in [camera.action] of block.toml: which lens is it?' in told[-1]
        problem = make_problem(flown(start_error=(0.5, 0.005, 0.5)))
        assert not [s for s in misfit(LinearSystem(problem, problem.start)) if "lens" in s]

    def test_points_at_90_degrees_are_set_aside_and_the_rest_is_adjusted(self):
        block = flown(start_error=(0.5, 0.005, 0.5))
        theirs = np.linalg.norm(block.numbers("tie_points", "x", "y") - [1990.0, 1510.0], axis=1)
        beyond = theirs > np.quantile(theirs, 0.95)
        # At 95 degrees, in the direction in which they lie.
        away = block.numbers("tie_points", "x", "y")[beyond] - [1990.0, 1510.0]
        away *= (3014.2 / theirs[beyond])[:, None]
        block.tie_points.loc[beyond, ["x", "y"]] = away + [1990.0, 1510.0]
        told = [s for s in plausibility_warnings(block) if "90 degrees" in s]
        assert f"{beyond.sum():,} of " in told[0] and "They are set aside." in told[0]
        found = corridor.adjust(block, camera="fisheye")
        assert found.check_rms.d3 < 1e-8 and told[0] in found.notes
        with pytest.raises(InputError, match="tie_points.csv, row .* 90 degrees"):
            corridor.adjust(block, camera="fisheye", strict=True)

    def test_a_fisheye_that_cannot_see_most_of_its_points_is_wrong_itself(self):
        block = flown()
        block.cameras["action"] = block.cameras["action"].with_values(k1=-0.5)
        told = [s for s in plausibility_warnings(block) if "90 degrees" in s]
        assert told[0].endswith("Correct f and k1..k4 in block.toml.")

    def test_a_focal_length_in_millimetres_is_told_first(self):
        block = flown()
        block.cameras["action"] = dataclasses.replace(
            block.cameras["action"].with_values(f=2.92), pixel_um=1.6
        )
        told = plausibility_warnings(block)
        assert "f is in pixels, 2.92 mm are 1825" in told[0]
        assert not [s for s in told if "90 degrees" in s]
