"""Which effects of the catalogue tell a readout: by what they act on and need, not by name."""

from __future__ import annotations

from functools import cache

from corridor.block import Block
from corridor.effects import Effect, every_effect


@cache
def shutter() -> Effect:
    """What moves the camera during the readout as its velocity says."""
    return next(one for one in _at("motion") if "images.vx" in one.needs)


def free_motion(block: Block) -> Effect:
    """What moves and turns every image on its own during the readout: the freest of its kind."""
    free = [one for one in _at("motion") if one.group == "image" and one.generic]
    return max(free, key=lambda one: len(one.parameters(block)))


@cache
def late_clock() -> Effect:
    """What moves antenna positions as the velocity says: they are late."""
    return next(one for one in _at("antenna") if "images.vx" in one.needs and one.group == "block")


def _at(place: str) -> list[Effect]:
    return [one for one in every_effect() if one.place == place]
