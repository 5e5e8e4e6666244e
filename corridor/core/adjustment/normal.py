"""Normal equations of a problem at a state: assembled in one pass, by one thread or two."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from corridor.core.adjustment.distances import add_distances, ground_with_ends
from corridor.core.adjustment.matrix import Band, Bordered, Singular, Sparse
from corridor.core.adjustment.measured_poses import pose_rows, residuals
from corridor.core.adjustment.model import Loss
from corridor.core.adjustment.partition import Pieces
from corridor.core.adjustment.problem import POSE_KINDS, Problem, State
from corridor.core.adjustment.rigs import Exposures, hung
from corridor.core.adjustment.unknowns import is_per_image, per_image_code
from corridor.core.block import turned
from corridor.core.camera import INTERIOR, radials_in_use, without_distortion
from corridor.core.effects import ROW_REACH, Context, Images
from corridor.core.engine import scene as arrays
from corridor.core.engine.interface import engine
from corridor.core.engine.scene import PANEL
from corridor.core.geometry import rotation_from_vector

# Observations that effects look at in one go: small enough for the cache.
CHUNK = 4096
_FIRST_RADIAL = INTERIOR.index("k1")
_NO_DERIVATIVE = np.zeros((0, 2, 0))
_NO_SIGHT = np.zeros((0, 2, 9))
# By how much centre, turn and point are moved for what effects on the image make of it, m and rad.
_SIGHT_STEP = (1e-3,) * 3 + (1e-5,) * 3 + (1e-3,) * 3


# From a pixel so near (px) a step of Newton finds what effects on the image look at; from a row so
# near, where the camera is: to a millionth of a pixel, as each leaves the square. Where a camera
# moves straight, only the perspective bends its way in the picture.
NEAR, NEAR_ROW, NEAR_STRAIGHT = 0.5, 0.05, 5.0
# Pixels and rows are at rest where another look moves them by less than this (px).
AT_REST, ROW_AT_REST = 1e-11, 1e-5
PASSES = 20


@dataclass
class Modelled:
    """Where a state puts the observations, as far as effects must know.

    row (n,): the row in which a moving camera reads each, px; pixel (n, 4): x, y, u, v at which
    effects on the image look; slope (n, 4): derivative of the pixel by the one before effects;
    sight (n, 2, 9): of the effects' shift by centre, turn and point, where they see these.
    Empty where nothing moves or looks.
    """

    row: np.ndarray
    pixel: np.ndarray
    slope: np.ndarray
    sight: np.ndarray

    def copy(self) -> "Modelled":
        """The same in arrays of its own."""
        return Modelled(self.row.copy(), self.pixel.copy(), self.slope.copy(), self.sight.copy())


@dataclass
class View:
    """A state as the kernels take it.

    exposures: of whose unknowns those of images are made; cameras: poses, interiors and motion;
    d_interior (m, k, 16), d_motion (m, k, degree + 1, 8) as in `_for_kernels` and d_ground
    (c, 3, k): derivatives by the effects; control_residual (c, 3): given minus modelled, m.
    """

    state: State
    images: Images
    exposures: Exposures
    cameras: arrays.Cameras
    d_interior: np.ndarray
    d_motion: np.ndarray
    control_residual: np.ndarray
    d_ground: np.ndarray


class Normal:
    """The equations of one problem; storage is kept from one assembly to the next.

    What is found at a state depends on the state alone: where effects move the camera or look at
    the modelled pixel, both are brought to rest first, to a millionth of a pixel. `near` may say
    where a state close by had them, which saves passes and changes nothing else.

    After `assemble`: cost (half the weighted sum of squares, priors included), behind (how many
    observations lie behind their camera), modelled (at that state), gradient (n,) and
    shared_gradient (q,). The unknowns are those of exposures (see `corridor.core.adjustment.rigs`).
    """

    def __init__(self, problem: Problem, loss: Loss, threads: int = 1, storage: str = "auto"):
        self.problem, self.loss = problem, loss
        p = problem
        if storage == "auto":
            storage = "sparse" if _band_costs_more(p) else "band"
        self.longest = int(np.diff(p.ptr).max(initial=1))
        self.sighted = p.stack.sees_points
        self.engine = engine()(p.d, self.longest, self.sighted)
        exposures = self.exposures_at(p.start)
        # The same, for the unknowns of exposures.
        self.of_exposures = engine()(exposures.size, self.longest, self.sighted)
        self.pieces = Pieces.of(p, min(threads, self.engine.threads) if storage == "band" else 1)
        self.storage = storage
        root = np.sqrt(p.control_weight)[:, :, None] * p.control_turn
        lower = np.tril_indices(3)
        # In one layout: a kernel is compiled for each anew.
        whole, root = (
            np.ascontiguousarray(one[:, lower[0], lower[1]])
            for one in (root.transpose(0, 2, 1) @ root, root)
        )
        self.control_weight = whole, root
        rows, size = p.exposure_count + self.pieces.apart, exposures.size
        self.gradient = np.zeros((rows, size))
        self.reference = np.zeros((rows, size))
        self.cross = np.zeros((rows, size, p.wide))
        self.has_image_effects = bool(p.stack.at("image"))
        self.has_motion = bool(p.stack.at("motion"))
        mine = np.concatenate([p.camera_column, p.slot_column], axis=1)
        last = mine.max(axis=1, initial=-1)
        # Nothing at all where no column is touched.
        first = np.where(mine >= 0, mine, np.maximum(last, 0)[:, None]).min(axis=1, initial=p.wide)
        touched = (p.camera_column, p.slot_column, p.ground_column)
        self.columns = arrays.Columns(
            _sources(p),
            p.images.camera,
            p.slot_column,
            p.ground_column,
            first,
            last,
            first // PANEL * PANEL,
            -(-(last + 1) // PANEL) * PANEL,
            p.wide,
            used=1 + max(int(some.max(initial=-1)) for some in touched),
            exposure=p.exposure,
            hung=np.zeros((0, 18)),
        )
        # What images have for themselves stands further behind in the unknowns of their exposure.
        behind = exposures.unknown[:, -1:] % size + 1 - p.d if size > p.d else 0
        slot = np.where(is_per_image(p.slot_column), p.slot_column - behind, p.slot_column)
        self.columns_of_exposures = self.columns._replace(slot=slot)
        self.assembled: View | None = None
        self.held = np.zeros((0, 2), dtype=np.int64)

    @cached_property
    def blocks(self) -> Band | Sparse:
        """Where equations are assembled; residuals need none."""
        p = self.problem
        size = self.of_exposures.d
        if self.storage == "sparse":
            return Sparse(p.exposure_count, size, p.ptr, p.exposure[p.img])
        rows = p.exposure_count + self.pieces.apart
        return Band(p.exposure_count, size, p.bandwidth, rows, self.engine)

    def exposures_at(self, state: State) -> Exposures:
        """Of whose unknowns those of the images are made."""
        return Exposures(self.problem, state.rotation)

    # --- what stays the same during one evaluation -----------------------------------------

    def view(self, state: State) -> View:
        """What all observations have in common at a state."""
        p = self.problem
        images = p.images.with_poses(state.centre, state.rotation)
        every = Context(images, np.arange(p.image_count))
        interior = state.interior[images.camera]
        shift, d_interior = p.stack.evaluate("camera", every, state.effects)
        if p.stack.at("camera"):
            interior = interior + _widened(shift, interior.shape[1])
        motion, d_motion = p.stack.motion_by_row(images, state.effects)
        motion, d_motion = _for_kernels(state.rotation, motion, d_motion)
        c = len(p.control_rows)
        if c:
            names = p.block.ground["point"].to_numpy(dtype=object)[p.control_rows]
            rows = np.flatnonzero((p.control >= 0) & (p.control < c))
            modelled = p.control_given[:c].copy()
            modelled[p.control[rows]] = state.points[rows]
            ground = Context(images, point=list(names), position=modelled)
            moved, d_ground = p.stack.evaluate("ground", ground, state.effects)
            residual = p.control_given[:c] - modelled - moved
        else:
            residual, d_ground = np.zeros((0, 3)), np.zeros((0, 3, 0))
        residual, d_ground = ground_with_ends(p, state, residual, d_ground)
        # An effect's derivative may be a read-only view, which kernels would be compiled anew for.
        d_ground = np.array(d_ground, order="C")
        radials = int(radials_in_use(interior))
        for name in {name for free in p.free.values() for name in free}:
            radials = max(radials, INTERIOR.index(name) - _FIRST_RADIAL + 1)
        fisheye = bool(interior[:, -1].any())
        radials = max(radials, 2) if fisheye else radials
        row_of = images.row_of.copy()
        row_of[:, 1:] /= ROW_REACH
        pose = [state.centre, state.rotation.reshape(-1, 9), row_of, np.zeros((len(row_of), 1))]
        turns = any(by[..., 3:6].any() for by in (motion, d_motion))
        cameras = arrays.Cameras(
            np.concatenate(pose, axis=1), np.ascontiguousarray(interior), radials,
            fisheye, motion, turns,
        )  # fmt: skip
        d_interior = _widened(d_interior.transpose(0, 2, 1), arrays.INNER)
        exposures = self.exposures_at(state)
        return View(state, images, exposures, cameras, d_interior, d_motion, residual, d_ground)

    def scene_of_exposures(
        self, view: View, modelled: Modelled, first: int, last: int, anew: bool = True
    ) -> arrays.Scene:
        """As `scene`, for `of_exposures`."""
        columns = self.columns_of_exposures._replace(hung=view.exposures.hung)
        return self.scene(view, modelled, first, last, anew)._replace(columns=columns)

    def scene(
        self, view: View, modelled: Modelled, first: int, last: int, anew: bool = True
    ) -> arrays.Scene:
        """What kernels need to know of points first..last.

        modelled: moved on by whoever goes over the points. anew: find the slope of image effects,
        which changes little from then on.
        """
        shift, d_image = self._shifts(view, modelled, first, last)
        if self.has_image_effects:
            if anew:
                self._find_slope(view, modelled, first, last, shift)
            slope = modelled.slope[self.problem.ptr[first] : self.problem.ptr[last]]
            shift = np.concatenate([shift, slope], axis=1)
        sight = _NO_SIGHT
        if self.sighted:
            sight = modelled.sight[self.problem.ptr[first] : self.problem.ptr[last]]
        return self._scene(view, modelled, (first, last), shift, d_image, sight=sight)

    def _scene(
        self, view, modelled, points, shift, d_image=_NO_DERIVATIVE, within=NEAR, sight=_NO_SIGHT
    ) -> arrays.Scene:
        p = self.problem
        straight = view.cameras.motion.shape[1] <= 2
        near = NEAR_STRAIGHT if straight else NEAR_ROW
        if within < NEAR:
            near = ROW_AT_REST
        return arrays.Scene(
            view.state.points,
            arrays.Observations(p.ptr, p.img, p.xy, p.weight, p.skewed),
            view.cameras,
            arrays.Looked(int(p.ptr[points[0]]), shift, modelled.row, modelled.pixel, near),
            arrays.Derivatives(view.d_interior, d_image, view.d_motion, view.d_ground, sight),
            self.columns,
            arrays.Control(p.control, *self.control_weight, view.control_residual),
            self.loss,
            *points,
        )

    def _shifts(self, view: View, modelled: Modelled, first: int, last: int):
        """Image effects (n, 2) of the observations of points first..last, and their derivative.

        The derivative is (n, 2, parameters); n = 0 without effects on the image.
        """
        if not self.has_image_effects:
            return np.zeros((0, 2)), _NO_DERIVATIVE
        seen = self._seen(view, modelled, first, last)
        shift, derivative = self.problem.stack.evaluate("image", seen, view.state.effects)
        return np.ascontiguousarray(shift), np.ascontiguousarray(derivative)

    def _shift(self, view: View, modelled: Modelled, first: int, last: int) -> np.ndarray:
        """As `_shifts`, without the derivative."""
        if not self.has_image_effects:
            return np.zeros((0, 2))
        seen = self._seen(view, modelled, first, last)
        return self.problem.stack.shift("image", seen, view.state.effects)

    def _seen(self, view: View, modelled: Modelled, first: int, last: int) -> Context:
        """What effects on the image look at of the observations of points first..last."""
        p = self.problem
        rows = slice(p.ptr[first], p.ptr[last])
        seen = modelled.pixel[rows]
        position = self._seen_points(view, first, last)
        return Context(
            view.images, p.img[rows], pixel=seen[:, :2], ray=seen[:, 2:], position=position,
            measured=p.xy[rows],
        )  # fmt: skip

    def _seen_points(self, view: View, first: int, last: int) -> np.ndarray | None:
        """Object point (n, 3) of each observation of points first..last, where effects see it."""
        if not self.sighted:
            return None
        count = np.diff(self.problem.ptr[first : last + 1])
        return np.repeat(view.state.points[first:last], count, axis=0)

    def _find_slope(
        self, view: View, modelled: Modelled, first: int, last: int, shift: np.ndarray
    ) -> None:
        """Derivative of the pixel by the pixel before image effects, which look at it.

        shift (n, 2): theirs. From m = p + s(m) follows dm = (1 - ds/dm)^-1 dp; ds/dm by steps of a
        pixel, the ray along.
        """
        p = self.problem
        rows = slice(p.ptr[first], p.ptr[last])
        seen, image = modelled.pixel[rows], p.img[rows]
        step = 1.0 / view.cameras.interior[image, 0]
        position = self._seen_points(view, first, last)
        if self.sighted:
            self._find_sight(view, modelled, rows, position)
        by = np.empty((len(seen), 2, 2))
        for axis in range(2):
            pixel, ray = seen[:, :2].copy(), seen[:, 2:].copy()
            pixel[:, axis] += 1.0
            ray[:, axis] += step
            look = Context(
                view.images, image, pixel=pixel, ray=ray, position=position, measured=p.xy[rows]
            )
            # At infinity, beside its camera, an observation has no slope; it counts as behind.
            with np.errstate(invalid="ignore"):
                by[:, :, axis] = p.stack.shift("image", look, view.state.effects) - shift
        (a, b), (c, d) = by[:, 0].T, by[:, 1].T
        inverse = 1.0 / ((1.0 - a) * (1.0 - d) - b * c)
        found = np.stack([1.0 - d, b, c, 1.0 - a], axis=1) * inverse[:, None]
        modelled.slope[rows] = found

    def _find_sight(self, view: View, modelled: Modelled, rows: slice, position) -> None:
        """Derivative of image effects by the centre, the turn and the point that they see."""
        p, images = self.problem, view.images
        image, seen = p.img[rows], modelled.pixel[rows]
        for k, h in enumerate(_SIGHT_STEP):
            total = 0.0
            for sign in (h, -h):
                centre, rotation, point = images.centre, images.rotation, position
                unit = sign * np.eye(3)[k % 3]
                if k < 3:
                    centre = centre + unit
                elif k < 6:
                    rotation = rotation_from_vector(unit) @ rotation
                else:
                    point = point + unit
                look = Context(
                    images.with_poses(centre, rotation), image,
                    pixel=seen[:, :2], ray=seen[:, 2:], position=point, measured=p.xy[rows],
                )  # fmt: skip
                shift = p.stack.shift("image", look, view.state.effects)
                total = total + np.sign(sign) * shift
            modelled.sight[rows, :, k] = total / (2.0 * h)

    def chunks(self, first: int, last: int, size: int | None = None) -> Iterator[tuple[int, int]]:
        """Ranges of points of so many observations; by default those whose effects are evaluated
        together."""
        if size is None:
            size = CHUNK if self.has_image_effects else self.problem.ptr[-1]
        ptr = self.problem.ptr
        while first < last:
            upto = int(np.searchsorted(ptr, ptr[first] + size, side="right")) - 1
            upto = min(max(upto, first + 1), last)
            yield first, upto
            first = upto

    # --- residuals ---------------------------------------------------------------------------

    def modelled_at(
        self, state: State, near: Modelled | None = None, within: float = AT_REST
    ) -> Modelled:
        """Where a state puts the observations; the last pass moved no pixel by more than `within`.

        Effects make a shift that differs between places a pixel apart by far less than a pixel:
        what is left is a small part of that.
        """
        if not (self.has_image_effects or self.has_motion):
            return self._start()
        return self._converge(self.view(state), near, within)[0]

    def residuals(self, state: State, near: Modelled | None = None) -> tuple[np.ndarray, int]:
        """Image residuals (n, 2) px, sorted as the problem, and how many are behind a camera."""
        out = np.empty((len(self.problem.img), 2))
        _, (_, behind) = self._converge(self.view(state), near, out=out)
        return out, int(behind)

    def cost_at(self, state: State, near: Modelled | None = None) -> tuple[float, int]:
        """Cost at a state and how many observations are behind a camera, without derivatives."""
        view = self.view(state)
        cost, behind = self._converge(view, near)[1]
        return self._with_others(cost, view, None), int(behind)

    def _start(self) -> Modelled:
        """The measured pixels and rows, with rays that leave distortion out."""
        p = self.problem
        moving = slice(0, len(p.img) if self.has_motion else 0)
        down = p.images.row_axis[p.img[moving]] == 1
        row = np.where(down, p.xy[moving, 1], p.xy[moving, 0])
        if not self.has_image_effects:
            return Modelled(row, np.zeros((0, 4)), np.zeros((0, 4)), _NO_SIGHT)
        ray = without_distortion(p.xy, p.start.interior, p.images.camera[p.img])
        sight = np.zeros((len(p.img), 2, 9)) if self.sighted else _NO_SIGHT
        pixel = np.concatenate([p.xy, ray], axis=1)
        return Modelled(row, pixel, np.zeros((len(p.img), 4)), sight)

    def _converge(
        self,
        view: View,
        near: Modelled | None,
        within: float = AT_REST,
        out: np.ndarray | None = None,
    ) -> tuple[Modelled, np.ndarray]:
        """Where the observations come to rest, and (cost of their residuals, how many behind).

        out (n, 2): receives the residuals, px, in place of which the loss counts otherwise.
        """
        modelled = self._start() if near is None else near.copy()
        plain = out is not None
        into = np.zeros((0, 2)) if out is None else out
        for _ in range(PASSES if self.has_image_effects else 1):
            before = modelled.pixel[:, :2].copy()
            totals = np.zeros((len(self.pieces), 2))

            def work(piece: int, start: int, stop: int, totals=totals) -> None:
                for first, last in self.chunks(start, stop):
                    shift = self._shift(view, modelled, first, last)
                    scene = self._scene(view, modelled, (first, last), shift, within=within)
                    if plain:
                        unweighted = scene.observations._replace(
                            weight=np.ones(1), skewed=np.zeros((0, 3))
                        )
                        scene = scene._replace(observations=unweighted, loss=Loss())
                    totals[piece] += self.engine.residuals(scene, into)

            self.pieces.run(work)
            if not _farthest(modelled.pixel[:, :2], before) > within:
                break
        return modelled, totals.sum(axis=0)

    # --- assembly ----------------------------------------------------------------------------

    def assemble(
        self, state: State, damping: float, near: Modelled | None = None, matrix: bool = True
    ) -> None:
        """Fill the reduced equations at a state; without `matrix` the right side alone."""
        view = self.assembled = self.view(state)
        if near is None and (self.has_image_effects or self.has_motion):
            near = self._converge(view, None)[0]
        self.modelled = self._start() if near is None else near.copy()
        for _ in range(PASSES):
            before = self.modelled.pixel[:, :2].copy()
            self._assemble(view, damping, matrix)
            if not _farthest(self.modelled.pixel[:, :2], before) > NEAR:
                return

    def _assemble(self, view: View, damping: float, matrix: bool) -> None:
        p = self.problem
        q, wide = p.shared_count, p.wide
        kept: list[np.ndarray] = [self.gradient]
        if matrix:
            kept += [self.reference, self.cross, self.blocks.rows]
            self.blocks.holds = None
        block = np.zeros((len(self.pieces), wide * wide))
        shared = np.zeros((len(self.pieces), 2, wide))
        totals = np.zeros((len(self.pieces), 3))

        def work(piece: int, start: int, stop: int) -> None:
            equations = arrays.Equations(
                self.blocks.storage,
                self.gradient.ravel(),
                self.reference.ravel(),
                self.cross.ravel(),
                block[piece],
                shared[piece, 0],
                shared[piece, 1],
                *self.pieces.shift(piece),
                matrix,
            )
            for array in kept:
                self.pieces.clear(piece, array)
            for first, last in self.chunks(start, stop):
                # A right side alone meets the matrix, and so the slope, of a step before.
                scene = self.scene_of_exposures(view, self.modelled, first, last, anew=matrix)
                totals[piece] += self.of_exposures.assemble(scene, damping, equations)

        self.pieces.run(work)
        for array in kept:
            self.pieces.fold(array)
        self.shared_gradient = shared[:, 0].sum(axis=0)[:q]
        if matrix:
            self.shared_block = np.tril(block.sum(axis=0).reshape(wide, wide)[:q, :q])
            self.shared_reference = shared[:, 1].sum(axis=0)[:q]
        cost, behind, self.weak = totals.sum(axis=0)
        self.cost, self.behind = self._with_others(cost, view, matrix), int(behind)
        if not matrix:
            return
        if damping:
            self.blocks.add_diagonal(damping * self.reference[: p.exposure_count])
            self.shared_block[np.diag_indices(q)] += damping * self.shared_reference
        if len(self.held):
            pinned = np.zeros((p.exposure_count, self.of_exposures.d))
            at = view.exposures.unknown[*self.held.T]
            pinned.reshape(-1)[at] = self.reference.reshape(-1)[at]
            self.blocks.add_diagonal(pinned)

    def _with_others(self, cost: float, view: View, matrix: bool | None) -> float:
        """Add what is no image point; half of the whole cost, twice that of image points given.

        matrix: whether the matrix is wanted, too; None: nothing but the cost.
        """
        p, state = self.problem, view.state
        # Of the control the engine adds the rest.
        control = turned(p.control_turn, view.control_residual)
        cost += float(np.sum(p.control_weight * control**2))
        cost += sum(self._add_poses(kind, view, matrix) for kind in POSE_KINDS)
        cost += add_distances(self, p, state, matrix)
        return 0.5 * float(cost + self._add_priors(view, matrix))

    def _add_poses(self, kind: str, view: View, matrix: bool | None) -> float:
        """Add what is measured of poses directly, `gnss` or `attitude`; twice its cost."""
        p, state, images = self.problem, view.state, view.images
        if not len(p.measured(kind)):
            return 0.0
        if matrix is None:
            return float(np.sum(p.weight_of(kind) * residuals(kind, p, state, images) ** 2))
        rows = pose_rows(kind, p, state, images)
        residual, weight = rows.residual, rows.weight
        unknown, own = view.exposures.rows(rows.image, rows.own)
        # Cameras and most effects move none of them.
        used = np.flatnonzero(rows.shared.any(axis=(0, 1)))
        shared = rows.shared[:, :, used]
        # `einsum` takes three times as long over as many small products.
        weighted = (own * weight[:, :, None]).transpose(0, 2, 1)
        heavy = (shared * weight[:, :, None]).reshape(weight.size, len(used))
        np.add.at(self.gradient.reshape(-1), unknown, (weighted @ residual[:, :, None])[:, :, 0])
        self.shared_gradient[used] += heavy.T @ residual.ravel()
        if matrix:
            blocks = weighted @ own
            self.blocks.add_blocks(unknown, blocks)
            np.add.at(self.reference.reshape(-1), unknown, np.einsum("nii->ni", blocks))
            cross = self.cross.reshape(-1, p.wide)
            np.add.at(cross, (unknown[:, :, None], used), weighted @ shared)
            block = heavy.T @ shared.reshape(weight.size, len(used))
            self.shared_block[np.ix_(used, used)] += np.tril(block)
            self.shared_reference[used] += np.diag(block)
        return float(np.sum(weight * residual**2))

    def from_priors(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Prior minus value of the shared unknowns (q,) and of every image's own (m, k)."""
        p = self.problem
        own = [state.effects[slug][:, number] for slug, number in p.per_image_unknowns]
        away = p.per_image_prior[0] - np.stack(own, axis=1) if own else np.zeros((p.image_count, 0))
        return p.prior_value - shared_values(p, state), away

    def _add_priors(self, view: View, matrix: bool | None) -> float:
        p, unknown = self.problem, view.exposures.unknown
        shared, own = self.from_priors(view.state)
        weight = p.per_image_prior[1]
        if matrix is not None:
            self.shared_gradient += p.prior_weight * shared
            self.gradient.reshape(-1)[unknown[:, 6:]] += weight * own
        if matrix:
            self.shared_block[np.diag_indices(p.shared_count)] += p.prior_weight
            self.shared_reference += p.prior_weight
            # Exposures that lack an image have nothing in its place.
            flat = np.ones(p.exposure_count * self.of_exposures.d)
            flat[unknown] = 0.0
            flat[unknown[:, 6:]] = weight
            flat[unknown[*p.idle.T]] += 1.0
            if flat.any():
                diagonal = flat.reshape(p.exposure_count, -1)
                self.blocks.add_diagonal(diagonal)
                self.reference[: p.exposure_count] += diagonal
        return float(np.sum(p.prior_weight * shared**2) + np.sum(weight * own**2))

    def factor(self) -> Bordered:
        """Factorise in place. Raises Singular."""
        p = self.problem
        count = p.exposure_count
        try:
            return Bordered(
                self.blocks,
                self.cross[:count].reshape(-1, p.wide)[:, : p.shared_count],
                self.shared_block,
                self.shared_reference,
                self.reference[:count],
            )
        except Singular as weak:
            if weak.image is not None and weak.own is not None:
                # Of the exposure's: whose it is of its images, and which of that one's.
                unknown = self.exposures_at(p.start).unknown
                at = weak.image * self.of_exposures.d + weak.own
                weak.image, weak.own = np.argwhere(unknown == at)[0].tolist()
            raise

    def step_of_images(self, step: np.ndarray) -> np.ndarray:
        """The step (m, d) of images that a step (n,) of exposures makes."""
        assert self.assembled is not None
        return self.assembled.exposures.images(step).reshape(-1, self.problem.d)

    def stand_at(self, state: State) -> None:
        """Make what points are substituted with at a state, without its equations."""
        self.assembled, self.modelled = self.view(state), self.modelled_at(state)
        if self.has_image_effects:
            for first, last in self.chunks(0, len(self.problem.ptr) - 1):
                shift = self._shift(self.assembled, self.modelled, first, last)
                self._find_slope(self.assembled, self.modelled, first, last, shift)

    def substitute(
        self, state: State, damping: float, step: np.ndarray, shared: np.ndarray
    ) -> tuple[np.ndarray, float, float]:
        """New points (n, 3), and of their step: step . gradient, step . diagonal . step."""
        p = self.problem
        if self.assembled is None or self.assembled.state is not state:
            self.stand_at(state)
        view = self.assembled
        assert view is not None
        moved = np.empty_like(state.points)
        totals = np.zeros((len(self.pieces), 2))
        padded = np.zeros(p.wide)
        padded[: len(shared)] = shared
        whole = self._step(view, step, padded)

        def work(piece: int, start: int, stop: int) -> None:
            for first, last in self.chunks(start, stop):
                scene = self.scene(view, self.modelled, first, last, anew=False)
                totals[piece] += self.engine.substitute(scene, damping, whole, moved)

        self.pieces.run(work)
        down, square = totals.sum(axis=0)
        return moved, float(down), float(square)

    def _step(self, view: View, step: np.ndarray, shared: np.ndarray) -> arrays.Step:
        """What a step of the images (m, d) and the shared (wide,) does to each image."""
        p = self.problem
        camera = np.where(p.camera_column >= 0, shared[np.maximum(p.camera_column, 0)], 0.0)
        slots = np.where(p.slot_column >= 0, shared[np.maximum(p.slot_column, 0)], 0.0)
        image, slot = np.nonzero(is_per_image(p.slot_column))
        slots[image, slot] = step[image, per_image_code(p.slot_column[image, slot])]
        first = view.d_interior.shape[1]
        last = slots.shape[1] - view.d_motion.shape[1]
        interior = np.einsum("ink,in->ik", view.d_interior, slots[:, :first])
        return arrays.Step(
            np.concatenate([step.ravel(), np.zeros(PANEL)]),
            shared,
            interior + _widened(camera, arrays.INNER),
            np.ascontiguousarray(slots[:, first:last]),
            np.einsum("in...,in->i...", view.d_motion, slots[:, last:]),
        )


