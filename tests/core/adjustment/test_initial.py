"""Start values are near the truth, whatever is missing; what is given stays."""

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import complete
from corridor.core.camera import Camera, project
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion, similarity
from corridor.core.simulation import CAMLIGHT, add_noise

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
NOISE = {"tie_px": 0.5, "mark_px": 0.5, "gnss_m": 0.02, "control_m": 0.01}


def without(block, poses=None, points=True, ground=False, gnss=False):
    """The block without the poses of some images (rows), points, ground points, antennas."""
    block = block.copy()
    if poses is not None:
        images = block.images.copy()
        images.loc[poses, POSE] = np.nan
        block.images = images
    if points:
        block.points = block.points[:0]
    if ground:
        block.marks, block.ground = block.marks[:0], block.ground[:0]
    if gnss:
        block.gnss = block.gnss[:0]
    return block


def every(block):
    return np.ones(len(block.images), dtype=bool)


def misses(found, true, free=False):
    """Largest error of a centre (m) and of an angle (rad); free: after a similarity."""
    poses = [b.images[POSE].to_numpy() for b in (found, true)]
    centre, aim = (pose[:, :3] for pose in poses)
    rotation, right = (rotation_from_quaternion(pose[:, 3:]) for pose in poses)
    if free:
        frame = similarity(centre, aim)
        centre, rotation = frame.apply(centre), frame.apply_to_rotations(rotation)
    turn = np.linalg.norm(rotation - right, axis=(1, 2)) / np.sqrt(2)
    return np.linalg.norm(centre - aim, axis=1).max(), turn.max()


@pytest.fixture(scope="module")
def perfect():
    return corridor_block(seed=2)


@pytest.fixture(scope="module")
def noisy(perfect):
    return add_noise(perfect, **NOISE, outliers=0.02, seed=2)


class TestWithoutNoise:
    """Rounding of 1e-16 in the rays, a thousandfold by the chain, stays below a micrometre."""

    def test_poses_come_from_marks(self, perfect):
        found = complete(without(perfect, every(perfect), gnss=True))
        assert max(misses(found, perfect)) < 1e-6

    def test_marks_alone_are_enough(self):
        """No tie point at all, and at least four marks in every image."""
        block = corridor_block(control=80, check=0, seed=2)
        start = without(block, every(block), gnss=True)
        start.tie_points = start.tie_points[:0]
        # A pose is refined until a step gains less than 1e-9: 1e-4 px, which few marks magnify.
        assert max(misses(complete(start), block)) < 1e-3

    def test_poses_come_from_known_tie_points(self, perfect):
        found = complete(without(perfect, every(perfect), points=False, ground=True, gnss=True))
        assert max(misses(found, perfect)) < 1e-6

    def test_missing_poses_are_chained_to_given_ones(self, perfect):
        some = np.arange(42) % 4 != 0
        found = complete(without(perfect, some, ground=True, gnss=True))
        assert max(misses(found, perfect)) < 1e-6

    def test_a_free_network_has_the_right_shape(self, perfect):
        found = complete(without(perfect, every(perfect), ground=True, gnss=True))
        assert max(misses(found, perfect, free=True)) < 1e-6

    def test_antennas_and_their_arm_give_frame_and_scale(self, perfect):
        found = complete(without(perfect, every(perfect), ground=True))
        assert max(misses(found, perfect)) < 1e-3

    @pytest.mark.parametrize("missing", ["nothing", "points"])
    def test_points_are_where_their_rays_meet(self, perfect, missing):
        start = without(perfect, points=missing == "points")
        found = complete(start).points.set_index("point").loc[perfect.points["point"]]
        off = found.to_numpy() - perfect.points[["x", "y", "z"]].to_numpy()
        assert np.abs(off).max() < 1e-6

    def test_a_plane_does_not_mislead(self):
        """Flat ground leaves the essential matrix a second solution (Longuet-Higgins 1986)."""
        flat = corridor_block(images=24, relief=0.0, seed=6)
        found = complete(without(flat, every(flat), ground=True, gnss=True))
        assert max(misses(found, flat, free=True)) < 1e-6


