"""Compiled loops: Kalman filter, smoother, and the regimes' forward-backward recursion.

One axis at a time. A row is an epoch or a time without observation (variance below zero).
x, P: state and covariance; h: what an observation sees of the state; S: innovation variance.
"""

import numpy as np

from corridor.core.engine.compiled import compiled
from corridor.core.gnss.interpolation.motion import MOTION

_OPTIONS = dict(nogil=True, error_model="numpy", fastmath={"contract"})


@compiled(**_OPTIONS)
def _driving(steps, u, gust, jerk, Q):
    """Q (d, d) becomes the covariance that gusts and jerks of these densities add in a step."""
    d = Q.shape[0]
    for i in range(d):
        for j in range(d):
            Q[i, j] = gust * steps.gust[u, i, j] + jerk * steps.jerk[u, i, j]


@compiled(**_OPTIONS)
def _predict(x, P, F, Q, kept, y, A):
    """x = F x, P = F P F' + Q; y (d,) and A (d, d) are work space.

    kept: what is left of the slow error, apart from its decay in F; its variance stays 1.
    """
    d = x.shape[0]
    for i in range(d):
        y[i] = 0.0
        for j in range(i, d):
            y[i] += F[i, j] * x[j]
    for i in range(d):
        x[i] = y[i]
        for j in range(d):
            s = 0.0
            for k in range(i, d):
                s += F[i, k] * P[k, j]
            A[i, j] = s
    for i in range(d):
        for j in range(i + 1):
            s = Q[i, j]
            for k in range(j, d):
                s += A[i, k] * F[j, k]
            P[i, j] = s
            P[j, i] = s
    if d > MOTION:
        x[MOTION] *= kept
        for i in range(d):
            P[i, MOTION] *= kept
            P[MOTION, i] *= kept
        P[MOTION, MOTION] += 1.0 - (kept * F[MOTION, MOTION]) ** 2


@compiled(**_OPTIONS)
def _update(x, P, seen, share, value, variance, g):
    """One scalar observation of state `seen` plus `share` of the slow error.

    Returns innovation and its variance; g (d,) becomes the gain.
    """
    d = x.shape[0]
    for i in range(d):
        g[i] = P[i, seen]
        if share != 0.0:
            g[i] += share * P[i, d - 1]
    S = variance + g[seen]
    v = value - x[seen]
    if share != 0.0:
        S += share * g[d - 1]
        v -= share * x[d - 1]
    for i in range(d):
        for j in range(i + 1):
            P[i, j] -= g[i] * g[j] / S
            P[j, i] = P[i, j]
    for i in range(d):
        g[i] /= S
        x[i] += g[i] * v
    return v, S


@compiled(**_OPTIONS)
def _observe(x, P, rows, k, g):
    """Updates x and P by what row k observes; its log-likelihood."""
    log = 0.0
    if rows.variance[k] >= 0:
        v, S = _update(x, P, 0, rows.share[k], rows.z[k], rows.variance[k], g)
        log -= 0.5 * (np.log(S) + v * v / S)
    if rows.v_variance[k] >= 0:
        v, S = _update(x, P, 1, 0.0, rows.vz[k], rows.v_variance[k], g)
        log -= 0.5 * (np.log(S) + v * v / S)
    return log


@compiled(**_OPTIONS)
def log_likelihoods(rows, start, steps, gusts, jerks, P0, out):
    """Adds to out (n, levels) the log-likelihood of each row under each level of motion noise.

    rows: z, vz: positions m, velocities m/s; variance, v_variance: of each, below zero where there
    is none; share: standard deviation of the slow error in each position; kept: what is left of it
    from the row before, decay in time apart. start: rows at which a new piece begins. steps: see
    `motion.Steps`. gusts, jerks: (levels,) densities. The first three rows of a piece, which only
    find the state, do not count.
    """
    n, d = rows.z.shape[0], steps.F.shape[1]
    x, g, y = np.zeros(d), np.zeros(d), np.zeros(d)
    P, A, Q = np.zeros((d, d)), np.zeros((d, d)), np.zeros((d, d))
    for level in range(gusts.shape[0]):
        age = 0
        for k in range(n):
            if start[k]:
                age = 0
                for i in range(d):
                    x[i] = 0.0
                    for j in range(d):
                        P[i, j] = P0[i, j]
                x[0] = rows.z[k]
            else:
                u = steps.which[k]
                _driving(steps, u, gusts[level], jerks[level], Q)
                _predict(x, P, steps.F[u], Q, rows.kept[k], y, A)
            age += 1
            log = _observe(x, P, rows, k, g)
            if age > 3:
                out[k, level] += log


