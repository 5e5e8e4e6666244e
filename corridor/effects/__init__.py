"""Physical effects: one file each, found by looking in this folder.

`every_effect()` lists them, `find(slug)` makes one; `add` simulates effects in a block, `take_out`
undoes that, `correct` with all that a person may have forgotten; `predict` is the whole forward
model. A new effect is a new file with one class (`corridor.effects.contract.Effect`).
"""

from corridor.effects.contract import (
    Context,
    Effect,
    Images,
    Parameter,
    every_effect,
    find,
    group_names,
    group_of_image,
)
from corridor.effects.correction import correct
from corridor.effects.forward import (
    Prediction,
    add,
    point_positions,
    predict,
    stated_lever_arms,
    take_out,
)
from corridor.effects.stack import ROW_REACH, Arrays, Stack, check_needs
from corridor.effects.values import EffectValues, Values, parse_word

__all__ = [
    "ROW_REACH",
    "Arrays",
    "Context",
    "Effect",
    "EffectValues",
    "Images",
    "Parameter",
    "Prediction",
    "Stack",
    "Values",
    "add",
    "every_effect",
    "check_needs",
    "correct",
    "find",
    "group_names",
    "group_of_image",
    "parse_word",
    "point_positions",
    "predict",
    "stated_lever_arms",
    "take_out",
]
