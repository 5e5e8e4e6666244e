"""Rolling shutters: readout time from photographs of a target, or from a survey flight.

readout = corridor.readout.readout_from_star("still.jpg", "turning.jpg", 2.2)
print(readout)
print(corridor.readout.readout_from_flight("my_block"))
"""

from corridor.core.photographs import published_readouts
from corridor.core.preparation import Velocities, rates_from_neighbours, velocities
from corridor.core.registry import offered
from corridor.tools.readout import render
from corridor.tools.readout.bar import measure_bar
from corridor.tools.readout.examples import EXAMPLES, write_examples
from corridor.tools.readout.flight import readout_from_flight
from corridor.tools.readout.flight_report import (
    FlightReadout,
    can_save_flight,
    published_value,
    save_flight,
    use,
)
from corridor.tools.readout.gyroscope import rates_from_gyro
from corridor.tools.readout.led import measure_led
from corridor.tools.readout.photograph import CannotMeasure, Photograph
from corridor.tools.readout.result import Readout, can_save_readout, save_readout
from corridor.tools.readout.star import measure_star
from corridor.tools.readout.video import speed_from_video
from corridor.tools.readout.wheel import measure_wheel

# What measures is called by what it measures with as well.
readout_from_star, readout_from_wheel = measure_star, measure_wheel
readout_from_led = measure_led

__all__ = sorted([*offered(globals()), "render"])
