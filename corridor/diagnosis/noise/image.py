"""Pseudo-residuals: what least squares would have to see to do what a robust estimator does.

Image residuals follow Student's t with nu = 4, of a length s in units of its scale:

    psi(r) = r (nu + 2) / (nu + s^2),  mean psi' = mean of nu (nu + 2) / (nu + s^2)^2
    r* = psi(r) K / mean psi',         K = 1 + p/n var psi' / (mean psi')^2

K is for the many unknowns: four rays leave two fifths of what is measured to points and poses, and
without it noise comes out a tenth too small. An estimator has the covariance of least squares with
observations of the variance of r*.
Source: Huber and Ronchetti 2009, "Robust statistics", sections 7.6 (K) and 7.10.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from corridor.core.camera import projection_derivatives
from corridor.core.geometry import is_outlier
from corridor.diagnosis.settings import SETTINGS

if TYPE_CHECKING:
    from corridor.core.adjustment import LinearSystem


@dataclass
class Scales:
    """Sizes of the image noise.

    of_observation (n,) px: standard deviation of each pseudo-residual. tie, mark: factor on the
    stated standard deviations. core: scale of Student's t, ties, in stated standard deviations.
    """

    of_observation: np.ndarray
    tie: float
    mark: float
    core: float


def scale_of(square: np.ndarray) -> float:
    """Scale of bivariate Student t residuals by maximum likelihood; square: (n,) their |r|^2."""
    variance = max(float(np.median(square)) / 1.5, 1e-24)
    for _ in range(200):
        weight = (SETTINGS.student_nu + 2.0) / (SETTINGS.student_nu + square / variance)
        after = max(float(np.mean(0.5 * weight * square)), 1e-24)
        if abs(after - variance) < 1e-10 * variance:
            break
        variance = after
    return float(np.sqrt(variance))


def pseudo_residuals(system: LinearSystem, residual: np.ndarray) -> tuple[np.ndarray, Scales]:
    """Pseudo-residuals (n, 2) px of image residuals (n, 2) px, and how large their noise is.

    The noise is such that the mean square of what remains equals the redundancy. Rows behind
    their camera (NaN) get zero. Marks are judged against the other marks of their point alone: a
    control point that disagrees with everything else in all its images is no wrong measurement.
    """
    rows = system.image_rows
    sigma, tie = rows.sigma, rows.tie
    known = np.isfinite(residual).all(axis=1)
    residual = np.where(known[:, None], residual, 0.0)
    out = np.zeros_like(residual)
    share = _redundancy(system)

    mine = tie & known
    core = factor = 1.0
    if mine.any():
        scaled = residual[mine] / sigma[mine][:, None]
        square = (scaled**2).sum(axis=1)
        core = scale_of(square)
        s = square / core**2
        slope = _slope(s, share)
        out[mine] = (
            residual[mine]
            * ((SETTINGS.student_nu + 2.0) / (SETTINGS.student_nu + s) / slope)[:, None]
        )
        found = np.mean(((out[mine] / sigma[mine][:, None]) ** 2).sum(axis=1)) / 2.0 / share
        factor = max(float(np.sqrt(found)), SETTINGS.noise_factor_range[0])
    marks = np.flatnonzero(~tie & known)
    of_marks = factor
    if len(marks):
        out[marks], of_marks = _marks(system, residual, marks)
    of = sigma * np.where(tie, factor, of_marks)
    return out, Scales(of, factor, of_marks, core)


def _slope(s: np.ndarray, share: float) -> float:
    """Mean of psi' over K, for squared lengths s (n,) in scales and the share of redundancy.

    psi' of a vector has two values: along it, and across.
    """
    across = (SETTINGS.student_nu + 2.0) / (SETTINGS.student_nu + s)
    along = across - 2.0 * across * s / (SETTINGS.student_nu + s)
    mean = 0.5 * float(np.mean(along) + np.mean(across))
    variance = 0.5 * float(np.mean((along - mean) ** 2) + np.mean((across - mean) ** 2))
    return mean / (1.0 + (1.0 - share) * variance / mean**2)


def _redundancy(system: LinearSystem) -> float:
    """Share of the image observations that no point, pose or camera takes up."""
    count = len(system.image_rows.point)
    camera = sum(1 for unknown in system.columns.shared if unknown.kind == "camera")
    unknown = 3 * len(system.state.points) + system.columns.pose.size + camera
    return max(1.0 - unknown / max(2 * count, 1), SETTINGS.least_redundancy)


def _marks(system: LinearSystem, residual, marks) -> tuple[np.ndarray, float]:
    """Pseudo-residuals (k, 2) of marks, and the factor on their stated standard deviations."""
    rows, state, sigma = system.image_rows, system.state, system.image_rows.sigma
    point, image = rows.point[marks], rows.image[marks]
    lens = state.interior.copy()
    lens[:, 3:-1] = 0.0  # but for its distortion
    by_point = projection_derivatives(
        state.points[point], state.centre[image], state.rotation[image], lens,
        system.images.camera[image],
    ).by_point  # fmt: skip
    common = np.zeros((len(marks), 2))
    apart = np.zeros(len(marks))
    left, lost = 0.0, 0
    for n in np.unique(point):
        rows = np.flatnonzero(point == n)
        A = by_point[rows] / sigma[marks[rows]][:, None, None]
        r = residual[marks[rows]] / sigma[marks[rows]][:, None]
        weight = np.ones(len(rows))
        for _ in range(30):
            heavy = A * weight[:, None, None]
            normal = np.einsum("nij,nik->jk", heavy, A)
            normal += 1e-9 * np.trace(normal) * np.eye(3)
            shift = np.linalg.solve(normal, np.einsum("nij,ni->j", heavy, r))
            left_over = r - A @ shift
            square = (left_over**2).sum(axis=1)
            weight = 1.0 / (1.0 + square / SETTINGS.mark_cauchy_width**2)
        common[rows] = (A @ shift) * sigma[marks[rows]][:, None]
        apart[rows] = np.sqrt(square)
        good = ~is_outlier(np.sqrt(square))
        left += square[good].sum()
        lost += max(2 * int(good.sum()) - 3, 0)
    stated = SETTINGS.stated_mark_weight
    factor = float(np.sqrt((left + stated) / (lost + stated)))
    wrong = is_outlier(apart, max(factor, 1.0))
    return np.where(wrong[:, None], common, residual[marks]), factor


def places(xy: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Number (n,) of the place of its picture in which a point lies. xy, size (n, 2): px."""
    columns, rows = SETTINGS.places
    cell = np.clip((xy + 0.5) / size * (columns, rows), 0, (columns - 1, rows - 1)).astype(int)
    return cell[:, 0] * rows + cell[:, 1]
