"""Corridor flights: what the camera did that the model does not know.

adjustment = corridor.adjust("data_synthetic/dike")
print(adjustment)
print(corridor.diagnose("data_synthetic/dike").sentence)

A function for each command, and Python's rooms for those of several steps: `dir(corridor)`.

Everything named in `__all__` is loaded at its first use, so that `import corridor`
(and `corridor --help`) do not wait for the numerical libraries.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment as Adjustment
    from corridor.core.adjustment import Model as Model
    from corridor.core.adjustment import adjust as adjust
    from corridor.core.block import Block as Block
    from corridor.core.block import read as read
    from corridor.core.camera import Camera as Camera
    from corridor.core.effects import correct as correct
    from corridor.core.effects import every_effect as catalogue  # noqa: F401
    from corridor.core.effects import summary as summary
    from corridor.core.errors import AdjustmentFailed as AdjustmentFailed
    from corridor.core.errors import InputError as InputError
    from corridor.core.preparation import prepare as prepare
    from corridor.core.simulation import simulate as simulate
    from corridor.diagnosis import Diagnosis as Diagnosis
    from corridor.diagnosis import diagnose as diagnose
    from corridor.tools.batch import batch as batch
    from corridor.tools.formats import export_project as export  # noqa: F401
    from corridor.tools.formats import import_project as import_project
    from corridor.tools.planning import plan as plan

__version__ = "0.1.0"

# Public names that are called otherwise at home, where a folder bears the name.
_AT_HOME = {"catalogue": "every_effect", "export": "export_project"}
_HOME = {
    "read": "corridor.block",
    "summary": "corridor.effects",
    "prepare": "corridor.preparation",
    "adjust": "corridor.adjustment",
    "diagnose": "corridor.diagnosis",
    "batch": "corridor.campaign",
    "simulate": "corridor.simulation",
    "plan": "corridor.planning",
    "correct": "corridor.effects",
    "import_project": "corridor.interchange",
    "export": "corridor.interchange",
    "catalogue": "corridor.effects",
    "Block": "corridor.block",
    "Camera": "corridor.camera",
    "Model": "corridor.adjustment",
    "Adjustment": "corridor.adjustment",
    "Diagnosis": "corridor.diagnosis",
    "InputError": "corridor.errors",
    "AdjustmentFailed": "corridor.errors",
}
# Commands of several functions (`corridor.thermal.fit`), and what draws.
_ROOMS = ("change", "data", "effects", "figures", "gnss", "readout", "thermal")
# What stands behind a function above; there when asked for.
_BEHIND = ("campaign", "diagnosis", "interchange", "planning", "preparation", "simulation")

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
    elif name in (*_ROOMS, *_BEHIND):
        value = import_module(f"corridor.{name}")
    else:
        raise AttributeError(f"module 'corridor' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    return sorted([*__all__, "__version__"])
