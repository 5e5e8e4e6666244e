"""The command `corridor`, and `python -m corridor`."""

import gc
import signal
import sys

# New objects that Python waits for before it looks for circles among them.
_NEW_OBJECTS = 200_000


def main() -> int:
    """Run the command line; Ctrl-C ends it with one line, also before it and after it."""
    # Libraries make some hundred thousand objects that stay; by default they are looked through
    # again and again while more are made.
    gc.set_threshold(_NEW_OBJECTS)
    try:
        from corridor.interface import cli

        status = cli.main()
    except KeyboardInterrupt:
        print("interrupted: nothing was written.", file=sys.stderr)
        # What was half made when Ctrl-C came (a progress bar) may complain as it goes.
        sys.unraisablehook = lambda _: None
        status = 130
    # What is left is the end of Python: a traceback from there would be about nothing, and a
    # search for circles among all that was loaded takes half a second.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()
    return status


if __name__ == "__main__":
    sys.exit(main())
