"""An alarm that needs no catalogue: two halves of the images, adjusted apart, must agree.

One half are the strips (or, of few strips, the images) with odd numbers, the other the even ones.
Every tie point that both see well is split in two, one of each half, and each half has a camera of
its own: what is left in common is control, the lever arms and the noise of the GNSS. So the
differences d of the cameras and of the heights of the surface, by cells, come with their joint
covariance C, all of what the halves share in it, and

    T = d' C^-1 d

is chi square where the model is right. What both halves bend alike does not show.
Residuals hang together: C is times phi, the variance of what runs of images contribute to d over
that of independent residuals, and T / (phi k) Fisher's F with as many degrees of freedom as there
are runs and prior knowledge (see `scores`).
Source: Kogan, mrcal, "cross-validation" (two halves of the data against their stated uncertainty);
Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.linalg import pinvh
from scipy.special import fdtrc

from corridor.core.adjustment import Adjustment, Design, Sets
from corridor.core.block import Block
from corridor.core.effects import Effect, LinearEffect, Parameter, of_interior
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import is_outlier, robust_scale
from corridor.core.preparation import strips_of
from corridor.diagnosis.evidence.lens import Lens
from corridor.diagnosis.evidence.nothing import by_run, residuals
from corridor.diagnosis.noise.gnss import GnssNoise, stated_noise
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination, rows_of
from corridor.diagnosis.system.equations import equations

# Cells of the surface, points of a cell that are asked, and split points without which no surface
# is compared.
_CELLS, _OF_CELL, _FEWEST = 12, 40, 24
# Behind the name of the point that the second half sees.
_SECOND = " (second half)"


@dataclass(frozen=True)
class Halves:
    """What two halves say of each other.

    by: `strips` or `images`. chi_square, freedom, p: of all differences together, phi: by how much
    more residuals hang together. rows: name, unit, difference (first less second half) and its
    sigma, of cameras and of the surface. reason: why nothing was compared; then p is None.
    """

    by: str = ""
    chi_square: float | None = None
    freedom: int = 0
    phi: float = 1.0
    p: float | None = None
    rows: tuple[dict, ...] = ()
    reason: str = ""

    @property
    def alarm(self) -> bool:
        """Whether the halves contradict each other: one sound block in a hundred does."""
        return self.p is not None and self.p < SETTINGS.alarm_level

    @property
    def farthest(self) -> dict | None:
        """The row that differs by most of its sigmas."""
        return max(self.rows, key=lambda row: abs(row["value"]) / row["sigma"], default=None)

    def to_dict(self) -> dict:
        """The entry `halves` of diagnosis.json."""
        return {
            "by": self.by,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.freedom,
            "phi": self.phi,
            "p": self.p,
            "differences": list(self.rows),
            "reason": self.reason,
        }


class OfHalves(LinearEffect):
    """Camera parameters that differ between two halves: the first less the second."""

    slug = "camera_of_halves"
    title = "Camera of the first half less that of the second"
    called = "a camera that differs between two halves"
    place = "camera"
    group = "camera"
    generic = True

    def __init__(self, scale: dict[str, float], first: set[str]):
        """scale: of each interior parameter. first: names of the images of the first half."""
        super().__init__()
        self.scale, self.first = scale, first

    def parameters(self, block):
        return [Parameter(name, _unit(name), scale=scale) for name, scale in self.scale.items()]

    def derivative(self, context):
        """Half of the values more in the images of the first half, half of them less elsewhere."""
        names = context.images.names[context.image]
        side = np.where([name in self.first for name in names], 0.5, -0.5)
        return of_interior(context, **dict.fromkeys(self.scale, side))


def _unit(name: str) -> str:
    return "px" if name in ("f", "cx", "cy") else "1"


def compare_halves(
    believed: ReferenceModel, effects: list[Effect], noise: GnssNoise | None, lens: Lens | None
) -> Halves:
    """What two halves of the images say of each other, beside effects that are in the model.

    noise, lens: as the diagnosis has them. Where halves cannot be adjusted, the reason.
    """
    by, first = halves_of(believed.block)
    block, pairs = split(believed.block, first)
    if len(pairs) < _FEWEST:
        return Halves(by, reason="the two halves have too few points in common")
    try:
        apart = believed.adjust(effects, block)
        return _compared(apart, by, set(block.images["image"][first]), pairs, noise, lens)
    except (InputError, AdjustmentFailed, np.linalg.LinAlgError) as failed:
        return Halves(by, reason=f"the halves could not be adjusted apart ({failed})")


def halves_of(block: Block) -> tuple[str, np.ndarray]:
    """By what the images are halved, and which (images,) are of the first half."""
    strips = [rows for _, rows in strips_of(block)]
    first = np.zeros(len(block.images), dtype=bool)
    named = block.images["strip"].nunique() if "strip" in block.images else 0
    if named >= 4 and len(strips) >= 4:
        first[np.concatenate(strips[::2])] = True
        _, pairs = split(block, first)
        if len(pairs) >= _FEWEST * 4:
            return "strips", first
    first[:] = False
    time = block.column("images", "time_s")
    time = np.where(np.isfinite(time), time, np.arange(len(time)))
    for rows in strips:
        first[rows[np.argsort(time[rows], kind="stable")][::2]] = True
    return "images", first


def split(block: Block, first: np.ndarray) -> tuple[Block, list[str]]:
    """The block with a point for each half, and the names of those that have been split.

    first (images,): which are of the first half. Rays that are alone in their half have no say.
    """
    rows = block.tie_points
    point, side = rows["point"].cat.codes.to_numpy(), first[block.image_rows("tie_points")]
    names = rows["point"].cat.categories.to_numpy(dtype=object).astype(str)
    rays = np.stack([np.bincount(point[side == one], minlength=len(names)) for one in (1, 0)])
    kept = rays[np.where(side, 0, 1), point] >= 2
    both = (rays >= 2).all(axis=0)
    name = names[point].astype(object)
    second = both[point] & ~side
    name[second] = name[second] + _SECOND
    out = block.copy()
    out.tie_points = rows.assign(point=pd.Categorical(name))[kept].reset_index(drop=True)
    return out, names[both].tolist()


def _compared(
    apart: Adjustment, by: str, first: set[str], pairs: list[str], noise, lens: Lens | None
) -> Halves:
    """Differences of the halves of an adjustment in which they have points of their own."""
    free = sorted(set().union(*apart.system.free.values()))
    scale = {name: 1.0 if name in ("f", "cx", "cy") else 1e-3 for name in free}
    tested: list[Effect] = [OfHalves(scale, first)] if free else []
    tested += [] if lens is None else [lens.group.effect]
    e = equations(apart, tested, {})
    groups = {group.slug: group for group in e.groups}
    rows = [(groups[OfHalves.slug], SETTINGS.free_size)] if free else []
    rows += [] if lens is None else [(groups[lens.group.slug], lens.size)]
    if noise is not None:
        # Of the same receiver; positions may be in another order.
        sizes = {"white": noise.white, "coloured": noise.coloured, "tau": noise.tau}
        noise = replace(stated_noise(e.system), **sizes)
    whole = Elimination(e, noise, rows_of(rows))
    surface = _Surface(e.system, pairs)
    design = Design(e.system, followed=surface.point.ravel())
    height, toward, inside = surface.compared(design, whole)
    labels = [(f"height of the surface, part {n + 1}", "m") for n in range(surface.count)]
    at = len(e.first) + np.arange(len(groups[OfHalves.slug]) if free else 0)
    labels = [
        *((f"camera.{owner}.{name}", unit) for owner, name, unit in
          (groups[OfHalves.slug].labels if free else ())),
        *labels,
    ]  # fmt: skip
    # Differences are `height` and zero, less what the rows do: `toward`.
    toward = np.concatenate([-np.eye(len(whole.at))[:, at], toward], axis=1)
    value = np.concatenate([np.zeros(len(at)), height])
    value = value - toward.T @ whole.solve(whole.here)[:, 0]
    inside = np.concatenate([np.zeros(len(at)), inside])
    covariance = toward.T @ whole.solve(toward) + np.diag(inside)
    freedom, inverse = _inverse(covariance)
    square = float(value @ inverse @ value)
    phi, runs = _phi(design, whole, surface, at, inverse)
    worth = SETTINGS.clusters_of_prior + runs
    p = float(fdtrc(freedom, worth, square / phi / freedom))
    unit = np.concatenate([groups[OfHalves.slug].scale if free else [], np.ones(surface.count)])
    sigma = np.sqrt(phi * covariance.diagonal())
    told = tuple(
        {"name": name, "unit": text, "value": float(v * s), "sigma": float(q * s)}
        for (name, text), v, q, s in zip(labels, value, sigma, unit, strict=True)
    )
    return Halves(by, square, freedom, phi, p, told)


def _phi(
    design: Design, whole: Elimination, surface: _Surface, at: np.ndarray, inverse: np.ndarray
) -> tuple[float, int]:
    """Variance of what runs of images contribute to the differences, over that of independent
    residuals, one at least; and the number of runs.
    """
    system = whole.equations.system
    rng = np.random.default_rng(0)

    def spread(errors: Sets, step: np.ndarray) -> tuple[float, int]:
        """Mean square of what runs contribute, of the errors that such a step leaves."""
        left, *_ = design.back(errors, step)
        sets = by_run(system, left)
        step = whole.step(design.right(sets))
        _, moved, _ = design.back(sets, step)
        camera = step[whole.at[at]] / whole.equations.unit[whole.at[at], None]
        both = np.concatenate([camera, surface.of_moves(moved)])
        return float(np.einsum("ik,ij,jk->", both, inverse, both)), both.shape[1]

    usual = []
    for _ in range(SETTINGS.cluster_draws):
        shape = (2 * len(system.image_rows.point),)
        drawn = Sets([rng.standard_normal(shape)], np.zeros((system.control.residual.size, 1)))
        usual.append(spread(drawn, whole.step(design.right(drawn)))[0])
    step = np.zeros((len(system.columns), 1))
    step[whole.at] = whole.equations.unit[whole.at, None] * whole.solve(whole.here)
    found, runs = spread(residuals(whole), step)
    ratio = found / np.mean(usual)
    worth = SETTINGS.clusters_of_prior
    return max((worth + runs * float(ratio)) / (worth + runs), 1.0), runs


def _inverse(covariance: np.ndarray) -> tuple[int, np.ndarray]:
    """Rank and inverse within it, scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(covariance.diagonal())
    inverse, rank = pinvh(scale[:, None] * covariance * scale, rtol=1e-9, return_rank=True)
    return rank, scale[:, None] * inverse * scale


