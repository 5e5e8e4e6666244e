"""The accuracy of a flight before it is flown: from covariances, without a draw."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from corridor.core.adjustment import Model
from corridor.core.effects import Effect
from corridor.core.errors import InputError
from corridor.core.options import made, options
from corridor.core.simulation import Plan, read_plan
from corridor.tools.planning.conditioning import Moments
from corridor.tools.planning.expected import Expected, Known
from corridor.tools.planning.network import Carried, Network, Quantities
from corridor.tools.planning.noise import GnssNoise, unit_bias
from corridor.tools.planning.surveyed import Surveyed

Control = int | Sequence[str | tuple[float, float]]


@dataclass(frozen=True)
class Believed:
    """What is known of a planned flight, and what its adjustment will estimate: see `Planner`."""

    camera: str | Mapping[str, str] | None = None
    lever_arm: str = "free"
    effects: Iterable[str | Effect] = ()
    priors: Mapping[str, float] | None = None
    model: Model | None = None
    carried: Carried | None = None
    noise: GnssNoise | None = None
    surveyed: Surveyed | None = None
    seed: int = 0

    def as_model(self) -> Model:
        """The same as a `Model`. Raises InputError where a model and other options are given."""
        known = {name: (0.0, sigma) for name, sigma in (self.priors or {}).items()}
        told = {"camera": self.camera, "effects": self.effects, "priors": known}
        # Where nothing is said the arms are free; a model says what it means.
        if self.model is None or self.lever_arm != "free":
            told["lever_arm"] = self.lever_arm
        return made(Model, self.model, told, "model")


class Planner:
    """The expected accuracy of a plan with any set of control points.

    planner = Planner("thesis_s2_n50+thesis_s2_o50")
    print(planner.expect(control=1))
    planner.expect(control=["L4", (310.0, -12.0)]).z

    plan: a `Plan`, a `.toml` file, or names of ready-made plans joined by +. Its `[noise]` states
        the sigmas that the adjustment will work with (where it says nothing, those of a block).
    camera: free parameters as of `corridor.adjust`, `fixed` for a pre-calibrated camera.
    lever_arm: `free` or `fixed`. carried: camera and arms of another flight set
        (`Expected.carried`), as prior or held.
    effects, priors: estimated with the rest, of the antenna only: `["gnss_bias"]`,
        `{"gnss_bias.z": 0.05}` (standard deviations).
    model: a `Model` in place of camera, lever_arm, effects and priors; control is asked for later.
    noise: the true errors of the GNSS, where they are not what the plan states.
    surveyed: candidates and check points; default: `Surveyed.grid(plan)`.
    seed: of the perfect block. seconds: what the set-up took.

    Setting up solves the network once; a control set is then a matter of a millisecond.
    Raises InputError for a plan that cannot be flown, or leaves a parameter undetermined.
    """

    @options(believed=Believed)
    def __init__(self, plan: Plan | str | os.PathLike, *, believed: Believed):
        began = time.perf_counter()
        self.plan = plan if isinstance(plan, Plan) else read_plan(plan)
        surveyed = believed.surveyed or Surveyed.grid(self.plan)
        self.network = net = Network(
            self.plan, surveyed, believed.as_model(), believed.carried, believed.seed
        )
        self.surveyed, self.block = net.surveyed, net.block
        self._noise = believed.noise or GnssNoise()
        names = list(self.surveyed.names)
        xyz = net.block.ground[["x", "y", "z"]].to_numpy(float)
        where = np.column_stack([self.surveyed.station, self.surveyed.across])
        self._known = self._knowing(names, where, xyz, [net.shared, net.points(names, xyz)])
        self.seconds = time.perf_counter() - began

    def __repr__(self) -> str:
        return (
            f"Planner of {self.plan.name}: {len(self.block.images)} images, "
            f"{np.sum(~self.surveyed.check)} candidates and {np.sum(self.surveyed.check)} check "
            "points"
        )

    # --- the noise ----------------------------------------------------------------------------

    @property
    def noise(self) -> GnssNoise:
        """The true errors of the GNSS; another one may be set, the network stays as it is."""
        return self._noise

    @noise.setter
    def noise(self, noise: GnssNoise) -> None:
        self._noise, known = noise, self._known
        self._known = self._knowing(known.names, known.where, known.xyz, known.parts)

    def _knowing(self, names, where, xyz, parts: list[Quantities]) -> Known:
        shared = parts[0].solved.shape[1]
        moments = self._moments_of(parts)
        first = shared + 3 * np.arange(len(names))
        bias = self._bias_of(moments)
        return Known(names, where, xyz, first, parts, moments, bias, self._noise)

    def _moments_of(self, parts: list[Quantities]) -> Moments:
        net = self.network
        rows = [part.rows for part in parts]
        stated = np.block([[row @ part.solved for part in parts] for row in rows])
        at = 0
        for part in parts:
            span = slice(at, at + len(part.own))
            stated[span, span] += part.own
            at += len(part.own)
        stated = 0.5 * (stated + stated.T)
        response = np.concatenate([net.gnss_response(part) for part in parts])
        carried = np.concatenate([net.carried_response(part) for part in parts])
        flight, error = net.gnss_flight, stated.copy()
        if len(flight):
            time = net.images.time[net.gnss.image]
            error += self.noise.excess(response, net.gnss.sigma, time, flight)
        # The prior of a bias stands for a bias; it is counted once, as what the GNSS does.
        for column in self._bias_priors:
            error -= net.prior_weight[column] * np.outer(stated[:, column], stated[column])
        transfer = unit_bias(response, flight)
        if net.carried is not None:
            error += carried @ (net.carried.error - net.assumed) @ carried.T
            transfer = np.concatenate([transfer, (carried @ net.carried.transfer)[:, None]], axis=1)
        return Moments(stated, error, transfer.reshape(len(transfer), -1))

    @property
    def _bias_priors(self) -> list[int]:
        """Columns of the biases of the GNSS that are estimated with a prior."""
        net = self.network
        return [column for column in net.biases if net.prior_weight[column] > 0]

    def _bias_of(self, moments: Moments) -> np.ndarray:
        net, one = self.network, self.noise.bias_moment
        groups = moments.transfer.shape[1] // 3
        if one is not None:
            alike = np.ones((groups, groups)) if self.noise.bias_per == "block" else np.eye(groups)
            return np.kron(alike, one)
        out = np.zeros((3 * groups, 3 * groups))
        with_gnss = np.unique(net.gnss_flight)
        for column in self._bias_priors:
            axis, flights = net.biases[column]
            moved = np.zeros((groups, 3))
            moved[: len(with_gnss), axis] = np.isin(with_gnss, flights)
            # What is carried over comes from the same base station, where all flights share one.
            moved[len(with_gnss) :, axis] = len(flights) == len(with_gnss)
            out += np.outer(moved, moved) / net.prior_weight[column]
        return out

    # --- control ------------------------------------------------------------------------------

    @property
    def candidates(self) -> pd.DataFrame:
        """Points that may serve as control: point, station, across (m)."""
        return self._known.table(np.flatnonzero(~self.surveyed.check))

    def spread(self, count: int) -> list[str]:
        """Names of so many candidates, spread evenly from end to end on alternating banks.

        One alone lies in the middle, as near the axis as can be: from a bank it would take the
        block's roll for height. Raises InputError where there are not so many candidates.
        """
        rows, station = self._along
        if not 0 <= count <= len(rows):
            raise InputError(
                f"{count} control points are wanted, and there are {len(rows)} candidates: "
                "give more stations"
            )
        names, stations = self.surveyed.names, np.unique(station)
        if count > len(stations):
            return [
                names[rows[k]] for k in np.round(np.linspace(0, len(rows) - 1, count)).astype(int)
            ]
        if count == 1:
            here = rows[station == stations[(len(stations) - 1) // 2]]
            return [names[here[np.argmin(np.abs(self.surveyed.across[here]))]]]
        chosen = stations[np.round(np.linspace(0, len(stations) - 1, count)).astype(int)]
        return [names[rows[station == s][-1 if k % 2 else 0]] for k, s in enumerate(chosen)]

    @cached_property
    def _along(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the candidates along the corridor, from left to right, and their stations."""
        points = self.surveyed
        rows = np.flatnonzero(~points.check)
        rows = rows[np.lexsort((points.across[rows], points.station[rows]))]
        return rows, points.station[rows]

    def best(self, count: int) -> list[str]:
        """Names of so many candidates, each the one that helps most after those before (3D).

        Raises InputError where there are not so many candidates.
        """
        names: list[str] = []
        left = self.candidates["point"].tolist()
        for _ in self.spread(count):
            tried = [self.expect([*names, name]) for name in left]
            error = [e.d3 if np.isfinite(e.d3) else e.loose for e in tried]
            names.append(left.pop(int(np.argmin(error))))
        return names

    def expect(self, control: Control = ()) -> Expected:
        """The expected accuracy with a set of control points.

        control: how many, spread evenly; or names of surveyed points and positions (station,
        across), metres, in any mixture. A check point that is named controls and checks no more.
        Raises InputError for a name that nobody knows, and a place that no two images show.
        """
        asked = self.spread(control) if isinstance(control, int | np.integer) else control
        known, names = self._known, []
        places = {}
        for name in asked:
            if not isinstance(name, str):
                place = _position(name)
                name = f"({place[0]:g}, {place[1]:g})"
                places[name] = place
            elif name not in known.names:
                raise InputError(
                    f"point {name} is not seen in two images: take another"
                    if name in self.network.unseen
                    else f"no point {name} could be surveyed: there are "
                    f"{', '.join(self.candidates['point'])}, or give (station, across)"
                )
            names.append(name)
        if places:
            where = np.array(list(places.values()))
            xyz = self.network.place(*where.T)
            parts = [*known.parts, self.network.points(list(places), xyz)]
            where, xyz = np.concatenate([known.where, where]), np.concatenate([known.xyz, xyz])
            known = self._knowing([*known.names, *places], where, xyz, parts)
        names = list(dict.fromkeys(names))
        points = np.array([known.names.index(name) for name in names], dtype=np.int64)
        return Expected(self.network, known, tuple(names), points)


def _position(given) -> tuple[float, float]:
    try:
        station, across = (float(number) for number in given)
    except (TypeError, ValueError):
        station = across = np.nan
    if not np.isfinite([station, across]).all():
        raise InputError(f"{given!r} is not a point: give a name or (station, across)")
    return station, across


def subset(plan: Plan, flights: Sequence[str]) -> Plan:
    """The plan with some of its flights only, in its own order, named after them."""
    kept = tuple(flight for flight in plan.flights if flight.name in flights)
    return replace(plan, name="+".join(flight.name for flight in kept), flights=kept)
