"""The catalogue: effects of the folder `catalogue`, of other packages, and of this session.

Another package offers its effects by entry points of the group `corridor.effects`, each of which
names a class; who tries one out in a notebook calls `register`.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import warnings
from collections.abc import Iterable
from copy import copy
from functools import cache
from importlib.metadata import entry_points
from typing import TypeVar

from corridor.core.block import Block, Summary, read
from corridor.core.effects.contract import Effect, check_contract
from corridor.core.errors import InputError, did_you_mean

Kind = TypeVar("Kind", bound="Effect | type[Effect]")
ENTRY_POINTS = "corridor.effects"
_registered: dict[str, Effect] = {}


def every_effect() -> list[Effect]:
    """Every effect that is known, and its variants, by slug."""
    return [copy(effect) for _, effect in sorted(_known().items())]


def believed_of(block: Block, given: Iterable[Effect] = ()) -> list[Effect]:
    """Effects that the measurements of a block come with, but for those that are given."""
    slugs = {effect.slug for effect in given}
    return [
        copy(effect)
        for slug, effect in sorted(_known().items())
        if slug not in slugs and effect.believed(block)
    ]


def find(name: str) -> Effect:
    """The effect with a slug; `slug@flight` asks for one set of values a flight.

    Raises InputError where there is none.
    """
    if not isinstance(name, str):
        raise InputError(f"an effect is a slug of `corridor effects` or an object, not {name!r}")
    slug, _, group = name.partition("@")
    known = _known()
    if slug not in known:
        near = did_you_mean(slug, known)
        usual = ", ".join(
            slug
            for slug, one in sorted(known.items())
            if not (one.generic or one.refines or one.needs_table("attitudes"))
        )
        raise InputError(
            f"effect {slug!r} is unknown{near}: `corridor effects` lists them all"
            + ("" if near else f", the usual ones are {usual}")
        )
    return known[slug].per(group) if group else copy(known[slug])


def summary(block: Block | str | os.PathLike) -> Summary:
    """First look at a block (or its folder), and the effects that lack a column in it."""
    return read(block).summary(needs={effect.slug: effect.needs for effect in every_effect()})


def register(effect: Kind) -> Kind:
    """Make an effect known by its slug until the session ends; as a decorator of a class, too.

    Raises InputError where another effect has the slug, or the class is no effect.
    """
    one = effect() if isinstance(effect, type) else effect
    check_contract(one)
    for each in _with_variants(one):
        if each.slug in _installed():
            raise InputError(f"effect {each.slug} is there already: choose another slug")
        _registered[each.slug] = each
    return effect


def forget(slug: str) -> None:
    """Make an effect that was registered unknown again."""
    for each in _with_variants(_registered[slug]):
        del _registered[each.slug]


def forget_installed() -> None:
    """Look again for what packages offer: one was installed, or removed, in this session."""
    _installed.cache_clear()


def _known() -> dict[str, Effect]:
    return _installed() | _registered


@cache
def _installed() -> dict[str, Effect]:
    found = {each.slug: each for one in _of_folder() for each in _with_variants(one)}
    for point in entry_points(group=ENTRY_POINTS):
        try:
            one = point.load()
            one = one() if isinstance(one, type) else one
            check_contract(one)
            theirs = {each.slug: each for each in _with_variants(one)}
        except Exception as error:  # what a stranger's package does is not known here
            warnings.warn(
                f"effect {point.name} of {point.value} cannot be loaded ({error!r}): left out",
                stacklevel=2,
            )
            continue
        for slug in theirs.keys() & found.keys():
            warnings.warn(
                f"effect {slug} of {point.value} is left out: there is one of that slug already",
                stacklevel=2,
            )
        found = theirs | found
    return found


def _of_folder() -> list[Effect]:
    package = importlib.import_module("corridor.core.effects.catalogue")
    modules = [
        importlib.import_module(f"{package.__name__}.{module.name}")
        for module in pkgutil.iter_modules(package.__path__)
    ]
    return [
        value()
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Effect) and "slug" in vars(value)
    ]


def _with_variants(effect: Effect) -> list[Effect]:
    return [effect, *(effect.variant(one) for one in effect.variants)]
