"""Data that a fit has not used: which, and what they say of one fit beside another.

Some tie observations are given no weight, one of a point of four rays or more; the check points
never have any. Whether ties are predicted better by more than chance: each observation held out has
a density, Student's t about what a fit predicts; d is what its logarithm gains between two fits.
What is left in one strip hangs together: its light, its vegetation, its matches. So the sums d_c of
strips are what counts, and where nothing is gained

    mean(d_c) / (sd(d_c) / sqrt(q))  is at most Student's t with q - 1 degrees of freedom,

whatever their variances, at any level below 8 %.
Source: Diebold and Mariano 1995 (loss of two predictions); Ibragimov and Müller 2010 (few groups).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import ndtri, stdtrit

from corridor.core.adjustment import Adjustment, LinearSystem, Loss
from corridor.core.block import Block
from corridor.core.effects import Effect
from corridor.core.geometry import OUTLIER, UNUSABLE, is_outlier, robust_scale_of_lengths
from corridor.core.output import scaled
from corridor.core.preparation import strips_of
from corridor.diagnosis.findings.findings import Estimate
from corridor.diagnosis.noise.image import places, scale_of
from corridor.diagnosis.settings import SETTINGS


def hold_out(block: Block, rng: np.random.Generator) -> tuple[Block, pd.MultiIndex]:
    """The block with some tie observations robbed of their weight, and those (k,): image, point.

    Points that control the marks are not touched, and every image keeps most of its points. They
    are those of one fold, all that can be spared there.
    """
    ties = block.tie_points
    image = block.image_rows("tie_points")
    sizes = {name: (camera.width, camera.height) for name, camera in block.cameras.items()}
    size = np.array([sizes[name] for name in block.images["camera"]], dtype=float)[image]
    fold = folds_of(image, ties[["x", "y"]].to_numpy(float), size, rng)
    chosen = spared(ties["point"].array.codes, rng, fold == 0)
    out = block.copy()
    sigma = block.tie_sigma().copy()
    sigma[chosen] *= SETTINGS.free_size
    out.tie_points = ties.assign(sigma=sigma)
    return out, pd.MultiIndex.from_frame(ties.loc[chosen, ["image", "point"]].astype(str))


def _measured(system: LinearSystem) -> pd.MultiIndex:
    """Image and point of the image rows (n,): adjustments may leave different points out."""
    rows = system.image_rows
    names = np.asarray(system.images.names)[rows.image], system.points.names[rows.point]
    return pd.MultiIndex.from_arrays(names, names=["image", "point"])


def spared(point: np.ndarray, rng: np.random.Generator, among: np.ndarray) -> np.ndarray:
    """Rows (k,), ascending, of observations: one of a point of four rays or more.

    point: (n,) number of the point of each tie observation. among (n,): which may be chosen.
    """
    fit = np.bincount(point)[point] >= SETTINGS.fewest
    order = rng.permutation(np.flatnonzero(fit & among))
    _, first = np.unique(point[order], return_index=True)
    return np.sort(order[first])


def folds_of(
    image: np.ndarray, xy: np.ndarray, size: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Number (n,) of the fold of each observation: some places of every picture each.

    image (n,): number; xy (n, 2), size (n, 2): px. Residuals of neighbours in one picture hang
    together: what is to be predicted has to lie away from what has been used.
    """
    order = rng.random((int(image.max()) + 1, int(np.prod(SETTINGS.places)))).argsort(axis=1)
    return (order % SETTINGS.folds)[image, places(xy, size)]