@pytest.mark.slow
class TestWithNoise:
    """0.5 px are 5 mm on the ground and 1e-4 rad; a chain of 14 images may collect a hundredfold
    of it, which is far within the reach of the adjustment."""

    @pytest.mark.parametrize(
        ("kept", "free"),
        [
            ({"gnss": True}, False),
            ({"ground": True}, False),
            ({}, False),
            ({"ground": True, "gnss": True}, True),
        ],
        ids=["ground", "gnss", "ground and gnss", "nothing"],
    )
    @pytest.mark.parametrize("strips", [1, 3])
    def test_poses_are_within_half_a_metre_and_a_degree(self, kept, free, strips):
        true = corridor_block(images=14 * strips, strips=strips, seed=8)
        measured = add_noise(true, **NOISE, outliers=0.02, seed=8)
        found = complete(without(measured, every(true), **kept))
        metres, radians = misses(found, true, free)
        assert metres < 0.5
        assert radians < np.radians(1.0)

    def test_a_wrong_antenna_does_not_carry_its_image_away(self, noisy, perfect):
        wrong = without(noisy, every(noisy), ground=True)
        wrong.gnss.loc[7, "x"] += 30.0
        found = complete(wrong)
        assert misses(found, perfect)[0] < 1.0

    def test_antennas_on_one_line_and_a_nadir_view_are_enough(self):
        """Nothing is across the line but the view itself: it is taken to look down."""
        line = corridor_block(
            images=12, strips=1, seed=1, position_jitter=0.0, attitude_jitter_deg=0.0
        )
        found = complete(without(line, every(line), ground=True))
        assert misses(found, line)[1] < np.radians(2.0)

    def test_most_points_are_within_their_accuracy(self, noisy, perfect):
        found = complete(without(noisy)).points.set_index("point").loc[perfect.points["point"]]
        off = np.linalg.norm(found.to_numpy() - perfect.points[["x", "y", "z"]].to_numpy(), axis=1)
        # 0.5 px at 110 px/m and a base of 7 m at 50 m: 5 mm in plan, 35 mm and more in height.
        assert np.median(off) < 0.02
        assert (off < 0.5).mean() > 0.97

    def test_two_flights_that_share_no_point_find_each_other_through_gnss(self, noisy):
        """Tie points of the third strip are renamed: it hangs together with nothing."""
        apart = without(noisy, every(noisy), ground=True)
        ties = apart.tie_points
        third = (apart.images["strip"] == "3").to_numpy()[apart.image_rows("tie_points")]
        name = ties["point"].astype(str) + np.where(third, "b", "a")
        count = name.map(name.value_counts())
        apart.tie_points = ties.assign(point=name.astype("category"))[count > 1]
        found = complete(apart)
        assert misses(found, noisy)[0] < 1.0


