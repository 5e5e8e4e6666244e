"""Which event of a receiver belongs to which photograph: by the rhythm of both series of times."""

import numpy as np

# So many events or photographs may be missing before or between the others, and are tried.
_MISSED, _PROBES = 20, 15
# Pairs that another shift has, too, decide nothing: so many more, and this share of the shorter.
_CLEARLY, _SHARE, _WHOLE = 3, 0.03, 0.9


def paired(one: np.ndarray, other: np.ndarray, within: float) -> np.ndarray | None:
    """Rows (k, 2) of two rising series of times that are the same moments; None: they do not tell.

    one (n,), other (m,): s, by two clocks that differ by a constant. within: how far moments may
    lie apart then, s. Series that go together as they stand are one; else the shift with the most
    pairs is taken where no other has nearly as many.
    """
    if len(one) == len(other) and np.ptp(one - other) <= 2 * within:
        return np.column_stack([np.arange(len(one))] * 2)
    reach = _MISSED + abs(len(one) - len(other))
    probes = np.unique(np.linspace(0, len(one) - 1, _PROBES).astype(int))
    shifts = np.unique([
        round(float(one[i] - other[j]) / within)
        for i in probes for j in range(max(0, i - reach), min(len(other), i + reach + 1))
    ])  # fmt: skip
    # A shift is known to `within`, and times that are printed coarsely do not scatter about one.
    wide = 2 * within
    counts = np.array([len(_pairs(one, other, shift * within, wide)) for shift in shifts])
    best = int(np.argmax(counts))
    rivals = counts[np.abs(shifts - shifts[best]) > 4]
    few = min(len(one), len(other))
    needed = max(_CLEARLY, _SHARE * few) + (rivals.max() if len(rivals) else 0)
    if counts[best] < max(needed, _WHOLE * few):
        return None
    rows = _pairs(one, other, shifts[best] * within, wide)
    apart = one[rows[:, 0]] - other[rows[:, 1]]
    return _pairs(one, other, float(apart.min() + apart.max()) / 2, within)


def _pairs(one: np.ndarray, other: np.ndarray, shift: float, within: float) -> np.ndarray:
    """Rows (k, 2) of moments that are each other's nearest and no further apart than `within`."""
    later = other + shift

    def nearest(times, among):
        at = np.clip(np.searchsorted(among, times), 1, len(among) - 1)
        return at - (times - among[at - 1] < among[at] - times)

    rows = np.arange(len(one))
    there = nearest(one, later)
    good = (np.abs(one - later[there]) <= within) & (nearest(later, one)[there] == rows)
    return np.column_stack([rows, there])[good]
