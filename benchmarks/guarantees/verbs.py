"""Every verb that writes, with good input: what is interrupted, and what meets a full disk."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from corridor.__main__ import main

# {good} is the folder of the samples, {out} what is written.
VERBS = {
    "adjust": "adjust {good}/block -o {out}",
    "summary": "summary {good}/block -o {out}",
    "diagnose": "diagnose {good}/block --only gnss_bias --counterparts 19 -o {out}",
    "correct": "correct {good}/block --effect rolling_shutter:readout=0.03 -o {out}",
    "simulate": "simulate {good}/plan/plan.toml -o {out}",
    "plan": "plan {good}/plan/plan.toml --control 0,3 -o {out}",
    "plan --jobs 2": "plan {good}/plan/plan.toml --control 0,3 --jobs 2 -o {out}",
    "change": "change {good}/block {good}/block --points-only --no-camera -o {out}",
    "gnss": "gnss {good}/track/track.csv --images {good}/track -o {out}/gnss.csv",
    "readout led": "readout led {good}/photographs/led.jpg --frequency 800 -o {out}",
    "readout examples": "readout examples -o {out}",
    "thermal map": "thermal map {good}/series -o {out}/maps.npz",
    "thermal fit": "thermal fit {good}/heat/maps.npz -o {out}/model.json",
    "thermal apply": "thermal apply {good}/heat/model.json --points {good}/heat/points.csv "
    "-o {out}/moved.csv",
    "import": "import auto {good}/opensfm -o {out}",
    "export": "export colmap {good}/block --corrected -o {out}",
    "data fetch": "data fetch dike -o {out}",
}


def typed(verb: str, good: Path, out: Path) -> list[str]:
    """The words of a verb."""
    return VERBS[verb].format(good=good, out=out).split()


def whole(verb: str, home: Path) -> set[str]:
    """What the verb writes undisturbed, below home/whole; afterwards all is compiled."""
    place = home / "whole" / verb.replace(" ", "_")
    place.mkdir(parents=True)
    pid = begin(typed(verb, home / "good", place / "out"), place.with_suffix(".txt"))
    status = ended(pid)
    assert status == 0, (verb, status, place.with_suffix(".txt").read_text())
    return listed(place)


def begin(words: list[str], printed: Path, before=lambda: None) -> int:
    """Start the command in a process that has the libraries already; its id, once it begins.

    printed: file of all that it prints. before: called in the process first.
    """
    sys.stdout.flush(), sys.stderr.flush()
    begins, tell = os.pipe()
    pid = os.fork()
    if pid:
        os.close(tell)
        os.read(begins, 1)  # what comes before the command is ours, and not for it to answer for
        os.close(begins)
        return pid
    status = 70
    try:
        file = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, 1), os.dup2(file, 2)
        before()
        os.setpgid(0, 0)  # Ctrl-C reaches what it starts, and nobody else
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.argv = ["corridor", *words]
        sys.stdout, sys.stderr = (open(k, "w", buffering=1, closefd=False) for k in (1, 2))  # noqa: SIM115
        os.close(tell)
        status = main()
    except SystemExit as stop:
        status = stop.code
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 71)


def ended(pid: int) -> int:
    """Wait for a process of `begin`; its status. Workers that wait for more of its work end too."""
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    end_group(pid)
    return status


def end_group(pid: int) -> None:
    """End what a process of `begin`, which has ended, has left running."""
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)


def listed(place: Path) -> set[str]:
    """Every file and empty folder below a place."""
    return {
        path.relative_to(place).as_posix()
        for path in place.rglob("*")
        if path.is_file() or not any(path.iterdir())
    }


def fault(status: int, said: str, there: set[str], whole: set[str], allowed: tuple) -> str:
    """What of the guarantee did not hold, nothing where all did.

    there, whole: files that are there now, and those of a whole result. allowed: statuses.
    """
    kept = {name for name in there if ".npz.part" in name}  # what `thermal map` goes on from
    if "Traceback" in said:
        return "a traceback"
    if status not in allowed:
        return f"status {status}"
    if there - kept not in (set(), whole):
        return f"half an output: {sorted(there - kept)[:4]}"
    if status and there - kept:
        return ""  # it was whole when Ctrl-C came
    if not status and there != whole:
        return "status 0 without a whole result"
    if status and not said.strip():
        return "not a word"
    return ""