def _sources(p: Problem) -> np.ndarray:
    """`Columns.source`: where the derivative behind each shared unknown of an image stands."""
    source = np.full((p.image_count, p.wide + 1), arrays.INNER - 1)
    image = np.arange(p.image_count)
    for parameter in range(p.camera_column.shape[1]):
        column = p.camera_column[:, parameter]
        source[image, np.where(column >= 0, column, p.wide)] = parameter
    return 2 * PANEL * np.ascontiguousarray(source[:, : p.wide])


def _widened(values: np.ndarray, width: int) -> np.ndarray:
    """The same with rows of whole panels: zeros behind."""
    out = np.zeros((*values.shape[:-1], width))
    out[..., : values.shape[-1]] = values
    return out


def _for_kernels(rotation: np.ndarray, motion: np.ndarray, d_motion: np.ndarray):
    """Motion (m, degree + 1, 8) and its derivative (m, k, degree + 1, 8), as the kernels take them.

    The centre moves in the camera frame. Arguments as of `Stack.motion_by_row`.
    """
    both = np.concatenate([motion[..., None], d_motion], axis=3)
    both[:, :, :3] = rotation[:, None] @ both[:, :, :3]
    both = _widened(both.transpose(0, 3, 1, 2), PANEL)
    return np.ascontiguousarray(both[:, 0]), np.ascontiguousarray(both[:, 1:])


