"""Malformed inputs: one damaged file, one command, and what came of it.

A case is a number: seed and number choose subject, command and damage, so that any case can be run
again alone. Cases run in forked workers that call the command's own entry, with the memory and
the processor time of a case limited.
"""

from __future__ import annotations

import functools
import gc
import multiprocessing
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter, deque
from dataclasses import asdict, dataclass, field
from itertools import chain, count
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from benchmarks.guarantees import samples, subjects
from benchmarks.guarantees.damage import damage

SECONDS, BYTES = 60, 4 * 2**30
# One figure in so many is drawn: of the others the file is enough.
DRAWN = 8
# Cases that a worker is dealt at a time, and seconds after which figures are stored.
BATCH, STORE_S = 20, 60.0
# Who waits for a worker on a busy machine gives it this many times its processor time.
PATIENCE = 10
MEMORY = "/dev/shm"
GOOD = ("refused", "failed", "unharmed", "right", "told", "done")
FAULTS = (
    "traceback", "hang", "memory", "died", "half an output", "no sentence", "names no place",
    "foreign words", "silent",
)  # fmt: skip
# Work that can fail honestly on an input that can be read: status 1 with a sentence.
MAY_FAIL = ("adjust", "change", "correct", "diagnose", "gnss", "plan", "readout led",
            "readout star", "readout wheel", "simulate", "thermal fit", "thermal map")  # fmt: skip


# Whose undamaged run is not made first: it takes longer than a thousand cases.
SLOW = ("readout star", "readout wheel")


class Hang(BaseException):
    """The processor time of a case is used up."""


@dataclass
class Case:
    """What was damaged and typed, and what came of it: one of GOOD or FAULTS, with the words."""

    number: int
    subject: str
    typed: str
    damage: str
    outcome: str = ""
    words: str = ""
    seconds: float = 0.0


@dataclass
class Found:
    """Counts of outcomes by verb and by kind of damage, the faults, and numbers that are left."""

    seed: int
    cases: int = 0
    outcomes: Counter = field(default_factory=Counter)
    verbs: dict = field(default_factory=dict)
    damages: dict = field(default_factory=dict)
    faults: list = field(default_factory=list)
    most_seconds: float = 0.0
    most_bytes: int = 0
    left: list = field(default_factory=list)

    def add(self, case: Case, peak: int) -> None:
        """Count one case. peak: bytes of the worker's memory at most until now."""
        self.cases += 1
        self.outcomes[case.outcome] += 1
        for table, key in ((self.verbs, case.typed), (self.damages, case.damage.split(":")[0])):
            table.setdefault(key, Counter())[case.outcome] += 1
        if case.outcome in FAULTS:
            self.faults.append(case)
        self.most_seconds = max(self.most_seconds, case.seconds)
        self.most_bytes = max(self.most_bytes, peak)


def figures(found: Found) -> dict:
    """What is stored of a run."""
    return {
        "cases": found.cases, "seed": found.seed, "outcomes": dict(found.outcomes),
        "verbs": {verb: dict(count) for verb, count in found.verbs.items()},
        "damages": {kind: dict(count) for kind, count in found.damages.items()},
        "most_seconds": round(found.most_seconds, 1), "most_gb": round(found.most_bytes / 1e9, 2),
        "faults": [asdict(case) for case in found.faults], "holds": not found.faults,
        "left": _ranges(found.left), "commits": {_commit(): found.cases},
    }  # fmt: skip


def left(known: dict) -> list[int]:
    """Numbers of the cases that a run that was stopped has left."""
    return [number for first, last in known.get("left", []) for number in range(first, last + 1)]


def _ranges(numbers):
    """Ascending numbers as pairs of first and last."""
    out = []
    for number in numbers:
        if out and out[-1][1] == number - 1:
            out[-1][1] = number
        else:
            out.append([number, number])
    return out


@functools.cache
def _commit():
    """Of the code that runs; `unknown` outside a clone."""
    asked = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def retried(before: dict, again: Found) -> dict:
    """The figures with the cases that were faults replaced by what they are now."""
    numbers = {case["number"] for case in before["faults"]}
    lost = [Case(**case) for case in before["faults"]]
    both = added({**before, "faults": []}, figures(again))
    for case in lost:
        both["outcomes"][case.outcome] -= 1
        both["verbs"][case.typed][case.outcome] -= 1
        both["damages"][case.damage.split(":")[0]][case.outcome] -= 1
    both["outcomes"] = {name: count for name, count in both["outcomes"].items() if count}
    still = len(again.faults)
    return both | {
        "cases": before["cases"], "holds": not still,
        "mended": before.get("mended", 0) + len(numbers) - still,
        "left": before.get("left", []), "commits": before.get("commits", {}),
    }  # fmt: skip


