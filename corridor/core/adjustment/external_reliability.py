"""What an error of control that is not found does to the points: how much, and where.

With a' x = l the equation of one coordinate of control (its point, and what images share), N the
equations of everything and s its standard deviation, an error e of l moves the unknowns by

    dx = N^-1 a e / s^2        or, correlated with others, by N^-1 sum of a_j W_ji e

of which the points follow (`regression`): dp_i = [i = j] V_j^-1 e_k e / s^2 - K_i' dx.
Source: Baarda 1968 (external reliability); Triggs et al. 2000, section 6.
"""

import numpy as np
import pandas as pd
from scipy.sparse import block_diag, csr_array

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.regression import point_regression
from corridor.core.output import with_units

# Points that are looked at: an even choice of a river's. Errors whose effects are held together.
MOST_POINTS, ERRORS_AT_ONCE = 20_000, 48


def moves(covariance: Covariance, controls: np.ndarray, errors: np.ndarray) -> pd.DataFrame:
    """Where errors of control move the points most: columns plan, height (m, the largest anywhere)
    and at (point where the length is largest), x, y, z (m) and moved (m) there.

    controls (c,): numbers of the control points; errors (3 c,), m; no row is made of an infinite
    one but NaN.
    """
    system = covariance.system
    p = system.problem
    every = p.point_index
    count = len(every)
    seen = np.union1d(np.arange(0, count, max(-(-count // MOST_POINTS), 1)), controls)
    names = every[seen]
    regression = point_regression(system, seen)
    place = np.searchsorted(seen, controls)
    given = p.control[controls]
    at = (3 * given[:, None] + np.arange(3)).ravel()
    turn = p.control_turn[given]
    # Along the axes, whatever is correlated.
    rows = system.control.jacobian[at]
    if len(turn):
        rows = csr_array(block_diag(list(np.linalg.inv(turn)), format="csr") @ rows)
    columns = (3 * place[:, None] + np.arange(3)).ravel()
    weight = turn.transpose(0, 2, 1) @ (p.control_weight[given][:, :, None] * turn)
    out = []
    for first in range(0, len(columns), ERRORS_AT_ONCE):
        some = slice(first, first + ERRORS_AT_ONCE)
        # What a coordinate of control sees of the unknowns: by itself, and through its point.
        by = (rows[some].T - regression.gain[:, columns[some]]).toarray()
        shift = -(regression.gain.T @ covariance.solve(by)).reshape(len(seen), 3, -1)
        own = columns[some]
        at = np.arange(len(own))
        shift[own // 3, :, at] += regression.own[own // 3, :, own % 3]
        # W e: an error of one coordinate counts for those that are correlated with it, too.
        heavy = weight[first // 3 : (first + len(own)) // 3]
        shift = np.einsum("nakj,kji->naki", shift.reshape(*shift.shape[:2], -1, 3), heavy)
        shift = shift.reshape(*shift.shape[:2], -1)
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
