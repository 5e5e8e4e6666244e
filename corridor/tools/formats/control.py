"""Ground control as evidence of where a project lies, and in which pictures it was measured.

Marks and poses give each ground point a place in the project's frame; the list of ground points
gives it another. From both follow the size of the pictures that marks were measured in, the place
of a project that has no positions, and the height system of one that has. What fits neither is
refused.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from pandas.api.typing import SeriesGroupBy

from corridor.core.block import POSE, Block
from corridor.core.errors import InputError, some
from corridor.core.geometry import (
    Similarity,
    quaternion_from_rotation,
    robust_scale,
    rotation_from_quaternion,
    similarity,
)
from corridor.core.gnss import GEOGRAPHIC, Local, known_crs, local_of
from corridor.core.photographs import Metadata
from corridor.core.preparation import (
    AGREES,
    CONTRADICTS,
    UNCHECKED,
    Witness,
    marks_of_another_size,
    unit_of,
)
from corridor.tools.formats.faults import blaming
from corridor.tools.formats.frames import local_table
from corridor.tools.formats.ground import Ground, add_to, called_as_marked, in_frame, read_ground
from corridor.tools.formats.plausible import refusal
from corridor.tools.formats.project import Project
from corridor.tools.formats.proof import LARGE_PX
from corridor.tools.formats.rows import rows_of
from corridor.tools.formats.strange import not_text

XYZ = list(POSE[:3])
# Marks were measured in pictures of another size where their rays meet so much better in these.
_BETTER = 0.2
# A shift of this many sigmas is one, and of this size in any case: positions without corrections
# are good to 3 m in plan and 6 m in height.
_SIGMAS, _LEAST_M = 4.0, 10.0
_LEAST_POINTS, _MOST_TRIED = 3, 2000
_MOST_PX = 100_000  # no picture is so large


class Seen(NamedTuple):
    """Control and check points that marks place: names, given and met (n, 3), m, and by how many
    pixels (n,) the rays miss each other."""

    names: list[str]
    given: np.ndarray
    met: np.ndarray
    missed_px: np.ndarray


def _is_of(plane: str, crs: str) -> bool:
    """Whether a system is the other, or its plane without the heights."""
    one, system = known_crs(plane), known_crs(crs)
    level = system.sub_crs_list[0] if system.is_compound and not one.is_compound else system
    return one.equals(level, ignore_axis_order=True)


def add_ground(
    project: Project,
    path: Path,
    photos: Mapping[int, Metadata] | None = None,
    crs: str | None = None,
) -> Project:
    """The project with the ground points and marks of a file, which place it if nothing else does.

    photos: by row of images.csv; they tell which pictures marks may have been measured in. crs: of
    the coordinates, where the file does not say. Raises InputError where the file is damaged, or
    its points lie nowhere near where marks or cameras see them.
    """
    with blaming(path, "a file of ground points"):
        told = not_text(path) if path.is_file() else ""
        if told:
            raise InputError(f"{path.name} is {told}")
        ground = read_ground(path, project.block)
        ground = called_as_marked(ground, project.block)
        listed = [] if ground.table is None else list(ground.table["point"])
        if listed and set(listed) <= set(project.block.images["image"]):
            raise InputError(
                f"{path.name} lists photographs ({some(listed, 3)}), so it is no list of ground "
                "points; leave it out"
            )
        if ground.unit and (crs is None or known_crs(crs).axis_info[0].unit_conversion_factor == 1):
            raise InputError(
                f"{path.name}: its header gives the coordinates in {ground.unit}; write them in "
                "metres, or name their system with --ground-crs if that counts in this unit"
            )
        if crs is not None:
            # A header that counts latitude and longitude names no datum.
            same = ground.crs == GEOGRAPHIC and known_crs(crs).is_geographic
            same = same or ground.crs is not None and _is_of(ground.crs, crs)
            if ground.crs not in (None, crs) and not same:
                raise InputError(
                    f"its coordinates are in {ground.crs[:60]}; --ground-crs {crs} contradicts it: "
                    "leave it out"
                )
            known_crs(crs)
            ground = replace(ground, crs=crs)
        framed = project.placed or project.block.crs or local_of(project.block)
        project = _in_size(_with_place(project, ground), ground, photos or {})
        if listed and ground.crs is not None and not framed:
            project = _alone_in_its_system(project, listed, path.name, ground.crs)
        if framed and listed:
            given = ground.table[XYZ].to_numpy(float)
            wrong = refusal(project.block, listed, given, ground.crs, in_frame)
            if wrong:
                raise InputError(wrong)
    notes = [f"{path.name}: {len(listed)} ground points, {len(ground.marks)} marks"]
    marked = set(project.block.marks["point"].cat.categories)
    unseen = [name for name in listed if name not in marked]
    if unseen:
        notes.append(f"{len(unseen)} ground points are measured in no image: {some(unseen, 5)}")
    project = project.having(notes=notes)
    block = project.block
    if not (len(block.ground) and len(block.marks)):
        return project
    doubt = _outside(block, {point for point, *_ in ground.marks}, path.name)
    if not project.placed and local_of(block) is None:
        project = _placed(project, path.name)
    else:
        try:
            _refuse_beside_others(project.block, listed, path.name)
            project = _in_one_height_system(project, path.name)
        except InputError as error:
            raise InputError(f"{error}; {doubt}" if doubt else str(error)) from None
    if doubt:
        project = project.warned(doubt)
    project = project.warned(*marks_of_another_size(project.block)[1])
    heights = ground.table["z"].to_numpy(float) if listed else np.zeros(0)
    if len(heights) <= _LEAST_POINTS or np.ptp(heights) > 0:
        return project
    return project.warned(
        f"{path.name}: all heights are {heights[0]:g} m, so they look typed, not surveyed; "
        "give the surveyed ones, or their standard deviation (sz in ground.csv)"
    )


def _with_place(project: Project, ground: Ground) -> Project:
    """The project in the file's own system, where it has none: control will place it."""
    block = project.block
    if ground.crs is None or ground.table is None or project.placed or block.crs is not None:
        return project
    if local_of(block) is not None:
        return project
    system, places = known_crs(ground.crs), ground.table[XYZ].to_numpy(float)
    if system.is_projected:
        offset = np.round(np.median(places, axis=0) / 100) * 100 * [1, 1, 0]
        return project.having(crs=ground.crs, offset=offset)
    local = local_table(Local.amid(places, ground.crs))
    return project.having(extra={**block.extra, "local_frame": local}, placed=False)


