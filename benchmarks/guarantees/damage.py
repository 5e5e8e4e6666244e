"""What happens to files: bytes, cells, columns, units, order, encodings, sizes, swapped files.

Every kind of damage takes a file and a random generator, changes the file and says what it did.
"""

from __future__ import annotations

import csv
import io
import random
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

WORDS = (
    "", "nan", "inf", "-inf", "1e999", "-1", "0", "1e20", "-1e-300", "1,5", "abc", "=1+1", "NULL",
    "99999999999999999999", "0x10", "1_000", "../../../etc/passwd", "<script>alert(1)</script>",
    "\u00fc\u4e2d\U0001f600", "x" * 5000, "true", "12:30:00", "2019-03-01", "'", '"', "\\n", " ",
)  # fmt: skip
# Feet, degrees, km/h, knots, milliseconds and the slips of a decimal point.
FACTORS = (1e3, 1e-3, 10.0, 0.1, 100.0, 3.6, 1.944, 0.3048, 57.29578, 0.5, 2.0, -1.0, 0.0)
# Shares of rows that are left of a picture that was cropped, once or twice.
CUT = (7 / 8, 49 / 64)
_BOOLEAN = ("true", "false")


def damage_bytes(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to three damages of kinds that happen to files."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if not out:
            break
        at = rng.randrange(len(out))
        kind = rng.randrange(12)
        if kind == 0:
            del out[at:]
        elif kind == 1:
            del out[at : at + rng.choice((1, 2, 7, 50, 400))]
        elif kind == 2:
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 3:
            out[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice((1, 3, 20))))
        elif kind == 4:
            out = bytearray(b"\xef\xbb\xbf" + out)
        elif kind == 5:
            out = bytearray(out.replace(b".", b",", rng.choice((1, 10, -1))))
        elif kind == 6:
            lines = out.split(b"\n")
            spot = rng.randrange(len(lines))
            del lines[spot : spot + rng.choice((1, 1, 3))]
            out = bytearray(b"\n".join(lines))
        elif kind == 7:
            lines = out.split(b"\n")
            a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[a], lines[b] = lines[b], lines[a]
            out = bytearray(b"\n".join(lines))
        elif kind == 8:
            out = bytearray(
                out.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n")), rng.choice((3, -1)))
            )
        elif kind == 9:
            words = rng.choice(
                (b"nan", b"inf", b"-1", b"1e999", b"", b"0", b"99999999999999999999")
            )
            end = at
            while end < len(out) and out[end : end + 1] not in (b" ", b"\n", b",", b"<", b'"'):
                end += 1
            out[at:end] = words
        elif kind == 10:
            end = min(len(out), at + rng.choice((4, 8, 64)))
            out[at:end] = bytes(end - at)
        else:
            end = min(len(out), at + rng.choice((10, 100, 1000)))
            out[end:end] = out[at:end]
    return bytes(out)


def damage(path: Path, rng: random.Random, others: list[Path]) -> str:
    """Damage one file in one way; the kind of damage, and what was done.

    others: files beside it that it may be swapped with.
    """
    kinds: dict[str, tuple[int, Callable]] = {"bytes": (3, _bytes)}
    kinds["file"] = (2, lambda path, rng: _file(path, rng, others))
    if path.suffix == ".csv":
        kinds |= {"cell": (6, _cell), "column": (5, _column), "order": (3, _rows)}
        kinds |= {"encoding": (2, _encoding), "size": (1, _size)}
    elif path.suffix in (".png", ".jpg"):
        kinds |= {"picture": (6, _picture)}
    elif path.suffix == ".npz":
        kinds |= {"array": (6, _array)}
    elif path.suffix in (".toml", ".json", ".xml", ".txt", ".out"):
        kinds |= {"value": (6, _value), "line": (2, _line), "encoding": (2, _encoding)}
    kind = rng.choices(list(kinds), [weight for weight, _ in kinds.values()])[0]
    _apart(path)
    return f"{kind}: {path.name}: {kinds[kind][1](path, rng)}"


def _apart(path):
    """Make a file of its own of what may be a link to the undamaged one."""
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data)


def _bytes(path, rng):
    path.write_bytes(damage_bytes(path.read_bytes(), rng))
    return "bytes"


# --- whole files -------------------------------------------------------------------------------


def _file(path, rng, others):
    what = rng.choice(("gone", "empty", "a folder", "itself", "twice", "swapped", "another"))
    data = path.read_bytes()
    other = rng.choice(others) if others else path
    if what == "twice":
        path.write_bytes(data + data)
    elif what == "swapped":
        path.write_bytes(other.read_bytes())
        _apart(other)
        other.write_bytes(data)
    elif what == "another":
        path.write_bytes(other.read_bytes())
    else:
        path.unlink()
        if what == "empty":
            path.touch()
        elif what == "a folder":
            path.mkdir()
        elif what == "itself":
            path.symlink_to(path.name)
    return f"{what} ({other.name})" if what in ("swapped", "another") else what


