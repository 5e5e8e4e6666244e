"""Sums over the entries of a covariance that each of many functions touches."""

import numpy as np

from corridor.compiled import compiled


@compiled(nogil=True, error_model="numpy", fastmath={"contract"})
def quadratic_forms(start, column, value, place, matrix, out):
    """Adds s' Q s of sparse rows s to out (r,).

    start, column, value: rows in compressed storage; place: where a column stands in matrix, its
    part of Q.
    """
    for r in range(len(out)):
        total = 0.0
        for a in range(start[r], start[r + 1]):
            i = place[column[a]]
            part = 0.5 * value[a] * matrix[i, i]
            for b in range(start[r], a):
                part += value[b] * matrix[i, place[column[b]]]
            total += 2.0 * value[a] * part
        out[r] += total


def variances(rows, solve, most: int = 40_000_000) -> np.ndarray:
    """s' Q s (r,) of sparse rows (r, n); solve(right) gives Q right.

    most: numbers of Q to hold at a time. Rows are taken in the order of the unknowns they touch,
    so that each piece of Q serves many of them.
    """
    rows = rows.tocsr()
    rows.sort_indices()
    n, out = rows.shape[1], np.zeros(rows.shape[0])
    # Where images are ordered along the corridor, neighbours touch the same unknowns.
    order = np.argsort(_middle(rows), kind="stable")
    first = 0
    while first < len(order):
        touched = np.zeros(n, dtype=bool)
        last = first
        while last < len(order):
            r = order[last]
            new = touched.copy()
            new[rows.indices[rows.indptr[r] : rows.indptr[r + 1]]] = True
            if last > first and new.sum() * n > most:
                break
            touched, last = new, last + 1
        at = np.flatnonzero(touched)
        place = np.zeros(n, dtype=np.int64)
        place[at] = np.arange(len(at))
        matrix = _columns(solve, at, n)
        some = order[first:last]
        part = rows[some]
        found = np.zeros(len(some))
        quadratic_forms(part.indptr, part.indices, part.data, place, matrix, found)
        out[some] = found
        first = last
    return out


def _columns(solve, at: np.ndarray, n: int, chunk: int = 600) -> np.ndarray:
    """Q[at, at]."""
    out = np.empty((len(at), len(at)))
    for first in range(0, len(at), chunk):
        some = at[first : first + chunk]
        unit = np.zeros((n, len(some)))
        unit[some, np.arange(len(some))] = 1.0
        out[:, first : first + len(some)] = solve(unit)[at]
    return out


def _middle(rows) -> np.ndarray:
    """Least unknown that each row touches."""
    out = np.zeros(rows.shape[0])
    filled = np.diff(rows.indptr) > 0
    out[filled] = rows.indices[rows.indptr[:-1][filled]]
    return out