def _alone_in_its_system(project: Project, listed: list[str], name: str, crs: str) -> Project:
    """The project without the ground points of its own frame, which the file's system is not.

    Raises InputError where no mark joins the two.
    """
    table = project.block.ground
    mine = table["point"].isin(listed).to_numpy()
    if not set(listed) & set(project.block.marks["point"].cat.categories):
        called = some(list(map(str, table["point"][~mine])), 3)
        raise InputError(
            f"{name} is in {crs[:60]}, the project in a frame of its own, and no mark shows "
            "a point of the file in an image, so nothing joins the two: "
            + (f"call the points as the project does ({called}), or " if called else "")
            + "give a list with their marks"
        )
    if mine.all():
        return project
    told = f"{(~mine).sum()} ground points of the project itself are in its own frame: left out"
    return project.having(ground=table[mine].reset_index(drop=True), notes=[told])


# --- the pictures that marks were measured in ------------------------------------------------


def _in_size(project: Project, ground: Ground, photos: Mapping[int, Metadata]) -> Project:
    """The project with the marks of a file in the pixels of its own pictures."""
    found = {1.0: add_to(project, ground)}
    for factor in _factors(project.block, photos):
        marks = [(point, image, factor * (x + 0.5) - 0.5, factor * (y + 0.5) - 0.5)
                 for point, image, x, y in ground.marks]  # fmt: skip
        found[factor] = add_to(project, replace(ground, marks=marks))
    if len(found) == 1:
        return found[1.0]
    missed = {factor: _missed(one.block) for factor, one in found.items()}
    best = min(missed, key=missed.get)
    if best == 1.0 or not missed[best] < _BETTER * missed[1.0]:
        return found[1.0]
    size = _limit(project.block)
    was = "" if not np.isfinite(missed[1.0]) else f" in place of {missed[1.0]:.3g} px as they are"
    return found[best].noted(
        f"{ground.path.name}: its marks were measured in pictures of {size / best:.0f} px and "
        f"brought to {size:.0f} px: there their rays meet to {missed[best]:.2g} px{was}"
    )


def _factors(block: Block, photos: Mapping[int, Metadata]) -> list[float]:
    """Sizes of the block's pictures over those that the marks may have been measured in."""
    found = set()
    for row, photo in photos.items():
        camera = block.cameras[block.images["camera"].iloc[row]]
        for width in (photo.width, photo.taken_size[0]):
            found.add(round(camera.width / width, 6))
    return sorted(found - {1.0})


