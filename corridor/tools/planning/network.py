"""What the images and the GNSS of a plan determine, with no ground control: solved once.

The normal equations stand at the truth and are factorised once. Everything a planner asks of them
is linear: with x the poses and what images share, and z = T x + own the quantities of interest,

    S = T N^-1 T' + V^-1          covariance of z
    B = T N^-1 J' W               what an error of each GNSS coordinate does to z

V^-1 is a ground point's covariance at given poses, J the GNSS rows, W their weights.
Source: Triggs et al. 2000, section 6 (elimination of points).
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.linalg import block_diag
from scipy.sparse import csr_array, vstack

from corridor.core.adjustment import Covariance, LinearSystem, Model, Singular, make_problem
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.camera import projection_derivatives
from corridor.core.errors import InputError
from corridor.core.simulation import Plan, marks_on, on_the_ground, perfect_block
from corridor.tools.planning.surveyed import Surveyed

# Every surveyed point is known to so many metres. It changes no result that is worth having, and
# lets a network without a datum be factorised, to be laid on its control later: looser, and the
# difference drowns in rounding; tighter, and half a metre would no longer be told from nothing.
LOOSE_M = 10.0
# A camera that looks further than this from straight down makes a flight oblique.
OBLIQUE_DEG = 5.0
# A value that is held, against its own standard deviation.
_HELD = 1e-4


@brief
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

    def for_flights(self, names: Iterable[str]) -> "Carried":
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

    model: what is estimated; its effects act on the antenna, its control is left aside.
    Raises InputError for what cannot be planned.
    """

    def __init__(
        self,
        plan: Plan,
        surveyed: Surveyed,
        model: Model,
        carried: Carried | None = None,
        seed: int = 0,
    ):
        self.plan, self.seed = plan, seed
        for effect in model.effects:
            if effect.place not in ("antenna", "attitude"):
                raise InputError(
                    f"effect {effect.slug} acts on {effect.place}: the planner estimates those of "
                    "the antenna and of attitudes; adjust simulated blocks for the others"
                )
        self.block, self.surveyed, self.unseen = _block_of(plan, surveyed, seed)
        model = replace(model, control=self.surveyed.names, check=None)
        loose = self.block.ground.assign(sx=LOOSE_M, sy=LOOSE_M, sz=LOOSE_M)
        problem = make_problem(replace(self.block, ground=loose), model)
        system = LinearSystem(problem, problem.start)
        self.columns, self.images, self.gnss = system.columns, system.images, system.gnss
        self.unknowns = self.columns.shared
        self.labels = [unknown.label for unknown in self.unknowns]
        self.carried, self.carried_columns = carried, self._columns_of(carried)
        information = None
        if carried is not None:
            self.assumed = carried.assumed
            if carried.held:
                self.assumed = np.diag(_HELD**2 * np.diag(carried.assumed))
            information = np.zeros((len(self.labels),) * 2)
            at = np.ix_(self.carried_columns, self.carried_columns)
            self.weight = information[at] = np.linalg.inv(self.assumed)
        try:
            self.covariance = Covariance(replace(system, information=information))
        except Singular as singular:
            raise self._explain(singular) from None

    @property
    def shared(self) -> Quantities:
        """The unknowns that images share, in the order of `labels`."""
        at, q = self.columns.shared_at, len(self.labels)
        rows = csr_array((np.ones(q), (np.arange(q), at)), shape=(q, len(self.columns)))
        return self._solved(rows, np.zeros((q, q)))

    def points(self, names: Sequence[str], xyz: np.ndarray) -> Quantities:
        """Ground points (k, 3), m, as their marks in the images and the poses give them.

        Exact for the points of the block. Others are intersected from their marks, which help
        the poses no further: with hundreds of tie points an image nobody can tell.
        Raises InputError for a point that fewer than two images show.
        """
        marks = marks_on(self.plan, self.seed, names, xyz)
        weight = self.block.sigma["mark_px"] ** -2.0
        rows, own = [], []
        for name, point in zip(names, xyz, strict=True):
            shown = marks.loc[marks["point"] == name, "image"]
            images = np.flatnonzero(np.isin(self.images.names, list(shown)))
            if len(images) < 2:
                raise InputError(
                    f"point {name} is seen in {len(images)} image{'s' * (len(images) != 1)}, "
                    "2 are needed: place it where the flights look"
                )
            by_point, by_columns = self._mark_rows(point, images)
            own.append(np.linalg.inv(weight * by_point.T @ by_point))
            rows.append(csr_array(-weight * own[-1] @ by_point.T) @ by_columns)
        return self._solved(csr_array(vstack(rows)), block_diag(*own))

    def place(self, station, across) -> np.ndarray:
        """Positions (n, 3), m, on the plan's ground."""
        return on_the_ground(self.plan, self.seed, station, across)

    def gnss_response(self, z: Quantities) -> np.ndarray:
        """B (r, k, 3): what an error of each GNSS coordinate does to the quantities."""
        moved = self.gnss.jacobian @ z.solved / self.gnss.sigma.reshape(-1, 1) ** 2
        return moved.T.reshape(z.solved.shape[1], len(self.gnss.names), 3)

    def carried_response(self, z: Quantities) -> np.ndarray:
        """A (r, k): what an error of each carried-over value does to the quantities."""
        if self.carried is None:
            return np.zeros((z.solved.shape[1], 0))
        return z.solved[self.columns.shared_at[self.carried_columns]].T @ self.weight

    def heights_with(self, z: Quantities) -> np.ndarray:
        """Covariances (m, r) of the camera heights with the quantities, m times their unit."""
        return z.solved[self.columns.pose[:, 2]]

    @cached_property
    def heights(self) -> np.ndarray:
        """Variance (m,) of the camera heights without control, m^2."""
        return self.covariance.each_pose[:, 2, 2]

    @property
    def held(self) -> np.ndarray:
        """Columns of shared unknowns that are carried over and held."""
        held = self.carried is not None and self.carried.held
        return self.carried_columns if held else self.carried_columns[:0]

    @property
    def arms_free(self) -> bool:
        """Whether lever arms are estimated."""
        return any(unknown.kind == "lever_arm" for unknown in self.unknowns)

    @property
    def gnss_flight(self) -> np.ndarray:
        """Flight (k,) of each antenna position."""
        return self.images.flight[self.gnss.image]

    @property
    def prior_weight(self) -> np.ndarray:
        """Weight (q,) of the priors on what images share; 0 without."""
        return self.columns.prior_weight[self.columns.shared_at]

    @property
    def views(self) -> dict[str, str]:
        """`nadir` or `oblique` for each flight."""
        return {
            f.name: "oblique" if f.tilt_deg > OBLIQUE_DEG else "nadir" for f in self.plan.flights
        }

    @cached_property
    def biases(self) -> dict[int, tuple[int, np.ndarray]]:
        """The shared unknowns that move whole flights alike: column -> axis, flights.

        Those are biases of the GNSS, whatever they are called.
        """
        moved_by = self.gnss.jacobian[:, self.columns.shared_at].toarray()
        found = {}
        for column, unknown in enumerate(self.unknowns):
            step = moved_by[:, column].reshape(-1, 3)
            moved = step.any(axis=1)
            axis = int(np.argmax(np.abs(step[moved][0]))) if moved.any() else 0
            alike = np.array_equal(step, moved[:, None] * np.eye(3)[axis])
            if unknown.kind == "effect" and moved.any() and alike:
                found[column] = axis, np.unique(self.gnss_flight[moved])
        return found

    # ------------------------------------------------------------------------------------------

    def _solved(self, rows: csr_array, own: np.ndarray) -> Quantities:
        return Quantities(rows, own, self.covariance.solve(rows.toarray().T))

    def _mark_rows(self, point: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, csr_array]:
        """Derivatives of a point's marks in some images: by the point (2m, 3), and (2m, n)."""
        images = self.images
        by = projection_derivatives(
            np.broadcast_to(point, (len(rows), 3)), images.centre[rows], images.rotation[rows],
            images.interior[rows], np.arange(len(rows)),
        )  # fmt: skip
        pose = by.by_pose.reshape(-1, 6)
        by_columns = np.zeros((2 * len(rows), len(self.columns)))
        at = np.repeat(self.columns.pose[rows], 2, axis=0)
        by_columns[np.arange(len(at))[:, None], at] = pose
        camera = np.repeat(images.camera[rows], 2)
        change = by.by_interior.reshape(-1, 15)
        for number, unknown in zip(self.columns.shared_at, self.unknowns, strict=True):
            if unknown.kind == "camera":
                mine = camera == unknown.at[0]
                by_columns[mine, number] = change[mine, unknown.at[1]]
        return by.by_point.reshape(-1, 3), csr_array(by_columns)

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
        image = self.images.names[singular.image]
        return InputError(
            f"the pose of image {image} of flight set {self.plan.name} cannot be determined: "
            "more tie points or more overlap are needed"
        )


