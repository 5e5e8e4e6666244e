"""From another program's project to a block folder: read, complete, prove, write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from corridor.block import Block
from corridor.errors import InputError
from corridor.interchange.faults import blaming
from corridor.interchange.ground import add_ground
from corridor.interchange.mapping import forget, from_photographs
from corridor.interchange.placing import add_photographs, add_track, picture_size
from corridor.interchange.project import Project
from corridor.interchange.proof import Proof, demand, prove
from corridor.interchange.reading import read_project


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


def import_project(
    path: str | Path,
    form: str,
    output: str | Path,
    *,
    photos: Path | None = None,
    track: Path | None = None,
    ground: Path | None = None,
    crs: str | None = None,
    size: tuple[int, int] | None = None,
    track_system: str | None = None,
    images_system: str | None = None,
    table_form: str = "csv",
    force: bool = False,
    progress: Callable[[str], None] = lambda what: None,
) -> Imported:
    """Import a project, prove it, and write the block folder `output`, whole or not at all.

    form: auto, photos (from photographs alone), or a name of `format_names()`. photos, track,
    ground: what is added to it. crs: of the project's coordinates. size: of the pictures, px.
    table_form: csv or parquet. force: write although the proof refuses.
    Raises InputError: one sentence naming file, line and remedy.
    """
    if Path(output).exists() and not Path(output).is_dir():
        raise InputError(f"{output} is a file; name a folder to write to")
    path = Path(path)
    if form == "photos":
        project = from_photographs(path, Path(output), progress)
        photos = photos or path
    else:
        if size is None and photos is not None:
            size = picture_size(photos)
        progress(f"reading {path}")
        project = read_project(path, form, size)
    complete(project, photos, track, ground, crs, track_system, images_system, progress)
    progress("proving by reprojection")
    with blaming(path, "a whole project"):
        proof = prove(project)
    try:
        demand(proof, force)
    except InputError as error:
        said = "".join(f"{sentence}. " for sentence in project.warnings)
        raise InputError(f"{path}: {said}{error}") from None
    block = project.block
    if proof.verdict == "refused":
        project.warnings.append(f"written with --force although {proof.refusal()}")
    elif proof.verdict == "unproved":
        project.warnings.append(proof.refusal())
    block.source = block.source or f"imported from {project.form}: {path.name}"
    progress(f"writing {output}")
    block.write(output, table_form, observed=False)
    if form == "photos":
        forget(Path(output))
    return Imported(project, proof)


def complete(
    project: Project,
    photos: Path | None = None,
    track: Path | None = None,
    ground: Path | None = None,
    crs: str | None = None,
    track_system: str | None = None,
    images_system: str | None = None,
    progress: Callable[[str], None] = lambda what: None,
) -> None:
    """Add what photographs, a track and a file of ground points know; arguments as above."""
    if crs is not None:
        if project.block.crs not in (None, crs):
            raise InputError(
                f"the project is in {project.block.crs[:60]}; --crs {crs} contradicts it"
            )
        _known_system(crs)
        project.block.crs = crs
        project.placed = True
    exposures = None
    if photos is not None:
        progress(f"reading the photographs of {photos}")
        with blaming(photos, "a folder of photographs"):
            exposures = add_photographs(project, photos)
    if track is not None:
        progress(f"reading {track}")
        with blaming(track, "a track"):
            add_track(project, track, exposures, track_system, images_system)
    if ground is not None:
        add_ground(project, ground)


def _known_system(crs):
    import pyproj

    try:
        system = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise InputError(f"crs {crs!r} is not known; give a code, as EPSG:32647") from None
    if not system.is_projected:
        raise InputError(f"crs {crs} is not in metres of a grid; give one that is, as EPSG:32647")