class _Surface:
    """Split points in cells along the block. count: cells; point (2, n): numbers of the pairs."""

    def __init__(self, system, pairs: list[str]):
        index = {name: n for n, name in enumerate(system.points.names)}
        both = [(index.get(name), index.get(name + _SECOND)) for name in pairs]
        self.point = np.array([pair for pair in both if None not in pair]).T
        place = system.state.points[self.point[0]]
        apart = place[:, :2] - place[:, :2].mean(axis=0)
        along = apart @ np.linalg.svd(apart, full_matrices=False)[2][0]
        away = np.diff(system.state.points[self.point][..., 2], axis=0)[0]
        along, self.point = (some[..., ~is_outlier(away)] for some in (along, self.point))
        self.count = int(np.clip(len(along) // _FEWEST, 1, _CELLS))
        rank = np.argsort(np.argsort(along, kind="stable"), kind="stable")
        self.cell = rank * self.count // len(rank)
        # Evenly over the cell: those of one place share their errors.
        chosen = [np.flatnonzero(self.cell == k) for k in range(self.count)]
        some = [mine[:: -(-len(mine) // _OF_CELL)] for mine in chosen]
        self.point, self.cell = self.point[:, np.concatenate(some)], self.cell[np.concatenate(some)]
        self._place = system.state.points

    def compared(
        self, design: Design, whole: Elimination
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean differences of height (cells,), m; how they follow the rows of the elimination
        (n, cells), less; and their variance (cells,) where these are known.
        """
        e = whole.equations
        columns = np.zeros((len(e.system.columns), self.count))
        p = e.system.problem
        each, variance = [], np.zeros(self.point.shape)
        flat = self.point.ravel()
        for n, rays in enumerate(design.rays_of(flat)):
            half = np.zeros((3, 3))
            half[np.tril_indices(3)] = rays.root[0]
            by_height = half.T @ half[:, 2]
            variance.ravel()[n] = by_height[2]
            each.append((rays, rays.point @ by_height))
        height = self._place[self.point][..., 2]
        away = height[0] - height[1]
        middle = [np.median(away[self.cell == k]) for k in range(self.count)]
        off = (away - np.array(middle)[self.cell]) / np.sqrt(variance.sum(axis=0))
        # A wrong match that two rays show is no outlier to them.
        weight = ~is_outlier(np.abs(off), robust_scale(off)) / variance.sum(axis=0)
        weight /= np.bincount(self.cell, weight)[self.cell]
        self.weight = weight
        value = np.bincount(self.cell, weight * away)
        inside = np.bincount(self.cell, weight**2 * variance.sum(axis=0))
        sides = np.repeat([1.0, -1.0], self.point.shape[1])
        for n, (rays, seen) in enumerate(each):
            k = n % self.point.shape[1]
            seen = sides[n] * weight[k] * seen
            for ray, image in enumerate(rays.image):
                at = image * p.d + np.arange(p.d)
                mine = slice(2 * ray, 2 * ray + 2)
                columns[at, self.cell[k]] += rays.own[mine].T @ seen[mine]
            at = p.image_count * p.d + np.arange(p.shared_count)
            columns[at, self.cell[k]] += rays.shared.T @ seen
        return value, columns[whole.at] * e.unit[whole.at, None], inside

    def of_moves(self, moved: np.ndarray) -> np.ndarray:
        """Differences (cells, k) where the pairs, one half after the other, move (2 n, 3, k)."""
        count = self.point.shape[1]
        apart = self.weight[:, None] * (moved[:count, 2] - moved[count:, 2])
        out = np.zeros((self.count, moved.shape[2]))
        np.add.at(out, self.cell, apart)
        return out
