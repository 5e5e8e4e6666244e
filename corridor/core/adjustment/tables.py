"""What an adjustment found, as tables that are computed when they are first asked for."""

from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property

import numpy as np
import pandas as pd

from corridor.core.adjustment.blunders import exchanged_points, where_seen
from corridor.core.adjustment.check_statistics import Checked
from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.distances import END, table_of
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.model import CAMERA, EFFECT, LEVER_ARM, ParameterId
from corridor.core.adjustment.parameters import Found, Parameters
from corridor.core.adjustment.point_quality import quality
from corridor.core.adjustment.reliability import Reliability
from corridor.core.adjustment.solving import Solution
from corridor.core.adjustment.unknowns import IN_PIXELS
from corridor.core.block import (
    POSE,
    Block,
    along_axes,
    covariance_of,
    frugal,
    places,
    turned,
    values_of,
)
from corridor.core.camera import INTERIOR
from corridor.core.effects import Values
from corridor.core.engine.scene import robust
from corridor.core.geometry import (
    CONTRADICTING_FACTOR,
    GROSS,
    is_outlier,
    quaternion_from_rotation,
    robust_scale,
    robust_scale_of_lengths,
)
from corridor.core.output import with_units
from corridor.core.preparation import FRAME

HIGH_CORRELATION = 0.95
_PART = 1 << 20  # observations that are looked at together
_METRES = ("rms_x_m", "rms_y_m", "rms_z_m")
_DEGREES = ("rms_roll_deg", "rms_pitch_deg", "rms_yaw_deg")
_COLUMNS = ("count", "outliers", "gross", "rms_px", *_METRES)