# --- tables ------------------------------------------------------------------------------------


def _read(path):
    return list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))


def _write(path, rows):
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    path.write_text(out.getvalue(), encoding="utf-8")


def _times(text, factor):
    try:
        return repr(float(text) * factor)
    except ValueError:
        return text


def _cell(path, rng):
    rows = _read(path)
    done = []
    for _ in range(rng.choice((1, 1, 1, 2))):
        at, column = rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
        old = rows[at][column]
        how = rng.randrange(4)
        if how == 0:
            new = rng.choice(WORDS)
        elif how == 1:
            new = _times(old, rng.choice(FACTORS))
        elif how == 2:
            new = rows[rng.randrange(1, len(rows))][column]
        else:
            new = rng.choice(rows[rng.randrange(1, len(rows))])
        rows[at][column] = new
        done.append(f"row {at + 1}, {rows[0][column]} {old[:20]!r} -> {new[:20]!r}")
    _write(path, rows)
    return "; ".join(done)


def _column(path, rng):
    rows = _read(path)
    head, one = rows[0], rng.randrange(len(rows[0]))
    two, name = rng.randrange(len(head)), rows[0][one]
    what = rng.choice(("gone", "renamed", "exchanged", "unit", "shifted", "empty", "same", "twice"))
    if what == "gone":
        rows = [row[:one] + row[one + 1 :] for row in rows]
    elif what == "renamed":
        head[one] = rng.choice((name.upper(), f" {name}_m", "", "\u00fc", head[two], name + "1"))
    elif what == "exchanged":
        head[one], head[two] = head[two], head[one]
        return _write(path, rows) or f"columns {name} and {head[one]} exchanged"
    elif what == "twice":
        rows = [[*row, row[one]] for row in rows]
    else:
        factor, plus = rng.choice(FACTORS), rng.choice((43.0, 18.0, 0.5, 5e5, 5.7e6, -1e9))
        for row in rows[1:]:
            if what == "unit":
                row[one] = _times(row[one], factor)
            elif what == "shifted":
                row[one] = str(float(row[one]) + plus) if _times(row[one], 1) != row[one] else ""
            else:
                row[one] = "" if what == "empty" else rows[1][one]
        what = {"unit": f"times {factor}", "shifted": f"plus {plus}"}.get(what, what)
    _write(path, rows)
    return f"column {name} {what}"


