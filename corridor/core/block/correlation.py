"""Coordinates that were measured together: their correlations, and what makes them independent.

With L L' the covariance of a measurement (L lower triangular, d its diagonal), the coordinates

    T v,   T = diag(d) L^-1

are independent, with standard deviations d: the first as it is stated, each next one as it is
where those before it are known. Without correlations T is the unit matrix and d is what is stated.
Source: Koch 1999, "Parameter estimation and hypothesis testing in linear models", section 3.2
(decorrelation by the Cholesky factor of the weights).
"""

import numpy as np

# Correlations of x and y, x and z, y and z; of an image point the first alone.
RHO = ("rho_xy", "rho_xz", "rho_yz")
# Least eigenvalue of a correlation matrix that is believed: of three digits no more are known.
_LEAST_EIGENVALUE = 1e-3
_ROWS = {2: ([1], [0]), 3: ([1, 2, 2], [0, 0, 1])}


def covariances(sigma: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Covariances (n, k, k) of standard deviations (n, k) and correlations (n, k (k - 1) / 2)."""
    n, k = sigma.shape
    out = np.zeros((n, k, k))
    out[:, range(k), range(k)] = 1.0
    i, j = _ROWS[k]
    out[:, i, j] = out[:, j, i] = rho
    return out * sigma[:, :, None] * sigma[:, None, :]


def correlations(covariance: np.ndarray) -> np.ndarray:
    """Correlations (n, k (k - 1) / 2) of covariances (n, k, k); 0 where one has no variance."""
    variance = np.einsum("nii->ni", covariance)
    i, j = _ROWS[covariance.shape[1]]
    size = np.sqrt(variance[:, i] * variance[:, j])
    return np.divide(covariance[:, i, j], size, out=np.zeros(size.shape), where=size > 0)


def possible(rho: np.ndarray) -> np.ndarray:
    """Whether there is a positive definite matrix (n,) of such correlations (n, 1) or (n, 3)."""
    if rho.shape[1] == 1:
        return np.abs(rho[:, 0]) < 1
    x, y, z = rho.T
    return (np.abs(rho) < 1).all(axis=1) & (1 + 2 * x * y * z - x * x - y * y - z * z > 0)


def made_possible(rho: np.ndarray) -> np.ndarray:
    """Correlations (n, k), nearer to zero where printed digits leave no covariance matrix."""
    i, j = _ROWS[2 if rho.shape[1] == 1 else 3]
    whole = np.tile(np.eye(max(i) + 1), (len(rho), 1, 1))
    whole[:, i, j] = whole[:, j, i] = rho
    least = np.linalg.eigvalsh(whole)[:, 0]
    # With the factor t the least eigenvalue becomes 1 - t (1 - least).
    return (
        rho * np.minimum(1.0, (1.0 - _LEAST_EIGENVALUE) / np.maximum(1.0 - least, 1e-12))[:, None]
    )


def independent(sigma: np.ndarray, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T (n, k, k) and the standard deviations (n, k) of what it makes of residuals."""
    n, k = sigma.shape
    turn = np.zeros((n, k, k))
    turn[:, range(k), range(k)] = 1.0
    left = sigma.copy()
    rows = np.flatnonzero(rho.any(axis=1))
    if len(rows):
        root = np.linalg.cholesky(covariances(sigma[rows], rho[rows]))
        left[rows] = np.einsum("nii->ni", root)
        turn[rows] = left[rows][:, :, None] * np.linalg.inv(root)
    return turn, left


def turned(turn: np.ndarray, values: np.ndarray) -> np.ndarray:
    """T v of values (n, k): coordinates that are independent."""
    return np.einsum("nij,nj->ni", turn, values)


def along_axes(turn: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n, k) of which `turned` makes those that are given."""
    return np.linalg.solve(turn, values[:, :, None])[:, :, 0]


def covariance_of(turn: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Covariances (n, k, k) along the axes; weight (n, k) of what T gives."""
    back = np.linalg.inv(turn)
    return (back / weight[:, None, :]) @ back.transpose(0, 2, 1)
