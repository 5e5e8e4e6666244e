"""From another program's project to a block folder: read, complete, prove, write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.errors import InputError, WorkFailed
from corridor.core.geometry import GROSS, robust_scale
from corridor.core.gnss import (
    GEOGRAPHIC,
    about_the_middle,
    in_metres,
    known_crs,
    local_of,
    loose_way,
    outside_area,
)
from corridor.core.options import options
from corridor.core.output import Progress, Report, Table, png, silent, telling, whole_file
from corridor.core.photographs import photographs_in, read_metadata
from corridor.core.preparation import AGREES, Witness, derived, derived_table
from corridor.tools.formats.attitudes import with_attitudes
from corridor.tools.formats.control import add_ground, marks_refused, placed_by_own
from corridor.tools.formats.delay import with_delay_told
from corridor.tools.formats.faults import blaming
from corridor.tools.formats.frames import elsewhere, moved
from corridor.tools.formats.ground import system_beside
from corridor.tools.formats.heights import with_heights_told
from corridor.tools.formats.joining import bent
from corridor.tools.formats.mapping import Cheaply, forget, from_photographs, is_whole, workplace
from corridor.tools.formats.placing import (
    Track,
    add_photographs,
    add_track,
    in_own_frame,
    picture_size,
    with_motion,
)
from corridor.tools.formats.project import Project, near_origin
from corridor.tools.formats.proof import Proof, demand, prove
from corridor.tools.formats.reading import read_project
from corridor.tools.formats.rows import rows_of
from corridor.tools.formats.starting import can_start
from corridor.tools.formats.turned import with_turned

# Below so many spare observations a standard deviation is good to a tenth at best; beyond these
# limits it is of a mapping that failed.
_LEAST_SPARE, _SIGMA_PX = 50, (0.05, 3.0)


@brief
@dataclass
class Imported:
    """A project that became a block, with its proof; `print` tells both."""

    project: Project
    proof: Proof
    output: Path

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
        table = derived_table(block)
        shown = [] if table is None else ["", str(table)]
        return "\n".join([*lines, *shown, "", str(self.proof)])

    def report(self) -> Report:
        """The import as a page has it: what joined, what was derived, what is doubtful."""
        project, block = self.project, self.block
        count = len(block.images)
        joined = f"{count} of {count + len(project.lost)} images"
        where = "placed on Earth" if local_of(block) or block.crs else "in a frame of its own"
        opening = (
            f"{project.source} ({project.form}): {joined} are in one block, {where}, with "
            f"{len(block.tie_points):,} tie observations, {len(block.marks):,} marks and "
            f"{len(block.gnss):,} positions. {self.proof}"
        )
        tables = [table] if (table := derived_table(block)) else []
        if project.lost:
            lost = tuple((name,) for name in project.lost)
            tables.append(Table("Photographs that did not join", (), lost, "l"))
        notes = tuple((note,) for note in project.notes)
        tables.append(Table("What was done", (), notes, "w"))
        actions = [f"Adjust it: `corridor adjust {self.output} -o OUT`."]
        if any(one.column == "moments of gnss.csv" for one in derived(block)):
            actions[0] = (
                "Adjust it with its delay: `corridor adjust "
                f"{self.output} --effect clock_offset -o OUT`."
            )
        actions.append(f"Find what its model lacks: `corridor diagnose {self.output} -o OUT`.")
        if not len(block.ground):
            actions.append(
                "For accuracy on the ground, measure control and add it: `--ground FILE`."
            )
        return Report(f"Import of {block.name}", opening, project.warnings, tables, actions)

    def save(self, figure=None) -> Path:
        """Write the report as `import.html` into the block's folder; figure: of matplotlib.

        Returns its path.
        """
        pictures = []
        if figure is not None:
            caption = "Where the images and points lie, and how many images show each point."
            pictures.append(("map of the block", caption, png(figure)))
        path = self.output / "import.html"
        with whole_file(path) as part:
            part.write_text(self.report().page(pictures), encoding="utf-8")
        return path


@dataclass(frozen=True)
class Additions:
    """What is added to a project that is imported.

    photos: folder of its photographs. track: file of the receiver. ground: file of ground points.
    crs: of the block's coordinates: those of the project, or what they are converted to where it
    has a place on Earth of its own. ground_crs: of the file of ground points. to_crs: the block
    goes into a local frame, and results are given in this system. size: of the pictures, px.
    track_system, images_system: time systems, where the files do not state them. long_side, share:
    of `mapping.Cheaply`, where the project is made from photographs. attitudes: those they state.
    """

    photos: Path | None = None
    track: Path | None = None
    ground: Path | None = None
    crs: str | None = None
    ground_crs: str | None = None
    to_crs: str | None = None
    size: tuple[int, int] | None = None
    track_system: str | None = None
    images_system: str | None = None
    long_side: int | None = None
    share: int = 1
    attitudes: bool = False


@options(added=Additions)
def import_project(
    path: str | Path,
    form: str,
    output: str | Path,
    *,
    added: Additions,
    table_form: str = "csv",
    force: bool = False,
    unadjusted: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Imported:
    """Import a project, prove it, and write the block folder `output`, whole or not at all.

    form: auto, photos (from photographs alone), or a name of `format_names()`. photos to
    share: what is added to it, of `Additions`; added: these as a whole. table_form: csv or parquet.
    force: write although the proof refuses. unadjusted: write also where the residuals are large
    and no usual mistake of convention explains them, as of a project before its adjustment: that
    adjustment is the proof.
    Raises InputError: one sentence naming file, line and remedy.
    """
    if Path(output).exists() and not Path(output).is_dir():
        raise InputError(f"{output} is a file; name a folder to write to")
    say = telling(progress)
    path = Path(path)
    if form == "photos":
        cheaply = Cheaply(added.long_side, added.share)
        project = from_photographs(path, Path(output), say, cheaply, force)
        added = replace(added, photos=added.photos or path)
    else:
        size = added.size
        if size is None and added.photos is not None:
            size = picture_size(added.photos)
        say(f"reading {path}")
        project = read_project(path, form, size)
    beside = None if added.ground is not None else _list_beside(path)
    if beside is not None:
        told = f"{beside} lies beside the project and was not read: give it with --ground"
        project = project.warned(told)
    if added.crs is None and project.block.crs is None and local_of(project.block) is None:
        project = project.warned(*_prj_beside(path))
    project = complete(project, added, say)
    if form == "photos":
        files = photographs_in(path)[:: added.share]
        if bent(project.block) and can_start(list(map(read_metadata, files))):
            again = from_photographs(path, Path(output), say, cheaply, force, started=True)
            again = complete(again, added, say)
            project = again if bent(again.block) is None else project
        project = _with_tie_sigma(_straight(project, Path(output), force))
    if project.block.crs is not None and added.crs is None and added.to_crs is None:
        centres = project.block.numbers("images", *"xyz") + project.block.offset
        project = project.having(warnings=filter(None, [elsewhere(centres, project.block.crs)]))
    say("proving by reprojection")
    with blaming(path, "a whole project"):
        proof = prove(project)
    try:
        refused = marks_refused(project)
        if refused and not (force or project.own):
            raise InputError(f"{refused}; --force writes the block as it is")
        demand(proof, force or project.own or (unadjusted and not proof.explained))
    except InputError as error:
        said = "".join(f"; {sentence}" for sentence in project.warnings)
        raise InputError(f"{path}: {error}{said}") from None
    if added.to_crs is not None:
        project = in_local_frame(project, added.to_crs)
    if project.own:
        pass
    elif proof.verdict == "refused" and not force:
        told = f"by the poses of the project itself the points do not reproject ({proof.main})"
        project = project.warned(told)
    elif proof.verdict == "refused":
        project = project.warned(f"written with --force although {proof.refusal()}")
    elif proof.verdict == "unproved":
        project = project.warned(proof.refusal())
    block = project.block
    block.source = block.source or f"imported from {project.form}: {path.name}"
    say(f"writing {output}")
    block.write(output, table_form, observed=False)
    if form == "photos" and is_whole(project, Path(output)) and not bent(project.block):
        forget(Path(output))
    return Imported(project, proof, Path(output))


def _list_beside(path: Path) -> Path | None:
    """OpenDroneMap's list of ground points in the folder of a project, or in the one above."""
    home = path if path.is_dir() else path.parent
    places = [home, home / "opensfm", *([home.parent] if home.name == "opensfm" else [])]
    return next((file for one in places if (file := one / "gcp_list.txt").is_file()), None)