def _farthest(pixels: np.ndarray, before: np.ndarray) -> float:
    """By how much (px) another look moved the observation that it moved most.

    What stands beside its camera is at infinity in both, and at rest.
    """
    with np.errstate(invalid="ignore"):
        return float(np.fmax.reduce(np.abs(pixels - before), axis=None, initial=0.0))


def _band_costs_more(p: Problem) -> bool:
    """Whether a sparse factorisation is likely cheaper than the band."""
    wide = p.bandwidth * p.d
    flops = p.exposure_count * p.d * wide**2
    return flops > 2e10 and p.bandwidth > 0.25 * p.exposure_count


def shared_values(p: Problem, state: State) -> np.ndarray:
    """Values (q,) of the shared unknowns."""
    tables = {"camera": lambda u: state.interior, "lever_arm": lambda u: state.arms}
    return np.array(
        [tables.get(u.kind, lambda u: state.effects[u.owner])(u)[u.at] for u in p.unknowns]
    )


def moved_state(
    p: Problem, state: State, step: np.ndarray, shared: np.ndarray, points: np.ndarray
) -> State:
    """The state after a step of the images (m, d) and the shared unknowns (q,), at new points."""
    interior, arms = state.interior.copy(), state.arms.copy()
    effects = {slug: values.copy() for slug, values in state.effects.items()}
    for unknown, change in zip(p.unknowns, shared.tolist(), strict=True):
        table = {"camera": interior, "lever_arm": arms}.get(unknown.kind)
        (effects[unknown.owner] if table is None else table)[unknown.at] += change
    for number, (slug, parameter) in enumerate(p.per_image_unknowns):
        effects[slug][:, parameter] += step[:, 6 + number]
    turn = rotation_from_vector(step[:, 3:6])
    centre, rotation = state.centre + step[:, :3], turn @ state.rotation
    return hung(p, State(centre, rotation, points, interior, effects, arms))
