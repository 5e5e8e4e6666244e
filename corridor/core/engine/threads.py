"""The linear algebra of numpy and scipy in one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """For as long as the `with` lasts, or in a function that is decorated with it.

    Matrices of a block are small and many: threads that wait for each other take ten times as long
    on a busy machine. Without threadpoolctl the libraries decide.
    """
    with _libraries().limit(limits=1) if find_spec("threadpoolctl") else nullcontext():
        yield


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401, has a library of its own, to be found as well
    from threadpoolctl import ThreadpoolController

    # Looking through all that is loaded takes a millisecond, longer than most that is solved.
    return ThreadpoolController()