def _rows(path, rng):
    rows = _read(path)
    what = rng.choice(("shuffled", "turned", "some", "half", "twice", "no header", "header only"))
    body = rows[1:]
    if what == "shuffled":
        rng.shuffle(body)
    elif what == "turned":
        body.reverse()
    elif what == "some":
        share = rng.choice((0.05, 0.3, 0.95))
        body = [row for row in body if rng.random() > share]
    elif what == "half":
        body = body[: len(body) // 2]
    elif what == "twice":
        body += [list(row) for row in rng.sample(body, max(1, len(body) // rng.choice((1, 20))))]
    elif what == "header only":
        body = []
    _write(path, body if what == "no header" else [rows[0], *body])
    return f"rows {what}"


def _size(path, rng):
    rows = _read(path)
    what = rng.choice(("many", "wide", "long"))
    if what == "many":
        rows += rows[1:] * max(1, 20_000 // len(rows))
    elif what == "wide":
        rows = [[*row, *([f"c{k}" for k in range(2000)] if n == 0 else ["1"] * 2000)]
                for n, row in enumerate(rows)]  # fmt: skip
    else:
        rows[-1][0] = "y" * 1_000_000
    _write(path, rows)
    return what


# --- texts -------------------------------------------------------------------------------------


def _encoding(path, rng):
    text = path.read_bytes().decode("utf-8", errors="replace")
    what = rng.choice(("utf-16", "latin-1", "bom", "crlf", "cr", ";", "tab", "quotes", "comma"))
    if what == "utf-16":
        data = text.encode("utf-16")
    elif what == "latin-1":
        at = rng.randrange(len(text) + 1)
        data = (text[:at] + "\u00fc" + text[at:]).encode("latin-1", errors="replace")
    elif what == "bom":
        data = b"\xef\xbb\xbf" + text.encode()
    else:
        pair = {"crlf": ("\n", "\r\n"), "cr": ("\n", "\r"), ";": (",", ";"), "tab": (",", "\t")}
        pair |= {"quotes": (",", '","'), "comma": (".", ",")}
        data = text.replace(*pair[what]).encode()
    path.write_bytes(data)
    return what


def _value(path, rng):
    text = path.read_bytes().decode("utf-8", errors="replace")
    places = list(re.finditer(r"-?\d+\.?\d*(?:[eE][+-]?\d+)?|true|false", text))
    if not places:
        return _bytes(path, rng)
    place = rng.choice(places)
    old = place.group()
    how = rng.randrange(3)
    if how == 0 or old in _BOOLEAN:
        new = rng.choice((*WORDS, "[]", "{}", "[1, 2]", '"1"', "null"))
    elif how == 1:
        new = _times(old, rng.choice(FACTORS))
    else:
        new = rng.choice(places).group()
    path.write_text(text[: place.start()] + new + text[place.end() :], encoding="utf-8")
    line = text.count("\n", 0, place.start()) + 1
    return f"line {line}, {old[:20]!r} -> {new[:20]!r}"


def _line(path, rng):
    lines = path.read_bytes().decode("utf-8", errors="replace").split("\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.choice(("gone", "twice", "moved", "misspelt", "cut"))
    if what == "gone":
        del lines[at]
    elif what == "twice":
        lines.insert(at, lines[at])
    elif what == "moved":
        lines.insert(to, lines.pop(at))
    elif what == "cut":
        lines[at] = lines[at][: len(lines[at]) // 2]
    else:
        words = re.findall(r"[A-Za-z_]{3,}", lines[at])
        word = rng.choice(words) if words else ""
        lines[at] = lines[at].replace(word, word[:-2] + word[-1:] + word[-2:-1]) if word else "x"
    path.write_text("\n".join(lines), encoding="utf-8")
    return f"line {at + 1} {what}"


# --- pictures and arrays -----------------------------------------------------------------------


def _picture(path, rng):
    grey = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    high, wide = grey.shape[:2]
    made = {
        "half": lambda: cv2.resize(grey, (wide // 2, high // 2)),
        "larger": lambda: cv2.resize(grey, (wide * 5 // 4, high * 5 // 4)),
        "cropped": lambda: grey[high // 8 :, : wide - wide // 6],
        "turned": lambda: cv2.rotate(grey, cv2.ROTATE_90_CLOCKWISE),
        "upside down": lambda: cv2.rotate(grey, cv2.ROTATE_180),
        "mirrored": lambda: grey[:, ::-1],
        "colour": lambda: np.dstack([grey] * 3) if grey.ndim == 2 else grey[..., 0],
        "alpha": lambda: np.dstack([*[grey if grey.ndim == 2 else grey[..., 0]] * 3, grey * 0 + 9]),
        "16 bit": lambda: grey.astype(np.uint16) * 257,
        "black": lambda: np.zeros_like(grey),
        "white": lambda: np.full_like(grey, 255),
        "negative": lambda: 255 - grey,
        "dark": lambda: (grey * 0.05).astype(np.uint8),
        "noise": lambda: np.random.default_rng(rng.randrange(99)).integers(
            0, 256, grey.shape, np.uint8
        ),
        "one pixel": lambda: grey[:1, :1],
        "a line": lambda: grey[:1],
        "blurred": lambda: cv2.GaussianBlur(grey, (0, 0), 6.0),
        "torn": lambda: np.concatenate([grey[high // 2 :], grey[: high // 2]]),
    }  # fmt: skip
    what = rng.choice([*made, "huge", "another format"])
    if what == "huge" and path.suffix == ".png":
        data = bytearray(path.read_bytes())
        data[16:24] = (60000).to_bytes(4, "big") * 2  # width and height of the header
        path.write_bytes(data)
        return what
    new = made[what]() if what in made else grey
    suffix = rng.choice((".bmp", ".tif", ".ppm")) if what == "another format" else path.suffix
    if suffix == ".jpg" and new.dtype != np.uint8:
        new = new.astype(np.uint8)
    path.write_bytes(cv2.imencode(suffix, new)[1].tobytes())
    return what


def _array(path, rng):
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    name = rng.choice(list(arrays))
    old = arrays[name]
    number = old.dtype.kind in "fiu"
    what = rng.choice(("gone", "empty", "nan", "scaled", "turned", "text", "flat", "zero", "more"))
    if what == "gone":
        del arrays[name]
    elif what == "empty":
        arrays[name] = old[:0] if old.ndim else old
    elif what == "nan" and number:
        arrays[name] = old.astype(float)
        flat = arrays[name].reshape(-1)
        flat[rng.randrange(flat.size)] = rng.choice((np.nan, np.inf, -np.inf))
    elif what == "scaled" and number:
        arrays[name] = old * rng.choice(FACTORS)
    elif what == "turned":
        arrays[name] = old.T[::-1] if old.ndim else old
    elif what == "text":
        arrays[name] = old.astype(str)
    elif what == "zero" and number:
        arrays[name] = old * 0
    elif what == "more":
        arrays[name] = np.stack([old, old])
    else:
        arrays[name] = old.reshape(-1)
    with path.open("wb") as file:
        np.savez(file, **arrays)
    return f"{name} {what}"
