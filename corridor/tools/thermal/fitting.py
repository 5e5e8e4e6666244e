"""A thermal model from deformation maps.

Which terms a model gets is decided by leaving out blocks of temperature and predicting them. The
pixels of a picture share its errors (its temperature, its reference), so that criteria which count
pixels always ask for more terms.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.geometry import jackknife, robust_scale
from corridor.tools.thermal import temperature
from corridor.tools.thermal.maps import Maps
from corridor.tools.thermal.model import KINDS, ThermalModel
from corridor.tools.thermal.sums import SCALE_C, Solved, Sums
from corridor.tools.thermal.wrong_stamps import without_wrong_stamps

_MOST_POWERS = 3
_BLOCKS = 6
_MOST_STEPS = 3
_STRETCH = 0.2  # of the growth: a difference of the axes that is told
# No camera that works is hotter: the industrial range of electronics. No optics lag by hours.
_HOTTEST_C, _LONGEST_LAG_S = 85.0, 3600.0
# A lag that cannot be seen, as small cameras have it: Zhou 2019 and chapter 3 find 40 to 60 s.
_USUAL_LAG_S = 50.0
# Thermometers that follow the optics are tried so many usual intervals late; the share of what was
# left that then has to be left.
_LATE, _FITS_BETTER = (1, 2, 3, 4, 6, 8), 0.5
_LEAST_STEP = 0.03  # px: a smaller jump of the tripod does not matter


@brief
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
    Pictures whose temperature is not theirs are left out and named (see `wrong_stamps`).
    Raises InputError without temperatures, WorkFailed where they say too little.
    """
    rough = "decentring" if kind is None else kind
    notes = list(maps.warnings)
    _check(maps)
    maps, wrong = without_wrong_stamps(maps, rough)
    sums = Sums(maps, kind)
    notes += wrong or sums.notes
    if smooth is None:
        smooth = _better_smoothed(sums, rough, lag_s)
    if smooth:
        sums.warm = sums.smooth_warm
    lag, lag_sigma, note = _lag(sums, rough) if lag_s is None else (float(lag_s), None, None)
    steps = _steps(sums, rough, lag or 0.0) if kind != "printed" else []
    if steps and lag_s is None:
        # A jump looks like a lag, and a lag a little like a jump.
        lag, lag_sigma, note = _lag(sums, rough, None, steps)
        steps = _steps(sums, rough, lag or 0.0)
    if kind != "printed":
        sums.remove_error_of_reference(lag or 0.0, steps)
    table = _cross_validate(sums, kind, powers, lag or 0.0, steps)
    kind, powers = table.loc[table["chosen"], ["kind", "powers"]].iloc[0]
    if lag_s is None and lag is not None:
        lag, lag_sigma, note = _lag(sums, kind, int(powers), steps)
    if note:
        notes.append(note)
    notes += _of_lag(sums, kind, int(powers), lag or 0.0, steps)
    names = maps.picture[sums.rows]
    notes += [_jumps(names[step - 1], names[step]) for step in steps]
    solved = sums.solve(kind, int(powers), lag or 0.0, steps)
    if kind != "printed" and _apart(sums, solved):
        notes.append(_jumps("the reference", names[0]))
    model = _model(sums, solved, lag, lag_sigma, tuple(dict.fromkeys(notes)))
    model = replace(model, extra={"smoothed_temperature": bool(smooth)})
    return Fit(model, _pictures(sums, solved, lag or 0.0), table)


def _check(maps: Maps) -> None:
    """Raises InputError for temperatures that no camera has, and for times that are all one."""
    warm = float(np.nanmedian(maps.temperature_c)) if np.isfinite(maps.temperature_c).any() else 0.0
    if abs(warm) > _HOTTEST_C:
        raise InputError(
            f"the temperatures are {warm:.0f} (median), which no camera that works has: are they "
            "in kelvin, Fahrenheit or tenths? Write temperature_c of series.csv in degrees Celsius "
            "and make the maps anew"
        )
    if len(maps.time_s) > 1 and not np.ptp(maps.time_s) > 0:
        raise InputError(
            "all pictures have one time: write time_s of series.csv in seconds and make the maps "
            "anew"
        )


def _of_lag(sums, kind, powers, lag, steps) -> list[str]:
    """Sentences where the lag is none of optics: of hours, or of a thermometer that follows."""
    if lag > _LONGEST_LAG_S:
        return [
            f"the optics would lag {lag / 3600:.1f} h behind the thermometer, as none do: is "
            "time_s in milliseconds? Write seconds"
        ]
    time, kept = sums.maps.time_s, sums.warm
    known = np.argsort(time, kind="stable")
    known = known[np.isfinite(kept[known])]
    left, interval = (
        sums.solve(kind, powers, lag, steps).cost,
        float(np.median(np.diff(time[known]))),
    )
    cost = {}
    for late in _LATE:
        sums.warm = np.where(
            np.isfinite(kept), np.interp(time + late * interval, time[known], kept[known]), np.nan
        )
        cost[late] = sums.solve(kind, powers, 0.0, steps).cost
    sums.warm = kept
    best = min(cost, key=lambda late: cost[late])
    if not cost[best] < _FITS_BETTER * left:
        return []
    return [
        f"the pictures warm up about {best * interval:.0f} s before the thermometer does: is it "
        "far from the lens, or are its times late? The model is not to be trusted"
    ]


