"""The command `corridor`.

A verb is a file of this folder, found by looking; a name that begins with an underscore is none.
It has a docstring (the verb's help: first line in the list of verbs, the rest under `corridor VERB
--help`), `configure(parser)` for its options, and `run(options)`, which makes one call of the
package and prints what came of it.
"""

import argparse
import importlib
import pkgutil
import sys

from corridor.errors import AdjustmentFailed, InputError

__all__ = ["main"]

_OPENING = """\
What did the camera of a corridor flight do that the model does not know, what does it cost on
the ground, and what happens when it is modelled?
"""

_FIRST_STEPS = """\
first steps:
  corridor summary data_synthetic/dike                 what is in a block, and what is missing
  corridor adjust data_synthetic/dike -o out/dike      adjust it: report, pictures, adjusted block
  corridor diagnose data_synthetic/dike -o out/missing what is missing from the model, and where
  corridor effects                                     what else could be estimated

A BLOCK is a folder of plain files; README.md says which. Exit status: 0 done, 1 the work failed,
2 the input is wrong, 130 interrupted.
"""


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; its exit status. Failures end on one sentence, never on a traceback."""
    for stream in (sys.stdout, sys.stderr):
        # A console that knows no Greek letters must not end an adjustment.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
        sys.stdout.flush()
        return 0
    except InputError as error:
        return _end(2, f"error: {error}")
    except AdjustmentFailed as error:
        return _end(1, f"failed: {error}")
    except KeyboardInterrupt as stop:
        return _end(130, f"interrupted: {str(stop) or 'nothing was written'}.")
    except BrokenPipeError:
        # The reader of our output (`| head`) has seen enough; nothing more can be said to it.
        sys.stdout = None
        return 0
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        return _end(1, f"failed: {what}; nothing was written.")
    except MemoryError:
        return _end(1, "failed: not enough memory for this block; nothing was written.")


def _end(status, sentence):
    sys.stdout.flush()
    print(sentence, file=sys.stderr)
    return status


def _parser():
    parser = argparse.ArgumentParser(
        prog="corridor",
        description=_OPENING,
        epilog=_FIRST_STEPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for module in pkgutil.iter_modules(__path__):
        if module.name.startswith("_"):
            # What several verbs have in common.
            continue
        verb = importlib.import_module(f"{__name__}.{module.name}")
        first, _, rest = verb.__doc__.partition("\n")
        # `import` and other words of the language are files with a trailing underscore.
        below = verbs.add_parser(
            module.name.rstrip("_").replace("_", "-"),
            help=first[:1].lower() + first[1:].rstrip("."),
            description=f"{first}\n",
            epilog=rest.strip(),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.configure(below)
        below.set_defaults(run=verb.run)
    return parser
