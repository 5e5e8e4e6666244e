"""The engine in NumPy and SciPy: the whole of the mathematics, for reading and for small blocks.

Every ray at a time, all in arrays: where the image sees the point (`_see`), the derivatives of
that (`_rows`), and then linear algebra. With J the weighted rows of the rays by their images, B
those by what images share, P those by the points and e the residuals, the points are eliminated:

    V = P'P = L L',    Y = L^-1 P'J,    Z = L^-1 P'B,    n = L^-1 P'e

    J'J - Y'Y    J'B - Y'Z    and right    J'e - Y'n
                 B'B - Z'Z                 B'e - Z'n

Where ties weigh a million times as much as the rest, B'B - Z'Z would lose digits: B'(B - P L^-T Z)
is the same and loses none, and so are the others with B and e.

Increments of image i: C += dC; R <- Exp(dr) R. A camera that moves while its rows are read stands,
at a row, at (c, theta): X = Exp(-theta) (R (P - C) - c).

Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 4.3, 6 and 9.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dtbtrs
from scipy.sparse import csr_array, tril
from scipy.spatial.transform import Rotation

from corridor.core.engine.scene import (
    PANEL,
    PASSES,
    Asked,
    Equations,
    Inverse,
    Passing,
    Rays,
    Scene,
    Step,
    robust,
)

# Rows and columns of the six numbers that a symmetric matrix of a point has.
_LOWER = np.tril_indices(3)
# Numbers that are gathered at once where points take their part of the inverse.
_AT_ONCE = 4_000_000


# --- where images see points ----------------------------------------------------------------------


class _Seen(NamedTuple):
    """Of n rays: image (n,); x (n, 3), the point in the camera's frame before the turn of its row,
    and place (n,) of that row, turn (n, 3); rotation (n, 3, 3); ahead (n,): whether the point is
    before the camera; ray (n, 2), lens (n, 2), the same before its distortion (`_through_lens`),
    focal (n,) and the ray distorted (n, 2), affine (n, 2, 2): what a fisheye does to it last;
    stretched (n, 2): what b1 and b2 multiply; weight (n,) with that of the loss; by (n, 2, 3):
    weighted derivative of the pixel by x; slope (n, 2, 2): of the pixel by what it is before
    effects, before a moving camera and before correlated coordinates; residual (n, 2), weighted;
    cost (n,); row (n,) and pixel (n, 2): where it is found now."""

    image: np.ndarray
    x: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    rotation: np.ndarray
    ahead: np.ndarray
    ray: np.ndarray
    lens: np.ndarray
    focal: np.ndarray
    distorted: np.ndarray
    affine: np.ndarray
    stretched: np.ndarray
    weight: np.ndarray
    by: np.ndarray
    slope: np.ndarray
    residual: np.ndarray
    cost: np.ndarray
    row: np.ndarray
    pixel: np.ndarray


def _rays(scene: Scene) -> slice:
    """The rays of the scene's points among all."""
    return slice(*scene.observations.start[[scene.first, scene.last]].tolist())


def _lengths(scene: Scene) -> np.ndarray:
    """How many rays each of the scene's points has."""
    return np.diff(scene.observations.start[scene.first : scene.last + 1])


def _see(scene: Scene) -> _Seen:
    """The rays of the scene's points; moves on what the scene knows of rows and pixels."""
    looked, rays = scene.looked, _rays(scene)
    moves, looks = scene.cameras.motion.shape[1] > 0, len(looked.modelled) > 0
    row = looked.row[rays].copy() if moves else np.zeros(rays.stop - rays.start)
    modelled = looked.modelled[rays, :2].copy()
    for _ in range(PASSES if moves else 1):
        seen = _see_once(scene, row, modelled)
        far = np.abs(seen.row - row) > looked.near
        if not (moves and far.any()):
            break
        row = np.where(far, seen.row, row)
    if moves:
        looked.row[rays] = np.where(seen.ahead, seen.row, looked.row[rays])
    if looks:
        found = np.concatenate([seen.pixel, seen.ray], axis=1)
        looked.modelled[rays] = np.where(seen.ahead[:, None], found, looked.modelled[rays])
    return seen


