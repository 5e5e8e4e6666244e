"""Numba's compiler, with a disk cache that follows the source of all that a function takes in.

Numba itself compares the one file that holds a function; what that inlines from other files may
have changed since, and the old machine code would go on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

from numba import njit
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

# For small functions inside a loop. LLVM inlines them: inlined by numba, every argument would be
# a new name that holds a reference to its array. And `_nrt` off leaves the counting of references
# out altogether; it took longer than the arithmetic. Such a function cannot make an array. It is
# numba's own option, so that pyproject.toml bounds the version.
SCALAR = {
    "forceinline": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,
    "error_model": "numpy",
    "fastmath": {"contract"},
}
# What kernels alone call compiles sooner without a way in from Python: called from there it would
# end the process.
UNWRAPPED = SCALAR | {"no_cpython_wrapper": True}
# Kernels proper: as the scalar functions, and they let other threads run.
_SHARED = ("_nrt", "no_cfunc_wrapper", "error_model", "fastmath")
KERNEL = {key: SCALAR[key] for key in _SHARED} | {"nogil": True}


def compiled(**options) -> Callable:
    """Decorator: `numba.njit(cache=True)` whose cache holds as long as no source has changed.

    options: those of `numba.njit`.
    """

    def make(function: Callable) -> Dispatcher:
        made = njit(cache=True, **options)(function)
        made._cache._cache_file._source_stamp = _stamp(function)
        return made

    return make


def _stamp(function: Callable) -> str:
    """Digest of the files that hold a function and all compiled ones that it can see."""
    files: set[str] = set()

    def visit(one: Callable) -> None:
        if one.__code__.co_filename in files:
            return
        files.add(one.__code__.co_filename)
        for value in one.__globals__.values():
            if isinstance(value, Dispatcher):
                visit(value.py_func)
            elif isinstance(value, _Intrinsic):
                visit(value._defn)

    visit(function)
    return " ".join(_digest(file) for file in sorted(files))


@cache
def _digest(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()
