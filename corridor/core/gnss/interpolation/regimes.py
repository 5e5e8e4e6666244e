"""How strongly a flight moves the antenna, and what the noise of its positions is like.

One number cannot describe a corridor flight: it stands, cruises, brakes and turns. So the density
of the jerk is one of a ladder of levels, the same for all three axes at a time, and changes now
and then at random (a hidden Markov chain); its level at each step is averaged over what the
epochs before and after say. What does not change during a flight is found by maximum likelihood,
for plan and height apart: the density of the gusts, the share of the noise that is slow, and,
where the track does not state them, the standard deviations of positions and velocities.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from corridor.core.gnss.interpolation import kernels
from corridor.core.gnss.interpolation.motion import MOTION, before_the_flight, steps

GROUPS = (("plan", (0, 1)), ("height", (2,)))

# Standing drone first: no gusts reach it. Then from a calm cruise to an emergency stop.
_JERK = np.concatenate([[1e-6], 10.0 ** np.arange(-4.0, 3.1, 0.5)])
_COARSE = np.concatenate([[1e-6], 10.0 ** np.arange(-4.0, 3.1, 1.0)])
# A drone brakes and turns in plan; its tilt brings about half of that into the height.
_OF_AXIS = (1.0, 1.0, 10.0**-0.5)
_DWELL_S = 5.0
_GUSTS_BESIDE, _FINER = 4, 16
_GUST = np.concatenate([[0.0], 10.0 ** np.arange(-5.0, 1.1, 0.5)])
# Of multipath and atmosphere over a short base line: half a minute to some minutes.
CORRELATION_S = 60.0
# Shares of the variance that may be slow, each equally likely beforehand.
SLOW_SHARES = np.array([0.0, 0.5, 0.8, 0.9, 0.95, 0.98])
# How much more epochs scatter than they state; what a step of it has to gain in log-likelihood:
# receivers are believed unless they are contradicted.
_INFLATED, _BELIEVED = 2.0 ** np.arange(0.0, 3.1, 0.5), 2.0
# Root mean square acceleration of a survey drone in turbulent air, m/s^2, above the frequencies
# that its track shows.
_SHAKEN_M_S2 = 0.5
# Epochs further apart than this do not tell a shaken drone from a noisy receiver.
SLOW_S = 0.35
# Median size of third differences of white noise of unit variance: their variance is 20.
_THIRD = 0.6745 * np.sqrt(20.0)
_SCALE = 10.0 ** np.arange(-3.5, 1.1, 0.25)
_VELOCITY = 10.0 ** np.arange(-2.5, 1.1, 0.25)
_BLOCK, _BLOCKS = 200, 12
_CALM_S, _WANDER = 5.0, 1.5
# A float ambiguity is wrong by nearly the same from epoch to epoch.
_WORSE = 0.95
FEWEST_EPOCHS = 12


class Epochs(NamedTuple):
    """Observations of one piece of a track."""

    time: np.ndarray  # (n,) s
    position: np.ndarray  # (n, 3) m, relative to the first
    sigma: np.ndarray  # (n, 3) m, or relative weights where `stated` is false
    usual: np.ndarray  # (n, 3) m, sigma of a usual epoch, or of this one if that is smaller
    excess: np.ndarray  # (n, 3) m, what a worse solution (float, single) has on top of it
    stated: bool
    velocity: np.ndarray | None  # (n, 3) m/s, NaN where unknown
    velocity_sigma: np.ndarray | None  # (n, 3) m/s; None: unknown

    def at(self, rows: np.ndarray | slice) -> "Epochs":
        """Some of the epochs."""
        parts: dict[str, Any] = {
            k: v[rows] for k, v in self._asdict().items() if isinstance(v, np.ndarray)
        }
        return self._replace(**parts)


class Axis(NamedTuple):
    """What holds for one axis (or group of axes) all along a piece.

    gust: m^2/s^3; share: of the position variance, that is slow; scale: of the sigmas;
    velocity_sigma: m/s, None where stated.
    """

    gust: float
    share: float
    scale: float
    velocity_sigma: float | None


class Model(NamedTuple):
    """Noise of a piece: `axes` x, y, z; densities of the step to each epoch, (n, 3).

    unresolved (3,): standard deviation, m, of motion too fast for the epochs to show, in every
    position between them; interval_s: usual step.
    """

    axes: tuple[Axis, ...]
    gusts: np.ndarray
    jerks: np.ndarray
    correlation_s: float = CORRELATION_S
    unresolved: np.ndarray | tuple = (0.0, 0.0, 0.0)
    interval_s: float = 1.0


class Rows(NamedTuple):
    """One axis as the kernels take it."""

    z: np.ndarray
    variance: np.ndarray
    share: np.ndarray
    kept: np.ndarray
    vz: np.ndarray
    v_variance: np.ndarray


def rows(epochs: Epochs, axis: int, noise: Axis, back: bool = False) -> Rows:
    """Observations of one axis with their variances; `back`: with time reversed."""
    sigma = epochs.sigma[:, axis] * noise.scale
    slow = noise.share * epochs.usual[:, axis] ** 2 + _WORSE * epochs.excess[:, axis] ** 2
    slow = np.sqrt(slow) * noise.scale
    # Where the stairs lie above a sigma, the white part stays what it is elsewhere.
    white = np.where(epochs.excess[:, axis] > 0, 1 - max(noise.share, _WORSE), 1 - noise.share)
    variance = np.maximum(sigma**2 - slow**2, white * sigma**2)
    n = len(sigma)
    velocity, v_variance = np.zeros(n), np.full(n, -1.0)
    if epochs.velocity is not None:
        known = np.isfinite(epochs.velocity[:, axis])
        velocity = np.where(known, epochs.velocity[:, axis], 0.0)
        stated = epochs.velocity_sigma
        v_sigma = noise.velocity_sigma if stated is None else stated[:, axis]
        assert v_sigma is not None  # estimated where it is not stated
        v_variance = np.where(known, np.square(v_sigma), -1.0)
    every = (epochs.position[:, axis], variance, slow, kept(slow), velocity, v_variance)
    if back:
        position, variance, slow = (part[::-1] for part in every[:3])
        every = (position, variance, slow, kept(slow), -velocity[::-1], v_variance[::-1])
    return Rows(*(np.ascontiguousarray(part) for part in every))


def split(sigma: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Usual sigma and excess of each epoch (see `Epochs`) from stated sigmas (n, 3).

    Usual is the sigma that a fifth of the epochs does not exceed.
    """
    stairs = staircase(sigma, time)
    base = np.percentile(stairs, 20, axis=0)
    worse = stairs > _WANDER * base
    excess = np.sqrt(np.where(worse, stairs**2 - base**2, 0.0))
    return np.where(worse, base, stairs), excess


