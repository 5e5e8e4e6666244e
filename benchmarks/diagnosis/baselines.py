"""What others would say of the same block: residual correlation, and an expert by hand.

Each gives every named effect of the catalogue (each control point for itself) a number, the
larger the more it is believed in; the first is the answer, where it is beyond a limit that null
blocks set.

    correlation   multiple correlation coefficient of the residuals of the believed model with what
                  the effect would do to them, all in stated standard deviations
    bic           by how much the adjustment with the effect lowers n log(cost) + k log(n)
    t_test        largest of the effect's parameters over its standard deviation
    check_points  by which share the adjustment with the effect lowers the RMS of the check points

The last three are of one real, robust adjustment for each effect. Sources: Fraser 1997 for the
t-test of added parameters; Schwarz 1978, "Estimating the dimension of a model".
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from corridor.core.adjustment import Adjustment
from corridor.core.effects import Effect, Images, candidates, group_names, group_of_image, predict
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.system.groups import of_some

# Residuals beyond so many sigmas are taken for wrong matches.
OUTLYING = 3.0
METHODS = ("correlation", "bic", "t_test", "check_points")


def baselines(
    believed: ReferenceModel, before: Adjustment, only: Iterable[str] | None = None
) -> dict[str, dict[str, float]]:
    """Method -> effect -> number. before: adjustment of the believed model.

    only: slugs of the effects to be tried; default: all that can be tested.

    Effects of single control points are called `slug.point`.
    """
    system = before.system
    control = [str(name) for name in system.control_names]
    tested = candidates(believed.block, system.free, believed.effects, control).effects
    wanted = {effect.slug for effect in tested} if only is None else set(only)
    tested = [e for e in tested if not e.generic and e.slug in wanted]
    by_hand = _by_hand(believed, before, tested, control)
    return {"correlation": _correlations(before, tested), **by_hand}


# --- by hand ----------------------------------------------------------------------------------


def _by_hand(believed, before, tested, control) -> dict[str, dict[str, float]]:
    out: dict[str, dict[str, float]] = {"bic": {}, "t_test": {}, "check_points": {}}
    measured = before.system
    positions = len(measured.gnss.names) + len(control)
    count = 2 * len(measured.image_rows.image) + 3 * positions
    rms = before.check_rms.d3
    for effect in tested:
        for point in control if effect.group == "point" else [None]:
            key = effect.slug if point is None else f"{effect.slug}.{point}"
            try:
                after = believed.adjust([of_some(effect, [point]) if point else effect])
                table = after.effects[after.effects["slug"] == effect.slug]
            except (InputError, AdjustmentFailed):
                continue
            if point is not None:
                table = table[table["group"] == point]
            value, sigma = (table[name].to_numpy(float) for name in ("value", "sigma"))
            gain = count * math.log(before.cost / after.cost) - len(table) * math.log(count)
            t = np.abs(value[sigma > 0] / sigma[sigma > 0])
            out["bic"][key] = float(gain)
            out["t_test"][key] = float(t.max(initial=0.0))
            if rms > 0:
                out["check_points"][key] = float(1.0 - after.check_rms.d3 / rms)
    return out


# --- correlation ------------------------------------------------------------------------------


def _correlations(before: Adjustment, tested: list[Effect]) -> dict[str, float]:
    """Multiple correlation coefficient of the residuals with each effect's own shifts.

    Residuals of tie points, GNSS and control; those of more than three sigmas count as three.
    """
    block = before.block
    images = Images.of(block)
    points = list(block.ground.loc[block.ground["role"] == "control", "point"])
    still = predict(block)
    found = before.residuals["control"].set_index("point")[["vx", "vy", "vz"]]
    residual = (
        block.tie_points[["x", "y"]].to_numpy(float) - still.tie,
        block.gnss[["x", "y", "z"]].to_numpy(float) - still.gnss,
        found.reindex(points).to_numpy(float),
    )
    control = (block.ground["role"] == "control").to_numpy()
    weight = (
        1.0 / block.tie_sigma()[:, None], 1.0 / block.gnss_sigma(),
        1.0 / block.ground_sigma()[control],
    )  # fmt: skip
    limited = [
        np.clip(np.nan_to_num(r * w), -OUTLYING, OUTLYING)
        for r, w in zip(residual, weight, strict=True)
    ]
    size = math.sqrt(sum(float((r**2).sum()) for r in limited)) or 1.0
    of_image = block.image_rows("tie_points"), block.image_rows("gnss")
    out: dict[str, float] = {}
    for effect in tested:
        columns = [
            [
                np.nan_to_num((there - here) * w)
                for there, here, w in zip(_seen(moved), _seen(still), weight, strict=True)
            ]
            for parameter in effect.parameters(block)
            for moved in [predict(block, {effect.slug: {parameter.name: parameter.scale}})]
        ]
        names = group_names(images, effect.group, points)
        if effect.group == "point":
            group = [np.zeros(len(rows), dtype=int) for rows in of_image]
            group.append(np.arange(len(points)))
        else:
            each = group_of_image(images, effect.group)
            group = [*(each[rows] for rows in of_image), np.zeros(len(points), dtype=int)]
        square = _explained(columns, limited, group, len(names))
        if effect.group == "point":
            # What does not move is in the first group; control points have no share in it.
            out |= {
                f"{effect.slug}.{name}": math.sqrt(part) / size
                for name, part in zip(points, square, strict=True)
            }
        else:
            out[effect.slug] = math.sqrt(square.sum()) / size
    return out


def _seen(prediction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return prediction.tie, prediction.gnss, prediction.control


def _explained(columns, residual, group, count: int) -> np.ndarray:
    """Sum of squares (groups,) that the columns of each group explain of its rows' residuals."""
    size = len(columns)
    matrix, right = np.zeros((count, size, size)), np.zeros((count, size))
    for kind, of_row in enumerate(group):
        rows = np.stack([column[kind] for column in columns], axis=-1)
        np.add.at(matrix, of_row, np.einsum("nki,nkj->nij", rows, rows))
        np.add.at(right, of_row, np.einsum("nki,nk->ni", rows, residual[kind]))
    inverse = np.linalg.pinv(matrix, rcond=1e-10, hermitian=True)
    return np.maximum(np.einsum("ni,nij,nj->n", right, inverse, right), 0.0)
