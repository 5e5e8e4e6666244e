"""What a process has taken when it ends, as the system counts it."""

import os
import subprocess
import sys
from typing import NamedTuple


class Spent(NamedTuple):
    """Of a process and those it waited for: processor time, s, and largest resident set, MB."""

    cpu_s: float
    peak_mb: float


def spent(process: subprocess.Popen) -> Spent:
    """Waits for the end of a process, whose `returncode` is set."""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return Spent(used.ru_utime + used.ru_stime, used.ru_maxrss / unit)
