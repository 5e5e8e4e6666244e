"""What an error of control that is not found does to the points: how much, and where.

With a' x = l the equation of one coordinate of control (its point, and what images share), N the
equations of everything and s its standard deviation, an error e of l moves the unknowns by

    dx = N^-1 a e / s^2        or, correlated with others, by N^-1 sum of a_j W_ji e

of which the points follow (`regression`): dp_i = [i = j] V_j^-1 e_k e / s^2 - K_i' dx.
Source: Baarda 1968 (external reliability); Triggs et al. 2000, section 6.
"""

import numpy as np
import pandas as pd

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.regression import point_regression
from corridor.core.output import with_units

# Points that are looked at: an even choice of a river's.
MOST_POINTS = 20_000


def moves(covariance: Covariance, errors: np.ndarray) -> pd.DataFrame:
    """Where errors of control move the points most: columns plan, height (m, the largest anywhere)
    and at (point where the length is largest), x, y, z (m) and moved (m) there.

    errors (3 c,): of the control points, m; no row is made of an infinite one but NaN.
    """
    system, control = covariance.system, covariance.control
    p = system.problem
    every = p.point_index
    count = len(every)
    seen = np.union1d(np.arange(0, count, max(-(-count // MOST_POINTS), 1)), control.points)
    names = every[seen]
    regression = point_regression(system, seen)
    place = np.searchsorted(seen, control.points)
    turn, given = p.control_turn[: len(place)], p.control_weight[: len(place)]
    weight = turn.transpose(0, 2, 1) @ (given[:, :, None] * turn)
    out = []
    for some, known in covariance.with_control():
        mine = np.arange(some.start // 3, some.stop // 3)
        shift = -(regression.gain.T @ known).reshape(len(seen), 3, len(mine), 3)
        shift[place[mine], :, mine - mine[:1]] += control.own[mine]
        # W e: an error of one coordinate counts for those that are correlated with it, too.
        shift = (shift.transpose(2, 0, 1, 3) @ weight[mine][:, None]).transpose(1, 2, 0, 3)
        shift = shift.reshape(len(seen), 3, -1)
        shift *= np.where(np.isfinite(errors[some]), errors[some], np.nan)
        plan = np.hypot(shift[:, 0], shift[:, 1])
        length = np.hypot(plan, shift[:, 2])
        where = np.argmax(np.nan_to_num(length), axis=0)
        for k, row in enumerate(where.tolist()):
            found = length[row, k], plan[:, k].max(), np.abs(shift[:, 2, k]).max()
            out.append((str(names[row]), *covariance.state.points[seen[row]], *found))
    table = pd.DataFrame(out, columns=["at", "x", "y", "z", "moved", "plan", "height"])
    table = table.astype(dict.fromkeys(table.columns[1:], float))
    return with_units(table, {"m": "x y z moved plan height"})
