"""The command `corridor`.

A verb is a file of this folder, found by looking; a name that begins with an underscore is none.
It has a docstring (the verb's help: first line in the list of verbs, the rest under `corridor VERB
--help`), OPTIONS (a table for `_options.add`; a verb of several kinds has `configure(parser)`), and
`run(options)`, which makes one call of the package and prints what came of it. MARK, where there
is one, is the file by which the folder that it writes is known: another folder is refused before
any work.
"""

import _thread
import argparse
import importlib
import pkgutil
import re
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from corridor import __version__
from corridor.core.command.options import add
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.interface.cli._help import Parser
from corridor.interface.cli._streams import unread

__all__ = ["main"]

_OPENING = """\
What did the camera of a corridor flight do that the model does not know, what does it cost on
the ground, and what happens when it is modelled?
"""

_FIRST_STEPS = """\
first steps:
  corridor summary data_synthetic/dike
      what is in a block, and what is missing
  corridor adjust data_synthetic/dike -o out/dike
      adjust it: report, pictures, adjusted block
  corridor diagnose data_synthetic/dike -o out/missing
      what is missing from the model, and where
  corridor effects
      what else could be estimated
  corridor VERB --help
      options and examples of one verb

A BLOCK is a folder of plain files; README.md says which. Exit status: 0 done, 1 the work failed,
2 the input is wrong, 130 interrupted.
"""


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; its exit status. Failures end on one sentence, never on a traceback."""
    for stream in (sys.stdout, sys.stderr):
        # A console that knows no Greek letters must not end an adjustment.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    with unread(), _interruptions() as came, warnings.catch_warnings():
        # What Pillow says of a damaged picture tells nobody more than our own sentence.
        warnings.filterwarnings("ignore", module=r"PIL\.")
        try:
            words = _asking(_with_signs(arguments))
            options = _parser(*words[:1]).parse_args(words)
            _check_output(options)
            options.run(options)
            sys.stdout.flush()
            return 0
        except (Exception, KeyboardInterrupt) as error:
            # What is interrupted while it loads raises what it likes.
            stopped = isinstance(error, KeyboardInterrupt)
            if came and not stopped:
                error, stopped = KeyboardInterrupt(), True
            if stopped:
                return _end(130, f"interrupted: {str(error) or 'nothing was written'}.")
            return _failed(error)


def _failed(error: Exception) -> int:
    """One sentence on what went wrong, and its status; faults of ours are raised again."""
    if isinstance(error, InputError):
        return _end(2, f"error: {error}")
    if isinstance(error, AdjustmentFailed):
        return _end(1, f"failed: {error}")
    if isinstance(error, OSError):
        # What is not whole yet has a hidden name, of which nobody knows.
        name = re.sub(r"\.([^/\\]+)\.[0-9a-f]{8}\.(part|old)", r"\1", str(error.filename or ""))
        what = f"{name}: {error.strerror}" if name else error.strerror or str(error)
        return _end(1, f"failed: {what}; nothing was written.")
    if isinstance(error, MemoryError):
        return _end(1, "failed: not enough memory for this block; nothing was written.")
    raise error


def _check_output(options: argparse.Namespace) -> None:
    """Whether the result can be written, before it is worked out."""
    output = getattr(options, "output", None)
    if output is None:
        return
    from corridor.core.output import check_folder, check_writable

    check_writable(output)
    mark = getattr(sys.modules[options.run.__module__], "MARK", None)
    if mark is not None:
        check_folder(output, mark)


@contextmanager
def _interruptions() -> Iterator[list]:
    """A list that is no longer empty once Ctrl-C was pressed, even where a library hides it."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return

    def interrupted(number, _):
        came.append(number)
        raise KeyboardInterrupt

    def unraisable(lost):
        if lost.exc_type is not KeyboardInterrupt:
            return hook(lost)
        # It fell into a callback that may not raise (the import system has some): once more, soon.
        threading.Timer(0.05, _thread.interrupt_main).start()

    hook, sys.unraisablehook = sys.unraisablehook, unraisable
    before = signal.signal(signal.SIGINT, interrupted)
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook


def _with_signs(words: list[str] | None) -> list[str]:
    """The words of a command, values that begin with a minus joined to their options.

    argparse takes `--bias -0.05,0,0.07` for two options.
    """
    out: list[str] = []
    for word in sys.argv[1:] if words is None else words:
        if out and re.fullmatch(r"--[a-z-]+", out[-1]) and re.match(r"-\.?\d", word):
            out[-1] = f"{out[-1]}={word}"
        else:
            out.append(word)
    return out


def _asking(words: list[str]) -> list[str]:
    """`help VERB` as `VERB --help`, which more people know."""
    return [*words[1:], "--help"] if words[:1] == ["help"] else words


def _end(status, sentence):
    sys.stdout.flush()
    # One sentence is one line, also where a name from a file has line breaks.
    print(" ".join(sentence.split()), file=sys.stderr)
    return status


def _parser(word: str = ""):
    """The parser of all verbs; of one alone where the first word of a command names it."""
    parser = Parser(prog="corridor", description=_OPENING, epilog=_FIRST_STEPS)
    parser.add_argument("--version", action="version", version=f"corridor {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    # What several verbs have in common begins with an underscore; `import` and other words of the
    # language are files with a trailing one.
    files = [found.name for found in pkgutil.iter_modules(__path__) if found.name[0] != "_"]
    names = {file.rstrip("_").replace("_", "-"): file for file in files}
    for name in [word] if word in names else names:
        verb = importlib.import_module(f"{__name__}.{names[name]}")
        first, _, rest = verb.__doc__.partition("\n")
        below = verbs.add_parser(
            name,
            help=first[:1].lower() + first[1:].rstrip("."),
            description=f"{first}\n",
            epilog=rest.strip(),
        )
        if hasattr(verb, "OPTIONS"):
            add(below, verb.OPTIONS)
        else:
            verb.configure(below)
        below.set_defaults(run=verb.run)
    return parser