@dataclass(frozen=True)
class Prediction:
    """What a correction gains in strips: log density (strips,) of what no fit has used there."""

    gain: np.ndarray

    @classmethod
    def of_folds(cls, without: Adjustment, with_it: Adjustment, held: pd.MultiIndex) -> Prediction:
        """Of all tie observations that can be spared, some places of each picture at a time.

        held (k,): tie observations that neither adjustment has used; they count as the others
        do. What a fold is predicted from is a step of least squares from either adjustment, with
        the weights that its loss has there.
        """
        systems = [
            replace(
                LinearSystem(one.problem, one.state, Loss.parse(one.problem.model.loss)),
                held=one.system.held,
            )
            for one in (without, with_it)
        ]
        seen, rng = systems[0].image_rows, np.random.default_rng(0)
        measured = [_measured(one) for one in systems]
        sigmas = [one.image_rows.sigma.copy() for one in systems]
        for sigma, names in zip(sigmas, measured, strict=True):
            sigma[names.isin(held)] /= SETTINGS.free_size
        at = [np.arange(len(seen.point)), measured[1].get_indexer(measured[0])]
        fold = folds_of(seen.image, seen.xy, systems[0].images.size[seen.image], rng)
        image, squares = [], []
        for number in range(SETTINGS.folds):
            left = spared(seen.point, rng, seen.tie & (at[1] >= 0) & (fold == number))
            image.append(systems[0].image_order[seen.image[left]])
            square = []
            for one, sigma, rows in zip(systems, sigmas, at, strict=True):
                fewer = sigma.copy()
                fewer[rows[left]] *= SETTINGS.free_size
                pair = one.measuring(sigma=fewer)
                v = pair.at(pair.step()).residuals().pixels[rows[left]]
                square.append((v**2).sum(axis=1) / sigma[rows[left]] ** 2)
            squares.append(square)
        before, after = np.concatenate(squares, axis=1)
        block = without.system.block
        strip = np.zeros(len(block.images), dtype=np.int64)
        for number, (_, images) in enumerate(strips_of(block)):
            strip[images] = number
        good = np.isfinite(before) & np.isfinite(after)
        scale = scale_of(before[good]) if good.any() else 1.0
        gained = _log_density(after[good] / scale**2) - _log_density(before[good] / scale**2)
        where = strip[np.concatenate(image)[good]]
        return cls(np.bincount(where, gained)[np.bincount(where) > 0])

    @property
    def proved(self) -> bool:
        """Whether the gain is larger than chance makes it, by what the strips say one by one."""
        count = len(self.gain)
        if count < 2:
            return False
        error = float(np.std(self.gain, ddof=1)) * np.sqrt(count)
        limit = stdtrit(count - 1, 1.0 - SETTINGS.doubt_level)
        return bool(self.gain.sum() > limit * error)


def _log_density(square: np.ndarray) -> np.ndarray:
    """Of a bivariate Student t, but for a constant; square (n,) in squared scales."""
    nu = SETTINGS.student_nu
    return -0.5 * (nu + 2.0) * np.log1p(square / nu)


@dataclass(frozen=True)
class Cost:
    """What a shape of the picture costs where it is left out.

    metres, sigmas: by how much half of the tie points move at least, 3D, and in their standard
    deviations on the axis where that is most. ratio: error of ties that no fit has used with it,
    over the error without; seen: whether that is clearly less, and by more than chance.
    """

    metres: float
    sigmas: float
    ratio: float
    seen: bool

    @classmethod
    def of(cls, without: Adjustment, with_it: Adjustment, held: pd.MultiIndex) -> Cost:
        """Between two adjustments; held: tie observations that neither has used."""
        tie = tie_gap(without, with_it, held)
        ratio = tie["after"] / tie["before"] if tie["before"] else 1.0
        seen = ratio < SETTINGS.cost_ratio and Prediction.of_folds(without, with_it, held).proved
        return cls(*moved(without, with_it), ratio, seen)

    @property
    def counts(self) -> bool:
        """Whether it is worth a word: beyond the ground's own doubt, or seen in the residuals."""
        return self.sigmas > SETTINGS.implausible_sigma or self.seen


def moved(before: Adjustment, after: Adjustment) -> tuple[float, float]:
    """Median 3D movement of the points between two adjustments, m, and in sigmas of `before`."""
    a, b = (one.points.set_index("point")[["x", "y", "z"]] for one in (before, after))
    away = b.reindex(a.index).to_numpy() - a.to_numpy()
    known = np.isfinite(away).all(axis=1)
    metres = float(np.median(np.linalg.norm(away[known], axis=1)))
    return metres, float(np.nanmedian(np.abs(away / before.point_sigma)[known], axis=0).max())