class Tables(Checked):
    """A block after adjustment, with everything one asks of it.

    Standard deviations are scaled by sigma naught. Tables are pandas frames.
    """

    def __init__(self, start: Block, solution: Solution, covariance: Covariance, seconds: float):
        self.start, self.system = start, covariance.system
        self.problem = self.system.problem
        self.state = solution.state
        self.converged, self.iterations = solution.converged, solution.iterations
        self.cost, self.history, self.seconds = solution.cost, solution.history, seconds
        self.covariance = covariance
        self.redundancy = (
            self.problem.observation_count
            - self.problem.unknown_count
            + len(self.problem.idle)
            + (0 if self.system.held is None else len(self.system.held))
        )
        # Without redundancy there is nothing to estimate sigma naught from.
        self.sigma0 = float(np.sqrt(2 * self.cost / self.redundancy)) if self.redundancy else 1.0

    @property
    def sigma_naught(self) -> float:
        """`sigma0` by the name that the report has for it."""
        return self.sigma0

    @property
    def stated_system(self) -> LinearSystem:
        """The equations at the result, every residual with its stated weight."""
        return LinearSystem(self.problem, self.state)

    # --- the adjusted block ------------------------------------------------------------------

    @cached_property
    def block(self) -> Block:
        """The block with adjusted poses, points, cameras and lever arms."""
        return self._placed(self.point_sigma)

    @property
    def start_again(self) -> Block:
        """As `block`, without the sigmas of points, which take longer: to be adjusted anew."""
        return self._placed(np.full(self.state.points.shape, np.nan))

    def as_left(self, slugs: Collection[str]) -> tuple[Block, dict[str, float]]:
        """`start_again` where effects of these slugs begin with the values that they ended with.

        The block, with poses that nothing was restated in, and the values by the names of
        parameters; not of effects with values for each image.
        """
        members = {
            slug: member
            for slug, member in self.problem.stack.members.items()
            if slug in slugs and member.effect.group != "image"
        }
        values = {
            str(ParameterId(EFFECT, slug, parameter.name, group)): float(number)
            for slug, member in members.items()
            for group, row in zip(member.groups, self.state.effects[slug], strict=True)
            for parameter, number in zip(member.parameters, row, strict=True)
        }
        return self._placed(np.full(self.state.points.shape, np.nan), self._at(members)), values

    def _placed(self, sigma: np.ndarray, posed: Block | None = None) -> Block:
        p, state = self.problem, self.state
        block = (self._posed if posed is None else posed).copy()
        block.cameras = {
            name: camera.with_interior(interior)
            for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
        }
        block.points = self._points_table(block.points, sigma)
        if len(block.gnss) or (block.ground["role"] == "control").sum() > 2:
            # Metres now, and no longer the free frame of a reconstruction.
            block.extra = {key: value for key, value in block.extra.items() if key != FRAME}
        if p.arms_free:
            block.lever_arm = {
                name: tuple(arm) for name, arm in zip(block.flight_names, state.arms, strict=True)
            }
        return block

    @cached_property
    def _posed(self) -> Block:
        """The block with adjusted poses, and what effects state anew."""
        return self._at()

    def _at(self, slugs: Collection[str] = ()) -> Block:
        """The block with adjusted poses, and what effects but these state anew."""
        p, state = self.problem, self.state
        block = p.block.copy()
        block.put("images", POSE, self._as_adjusted)
        for slug, member in p.stack.members.items():
            if slug not in slugs:
                block = member.effect.restated(block, state.effects[slug])
        return block

    @frugal()
    def _points_table(self, given: pd.DataFrame, sigma: np.ndarray) -> pd.DataFrame:
        """points.csv with what was found in place of what was given, new points behind."""
        codes, names = self.problem.point_codes, self.problem.names
        found = dict(zip(("x", "y", "z"), self.state.points.T, strict=True))
        found |= dict(zip(("sx", "sy", "sz"), sigma.T, strict=True))
        of_code = np.full(len(names) + 1, -1, np.int32)  # one more, for names that are not known
        of_code[codes] = np.arange(len(codes), dtype=np.int32)
        at = of_code[places(given["point"], names)]
        hit = at >= 0
        fresh = np.ones(len(codes), dtype=bool)
        fresh[at[hit]] = False
        # One array a column, made once: of a river each is as large as all its points.
        kept = given[[name for name in given if name not in found]]
        if fresh.any():
            new = pd.DataFrame({"point": names.take(codes[fresh])})
            kept = pd.concat([kept, new], ignore_index=True)
        columns = {name: kept[name] for name in kept}
        for name, values in found.items():
            column = np.full(len(kept), np.nan)
            if name in given:
                column[: len(given)] = given[name]
            column[: len(given)][hit] = values[at[hit]]
            column[len(given) :] = values[fresh]
            columns[name] = column
        order = dict.fromkeys([*given, *columns])
        return pd.DataFrame({name: columns[name] for name in order}, copy=False)

    @property
    def pose(self) -> np.ndarray:
        """(images, 7): x, y, z and qw, qx, qy, qz in the order of images.csv."""
        return self._posed.poses if self.problem.stack.members else self._as_adjusted

    @cached_property
    def _as_adjusted(self) -> np.ndarray:
        """`pose`, where no effect states anything anew."""
        p, state = self.problem, self.state
        pose = np.empty((p.image_count, 7))
        pose[p.order, :3] = state.centre
        pose[p.order, 3:] = quaternion_from_rotation(state.rotation)
        return pose

    # --- residuals ---------------------------------------------------------------------------

    @cached_property
    def residuals(self) -> dict[str, pd.DataFrame]:
        """Measured minus modelled, by kind: `tie`, `mark` (px), `gnss`, `control` (m), and
        `attitude` where there is any (degrees, about the heading, to its right, and down)."""
        p = self.problem
        left = self.system.residuals()
        v = np.empty((2, len(p.block.tie_points) + len(p.block.marks)))

        def in_rows(axis: int) -> None:
            v[axis] = np.nan
            for first in range(0, len(p.row), _PART):
                part = slice(first, first + _PART)
                v[axis][p.row[part]] = left.pixels[part, axis]

        with ThreadPoolExecutor(self.system.threads) as pool:
            list(pool.map(in_rows, range(2)))
        left = replace(left, pixels=np.zeros((0, 2)))  # as large as the observations
        sigma = {"tie": p.block.tie_sigma(), "mark": p.block.mark_sigma()}
        skewed = self._skewed_rows

        def lengths() -> np.ndarray:
            length = np.empty(v.shape[1])
            for first in range(0, len(length), _PART):
                part = slice(first, first + _PART)
                x, y = v[0, part], v[1, part]
                if len(skewed):
                    x, y = skew(skewed[part], x, y)
                length[part] = np.sqrt(x**2 + y**2)
            length[: p.tie_count] /= sigma["tie"]
            length[p.tie_count :] /= sigma["mark"]
            return length

        usual = robust_scale_of_lengths(lengths(), least=1e-9, overwrite=True)
        length = lengths()
        loss = self.system.loss
        weight = np.broadcast_to(1.0, len(length))
        if loss.kind != 0:
            weight = robust(loss, length**2)[1] ** 2
        out = {}
        self._seen: dict[str, np.ndarray] = {}
        for kind, rows, span in (
            ("tie", p.block.tie_points, slice(0, p.tie_count)),
            ("mark", p.block.marks, slice(p.tie_count, None)),
        ):
            # Stated sigmas may fit one kind and not the other: half of a kind are no outliers.
            own = max(usual, robust_scale_of_lengths(length[span]))
            mine = {
                "vx": v[0, span],
                "vy": v[1, span],
                "sigma": sigma[kind],
                "weight": weight[span],
                "outlier": is_outlier(length[span], own),
                "gross": is_outlier(length[span], own, GROSS),
            }
            shown = {name: rows[name] for name in ("point", "image", "x", "y")}
            frame = pd.DataFrame(shown | mine, copy=False)
            self._seen[kind] = known = np.isfinite(mine["vx"])
            if not known.all():
                frame = frame[known].reset_index(drop=True)
            out[kind] = with_units(frame, {"px": "x y vx vy sigma"})
        names = p.images.names[p.gnss_image]
        out["gnss"] = _threes(
            names, "image", p.gnss_given, left.gnss, p.gnss_weight, turn=p.gnss_turn, apart=True
        )
        if len(p.attitude_image):
            names = p.images.names[p.attitude_image]
            degrees, weight = np.degrees(left.attitude), p.attitude_weight / np.degrees(1.0) ** 2
            out["attitude"] = _threes(names, "image", None, degrees, weight, "deg")
        names, c = self.system.control_names, len(p.control_rows)
        out["control"] = _threes(
            names, "point", p.control_given[:c], left.control, p.control_weight[:c],
            turn=p.control_turn[:c],
        )  # fmt: skip
        return out

    @cached_property
    def _skewed_rows(self) -> np.ndarray:
        """`Network.skewed` in the order of the files, ties then marks, NaN where a row is unused;
        (0, 3) where x and y of all are equally good and independent."""
        p = self.problem
        if not len(p.skewed):
            return p.skewed
        out = np.full((len(p.block.tie_points) + len(p.block.marks), 3), np.nan)
        out[p.row] = p.skewed
        return out

    def correlated(self, kind: str) -> tuple[np.ndarray | None, np.ndarray]:
        """What makes the rows of `gnss` or `control` in `residuals` independent (k, 3, 3), None
        where they are, and the weights (k, 3) of that."""
        p = self.problem
        if kind == "attitude":
            return None, p.attitude_weight
        turn, weight = getattr(p, f"{kind}_turn"), getattr(p, f"{kind}_weight")
        if kind == "control":
            turn, weight = turn[: len(p.control_rows)], weight[: len(p.control_rows)]
        return (turn if (turn != np.eye(3)).any() else None), weight

    @property
    def correlated_kinds(self) -> list[str]:
        """Kinds of observation of which some coordinates are correlated: `tie`, `mark`, `gnss`,
        `control`."""
        p, kinds = self.problem, []
        if len(p.skewed):
            tie = p.row < p.tie_count
            skewed = (p.skewed != [1.0, 0.0, 1.0]).any(axis=1)
            kinds = [kind for kind, rows in (("tie", tie), ("mark", ~tie)) if skewed[rows].any()]
        for kind in ("gnss", "control"):
            if self.correlated(kind)[0] is not None:
                kinds.append(kind)
        return kinds

    @cached_property
    def observations(self) -> pd.DataFrame:
        """A row for each kind: `tie`, `mark`, `gnss`, `control`, of which there are any.

        Columns: count, outliers (beyond 5 robust sigmas), gross (beyond 15, which the RMS leaves
        out), rms_px (an axis; NaN of positions), rms_x_m, rms_y_m, rms_z_m (NaN of image points),
        sigma0.
        """
        return _observation_table(self.statistics)

    @cached_property
    def statistics(self) -> dict[str, dict]:
        """`observations` as adjustment.json has them: rms in px, or three in metres."""
        out: dict[str, dict] = {}
        for kind, frame in self.residuals.items():
            out[kind] = {}
            if not len(frame):
                continue
            if kind in ("gnss", "control", "attitude"):
                v = values_of(frame, "vx", "vy", "vz")
                s = values_of(frame, "sx", "sy", "sz")
                turn, weight = self.correlated(kind)
                scaled = v / s if turn is None else turned(turn, v) * np.sqrt(weight)
                out[kind] = {
                    "count": len(frame),
                    "rms": np.sqrt(np.mean(v**2, axis=0)).tolist(),
                    "sigma0": float(np.sqrt(np.mean(scaled**2))),
                    "outliers": int(frame["outlier"].sum()),
                }
                continue
            gross, sigma = frame["gross"].to_numpy(), frame["sigma"].to_numpy()
            # Where the sigmas of the other kind are absurd all of a kind stand out: none is left.
            gross = gross & ~gross.all()
            kept = ~gross
            axes = [frame[axis].to_numpy() for axis in ("vx", "vy")]
            alike = axes
            if len(self._skewed_rows):
                ties = len(self.problem.block.tie_points)
                mine = self._skewed_rows[:ties] if kind == "tie" else self._skewed_rows[ties:]
                alike = skew(mine[self._seen[kind]], *axes)
            one = np.broadcast_to(1.0, len(sigma))
            out[kind] = {
                "count": len(frame),
                "rms": float(np.sqrt(np.mean([_mean_square(v, one, kept) for v in axes]))),
                "sigma0": float(np.sqrt(np.mean([_mean_square(v, sigma, kept) for v in alike]))),
                "outliers": int(frame["outlier"].sum()),
                "gross": int(gross.sum()),
            }
        return out

    @cached_property
    def distances(self) -> pd.DataFrame:
        """The distances that were measured: from, to, given, sigma, v (given minus adjusted),
        s_adjusted, redundancy, w, least_error; m. See `adjustment.distances`."""
        return table_of(self.problem, self.state, self.covariance, self.sigma0)

    @cached_property
    def wrong_distances(self) -> pd.DataFrame:
        """Distances that all others contradict; see `Reliability.wrong_distances`."""
        return self.reliability.wrong_distances

    @cached_property
    def reliability(self) -> Reliability:
        """What could have hidden: redundancy, tests, least errors that show; see `Reliability`."""
        return Reliability(self)

    # --- what images share -------------------------------------------------------------------

    @cached_property
    def _shared_sigma(self) -> np.ndarray:
        return self.sigma0 * np.sqrt(np.diag(self.covariance.shared))

    def _sigma_of(self, kind: str, owner: str, at: tuple[int, int]) -> float:
        for n, unknown in enumerate(self.problem.unknowns):
            if (unknown.kind, unknown.owner, unknown.at) == (kind, owner, at):
                return float(self._shared_sigma[n])
        return 0.0

    @cached_property
    def camera(self) -> pd.DataFrame:
        """Interior parameters of each camera with their units; sigma 0 where held."""
        rows = []
        for c, name in enumerate(self.problem.images.camera_names):
            free = self.problem.free[name]
            for k, parameter in enumerate(INTERIOR):
                value = float(self.state.interior[c, k])
                sigma = self._sigma_of("camera", name, (c, k))
                if parameter in free or value != 0.0 or k < 3:
                    unit = "px" if parameter in IN_PIXELS else ""
                    rows.append((name, parameter, value, sigma, unit, parameter in free))
        columns = ["camera", "parameter", "value", "sigma", "unit", "free"]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def values(self) -> Values:
        """Values of the effects that were estimated, with groups, standard deviations and units."""
        own = range(6, self.problem.d)
        each = self.covariance.each_pose[:, own, own] if len(own) else None
        per_image_sigma = None if each is None else self.sigma0 * np.sqrt(each)
        return self.problem.values(self.state, self._shared_sigma, per_image_sigma)

    @cached_property
    def parameters(self) -> Parameters:
        """Every parameter of cameras, lever arms and effects; poses and points have tables.

        `adjustment.parameters["camera.P1.f"]`: value, sigma, unit, vary, prior; `to_frame()`.
        """
        p, start = self.problem, self.problem.start
        settings = p.model.settings_of(p.block)

        def found(which: ParameterId, value, sigma, unit, vary, begun) -> Found:
            given = [wish.prior for other, wish in settings.items() if other.means(which)]
            prior = next((prior for prior in given if prior is not None and vary), None)
            return Found(str(which), float(value), float(sigma), unit, bool(vary), prior, begun)

        out = []
        for row in self.camera.itertuples(index=False):
            begun = p.block.cameras[row.camera][row.parameter]
            which = ParameterId(CAMERA, row.camera, row.parameter)
            out.append(found(which, row.value, row.sigma, row.unit, row.free, begun))
        for row in self.lever_arm.itertuples(index=False):
            g = p.images.flight_names.index(row.flight)
            for axis, name in enumerate("xyz"):
                which, sigma = ParameterId(LEVER_ARM, row.flight, name), getattr(row, f"s{name}")
                begun = float(start.arms[g, axis])
                out.append(found(which, getattr(row, name), sigma, "m", sigma > 0, begun))
        for slug, one in self.values.items():
            for k, parameter in enumerate(one.parameters):
                for g in np.flatnonzero(np.isfinite(one.value[:, k])).tolist():
                    group = "block" if one.kind == "block" else one.groups[g]
                    which = ParameterId(EFFECT, slug, parameter.name, group)
                    value, sigma = one.value[g, k], one.sigma[g, k]
                    begun = float(start.effects[slug][g, k])
                    out.append(found(which, value, sigma, parameter.unit, sigma > 0, begun))
        return Parameters(out)

    @cached_property
    def effects(self) -> pd.DataFrame:
        """Table of `values`: slug, parameter, group, value, sigma, unit."""
        return self.values.frame

    @cached_property
    def lever_arm(self) -> pd.DataFrame:
        """Lever arm of each flight with GNSS, metres in the camera frame."""
        p = self.problem
        rows = []
        flights = set(p.images.flight[p.gnss_image]) if len(p.gnss_image) else set()
        for g, name in enumerate(p.images.flight_names):
            if g in flights:
                sigma = [self._sigma_of("lever_arm", name, (g, axis)) for axis in range(3)]
                rows.append((name, *self.state.arms[g], *sigma, not p.arms_free))
        columns = ["flight", "x", "y", "z", "sx", "sy", "sz", "fixed"]
        return with_units(pd.DataFrame(rows, columns=columns), {"m": "x y z sx sy sz"})

    @cached_property
    def correlation_matrix(self) -> pd.DataFrame:
        """Correlations (q, q) of camera, effect and lever-arm parameters, by their names."""
        # Coordinates of the ends of distances, which stand last, are no parameters.
        names = [one.label for one in self.problem.unknowns if one.kind != END]
        shared = self.covariance.shared if names else np.zeros((0, 0))
        shared = shared[: len(names), : len(names)]
        sigma = np.sqrt(np.diag(shared))
        return pd.DataFrame(shared / sigma[:, None] / sigma, index=names, columns=names)

    @cached_property
    def high_correlations(self) -> pd.DataFrame:
        """Pairs of shared parameters that are correlated beyond 0.95: a, b, value."""
        names, matrix = list(self.correlation_matrix), self.correlation_matrix.to_numpy()
        high = np.argwhere(np.triu(np.abs(matrix) > HIGH_CORRELATION, 1))
        rows = [(names[i], names[j], matrix[i, j]) for i, j in high]
        return pd.DataFrame(rows, columns=["a", "b", "value"]).astype({"value": float})

    @cached_property
    def correlations(self) -> pd.DataFrame:
        """Of focal lengths and lever arms (z) with camera and ground height, and each other.

        The mean and standard deviation are over the cameras or ground points concerned (points
        measured as marks where there are any, else tie points in three images or more). With
        several flights, focal lengths come with the heights of each (`height.FLIGHT`) as well.
        sigma_a, sigma_b: standard deviations of the two (b: mean), without which a coefficient
        hides how large either error is.
        Columns: a, b, mean, std, sigma_a, sigma_b. Source: Zhou 2019, table 5.3.
        """
        columns = ["a", "b", "mean", "std", "sigma_a", "sigma_b"]
        table = pd.DataFrame(self._pairs(), columns=columns)
        return table.astype(dict.fromkeys(columns[2:], float))

    def _pairs(self) -> list[tuple]:
        p = self.problem
        if not p.unknowns:
            return []
        sigma = np.sqrt(np.diag(self.covariance.shared))
        height = np.sqrt(self.covariance.each_pose[:, 2, 2])
        with_height = self.covariance.poses_shared[2 :: p.d]
        picked = np.flatnonzero(p.point_kinds)
        if not len(picked):
            picked = np.flatnonzero(np.diff(p.ptr) >= 3)
        ground = np.sqrt(self.covariance.point_variances[picked, 2])
        focal = [n for n, u in enumerate(p.unknowns) if (u.kind, u.name) == ("camera", "f")]
        between = self.covariance.between(picked, focal)[:, 2]
        with_ground = dict(zip(focal, between.T, strict=True))
        out = []
        chosen = [
            (n, unknown)
            for n, unknown in enumerate(p.unknowns)
            if (unknown.kind, unknown.name) in (("camera", "f"), ("lever_arm", "z"))
        ]
        for n, unknown in chosen:
            name = unknown.label
            if unknown.kind == "camera":
                mine = p.images.camera == unknown.at[0]
                out.append(self._pair(n, name, "height", with_height[mine, n], height[mine]))
                flights = np.unique(p.images.flight[mine])
                for g in flights if len(flights) > 1 else ():
                    here = mine & (p.images.flight == g)
                    which = f"height.{p.images.flight_names[g]}"
                    out.append(self._pair(n, name, which, with_height[here, n], height[here]))
                out.append(self._pair(n, name, "ground height", with_ground[n], ground))
            else:
                mine = p.images.flight == unknown.at[0]
                out.append(self._pair(n, name, "height", with_height[mine, n], height[mine]))
        for n, a in chosen:
            for m, b in chosen:
                if a.kind == "camera" and b.kind == "lever_arm":
                    other = np.array([self.covariance.shared[n, m]]), np.array([sigma[m]])
                    out.append(self._pair(n, a.label, b.label, *other))
        return out

    def _pair(self, n: int, a: str, b: str, covariance: np.ndarray, sigma_b: np.ndarray) -> tuple:
        """Correlation of the n-th shared unknown with others: mean and spread."""
        sigma_a = np.sqrt(self.covariance.shared[n, n])
        known = sigma_b > 0  # a point that wild marks drove to infinity has none
        covariance, sigma_b = covariance[known], sigma_b[known]
        values = covariance / sigma_a / sigma_b
        spread = values.std(ddof=1) if len(values) > 1 else 0.0
        sigmas = self.sigma0 * sigma_a, self.sigma0 * sigma_b.mean()
        return a, b, values.mean(), spread, *sigmas

    # --- poses and points --------------------------------------------------------------------

    @cached_property
    def poses(self) -> pd.DataFrame:
        """Centres (m) and their sigmas; s_rx.. are rotations about the camera's axes, rad."""
        p = self.problem
        variance = np.einsum("nii->ni", self.covariance.each_pose)[:, :6]
        sigma = np.empty_like(variance)
        sigma[p.order] = self.sigma0 * np.sqrt(variance)
        frame = pd.DataFrame({"image": p.block.images["image"].to_numpy(dtype=object)})
        frame[["x", "y", "z"]] = self.pose[:, :3]
        frame[["sx", "sy", "sz", "s_rx", "s_ry", "s_rz"]] = sigma
        return with_units(frame, {"m": "x y z sx sy sz", "rad": "s_rx s_ry s_rz"})

    @cached_property
    def points(self) -> pd.DataFrame:
        """Adjusted points, ties and marks; sigmas are in `point_sigma`, which takes longer."""
        p = self.problem
        places = dict(zip("xyz", self.state.points.T, strict=True))
        frame = pd.DataFrame({"point": p.point_index, **places, "rays": np.diff(p.ptr)})
        frame["kind"] = np.where(p.point_kinds, "mark", "tie")
        return with_units(frame, {"m": "x y z"})

    @cached_property
    def point_quality(self) -> pd.DataFrame:
        """How each point is determined: point, rays, angle (largest between two of its rays,
        degrees), correlation (largest between two of its coordinates)."""
        return quality(self.covariance)

    @property
    def point_sigma(self) -> np.ndarray:
        """Standard deviations (n, 3), m, of the rows of `points`; NaN of parallel rays."""
        sigma = np.sqrt(self.covariance.point_variances)
        sigma *= self.sigma0
        # Along what nothing determines the equations hold a point still: that is no zero.
        sigma[~(sigma > 0).all(axis=1)] = np.nan
        return sigma

    @cached_property
    def exchanged(self) -> list[tuple[str, str]]:
        """Pairs of ground points each of which lies where the other was surveyed."""
        control, check = self.residuals["control"], self._checked[0]
        block = self.problem.block
        names = [*self.system.control_names, *block.ground["point"].to_numpy(dtype=object)[check]]
        off = len(control) and control["outlier"].any()
        if len(names) < 2 or not (off or len(check)):
            return []
        rows = pd.Index(block.ground["point"]).get_indexer(names)
        seen = where_seen(block, self.pose, self.state.interior)[rows]
        pairs = exchanged_points(block.numbers("ground", *"xyz")[rows], seen)
        return [(names[i], names[j]) for i, j in pairs]

    @cached_property
    def _checked(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of ground.csv and of points (n,) of the check points that images show."""
        p = self.problem
        rows = np.flatnonzero(p.roles == "check")
        marks = np.flatnonzero(p.point_kinds)
        at = pd.Index(p.point_index[marks]).get_indexer(p.block.ground["point"].iloc[rows])
        return rows[at >= 0], marks[at[at >= 0]]

    @cached_property
    def check_points(self) -> pd.DataFrame:
        """Adjusted minus given, metres, of the check points that images show.

        sx, sy, sz: standard deviations of the adjusted point; s_dx, s_dy, s_dz: of the difference,
        with that of the survey. What effects of the ground do to all points that were surveyed
        together is taken from the given.
        """
        p = self.problem
        ground = p.block.ground
        rows, index = self._checked
        names = ground["point"].to_numpy(dtype=object)[rows]
        given = values_of(ground, *"xyz")[rows]
        table = pd.DataFrame({"point": names})
        found = self.state.points[index]
        moved = p.stack.moved_ground(p.images, names.tolist(), found, self.state.effects)
        table[["dx", "dy", "dz"]] = found - (given - moved)
        # Of no point the covariances need not be worked out.
        variance = self.covariance.points(index)[:, [0, 2, 5]] if len(index) else np.zeros((0, 3))
        surveyed = p.block.ground_sigma()[rows]
        own = self.sigma0 * np.sqrt(variance)
        table[["sx", "sy", "sz"]] = own
        table[["s_dx", "s_dy", "s_dz"]] = np.hypot(own, surveyed)
        table["rays"] = np.diff(p.ptr)[index]
        return with_units(table, {"m": "dx dy dz sx sy sz s_dx s_dy s_dz"})


def _observation_table(statistics: Mapping[str, Mapping]) -> pd.DataFrame:
    """Counts, RMS and sigma naught: a row for each kind that has any observation.

    statistics: as in adjustment.json; rms is one number in px, or three in metres, of attitudes in
    degrees, whose columns are there where there are any.
    """
    rows = {}
    for kind, found in statistics.items():
        if found:
            rms = np.atleast_1d(found["rms"])
            unit = ("rms_px",) if len(rms) == 1 else _DEGREES if kind == "attitude" else _METRES
            rows[kind] = {**found, **dict(zip(unit, rms, strict=True))}
    table = pd.DataFrame.from_dict(rows, orient="index").reindex(
        columns=[*_COLUMNS, *_DEGREES * ("attitude" in rows), "sigma0"]
    )
    table = table.fillna({"gross": 0}).astype({"count": int, "outliers": int, "gross": int})
    return table.rename_axis("kind")


def skew(by: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """x and y (n,) after triangles 00 10 11 (n, 3)."""
    return [by[:, 0] * x, by[:, 1] * x + by[:, 2] * y]


def _mean_square(v: np.ndarray, sigma: np.ndarray, kept: np.ndarray) -> float:
    """Of v / sigma (n,) where it is kept, part by part: of a river each is as large as all rays."""
    total = 0.0
    for first in range(0, len(v), _PART):
        part = slice(first, first + _PART)
        scaled = v[part] / sigma[part]
        if not kept[part].all():
            scaled = scaled[kept[part]]
        total += float(scaled @ scaled)
    return total / max(int(np.count_nonzero(kept)), 1)


def _threes(names, key: str, given, residual, weight, unit="m", turn=None, apart=False):
    """Table of residuals in metres or degrees; outliers are beyond five sigmas, or five usual.

    residual (k, 3), weight (k, 3): of the coordinates that are independent (`turn`, (k, 3, 3)).
    apart: an axis may scatter more than the others do, by what contradicts no standard deviation.
    """
    scaled = np.abs(residual) * np.sqrt(weight)
    sigma = 1.0 / np.sqrt(weight) if len(weight) else np.zeros((0, 3))
    if turn is not None and (turn != np.eye(3)).any():
        residual = along_axes(turn, residual)
        sigma = np.sqrt(np.einsum("nii->ni", covariance_of(turn, weight)))
    usual = robust_scale(scaled, least=1e-6) if len(scaled) > 6 else 1.0
    # With a redundancy of 1 % residuals are a tenth of sigma: they do not show how axes scatter.
    if apart and len(scaled) > 6 and usual > 0.1:
        usual = np.clip(robust_scale(scaled, axis=0), usual, max(usual, CONTRADICTING_FACTOR))
    parts = {"": given, "v": residual, "s": sigma}
    columns = {
        label + axis: part[:, k]
        for label, part in parts.items()
        if part is not None
        for k, axis in enumerate("xyz")
    }
    outlier = is_outlier(scaled, usual).any(axis=1)
    frame = pd.DataFrame({key: list(names), **columns, "outlier": outlier})
    return with_units(frame, {unit: "x y z vx vy vz sx sy sz"})
