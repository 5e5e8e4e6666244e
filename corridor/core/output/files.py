"""Files and folders that appear whole or not at all, also where two runs write the same ones.

What is written stands under a hidden name of its own until it is whole; the run that ends last
wins, whole, and nothing hidden stays.
"""

import errno
import glob
import io
import json
import math
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import is_numeric_dtype

from corridor.core.errors import InputError
from corridor.core.output.json import json_text
from corridor.core.output.letters import CODED, NOTE, printable
from corridor.core.output.units import named_with_units

# The smallest result has a table and a picture.
LEAST_FREE = 1_000_000
_FILE = "file: "
# Also behind blanks and control characters, which some spreadsheets pass over; and in full width.
_FORMULA = re.compile(r"'*[\s\x00-\x1f]*[=+\-@\uff1d\uff0b\uff0d\uff20]|'*[\t\r\n]")


@contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """A path to write to, which becomes `path` when the `with` ends well; its folder is made."""
    with whole_files(path) as (part,):
        yield part


@contextmanager
def whole_files(*paths: str | os.PathLike) -> Iterator[tuple[Path, ...]]:
    """Paths to write to, which become `paths`, in this order, when the `with` ends well.

    Otherwise (error, full disk, Ctrl-C) none of them is touched, nor is any folder made.
    """
    targets = [Path(path) for path in paths]
    token = uuid.uuid4().hex[:8]
    parts = tuple(path.with_name(f".{path.name}.{token}.part") for path in targets)
    made = [parent for parent in targets[0].parents if not parent.exists()]
    try:
        targets[0].parent.mkdir(parents=True, exist_ok=True)
        yield parts
        with _alone_in(targets[0].parent):
            for part, target in zip(parts, targets, strict=True):
                part.replace(target)
    except BaseException:
        for part in parts:
            part.unlink(missing_ok=True)
        _remove_empty(made)
        raise


@contextmanager
def whole_folder(
    folder: str | os.PathLike, mark: str, ours: Callable[[str], bool] | None = None
) -> Iterator[Path]:
    """A folder to write into, which becomes `folder` when the `with` ends well.

    Otherwise (error, full disk, Ctrl-C) nothing of it stays and what `folder` held is untouched.
    mark: file that tells a folder of this kind; another folder that is not empty is not replaced.
    ours: files that may go with the old folder, paths in it with slashes, asked when it goes; by
    default those that `mark` lists (`listed_in`). All others are kept, in folders of ours as well.
    Raises InputError where `folder` is something else.
    """
    check_folder(folder, mark)
    target = Path(folder).resolve()
    made = [parent for parent in target.parents if not parent.exists()]
    token = uuid.uuid4().hex[:8]
    part, old = (target.parent / f".{target.name}.{token}.{end}" for end in ("part", "old"))
    try:
        part.mkdir(parents=True)
        yield part
        with _alone_in(target.parent):
            try:
                if target.exists():
                    _keep(target, part, ours or listed_in(folder, mark))
                    target.rename(old)
                part.rename(target)
            finally:
                # Only while we are alone does a missing folder mean that ours did not get there.
                if target.exists():
                    shutil.rmtree(old, ignore_errors=True)
                elif old.exists():
                    old.rename(target)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        _remove_empty(made)
        raise


def check_writable(path: str | os.PathLike) -> None:
    """Raises OSError where nothing can be written at a path: to be told before long work."""
    target = Path(path).absolute()
    place = next(one for one in (target, *target.parents) if one.exists())
    if place != target and not place.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is a file, no folder to write in", str(place))
    place = place if place.is_dir() else place.parent
    if not os.access(place, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "no permission to write there", str(place))
    if shutil.disk_usage(place).free < LEAST_FREE:
        raise OSError(errno.ENOSPC, "no free place on this disk", str(place))


