"""How well each kind of observation fits, as a table whose columns bear their units."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

_METRES = ("rms_x_m", "rms_y_m", "rms_z_m")
_DEGREES = ("rms_roll_deg", "rms_pitch_deg", "rms_yaw_deg")
_COLUMNS = ("count", "outliers", "gross", "rms_px", *_METRES)


def observation_table(statistics: Mapping[str, Mapping]) -> pd.DataFrame:
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
