"""One block of a batch, by whichever worker: adjusted or diagnosed, saved, and its row kept."""

import gc
import hashlib
import json
import os
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from corridor.core import __version__, registry
from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Model, not_converged
from corridor.core.block import read
from corridor.core.errors import InputError, WorkFailed
from corridor.core.output import forget_parts, sole, whole_file, write_json
from corridor.tools.batch.row import FAILED, Row

MARK = "batch.json"
# The file by which the result of a verb is known.
RESULTS = {"adjust": "adjustment.json", "diagnose": "diagnosis.json"}
_GROUP = Path("/sys/fs/cgroup/memory.max")
# Of what the machine has, what is left to the system and to the process that shares out.
_LEFT = 0.1
# A Dask worker may have several threads; a process has one block, and its memory, at a time.
_ONE_BLOCK = threading.Lock()


@dataclass(frozen=True)
class Asked:
    """What is asked of every block.

    options: keywords of `corridor.adjust` or `corridor.diagnose` but the model. counterparts: of a
    diagnosis. memory_gb: that a worker may use, None: any. command: what was typed, for the pages
    of diagnoses, without the blocks. gis: also files for a GIS.
    """

    verb: str
    model: Model
    options: Mapping[str, Any]
    required: float | None
    counterparts: int
    memory_gb: float | None
    command: str
    gis: bool

    @property
    def text(self) -> str:
        """All of it that makes a difference to a result."""
        options = sorted(self.options.items())
        saving = (self.required, self.counterparts, self.gis)
        return repr((__version__, self.verb, self.model, options, saving))


@dataclass(frozen=True)
class Task:
    """A block to be worked on. name: in the batch; output: the folder of the batch."""

    name: str
    folder: Path
    output: Path
    mark: str
    asked: Asked

    @classmethod
    def of(cls, name: str, folder: Path, output: Path, asked: Asked) -> "Task":
        """The task of a block as its files are now."""
        digest = hashlib.sha256(asked.text.encode())
        for path in sorted(folder.glob("*")) if folder.is_dir() else ():
            if path.is_file():
                with path.open("rb") as file:
                    content = hashlib.file_digest(file, "sha256").hexdigest()
                digest.update(f"{path.name} {content}\n".encode())
        return cls(name, folder, output, digest.hexdigest(), asked)

    @property
    def target(self) -> Path:
        """The folder of the block's own result."""
        return self.output / "blocks" / self.name

    def _beside(self, end: str) -> Path:
        return self.output / "rows" / f"{self.name}.{end}"

    @property
    def begun(self) -> bool:
        """Whether a worker is at it, or was when it was killed."""
        return self._beside("begun").is_file()

    @property
    def size(self) -> int:
        """Bytes of the block."""
        if not self.folder.is_dir():
            return 0
        return sum(path.stat().st_size for path in self.folder.glob("*") if path.is_file())

    def kept(self) -> Row | None:
        """The row of a result that is there and of this block, these options, this version."""
        try:
            content = json.loads(self._beside("json").read_text(encoding="utf-8"))
            row = Row.of_json(content["row"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        whole = (self.target / RESULTS[self.asked.verb]).is_file()
        return row if whole and content.get("of") == self.mark and not row.failed else None

    def keep(self, row: Row) -> None:
        """Keeps a row for the next time."""
        with whole_file(self._beside("json")) as part:
            write_json({"of": self.mark, "row": asdict(row)}, part)

    def forget(self) -> None:
        """Removes what a worker left that was interrupted or killed."""
        if not self.begun:
            return
        with sole(self._beside("lock")) as ours:
            if ours:
                forget_parts(self.target)
                self._beside("begun").unlink(missing_ok=True)

    def failed(self, sentence: str, fault: str = "") -> Row:
        """The row of a block without result."""
        return Row(self.name, str(self.folder), FAILED, attention=sentence, fault=fault)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else works on this block, of whichever batch; what killed runs left is gone."""
        with _ONE_BLOCK, sole(self._beside("lock"), wait=True):
            begun = self._beside("begun")
            begun.touch()
            try:
                forget_parts(self.target)
                yield
            finally:
                begun.unlink(missing_ok=True)


def call_of(verb: str) -> Callable:
    """The function of a verb."""
    if verb == "adjust":
        return least_squares.adjust
    # A second that workers of adjustments do without.
    return registry.room("diagnosis").diagnose


def work(task: Task) -> Row:
    """Does what is asked of a block, if no other worker has done it meanwhile; its row.

    Raises InputError where the folder of the batch is not on a disk that this worker shares.
    """
    if not (task.output / MARK).is_file():
        raise InputError(
            f"{task.output}: the worker on {socket.gethostname()} does not find {MARK} there; "
            "name a folder on a disk that all workers share"
        )
    with task.alone():
        row = task.kept()
        if row is None:
            row = _attempted(task)
            task.keep(row)
    return row


def _attempted(task: Task) -> Row:
    """The row of a block, also where there is no result."""
    began = time.perf_counter()
    memory = task.asked.memory_gb
    try:
        with limited(memory):
            row = _adjusted(task) if task.asked.verb == "adjust" else _diagnosed(task)
    except (InputError, WorkFailed) as error:
        row = task.failed(str(error))
    except MemoryError:
        most = "there is" if memory is None else f"the {memory:.3g} GB that a worker may use"
        row = task.failed(
            f"It needs more memory than {most}: allow more with --memory, or use fewer --jobs."
        )
    except OSError as error:
        row = task.failed(f"{error.filename or task.target}: {error.strerror or error}.")
    except Exception as fault:
        row = task.failed(
            f"A fault of corridor, please report it: {type(fault).__name__}: {fault}",
            traceback.format_exc(),
        )
    gc.collect()  # results and their pictures refer to each other
    return replace(row, seconds=time.perf_counter() - began)


def _adjusted(task: Task) -> Row:
    asked = task.asked
    adjustment = call_of("adjust")(read(task.folder), model=asked.model, **asked.options)
    if not adjustment.converged:
        raise not_converged(adjustment)
    adjustment.required = asked.required
    adjustment.save(task.target, registry.room("figures").of_adjustment, gis=asked.gis)
    return Row.of_adjustment(task.name, str(task.folder), adjustment)


def _diagnosed(task: Task) -> Row:
    asked = task.asked
    found = call_of("diagnose")(read(task.folder), model=asked.model, **asked.options)
    found.required = asked.required
    threads = asked.options.get("threads", 1)
    command = asked.command.replace("BLOCKS", os.fspath(task.folder), 1)
    found.save(task.target, asked.counterparts, threads, command=command, gis=asked.gis)
    return Row.of_diagnosis(task.name, str(task.folder), found)


def share_of_machine(jobs: int) -> float | None:
    """Memory (GB) for each of so many workers of this machine; None where it cannot be held."""
    if not sys.platform.startswith("linux"):
        return None
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, ValueError):
        total = min(total, int(_GROUP.read_text()))  # of a container
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
