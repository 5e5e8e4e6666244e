"""Rolling shutters: readout time from photographs of a target, or from a survey flight.

readout = corridor.readout.readout_from_star("still.jpg", "turning.jpg", 2.2)
print(readout)
print(corridor.readout.readout_from_flight("my_block"))
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.core.photographs import published_readouts as published_readouts
    from corridor.tools.readout import render as render
    from corridor.tools.readout.flight import readout_from_flight as readout_from_flight
    from corridor.tools.readout.flight_report import FlightReadout as FlightReadout
    from corridor.tools.readout.led import measure_led as readout_from_led  # noqa: F401
    from corridor.tools.readout.photograph import CannotMeasure as CannotMeasure
    from corridor.tools.readout.photograph import Photograph as Photograph
    from corridor.tools.readout.result import Readout as Readout
    from corridor.tools.readout.result import save_readout as save_readout
    from corridor.tools.readout.star import measure_star as readout_from_star  # noqa: F401
    from corridor.tools.readout.wheel import measure_wheel as readout_from_wheel  # noqa: F401

_OFFERED = {
    "corridor.readout": ("render",),
    "corridor.tools.readout.star": ("measure_star",),
    "corridor.tools.readout.wheel": ("measure_wheel",),
    "corridor.tools.readout.bar": ("measure_bar",),
    "corridor.tools.readout.led": ("measure_led",),
    "corridor.tools.readout.video": ("speed_from_video",),
    "corridor.tools.readout.photograph": ("CannotMeasure", "Photograph"),
    "corridor.tools.readout.result": ("Readout", "save_readout", "can_save_readout"),
    "corridor.tools.readout.examples": ("EXAMPLES", "write_examples"),
    "corridor.tools.readout.flight": ("readout_from_flight",),
    "corridor.tools.readout.flight_report": ("FlightReadout", "published_value", "use"),
    "corridor.tools.readout.flight_folder": ("can_save_flight", "save_flight"),
    "corridor.core.photographs": ("published_readouts",),
    "corridor.core.preparation": (
        "Velocities", "velocities", "rates_from_gyro", "rates_from_neighbours",
    ),
}  # fmt: skip
# What measures is called by what it measures with as well.
_ALSO = {f"readout_from_{target}": f"measure_{target}" for target in ("star", "wheel", "led")}
_HOME = {name: room for room, names in _OFFERED.items() for name in names}

__all__ = [*_HOME, *_ALSO]


# Loaded at first use: the renderer compiles, the measurements do not wait for it.
def __getattr__(name):
    own = _ALSO.get(name, name)
    if own not in _HOME:
        raise AttributeError(f"module 'corridor.readout' has no attribute {name!r}")
    if own == "render":
        value = import_module("corridor.tools.readout.render")
    else:
        value = getattr(import_module(_HOME[own]), own)
    globals()[name] = value
    return value


def __dir__():
    return sorted(__all__)
