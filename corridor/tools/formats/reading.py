"""Read a project of another program, whatever its format."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.block import SIGMAS, Block, places
from corridor.core.errors import InputError
from corridor.core.gnss import known_crs, metric
from corridor.core.preparation import passed_over
from corridor.core.textfile import disguised
from corridor.tools.formats.control import placed_by_own
from corridor.tools.formats.faults import blaming
from corridor.tools.formats.programs import candidates, formats
from corridor.tools.formats.project import Project, near_origin
from corridor.tools.formats.strange import TEXT, strange

# Endings of the files that projects are made of.
_OF_PROJECTS = (
    ".txt", ".csv", ".json", ".xml", ".bin", ".toml", ".parquet", ".psx", ".psz", ".out", ".nvm",
    ".sfm", ".dat", ".xyz", ".prj", ".db", ".p4d",
)  # fmt: skip
# A few bad matches lie outside their picture.
_MOST_OUTSIDE = 0.02
_FEW = 0.01  # share of points seen once that mean nothing


@np.errstate(all="ignore")
def read_project(
    path: str | Path, form: str = "auto", size: tuple[int, int] | None = None
) -> Project:
    """The project of a file or folder, in this package's conventions; not yet proved.

    form: a name of `format_names()`, or auto. size: of the pictures, pixels, for formats whose
    files do not have it.
    Raises InputError: one sentence that names file, line and what to do.
    """
    path, others = Path(path), []
    if not path.exists():
        raise _not_there(path)
    if told := _disguised(path):
        raise InputError(told)
    form = form.lower()
    # A format may be written in several forms, all of which it reads.
    known = formats().items()
    form = next((name for name, one in known if form in getattr(one, "WRITES", ())), form)
    if form == "auto":
        form, path, others = _found(path)
    elif form not in formats():
        known = ", ".join(formats())
        raise InputError(f"format {form!r} is unknown; use auto, photos or one of {known}")
    else:
        path = next((place for name, place in candidates(path) if name == form), path)
    if told := _disguised(path):
        raise InputError(told)
    with blaming(path, f"a project of {form}"):
        project = formats()[form].read(path, size)
        if project.own:
            project = project.warned(*passed_over(project.block))
        else:
            project = _counted_in_metres(project)
        ties = not project.own and len(project.block.tie_points)
        outside = project.block.outside("tie_points").mean() if ties else 0.0
        if outside > _MOST_OUTSIDE and size is None:
            project = project.warned(
                f"{outside:.0%} of the image points lie outside the pictures that the project "
                "states: were they measured in pictures of another size?"
            )
        elif outside > _MOST_OUTSIDE:
            raise InputError(
                f"{outside:.0%} of the image points lie outside pictures of {size[0]} x {size[1]} "
                "px (--size, or the photographs of --photos): give the size of the pictures that "
                "the points were measured in"
            )
        project = replace(project, block=near_origin(project.block))
        warnings, notes = _unseen(project.block)
        project = placed_by_own(project).having(warnings=warnings, notes=notes)
    if others:
        also = f"the same place is also a project of {', '.join(others)}: name it so"
        project = project.noted(also)
    return project


def _counted_in_metres(project: Project) -> Project:
    """The project in metres, where its grid counts in feet, as that of its poses does then."""
    block = project.block
    if block.crs is None or block.crs.startswith("local"):
        return project
    crs, unit = metric(block.crs)
    if unit == 1.0:
        return project
    tables = {}
    for name in ("images", "points", "ground", "gnss"):
        table = getattr(block, name)
        lengths = [column for column in (*"xyz", *SIGMAS) if column in table]
        tables[name] = table.assign(**{column: unit * table[column] for column in lengths})
    system = known_crs(block.crs)
    told = f"{system.name} counts in {system.axis_info[0].unit_name}: the block is in metres"
    return project.having(notes=[told], crs=crs, offset=unit * block.offset, **tables)


def _unseen(block: Block) -> tuple[list[str], list[str]]:
    """Warnings and notes on points and images without observations: a file that ends early at the
    end of a line. A few points whose other rays a program has struck are everywhere."""
    if not len(block.tie_points):
        return [], []
    warnings, notes = [], []
    names = block.tie_points["point"].cat.categories
    codes = block.tie_points["point"].array.codes.astype(np.int64)
    seen = np.bincount(codes, minlength=len(names))
    at = places(block.points["point"], names)
    few = pd.Series(np.where(at >= 0, seen[at], 0) < 2)
    if len(block.ground) or len(block.marks):
        few &= ~block.points["point"].isin(set(block.ground["point"]))
        few &= ~block.points["point"].isin(set(block.marks["point"].cat.categories))
    if few.any():
        told = (
            f"{int(few.sum())} of {len(block.points)} points are seen in fewer than two images "
            f"(first: {block.points['point'][few].iloc[0]})"
        )
        if few.mean() < _FEW:
            notes.append(told)
        else:
            warnings.append(f"{told}: the observations may be cut off")
    bare = ~block.images["image"].isin(set(block.tie_points["image"].unique()))
    bare &= ~block.images["image"].isin(set(block.marks["image"].unique()))
    if bare.any():
        warnings.append(
            f"{int(bare.sum())} of {len(block.images)} images see no point (first: "
            f"{block.images['image'][bare].iloc[0]})"
        )
    return warnings, notes


def _disguised(path: Path) -> str:
    """A sentence on a file, or one of a folder, that is not what its name says; or empty."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    told = ((file, disguised(file)) for file in files if file.suffix.lower() in _OF_PROJECTS)
    return next((f"{file} is {what}" for file, what in told if what), "")


def _not_there(path: Path) -> InputError:
    """The sentence for a project that is not there."""
    if re.match(r"(?i)(https?|ftp|s3):/", str(path)):
        return InputError(f"{path} is an address: download it, unpack it, and name the folder")
    known = registry.room("data").register()
    if str(path) in known:
        return InputError(
            f"{path} is not there; `corridor data fetch {path} -o {path}` fetches the set of that "
            "name"
        )
    return InputError(f"{path} is not there; name the file or folder of a project")


def _found(path: Path) -> tuple[str, Path, list[str]]:
    found = candidates(path)
    if not found:
        known = ", ".join(formats())
        named = strange(path)
        whole = candidates(path.parent) if path.is_file() else []
        if (not named or named == TEXT) and (whole and whole[0][1] == path.parent):
            named = f"a part of a project of {whole[0][0]}: name its folder, {path.parent}"
        if named:
            raise InputError(f"{path} is {named}")
        raise InputError(
            f"{path} is not a project that corridor recognises ({known}); name the exported file "
            "or folder, and its format in place of auto"
        )
    if len({place for _, place in found}) > 1:
        places = "; ".join(f"{name}: {place}" for name, place in found[:6])
        raise InputError(f"{path} holds several projects ({places}); name one of them")
    (form, place), *others = found
    return form, place, [name for name, _ in others]


def format_names() -> dict[str, str]:
    """What each format is, by its name."""
    return {name: module.TITLE for name, module in formats().items()}
