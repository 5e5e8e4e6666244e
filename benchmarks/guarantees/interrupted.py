"""Every verb stopped by Ctrl-C at random moments: one line, and nothing half-written."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.guarantees import samples, verbs

# Of the moments of a verb this share falls into a process that has still to load its libraries.
FROM_NOTHING = 0.25
PYTHON_S = 0.06  # of processor, in which Python starts itself and knows of no program yet
TICK = os.sysconf("SC_CLK_TCK")
FORKED_S = 2 / TICK  # of processor, by whose clock a forked process is surely in the command


def run(times: int, seed: int, say, minutes: float = np.inf, some: Sequence[str] = ()) -> dict:
    """Stop every verb at so many moments; the figures.

    minutes: after which no verb is begun. some: these verbs in place of all.
    """
    home = Path(tempfile.mkdtemp(prefix="guarantees_"))
    samples.make(home / "good", short=True)
    until, done = time.time() + 60.0 * minutes, []
    statuses: dict[int, int] = {}
    faults, count, loading = [], 0, 0
    from_nothing = round(FROM_NOTHING * times)
    for verb in some or verbs.VERBS:
        if time.time() > until:
            break
        done.append(verb)
        whole = verbs.whole(verb, home)
        kinds = (False, True) if from_nothing else (False,)
        needed = {fresh: _undisturbed(verb, home, fresh) for fresh in kinds}
        for k in range(times):
            rng = random.Random(f"{seed} {verb} {k}")
            fresh = k < from_nothing
            moment = rng.uniform(0.0, 1.05) * needed[fresh]
            moment = max(moment, PYTHON_S if fresh else FORKED_S)
            status, said, there = _stopped(verb, home, fresh, moment)
            wrong = verbs.fault(status, said, there, whole, (130, 0))
            count, loading = count + 1, loading + fresh
            statuses[status] = statuses.get(status, 0) + 1
            if wrong:
                told = {"verb": verb, "moment": k, "processor_s": moment, "fault": wrong,
                        "said": said[-600:]}  # fmt: skip
                faults.append(told)
                say(f"{verb}, moment {k}, {moment:.2f} s: {wrong}\n{said[-1500:]}")
    shutil.rmtree(home, ignore_errors=True)
    return {
        "verbs": len(done), "of_verbs": len(verbs.VERBS), "moments": count,
        "while_loading_libraries": loading,
        "stopped": statuses.get(130, 0), "had_finished": statuses.get(0, 0), "seed": seed,
        "faults": faults, "holds": not faults,
    }  # fmt: skip


def _start(verb, home, fresh, out, printed):
    """A process of the command: forked with its libraries, or from nothing."""
    words = verbs.typed(verb, home / "good", out)
    if not fresh:
        return verbs.begin(words, printed)
    with printed.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "corridor", *words], stdout=file, stderr=file,
            start_new_session=True,
            # A shell's background job ignores Ctrl-C, and so would what it starts.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )  # fmt: skip
    process.returncode = 0  # it is waited for here
    return process.pid


def _undisturbed(verb, home, fresh):
    """Processor seconds that the verb takes."""
    place = home / "timed"
    place.mkdir()
    pid = _start(verb, home, fresh, place / "out", home / "printed.txt")
    _, _, used = os.wait4(pid, 0)
    verbs.end_group(pid)
    shutil.rmtree(place)
    return used.ru_utime + used.ru_stime


def _stopped(verb, home, fresh, moment):
    """Stop it once it has used so many processor seconds: status, what it said, what is there."""
    place, printed = home / "tried", home / "printed.txt"
    place.mkdir()
    pid = _start(verb, home, fresh, place / "out", printed)
    moment += 0.0 if fresh else _used(pid)
    while (
        _used(pid) < moment
        and os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
    ):
        time.sleep(0.004)
    os.killpg(pid, signal.SIGINT) if os.getpgid(pid) == pid else os.kill(pid, signal.SIGINT)
    status = os.waitstatus_to_exitcode(_waited(pid))
    # Python ends itself by the signal where that met code compiled from a string (a dataclass
    # being made), also if it was answered since: to a shell both are 130.
    status = 128 + signal.SIGINT if status == -signal.SIGINT else status
    verbs.end_group(pid)
    said, there = printed.read_text(errors="replace"), verbs.listed(place)
    shutil.rmtree(place)
    return status, said, there


def _used(pid):
    """Processor seconds of a process and those that it waited for."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return float("inf")
    return sum(map(int, fields[11:15])) / TICK


def _waited(pid, seconds=120.0):
    """Status of a process; killed where it does not end."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return status
        time.sleep(0.01)
    os.killpg(pid, signal.SIGKILL)
    return os.waitpid(pid, 0)[1]
