"""What neither GNSS nor control determines: told from points that stay as loose as they were."""

import numpy as np

from corridor.core.adjustment import QUANTITIES
from corridor.core.geometry import helmert_motions
from corridor.tools.planning.network import LOOSE_M

# Points this loose are held by what was assumed of them, not by anything measured.
OPEN_M = 0.05 * LOOSE_M


def open_motions(covariance: np.ndarray, xyz: np.ndarray) -> list[str]:
    """Motions of the whole block that are open, in words; empty where the datum is complete.

    covariance (3 n, 3 n), m^2, of points (n, 3), m. A rotation about any axis counts as one about
    its direction, wherever it lies; positions count where the block can be moved without turning.
    """
    if np.trace(covariance) / len(xyz) < OPEN_M**2:
        return []
    motion = helmert_motions(xyz).reshape(-1, 7)
    motion /= np.linalg.norm(motion, axis=0)
    value, vector = np.linalg.eigh(covariance)
    loose = np.linalg.pinv(motion, rcond=1e-6) @ vector[:, value > 0.05 * value[-1]]
    _, size, across = np.linalg.svd(loose[3:])
    turns = int(np.sum(size > 0.1))
    still = loose[:3] @ across[turns:].T
    shift = np.linalg.norm(still, axis=1, ord=2) if still.size else np.zeros(3)
    turned = np.linalg.norm(loose[3:] @ across[:turns].T, axis=1)
    part = np.concatenate([shift, turned])
    return [QUANTITIES[k] for k in np.flatnonzero(part > 0.3 * max(part.max(), 1e-9))]


def sentence(words: list[str], control: int, gnss: int, arms_free: bool) -> str:
    """What is open, by what, and what to do."""
    what = " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
    by = [f"{control} control point{'s' * (control != 1)}" if control else "no control point"]
    by.append(f"{gnss} GNSS positions{' with free lever arms' * arms_free}" if gnss else "no GNSS")
    stay = "stay" if len(words) > 1 else "stays"
    return (
        f"{what[0].upper()}{what[1:]} of the block {stay} open with {' and '.join(by)}: "
        "plan more control points, GNSS, a strip beside the first, or a lever arm that is known"
    )
