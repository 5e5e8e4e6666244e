"""What is wrong with GNSS positions: white noise, noise with a memory, a constant bias."""

from dataclasses import dataclass

import numpy as np

from corridor.core.errors import InputError
from corridor.core.gnss import SlowNoise

Three = tuple[float, float, float]


@dataclass(frozen=True)
class GnssNoise:
    """The true errors of the antenna positions; the adjustment weighs them as the plan states.

    sigma_m: standard deviation of each axis, white and correlated together; default: as stated.
    correlated: share (0 to 1) of the variance that is an exponentially correlated process of each
        axis and flight, with the time constant correlation_s.
    bias_m: constant error (measured minus true) that is known to be there; bias_sigma_m: standard
        deviation of one that is not known. Default: what priors of an estimated bias
        expect, or none.
    bias_per: `block` for one bias of all flights (the base station), `flight` for one each (its
        ambiguities).
    """

    sigma_m: float | Three | None = None
    correlated: float = 0.0
    correlation_s: float = 30.0
    bias_m: float | Three | None = None
    bias_sigma_m: float | Three | None = None
    bias_per: str = "block"

    def __post_init__(self):
        if not 0 <= self.correlated <= 1:
            raise InputError(f"correlated = {self.correlated:g} is a share: give 0 to 1")
        if not self.correlation_s > 0:
            raise InputError(f"correlation_s = {self.correlation_s:g} is not greater than 0")
        if self.bias_per not in ("block", "flight"):
            raise InputError(f"bias_per = {self.bias_per!r} is unknown: use block or flight")
        for key in ("sigma_m", "bias_m", "bias_sigma_m"):
            value = getattr(self, key)
            if value is None:
                continue
            numbers = np.asarray(value, dtype=float)
            if numbers.shape not in ((), (3,)) or not np.isfinite(numbers).all():
                raise InputError(f"{key} = {value!r} is not one number or three")
            if key != "bias_m" and (numbers < 0).any():
                raise InputError(f"{key} = {value!r} is below 0")

    @property
    def bias_moment(self) -> np.ndarray | None:
        """Second moments (3, 3) of the bias, m^2; None where nothing is said of it."""
        if self.bias_m is None and self.bias_sigma_m is None:
            return None
        known = np.zeros(3) + (0.0 if self.bias_m is None else self.bias_m)
        sigma = np.zeros(3) + (0.0 if self.bias_sigma_m is None else self.bias_sigma_m)
        return np.outer(known, known) + np.diag(sigma**2)

    def excess(
        self, response: np.ndarray, stated: np.ndarray, time: np.ndarray, flight: np.ndarray
    ) -> np.ndarray:
        """B (C_true - C_stated) B' without the bias: covariance (r, r) to be added.

        response: B (r, k, 3) of k positions; stated (k, 3): sigmas, m; time (k,) s; flight (k,).
        """
        sigma = stated if self.sigma_m is None else np.zeros_like(stated) + self.sigma_m
        white = (1 - self.correlated) * sigma**2 - stated**2
        out = np.einsum("ika,ka,jka->ij", response, white, response, optimize=True)
        if not self.correlated:
            return out
        for group in np.unique(flight):
            mine = np.flatnonzero(flight == group)
            if not np.isfinite(time[mine]).all():
                raise InputError("correlated GNSS noise needs the time of every exposure")
            memory = SlowNoise(self.correlation_s).correlation(time[mine])
            for axis in range(3):
                part = response[:, mine, axis] * (np.sqrt(self.correlated) * sigma[mine, axis])
                out += part @ memory @ part.T
        return out


def unit_bias(response: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """What a bias of 1 m in x, y, z of each flight does to the quantities (r, flights, 3)."""
    groups = np.unique(flight)
    parts = [response[:, flight == group].sum(axis=1) for group in groups]
    return np.stack(parts, axis=1) if parts else np.zeros((len(response), 0, 3))