def added(before: dict | None, after: dict) -> dict:
    """The figures of two runs of other cases as one."""
    if not before or before["seed"] != after["seed"]:
        return after

    def sums(one, two):
        return dict(Counter(one) + Counter(two))

    both = {
        key: {name: sums(before[key].get(name, {}), after[key].get(name, {}))
              for name in sorted({*before[key], *after[key]})}
        for key in ("verbs", "damages")
    }  # fmt: skip
    return both | {
        "cases": before["cases"] + after["cases"], "seed": after["seed"],
        "outcomes": sums(before["outcomes"], after["outcomes"]),
        "most_seconds": max(before["most_seconds"], after["most_seconds"]),
        "most_gb": max(before["most_gb"], after["most_gb"]),
        "faults": before["faults"] + after["faults"],
        "holds": before["holds"] and after["holds"], "mended": before.get("mended", 0),
        "left": after["left"], "commits": sums(before.get("commits", {}), after["commits"]),
    }  # fmt: skip


def run(
    cases, seed: int = 0, jobs: int = 1, short: bool = False, place: Path | None = None, say=None,
    keep: bool = False, minutes: float = np.inf, store=None,
) -> Found:  # fmt: skip
    """Run cases (numbers) in `jobs` forked workers.

    short: without the commands that take long. place: folder for samples and scratch files, made
    anew. say: called with every fault. keep: leave the folder, with the last case in it.
    minutes: after which no case is begun. store: called once a minute with what was found so far.
    """
    # In memory where there is such a place: a case writes and removes some twenty files.
    memory = MEMORY if os.access(MEMORY, os.W_OK) else None
    home = Path(place or tempfile.mkdtemp(prefix="guarantees_", dir=memory))
    shutil.rmtree(home, ignore_errors=True)
    _prepare(home / "good", short)
    until = time.time() + 60.0 * minutes
    found, todo = Found(seed), deque(cases)
    context = multiprocessing.get_context("fork")
    workers: dict[Connection, _Worker] = {}

    def start(k):
        ours, theirs = context.Pipe()
        arguments = (seed, short, home / "good", home / f"worker{k}", theirs, keep)
        process = context.Process(target=_work, args=arguments)
        process.start()
        theirs.close()
        workers[ours] = _Worker(k, process)
        deal(ours)

    def deal(end):
        """The next cases, or the word that there are none."""
        worker = workers[end]
        more = time.time() < until
        worker.dealt = [todo.popleft() for _ in range(min(BATCH, len(todo)) if more else 0)]
        end.send(list(worker.dealt))

    def count(worker, case, peak):
        worker.dealt.remove(case.number)
        found.add(case, peak)
        if say is not None and case.outcome in FAULTS:
            say(case)

    for k in range(jobs):
        start(k)
    stored = time.monotonic()
    while workers:
        for end in wait(list(workers), timeout=5.0):
            worker = workers[end]
            try:
                sent = end.recv()
            except EOFError:
                worker.process.join()
                del workers[end]
                if worker.case is not None:  # it died within a case
                    worker.case.outcome = "died"
                    worker.case.words = f"exit status {worker.process.exitcode}"
                    count(worker, worker.case, 0)
                    todo.extendleft(reversed(worker.dealt))
                    start(worker.number)
                continue
            worker.case, worker.since = None, time.monotonic()
            if isinstance(sent, Case):
                worker.case = sent
            else:
                count(worker, *sent)
                if not worker.dealt:
                    deal(end)
        for worker in workers.values():
            if worker.case is not None and time.monotonic() - worker.since > PATIENCE * SECONDS:
                worker.process.kill()
        found.left = sorted([*todo, *(n for worker in workers.values() for n in worker.dealt)])
        if store is not None and time.monotonic() - stored > STORE_S:
            store(found)
            stored = time.monotonic()
    if not keep:
        shutil.rmtree(home, ignore_errors=True)
    return found


