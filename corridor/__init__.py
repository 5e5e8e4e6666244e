"""Corridor flights: what the camera did that the model does not know.

block = corridor.read("data_synthetic/dike")
adjustment = corridor.adjust(block)
print(adjustment)

Everything named in `__all__` is loaded at its first use, so that `import corridor`
(and `corridor --help`) do not wait for the numerical libraries.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.adjustment import Adjustment as Adjustment
    from corridor.adjustment import Model as Model
    from corridor.adjustment import adjust as adjust
    from corridor.block import Block as Block
    from corridor.block import read as read
    from corridor.camera import Camera as Camera
    from corridor.diagnosis import Diagnosis as Diagnosis
    from corridor.diagnosis import diagnose as diagnose
    from corridor.effects import every_effect as catalogue  # noqa: F401
    from corridor.errors import AdjustmentFailed as AdjustmentFailed
    from corridor.errors import InputError as InputError
    from corridor.preparation import prepare as prepare
    from corridor.simulation import simulate as simulate

__version__ = "0.1.0"

# Public names that are called otherwise at home, where a folder bears the name.
_AT_HOME = {"catalogue": "every_effect"}
_HOME = {
    "read": "corridor.block",
    "Block": "corridor.block",
    "Camera": "corridor.camera",
    "prepare": "corridor.preparation",
    "adjust": "corridor.adjustment",
    "Adjustment": "corridor.adjustment",
    "Model": "corridor.adjustment",
    "catalogue": "corridor.effects",
    "simulate": "corridor.simulation",
    "diagnose": "corridor.diagnosis",
    "Diagnosis": "corridor.diagnosis",
    "InputError": "corridor.errors",
    "AdjustmentFailed": "corridor.errors",
}
_ROOMS = (
    "diagnosis",
    "effects",
    "figures",
    "gnss",
    "interchange",
    "planning",
    "preparation",
    "readout",
    "simulation",
    "thermal",
)

__all__ = [*_HOME, *_ROOMS]


def __getattr__(name):
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), _AT_HOME.get(name, name))
    elif name == "rolling_shutter":
        warnings.warn(
            "corridor.rolling_shutter is called corridor.readout and corridor.preparation now; "
            "the old name goes with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return import_module("corridor.readout")
    elif name in _ROOMS:
        value = import_module(f"corridor.{name}")
    else:
        raise AttributeError(f"module 'corridor' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    return sorted([*globals(), *__all__])
