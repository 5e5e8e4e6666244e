"""Rays of known cameras meet where the points are."""

import numpy as np
import pytest

from corridor.core.geometry import Rays, intersect, meeting_points, rotation_from_vector

F = 4000.0
RNG = np.random.default_rng(8)
PLACES = RNG.uniform([-30, -30, -3], [30, 30, 3], (40, 3)) + [7e5, 5e6, 200.0]
CENTRES = np.array([[-20.0, 0, 80], [20, 5, 82], [0, 25, 79]]) + [7e5, 5e6, 200.0]
TURNS = rotation_from_vector(np.array([[np.pi - 0.1, 0, 0], [np.pi, 0.1, 0], [np.pi, 0, 0.2]]))


def rays(noise_px=0.0, centres=CENTRES):
    """Each point by each image, point by point."""
    seen = np.einsum("mij,nmj->nmi", TURNS, PLACES[:, None] - CENTRES)
    ray = (seen[..., :2] / seen[..., 2:]).reshape(-1, 2)
    ray = ray + RNG.normal(0, noise_px / F, ray.shape)
    image = np.tile(np.arange(3), len(PLACES))
    return Rays(image, ray, TURNS, centres, np.full(3, 1 / F))


POINT = np.repeat(np.arange(len(PLACES)), 3)


def test_exact_rays_meet_in_the_point_in_map_coordinates_too():
    """Map coordinates of 5e6 m hold 1e-9 m."""
    assert meeting_points(rays(), POINT, len(PLACES)) == pytest.approx(PLACES, abs=1e-7)


def test_noisy_rays_meet_within_the_error_of_the_image_times_the_scale():
    """80 m over 4000 px are 2 cm a pixel; 0.3 px, and four times that in height."""
    found = meeting_points(rays(0.3), POINT, len(PLACES))
    assert np.abs(found - PLACES).max() < 5 * 4 * 0.3 * 0.02


def test_one_wrong_ray_of_three_is_held_down_by_the_gate():
    """The two good rays differ by 0.1 px; a wrong one by 300 px would take a third of that."""
    wrong = rays(0.1)
    wrong.ray[::3, 1] += 300 / F
    starts = np.arange(0, len(POINT) + 1, 3)
    found = intersect(wrong, starts, np.arange(len(POINT)), gate=4.0)
    plain = intersect(wrong, starts, np.arange(len(POINT)))
    assert (np.abs(found.place - PLACES).max(1) < np.abs(plain.place - PLACES).max(1)).all()


def test_images_without_a_pose_do_not_count_and_parallel_rays_fix_nothing():
    alone = np.where(np.arange(3)[:, None] == 0, CENTRES, np.nan)
    assert np.isnan(meeting_points(rays(centres=alone), POINT, len(PLACES))).all()
    near = np.array([CENTRES[0], CENTRES[0] + 0.01, CENTRES[0] - 0.01])
    seen = (PLACES[:, None] - near) @ TURNS[0].T
    ray = (seen[..., :2] / seen[..., 2:]).reshape(-1, 2)
    twins = Rays(np.tile(np.arange(3), len(PLACES)), ray, TURNS[[0, 0, 0]], near, np.ones(3))
    assert np.isnan(meeting_points(twins, POINT, len(PLACES))).all()
