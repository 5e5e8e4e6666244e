"""Work shared out among processes, or among the workers of a Dask cluster."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from corridor.core.errors import InputError

if TYPE_CHECKING:
    import joblib


class WorkerDied(RuntimeError):
    """A worker ended in the midst of its work: killed, out of memory, or switched off."""


@contextmanager
def parallel(
    jobs: int = 1, cluster: str | None = None, ordered: bool = True
) -> Iterator[joblib.Parallel]:
    """A `joblib.Parallel` that hands results on as they come, for as long as the `with` lasts.

    jobs: processes. cluster: address of a Dask scheduler (extra `cluster`) whose workers have
    corridor, used in their place. ordered: results in the order of the calls, else the first ready
    first. Raises InputError for no process, where Dask is not installed or no scheduler answers;
    WorkerDied when a process ends in the midst of its work, or workers of a cluster again and again
    with the same piece.
    """
    import joblib

    come = "generator" if ordered else "generator_unordered"
    if cluster is None:
        if jobs == 0:
            raise InputError("0 processes do no work: use 1 or more")
        if jobs != 1:
            _start(jobs)
        try:
            with warnings.catch_warnings(), joblib.Parallel(jobs, return_as=come) as share_out:
                # Processes that have grown or waited for long are replaced, and nothing is lost.
                warnings.filterwarnings("ignore", "A worker stopped while some jobs")
                yield share_out
        except BrokenExecutor as broken:
            raise WorkerDied(str(broken)) from broken
        return
    try:
        from dask.distributed import Client, KilledWorker
    except ImportError:
        raise InputError("a cluster needs Dask: install corridor with the extra cluster") from None
    try:
        client = Client(cluster, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {cluster} ({error}): start one") from None
    with client, joblib.parallel_config("dask", client=client):
        try:
            yield joblib.Parallel(n_jobs=-1, return_as=come)
        except KilledWorker as killed:
            raise WorkerDied(str(killed)) from killed


def _start(jobs: int) -> None:
    """Start the processes such that Ctrl-C reaches us alone, who then end them.

    Interrupted while they load libraries, each would print a traceback of its own.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    import joblib

    # Processes inherit what is ignored; they are there as soon as the calls are dispatched.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        work = joblib.Parallel(n_jobs=jobs, return_as="generator")
        begun = work(joblib.delayed(int)() for _ in range(2 * jobs))
    finally:
        signal.signal(signal.SIGINT, before)
    list(begun)
