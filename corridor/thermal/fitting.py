"""A thermal model from deformation maps.

The maps enter through their sums: with weights 1 / sigma^2 and the monomials of the picture, each
picture gives one small normal matrix, and every model, lag and left-out block is a solution of
those.

Which terms a model gets is decided by leaving out blocks of temperature and predicting them. The
pixels of a picture share its errors (its temperature, its reference), so that criteria which count
pixels always ask for more terms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from corridor.errors import AdjustmentFailed, InputError
from corridor.geometry import robust_scale
from corridor.thermal import temperature
from corridor.thermal.maps import Maps
from corridor.thermal.model import KINDS, ThermalModel
from corridor.thermal.shapes import monomials, terms_of

_SCALE_C = 10.0
_LEAST_PICTURES = 4
_LEAST_FOR_PATTERN = 8  # pictures, to tell the reference's noise from theirs
_LEAST_SPAN = 1.0  # C
_MOST_POWERS = 3
_BLOCKS = 6
_LEAST_FOR_LAG = 8  # pictures
_LEAST_TURN = 0.2  # of the range, met both while warming and while cooling
_MOST_STEPS = 3
_LEAST_SIGMA = 1e-4  # px: nothing is better known
_LEAST_STEP = 0.03  # px: a smaller jump of the tripod does not matter


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model, and what it was chosen from.

    model: the thermal model. pictures: one row a picture: picture, time_s, thermometer_c,
    optics_c, used, cooling (bool), shift_x, shift_y (px), scale (ppm), rotation (microradians) as
    its own map has them, residual_px. cross_validation: kind, powers, rms_px (of predicted blocks,
    an axis), chosen.
    """

    model: ThermalModel
    pictures: pd.DataFrame
    cross_validation: pd.DataFrame


def fit(
    maps: Maps,
    kind: str | None = None,
    powers: int | None = None,
    lag_s: float | None = None,
    smooth: bool | None = None,
) -> Fit:
    """The thermal model of a series.

    kind: similarity, radial, decentring, polynomial (i, j = 0..3), or `printed` (eq. 6.3 of Zhou
        2019, i, j = 1..4: for comparison). powers: of T - T0. lag_s: hold it at this value.
        smooth: the temperatures over time first. Each is found from the maps unless given.
    Raises InputError without temperatures, AdjustmentFailed where they say too little.
    """
    work = _Work(maps, kind)
    notes = list(maps.warnings) + work.notes
    rough = "decentring" if kind is None else kind
    if smooth is None:
        smooth = work.better_smoothed(rough, lag_s)
    if smooth:
        work.warm = work.smooth_warm
    lag, lag_sigma, note = work.lag(rough) if lag_s is None else (float(lag_s), None, None)
    steps = work.steps(rough, lag or 0.0) if kind != "printed" else []
    if steps and lag_s is None:
        # A jump looks like a lag, and a lag a little like a jump.
        lag, lag_sigma, note = work.lag(rough, None, steps)
        steps = work.steps(rough, lag or 0.0)
    if kind != "printed":
        work.remove_error_of_reference(lag or 0.0, steps)
    table = work.cross_validate(kind, powers, lag or 0.0, steps)
    kind, powers = table.loc[table["chosen"], ["kind", "powers"]].iloc[0]
    if lag_s is None and lag is not None:
        lag, lag_sigma, note = work.lag(kind, int(powers), steps)
    if note:
        notes.append(note)
    notes += [work.say_step(step) for step in steps]
    solved = work.solve(kind, int(powers), lag or 0.0, steps)
    if kind != "printed" and work.apart(solved):
        notes.append(
            "the picture as a whole jumps between the reference and "
            f"{maps.picture[work.rows[0]]}, beyond what temperature explains: the tripod or the "
            "camera was moved; the jump was fitted and left out of the model"
        )
    model = work.model(solved, lag, lag_sigma, steps, tuple(dict.fromkeys(notes)))
    model = replace(model, extra={"smoothed_temperature": bool(smooth)})
    return Fit(model, work.pictures(solved, model, lag or 0.0), table)