@dataclass
class _Worker:
    """A worker, the case that it is at and since when, and the numbers that it was dealt."""

    number: int
    process: BaseProcess
    case: Case | None = None
    since: float = 0.0
    dealt: list[int] = field(default_factory=list)


def _prepare(good, short):
    """Samples, what is made of them undamaged, and every command run once: nothing compiles."""
    from corridor.interface.cli import main

    _without_waste()
    samples.make(good, short)
    with Captured(good) as (_, printed):
        for subject in subjects.SUBJECTS:
            for command in subject.commands:
                if short and command.long or command.verb in SLOW:
                    continue
                out = good / "once"
                words, written = _words(command, good / subject.name, out)
                subjects.last_adjustment.clear()
                assert main(words) == 0, (words, printed())
                # Without this, what is wrong undamaged would count as a damage that nobody told.
                if command.verb in ("adjust", "gnss"):
                    assert command.right(good / subject.name, written, good), words
                (good / f"{subject.name} {command.words[:40]}.said".replace("/", " ")).write_text(
                    "\n".join(_told(printed(), good)), encoding="utf-8"
                )
                for path in good.glob("once*"):
                    keep = {"thermal map": "maps.npz", "import": f"imported_{subject.name}"}
                    if path.suffix == ".npz" or command.verb == "import":
                        path.replace(good / keep[command.verb])
                    elif path.is_dir():
                        shutil.rmtree(path)
                    else:
                        path.unlink()
    shutil.copy(good / "heat" / "model.json", good / "model.json")


@functools.cache
def _without_waste():
    """What costs time at every call and is not what is tested: parsers, dots of pictures."""
    from corridor.core.output import files
    from corridor.interface import cli, figures

    cli._parser = functools.cache(cli._parser)
    draw, turn = files.png, count()

    def png(figure):
        return b"not drawn" if next(turn) % DRAWN else draw(figure, 15)

    files.png = figures.png = png
    subjects.record_adjustments()


