"""docs/guarantees.md, written from docs/guarantees.json and from nothing else."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.guarantees import dates, flights, sizes
from benchmarks.guarantees.malformed import BYTES, SECONDS

RUN = "python -m benchmarks.guarantees"
FULL = 100_000

_HEAD = """\
# Guarantees

What can be relied on, how it is tried, what came of it in the last run, and the command that
does it again. The figures are written by that command into `docs/guarantees.json`, and this page
from there; a test compares the two.

| what is guaranteed | how it is tested | figure of the last run | command |
|---|---|---|---|
"""

_EXACTLY = """
## What exactly is checked of a malformed input

A case is a small sound input of which everything true is known (a block of 12 images, a track, a
plan, photographs, a series of a wall, a thermal model, projects of six formats), one file of it
damaged (two in a fifth of the cases), and one command. Damage is: bytes lost, doubled, exchanged or
flipped; cells, columns, rows, units (feet, degrees, km/h, milliseconds, a slipped decimal point),
order, encodings, sizes; values and lines of TOML, JSON, XML; pictures cropped, turned, resized, of
other depth, blank, torn; arrays of other shapes and types; files missing, empty, doubled, swapped
with others, folders and links in their place. Seed and number of a case name it: `{run} malformed
--case 17` runs one again. All cases run in one process that is used again, with pictures of few
dots.

- **refused**: status 2, the last line begins with `error:`, and names a file or folder of the
  input (of a plan, which is one file that was typed: a flight or a key).
- **failed**: status 1 with one line, from a verb that can honestly fail: an adjustment does
  not converge, a photograph shows nothing.
- **right**: status 0, and the numbers agree with the truth: `adjust` (camera centres, points) and
  `gnss` within six of the sigmas that the result states, `readout` within six sigmas and 0.9 per
  cent, `thermal map` within 0.35 px of the undamaged series, `thermal fit` within 0.1 px of the
  true shift, `import` within 5 mm and 3 px of the undamaged project with nothing lost.
- **told**: status 0, the numbers differ, and a sentence of warning or a count is printed that the
  undamaged input does not print.
- **done**: status 0 from a verb of whose numbers nothing is known: a plan with another height is
  another plan. Only the outcome is checked: no traceback, a whole result.
- **a fault** is everything else: a traceback, {seconds} s of processor time, {gb} GB of memory, a
  process that died, half an output or hidden files left, no sentence or one that names no place,
  words of a library, and another result without a word.

What is not seen, because nothing in the input says so: rows that were cut off a photograph without
EXIF, other sigmas that are plausible, another plan, a factor on all temperatures of a series
or one of them that lies between its neighbours'.

## What is known not to hold

- `gnss` takes one epoch that is off by less than a drone can move for a movement of the drone; it
  says so only where nothing else in the flight moves nearly as much.
- `readout led` is now and then off by three of its sigmas, where unresolved edges of
  the stripes fall on their rows.
