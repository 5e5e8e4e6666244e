"""What verbs have in common: their options in one table, the types of options, and news of work."""

import argparse
import math
import os
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from corridor.core import registry

# So many files are named one by one; what somebody is to read is named last.
_MOST_FILES = 6
_REPORT = "report.html"


def checked(of: Callable, holds: Callable[..., bool], wrong: str) -> Callable[[str], object]:
    """A type of option: what `of` makes of a text, where that holds; wrong: said of any other."""

    def value(text: str):
        with suppress(ValueError):
            found = of(text)
            if holds(found):
                return found
        from corridor.core.textfile import with_point  # which loads NumPy: help does without

        if with_point(text) != text:
            wrote = f"{text!r} has a decimal comma; write {with_point(text)}"
            raise argparse.ArgumentTypeError(wrote)
        raise argparse.ArgumentTypeError(f"{text!r} {wrong}")

    return value


def digits(text: str) -> int:
    """The number that digits alone say."""
    if not text.isdecimal():
        raise ValueError
    return int(text)


def number(
    wrong: str, least: float = -math.inf, above: float = -math.inf, below: float = math.inf
) -> Callable[[str], object]:
    """A type of option: a finite number in a range; wrong: what is said of any other text."""
    return checked(float, lambda v: math.isfinite(v) and v >= least and above < v < below, wrong)


def whole(what: str, least: int) -> Callable[[str], object]:
    """A type of option: a whole number of at least so much."""
    return checked(digits, lambda v: v >= least, f"is no {what}: a whole number from {least}")


def several(of: Callable, wrong: str, counts: Iterable[int] = ()) -> Callable[[str], list]:
    """A type of option: values with commas between them, as many as one of the counts.

    wrong: what is said of any other text.
    """

    def values(text: str) -> list:
        with suppress(argparse.ArgumentTypeError):
            found = [of(word.strip()) for word in text.split(",")]
            if not counts or len(found) in counts:
                return found
        raise argparse.ArgumentTypeError(f"{text!r} {wrong}")

    return values


def names(what: str) -> Callable[[str], list[str]]:
    """A type of option: names with commas between them; `none` for no name at all."""

    def of(text: str) -> list[str]:
        found = [word.strip() for word in text.split(",") if word.strip()]
        if not found:
            raise argparse.ArgumentTypeError(f"no {what} named; write {what.upper()}, A,B or none")
        return [] if found == ["none"] else found

    return of


def slugs(text: str) -> list[str]:
    """A type of option: slugs of effects with commas between them."""
    found = [word.strip() for word in text.split(",")]
    if not all(found) or any(mark in text for mark in ":="):
        slug, values, _ = text.partition(":")
        told = f": values are estimated here, write {slug}" if values and slug else ""
        raise argparse.ArgumentTypeError(f"{text!r} is not a SLUG of `corridor effects`{told}")
    return found


def effect(text: str) -> tuple[str, dict[str, Any] | None]:
    """Slug and values of SLUG:PARAMETER=VALUE,...; no values where it is a SLUG alone."""
    from corridor.core.effects import parse_word

    try:
        return parse_word(text)
    except ValueError:
        told = "is not SLUG:PARAMETER=VALUE, for example rolling_shutter:readout=0.03"
        pointed = re.sub(r"(=\s*[+-]?\d+),(?=\d+\s*(?:,|$))", r"\1.", text)
        if pointed != text:
            told = f"has a decimal comma; write {'' if ':' in text else 'SLUG:'}{pointed}"
        raise argparse.ArgumentTypeError(f"{text!r} {told}") from None


def valued_effect(text: str) -> tuple[str, dict[str, Any]]:
    """Slug and values of SLUG:PARAMETER=VALUE,PARAMETER=VALUE."""
    name, values = effect(text)
    return name, values if values is not None else effect(f"{text}:")[1] or {}


def given_once(effects: Iterable[tuple[str, dict[str, Any] | None]]) -> dict[str, Any]:
    """Values of effects that several words give. Raises InputError where two give the same."""
    from corridor.core.errors import InputError

    found: dict[str, Any] = {}
    for name, values in effects:
        twice = set(found.get(name) or ()) & set(values or ())
        if twice:
            raise InputError(f"--effect {name}: {min(twice)} is given twice; give one value")
        found[name] = {**(found.get(name) or {}), **values} if values else found.get(name)
    return found


