"""What must not matter does not: order of rows, names, offsets, units, forms of files; seeds.

And names that come with a file reach neither outside the folder that is written nor into a page.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from benchmarks.guarantees import samples
from corridor.core.simulation import read_plan

XYZ, SXYZ = ["x", "y", "z"], ["sx", "sy", "sz"]
SHIFT = np.array([500_000.0, 5_700_000.0, 40.0])
# Of the standard deviation: far below anything that could matter, far above the last digits of
# coordinates of millions of metres and of other summation orders.
MOST = 0.01
HOSTILE = (
    "../../out", "/etc/passwd", "..", "a/b/c", "<script>alert(1)</script>", '"><img src=x>',
    "&lt;b&gt;", "name with blanks", "\u00fc\u4e2d", "x" * 100, "con", "-rf",
)  # fmt: skip


def run(seed: int) -> dict:
    """Every change that must not matter: the largest difference over sigma; the figures."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        (home / "plan.toml").write_text(samples.PLAN, encoding="utf-8")
        plan = read_plan(str(home / "plan.toml"))
        block = corridor.simulate(plan, seed=7).copy()
        base = corridor.adjust(block)
        off = {name: change(block, base, home, seed) for name, change in CHANGES.items()}
        same = _same_bits(plan, home)
        out = names(block, home)
    return {
        "off_over_sigma": off, "same_bits": same, **out, "seed": seed,
        "holds": max(off.values()) < MOST and same and not out["faults"],
    }  # fmt: skip


def _off(base, found, renamed=lambda name: name, back=lambda xyz: xyz, scale=1.0) -> float:
    """The largest difference of positions, and of their sigmas, over the sigma."""
    most = 0.0
    for one, two, key in (
        (base.poses, found.poses, "image"), (base.block.points, found.block.points, "point")
    ):  # fmt: skip
        known = one.assign(**{key: [renamed(str(name)) for name in one[key]]}).set_index(key)
        known = known.loc[two[key].astype(str)]
        sigma = known[SXYZ].to_numpy(float)
        moved = back(two[XYZ].to_numpy(float)) - known[XYZ].to_numpy(float)
        wider = two[SXYZ].to_numpy(float) / scale - sigma
        most = max(most, *(float(np.nanmax(np.abs(v) / sigma)) for v in (moved, wider)))
    return most


def _rows(block, base, home, seed):
    """Rows of every table in another order."""
    other = block.copy()
    for n, table in enumerate(TABLES):
        frame = getattr(other, table)
        setattr(other, table, frame.sample(frac=1.0, random_state=seed + n).reset_index(drop=True))
    return _off(base, corridor.adjust(other))


TABLES = "images", "tie_points", "points", "marks", "ground", "gnss"


def _called(block, new):
    """The block with other names; new: of a column, the new name of a name."""
    other = block.copy()
    for table in TABLES:
        frame = getattr(other, table)
        for key in sorted(set(new) & set(frame)):
            called = [new[key](str(name)) for name in frame[key]]
            kind = frame[key].dtype
            frame = frame.assign(**{key: pd.Categorical(called) if kind == "category" else called})
        setattr(other, table, frame)
    return other


def _names(block, base, home, seed):
    """Every image, point and flight called otherwise, in another order of the alphabet."""

    def renamed(name):
        return f"{name[::-1]} x"

    other = _called(block, {key: renamed for key in ("image", "point", "flight")})
    other.lever_arm = {renamed(name): arm for name, arm in block.lever_arm.items()}
    other.write(home / "renamed")
    return _off(base, corridor.adjust(corridor.read(home / "renamed")), renamed)


def _offset(block, base, home, seed):
    """All coordinates larger by an offset, as in a national grid."""
    other = block.copy()
    for table in ("images", "points", "ground", "gnss"):
        frame = getattr(other, table)
        setattr(
            other, table, frame.assign(**{k: frame[k] + v for k, v in zip(XYZ, SHIFT, strict=True)})
        )
    return _off(base, corridor.adjust(other), back=lambda xyz: xyz - SHIFT)


