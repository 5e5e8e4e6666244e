"""Where the antenna was at the moments of exposure, and how well that is known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.block import RHO
from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.core.gnss.interpolation import polynomials, regimes, roughness, smoother
from corridor.core.gnss.interpolation.blunders import blunder_epochs, singular_epochs
from corridor.core.gnss.interpolation.jumps import Jump, alternating, jumps
from corridor.core.gnss.interpolation.segmenting import segments
from corridor.core.options import options

METHODS = ("smoother", "parabola", "spline", "pchip", "linear")
# A position of 10 cm beside ones of 2 cm has a twenty-fifth of their weight: it can no longer
# help the adjustment, only mislead it.
MAX_SIGMA_M = 0.10
_UNSURE = 50.0  # times the usual sigma: half a metre against a fix of 1 cm
_MOST_LOST = 0.1  # share of the epochs of a receiver that nobody misses
_CURVE = 2000
_POSITION, _SIGMA = ["x", "y", "z"], ["sx", "sy", "sz"]
_VELOCITY, _VELOCITY_SIGMA = ["vx", "vy", "vz"], ["svx", "svy", "svz"]
# What solutions that are no fix are good to, m, and what they are called.
# Source: RTKLIB manual 2.4.2, appendix B.1 (quality); decimetres of a float ambiguity, metres of a
# position without: Teunissen and Montenbruck 2017, chapters 21 and 26.
_GOOD_TO_M = {2: 0.2, 3: 1.0, 4: 0.5, 5: 2.0}
_TOLD_APART = 1.05
_NAMES = {2: "float", 3: "SBAS", 4: "differential code", 5: "single"}
# A scatter that is larger than stated by more than this is told; sigmas between epochs that are
# smaller by more than this than second differences of the epochs say hold too little motion: of
# 120 epochs chance and turns make 1.3, in simulated flights.
_CONTRADICTS, _STRAYS = 1.3, 1.5
# The phase of a carrier, 0.19 m long, is measured to a hundredth: nobody's positions in flight are
# better than a millimetre. Source: Teunissen and Montenbruck 2017, chapter 13.
_NOBODYS_M = 1e-3
# Slow errors are a few times as large as the scatter of neighbours; not twenty times. What
# scatters by less than receivers print was computed.
_FAR_BELOW, _PRINTED_M = 0.05, 1e-4
# Sigma against that of a fix, where a track states quality but no sigma.
_BY_QUALITY = {1: 1.0, 2: 20.0, 3: 100.0, 4: 50.0, 5: 200.0, 6: 5.0, 7: 1000.0}


@brief
@dataclass(frozen=True)
class Interpolated:
    """Antenna positions at given times.

    table: one row a time, in their order: time_s; x, y, z and sx, sy, sz, m; vx, vy, vz and svx,
        svy, svz, m/s (sigmas of velocities: of the smoother alone);
        segment (row of `segments`, -1 where none); why: a few words where the position is
        refused, "" where it is good. Refused by its sigma: the numbers are there; for another
        reason: NaN.
    segments: pieces of the track (see `segments`)
    noise: what the smoother found, a row for plan and height of each piece: segment, group,
        gust (m^2/s^3), slow (share of the variance that is slow), sigma_m (median used),
        velocity_sigma (m/s), scale (by which epochs scatter more than they state), unresolved_m
        (motion faster than the epochs can show, in the sigma of every position)
    curve: time_s, x, y, z, sx, sy, sz, segment halfway between epochs, all along the pieces that
        have exposures, for a picture
    notes: sentences worth telling
    """

    table: pd.DataFrame
    segments: pd.DataFrame
    noise: pd.DataFrame
    curve: pd.DataFrame
    method: str
    max_sigma: float
    notes: tuple[str, ...] = ()

    @property
    def good(self) -> pd.DataFrame:
        """Rows of the table that are not refused."""
        return self.table[self.table["why"] == ""]


@dataclass(frozen=True)
class Interpolation:
    """How positions come from the epochs of a track.

    method: "smoother", or a curve for comparison: "parabola", "spline", "pchip", "linear".
    max_sigma: m; a position is refused where the sigma of one axis is larger.
    slow_share: share of the stated variance that is slow, as errors of satellite positioning are:
        neighbouring epochs share it, and no smoothing makes it smaller. None: what the epochs
        show, about 0.7 where they cannot tell.
    velocities: use vx, vy, vz where they are there.
    Raises InputError for a method that is unknown, and numbers that cannot be.
    """

    method: str = "smoother"
    max_sigma: float = MAX_SIGMA_M
    slow_share: float | None = None
    velocities: bool = True

    def __post_init__(self):
        if self.method not in METHODS:
            raise InputError(
                f"method {self.method!r} is not known; choose one of {', '.join(METHODS)}"
            )
        if not self.max_sigma > 0:
            raise InputError(f"the largest sigma is {self.max_sigma:g} m; give a number above 0")
        if self.slow_share is not None and not 0 <= self.slow_share < 1:
            raise InputError(
                f"the slow share is {self.slow_share:g}; give a number from 0 up to below 1"
            )


@options(interpolation=Interpolation)
def interpolate(
    track: pd.DataFrame,
    times: np.ndarray,
    interpolation: Interpolation,
    *,
    flight: np.ndarray | None = None,
) -> Interpolated:
    """The antenna at `times` (n,), seconds of the track's clock, with standard deviations.

    track: time_s, x, y, z in metres along axes of equal scale (z up), optional sx, sy, sz (m),
        rho_xy, rho_xz, rho_yz (their correlations, which positions get from the epochs beside
        them: the axes are smoothed one by one), vx, vy, vz, svx, svy, svz (m/s), quality
        (RTKLIB's number), flight. Without sigmas the smoother finds them by likelihood; the curves
        then have none.
    method, max_sigma, slow_share, velocities: see `Interpolation`, which may be given in their
        place as interpolation.
    flight: (n,) names of the flight of each time, where flights of the track overlap in time.
    Raises InputError for a track that cannot be interpolated.
    """
    method, max_sigma = interpolation.method, interpolation.max_sigma
    times = np.asarray(times, dtype=float).reshape(-1)
    pieces = segments(track)
    notes: list[str] = []
    aside = alternating(track, pieces)
    if aside:
        raise InputError(
            f"every second epoch lies {aside:.2f} m beside the others, as of two receivers in one "
            "file; put each into a file of its own"
        )
    for told in (blunder_epochs, lambda *of: jumps(*of)[1]):
        if false := told(track, pieces):
            notes.append(_of_wild(track, false))
            track = track.drop(track.index[list(false)]).reset_index(drop=True)
            pieces = segments(track)
    jumped = jumps(track, pieces)[0]
    if jumped:
        notes.append(_of_jumps(jumped))
        pieces = segments(track, [jump.row for jump in jumped])
    notes += _of_singular(track, pieces)
    notes += _of_holes(track["time_s"].to_numpy(dtype=float), pieces)
    epochs = _epochs(track, interpolation.velocities and method == "smoother", notes)
    piece, why = _pieces_of(times, pieces, flight)
    position, sigma, velocity, v_sigma = (np.full((len(times), 3), np.nan) for _ in range(4))
    curves, noise = [], []
    parts = []
    for number, row in enumerate(pieces.itertuples()):
        chosen = piece == number
        if not chosen.any() or row.epochs < 2:
            why[chosen] = "the track has one epoch only here"
            piece[chosen] = -1
        else:
            parts.append((number, slice(row.first, row.last + 1), chosen))

    def along(job):
        _, part, chosen = job
        dense = _along(epochs.time[part], len(pieces))
        at = np.concatenate([times[chosen], dense])
        if method == "smoother":
            return dense, *_smoothed(
                epochs.at(part), at, len(at) - len(dense), interpolation.slow_share
            )
        return dense, _curve(method, epochs, part, at), None, None

    with ThreadPoolExecutor(2) as pool:
        for (number, _, chosen), found in zip(parts, pool.map(along, parts), strict=True):
            dense, made, model, used = found
            if model is not None:
                noise += _noise_rows(number, model, used, epochs.stated)
            count = int(chosen.sum())
            position[chosen], sigma[chosen], velocity[chosen], v_sigma[chosen] = (
                each[:count] for each in made
            )
            curves.append(_curve_rows(number, dense, made[0][count:], made[1][count:]))
    weak = (why == "") & (np.nanmax(np.nan_to_num(sigma, nan=-1.0), axis=1) > max_sigma)
    largest = np.max(np.nan_to_num(sigma, nan=0.0), axis=1, initial=0.0)
    why[weak] = [f"sigma {value:.2f} m is above {max_sigma:g} m" for value in largest[weak]]
    table = pd.DataFrame({"time_s": times})
    table[_POSITION], table[_SIGMA] = position, sigma
    table[_VELOCITY], table[_VELOCITY_SIGMA] = velocity, v_sigma
    if set(RHO) <= set(track):
        table[list(RHO)] = _correlation(track, times, pieces, piece)
    table["segment"], table["why"] = piece, pd.Series(why, dtype="str")
    columns = ["segment", "group", "gust", "slow", "sigma_m", "velocity_sigma"]
    columns += ["scale", "unresolved_m"]
    found = pd.DataFrame(noise, columns=columns)
    notes += _of_noise(found, epochs.stated, interpolation.slow_share)
    notes += _of_scatter(found, pieces) if epochs.stated else []
    notes += _of_shaken(found, pieces)
    curve = (
        pd.concat(curves, ignore_index=True)
        if curves
        else pd.DataFrame(columns=["time_s", *_POSITION, *_SIGMA, "segment"], dtype=float)
    )
    return Interpolated(table, pieces, found, curve, method, max_sigma, tuple(notes))


def _correlation(track, times, pieces, piece) -> np.ndarray:
    """Correlations (n, 3) at times, between those of the epochs of each piece."""
    out = np.zeros((len(times), 3))
    time, given = track["time_s"].to_numpy(float), np.nan_to_num(track[list(RHO)].to_numpy(float))
    for number, row in enumerate(pieces.itertuples()):
        mine, part = piece == number, slice(row.first, row.last + 1)
        for axis in range(3):
            out[mine, axis] = np.interp(times[mine], time[part], given[part, axis])
    return out


def _of_holes(time: np.ndarray, pieces: pd.DataFrame) -> list[str]:
    """A sentence where a receiver's regular epochs are not all there."""
    step = np.concatenate([np.diff(time[row.first : row.last + 1]) for row in pieces.itertuples()])
    usual = float(np.quantile(step, 0.1, method="lower"))
    lost = int(np.round(np.maximum(step / usual - 1.0, 0.0)).sum())
    if lost <= _MOST_LOST * (len(step) + lost):
        return []
    return [
        f"{lost} of {len(step) + lost} epochs at intervals of {usual:.3g} s are missing in the "
        "track: what the drone did there is not known"
    ]


def _of_jumps(found: list[Jump]) -> str:
    worst = max(found, key=lambda jump: jump.size)
    by = ", ".join(f"{value:+.2f}" for value in worst.by)
    more = f" ({len(found) - 1} more jumps too)" if len(found) > 1 else ""
    return (
        f"the track jumps by {worst.size:.2f} m at {worst.time_s:.3f} s (x, y, z {by}){more}, as "
        "no drone flies: positions on one side are off by that, and their sigmas do not say so; "
        "look at the base, the fixes and the heights of the track"
    )


def _of_wild(track: pd.DataFrame, wild: dict[int, float]) -> str:
    worst = max(wild, key=lambda epoch: wild[epoch])
    many = f"{len(wild)} epochs stand" if len(wild) > 1 else "1 epoch stands"
    return (
        f"{many} alone, off the line of their neighbours by more than motion and noise explain, "
        f"and {'are' if len(wild) > 1 else 'is'} left out of the track: that at "
        f"{track['time_s'].iloc[worst]:.3f} s by {wild[worst]:.2f} m"
    )


def _of_units(time: np.ndarray, position: np.ndarray, sigma: np.ndarray) -> list[str]:
    """A sentence where epochs scatter far less than the sigmas (n, 3) that they state."""
    if len(time) < regimes.FEWEST_EPOCHS:
        return []
    stated = float(np.median(sigma))
    scatter = float(robust_scale(np.diff(position, 3, axis=0))) / np.sqrt(20)  # of white noise
    if not _PRINTED_M < scatter < _FAR_BELOW * stated:
        return []
    return [
        f"the epochs state sigmas of {stated:.3g} m (median) and scatter by {scatter:.2g} m: are "
        "the sigmas in centimetres or millimetres? Write metres"
    ]


def _of_singular(track: pd.DataFrame, pieces: pd.DataFrame) -> list[str]:
    return [
        f"the epoch at {one.time_s:.3f} s lies {one.off:.2f} m off its neighbours in {one.axis}, "
        f"no other more than {one.others:.2f} m: taken for a movement of the drone; if it stood "
        "out for no reason, take the row out of the track"
        for one in singular_epochs(track, pieces)
    ]


def _by_quality(sigma: np.ndarray, quality: np.ndarray, notes: list[str]) -> np.ndarray:
    """Sigmas (n, 3) of which those of worse solutions are not as small as those of fixes.

    Where epochs that are no fixes state the sigmas of fixes, these are of noise, not of what such
    solutions are off. Programs that state larger ones are believed.
    """
    fixed, out = quality == 1, sigma.copy()
    for q, metres in _GOOD_TO_M.items():
        mine = quality == q
        if not mine.any():
            continue
        text = (
            f"{int(mine.sum())} of {len(quality)} epochs are not fixes (quality {q}, {_NAMES[q]})"
        )
        usual = np.median(sigma[fixed], axis=0) if fixed.any() else np.full(3, np.inf)
        if (np.median(sigma[mine], axis=0) > _TOLD_APART * usual).any():
            notes.append(f"{text}: their sigmas are larger than those of fixes and are used")
        else:
            out[mine] = np.maximum(sigma[mine], metres)
            notes.append(
                f"{text} and state the sigmas of fixes: they are counted as good to {metres:g} m"
            )
    return out


def _of_unsure(track: pd.DataFrame, sigma: np.ndarray) -> list[str]:
    """A sentence where one epoch alone states sigmas (n, 3) beyond all that its fix explains."""
    times = (sigma / np.median(sigma, axis=0)).max(axis=1)
    unsure = np.flatnonzero(times > _UNSURE)
    if len(unsure) != 1:
        return []
    row = unsure[0]
    return [
        f"the epoch at {track['time_s'].iloc[row]:.3f} s states {times[row]:.0f} times the usual "
        "sigma and hardly counts: what the drone did there is not known"
    ]


def _epochs(track: pd.DataFrame, velocities: bool, notes: list[str]) -> regimes.Epochs:
    n = len(track)
    quality = np.full(n, np.nan)
    if "quality" in track:
        quality = track["quality"].to_numpy(dtype=float, na_value=np.nan)
    relative = np.array([_BY_QUALITY.get(q, 1.0) for q in quality])
    sigma, lost = _stated(track, _SIGMA, relative)
    if sigma is not None and np.median(sigma) < _NOBODYS_M:
        notes.append(
            f"the epochs state sigmas of {1000 * np.median(sigma):.2g} mm (median), which no "
            "receiver in flight reaches (are they variances?): they are not used"
        )
        sigma = None
    stated = sigma is not None
    if stated:
        notes += _of_unsure(track, sigma)
        notes += _of_units(track["time_s"].to_numpy(float), track[_POSITION].to_numpy(float), sigma)
        # GrafNav's own quality follows from its standard deviations, and says no more than they.
        if "grafnav_quality" not in track:
            sigma = _by_quality(sigma, quality, notes)
    else:
        sigma = np.repeat(relative[:, None], 3, axis=1)
    if lost:
        notes.append(f"{lost} epochs state no sigma: they got that of the others of their quality")
    speed = speed_sigma = None
    if velocities and set(_VELOCITY) <= set(track):
        speed = track[_VELOCITY].to_numpy(dtype=float)
        speed = speed if np.isfinite(speed).any() else None
    if speed is not None:
        speed_sigma, _ = _stated(track, _VELOCITY_SIGMA, np.ones(n))
    time, position = (track[c].to_numpy(dtype=float) for c in ("time_s", _POSITION))
    return regimes.Epochs(time, position, sigma, sigma, 0 * sigma, stated, speed, speed_sigma)


def _stated(track, names, relative):
    """Sigmas (n, 3) of three columns, and how many epochs have none; None where an axis has none.

    Unknown ones come from the known, scaled by what the quality says of both.
    """
    if not set(names) <= set(track):
        return None, 0
    given = track[names].to_numpy(dtype=float)
    good = np.isfinite(given) & (given > 0)
    if not good.any(axis=0).all():
        return None, 0
    unit = np.where(good, given / relative[:, None], np.nan)
    filled = np.where(good, given, np.nanmedian(unit, axis=0) * relative[:, None])
    return filled, int((~good).any(axis=1).sum())


def _pieces_of(times, pieces, flight):
    """Piece of each time (-1: none), and why there is none."""
    piece = np.full(len(times), -1)
    why = np.full(len(times), "", dtype=object)
    claims = np.zeros(len(times), dtype=int)
    names = None if flight is None else np.asarray(flight).astype(str)
    for number, row in enumerate(pieces.itertuples()):
        inside = (times >= row.start_s) & (times <= row.end_s)
        if names is not None and row.flight:
            inside &= names == row.flight
        # The epoch shared by two pieces belongs to the first.
        shared = row.begins == "standing"
        inside &= ~(shared & (piece >= 0))
        claims += inside
        piece[inside] = number
    piece[claims > 1] = -1
    why[claims > 1] = "two flights of the track cover this time"
    lost = claims == 0
    why[lost] = "in a gap of the track"
    why[lost & (times < pieces["start_s"].min())] = "before the track begins"
    why[lost & (times > pieces["end_s"].max())] = "after the track ends"
    why[~np.isfinite(times)] = "no time"
    return piece, why


def _along(time: np.ndarray, pieces: int) -> np.ndarray:
    """Middles between epochs, where the sigma is largest; more of them where one is missing."""
    middle, step = (time[:-1] + time[1:]) / 2, np.diff(time)
    wide = step > 1.5 * np.median(step)
    within = time[:-1][wide, None] + step[wide, None] * np.arange(1, 16) / 16
    every = max(1, len(time) * pieces // _CURVE)
    return np.sort(np.concatenate([middle[~wide][::every], within.ravel()]))


def _shaken(epochs: regimes.Epochs, sigma: np.ndarray, model: regimes.Model) -> np.ndarray:
    """Standard deviation (3,), m, of motion that the smoother's sigmas (n, 3) of the middles
    between epochs do not hold, though the epochs show it: they are further apart than it lasts.
    """
    out = np.zeros(3)
    if not len(sigma) or model.interval_s < regimes.SLOW_S:
        return out
    for _, axes in regimes.GROUPS:
        rows = list(axes)
        noise = model.axes[axes[0]].scale * np.median(epochs.usual[:, rows])
        wanted = roughness.between(epochs.time, epochs.position[:, rows], float(noise))
        held = float(np.median(sigma[:, rows]))
        if wanted > _STRAYS * held:
            out[rows] = np.sqrt(wanted**2 - held**2)
    return out


def _left_over(epochs: regimes.Epochs, residual: np.ndarray, model: regimes.Model) -> np.ndarray:
    """Standard deviation (3,), m, of motion in the residuals (n, 3) of usual epochs, by what the
    smoother makes of white noise that is drawn as signs, alike for a track that is turned round."""
    out, usual, n = np.zeros(3), (epochs.excess == 0).all(axis=1), len(residual)
    if usual.sum() < regimes.FEWEST_EPOCHS:
        return out
    every = enumerate(model.axes)
    white = np.sqrt([regimes.rows(epochs, axis, noise).variance for axis, noise in every]).T
    half = np.random.default_rng(0).choice([-1.0, 1.0], ((n + 1) // 2, 3))
    noise = white * np.concatenate([half[: n // 2], half[::-1]])
    still = None if epochs.velocity is None else 0 * epochs.velocity
    drawn = epochs._replace(position=noise, velocity=still)
    passed = smoother.smooth(drawn, epochs.time, model)[0]
    for _, axes in regimes.GROUPS:
        mine = (part[usual][:, axes] for part in (residual, noise, passed))
        out[list(axes)] = roughness.left_over(epochs.time[usual], *mine)
    return out


def _between_epochs(time: np.ndarray, at: np.ndarray) -> np.ndarray:
    """How far times (n,) are from epochs (m,), as the standard deviation of what happens between:
    1 in the middle, 0 at an epoch, which measures where the drone is (a Brownian bridge)."""
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    share = (at - time[after - 1]) / (time[after] - time[after - 1])
    return np.sqrt(np.clip(4.0 * share * (1.0 - share), 0.0, 1.0))


def _smoothed(epochs, at, count, slow_share):
    origin = epochs.position[0]
    usual, excess = regimes.split(epochs.sigma, epochs.time)
    epochs = epochs._replace(position=epochs.position - origin, usual=usual, excess=excess)
    model = regimes.fit(epochs, slow_share)
    # Some of the epochs themselves, to see what is left of them.
    n = len(epochs.time)
    some = slice(max((n - _CURVE) // 2, 0), (n + _CURVE) // 2)
    smoothed = smoother.smooth(epochs, np.concatenate([at, epochs.time[some]]), model)
    residual = epochs.position[some] - smoothed[0][len(at) :]
    of_some = model._replace(gusts=model.gusts[some], jerks=model.jerks[some])
    left = _left_over(epochs.at(some), residual, of_some)
    position, sigma, velocity, v_sigma = (part[: len(at)] for part in smoothed)
    if left.any():
        sigma = np.hypot(sigma, left)
        v_sigma = np.hypot(v_sigma, left * np.pi / model.interval_s / np.sqrt(3))
    shaken = np.zeros(3) if epochs.velocity is not None else _shaken(epochs, sigma[count:], model)
    if shaken.any():
        model = model._replace(unresolved=np.hypot(model.unresolved, shaken))
        sigma = np.hypot(sigma, shaken * _between_epochs(epochs.time, at)[:, None])
        # White motion up to half the rate has this speed.
        v_sigma = np.hypot(v_sigma, shaken * np.pi / model.interval_s / np.sqrt(3))
    others = sigma, velocity, v_sigma
    used = np.median(epochs.sigma, axis=0) * [noise.scale for noise in model.axes]
    return (position + origin, *others), model, used


def _curve(method, epochs, part, at):
    time, values = epochs.time[part], epochs.position[part]
    position, velocity = polynomials.CURVES[method](time, values, at)
    sigma = np.full_like(position, np.nan)
    if epochs.stated:
        sigma = polynomials.propagated(method, time, values, epochs.sigma[part], at)
    return position, sigma, velocity, np.full_like(position, np.nan)


def _curve_rows(number, time, position, sigma):
    frame = pd.DataFrame({"time_s": time})
    frame[_POSITION], frame[_SIGMA] = position, sigma
    return frame.assign(segment=number)


def _noise_rows(number, model, used, stated):
    rows = []
    for name, axes in regimes.GROUPS:
        noise = model.axes[axes[0]]
        speed = np.nan if noise.velocity_sigma is None else noise.velocity_sigma
        size = float(np.sqrt(np.mean(used[list(axes)] ** 2)))
        scale = noise.scale if stated else 1.0
        unresolved = float(np.sqrt(np.mean(model.unresolved[list(axes)] ** 2)))
        rows.append((number, name, noise.gust, noise.share, size, speed, scale, unresolved))
    return rows


def _of_scatter(found, pieces):
    """Sentences where neighbouring epochs contradict the sigmas that they state."""
    for row in found[found["scale"] > _CONTRADICTS].itertuples():
        rate = 1 / pieces["interval_s"].iloc[row.segment]
        text = (
            f"segment {row.segment + 1}, {row.group}: neighbouring epochs scatter {row.scale:.1f} "
            "times as much as their sigmas say, which is used"
        )
        if row.unresolved_m > 0.5 * row.sigma_m * np.sqrt(1 - row.scale**-2.0):
            text += (
                f"; {rate:.3g} epochs a second cannot show motion above {rate / 2:.3g} Hz, of "
                f"which {1000 * row.unresolved_m:.0f} mm are in the sigma of every position"
            )
        yield text


def _of_shaken(found, pieces):
    """Sentences where the drone strays between epochs by more than a smooth flight would."""
    for row in found[(found["unresolved_m"] > 0) & (found["scale"] <= _CONTRADICTS)].itertuples():
        rate = 1 / pieces["interval_s"].iloc[row.segment]
        yield (
            f"piece {row.segment + 1}, {row.group}: the drone is shaken faster than {rate:.3g} "
            f"epochs a second can show; {1000 * row.unresolved_m:.0f} mm of it are in the sigmas "
            "between epochs: use a track with more epochs a second"
        )


def _of_noise(found, stated, slow_share):
    notes = []
    for row in found.itertuples():
        where = f"segment {row.segment + 1}, {row.group}"
        if not stated:
            notes.append(
                f"{where}: the track states no standard deviations; its scatter gives "
                f"{1000 * row.sigma_m:.1f} mm"
            )
        if slow_share is None and row.slow >= 0.5:
            notes.append(
                f"{where}: {100 * row.slow:.0f} % of the stated variance is taken as correlated in "
                "time: neighbouring epochs share it, and more epochs do not make it smaller"
            )
    return notes
