"""What a plan gives with one set of control points."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from corridor.core.adjustment import END, Parts
from corridor.core.errors import InputError
from corridor.core.output import millimetres
from corridor.tools.planning.conditioning import Moments, condition
from corridor.tools.planning.datum import open_motions, sentence
from corridor.tools.planning.network import Carried, Network, Quantities
from corridor.tools.planning.noise import GnssNoise


@dataclass(frozen=True)
class Known:
    """The points that an expectation may name, and the moments of all quantities under a noise.

    names (k,), where (k, 2): station and across, xyz (k, 3), m; first (k,): row of each point
    among the quantities; parts: what the network was solved for. bias: second moments of the
    constant errors that the columns of the transfer stand for, m^2.
    """

    names: list[str]
    where: np.ndarray
    xyz: np.ndarray
    first: np.ndarray
    parts: list[Quantities]
    moments: Moments
    bias: np.ndarray
    noise: GnssNoise

    def table(self, rows: np.ndarray) -> pd.DataFrame:
        """Points by row: point, station, across (m)."""
        names, (station, across) = [self.names[k] for k in rows], self.where[rows].T
        return pd.DataFrame({"point": names, "station": station, "across": across})


class Expected:
    """What a plan gives with one set of control points; metres.

    xy, z, d3: expected RMS of the check points, adjusted minus surveyed, as a report would have
    it: true errors of the GNSS and of the survey of both kinds of points. stated: the same as the
    adjustment believes. open: a sentence where the datum has a hole (the numbers are NaN then).
    """

    def __init__(self, net: Network, known: Known, control: tuple[str, ...], points: np.ndarray):
        self.network, self.control, self._known = net, control, known
        before = known.moments
        survey = net.block.sigma["control_m"] ** 2
        check = np.flatnonzero(net.surveyed.check)
        self._check = check[~np.isin(check, points)]
        if not len(self._check):
            raise InputError("every check point is control: leave some to check with")
        # Shared unknowns, check points and control are all that is asked for: of a hundred
        # candidates the rest would be carried along.
        q, axes = len(net.labels), np.arange(3)
        self._rows = (known.first[points][:, None] + axes).ravel()
        checked = (known.first[self._check][:, None] + axes).ravel()
        self._moments = before.of(np.concatenate([np.arange(q), checked, self._rows]))
        self._at = q + np.arange(len(checked))
        self._gain = self._inverse = None
        if len(points):
            self._moments, self._gain, self._inverse = condition(
                self._moments,
                q + len(checked) + np.arange(len(self._rows)),
                np.tile(survey, len(points)),
            )
        self._survey = np.tile(survey, len(self._check))
        stated = self._moments.stated[np.ix_(self._at, self._at)]
        self.loose = float(np.sqrt(np.trace(stated) / len(self._check)))
        words = open_motions(stated, known.xyz[self._check])
        positions = len(net.gnss.names)
        self.open = sentence(words, len(points), positions, net.arms_free) if words else ""
        moved = self._moments.transfer[self._at]
        error = np.diag(self._moments.error)[self._at] + np.sum(moved @ known.bias * moved, axis=1)
        self._error = np.full(len(self._at), np.nan) if words else error + self._survey
        self._stated = np.full(len(self._at), np.nan) if words else np.diag(stated) + self._survey
        found = _accuracy(self._error)
        self.xy, self.z, self.d3 = found.xy, found.z, found.d3

    @property
    def stated(self) -> Parts:
        """What the adjustment believes the RMS of its check points to be."""
        return _accuracy(self._stated)

    @property
    def check_points(self) -> pd.DataFrame:
        """Each check point: station, across; expected RMS of dx, dy, dz (m)."""
        table = self._known.table(self._check)
        root = np.sqrt(self._error).reshape(-1, 3)
        return table.assign(**dict(zip(("rms_x", "rms_y", "rms_z"), root.T, strict=True)))

    @property
    def transfer(self) -> np.ndarray:
        """Error (3,) of x, y, z on the ground a metre of constant GNSS bias in x, y, z.

        The mean over the check points, the bias common to all flights (and to the flight set of a
        carried-over camera).
        """
        if self.open or not self._moments.transfer.shape[1]:
            return np.full(3, np.nan) if self.open else np.zeros(3)
        by_axis = self._moments.transfer[self._at].reshape(len(self._check), 3, -1, 3).sum(axis=2)
        return np.einsum("nkk->k", by_axis) / len(self._check)

    @property
    def parameters(self) -> pd.DataFrame:
        """What images share: label, unit, stated sigma (0 where held), expected RMS error."""
        unknowns = self.network.unknowns
        q = len(unknowns)
        held = np.isin(np.arange(q), self.network.held)
        error = np.diag(self._moments.rms(self._known.bias)[:q, :q]).copy()
        for n in self.network.biases:
            # Its error is that of the adjustment: the bias is what it finds.
            error[n] = self._moments.stated[n, n]
        units = [unknown.unit for unknown in unknowns]
        frame = pd.DataFrame({"parameter": self.network.labels, "unit": units})
        frame["sigma"] = np.where(held, 0.0, np.sqrt(np.diag(self._moments.stated)[:q]))
        frame["rms"] = np.sqrt(np.maximum(error, 0.0))
        if self.open:
            frame[["sigma", "rms"]] = np.nan
        return frame[[unknown.kind != END for unknown in unknowns]].reset_index(drop=True)

    @cached_property
    def correlations(self) -> pd.DataFrame:
        """Absolute correlations of each flight: lever arm z, focal length, camera height.

        Columns flight, view, arm_f; height_arm, height_f: mean over the images; the same with
        _std: their spread; sigma_height, sigma_arm (m), sigma_f (px) beside them, since the
        coefficient alone hides how large either error is. NaN where one is held.
        Source: Zhou 2019, table 5.3 (of what the adjustment states).
        """
        net, images = self.network, self.network.images
        stated, q = self._moments.stated, len(net.labels)
        across = net.heights_with(self._known.parts[0])
        variance = net.heights
        if self._gain is not None:
            # Every control point belongs to a part of the quantities that was solved for.
            to_points = np.concatenate(
                [net.heights_with(part) for part in self._known.parts], axis=1
            )[:, self._rows]
            across = across - to_points @ self._gain[:q].T
            variance = variance - np.einsum(
                "ic,cd,id->i", to_points, self._inverse, to_points, optimize=True
            )
        height = np.sqrt(np.maximum(variance, 0.0))
        sigma = np.sqrt(np.diag(stated)[:q])
        labels = {label: n for n, label in enumerate(net.labels) if n not in net.held}
        rows = []
        for g, flight in enumerate(images.flight_names):
            mine = np.flatnonzero(images.flight == g)
            camera = images.camera_names[images.camera[mine[0]]]
            arm = labels.get(f"lever_arm.{flight}.z")
            focal = labels.get(f"camera.{camera}.f")
            row = {"flight": flight, "view": self.network.views[flight], "arm_f": np.nan}
            if arm is not None and focal is not None:
                row["arm_f"] = abs(stated[arm, focal]) / sigma[arm] / sigma[focal]
            for name, n in (("arm", arm), ("f", focal)):
                values = np.full(len(mine), np.nan)
                if n is not None:
                    values = np.abs(across[mine, n]) / height[mine] / sigma[n]
                row[f"height_{name}"] = values.mean()
                row[f"height_{name}_std"] = values.std(ddof=1) if len(values) > 1 else 0.0
            row["sigma_height"] = float(np.sqrt(np.mean(variance[mine])))
            row["sigma_arm"] = np.nan if arm is None else sigma[arm]
            row["sigma_f"] = np.nan if focal is None else sigma[focal]
            rows.append(row)
        frame = pd.DataFrame(rows)
        if self.open:
            frame.iloc[:, 2:] = np.nan
        return frame

    def carried(self, arms: Mapping[str, str] | None = None, held: bool = False) -> Carried:
        """Camera and lever arms as this adjustment leaves them, for another flight set.

        arms: flight there -> flight here that was mounted alike; only those are carried over.
        held: hold the values there, in place of estimating them with these as prior.
        The errors are those under this planner's noise; a constant bias is the same in both.
        Raises InputError for a flight that is not here, and where nothing was estimated.
        """
        if self.open:
            raise InputError(f"nothing to carry over: {self.open}")
        labels = self.network.labels
        take = {label: label for label in labels if label.startswith("camera.")}
        for there, here in (arms or {}).items():
            for axis in "xyz":
                label = f"lever_arm.{here}.{axis}"
                if label not in labels:
                    raise InputError(
                        f"flight {here} has no lever arm to carry over: flights are "
                        f"{', '.join(self.network.images.flight_names)}"
                    )
                take[f"lever_arm.{there}.{axis}"] = label
        if not take:
            raise InputError("nothing to carry over: camera and lever arms are held")
        rows = np.array([labels.index(label) for label in take.values()])
        at = np.ix_(rows, rows)
        common = self._moments.transfer[rows].reshape(len(rows), -1, 3)
        error = self._moments.error[at]
        transfer = common.sum(axis=1)
        if self._known.noise.bias_per == "flight":
            # Of other flights: nothing in common with those that take the camera over.
            error = self._moments.rms(self._known.bias)[at]
            transfer = np.zeros_like(transfer)
        return Carried(tuple(take), self._moments.stated[at], error, transfer, held)

    def __repr__(self) -> str:
        what = ", ".join(self.control) or "no control"
        if self.open:
            return f"Expected of {self.network.plan.name} with {what}: {self.open}"
        return (
            f"Expected of {self.network.plan.name} with {what}: xy {millimetres(self.xy)}, "
            f"z {millimetres(self.z)}"
        )

    def summary(self) -> dict:
        """One row of a table: accuracy (m), sigmas, correlations, transfer of a GNSS bias.

        arm_z, sigma_f, arm_f, height_arm, height_f: of the nadir flights (of all where there is
        none), averaged.
        """
        table = self.correlations
        if (table["view"] == "nadir").any():
            table = table[table["view"] == "nadir"]
        views = list(self.network.views.values())
        return {
            "flights": self.network.plan.name,
            "nadir": views.count("nadir"),
            "oblique": views.count("oblique"),
            "images": len(self.network.block.images),
            "control": len(self.control),
            "points": " ".join(self.control),
            "xy": self.xy,
            "z": self.z,
            "d3": self.d3,
            "stated_xy": self.stated.xy,
            "stated_z": self.stated.z,
            "sigma_f": table["sigma_f"].mean(),
            "sigma_arm_z": table["sigma_arm"].mean(),
            "arm_f": table["arm_f"].mean(),
            "height_arm": table["height_arm"].mean(),
            "height_f": table["height_f"].mean(),
            **dict(zip(("transfer_x", "transfer_y", "transfer_z"), self.transfer, strict=True)),
            "open": self.open,
        }


def _accuracy(variance: np.ndarray) -> Parts:
    mean = variance.reshape(-1, 3).mean(axis=0)
    return Parts(*np.sqrt([mean[0] + mean[1], mean[2], mean.sum()]).tolist())
