"""What an error of control that is not found does to the points: how much, and where.

With a' x = l the equation of one coordinate of control (its point, and what images share), N the
equations of everything and s its standard deviation, an error e of l moves the unknowns by

    dx = N^-1 a e / s^2

of which the points follow (`regression`): dp_i = [i = j] V_j^-1 e_k e / s^2 - K_i' dx.
Source: Baarda 1968 (external reliability); Triggs et al. 2000, section 6.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.regression import point_gains
from corridor.core.output import with_units

# Points that are looked at: an even choice of a river's. Errors whose effects are held together.
MOST, TOGETHER = 20_000, 48


def moves(covariance: Covariance, controls: np.ndarray, errors: np.ndarray) -> pd.DataFrame:
    """Where errors of control move the points most: columns plan, height (m, the largest anywhere)
    and at (point where the length is largest), x, y, z (m) and moved (m) there.

    controls (c,): numbers of the control points; errors (3 c,), m; no row is made of an infinite
    one but NaN.
    """
    system = covariance.system
    p = system.problem
    count = len(p.point_index)
    seen = np.union1d(np.arange(0, count, max(-(-count // MOST), 1)), controls)
    gains = point_gains(system, seen)
    place = np.searchsorted(seen, controls)
    rows = system.control.jacobian
    given = p.control[controls]
    rows = rows[(3 * given[:, None] + np.arange(3)).ravel()]
    columns = (3 * place[:, None] + np.arange(3)).ravel()
    weight = p.control_weight[given].ravel()
    out = []
    for first in range(0, len(columns), TOGETHER):
        some = slice(first, first + TOGETHER)
        # What a coordinate of control sees of the unknowns: by itself, and through its point.
        by = (rows[some].T - gains.gain[:, columns[some]]).toarray()
        shift = -(gains.gain.T @ covariance.solve(by)).reshape(len(seen), 3, -1)
        own = columns[some]
        at = np.arange(len(own))
        shift[own // 3, :, at] += gains.own[own // 3, :, own % 3]
        shift *= np.where(np.isfinite(errors[some]), errors[some], np.nan) * weight[some]
        plan = np.hypot(shift[:, 0], shift[:, 1])
        length = np.hypot(plan, shift[:, 2])
        where = np.argmax(np.nan_to_num(length), axis=0)
        for k, row in enumerate(where.tolist()):
            found = length[row, k], plan[:, k].max(), np.abs(shift[:, 2, k]).max()
            out.append((str(p.point_index[seen[row]]), *covariance.state.points[seen[row]], *found))
    table = pd.DataFrame(out, columns=["at", "x", "y", "z", "moved", "plan", "height"])
    table = table.astype(dict.fromkeys(table.columns[1:], float))
    return with_units(table, {"m": "x y z moved plan height"})
