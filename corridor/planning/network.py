"""What the images and the GNSS of a plan determine, with no ground control: solved once.

The normal equations stand at the truth and are factorised once. Everything a planner asks of them
is linear: with x the poses and what images share, and z = T x + own the quantities of interest,

    S = T N^-1 T' + V^-1          covariance of z
    B = T N^-1 J' W               what an error of each GNSS coordinate does to z

V^-1 is a ground point's covariance at given poses, J the GNSS rows, W their weights.
Source: Triggs et al. 2000, section 6 (elimination of points).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import pandas as pd
from scipy.sparse import csr_array, hstack

from corridor.adjustment import Covariance, Loss, Normal, Singular, make_problem
from corridor.block import Block
from corridor.camera import interior_derivatives, project_rays
from corridor.effects import Effect, Images, find
from corridor.errors import InputError
from corridor.planning.surveyed import Surveyed, marks_of, on_the_ground, seen_by
from corridor.simulation import Plan, perfect_block

# Every surveyed point is known to so many metres. It changes no result that is worth having, and
# lets a network without a datum be factorised, to be laid on its control later: looser, and the
# difference drowns in rounding; tighter, and half a metre would no longer be told from nothing.
LOOSE_M = 10.0
# A value that is held, against its own standard deviation.
_HELD = 1e-4


@dataclass(frozen=True)
class Carried:
    """Camera and lever arms of another flight set, as its adjustment leaves them.

    labels (k,): `camera.NAME.f`, `lever_arm.FLIGHT.z` of the flight that takes them over.
    assumed (k, k): covariance that the other adjustment states; error (k, k): second moments of
    the true errors without those of a constant GNSS bias; transfer (k, 3): by a constant bias
    common to both flight sets, per metre of it.
    held: the values are held fixed (and their errors with them) instead of being estimated anew
    with their covariance as prior.
    """

    labels: tuple[str, ...]
    assumed: np.ndarray
    error: np.ndarray
    transfer: np.ndarray
    held: bool = False

    def for_flights(self, names: Iterable[str]) -> Carried:
        """Without the lever arms of other flights than these."""
        flights = set(names)
        kept = [
            n
            for n, label in enumerate(self.labels)
            if not label.startswith("lever_arm.") or label[10:-2] in flights
        ]
        at = np.ix_(kept, kept)
        return replace(
            self,
            labels=tuple(self.labels[n] for n in kept),
            assumed=self.assumed[at],
            error=self.error[at],
            transfer=self.transfer[kept],
        )


@dataclass
class Quantities:
    """Quantities of interest: three rows a ground point, or one a shared unknown.

    rows: T (r, n + q). own (r, r): covariance at given poses, m^2. solved: N^-1 T' (n + q, r).
    """

    rows: csr_array
    own: np.ndarray
    solved: np.ndarray


class Network:
    """The normal equations of a plan without control, factorised at the truth.

    camera, lever_arm, effects: as of `corridor.adjust`; effects act on the antenna.
    priors: standard deviation by name. Raises InputError for what cannot be planned.
    """

    def __init__(
        self,
        plan: Plan,
        surveyed: Surveyed,
        camera: str | Mapping[str, str] | None = None,
        lever_arm: str = "free",
        effects: Iterable[str | Effect] = (),
        priors: Mapping[str, float] | None = None,
        carried: Carried | None = None,
        seed: int = 0,
    ):
        self.plan, self.seed = plan, seed
        chosen = [effect if isinstance(effect, Effect) else find(effect) for effect in effects]
        for effect in chosen:
            if effect.place != "antenna":
                raise InputError(
                    f"effect {effect.slug} acts on {effect.place}: the planner estimates those of "
                    "the antenna; adjust simulated blocks for the others"
                )
        self.block, self.surveyed, self.unseen = _block_of(plan, surveyed, seed)
        self.problem = make_problem(
            _loosely_known(self.block),
            camera=camera,
            effects=chosen,
            control=list(self.surveyed.names),
            priors={name: (0.0, sigma) for name, sigma in (priors or {}).items()},
            lever_arm=lever_arm if plan.gnss else None,
        )
        self.state = self.problem.start
        p = self.problem
        self.labels = [unknown.label for unknown in p.unknowns]
        self.carried, self.carried_columns = carried, self._columns_of(carried)
        information = None
        if carried is not None:
            self.assumed = carried.assumed
            if carried.held:
                self.assumed = np.diag(_HELD**2 * np.diag(carried.assumed))
            information = np.zeros((p.shared_count, p.shared_count))
            at = np.ix_(self.carried_columns, self.carried_columns)
            self.weight = information[at] = np.linalg.inv(self.assumed)
        self.normal = Normal(p, Loss())
        try:
            self.covariance = Covariance(self.normal, self.state, information=information)
        except Singular as singular:
            raise self._explain(singular) from None
        self._gnss, self.biases = self._gnss_rows()

    @property
    def shared(self) -> Quantities:
        """The unknowns that images share, in the order of `labels`."""
        p = self.problem
        n, q = p.image_count * p.d, p.shared_count
        rows = csr_array((np.ones(q), (np.arange(q), n + np.arange(q))), shape=(q, n + q))
        return self._solved(rows, np.zeros((q, q)))

    def points(self, names: Sequence[str], xyz: np.ndarray) -> Quantities:
        """Ground points (k, 3), m, as their marks in the images and the poses give them.

        Exact for the points of the block. Others are intersected from their marks, which help
        the poses no further: with hundreds of tie points an image nobody can tell.
        Raises InputError for a point that fewer than two images show.
        """
        p = self.problem
        count, n = len(xyz), p.image_count * p.d
        seen = seen_by(p.images, xyz, self.plan.tie_points.border_px)
        weight = self.block.sigma["mark_px"] ** -2.0
        entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        own = np.zeros((3 * count, 3 * count))
        for k, (point, rows) in enumerate(zip(xyz, seen, strict=True)):
            if len(rows) < 2:
                raise InputError(
                    f"point {names[k]} is seen in {len(rows)} image{'s' * (len(rows) != 1)}, "
                    "2 are needed: place it where the flights look"
                )
            by_point, by_pose, by_shared = self._mark_rows(point, rows)
            inverse = np.linalg.inv(weight * np.einsum("mki,mkj->ij", by_point, by_point))
            own[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = inverse
            gain = -weight * np.einsum("ij,mkj->imk", inverse, by_point)
            pose = np.einsum("imk,mkc->imc", gain, by_pose).reshape(3, -1)
            shared = np.einsum("imk,mks->is", gain, by_shared)
            column = np.concatenate(
                [(rows[:, None] * p.d + np.arange(6)).ravel(), n + np.arange(p.shared_count)]
            )
            value = np.concatenate([pose, shared], axis=1)
            row = np.repeat(np.arange(3 * k, 3 * k + 3), len(column))
            entries.append((value.ravel(), row, np.tile(column, 3)))
        value, row, column = (np.concatenate(part) for part in zip(*entries, strict=True))
        return self._solved(csr_array((value, (row, column)), (3 * count, n + p.shared_count)), own)

    def place(self, station, across) -> np.ndarray:
        """Positions (n, 3), m, on the plan's ground."""
        return on_the_ground(self.plan, self.seed, station, across)

    def gnss_response(self, z: Quantities) -> np.ndarray:
        """B (r, k, 3): what an error of each GNSS coordinate does to the quantities."""
        k = len(self.problem.gnss_image)
        return (self._gnss @ z.solved).T.reshape(z.solved.shape[1], k, 3)

    def carried_response(self, z: Quantities) -> np.ndarray:
        """A (r, k): what an error of each carried-over value does to the quantities."""
        if self.carried is None:
            return np.zeros((z.solved.shape[1], 0))
        n = self.problem.image_count * self.problem.d
        return z.solved[n + self.carried_columns].T @ self.weight

    def heights_with(self, z: Quantities) -> np.ndarray:
        """Covariances (m, r) of the camera heights with the quantities, m times their unit."""
        n, d = self.problem.image_count * self.problem.d, self.problem.d
        return z.solved[2:n:d]

    @property
    def held(self) -> np.ndarray:
        """Columns of shared unknowns that are carried over and held."""
        held = self.carried is not None and self.carried.held
        return self.carried_columns if held else self.carried_columns[:0]

    @property
    def flight(self) -> np.ndarray:
        """Flight (m,) of each image, in the order of the problem."""
        return self.problem.images.flight

    # ------------------------------------------------------------------------------------------

    def _solved(self, rows: csr_array, own: np.ndarray) -> Quantities:
        n = self.problem.image_count * self.problem.d
        right = rows.toarray().T
        poses, shared = self.covariance.solve(right[:n], right[n:])
        return Quantities(rows, own, np.concatenate([poses, shared]))

    def _mark_rows(self, point: np.ndarray, rows: np.ndarray):
        """Derivatives of a point's marks (m, 2, ...): by the point, the pose, what is shared."""
        p = self.problem
        rotation = self.state.rotation[rows]
        seen = np.einsum("nij,nj->ni", rotation, point - self.state.centre[rows])
        ray = seen[:, :2] / seen[:, 2:]
        interior = self.state.interior[p.images.camera]
        by_ray = np.empty((len(rows), 2, 2))
        h = 1e-5  # of a ray: truncation and rounding stay below 1e-9
        for k in range(2):
            step = h * np.eye(2)[k]
            ahead, behind = (project_rays(ray + s * step, interior, rows) for s in (1, -1))
            by_ray[:, :, k] = (ahead - behind) / (2 * h)
        by_seen = np.zeros((len(rows), 2, 3))
        by_seen[:, 0, 0] = by_seen[:, 1, 1] = 1.0
        by_seen[:, :, 2] = -ray
        by_seen = by_ray @ by_seen / seen[:, 2, None, None]
        by_point = by_seen @ rotation
        turn = np.zeros((len(rows), 3, 3))
        x, y, z = seen.T
        turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = z, -y, x
        turn -= turn.transpose(0, 2, 1)
        by_pose = np.concatenate([-by_point, by_seen @ turn], axis=2)
        by_shared = np.zeros((len(rows), 2, p.shared_count))
        for camera in np.unique(p.images.camera[rows]):
            mine = np.flatnonzero(p.images.camera[rows] == camera)
            column = p.camera_column[rows[mine[0]]]
            free = np.flatnonzero(column >= 0)
            change = interior_derivatives(ray[mine], self.state.interior[camera])
            by_shared[np.ix_(mine, [0, 1], column[free])] = change[:, :, free]
        return by_point, by_pose, by_shared

    def _gnss_rows(self) -> tuple[csr_array, dict[int, tuple[int, np.ndarray]]]:
        """W J (3 k, n + q); and the shared unknowns that move whole flights alike.

        Those are biases of the GNSS, whatever they are called: column -> axis, flights.
        """
        p = self.problem
        n, k = p.image_count * p.d, len(p.gnss_image)
        if not k:
            return csr_array((0, n + p.shared_count)), {}
        view = self.normal.view(self.state)
        _, own, shared = self.normal.antenna_rows(self.state, view.images)
        biases = {}
        for column, unknown in enumerate(p.unknowns):
            step = shared[:, :, column]
            moved = step.any(axis=1)
            axis = int(np.argmax(np.abs(step[moved][0]))) if moved.any() else 0
            if unknown.kind == "effect" and np.array_equal(step, moved[:, None] * np.eye(3)[axis]):
                biases[column] = axis, np.unique(p.images.flight[p.gnss_image[moved]])
        own, shared = own * p.gnss_weight[:, :, None], shared * p.gnss_weight[:, :, None]
        column = np.broadcast_to((p.gnss_image[:, None] * p.d + np.arange(p.d))[:, None], own.shape)
        row = np.broadcast_to(np.arange(3 * k).reshape(k, 3, 1), own.shape)
        poses = csr_array((own.ravel(), (row.ravel(), column.ravel())), shape=(3 * k, n))
        return csr_array(hstack([poses, csr_array(shared.reshape(3 * k, -1))])), biases

    def _columns_of(self, carried: Carried | None) -> np.ndarray:
        if carried is None:
            return np.zeros(0, dtype=np.int64)
        lost = [label for label in carried.labels if label not in self.labels]
        if lost:
            raise InputError(
                f"{', '.join(lost[:5])} cannot be carried over: it is not estimated here, where "
                f"{', '.join(self.labels) or 'poses and points only'} are"
            )
        return np.array([self.labels.index(label) for label in carried.labels])

    def _explain(self, singular: Singular) -> InputError:
        if singular.shared is not None:
            return InputError(
                f"{self.labels[singular.shared]} cannot be determined by flight set "
                f"{self.plan.name}: hold it, give it a prior, or fly otherwise"
            )
        image = self.problem.images.names[singular.image]
        return InputError(
            f"the pose of image {image} of flight set {self.plan.name} cannot be determined: "
            "more tie points or more overlap are needed"
        )


