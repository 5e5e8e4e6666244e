"""How strongly a hidden effect shows in a block, and what it is mistaken for: by geometry alone.

Both follow from the twin, the same block without the effect, and from what is true; nothing of
what a diagnosis of the block says goes in. M is the twin's reduced system (what poses, points and
camera leave of every candidate, with the GNSS noise that the twin shows) and theta the truth in
prior standard deviations. Then

    signal-to-noise ratio    sqrt(theta' M theta),

what is left of it when other hidden effects are estimated too (of an effect with values for each
image: see `_as_one`); and beside another candidate k

    sqrt(theta' (M_tt - M_tk (M_kk + 1 / 10^2)^-1 M_kt) theta),

by how many sigmas the data tell the truth from the best that k can do in its place. What the
antenna feels has one more rival, of no name: GNSS noise that is larger or slower. How much worse
it explains the data than the truth does, each with the noise that fits it best, is given in
sigmas too, sqrt(2 log L) (see `_from_noise`). Where the
truth gives no parameters of the catalogue, the ratio is the weighted length of what the effect
leaves in the residuals: those of the block minus those of its twin, both adjusted by plain least
squares, less what the noise of the GNSS that the twin shows takes of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.diagnosis.truth import Hidden, Truth
from corridor.core import adjustment
from corridor.core.adjustment import Adjustment, Model
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.profile_likelihood import NoiseModel
from corridor.diagnosis.findings.verdict import refines
from corridor.diagnosis.noise.likelihood import estimate, value_of
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination, rows_of
from corridor.diagnosis.system.equations import Equations, moved_by
from corridor.diagnosis.system.groups import Group

# Sigmas by which the data prefer the truth to a rival: from APART on the two are separable; below
# ALIKE, three units of log likelihood, they are look-alikes that nobody should tell apart.
APART, ALIKE = 5.0, math.sqrt(6.0)
# Prior standard deviations that another candidate may well have.
WIDE = 10.0


@dataclass
class Signal:
    """ratio: signal-to-noise ratio; apart: sigmas that separate it from its closest rival.

    Both None where unknown. rival: slug of the closest. by: how the ratio was found, `reduced`
    or `residuals`. from_noise: sigmas that separate it from noise of the GNSS, None where the
    antenna does not feel it.
    """

    ratio: float | None = None
    apart: float | None = None
    rival: str | None = None
    by: str | None = None
    from_noise: float | None = None

    @property
    def separable(self) -> bool | None:
        """Whether neither another candidate nor the GNSS noise comes within five sigmas."""
        if self.apart is None:
            return None
        return min(self.apart, math.inf if self.from_noise is None else self.from_noise) >= APART

    @property
    def alike(self) -> bool | None:
        """Whether another candidate fits within three log units of the truth."""
        return None if self.apart is None else self.apart < ALIKE


def signals(
    truth: Truth,
    evidence: Evidence,
    block: Block,
    twin: Block,
    options: dict,
    noises: NoiseModel | None = None,
) -> dict[str, Signal]:
    """By slug (and control point) of the hidden effects.

    evidence, noises: of the first round of the twin's diagnosis. options: believed model, as of
    `diagnose`.
    """
    out: dict[str, Signal] = {}
    members = []
    for one in truth.inside:
        n = _number(evidence, one)
        theta = None if n is None else _theta(evidence.groups[n], one)
        if theta is not None and theta.any():
            members.append((key_of(one), n, theta))
    for key, n, theta in members:
        others = [k for other, k, _ in members if other != key]
        out[key] = _of_group(evidence, n, theta, others)
        if noises is not None and noises.touches(n) > SETTINGS.gnss_share:
            out[key].from_noise = math.sqrt(max(2.0 * _from_noise(noises, n, theta), 0.0))
    missing = [one for one in (*truth.inside, *truth.outside) if key_of(one) not in out]
    if len(missing) == 1 and not members:
        out[key_of(missing[0])] = _of_residuals(block, twin, options, noises)
    return out


def key_of(one: Hidden) -> str:
    """Slug, with the control point where it is one's."""
    return one.slug if one.point is None else f"{one.slug}.{one.point}"


def _number(evidence: Evidence, one: Hidden) -> int | None:
    return evidence.number.get(key_of(one))


def _theta(group: Group, one: Hidden) -> np.ndarray | None:
    """True parameters (p,) of a group in prior standard deviations; None where none is given."""
    found = [
        one.values.get((owner, name), one.values.get(("", name))) for owner, name, _ in group.labels
    ]
    if all(value is None for value in found):
        return None
    return np.array([value or 0.0 for value in found]) / group.scale


