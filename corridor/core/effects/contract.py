"""What an effect is: one class in one file.

A class says where it acts (`place`), with which parameters, and by how much it moves what, with
the derivative. Simulating, adjusting, correcting, diagnosing and documenting all follow from it.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import INTERIOR
from corridor.core.effects.context import GROUPS, Context
from corridor.core.errors import InputError, did_you_mean

# Shape of one row's shift, by place.
PLACES = {
    "camera": len(INTERIOR), "image": 2, "motion": 6, "antenna": 3, "attitude": 3, "ground": 3,
    "distance": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One unknown of an effect.

    start: value it starts from; scale: standard deviation one would expect before looking. text:
    what it is, where the name does not say it. most: size beyond which the cause is another one;
    the effect's file says where it comes from.
    """

    name: str
    unit: str
    scale: float
    start: float = 0.0
    text: str = ""
    most: float = np.inf


@dataclass(frozen=True)
class Variant:
    """The same effect with values for other groups, under a slug of its own; see `Effect`."""

    slug: str
    group: str
    title: str
    called: str
    revealed_by: str
    unobservable_when: str
    about: str
    generic: bool = False
    datum: bool = False


@dataclass(frozen=True)
class Without:
    """What an adjustment without an effect shows it, which tells whether it is missed.

    block: as it was measured. free: interior parameters that the adjustment estimates for some
    camera. height: median of cameras over points, m. gnss: residuals vx, vy, vz of the antenna
    positions of an image and their sigmas sx, sy, sz, m.
    """

    block: Block
    free: frozenset[str]
    height: float
    gnss: pd.DataFrame