@compiled(**_OPTIONS)
def smooth(rows, steps, gusts, jerks, P0, states, sigmas):
    """Fills states (n, d) and sigmas (n, d) of every row from all observations.

    gusts, jerks: (n,) densities of the step that leads to each row; else as `log_likelihoods`.
    The backward pass adds covariances and subtracts none, so that the wide start does no harm:
    P_k = (I - C F) P (I - C F)' + C (P_k+1 + Q) C',  C = P F' (F P F' + Q)^-1.
    """
    n, d = rows.z.shape[0], steps.F.shape[1]
    x, y, g = np.zeros(d), np.zeros(d), np.zeros(d)
    x[0] = rows.z[0]
    P, A, Q = P0.copy(), np.zeros((d, d)), np.zeros((d, d))
    filtered = np.zeros((n, d, d))
    for k in range(n):
        if k > 0:
            u = steps.which[k]
            _driving(steps, u, gusts[k], jerks[k], Q)
            _predict(x, P, steps.F[u], Q, rows.kept[k], y, A)
        _observe(x, P, rows, k, g)
        for i in range(d):
            states[k, i] = x[i]
            for j in range(d):
                filtered[k, i, j] = P[i, j]
    # From here on P is the smoothed covariance of row k + 1.
    E, L, C, B = np.zeros((d, d)), np.zeros((d, d)), np.zeros((d, d)), np.zeros((d, d))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            u = steps.which[k + 1]
            _driving(steps, u, gusts[k + 1], jerks[k + 1], Q)
            for i in range(d):
                for j in range(d):
                    E[i, j] = steps.F[u, i, j]
            if d > MOTION:
                E[MOTION, MOTION] *= rows.kept[k + 1]
                Q[MOTION, MOTION] = 1.0 - E[MOTION, MOTION] ** 2
            now = filtered[k]
            _product(E, now, A)
            _product(A, E.T, B)
            for i in range(d):
                for j in range(d):
                    B[i, j] += Q[i, j]
            _cholesky(B, L)
            for i in range(d):
                # A is F P, so its columns are those of P F', row by row.
                for j in range(d):
                    y[j] = A[j, i]
                _solve(L, y)
                for j in range(d):
                    C[i, j] = y[j]
            for i in range(d):
                s = 0.0
                for j in range(i, d):
                    s += E[i, j] * states[k, j]
                g[i] = states[k + 1, i] - s
            for i in range(d):
                s = 0.0
                for j in range(d):
                    s += C[i, j] * g[j]
                    P[i, j] += Q[i, j]
                states[k, i] += s
            _product(C, P, A)
            _product(A, C.T, P)
            _product(C, E, A)
            for i in range(d):
                for j in range(d):
                    A[i, j] = (1.0 if i == j else 0.0) - A[i, j]
            _product(A, now, B)
            _product(B, A.T, L)
            for i in range(d):
                for j in range(d):
                    P[i, j] += L[i, j]
            for i in range(d):
                for j in range(i):
                    P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
        for i in range(d):
            sigmas[k, i] = np.sqrt(P[i, i])


@compiled(**_OPTIONS)
def _product(A, B, out):
    """out = A B."""
    d = A.shape[0]
    for i in range(d):
        for j in range(d):
            s = 0.0
            for k in range(d):
                s += A[i, k] * B[k, j]
            out[i, j] = s


@compiled(**_OPTIONS)
def _cholesky(A, L):
    """L L' = A; a direction without variance gets none back (its pivot is infinite)."""
    d = A.shape[0]
    for i in range(d):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = s / L[j, j]
            else:
                L[i, i] = np.sqrt(s) if s > 1e-15 * A[i, i] else np.inf


@compiled(**_OPTIONS)
def _solve(L, y):
    """y becomes (L L')^-1 y."""
    d = y.shape[0]
    for i in range(d):
        for k in range(i):
            y[i] -= L[i, k] * y[k]
        y[i] /= L[i, i]
    for i in range(d - 1, -1, -1):
        for k in range(i + 1, d):
            y[i] -= L[k, i] * y[k]
        y[i] /= L[i, i]


@compiled(**_OPTIONS)
def forward_backward(logs, stay, jump, weights):
    """Probability of each level at each row, and the log-likelihood of all rows.

    logs: (n, levels) log-likelihood of a row under each level; stay: (n,) probability that the
    level has not been drawn anew since the row before; jump: (levels, levels) where it goes.
    weights (n, levels) is filled. Returns the log-likelihood.
    Source: Rabiner, A tutorial on hidden Markov models, 1989, section III.
    """
    n, m = logs.shape
    total = 0.0
    for k in range(n):
        top = logs[k, 0]
        for j in range(1, m):
            top = max(top, logs[k, j])
        c = 0.0
        for j in range(m):
            a = 1.0 / m
            if k > 0:
                a = 0.0
                for i in range(m):
                    a += weights[k - 1, i] * jump[i, j]
                a = stay[k] * weights[k - 1, j] + (1.0 - stay[k]) * a
            weights[k, j] = a * np.exp(logs[k, j] - top)
            c += weights[k, j]
        for j in range(m):
            weights[k, j] /= c
        total += np.log(c) + top
    back, new = np.ones(m), np.ones(m)
    for k in range(n - 2, -1, -1):
        top = logs[k + 1, 0]
        for j in range(1, m):
            top = max(top, logs[k + 1, j])
        for j in range(m):
            back[j] *= np.exp(logs[k + 1, j] - top)
        c = 0.0
        for i in range(m):
            a = 0.0
            for j in range(m):
                a += jump[i, j] * back[j]
            new[i] = stay[k + 1] * back[i] + (1.0 - stay[k + 1]) * a
            c += new[i]
        s = 0.0
        for i in range(m):
            back[i] = new[i] / c
            weights[k, i] *= back[i]
            s += weights[k, i]
        for i in range(m):
            weights[k, i] /= s
    return total
