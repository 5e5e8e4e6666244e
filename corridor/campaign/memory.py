"""How much memory a worker may use: what is asked for beyond it is refused by the system."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from corridor.errors import InputError

_GROUP = Path("/sys/fs/cgroup/memory.max")
# Of what the machine has, what is left to the system and to the process that shares out.
_LEFT = 0.1


def share_of_machine(jobs: int) -> float | None:
    """Memory (GB) for each of so many workers of this machine; None where it cannot be held."""
    if not sys.platform.startswith("linux"):
        return None
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        total = min(total, int(_GROUP.read_text()))  # of a container
    except (OSError, ValueError):
        pass
    return (1 - _LEFT) * total / 1e9 / jobs


@contextmanager
def limited(gb: float | None) -> Iterator[None]:
    """Within the `with` the process has at most so much memory of its own; beyond, MemoryError.

    gb: None for any. Raises InputError where the system cannot do it (all but Linux).
    """
    if gb is None:
        yield
        return
    if not sys.platform.startswith("linux"):
        raise InputError("memory can be limited on Linux only: leave --memory out, lower --jobs")
    import resource

    before, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = int(gb * 1e9)
    wanted = wanted if most == resource.RLIM_INFINITY else min(wanted, most)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, most))