def _see_once(scene: Scene, row: np.ndarray, modelled: np.ndarray) -> _Seen:
    """One step of Newton from the rows, and pixels of effects, that were found last."""
    o, cameras, looked = scene.observations, scene.cameras, scene.looked
    rays = _rays(scene)
    image, n = o.image[rays], rays.stop - rays.start
    pose, interior = cameras.pose[image], cameras.interior[image]
    rotation = pose[:, 3:12].reshape(n, 3, 3)
    point = np.repeat(scene.points[scene.first : scene.last], _lengths(scene), axis=0)
    x = bent = _times(rotation, point - pose[:, :3])
    back, turn, place = np.eye(3), np.zeros((n, 3)), np.zeros(n)
    factor, moves = pose[:, 13], cameras.motion.shape[1] > 0
    if moves:
        place = factor * row + pose[:, 14]
        centre, turn, centre_slope, turn_slope = _course(cameras.motion[image], place)
        x = bent = x - centre
        # How X moves with the place of the row, before the turn.
        x_slope = np.cross(x, turn_slope) - centre_slope
        if cameras.turns:
            back = Rotation.from_rotvec(-turn).as_matrix()
            bent = _times(back, x)
    ahead = bent[:, 2] > 0
    inverse = np.zeros(n)
    inverse[ahead] = 1.0 / bent[ahead, 2]
    ray, f = bent[:, :2] * inverse[:, None], interior[:, 0]
    lens, by_lens = _through_lens(ray, interior)
    affine, fisheye = np.tile(np.eye(2), (n, 1, 1)), _fisheye(interior)[:, None]
    affine[:, 0] += fisheye * interior[:, 5:7]
    bent_ray, by_ray = _distorted(lens, interior)
    stretched = np.where(fisheye, bent_ray, lens)
    distorted, by_ray = _times(affine, bent_ray), affine @ by_ray @ by_lens
    pixel = interior[:, 1:3] + f[:, None] * distorted
    by = np.concatenate([by_ray, -_times(by_ray, ray)[:, :, None]], axis=2)
    by *= (f * inverse)[:, None, None]
    slope = np.broadcast_to(np.eye(2), (n, 2, 2))
    if len(looked.shift):
        shift = looked.shift[rays.start - looked.base :][:n]
        pixel = pixel + shift[:, :2]
        if shift.shape[1] > 2:
            # The shift is that of the pixel modelled last time: one step of Newton from there.
            slope = shift[:, 2:].reshape(n, 2, 2)
            pixel = modelled + _times(slope, pixel - modelled)
            by = slope @ by
    if moves:
        by = by @ back
        along = factor[:, None] * _times(by, x_slope)
        axis = np.where(pose[:, 12] > 0, 1, 0)
        every = np.arange(n)
        keeps = 1.0 / (1.0 - along[every, axis])
        missed = np.where(ahead, (pixel[every, axis] - row) * keeps, 0.0)
        pixel = pixel + along * missed[:, None]
        across = np.tile(np.eye(2), (n, 1, 1))
        across[every, :, axis] += along * keeps[:, None]
        by, slope = across @ by, across @ slope
        place, row = place + factor * missed, row + missed
    weight = np.where(ahead, o.weight[rays] if len(o.weight) > 1 else o.weight, 0.0)
    residual = weight[:, None] * (o.xy[rays] - pixel)
    if len(o.skewed):
        skew = np.zeros((n, 2, 2))
        skew[:, [0, 1, 1], [0, 0, 1]] = o.skewed[rays]
        residual, by, slope = _times(skew, residual), skew @ by, skew @ slope
    cost = np.sum(residual**2, axis=1)
    cost, soft = robust(scene.loss, cost)
    weight, residual = weight * soft, residual * soft[:, None]
    return _Seen(
        image, x, place, turn, rotation, ahead, ray, lens, f, distorted, affine, stretched, weight,
        weight[:, None, None] * by, slope, residual, cost, row, pixel,
    )  # fmt: skip


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Matrices (n, k, l) times vectors (n, l)."""
    return (matrix @ vector[:, :, None])[:, :, 0]


def _course(motion: np.ndarray, place: np.ndarray):
    """Centre and turn (n, 3) of moving cameras at the places (n,) of rows, and their slopes.

    motion (n, degree + 1, 8): coefficients of the powers of the place.
    """
    power = np.arange(motion.shape[1])
    here = place[:, None] ** power
    slope = power * place[:, None] ** np.maximum(power - 1, 0)
    at, by = ((some[:, None] @ motion[:, :, :6])[:, 0] for some in (here, slope))
    return at[:, :3], at[:, 3:], by[:, :3], by[:, 3:]


def _through_lens(ray: np.ndarray, interior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays (n, 2) as lenses have them before their distortion, and the derivative (n, 2, 2).

    A fisheye has angles from the axis, theta = atan(r), in place of r = tan(theta): across the ray
    it shrinks by theta / r, along it by d theta / d r = 1 / (1 + r^2).
    """
    r2 = np.sum(ray**2, axis=1)
    r = np.sqrt(r2)
    bent = _fisheye(interior) & (r > 0)
    safe = np.where(bent, r, 1.0)
    across = np.where(bent, np.arctan(safe) / safe, 1.0)
    along = np.where(bent, 1.0 / (1.0 + r2), 1.0)
    axis = ray / safe[:, None]
    turned = axis[:, :, None] * axis[:, None]
    by = across[:, None, None] * np.eye(2) + (along - across)[:, None, None] * turned
    return across[:, None] * ray, by


