"""Tables that say what their columns are measured in.

Columns are called as in a block's files (`x`, `sx`, `dx`), so that tables can be joined with them;
the units stand beside: in the head when a table is shown, and in the names of a CSV file.
"""

from collections.abc import Mapping

import pandas as pd

KEY = "units"


class UnitTable(pd.DataFrame):
    """A table whose head shows units, as long as rows and columns are only chosen from it.

    What is computed from it is an ordinary table: no unit is claimed that may not hold.
    """

    @property
    def _constructor(self):
        return pd.DataFrame

    @property
    def units(self) -> dict[str, str]:
        """Column -> unit, of those that have one."""
        return {name: unit for name, unit in self.attrs[KEY].items() if name in self.columns}

    def __repr__(self) -> str:
        return repr(self._headed())

    def _repr_html_(self) -> str | None:
        return self._headed()._repr_html_()

    def _headed(self) -> pd.DataFrame:
        names = {name: f"{name} ({unit})" for name, unit in self.units.items()}
        return pd.DataFrame(self).rename(columns=names)

    def __getitem__(self, key):
        return _kept(super().__getitem__(key), self)

    def head(self, n: int = 5):
        return _kept(super().head(n), self)

    def tail(self, n: int = 5):
        return _kept(super().tail(n), self)

    def query(self, *args, **kwargs):
        return _kept(super().query(*args, **kwargs), self)

    def sort_values(self, *args, **kwargs):
        return _kept(super().sort_values(*args, **kwargs), self)

    def set_index(self, *args, **kwargs):
        return _kept(super().set_index(*args, **kwargs), self)


def with_units(table: pd.DataFrame, units: Mapping[str, str]) -> UnitTable:
    """The table with units: `{"m": "x y z", "rad": "s_rx"}`, each with its columns."""
    out = UnitTable(table)
    out.attrs = {KEY: {name: unit for unit, names in units.items() for name in names.split()}}
    return out


def _kept(chosen, table: UnitTable):
    """What was chosen from a table, with its units where it is a table."""
    if not isinstance(chosen, pd.DataFrame):
        return chosen
    out = UnitTable(chosen)
    out.attrs = {KEY: table.attrs[KEY]}
    return out


def named_with_units(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the unit in each column's name, `dx_m`: for a file, which has no head."""
    units = table.units if isinstance(table, UnitTable) else {}
    names = {name: f"{name}_{unit}" for name, unit in units.items()}
    return pd.DataFrame(table).rename(columns=names)
