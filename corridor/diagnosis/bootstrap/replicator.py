"""Draws counterparts of a block from the model one believes in, and fits them as it was.

Every observation anew, from the adjusted model and noise of the sizes and kinds that the residuals
show: how large, how heavy its tails, how slow. Residuals are smaller than the noise, because poses
and points follow it. What they lost is known from the adjustment itself: for GNSS from the
equations, for everything else by trying noise until the residuals it leaves behind are those that
were found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.adjustment import LOSSES, ImageRows, LinearSystem, Loss
from corridor.core.effects import Context, every_effect
from corridor.core.errors import InputError
from corridor.core.geometry import (
    CLIPPED,
    UNUSABLE,
    is_outlier,
    robust_scale,
    robust_scale_of_lengths,
)
from corridor.diagnosis.bootstrap.linear_fits import LinearFits, Measured
from corridor.diagnosis.bootstrap.statistics import Fit
from corridor.diagnosis.evidence.profile_likelihood import has_states
from corridor.diagnosis.noise.gnss import GnssNoise, stated_noise
from corridor.diagnosis.noise.likelihood import Arguments, estimate, value_of
from corridor.diagnosis.system.elimination import Elimination, Rows, rows_of
from corridor.diagnosis.system.equations import Columns, Equations, take_apart
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification.held_out import spared

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

# Probabilities at which the length of the tie noise is known: dense where tails begin.
GRID = np.concatenate([np.linspace(0.0, 0.98, 99), 1 - np.geomspace(0.018, 1e-6, 30)])
# Epochs from which on slow noise can be told from white.
ENOUGH_EPOCHS = 12
# Gain in log likelihood from which on slow noise is believed: a chance of one in seven.
LEAST_GAIN = 2.0
# So many times as large as the residuals may be what is left free; beside the weights of what is
# measured, the prior of more would be lost to rounding.
FREE = 1e3
# What has a smaller singular value, relative to the largest, is a sum of other antenna effects.
RANK = 1e-6
# Weight, in degrees of freedom, of a stated standard deviation where few residuals tell.
STATED_FREEDOM = 20.0
# Share of the tie observations that no fit uses.
HELD_OUT = 0.05
# The last tenth of a per mille of a step changes no statistic.
TOLERANCE = 1e-3
# With more than this share of unusable residuals there are wrong matches.
GROSS_SHARE = 0.002
# Tie observations from which on one trial says enough on the noise.
TIES_OF_A_TRIAL = 20_000
TRIALS = 3
WINSORIZED = 2.5


@dataclass(frozen=True)
class EstimatedNoise:
    """Noise of everything that is measured, in units of the stated standard deviations.

    tie: (len(GRID),) length of a tie point's error at the probabilities GRID (a Gaussian one has
    the lengths of Rayleigh). mark, control: factors. gnss: of the antenna; None without.
    """

    tie: np.ndarray
    mark: float = 1.0
    control: float = 1.0
    gnss: GnssNoise | None = None

    @property
    def tie_sigma(self) -> float:
        """Robust standard deviation of a tie coordinate in stated ones: from the median length."""
        return robust_scale_of_lengths(np.interp(0.5, GRID, self.tie))

    def draw_tie(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Errors (count, 2) in stated standard deviations, in any direction."""
        length = np.interp(rng.random(count), GRID, self.tie)
        angle = rng.uniform(0.0, 2 * np.pi, count)
        error = np.column_stack([np.cos(angle), np.sin(angle)])
        error *= length[:, None]
        return error


def lengths(residual: np.ndarray) -> np.ndarray:
    """Lengths of residuals (n, 2), in standard deviations, at the probabilities GRID."""
    return np.quantile(np.hypot(*residual.T), GRID)