"""


def stored(figures: Path) -> dict:
    """The figures that a file holds, by part."""
    return json.loads(figures.read_text(encoding="utf-8")) if figures.is_file() else {}


def store(figures: Path, part: str, found: dict) -> None:
    """Puts the figures of a part into the file."""
    text = json.dumps(stored(figures) | {part: found}, indent=1, sort_keys=True)
    figures.write_text(text + "\n", "utf-8")


def write(figures: Path) -> None:
    """The page beside a file of figures."""
    known = json.loads(figures.read_text(encoding="utf-8"))
    figures.with_suffix(".md").write_text(text(known), encoding="utf-8", newline="\n")


def text(known: dict) -> str:
    """The page."""
    lines = ["| " + " | ".join(row) + " |" for row in _rows(known)]
    exactly = _EXACTLY.format(run=RUN, seconds=SECONDS, gb=BYTES // 2**30)
    matters = sizes.matters(known.get("sensitivity"))
    outcomes = _outcomes(known.get("malformed"))
    return _HEAD + "\n".join(lines) + "\n" + exactly + matters + outcomes


def _rows(known):
    """What, how, figure, command."""
    made = known.get
    yield (
        "A malformed block, track, plan, series, photograph or project is refused in one sentence "
        "that names the place, or gives a right result; never a traceback, a hang, more than 4 GB "
        "or half an output",
        "damaged inputs of which the truth is known, seeds fixed; the first 100 are a test",
        _malformed(made("malformed")),
        f"`{RUN} malformed --cases 100000 --jobs 2`",
    )
    yield (
        "Ctrl-C ends every verb with one line and status 130; nothing half-written stays",
        "each verb that writes, at random moments of its work, a quarter of them from the start of "
        "Python, libraries still loading; with `--jobs 2` too; four verbs in short are a test",
        _trials(
            made("interrupted"),
            "{moments} moments of {verbs} of {of_verbs} verbs: {stopped} stopped, {had_finished} "
            "had finished",
        ),
        f"`{RUN} interrupted`",
    )
    yield (
        "On a full disk a verb ends with one sentence and status 1; nothing half-written stays",
        "each verb that writes, with room for 0 to 99.9 % of its largest file; four verbs in short "
        "are a test",
        _trials(made("full"), "{tries} tries of {verbs} of {of_verbs} verbs"),
        f"`{RUN} full`",
    )
    yield (
        "Two runs at once into one folder leave the whole result of the last",
        "two processes, and two threads, again and again",
        "a test of the suite",
        "`pytest tests/interface/report/test_files.py`",
    )
    for name, (what, how) in _SIGMAS.items():
        yield (
            f"Errors are as large as stated: {what}",
            how,
            _ratio((made("sigmas") or {}).get("kinds", {}).get(name)),
            f"`{RUN} sigmas`",
        )
    yield from flights.rows(made("flights"))
    yield (
        "What is wrong with attitudes or a rig, at 10 sigma, is named, or a set with it in it",
        "small flights of drawn geometry with attitudes, or of a head of two or three cameras, one "
        "effect hidden in each, or none",
        _rigs(made("rigs")),
        "`python -m benchmarks.rigs --figures docs/guarantees.json`",
    )
    yield from sizes.rows(made)
    yield from dates.rows(made("change"))
    yield (
        "Order of rows, names, offset and unit of coordinates, CSV or Parquet do not matter",
        "one block adjusted again after each change; positions and sigmas compared",
        _changes(made("order")),
        f"`{RUN} order`",
    )
    yield (
        "The same seed gives the same bits on one machine",
        "a simulated block, its adjustment, report and pictures made twice, byte by byte",
        {None: "not run", True: "equal", False: "**differ**"}[
            (made("order") or {}).get("same_bits")
        ],
        f"`{RUN} order`",
    )
    yield (
        "A mistake of meaning in the source makes a test fail",
        "p1 for p2, a lever arm or a row direction with the other sign, milliseconds, degrees, "
        "half a pixel, a transposed rotation and the like, one at a time; the nearest tests run",
        _mutants(made("mutants")),
        f"`{RUN} mutants`",
    )
    yield (
        "Names in files reach neither outside the folder that is written nor into a page's HTML",
        "images, points, flights and the block called `../../out`, `/etc/passwd`, `<script>` ...; "
        "every verb that writes a block's names",
        _named(made("order")),
        f"`{RUN} order`",
    )


_SIGMAS = {
    "adjust": ("`adjust`, camera centres and points", "a block of 12 images, new noise each draw"),
    "plan": ("`plan`, check points of flights that follow", "expected RMS against that of draws"),
    "gnss": (
        "`gnss`, antennas between epochs",
        "smooth flights, a receiver of 2 Hz, some noise slow",
    ),
    "readout": ("`readout led`", "photographs of other readout, frequency, exposure and noise"),
    "thermal": ("`thermal fit`, shifts at 42 C", "maps with new noise each draw"),
    "diagnose": ("`diagnose`, the value of the effect that it names", "a shutter of 20 ms"),
}


def _rigs(found):
    if not found:
        return "not run"
    told = [
        f"{kind}: {one['named']} named, {one['inside']} in the set, of {one['done']}"
        for kind, one in found["kinds"].items()
        if kind not in found["nulls"]
    ]
    nulls = [found["kinds"][kind] for kind in found["nulls"]]
    false = sum(one["false"] for kind, one in found["kinds"].items() if kind not in found["nulls"])
    told.append(f"beside these {false} times something that is not there")
    told.append(
        f"flights that lack nothing: something named in {sum(one['false'] for one in nulls)} of "
        f"{sum(one['done'] for one in nulls)}"
    )
    return f"draws from {found['first']} on: " + "; ".join(told)


def _malformed(found):
    if not found:
        return "not run"
    cases, good = found["cases"], found["outcomes"]
    short = "" if cases >= FULL else f" of the {FULL:,} that the command has"
    mended = found.get("mended", 0)
    told = f"; {mended} faults of earlier cases mended and tried again" if mended else ""
    commits = len(found.get("commits", {}))
    told += f"; the code of {commits} commits, as faults were mended" if commits > 1 else ""
    return (
        f"{cases:,} cases{short}: {_faults(found)}{told}. Refused {good.get('refused', 0):,}, "
        f"right {good.get('right', 0):,}, told {good.get('told', 0):,}, "
        f"done {good.get('done', 0):,}, failed {good.get('failed', 0):,}; "
        f"longest {found['most_seconds']:g} s, most {found['most_gb']:g} GB"
    )


def _faults(found):
    count = len(found["faults"])
    return f"**{count} fault{'s' * (count > 1)}**" if count else "no fault"


def _trials(found, form):
    if not found:
        return "not run"
    return f"{form.format(**found)}; {_faults(found)}"


def _ratio(found):
    if not found:
        return "not run"
    word = "" if found["holds"] else ", **outside 0.95 to 1.05**"
    if found["holds"] and not (found["low"] > 0.9 and found["high"] < 1.1):
        narrow = found["high"] - found["low"] < 0.1
        word = ", too few to prove 0.95 to 1.05"
        if narrow:
            word = f": stated too {'large' if found['ratio'] < 1 else 'small'} by some per cent"
    if not found["holds"] and found["high"] < 0.95:
        word = ": the stated sigma is too large, **outside 0.95 to 1.05**"
    return (
        f"error over sigma {found['ratio']:.3f} ({found['low']:.3f} to {found['high']:.3f}, 95 %), "
        f"{found['draws']} draws{word}"
    )


def _changes(found):
    if not found:
        return "not run"
    told = ", ".join(f"{name} {value:.1g}" for name, value in found["off_over_sigma"].items())
    return f"largest difference over sigma: {told}"


def _mutants(found):
    if not found:
        return "not run"
    told = f": {', '.join(found['survive'])}" if found["survive"] else ""
    return f"{found['killed']} of {found['mutants']} mutants killed{told}"


def _named(found):
    if not found:
        return "not run"
    return f"{found['hostile_names']} names, {found['verbs_that_wrote']} results: {_faults(found)}"


def _outcomes(found):
    """Outcomes by kind of damage and by verb, as two tables."""
    if not found:
        return ""
    order = ["refused", "failed", "right", "told", "done"]
    others = sorted(set(found["outcomes"]) - set(order))
    lines = []
    for title, key in (("damage", "damages"), ("command", "verbs")):
        lines += ["", f"| {title} | cases | " + " | ".join(order + others) + " |",
                  "|---" * (2 + len(order + others)) + "|"]  # fmt: skip
        for name, count in sorted(found[key].items()):
            cells = [name, f"{sum(count.values()):,}"]
            cells += [f"{count.get(one, 0):,}" for one in order + others]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n## Malformed inputs, by damage and by command\n" + "\n".join(lines) + "\n"
