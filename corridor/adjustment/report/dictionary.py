"""The report for other programs: the content of `adjustment.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_MOST_GROUPS = 50


def as_dict(adjustment: Adjustment) -> dict[str, Any]:
    """The content of `adjustment.json`: finite numbers or None.

    An effect with one group is {parameter: {value, sigma, unit}}, with several
    {group: {parameter: ...}}; of more than 50 groups there is a summary for each parameter
    and, in a saved folder, a table `effect_SLUG.csv`.
    """
    check = {
        name: {"xy": found.xy, "z": found.z, "3d": found.d3}
        for name, found in (
            ("rms", adjustment.check_rms),
            ("mean", adjustment.check_mean),
            ("std", adjustment.check_std),
        )
    }
    camera: dict[str, dict] = {}
    for row in adjustment.camera.itertuples(index=False):
        camera.setdefault(str(row.camera), {})[str(row.parameter)] = {
            "value": row.value,
            "sigma": row.sigma,
        }
    lever_arm = {
        str(row.flight): {
            axis: {"value": getattr(row, axis), "sigma": getattr(row, f"s{axis}")} for axis in "xyz"
        }
        for row in adjustment.lever_arm.itertuples(index=False)
    }
    names, _ = adjustment.correlation_matrix
    return _clean(
        {
            "block": adjustment.block.name,
            "converged": bool(adjustment.converged),
            "iterations": adjustment.iterations,
            "seconds": adjustment.seconds,
            "sigma0": adjustment.sigma0,
            "redundancy": adjustment.redundancy,
            "observations": adjustment.observations,
            "camera": camera,
            "effects": _effects_dict(adjustment.effects),
            "lever_arm": lever_arm,
            "check_points": {"rows": adjustment.check_points.to_dict(orient="records"), **check},
            "correlations": adjustment.correlations,
            "high_correlations": adjustment.high_correlations,
            "parameters": len(names),
            "warnings": adjustment.warnings,
        }
    )


def _effects_dict(frame: pd.DataFrame) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for slug, effect in frame.groupby("slug", sort=False) if len(frame) else ():
        if has_table(effect):
            made[str(slug)] = {
                str(name): {
                    "groups": len(part),
                    "mean": part["value"].mean(),
                    "std": part["value"].std(),
                    "min": part["value"].min(),
                    "max": part["value"].max(),
                    "sigma": part["sigma"].median(),
                    "unit": str(part["unit"].iloc[0]),
                    "table": effect_table(str(slug)),
                }
                for name, part in effect.groupby("parameter", sort=False)
            }
            continue
        by_group: dict[str, dict] = {}
        for row in effect.itertuples(index=False):
            by_group.setdefault(str(row.group), {})[str(row.parameter)] = {
                "value": row.value,
                "sigma": row.sigma,
                "unit": str(row.unit),
            }
        made[str(slug)] = next(iter(by_group.values())) if len(by_group) == 1 else by_group
    return made


def has_table(effect: pd.DataFrame) -> bool:
    """Whether an effect has too many groups for the dictionary, and gets a table of its own."""
    return effect["group"].astype(str).nunique() > _MOST_GROUPS


def effect_table(slug: str) -> str:
    """Name of the table of an effect with many groups."""
    return f"effect_{slug}.csv"


def _clean(value: Any) -> Any:
    """Plain Python values that JSON can hold; None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _clean(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _clean(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_clean(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if value is None or value is pd.NA:
        return None
    return str(value)