def _block_of(plan: Plan, surveyed: Surveyed, seed: int) -> tuple[Block, Surveyed, list[str]]:
    """The perfect block with the surveyed points measured in it; names of those not seen twice."""
    bare = replace(plan, ground=replace(plan.ground, control=0, check=0, every_m=None,
                                        check_from_ties=0))  # fmt: skip
    block = perfect_block(bare, seed)
    stated = {key: value for key, value in asdict(plan.noise).items() if key in _SIGMAS}
    block.sigma |= {
        key: np.broadcast_to(np.asarray(value, float), 3).copy() if key.endswith("_m") else value
        for key, value in stated.items()
        if np.all(np.asarray(value) > 0)
    }
    images = Images.of(block)
    xyz = surveyed.place(plan, seed)
    seen = seen_by(images, xyz, plan.tie_points.border_px)
    twice = np.array([len(rows) >= 2 for rows in seen])
    if not (twice & surveyed.check).any():
        raise InputError(
            f"flight set {plan.name} shows no check point twice: plan the check points where it "
            "flies, or fly longer"
        )
    kept = np.flatnonzero(twice)
    shown = Surveyed(
        tuple(surveyed.names[k] for k in kept),
        surveyed.station[kept],
        surveyed.across[kept],
        surveyed.check[kept],
    )
    block = replace(
        block,
        marks=marks_of(images, shown.names, xyz[kept], [seen[k] for k in kept]),
        ground=pd.DataFrame(
            {
                "point": shown.names,
                **dict(zip("xyz", xyz[kept].T, strict=True)),
                "role": np.where(shown.check, "check", "control"),
            }
        ),
    )
    return block, shown, [surveyed.names[k] for k in np.flatnonzero(~twice)]


_SIGMAS = ("tie_px", "mark_px", "gnss_m", "control_m")


def _loosely_known(block: Block) -> Block:
    loose = dict.fromkeys(("sx", "sy", "sz"), LOOSE_M)
    return replace(block, ground=block.ground.assign(**loose))
