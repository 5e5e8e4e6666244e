"""The simulated counterpart: this very block, had the believed model been the whole truth.

Same images, points, gaps, control and epochs; every observation anew, from the adjusted model and
noise of the sizes and kinds that the residuals show; then adjusted again. What many counterparts
have in common is what the believed model produces after poses and points have absorbed what they
can, and beside it stands what was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from corridor import adjustment as least_squares
from corridor.adjustment import LOSSES, Loss, Normal, one_step
from corridor.block import Block
from corridor.camera import quaternion_from_rotation
from corridor.diagnosis.estimated_noise import (
    GRID,
    TRUST,
    EstimatedNoise,
    Series,
    gnss_noise,
    lengths,
    mended,
    series_of,
)
from corridor.diagnosis.statistics import Fit, Ruler, Statistic
from corridor.effects import add
from corridor.errors import InputError
from corridor.simulation import Simulated

if TYPE_CHECKING:
    from corridor.adjustment import Adjustment

# With 39 counterparts the second largest of 40 is the 95 % limit, exactly.
COUNT = 39
LEAST = 19
# Share of the tie observations that no fit uses, and rays that a point keeps at least.
HELD_OUT, RAYS_LEFT = 0.05, 3
# The last tenth of a per mille of a step changes no statistic.
TOLERANCE = 1e-3
# With more than this share of the residuals beyond so many usual deviations, matches are wrong.
WRONG, FAR = 0.002, 6.0
# Tie observations from which on one trial says enough on the noise.
MANY = 20_000
TRIALS = 3
# Share of the raw noise below which a value says nothing: the adjustment makes it zero.
ABSORBED = 0.01
PULL = 2.5


@dataclass(frozen=True)
class Measured:
    """Everything measured, in the order of the problem; px and m.

    prior: value of the priors of shared unknowns. check: given coordinates of the check points.
    """

    xy: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    prior: np.ndarray
    check: np.ndarray


class Simulator:
    """The model one believes in, as an adjustment found it; draws counterparts and adjusts them.

    held_out: (observations,) bool, image observations that no fit uses. fit: the measured block
    adjusted without them, `Fit`. noise: `EstimatedNoise`. Blocks with many wrong matches are fitted
    robustly, the measured one and its counterparts.
    """

    def __init__(self, adjustment: Adjustment):
        p = adjustment.problem
        self.loss = _loss(adjustment)
        self.pins = adjustment.normal.pins
        self.held_out = _held_out(p)
        weight = np.broadcast_to(p.weight, len(p.img)).copy()
        self.sigma = 1.0 / weight
        weight[self.held_out] = 0.0
        self.is_tie = p.row < p.tie_count
        self.check_rows, self.check_points = _check_points(p, free=len(self.pins) > 0)
        ground = p.block.ground
        given = ground[["x", "y", "z"]].to_numpy(float)
        self.measured = Measured(
            p.xy, p.gnss_given, p.control_given, p.prior_value, given[self.check_rows]
        )
        self.check_sigma = p.block.ground_sigma()[self.check_rows]
        self.series: list[Series] = series_of(p)
        self.problem = replace(p, weight=weight, start=adjustment.state)
        self.fit, normal = self._adjust(self.measured, near=False)
        self.problem = replace(self.problem, start=self.fit.state)
        self.noise = self._estimate(normal)

    # --- adjusting ---------------------------------------------------------------------------

    def adjust(self, measured: Measured) -> Fit:
        """The believed model fitted to other measurements of the same things."""
        return self._adjust(measured)[0]

    def absorb(self, pixels: np.ndarray, gnss: np.ndarray, control: np.ndarray) -> Fit:
        """What is left of shifts (n, 2) px, (k, 3) m, (c, 3) m of what the model says."""
        p, fit, given = self.problem, self.fit, self.measured
        shifted = Measured(
            xy=given.xy - fit.pixels + pixels,
            gnss=given.gnss - fit.gnss + gnss,
            control=given.control - fit.control + control,
            prior=_shared(p, fit.state),
            check=given.check,
        )
        normal = self._normal(shifted, Loss())
        if normal.looks:
            normal.look(fit.state)
        return self._fit(normal, one_step(normal), shifted)

    def _normal(self, measured: Measured, loss: Loss) -> Normal:
        p = replace(
            self.problem,
            xy=measured.xy,
            gnss_given=measured.gnss,
            control_given=measured.control,
            prior_value=measured.prior,
        )
        normal = Normal(p, loss)
        normal.pins = self.pins
        return normal

    def _adjust(self, measured: Measured, near: bool = True) -> tuple[Fit, Normal]:
        normal = self._normal(measured, self.loss)
        state = least_squares.solve(normal, 20, TOLERANCE, near=near).state
        return self._fit(normal, state, measured), normal

    def _fit(self, normal: Normal, state, measured: Measured) -> Fit:
        p = normal.problem
        pixels, _ = normal.look(state, passes=5)
        gnss = np.zeros((0, 3))
        if len(p.gnss_image):
            images = p.images.with_poses(state.centre, state.rotation)
            gnss = p.gnss_given - normal.antenna(state, images)[0]
        control = normal.view(state).control_residual
        check = state.points[self.check_points] - measured.check
        return Fit(state, pixels, gnss, control, check)

    # --- noise -------------------------------------------------------------------------------

    def _estimate(self, normal: Normal) -> EstimatedNoise:
        ties = self.is_tie & ~self.held_out
        marks = ~self.is_tie
        scaled = self.fit.pixels / self.sigma[:, None]
        noise = EstimatedNoise(np.sqrt(-2 * np.log1p(-np.minimum(GRID, 1 - 1e-9))))
        if ties.any():
            found = lengths(scaled[ties])
            noise = noise.changed(tie=1.2 * found)
        if len(self.fit.gnss):
            usual = noise.tie_sigma if ties.any() else 1.0
            noise = noise.changed(gnss=gnss_noise(normal, self.fit.state, self.fit.gnss, usual))
        control_sigma = self.problem.control_weight**-0.5
        pulls = [
            _sum_of_squares(scaled[marks]),
            _sum_of_squares(self.fit.control / control_sigma) if len(control_sigma) else 0.0,
        ]
        trials = int(np.clip(MANY // max(int(ties.sum()), 1), 1, 6))
        for trial in range(TRIALS):
            left, squares = [], []
            for k in range(trials):
                drawn = self.draw(np.random.default_rng([17, trial, k]), noise.changed(control=1.0))
                fit = self.adjust(drawn)
                again = fit.pixels / self.sigma[:, None]
                left.append(again[ties])
                squares.append(
                    [
                        _sum_of_squares(again[marks]),
                        _sum_of_squares(fit.control / control_sigma) if len(control_sigma) else 0.0,
                    ]
                )
            if ties.any():
                noise = mended(noise, found, lengths(np.concatenate(left)))
            mark, control = np.mean(squares, axis=0)
            if mark > 0:
                noise = noise.changed(mark=noise.mark * float(np.sqrt(pulls[0] / mark)))
            # Few points say little on their sigma: what is stated counts too.
            factor = (TRUST + pulls[1]) / (TRUST + control)
            noise = noise.changed(control=float(np.sqrt(factor)))
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
        )

    def draw(self, rng: np.random.Generator, noise: EstimatedNoise | None = None) -> Measured:
        """All measurements anew: what the believed model says, and noise."""
        noise = noise or self.noise
        p, fit, given = self.problem, self.fit, self.measured
        tie, mark, gnss, control, check, prior = rng.spawn(6)
        error = np.empty_like(fit.pixels)
        error[self.is_tie] = noise.draw_tie(int(self.is_tie.sum()), tie)
        marks = ~self.is_tie
        error[marks] = noise.mark * mark.standard_normal((int(marks.sum()), 2))
        antenna = noise.draw_gnss(self.series, len(fit.gnss), gnss) * p.gnss_weight**-0.5
        ground = noise.control * p.control_weight**-0.5
        of_check = noise.control * self.check_sigma
        known = p.prior_weight > 0
        value = given.prior.copy()
        if known.any():
            sigma = p.prior_weight[known] ** -0.5
            value[known] = _shared(p, fit.state)[known] + sigma * prior.standard_normal(len(sigma))
        return Measured(
            xy=given.xy - fit.pixels + error * self.sigma[:, None],
            gnss=given.gnss - fit.gnss + antenna,
            control=given.control
            - fit.control
            + ground * control.standard_normal(fit.control.shape),
            prior=value,
            check=fit.state.points[self.check_points]
            + of_check * check.standard_normal(of_check.shape),
        )


@dataclass(eq=False)
class Counterparts:
    """What was measured beside what the believed model produces.

    statistics: what is compared, their values laid end to end; measured: (values,) of the block;
    simulated: (count, values) of its counterparts. missing: statistics that could not be formed,
    with the column to add. absorbed: (values,) bool, values of which poses and points leave
    nothing but rounding; unseen: effects of which they leave no signature. believed: the model
    and its noise.
    """

    statistics: list[Statistic]
    measured: np.ndarray
    simulated: np.ndarray
    absorbed: np.ndarray
    missing: dict[str, str]
    unseen: tuple[str, ...]
    believed: Simulator

    @property
    def noise(self) -> EstimatedNoise:
        """The noise that was drawn."""
        return self.believed.noise

    @property
    def table(self) -> pd.DataFrame:
        """Statistics of the measured block, a row a value: see `measure`."""
        return _table(self.statistics, self.measured)


def counterparts(
    adjustment: Adjustment,
    count: int = COUNT,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Counterparts:
    """Simulate the block of an adjustment again and again, and adjust it with the same model.

    count: how many counterparts, at least 19; 39 make the 95 % limits exact. threads: 1 or 2.
    progress: called with how many are done, and of how many.
    Same adjustment, count and seed: same numbers, whatever the threads. Raises InputError where
    count is too small for a band.
    """
    if count < LEAST:
        raise InputError(f"{count} counterparts make no 95 % band: ask for {LEAST} or more")
    # Threads that each limit the libraries' own would leave the limit behind them.
    with threadpool_limits(1):
        believed = Simulator(adjustment)
        ruler = Ruler(believed)
        measured = ruler(believed.fit)
        simulated = np.empty((count, len(measured)))

        def one(k: int) -> None:
            drawn = believed.draw(np.random.default_rng([seed, k]))
            simulated[k] = ruler(believed.adjust(drawn))

        for done, _ in enumerate(_each(one, count, threads), start=1):
            if progress:
                progress(done, count)
        streams = np.random.default_rng([seed, count]).spawn(8)
        raw = np.stack([ruler(believed.errors(believed.draw(rng))) for rng in streams])
    # Signatures are normed to what is left of them.
    normed = np.repeat([s.kind == "signature" for s in ruler.statistics], ruler.lengths)
    absorbed = (_spread(simulated) < ABSORBED * _spread(raw)) & ~normed
    return Counterparts(
        ruler.statistics, measured, simulated, absorbed, ruler.missing, ruler.unseen, believed
    )


def _spread(values: np.ndarray) -> np.ndarray:
    """Half the values lie in it: one that was cut in a single draw does not count."""
    return np.subtract(*np.percentile(values, [75, 25], axis=0))


def _each(work: Callable[[int], None], count: int, threads: int) -> Iterator[None]:
    if threads < 2:
        for k in range(count):
            yield work(k)
        return
    with ThreadPoolExecutor(min(threads, 2)) as pool:
        for job in as_completed([pool.submit(work, k) for k in range(count)]):
            yield job.result()


def measure(adjustment: Adjustment) -> pd.DataFrame:
    """Every statistic of an adjusted block, a row a value.

    statistic, kind, unit; axis and the position on it (x, and y where it is a map), label; value.
    Held-out tie observations are taken from the fit, which is repeated without them.
    """
    with threadpool_limits(1):
        believed = Simulator(adjustment)
        ruler = Ruler(believed)
        return _table(ruler.statistics, ruler(believed.fit))


def _table(statistics: list[Statistic], values: np.ndarray) -> pd.DataFrame:
    parts, first = [], 0
    for one in statistics:
        at = one.at if one.at.ndim == 2 else np.column_stack([one.at, np.full(len(one.at), np.nan)])
        parts.append(
            pd.DataFrame(
                {
                    "statistic": one.name, "kind": one.kind, "axis": one.axis, "x": at[:, 0],
                    "y": at[:, 1], "label": one.labels or "",
                    "value": values[first : first + len(one)], "unit": one.unit,
                }
            )
        )  # fmt: skip
        first += len(one)
    return pd.concat(parts, ignore_index=True)


# --- one counterpart as a block ------------------------------------------------------------------


def counterpart(
    adjustment: Adjustment, seed: int = 0, effects: Mapping[str, Mapping] | None = None
) -> Simulated:
    """One simulated counterpart as a block: the measured one's, had the model been the truth.

    Start values are those of the measured block. Marks of ground points with the role `unused`
    are left out, and so is a track: the model says nothing on them. `truth` holds the adjusted
    model and the noise that was drawn.

    effects: `{slug: {parameter: value}}` on top, which the believed model does not have.
    """
    effects = effects or {}
    with threadpool_limits(1):
        believed = Simulator(adjustment)
    p, drawn = believed.problem, believed.draw(np.random.default_rng([seed, 0]))
    block = p.block.copy()
    xy = np.full((len(block.tie_points) + len(block.marks), 2), np.nan)
    xy[p.row] = drawn.xy
    for table, values in (("tie_points", xy[: p.tie_count]), ("marks", xy[p.tie_count :])):
        frame = getattr(block, table).assign(x=values[:, 0], y=values[:, 1])
        frame = frame[np.isfinite(values[:, 0])].reset_index(drop=True)
        frame["point"] = frame["point"].cat.remove_unused_categories()
        setattr(block, table, frame)
    if len(drawn.gnss):
        known = np.flatnonzero(np.isfinite(block.gnss[["x", "y", "z"]].to_numpy(float)).all(axis=1))
        block.gnss.loc[block.gnss.index[known], ["x", "y", "z"]] = drawn.gnss
    for rows, values in ((p.control_rows, drawn.control), (believed.check_rows, drawn.check)):
        if len(rows):
            block.ground.loc[block.ground.index[rows], ["x", "y", "z"]] = values
    block.ground["role"] = p.roles
    block.track = block.track.iloc[:0]
    block.folder, block._files = None, {}
    if effects:
        block = _with_effects(block, believed, effects)
    values = {name: getattr(block, name) for name in Block.__dataclass_fields__}
    truth = _truth(believed, seed)
    truth["effects"] |= {slug: dict(given) for slug, given in effects.items()}
    return Simulated(**values, truth=truth)


def _with_effects(block: Block, believed: Simulator, effects: Mapping[str, Mapping]) -> Block:
    """The block as measured with effects on top, which act where the adjusted model has it."""
    p, state = believed.problem, believed.fit.state
    doubled = [slug for slug in effects if slug.partition("@")[0] in p.stack.members]
    if doubled:
        raise InputError(f"effect {doubled[0]} is estimated already: it cannot come on top as well")
    there, order = block.copy(), np.argsort(p.order)
    quaternion = quaternion_from_rotation(state.rotation)[order]
    pose = np.concatenate([state.centre[order], quaternion], axis=1)
    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    there.images = there.images.assign(**dict(zip(names, pose.T, strict=True)))
    points = pd.DataFrame(state.points, columns=["x", "y", "z"])
    points.insert(0, "point", p.point_names)
    there.points = points
    there.cameras = {
        name: camera.with_interior(interior)
        for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
    }
    moved = add(there, effects)
    for table in ("tie_points", "marks", "gnss", "ground"):
        setattr(block, table, getattr(moved, table))
    return block


def _truth(believed: Simulator, seed: int) -> dict:
    p, state = believed.problem, believed.fit.state
    noise, block = believed.noise, p.block

    def rows(names, values) -> dict:
        return dict(zip(list(names), np.asarray(values).tolist(), strict=True))

    effects = {}
    for slug, member in p.stack.members.items():
        # Values of images are kept in the order of the problem.
        groups = list(p.images.names) if member.effect.group == "image" else member.groups
        by_name = {
            parameter.name: rows(groups, state.effects[slug][:, n])
            for n, parameter in enumerate(member.parameters)
        }
        single = member.effect.group == "block"
        effects[slug] = {
            name: next(iter(values.values())) if single else values
            for name, values in by_name.items()
        }
    named = p.point_names
    ground = block.ground[["x", "y", "z"]].to_numpy(float).copy()
    at = pd.Index(named[p.point_kinds]).get_indexer(block.ground["point"])
    seen = at >= 0
    ground[seen] = state.points[p.point_kinds][at[seen]]
    order = np.argsort(p.order)
    cameras = {
        name: camera.with_interior(interior).to_table()
        for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
    }
    return {
        "block": block.name,
        "like": block.name,
        "seed": seed,
        "noise": {
            "tie_sigmas": noise.tie_sigma,
            "mark_sigmas": noise.mark,
            "control_sigmas": noise.control,
            "gnss": {
                f"{p.images.flight_names[flight]}.{'xyz'[axis]}": {
                    "white_sigmas": kind.white,
                    "slow_sigmas": kind.slow,
                    "constant_s": kind.constant_s,
                }
                for (flight, axis), kind in noise.gnss.items()
            },
        },
        "camera": cameras,
        "effects": effects,
        "lever_arm": rows(p.images.flight_names, state.arms) if len(p.gnss_image) else {},
        "centre": rows(block.images["image"], state.centre[order]),
        "quaternion": rows(block.images["image"], quaternion_from_rotation(state.rotation)[order]),
        "ground": rows(block.ground["point"], ground),
        "points": rows(named[~p.point_kinds], state.points[~p.point_kinds]),
    }


# --- helpers -------------------------------------------------------------------------------------


def _loss(adjustment: Adjustment) -> Loss:
    """The adjustment's loss; a robust one where squares were fitted to many wrong matches.

    Least squares spread a gross error over its surroundings, where no noise can imitate it.
    """
    loss, p = adjustment.normal.loss, adjustment.problem
    if loss.kind != LOSSES["squares"] or not p.tie_count:
        return loss
    pixels, _ = adjustment.normal.look(adjustment.state, passes=5)
    length = (np.hypot(*pixels.T) * p.weight)[p.row < p.tie_count]
    usual = max(float(np.median(length)) / np.sqrt(2 * np.log(2)), 1e-9)
    if np.mean(length > FAR * usual) < WRONG:
        return loss
    return Loss(LOSSES["huber"], 2 * usual)


def _held_out(p) -> np.ndarray:
    """Tie observations that no fit uses: one at most of a point, which keeps enough rays."""
    rays = np.diff(p.ptr)
    rng = np.random.default_rng(11)
    fit = ~p.point_kinds & (rays > RAYS_LEFT)
    wanted = HELD_OUT * p.tie_count
    chosen = np.flatnonzero(fit & (rng.random(len(rays)) < wanted / max(int(fit.sum()), 1)))
    out = np.zeros(len(p.img), dtype=bool)
    out[p.ptr[chosen] + rng.integers(0, rays[chosen])] = True
    return out


def _check_points(p, free: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rows of ground.csv of the check points that images show, and their points."""
    rows = np.flatnonzero(p.roles == "check")
    if free or not len(rows):
        # A free network lies where its start poses were, not where the check points are.
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    marks = np.flatnonzero(p.point_kinds)
    at = pd.Index(p.point_names[marks]).get_indexer(p.block.ground["point"].iloc[rows])
    return rows[at >= 0], marks[at[at >= 0]]


def _sum_of_squares(pulls: np.ndarray) -> float:
    """Of residuals in standard deviations, none counting more than PULL of them."""
    return float(np.sum(np.clip(pulls, -PULL, PULL) ** 2))


def _shared(p, state) -> np.ndarray:
    tables = {"camera": state.interior, "lever_arm": state.arms}
    return np.array(
        [tables.get(u.kind, state.effects.get(u.owner))[u.at] for u in p.unknowns], float
    )