class Effect(ABC):
    """One physical effect.

    slug: public name. title: one line. place: one of `PLACES`.
    called: the effect in the middle of a sentence, "... is missing from the model".
    needs: columns that must be known, `table.column`, or `camera.key`. takes: columns that are
    used where they are known.
    group: who shares a set of values: the block, a camera, a flight, an image, a ground point or a
    measured distance.
    generic: a mathematical shape that stands for the unknown, not a physical cause.
    searched: whether the diagnosis asks for it; not where others of the catalogue say it better.
    sudden: a break of the picture at a line, which matches across that line show one by one too.
    by_row: it differs from row to row of a picture, and has no one place in it.
    proper: of values for each image the parameters that nothing else looks like; where the data
    show none of them and nothing else tells that the camera moved, it is not called by its name.
    variants: the same effect for other groups, which the catalogue lists beside it. refines: of a
    variant with more sets of values, the slug of the effect.
    datum: the constant error that all positions of its place and group share.
    sees_points: of the place image: it looks at the object point and the pose, not at the pixel.
    row_degree: of the place motion: degree of the polynomial in the row that holds the shift.
    stands_in_for: camera parameters that have to be held, or the effect to have a prior: it can
    move what they move.
    revealed_by, unobservable_when: the data that show it, and the flight that hides it, for people.
    remedy: what to do in the block about it, where an effect in the model is not the way.
    about: what is modelled, and its source; by default the text at the head of the file.
    unknowns: the parameters of one group, where they do not depend on the block.
    """

    slug: str
    title: str
    called: str
    place: str
    needs: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    group: str = "block"
    generic: bool = False
    searched: bool = True
    sudden: bool = False
    by_row: bool = False
    proper: tuple[str, ...] = ()
    datum: bool = False
    sees_points: bool = False
    refines: str = ""
    row_degree: int = 1
    stands_in_for: tuple[str, ...] = ()
    revealed_by: str = ""
    unobservable_when: str = ""
    remedy: str = ""
    about: str = ""
    variants: tuple[Variant, ...] = ()
    unknowns: Sequence[Parameter] = ()

    def __init__(self, group: str | None = None):
        if group is not None:
            self.group = self.per(group).group

    def __repr__(self) -> str:
        group = "" if self.group == type(self).group else f" of each {self.group}"
        return f"Effect {self.slug}{group}: {self.title}"

    def per(self, group: str) -> "Effect":
        """The same effect with another kind of groups: one set of values for each of them."""
        if group not in GROUPS:
            raise InputError(f"group {group!r} is unknown: use one of {', '.join(GROUPS)}")
        out = copy(self)
        out.group = group
        return out

    def parameters(self, block: Block) -> list[Parameter]:
        """The unknowns of one group in a block."""
        return list(self.unknowns)

    @abstractmethod
    def shift(self, context: Context, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far everything moves, and the derivative.

        values: (rows, parameters), the values of each row's own group.
        Returns (rows, dimension) in the unit of the place (camera: `INTERIOR`; image: px; motion:
        centre m and rotation of the camera rad, in the camera frame; antenna, ground, distance: m;
        attitude: turn of the measured frame against the camera, rad, in the camera frame), and
        its derivative (rows, dimension, parameters) by the values of the row's group.
        """

    def variant(self, one: Variant) -> "Effect":
        """The same effect as one of its variants."""
        out = self.per(one.group)
        vars(out).update(asdict(one), variants=())
        # All values but those of the whole block are more sets of them.
        out.refines = "" if one.group == "block" else self.slug
        return out

    def described(self) -> list[str]:
        """Paragraphs: what is modelled, with its source; the formula."""
        module = inspect.getmodule(type(self))
        formula = getattr(type(self), "derivative", type(self).shift).__doc__
        told = self.about or (module and module.__doc__) or type(self).__doc__
        return [inspect.cleandoc(text) for text in (told, formula) if text]

    def form(self, block: Block) -> "Effect":
        """The effect as this block's data let it be: other parameters, another group."""
        return self

    def stated(self, block: Block) -> dict[str, float | dict[str, float]] | None:
        """Values that the block itself states, `{parameter: number or {group: number}}`, or None.

        They are taken where somebody corrects the effect without giving values.
        """
        return None

    @property
    def during_readout(self) -> bool:
        """Whether it moves the camera while a picture is read, row by row."""
        return self.place == "motion" and self.row_degree > 0

    def believed(self, block: Block) -> bool:
        """Whether it is part of every model of this block, whose measurements come with it."""
        return False

    def priors(self, block: Block) -> dict[tuple[str, str], tuple[float, float]]:
        """What the block knows beforehand: (parameter, group) -> value and standard deviation."""
        return {}

    def restated(self, block: Block, values: np.ndarray) -> Block:
        """The adjusted block with values (groups, parameters) in its statements, not beside them.

        By default it states nothing of them.
        """
        return block

    def doubts(self, block: Block, found: pd.DataFrame) -> list[str]:
        """Sentences on values that no such effect has, or that contradict what the block states.

        found: parameter, group, value and sigma of each, as an adjustment has them.
        """
        return []

    def missed(self, found: Without) -> list[str]:
        """Sentences where an adjustment without any effect of this place shows that it is missed.

        Only of what shows without a search for it; the search is the diagnosis.
        """
        return []

    def missing(self, block: Block) -> list[str]:
        """Those of `needs` that the block does not have."""
        return [column for column in self.needs if not block.has(column)]

    def needs_table(self, table: str) -> bool:
        """Whether it needs a column of a table of the block."""
        return any(need.startswith(f"{table}.") for need in self.needs)


def check_contract(effect: Effect) -> None:
    """Refuse a class that cannot work, with a sentence on what it lacks."""
    name = type(effect).__name__
    if not isinstance(effect, Effect):
        raise InputError(f"{name} is not an effect: derive it from Effect or LinearEffect")
    for text, example in (
        ("slug", '"lens_tilt"'),
        ("title", '"Lens that tilts with the temperature"'),
        ("called", '"a tilt of the lens"'),
        ("place", f"one of {', '.join(PLACES)}"),
    ):
        value = getattr(effect, text, None)
        if not isinstance(value, str) or not value.strip():
            raise InputError(f"effect {name} has no {text}: write {text} = {example} in the class")
    if not effect.slug.replace("_", "").isalnum() or effect.slug != effect.slug.lower():
        raise InputError(
            f"effect {name}: slug = {effect.slug!r} is not a valid name: use lower case, digits "
            "and underscores"
        )
    if type(effect).parameters is Effect.parameters and not effect.unknowns:
        raise InputError(f"effect {name} has no parameters: list them in unknowns of the class")
    check_place(effect)
    if effect.group not in GROUPS:
        raise InputError(
            f"effect {effect.slug}: group = {effect.group!r} is unknown: use one of "
            f"{', '.join(GROUPS)}"
        )
    if isinstance(effect.needs, str) or isinstance(effect.takes, str):
        raise InputError(f'effect {effect.slug}: needs is a tuple: write ("images.time_s",)')


def check_place(effect: Effect) -> None:
    """Refuse an unknown place: nothing would ever use the effect."""
    if effect.place not in PLACES:
        near = did_you_mean(effect.place, PLACES)
        raise InputError(
            f"effect {effect.slug}: place = {effect.place!r} is unknown{near}: use one of "
            f"{', '.join(PLACES)}"
        )


class LinearEffect(Effect):
    """An effect that moves things by its derivative times its values."""

    @abstractmethod
    def derivative(self, context: Context) -> np.ndarray:
        """Derivative (rows, dimension, parameters) by the values of the row's group."""

    def shift(self, context: Context, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The derivative times the values."""
        derivative = self.derivative(context)
        return linear(derivative, values), derivative


class AlongAxes(LinearEffect):
    """An effect that moves each axis of its place by the same terms: x by its first values."""

    @abstractmethod
    def terms(self, context: Context) -> np.ndarray:
        """Terms (rows, k); the effect has k parameters for x, then as many for y, and so on."""

    def derivative(self, context: Context) -> np.ndarray:
        """Each axis by the terms."""
        return along_each(self.terms(context), PLACES[self.place])

    def moved(self, context: Context, values: np.ndarray) -> np.ndarray:
        """Shift (rows, dimension) by the terms times values (k, dimension) of all rows."""
        return self.terms(context) @ values


def linear(derivative: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Shift (rows, dimension): derivative (rows, dimension, parameters) times values."""
    values = np.broadcast_to(values, (len(derivative), derivative.shape[2]))
    return np.einsum("nij,nj->ni", derivative, values)


def of_interior(context: Context, **factors: float | np.ndarray) -> np.ndarray:
    """Derivative (rows, interior parameters, parameters) of an effect of the place camera.

    factors: by interior parameter, how much a parameter of the effect moves it: one number, one a
    row, or (rows, k) for k parameters; the effect's parameters follow each other in that order.
    """
    parts = []
    for name, factor in factors.items():
        factor = np.asarray(factor, dtype=float)
        if factor.ndim < 2:
            factor = np.broadcast_to(factor, len(context))[:, None]
        part = np.zeros((len(context), len(INTERIOR), factor.shape[1]))
        part[:, INTERIOR.index(name)] = factor
        parts.append(part)
    return np.concatenate(parts, axis=2)


def along_each(terms: np.ndarray, axes: int = 3) -> np.ndarray:
    """Derivative (rows, axes, axes * k) of an effect that moves each axis by k terms (rows, k)."""
    rows, count = terms.shape
    derivative = np.zeros((rows, axes, axes * count))
    for axis in range(axes):
        derivative[:, axis, axis * count : (axis + 1) * count] = terms
    return derivative


def edge_of(block: Block) -> tuple[float, float]:
    """Focal length, px, of the block's first camera, and u at the end of its long side."""
    camera = next(iter(block.cameras.values()))
    return camera["f"], (max(camera.width, camera.height) - 1) / 2 / camera["f"]
