"""A free network brought to ground points afterwards (absolute orientation).

Tie points alone are adjusted first; a similarity then takes the result to the ground points. They
position the block, and no more: what a tight control network would hide stays visible.
Source: Zhou 2019, section 4.2.2.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.adjustment.check_statistics import Checked
from corridor.core.adjustment.result import Adjustment
from corridor.core.block import values_of
from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.geometry import Similarity, similarity


@brief
@dataclass
class AbsoluteOrientation(Checked):
    """An adjustment seen in the frame of its ground points.

    similarity: from the adjusted frame to the ground points'. check_points: point, given x, y, z
    and adjusted minus given dx, dy, dz, metres. centre: (images, 3) of the cameras, metres.
    control_points: the same columns as check_points, of the points that it was laid on.
    """

    similarity: Similarity
    check_points: pd.DataFrame
    centre: np.ndarray
    control_points: pd.DataFrame

    @property
    def control_error(self) -> np.ndarray:
        """Distance (points,) of each of `control_points` from where it was given, metres."""
        return np.linalg.norm(values_of(self.control_points, "dx", "dy", "dz"), axis=1)


def lay_on_control(
    adjustment: Adjustment, control: Iterable[str] | None = None
) -> AbsoluteOrientation:
    """The adjustment laid on its control points by a similarity.

    control: ground points to lay it on; default: those with the role `control` in ground.csv,
    whether or not the adjustment itself used them. All other ground points are check points.
    Raises InputError where fewer than three of them are seen, or they lie on one line.
    """
    ground = adjustment.start.ground
    if control is None:
        used = ground["role"] == "control"
    else:
        control = list(control)
        used = ground["point"].isin(control)
        unknown = pd.Index(control).difference(pd.Index(ground["point"]), sort=False)
        if len(unknown):
            raise InputError(f"the block has no ground point {unknown[0]!r}: correct the name")
    found = adjustment.points[adjustment.points["kind"] == "mark"]
    at = pd.Index(found["point"]).get_indexer(ground["point"])
    xyz = values_of(found, *"xyz")
    adjusted = (
        np.where((at >= 0)[:, None], xyz[at], np.nan) if len(xyz) else np.full((1, 3), np.nan)
    )
    given = values_of(ground, *"xyz")
    if (used & (at >= 0)).sum() < 3:
        raise InputError(
            f"{adjustment.start.where('ground', 0)}: orienting a block needs three control "
            f"points, and images show {int((used & (at >= 0)).sum())}: give more the role control"
        )
    found = similarity(adjusted[used], given[used])

    def differences(rows):
        table = ground.loc[rows, ["point", "x", "y", "z"]].reset_index(drop=True)
        table[["dx", "dy", "dz"]] = found.apply(adjusted[rows]) - given[rows]
        return table

    check = ((ground["role"] != "unused") & ~used & (at >= 0)).to_numpy()
    centre = np.empty_like(adjustment.state.centre)
    centre[adjustment.problem.order] = adjustment.state.centre
    on = (used & (at >= 0)).to_numpy()
    return AbsoluteOrientation(found, differences(check), found.apply(centre), differences(on))
