"""Files for the program that a project comes from, proved by importing them again."""

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.effects import take_out
from corridor.core.errors import InputError
from corridor.core.gnss import in_world, known_crs, world_crs
from corridor.core.output import counted, millimetres, significant, whole_folder, write_csv
from corridor.tools.check.advice import ProgramSettings

MARK = "settings.txt"
_DIGITS = 12  # a northing to a hundredth of a millimetre
_NOTHING = 1e-8  # of a coordinate, a parameter or a pixel: rounding of the computation
_XYZ, _SIGMAS = ["x", "y", "z"], ["sx", "sy", "sz"]


@dataclass
class TakenBack:
    """What was written for another program.

    folder: where. files: with their paths. native: the format of the project in it, or "". proof:
    what importing it again shows, a sentence. sentences: what the formats cannot hold.
    """

    folder: str
    files: list[str]
    native: str = ""
    proof: str = ""
    sentences: list[str] = field(default_factory=list)


def take_back(result: Path, folder: Path, form: str, settings: ProgramSettings) -> TakenBack:
    """Writes what to take back of a result of `corridor adjust`, and imports it again.

    settings.txt; camera.toml; positions.csv (camera positions by GNSS, corrected for the antenna,
    with sigmas), ground.csv, marks.csv and gcp_list.txt (control and its marks, effects taken out),
    in the block's system; project/: the whole project in its own format, where that is written.
    """
    formats = registry.room("interchange")
    block, effects = formats.read_adjusted(result)
    measured = take_out(block, effects) if effects else block
    if settings.without:
        roles = measured.ground["role"].where(
            ~measured.ground["point"].isin(settings.without), "unused"
        )
        measured.ground = measured.ground.assign(role=roles)
    native = form if form in formats.export_names() else ""
    sentences: list[str] = []
    with whole_folder(folder, MARK) as part:
        lines = [f"Settings for {form}, from corridor check", "", *settings.sentences()]
        (part / MARK).write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
        _write_camera(part, measured)
        positions = formats.camera_positions(measured)
        if len(positions):
            write_csv(_out(measured, positions), part / "positions.csv", _DIGITS)
        _write_ground(part, measured)
        if native:
            try:
                made = formats.export_project(measured, native, part / "project", corrected=True)
                sentences += made.sentences
            except InputError as error:
                sentences.append(f"the project was not written as {native}: {error}")
                native = ""
    if any(" " in str(name) for name in measured.images["image"]):
        sentences.append(
            "gcp_list.txt has names with blanks in quotes, which OpenDroneMap does not read: "
            "rename the photographs for it"
        )
    proof = proved(folder, measured, native, formats)
    files = sorted(str(path) for path in folder.rglob("*") if path.is_file())
    return TakenBack(str(folder), files, native, proof, sentences)


def proved(folder: Path, block: Block, native: str, formats) -> str:
    """What importing every file again shows, against the block that they were written from."""
    told = []
    if native:
        project = formats.read_project(folder / "project", native)
        proof = formats.prove(project)
        told.append(f"project/ imported again: {proof.main}")
    tables = tomllib.loads((folder / "camera.toml").read_text(encoding="utf-8"))["camera"]
    off = max(
        float(np.abs(camera.interior - Camera.from_table(*again).interior).max())
        for camera, again in zip(block.cameras.values(), tables.items(), strict=True)
    )
    told.append(f"camera.toml read again: {_same(off, 'in every parameter')}")
    if (folder / "positions.csv").is_file():
        again = pd.read_csv(folder / "positions.csv", dtype={"image": str})
        table = formats.camera_positions(block)
        places = again[_XYZ].to_numpy(float)
        off = _largest(in_world(block, table[_XYZ].to_numpy(float)) - places)
        sigmas = np.abs(again[_SIGMAS].to_numpy(float) - table[_SIGMAS].to_numpy(float))
        told.append(
            f"positions.csv read again: {counted(len(again), 'position')}, "
            f"{_same(off, 'm')}, standard deviations {_same(float(np.nanmax(sigmas)), 'm')}"
        )
    for name in ("ground.csv", "gcp_list.txt"):
        if (folder / name).is_file():
            try:
                again = _ground_again(folder / name, block, formats)
            except InputError as error:
                again = f"refused, do not use it ({error})"
            told.append(f"{name} imported again: {again}")
    return "; ".join(told)


