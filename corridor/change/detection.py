"""What could be seen, before any change is asked for: the level of detection as a map."""

from __future__ import annotations

import os

from corridor import adjustment, simulation
from corridor.adjustment import Adjustment, Model
from corridor.block import Block, read
from corridor.change.comparison import Comparison
from corridor.change.cores import make_cores
from corridor.change.epochs import clouds
from corridor.change.joint import Joint
from corridor.change.surface import SurfaceChange, surface_change
from corridor.simulation import Plan, read_plan, ready_made


def detection(
    what: Block | Adjustment | Plan | str | os.PathLike,
    model: Model | None = None,
    *,
    seed: int = 0,
    **options,
) -> SurfaceChange:
    """Levels of detection of two flights like this one; every distance is zero.

    what: a block, its adjustment, or a plan that nobody has flown yet (a `Plan`, a `.toml` file, or
        names of ready-made plans joined by +), which is then simulated from the seed.
    options: of `Comparison`. Raises InputError for what is none of these.
    """
    asked = Comparison(**options)
    one = what
    if not isinstance(what, Adjustment):
        one = adjustment.adjust(_block(what, seed), model=model)
    first, second = clouds(one, one, asked.same_ties, asked.rays)
    joint = Joint(first, second, asked.common, asked.bias)
    cores = make_cores(
        first.xyz, second.xyz, asked.spacing, asked.radius, asked.normal, asked.profile
    )
    return surface_change(joint, cores, degree=asked.degree, sampled=not asked.same_ties)


def _block(what, seed: int) -> Block:
    if isinstance(what, Plan):
        return simulation.simulate(what, seed=seed)
    if isinstance(what, Block):
        return what
    text = os.fspath(what)
    if text.endswith(".toml") or set(text.split("+")) <= set(ready_made()):
        return simulation.simulate(read_plan(text), seed=seed)
    return read(text)