def _unknown_lag(sums, solved, felt, t0) -> float:
    """RMS by which the model would be another with the lag that optics usually have, px."""
    terms = sums.projected(solved.kind)[1]
    other = sums.solve(solved.kind, solved.powers, _USUAL_LAG_S, solved.steps)
    apart = (solved.coefficients(terms) - other.coefficients(terms))[1:]
    power = ((felt[sums.rows] - t0) / SCALE_C)[:, None] ** np.arange(1, solved.powers + 1)
    moved = np.einsum("nm,mxa,ka->nxk", power, apart, sums.shapes)
    return float(np.sqrt(np.mean(moved**2)))


def _better_smoothed(sums, kind, lag) -> bool:
    """Whether the maps follow the smoothed temperatures better than those written down."""
    kept, cost = sums.warm, []
    for warm in (kept, sums.smooth_warm):
        sums.warm = warm
        one = 0.0 if lag is None else lag
        if lag is None and sums.shows_lag:
            one = _best_lag(sums, kind)
        cost.append(sums.solve(kind, sums.most_powers(2), one).cost)
    sums.warm = kept
    return bool(cost[1] < cost[0])


def _cross_validate(sums, kind, powers, lag, steps) -> pd.DataFrame:
    """Error of predicting each block of temperature from the others, by model."""
    felt = sums.optics(lag)[0][sums.rows]
    number = min(_BLOCKS, len(felt) // 2)
    block = np.empty(len(felt), dtype=int)
    block[np.argsort(felt, kind="stable")] = np.arange(len(felt)) * number // len(felt)
    kinds = KINDS if kind is None else (kind,)
    most = sums.most_powers(_MOST_POWERS)
    tried = range(1, most + 1) if powers is None else (powers,)
    rows, errors = [], []
    for one in kinds:
        for power in tried:
            part = []
            for n in range(number):
                solved = sums.solve(one, power, lag, steps, block != n)
                # What shakes a picture as a whole says nothing about the model's shape.
                shaken = sums.weight * np.sum(solved.offset**2, axis=1)
                left = solved.of_picture - shaken
                part.append(left[block == n].sum() / (2 * sums.nodes[block == n].sum()))
            errors.append(part)
            rows.append((one, power))
    errors = np.array(errors)
    # The weights are 1 / sigma^2: back to pixels.
    typical = float(np.sqrt(sums.nodes.sum() / sums.weight.sum()))
    best = int(np.argmin(errors.mean(axis=1)))
    least = errors[best].mean()
    order = np.argsort([KINDS.index(k) * 10 + p if k in KINDS else p for k, p in rows])
    chosen = best
    for n in order:
        worse = errors[n] - errors[best]
        spread = worse.std(ddof=1) / np.sqrt(number) if number > 1 else 0.0
        # As good as the best within one standard error (Breiman et al. 1984).
        if worse.mean() <= min(spread, 0.1 * least):
            chosen = int(n)
            break
    table = pd.DataFrame(rows, columns=["kind", "powers"])
    table["rms_px"] = typical * np.sqrt(np.maximum(errors.mean(axis=1), 0.0))
    table["chosen"] = np.arange(len(table)) == chosen
    return table


def _best_lag(sums, kind, powers=None, steps=(), use=None, near=None) -> float:
    """The lag that leaves least, s; near: look only from half to twice of it."""
    powers = sums.most_powers(2) if powers is None else powers

    def cost(lag):
        return sums.solve(kind, powers, lag, steps, use).cost

    if near is None:
        tried = np.concatenate([[0.0], np.geomspace(1.0, max(sums.longest_lag, 2.0), 20)])
        values = [cost(lag) for lag in tried]
        n = int(np.argmin(values))
        low, high = tried[max(n - 1, 0)], tried[min(n + 1, len(tried) - 1)]
    else:
        low, high = near / 2, 2 * near + 1
    found = minimize_scalar(
        cost, bounds=(low, high), method="bounded", options={"xatol": 0.01 * high}
    )
    return float(found.x)


def _lag(sums, kind, powers=None, steps=()):
    """Lag and its sigma, s, or None and a sentence where it cannot be seen."""
    if not sums.shows_lag:
        return _no_lag(
            "the series does not go through the same temperatures while warming and while cooling"
        )
    lag = _best_lag(sums, kind, powers, steps)
    # Errors of neighbouring pictures are alike: whole stretches of time are left out.
    parts = min(6, len(sums.rows) // 2)
    part = np.arange(len(sums.rows)) * parts // len(sums.rows)
    without = [_best_lag(sums, kind, powers, steps, part != n, lag) for n in range(parts)]
    sigma = max(jackknife(without), 0.05)
    if lag >= 0.95 * sums.longest_lag or sigma > max(0.5 * lag, 0.1 * sums.longest_lag):
        return _no_lag(f"{lag:.0f} s are found with a sigma of {sigma:.0f} s")
    return lag, sigma, None


def _steps(sums, kind, lag) -> list[int]:
    """Used pictures from which on the whole series is shifted beyond the model."""
    powers, found = sums.most_powers(2), []
    for _ in range(_MOST_STEPS):
        before = sums.solve(kind, powers, lag, found)
        place, alone = _most_abrupt(before.offset, found)
        if place is None:
            break
        steps = sorted([*found, place])
        after = sums.solve(kind, powers, lag, steps)
        jump = np.hypot(*after.jump[steps.index(place)])
        noise = robust_scale(np.hypot(*np.diff(after.offset, axis=0).T)) / 1.18
        worth = before.cost / max(after.cost, 1e-300)
        if min(jump, alone) < max(_LEAST_STEP, 8 * noise) or worth < 1.5:
            break
        found = steps
    return found


def _apart(sums, solved) -> bool:
    """Whether all pictures are shifted against the reference beyond the model."""
    terms = sums.projected(solved.kind)[1]
    constant, slope = (sums.shapes @ one.T for one in solved.coefficients(terms)[:2])
    constant = constant + sums.pattern
    # What an error of the reference's temperature makes grows and shifts as heat does.
    growth = slope - slope.mean(axis=0)
    error = np.sum(growth * constant) / max(np.sum(growth**2), 1e-12)
    shift = constant.mean(axis=0) - error * slope.mean(axis=0)
    half_a_degree = 0.5 * np.hypot(*slope.mean(axis=0)) / SCALE_C
    return bool(np.hypot(*shift) > max(2 * _LEAST_STEP, half_a_degree))


def _jumps(before: str, after: str) -> str:
    """The warning about a jump."""
    return (
        f"the picture as a whole jumps between {before} and {after}, beyond what temperature "
        "explains: the tripod or the camera was moved; the jump was fitted and left out of the "
        "model"
    )


def _model(sums, solved: Solved, lag, lag_sigma, notes) -> ThermalModel:
    """The fitted model with its uncertainty."""
    maps, terms = sums.maps, sums.projected(solved.kind)[1]
    k, powers, used = len(terms), solved.powers, solved.of_temperature
    felt, t0, _ = sums.optics(lag or 0.0)
    coefficients = solved.coefficients(terms)[1:].swapaxes(0, 1)
    dx, dy = coefficients.reshape(2, powers, sums.order, sums.order)
    rms, misfit = _misfit(sums, solved)
    if lag is None:
        misfit = float(np.hypot(misfit, _unknown_lag(sums, solved, felt, t0)))
    inside = felt[sums.rows]
    covariance = solved.inverse[used, used] * _design_effect(sums, solved)
    stretched = _stretched(sums, solved, covariance)
    notes += (stretched,) if stretched else ()
    return ThermalModel(
        kind=solved.kind, width=maps.width, height=maps.height, t0_c=t0,
        range_c=(float(min(inside.min(), t0)), float(max(inside.max(), t0))), dx=dx, dy=dy,
        middle=sums.middle, scale_px=sums.scale_px, scale_c=SCALE_C, residual_px=rms,
        misfit_px=misfit, lag_s=lag, lag_sigma_s=lag_sigma, warnings=notes,
        terms=terms.reshape(k, 2, sums.order, sums.order), covariance=covariance,
        beyond_px_c=_beyond(sums, solved, lag or 0.0, inside, t0),
    )  # fmt: skip


def _stretched(sums, solved, covariance) -> str | None:
    """A sentence where the middle of the picture grows otherwise in x than in y.

    A lens and what holds it warm up about an axis: their picture grows alike.
    """
    terms = sums.projected(solved.kind)[1]
    k, order = len(terms), sums.order
    across = np.stack([terms[:, 0, order], terms[:, 1, 1]])  # X of x, Y of y
    growth = across @ solved.amplitude[0]
    apart = across[0] - across[1]
    sigma = float(np.sqrt(max(apart @ covariance[:k, :k] @ apart, 0.0)))
    off = abs(growth[0] - growth[1])
    if off <= max(_STRETCH * np.abs(growth).max(), 6.0 * sigma):
        return None
    x, y = 1e6 * growth / (sums.scale_px * SCALE_C)
    return (
        f"the middle of the picture grows by {x:.1f} ppm a degree in x and {y:.1f} in y, which a "
        "lens does alike: are the axes or the units of the maps mixed up?"
    )


def _misfit(sums, solved) -> tuple[float, float]:
    """RMS of what the model leaves, and of the smooth part of it beyond noise, px an axis.

    Smooth is what the fullest polynomial takes of each picture; noise is what that leaves, and
    has its share in as many numbers as the polynomial has, less those of the model.
    """
    fitted = squares = 0.0
    count = numbers = 0
    for row, left in zip(sums.rows, sums.residual(solved), strict=True):
        basis, _ = np.linalg.qr(sums.shapes[sums.maps.valid[row]])
        squares += float(np.sum(left**2))
        fitted += float(np.sum((basis.T @ left) ** 2))
        count += left.size
        numbers += 2 * basis.shape[1]
    free = max(numbers - len(solved.inverse), 0)  # of what is smooth
    noise = (squares - fitted) / max(sums.freedom(solved) - free, 1.0)
    beyond = max(fitted - noise * free, 0.0)
    return float(np.sqrt(squares / count)), float(np.sqrt(beyond / count))


def _design_effect(sums, solved) -> float:
    """Factor on the covariance of the amplitudes: what is left tells how good the maps are, and by
    how much the errors that a picture's nodes share make the amplitudes worse.
    """
    constant, terms, K, r, cross = sums.projected(solved.kind)
    power, at = solved.power, solved.of_temperature
    term, of = sums.columns(solved.kind, solved.powers)
    total = np.concatenate(
        [np.broadcast_to(solved.of_constant, (len(power), len(constant))),
         power[:, 1:] @ solved.amplitude], axis=1,
    )  # fmt: skip
    score = r - np.einsum("nkl,nl->nk", K, total)
    for step, size in zip(solved.steps, solved.jump, strict=True):
        score[step:] -= cross[step:] @ size
    wide = len(term)
    moved = (power[:, of] * score[:, term]) @ solved.inverse[:wide, at]
    metric = np.linalg.inv(solved.inverse[at, at])
    ratio = np.einsum("na,ab,nb->", moved, metric, moved) / len(metric)
    shared = len(power) / max(len(power) - solved.powers - 1, 1)
    return float(max(solved.cost / sums.freedom(solved), ratio * shared))


def _beyond(sums, solved, lag, inside, t0):
    """Slope px/C (2, 2, order, order), below and above, by which rivals part from the model."""
    rival = solved.powers + 1
    if rival > sums.most_powers(_MOST_POWERS + 1):
        rival = solved.powers - 1
    if rival < 1:
        return np.zeros((2, 2, sums.order, sums.order))
    other = sums.solve(solved.kind, rival, lag, solved.steps)
    terms = sums.projected(solved.kind)[1]
    out = []
    for edge in (inside.min(), inside.max()):
        t = (edge - t0) / SCALE_C
        total = 0.0
        for sign, one in ((1.0, other), (-1.0, solved)):
            m = np.arange(1, one.powers + 1)
            slope = m * t ** (m - 1) / SCALE_C
            total = total + sign * np.tensordot(slope, one.coefficients(terms)[1:], 1)
        out.append(total.reshape(2, sums.order, sums.order))
    return np.array(out)


def _pictures(sums, solved, lag) -> pd.DataFrame:
    """Each picture's own similarity (eq. 6.2), and what the model leaves of it."""
    maps = sums.maps
    felt = sums.optics(lag)[0]
    table = pd.DataFrame({"picture": maps.picture, "time_s": maps.time_s})
    table = table.assign(thermometer_c=maps.temperature_c, optics_c=felt, used=False)
    table.loc[sums.rows, "used"] = True
    order = np.argsort(maps.time_s, kind="stable")
    rate = np.full(len(table), np.nan)
    known = order[np.isfinite(felt[order])]
    calm = temperature.smoothed(maps.time_s, maps.temperature_c)
    rate[known] = np.gradient(calm[known]) if len(known) > 1 else 0.0
    table["cooling"] = rate < 0
    names = ("shift_x", "shift_y", "scale", "rotation")
    own = np.full((len(table), 4), np.nan)
    constant, _, K, r, _ = sums.projected("similarity")
    its = slice(len(constant), None)
    unit = np.array([1.0, 1.0, 1e6 / sums.scale_px, 1e6 / sums.scale_px])
    own[sums.rows] = np.linalg.solve(K[:, its, its], r[:, its, None])[..., 0] * unit
    table[list(names)] = own
    left = np.full(len(table), np.nan)
    # Without its jumps, so that they show.
    calm = sums.residual(solved, jumps=False)
    left[sums.rows] = [np.sqrt(np.mean(part**2)) for part in calm]
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
