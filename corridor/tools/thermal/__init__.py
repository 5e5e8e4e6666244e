"""Thermal effect: deformation maps from pictures of a wall, the model of them, its correction.

maps = corridor.thermal.measure_maps("SERIES")
model = corridor.thermal.fit(maps).model
block, notes = corridor.thermal.correct(corridor.read("BLOCK"), model)
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.tools.thermal.comparison import CameraDifference as CameraDifference
    from corridor.tools.thermal.comparison import calibrated_at as calibrated_at
    from corridor.tools.thermal.comparison import camera_at as camera_at
    from corridor.tools.thermal.comparison import compare_cameras as compare_cameras
    from corridor.tools.thermal.correction import correct as correct
    from corridor.tools.thermal.correction import laboratory_prior as laboratory_prior
    from corridor.tools.thermal.correction import uncorrect as uncorrect
    from corridor.tools.thermal.fitting import Fit as Fit
    from corridor.tools.thermal.fitting import fit as fit
    from corridor.tools.thermal.maps import Maps as Maps
    from corridor.tools.thermal.maps import forget as forget
    from corridor.tools.thermal.maps import measure_maps as measure_maps
    from corridor.tools.thermal.maps import read_maps as read_maps
    from corridor.tools.thermal.matching import Matcher as Matcher
    from corridor.tools.thermal.model import ThermalModel as ThermalModel
    from corridor.tools.thermal.model import read_model as read_model
    from corridor.tools.thermal.model import simple_model as simple_model
    from corridor.tools.thermal.points import apply as apply
    from corridor.tools.thermal.series import read_picture as read_picture

_OFFERED = {
    "comparison": ("CameraDifference", "calibrated_at", "camera_at", "compare_cameras"),
    "correction": ("correct", "laboratory_prior", "uncorrect"),
    "fitting": ("Fit", "fit"),
    "maps": ("Maps", "forget", "measure_maps", "read_maps"),
    "matching": ("Match", "Matcher"),
    "model": ("ThermalModel", "read_model", "simple_model"),
    "points": ("apply", "write_points"),
    "series": ("read_picture",),
    "temperature": ("degrees", "optics", "smoothed"),
}
_HOME = {
    name: f"corridor.tools.thermal.{file}" for file, names in _OFFERED.items() for name in names
}

__all__ = list(_HOME)


# Loaded at first use: correcting a block does not wait for the kernels of matching.
def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module 'corridor.thermal' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted(__all__)
