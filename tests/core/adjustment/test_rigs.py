"""Cameras that hang together, against perfect flights and equations by code of its own."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rigged import HEAD, SIZE, F, exp, mounting, quaternion, rig_table, rigged_block

import corridor
from corridor.core.adjustment import Covariance, Loss, Run, refit
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.ordering import corridor_order
from corridor.core.adjustment.problem import make_problem
from corridor.core.adjustment.rigs import rig_rows
from corridor.core.block import read
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
NOISE = {"tie_px": 0.5, "mark_px": 0.5, "gnss_m": 0.02, "control_m": 0.01}


@pytest.fixture(scope="module")
def block():
    return rigged_block()


def matrix(q):
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def astray(block, seed=3, rows=slice(None)):
    """Start values that miss the truth by decimetres and half a degree, every image for itself."""
    rng, out = np.random.default_rng(seed), block.copy()
    pose = block.poses.copy()
    pose[rows, :3] += rng.normal(0, 0.3, pose[rows, :3].shape)
    pose[rows, 3:] = [quaternion(exp(rng.normal(0, 0.01, 3)) @ matrix(q)) for q in pose[rows, 3:]]
    out.put("images", POSE, pose)
    out.put(
        "points", "xyz", out.numbers("points", *"xyz") + rng.normal(0, 0.5, (len(out.points), 3))
    )
    return out


def off(found, block):
    """Largest errors of positions, m, and of mountings, m and parts of a turn."""
    members = found.block.extra["rig"]["HEAD"]["member"]
    hung = []
    for camera, table in members.items():
        t, m = mounting(camera)
        hung += [np.abs(np.array(table["xyz"]) - t).max(),
                 np.abs(matrix(table["quaternion"]) - m).max()]  # fmt: skip
    return np.abs(found.block.poses[:, :3] - block.poses[:, :3]).max(), max(hung)


class TestPerfectFlights:
    """To nanometres, from start values that miss by decimetres."""

    @pytest.mark.parametrize("stated", [True, False])
    @pytest.mark.parametrize("threads", [1, 2])
    def test_mountings_are_found(self, block, stated, threads):
        start = astray(block)
        start.extra["rig"] = rig_table(stated=stated)
        found = corridor.adjust(start, lever_arm="fixed", threads=threads)
        assert found.converged and max(off(found, block)) < 1e-9

    def test_a_mounting_that_was_stated_wrongly_is_mended(self, block):
        start = astray(block)
        left = start.extra["rig"]["HEAD"]["member"]["left"]
        left["xyz"] = (np.array(left["xyz"]) + [0.03, -0.02, 0.05]).tolist()
        left["quaternion"] = quaternion(exp([0.02, 0.01, -0.03]) @ mounting("left")[1]).tolist()
        found = corridor.adjust(start, lever_arm="fixed")
        assert max(off(found, block)) < 1e-9
        # And the result states it: nothing is left to be added.
        assert found.pose == pytest.approx(found.block.poses, abs=0)
        assert found.poses[["x", "y", "z"]].to_numpy() == pytest.approx(
            block.poses[:, :3], abs=1e-9
        )
        again = corridor.adjust(found.block, lever_arm="fixed")
        assert again.effects["value"].abs().max() < 1e-9
        assert max(off(again, block)) < 1e-9

    def test_an_adjustment_begins_where_another_ended(self, block):
        """Its members hang elsewhere than stated: beside poses that were restated, with the
        mounting at nothing, they would begin centimetres from where they have to hang."""
        start = block.copy()
        left = start.extra["rig"]["HEAD"]["member"]["left"]
        left["xyz"] = (np.array(left["xyz"]) + [0.03, -0.02, 0.05]).tolist()
        model = replace(corridor.adjust(block, lever_arm="fixed").problem.model, lever_arm="fixed")
        found = refit(start, model, Run())
        ended, values = found.as_left(["mounting"])
        shift = [values[f"mounting.left.{axis}"] for axis in "xyz"]
        assert np.linalg.norm(shift) == pytest.approx(np.linalg.norm([0.03, -0.02, 0.05]), rel=1e-6)
        there, restated = (
            refit(replace(start, images=at.images, points=ended.points), one, Run(), near=True)
            for at, one in ((ended, model.starting(values)), (found.start_again, model))
        )
        assert there.history[0]["step"] < 1e-6 < 0.1 < restated.history[0]["step"]

    def test_exposures_may_lack_a_member_or_the_base(self):
        lacking = {(1, "left"), (4, "nadir"), (6, "right"), (6, "left"), (8, "nadir")}
        block = rigged_block(lacking=lacking)
        found = corridor.adjust(astray(block), lever_arm="fixed")
        assert max(off(found, block)) < 1e-9

    def test_members_need_no_start_values_of_their_own(self, block):
        start = block.copy()
        start.images.loc[start.images["camera"] != "nadir", POSE] = np.nan
        found = corridor.adjust(start, lever_arm="fixed")
        assert max(off(found, block)) < 1e-9

    def test_exact_mountings_are_held(self, block):
        start = astray(block)
        start.extra["rig"] = rig_table(sigma_m=0.0, sigma_deg=0.0)
        found = corridor.adjust(start, lever_arm="fixed")
        assert not len(found.effects) and off(found, block)[0] < 1e-9

    def test_without_gnss_and_control_a_rig_keeps_its_scale(self, block):
        """Exact mountings: the network is laid on its start by a motion that is rigid."""
        start = block.copy()
        start.extra["rig"] = rig_table(sigma_m=0.0, sigma_deg=0.0)
        start.gnss, start.ground = start.gnss.iloc[:0], start.ground.iloc[:0]
        start.marks = start.marks.iloc[:0]
        found = corridor.adjust(start)
        assert off(found, block)[0] < 1e-5


class TestEquations:
    def test_derivatives(self, block):
        """Central differences, at poses that hang together badly."""
        problem = make_problem(astray(block))
        state = problem.start
        rows, h = rig_rows(problem, state), 1e-6
        assert np.abs(rows.residual).max() > 0.1
        for pair in range(6):
            for side, by in ((0, rows.first), (1, rows.second)):
                one = problem.rig_image[pair, side]
                for k in range(6):
                    change = []
                    for sign in (h, -h):
                        centre, rotation = state.centre.copy(), state.rotation.copy()
                        if k < 3:
                            centre[one, k] += sign
                        else:
                            rotation[one] = exp(sign * np.eye(3)[k - 3]) @ rotation[one]
                        moved = replace(state, centre=centre, rotation=rotation)
                        change.append(rig_rows(problem, moved).residual[pair])
                    numeric = (change[1] - change[0]) / (2 * h)
                    assert by[pair, :, k] == pytest.approx(numeric, abs=1e-7)

    def test_band_and_sparse_storage_hold_the_same(self, block):
        problem = make_problem(block)
        matrices = []
        for storage in ("band", "sparse"):
            normal = Normal(problem, LinearSystem(problem, problem.start).loss, storage=storage)
            normal.assemble(problem.start, 0.0)
            matrices.append(normal.blocks.symmetric().toarray())
        assert matrices[0] == pytest.approx(matrices[1], rel=1e-12)

    @pytest.mark.parametrize(("effects", "size"), [([], 6), (["focal@image"], 9)])
    def test_an_exposure_has_one_pose(self, effects, size):
        """And the focal lengths that its three images have for themselves."""
        lacking = {(1, "left"), (4, "nadir")}
        block = add_noise(rigged_block(exposures=6, points=400, lacking=lacking), **NOISE, seed=1)
        found = corridor.adjust(block, lever_arm="fixed", effects=effects)
        p, system = found.problem, LinearSystem(found.problem, found.state)
        covariance = Covariance(system)
        assert p.image_count == 16 and Normal(p, Loss()).blocks.n == size * 6
        # Members stand where their exposure has them, and are as accurate as all equations say.
        hung = rig_rows(p, found.state).residual
        assert np.abs(hung).max() < 1e-12
        each = covariance.each_pose
        for image in range(p.image_count):
            alone = covariance.poses(np.array([image]))
            assert each[image] == pytest.approx(alone, abs=1e-9 * np.diag(alone).max())
        together = np.flatnonzero(p.exposure == p.exposure[-1])
        both = covariance.poses(together)
        assert covariance.of_images(together) == pytest.approx(both, abs=1e-9 * both.max())
        # N of images, in which they are held together to a micrometre, says the same.
        size = np.sqrt(system.reference)
        dense = np.linalg.inv(system.matrix.toarray() / size[:, None] / size) / size[:, None] / size
        image = np.arange(p.d) + p.d * together[-1]
        sigma = np.sqrt(np.diag(each[together[-1]]))
        off = (dense[np.ix_(image, image)] - each[together[-1]]) / sigma[:, None] / sigma
        assert np.abs(off).max() < 1e-4

    def test_sigmas_are_those_of_one_pose_an_exposure(self):
        """Equations by code of its own: six unknowns an exposure, six a member, three a point."""
        block = rigged_block(exposures=6, points=260, seed=2)
        found = corridor.adjust(block, lever_arm="fixed")
        sigma = found.effects.set_index(["group", "parameter"])["sigma"] / found.sigma0
        mine = own_sigmas(block)
        for (camera, name), value in mine.items():
            assert sigma[camera, name] == pytest.approx(value, rel=2e-4)

    def test_errors_are_as_large_as_their_sigmas(self, block):
        """RMS of 25 draws; their own spread is 14 % each, 4 % of all together."""
        off = []
        for seed in range(25):
            found = corridor.adjust(add_noise(block, **NOISE, seed=seed), lever_arm="fixed",
                                    weights="stated")  # fmt: skip
            off.append(found.effects["value"] / (found.effects["sigma"] / found.sigma0))
        rms = np.sqrt(np.mean(np.square(off), axis=0))
        assert np.sqrt(np.mean(rms**2)) == pytest.approx(1.0, abs=0.15)
        assert rms.max() < 1.7 and rms.min() > 0.5

    def test_a_prior_counts_as_it_is_stated(self, block):
        noisy = add_noise(block, **NOISE, seed=1)
        noisy.extra["rig"] = rig_table(sigma_m=1e-5, sigma_deg=0.0)
        found = corridor.adjust(noisy, lever_arm="fixed")
        sigma = found.effects.set_index(["group", "parameter"])["sigma"]
        assert 0.9e-5 < sigma["left", "x"] / found.sigma0 < 1.01e-5
        assert sigma["left", "turn_x"] < 1e-8

    def test_a_rig_is_more_accurate_than_cameras_that_fly_apart(self, block):
        noisy = add_noise(block, **NOISE, seed=2)
        free = noisy.copy()
        free.extra = {}
        one, other = (corridor.adjust(b, lever_arm="fixed") for b in (noisy, free))
        assert np.median(one.poses["sz"]) < np.median(other.poses["sz"])
        assert one.check_points["sz"].mean() <= other.check_points["sz"].mean() * 1.001


def own_sigmas(block):
    """Standard deviations of the mountings: central differences of a projection of its own."""
    images = block.images
    shots = list(dict.fromkeys(images["exposure"]))
    cameras = list(HEAD)
    points = pd.concat([block.points, block.ground])[["point", "x", "y", "z"]]
    names = points["point"].tolist()
    xyz = points[["x", "y", "z"]].to_numpy(float)
    base = images[images["camera"] == "nadir"].set_index("exposure")
    rotations = {s: matrix(base.loc[s, ["qw", "qx", "qy", "qz"]].to_numpy(float)) for s in shots}
    n = 6 * len(shots) + 6 * len(cameras) + 3 * len(names)
    rows = pd.concat([block.tie_points, block.marks])
    row_of = {row.image: row for row in images.itertuples()}
    centres = {s: base.loc[s, ["x", "y", "z"]].to_numpy(float) for s in shots}
    hung = {camera: mounting(camera) for camera in cameras}
    first_point = 6 * len(shots) + 6 * len(cameras)

    def project(row, shift):
        """Pixel with the unknowns moved; a mounting's shift and turn are in its own frame."""
        image = row_of[row.image]
        s, at = image.exposure, 6 * shots.index(image.exposure)
        move = shift[at : at + 6]
        r = exp(move[3:]) @ rotations[s] if move[3:].any() else rotations[s]
        c = centres[s] + move[:3]
        if image.camera != "nadir":
            t, m = hung[image.camera]
            at = 6 * len(shots) + 6 * cameras.index(image.camera)
            a, w = shift[at : at + 3], shift[at + 3 : at + 6]
            c = c + r.T @ (t + m.T @ a)
            r = exp(-w) @ m @ r if w.any() else m @ r
        number = names.index(row.point)
        at = first_point + 3 * number
        x, y, z = r @ (xyz[number] + shift[at : at + 3] - c)
        return np.array([F * x / z, F * y / z]) + (np.array(SIZE) - 1) / 2

    normal = np.zeros((n, n))
    for row in rows.astype({"point": str, "image": str}).itertuples():
        image = row_of[row.image]
        at = list(range(6 * shots.index(image.exposure), 6 * shots.index(image.exposure) + 6))
        if image.camera != "nadir":
            begin = 6 * len(shots) + 6 * cameras.index(image.camera)
            at += list(range(begin, begin + 6))
        begin = first_point + 3 * names.index(row.point)
        at += list(range(begin, begin + 3))
        jacobian = np.empty((2, len(at)))
        for k, one in enumerate(at):
            step = np.zeros(n)
            step[one] = 1e-5
            jacobian[:, k] = (project(row, step) - project(row, -step)) / 2e-5
        normal[np.ix_(at, at)] += jacobian.T @ jacobian / 0.5**2
    for k in range(len(shots)):
        normal[6 * k + np.arange(3), 6 * k + np.arange(3)] += 0.02**-2
    for name, role in zip(block.ground["point"], block.ground["role"], strict=True):
        if role == "control":
            at = first_point + 3 * names.index(name) + np.arange(3)
            normal[at, at] += 0.01**-2
    sigma = np.sqrt(np.diag(np.linalg.inv(normal)))
    labels = ["x", "y", "z", "turn_x", "turn_y", "turn_z"]
    return {
        (camera, label): sigma[6 * len(shots) + 6 * k + n]
        for k, camera in enumerate(cameras)
        for n, label in enumerate(labels)
    }


