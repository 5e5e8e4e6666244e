"""From another program's project to a block folder: read, complete, prove, write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.gnss import known_crs
from corridor.core.photographs import photographs_in, read_metadata
from corridor.tools.formats.faults import blaming
from corridor.tools.formats.ground import add_ground
from corridor.tools.formats.joining import bent
from corridor.tools.formats.mapping import (
    Cheaply,
    forget,
    from_photographs,
    is_whole,
    workplace,
)
from corridor.tools.formats.placing import Track, add_photographs, add_track, picture_size
from corridor.tools.formats.project import Project
from corridor.tools.formats.proof import Proof, demand, prove
from corridor.tools.formats.reading import read_project
from corridor.tools.formats.starting import can_start
from corridor.tools.formats.turned import with_turned


@brief
@dataclass
class Imported:
    """A project that became a block, with its proof; `print` tells both."""

    project: Project
    proof: Proof

    @property
    def block(self) -> Block:
        """The block."""
        return self.project.block

    def __str__(self) -> str:
        project, block = self.project, self.project.block
        points = len(block.tie_points["point"].cat.categories)
        lines = [
            f"{project.source} ({project.form}): {len(block.images):,} images, "
            f"{len(block.cameras)} cameras, {len(block.tie_points):,} tie observations of "
            f"{points:,} points, {len(block.marks):,} marks, "
            f"{len(block.ground):,} ground points, {len(block.gnss):,} GNSS positions"
        ]
        lines += [f"note: {sentence}" for sentence in project.notes]
        lines += [f"warning: {sentence}" for sentence in project.warnings]
        return "\n".join([*lines, "", str(self.proof)])


@dataclass(frozen=True)
class Additions:
    """What is added to a project that is imported.

    photos: folder of its photographs. track: file of the receiver. ground: file of ground points.
    crs: of the project's coordinates. size: of the pictures, px. track_system, images_system: time
    systems, where the files do not state them. long_side, share: of `mapping.Cheaply`, where the
    project is made from photographs.
    """

    photos: Path | None = None
    track: Path | None = None
    ground: Path | None = None
    crs: str | None = None
    size: tuple[int, int] | None = None
    track_system: str | None = None
    images_system: str | None = None
    long_side: int | None = None
    share: int = 1


def _silent(what: str) -> None:
    """Say nothing."""


def import_project(
    path: str | Path,
    form: str,
    output: str | Path,
    added: Additions | None = None,
    *,
    table_form: str = "csv",
    force: bool = False,
    progress: Callable[[str], None] = _silent,
    **more,
) -> Imported:
    """Import a project, prove it, and write the block folder `output`, whole or not at all.

    form: auto, photos (from photographs alone), or a name of `format_names()`. added: what is added
    to it; more: its fields, in place of it. table_form: csv or parquet. force: write although the
    proof refuses.
    Raises InputError: one sentence naming file, line and remedy.
    """
    if Path(output).exists() and not Path(output).is_dir():
        raise InputError(f"{output} is a file; name a folder to write to")
    path, added = Path(path), added or Additions(**more)
    if form == "photos":
        cheaply = Cheaply(added.long_side, added.share)
        project = from_photographs(path, Path(output), progress, cheaply, force)
        added = replace(added, photos=added.photos or path)
    else:
        size = added.size
        if size is None and added.photos is not None:
            size = picture_size(added.photos)
        progress(f"reading {path}")
        project = read_project(path, form, size)
    project = complete(project, added, progress)
    if form == "photos":
        if bent(project.block) and _can_start(path, added):
            again = from_photographs(path, Path(output), progress, cheaply, force, started=True)
            again = complete(again, added, progress)
            project = again if bent(again.block) is None else project
        project = _straight(project, Path(output), force)
    progress("proving by reprojection")
    with blaming(path, "a whole project"):
        proof = prove(project)
    try:
        demand(proof, force)
    except InputError as error:
        said = "".join(f"{sentence}. " for sentence in project.warnings)
        raise InputError(f"{path}: {said}{error}") from None
    if proof.verdict == "refused":
        project = project.having(warnings=[f"written with --force although {proof.refusal()}"])
    elif proof.verdict == "unproved":
        project = project.having(warnings=[proof.refusal()])
    block = project.block
    block.source = block.source or f"imported from {project.form}: {path.name}"
    progress(f"writing {output}")
    block.write(output, table_form, observed=False)
    if form == "photos" and is_whole(project, Path(output)) and not bent(project.block):
        forget(Path(output))
    return Imported(project, proof)


def _can_start(folder: Path, added: Additions) -> bool:
    files = photographs_in(folder)[:: added.share]
    return can_start([read_metadata(file) for file in files])


def _straight(project: Project, output: Path, force: bool) -> Project:
    """Raises AdjustmentFailed where a model contradicts the positions, unless nobody minds."""
    said = bent(project.block)
    if said is None:
        return project
    if not force:
        others = "".join(f"{sentence}. " for sentence in project.warnings)
        raise AdjustmentFailed(
            f"{others}{said[0].upper()}{said[1:]}; features and matches are kept in "
            f"{workplace(output)}; --force writes the block as it is"
        )
    return project.having(warnings=[said])


def complete(
    project: Project, added: Additions, progress: Callable[[str], None] = _silent
) -> Project:
    """The project with what photographs, a track and a file of ground points know."""
    if added.crs is not None:
        if project.block.crs not in (None, added.crs):
            raise InputError(
                f"the project is in {project.block.crs[:60]}; --crs {added.crs} contradicts it"
            )
        if not known_crs(added.crs).is_projected:
            raise InputError(
                f"crs {added.crs} is not in metres of a grid; give one that is, as EPSG:32647"
            )
        project = project.having(crs=added.crs, placed=True)
    photos, exposures = {}, None
    if added.photos is not None:
        progress(f"reading the photographs of {added.photos}")
        with blaming(added.photos, "a folder of photographs"):
            project, photos, exposures = add_photographs(project, added.photos)
    if added.track is not None:
        progress(f"reading {added.track}")
        track = Track(added.track, added.track_system, added.images_system)
        with blaming(added.track, "a track"):
            project = add_track(project, exposures, track)
    if added.ground is not None:
        project = add_ground(project, added.ground)
    # Marks are measured in the pictures as they lie there: only now can all be turned back.
    return with_turned(project, photos)