def without_control(plan: Plan, seed: int) -> Block:
    """The perfect block of a plan, without the ground points that the plan states.

    Its bars stay where the plan states how good they are (`noise.distance_m`).
    """
    none = {"control": 0, "check": 0, "every_m": None, "check_from_ties": 0}
    none |= {} if plan.noise.distance_m else {"bars": 0}
    block = perfect_block(replace(plan, ground=replace(plan.ground, **none)), seed)
    if len(block.distances):
        block.distances = block.distances.assign(sigma=plan.noise.distance_m)
    return block


def _block_of(plan: Plan, surveyed: Surveyed, seed: int) -> tuple[Block, Surveyed, list[str]]:
    """The perfect block with the surveyed points measured in it; names of those not seen twice."""
    block = without_control(plan, seed)
    stated = {key: value for key, value in asdict(plan.noise).items() if key in _SIGMAS}
    block.sigma |= {
        key: value if key.endswith("_px") else np.broadcast_to(np.asarray(value, float), 3).copy()
        for key, value in stated.items()
        if np.all(np.asarray(value) > 0)
    }
    xyz = surveyed.place(plan, seed)
    marks = marks_on(plan, seed, surveyed.names, xyz)
    twice = marks["point"].value_counts(sort=False).to_numpy() >= 2
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
    ground = pd.DataFrame({"point": shown.names, **dict(zip("xyz", xyz[kept].T, strict=True))})
    ground["role"] = np.where(shown.check, "check", "control")
    block = replace(
        block,
        marks=marks[marks["point"].isin(shown.names)].astype({"point": str, "image": str}),
        ground=ground,
    )
    return block, shown, [surveyed.names[k] for k in np.flatnonzero(~twice)]


_SIGMAS = ("tie_px", "mark_px", "gnss_m", "control_m", "attitude_deg")
