"""What could have hidden: redundancy, tests, least errors that show, and predictions.

Source: Baarda 1968 (inner and external reliability); Förstner 1980; Gruen 1980; Pope 1976 (tau).
Probabilities are those of Baarda: an error is found with 80 % where one good measurement in a
thousand is accused.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.linalg import block_diag
from scipy.special import betainc, chdtrc, ndtri, stdtrit

from corridor.core.adjustment.cofactors import (
    OfPoint,
    of_antennas,
    of_control,
    of_points,
    with_control,
)
from corridor.core.adjustment.distances import ends_named, tested
from corridor.core.adjustment.external_reliability import moves
from corridor.core.adjustment.problem import POSE_KINDS
from corridor.core.adjustment.snooping import LEAST_SHOWN_SHARE, Blunder, blunders, with_scale
from corridor.core.block import turned, values_of
from corridor.core.output import with_units

if TYPE_CHECKING:
    from corridor.core.adjustment.tables import Tables

# Rays up to which reports tell what needs a matrix of all of them (500 MB).
_MOST_RAYS = 2_000_000
ALPHA, BETA = 1e-3, 0.2
# In so many sets of good measurements the largest w of a kind is beyond the critical value.
OF_ALL = 0.05
# Non-centrality of a test of that size and power, in sigmas: 4.13.
DELTA = float(-ndtri(ALPHA / 2) - ndtri(BETA))


def critical(alpha: float, redundancy: float | None = None) -> float:
    """What |w| of a good measurement exceeds with a probability of alpha.

    redundancy f: with which sigma naught is estimated from the same residuals, None where it is
    given. Then w follows Pope's tau, t sqrt(f) / sqrt(f - 1 + t^2) with Student's t of f - 1.
    """
    if redundancy is None:
        return float(-ndtri(alpha / 2))
    if redundancy <= 1:
        return float(np.sqrt(max(redundancy, 0)))  # Of one redundancy w is always 1.
    t = -stdtrit(redundancy - 1, alpha / 2)
    return float(t * np.sqrt(redundancy / (redundancy - 1 + t * t)))


class Reliability:
    """Reliability of an adjustment; tables are pandas frames, one row a coordinate.

    Columns of `control`, `gnss`, `marks` and `check`: redundancy (0: the measurement decides alone,
    1: all others do); w (standardised residual: beyond 3.3 one good one in a thousand); least_error
    (the smallest error that is found with a probability of 80 %, m or px; infinite where none is);
    external (by how many of its own standard deviations such an error, if it is not found, moves
    any unknown at the most); predicted (measured minus what all others predict when the whole
    point, position or mark is left out, m or px) and s_predicted (its standard deviation, that of
    the measurement included); p (probability of such a difference, all axes together).

    Sigmas of ground points and antennas count as they are stated, or as the variance components
    have them; those of image points times sigma naught of the image points.
    """

    def __init__(self, adjustment: Tables):
        self._of = adjustment

    # --- tables ------------------------------------------------------------------------------

    @cached_property
    def control(self) -> pd.DataFrame:
        """Control points: point, axis and the columns above."""
        residuals = self._of.residuals["control"]
        return _table("point", residuals, self._share("control"), "m", self._root("control"))

    @cached_property
    def gnss(self) -> pd.DataFrame:
        """Antenna positions: image, axis and the columns above."""
        residuals = self._of.residuals["gnss"]
        return _table("image", residuals, self._share("gnss"), "m", self._root("gnss"))

    @cached_property
    def attitude(self) -> pd.DataFrame:
        """Attitudes: image, axis (x, y, z: the heading, to its right, down) and the columns above,
        in degrees."""
        share = self._share("attitude")
        residuals = self._of.residuals["attitude" if len(share) else "gnss"][: len(share)]
        return _table("image", residuals, share, "deg")

    @cached_property
    def marks(self) -> pd.DataFrame:
        """Marks of ground points: point, image, axis and the columns above, in px."""
        p, residuals = self._of.problem, self._of.residuals["mark"]
        numbers, share = [np.zeros(0, int)], []
        for point, one in self._points.items():
            rays = p.row[p.ptr[point] : p.ptr[point + 1]] - p.tie_count
            numbers.append(rays)
            share += [one.share[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(rays))]
        rows = np.concatenate(numbers)
        # Marks of unused points have no residual and no row.
        back = np.full(len(p.block.marks), -1)
        back[np.sort(rows)] = np.arange(len(rows))
        mine = residuals.iloc[back[rows]].reset_index(drop=True)
        mine = mine.assign(sx=mine["sigma"] * self.image_scale, sy=mine["sigma"] * self.image_scale)
        root = None
        if len(p.skewed):
            place = np.full(len(p.block.tie_points) + len(p.block.marks), -1)
            place[p.row] = np.arange(len(p.row))
            root = np.zeros((len(rows), 2, 2))
            root[:, [0, 1, 1], [0, 0, 1]] = p.skewed[place[p.tie_count + rows]]
            root /= mine["sx"].to_numpy()[:, None, None]
            mine[["sx", "sy"]] = np.sqrt(
                np.einsum("nij,nij->ni", np.linalg.inv(root), np.linalg.inv(root))
            )
        shares = np.array(share).reshape(-1, 2, 2)
        return _table(("point", "image"), mine, shares, "px", root, self._of.redundancy)

    @cached_property
    def check(self) -> pd.DataFrame:
        """Check points, which nothing but the images shows: all others predict them as they are."""
        check = self._of.check_points
        residuals = pd.DataFrame({"point": check["point"].astype(str)})
        for axis in "xyz":
            residuals[f"v{axis}"] = -check[f"d{axis}"]
            residuals[f"s{axis}"] = check[f"s{axis}"]
        share = np.broadcast_to(np.eye(3), (len(check), 3, 3))
        return _table("point", residuals, share, "m")

    @cached_property
    def summary(self) -> pd.DataFrame:
        """A row for each kind: count of numbers, redundancy together, its mean and least,
        largest w and its critical value (exceeded by the largest of a kind in one of twenty good
        sets), and the median and largest least error."""
        rows: dict[str, tuple] = {}
        taken = 0.0
        tables = (
            ("control", self.control), ("gnss", self.gnss), ("attitude", self.attitude),
            ("mark", self.marks),
        )  # fmt: skip
        for kind, table in tables:
            unit = {"mark": "px", "attitude": "deg"}.get(kind, "m")
            if not len(table):
                continue
            share = table["redundancy"]
            taken += share.sum()
            error, scaled = table["least_error"], self._of.redundancy if kind == "mark" else None
            rows[kind] = (len(table), share.sum(), share.mean(), share.min(),
                          table["w"].abs().max(), critical(OF_ALL / len(table), scaled),
                          error.median(), error.max(), unit)  # fmt: skip
        p = self._of.problem
        ties = 2 * int(np.count_nonzero(p.row < p.tie_count))
        if ties:
            # What is left; of priors each takes at most one.
            left = self._of.redundancy - taken
            most = critical(OF_ALL / ties, self._of.redundancy)
            rows["tie"] = (ties, left, left / ties, np.nan, np.nan, most, np.nan, np.nan, "px")
        columns = ["count", "redundancy", "mean", "least", "largest_w", "critical_w",
                   "median_least_error", "largest_least_error", "unit"]  # fmt: skip
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("kind")

    @property
    def whole(self) -> bool:
        """Whether what looks at every point of every image fits in the memory of a report."""
        return len(self._of.problem.img) <= _MOST_RAYS

    @cached_property
    def external(self) -> pd.DataFrame:
        """What the least error of each coordinate of control does to the points where it is not
        found: point, axis, least_error, and the point that moves most: at, x, y, z, moved; plan,
        height: the largest move of any point in these; m."""
        control = self.control
        errors = control["least_error"].to_numpy(float)
        found = moves(self._of.covariance, errors)
        kept = pd.DataFrame(control[["point", "axis", "least_error"]])
        whole = pd.concat([kept, pd.DataFrame(found)], axis=1)
        return with_units(whole, {"m": "least_error x y z moved plan height"})

    # --- what is wrong -----------------------------------------------------------------------

    @cached_property
    def wrong_control(self) -> pd.DataFrame:
        """Coordinates of control that are wrong: point, axis, error and sigma (given minus true,
        m), w, and `or_else`, other coordinates that explain the same as well.

        All coordinates are tested together, pairs that hide each other too; a set in which nothing
        is wrong gets a name with a probability of 1 %. See `corridor.core.adjustment.snooping`.
        """
        table = self._wrong(slice(0, 3 * len(self._of.residuals["control"])))
        parts = [name.rsplit(" ", 1) for name in table.pop("name")]
        table = table.drop(columns="number")
        table.insert(0, "point", [point for point, _ in parts])
        table.insert(1, "axis", [axis for _, axis in parts])
        return with_units(table, {"m": "error sigma"})

    @cached_property
    def wrong_distances(self) -> pd.DataFrame:
        """Distances that are wrong: from, to, and the columns of `wrong_control`, with which they
        are tested together: what a wrong bar pushes aside is not accused."""
        first, p = 3 * len(self._of.residuals["control"]), self._of.problem
        table = self._wrong(slice(first, None))
        named = ends_named(p).iloc[table.pop("number") - first].reset_index(drop=True)
        return with_units(named.join(table.drop(columns="name")), {"m": "error sigma"})

    def _wrong(self, some: slice) -> pd.DataFrame:
        """Those of the control and the distances that are wrong, some of both."""
        sigma, names = self._tested_sigmas
        rows = [
            (one.number, names[one.number], sigma[one.number] * one.error,
             sigma[one.number] * one.sigma, one.w, ", ".join(names[k] for k in one.rivals))
            for one in self._blunders
            if one.number in range(len(names))[some]
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=["number", "name", "error", "sigma", "w", "or_else"])

    @cached_property
    def _tested_sigmas(self) -> tuple[np.ndarray, list[str]]:
        """Standard deviations and names of the coordinates of control and of the distances."""
        p, residuals = self._of.problem, self._of.residuals["control"]
        sigma = values_of(residuals, "sx", "sy", "sz").ravel()
        names = [f"{name} {axis}" for name in residuals["point"] for axis in "xyz"]
        names += [" to ".join(pair) for pair in ends_named(p).astype(str).itertuples(index=False)]
        return np.concatenate([sigma, p.distance_weight**-0.5]), names

    @cached_property
    def control_cofactors(self) -> np.ndarray:
        """Cofactors (3 c, 3 c) of the residuals of control, x, y, z of each point, in units of its
        standard deviations."""
        return of_control(self._of.covariance)

    @cached_property
    def _blunders(self) -> list[Blunder]:
        """Of the coordinates of control, and of the distances behind them: all tested together."""
        residuals, covariance = self._of.residuals["control"], self._of.covariance
        if len(residuals) < 2:
            residuals = residuals.iloc[:0]
        v = values_of(residuals, "vx", "vy", "vz")
        sigma = values_of(residuals, "sx", "sy", "sz")
        root = self._root("control")
        white = (v / sigma if root is None else turned(root, v)).ravel()
        of_bars, rows, share = tested(self._of.problem, self._of.state, covariance)
        # Of a control point alone nothing is said.
        control = self.control_cofactors if len(residuals) else np.zeros((0, 0))
        whole = block_diag(control, share)
        if len(control) and len(share):
            between = -with_control(covariance) @ rows.T
            whole[: len(control), len(control) :] = between
            whole[len(control) :, : len(control)] = between.T
        most = int(np.count_nonzero(np.diag(control) > LEAST_SHOWN_SHARE)) // 3
        # Fewer wrong distances than half of those that others show have no other explanation.
        most += round(float(np.trace(share))) // 2
        white = np.concatenate([white, of_bars])
        white, whole = with_scale(white, whole, max(self.image_scale, 1.0))
        if root is not None:
            # An error of a coordinate shows in all three that are independent.
            errors = block_diag(*(root * sigma[:, None, :]), np.eye(len(share)))
            white, whole = errors.T @ white, np.asarray(errors.T @ whole @ errors)
        found = blunders(white, whole, least=1 if len(share) else 2, most=most)
        alone = len(self._of.residuals["control"]) - len(residuals)
        return [
            replace(
                one,
                number=one.number + 3 * alone,
                rivals=tuple(k + 3 * alone for k in one.rivals),
            )
            for one in found
        ]

    def _root(self, kind: str) -> np.ndarray | None:
        """What makes residuals of `control` or `gnss` independent, with sigma 1 (k, 3, 3); None
        where they are independent."""
        turn, weight = self._of.correlated(kind)
        return None if turn is None else np.sqrt(weight)[:, :, None] * turn

    def independent(self, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """Squares (k, 3) of the residuals of `control`, `gnss` or `attitude` in coordinates that
        are independent, in their sigmas, and the redundancy (k, 3) of these."""
        residuals = self._of.residuals.get(kind, pd.DataFrame())
        if not len(residuals):
            return np.zeros((0, 3)), np.zeros((0, 3))
        v = values_of(residuals, "vx", "vy", "vz")
        root = self._root(kind)
        scaled = v / values_of(residuals, "sx", "sy", "sz") if root is None else turned(root, v)
        return scaled**2, np.clip(np.einsum("nii->ni", self._share(kind)), 0.0, 1.0)

    def _share(self, kind: str) -> np.ndarray:
        """Cofactors (k, 3, 3) of the residuals of each row of a kind, independent, of sigma 1."""
        if kind == "control":
            control = self._of.covariance.control.points.tolist()
            found = [self._points[k].share[-3:, -3:] for k in control]
            return np.array(found).reshape(-1, 3, 3)
        return self._antennas[kind]

    @cached_property
    def _antennas(self) -> dict[str, np.ndarray]:
        return {kind: of_antennas(self._of.covariance, kind) for kind in POSE_KINDS}

    # --- what all of them need ---------------------------------------------------------------

    @cached_property
    def image_scale(self) -> float:
        """Sigma naught of the image points."""
        return self._of.sigma0

    @cached_property
    def _points(self) -> dict[int, OfPoint]:
        """Cofactors of the marked points, by their number."""
        p = self._of.problem
        marked = np.flatnonzero(p.point_kinds)
        return dict(
            zip(marked.tolist(), of_points(self._of.covariance, marked.tolist()), strict=True)
        )

    def to_dict(self) -> dict:
        """For adjustment.json: `summary`, `wrong_control`, and the tables of ground points."""
        return {
            "alpha": ALPHA,
            "power": 1.0 - BETA,
            "summary": self.summary.reset_index().to_dict(orient="records"),
            "wrong_control": self.wrong_control.to_dict(orient="records"),
            "control": self.control.to_dict(orient="records"),
            "check": self.check.to_dict(orient="records"),
            "external": self.external.to_dict(orient="records") if self.whole else None,
        }

    def to_frame(self) -> pd.DataFrame:
        """All tables in one, with the column `kind` before them; metres, marks in px."""
        kinds = ("control", "check", "gnss", "attitude", "marks")
        tables = {kind: getattr(self, kind) for kind in kinds}
        parts = [pd.DataFrame(t).assign(kind=kind) for kind, t in tables.items() if len(t)]
        if not parts:
            return pd.DataFrame(columns=["kind"])
        whole = pd.concat(parts, ignore_index=True)
        first = [name for name in ("kind", "point", "image", "axis") if name in whole]
        return whole[[*first, *(name for name in whole if name not in first)]]


def _table(
    key,
    residuals: pd.DataFrame,
    share: np.ndarray,
    unit: str,
    root: np.ndarray | None = None,
    redundancy: float | None = None,
) -> pd.DataFrame:
    """The columns of `Reliability` from residuals v and sigmas s of some axes.

    share (n, k, k): R, cofactors of the residuals of each where all are independent, of sigma 1;
    root (n, k, k): G, which makes that of v; None: 1 / s. Of correlated axes, with P = G'G, an
    error e of one shows in the test w = (P v) / sqrt((G'RG)) (Koch 1999, section 4.2.3); the
    redundancy is the diagonal of G^-1 R G, which need not lie between 0 and 1. redundancy f: as of
    `critical`; the square of k axes over f is a Beta of k / 2 and (f - k) / 2 then.
    """
    keys = (key,) if isinstance(key, str) else key
    k = share.shape[1]
    axes = list("xyz"[:k])
    v = values_of(residuals, *(f"v{axis}" for axis in axes))
    sigma = values_of(residuals, *(f"s{axis}" for axis in axes))
    if root is None:
        root = np.eye(k) / sigma[:, :, None]
        r = np.clip(np.einsum("nii->ni", share), 0.0, 1.0)
    else:
        r = np.einsum("nii->ni", np.linalg.solve(root, share @ root))
    across = root.transpose(0, 2, 1)
    known = np.einsum("nji,nji->ni", root, root)
    seen = np.clip(np.einsum("nii->ni", across @ share @ root), 0.0, known)
    shown = seen > LEAST_SHOWN_SHARE * known
    size = np.sqrt(np.where(shown, seen, np.nan))
    # Where a direction shows in no other measurement, nothing predicts the whole.
    whole = np.linalg.eigvalsh(share)[:, 0] > LEAST_SHOWN_SHARE if len(share) else np.zeros(0, bool)
    inverse = np.full(share.shape, np.nan)
    inverse[whole] = np.linalg.inv(share[whole])
    scaled = turned(root, v)
    left_out = turned(inverse, scaled)
    test = np.einsum("ni,ni->n", scaled, left_out)
    back = np.linalg.inv(root)
    out = {name: np.repeat(residuals[name].astype(str).to_numpy(object), k) for name in keys}
    numbers = {
        "redundancy": r,
        "w": turned(across, scaled) / size,
        "least_error": np.where(shown, DELTA / size, np.inf),
        "external": np.where(shown, DELTA * np.sqrt(known - seen) / size, np.inf),
        "predicted": turned(back, left_out),
        "s_predicted": np.sqrt(np.einsum("nij,njk,nik->ni", back, inverse, back)),
        "p": np.broadcast_to(chance(k, test, redundancy)[:, None], r.shape),
    }
    out["axis"] = np.tile(axes, len(residuals))
    out |= {name: values.ravel() for name, values in numbers.items()}
    return with_units(pd.DataFrame(out), {unit: "least_error predicted s_predicted"})


def chance(k: int, test: np.ndarray, redundancy: float | None) -> np.ndarray:
    """Probability of squares (n,) of k axes, or of more; arguments as of `_table`."""
    if redundancy is None or redundancy <= k:
        return chdtrc(k, test)
    return betainc((redundancy - k) / 2, k / 2, np.clip(1.0 - test / redundancy, 0.0, 1.0))
