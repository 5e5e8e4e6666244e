"""The equations of an adjustment at a state, with a name for every column and row.

    N x = t,  N = A' P A,  t = A' P r

with the points eliminated: x holds six unknowns for the pose of each image (centre m, then
rotation about the camera's axes, rad), those of effects that each image has for itself, and what
images share. Whoever asks what measurements say at a state asks here: covariances, the diagnosis,
the planner, replicates.

A system depends on its problem and its state and on nothing that was asked before: rows that an
effect looks at are brought to rest first, from the measured ones.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import block_array, coo_array, csc_array, csr_array, vstack

from corridor.core.adjustment.distances import ENDS, distance_rows
from corridor.core.adjustment.matrix import Bordered
from corridor.core.adjustment.measured_poses import pose_rows, residuals
from corridor.core.adjustment.model import CAMERA, EFFECT, LEVER_ARM
from corridor.core.adjustment.normal import Loss, Normal, moved_state
from corridor.core.adjustment.observations import NO_GNSS
from corridor.core.adjustment.problem import POSE_KINDS, Problem, with_effects
from corridor.core.adjustment.rigs import Exposures, RigRows, rig_rows
from corridor.core.adjustment.solving import solve
from corridor.core.adjustment.unknowns import State, Unknown
from corridor.core.block import Block, along_axes, turned
from corridor.core.brief import brief
from corridor.core.effects import Context, Effect, Images, Parameter, Stack, Values
from corridor.core.engine.memory import InPlace
from corridor.core.engine.threads import one_thread
from corridor.core.geometry import helmert_motions, rotation_from_vector

POSE = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Columns:
    """The unknowns of a linear system: for each its number, name, value and prior.

    images (m,): names. pose (m, 6), of_image: slug -> (m, parameters): numbers of the unknowns
    that each image has for itself. parameters: slug -> parameters of one group, of every effect;
    of those in of_image without what is held.
    shared (q,): what images share, with its numbers shared_at (q,).
    scale (n,): prior standard deviation of an effect's parameter, NaN for all else. value (n,):
    of what is not a pose. prior_weight (n,): of the priors that count in the equations;
    shared_prior (q,): their values.
    """

    images: np.ndarray
    pose: np.ndarray
    of_image: dict[str, np.ndarray]
    parameters: dict[str, list[Parameter]]
    shared: list[Unknown]
    shared_at: np.ndarray
    scale: np.ndarray
    value: np.ndarray
    prior_weight: np.ndarray
    shared_prior: np.ndarray

    def __len__(self) -> int:
        return len(self.scale)

    def of(self, slug: str) -> np.ndarray:
        """Numbers of an effect's unknowns that images share (k,)."""
        mine = [(u.kind, u.owner) == (EFFECT, slug) for u in self.shared]
        return self.shared_at[np.array(mine, dtype=bool)]

    @property
    def shared_value(self) -> np.ndarray:
        """Values (q,) of what images share."""
        return self.value[self.shared_at]

    @cached_property
    def labels(self) -> list[str]:
        """Names (n,): `IMG7.x`, `IMG7.time_rounding.offset`, `camera.P1.f`."""
        out = [""] * len(self)
        blocks: list[tuple[np.ndarray, Sequence[str]]] = [(self.pose, POSE)]
        blocks += [
            (at, [f"{slug}.{p.name}" for p in self.parameters[slug]])
            for slug, at in self.of_image.items()
        ]
        for at, names in blocks:
            for image, row in zip(self.images, at.tolist(), strict=True):
                for number, name in zip(row, names, strict=True):
                    out[number] = f"{image}.{name}"
        for number, unknown in zip(self.shared_at.tolist(), self.shared, strict=True):
            out[number] = unknown.label
        return out


@brief
@dataclass(frozen=True)
class Residuals:
    """Measured minus modelled.

    pixels (n, 2) px, NaN behind a camera; gnss (k, 3), control (c, 3) m, in the coordinates of
    their `Rows`; attitude (k, 3) rad, about level axes. behind: how many image points lie behind
    their camera.
    """

    pixels: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    attitude: np.ndarray
    behind: int = 0


