"""What is measured of poses directly: antenna positions, and attitudes.

    antenna    P = C + R' a + shift
    attitude   A = Exp(-v) Exp(-s) R,   v = -Log(A R' Exp(s))

with the lever arm a, what effects add (s: by which the measured frame is turned against the
camera), and the turn v that is left of an attitude A (world to camera), both in the camera frame.
It is told about level axes, in which sigmas are stated: H v with H = L A' and L the level axes at
A, which stay as they are.
Source: Zhou 2019, eq. 5.2 and section 3.3.2; Sola et al. 2018, eqs. 143 and 144 (Jacobians).
"""

from dataclasses import dataclass

import numpy as np

from corridor.core.adjustment.problem import Problem
from corridor.core.adjustment.unknowns import State, is_per_image, per_image_code
from corridor.core.block import turned
from corridor.core.effects import Context, Images
from corridor.core.geometry import right_jacobian, rotation_from_vector, skew, vector_from_rotation


@dataclass(frozen=True)
class PoseRows:
    """Measurements of one kind, three numbers each.

    image (k,); residual (k, 3), measured minus modelled, m or rad; weight (k, 3). own (k, 3, d),
    shared (k, 3, q): derivatives of the modelled by the image's unknowns, and what images share.
    Coordinates of an antenna are those that are independent (`block.independent`).
    """

    image: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    own: np.ndarray
    shared: np.ndarray


def residuals(kind: str, p: Problem, state: State, images: Images) -> np.ndarray:
    """Measured minus modelled (k, 3) of `gnss`, m, or `attitude`, rad, as of `pose_rows`."""
    if kind == "gnss":
        return turned(p.gnss_turn, p.gnss_given - antenna(p, state, images)[0])
    return _attitude(p, state, images)[0]


def pose_rows(kind: str, p: Problem, state: State, images: Images) -> PoseRows:
    """The measurements of a kind, `gnss` or `attitude`, at a state."""
    if kind == "gnss":
        image, weight, turn = p.gnss_image, p.gnss_weight, p.gnss_turn
        predicted, d_pose, d_effects, to_world = antenna(p, state, images)
        residual = turned(turn, p.gnss_given - predicted)
        d_pose, d_effects, to_world = (turn @ by for by in (d_pose, d_effects, to_world))
        sources = [(d_effects, p.antenna_column[image]), (to_world, p.arm_column[image])]
    else:
        image, weight = p.attitude_image, p.attitude_weight
        residual, d_pose, d_effects = _attitude(p, state, images)
        sources = [(d_effects, p.attitude_column[image])]
    own = np.zeros((len(image), 3, p.d))
    own[:, :, :6] = d_pose
    shared = np.zeros((len(image), 3, p.shared_count))
    rows = np.arange(len(image))
    for source, columns in sources:
        for k in range(columns.shape[1]):
            column = columns[:, k]
            inside = column >= 0
            shared[rows[inside], :, column[inside]] += source[inside, :, k]
            mine = is_per_image(column)
            own[rows[mine], :, per_image_code(column[mine])] += source[mine, :, k]
    return PoseRows(image, residual, weight, own, shared)


def antenna(p: Problem, state: State, images: Images):
    """Predicted antenna (k, 3), m, and its derivatives.

    By centre and rotation of the image (k, 3, 6), by the effects (k, 3, parameters) and by
    the lever arm (k, 3, 3).
    """
    image = p.gnss_image

    def shift_at(centre, rotation):
        moved = Context(images.with_poses(centre, rotation), image)
        return p.stack.evaluate("antenna", moved, state.effects)

    shift, d_antenna = shift_at(state.centre, state.rotation)
    to_world = state.rotation[image].transpose(0, 2, 1)
    arm = state.arms[images.flight[image]]
    predicted = state.centre[image] + np.einsum("nij,nj->ni", to_world, arm) + shift
    d_pose = np.zeros((len(image), 3, 6))
    d_pose[:, :, :3] = np.eye(3)
    d_pose[:, :, 3:] = to_world @ skew(arm)
    if p.stack.at("antenna"):
        # An effect states its derivative by its own values only; images are few.
        for k, h in enumerate([1e-3] * 3 + [1e-5] * 3):
            for sign in (1.0, -1.0):
                centre, rotation = state.centre.copy(), state.rotation
                if k < 3:
                    centre[:, k] += sign * h
                else:
                    rotation = rotation_from_vector(sign * h * np.eye(3)[k - 3]) @ rotation
                d_pose[:, :, k] += sign * shift_at(centre, rotation)[0] / (2 * h)
    return predicted, d_pose, d_antenna, to_world


def _attitude(p: Problem, state: State, images: Images):
    """Residuals (k, 3), rad, about level axes, and derivatives of what is modelled.

    By centre and rotation of the image (k, 3, 6), and by the effects (k, 3, parameters), which
    look at no pose.
    """
    image = p.attitude_image
    shift, d_effects = p.stack.evaluate("attitude", Context(images, image), state.effects)
    turn = rotation_from_vector(-shift)
    modelled = turn @ state.rotation[image]
    left = -vector_from_rotation(p.attitude_given @ modelled.transpose(0, 2, 1))
    # Exp(w) before the modelled makes Exp(-v) Exp(-w) of what is left: v + J(-v)^-1 w.
    back = p.attitude_level @ np.linalg.inv(right_jacobian(-left)) @ turn
    d_pose = np.zeros((len(image), 3, 6))
    d_pose[:, :, 3:] = -back
    d_effects = back @ right_jacobian(-shift) @ d_effects
    return np.einsum("nij,nj->ni", p.attitude_level, left), d_pose, d_effects
