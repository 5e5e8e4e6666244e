"""Start values from nothing, and ways down from them.

Gauss and Newton, Levenberg and Marquardt, dog leg, conjugate gradients: all take the same reduced
normal equations (points eliminated) from the package; only the step is theirs. The package's own
solver is another one: `corridor.core.adjustment.solving`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.linalg import cho_factor, cho_solve

import corridor
from corridor.core.adjustment import LinearSystem, Loss, Normal, initial, make_problem
from corridor.core.adjustment.adjusting import complete
from corridor.core.block import Block
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector, similarity
from corridor.core.geometry import rotation_from_quaternion as turned

MOST = 100
# A step that lowers the cost by less than this share of it, or promises no more, is the last.
ENOUGH = 1e-10


@dataclass
class Descent:
    """Costs after each step that was tried, the first one that of the start.

    products: of the matrix with a vector, where no matrix was factorised; refused: steps that
    raised the cost.
    """

    costs: list[float]
    refused: int = 0
    products: int = 0

    @property
    def steps(self) -> int:
        """Steps tried."""
        return len(self.costs) - 1


def unoriented(block: Block) -> Block:
    """What the images alone measured: no pose, position, velocity, ground point or start value."""
    out = block.copy()
    poses = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    moving = [name for name in ("vx", "vy", "vz", "wx", "wy", "wz") if name in out.images]
    out.images = out.images.drop(columns=moving).assign(**dict.fromkeys(poses, np.nan))
    for table in ("points", "gnss", "ground", "marks"):
        setattr(out, table, getattr(out, table).iloc[:0])
    return out


def from_a_pair(block: Block, straightened: bool) -> Block:
    """All poses and points, from the best pair of images, one image after the other.

    straightened: what is there is adjusted whenever it has grown by a quarter, as `adjust` does.
    """
    if straightened:
        return complete(block)
    return initial.complete(block, lambda part: None)


def off_by(block: Block, known: Block) -> np.ndarray:
    """(m,) distances of the cameras to known ones, m, after the best similarity."""
    here, there = (one.images[["x", "y", "z"]].to_numpy(float) for one in (block, known))
    return np.linalg.norm(similarity(here, there).apply(here) - there, axis=1)


def displaced(block: Block, metres: float, degrees: float, seed: int) -> Block:
    """The block with poses that are off by chance, and points intersected from them."""
    draw = np.random.default_rng(seed)
    out = block.copy()
    count = len(out.images)
    centre = out.images[["x", "y", "z"]].to_numpy(float)
    quaternion = out.images[["qw", "qx", "qy", "qz"]].to_numpy(float)
    turn = rotation_from_vector(np.radians(degrees) * draw.standard_normal((count, 3)))
    rotation = turn @ turned(quaternion)
    out.images[["x", "y", "z"]] = centre + metres * draw.standard_normal((count, 3))
    out.images[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(rotation)
    out.points = out.points.iloc[:0]
    return complete(out)


def descend(block: Block, way: Callable, **options) -> Descent:
    """Adjust a block by one of the ways below, at most `MOST` steps. options: as of `adjust`."""
    problem = make_problem(block, **options)
    normal = Normal(problem, Loss())
    system = LinearSystem(problem, problem.start)
    found = Descent([normal.cost_at(problem.start)[0]])
    memory: dict = {}
    while found.steps < MOST:
        cost = found.costs[-1]
        change = way(system, memory, found)
        state = system.following(change)
        reached, behind = normal.cost_at(state)
        better = behind == 0 and reached < cost
        promised = 2 * change @ system.right - change @ system.multiply(change[:, None])[:, 0]
        memory["gain"] = (cost - reached) / (0.5 * promised) if better else -1.0
        memory["accepted"] = better
        found.costs.append(reached if better else cost)
        found.refused += not better
        if better:
            system = system.at(state)
            if cost - reached < ENOUGH * cost:
                break
        elif memory.get("end") or 0.5 * promised < ENOUGH * cost:
            break
    return found


def gauss_newton(system: LinearSystem, memory: dict, found: Descent) -> np.ndarray:
    """The whole step, always; it ends where a step does not lower the cost."""
    memory["end"] = True
    return system.solve(system.right[:, None])[:, 0]


def _damping(memory):
    """Marquardt's rule: a tenth after a good step, ten times as much after a bad one."""
    damping = memory.get("damping", 1e-3)
    if "accepted" in memory:
        damping *= 0.1 if memory["accepted"] else 10.0
    memory["damping"] = damping
    memory["end"] = damping > 1e8
    return damping