@pytest.mark.slow
class TestWhatIsGivenStays:
    def test_a_complete_block_is_returned_as_it_is(self, perfect):
        assert complete(perfect) is perfect

    def test_given_poses_and_points_are_kept_to_the_last_bit(self, noisy):
        start = without(noisy, np.arange(42) >= 30, points=False)
        start.points = start.points[::2].reset_index(drop=True)
        found = complete(start)
        pd.testing.assert_frame_equal(found.images[:30], start.images[:30])
        assert not found.images[POSE].isna().any(axis=None)
        kept = found.points[found.points["point"].isin(start.points["point"])]
        pd.testing.assert_frame_equal(kept.reset_index(drop=True), start.points)
        assert set(found.points["point"]) == set(noisy.points["point"])

    def test_the_block_handed_in_is_not_touched(self, noisy):
        start = without(noisy, np.arange(42) >= 30)
        before = start.copy()
        complete(start)
        pd.testing.assert_frame_equal(start.images, before.images)
        assert not len(start.points)

    def test_an_empty_cell_in_points_is_filled_and_other_columns_stay(self, noisy):
        start = without(noisy, points=False)
        start.points = start.points.assign(label="a")
        start.points.loc[5, ["x", "y", "z"]] = np.nan
        found = complete(start).points
        off = found.loc[5, POSE[:3]].to_numpy(float) - noisy.points.loc[5, POSE[:3]].to_numpy(float)
        assert np.abs(off).max() < 0.5
        assert (found["label"] == "a").all()

    def test_measured_points_that_ground_csv_lacks_get_a_row_in_points(self, noisy):
        start = without(noisy, points=False)
        truth = start.ground.iloc[4]
        start.ground = start.ground.drop(index=4)
        found = complete(start).points.set_index("point").loc[truth["point"]]
        off = found[["x", "y", "z"]].to_numpy(float) - truth[["x", "y", "z"]].to_numpy(float)
        assert np.abs(off).max() < 0.1

    def test_the_order_of_rows_does_not_count(self, noisy):
        start = without(noisy, every(noisy))
        shuffled = start.copy()
        for table in ("tie_points", "marks", "ground", "gnss"):
            rows = getattr(start, table).sample(frac=1.0, random_state=3)
            setattr(shuffled, table, rows.reset_index(drop=True))
        first, second = complete(start), complete(shuffled)
        off = (first.images[POSE] - second.images[POSE]).to_numpy()
        assert np.abs(off).max() < 1e-9


class TestPointsThatHardlyIntersect:
    @pytest.mark.parametrize("shift", [0.0, 0.5, -0.5, 60.0, -60.0])
    def test_rays_that_do_not_meet_ahead_end_at_the_depth_of_the_others(self, perfect, shift):
        """What two images see at infinity, or beyond: the second ray leans away by `shift` px.

        With the base of some 7.5 m, 60 px along the flight bring infinity to 7.5 x 5489 / 60 =
        690 m on one side, and send it behind the cameras on the other.
        """
        start = without(perfect)
        images = start.images.iloc[2:4]
        centre = images[POSE[:3]].to_numpy()
        rotation = rotation_from_quaternion(images[POSE[3:]].to_numpy())
        far = centre[0] + 1e7 * np.array([[0.1, 0.0, -1.0], [0.0, 0.1, -1.0], [0.0, 0.0, -1.0]])
        rows = []
        for k, point in enumerate(far):
            for i, image in enumerate(images["image"]):
                x, y = project(point[None], centre[i], rotation[i], CAMLIGHT.interior)[0]
                rows.append((f"far{k}", image, x, y + shift * i))
        more = pd.DataFrame(rows, columns=["point", "image", "x", "y"])
        ties = start.tie_points.astype({"point": str, "image": str})
        start.tie_points = pd.concat([ties, more], ignore_index=True)
        start.__post_init__()
        found = complete(start).points.set_index("point").loc[["far0", "far1", "far2"]].to_numpy()
        depth = np.einsum("ij,nij->ni", rotation[:, 2], found[:, None] - centre)
        assert (depth > 0).all()
        assert (depth < 800).all()
        if abs(shift) < 1:
            assert np.abs(found[:, 2]).max() < 5.0

    def test_no_point_lies_behind_a_camera_that_sees_it(self, noisy):
        found = complete(without(noisy, every(noisy)))
        point = found.points.set_index("point").loc[found.tie_points["point"].astype(str)]
        pose = found.images[POSE].to_numpy()[found.image_rows("tie_points")]
        view = rotation_from_quaternion(pose[:, 3:])[:, 2]
        assert (np.einsum("ni,ni->n", view, point.to_numpy() - pose[:, :3]) > 0).all()