@dataclass
class _Solved:
    """Amplitudes (powers + 1, k) of spatial terms (constant first), and what they leave."""

    kind: str
    powers: int
    t: np.ndarray  # (used,) temperature of the optics from t0, in units of the model
    amplitude: np.ndarray
    jump: np.ndarray  # (steps, 2) px
    inverse: np.ndarray
    cost: float
    of_picture: np.ndarray  # weighted squares left of each used picture
    offset: np.ndarray  # (used, 2) px, what is left of the picture's shift


class _Work:
    """The sums of the usable pictures, in the order of time."""

    def __init__(self, maps: Maps, kind: str | None):
        self.maps, self.notes = maps, []
        self.order = 5 if kind == "printed" else 4
        warm = np.asarray(maps.temperature_c, dtype=float)
        if not np.isfinite(warm).any():
            raise InputError(
                "no picture has a temperature: fill temperature_c in series.csv and make the maps "
                "anew"
            )
        seen = maps.valid.any(axis=1)
        unknown = seen & ~np.isfinite(warm)
        if unknown.any():
            self.notes.append(
                f"{np.count_nonzero(unknown)} pictures without temperature are left out "
                f"({_some(maps.picture[unknown])})"
            )
        use = seen & np.isfinite(warm)
        if np.count_nonzero(maps.reference) == 1:
            # Against itself a picture says nothing.
            use &= ~maps.reference
        if np.count_nonzero(use) < _LEAST_PICTURES:
            raise AdjustmentFailed(
                f"{np.count_nonzero(use)} pictures with valid nodes and a temperature are too few "
                f"for a thermal model: take {_LEAST_PICTURES} or more beside the reference"
            )
        rows = np.flatnonzero(use)
        self.rows = rows[np.argsort(maps.time_s[rows], kind="stable")]
        span = float(np.ptp(warm[self.rows]))
        if span < _LEAST_SPAN:
            raise AdjustmentFailed(
                f"the temperatures of the usable pictures span {span:.1f} C: a thermal model needs "
                f"{_LEAST_SPAN:g} C at least, and 25 C to be good"
            )
        self.warm = warm
        self.smooth_warm = temperature.smoothed(maps.time_s, warm)
        self.scale_px = float(np.hypot(maps.width, maps.height)) / 2
        self.middle = (maps.width - 1) / 2, (maps.height - 1) / 2
        shapes = monomials(
            (maps.x - self.middle[0]) / self.scale_px,
            (maps.y - self.middle[1]) / self.scale_px,
            self.order,
        )
        count = len(self.rows)
        self.A = np.empty((count, shapes.shape[1], shapes.shape[1]))
        self.b = np.empty((count, shapes.shape[1], 2))
        self.squares, self.nodes = np.empty(count), np.empty(count)
        self.weight = np.empty(count)
        self.shapes = shapes
        self.pattern = np.zeros((len(maps.x), 2))
        self._sum_up()

    def _sum_up(self):
        for n, row in enumerate(self.rows):
            valid = self.maps.valid[row]
            weight = 1.0 / np.maximum(self.maps.sigma[row, valid], _LEAST_SIGMA) ** 2
            inside, measured = self.shapes[valid], self.measured(row)[valid]
            self.A[n] = inside.T @ (weight[:, None] * inside)
            self.b[n] = inside.T @ (weight[:, None] * measured)
            self.squares[n] = np.sum(weight[:, None] * measured**2)
            self.nodes[n] = np.count_nonzero(valid)
            self.weight[n] = weight.sum()
        self._projected: dict[str, tuple] = {}

    def measured(self, row):
        """Shifts (nodes, 2) px of a picture less the reference's error; NaN where not valid."""
        return np.stack([self.maps.dx[row], self.maps.dy[row]], axis=1) - self.pattern

    def remove_error_of_reference(self, lag, steps):
        """Take out what every picture has alike: the noise of the reference at each node.

        It is the constant of the fullest model, and that of a straight line by temperature through
        what it leaves at each node; what grows with temperature stays.
        """
        if len(self.rows) < _LEAST_FOR_PATTERN:
            return
        solved = self.solve("polynomial", self.most_powers(2), lag, steps)
        left = np.full((len(self.rows), *self.pattern.shape), np.nan)
        for n, part in enumerate(self.residual(solved, steps)):
            left[n, self.maps.valid[self.rows[n]]] = part
        there = np.isfinite(left[:, :, 0]).astype(float)
        left = np.nan_to_num(left)
        t = solved.t
        s0, s1, s2 = there.sum(axis=0), t @ there, (t**2) @ there
        sum0, sum1 = left.sum(axis=0), np.einsum("n,nkx->kx", t, left)
        det = s0 * s2 - s1**2
        good = (s0 >= _LEAST_FOR_PATTERN) & (det > 1e-6 * s0 * s2)
        constant = (s2[:, None] * sum0 - s1[:, None] * sum1)[good] / det[good, None]
        terms = self.projected("polynomial")[0]
        fitted = self.shapes @ np.einsum("k,kxa->xa", solved.amplitude[0], terms).T
        self.pattern[good] += constant + fitted[good]
        self._sum_up()

    # --- one model -------------------------------------------------------------------------

    def projected(self, kind):
        """Normal matrices (pictures, k, k) and right-hand sides (pictures, k) of a kind."""
        if kind not in self._projected:
            terms = terms_of(kind, self.order)  # (k, 2, order^2)
            K = np.zeros((len(self.rows), len(terms), len(terms)))
            r = np.zeros((len(self.rows), len(terms)))
            for axis in range(2):
                K += np.einsum("ka,nab,lb->nkl", terms[:, axis], self.A, terms[:, axis])
                r += np.einsum("ka,na->nk", terms[:, axis], self.b[:, :, axis])
            shift = np.zeros((2, 2, self.order**2))
            shift[0, 0, 0] = shift[1, 1, 0] = 1.0
            cross = np.zeros((len(self.rows), len(terms), 2))
            for axis in range(2):
                cross += np.einsum("ka,nab,lb->nkl", terms[:, axis], self.A, shift[:, axis])
            self._projected[kind] = terms, K, r, cross
        return self._projected[kind]

    def optics(self, lag):
        """Temperatures of the optics of every picture (P,), and t (used,) from t0."""
        felt = temperature.optics(self.maps.time_s, self.warm, lag)
        known = self.maps.reference & np.isfinite(felt)
        if known.any():
            t0 = float(felt[known].mean())
        else:
            # A reference without a temperature: that of the pictures around it in time.
            order = np.argsort(self.maps.time_s)
            have = order[np.isfinite(felt[order])]
            t0 = float(np.mean(np.interp(
                self.maps.time_s[self.maps.reference], self.maps.time_s[have], felt[have]
            )))  # fmt: skip
        return felt, t0, (felt[self.rows] - t0) / _SCALE_C

    def normal(self, kind, powers, lag, steps=(), use=None):
        """Normal matrix, right-hand side and powers of t (used, powers + 1)."""
        _, K, r, cross = self.projected(kind)
        _, _, t = self.optics(lag)
        power = t[:, None] ** np.arange(powers + 1)
        mask = np.ones(len(t)) if use is None else use.astype(float)
        k, wide = K.shape[1], (powers + 1) * K.shape[1]
        weighted = power * mask[:, None]
        N = np.einsum("nm,nq,nkl->mkql", weighted, power, K, optimize=True).reshape(wide, wide)
        right = np.einsum("nm,nk->mk", weighted, r).ravel()
        if len(steps):
            after = (np.arange(len(t))[:, None] >= np.asarray(steps)) * mask[:, None]
            C = np.einsum("nm,nkc,ns->mksc", power, cross, after, optimize=True)
            C = C.reshape(wide, 2 * len(steps))
            level = np.einsum("n,ns,nq->sq", self.weight * mask, after, after)
            D = np.kron(level, np.eye(2))
            N = np.block([[N, C], [C.T, D]])
            right = np.concatenate([right, np.einsum("nc,ns->sc", self.b[:, 0], after).ravel()])
        return N, right, power, k

    def solve(self, kind, powers, lag, steps=(), use=None) -> _Solved:
        """Weighted least squares over the pictures that are used."""
        N, right, power, k = self.normal(kind, powers, lag, steps, use)
        size = np.sqrt(np.diag(N))
        size[size == 0] = 1.0
        # A jump that the used pictures do not show stays at zero.
        scaled = N / np.outer(size, size) + 1e-12 * np.eye(len(N))
        inverse = np.linalg.inv(scaled) / np.outer(size, size)
        found = inverse @ right
        cut = (powers + 1) * k
        amplitude, jump = found[:cut].reshape(powers + 1, k), found[cut:].reshape(-1, 2)
        terms = self.projected(kind)[0]
        spatial = np.einsum("nm,mk,kxa->nxa", power, amplitude, terms, optimize=True)
        for step, size_of in zip(steps, jump, strict=True):
            spatial[step:, :, 0] += size_of
        fitted = np.einsum("nab,nxb->nax", self.A, spatial)
        left = self.squares - 2 * np.einsum("nax,nxa->n", self.b, spatial)
        left = left + np.einsum("nxa,nax->n", spatial, fitted)
        offset = (self.b[:, 0] - fitted[:, 0]) / self.weight[:, None]
        mask = slice(None) if use is None else use
        return _Solved(
            kind, powers, self.optics(lag)[2], amplitude, jump, inverse,
            float(left[mask].sum()), left, offset,
        )  # fmt: skip

    # --- what is chosen --------------------------------------------------------------------

    def better_smoothed(self, kind, lag) -> bool:
        """Whether the maps follow the smoothed temperatures better than those written down."""
        kept, cost = self.warm, []
        for warm in (kept, self.smooth_warm):
            self.warm = warm
            one = 0.0 if lag is None else lag
            if lag is None and self.shows_lag:
                one = self.best_lag(kind)
            cost.append(self.solve(kind, self.most_powers(2), one).cost)
        self.warm = kept
        return bool(cost[1] < cost[0])

    def most_powers(self, wanted):
        """Powers of T that the temperatures can tell apart."""
        different = len(np.unique(np.round(self.warm[self.rows], 1)))
        return max(1, min(wanted, different - 2, len(self.rows) - 2))

    def cross_validate(self, kind, powers, lag, steps) -> pd.DataFrame:
        """Error of predicting each block of temperature from the others, by model."""
        felt = self.optics(lag)[0][self.rows]
        number = min(_BLOCKS, len(felt) // 2)
        block = np.empty(len(felt), dtype=int)
        block[np.argsort(felt, kind="stable")] = np.arange(len(felt)) * number // len(felt)
        kinds = KINDS if kind is None else (kind,)
        most = self.most_powers(_MOST_POWERS)
        tried = range(1, most + 1) if powers is None else (powers,)
        rows, errors = [], []
        for one in kinds:
            for power in tried:
                part = []
                for n in range(number):
                    solved = self.solve(one, power, lag, steps, block != n)
                    # What shakes a picture as a whole says nothing about the model's shape.
                    shaken = self.weight * np.sum(solved.offset**2, axis=1)
                    left = solved.of_picture - shaken
                    part.append(left[block == n].sum() / (2 * self.nodes[block == n].sum()))
                errors.append(part)
                rows.append((one, power))
        errors = np.array(errors)
        # The weights are 1 / sigma^2: back to pixels.
        typical = float(np.sqrt(self.nodes.sum() / self.weight.sum()))
        best = int(np.argmin(errors.mean(axis=1)))
        least = errors[best].mean()
        order = np.argsort([KINDS.index(k) * 10 + p if k in KINDS else p for k, p in rows])
        chosen = best
        for n in order:
            worse = errors[n] - errors[best]
            spread = worse.std(ddof=1) / np.sqrt(number) if number > 1 else 0.0
            # As good as the best within one standard error, or so nearly that it does not matter.
            if worse.mean() <= np.clip(spread, 0.05 * least, 0.1 * least):
                chosen = int(n)
                break
        table = pd.DataFrame(rows, columns=["kind", "powers"])
        table["rms_px"] = typical * np.sqrt(np.maximum(errors.mean(axis=1), 0.0))
        table["chosen"] = np.arange(len(table)) == chosen
        return table

    def best_lag(self, kind, powers=None, steps=(), use=None, near=None) -> float:
        """The lag that leaves least, s; near: look only from half to twice of it."""
        powers = self.most_powers(2) if powers is None else powers

        def cost(lag):
            return self.solve(kind, powers, lag, steps, use).cost

        if near is None:
            tried = np.concatenate([[0.0], np.geomspace(1.0, max(self.longest_lag, 2.0), 20)])
            values = [cost(lag) for lag in tried]
            n = int(np.argmin(values))
            low, high = tried[max(n - 1, 0)], tried[min(n + 1, len(tried) - 1)]
        else:
            low, high = near / 2, 2 * near + 1
        found = minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"xatol": 0.01 * high}
        )
        return float(found.x)

    @property
    def longest_lag(self) -> float:
        """Half of the series, s."""
        return 0.5 * float(np.ptp(self.maps.time_s[self.rows]))

    @property
    def shows_lag(self) -> bool:
        """Whether the series warms and cools through the same temperatures."""
        share = temperature.turns(self.maps.time_s[self.rows], self.warm[self.rows])
        return share >= _LEAST_TURN and len(self.rows) >= _LEAST_FOR_LAG

    def lag(self, kind, powers=None, steps=()):
        """Lag and its sigma, s, or None and a sentence where it cannot be seen."""
        if not self.shows_lag:
            return _no_lag(
                "the series does not go through the same temperatures while warming and while "
                "cooling"
            )
        lag = self.best_lag(kind, powers, steps)
        # Errors of neighbouring pictures are alike: whole stretches of time are left out.
        parts = min(6, len(self.rows) // 2)
        part = np.arange(len(self.rows)) * parts // len(self.rows)
        without = np.array(
            [self.best_lag(kind, powers, steps, part != n, lag) for n in range(parts)]
        )
        sigma = float(np.sqrt((parts - 1) / parts * np.sum((without - without.mean()) ** 2)))
        sigma = max(sigma, 0.05)
        if lag >= 0.95 * self.longest_lag or sigma > max(0.5 * lag, 0.1 * self.longest_lag):
            return _no_lag(f"{lag:.0f} s are found with a sigma of {sigma:.0f} s")
        return lag, sigma, None

    # --- a moved tripod --------------------------------------------------------------------

    def steps(self, kind, lag) -> list[int]:
        """Used pictures from which on the whole series is shifted beyond the model."""
        powers, found = self.most_powers(2), []
        for _ in range(_MOST_STEPS):
            before = self.solve(kind, powers, lag, found)
            place, alone = _most_abrupt(before.offset, found)
            if place is None:
                break
            steps = sorted([*found, place])
            after = self.solve(kind, powers, lag, steps)
            jump = np.hypot(*after.jump[steps.index(place)])
            noise = robust_scale(np.hypot(*np.diff(after.offset, axis=0).T)) / 1.18
            worth = before.cost / max(after.cost, 1e-300)
            if min(jump, alone) < max(_LEAST_STEP, 8 * noise) or worth < 1.5:
                break
            found = steps
        return found

    def apart(self, solved) -> bool:
        """Whether all pictures are shifted against the reference beyond the model."""
        terms = self.projected(solved.kind)[0]
        constant, slope = (
            self.shapes @ np.einsum("k,kxa->xa", one, terms).T for one in solved.amplitude[:2]
        )
        constant = constant + self.pattern
        # What an error of the reference's temperature makes grows and shifts as heat does.
        growth = slope - slope.mean(axis=0)
        error = np.sum(growth * constant) / max(np.sum(growth**2), 1e-12)
        shift = constant.mean(axis=0) - error * slope.mean(axis=0)
        half_a_degree = 0.5 * np.hypot(*slope.mean(axis=0)) / _SCALE_C
        return bool(np.hypot(*shift) > max(2 * _LEAST_STEP, half_a_degree))

    def say_step(self, step) -> str:
        """The warning about a jump."""
        before, after = self.maps.picture[self.rows[step - 1]], self.maps.picture[self.rows[step]]
        return (
            f"the picture as a whole jumps between {before} and {after}, beyond what temperature "
            "explains: the tripod or the camera was moved; the jump was fitted and left out of the "
            "model"
        )

    # --- the result ------------------------------------------------------------------------

    def model(self, solved: _Solved, lag, lag_sigma, steps, notes) -> ThermalModel:
        """The fitted model with its uncertainty."""
        maps, terms = self.maps, self.projected(solved.kind)[0]
        k, powers = len(terms), solved.powers
        used = slice(k, (powers + 1) * k)  # the constant term is the reference's own error
        felt, t0, t = self.optics(lag or 0.0)
        coefficients = np.einsum("mk,kxa->xma", solved.amplitude[1:], terms)
        shape = (2, powers, self.order, self.order)
        dx, dy = coefficients.reshape(shape)
        residual = self.residual(solved, steps)
        values = np.concatenate([part.ravel() for part in residual])
        noise = np.concatenate([maps.sigma[row, maps.valid[row]] for row in self.rows])
        rms = float(np.sqrt(np.mean(values**2)))
        misfit = float(np.sqrt(max(rms**2 - np.mean(noise**2), (0.25 * rms) ** 2)))
        inside = felt[self.rows]
        covariance = solved.inverse[used, used] * self.design_effect(solved, steps)
        return ThermalModel(
            kind=solved.kind, width=maps.width, height=maps.height, t0_c=t0,
            range_c=(float(min(inside.min(), t0)), float(max(inside.max(), t0))), dx=dx, dy=dy,
            middle=self.middle, scale_px=self.scale_px, scale_c=_SCALE_C, residual_px=rms,
            misfit_px=misfit, lag_s=lag, lag_sigma_s=lag_sigma, warnings=notes,
            terms=terms.reshape(k, 2, self.order, self.order), covariance=covariance,
            beyond_px_c=self.beyond(solved, lag or 0.0, steps, inside, t0),
        )  # fmt: skip

    def residual(self, solved, steps):
        """Measured minus modelled (nodes, 2) px of each used picture."""
        terms = self.projected(solved.kind)[0]
        t = solved.t
        power = t[:, None] ** np.arange(solved.powers + 1)
        spatial = np.einsum("nm,mk,kxa->nxa", power, solved.amplitude, terms, optimize=True)
        for step, size in zip(steps, solved.jump, strict=True):
            spatial[step:, :, 0] += size
        out = []
        for n, row in enumerate(self.rows):
            valid = self.maps.valid[row]
            out.append(self.measured(row)[valid] - self.shapes[valid] @ spatial[n].T)
        return out

    def design_effect(self, solved, steps) -> float:
        """By how much the errors that a picture's nodes share make the amplitudes worse."""
        terms, K, r, cross = self.projected(solved.kind)
        t = solved.t
        power = t[:, None] ** np.arange(solved.powers + 1)
        each = np.einsum("nm,mk->nk", power, solved.amplitude)
        score = r - np.einsum("nkl,nl->nk", K, each)
        for step, size in zip(steps, solved.jump, strict=True):
            score[step:] -= cross[step:] @ size
        full = np.einsum("nm,nk->nmk", power, score).reshape(len(t), -1)
        wide = full.shape[1]
        inverse = solved.inverse[:wide, :wide]
        ratio = np.einsum("na,ab,nb->", full, inverse, full) / wide
        free = len(t) / max(len(t) - solved.powers - 1, 1)
        return float(max(1.0, ratio * free))

    def beyond(self, solved, lag, steps, inside, t0):
        """Slope px/C (2, 2, order, order), below and above, by which rivals part from the model."""
        rival = solved.powers + 1
        if rival > self.most_powers(_MOST_POWERS + 1):
            rival = solved.powers - 1
        if rival < 1:
            return np.zeros((2, 2, self.order, self.order))
        other = self.solve(solved.kind, rival, lag, steps)
        terms = self.projected(solved.kind)[0]
        out = []
        for edge in (inside.min(), inside.max()):
            t = (edge - t0) / _SCALE_C
            total = 0.0
            for sign, one in ((1.0, other), (-1.0, solved)):
                m = np.arange(1, one.powers + 1)
                total = total + sign * np.einsum(
                    "m,mk,kxa->xa", m * t ** (m - 1) / _SCALE_C, one.amplitude[1:], terms
                )
            out.append(total.reshape(2, self.order, self.order))
        return np.array(out)

    def pictures(self, solved, model, lag) -> pd.DataFrame:
        """Each picture's own similarity (eq. 6.2), and what the model leaves of it."""
        maps = self.maps
        felt = self.optics(lag)[0]
        table = pd.DataFrame(
            {
                "picture": maps.picture, "time_s": maps.time_s,
                "thermometer_c": maps.temperature_c, "optics_c": felt, "used": False,
            }
        )  # fmt: skip
        table.loc[self.rows, "used"] = True
        order = np.argsort(maps.time_s, kind="stable")
        rate = np.full(len(table), np.nan)
        known = order[np.isfinite(felt[order])]
        calm = temperature.smoothed(maps.time_s, maps.temperature_c)
        rate[known] = np.gradient(calm[known]) if len(known) > 1 else 0.0
        table["cooling"] = rate < 0
        names = ("shift_x", "shift_y", "scale", "rotation")
        own = np.full((len(table), 4), np.nan)
        terms, K, r, _ = self.projected("similarity")
        unit = np.array([1.0, 1.0, 1e6 / self.scale_px, 1e6 / self.scale_px])
        own[self.rows] = np.linalg.solve(K, r[..., None])[..., 0] * unit
        table[list(names)] = own
        left = np.full(len(table), np.nan)
        # Without its jumps, so that they show.
        calm = self.residual(replace(solved, jump=np.zeros((0, 2))), ())
        left[self.rows] = [np.sqrt(np.mean(part**2)) for part in calm]
        table["residual_px"] = left
        return table


def _no_lag(why):
    return None, None, (
        f"the lag of the optics behind the thermometer is not observable: {why}; it is taken as 0"
    )  # fmt: skip


def _most_abrupt(offset, known):
    """The row before which shifts (n, 2) px change most, and by how much more than around it.

    A model that does not fit changes gradually: its neighbours go the same way.
    """
    change = np.diff(offset, axis=0)
    size = np.hypot(*change.T)
    # What either neighbour does in the same direction.
    along = np.einsum("nx,nx->n", change[1:], change[:-1])
    with np.errstate(invalid="ignore", divide="ignore"):
        after = np.append(along / size[:-1], 0.0)
        before = np.append(0.0, along / size[1:])
    alone = size - 3 * np.nan_to_num(np.maximum(np.maximum(after, before), 0.0))
    alone[[n - 1 for n in known]] = -np.inf
    place = int(np.argmax(alone))
    return (place + 1, float(alone[place])) if alone[place] > 0 else (None, 0.0)


def _some(names) -> str:
    names = [str(name) for name in names]
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
