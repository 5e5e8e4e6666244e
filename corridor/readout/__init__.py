"""Rolling shutters: readout time from photographs of a target, or from a survey flight.

readout = corridor.readout.readout_from_star("still.jpg", "turning.jpg", 2.2)
print(readout)
print(corridor.readout.readout_from_flight("my_block"))
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.photographs import published_readouts as published_readouts
    from corridor.readout import render as render
    from corridor.readout.flight import FlightReadout as FlightReadout
    from corridor.readout.flight import readout_from_flight as readout_from_flight
    from corridor.readout.measure import readout_from_led as readout_from_led
    from corridor.readout.measure import readout_from_star as readout_from_star
    from corridor.readout.measure import readout_from_wheel as readout_from_wheel
    from corridor.readout.photograph import CannotMeasure as CannotMeasure
    from corridor.readout.photograph import Photograph as Photograph
    from corridor.readout.result import Readout as Readout
    from corridor.readout.result import save_readout as save_readout

_HOME = {
    "render": "corridor.readout.render",
    "readout_from_star": "corridor.readout.measure",
    "readout_from_wheel": "corridor.readout.measure",
    "readout_from_led": "corridor.readout.measure",
    "measure_star": "corridor.readout.star",
    "measure_wheel": "corridor.readout.wheel",
    "measure_bar": "corridor.readout.bar",
    "measure_led": "corridor.readout.led",
    "speed_from_video": "corridor.readout.video",
    "published_readouts": "corridor.photographs",
    "CannotMeasure": "corridor.readout.photograph",
    "Photograph": "corridor.readout.photograph",
    "Readout": "corridor.readout.result",
    "velocities": "corridor.preparation.velocity",
    "Velocities": "corridor.preparation.velocity",
    "rates_from_gyro": "corridor.preparation.angular_rate",
    "rates_from_neighbours": "corridor.preparation.angular_rate",
    "readout_from_flight": "corridor.readout.flight",
    "FlightReadout": "corridor.readout.flight",
    "published_value": "corridor.readout.flight_value",
    "use": "corridor.readout.flight_value",
    "can_save_flight": "corridor.readout.flight_report",
    "save_flight": "corridor.readout.flight_report",
    "write_examples": "corridor.readout.examples",
    "EXAMPLES": "corridor.readout.examples",
    "save_readout": "corridor.readout.result",
    "can_save_readout": "corridor.readout.result",
}

__all__ = list(_HOME)


# Loaded at first use: the renderer compiles, the measurements do not wait for it.
def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module 'corridor.readout' has no attribute {name!r}")
    home = _HOME[name]
    module = import_module(home)
    value = module if name == "render" else getattr(module, name)
    globals()[name] = value
    return value


def __dir__():
    return sorted(__all__)
