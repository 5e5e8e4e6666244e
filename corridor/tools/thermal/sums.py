"""The sums through which deformation maps enter a thermal model.

With weights 1 / sigma^2 and the monomials of the picture, each picture gives one small normal
matrix, and every model, lag and left-out block is a solution of those.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyvander2d

from corridor.core.errors import InputError, WorkFailed, some
from corridor.tools.thermal import temperature
from corridor.tools.thermal.maps import LEAST_SPAN_C, Maps
from corridor.tools.thermal.shapes import terms_of

SCALE_C = 10.0
_LEAST_PICTURES = 4
_LEAST_FOR_PATTERN = 8  # pictures, to tell the reference's noise from theirs
_LEAST_FOR_LAG = 8  # pictures
_LEAST_TURN = 0.2  # of the range, met both while warming and while cooling
_LEAST_SIGMA = 1e-4  # px: nothing is better known


@dataclass(frozen=True, eq=False)
class Solved:
    """What grows with powers of the temperature and what all pictures have alike.

    amplitude: (powers, k) of the kind's terms. of_constant: (c,) of the constant's terms; constant:
    (2, order^2), px, their polynomial, the error of the reference. power: (used, powers + 1) of
    the temperature of the optics from t0, in units of the model, the first is 1. inverse: of the
    normal matrix, of_constant first, then the amplitudes.
    steps: used pictures from which on all are shifted by jump (steps, 2) px more. of_picture:
    (used,) weighted squares left. offset: (used, 2) px, what is left of a picture's shift.
    """

    kind: str
    power: np.ndarray
    amplitude: np.ndarray
    of_constant: np.ndarray
    constant: np.ndarray
    steps: tuple[int, ...]
    jump: np.ndarray
    inverse: np.ndarray
    cost: float
    of_picture: np.ndarray
    offset: np.ndarray

    @property
    def powers(self) -> int:
        """Of the temperature, beside the constant."""
        return len(self.amplitude)

    @property
    def of_temperature(self) -> slice:
        """Where `inverse` has the amplitudes."""
        last = len(self.inverse) - 2 * len(self.steps)
        return slice(last - self.amplitude.size, last)

    def coefficients(self, terms: np.ndarray) -> np.ndarray:
        """Polynomials (powers + 1, 2, order^2) of the powers of temperature, constant first."""
        return np.concatenate(
            [self.constant[None], np.einsum("mk,kxa->mxa", self.amplitude, terms)]
        )


def _usable(maps: Maps) -> tuple[np.ndarray, list[str]]:
    """Pictures that can be used, in the order of time, and what is to be said of the others."""
    warm, notes = np.asarray(maps.temperature_c, dtype=float), []
    if not np.isfinite(warm).any():
        raise InputError(
            "no picture has a temperature: fill temperature_c in series.csv and make the maps anew"
        )
    seen = maps.valid.any(axis=1)
    unknown = seen & ~np.isfinite(warm)
    if unknown.any():
        names = some(maps.picture[unknown], 3)
        notes.append(f"{unknown.sum()} pictures without temperature are left out ({names})")
    use = seen & np.isfinite(warm)
    if np.count_nonzero(maps.reference) == 1:
        # Against itself a picture says nothing.
        use &= ~maps.reference
    if np.count_nonzero(use) < _LEAST_PICTURES:
        raise WorkFailed(
            f"{np.count_nonzero(use)} pictures with valid nodes and a temperature are too few for "
            f"a thermal model: take {_LEAST_PICTURES} or more beside the reference"
        )
    rows = np.flatnonzero(use)
    rows = rows[np.argsort(maps.time_s[rows], kind="stable")]
    span = float(np.ptp(warm[rows]))
    if span < LEAST_SPAN_C:
        raise WorkFailed(
            f"the temperatures of the usable pictures span {span:.1f} C: a thermal model needs "
            f"{LEAST_SPAN_C:g} C at least, and 25 C to be good"
        )
    return rows, notes


class Sums:
    """The sums of the usable pictures, in the order of time.

    rows: of those pictures in the maps. warm: (P,) temperatures of the thermometer that are used.
    pattern: (N, 2) px, the error of the reference at each node.
    """

    def __init__(self, maps: Maps, kind: str | None):
        self.maps = maps
        self.order = 5 if kind == "printed" else 4
        self.rows, self.notes = _usable(maps)
        self.warm = np.asarray(maps.temperature_c, dtype=float)
        self.smooth_warm = temperature.smoothed(maps.time_s, self.warm)
        self.scale_px = float(np.hypot(maps.width, maps.height)) / 2
        self.middle = (maps.width - 1) / 2, (maps.height - 1) / 2
        X, Y = (
            (place - middle) / self.scale_px
            for place, middle in zip((maps.x, maps.y), self.middle, strict=True)
        )
        shapes = polyvander2d(X, Y, [self.order - 1] * 2)
        count = len(self.rows)
        self.A = np.empty((count, shapes.shape[1], shapes.shape[1]))
        self.b = np.empty((count, shapes.shape[1], 2))
        self.squares, self.nodes = np.empty(count), np.empty(count)
        self.weight = np.empty(count)
        self.shapes = shapes
        self.pattern = np.zeros((len(maps.x), 2))
        self._patterned, self._taken = 0, 0.0
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
        for n, part in enumerate(self.residual(solved)):
            left[n, self.maps.valid[self.rows[n]]] = part
        there = np.isfinite(left[:, :, 0]).astype(float)
        left = np.nan_to_num(left)
        t = solved.power[:, 1]
        s0, s1, s2 = there.sum(axis=0), t @ there, (t**2) @ there
        sum0, sum1 = left.sum(axis=0), np.einsum("n,nkx->kx", t, left)
        det = s0 * s2 - s1**2
        good = (s0 >= _LEAST_FOR_PATTERN) & (det > 1e-6 * s0 * s2)
        constant = (s2[:, None] * sum0 - s1[:, None] * sum1)[good] / det[good, None]
        self.pattern[good] += constant + (self.shapes @ solved.constant.T)[good]
        self._patterned = int(np.count_nonzero(good))
        # n residuals less an error d of the constant, of variance v: n - 2 + n v is expected of
        # their squares, in place of n - 1 where d is their mean.
        self._taken = float(np.mean(2.0 - (s0 * s2)[good] / det[good])) if good.any() else 0.0
        self._sum_up()

    def projected(self, kind):
        """Terms of the constant (c, 2, order^2) and of a kind (k, 2, order^2); for c + k of them
        normal matrices (used, c + k, c + k), right-hand sides (used, c + k), and those of a jump.

        What the reference has wrong is no matter of temperature: its terms are the fullest, of
        every kind, so that kinds differ by what grows with temperature alone.
        """
        if kind not in self._projected:
            of_kind = terms_of(kind, self.order)
            constant = of_kind if kind == "printed" else terms_of("polynomial", self.order)
            terms = np.concatenate([constant, of_kind])
            K = np.zeros((len(self.rows), len(terms), len(terms)))
            r = np.zeros((len(self.rows), len(terms)))
            cross = np.zeros((len(self.rows), len(terms), 2))
            for axis in range(2):
                moved = terms[:, axis]
                onto = np.einsum("ka,nab->nkb", moved, self.A)
                K += onto @ moved.T
                r += np.einsum("ka,na->nk", moved, self.b[:, :, axis])
                cross[:, :, axis] = onto[:, :, 0]
            self._projected[kind] = constant, of_kind, K, r, cross
        return self._projected[kind]

    @property
    def warm(self):
        return self._warm

    @warm.setter
    def warm(self, temperature_c):
        # Many lags are tried behind one course.
        self._warm = temperature_c
        self._thermometer = temperature.Thermometer(self.maps.time_s, temperature_c)

    def optics(self, lag):
        """Temperatures of the optics of every picture (P,), and t (used,) from t0."""
        felt = self._thermometer.optics(lag)
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
        return felt, t0, (felt[self.rows] - t0) / SCALE_C

    def columns(self, kind, powers):
        """Term and power of t of each column: of the constant first, then power by power."""
        constant, terms = self.projected(kind)[:2]
        c, k = len(constant), len(terms)
        term = np.concatenate([np.arange(c), np.tile(c + np.arange(k), powers)])
        return term, np.concatenate([np.zeros(c, dtype=int), np.repeat(1 + np.arange(powers), k)])

    def normal(self, kind, powers, lag, steps=(), use=None):
        """Normal matrix, right-hand side and powers of t (used, powers + 1)."""
        *_, K, r, cross = self.projected(kind)
        _, _, t = self.optics(lag)
        power = t[:, None] ** np.arange(powers + 1)
        mask = np.ones(len(t)) if use is None else use.astype(float)
        term, of = self.columns(kind, powers)
        by = power[:, of] * mask[:, None]
        products = (power * mask[:, None])[:, :, None] * power[:, None]
        moments = np.tensordot(products, K, axes=(0, 0))
        N = moments[of[:, None], of, term[:, None], term]
        right = np.sum(by * r[:, term], axis=0)
        if len(steps):
            after = (np.arange(len(t))[:, None] >= np.asarray(steps)) * mask[:, None]
            C = np.einsum("nw,nwc,ns->wsc", by, cross[:, term], after, optimize=True)
            C = C.reshape(len(term), 2 * len(steps))
            level = np.einsum("n,ns,nq->sq", self.weight * mask, after, after)
            D = np.kron(level, np.eye(2))
            N = np.block([[N, C], [C.T, D]])
            right = np.concatenate([right, np.einsum("nc,ns->sc", self.b[:, 0], after).ravel()])
        return N, right, power

    def solve(self, kind, powers, lag, steps=(), use=None) -> Solved:
        """Weighted least squares over the pictures that are used."""
        N, right, power = self.normal(kind, powers, lag, steps, use)
        size = np.sqrt(np.diag(N))
        size[size == 0] = 1.0
        # A jump that the used pictures do not show stays at zero.
        scaled = N / np.outer(size, size) + 1e-12 * np.eye(len(N))
        inverse = np.linalg.inv(scaled) / np.outer(size, size)
        found = inverse @ right
        of_constant, terms = self.projected(kind)[:2]
        c, k = len(of_constant), len(terms)
        cut = c + powers * k
        constant = np.einsum("k,kxa->xa", found[:c], of_constant)
        amplitude, jump = found[c:cut].reshape(powers, k), found[cut:].reshape(-1, 2)
        moved = np.einsum("mk,kxa->mxa", amplitude, terms)
        spatial = _of_pictures(power, np.concatenate([constant[None], moved]), steps, jump)
        fitted = np.einsum("nab,nxb->nax", self.A, spatial)
        left = self.squares - 2 * np.einsum("nax,nxa->n", self.b, spatial)
        left = left + np.einsum("nxa,nax->n", spatial, fitted)
        offset = (self.b[:, 0] - fitted[:, 0]) / self.weight[:, None]
        mask = slice(None) if use is None else use
        return Solved(
            kind, power, amplitude, found[:c], constant, tuple(steps), jump, inverse,
            float(left[mask].sum()), left, offset,
        )  # fmt: skip

    def left_of_pictures(self, kind, powers, lags, use) -> np.ndarray:
        """Weighted squares left of each picture (lags, used), less what moves it as a whole.

        As `solve` without jumps has them at each of the lags, of many at once.
        """
        of_constant, terms, K, r, _ = self.projected(kind)
        c, count = len(of_constant), len(self.rows)
        term, of = self.columns(kind, powers)
        t = np.array([self.optics(lag)[2] for lag in lags])
        power = t[:, None] ** np.arange(2 * powers + 1)[:, None]
        masked = power if use is None else power * use
        moments = (masked.reshape(-1, count) @ K.reshape(count, -1)).reshape(
            *power.shape[:2], *K.shape[1:]
        )
        N = moments[:, of[:, None] + of, term[:, None], term]
        right = (masked[:, : powers + 1] @ r)[:, of, term]
        size = np.sqrt(np.einsum("lkk->lk", N))
        size[size == 0] = 1.0
        scaled = N / (size[:, :, None] * size[:, None]) + 1e-12 * np.eye(len(term))
        found = np.linalg.solve(scaled, (right / size)[:, :, None])[:, :, 0] / size
        flat = [of_constant.reshape(c, -1), terms.reshape(len(terms), -1)]
        amplitude = found[:, c:].reshape(len(lags), powers, len(terms))
        coefficients = np.concatenate(
            [(found[:, :c] @ flat[0])[:, None], amplitude @ flat[1]], axis=1
        )
        spatial = power[:, : powers + 1].swapaxes(1, 2) @ coefficients
        spatial = spatial.reshape(len(lags), count, 2, -1)
        fitted = spatial @ self.A
        b = self.b.swapaxes(1, 2)
        left = self.squares + np.einsum("lnxa,lnxa->ln", spatial, fitted - 2 * b)
        return left - np.sum((b[:, :, 0] - fitted[..., 0]) ** 2, axis=2) / self.weight

    def freedom(self, solved) -> float:
        """What is expected of the weighted squares left, in squares of unit weight."""
        constant = len(solved.of_constant)
        # Below the constant's own polynomial the solution has adjusted what was taken out.
        taken = len(solved.inverse) + self._taken * max(2 * self._patterned - constant, 0)
        return float(max(2 * self.nodes.sum() - taken, 1.0))

    def most_powers(self, wanted):
        """Powers of T that the temperatures can tell apart."""
        different = len(np.unique(np.round(self.warm[self.rows], 1)))
        return max(1, min(wanted, different - 2, len(self.rows) - 2))

    def residual(self, solved, jumps=True):
        """Measured minus modelled (nodes, 2) px of each used picture; with or without its jumps."""
        steps, jump = (solved.steps, solved.jump) if jumps else ((), ())
        coefficients = solved.coefficients(self.projected(solved.kind)[1])
        spatial = _of_pictures(solved.power, coefficients, steps, jump)
        out = []
        for n, row in enumerate(self.rows):
            valid = self.maps.valid[row]
            out.append(self.measured(row)[valid] - self.shapes[valid] @ spatial[n].T)
        return out

    @property
    def longest_lag(self) -> float:
        """Half of the series, s."""
        return 0.5 * float(np.ptp(self.maps.time_s[self.rows]))

    @property
    def shows_lag(self) -> bool:
        """Whether the series warms and cools through the same temperatures."""
        share = temperature.turns(self.maps.time_s[self.rows], self.warm[self.rows])
        return share >= _LEAST_TURN and len(self.rows) >= _LEAST_FOR_LAG


def _of_pictures(power, coefficients, steps, jump):
    """Fitted polynomials (used, 2, order^2) of the pictures, px."""
    fitted = np.einsum("nm,mxa->nxa", power, coefficients)
    for step, size in zip(steps, jump, strict=True):
        fitted[step:, :, 0] += size
    return fitted
