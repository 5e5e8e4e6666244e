"""The Jacobian of a problem by numerical differences of the forward model.

It shares no line with the kernels of the adjustment: `corridor.effects.predict`, and central
differences of the fourth order.
"""

import numpy as np
import pandas as pd

from corridor.core.adjustment.normal import moved_state, shared_values
from corridor.core.effects import predict
from corridor.core.geometry import quaternion_from_rotation


def block_of(state, problem):
    """The problem's block at another state, and the values of its effects in file order."""
    block = problem.block.copy()
    back = np.argsort(problem.order)
    pose = np.concatenate([state.centre, quaternion_from_rotation(state.rotation)], axis=1)[back]
    block.images = block.images.assign(
        **dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), pose.T, strict=True))
    )
    block.cameras = {
        name: camera.with_interior(interior)
        for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
    }
    block.lever_arm = dict(zip(block.flight_names, map(tuple, state.arms), strict=True))
    for table in (block.points, block.ground):
        rows = pd.Index(problem.point_names).get_indexer(table["point"])
        for axis, moved in zip("xyz", state.points.T, strict=True):
            table[axis] = np.where(rows >= 0, moved[rows], table[axis])
    values = {
        slug: array[back] if problem.stack.members[slug].effect.group == "image" else array
        for slug, array in state.effects.items()
    }
    return block, values


def weighted(state, problem):
    """Every modelled observation over its sigma: ties, marks, GNSS, control, priors."""
    block, values = block_of(state, problem)
    seen = predict(block, values)
    used = problem.roles == "control"
    return np.concatenate([
        (seen.tie / problem.block.tie_sigma()[:, None]).ravel(),
        (seen.mark / problem.block.mark_sigma()[:, None]).ravel(),
        (seen.gnss / problem.block.gnss_sigma()).ravel(),
        (seen.control / problem.block.ground_sigma()[used]).ravel(),
        shared_values(problem, state) * np.sqrt(problem.prior_weight),
    ])  # fmt: skip


def touched(problem):
    """Image and point (position in the problem, -1: none) of every observation of `weighted`."""
    block, gnss = problem.block, problem.gnss_image.astype(int)
    used = np.flatnonzero(problem.roles == "control")
    priors = problem.shared_count
    image = np.full(len(block.tie_points) + len(block.marks), -1)
    point = image.copy()
    image[problem.row] = problem.img
    point[problem.row] = np.repeat(np.arange(len(problem.ptr) - 1), np.diff(problem.ptr))
    at = {name: n for n, name in enumerate(problem.point_names)}
    control = np.array([at[name] for name in block.ground["point"].iloc[used]], dtype=int)
    nothing = np.full(priors, -1)
    return (
        np.concatenate([np.repeat(image, 2), np.repeat(gnss, 3), np.full(3 * len(used), -1),
                        nothing]),
        np.concatenate([np.repeat(point, 2), np.full(3 * len(gnss), -1), np.repeat(control, 3),
                        nothing]),
    )  # fmt: skip


def jacobian(state, problem):
    """By poses, shared unknowns and points; every observation has one image and one point, so
    that all images move at once, and all points."""
    m, d, q, n = problem.image_count, problem.d, problem.shared_count, len(state.points)
    image, point = touched(problem)
    rows = np.arange(len(image))
    out = np.zeros((len(rows), m * d + q + 3 * n))

    def derivative(own, shared, points, h):
        def at(k):
            moved = moved_state(
                problem, state, k * h * own, k * h * shared, state.points + k * h * points
            )
            return weighted(moved, problem)

        return (at(-2) - 8 * at(-1) + 8 * at(1) - at(2)) / (12 * h)

    no_own, no_shared, no_point = np.zeros((m, d)), np.zeros(q), np.zeros((n, 3))
    for k in range(d):
        own = no_own.copy()
        own[:, k] = 1.0
        change = derivative(own, no_shared, no_point, 0.02 if k < 3 else 1e-3)
        inside = image >= 0
        out[rows[inside], image[inside] * d + k] = change[inside]
    for k, unknown in enumerate(problem.unknowns):
        # Pixels and metres by a tenth; seconds and numbers without a unit by a thousandth.
        h = 0.1 if unknown.unit in ("px", "m") else 1e-3
        out[:, m * d + k] = derivative(no_own, np.eye(q)[k], no_point, h)
    for k in range(3):
        points = no_point.copy()
        points[:, k] = 1.0
        change = derivative(no_own, no_shared, points, 0.02)
        inside = point >= 0
        out[rows[inside], m * d + q + 3 * point[inside] + k] = change[inside]
    return out
