"""Attitudes as observations, with truth by code of its own: matrix exponentials and hand-worked
directions, no rotation of the package."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm
from strips import CAMLIGHT, corridor_block

import corridor
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.measured_poses import pose_rows
from corridor.core.adjustment.normal import moved_state
from corridor.core.adjustment.problem import make_problem
from corridor.core.block import Block, read
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

SIGMA_DEG = (0.05, 0.07, 0.2)


def turned(vector):
    """Exp of a vector (3,), rad, by the series of the matrix."""
    x, y, z = vector
    return expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def matrix(qw, qx, qy, qz):
    """Rotation of a unit quaternion, written out."""
    return np.array(
        [
            [1 - 2 * (qy**2 + qz**2), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)],
            [2 * (qx * qy + qw * qz), 1 - 2 * (qx**2 + qz**2), 2 * (qy * qz - qw * qx)],
            [2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx**2 + qy**2)],
        ]
    )


def angles_of(rotation, frame="body"):
    """Roll, pitch, yaw of a camera, by its axes in the world."""
    right, down, axis = rotation
    ahead, side, below = (-down, right, axis) if frame == "body" else (axis, right, down)
    yaw = np.arctan2(ahead[0], ahead[1])
    pitch = np.arcsin(ahead[2])
    level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    roll = np.arctan2(-side[2] / np.cos(pitch), side @ level) if frame == "body" else 0.0
    return np.degrees([roll, pitch, yaw])


def with_attitudes(block, boresight=(0.0, 0.0, 0.0)):
    """The block with attitudes as an IMU turned by a boresight, for each flight, has them."""
    out = block.copy()
    by_flight = np.broadcast_to(boresight, (len(block.flight_names), 3))
    rows = []
    for k, row in enumerate(block.images.itertuples()):
        true = matrix(row.qw, row.qx, row.qy, row.qz)
        measured = turned(-by_flight[block.image_flight[k]]) @ true
        rows.append((row.image, *angles_of(measured)))
    out.attitudes = pd.DataFrame(rows, columns=["image", "roll", "pitch", "yaw"])
    out.extra["attitudes"] = {"frame": "body"}
    out = out.with_()
    out.sigma["attitude_deg"] = np.array(SIGMA_DEG)
    out.check()
    return out


def flown(images=18, strips=2, **options):
    camera = replace(CAMLIGHT, calibrated=True)
    said = {"attitude_jitter_deg": 4.0, "relief": 5.0, "observations_per_image": 90, "seed": 3}
    return corridor_block(images, strips, camera=camera, **(said | options))


@pytest.fixture(scope="module")
def block():
    return flown()


class TestWhatTheAnglesMean:
    """Directions that anybody can check with the hands; north is y, east x."""

    @pytest.mark.parametrize(
        ("frame", "angles", "top", "axis"),
        [
            # Flying north, level: the top of the picture is north, the camera looks down.
            ("body", (0, 0, 0), (0, 1, 0), (0, 0, -1)),
            ("body", (0, 0, 90), (1, 0, 0), (0, 0, -1)),
            # Nose up by 30 degrees: the camera looks ahead.
            ("body", (0, 30, 0), (0, 0.8660254, 0.5), (0, 0.5, -0.8660254)),
            # Right wing down by 30: it looks to the left.
            ("body", (30, 0, 0), (0, 1, 0), (-0.5, 0, -0.8660254)),
            # A gimbal that looks at the horizon in the west, one that looks down.
            ("camera", (0, 0, 270), (0, 0, 1), (-1, 0, 0)),
            ("camera", (0, -90, 90), (1, 0, 0), (0, 0, -1)),
            ("camera", (0, -60, 0), (0, 0.8660254, 0.5), (0, 0.5, -0.8660254)),
        ],
    )
    def test_roll_pitch_yaw(self, block, frame, angles, top, axis):
        found = self.rotation(
            block, frame, dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
        )
        assert -found[1] == pytest.approx(top, abs=1e-7)
        assert found[2] == pytest.approx(axis, abs=1e-7)

    def test_omega_phi_kappa(self, block):
        """omega about x: a positive one turns y up, so the camera looks north (Kraus 1993)."""
        found = self.rotation(block, None, {"omega": 30.0, "phi": 0.0, "kappa": 0.0})
        assert found[2] == pytest.approx((0, 0.5, -0.8660254), abs=1e-7)
        # kappa counts from east over north: the top of the picture turns to the west.
        found = self.rotation(block, None, {"omega": 0.0, "phi": 0.0, "kappa": 90.0})
        assert -found[1] == pytest.approx((-1, 0, 0), abs=1e-7)

    def rotation(self, block, frame, cells):
        some = block.copy()
        name = block.images["image"].iloc[0]
        some.attitudes = pd.DataFrame(
            {"image": [name], **{k: [float(v)] for k, v in cells.items()}}
        )
        some.extra["attitudes"] = {"frame": frame} if frame else {}
        return some.with_().attitude_rotations[0]

    @pytest.mark.parametrize("frame", ["body", "camera"])
    def test_what_is_written_is_read_and_every_form_says_the_same(self, block, frame, tmp_path):
        rng = np.random.default_rng(1)
        some = block.copy()
        names = block.images["image"].iloc[:6]
        wanted = np.array([turned(rng.uniform(-2, 2, 3)) for _ in names])
        for form in (("roll", "pitch", "yaw"), ("omega", "phi", "kappa"), ("qw", "qx", "qy", "qz")):
            empty = dict.fromkeys(form, np.ones(len(names)))
            some.attitudes = pd.DataFrame({"image": names, **empty})
            some.extra["attitudes"] = {"frame": frame}
            some = some.with_()
            some.put_attitudes(wanted)
            some.write(tmp_path / form[0])
            assert read(tmp_path / form[0]).attitude_rotations == pytest.approx(wanted, abs=1e-12)


class TestDerivatives:
    def test_by_the_pose_and_by_effects(self, block):
        """Central differences, far from the solution and beside a boresight of a radian."""
        measured = with_attitudes(block, (0.4, -0.3, 0.9))
        problem = make_problem(measured, effects=["gimbal_lag"])
        rng = np.random.default_rng(2)
        state = problem.start
        for values in state.effects.values():
            values[:] = rng.uniform(-0.5, 0.5, values.shape)
        rows = pose_rows("attitude", problem, state, problem.images)
        assert np.abs(rows.residual).max() > 0.3
        step, q = 1e-6, problem.shared_count

        def residual(own, shared):
            at = moved_state(problem, state, own, shared, state.points)
            images = problem.images.with_poses(at.centre, at.rotation)
            return pose_rows("attitude", problem, at, images).residual

        for k in range(6):
            own = np.zeros((problem.image_count, problem.d))
            own[:, k] = step
            change = residual(own, np.zeros(q)) - residual(-own, np.zeros(q))
            assert rows.own[:, :, k] == pytest.approx(-change / (2 * step), abs=1e-7)
        for k in range(q):
            shared, own = step * np.eye(q)[k], np.zeros((problem.image_count, problem.d))
            change = residual(own, shared) - residual(own, -shared)
            assert rows.shared[:, :, k] == pytest.approx(-change / (2 * step), abs=1e-7)


def test_a_perfect_block_comes_back_to_nanometres_with_the_boresight_of_each_flight(block):
    truth = np.array([[0.02, -0.03, 0.1], [-0.4, 0.3, 1.2]])
    perfect = flown(flights=2)
    start = flown(flights=2, start_error=(0.5, 0.01, 1.0))
    start.attitudes = with_attitudes(perfect, truth).attitudes
    start.extra["attitudes"] = {"frame": "body"}
    found = corridor.adjust(start.with_(), lever_arm="fixed")
    assert found.converged
    assert found.pose[:, :3] == pytest.approx(perfect.poses[:, :3], abs=2e-9)
    assert found.check_points[["dx", "dy", "dz"]].abs().to_numpy().max() < 2e-9
    boresight = found.effects.pivot(index="group", columns="parameter", values="value")
    assert boresight.to_numpy() == pytest.approx(truth, abs=1e-10)
    assert found.residuals["attitude"][["vx", "vy", "vz"]].abs().to_numpy().max() < 1e-8


def test_a_straight_line_of_positions_is_held_by_attitudes():
    """One strip: its roll about the line is open, and no strip geometry gives it."""
    # Nobody measured any of its ground.
    line = flown(9, 1, control=0, check=4, attitude_jitter_deg=2.0, lever_arm=(0.0, 0.0, 0.0))
    line.gnss[["y", "z"]] = [0.0, 50.0]
    line.images[["y", "z"]] = [0.0, 50.0]
    line = corridor.effects.add(line, {}).with_()
    seen = corridor.effects.predict(line)
    line.tie_points[["x", "y"]], line.marks[["x", "y"]] = seen.tie, seen.mark
    with pytest.raises(InputError, match=r"[Rr]otation about x.* cannot be determined"):
        corridor.adjust(line, lever_arm="fixed")
    held = with_attitudes(line)
    held.extra["attitudes"]["calibrated"] = True
    found = corridor.adjust(held, lever_arm="fixed")
    assert found.check_points[["dx", "dy", "dz"]].abs().to_numpy().max() < 1e-6


def test_errors_are_as_large_as_their_sigmas():
    """RMS of 40 draws of heights, positions and boresights over their sigmas; their own spread
    is 6 %."""
    truth = (0.01, -0.02, 0.03)
    perfect = with_attitudes(flown(12, 2, control=0, check=5, gnss=True), truth)
    off = []
    for seed in range(40):
        noisy = add_noise(
            perfect, tie_px=0.5, mark_px=0.5, gnss_m=0.03, attitude_deg=SIGMA_DEG, seed=seed
        )
        found = corridor.adjust(noisy, lever_arm="fixed", weights="stated")
        points, effects = found.check_points, found.effects
        off.append(np.concatenate([
            (points[["dx", "dy", "dz"]] / (points[["sx", "sy", "sz"]].to_numpy() / found.sigma0)
             ).to_numpy().ravel(),
            (effects["value"] - np.array(truth)) / (effects["sigma"] / found.sigma0),
        ]))  # fmt: skip
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.mean(rms) == pytest.approx(1.0, abs=0.12)
    # Each over 40 draws: 11 % is one sigma of an RMS.
    assert rms.max() < 1.5 and rms.min() > 0.6


class TestInvariance:
    def test_the_world_may_be_turned(self, block):
        """About the vertical: yaws count from another north, and nothing else changes."""
        noisy = add_noise(with_attitudes(block), tie_px=0.5, gnss_m=0.02, attitude_deg=0.1, seed=1)
        a = np.radians(63.0)
        turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        other = noisy.copy()
        other.attitudes["yaw"] -= 63.0
        for table in ("images", "points", "ground", "gnss"):
            other.put(table, "xyz", other.numbers(table, *"xyz") @ turn.T)
        half = np.array([np.cos(a / 2), 0, 0, -np.sin(a / 2)])
        q = noisy.numbers("images", "qw", "qx", "qy", "qz")
        w, x, y, z = q.T
        s = half[3]
        other.put("images", ("qw", "qx", "qy", "qz"), np.stack(
            [w * half[0] - z * s, x * half[0] + y * s, y * half[0] - x * s, z * half[0] + w * s],
            axis=1,
        ))  # fmt: skip
        other.images = other.images.drop(columns=["vx", "vy", "vz"])
        one, two = (corridor.adjust(b.with_(), lever_arm="fixed") for b in (noisy, other))
        assert two.sigma0 == pytest.approx(one.sigma0, rel=1e-9)
        axes = ["vx", "vy", "vz"]
        left = (f.residuals["attitude"][axes].to_numpy() for f in (one, two))
        assert next(left) == pytest.approx(next(left), abs=1e-7)

    def test_the_form_of_the_file_does_not_matter(self, block):
        noisy = add_noise(with_attitudes(block), tie_px=0.5, attitude_deg=0.1, seed=2)
        other = noisy.copy()
        other.attitudes = noisy.attitudes[["image"]].assign(omega=0.0, phi=0.0, kappa=0.0)
        other = other.with_()
        other.put_attitudes(noisy.attitude_rotations)
        one, two = (corridor.adjust(b, lever_arm="fixed") for b in (noisy, other))
        assert two.sigma0 == pytest.approx(one.sigma0, rel=1e-9)
        assert two.pose == pytest.approx(one.pose, abs=1e-8)


class TestNoise:
    def test_it_is_drawn_about_level_axes_with_the_sigmas_that_are_asked_for(self):
        perfect = with_attitudes(flown(60, 2, observations_per_image=20))
        noisy = add_noise(perfect, attitude_deg=SIGMA_DEG, seed=4)
        away = noisy.attitude_rotations @ perfect.attitude_rotations.transpose(0, 2, 1)
        # In the world, then about the heading (here all strips head along x or against it).
        small = (
            np.array([[m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]] for m in away]) / 2
        )
        world = np.einsum("nji,nj->ni", perfect.attitude_rotations, small)
        rms = np.degrees(np.sqrt(np.mean(world**2, axis=0)))
        assert rms == pytest.approx(SIGMA_DEG, rel=4 / np.sqrt(2 * 60))
        assert noisy.sigma["attitude_deg"] == pytest.approx(SIGMA_DEG)


@pytest.fixture(scope="module")
def found(block):
    noisy = add_noise(
        with_attitudes(block, (0.01, 0.02, 0.03)), tie_px=0.5, mark_px=0.5,
        gnss_m=0.02, control_m=0.01, attitude_deg=SIGMA_DEG, seed=5,
    )  # fmt: skip
    return corridor.adjust(noisy)


class TestWhatIsTold:
    def test_residuals_counts_and_components(self, found):
        table = found.residuals["attitude"]
        assert len(table) == len(found.start.images)
        assert found.statistics["attitude"]["sigma0"] == pytest.approx(1.0, abs=0.3)
        assert found.observations.loc["attitude", "rms_yaw_deg"] > 0.05
        parts = found.variance_components.query("kind == 'attitude'")
        assert set(parts["part"]) == {"roll and pitch", "yaw"}
        assert (parts["p"] > 1e-3).all()
        assert "attitudes" in str(found)
        assert found.to_dict()["observations"]["attitude"]["count"] == len(table)

    def test_redundancies_add_up(self, found):
        """Those of all kinds are what observations have more than unknowns."""
        parts = found.variance_components
        assert parts["redundancy"].sum() == pytest.approx(found.redundancy, rel=1e-9)
        share = found.reliability.attitude["redundancy"]
        assert 0 < share.min() and share.max() < 1

    def test_a_redundancy_is_what_an_error_leaves(self, found):
        """The attitude of one image changed by a small turn about the vertical, and adjusted."""
        share = found.reliability.attitude
        image = share["image"].iloc[6]
        part = share["redundancy"][(share["image"] == image) & (share["axis"] == "z")].iloc[0]
        moved = found.start.copy()
        rows = moved.attitudes["image"] == image
        moved.attitudes.loc[rows, "yaw"] += 0.02
        again = corridor.adjust(moved)
        before, after = (f.residuals["attitude"].set_index("image").loc[image, "vz"]
                         for f in (found, again))  # fmt: skip
        assert (after - before) / 0.02 == pytest.approx(part, abs=0.02)

    def test_what_comes_with_attitudes_is_not_called_superfluous(self, block):
        found = corridor.adjust(with_attitudes(block))
        assert len(found.effects) == 3
        assert not any("is not shown by this block" in sentence for sentence in found.warnings)

    def test_a_wrong_frame_is_told(self, block):
        wrong = with_attitudes(block)
        wrong.extra["attitudes"] = {"frame": "camera"}
        found = corridor.adjust(wrong.with_())
        assert any("correct frame in [attitudes]" in sentence for sentence in found.warnings)

    def test_without_attitudes_nothing_is_said_of_them(self, block):
        found = corridor.adjust(block)
        assert "attitude" not in found.statistics and not len(found.effects)
        assert "rms_yaw_deg" not in found.observations


class TestWrongInput:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda b: b.extra.pop("attitudes"),
             'frame is not stated in .attitudes.*frame = "body"'),
            (lambda b: b.extra.update(attitudes={"frame": "plane"}), "frame = 'plane' is unknown"),
            (lambda b: b.extra.update(attitudes={"frame": "body", "calibrated": "yes"}),
             "calibrated = true or false"),
            (lambda b: b.attitudes.pop("yaw"), "no whole form of an attitude"),
            (lambda b: b.put("attitudes", ["omega", "phi", "kappa"], np.zeros((18, 3))),
             "several forms"),
            (lambda b: b.put("attitudes", ["syaw"], np.zeros((18, 1))),
             "syaw = 0 is not a standard"),
            (lambda b: b.attitudes.__setitem__("image", ["nobody"] + ["A"] * 17),
             "'nobody' is not in images.csv"),
            (lambda b: b.attitudes.__setitem__("image", [b.images["image"].iloc[0]] * 18),
             "attitudes.csv, row 3: image .* stands already"),
            (lambda b: b.attitudes.__setitem__("pitch", [np.nan] + [0.0] * 17),
             "row 2: the attitude is given in part, pitch is missing"),
        ],
    )  # fmt: skip
    def test_it_is_refused_with_the_file_and_what_to_do(self, block, change, words):
        wrong = with_attitudes(block)
        change(wrong)
        with pytest.raises(InputError, match=words):
            wrong.with_().check()

    def test_rows_without_an_attitude_are_left_out(self, block):
        part = with_attitudes(block)
        part.attitudes.loc[2:5, ["roll", "pitch", "yaw"]] = np.nan
        part.check()
        found = corridor.adjust(part)
        assert len(found.residuals["attitude"]) == len(block.images) - 4

    def test_a_part_of_the_block_keeps_its_attitudes(self, block):
        names = block.images["image"].iloc[:7]
        assert with_attitudes(block).select(images=names).attitudes["image"].tolist() == list(names)


def test_without_control_or_gnss_attitudes_turn_the_free_network(block):
    """Position and scale stay those of the start, its rotation does not."""
    free = with_attitudes(block)
    free.extra["attitudes"]["calibrated"] = True
    free.gnss, free.ground = free.gnss.iloc[:0], free.ground.iloc[:0]
    free.marks = free.marks.iloc[:0]
    tilted = free.copy()
    a = 0.05
    turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    for table in ("images", "points"):
        tilted.put(table, "xyz", tilted.numbers(table, *"xyz") @ turn.T)
    found = corridor.adjust(tilted.with_())
    truth = np.array([matrix(*q) for q in block.poses[:, 3:]])
    mine = np.array([matrix(*q) for q in found.pose[:, 3:]])
    assert mine == pytest.approx(truth, abs=1e-8)


def test_a_system_of_turned_measurements_is_that_of_their_residuals(block):
    """`measuring(attitude=...)`: what replicates are drawn with."""
    system = LinearSystem(*(lambda p: (p, p.start))(make_problem(with_attitudes(block))))
    turn = 1e-4 * np.random.default_rng(0).standard_normal((len(block.images), 3))
    again = system.measuring(attitude=turn).residuals().attitude
    assert again - system.residuals().attitude == pytest.approx(turn, abs=1e-9)
    assert isinstance(system.block, Block)


def test_a_clock_late_by_100_ms_at_10_degrees_a_second_misses_by_one_degree():
    """The camera turns clockwise seen from above, about its own axis: its attitude stays behind."""
    block = flown(4, 1, attitude_jitter_deg=0.0)
    some = with_attitudes(block)
    some.images[["wx", "wy"]], some.images["wz"] = 0.0, np.radians(10.0)
    moved = corridor.effects.add(some, {"attitude_clock_offset": {"offset": 0.1}})
    change = (moved.attitudes["yaw"] - some.attitudes["yaw"]).to_numpy()
    assert (change + 180) % 360 - 180 == pytest.approx(np.full(4, -1.0), abs=1e-9)
    lagging = corridor.effects.add(some, {"gimbal_lag": {"z": 0.1, "x": 5.0}})
    assert lagging.attitude_rotations == pytest.approx(moved.attitude_rotations, abs=1e-12)