def check_folder(folder: str | os.PathLike, mark: str) -> None:
    """Raises InputError where `whole_folder` would refuse a folder: to be told before long work."""
    target = Path(folder).resolve()
    if not target.exists():
        return
    with _alone_in(target.parent):  # else another run may take it away between two looks
        if target.exists() and not target.is_dir():
            raise InputError(f"{folder} is a file; name a folder to write to")
        if target.exists() and any(target.iterdir()) and not (target / mark).is_file():
            raise InputError(
                f"{folder} is a folder without {mark}, so it is not replaced; name a new folder"
            )


def listed_in(folder: str | os.PathLike, mark: str, key: str = "files") -> Callable[[str], bool]:
    """Whether a file of a folder is on the list that its result keeps: `ours` of `whole_folder`.

    mark: the file of the result: JSON with paths in the folder under `key`, or text with the lines
    of `file_lines`.
    """
    path = Path(folder) / mark
    listed: dict[int, set[str]] = {}

    def ours(name: str) -> bool:
        try:
            written = path.stat().st_mtime_ns
            if written not in listed:
                listed[written] = _listed(path.read_text(encoding="utf-8"), key)
        except (OSError, ValueError, KeyError, TypeError):
            return name == mark
        return name == mark or name in listed[written]

    return ours


def _listed(text: str, key: str) -> set[str]:
    if text.startswith("{"):
        return set(map(str, json.loads(text)[key]))
    return {line[len(_FILE) :] for line in text.splitlines() if line.startswith(_FILE)}


def file_lines(folder: Path) -> str:
    """A line for each file of a folder, for a mark that is a text."""
    return "".join(f"{_FILE}{name}\n" for name in files_in(folder))


def files_in(folder: Path) -> list[str]:
    """Every file of a folder and of those in it, as sorted paths with slashes."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """JSON of finite numbers or null, a value a line."""
    path.write_text(json_text(content), encoding="utf-8", newline="\n")


def write_csv(frame: pd.DataFrame, path: Path, digits: int = 10) -> None:
    """A table with so many digits and units in its column names; empty where a number is unknown.

    These tables are opened in spreadsheets, which would run a name like `=cmd|...`: a text that
    begins so gets an apostrophe before it (`harmless`).
    """
    table = named_with_units(frame).rename(columns=harmless)
    for name in table.columns[[not is_numeric_dtype(kind) for kind in table.dtypes]]:
        table[name] = table[name].map(harmless)
    table.to_csv(path, index=False, float_format=f"%.{digits}g", lineterminator="\n")


def harmless(text: object) -> object:
    """The same, with an apostrophe before a text that a spreadsheet would take for a formula.

    A number is none, whatever its sign. Source: OWASP, CSV injection.
    """
    if not isinstance(text, str):
        return text
    text = text.replace("\r", " ")  # it would begin a row of its own
    if not _FORMULA.match(text):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def as_it_was(text: str) -> str:
    """What `harmless` was given."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def png(figure, dpi: float = 144) -> bytes:
    """A matplotlib figure as the bytes of a PNG file, without date or program version."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = figure.canvas
    if not isinstance(canvas, FigureCanvasAgg):
        canvas = FigureCanvasAgg(figure)
    before, stream = figure.dpi, io.BytesIO()
    _write_printably(figure)
    # `savefig` would draw twice what matplotlib lays out, and pack an opacity that is one.
    try:
        figure.dpi = dpi
        canvas.draw()
        size, pixels = canvas.get_width_height(), canvas.buffer_rgba()
        picture = Image.frombuffer("RGBA", size, pixels, "raw", "RGBA", 0, 1)
        picture.convert("RGB").save(stream, format="png", compress_level=4)
    finally:
        figure.dpi = before
    return stream.getvalue()


def _write_printably(figure) -> None:
    """Names in letters that the font lacks by their numbers, with a line that says so."""
    from matplotlib.text import Text
    from matplotlib.ticker import FixedLocator

    coded = False
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_locator(), FixedLocator):
            names = [label.get_text() for label in axis.get_ticklabels()]
            shown = [printable(name) for name in names]
            if shown != names:
                axis.set_ticks(axis.get_majorticklocs(), shown)
                coded = True
    for text in figure.findobj(Text):
        written = text.get_text()
        if written != (plain := printable(written)):
            text.set_text(plain)
        coded |= bool(CODED.search(plain))
    if coded:
        figure.text(0.005, 0.002, NOTE, size=5, color="#6f6f6f", va="bottom", parse_math=False)


def write_picture(figure, path: Path) -> bytes:
    """Writes a matplotlib figure as PNG; returns the bytes."""
    content = png(figure)
    path.write_bytes(content)
    return content


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Who else replaces something in a folder waits."""
    try:
        import fcntl
    except ImportError:
        # Who has waited for half a minute goes on without it.
        with _existing(folder / ".corridor.lock", 30.0):
            yield
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


