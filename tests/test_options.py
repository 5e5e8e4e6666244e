"""Calls that take the fields of types as keywords, of which the whole may be given instead."""

import inspect
from dataclasses import dataclass

import pytest

import corridor
from corridor.core.errors import InputError
from corridor.core.options import options


@dataclass(frozen=True)
class Cut:
    depth: float = 1.0
    wide: tuple = ()


@options(cut=Cut)
def dig(place, cut: Cut, *, seed=0):
    """Where and how."""
    return place, cut, seed


class TestAnOption:
    def test_is_a_field_by_name_or_by_place(self):
        assert dig("a", depth=2.0) == dig("a", 2.0) == ("a", Cut(2.0), 0)
        assert dig("a", 2.0, (3,), seed=1) == ("a", Cut(2.0, (3,)), 1)
        assert dig("a") == ("a", Cut(), 0)

    def test_is_shown_to_who_asks_for_help(self):
        assert list(inspect.signature(dig).parameters) == ["place", "depth", "wide", "seed", "cut"]
        assert {"camera", "effects", "priors", "threads"} <= set(
            inspect.signature(corridor.adjust).parameters
        )

    def test_of_no_type_is_refused_by_name(self):
        with pytest.raises(TypeError, match=r"dig\(\).*'deep'"):
            dig("a", deep=2.0)
        with pytest.raises(TypeError, match="kamera"):
            corridor.adjust("nowhere", kamera="fixed")


class TestTheWhole:
    def test_stands_for_its_fields(self):
        assert dig("a", cut=Cut(5.0)) == ("a", Cut(5.0), 0)

    def test_and_a_field_that_says_nothing_new_are_taken(self):
        assert dig("a", depth=1.0, wide=None, cut=Cut(5.0)) == ("a", Cut(5.0), 0)

    def test_and_a_field_contradict_each_other(self):
        with pytest.raises(InputError, match="depth and a cut are given"):
            dig("a", depth=2.0, cut=Cut(5.0))
