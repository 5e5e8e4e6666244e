"""Both dates in one adjustment, with what stands still common to both.

What both epochs do wrong alike then cancels: one datum, one camera if it was the same one, and
points of one name are one point. Points that may have moved keep a name for each date.
Source: Feurer and Vinatier 2018 (co-alignment).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pandas as pd

from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.change.clouds import Cloud
from corridor.change.epoch import Epoch
from corridor.change.epochs import cloud, paired
from corridor.errors import InputError

BEFORE, AFTER = "before:", "after:"
_TABLES = ("images", "tie_points", "points", "marks", "ground", "gnss", "rates", "track")


def joined(
    before: Block,
    after: Block,
    stable: Iterable[str],
    same_camera: bool = False,
    same_ties: bool = False,
) -> Block:
    """One block of both dates.

    stable: ground points that are one point in both. same_camera: cameras of one name are one
    camera with one calibration, else each date has its own. same_ties: a tie point of one name is
    a place seen at both dates; it is still adjusted for each date.
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
    out = block.copy()
    out.images["image"] = prefix + out.images["image"].astype(str)
    out.images["flight"] = [prefix + block.flight_names[k] for k in block.image_flight]
    if not same_camera:
        out.images["camera"] = prefix + out.images["camera"].astype(str)
        out.cameras = {prefix + n: replace(c, name=prefix + n) for n, c in out.cameras.items()}
    for table in ("tie_points", "marks", "gnss", "rates", "track"):
        rows = getattr(out, table)
        for column in ("image", "flight"):
            if column in rows and len(rows):
                rows[column] = prefix + rows[column].astype(str)
    sigmas = {"tie_points": block.tie_sigma(), "marks": block.mark_sigma()}
    for table, sigma in sigmas.items():
        getattr(out, table)["sigma"] = sigma
    for table, sigma in (("gnss", block.gnss_sigma()), ("ground", block.ground_sigma())):
        if len(sigma):
            getattr(out, table)[["sx", "sy", "sz"]] = sigma
    out.tie_points["point"] = prefix + out.tie_points["point"].astype(str)
    marks = set(map(str, out.ground["point"])) | set(map(str, out.marks["point"]))
    for table in ("marks", "ground"):
        rows = getattr(out, table)
        names = rows["point"].astype(str)
        rows["point"] = names.where(names.isin(stable), prefix + names)
    names = out.points["point"].astype(str)
    out.points["point"] = names.where(names.isin(stable & marks), prefix + names)
    out.lever_arm = {
        (prefix + name if name != "default" else name): arm for name, arm in block.lever_arm.items()
    }
    if "default" in out.lever_arm:
        default = out.lever_arm.pop("default")
        out.lever_arm = {prefix + name: default for name in block.flight_names} | out.lever_arm
    return out


def dates_of(block: Block, folders: Iterable[str]) -> tuple[Block, Block]:
    """The two dates of a block whose photographs were matched all together.

    folders: what the names of the images of each date begin with, `2023/` and `2024/`, as
    `corridor import photos` names those of a folder that holds both. Raises InputError where there
    are not two of them, or no image is of one.
    """
    folders = tuple(folders)
    if len(folders) != 2:
        raise InputError(f"{len(folders)} folders of photographs are no two dates: name both")
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


def together_clouds(
    adjustment: Adjustment, same_ties: bool = False, rays: int = 3
) -> tuple[Cloud, Cloud]:
    """The clouds of both dates in one adjustment, named as they were in each; see `clouds`."""
    epoch = Epoch(adjustment)
    sides = tuple(cloud(epoch, rays, date) for date in (BEFORE, AFTER))
    return paired(*sides) if same_ties else sides
