"""Every verb where there is no room for its result: one sentence, and nothing half-written.

A file may grow to a limit and no further (RLIMIT_FSIZE), as on a full disk or beyond a quota; the
limits are shares of the largest file that the verb writes.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.guarantees import samples, verbs

SHARES = (0.0, 0.02, 0.2, 0.5, 0.9, 0.999)


def run(
    say, minutes: float = np.inf, some: Sequence[str] = (), shares: Sequence[float] = SHARES
) -> dict:
    """Every verb with every limit; the figures.

    minutes: after which no verb is begun. some: these verbs in place of all. shares: of the
    largest file, for which there is room.
    """
    home = Path(tempfile.mkdtemp(prefix="guarantees_"))
    samples.make(home / "good", short=True)
    until, done, faults, count = time.time() + 60.0 * minutes, [], [], 0
    for verb in some or verbs.VERBS:
        if time.time() > until:
            break
        done.append(verb)
        whole = verbs.whole(verb, home)
        written = home / "whole" / verb.replace(" ", "_")
        largest = max(path.stat().st_size for path in written.rglob("*") if path.is_file())
        for share in shares:
            status, said, there = _tried(verb, home, int(share * largest))
            wrong = verbs.fault(status, said, there, whole, (1,))
            count += 1
            if wrong:
                faults.append({"verb": verb, "share": share, "fault": wrong, "said": said[-600:]})
                say(f"{verb}, room for {share:.3f}: {wrong}\n{said[-1500:]}")
    shutil.rmtree(home, ignore_errors=True)
    return {"verbs": len(done), "of_verbs": len(verbs.VERBS), "tries": count, "faults": faults,
            "holds": not faults}  # fmt: skip


def _tried(verb, home, most):
    """Status, what it said, and what is there, with room for files of so many bytes."""
    place, printed = home / "tried", home / "printed.txt"
    place.mkdir()
    # What is printed goes through a pipe: a file would be as full.
    end, start = os.pipe()

    def before():
        os.dup2(start, 1), os.dup2(start, 2)
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    pid = verbs.begin(verbs.typed(verb, home / "good", place / "out"), printed, before)
    os.close(start)
    # A few lines, for which a pipe has room. Workers that go on would keep it open.
    status = verbs.ended(pid)
    with os.fdopen(end, errors="replace") as pipe:
        said = pipe.read()
    there = verbs.listed(place)
    shutil.rmtree(place)
    return status, said, there