def _prj_beside(path: Path) -> list[str]:
    """A sentence on a .prj in the folder of a project that states no system; none without it."""
    try:
        beside = system_beside(path, "--crs")
    except InputError as error:
        return [str(error)]
    if beside is None:
        return []
    file, code, named = beside
    code = code if code.startswith("EPSG") else "and its code"
    return [
        f"{file.name} beside the project names {named} and was not read: if the project's "
        f"coordinates are in it, give --crs {code}"
    ]


def _with_tie_sigma(project: Project) -> Project:
    """The project whose tie points have the standard deviation that the mapping left them.

    Root of v'v / r of the residuals, without gross errors; r: observations less unknowns.
    """
    rows = rows_of(project.block, complete=False)
    ties = rows.only(rows.point < rows.ties)
    residual = ties.residuals()
    size = np.abs(residual).max(axis=1)
    good = size < GROSS * robust_scale(residual)
    used = ties.only(good)
    spare = 2 * good.sum() - 3 * len(np.unique(used.point)) - 6 * len(np.unique(used.image))
    if spare < _LEAST_SPARE:
        return project
    sigma = round(float(np.sqrt(np.sum(residual[good] ** 2) / spare)), 2)
    if not _SIGMA_PX[0] <= sigma <= _SIGMA_PX[1]:
        return project
    told = f"tie points are good to {sigma:g} px (1 sigma), by the residuals of the mapping"
    redundancy = Witness("residuals of the mapping", AGREES, f"redundancy {spare:,}")
    project = project.having(notes=[told], sigma={**project.block.sigma, "tie_px": sigma})
    known = np.array([sigma])
    return project.deriving("sigma.tie_px", "tie_points.csv", known, told, "px", [redundancy])


