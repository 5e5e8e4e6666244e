"""Numba's compiler, with a disk cache that follows the source of all that a function takes in.

Numba itself compares the one file that holds a function; what that inlines from other files may
have changed since, and the old machine code would go on.
"""

import atexit
import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from corridor.core.errors import SlowerWarning

try:
    from numba import __version__, config, njit
    from numba.core.caching import NullCache
    from numba.core.cpu import CPUTargetOptions
    from numba.core.dispatcher import Dispatcher
    from numba.core.extending import _Intrinsic
except ImportError:
    # What is compiled elsewhere runs as it is written; of engines there is `plain` alone.
    CPUTargetOptions = Dispatcher = None  # type: ignore[assignment, misc]

    def njit(**options: Any) -> Callable:  # type: ignore[no-redef]
        """A decorator that leaves a function as it is."""
        return lambda function: function


def _known(options: dict[str, Any]) -> dict[str, Any]:
    """Those options that this numba has; code without the others is slower, and does the same."""
    if CPUTargetOptions is None:
        return {}
    lost = [name for name in options if not hasattr(CPUTargetOptions, name)]
    if lost:
        warnings.warn(
            f"numba {__version__} has no option {', '.join(lost)}: what is compiled is slower; "
            "install numba 0.64 to 0.68",
            SlowerWarning,
            stacklevel=2,
        )
    return {name: value for name, value in options.items() if name not in lost}


# For small functions inside a loop. LLVM inlines them: inlined by numba, every argument would be
# a new name that holds a reference to its array. And `_nrt` off leaves the counting of references
# out altogether; it took longer than the arithmetic. Such a function cannot make an array. It is
# numba's own option, so that pyproject.toml bounds the version; one that has gone is left out.
SCALAR = _known(
    {
        "forceinline": True,
        "no_cfunc_wrapper": True,
        "_nrt": False,
        "error_model": "numpy",
        "fastmath": {"contract"},
    }
)
# What kernels alone call compiles sooner without a way in from Python: called from there it would
# end the process.
UNWRAPPED = SCALAR | _known({"no_cpython_wrapper": True})
# Kernels proper: as the scalar functions, and they let other threads run.
_SHARED = ("_nrt", "no_cfunc_wrapper", "error_model", "fastmath")
KERNEL = {key: SCALAR[key] for key in _SHARED if key in SCALAR} | {"nogil": True}

# A process that compiles for us has failed where it takes longer for one kernel, s.
PATIENCE_S = 60.0


def compiled(late: bool = False, **options) -> Callable:
    """Decorator: `numba.njit(cache=True)` whose cache holds as long as no source has changed.

    late: another process may be at it (`meanwhile`): it is waited for. options: of `numba.njit`.
    """

    def make(function: Callable) -> Any:
        if Dispatcher is None:
            return function
        made: Any = _cached(function, options)
        if isinstance(made._cache, NullCache):
            return made
        made._cache._cache_file._source_stamp = _stamp(function)
        made._cache.load_overload = _loadable(made._cache)
        if late:
            made._cache.load_overload = _patient(made._cache.load_overload)
        return made

    return make


def _cached(function: Callable, options: dict) -> Any:
    """The function with its cache beside the source or in the user's folder of caches.

    Where neither can be written (a read-only installation, a user without a home) it is in a folder
    of the user's in the temporary one; where that cannot be either, there is none.
    """
    with suppress(RuntimeError):
        return njit(cache=True, **options)(function)
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    try:
        config.CACHE_DIR = _private_folder()  # type: ignore[attr-defined]
        return njit(cache=True, **options)(function)
    except (OSError, RuntimeError):
        return njit(**options)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]


@cache
def _private_folder() -> str:
    """A folder that nobody else can write to: what lies there is run as it is. Raises OSError."""
    if hasattr(os, "getuid"):
        folder = Path(tempfile.gettempdir()) / f"corridor-{os.getuid()}"
        with suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
            facts = folder.lstat()
            alone = stat.S_ISDIR(facts.st_mode) and not facts.st_mode & 0o077
            if alone and facts.st_uid == os.getuid():
                return str(folder)
    made = tempfile.mkdtemp(prefix="corridor-")
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def _stamp(function: Callable) -> str:
    """Digest of the files that hold a function, all compiled ones that it can see, and scenes."""
    files = {str(Path(__file__).with_name("scene.py"))}

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
    return " ".join(hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in sorted(files))


# --- a second process ---------------------------------------------------------------------------


class _Helper:
    """The process that compiles late kernels, if there is one."""

    process: subprocess.Popen | None = None


@contextmanager
def meanwhile(code: str) -> Iterator[None]:
    """Let a second process compile what `code` calls, for as long as the `with` lasts.

    Processes, since numba compiles in one thread at a time. Whatever becomes of it, what it has not
    left in the cache is compiled here. On one core, or where no process can be started, it is none.
    """
    if (os.cpu_count() or 1) > 1:
        # Our modules and no others: their cache is where they are.
        path = os.pathsep.join(place or os.getcwd() for place in sys.path)
        with suppress(OSError):
            _Helper.process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": path},
            )
    try:
        yield
    finally:
        _stop()


def is_kept(kernel: Any) -> bool:
    """Whether any machine code of a kernel is in its cache, of this source."""
    return not isinstance(kernel._cache, NullCache) and bool(
        kernel._cache._cache_file._load_index()
    )


def _loadable(kept: Any) -> Callable:
    """`Cache.load_overload` that begins the cache anew where it names what cannot be imported.

    The types of arguments are in it: a tuple of a notebook's, which no other program finds.
    """
    load = kept.load_overload

    def loadable(signature, context):
        try:
            return load(signature, context)
        except (ImportError, AttributeError):
            kept._cache_file.flush()
            return None

    return loadable


def _patient(load: Callable) -> Callable:
    """`Cache.load_overload` that waits for a kernel as long as another process may be at it."""

    def patient(signature, context):
        until = time.monotonic() + PATIENCE_S
        while True:
            # Asked before: it may end just after it has left the kernel.
            at_it = _Helper.process is not None and _Helper.process.poll() is None
            found = load(signature, context)
            if found is not None or not at_it:
                return found
            if time.monotonic() > until:
                _stop()
            time.sleep(0.03)

    return patient


def _stop() -> None:
    process, _Helper.process = _Helper.process, None
    if process is not None:
        process.kill()
        process.wait()