class Captured:
    """What is printed, by libraries of C too; in a file, asked for and forgotten by `printed`."""

    def __init__(self, folder: Path):
        self.path = folder / "printed.txt"

    def __enter__(self):
        sys.stdout.flush(), sys.stderr.flush()
        self.kept = [os.dup(1), os.dup(2)]
        self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC)
        os.dup2(self.file, 1), os.dup2(self.file, 2)
        self.streams = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = (
            open(k, "w", encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
            for k in (1, 2)
        )
        return self, self.printed

    def printed(self):
        sys.stdout.flush(), sys.stderr.flush()
        text = self.path.read_text(encoding="utf-8", errors="replace")
        os.ftruncate(self.file, 0)
        return text

    def __exit__(self, *_):
        sys.stdout.flush(), sys.stderr.flush()
        sys.stdout, sys.stderr = self.streams
        for kept, number in zip(self.kept, (1, 2), strict=True):
            os.dup2(kept, number)
            os.close(kept)
        os.close(self.file)


def _words(command, there, out):
    """What is typed, and the path of what it writes or None."""
    words = command.words.format(there=there, out=out).split()
    return words, Path(words[words.index("-o") + 1]) if "-o" in words else None


def _work(seed, short, good, scratch, end, keep):
    """A worker: cases as it is dealt them; announced before, told after."""
    resource.setrlimit(resource.RLIMIT_DATA, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    scratch.mkdir(parents=True, exist_ok=True)
    gc.freeze()  # what the libraries hold need not be looked through after each case
    with Captured(scratch) as (_, printed):
        for number in chain.from_iterable(iter(end.recv, [])):
            case, todo = prepared(number, seed, short, good, scratch)
            end.send(case)
            printed()  # what the damage itself had to say
            _judge(case, todo, printed, good)
            peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            end.send((case, peak))
            if not keep:
                shutil.rmtree(scratch / "case", ignore_errors=True)
            gc.collect()


def prepared(number: int, seed: int, short: bool, good: Path, scratch: Path):
    """A case and its damaged files below scratch/case; what there is to do."""
    rng = random.Random(f"{seed} {number}")
    subject, command = subjects.chosen(rng, short)
    there = scratch / "case" / subject.name
    shutil.rmtree(there.parent, ignore_errors=True)
    shutil.copytree(good / subject.name, there, copy_function=os.link)
    files = sorted(
        {path for pattern in command.reads for path in there.rglob(pattern) if path.is_file()}
    )
    done = []
    for _ in range(rng.choice((1, 1, 1, 1, 2))):
        path = rng.choice(files)
        if path.is_file():
            try:
                done.append(damage(path, rng, [f for f in files if f != path and f.is_file()]))
            except Exception as error:  # of whatever library reads what is already damaged
                done.append(f"none: {path.name}: already damaged ({type(error).__name__})")
    words, out = _words(command, there, there.parent / "out")
    return Case(number, subject.name, command.verb, "; ".join(done)), (command, words, out, there)


def _judge(case, todo, printed, good):
    """Run a prepared case and judge what came of it."""
    from corridor.interface.cli import main

    command, words, out, there = todo
    names = {path.name for path in there.parent.iterdir()}
    subjects.last_adjustment.clear()

    def used_up(*_):
        raise Hang

    signal.signal(signal.SIGPROF, used_up)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    begun, raised, status = time.process_time(), "", None
    try:
        status = main(words)
    except SystemExit as stop:
        status = stop.code
    except Hang:
        raised = "hang"
    except BaseException:
        raised = "traceback"
        case.words = traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    case.seconds = time.process_time() - begun
    text = printed()
    if raised:
        case.outcome, case.words = raised, case.words or text[-500:]
        return
    left = sorted({path.name for path in there.parent.iterdir()} - names)
    case.outcome, case.words = _outcome(case, command, status, text, left, (there, words))
    if case.outcome == "done" and command.right is not None:
        _compare(case, command, text, out, there, good)


def _outcome(case, command, status, text, left, typed):
    """Outcome and words, but for whether a result is right. typed: what is damaged, and words."""
    there, words = typed
    last = text.rstrip("\n").rpartition("\n")[2]
    foreign = [
        line for line in text.splitlines()
        if re.search(r"Warning:|\.py:\d+:|^Traceback|libpng|Corrupt JPEG|^\[ *WARN|^OpenCV", line)
    ]  # fmt: skip
    if foreign:
        return "foreign words", foreign[0]
    hidden = [name for name in left if name.startswith(".") or name.endswith(".part")]
    if hidden or (left and status != 0):
        return "half an output", f"status {status}, left {left}"
    if status == 0:
        if command.writes and not left:
            return "half an output", "status 0, nothing written"
        return "done", ""
    if status == 1 and "not enough memory" in last:
        return "memory", last
    head = {1: "failed: ", 2: "error: "}.get(status)
    if head is None or not last.startswith(head) or len(last) < 20:
        return "no sentence", f"status {status}: {text[-300:]}"
    if status == 1:
        if case.typed not in MAY_FAIL:
            return "no sentence", f"status 1: {last}"
        return "failed", last
    known = {path.name for path in (there, *there.rglob("*"))}
    known |= {Path(name).stem for name in known} | {str(there)}
    # A file that was typed and is gone is a place, too.
    known |= {Path(word).name for word in map(str, words) if Path(word).suffix}
    if case.subject == "plan":
        # The one file that was typed: a flight or a key is the place.
        known |= {"flight", *re.findall(r"\w{4,}", samples.PLAN)}
    if not any(name in last for name in known):
        return "names no place", last
    return "refused", last


def _told(text, there):
    """Sentences that warn, without their numbers."""
    lines = [line.strip() for line in text.replace(str(there), "").splitlines()]
    warned = (line for line in lines if re.match(r"!|warning:|note:|proof", line))
    # What is printed of how much there is, and of epochs left out, is told with its numbers.
    numbered = r"\d+ images|^\d+ (pictures|points)|left out of the track"
    counts = {line for line in lines if re.search(numbered, line)}
    return sorted({re.sub(r"[-+]?\d[\d.,]*", "#", line) for line in warned} | counts)


def _compare(case, command, text, out, there, good):
    """Whether a result is right; where it is not, whether somebody was told."""
    name = f"{case.subject} {command.words[:40]}.said".replace("/", " ")
    said = good / name
    before = said.read_text(encoding="utf-8").splitlines() if said.is_file() else []
    told = [line for line in _told(text, there) if line not in before]
    try:
        right = command.right(there, out, good)
    except Exception:
        case.outcome, case.words = "half an output", traceback.format_exc()[-600:]
        return
    if right:
        case.outcome = "right"
    elif told:
        case.outcome, case.words = "told", told[0]
    else:
        case.outcome, case.words = "silent", "another result without a word"