def _missed(block: Block) -> float:
    """By how many pixels rays of marks miss each other, median; infinite where none meet."""
    missed = ground_seen(block).missed_px
    inside = len(missed) and np.mean(block.outside("marks")) < 0.5
    return float(np.median(missed)) if inside else np.inf


def ground_seen(block: Block) -> Seen:
    """Control and check points where the rays of their marks meet by the block's own poses."""
    rows = rows_of(block, complete=False).posed()
    table = block.ground[block.ground["role"] != "unused"]
    at = rows.point_names.get_indexer(table["point"])
    given, names = table[XYZ].to_numpy(float)[at >= 0], table["point"].to_numpy()[at >= 0]
    at = at[at >= 0]
    if not len(at):
        return Seen([], np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    positions = rows.positions.copy()
    met = positions[at] = rows.intersected(at)
    length = np.linalg.norm(replace(rows, positions=positions).residuals(), axis=1)
    place = np.full(len(positions), -1)
    place[at] = np.arange(len(at))
    missed = np.full(len(at), np.nan)
    for k in range(len(at)):
        mine = length[place[rows.point] == k]
        if len(mine) > 1 and np.isfinite(mine).any():
            missed[k] = np.median(np.where(np.isfinite(mine), mine, np.inf))
    good = np.isfinite(met).all(axis=1) & np.isfinite(missed) & np.isfinite(given).all(axis=1)
    return Seen([str(n) for n in names[good]], given[good], met[good], missed[good])


# --- where the project lies ------------------------------------------------------------------


def placed_by_own(project: Project, last: bool = False) -> Project:
    """A free reconstruction in the frame of the ground points or positions that it has itself.

    Where a frame on Earth is stated, these are in it and the poses are not; else both may be in
    one, which marks show; last: nothing else, as photographs, places it any more. What places
    nothing is left out.
    """
    block = project.block
    apart = project.apart or local_of(block) is not None
    if project.placed or not (apart or last and len(block.ground) + len(block.gnss)):
        return project
    name = project.source.name
    if not np.isfinite(block.poses).all(axis=1).any():
        return project.having(placed=True)  # no pose is in another frame
    if len(block.ground) and len(block.marks):
        seen = ground_seen(block)
        if not apart and len(seen.names) >= _LEAST_POINTS and _in_pixels(block) <= LARGE_PX:
            told = f"the frame is that of its {len(seen.names)} ground points, as their marks show"
            return project.having(placed=True, notes=[told])
        made = _placed(project, name)
        if made.placed or not len(block.gnss):
            return made.having(description="") if made.placed else made
    if not (apart or len(block.gnss)):
        return project
    rows, given = block.image_rows("gnss"), block.numbers("gnss", *XYZ)
    met = block.poses[rows, :3]
    good = np.isfinite(met).all(axis=1) & np.isfinite(given).all(axis=1)
    names = block.gnss["image"].to_numpy()[good].astype(str).tolist()
    found = _robust(Seen(names, given[good], met[good], np.zeros(len(names))))
    if found is None:
        return _in_no_frame(project, f"the positions of {name} do not place it")
    move, away = found
    off = np.median(np.linalg.norm(met - given, axis=1)[good])
    if not apart:
        # Poses are in the frame of the positions already, or nobody knows in which.
        near = 3 * max(np.median(away), np.median(np.linalg.norm(block.gnss_sigma(), axis=1)))
        told = f"the frame is that of its {len(names)} positions, {off:.2g} m from camera centres"
        return project.having(placed=True, notes=[told]) if off <= near else project
    told = (
        f"placed by {len(names)} positions of {name}: scale {move.scale:.6g}, camera centres "
        f"{np.median(away):.2g} m (median) from them"
    )
    return moved_by(project, move).having(placed=True, notes=[told], description="")


def _in_no_frame(project: Project, why: str) -> Project:
    """The project in the frame of its poses, without what is in another."""
    block = project.block
    extra = {key: value for key, value in block.extra.items() if key != "local_frame"}
    told = f"the project stays in its own frame: {why}"
    project = project.having(crs=None, extra=extra, warnings=[told])
    if local_of(block) is None and not project.apart:
        return project
    return project.having(ground=block.ground.iloc[:0], gnss=block.gnss.iloc[:0])


def _placed(project: Project, name: str) -> Project:
    """A free reconstruction turned, scaled and shifted onto ground control."""
    seen = ground_seen(project.block)
    found = _robust(seen)
    if found is None:
        return _in_no_frame(
            project,
            f"{name} has {len(seen.names)} points that two images or more show, and a frame needs "
            "three that do not lie on one line",
        )
    move, away = found
    # Where few or narrow rays meet is uncertain along them, and says nothing against a point.
    pixels = _by_point(moved_by(project, move).block).median().reindex(seen.names).to_numpy()
    good = (away <= max(3 * np.median(away), 1e-9)) | (
        pixels <= max(LARGE_PX, 3 * np.median(pixels))
    )
    bad = [n for n, fits in zip(seen.names, good, strict=True) if not fits]
    warnings = []
    if bad and len(seen.names) > _LEAST_POINTS:
        warnings.append(
            f"{name}: {', '.join(bad[:5])} lie {away[~good].max():.3g} m from where their marks "
            f"see them, the others {np.median(away[good]):.2g} m: are names or coordinates wrong?"
        )
    unit = unit_of(move.scale)
    if unit and len(project.block.gnss):
        warnings.append(
            f"{name}: the project has positions, and becomes {move.scale:.4g} times as large by "
            f"these points: are they in {unit}? Write metres"
        )
    moved = moved_by(project, move).having(
        placed=True,
        warnings=warnings,
        notes=[
            f"placed by {good.sum()} ground points of {name}: scale {move.scale:.6g}, their marks "
            f"see them {np.median(away):.2g} m (median) from where they were surveyed"
        ],
    )
    spare = len(seen.names) - _LEAST_POINTS
    witness = Witness(
        f"{spare} more ground points", AGREES if good.all() and spare else
        CONTRADICTS if spare else UNCHECKED, f"{away.max():.2g} m at most",
    )  # fmt: skip
    told = f"The frame is that of {name}, by a similarity of {good.sum()} ground points."
    sigma = away[good] / np.sqrt(3)
    return moved.deriving("images.x", name, sigma, told, witnesses=[witness])


def _robust(seen: Seen) -> tuple[Similarity, np.ndarray] | None:
    """The similarity that the most points agree with, and how far each is from it, m."""
    count = len(seen.names)
    best = None
    for three in islice(combinations(range(count), 3), _MOST_TRIED):
        try:
            move = similarity(seen.met[list(three)], seen.given[list(three)])
        except InputError:
            continue
        away = np.linalg.norm(move.apply(seen.met) - seen.given, axis=1)
        worth = float(np.median(away)) if count > _LEAST_POINTS else float(away.max())
        if best is None or worth < best[0]:
            best = worth, move, away
    if best is None:
        return None
    kept = best[2] <= max(3 * best[0], 1e-6)
    if kept.sum() >= _LEAST_POINTS:
        try:
            move = similarity(seen.met, seen.given, kept.astype(float))
            return move, np.linalg.norm(move.apply(seen.met) - seen.given, axis=1)
        except InputError:
            pass
    return best[1], best[2]


def moved_by(project: Project, move: Similarity) -> Project:
    """The project's poses and points by a similarity; its ground points stay where they are."""
    block = project.block
    turned = move.apply_to_rotations(rotation_from_quaternion(block.poses[:, 3:]))
    pose = [move.apply(block.poses[:, :3]), quaternion_from_rotation(turned)]
    made = block.copy()
    made.put("images", POSE, np.hstack(pose))
    made.put("points", XYZ, move.apply(block.points[XYZ].to_numpy(float)))
    given, met = block.numbers("gnss", *XYZ), made.poses[block.image_rows("gnss"), :3]
    frames = given, move.apply(given)
    # Positions may be in the frame that the poses had, and then go with them.
    if len(given) and np.subtract(*(np.nanmedian(np.abs(one - met)) for one in frames)) > 0:
        made.put("gnss", XYZ, frames[1])
    return replace(project, block=made)


def _outside(block: Block, points: set[str], file: str) -> str:
    """A sentence where marks of a file lie outside their pictures; empty where none does."""
    mine = block.marks["point"].isin(points).to_numpy()
    out = mine & block.outside("marks")
    if not out.any():
        return ""
    first = block.marks[out].iloc[0]
    return (
        f"{out.sum()} of {mine.sum()} marks of {file} lie outside their pictures (first: "
        f"{first['point']} in {first['image']} at {first['x']:.0f}, {first['y']:.0f}): give "
        "pixels of the pictures of the project, column before row"
    )


def _refuse_beside_others(block: Block, names: list[str], file: str) -> None:
    """Raises InputError where the points of a file lie off, and the project's own do not."""
    seen = ground_seen(block)
    new = np.isin(seen.names, names)
    if not new.any() or new.all():
        return
    off = np.array([np.median((seen.given - seen.met)[mine], axis=0) for mine in (new, ~new)])
    size = np.linalg.norm(off, axis=1)
    if size[0] > _LEAST_M and size[1] < _LEAST_M:
        raise InputError(
            f"{file}: its points lie {np.hypot(*off[0, :2]):,.1f} m horizontally and "
            f"{off[0, 2]:+,.1f} m vertically from where the marks in the pictures see them, the "
            f"ground points that the project has only {size[1]:.1f} m: give the points in the same "
            "system, with heights above the same surface (ellipsoid or geoid)"
        )


def _in_one_height_system(project: Project, name: str) -> Project:
    """The project in the height system of its control, where that is another than the positions'.

    Raises InputError, with both numbers, where control lies somewhere else altogether.
    """
    block, seen = project.block, ground_seen(project.block)
    if not len(seen.names):
        return project
    off = seen.given - seen.met
    middle = np.median(off, axis=0)
    spread = robust_scale(off, centred=True, axis=0)
    # What positions share places the block.
    shared = np.median(block.gnss_sigma(), axis=0) / 3.0 if len(block.gnss) else np.zeros(3)
    sigma = np.hypot(spread / np.sqrt(len(off)), shared)
    plan, up = float(np.hypot(*middle[:2])), float(middle[2])
    far = np.abs(middle) > np.maximum(_SIGMAS * sigma, _LEAST_M)
    if not far.any():
        return project
    height = float(np.median(block.poses[:, 2][np.isfinite(block.poses[:, 2])]))
    what = "positions of the photographs" if len(block.gnss) else "images"
    if far[:2].any() or len(seen.names) < 2:
        raise InputError(
            f"{name}: its points lie {plan:,.1f} m horizontally and {up:+,.1f} m vertically from "
            f"where the marks in the pictures see them (median of {len(seen.names)}), so the "
            f"{what} and the ground points are not in one system; check --crs, the order of the "
            "coordinates and the names of the points"
        )
    shift = np.array([0.0, 0.0, up])
    moved = moved_by(project, Similarity(1.0, np.eye(3), shift))
    gnss = block.gnss.assign(z=block.gnss["z"] + up) if len(block.gnss) else block.gnss
    ground = float(np.median(seen.given[:, 2]))
    text = (
        f"Control lies {abs(up):.1f} m {'above' if up > 0 else 'below'} the heights of the {what} "
        f"(control {ground:.1f} m, images {height:.1f} m): another height system. The images and "
        f"their positions were {'raised' if up > 0 else 'lowered'} by that: heights are those of "
        f"{name}."
    )
    moved = moved.having(gnss=gnss, notes=[text[0].lower() + text[1:].rstrip(".")])
    after = _in_pixels(moved.block)
    plan_witness = Witness(
        "the same points horizontally", AGREES, f"{plan:.1f} m beside the positions' own error"
    )
    marks = Witness(
        "marks", AGREES if after < _limit(block) else CONTRADICTS, f"{after:.1f} px afterwards"
    )
    witnesses = [plan_witness, marks]
    source, sigma = f"{name} and its marks", sigma[2:]
    return moved.deriving("gnss.z", source, sigma, text, witnesses=witnesses)


def _in_pixels(block: Block) -> float:
    """How far marks lie from where control and poses put them, px, median; infinite behind."""
    length = _by_point(block).obj
    return float(np.median(length)) if len(length) else 0.0


def _by_point(block: Block) -> SeriesGroupBy:
    """The same of each mark, by the names of the points."""
    rows = rows_of(block, complete=False).usable()
    marks = rows.only(rows.point >= rows.ties)
    length = np.linalg.norm(marks.residuals(), axis=1)
    found = pd.Series(np.where(np.isfinite(length), length, np.inf))
    return found.groupby(marks.point_names[marks.point].astype(str))


def _limit(block: Block) -> float:
    """The long side of the largest picture, px."""
    return float(max(max(camera.width, camera.height) for camera in block.cameras.values()))


def marks_refused(project: Project) -> str | None:
    """Why the project must not be written: its marks lie beyond their pictures. None if they fit.

    Of a project in its own frame that nothing places, marks and ground points need not agree yet.
    """
    block = project.block
    if not (project.placed and len(block.marks) and len(block.ground)):
        return None
    off, limit = _in_pixels(block), _limit(block)
    if off <= limit:
        return None
    told = f"{off:,.0f} px" if off < _MOST_PX else "far outside the pictures or behind the cameras"
    return (
        f"the marks lie {told} (median) from where ground points and poses put them, in pictures "
        f"of {limit:.0f} px: ground points and poses are not in one system; check the coordinate "
        "system, the order of the coordinates, the heights and the names of the points"
    )