def _unit(block, base, home, seed):
    """All lengths on the ground ten times as long: a flight ten times as high."""
    other = block.copy()
    for table, columns in (
        ("images", [*XYZ, "vx", "vy", "vz"]), ("points", XYZ), ("ground", XYZ + SXYZ),
        ("gnss", XYZ + SXYZ),
    ):  # fmt: skip
        frame = getattr(other, table)
        held = [name for name in columns if name in frame]
        setattr(other, table, frame.assign(**{name: 10.0 * frame[name] for name in held}))
    for key in ("gnss_m", "control_m"):
        other.sigma[key] = 10.0 * np.asarray(other.sigma[key])
    return _off(base, corridor.adjust(other), back=lambda xyz: xyz / 10.0, scale=10.0)


def _form(block, base, home, seed):
    """Written as CSV and as Parquet, and read again."""
    block.write(home / "as_csv")
    block.write(home / "as_parquet", form="parquet")
    return max(
        _off(base, corridor.adjust(corridor.read(home / form))) for form in ("as_csv", "as_parquet")
    )


CHANGES = {"order of rows": _rows, "names": _names, "offset": _offset, "unit of length": _unit,
           "form of files": _form}  # fmt: skip


def _same_bits(plan, home) -> bool:
    """Whether the same plan, seed and block twice write the same bytes, results included."""
    made = []
    for turn in ("one", "two"):
        place = home / turn / "block"
        corridor.simulate(plan, {"rolling_shutter": {"readout": 0.02}}, 3).write(place)
        found = corridor.adjust(corridor.read(place), effects=["rolling_shutter"])
        found.save(home / turn / "result", corridor.figures.of_adjustment(found))
        made.append(_bytes(home / turn))
    return made[0] == made[1]


def _bytes(folder):
    """Contents by name; how long the computer took is no result."""
    content = {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }
    told = json.loads(content.pop("result/adjustment.json"))
    told.pop("seconds", None)
    return content | {"result/adjustment.json": json.dumps(told)}


def names(block, home: Path) -> dict:
    """Every verb that writes, on a block with hostile names: what lies or stands where it must not.

    Images, points, flights, cameras and the block itself have them.
    """
    called = dict(zip(block.images["image"].astype(str), HOSTILE, strict=False))
    points = dict(zip(block.ground["point"].astype(str), HOSTILE, strict=False))
    hostile = _called(
        block,
        {
            "image": lambda name: called.get(name, name),
            "point": lambda name: points.get(name, name),
            "flight": lambda name: HOSTILE[4] if name == "F1" else name,
        },
    )
    hostile.name, hostile.lever_arm = HOSTILE[5], {}
    cage = home / "cage" / "deep"
    hostile.write(cage / "block")
    before = _outside(home, cage)
    faults, written = [], 0
    from corridor.interface.cli import main

    for verb in (
        "adjust {b} -o {o}", "summary {b} -o {o}", "export micmac {b} --lossy -o {o}",
        "export opensfm {b} --lossy -o {o}", "export colmap-text {b} --lossy -o {o}",
        "export metashape {b} --lossy -o {o}", "change {b} {b} --points-only --no-camera -o {o}",
        "correct {b} --effect rolling_shutter:readout=0.02 -o {o}",
    ):  # fmt: skip
        out, said = cage / "result", io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            status = main(verb.format(b=cage / "block", o=out).split())
        if status not in (0, 2) or "Traceback" in said.getvalue():
            faults.append(f"{verb}: status {status}: {said.getvalue()[-300:]}")
        if _outside(home, cage) != before or {p.name for p in cage.iterdir()} - {"block", "result"}:
            faults.append(f"{verb}: something was written outside")
        for page in out.rglob("*.html"):
            text = page.read_text(encoding="utf-8")
            if re.search(r"<script>alert|<img src=x>", text):
                faults.append(f"{verb}: a name stands in {page.name} as HTML")
        written += status == 0
        shutil.rmtree(out, ignore_errors=True)
    return {"hostile_names": len(HOSTILE), "verbs_that_wrote": written, "faults": faults}


def _outside(home, cage):
    return {p for p in home.rglob("*") if cage not in p.parents and p != cage}