class TestWhatCannotBeOriented:
    def test_an_image_without_a_measurement_is_named(self, noisy):
        blind = without(noisy, np.arange(42) == 20)
        for table in ("tie_points", "marks"):
            rows = getattr(blind, table)
            setattr(blind, table, rows[rows["image"] != "F1_0021.tif"])
        with pytest.raises(InputError, match="image F1_0021.tif cannot be oriented"):
            complete(blind)

    def test_images_that_hang_together_with_nothing_are_named(self, noisy):
        lost = without(noisy, np.arange(42) == 20, ground=True, gnss=True)
        rows = lost.tie_points["image"] != "F1_0021.tif"
        few = lost.tie_points[~rows][:3]
        lost.tie_points = pd.concat([lost.tie_points[rows], few], ignore_index=True)
        lost.__post_init__()
        with pytest.raises(InputError, match="image F1_0021.tif cannot be oriented.*give its pose"):
            complete(lost)

    def test_a_free_part_beside_an_oriented_one_is_named(self, noisy):
        """Six images oriented among themselves have no place in the world of the others."""
        apart = without(noisy, np.arange(42) < 6, ground=True, gnss=True)
        ties = apart.tie_points
        part = apart.image_rows("tie_points") < 6
        name = ties["point"].astype(str) + np.where(part, "b", "a")
        apart.tie_points = ties.assign(point=name.astype("category"))[
            name.map(name.value_counts()) > 1
        ]
        with pytest.raises(InputError, match="F1_0001.tif, .* and 1 more cannot be oriented"):
            complete(apart)


@pytest.mark.slow
class TestRealBlocks:
    def test_strasbourg_from_its_marks(self, real_data):
        """Given start poses are the published ones rounded to 5 m and 0.5 degree (README)."""
        given = corridor.read(real_data / "strasbourg")
        found = complete(without(given, every(given)))
        metres, radians = misses(found, given)
        assert metres < 7.0
        assert radians < np.radians(0.7)

    def test_strasbourg_as_a_free_network(self, real_data):
        given = corridor.read(real_data / "strasbourg")
        found = complete(without(given, every(given), ground=True))
        metres, radians = misses(found, given, free=True)
        assert metres < 7.0
        assert radians < np.radians(0.7)

    def test_saraburi_chained_between_given_poses(self, real_data):
        """Every fourth pose given, lens distortion unknown: 3.4 px of residual (README)."""
        given = corridor.read(real_data / "saraburi" / "block")
        found = complete(without(given, np.arange(88) % 4 != 0))
        metres, radians = misses(found, given)
        assert metres < 10.0
        assert radians < np.radians(5.0)

    @pytest.mark.parametrize("kept", [{"ground": True}, {}], ids=["gnss", "gnss and ground"])
    def test_saraburi_from_its_antennas(self, real_data, kept):
        """Given start values are of the maker's program, with another camera (README)."""
        given = corridor.read(real_data / "saraburi" / "block")
        found = complete(without(given, every(given), **kept))
        metres, radians = misses(found, given)
        assert metres < 1.0
        assert radians < np.radians(1.0)

    def test_roma_from_nothing_reaches_the_published_optimum(self, real_data):
        """Free network, distortion started at zero; optimum of COLMAP and Ceres (README)."""
        given = corridor.read(real_data / "roma")
        found = complete(without(given, every(given)))
        result = corridor.adjust(found, camera="f,cx,cy,k1,k2")
        assert result.converged and result.iterations <= 10
        assert result.sigma0 == pytest.approx(0.57587, abs=1e-4)
        camera = result.camera.set_index("parameter")["value"]
        assert camera["f"] == pytest.approx(3824.73, abs=0.05)


def test_a_camera_without_distortion_known_still_gives_a_start():
    """The lens moves the corners by some 35 px, of which the block knows nothing."""
    true = corridor_block(seed=2)
    plain = Camera("camlight", 5120, 3840, np.array([5489.0, 2559.5, 1919.5] + [0.0] * 12))
    start = without(true, every(true))
    start.cameras = {"camlight": plain}
    metres, radians = misses(complete(start), true)
    assert metres < 1.0
    assert radians < np.radians(2.0)
