"""What is printed while nobody reads any more (`| head`): the work goes on, and is written."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class Unread:
    """A stream whose reader may leave: what comes after that goes nowhere."""

    def __init__(self, stream):
        self._stream = stream

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As the stream does; all of a text counts as written, read or not."""
        try:
            return self._stream.write(text)
        except BrokenPipeError:
            self._leave()
            return len(text)

    def flush(self) -> None:
        """As the stream does."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._leave()

    def _leave(self):
        # The descriptor itself: what the stream still holds, and libraries of C, follow.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


@contextmanager
def unread() -> Iterator[None]:
    """Standard output and error that may lose their reader."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (Unread(stream) if stream else stream for stream in before)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, Unread):
                stream.flush()
        sys.stdout, sys.stderr = before
