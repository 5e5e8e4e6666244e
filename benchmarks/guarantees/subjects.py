"""What is damaged, what is typed with it, and what of the result is compared with the truth."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from benchmarks.guarantees import samples
from benchmarks.guarantees.damage import CUT

# Sigmas within which a result is right: of some hundred numbers the largest is below five.
WITHIN = 6.0


@dataclass(frozen=True)
class Command:
    """words: what is typed, with {there} for the folder of the subject and {out} for the output.

    weight: how often it is taken. reads: patterns of the files that it reads. right: whether the
    result agrees with what is true, given the place of the subject, of the output, and of the
    truth; None where nothing is known. long: left out of the short form.
    """

    words: str
    weight: float
    reads: tuple[str, ...] = ("*",)
    right: Callable[[Path, Path, Path], bool] | None = None
    long: bool = False

    @property
    def writes(self) -> bool:
        """Whether it writes a result."""
        return "{out}" in self.words

    @property
    def verb(self) -> str:
        """The verb, with its kind where it has some."""
        first, second = self.words.split()[:2]
        return f"{first} {second}" if first in ("readout", "thermal") else first


@dataclass(frozen=True)
class Subject:
    """A folder of the samples, how often it is damaged, and the commands that take it."""

    name: str
    weight: float
    commands: tuple[Command, ...]


# --- what is true ------------------------------------------------------------------------------

last_adjustment: list = []


def record_adjustments() -> None:
    """Keep the result of every `corridor.adjust` for `_adjusted`, which asks it for numbers."""
    adjust = corridor.adjust

    def recorded(*arguments, **options):
        last_adjustment[:] = [adjust(*arguments, **options)]
        return last_adjustment[0]

    corridor.adjust = recorded


@functools.cache
def _true(truth: Path) -> dict:
    return json.loads((truth / "block.truth.json").read_text(encoding="utf-8"))


def _near(names, found, sigma, true) -> bool:
    """Whether positions (n, 3) with sigmas agree with those that are true, by name."""
    known = np.array([true.get(str(name), [np.nan] * 3) for name in names])
    off = np.abs(np.asarray(found, float) - known) / np.maximum(np.asarray(sigma, float), 1e-4)
    return not np.any(off > WITHIN)


def _adjusted(there, out, truth):
    """Camera centres and check points within six of their own sigmas of the truth."""
    adjustment, true = last_adjustment[0], _true(truth)
    xyz, sxyz = ["x", "y", "z"], ["sx", "sy", "sz"]
    poses = adjustment.poses
    points = adjustment.block.points
    return _near(poses["image"], poses[xyz], poses[sxyz], true["centre"]) and _near(
        points["point"], points[xyz], points[sxyz], true["points"]
    )


def _gnss(there, out, truth):
    """Antennas within six of their sigmas of the centres that were flown."""
    table = pd.read_csv(out)
    xyz, sxyz = table[["x", "y", "z"]], table[["sx", "sy", "sz"]]
    return _near(table["image"], xyz, sxyz, _true(truth)["centre"])


def _readout(target):
    def right(there, out, truth):
        found = json.loads((out / "readout.json").read_text(encoding="utf-8"))
        # No file says that rows were cut off: it is the time of the rows that are left. Rows of a
        # picture made smaller are not the rows that were read: halved twice 0.8 per cent are lost.
        times = (share * samples.READOUT_MS[target] for share in (1.0, *CUT))
        most = WITHIN * found["sigma_ms"]
        return any(abs(found["readout_ms"] - true) <= most + 0.009 * true for true in times)

    return right


def _maps(there, out, truth):
    """Shifts within six of their sigmas, beside a twentieth of a pixel of the small windows."""
    with np.load(out) as one, np.load(truth / "maps.npz") as two:
        # By the names of the pictures: their order is free.
        place = {str(name): k for k, name in enumerate(two["picture"])}
        rows = [place.get(str(name), -1) for name in one["picture"]]
        if min(rows) < 0 or one["dx"].shape[1:] != two["dx"].shape[1:]:
            return False
        both = one["valid"].astype(bool) & two["valid"].astype(bool)[rows]
        off = np.hypot(one["dx"] - two["dx"][rows], one["dy"] - two["dy"][rows])[both]
        return _one_scale(one["temperature_c"], two["temperature_c"][rows]) and bool(
            not len(off) or np.max(off) < 0.35
        )


def _one_scale(found, true) -> bool:
    """Temperatures that differ by a factor or a shift alone, or one between its neighbours'.

    No file says that these are wrong.
    """
    known = np.isfinite(found)
    if known.sum() < 3 or not known.all():
        return np.array_equal(found, true)
    line = np.polynomial.Polynomial.fit(true, found, 1)
    off = np.flatnonzero(np.abs(found - true) > 0.01)
    if len(off) == 1 and 0 < off[0] < len(true) - 1:
        beside = true[off[0] - 1], true[off[0] + 1]
        if min(beside) <= found[off[0]] <= max(beside):
            return True
    return bool(np.abs(found - line(true)).max() < 0.01)


def _thermal(there, out, truth):
    """The model moves the corner by what the true one does, within a tenth of a pixel.

    At 40 C, or at what the file calls it where all its temperatures are wrong by one scale.
    """
    one, two = (corridor.thermal.read_model(path) for path in (out, truth / "model.json"))
    x, y = np.array([10.0, 160.0]), np.array([15.0, 150.0])
    called = 40.0
    with np.load(there / "maps.npz") as maps, np.load(truth / "heat" / "maps.npz") as whole:
        warm, true = maps["temperature_c"], whole["temperature_c"]
        if warm.shape == true.shape and _one_scale(warm, true):
            called = float(np.polynomial.Polynomial.fit(true, warm, 1)(called))
    off = np.array(one.displacement(x, y, called)) - np.array(two.displacement(x, y, 40.0))
    return bool(np.abs(off).max() < 0.1)


_whole = functools.cache(corridor.read)


def _imported(there, out, truth):
    """Poses within 5 mm and image points within 3 px of those of the whole project, none lost."""
    if not any(out.glob("tie_points.*")) and not any(out.glob("marks.*")):
        return False  # poses alone are written, and said to be no block yet
    one, two = corridor.read(out), _whole(truth / f"imported_{there.name}")
    for table, columns, most in (
        ("images", ["x", "y", "z"], 0.005), ("tie_points", ["x", "y"], 3.0),
        ("marks", ["x", "y"], 3.0), ("gnss", ["x", "y", "z"], 0.005),
        ("ground", ["x", "y", "z"], 0.005),
    ):  # fmt: skip
        a, b = (getattr(block, table)[columns].to_numpy(float) for block in (one, two))
        # Names and order are free: what is there is compared as a set.
        a, b = (np.sort(np.round(v, 6), axis=0) for v in (a, b))
        if a.shape != b.shape or np.nanmax(np.abs(a - b), initial=0.0) > most:
            return False
    return True


# --- the commands ------------------------------------------------------------------------------

_ADJUST = {"right": _adjusted, "reads": ("*.csv", "*.toml")}
SUBJECTS = (
    Subject("block", 40, (
        Command("adjust {there} --iterations 30", 8, **_ADJUST),
        Command("adjust {there} --iterations 30 -o {out}", 0.15, **_ADJUST, long=True),
        Command("summary {there}", 5),
        Command("correct {there} --effect rolling_shutter:readout=0.03 -o {out}", 2),
        Command("export opensfm {there} --lossy -o {out}", 1),
        Command("export colmap {there} --corrected -o {out}", 1),
        Command("simulate --like {there} -o {out}", 0.3, long=True),
        Command("change {there} {there} --points-only", 0.15, long=True),
        Command("diagnose {there} --only gnss_bias", 0.15, long=True),
    )),
    Subject("track", 10, (
        Command("gnss {there}/track.csv --images {there} -o {out}.csv", 1, right=_gnss),
        Command("gnss {there}/track.csv --images {there}/images.csv -o {out}.csv", 1,
                ("*.csv",), right=_gnss),
    )),
    Subject("plan", 12, (
        Command("simulate {there}/plan.toml -o {out}", 5),
        Command("plan {there}/plan.toml --control 0,3", 1),
    )),
    Subject("photographs", 6, (
        Command("readout led {there}/led.jpg --frequency 800 -o {out}", 12, ("led.jpg",),
                _readout("led")),
        Command("readout star {there}/star_still.png {there}/star_turning.png "
                "--turns-per-second 3 --sense cw -o {out}", 2, ("star*",), _readout("star"),
                True),
        Command("readout wheel {there}/wheel_still.png {there}/wheel_turning.png "
                "--turns-per-second 1.5 --sense cw -o {out}", 0.5, ("wheel*",), _readout("wheel"),
                True),
    )),
    Subject("series", 5, (
        Command("thermal map {there} -o {out}.npz", 1, right=_maps),
    )),
    Subject("heat", 7, (
        Command("thermal fit {there}/maps.npz -o {out}.json", 1, ("maps.npz",), _thermal,
                True),
        Command("thermal apply {there}/model.json --points {there}/points.csv -o {out}.csv", 5,
                ("model.json", "points.csv")),
    )),
    *(
        Subject(form, 20 / len(samples.PROJECTS), (
            Command("import auto {there} -o {out}", 1, right=_imported),
        ))
        for form in samples.PROJECTS
    ),
)  # fmt: skip


def chosen(rng, short: bool) -> tuple[Subject, Command]:
    """One subject and a command with it, by their weights."""
    subject = rng.choices(SUBJECTS, [one.weight for one in SUBJECTS])[0]
    commands = [one for one in subject.commands if not (short and one.long)]
    return subject, rng.choices(commands, [one.weight for one in commands])[0]