def _straight(project: Project, output: Path, force: bool) -> Project:
    """Raises WorkFailed where a model contradicts the positions, unless nobody minds."""
    said = bent(project.block)
    if said is None:
        return project
    if not force:
        others = "".join(f"{sentence}. " for sentence in project.warnings)
        raise WorkFailed(
            f"{others}{said[0].upper()}{said[1:]}; features and matches are kept in "
            f"{workplace(output)}; --force writes the block as it is"
        )
    return project.warned(said)


def in_crs(project: Project, crs: str) -> Project:
    """The project in coordinates of a grid in metres, converted to it or proved to be in it.

    Raises InputError where it has no place on Earth and its numbers are no coordinates there.
    """
    in_metres(crs)
    block, local = project.block, local_of(project.block)
    if local is not None:
        told = f"east, north, up about {local.lat_deg:g}, {local.lon_deg:g}"
    elif block.crs is None:
        if outside := outside_area(block.numbers("images", *"xyz") + block.offset, crs):
            raise InputError(
                f"--crs {crs}: the project's coordinates are not in it ({outside}); it has a frame "
                "of its own: place it with --photos or --track, or leave --crs out"
            )
        return project.having(crs=crs, placed=True)
    elif known_crs(block.crs).equals(known_crs(crs), ignore_axis_order=True):
        return project.having(crs=crs)
    else:
        told = block.crs if len(block.crs) <= 40 else known_crs(block.crs).name
    made = near_origin(moved(block, crs))
    note = f"coordinates were converted from {told} to {crs}, point by point"
    return replace(project, block=made).having(notes=[note], warnings=loose_way(block, crs))


def in_local_frame(project: Project, crs: str | None) -> Project:
    """The project in east, north, up about its middle; results go out in a CRS, or in its own.

    Raises InputError where nothing says where on Earth it is.
    """
    block, local = project.block, local_of(project.block)
    if crs is not None:
        known_crs(crs)
    if local is None:
        local, crs = about_the_middle(block), crs or block.crs
        note = (
            f"coordinates were converted to east, north, up about {local.lat_deg:g}, "
            f"{local.lon_deg:g}: results go out in {crs}"
        )
        project = project.noted(note)
    elif crs is None:
        return project
    project = project.having(warnings=loose_way(block, crs))
    return replace(project, block=moved(block, local, crs))


def complete(project: Project, added: Additions, say: Callable[..., None] = silent) -> Project:
    """The project with what photographs, a track and a file of ground points know."""
    late = None
    if added.crs is not None:
        try:
            project = in_crs(project, added.crs)
        except InputError:
            if project.placed or not (added.photos or added.track):
                raise
            late = added.crs  # once photographs or a track have placed it
    photos, exposures = {}, None
    free = not project.placed and project.block.crs is None and local_of(project.block) is None
    if added.photos is not None:
        say(f"reading the photographs of {added.photos}")
        with blaming(added.photos, "a folder of photographs"):
            project, photos, exposures = add_photographs(project, added.photos)
    elif added.attitudes:
        raise InputError(
            "--attitudes takes what photographs state: give their folder with --photos"
        )
    if added.track is not None:
        say(f"reading {added.track}")
        track = Track(added.track, added.track_system, added.images_system)
        with blaming(added.track, "a track"):
            project = add_track(project, exposures, track)
    if late is not None:
        project = in_crs(project, late)
    if added.ground is not None:
        project = add_ground(project, added.ground, photos, added.ground_crs)
    elif added.ground_crs is not None:
        raise InputError(
            "--ground-crs is the system of a file of ground points: give the file with --ground"
        )
    if added.photos or added.track:
        project = project.having(warnings=loose_way(project.block, GEOGRAPHIC))
    # Only now is it known in which frame the project is.
    project = in_own_frame(with_motion(placed_by_own(project, last=True), photos))
    if photos and len(project.block.gnss) and added.track is None:
        project = with_heights_told(with_delay_told(project), photos, free)
    # Marks are measured in the pictures as they lie there: only now can all be turned back.
    project = with_turned(project, photos)
    return with_attitudes(project, photos) if added.attitudes else project