def _from_noise(noises: NoiseModel, n: int, theta: np.ndarray) -> float:
    """Log likelihood by which the n-th group explains more than the noise could in its place.

    Of data like these, in which nothing is missing, with parameters theta (p,), in prior standard
    deviations, on top: once the noise alone is fitted to them, once the noise with the group. Of
    values for each image only their size is known then; of others all, and the mean of theta and
    -theta is taken, so that this block's noise has no part in it.
    """
    e, group = noises.equations, noises.evidence.groups[n]
    alone = estimate(e, noises.lens, noises.arguments).value
    rows = noises.lens
    if group.own is not None:
        size = float(np.sqrt(np.mean(theta**2)))
        rows = (*rows, *rows_of([(group, size)]))
    moved = [moved_by(e, group, sign * theta) for sign in (1.0, -1.0)]
    without = np.mean([estimate(one, noises.lens, noises.arguments).value for one in moved])
    if group.own is None:
        # What moves the pictures makes their residuals longer, whatever follows.
        inside = e.core.inside[np.ix_(group.columns, group.columns)]
        return float(0.5 * (without + theta @ inside @ theta - alone))
    with_it = np.mean([estimate(one, rows, noises.arguments).value for one in moved])
    return float(0.5 * (without - with_it))


def _of_group(evidence: Evidence, n: int, theta: np.ndarray, others: list[int]) -> Signal:
    group = evidence.groups[n]

    def ratio(beside: list[int]) -> float:
        M = _beside(evidence, n, beside)
        square = max(float(theta @ M @ theta), 0.0)
        return math.sqrt(square if group.own is None else _as_one(square, M))

    whole = ratio(others)
    best, rival = whole, None
    for k, other in enumerate(evidence.groups):
        if k == n or k in others or other.generic or refines(other, group):
            continue
        # Values for each image make up for nearly anything, and pay for it.
        if len(other) > len(group) + SETTINGS.look_alike_more_parameters:
            continue
        apart = ratio([*others, k])
        if apart < best:
            best, rival = apart, other.slug
    return Signal(whole, best, rival, "reduced")


def _as_one(square: float, M: np.ndarray) -> float:
    """Square of the ratio of one parameter that brings as much log likelihood as one an image.

    Of p values only the variance is known beforehand; with s^2 = square / p it brings
    p (s^2 - log(1 + s^2)) / 2. p: effective number of values, (tr M)^2 / tr M^2.
    """
    spread = float((M**2).sum())
    if not spread:
        return 0.0
    count = np.trace(M) ** 2 / spread
    each = square / count
    return float(count * (each - math.log1p(each)))


def _beside(evidence: Evidence, n: int, others: list[int]) -> np.ndarray:
    """M of a group (p, p) after other groups have taken their best.

    Those are known to stay within some ten prior standard deviations: an atmosphere five hundred
    times the real one is no rival of a lens.
    """
    group = evidence.groups[n]
    beside = dict.fromkeys(others, WIDE)
    if group.own is not None:
        M, _ = evidence.elimination(beside).spread(group, np.eye(len(group)))
        return M
    return evidence.beside(beside).M[np.ix_(group.columns, group.columns)]


def _plain(block: Block, options: dict) -> Adjustment:
    """The believed model by plain least squares: what a difference is taken of must be linear."""
    wanted = Model(options.get("camera"), options.get("effects", ()))
    return adjustment.adjust(block, model=ReferenceModel.of(block, wanted).model)


def _of_residuals(block: Block, twin: Block, options: dict, noises: NoiseModel | None) -> Signal:
    """By what an effect leaves in the residuals; of no ratio where rows differ."""
    try:
        sides = [_plain(one, options) for one in (block, twin)]
    except (InputError, AdjustmentFailed):
        return Signal(by="residuals")
    square = 0.0
    for kind, columns, sigmas in (
        ("tie", ["vx", "vy"], ["sigma"]), ("mark", ["vx", "vy"], ["sigma"]),
        ("gnss", ["vx", "vy", "vz"], ["sx", "sy", "sz"]),
        ("control", ["vx", "vy", "vz"], ["sx", "sy", "sz"]),
    ):  # fmt: skip
        a, b = (side.residuals[kind] for side in sides)
        if len(a) != len(b):
            return Signal(by="residuals")
        off = (a[columns].to_numpy() - b[columns].to_numpy()) / b[sigmas].to_numpy()
        square += float(np.nansum(off**2))
    if noises is None or noises.few:
        return Signal(float(np.sqrt(square)), by="residuals")
    a, b = (side.system for side in sides)
    left = (a.residuals().gnss - b.residuals().gnss).ravel()
    e, known = noises.equations, noises.arguments
    likely = estimate(e, noises.lens, known)
    moved = [_moved_by_residuals(e, sign * left) for sign in (1.0, -1.0)]
    alone, *beside = (
        value_of(Elimination(one, likely.noise, noises.lens), known, likely.x)
        for one in (e, *moved)
    )
    hidden = np.mean([estimate(one, noises.lens, known).value for one in moved])
    square -= float(left**2 @ e.stated**-2.0)
    return Signal(
        math.sqrt(max(square + float(np.mean(beside)) - alone, 0.0)), by="residuals",
        from_noise=math.sqrt(max(square + float(hidden) - likely.value, 0.0)),
    )  # fmt: skip


def _moved_by_residuals(e: Equations, left: np.ndarray) -> Equations:
    """Equations of data with more residuals (3k,) of the antenna, m, which nothing follows."""
    out = replace(e, right=e.right - e.jacobian.T @ (e.stated**-2.0 * left), kept={})
    out.residual = e.residual + left
    return out
