"""Perfect blocks of corridor flights, and the noise of measurements."""

from corridor.simulation.noise import add_noise
from corridor.simulation.strips import CAMLIGHT, corridor_block
from corridor.simulation.terrain import Dike

__all__ = ["CAMLIGHT", "Dike", "add_noise", "corridor_block"]
