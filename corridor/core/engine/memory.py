"""What lies in one place after another thing, and memory that is free."""

import ctypes
import sys
from collections.abc import Callable
from typing import Any


class InPlace:
    """Things of which each is made in the memory of the one before, and stands in its place.

    Whoever asks for one that is gone has it made anew, in other memory: what one gets never depends
    on who asked before, and nobody's thing is overwritten but by `take` and what follows it here.
    makers: how each is made from the one before, in order; the first from None.
    """

    def __init__(self, **makers: Callable[[Any], Any]):
        self._makers, self._held, self._value = makers, "", None

    def get(self, name: str) -> Any:
        """The thing of this name."""
        names = ["", *self._makers]
        if names.index(self._held) > names.index(name):
            self.forget()
        for one in names[names.index(self._held) + 1 : names.index(name) + 1]:
            # Whoever fails to be made has spoilt what it was made from.
            value, self._held, self._value = self._value, "", None
            self.put(one, self._makers[one](value))
        return self._value

    def put(self, name: str, value: Any) -> None:
        """Hold what somebody else has made."""
        self._held, self._value = name, value

    def take(self, name: str) -> Any:
        """The thing, for whoever makes something else in its place."""
        value = self.get(name)
        self.forget()
        return value

    def forget(self, *names: str) -> None:
        """Hold nothing, or none of these."""
        if not names or self._held in names:
            self._held, self._value = "", None


def give_back() -> None:
    """Give back what C's library keeps for later; elsewhere than on Linux, nothing.

    It keeps every gap that lies below something in use: in a block of 1,000 images, 0.4 GB.
    """
    if sys.platform == "linux":
        # Only glibc has it.
        getattr(ctypes.CDLL(None), "malloc_trim", bool)(0)
