"""Rotations: by hand, against OpenCV, there and back."""

import itertools

import cv2
import numpy as np
import pytest

from corridor.core.camera import project
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_angles,
    rotation_from_quaternion,
    rotation_from_vector,
)


def axis_turn(axis, degrees):
    """Rotation by hand: x to y for the axis z, and so on round."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[a, a], out[b, b], out[b, a], out[a, b] = c, c, s, -s
    return out


class TestRotations:
    def test_colmaps_sense_a_quarter_turn_about_z_takes_the_worlds_x_to_the_cameras_y(self):
        """qw qx qy qz, world to camera: X = R (P - C) (COLMAP, doc/format.rst)."""
        half = np.sqrt(0.5)
        rotation = rotation_from_quaternion(np.array([half, 0, 0, half]))
        assert rotation @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-15)
        points = np.array([[1.0, 0.0, 5.0]])
        seen = project(points, np.zeros(3), rotation, np.array([100.0] + [0.0] * 14))
        assert seen[0] == pytest.approx([0, 20], abs=1e-12)

    @pytest.mark.parametrize("axis", range(3))
    @pytest.mark.parametrize("degrees", [0, 30, 90, 150, 180, -90, 1e-7])
    def test_a_vector_and_a_quaternion_turn_about_each_axis_as_by_hand(self, axis, degrees):
        half = np.radians(degrees) / 2
        vector, quaternion = np.zeros(3), np.zeros(4)
        vector[axis], quaternion[0], quaternion[1 + axis] = 2 * half, np.cos(half), np.sin(half)
        by_hand = axis_turn(axis, degrees)
        assert rotation_from_vector(vector) == pytest.approx(by_hand, abs=1e-15)
        assert rotation_from_quaternion(quaternion) == pytest.approx(by_hand, abs=1e-15)

    def test_opencvs_rodrigues_gives_the_same_rotation(self):
        for vector in np.random.default_rng(3).normal(0, 1.2, (50, 3)):
            assert rotation_from_vector(vector) == pytest.approx(
                cv2.Rodrigues(vector)[0], abs=1e-14
            )

    def test_the_quaternion_comes_back_in_every_octant(self):
        signs = np.array(list(itertools.product([-1, 1], repeat=4)), dtype=float)
        sizes = np.array([[1, 2, 3, 4], [4, 3, 2, 1], [1, 5, 1, 1], [1, 1, 5, 1], [1, 1, 1, 5]])
        q = (signs[:, None] * sizes).reshape(-1, 4)
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        back = quaternion_from_rotation(rotation_from_quaternion(q))
        assert (back[:, 0] >= 0).all()
        assert back == pytest.approx(q * np.sign(q[:, :1]), abs=1e-15)

    def test_half_turns_about_any_axis_come_back_as_the_same_rotation(self):
        axes = np.array([p for p in itertools.product([-1, 0, 1], repeat=3) if any(p)], float)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        half_turn = 2 * np.einsum("ni,nj->nij", axes, axes) - np.eye(3)
        back = quaternion_from_rotation(half_turn)
        assert np.abs(back[:, 0]).max() < 1e-15
        assert rotation_from_quaternion(back) == pytest.approx(half_turn, abs=1e-15)

    def test_the_length_of_a_quaternion_does_not_matter(self):
        q = np.array([0.4, -0.2, 0.7, 0.1])
        assert rotation_from_quaternion(17 * q) == pytest.approx(
            rotation_from_quaternion(q), abs=1e-15
        )

    def test_what_is_unknown_stays_unknown(self):
        q = np.array([[1.0, 0, 0, 0], [np.nan] * 4])
        rotation = rotation_from_quaternion(q)
        assert np.isnan(rotation[1]).all() and rotation[0] == pytest.approx(np.eye(3))
        assert quaternion_from_rotation(rotation) == pytest.approx(q, nan_ok=True)

    def test_omega_phi_kappa_are_turns_about_x_then_the_new_y_then_the_new_z(self):
        turns = axis_turn(0, 10) @ axis_turn(1, -20) @ axis_turn(2, 130)
        assert rotation_from_angles(10, -20, 130) == pytest.approx(turns, abs=1e-15)
