"""Photographs of several folders, whose cameras may have clocks of their own."""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss import DAY_S, Exposures, days_between


def on_one_clock(parts: Sequence[Exposures]) -> Exposures:
    """The exposures of several folders as one, from the day of the first on.

    Raises InputError where their clocks are not of one time system.
    """
    first, systems = parts[0], sorted({part.time_system or "not named" for part in parts})
    if len(parts) == 1:
        return first
    if len(systems) > 1:
        raise InputError(
            f"the photographs lie in {len(parts)} folders, and their times are in different "
            f"systems ({', '.join(systems)})"
        )
    later = [DAY_S * days_between(first.day or "", part.day or "") for part in parts]
    tables = [part.table.assign(time_s=part.table["time_s"] + s)
              for part, s in zip(parts, later, strict=True)]  # fmt: skip
    return replace(
        first,
        table=pd.concat(tables, ignore_index=True),
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        resolution_s=max(part.resolution_s or 0.0 for part in parts) or None,
    )
