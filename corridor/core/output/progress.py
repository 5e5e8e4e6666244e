"""What long work says of itself while it runs: one kind of call for all of it.

corridor.adjust(block, progress=print)
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Progress:
    """One step of long work.

    what: is being done. done, of: how much of how much; of is 0 where nobody knows. result: what
    has come of the step, if anything: the figures of an iteration, the row of a block.
    """

    what: str
    done: float = 0
    of: float = 0
    result: Any = None

    def __str__(self) -> str:
        return f"{self.what}: {self.done:g} of {self.of:g}" if self.of > 1 else self.what


def telling(progress: Callable[[Progress], None] | None) -> Callable[..., None]:
    """A call that takes the fields of a `Progress` and hands it over; without anybody, silence."""

    def say(*step, **more) -> None:
        if progress:
            progress(Progress(*step, **more))

    return say


silent = telling(None)
