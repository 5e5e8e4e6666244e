"""Blocks of corridor flights that nobody flew: from a flight plan, with the truth beside them."""

from corridor.core.simulation.fly import bank_of, strips_of
from corridor.core.simulation.noise import add_noise
from corridor.core.simulation.plan import (
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
from corridor.core.simulation.simulating import (
    Simulated,
    marks_on,
    on_the_ground,
    perfect_block,
    simulate,
)
from corridor.core.simulation.terrain import Dike