def _same(off: float, unit: str) -> str:
    """How far apart two of the same are, m, px or as numbers; the same where by less than any
    digit that a file of another program has."""
    if off < _NOTHING:
        return f"the same {unit}" if " " in unit else "the same"
    return f"the same to {millimetres(off) if unit == 'm' else f'{significant(off)} {unit}'}"


def _largest(apart: np.ndarray) -> float:
    return float(np.linalg.norm(apart, axis=1).max()) if len(apart) else 0.0


def _ground_again(path: Path, block: Block, formats) -> str:
    """Ground points and marks of a file, imported into the block without its own."""
    bare = replace(block, ground=None, marks=None)
    project = formats.Project("block", path.parent, bare, own=True)
    crs = world_crs(block)
    again = formats.add_ground(project, path, crs=crs).block
    told = []
    for table, columns, keys, unit in (
        ("ground", _XYZ, ["point"], "m"),
        ("marks", ["x", "y"], ["point", "image"], "px"),
    ):
        mine, theirs = (
            getattr(one, table).astype(dict.fromkeys(keys, str)).set_index(keys)[columns]
            for one in (block, again)
        )
        both = mine.index.intersection(theirs.index)
        if len(both):
            off = _largest((mine.loc[both] - theirs.loc[both]).to_numpy(float))
            what = counted(len(both), "point" if table == "ground" else "mark")
            told.append(f"{what}, {_same(off, unit)}")
    return ", ".join(told)


def _write_camera(folder: Path, block: Block) -> None:
    """camera.toml: one table a camera, as block.toml has it."""
    lines = []
    for name, camera in block.cameras.items():
        lines.append(f'[camera."{name}"]')
        for key, value in camera.to_table().items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                lines.append(f"{key} = {value!r}")
        lines.append("")
    (folder / "camera.toml").write_text("\n".join(lines), encoding="utf-8", newline="\n")


def _out(block: Block, table: pd.DataFrame) -> pd.DataFrame:
    """The table with places in the system of the block's results."""
    places = in_world(block, table[_XYZ].to_numpy(float))
    return table.assign(**dict(zip(_XYZ, places.T, strict=True)))


def _write_ground(folder: Path, block: Block) -> None:
    if not len(block.ground):
        return
    ground = _out(block, block.ground)
    sigma = block.ground_sigma()
    ground = ground.assign(sx=sigma[:, 0], sy=sigma[:, 1], sz=sigma[:, 2])
    crs = world_crs(block)
    # A tenth of a millimetre, also in degrees.
    digits = 9 if crs is not None and known_crs(crs).is_geographic else 4
    ground[_XYZ] = ground[_XYZ].round(digits)
    write_csv(ground[["point", *_XYZ, *_SIGMAS, "role"]], folder / "ground.csv", _DIGITS)
    used = ground[ground["role"] != "unused"].set_index("point")
    if not len(block.marks):
        return
    marks = block.marks[["point", "image", "x", "y"]].astype({"point": str, "image": str})
    marks[["x", "y"]] = marks[["x", "y"]].round(4)
    write_csv(marks, folder / "marks.csv", _DIGITS)
    if crs is None or not len(used):
        return
    lines = [crs]
    for point, image, x, y in marks.itertuples(index=False):
        if point in used.index:
            place = used.loc[point, _XYZ].to_numpy(float)
            e, n, h = (f"{value:.{digits}f}" for value in place)
            lines.append(f"{e} {n} {h} {x:.3f} {y:.3f} {_word(image)} {_word(point)}")
    (folder / "gcp_list.txt").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _word(name: str) -> str:
    """A name in a file whose words stand between blanks."""
    return f'"{name}"' if any(map(str.isspace, name)) else name