def option(text: str, metavar: str | None = None, of: Callable | None = None, **more) -> dict:
    """What argparse is told of an option: its help, the word for its value, and its type."""
    given = {"help": text, "metavar": metavar, "type": of, **more}
    return {key: value for key, value in given.items() if value is not None or key == "default"}


def flag(text: str, **more) -> dict:
    """What argparse is told of an option without a value."""
    return {"help": text, "action": "store_true", **more}


def picked(options: argparse.Namespace, names: str) -> dict[str, Any]:
    """What some options say, as keywords; names: with blanks between them."""
    return {name: getattr(options, name) for name in names.split()}


def _form(text: str) -> str:
    """A form of certificates, as the tool that makes them knows them."""
    known = registry.room("certificate").form_names()
    if text not in known:
        raise argparse.ArgumentTypeError(f"{text!r} is not a form: use {', '.join(known)}")
    return text


_POINTS = {"metavar": "ID,ID", "action": "extend", "type": names("point")}
SHARED = {
    "block": option("folder of the block", "BLOCK", Path),
    "--output": option("folder to write (none: print only)", "OUT", Path),
    "--camera": option(
        "free camera parameters: fixed, a list such as f,cx,cy,k1,k2, fraser8, fraser10 or fisheye",
        "WHAT",
    ),
    "--effect": option(
        "estimate this effect too (commas, may be repeated; `corridor effects` lists them)",
        "SLUG",
        slugs,
        action="extend",
        default=[],
    ),
    "--control": _POINTS
    | option("ground points held as control (default: the roles in ground.csv; none: no control)"),
    "--check": _POINTS | option("ground points to be compared with"),
    "--threads": option(
        "threads to use (default %(default)s)", "N", whole("number of threads", 1), default=1
    ),
    "--iterations": option(
        "iterations within which the adjustment has to converge (default 100)",
        "N",
        whole("number of iterations", 1),
    ),
    "--required": option(
        "3D accuracy of check points that is good enough, metres: the report then says whether "
        "it is",
        "M",
        number("is not an accuracy in metres above 0", above=0.0),
    ),
    "--seed": option("of everything drawn (default 0)", "N", whole("seed", 0), default=0),
    "--jobs": option("processes (default 1)", "N", whole("number of processes", 1), default=1),
    "--cluster": option(
        "Dask scheduler whose workers do the work (needs the extra `cluster`)",
        "ADDRESS",
        dest="cluster",
    ),
    "--level": option(
        "probability of a false name in a block that lacks nothing (default 0.01)",
        "P",
        float,
        default=0.01,
    ),
    "--loss": option(
        "squares (default), huber:2 or cauchy:2: from how many sigmas on residuals weigh less",
        "LOSS",
        default="squares",
    ),
    "--lever-arm": option(
        "estimate the GNSS lever arm of each flight, or hold it (default: as block.toml says; held "
        "where positions are too coarse to show it)",
        choices=("free", "fixed"),
    ),
    "--gis": flag(
        "also a GeoPackage of points, check vectors, cameras and footprints, and points as LAS "
        "(needs the extra `gis`)"
    ),
    "--certificate": option(
        "also a certificate in this form, as HTML and PDF: what was computed, from which files",
        "FORM",
        _form,
    ),
    "--photos": option("folder of the photographs", "FOLDER", Path),
    "--crs": option("system of the coordinates, as EPSG:2154", "CODE"),
    "--track-system": option(
        "time system of TRACK where it states none: GPST, UTC, UTC+hh:mm", "SYSTEM"
    ),
    "--images-system": option(
        "time system of IMAGES where it states none: GPST, UTC, UTC+hh:mm", "SYSTEM"
    ),
}


_OTHER = {"--output": "-o", "--verbose": "-v", "--cluster": "--scheduler"}


