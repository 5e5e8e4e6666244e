"""Rolling shutters: readout time from photographs, and photographs as such a shutter takes them.

readout = corridor.rolling_shutter.readout_from_star("still.jpg", "turning.jpg", 2.2)
print(readout)
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.rolling_shutter import lesson as lesson
    from corridor.rolling_shutter import render as render
    from corridor.rolling_shutter.readout import readout_from_led as readout_from_led
    from corridor.rolling_shutter.readout import readout_from_star as readout_from_star
    from corridor.rolling_shutter.readout import readout_from_wheel as readout_from_wheel
    from corridor.rolling_shutter.readout.photograph import CannotMeasure as CannotMeasure
    from corridor.rolling_shutter.readout.photograph import Photograph as Photograph
    from corridor.rolling_shutter.readout.published import published_readouts as published_readouts
    from corridor.rolling_shutter.readout.result import Readout as Readout
    from corridor.rolling_shutter.readout.result import save_readout as save_readout

_HOME = {
    "lesson": "corridor.rolling_shutter.lesson",
    "render": "corridor.rolling_shutter.render",
    "readout_from_star": "corridor.rolling_shutter.readout",
    "readout_from_wheel": "corridor.rolling_shutter.readout",
    "readout_from_led": "corridor.rolling_shutter.readout",
    "measure_star": "corridor.rolling_shutter.readout.star",
    "measure_wheel": "corridor.rolling_shutter.readout.wheel",
    "measure_bar": "corridor.rolling_shutter.readout.bar",
    "measure_led": "corridor.rolling_shutter.readout.led",
    "speed_from_video": "corridor.rolling_shutter.readout.video",
    "published_readouts": "corridor.rolling_shutter.readout.published",
    "CannotMeasure": "corridor.rolling_shutter.readout.photograph",
    "Photograph": "corridor.rolling_shutter.readout.photograph",
    "Readout": "corridor.rolling_shutter.readout.result",
    "velocities": "corridor.rolling_shutter.velocity",
    "Velocities": "corridor.rolling_shutter.velocity",
    "rates_from_gyro": "corridor.rolling_shutter.turning",
    "rates_from_neighbours": "corridor.rolling_shutter.turning",
    "two_step": "corridor.rolling_shutter.correction",
    "TwoStep": "corridor.rolling_shutter.correction",
    "configurations": "corridor.rolling_shutter.table_7_3",
    "Configurations": "corridor.rolling_shutter.table_7_3",
    "in_pairs": "corridor.rolling_shutter.table_7_3",
    "readout_from_flight": "corridor.rolling_shutter.flight",
    "FlightReadout": "corridor.rolling_shutter.flight",
    "median_residual": "corridor.rolling_shutter.flight",
    "level_ground": "corridor.rolling_shutter.flight",
    "axis_assignments": "corridor.rolling_shutter.flight",
    "cost_of": "corridor.rolling_shutter.flight",
    "readout_with_errors": "corridor.rolling_shutter.support",
    "supported": "corridor.rolling_shutter.support",
    "save_readout": "corridor.rolling_shutter.readout.result",
    "can_save_readout": "corridor.rolling_shutter.readout.result",
}

__all__ = list(_HOME)


# Loaded at first use: the renderer compiles, the measurements do not wait for it.
def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module 'corridor.rolling_shutter' has no attribute {name!r}")
    home = _HOME[name]
    module = import_module(home)
    value = module if home.endswith(f"shutter.{name}") else getattr(module, name)
    globals()[name] = value
    return value


def __dir__():
    return sorted([*globals(), *__all__])
