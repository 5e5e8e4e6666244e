"""Parameters of an adjustment, each with its value, standard deviation, unit and prior."""

from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, fields

import numpy as np
import pandas as pd

from corridor.core.adjustment.model import ParameterId


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
