"""Corridor flights: what the camera did that the model does not know.

adjustment = corridor.adjust("data_synthetic/dike")
print(adjustment)
print(corridor.diagnose("data_synthetic/dike").sentence)

A function for each command, and Python's rooms for those of several steps: `dir(corridor)`.

Everything named in `__all__` is loaded at its first use, so that `import corridor`
(and `corridor --help`) do not wait for the numerical libraries.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from corridor.core import __version__ as __version__
from corridor.core import registry

if TYPE_CHECKING:
    from corridor.core import effects as effects
    from corridor.core import gnss as gnss
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
    from corridor.interface import figures as figures
    from corridor.tools import change as change
    from corridor.tools import data as data
    from corridor.tools import readout as readout
    from corridor.tools import thermal as thermal
    from corridor.tools.batch import batch as batch
    from corridor.tools.formats import export_project as export  # noqa: F401
    from corridor.tools.formats import import_project as import_project
    from corridor.tools.planning import plan as plan

# Public names that are called otherwise at home, where a folder bears the name.
_AT_HOME = {"catalogue": "every_effect", "export": "export_project"}
_HOME = {
    "read": "block",
    "summary": "effects",
    "prepare": "preparation",
    "adjust": "adjustment",
    "diagnose": "diagnosis",
    "batch": "campaign",
    "simulate": "simulation",
    "plan": "planning",
    "correct": "effects",
    "import_project": "formats",
    "export": "formats",
    "catalogue": "effects",
    "Block": "block",
    "Camera": "camera",
    "Model": "adjustment",
    "Adjustment": "adjustment",
    "Diagnosis": "diagnosis",
    "InputError": "errors",
    "AdjustmentFailed": "errors",
}
# Commands of several functions (`corridor.thermal.fit`), and what draws.
_ROOMS = ("change", "data", "effects", "figures", "gnss", "readout", "thermal")

__all__ = [*_HOME, *_ROOMS]

registry.answer_to_public_names()


def __getattr__(name):
    if name in _HOME:
        value = getattr(registry.room(_HOME[name]), _AT_HOME.get(name, name))
    elif registry.home(name) is not None:
        value = import_module(registry.home(name))
    else:
        raise AttributeError(f"module 'corridor' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    return sorted([*__all__, "__version__"])