class TestInvariance:
    def test_the_world_may_be_moved_and_turned(self, block):
        noisy = add_noise(block, **NOISE, seed=4)
        turn, shift = exp([0.3, -0.2, 1.0]), np.array([100.0, -50.0, 20.0])
        other = noisy.copy()
        for table in ("images", "points", "ground", "gnss"):
            other.put(table, "xyz", other.numbers(table, *"xyz") @ turn.T + shift)
        other.put("images", POSE[3:], [quaternion(matrix(q) @ turn.T) for q in block.poses[:, 3:]])
        # Sigmas that are the same in every direction.
        for b in (noisy, other):
            b.sigma["gnss_m"] = np.full(3, 0.02)
        one, two = (corridor.adjust(b, lever_arm="fixed") for b in (noisy, other))
        assert two.sigma0 == pytest.approx(one.sigma0, rel=1e-8)
        # The iterations stop at a thousandth of a sigma.
        off = (two.effects["value"] - one.effects["value"]) / one.effects["sigma"]
        assert off.abs().max() < 1e-3

    def test_the_order_of_the_rows_does_not_matter(self, block):
        noisy = add_noise(block, **NOISE, seed=5)
        other = noisy.with_(images=noisy.images.sample(frac=1, random_state=1))
        one, two = (corridor.adjust(b, lever_arm="fixed").effects for b in (noisy, other))
        assert two["value"].to_numpy() == pytest.approx(one["value"].to_numpy(), abs=1e-9)

    def test_which_camera_is_the_base_does_not_matter(self, block):
        """The same head told from `left`. Without GNSS, which is the base's."""
        noisy = add_noise(block, **NOISE, seed=6)
        noisy.gnss, noisy.ground["role"] = noisy.gnss.iloc[:0], "control"
        other = noisy.copy()
        t, m = mounting("left")
        told = {"nadir": (-m @ t, m.T), "right": None}
        tr, mr = mounting("right")
        told["right"] = (m @ (tr - t), mr @ m.T)
        other.extra["rig"] = {"HEAD": {"base": "left", "member": {
            camera: {"xyz": place.tolist(), "quaternion": quaternion(rotation).tolist()}
            for camera, (place, rotation) in told.items()
        }}}  # fmt: skip
        one, two = (corridor.adjust(b, lever_arm="fixed") for b in (noisy, other))
        assert two.sigma0 == pytest.approx(one.sigma0, rel=1e-7)
        assert two.block.poses == pytest.approx(one.block.poses, abs=2e-5)


