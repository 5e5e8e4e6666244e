"""Several effects at once: their values side by side, their shifts added up, by place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from corridor.core.block import Block
from corridor.core.effects.context import Context, Images, group_names
from corridor.core.effects.contract import PLACES, AlongAxes, Effect, Parameter, check_place
from corridor.core.errors import AdjustmentFailed, InputError

# Slug -> (groups, parameters), as the equations have the values of effects.
Arrays = dict[str, np.ndarray]
# What else than images an effect may act on: what that is called, and its groups.
_OWN_GROUPS = {
    "ground": ("ground points", ("point", "survey")),
    "distance": ("measured distances", ("distance",)),
}
# Motion is fitted a little beyond the first and last row: modelled points may lie outside.
ROW_REACH = 0.55


@dataclass
class Member:
    """One effect of a stack: its unknowns and the names of its groups."""

    effect: Effect
    parameters: list[Parameter]
    groups: list[str]

    @property
    def shape(self) -> tuple[int, int]:
        """Groups, parameters: the shape of this effect's values."""
        return len(self.groups), len(self.parameters)


class Stack:
    """The effects of one block.

    points: names of the ground control that effects of the place `ground` move.
    images: those of the block, where they are known already.
    Raises InputError where a column that an effect needs is missing, an effect is there twice or
    has a group that its place does not have.
    """

    def __init__(
        self,
        block: Block,
        effects: list[Effect],
        points: Sequence[str] = (),
        images: Images | None = None,
    ):
        # As given: another stack of the same block asks no table for them again.
        images = self.images = images or Images.of(block)
        effects = [effect.form(block) for effect in effects]
        slugs = [effect.slug for effect in effects]
        for slug in slugs:
            if slugs.count(slug) > 1:
                raise InputError(f"effect {slug} is given twice: give it once")
        for effect in effects:
            check_place(effect)
        check_groups(effects)
        check_needs(block, effects)
        self.members: dict[str, Member] = {}
        for effect in effects:
            groups = group_names(images, effect.group, points)
            self.members[effect.slug] = Member(effect, effect.parameters(block), groups)

    def start(self) -> Arrays:
        """Start values, slug -> (groups, parameters)."""
        return {
            slug: np.tile([p.start for p in member.parameters], (len(member.groups), 1))
            for slug, member in self.members.items()
        }

    def at(self, place: str) -> list[Member]:
        """The members that act at a place."""
        return [m for m in self.members.values() if m.effect.place == place]

    @property
    def sees_points(self) -> bool:
        """Whether an effect on the image looks at object points."""
        return any(m.effect.sees_points for m in self.at("image"))

    def evaluate(
        self, place: str, context: Context, values: Arrays
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sum of the shifts (rows, dimension) at a place and their derivatives side by side.

        The derivative (rows, dimension, parameters of all members at the place) is by the values
        of each row's own group. Raises InputError where an image lacks what an effect needs.
        """
        members, rows = self.at(place), len(context)
        if len(members) == 1 and not isinstance(members[0].effect, AlongAxes):
            return self._one(members[0], context, values)
        total = np.zeros((rows, PLACES[place]))
        derivative = np.zeros((rows, PLACES[place], sum(len(m.parameters) for m in members)))
        first = 0
        for member in members:
            mine = derivative[:, :, first : first + len(member.parameters)]
            first += len(member.parameters)
            alike = _moves_alike(member, values)
            terms = alike[0].terms(context) if alike else None
            if alike is None or terms is None or np.isnan(terms.sum()):
                shift, mine[:] = self._one(member, context, values)
            else:
                shift, k = terms @ alike[1], terms.shape[1]
                for axis in range(PLACES[place]):
                    mine[:, axis, axis * k : (axis + 1) * k] = terms
            total += shift
        return total, derivative

    def shift(self, place: str, context: Context, values: Arrays) -> np.ndarray:
        """Sum of the shifts (rows, dimension) at a place, as of `evaluate`.

        Effects that stand at zero are not asked: they move nothing.
        """
        total = np.zeros((len(context), PLACES[place]))
        for member in self.at(place):
            if values[member.effect.slug].any():
                total += self._moved(member, context, values)
        return total

    def _moved(self, member: Member, context: Context, values: Arrays) -> np.ndarray:
        """The shift (rows, dimension) of one effect, without its derivative where it can do so.

        A shape has a hundred columns in that, which weigh more than all else.
        """
        if alike := _moves_alike(member, values):
            shift = alike[0].moved(context, alike[1])
            if not np.isnan(shift.sum()):
                return shift
        return self._one(member, context, values)[0]

    def moved_ground(
        self, images: Images, names: list[str], position: np.ndarray, values: Arrays
    ) -> np.ndarray:
        """Given minus true (n, 3) of ground points of these names at a position (n, 3), m.

        A datum, or the curvature of the earth, moves all that were surveyed together, control or
        not; what is a point's own moves the points that have it.
        """
        out = np.zeros((len(names), 3))
        for member in self.at("ground"):
            array, mine = values[member.effect.slug], np.arange(len(names))
            if member.effect.group == "point":
                mine = np.flatnonzero(np.isin(names, member.groups))
                array = array[[member.groups.index(names[k]) for k in mine]]
            if len(mine):
                some = Context(images, point=[names[k] for k in mine], position=position[mine])
                out[mine] += self._one(member, some, {member.effect.slug: array})[0]
        return out

    def motion_by_row(self, images: Images, values: Arrays) -> tuple[np.ndarray, np.ndarray]:
        """Motion of every image as a polynomial in s = row fraction / `ROW_REACH`.

        Returns coefficients (images, degree + 1, 6), of s^0 first, and those of the derivative
        (images, degree + 1, 6, parameters). Without effects of motion: no coefficients.
        """
        members = self.at("motion")
        count = len(images.names)
        if not members:
            return np.zeros((count, 0, 6)), np.zeros((count, 0, 6, 0))
        degree = max(member.effect.row_degree for member in members)
        nodes = np.cos(np.pi * np.arange(degree + 1) / degree) if degree else np.zeros(1)
        image = np.repeat(np.arange(count), degree + 1)
        context = Context(images, image, row=ROW_REACH * np.tile(nodes, count))
        shift, derivative = self.evaluate("motion", context, values)
        fit = np.linalg.inv(np.vander(nodes, increasing=True))
        shift = shift.reshape(count, degree + 1, 6)
        derivative = derivative.reshape(count, degree + 1, 6, -1)
        return (
            np.ascontiguousarray(np.einsum("qn,inc->iqc", fit, shift)),
            np.ascontiguousarray(np.einsum("qn,inck->iqck", fit, derivative)),
        )

    def _one(self, member: Member, context: Context, values: Arrays):
        effect, mine = member.effect, values[member.effect.slug]
        if effect.group == "block":
            rows = np.broadcast_to(mine, (len(context), mine.shape[1]))
        else:
            rows = mine[context.group(effect.group)]
        # Points far outside their picture lead beyond all numbers; that is told below.
        with np.errstate(over="ignore", invalid="ignore"):
            shift, derivative = effect.shift(context, rows)
            _check_shapes(effect, shift, derivative, (len(context), rows.shape[1]))
            total = derivative.sum()
        # One reduction tells of any NaN; looking for the row is worth it only then.
        if not np.isnan(total):
            return shift, derivative
        # Infinity of both signs adds up to NaN too.
        bad = np.flatnonzero(~np.isfinite(derivative).all(axis=(1, 2)))
        name = context.images.names[context.image[bad[0]]] if context.image is not None else bad[0]
        if not effect.needs:
            raise AdjustmentFailed(
                f"effect {effect.slug} is not a number at image {name}: points lie far outside "
                "their picture, so poses, camera or image coordinates are wrong (y pointing up?)"
            )
        raise InputError(
            f"images.csv: image {name} lacks one of {', '.join(effect.needs)}, which effect "
            f"{effect.slug} needs: fill the cell or leave the effect out"
        )

    def names(self, place: str) -> list[tuple[str, str]]:
        """(slug, parameter) of the columns of a derivative at a place."""
        return [(m.effect.slug, p.name) for m in self.at(place) for p in m.parameters]


def _check_shapes(effect: Effect, shift, derivative, size: tuple[int, int]) -> None:
    """Refuse what an effect returns where it is not of the shape that its place has."""
    rows, count = size
    dimension = PLACES[effect.place]
    for what, found, wanted in (
        ("shift", shift, (rows, dimension)),
        ("derivative", derivative, (rows, dimension, count)),
    ):
        if np.shape(found) != wanted:
            raise InputError(
                f"effect {effect.slug}: its {what} has the shape {np.shape(found)}; the place "
                f"{effect.place} wants {wanted} (rows, dimension"
                f"{', parameters' * (len(wanted) == 3)})"
            )


def _moves_alike(member: Member, values: Arrays) -> tuple[AlongAxes, np.ndarray] | None:
    """An effect that moves each axis of all rows by the same terms, with its values (k, axes)."""
    effect, mine = member.effect, values[member.effect.slug]
    if not isinstance(effect, AlongAxes) or len(mine) != 1:
        return None
    return effect, mine.reshape(PLACES[effect.place], -1).T


def check_needs(block: Block, effects: list[Effect]) -> None:
    """Refuse effects that need a column which the block does not have."""
    for effect in effects:
        missing = effect.missing(block)
        if missing:
            table, _, column = missing[0].partition(".")
            if table == "effect":
                slug, _, key = column.partition(".")
                raise InputError(
                    f"block.toml has no {key} in a table [effect.{slug}], which effect "
                    f"{effect.slug} needs: add `{key} = ...` there or leave the effect out"
                )
            if table == "rig":
                raise InputError(
                    f"block.toml has no rig.{column} whose exposures images.csv names, which "
                    f"effect {effect.slug} needs: add [rig.NAME] and a column exposure, or leave "
                    "the effect out"
                )
            file = "block.toml" if table == "camera" else f"{table}.csv"
            raise InputError(
                f"{file} has no {column}, which effect {effect.slug} needs: add the column "
                f"or leave the effect out"
            )


def check_groups(effects: list[Effect]) -> None:
    """Refuse a group that a place does not have (an effect of ground points shared by images)."""
    for effect in effects:
        what, own = _OWN_GROUPS.get(effect.place, ("images", ()))
        others = {group for _, groups in _OWN_GROUPS.values() for group in groups}
        fits = effect.group in own if own else effect.group not in others
        if not fits and effect.group != "block":
            raise InputError(
                f"effect {effect.slug} acts on {what} and has no group {effect.group}: use another"
            )