def _fisheye(interior: np.ndarray) -> np.ndarray:
    """Which lenses (n,) are fisheyes."""
    return interior[:, 15] > 0


def _distorted(ray: np.ndarray, interior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays (n, 2) distorted, at unit focal length, and their derivative (n, 2, 2)."""
    u, v = ray.T
    p1, p2 = interior[:, 3:5].T
    # A fisheye has them behind (`_Seen.affine`).
    b1, b2 = np.where(_fisheye(interior), 0.0, interior[:, 5:7].T)
    k = interior[:, 7:15]
    r2, power = u**2 + v**2, np.arange(1, 9)
    radial = 1.0 + np.sum(k * r2[:, None] ** power, axis=1)
    by_r2 = np.sum(power * k * r2[:, None] ** (power - 1), axis=1)
    a = u * radial + p1 * (r2 + 2 * u**2) + 2 * p2 * u * v + b1 * u + b2 * v
    b = v * radial + p2 * (r2 + 2 * v**2) + 2 * p1 * u * v
    mixed = 2 * u * v * by_r2 + 2 * p1 * v + 2 * p2 * u
    by = [
        [radial + 2 * u**2 * by_r2 + 6 * p1 * u + 2 * p2 * v + b1, mixed + b2],
        [mixed, radial + 2 * v**2 * by_r2 + 6 * p2 * v + 2 * p1 * u],
    ]
    return np.stack([a, b], axis=1), np.array(by).transpose(2, 0, 1)


# --- Jacobian rows --------------------------------------------------------------------------------


def _rows(seen: _Seen, base: int, scene: Scene, d: int) -> tuple[np.ndarray, ...]:
    """Weighted rows of n rays: own (n, 2, d) by the image, shared (n, 2, wide), point (n, 2, 3).

    base: the first of them in what effects say of rays.
    """
    n, columns, effects = len(seen.image), scene.columns, scene.derivatives
    # What is not moved by a camera goes through the slope as pixels do.
    slope = seen.weight[:, None, None] * seen.slope
    point = seen.by @ seen.rotation
    own = np.zeros((n, 2, d))
    own[:, :, :3] = -point
    own[:, :, 3:6] = np.cross(seen.x[:, None], seen.by)
    inner = slope @ _by_interior(seen)
    shared = np.take_along_axis(inner, columns.source[seen.image][:, None] // (2 * PANEL), axis=2)
    parts = [inner @ effects.interior[seen.image].transpose(0, 2, 1)]
    if effects.image.shape[2]:
        parts.append(slope @ effects.image[base : base + n])
    for k in range(effects.motion.shape[1]):
        centre, theta, _, _ = _course(effects.motion[seen.image, k], seen.place)
        # Exp(t + q) = Exp(Left q) Exp(t), to second order.
        turned = np.cross(seen.turn, theta)
        turned = theta + turned / 2 + np.cross(seen.turn, turned) / 6
        away = np.cross(seen.x, turned) - centre if scene.cameras.turns else -centre
        parts.append(seen.by @ away[:, :, None])
    for slot, by in enumerate(np.moveaxis(np.concatenate(parts, axis=2), 2, 0)):
        column = columns.slot[seen.image, slot]
        mine, theirs = np.flatnonzero(column <= -2), np.flatnonzero(column >= 0)
        own[mine, :, 4 - column[mine]] += by[mine]
        shared[theirs, :, column[theirs]] += by[theirs]
    if len(effects.sight):
        sight = slope @ effects.sight[base : base + n]
        own[:, :, :6] += sight[:, :, :6]
        point = point + sight[:, :, 6:]
    return own, shared, point


def _by_interior(seen: _Seen) -> np.ndarray:
    """Derivative (n, 2, 16) of the pixel by the interior parameters, and a column of zeros."""
    (u, v), f = seen.lens.T, seen.focal
    r2, mixed = u**2 + v**2, 2 * seen.focal * u * v
    out = np.zeros((len(f), 2, 16))
    out[:, :, 0] = seen.distorted
    out[:, 0, 1] = out[:, 1, 2] = 1.0
    out[:, 0, 3], out[:, 1, 3] = f * (r2 + 2 * u**2), mixed
    out[:, 0, 4], out[:, 1, 4] = mixed, f * (r2 + 2 * v**2)
    radial = f[:, None] * r2[:, None] ** np.arange(1, 9)
    out[:, :, 7:15] = seen.lens[:, :, None] * radial[:, None]
    bent = [3, 4, *range(7, 15)]
    out[:, :, bent] = seen.affine @ out[:, :, bent]
    out[:, 0, 5:7] = f[:, None] * seen.stretched
    return out


# --- points ---------------------------------------------------------------------------------------


def _full(half: np.ndarray) -> np.ndarray:
    """Symmetric matrices (n, 3, 3) of 00 10 11 20 21 22 (n, 6)."""
    return half[:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)


def _triangle(half: np.ndarray) -> np.ndarray:
    """Lower triangles (n, 3, 3) of the same."""
    out = np.zeros((len(half), 3, 3))
    out[:, *_LOWER] = half
    return out


def _inverse_root(v: np.ndarray) -> tuple[np.ndarray, int]:
    """L^-1 (n, 3, 3) of V = L L', and how many directions are without information.

    Such a one (rays that are parallel) gets a zero: it does not move.
    """
    factor, out, weak = np.zeros_like(v), np.zeros_like(v), 0
    for c in range(3):
        left = v[:, c:, c] - np.einsum("nrk,nk->nr", factor[:, c:, :c], factor[:, c, :c])
        sure = left[:, 0] > (1e-14 * v[:, c, c] if c else 0.0)
        weak += int(np.count_nonzero(~sure))
        inverse = np.where(sure, 1.0 / np.sqrt(np.where(sure, left[:, 0], 1.0)), 0.0)
        factor[:, c:, c] = left * inverse[:, None]
        out[:, c, c] = inverse
        before = np.einsum("nk,nkj->nj", factor[:, c, :c], out[:, :c, :c])
        out[:, c, :c] = -inverse[:, None] * before
    return out, weak


class _Points:
    """The scene's points with the rows of their rays (`_rows`), V, and sums over the rays of each.

    start (count + 1,): where the rays of each begin; of_ray (n,): the point of each ray.
    """

    def __init__(self, scene: Scene, d: int):
        # Images of one exposure have the same unknowns (m,).
        self.exposure = scene.columns.exposure
        self.exposures = int(self.exposure[-1]) + 1
        length = _lengths(scene)
        self.count, self.start = len(length), np.concatenate([[0], np.cumsum(length)])
        self.of_ray = np.repeat(np.arange(self.count), length)
        self.seen = _see(scene)
        self.own, self.shared, self.point = _rows(
            self.seen, _rays(scene).start - scene.looked.base, scene, d
        )
        if len(scene.columns.hung):
            lever, turn = scene.columns.hung[self.seen.image].reshape(-1, 2, 3, 3).swapaxes(0, 1)
            self.own[:, :, 3:6] = self.own[:, :, :3] @ lever + self.own[:, :, 3:6] @ turn
        self.across = self.point.transpose(0, 2, 1)
        self.v = self.sum(self.across @ self.point)
        self.residual = self.sum(_times(self.across, self.seen.residual))
        # Ground control: the points (k,) that are, their weight W = G'G, what is left of them.
        given = scene.control.row[scene.first : scene.last]
        self.given = np.flatnonzero(given >= 0)
        given = given[self.given]
        self.root = _triangle(scene.control.root[given])
        self.left = scene.control.residual[given]
        self.v[self.given] += _full(scene.control.weight[given])
        # Of it by what is shared (k, 3, wide): effects on the ground.
        self.ground = np.zeros((len(given), 3, scene.columns.wide))
        for slot in range(scene.derivatives.ground.shape[2]):
            column = scene.columns.ground[given, slot]
            some = np.flatnonzero(column >= 0)
            self.ground[some, :, column[some]] += scene.derivatives.ground[given[some], :, slot]

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over the rays of each point."""
        n, k = len(values), int(np.prod(values.shape[1:]))
        add = csr_array((np.ones(n), np.arange(n), self.start), shape=(self.count, n))
        return (add @ values.reshape(n, k)).reshape(self.count, *values.shape[1:])

    def weighted(self, values: np.ndarray) -> np.ndarray:
        """W times values (k, 3, ...) of the control."""
        return np.einsum("nki,nkj,nj...->ni...", self.root, self.root, values)

    def damped(self, damping: float) -> tuple[np.ndarray, int]:
        """L^-1 and weak directions, the diagonal of V grown by its share."""
        return _inverse_root(self.v * (1.0 + damping * np.eye(3)))

    def towards(self, residual: np.ndarray, left: np.ndarray) -> np.ndarray:
        """P'e (count, 3) of summed residuals of rays, and of the control's (k, 3)."""
        out = residual.copy()
        out[self.given] += self.weighted(left)
        return out

    def images_part(self, inverse: np.ndarray) -> np.ndarray:
        """Y, ray by ray: L^-1 P'J (n, 3, d)."""
        return inverse[self.of_ray] @ (self.across @ self.own)

    def shared_part(self, inverse: np.ndarray) -> np.ndarray:
        """Z: L^-1 P'B (count, 3, wide)."""
        by = self.sum(self.across @ self.shared)
        by[self.given] += self.weighted(self.ground)
        return inverse @ by


# --- the engine -----------------------------------------------------------------------------------


class _Factor:
    """See `corridor.core.engine.interface.Factor`; by LAPACK."""

    def __init__(self, band: np.ndarray, ld: int, n: int):
        self.lower = band[: n * ld].reshape(n, ld).T
        made, info = dpbtrf(self.lower, lower=1)
        self.lower[:] = made
        bad = np.flatnonzero(~(self.lower[0] > 0.0))
        self.weak = info - 1 if info else next(iter(bad.tolist()), None)

    def half(self, right: np.ndarray) -> np.ndarray:
        return self._solved(right, "N")

    def other_half(self, right: np.ndarray) -> np.ndarray:
        return self._solved(right, "T")

    def _solved(self, right: np.ndarray, way: str) -> np.ndarray:
        # LAPACK's wrapper writes where it must not when there is nothing to solve.
        return dtbtrs(self.lower, right, uplo="L", trans=way)[0] if right.size else right.copy()


class Plain:
    """See `corridor.core.engine.interface.Engine`."""

    name, threads = "plain", 1

    def __init__(self, d: int, longest: int, sighted: bool) -> None:
        self.d = d

    @staticmethod
    def ready() -> bool:
        return True

    def residuals(self, scene: Scene, out: np.ndarray) -> np.ndarray:
        seen = _see(scene)
        if len(out):
            out[_rays(scene)] = np.where(seen.ahead[:, None], seen.residual, np.nan)
        return np.array([seen.cost.sum(), np.count_nonzero(~seen.ahead)])

    def rows(self, scene: Scene, row: np.ndarray, weight: np.ndarray) -> Rays:
        points = _Points(scene, self.d)
        v = points.sum(points.across @ points.point) + _full(weight)
        n = 2 * len(points.of_ray)
        own, point, shared = (x.reshape(n, -1) for x in (points.own, points.point, points.shared))
        root = _inverse_root(v)[0][:, *_LOWER]
        return Rays(points.seen.image, points.start, own, point, shared, root, row)

    def assemble(self, scene: Scene, damping: float, into: Equations) -> np.ndarray:
        d, wide = self.d, scene.columns.wide
        points = _Points(scene, d)
        seen = points.seen
        inverse, weak = points.damped(damping)
        y, back = points.images_part(inverse), inverse.transpose(0, 2, 1)
        # By how much points follow a unit of what is shared, and the residuals: L^-T Z, L^-T n.
        follow = back @ points.shared_part(inverse)
        move = _times(back @ inverse, points.towards(points.residual, points.left))
        # J (rays, unknowns of images) and Y (points, the same), in three and two rows each.
        size = points.exposures * d
        column = points.exposure[seen.image][:, None] * d + np.arange(d)
        J = _sparse(points.own, 2 * np.arange(len(column)), column, (2 * len(column), size))
        Y = _sparse(y, 3 * points.of_ray, column, (3 * points.count, size))
        # Control has three rows a point, of what is shared alone. What points follow is gone.
        ground, at = points.root @ points.ground, points.of_ray
        B = np.concatenate([points.shared.reshape(-1, wide), ground.reshape(-1, wide)])
        of_rays = points.shared - points.point @ follow[at]
        of_ground = ground - points.root @ follow[points.given]
        of_rays, of_ground = of_rays.reshape(-1, wide), of_ground.reshape(-1, wide)
        left = (points.seen.residual - _times(points.point, move[at])).ravel()
        left_ground = _times(points.root, points.left - move[points.given]).ravel()
        into.gradient[:size] += J.T @ left
        into.shared_gradient[:] += B.T @ np.concatenate([left, left_ground])
        if into.matrix:
            lower = tril(J.T @ J - Y.T @ Y).tocoo()
            row, column = lower.row.astype(np.int64), lower.col.astype(np.int64)
            at = into.storage.entries(row, column, d)
            into.storage.flat[at] += lower.data
            into.diagonal[:size] += (J.multiply(J)).sum(axis=0)
            into.cross[: size * wide] += (J.T @ of_rays).ravel()
            into.block[:] += (B.T @ np.concatenate([of_rays, of_ground])).ravel()
            into.shared_diagonal[:] += np.sum(B**2, axis=0)
        return np.array([seen.cost.sum(), np.count_nonzero(~seen.ahead), weak])

    def factor(self, band: np.ndarray, ld: int, n: int) -> _Factor:
        return _Factor(band, ld, n)

    def substitute(self, scene: Scene, damping: float, step: Step, moved: np.ndarray) -> np.ndarray:
        points = _Points(scene, self.d)
        m = len(scene.cameras.pose)
        own = step.poses[: m * self.d].reshape(m, self.d)[points.seen.image]
        left = points.seen.residual - _times(points.own, own) - points.shared @ step.shared
        left = points.sum(_times(points.across, left))
        inverse, _ = points.damped(damping)
        half = _times(inverse, points.towards(left, points.left - points.ground @ step.shared))
        down = _times(inverse, points.towards(points.residual, points.left))
        change = _times(inverse.transpose(0, 2, 1), half)
        points_at = slice(scene.first, scene.last)
        moved[points_at] = scene.points[points_at] + change
        diagonal = np.einsum("nii->ni", points.v)
        return np.array([np.sum(down**2), np.sum(diagonal * change**2)])

    def follow(self, rays: Rays, left: np.ndarray, to: Passing) -> None:
        d, count = rays.own.shape[1], len(rays.root)
        unknowns = to.unknowns.reshape(-1, to.sets)
        start = 2 * rays.start
        column = np.repeat(rays.image, 2)[:, None] * d + np.arange(d)
        J = _sparse(rays.own[:, None], np.arange(len(column)), column, (len(column), to.shared))
        shared = slice(to.shared, to.shared + rays.shared.shape[1])
        if to.taken:
            left -= J @ unknowns[: to.shared] + rays.shared @ unknowns[shared]
        axis = 3 * np.repeat(np.arange(count), np.diff(start))[:, None] + np.arange(3)
        P = _sparse(rays.point[:, None], np.arange(len(axis)), axis, (len(axis), 3 * count))
        heavy, moved = (x.reshape(-1, 3, to.sets) for x in (to.heavy, to.moved))
        numbered = np.flatnonzero(rays.row >= 0)
        towards = (P.T @ left).reshape(count, 3, to.sets)
        towards[numbered] += heavy[rays.row[numbered]]
        root = _triangle(rays.root)
        move = root.transpose(0, 2, 1) @ (root @ towards)
        moved[rays.row[numbered]] = move[numbered]
        left -= P @ move.reshape(-1, to.sets)
        if not to.taken:
            unknowns[: to.shared] += J.T @ left
            unknowns[shared] += rays.shared.T @ left

    def inverse(
        self, band: np.ndarray, ld: int, n: int, left: np.ndarray, right: np.ndarray
    ) -> None:
        lower, within = band[: n * ld].reshape(n, ld), np.zeros((n, ld))
        step = max(_AT_ONCE // n, 1)
        for first in range(0, n, step):
            unit = np.zeros((n, min(step, n - first)))
            unit[first + np.arange(unit.shape[1]), np.arange(unit.shape[1])] = 1.0
            column = dpbtrs(lower.T, unit, lower=1)[0] + left @ right[first : first + step].T
            for c in range(unit.shape[1]):
                below = column[first + c : first + c + ld, c]
                within[first + c, : len(below)] = below
        lower[:] = within

    def point_covariance(self, scene: Scene, known: Inverse, asked: Asked) -> None:
        d, q = self.d, known.q
        points = _Points(scene, d)
        inverse, _ = points.damped(0.0)
        y, z = points.images_part(inverse), points.shared_part(inverse)[:, :, :q]
        shared = known.shared.reshape(q, q)
        across = known.poses_shared.reshape(points.exposures, d, q)
        image = points.exposure[points.seen.image]
        # Of Y and Z together with what is shared (count, 3, q).
        with_shared = points.sum(y @ across[image]) + z @ shared
        every = slice(scene.first, scene.last)
        number = asked.number[every]
        some = np.flatnonzero(number >= 0)
        found = -inverse.transpose(0, 2, 1) @ with_shared[:, :, asked.columns]
        asked.cross[number[some]] = found[some]
        if not len(asked.out):
            return
        size = np.diff(points.start)
        middle = np.eye(3) + with_shared @ z.transpose(0, 2, 1)
        middle = middle + z @ points.sum(y @ across[image]).transpose(0, 2, 1)
        for m in np.unique(size[size > 0]).tolist():
            same = np.flatnonzero(size == m)
            step = max(_AT_ONCE // (m * d) ** 2, 1)
            for at in (same[k : k + step] for k in range(0, len(same), step)):
                rays = points.start[at][:, None] + np.arange(m)
                unknown = (image[rays][:, :, None] * d + np.arange(d)).reshape(-1, m * d)
                q_own = known.near.symmetric(unknown[:, :, None], unknown[:, None], d)
                y_own = y[rays].transpose(0, 2, 1, 3).reshape(-1, 3, m * d)
                middle[at] += y_own @ q_own @ y_own.transpose(0, 2, 1)
        out = inverse.transpose(0, 2, 1) @ middle @ inverse
        asked.out[every] = out[:, *_LOWER]


def _sparse(values: np.ndarray, row: np.ndarray, column: np.ndarray, shape) -> csr_array:
    """Of blocks values (n, k, l): rows row (n,) to row + k - 1, columns column (n, l)."""
    n, k, _ = values.shape
    rows = np.broadcast_to((row[:, None] + np.arange(k))[:, :, None], values.shape)
    columns = np.broadcast_to(column[:, None], values.shape)
    return csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