def mended(noise: EstimatedNoise, found: np.ndarray, left: np.ndarray) -> EstimatedNoise:
    """Tie noise nearer the truth, when it left behind lengths `left` in place of `found`."""
    ratio = np.clip(found / np.maximum(left, 1e-12), 0.5, 2.0)
    # One draw's tail is a few observations: what they say is averaged along the tail.
    tail = GRID > 0.98
    smooth = np.convolve(np.pad(ratio, 3, mode="edge"), np.full(7, 1 / 7), mode="valid")
    ratio = np.where(tail, smooth, ratio)
    return replace(noise, tie=np.maximum.accumulate(noise.tie * ratio))


def antenna_noise(system: LinearSystem, tie_sigma: float) -> GnssNoise | None:
    """White and slow noise of the antenna by flight and axis, by restricted maximum likelihood.

    system: at a fit. tie_sigma: of a tie coordinate in stated ones. What any antenna effect of the
    catalogue could do is projected out, for noise is what is left when each of them had its way: a
    drift must not count as slow noise. Nothing is known of the noise beforehand; it is white where
    the data do not speak for more, and as large as the residuals where an area of photographs has
    no states of slow noise.
    Source: Patterson and Thompson 1971 (restricted likelihood).
    """
    rows = system.image_rows
    sigma = np.where(rows.tie, tie_sigma * rows.sigma, rows.sigma)
    loss = system.loss._replace(width=system.loss.width / tie_sigma)
    noise, seen = stated_noise(system), system.gnss.residual
    usual = [robust_scale(seen.ravel()[at], centred=True, least=1e-9) for at, *_ in noise.blocks()]
    sizes = [
        size / np.sqrt(np.mean(noise.stated[at] ** 2))
        for size, (at, *_) in zip(usual, noise.blocks(), strict=True)
    ]
    if not has_states(system):
        for size, (_, flight, axis) in zip(sizes, noise.blocks(), strict=True):
            noise.white[flight, axis] = size
        return noise
    cut = seen.ravel().copy()
    for size, (at, *_) in zip(usual, noise.blocks(), strict=True):
        cut[at] = np.clip(cut[at], -CLIPPED * size, CLIPPED * size)
    given = system.gnss.given + cut.reshape(-1, 3) - seen
    system = replace(system.measuring(sigma=sigma, gnss=given), loss=loss)
    apart = take_apart(replace(system, gnss_counts=False), [])
    e, shapes = _with_signals(apart, _signals(system), FREE * max(usual))
    return _white_or_slow(e, shapes, noise, np.maximum(sizes, 1e-3))


def _with_signals(e: Equations, signals: np.ndarray, free: float) -> tuple[Equations, Rows]:
    """Equations with signals (3k, q) of the antenna, m, as columns, and these as rows.

    free: their standard deviation, m.
    """
    count = signals.shape[1]
    nothing = np.zeros(count)
    core = Columns(np.zeros((len(e.right), count)), np.diag(nothing), nothing, signals, nothing)
    labels = [("block", str(k), "m") for k in range(count)]
    at, scale = np.arange(count), np.ones(count)
    group = Group("signals", every_effect()[0], None, at, scale, labels)
    return replace(e, core=core, at=at, own=[], between=[], own_at=[], mutual={}, kept={}), rows_of(
        [(group, free)]
    )