def marquardt(system: LinearSystem, memory: dict, found: Descent) -> np.ndarray:
    """(N + damping diag N) x = t (Marquardt 1963)."""
    matrix = system.matrix.toarray()
    matrix[np.diag_indices_from(matrix)] *= 1 + _damping(memory)
    return cho_solve(cho_factor(matrix), system.right)


def dog_leg(system: LinearSystem, memory: dict, found: Descent) -> np.ndarray:
    """Along the slope to its lowest point, then towards Gauss and Newton, to a radius.

    Powell 1970; lengths in the norm of the diagonal of N. The radius follows what the last step
    gained of what it promised (Nocedal and Wright 2006, algorithm 4.1).
    """
    matrix, right = system.matrix.toarray(), system.right
    scale = np.sqrt(np.diag(matrix))
    full = cho_solve(cho_factor(matrix), right)
    radius = memory.get("radius", np.linalg.norm(scale * full) / 10)
    if "gain" in memory:
        gain, length = memory["gain"], memory["length"]
        if gain < 0.25:
            radius = length / 4
        elif gain > 0.75 and length > 0.99 * radius:
            radius *= 2
    memory["radius"] = radius
    slope = right / scale**2
    slope = slope * (right @ slope) / (slope @ matrix @ slope)
    size = {name: np.linalg.norm(scale * x) for name, x in (("full", full), ("slope", slope))}
    if size["full"] <= radius:
        change = full
    elif size["slope"] >= radius:
        change = slope * radius / size["slope"]
    else:
        a, b = scale * slope, scale * (full - slope)
        half, square = a @ b, b @ b
        part = (-half + np.sqrt(half**2 + square * (radius**2 - a @ a))) / square
        change = slope + part * (full - slope)
    memory["length"] = np.linalg.norm(scale * change)
    memory["end"] = memory["length"] < 1e-9
    return change


def conjugate_gradients(system: LinearSystem, memory: dict, found: Descent) -> np.ndarray:
    """Marquardt's equations solved to a tenth, without a factor (Agarwal et al. 2010).

    Preconditioned by the diagonal of N. What is left of the right side decides when to stop.
    """
    damping, right = _damping(memory), system.right
    diagonal = system.matrix.diagonal()
    change, left = np.zeros_like(right), right.copy()
    near = left / diagonal
    way, product = near.copy(), left @ near
    first = np.sqrt(product)
    while np.sqrt(product) > 0.1 * first:
        pushed = system.multiply(way[:, None])[:, 0] + damping * diagonal * way
        found.products += 1
        part = product / (way @ pushed)
        change, left = change + part * way, left - part * pushed
        near = left / diagonal
        product, before = left @ near, product
        way = near + product / before * way
    return change


WAYS: Mapping[str, Callable] = {
    "Gauss and Newton": gauss_newton,
    "Levenberg and Marquardt": marquardt,
    "dog leg": dog_leg,
    "conjugate gradients": conjugate_gradients,
}


def compared(block: Block, errors: Mapping[str, tuple[float, float]], seeds: int) -> pd.DataFrame:
    """How often each way arrives where the package does, and in how many steps (medians).

    errors: words -> metres and degrees by which the poses are off at the start.
    """
    best = corridor.adjust(block)
    least = Normal(make_problem(best.block), Loss()).cost_at(make_problem(best.block).start)[0]
    rows = []
    for words, (metres, degrees) in errors.items():
        starts = [displaced(best.block, metres, degrees, seed) for seed in range(seeds)]
        for name, way in WAYS.items():
            runs = [descend(start, way) for start in starts]
            there = [one for one in runs if one.costs[-1] < (1 + 1e-6) * least]
            steps = np.median([one.steps for one in there]) if there else np.nan
            products = np.median([one.products for one in there]) if there else np.nan
            rows.append([words, name, f"{len(there)} of {seeds}", steps, products])
    names = ["poses off by", "way", "arrive", "steps", "products with the matrix"]
    return pd.DataFrame(rows, columns=names).set_index(names[:2])
