"""Parameters of an adjustment, each with its value, standard deviation, unit and prior."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.adjustment.model import CAMERA, EFFECT, LEVER_ARM, ParameterId

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment


@dataclass(frozen=True)
class Found:
    """One parameter after the adjustment.

    value, sigma: in the unit; sigma is 0 where it was held. vary: whether it was estimated.
    prior: value and standard deviation that were given beforehand. start: where it began.
    """

    name: str
    value: float
    sigma: float
    unit: str
    vary: bool
    prior: tuple[float, float] | None
    start: float


class Parameters(Mapping):
    """Parameters of cameras, lever arms and effects by name: `camera.P1.f`, `focal.P1.f`.

    The group of an effect may be left out where there is only one.
    """

    def __init__(self, found: list[Found]):
        self._found = {one.name: one for one in found}

    def __getitem__(self, name: str) -> Found:
        if name in self._found:
            return self._found[name]
        which = ParameterId.parse(name)
        hit = [one for key, one in self._found.items() if which.means(ParameterId.parse(key))]
        if len(hit) != 1:
            raise KeyError(name)
        return hit[0]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __repr__(self) -> str:
        return self.to_frame().to_string()

    def _repr_html_(self) -> str:
        return self.to_frame().to_html()

    def to_frame(self) -> pd.DataFrame:
        """Table by name: value, sigma, unit, vary, prior, prior_sigma, start; NaN without prior."""
        columns = [field.name for field in fields(Found)]
        frame = pd.DataFrame([astuple(one) for one in self.values()], columns=columns)
        priors = [one.prior or (np.nan, np.nan) for one in self.values()]
        frame["prior"] = [value for value, _ in priors]
        frame.insert(columns.index("prior") + 1, "prior_sigma", [sigma for _, sigma in priors])
        return frame.set_index("name")


def parameters_of(adjustment: Adjustment) -> Parameters:
    """Every parameter of cameras, lever arms and effects; poses and points have tables."""
    p, start = adjustment.problem, adjustment.problem.start
    settings = p.model.settings_of(p.block)

    def found(which: ParameterId, value, sigma, unit, vary, begun) -> Found:
        given = [wish.prior for other, wish in settings.items() if other.means(which)]
        prior = next((prior for prior in given if prior is not None and vary), None)
        return Found(str(which), float(value), float(sigma), unit, bool(vary), prior, float(begun))

    out = []
    for row in adjustment.camera.itertuples(index=False):
        begun = p.block.cameras[row.camera][row.parameter]
        unit = row.unit
        which = ParameterId(CAMERA, row.camera, row.parameter)
        out.append(found(which, row.value, row.sigma, unit, row.free, begun))
    for row in adjustment.lever_arm.itertuples(index=False):
        g = p.images.flight_names.index(row.flight)
        for axis, name in enumerate("xyz"):
            which, sigma = ParameterId(LEVER_ARM, row.flight, name), getattr(row, f"s{name}")
            out.append(found(which, getattr(row, name), sigma, "m", sigma > 0, start.arms[g, axis]))
    for slug, one in adjustment.values.items():
        for k, parameter in enumerate(one.parameters):
            for g in np.flatnonzero(np.isfinite(one.value[:, k])):
                group = "block" if one.kind == "block" else one.groups[g]
                which = ParameterId(EFFECT, slug, parameter.name, group)
                value, sigma = one.value[g, k], one.sigma[g, k]
                begun = start.effects[slug][g, k]
                out.append(found(which, value, sigma, parameter.unit, sigma > 0, begun))
    return Parameters(out)
