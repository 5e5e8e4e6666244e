"""Geometry that every room needs: rotations, rays that meet, resection, similarity, robust scale.

Rotations go from world to camera, X = R (P - C); the camera looks along z, x right, y down.
"""

from corridor.core.geometry.helmert import Similarity, helmert_motions, relative_width, similarity
from corridor.core.geometry.intersection import Rays, intersect, meeting_points
from corridor.core.geometry.resampling import cluster_robust_sigma, jackknife, sigma_by_test
from corridor.core.geometry.resection import closed_pose, refine_poses
from corridor.core.geometry.robust import (
    CLIPPED,
    CONTRADICTING_FACTOR,
    GROSS,
    OUTLIER,
    UNUSABLE,
    is_outlier,
    robust_scale,
    robust_scale_of_lengths,
)
from corridor.core.geometry.rotations import (
    angles_from_rotation,
    nearest_rotation,
    quaternion_from_rotation,
    right_jacobian,
    roll_pitch_yaw_from_rotation,
    rotation_from_angles,
    rotation_from_quaternion,
    rotation_from_roll_pitch_yaw,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from corridor.core.geometry.vectors import cross, dot, few_sines, left_jacobian, rotated, sines