@dataclass(frozen=True)
class Rows:
    """Measured coordinates, three rows each, and what the unknowns do to them.

    Where x, y and z are correlated: coordinates T (x, y, z), which are not (`block.independent`).
    names (k,): of images, or control points. given, residual (measured minus modelled), sigma:
    (k, 3), m. turn (k, 3, 3): T. jacobian (3k, n): derivative of the modelled by the columns.
    image (k,): of antenna positions, -1 of control points.
    """

    names: np.ndarray
    given: np.ndarray
    residual: np.ndarray
    sigma: np.ndarray
    jacobian: csr_array
    image: np.ndarray
    turn: np.ndarray

    def along_axes(self, values: np.ndarray) -> np.ndarray:
        """Values (k, 3) of these coordinates as x, y, z."""
        return along_axes(self.turn, values)


@dataclass(frozen=True)
class ImageRows:
    """The image points that were measured, ordered by point: px.

    image, point (n,): positions; tie (n,): whether it is a tie point, not a mark; row (n,): in the
    file, marks after ties; xy (n, 2); sigma (n,), infinite where a row does not count.
    """

    image: np.ndarray
    point: np.ndarray
    tie: np.ndarray
    row: np.ndarray
    xy: np.ndarray
    sigma: np.ndarray

    @cached_property
    def multiplicity(self) -> np.ndarray:
        """In how many images the point of each row was measured (n,)."""
        return np.bincount(self.point)[self.point]


@dataclass(frozen=True)
class Points:
    """The points, in the order of the state. names (n,); mark (n,): whether it is no tie point."""

    names: np.ndarray
    mark: np.ndarray


