"""The command `corridor`.

A verb is a file in a folder `verbs` of the command, the diagnosis or a tool, or a module of another
package (`corridor.core.registry`). It has a docstring (the verb's help: first line in the list of
verbs, the rest under `corridor VERB --help`), OPTIONS (a table for `command.options.add`; a verb of
several kinds has `configure(parser)`), and `run(options)`, which makes one call of the package and
prints what came of it. MARK, where there is one, is the file by which the folder that it writes is
known: another folder is refused before any work.
"""

import _thread
import argparse
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from corridor.core import __version__, registry
from corridor.core.command.options import add, warn
from corridor.core.errors import CorridorWarning, InputError, WorkFailed
from corridor.interface.cli._help import Parser
from corridor.interface.cli._streams import unread

__all__ = ["alone", "main"]

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
    return _answer(lambda words: _parser(*words[:1]), arguments)


def alone(verb: ModuleType, program: str, arguments: list[str] | None = None) -> int:
    """Run a module that is written as a verb, as a program of its own; its exit status."""

    def parser(words: list[str]) -> Parser:
        first, _, rest = verb.__doc__.partition("\n")
        made = Parser(prog=program, description=first, epilog=rest.strip())
        _configure(made, verb)
        return made

    return _answer(parser, arguments)


def _answer(parser_of: Callable[[list[str]], Parser], arguments: list[str] | None) -> int:
    for stream in (sys.stdout, sys.stderr):
        # A console that knows no Greek letters must not end an adjustment.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    with unread(), _interruptions() as came, warnings.catch_warnings():
        # What Pillow says of a damaged picture tells nobody more than our own sentence.
        warnings.filterwarnings("ignore", module=r"PIL\.")
        warnings.showwarning = _told(warnings.showwarning)
        try:
            words = _with_signs(arguments)
            if words[:1] == ["help"]:  # more people know `help VERB`
                words = [*words[1:], "--help"]
            options = parser_of(words).parse_args(words)
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


def _told(otherwise: Callable[..., None]) -> Callable[..., None]:
    """Warnings as they are shown: of ours the sentence, of others where they come from as well."""

    def show(message, category, *place, **more) -> None:
        if issubclass(category, CorridorWarning):
            warn([str(message)])
        else:
            otherwise(message, category, *place, **more)

    return show


def _failed(error: Exception) -> int:
    """One sentence on what went wrong, and its status; faults of ours are raised again."""
    if isinstance(error, InputError):
        return _end(2, f"error: {error}")
    if isinstance(error, WorkFailed):
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
    given = [each for name, each in vars(options).items() if name != "output"]
    every = [path for each in given for path in (each if isinstance(each, list) else [each])]
    # Links in a circle have no real path either way; who reads them says so.
    goal = Path(os.path.realpath(output))
    for path in (Path(os.path.realpath(path)) for path in every if isinstance(path, Path)):
        # A table is put beside others into the folder that is read.
        same = path == goal and (mark is not None or not goal.is_dir())
        if same or (mark is not None and path.is_dir() and goal in path.parents):
            what, kind = "is" if path == goal else "holds", "folder" if goal.is_dir() else "file"
            raise InputError(
                f"{output} {what} what is read, and would be replaced; name another {kind} with -o"
            )


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
    known = registry.verbs()
    for name in [word] if word in known else known:
        # One verb is loaded to be run; of the others the first line of their help is read.
        verb = registry.verb(name) if name == word else None
        first, _, rest = registry.help_of(name).partition("\n")
        below = verbs.add_parser(
            name,
            help=first[:1].lower() + first[1:].rstrip("."),
            description=f"{first}\n",
            epilog=rest.strip(),
        )
        if verb is not None:
            _configure(below, verb)
    return parser


def _configure(parser: Parser, verb: ModuleType) -> None:
    if hasattr(verb, "OPTIONS"):
        add(parser, verb.OPTIONS)
    else:
        verb.configure(parser)
    parser.set_defaults(run=verb.run)
