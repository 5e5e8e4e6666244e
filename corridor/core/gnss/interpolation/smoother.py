"""The Kalman smoother: every epoch of a piece says something about every moment of it.

Source: Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, 1965.
"""

import numpy as np

from corridor.core.gnss.interpolation import kernels
from corridor.core.gnss.interpolation.motion import MOTION, before_the_flight, steps
from corridor.core.gnss.interpolation.regimes import Epochs, Model, Rows, kept, rows


def smooth(
    epochs: Epochs, times: np.ndarray, model: Model
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position, its sigma, velocity and its sigma, each (m, 3), at times (m,) within the piece.

    The sigma is that of the true antenna, the slow error of the positions included; exact for
    the continuous model at any moment, between epochs as well as at one. The axes are smoothed
    one by one: covariances between them are not used, and none are needed for sigmas that hold.
    """
    n = len(epochs.time)
    order = np.argsort(np.concatenate([epochs.time, times]), kind="stable")
    time = np.concatenate([epochs.time, times])[order]
    observed = order < n
    source = np.where(observed, order, 0)
    step = np.searchsorted(epochs.time, time)  # the epoch that a row leads to
    step = np.minimum(step, n - 1)
    place = order[~observed] - n
    position, sigma, velocity, velocity_sigma = (np.empty((len(times), 3)) for _ in range(4))
    for axis, noise in enumerate(model.axes):
        at = rows(epochs, axis, noise)
        slow = bool(at.share.any())
        d = MOTION + slow
        states, sigmas = np.zeros((len(time), d)), np.zeros((len(time), d))
        seen = Rows(
            at.z[source],
            np.where(observed, at.variance[source], -1.0),
            np.where(observed, at.share[source], 0.0),
            kept(at.share[step]),
            at.vz[source],
            np.where(observed, at.v_variance[source], -1.0),
        )
        kernels.smooth(
            seen,
            steps(time, model.correlation_s if slow else None),
            model.gusts[step, axis],
            model.jerks[step, axis],
            before_the_flight(d),
            states,
            sigmas,
        )
        position[place, axis] = states[~observed, 0]
        shaken = model.unresolved[axis]
        sigma[place, axis] = np.hypot(sigmas[~observed, 0], shaken)
        velocity[place, axis] = states[~observed, 1]
        # White motion up to half the rate has this speed.
        shaken *= np.pi / model.interval_s / np.sqrt(3)
        velocity_sigma[place, axis] = np.hypot(sigmas[~observed, 1], shaken)
    return position, sigma, velocity, velocity_sigma