def tie_gap(before: Adjustment, after: Adjustment, held: pd.MultiIndex) -> dict[str, float | None]:
    """RMS (px, an axis) of observations that both fits did not use, wrong matches left out."""
    found = []
    for system in (before.system, after.system):
        at = _measured(system).get_indexer(held)
        pixels = system.residuals().pixels[at]
        found.append(np.where((at >= 0)[:, None], pixels, np.nan))
    known = np.isfinite(np.hstack(found)).all(axis=1)
    if not known.any():
        return {"before": None, "after": None}
    length = np.where(known, np.hypot(*found[1].T), np.nan)
    good = known & ~is_outlier(length, robust_scale_of_lengths(length), UNUSABLE)
    values = [float(np.sqrt(np.mean(one[good] ** 2))) for one in found]
    return {"before": values[0], "after": values[1]}


def check_misfit(adjustment: Adjustment) -> float:
    """Sum of squares of what check points are off by, in their sigmas and those of the survey."""
    off, sigma = _off(adjustment, adjustment.check_points["point"])
    return float(((off / sigma) ** 2).sum())


def _off(adjustment: Adjustment, points: pd.Series) -> tuple[np.ndarray, np.ndarray]:
    """What check points (n,) are off by (n, 3), m, and its sigma, that of the survey included."""
    table = adjustment.check_points.set_index("point").loc[points]
    return table[["dx", "dy", "dz"]].to_numpy(), table[["s_dx", "s_dy", "s_dz"]].to_numpy()


def harms(without: Adjustment, with_it: Adjustment) -> bool:
    """Whether check points contradict what an adjustment has more than another.

    They move by s when it is added. If it is true, they end at zero but for their noise, so the
    differences d afterwards do not point along s more often than that noise lets them. What common
    errors do to all of them alike is allowed for by taking each axis as one number.
    """
    if not len(without.check_points) or not with_it.check_rms.d3 > without.check_rms.d3:
        return False
    points = with_it.check_points["point"]
    (before, sigma), (d, _) = _off(without, points), _off(with_it, points)
    s = d - before
    noise = np.sqrt(((np.abs(s) * sigma).sum(axis=0) ** 2).sum())
    return bool((d * s).sum() > ndtri(1.0 - SETTINGS.doubt_level) * noise)


def worse(without: Adjustment, with_it: Adjustment, held: pd.MultiIndex) -> bool:
    """Whether ties that neither adjustment has used are predicted worse with what one has more.

    By as much as a shape of the picture must better them to be worth a word: what is true betters
    them, or hardly changes them.
    """
    tie = tie_gap(without, with_it, held)
    return bool(tie["before"]) and tie["before"] < SETTINGS.cost_ratio * tie["after"]


def untold(one: Estimate, effect: Effect, fit: Adjustment) -> str:
    """Why the size of what was found cannot be told, nothing where it can.

    Either no camera or flight has as much, or the equations at the last fit say something else than
    the fit with it, by more than chance and by more than half: such a flight hardly determines it.
    """
    most = {parameter.name: parameter.most for parameter in effect.parameters(fit.start)}
    rows = fit.effects[fit.effects["slug"] == one.slug]
    if one.where:
        rows = rows[rows["group"].astype(str).isin([str(name) for name in one.where.values()])]
    pairs = zip(rows["value"], rows["sigma"], strict=True)
    fitted = dict(zip(rows["parameter"], pairs, strict=True))
    for told in one.parameters:
        name, value, sigma = told["name"], told["value"], told["sigma"]
        factor, unit = scaled(told["unit"], value, sigma, name=name)
        if abs(value) > most.get(name, np.inf):
            return f"{name} would be {factor * value:.3g} {unit}, and none is beyond " + (
                f"{factor * most[name]:.3g} {unit}".strip()
            )
        other, own = fitted.get(name, (value, 0.0))
        # What neither of the two determines is no value that was told.
        chance = OUTLIER * float(np.hypot(sigma, own))
        if one.values is None and abs(other - value) > max(chance, 0.5 * abs(value)):
            return f"{name} is {factor * value:.3g} {unit} by the equations of one fit, and " + (
                f"{factor * other:.3g} {unit} in the next".replace("  ", " ")
            )
    return ""


