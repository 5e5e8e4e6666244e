"""Physical effects: one file each in the folder `catalogue`.

`every_effect()` lists them, `find(slug)` makes one; `add` simulates effects in a block, `take_out`
undoes that, `correct` with all that a person may have forgotten; `predict` is the whole forward
model. `Values` are what was given or found. A new effect is a new file with one class (`Effect`,
`LinearEffect`), here or in another package that names it in the entry points `corridor.effects`.
"""

from corridor.core.effects.context import Context, Images, group_names, group_of_image
from corridor.core.effects.contract import (
    AlongAxes,
    Effect,
    LinearEffect,
    Parameter,
    Variant,
    Without,
    along_each,
    edge_of,
    of_interior,
)
from corridor.core.effects.correction import correct, refuse_impossible
from corridor.core.effects.forward import Prediction, add, predict, stated_lever_arms, take_out
from corridor.core.effects.moments import AtMoments
from corridor.core.effects.registry import (
    believed_of,
    every_effect,
    find,
    forget,
    register,
    summary,
)
from corridor.core.effects.stack import ROW_REACH, Arrays, Member, Stack, check_needs
from corridor.core.effects.testable import Candidates, candidates
from corridor.core.effects.values import EffectValues, Values, effect_of, parse_word
from corridor.core.effects.velocity_errors import (
    COMMON,
    RATE_SIGMA,
    VELOCITY_SIGMA,
    CommonVelocityError,
    OwnVelocityError,
)
from corridor.core.registry import offered

__all__ = offered(globals())
