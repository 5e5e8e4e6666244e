"""Similarity and check-point statistics, by hand and by symmetry."""

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.geometry import helmert_motions, rotation_from_vector, similarity

RNG = np.random.default_rng(0)
CLOUD = RNG.normal(size=(20, 3)) * [100.0, 10.0, 2.0] + [5e5, 6e6, 200.0]
TURN = rotation_from_vector(np.array([0.4, -1.1, 2.0]))


class TestSimilarityOfExactPoints:
    def test_recovers_scale_turn_and_shift(self):
        target = 2.5 * (CLOUD - CLOUD[0]) @ TURN.T + [1.0, 2.0, 3.0]
        found = similarity(CLOUD, target)
        assert found.scale == pytest.approx(2.5, rel=1e-12)
        assert found.rotation == pytest.approx(TURN, abs=1e-10)
        # Coordinates of 6e6 m hold 1e-9 m.
        assert np.abs(found.apply(CLOUD) - target).max() < 1e-7

    def test_a_quarter_turn_by_hand(self):
        """(1, 0, 0) to (0, 3, 0): a quarter turn about z, three times as large."""
        found = similarity(np.eye(3), 3 * np.eye(3)[[1, 0, 2]] * [[1], [-1], [1]])
        assert found.apply(np.array([1.0, 0, 0])) == pytest.approx([0, 3, 0])
        assert found.apply(np.array([0, 1.0, 0])) == pytest.approx([-3, 0, 0])
        assert found.scale == pytest.approx(3)

    def test_three_points_are_enough(self):
        target = 0.5 * CLOUD[:3] @ TURN.T
        assert np.abs(similarity(CLOUD[:3], target).apply(CLOUD[:3]) - target).max() < 1e-7

    def test_inverse_leads_back(self):
        found = similarity(CLOUD, 2.5 * CLOUD @ TURN.T)
        assert found.inverse().apply(found.apply(CLOUD)) == pytest.approx(CLOUD, abs=1e-6)

    def test_rotations_follow_the_frame(self):
        """A point seen by a camera before is seen by it in the same direction after."""
        found = similarity(CLOUD, 2.5 * CLOUD @ TURN.T + 7.0)
        camera, centre = rotation_from_vector(np.array([[1.0, 2.0, 0.5]])), CLOUD[:1] + 30.0
        before = camera[0] @ (CLOUD[3] - centre[0])
        after = found.apply_to_rotations(camera)[0] @ (
            found.apply(CLOUD[3]) - found.apply(centre)[0]
        )
        assert after == pytest.approx(2.5 * before)


class TestSimilarityOfMeasuredPoints:
    def test_a_mirror_image_gets_a_turn_and_never_a_reflection(self):
        found = similarity(CLOUD, CLOUD * [1.0, 1.0, -1.0])
        assert np.linalg.det(found.rotation) == pytest.approx(1.0)

    def test_a_flat_field_keeps_its_turn(self):
        """Points of a plane: the third singular value is zero and its sign must not matter."""
        flat = CLOUD * [1.0, 1.0, 0.0]
        found = similarity(flat, flat @ TURN.T)
        assert found.rotation == pytest.approx(TURN, abs=1e-10)

    def test_weight_zero_leaves_a_blunder_out(self):
        target, weights = CLOUD @ TURN.T, np.ones(20)
        target[4] += 50.0
        weights[4] = 0.0
        assert similarity(CLOUD, target, weights).rotation == pytest.approx(TURN, abs=1e-10)

    def test_a_weight_of_two_is_the_point_twice(self):
        noisy = CLOUD @ TURN.T + RNG.normal(size=CLOUD.shape)
        twice = similarity(CLOUD[[0, *range(20)]], noisy[[0, *range(20)]])
        weighted = similarity(CLOUD, noisy, np.array([2.0] + [1.0] * 19))
        assert weighted.scale == pytest.approx(twice.scale, rel=1e-12)
        assert weighted.rotation == pytest.approx(twice.rotation, abs=1e-12)

    def test_no_small_change_of_the_seven_fits_better(self):
        source = CLOUD - CLOUD.mean(0)
        target = source @ TURN.T + RNG.normal(size=CLOUD.shape)
        found = similarity(source, target)

        def cost(scale=1.0, turn=(0, 0, 0), shift=(0, 0, 0)):
            turned = source @ (rotation_from_vector(np.array(turn)) @ found.rotation).T
            moved = found.scale * scale * turned + found.translation + shift
            return ((moved - target) ** 2).sum()

        step = 1e-4
        axes = np.eye(3) * step
        for other in (
            *({"scale": 1 + s} for s in (step, -step)),
            *({"turn": s * axis} for s in (1, -1) for axis in axes),
            *({"shift": s * axis} for s in (1, -1) for axis in axes),
        ):
            assert cost(**other) > cost()

    def test_rows_with_unknown_coordinates_do_not_count(self):
        target = CLOUD @ TURN.T
        target[2, 1] = np.nan
        assert similarity(CLOUD, target).rotation == pytest.approx(TURN, abs=1e-10)


class TestDegenerateInput:
    def test_two_points_are_refused(self):
        with pytest.raises(InputError, match="at least 3 points .* there are 2"):
            similarity(CLOUD[:2], CLOUD[:2])

    @pytest.mark.parametrize("which", ["source", "target"])
    def test_points_on_a_line_are_refused(self, which):
        line = np.outer(np.arange(20.0), [1.0, 2.0, 3.0]) + [5e5, 6e6, 200.0]
        pair = (line, CLOUD) if which == "source" else (CLOUD, line)
        with pytest.raises(InputError, match="on one line"):
            similarity(*pair)

    def test_points_that_coincide_are_refused(self):
        with pytest.raises(InputError, match="on one line"):
            similarity(np.ones((5, 3)), CLOUD[:5])

    def test_a_corridor_one_centimetre_wide_in_a_kilometre_is_not_a_line(self):
        narrow = np.column_stack([np.linspace(0, 1000, 20), 0.005 * (-1.0) ** np.arange(20)])
        narrow = np.column_stack([narrow, np.zeros(20)])
        assert similarity(narrow, narrow @ TURN.T).rotation == pytest.approx(TURN, abs=1e-6)

    def test_unequal_sets_and_negative_weights_are_refused(self):
        with pytest.raises(InputError, match="of the same points"):
            similarity(CLOUD, CLOUD[:5])
        with pytest.raises(InputError, match="one weight for each point"):
            similarity(CLOUD, CLOUD, -np.ones(20))


@pytest.mark.parametrize("column", range(7))
def test_small_motions_are_those_of_a_similarity_about_the_mean(column):
    """A ten-thousandth: its square is 1e-8 of the 100 m that the cloud is long."""
    cloud, h = CLOUD[:, [1, 2, 0]] - CLOUD.mean(), 1e-4
    step = h * np.eye(7)[column]
    middle = cloud.mean(axis=0)
    turned = (cloud - middle) @ rotation_from_vector(step[3:6]).T
    moved = middle + step[:3] + (1 + step[6]) * turned
    assert moved - cloud == pytest.approx(helmert_motions(cloud) @ step, abs=5e-6)
