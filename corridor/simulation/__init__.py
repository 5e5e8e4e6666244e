"""Blocks of corridor flights that nobody flew: from a flight plan, with the truth beside them."""

from corridor.simulation.fly import reach
from corridor.simulation.noise import add_noise
from corridor.simulation.plan import (
    CAMLIGHT,
    ORDINARY_NOISE,
    Flight,
    Ground,
    Noise,
    Plan,
    Start,
    Terrain,
    TiePoints,
    cameras,
    read_plan,
    ready_made,
)
from corridor.simulation.simulate import Simulated, perfect_block, simulate
from corridor.simulation.terrain import Dike

__all__ = [
    "CAMLIGHT",
    "Dike",
    "Flight",
    "Ground",
    "Noise",
    "ORDINARY_NOISE",
    "Plan",
    "Simulated",
    "Start",
    "Terrain",
    "TiePoints",
    "add_noise",
    "cameras",
    "perfect_block",
    "reach",
    "read_plan",
    "ready_made",
    "simulate",
]
