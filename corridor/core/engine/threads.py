"""The linear algebra of numpy and scipy in one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """For as long as the `with` lasts, or in a function that is decorated with it.

    Matrices of a block are small and many: threads that wait for each other take ten times as long
    on a busy machine.
    """
    with _libraries().limit(limits=1):
        yield


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401, has a library of its own, to be found as well

    # Looking through all that is loaded takes a millisecond, longer than most that is solved.
    return ThreadpoolController()