def preferred(
    second: Adjustment, rivals: dict[str, Adjustment], held: pd.MultiIndex, limit: float
) -> tuple[str | None, dict[str, dict[str, float]]]:
    """The rival that does clearly better than `second` where no fit has looked, if any.

    Check points decide where there are enough of them, by less than `limit` times the error; else
    tie observations, where strip by strip they speak for it by more than chance. Also the error of
    each rival over that of `second`: `tie` and `check`.
    """
    share: dict[str, dict[str, float]] = {}
    many = len(second.check_points) >= SETTINGS.enough_checks
    for key, fit in rivals.items():
        share[key] = {"check": float(fit.check_rms.d3 / second.check_rms.d3)} if many else {}
        found = tie_gap(second, fit, held)
        if found["before"]:
            share[key]["tie"] = found["after"] / found["before"]
    kind = "check" if many else "tie"
    known = {key: one[kind] for key, one in share.items() if kind in one}
    best = min(known, key=known.get, default=None)
    if best is None or known[best] >= (limit if many else 1.0):
        return None, share
    clear = many or Prediction.of_folds(second, rivals[best], held).proved
    return (best if clear else None), share


def improves(without: Adjustment, with_it: Adjustment, held: pd.MultiIndex) -> bool:
    """Whether held-out ties are predicted better, and check points, where many, no worse."""
    if len(with_it.check_points) >= SETTINGS.enough_checks:
        if SETTINGS.clear_ratio_checks * with_it.check_rms.d3 > without.check_rms.d3:
            return False
    if harms(without, with_it):
        return False
    found = tie_gap(without, with_it, held)
    return bool(found["after"] < found["before"])


def check_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of check points, m; None without any."""
    if not len(before.check_points):
        return None
    return {"before": float(before.check_rms.d3), "after": float(after.check_rms.d3)}


def check_sigmas(after: Adjustment) -> float | None:
    """By how many of their standard deviations check points are off, RMS; None without any, and of
    a free network, which lies where its start poses are."""
    count = 3 * len(after.check_points) if after.system.held is None else 0
    return float(np.sqrt(check_misfit(after) / count)) if count else None


def check_alone(after: Adjustment, limit: float) -> tuple[str, str, float, float] | None:
    """The check point that is off alone, in which coordinate and by how much, m, and how far the
    others are, 3D RMS, m. None where more of them are off by `limit` standard deviations, RMS."""
    points = after.check_points["point"].reset_index(drop=True)
    if len(points) < 3:
        return None
    off, sigma = _off(after, points)
    square = ((off / sigma) ** 2).sum(axis=1)
    worst = int(np.argmax(square))
    rest = np.arange(len(points)) != worst
    if np.sqrt(square[rest].mean() / 3.0) > limit:
        return None
    axis = int(np.argmax(np.abs(off / sigma)[worst]))
    others = float(np.sqrt((off[rest] ** 2).sum(axis=1).mean()))
    return str(points[worst]), ("x", "y", "height")[axis], float(off[worst, axis]), others


def check_together(after: Adjustment, limit: float) -> np.ndarray | None:
    """The vector (3,), m, by which all check points are off together; None where what is left of
    them beside it is `limit` standard deviations, RMS, and more."""
    points = after.check_points["point"].reset_index(drop=True)
    if len(points) < 3:
        return None
    off, sigma = _off(after, points)
    mean = off.mean(axis=0)
    left = ((off - mean) / sigma) ** 2
    return None if np.sqrt(left.sum() / (3.0 * (len(points) - 1))) > limit else mean


def gnss_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of the antenna residuals, m; None without GNSS."""
    if not len(before.system.gnss.names):
        return None

    def rms(one):
        table = one.residuals["gnss"]
        return float(np.sqrt(np.mean((table[["vx", "vy", "vz"]].to_numpy() ** 2).sum(axis=1))))

    return {"before": rms(before), "after": rms(after)}


def closure(before: float, after: float, floor: float) -> float | None:
    """Share of the excess variance that is gone: (before^2 - after^2) / (before^2 - floor^2)."""
    excess = before**2 - floor**2
    return float((before**2 - after**2) / excess) if excess > 0 else None