@contextmanager
def folder_of(path: Path) -> Iterator[None]:
    """The folder of a file is there: made if need be, and gone again if nothing stays in it."""
    made = [parent for parent in path.absolute().parents if not parent.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        _remove_empty(made)


@contextmanager
def sole(path: Path, wait: bool = False) -> Iterator[bool]:
    """Whether nobody else holds this file, also on another machine that shares the disk.

    The system lets go of it when the process that holds it dies. It is gone when the `with` ends.
    wait: until nobody else holds it.
    """
    try:
        import fcntl
    except ImportError:
        with _existing(path, math.inf if wait else 0.0) as ours:
            yield ours
        return
    while True:
        lock = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            os.close(lock)
            yield False
            return
        except OSError:  # a disk without locks: nobody can be asked
            break
        with suppress(FileNotFoundError):
            # Who held it may have removed it: then another file of that name is the one to hold.
            if os.path.samestat(os.stat(path), os.fstat(lock)):
                break
        os.close(lock)
    try:
        yield True
    finally:
        path.unlink(missing_ok=True)
        os.close(lock)


@contextmanager
def _existing(path: Path, seconds: float) -> Iterator[bool]:
    """Whether this file is ours within so many seconds, where files cannot be locked (Windows).

    Only one can create it, and the system removes it once it is closed, also when its process
    dies.
    """
    removed = getattr(os, "O_TEMPORARY", 0)
    until, lock = time.monotonic() + seconds, None
    while lock is None:
        try:
            lock = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | removed)
        except (FileExistsError, PermissionError):  # it is there, or on its way out
            if time.monotonic() >= until:
                break
            time.sleep(0.01)
        except OSError:
            break
    try:
        yield lock is not None
    finally:
        if lock is not None:
            os.close(lock)
            if not removed:
                path.unlink(missing_ok=True)


def forget_parts(folder: str | os.PathLike) -> None:
    """Removes what a killed run left of a folder, which nobody may be writing now."""
    target = Path(folder).resolve()
    for end in ("part", "old"):
        for left in target.parent.glob(f".{glob.escape(target.name)}.????????.{end}"):
            shutil.rmtree(left, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _keep(source: Path, target: Path, ours: Callable[[str], bool]) -> None:
    for folder, folders, files in os.walk(source):
        at = Path(folder).relative_to(source)
        for name in folders:
            # An empty folder is somebody's; a link is one thing, whatever it leads to.
            if (source / at / name).is_symlink():
                files.append(name)
            elif not any((source / at / name).iterdir()):
                (target / at / name).mkdir(parents=True, exist_ok=True)
        for name in files:
            if ours((at / name).as_posix()):
                continue
            if (target / at / name).is_dir():
                raise FileExistsError(
                    errno.EEXIST, "is in the way of a folder, move it", str(source / at / name)
                )
            if os.path.lexists(target / at / name):
                continue
            (target / at).mkdir(parents=True, exist_ok=True)
            _link(source / at / name, target / at / name)


def _link(source: str | Path, target: str | Path) -> None:
    # A hard link costs nothing; not every file system has them.
    try:
        os.link(source, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, target, follow_symlinks=False)