class TestFiles:
    def test_a_rig_is_written_and_read(self, block, tmp_path):
        block.write(tmp_path / "b")
        again = read(tmp_path / "b")
        assert again.extra["rig"] == block.extra["rig"]
        assert again.images["exposure"].tolist() == block.images["exposure"].tolist()
        found = corridor.adjust(again, lever_arm="fixed")
        assert found.problem.rig_image.shape == (20, 2)

    def test_a_part_keeps_what_still_hangs_together(self, block):
        nadir = block.images.loc[block.images["camera"] == "nadir", "image"]
        assert "rig" not in block.select(images=nadir).extra
        two = block.images.loc[block.images["camera"] != "left", "image"]
        part = block.select(images=two)
        assert list(part.extra["rig"]["HEAD"]["member"]) == ["right"]
        part.check()

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda rig, b: rig.pop("base"), r'\[rig.HEAD\] needs base = "CAMERA"'),
            (
                lambda rig, b: rig.update(base="none"),
                "names camera none, which block.toml does not",
            ),
            (lambda rig, b: rig["member"].update(nadir={}), "nadir, which rig HEAD has"),
            (lambda rig, b: rig["member"]["left"].pop("xyz"), "given in part"),
            (lambda rig, b: rig["member"]["left"].update(xyz=[1, 2]), "xyz = .* is not 3 numbers"),
            (
                lambda rig, b: rig["member"]["left"].update(quaternion=[1, 1, 0, 0]),
                "length .* is not 1",
            ),
            (lambda rig, b: rig["member"]["left"].update(sigma_m=-1.0), "0 or larger"),
            (lambda rig, b: rig["member"]["left"].update(x=1.0), "has no x: use xyz"),
            (
                lambda rig, b: b.images.__setitem__("exposure", "E0"),
                "exposure E0 has camera .* twice",
            ),
        ],
    )
    def test_wrong_tables_are_refused(self, block, change, words):
        wrong = block.copy()
        change(wrong.extra["rig"]["HEAD"], wrong)
        with pytest.raises(InputError, match=words):
            wrong.check()

    def test_a_mounting_that_nothing_says_is_asked_for(self, block):
        wrong = block.copy()
        wrong.extra["rig"] = rig_table(stated=False)
        wrong.images.loc[wrong.images["camera"] == "left", POSE] = np.nan
        with pytest.raises(InputError, match="left.* has no xyz and quaternion, and no exposure"):
            corridor.adjust(wrong)


def test_exposures_of_cameras_that_look_ahead_are_in_order():
    """A camera that looks 20 exposures ahead, and shares no point with the one below."""
    count = 100
    exposure = np.arange(count)
    image = np.tile(np.concatenate([exposure[:-1], exposure[1:]]), 2).astype(np.int32)
    point = np.concatenate([exposure[:-1]] * 2 + [exposure[:-1] + count - 1] * 2).astype(np.int32)
    place = np.concatenate([exposure[:-1], 20 + exposure[:-1]])
    rank = np.argsort(corridor_order(point, image, place[:, None] * [1.0, 0.0, 0.0], count))
    assert np.abs(np.diff(rank)).max() == 1
