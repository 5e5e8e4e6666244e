"""Work on what strangers send, in a process of its own: limited in time and memory, and replaced.

A decoder that crashes, hangs or takes all memory then ends a process that nobody needs.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress

from corridor.core.errors import InputError, WorkFailed

# Loading the libraries, where the machine is busy with other things, s.
_LOADING_S = 120.0


class Apart:
    """`work` in a process of its own, one piece after the other; called as the work itself is.

    work: a function of a module, with one argument. seconds: for one piece. megabytes: more than
    the process has when it is loaded (where the system can limit it: Linux).
    Raises WorkFailed beyond a limit, and InputError as the work does, each a sentence.
    """

    def __init__(self, work: Callable, seconds: float, megabytes: int):
        self._work, self._seconds, self._megabytes = work, seconds, megabytes
        self._one = threading.Lock()
        self._process = self._pipe = None

    def __call__(self, asked):
        """What the work makes of `asked`; both must be picklable."""
        with self._one:
            try:
                if self._process is None or not self._process.is_alive():
                    self._start()
                self._pipe.send(asked)
                if not self._pipe.poll(self._seconds):
                    raise WorkFailed(
                        f"this took longer than {self._seconds:g} s, so it was stopped: give "
                        "smaller pictures"
                    )
                kind, answer = self._pipe.recv()
            except (EOFError, OSError, WorkFailed) as error:
                self._stop()
                if isinstance(error, WorkFailed):
                    raise
                kind = "memory"
        if kind == "memory":
            raise WorkFailed(
                f"this needs more than the {self._megabytes} MB of memory that are allowed, or the "
                "file is damaged: give smaller pictures"
            )
        if kind == "input":
            raise InputError(answer)
        return answer

    def _start(self):
        self._stop()
        # A fork of a process with threads may hang.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        process = context.Process(
            target=_serve, args=(theirs, self._work, self._megabytes), daemon=True
        )
        busy = WorkFailed("the computer is too busy to measure: try again in a minute")
        try:
            process.start()
        except OSError:  # no memory or no process is left: there is none to be ended
            raise busy from None
        self._process = process
        theirs.close()
        if not self._pipe.poll(_LOADING_S):
            raise busy
        self._pipe.recv()

    def _stop(self):
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = self._pipe = None

    def close(self) -> None:
        """End the process, if there is one."""
        with self._one:
            self._stop()


def _serve(pipe, work, megabytes):
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started us
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what a decoder says of damage helps nobody
    _limit(megabytes)
    pipe.send(None)
    while True:
        try:
            asked = pipe.recv()
        except EOFError:
            return
        try:
            answer = "done", work(asked)
        except MemoryError:
            answer = "memory", None
        except (InputError, WorkFailed) as error:
            answer = "input", str(error)
        except Exception:
            answer = "input", "this cannot be measured: take the photographs again"
        pipe.send(answer)


def _limit(megabytes):
    with suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:
            now = int(file.read().split()[0]) * resource.getpagesize()
        most = now + megabytes * 1_000_000
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