def kinds(parser, verb: str, title: str, word: str, table: Mapping[str, tuple]) -> list:
    """The parsers of the kinds of a verb, which have options and examples of their own.

    word: the option that says which. table: name -> what it is or does, options as of `add`,
    examples (arguments, without the verb, a line each).
    """
    made = parser.add_subparsers(title=title, metavar=word.upper(), dest=word, required=True)
    out = []
    for name, (text, options, examples) in table.items():
        lines = (f"  corridor {verb} {name} {line}" for line in examples.strip().splitlines())
        below = made.add_parser(
            name,
            help=text,
            description=f"{text[:1].upper()}{text[1:]}.",
            epilog="\n".join(["examples:", *lines, "", f"`corridor {verb} --help` says more."]),
        )
        add(below, options)
        out.append(below)
    return out


def add(parser, options: Mapping[str, Mapping]) -> None:
    """Adds options; what is the same for every verb comes from `SHARED`, by its name.

    options: name -> what differs from `SHARED`, or all that argparse is told of it; with `one_of`,
    "at most" or "exactly", where only one of those that have it can be given.
    """
    group = None
    for name, own in options.items():
        flags = (_OTHER[name], name) if name in _OTHER else (name,)
        told, place = {**SHARED.get(name, {}), **own}, parser
        if "one_of" in told:
            needed = told.pop("one_of") == "exactly"
            place = group = group or parser.add_mutually_exclusive_group(required=needed)
        place.add_argument(*flags, **told)


def say(what: object) -> None:
    """News on stderr, at once."""
    print(what, file=sys.stderr, flush=True)


def warn(sentences: Iterable[str]) -> None:
    """Warnings on stderr, a line each."""
    for sentence in sentences:
        say(f"warning: {sentence}")


def wrote(*written: str | os.PathLike) -> None:
    """What was written and where: some files a line each, many folded, the report last."""
    paths = [Path(path) for path in written]
    if len(paths) <= _MOST_FILES:
        print("\nWrote", *paths, sep="\n  ")
        return
    folder = Path(os.path.commonpath([path.parent for path in paths]))
    inside = [path.relative_to(folder) for path in paths]
    below = Counter(path.parts[0] for path in inside if len(path.parts) > 1)
    files = [path.name for path in inside if len(path.parts) == 1]
    pictures = [name for name in files if name.endswith(".png")]
    told = [name for name in files if name not in (*pictures, _REPORT)]
    told += [f"{name}/ ({count} files)" for name, count in below.items()]
    if pictures:
        told.append(f"{len(pictures)} pictures (.png)")
    print(f"\nWrote {folder}", *textwrap.wrap(", ".join(told), 96), sep="\n  ")
    if _REPORT in files:
        print(f"Read {folder / _REPORT}")


def announce_compilation(how_long: str, kernel: str = "") -> None:
    """Say so once where kernels are not compiled yet: silence looks broken.

    kernel: the one that takes long; by default any.
    """
    try:
        from numba.core import event
    except ImportError:
        return

    class Once(event.Listener):
        said = False

        def on_start(self, compilation):
            name = compilation.data["dispatcher"].py_func.__name__
            if not self.said and kernel in ("", name):
                self.said = True
                say(f"compiling for this machine, once ({how_long})")

        def on_end(self, compilation):
            pass

    event.register("numba:compile", Once())


class BlockBar:
    """A bar of blocks with the time left, and what became of the one that was done last."""

    def __enter__(self):
        from tqdm import tqdm

        self.bar = tqdm(total=0, unit="block", file=sys.stderr, mininterval=1.0)
        return self

    def __exit__(self, *_):
        self.bar.close()

    def __call__(self, progress) -> None:
        self.bar.total = progress.of
        self.bar.set_postfix_str(progress.what, refresh=False)
        self.bar.update(progress.done - self.bar.n)


class Bars:
    """A progress bar for each step that takes longer than a second."""

    def __enter__(self):
        self.bar, self.step = None, None
        return self

    def __exit__(self, *_):
        if self.bar is not None:
            self.bar.close()

    def __call__(self, progress) -> None:
        from tqdm import tqdm

        if progress.what != self.step:
            self.__exit__()
            self.step = progress.what
            form = "{desc} {percentage:3.0f} % |{bar}| {elapsed}"
            self.bar = tqdm(total=100, desc=self.step, delay=1.0, leave=False, bar_format=form)
        self.bar.update(100 * progress.done / progress.of - self.bar.n)
