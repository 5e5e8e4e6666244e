"""Work shared out among processes, or among the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import joblib

from corridor.errors import InputError


@contextmanager
def parallel(
    jobs: int = 1, cluster: str | None = None, ordered: bool = True
) -> Iterator[joblib.Parallel]:
    """A `joblib.Parallel` that hands results on as they come, for as long as the `with` lasts.

    jobs: processes. cluster: address of a Dask scheduler (extra `cluster`) whose workers have
    corridor, used in their place. ordered: results in the order of the calls, else the first ready
    first. Raises InputError where Dask is not installed or no scheduler answers.
    """
    come = "generator" if ordered else "generator_unordered"
    if cluster is None:
        yield joblib.Parallel(n_jobs=jobs, return_as=come)
        return
    try:
        from dask.distributed import Client
    except ImportError:
        raise InputError("a cluster needs Dask: install corridor with the extra cluster") from None
    try:
        client = Client(cluster, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {cluster} ({error}): start one") from None
    with client, joblib.parallel_config("dask", client=client):
        yield joblib.Parallel(n_jobs=-1, return_as=come)
