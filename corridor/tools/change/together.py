"""Both dates in one adjustment, with what stands still common to both.

What both epochs do wrong alike then cancels: one datum, one camera if it was the same one, and
points of one name are one point. Points that may have moved keep a name for each date.
Source: Feurer and Vinatier 2018 (co-alignment).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pandas as pd

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.output import counted
from corridor.tools.change.epoch import AFTER, BEFORE

_TABLES = ("images", "tie_points", "points", "marks", "ground", "gnss", "rates", "track",
           "distances")  # fmt: skip


def joined(before: Block, after: Block, stable: Iterable[str], same_camera: bool = False) -> Block:
    """One block of both dates.

    stable: ground points that are one point in both. same_camera: cameras of one name are one
    camera with one calibration, else each date has its own. A tie point is adjusted for each date.
    """
    stable = set(stable)
    parts = [
        _renamed(block, prefix, stable, same_camera)
        for block, prefix in ((before, BEFORE), (after, AFTER))
    ]
    tables = {
        table: pd.concat([getattr(part, table) for part in parts], ignore_index=True)
        for table in _TABLES
    }
    for table in ("points", "ground"):
        tables[table] = tables[table].drop_duplicates("point", ignore_index=True)
    first, second = parts
    return Block(
        name=f"{before.name} and {after.name}",
        cameras={**second.cameras, **first.cameras},
        **tables,
        sigma=first.sigma,
        lever_arm={**second.lever_arm, **first.lever_arm},
        lever_arm_fixed=first.lever_arm_fixed and second.lever_arm_fixed,
        offset=before.offset,
        crs=before.crs or after.crs,
    )


def _renamed(block: Block, prefix: str, stable: set[str], same_camera: bool) -> Block:
    """The block with names that say the date, but for what both dates share; sigmas filled in."""

    def dated(names: pd.Series, shared: Iterable[str] = ()) -> pd.Series:
        names = names.astype(str)
        return names.where(names.isin(shared), prefix + names)

    out = block.copy()
    out.images["flight"] = [block.flight_names[k] for k in block.image_flight]
    for table in ("images", "tie_points", "marks", "gnss", "rates", "track"):
        rows = getattr(out, table)
        for column in ("image", "flight"):
            if column in rows and len(rows):
                rows[column] = dated(rows[column])
    if not same_camera:
        out.images["camera"] = dated(out.images["camera"])
        out.cameras = {prefix + n: replace(c, name=prefix + n) for n, c in out.cameras.items()}
    xyz = ["sx", "sy", "sz"]
    for rows, columns, sigma in (
        (out.tie_points, "sigma", block.tie_sigma()),
        (out.marks, "sigma", block.mark_sigma()),
        (out.gnss, xyz, block.gnss_sigma()),
        (out.ground, xyz, block.ground_sigma()),
    ):
        if len(rows):
            rows[columns] = sigma
    measured = set(map(str, out.ground["point"])) | set(map(str, out.marks["point"]))
    shared = {"tie_points": (), "marks": stable, "ground": stable, "points": stable & measured}
    for table, names in shared.items():
        rows = getattr(out, table)
        rows["point"] = dated(rows["point"], names)
    # Ends are marks of one name in both dates, or tie points of one.
    for end in ("from", "to") if len(out.distances) else ():
        out.distances[end] = dated(out.distances[end], stable & measured)
    arms = dict(block.lever_arm)
    if "default" in arms:
        arms = dict.fromkeys(block.flight_names, arms.pop("default")) | arms
    out.lever_arm = {prefix + name: arm for name, arm in arms.items()}
    return out


def dates_of(block: Block, folders: Iterable[str]) -> tuple[Block, Block]:
    """The two dates of a block whose photographs were matched all together.

    folders: what the names of the images of each date begin with, `2023/` and `2024/`, as
    `corridor import photos` names those of a folder that holds both. Raises InputError where there
    are not two of them, or no image is of one.
    """
    folders = tuple(folders)
    if len(folders) != 2:
        raise InputError(
            f"{counted(len(folders), 'folder')} of photographs given: name two, one for each date"
        )
    out = []
    for folder in folders:
        images = [name for name in block.images["image"].astype(str) if name.startswith(folder)]
        if not images:
            raise InputError(
                f"images.csv of {block.name}: no image is called {folder}...; name the folders "
                "of the two dates as the images have them"
            )
        part = block.select(images=images)
        part.name = f"{block.name}, {folder.strip('/')}"
        out.append(part)
    return out[0], out[1]
