"""Calls whose keywords are the fields of types: an option is declared once, in its type."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from functools import wraps
from inspect import Parameter
from typing import Any, TypeVar

from corridor.core.errors import InputError

Kind = TypeVar("Kind")
_ALONE = Parameter.KEYWORD_ONLY


def options(**kinds: type) -> Callable[[Callable], Callable]:
    """Decorator: a call takes the fields of dataclasses in place of some of its arguments.

    kinds: argument -> its dataclass. What is called gets the whole; who calls names the fields, in
    the order of the dataclass where the argument stands, or gives the whole by the argument's name.
    `inspect.signature`, and so help and completion, show the fields. Raises TypeError for an
    option that there is none of, as Python does, and InputError for a whole and a field of it.
    """

    def around(call: Callable) -> Callable:
        shown = inspect.signature(call)
        shown = shown.replace(parameters=list(_spread(shown.parameters.values(), kinds)))

        @wraps(call)
        def asked(*args, **keywords):
            try:
                given = shown.bind(*args, **keywords).arguments
            except TypeError as error:
                raise TypeError(f"{call.__name__}() {error}") from None
            for name, kind in kinds.items():
                told = {one.name: given.pop(one.name) for one in fields(kind) if one.name in given}
                given[name] = made(kind, given.get(name), told, name)
            return call(**given)

        asked.__signature__ = shown  # type: ignore[attr-defined]
        return asked

    return around


def made(kind: type[Kind], given: Kind | None, told: Mapping[str, Any], name: str) -> Kind:
    """What is given as a whole, or one of the fields that are told. name: what it is called.

    Raises InputError where a whole is given, and a field is told that is not as by default.
    """
    if given is None:
        return kind(**told)
    default = {one.name: _default(one) for one in fields(kind)}  # type: ignore[arg-type]
    twice = [key for key, value in told.items() if not _same(value, default[key])]
    if twice:
        raise InputError(
            f"{', '.join(twice)} and a {name} are given: the {name} says it already, give one"
        )
    return given


def _spread(parameters: Iterable[Parameter], kinds: Mapping[str, type]) -> Iterable[Parameter]:
    """The parameters with the fields of kinds in the place of some, and these as keywords last."""
    wholes = []
    for one in parameters:
        if one.name not in kinds:
            yield one
            continue
        wholes.append(one.replace(kind=_ALONE, default=None, annotation=f"{one.annotation} | None"))
        for field in fields(kinds[one.name]):
            yield Parameter(field.name, one.kind, default=_default(field), annotation=field.type)
    yield from wholes


def _default(field) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _same(a: Any, b: Any) -> bool:
    if a is b or (_nothing(a) and _nothing(b)):
        return True
    alike = a == b
    return isinstance(alike, bool) and alike


def _nothing(value: Any) -> bool:
    return value is None or (isinstance(value, tuple | list | dict) and not value)
