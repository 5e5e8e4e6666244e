"""Corridor flights: what the camera did that the model does not know.

adjustment = corridor.adjust("data_synthetic/dike")
print(adjustment)
print(corridor.diagnose("data_synthetic/dike").sentence)

A function for each command, and Python's rooms for those of several steps: `dir(corridor)`.

Everything named in `__all__` is loaded at its first use, so that `import corridor` (and `corridor
--help`) do not wait for the numerical libraries. What a type checker is told stands in
`__init__.pyi`, which `docs/stub.py` writes.
"""

from importlib import import_module

from corridor.core import __version__ as __version__
from corridor.core import registry

# Public names that are called otherwise at home, where a folder bears the name.
_AT_HOME = {"catalogue": "every_effect", "export": "export_project", "report_bug": "report"}
_HOME = {
    "read": "block",
    "summary": "effects",
    "prepare": "preparation",
    "adjust": "adjustment",
    "diagnose": "diagnosis",
    "check_project": "check",
    "batch": "batches",
    "simulate": "simulation",
    "plan": "planning",
    "correct": "effects",
    "import_project": "formats",
    "export": "formats",
    "report_bug": "faults",
    "verify": "certificate",
    "catalogue": "effects",
    "Block": "block",
    "Camera": "camera",
    "Model": "adjustment",
    "Adjustment": "adjustment",
    "Diagnosis": "diagnosis",
    "InputError": "errors",
    "CorridorError": "errors",
    "WorkFailed": "errors",
    "AdjustmentFailed": "errors",
    "ReadoutFailed": "errors",
    "FetchFailed": "errors",
}
# Commands of several functions (`corridor.thermal.fit`), and what draws.
_ROOMS = ("certificate", "change", "data", "effects", "figures", "gnss", "readout", "thermal")

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