@brief
@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The equations of a problem at a state. Raises Singular where they are solved and cannot be.

    gnss: whether the antenna positions count in matrix, right side and solutions with their stated
        weights. Their rows are there either way: their noise may be coloured.
    tested: effects that act on the antenna and have columns without being estimated.
    information: (q, q) of other measurements on what images share, on top of the problem's: the
        inverse of their covariance.
    held (k, 2): image and unknown of it that are held, where nothing else holds the whole block.
    """

    problem: Problem
    state: State
    loss: Loss = field(default_factory=Loss)
    gnss_counts: bool = True
    tested: tuple[Effect, ...] = ()
    information: np.ndarray | None = None
    held: np.ndarray | None = None
    threads: int = 1
    storage: str = "auto"

    @classmethod
    def in_place(
        cls, normal: Normal, state: State, threads: int, factor: Bordered | None = None
    ) -> LinearSystem:
        """The system whose equations, or their factor, `normal` holds, here and undamped."""
        system = cls(normal.problem, state, normal.loss, threads=threads)
        if factor is None:
            system._memory.put("equations", normal)
        else:
            system._memory.put("factor", factor)
        return system

    # --- other systems -----------------------------------------------------------------------

    def testing(self, effects: Iterable[Effect]) -> LinearSystem:
        """The system with columns for effects, without priors on them; the GNSS is kept apart.

        An effect that the problem estimates stands where it is, another one at zero.
        """
        effects = list(effects)
        away = tuple(effect for effect in effects if effect.place == "antenna")
        problem = with_effects(self.problem, effects)
        # Zero moves nothing; some effects ask for another start when they are adjusted.
        stacks = [problem.stack, *self._alone(away)]
        zero = {s: np.zeros_like(v) for stack in stacks for s, v in stack.start().items()}
        known = {s: v for s, v in self.state.effects.items() if s in zero or s == ENDS}
        state = replace(self.state, effects=zero | known)
        return replace(self, problem=problem, state=state, tested=away, gnss_counts=False)

    def measuring(
        self,
        xy: np.ndarray | None = None,
        sigma: np.ndarray | None = None,
        gnss: np.ndarray | None = None,
        control: np.ndarray | None = None,
        prior: np.ndarray | None = None,
        attitude: np.ndarray | None = None,
        distance: np.ndarray | None = None,
    ) -> LinearSystem:
        """The system of other measurements of the same things; None leaves them.

        Coordinates are those of the rows: of `gnss` and `control`, say. xy (n, 2), px, and sigma
        (n,), infinite where a row shall not count, as in `image_rows`; gnss (k, 3), control (c, 3),
        m; prior (q,): expected values of what images share; attitude (k, 3): rad, by which the
        measured are turned further, about level axes; distance (k, 1), m.
        """
        if attitude is not None:
            p = self.problem
            turn = np.einsum("nji,nj->ni", p.attitude_level, attitude)
            attitude = rotation_from_vector(-turn) @ p.attitude_given
        if gnss is not None:
            gnss = self.gnss.along_axes(gnss)
        if control is not None:
            control = self.control.along_axes(control)
        given = {
            "xy": xy,
            "weight": None if sigma is None else 1.0 / sigma,
            "gnss_given": gnss,
            "control_given": control,
            "prior_value": prior,
            "attitude_given": attitude,
            "distance_given": None if distance is None else distance[:, 0],
        }
        stated: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
        return replace(self, problem=replace(self.problem, **stated))

    def at(self, state: State) -> LinearSystem:
        """The same measurements at another state."""
        return replace(self, state=state)

    # --- names -------------------------------------------------------------------------------

    @cached_property
    def columns(self) -> Columns:
        """Names, values and priors of the unknowns."""
        p, state = self.problem, self.state
        m, d, q = p.image_count, p.d, p.shared_count
        shared, of_image = list(p.unknowns), {}
        parameters = {slug: member.parameters for slug, member in p.stack.members.items()}
        varied: dict[str, list[int]] = {}
        for slug, number in p.per_image_unknowns:
            varied.setdefault(slug, []).append(number)
        first = 6
        for slug, numbers in varied.items():
            parameters[slug] = [parameters[slug][number] for number in numbers]
            of_image[slug] = np.arange(m)[:, None] * d + first + np.arange(len(numbers))
            first += len(numbers)
        at, shared_rows = m * d + q, [m * d + np.arange(q)]
        for beside in self._beside:
            slug = beside.effect.slug
            parameters[slug] = beside.parameters
            mine = np.arange(at, at + beside.size)
            at += len(mine)
            if beside.effect.group == "image":
                of_image[slug] = mine.reshape(m, -1)
            else:
                shared += beside.shared
                shared_rows.append(mine)
        shared_at = np.concatenate(shared_rows)
        scale, value, weight = np.full(at, np.nan), np.zeros(at), np.zeros(at)
        tables = {CAMERA: state.interior, LEVER_ARM: state.arms}
        for number, unknown in zip(shared_at.tolist(), shared, strict=True):
            if unknown.kind == EFFECT:
                scale[number] = parameters[unknown.owner][unknown.at[1]].scale
            table = tables[unknown.kind] if unknown.kind in tables else state.effects[unknown.owner]
            value[number] = table[unknown.at]
        weight[shared_at[:q]] = p.prior_weight
        prior = np.concatenate([p.prior_value, np.zeros(len(shared) - q)])
        for slug, rows in of_image.items():
            scale[rows] = [parameter.scale for parameter in parameters[slug]]
            value[rows] = state.effects[slug][:, varied.get(slug, slice(None))]
        for number, held in enumerate(p.per_image_prior[1].T):
            weight[6 + number : m * d : d] = held
        pose = np.arange(m)[:, None] * d + np.arange(6)
        return Columns(
            p.images.names,
            pose,
            of_image,
            parameters,
            shared,
            shared_at,
            scale,
            value,
            weight,
            prior,
        )

    @property
    def effects(self) -> dict[str, Effect]:
        """The effects that are estimated, by slug."""
        p = self.problem
        return {slug: m.effect for slug, m in p.stack.members.items() if slug not in p.beside}

    @property
    def arms_free(self) -> bool:
        """Whether lever arms are estimated."""
        return self.problem.arms_free

    @property
    def values(self) -> Values:
        """Values of the effects that are estimated."""
        return self.problem.values(self.state)

    @property
    def block(self) -> Block:
        """What was measured."""
        return self.problem.block

    @property
    def images(self) -> Images:
        """The images in the order of the columns, at the state."""
        return self.problem.images.with_poses(self.state.centre, self.state.rotation)

    @property
    def free(self) -> dict[str, tuple[str, ...]]:
        """Interior parameters of each camera that are estimated."""
        return self.problem.free

    @property
    def image_order(self) -> np.ndarray:
        """Row of images.csv (m,) of each image."""
        return self.problem.order

    @property
    def points(self) -> Points:
        """The points that images show."""
        return Points(self.problem.point_names, self.problem.point_kinds)

    @property
    def roles(self) -> np.ndarray:
        """Role of each row of ground.csv: `control`, `check` or `unused`."""
        return self.problem.roles

    @property
    def control_rows(self) -> np.ndarray:
        """Rows (c,) of ground.csv that count as control."""
        return self.problem.control_rows

    @property
    def control_names(self) -> np.ndarray:
        """Names (c,) of the ground control that counts."""
        return self.block.ground["point"].to_numpy(dtype=object)[self.control_rows]

    @cached_property
    def image_rows(self) -> ImageRows:
        """What was measured in the images, in the order of `residuals`."""
        p = self.problem
        with np.errstate(divide="ignore"):
            sigma = np.broadcast_to(1.0 / p.weight, len(p.img))
        return ImageRows(p.img, p.point_of_ray, p.row < p.tie_count, p.row, p.xy, sigma)

    # --- residuals and rows ------------------------------------------------------------------

    def residuals(self) -> Residuals:
        """Measured minus modelled, effects that are only tested among the modelled."""
        normal = Normal(self.problem, self.loss, self.threads, self.storage)
        pixels, behind = normal.residuals(self.state)
        p, images = self.problem, self.images
        gnss, attitude = (
            residuals(kind, p, self.state, images) if len(p.measured(kind)) else np.zeros((0, 3))
            for kind in POSE_KINDS
        )
        if len(gnss):
            gnss = gnss - turned(p.gnss_turn, self._moved_beside())
        control = normal.view(self.state).control_residual
        control = turned(p.control_turn, control)[: len(p.control_rows)]
        return Residuals(pixels, gnss, control, attitude, behind)

    @cached_property
    def gnss(self) -> Rows:
        """The antenna positions."""
        rows = self._measured("gnss", [beside.jacobian for beside in self._beside])
        if not len(rows.image):
            return rows
        return replace(rows, residual=rows.residual - turned(rows.turn, self._moved_beside()))

    @cached_property
    def attitude(self) -> Rows:
        """The attitudes, rad, about level axes; given: zero, what `measuring` turns them by."""
        beside = [csr_array((3 * len(self.problem.attitude_image), b.size)) for b in self._beside]
        return self._measured("attitude", beside)

    @cached_property
    def distance(self) -> Rows:
        """The distances, one row each: given, residual, sigma (k, 1), m."""
        p, n = self.problem, len(self.columns)
        residual, by, columns = distance_rows(p, self.state)
        at = p.image_count * p.d + columns
        jacobian = _sparse(by[:, None], at, n)
        names = np.array(p.images.distance_names, dtype=object)[p.distance_rows]
        given, sigma = p.distance_given[:, None], p.distance_weight[:, None] ** -0.5
        image, turn = np.full(len(at), -1), np.ones((len(at), 1, 1))
        return Rows(names, given, residual[:, None], sigma, jacobian, image, turn)

    @cached_property
    def posed(self) -> Rows:
        """The attitudes, and behind them two rows a pair of a rig: place, m, and turn, rad."""
        p, rows = self.problem, self.attitude
        k = len(p.rig_image)
        if not k:
            return rows
        found = rig_rows(p, self.state)
        names = p.images.names[np.repeat(p.rig_image[:, 1], 2)]
        residual = found.residual.reshape(-1, 3)
        sigma = np.tile(found.weight.reshape(2, 3) ** -0.5, (k, 1))
        return Rows(
            np.concatenate([rows.names, names]),
            np.zeros((len(rows.given) + 2 * k, 3)),
            np.concatenate([rows.residual, residual]),
            np.concatenate([rows.sigma, sigma]),
            csr_array(vstack([rows.jacobian, self._of_pairs(found, len(self.columns))])),
            np.concatenate([rows.image, np.repeat(p.rig_image[:, 1], 2)]),
            np.concatenate([rows.turn, np.tile(np.eye(3), (2 * k, 1, 1))]),
        )

    def _measured(self, kind: str, beside: list[csr_array]) -> Rows:
        """Rows of a kind of measured poses; beside: their derivatives by tested effects."""
        p = self.problem
        image, sigma = p.measured(kind), p.weight_of(kind) ** -0.5
        m, d, k = p.image_count, p.d, len(image)
        names, given, turn = p.images.names[image], np.zeros((k, 3)), np.tile(np.eye(3), (k, 1, 1))
        if kind == "gnss":
            turn = p.gnss_turn
            given = turned(turn, p.gnss_given)
        if not k:
            empty = csr_array((0, len(self.columns)))
            return Rows(names, given, np.zeros((0, 3)), sigma, empty, image, turn)
        found = pose_rows(kind, p, self.state, self.images)
        poses = _sparse(found.own, image[:, None] * d + np.arange(d), m * d)
        parts = [poses, csr_array(found.shared.reshape(3 * k, -1)), *beside]
        jacobian = csr_array(block_array([parts]))
        jacobian.eliminate_zeros()
        return Rows(names, given, found.residual, sigma, jacobian, image, turn)

    @cached_property
    def control(self) -> Rows:
        """The ground control, and behind it the ends of distances, which are tied to their points.

        The columns move it by effects of the ground; its points are gone.
        """
        p = self.problem
        view = Normal(p, self.loss).view(self.state)
        c = len(p.control_given)
        row, slot = np.nonzero(p.ground_column[:c] >= 0)
        column = p.image_count * p.d + p.ground_column[row, slot]
        turn = p.control_turn
        value = turned(turn[row], view.d_ground[row, :, slot]).ravel()
        at = (3 * row[:, None] + np.arange(3)).ravel()
        jacobian = csr_array((value, (at, np.repeat(column, 3))), shape=(3 * c, len(self.columns)))
        sigma = p.control_weight**-0.5
        given, residual = turned(turn, p.control_given), turned(turn, view.control_residual)
        names = np.array([*self.control_names, *p.end_names], dtype=object)
        return Rows(names, given, residual, sigma, jacobian, np.full(c, -1), turn)

    def _alone(self, effects: Iterable[Effect]) -> list[Stack]:
        """Effects of no ground point, each by itself."""
        return [Stack(self.block, [one], images=self.problem.stack.images) for one in effects]

    @cached_property
    def _beside(self) -> list[_Beside]:
        """Columns of the tested effects of the antenna."""
        context = Context(self.images, self.problem.gnss_image)
        out = []
        for stack in self._alone(self.tested):
            (member,) = stack.members.values()
            effect, (groups, count) = member.effect, member.shape
            _, derivative = stack.evaluate(
                "antenna", context, {effect.slug: np.zeros(member.shape)}
            )
            derivative = self.problem.gnss_turn @ derivative
            moved, _ = stack.evaluate("antenna", context, self.state.effects)
            group = context.group(effect.group)
            column = group[:, None] * count + np.arange(count)
            jacobian = _sparse(derivative, column, groups * count)
            shared: list[Unknown] = []
            if effect.group != "image":
                # Flights without a position have nothing to be tested with.
                seen = np.flatnonzero(np.bincount(group, minlength=groups))
                jacobian = jacobian[:, (seen[:, None] * count + np.arange(count)).ravel()]
                shared = [
                    Unknown(EFFECT, effect.slug, q.name, member.groups[g], q.unit, (g, number))
                    for g in seen.tolist()
                    for number, q in enumerate(member.parameters)
                ]
            out.append(_Beside(effect, member.parameters, jacobian, shared, moved))
        return out

    def _moved_beside(self) -> np.ndarray:
        nothing = np.zeros((len(self.problem.gnss_image), 3))
        return sum((beside.moved for beside in self._beside), nothing)

    # --- the equations -----------------------------------------------------------------------

    @cached_property
    def _memory(self) -> InPlace:
        """The equations, and in their place their factor: hundreds of megabytes."""
        return InPlace(equations=lambda _: self._assembled(), factor=self._factorised)

    @property
    def _normal(self) -> Normal:
        return self._memory.get("equations")

    def _assembled(self) -> Normal:
        p = self.problem
        if not self.gnss_counts:
            p = replace(p, **vars(NO_GNSS))
        normal = Normal(p, self.loss, self.threads, self.storage)
        if self.held is not None:
            normal.held = self.held
        normal.assemble(self.state, 0.0)
        if self.information is not None:
            normal.shared_block += np.tril(self.information)
            normal.shared_reference += np.diag(self.information)
        return normal

    @property
    def _of_problem(self) -> int:
        """Columns that the kernels know; those of tested effects of the antenna come behind."""
        return self.problem.image_count * self.problem.d + self.problem.shared_count

    @cached_property
    def right(self) -> np.ndarray:
        """t (n,): half the downward gradient of the cost."""
        out = np.zeros(len(self.columns))
        known = self.exposures.at_bases(self._of_exposures(self._normal.gradient))
        out[: self._of_problem] = np.concatenate([known, self._normal.shared_gradient])
        return out

    @cached_property
    def exposures(self) -> Exposures:
        """Whose unknowns the equations are made and solved for."""
        return Exposures(self.problem, self.state.rotation)

    def _of_exposures(self, rows: np.ndarray) -> np.ndarray:
        """Rows of `Normal` (n, ...), an unknown each, without what pieces kept apart."""
        rows = rows[: self.exposures.count]
        return rows.reshape(-1, *rows.shape[2:])

    @cached_property
    def _hanging(self) -> csc_array:
        """What keeps images of one exposure together in N (m d, m d)."""
        p = self.problem
        k, n = len(p.rig_image), p.image_count * p.d
        found = rig_rows(p, self.state)
        rows = self._of_pairs(found, n)
        heavy = rows * np.tile(found.weight, k)[:, None]
        return csc_array(heavy.T @ rows)

    def _of_pairs(self, found: RigRows, n: int) -> csr_array:
        """Derivatives (6 k, n) of the pairs of rigs by the first n columns."""
        at = self.columns.pose[self.problem.rig_image]
        return _sparse(found.first, at[:, 0], n) + _sparse(found.second, at[:, 1], n)

    @cached_property
    def right_of_priors(self) -> np.ndarray:
        """The part (n,) of t that comes from priors."""
        p, out = self.problem, np.zeros(len(self.columns))
        shared, own = Normal(p, self.loss, storage=self.storage).from_priors(self.state)
        out[self.columns.pose[:, :1] + np.arange(6, p.d)] = p.per_image_prior[1] * own
        out[p.image_count * p.d : self._of_problem] = p.prior_weight * shared
        return out

    @cached_property
    def matrix(self) -> csc_array:
        """N (n, n), symmetric."""
        cross, shared = csc_array(self._cross), csc_array(self.shared_matrix)
        beside = len(self.columns) - self._of_problem
        blocks = [
            [self._image_part, cross, None],
            [cross.T, shared, None],
            [None, None, csc_array((beside, beside))],
        ]
        return csc_array(block_array(blocks))

    @property
    def _image_part(self) -> csc_array:
        """N (m d, m d) of images."""
        made = self._normal.blocks.symmetric()
        if not self.exposures.rigs:
            return made
        return csc_array(self.exposures.first @ made @ self.exposures.first.T + self._hanging)

    def _of_images(self, first: np.ndarray, second: np.ndarray) -> csc_array:
        """N (m k, m l) of some numbers of every image's unknowns, first (k,) and second (l,)."""
        if not self.exposures.rigs:
            return self._normal.blocks.of_images(first, second)
        at = np.arange(self.problem.image_count)[:, None] * self.problem.d
        return self._image_part[(at + first).ravel()][:, (at + second).ravel()]

    def of_images(self, one: np.ndarray, other: np.ndarray) -> csc_array:
        """N (m k, m l) of unknowns that images have for themselves, one (m, k) and other (m, l)."""
        first, second = (own[0][own[0] < self.problem.d] for own in (one, other))
        if (first.size, second.size) == (one.shape[1], other.shape[1]):
            return self._of_images(first, second)
        # Tested effects of the antenna have columns behind all others, and no part in N.
        out = csc_array((one.size, other.size))
        if first.size and second.size:
            part = coo_array(self._of_images(first, second))
            place = []
            for own, at in ((one, part.row), (other, part.col)):
                inside = np.flatnonzero(own[0] < self.problem.d)
                image, number = np.divmod(at, len(inside))
                place.append(image * own.shape[1] + inside[number])
            out = csc_array((part.data, tuple(place)), shape=out.shape)
        return out

    def with_shared(self, rows: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """N (k, l) of any unknowns (k,) with some (l,) of those that images share."""
        out = np.zeros((len(rows), len(shared)))
        begin, end = self._of_problem - self.problem.shared_count, self._of_problem
        known = np.flatnonzero(shared < end)
        at = shared[known] - begin
        own, beside = np.flatnonzero(rows < begin), np.flatnonzero((rows >= begin) & (rows < end))
        out[np.ix_(own, known)] = self._cross[np.ix_(rows[own], at)]
        out[np.ix_(beside, known)] = self.shared_matrix[np.ix_(rows[beside] - begin, at)]
        return out

    def let_go(self) -> None:
        """Forget N, which is made anew where it is asked for: it grows to hundreds of megabytes.

        The right side and the diagonal before the points were eliminated stay.
        """
        self.right, self.reference  # noqa: B018, small, and gone with the matrix
        self.__dict__.pop("matrix", None)
        self._memory.forget("equations")

    @property
    def _cross(self) -> np.ndarray:
        cross = self._of_exposures(self._normal.cross)[:, : self.problem.shared_count]
        return self.exposures.at_bases(cross)

    @cached_property
    def reference(self) -> np.ndarray:
        """Diagonal (n,) of N before the points were eliminated: what is not rounding beside it."""
        own = self.exposures.at_bases(self._of_exposures(self._normal.reference))
        if self.exposures.rigs:
            own = own + self._hanging.diagonal()
        return np.concatenate([own, self._normal.shared_reference])

    @cached_property
    def _substitution(self) -> Normal:
        """The kernels at this state, for the points alone."""
        normal = Normal(self.problem, self.loss, self.threads, self.storage)
        normal.stand_at(self.state)
        return normal

    @property
    def shared_matrix(self) -> np.ndarray:
        """N (q, q) of what images share."""
        shared = self._normal.shared_block
        return shared + np.tril(shared, -1).T

    def multiply(self, x: np.ndarray) -> np.ndarray:
        """N x for x (n, k), without N as a whole."""
        n = self._of_problem - self.problem.shared_count
        image, shared, cross = x[:n], x[n : self._of_problem], self._cross
        out = np.zeros_like(x)
        exposures = self.exposures
        made = self._normal.blocks.multiply(exposures.of_bases(image))
        out[:n] = exposures.at_bases(made) + cross @ shared
        if exposures.rigs:
            out[:n] += self._hanging @ image
        out[n : self._of_problem] = cross.T @ image + self.shared_matrix @ shared
        return out

    @cached_property
    def motions(self) -> np.ndarray:
        """Change (n, 7) of the columns when the whole block moves, turns and grows."""
        p = self.problem
        out = np.zeros((len(self.columns), 7))
        out[: p.image_count * p.d] = motions(self.state, p.d)
        if p.end_names:
            ends = p.end_start - self.state.effects[ENDS]
            moved = helmert_motions(ends, self.state.centre.mean(axis=0))
            last = self._of_problem
            out[last - 3 * len(ends) : last] = -moved.reshape(-1, 7)
        return out

    # --- solutions ---------------------------------------------------------------------------

    def _factorised(self, normal: Normal) -> Bordered:
        self._memory.put("equations", normal)
        self.right, self.reference  # noqa: B018, small, and gone with the matrix
        # Where there is no factor, what was to become it is spoilt.
        self._memory.forget()
        with one_thread():
            return normal.factor()

    @property
    def factor(self) -> Bordered:
        """N factorised. Raises Singular."""
        return self._memory.get("factor")

    def take_factor(self) -> Bordered:
        """The factor, for whoever makes something in its place."""
        return self._memory.take("factor")

    def solve(self, right: np.ndarray) -> np.ndarray:
        """N^-1 right for right (n, k). Raises Singular."""
        n = self.problem.image_count * self.problem.d
        with one_thread():
            found, shared = self.factor.solve(self.exposures.sums(right[:n]), right[n:])
        return np.concatenate([self.exposures.images(found), shared])

    def minimised(self, max_iterations: int, tolerance: float, near: bool) -> LinearSystem:
        """The system at the state of least cost; arguments as of `solve`."""
        normal = Normal(replace(self.problem, start=self.state), self.loss, self.threads)
        if self.held is not None:
            normal.held = self.held
        return self.at(solve(normal, max_iterations, tolerance, near=near).state)

    def step(self) -> State:
        """The state one step of Gauss and Newton away.

        Exact where the measurements miss the state by what is linear. Raises Singular.
        """
        return self.following(self.solve(self.right[:, None])[:, 0])

    def following(self, change: np.ndarray) -> State:
        """The state after a change (n,) of the columns, each point where it then fits best."""
        p = self.problem
        poses, shared = np.split(change[: self._of_problem], [p.image_count * p.d])
        poses = poses.reshape(-1, p.d)
        points, *_ = self._substitution.substitute(self.state, 0.0, poses, shared)
        return moved_state(p, self.state, poses, shared, points)


@dataclass(frozen=True)
class _Beside:
    """A tested effect of the antenna: derivative (3k, columns), names, what it moves (k, 3) m."""

    effect: Effect
    parameters: list[Parameter]
    jacobian: csr_array
    shared: list[Unknown]
    moved: np.ndarray

    @property
    def size(self) -> int:
        """How many columns."""
        return self.jacobian.shape[1]


def _sparse(values: np.ndarray, column: np.ndarray, size: int) -> csr_array:
    """Rows (k r, size) of values (k, r, c), each of the k in its own columns (k, c)."""
    k, r, _ = values.shape
    row = np.broadcast_to(np.arange(k * r).reshape(k, r, 1), values.shape)
    at = row.ravel(), np.broadcast_to(column[:, None], values.shape).ravel()
    return csr_array((values.ravel(), at), shape=(k * r, size))


def motions(state: State, d: int, middle: np.ndarray | None = None) -> np.ndarray:
    """Change (images * d, 7) of the poses when the block as a whole moves, turns, grows about a
    middle, that of the centres by default."""
    m = len(state.centre)
    out = np.zeros((m, d, 7))
    out[:, :3] = helmert_motions(state.centre, middle)
    out[:, 3:6, 3:6] = -state.rotation
    return out.reshape(m * d, 7)
