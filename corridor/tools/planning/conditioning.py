"""Any set of control points by conditioning: dense algebra on a few hundred numbers.

A control point is a measurement of coordinates that the network has estimated already. With H
picking them, R their covariance:

    K = S H' (H S H' + R)^-1
    S' = (1 - K H) S                                   what the adjustment believes
    P' = (1 - K H) P (1 - K H)' + K R K'               what is true
    M' = (1 - K H) M                                   what a constant bias does

Source: Joseph's form of the Kalman update; equal to an adjustment with the control in it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve


@dataclass(frozen=True)
class Moments:
    """Of the quantities of interest.

    stated: S (r, r), covariance that the adjustment states; error: P (r, r), second moments of
    the true errors without constant biases; transfer: M (r, b), by unit biases.
    """

    stated: np.ndarray
    error: np.ndarray
    transfer: np.ndarray

    def of(self, rows: np.ndarray) -> "Moments":
        """The moments of some of the quantities."""
        at = np.ix_(rows, rows)
        return Moments(self.stated[at], self.error[at], self.transfer[rows])

    def rms(self, bias: np.ndarray) -> np.ndarray:
        """Second moments (r, r) of the errors with biases of second moments (b, b)."""
        return self.error + self.transfer @ bias @ self.transfer.T


def condition(
    before: Moments, rows: np.ndarray, given: np.ndarray
) -> tuple[Moments, np.ndarray, np.ndarray]:
    """The moments with the quantities `rows` (c,) surveyed with variances `given` (c,), m^2.

    Returns them with the gain K (r, c) and the inverse (c, c) of H S H' + R.
    """
    s, p, m = before.stated, before.error, before.transfer
    factor = cho_factor(s[np.ix_(rows, rows)] + np.diag(given), lower=True)
    inverse = cho_solve(factor, np.eye(len(rows)))
    gain = s[:, rows] @ inverse
    stated = s - gain @ s[rows]
    across = gain @ p[rows]
    error = p - across - across.T + gain @ (p[np.ix_(rows, rows)] + np.diag(given)) @ gain.T
    return Moments(stated, error, m - gain @ m[rows]), gain, inverse