def staircase(sigma: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Sigmas (n, 3), constant while they wander by less than half.

    A slow error does not follow every printed digit of the sigmas: if it did, a track that does
    not jump where its sigma jumps would show that the error is zero. It changes where the
    solution changes, from fixed to float.
    """
    # Both ways in time: a track that is turned round has the same stairs.
    both = _staircase(sigma, time), _staircase(sigma[::-1], -time[::-1])[::-1]
    return np.sqrt(both[0] * both[1])


def _staircase(sigma: np.ndarray, time: np.ndarray) -> np.ndarray:
    n = len(sigma)
    size = min(2 * int(_CALM_S / max(np.median(np.diff(time)), 1e-3) / 2) + 1, n)
    from scipy.ndimage import median_filter  # at first use: few blocks have a track

    calm = median_filter(sigma, (size, 1), mode="nearest")
    result = np.empty_like(sigma)
    for axis in range(sigma.shape[1]):
        first = 0
        while first < n:
            away = np.abs(np.log(calm[first:, axis] / calm[first, axis])) > np.log(_WANDER)
            last = first + int(np.argmax(away)) if away.any() else n
            result[first:last, axis] = np.median(sigma[first:last, axis])
            first = last
    return result


def kept(slow: np.ndarray) -> np.ndarray:
    """What is left of the slow error (as a multiple of its sigma) from each row to the next.

    slow: (n,) its sigma. Where that rises, something independent is added to the error; where
    it falls, the same is taken away.
    """
    before = np.concatenate([slow[:1], slow[:-1]])
    high = np.maximum(slow, before)
    return np.where(high > 0, np.minimum(slow, before) / np.where(high > 0, high, 1.0), 1.0)


def fit(epochs: Epochs, share: float | None) -> Model:
    """The motion and noise of one piece, by maximum likelihood.

    share: of the position variance, that is slow; None: its mean over what the likelihood allows,
        all shares being equally likely beforehand. At one epoch a second a shaken drone hides it.
    A piece of fewer than 12 epochs cannot tell: it gets the noise of a rough flight, and sigmas
        that are not stated follow from third differences.
    """
    n = len(epochs.time)
    if n < FEWEST_EPOCHS:
        unknown_velocity = epochs.velocity is not None and epochs.velocity_sigma is None
        scale = 1.0
        if not epochs.stated and n > 3:
            third = np.diff(epochs.position / epochs.sigma, 3, axis=0)
            scale = max(float(np.median(np.abs(third))) / _THIRD, float(_SCALE[0]))
        axis = Axis(1.0, share or 0.0, scale, 0.1 if unknown_velocity else None)
        jerks = np.outer(np.full(n, 10.0), _OF_AXIS)
        return Model((axis,) * 3, np.ones((n, 3)), jerks, unresolved=np.zeros(3))
    interval = float(np.median(np.diff(epochs.time)))
    search = _Search(epochs, share)
    found = search.run()
    # Plan and height scatter by factors that differ by more than a step of their grid.
    step = np.log2(_INFLATED[1]) * 1.01
    scales = [noise.scale for noise in found]
    if epochs.stated and interval < SLOW_S and abs(np.log2(scales[0] / scales[1])) > step:
        # A receiver is wrong about all axes alike; at this rate it is the drone that is shaken.
        found = search.run(scale=min(scales))
    axes = tuple(found[group] for group, (_, of) in enumerate(GROUPS) for _ in of)
    start = np.zeros(n, dtype=np.bool_)
    start[0] = True
    logs = sum(_logs(epochs, axis, axes[axis], _JERK, start) for axis in range(len(axes)))
    _, weights = _levels(logs, np.diff(epochs.time, prepend=epochs.time[0]))
    jerks = np.outer(weights @ _JERK, _OF_AXIS)
    flying = 1 - weights[:, 0]
    gusts = np.outer(flying, [noise.gust for noise in axes])
    unresolved = _unresolved(epochs, axes, interval)
    return Model(axes, gusts, jerks, unresolved=unresolved, interval_s=interval)


def _unresolved(epochs: Epochs, axes: tuple, interval: float) -> np.ndarray:
    """Standard deviation (3,) of motion faster than half the rate of the epochs, m.

    Epochs that scatter more than they state are shaken, or state too little. Motion that is white
    up to the frequency 1 / (2 interval) has accelerations of its size times (pi / interval)^2 /
    sqrt(5); what would need more than a drone is shaken by is noise.
    """
    most = _SHAKEN_M_S2 * np.sqrt(5) * (interval / np.pi) ** 2
    scale = np.array([noise.scale if epochs.stated else 1.0 for noise in axes])
    excess = np.median(epochs.usual, axis=0) * np.sqrt(np.maximum(scale**2 - 1, 0.0))
    return np.minimum(excess, most)


def _logs(epochs, axis, noise, levels, start):
    """Log-likelihood (n, levels) of the step that leads to each row, seen from both ends.

    start (n,): rows that no step leads to. Half of each: every step is seen twice, and a track
    that is turned round has the same.
    """
    with ThreadPoolExecutor(2) as pool:
        ahead, back = pool.map(
            lambda way: _one_way(epochs, axis, noise, levels, start, way), (False, True)
        )
    # Seen from the other end, a row tells of the step that leads on from it.
    ahead[1:] += np.where(start[1:, None], 0.0, back[:-1])
    return ahead / 2


def _one_way(epochs, axis, noise, levels, start, back):
    time = -epochs.time[::-1] if back else epochs.time
    at = rows(epochs, axis, noise, back)
    slow = bool(at.share.any())
    matrices = steps(time, CORRELATION_S if slow else None)
    if back:
        start = np.append(start[1:], True)[::-1].copy()
    gusts = np.where(np.arange(len(levels)) > 0, noise.gust, 0.0)
    out = np.zeros((len(time), len(levels)))
    kernels.log_likelihoods(
        at, start, matrices, gusts, levels * _OF_AXIS[axis], before_the_flight(MOTION + slow), out
    )
    return out[::-1] if back else out


def _levels(logs, step):
    """Log-likelihood, and the probability (n, levels) of each level at each step."""
    m = logs.shape[1]
    apart = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
    jump = np.where(apart > 0, np.exp(-apart.astype(float)), 0.0)
    # Symmetric, so that the chain is the same backwards: what a row lacks stays where it is.
    jump /= jump.sum(axis=1).max()
    jump[np.diag_indices(m)] = 1 - jump.sum(axis=1)
    weights = np.empty_like(logs)
    total = kernels.forward_backward(logs, np.exp(-step / _DWELL_S), jump, weights)
    return total, weights


class _Search:
    """Climbs the likelihood, one parameter after the other, on a sample of the epochs."""

    def __init__(self, epochs: Epochs, share: float | None):
        self.epochs, self.start = _sample(epochs)
        self.free = []
        if not epochs.stated:
            self.free.append("scale")
        if epochs.velocity is not None and epochs.velocity_sigma is None:
            self.free.append("velocity_sigma")
        self.free.append("gust")
        if epochs.stated:
            # What gusts explain is not for the sigmas to explain.
            self.free.append("scale")
        # Without stated sigmas nothing says how large the slow error is.
        if share is None and epochs.stated:
            self.free.append("share")
        self.grids = {
            "scale": _INFLATED if epochs.stated else _SCALE,
            "velocity_sigma": _VELOCITY,
            "gust": _GUST,
            "share": SLOW_SHARES,
        }
        unknown_velocity = "velocity_sigma" in self.free
        first = Axis(
            gust=_GUST[7],
            share=share or 0.0,
            scale=1.0 if epochs.stated else _SCALE[6],
            velocity_sigma=_VELOCITY[4] if unknown_velocity else None,
        )
        self.now = [first for _ in GROUPS]
        self.step = np.diff(self.epochs.time, prepend=self.epochs.time[0])
        self.step[self.start] = np.inf
        self.known: dict[tuple, np.ndarray] = {}

    def run(self, scale: float | None = None) -> list[Axis]:
        """What is found; with this scale of the stated sigmas, if one is given."""
        if scale is not None:
            self.free.remove("scale")
            self.now = [now._replace(scale=scale) for now in self.now]
        for _ in range(2):
            before = list(self.now)
            for group in range(len(GROUPS)):
                for name in self.free:
                    self._climb(group, name)
            if self.now == before:
                break
        for group in range(len(GROUPS)):
            self._refine(group)
        return self.now

    def _total(self, group: int, noise: Axis) -> float:
        parts = (noise if k == group else now for k, now in enumerate(self.now))
        return _levels(sum(map(self._of, range(len(self.now)), parts)), self.step)[0]

    def _of(self, group: int, noise: Axis) -> np.ndarray:
        key = (group, noise)
        if key not in self.known:
            self.known[key] = sum(
                _logs(self.epochs, axis, noise, _COARSE, self.start) for axis in GROUPS[group][1]
            )
        return self.known[key]

    def _climb(self, group: int, name: str) -> None:
        grid = self.grids[name]
        value = {}

        def at(k):
            if k not in value:
                value[k] = self._total(group, self.now[group]._replace(**{name: float(grid[k])}))
                if name == "scale" and self.epochs.stated:
                    value[k] -= _BELIEVED * k
            return value[k]

        if name == "share":
            mean = _mean_of([at(k) for k in range(len(grid))], grid)
            # To a hundredth: below that it changes nothing but the time it takes.
            self.now[group] = self.now[group]._replace(share=round(mean, 2))
            return
        here = int(np.argmin(np.abs(grid - getattr(self.now[group], name))))
        while True:
            near = [k for k in (here - 1, here, here + 1) if 0 <= k < len(grid)]
            best = max(near, key=at)
            if best == here:
                break
            here = best
        self.now[group] = self.now[group]._replace(**{name: float(grid[here])})

    def _refine(self, group: int) -> None:
        """The mean gust density over what the likelihood allows, all being equally likely before.

        The likeliest one may be none at all, where gusts are as small as the noise. A long track
        knows it better than the steps of the grid: between them the logarithm is a parabola.
        """
        k = int(np.argmin(np.abs(_GUST - self.now[group].gust)))
        near = slice(max(k - _GUSTS_BESIDE, 0), k + _GUSTS_BESIDE + 1)
        gusts = _GUST[near]
        log = np.array([self._total(group, self.now[group]._replace(gust=g)) for g in gusts])
        fine = np.linspace(0, len(log) - 1, _FINER * (len(log) - 1) + 1)
        at = np.clip(np.round(fine).astype(int), 1, len(log) - 2)
        off, slope, bend = fine - at, log[at + 1] - log[at - 1], np.diff(log, 2)[at - 1]
        # None at all stands a step below the smallest.
        known = np.log(np.maximum(gusts, _GUST[1] ** 2 / _GUST[2]))
        values = np.exp(np.interp(fine, np.arange(len(log)), known))
        gust = _mean_of(log[at] + off * slope / 2 + off**2 * bend / 2, values)
        self.now[group] = self.now[group]._replace(gust=gust)


def _mean_of(logs: list[float] | np.ndarray, values: np.ndarray) -> float:
    """Mean of values with these log-likelihoods."""
    likely = np.exp(np.array(logs) - np.max(logs))
    return float(likely @ values / likely.sum())


def _sample(epochs: Epochs) -> tuple[Epochs, np.ndarray]:
    """Up to twelve blocks of 200 epochs, moving ones first; and where each begins."""
    n = len(epochs.time)
    count = n // _BLOCK
    if count <= _BLOCKS:
        start = np.zeros(n, dtype=np.bool_)
        start[0] = True
        return epochs, start
    bounds = np.linspace(0, n, count + 1).astype(int)
    moved = np.array(
        [
            np.abs(np.diff(epochs.position[a:b], axis=0)).sum()
            for a, b in zip(bounds[:-1], bounds[1:], strict=True)
        ]
    )
    moving = np.flatnonzero(moved > 0.2 * moved.max())
    other = np.setdiff1d(np.arange(count), moving)
    few = min(len(other), max(_BLOCKS // 4, _BLOCKS - len(moving)))
    chosen = np.sort(np.concatenate([_spread(moving, _BLOCKS - few), _spread(other, few)]))
    take = np.concatenate([np.arange(bounds[k], bounds[k + 1]) for k in chosen])
    start = np.isin(take, bounds[chosen])
    return epochs.at(take), start


def _spread(items: np.ndarray, count: int) -> np.ndarray:
    if len(items) <= count:
        return items
    return items[np.linspace(0, len(items) - 1, count).round().astype(int)]