def _white_or_slow(e: Equations, shapes: Rows, noise: GnssNoise, sizes: np.ndarray) -> GnssNoise:
    """The noise of each flight and axis, slow only where the data speak for it.

    sizes (blocks,): of the residuals in stated standard deviations.
    """
    steps = [np.median(np.diff(np.sort(noise.time[at // 3]))) or 1.0 for at, *_ in noise.blocks()]
    spans = [np.ptp(noise.time[at // 3]) for at, *_ in noise.blocks()]
    step = float(np.min(steps)) if np.isfinite(steps).all() else 1.0
    factor = 1e-3 * float(sizes.min()), 10.0 * float(sizes.max())
    bounds = factor, factor, (2 * step, max(0.5 * float(np.max(spans)), 3 * step))
    arguments = Arguments(noise, bounds)
    count, flights = len(sizes), len(arguments.flights)
    few = [len(at) < ENOUGH_EPOCHS for at, *_ in noise.blocks()]
    starts = [
        np.log(np.concatenate([0.8 * sizes, 0.4 * sizes, np.full(flights, many * step)]))
        for many in (4.0, 20.0)
    ]
    best = min((estimate(e, shapes, arguments, x) for x in starts), key=lambda one: one.value)
    slow = slice(count, 2 * count)
    for n in range(count):
        x = best.x.copy()
        x[n] = 0.5 * np.logaddexp(2 * x[n], 2 * x[count + n])
        x[count + n] = arguments.low[count + n]
        alone = value_of(Elimination(e, arguments.noise_at(x), shapes), arguments, x)
        # Slow noise that is not there would make the bands wide where drifts would show.
        if few[n] or alone - best.value < 2 * LEAST_GAIN:
            arguments.high[count + n] = arguments.low[count + n]
    best = estimate(e, shapes, arguments, best.x)
    white = best.x[slow] <= arguments.low[slow]
    coloured, factors = best.noise.coloured.copy(), best.noise.white.copy()
    for n, (at, f, axis) in enumerate(noise.blocks()):
        if white[n]:
            coloured[f, axis] = 0.0
        if few[n]:
            # Too few to estimate anything from alone: what is stated counts too.
            told = len(at) * factors[f, axis] ** 2
            factors[f, axis] = np.sqrt((STATED_FREEDOM + told) / (STATED_FREEDOM + len(at)))
    return replace(best.noise, white=factors, coloured=coloured)


def _signals(system: LinearSystem) -> np.ndarray:
    """What every physical effect that a block shares can do to the antenna: (3k, q), orthogonal
    columns, each 1 m in the square mean."""
    block = system.block
    context = Context(system.images, system.gnss.image)
    parts = [np.tile(np.eye(3), (len(context), 1, 1))]
    for effect in every_effect():
        if effect.place != "antenna" or effect.generic or effect.group == "image":
            continue
        if effect.missing(block):
            continue
        values = np.zeros((len(context), len(effect.parameters(block))))
        derivative = effect.shift(context, values)[1]
        if np.isfinite(derivative).all():
            parts.append(derivative)
    shapes = np.concatenate(parts, axis=2).reshape(3 * len(context), -1)
    size = np.linalg.norm(shapes, axis=0)
    basis, strength, _ = np.linalg.svd(shapes[:, size > 0] / size[size > 0], full_matrices=False)
    return basis[:, strength > RANK * strength[0]] * np.sqrt(len(shapes))


class Replicator:
    """The model one believes in, as an adjustment found it; draws counterparts and fits them.

    held_out: (observations,) bool, image observations that no fit uses. fit: the measured block
    adjusted without them, `Fit`. fits: of counterparts, `LinearFits`. noise: `EstimatedNoise`.
    check_moved (c, 3): what effects of the ground do to the given check points, m; it is taken from
    what is measured.
    Blocks with many wrong matches are fitted robustly, the measured one and its counterparts.
    """

    def __init__(self, adjustment: Adjustment):
        system = adjustment.system
        if len(system.problem.skewed):
            raise InputError(
                "a counterpart takes x and y of an image point as equally good and independent: "
                "adjust the block without sx, sy and rho_xy of tie_points.csv and marks.csv"
            )
        rows = system.image_rows
        self.held_out = _held_out(rows)
        self.sigma, self.is_tie = rows.sigma, rows.tie
        self.check_rows, self.check_points = _check_points(system)
        ground = system.block.ground
        given = ground[["x", "y", "z"]].to_numpy(float)
        self.measured = Measured(
            rows.xy,
            system.gnss.given,
            system.control.given,
            system.columns.shared_prior,
            given[self.check_rows],
            system.posed.given,
            system.distance.given,
        )
        self.check_sigma = system.block.ground_sigma()[self.check_rows]
        system = system.measuring(sigma=np.where(self.held_out, np.inf, self.sigma))
        self.system = replace(system, loss=_loss(adjustment)).minimised(20, TOLERANCE, near=False)
        left, state = self.system.residuals(), self.system.state
        ground, self.check_moved = _ground_moved(self.system, self.check_rows, self.check_points)
        self.measured = self.measured._replace(check=self.measured.check - self.check_moved)
        check = state.points[self.check_points] - self.measured.check
        self.fit = Fit(
            state, left.pixels, left.gnss, self.system.control.residual, check,
            self.system.posed.residual, self.system.distance.residual,
        )  # fmt: skip
        self.fits = LinearFits(
            self.system,
            self.measured,
            self.fit,
            self.sigma,
            self.held_out,
            self.check_points,
            ground,
        )
        self.noise = self._estimate()

    # --- noise -------------------------------------------------------------------------------

    def _estimate(self) -> EstimatedNoise:
        ties = self.is_tie & ~self.held_out
        marks = ~self.is_tie
        scaled = self.fit.pixels / self.sigma[:, None]
        noise = EstimatedNoise(np.sqrt(-2 * np.log1p(-np.minimum(GRID, 1 - 1e-9))))
        if ties.any():
            found = lengths(scaled[ties])
            noise = replace(noise, tie=1.2 * found)
        if len(self.fit.gnss):
            usual = noise.tie_sigma if ties.any() else 1.0
            noise = replace(noise, gnss=antenna_noise(self.system, usual))
        control_sigma = self.system.control.sigma[: len(self.system.control_rows)]
        c = len(control_sigma)
        pulls = [
            _sum_of_squares(scaled[marks]),
            _sum_of_squares(self.fit.control[:c] / control_sigma) if c else 0.0,
        ]
        trials = int(np.clip(TIES_OF_A_TRIAL // max(int(ties.sum()), 1), 1, 6))
        for trial in range(TRIALS):
            left, squares = [], []
            plain = replace(noise, control=1.0)
            drawn = (self.draw(np.random.default_rng([17, trial, k]), plain) for k in range(trials))
            for fit in self.fits(drawn):
                again = fit.pixels / self.sigma[:, None]
                left.append(again[ties])
                squares.append(
                    [
                        _sum_of_squares(again[marks]),
                        _sum_of_squares(fit.control[:c] / control_sigma) if c else 0.0,
                    ]
                )
            if ties.any():
                noise = mended(noise, found, lengths(np.concatenate(left)))
            mark, control = np.mean(squares, axis=0)
            if mark > 0:
                noise = replace(noise, mark=noise.mark * float(np.sqrt(pulls[0] / mark)))
            # Few points say little on their sigma: what is stated counts too.
            factor = (STATED_FREEDOM + pulls[1]) / (STATED_FREEDOM + control)
            noise = replace(noise, control=float(np.sqrt(factor)))
        return noise

    # --- drawing -----------------------------------------------------------------------------

    def errors(self, drawn: Measured) -> Fit:
        """The errors of a draw as residuals that nothing has absorbed."""
        fit, given = self.fit, self.measured
        return Fit(
            fit.state,
            drawn.xy - given.xy + fit.pixels,
            drawn.gnss - given.gnss + fit.gnss,
            drawn.control - given.control + fit.control,
            fit.state.points[self.check_points] - drawn.check,
            drawn.posed - given.posed + fit.posed,
            drawn.distance - given.distance + fit.distance,
        )

    def draw(self, rng: np.random.Generator, noise: EstimatedNoise | None = None) -> Measured:
        """All measurements anew: what the believed model says, and noise."""
        noise = noise or self.noise
        fit, given = self.fit, self.measured
        tie, mark, gnss, control, check, prior, attitude, distance = rng.spawn(8)
        xy = np.empty_like(fit.pixels)
        xy[self.is_tie] = noise.draw_tie(int(self.is_tie.sum()), tie)
        marks = ~self.is_tie
        xy[marks] = noise.mark * mark.standard_normal((int(marks.sum()), 2))
        xy *= self.sigma[:, None]
        xy += given.xy - fit.pixels
        antenna = np.zeros((0, 3)) if noise.gnss is None else noise.gnss.draw(gnss).reshape(-1, 3)
        ground = noise.control * self.system.control.sigma
        # That the ends of distances are their points is no measurement.
        ground[len(self.system.control_rows) :] = 0.0
        of_check = noise.control * self.check_sigma
        columns = self.system.columns
        weight = columns.prior_weight[columns.shared_at]
        known = weight > 0
        value = given.prior.copy()
        if known.any():
            sigma = weight[known] ** -0.5
            value[known] = columns.shared_value[known] + sigma * prior.standard_normal(len(sigma))
        return Measured(
            xy=xy,
            gnss=given.gnss - fit.gnss + antenna,
            control=given.control
            - fit.control
            + ground * control.standard_normal(fit.control.shape),
            prior=value,
            check=fit.state.points[self.check_points]
            + of_check * check.standard_normal(of_check.shape),
            posed=given.posed
            - fit.posed
            + self.system.posed.sigma * attitude.standard_normal(fit.posed.shape),
            distance=given.distance
            - fit.distance
            + self.system.distance.sigma * distance.standard_normal(fit.distance.shape),
        )


def _loss(adjustment: Adjustment) -> Loss:
    """The adjustment's loss; a robust one where squares were fitted to many wrong matches.

    Least squares spread a gross error over its surroundings, where no noise can imitate it.
    """
    system = adjustment.system
    loss, rows = system.loss, system.image_rows
    if loss.kind != LOSSES["squares"] or not rows.tie.any():
        return loss
    length = (np.hypot(*system.residuals().pixels.T) / rows.sigma)[rows.tie]
    usual = robust_scale_of_lengths(length, least=1e-9)
    if np.mean(is_outlier(length, usual, UNUSABLE)) < GROSS_SHARE:
        return loss
    return Loss(LOSSES["huber"], 2 * usual)


def _held_out(rows: ImageRows) -> np.ndarray:
    """Tie observations (n,) bool that no fit uses."""
    out = np.zeros(len(rows.tie), dtype=bool)
    ties = np.flatnonzero(rows.tie)
    if len(ties):
        rng = np.random.default_rng(11)
        among = rng.random(len(ties)) < HELD_OUT
        out[ties[spared(rows.point[ties], rng, among)]] = True
    return out


def _check_points(system: LinearSystem) -> tuple[np.ndarray, np.ndarray]:
    """Rows of ground.csv of the check points that images show, and their points."""
    rows, points = np.flatnonzero(system.roles == "check"), system.points
    if system.held is not None or not len(rows):
        # A free network lies where its start poses were, not where the check points are.
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    marks = np.flatnonzero(points.mark)
    at = pd.Index(points.names[marks]).get_indexer(system.block.ground["point"].iloc[rows])
    return rows[at >= 0], marks[at[at >= 0]]


def _ground_moved(
    system: LinearSystem, rows: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivative (3c, n) by the columns of what effects do to ground points, and that (c, 3), m.

    rows: of ground.csv. points: where they are in the state.
    """
    state, stack, columns = system.state, system.problem.stack, system.columns
    names = system.block.ground["point"].iloc[rows].astype(str).tolist()

    def moved(effects: dict) -> np.ndarray:
        return stack.moved_ground(system.images, names, state.points[points], effects)

    here = moved(state.effects)
    out = np.zeros((3 * len(rows), len(columns)))
    ground = {member.effect.slug for member in stack.at("ground")}
    for unknown, column in zip(columns.shared, columns.shared_at, strict=True):
        if unknown.kind == "effect" and unknown.owner in ground and len(rows):
            value = state.effects[unknown.owner].copy()
            value[unknown.at] += 1.0
            out[:, column] = (moved(state.effects | {unknown.owner: value}) - here).ravel()
    return out, here


def _sum_of_squares(pulls: np.ndarray) -> float:
    """Of residuals in standard deviations, none counting more than WINSORIZED of them."""
    return float(np.sum(np.clip(pulls, -WINSORIZED, WINSORIZED) ** 2))
