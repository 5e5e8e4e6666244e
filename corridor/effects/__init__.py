"""Physical effects: one file each, found by looking in this folder.

`catalogue()` lists them, `find(slug)` makes one; `add` simulates effects in a block, `take_out`
corrects them, `predict` is the whole forward model. A new effect is a new file with one class
(`corridor.effects.contract.Effect`).
"""

from corridor.effects.contract import Context, Effect, Images, Parameter, catalogue, find
from corridor.effects.forward import Prediction, add, predict, take_out
from corridor.effects.stack import Stack

__all__ = [
    "Context",
    "Effect",
    "Images",
    "Parameter",
    "Prediction",
    "Stack",
    "add",
    "catalogue",
    "find",
    "predict",
    "take_out",
]
