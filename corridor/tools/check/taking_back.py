"""Files for the program that a project comes from, proved by importing them again."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.block import Block
from corridor.core.effects import take_out
from corridor.core.errors import InputError
from corridor.core.gnss import in_world, world_crs
from corridor.core.output import whole_folder, write_csv
from corridor.tools.check.advice import ProgramSettings

MARK = "settings.txt"
_XYZ = ["x", "y", "z"]


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
        _write_settings(part, settings, form)
        _write_camera(part, measured)
        _write_positions(part, measured, formats)
        _write_ground(part, measured)
        if native:
            try:
                made = formats.export_project(measured, native, part / "project", corrected=True)
                sentences += made.sentences
            except InputError as error:
                sentences.append(f"the project was not written as {native}: {error}")
                native = ""
    proof = _proved(folder, measured, native, formats)
    files = sorted(str(path) for path in folder.rglob("*") if path.is_file())
    return TakenBack(str(folder), files, native, proof, sentences)


def _proved(folder: Path, block: Block, native: str, formats) -> str:
    """What importing the files again shows."""
    told = []
    if native:
        project = formats.read_project(folder / "project", native)
        proof = formats.prove(project)
        told.append(f"project/ imported again: {proof.main}")
    if (folder / "gcp_list.txt").is_file():
        again = formats.read_gcp_list(folder / "gcp_list.txt")
        marks = {(p, i): (x, y) for p, i, x, y in again.marks}
        mine = block.marks[["point", "image", "x", "y"]].astype({"point": str, "image": str})
        away = [
            np.hypot(marks[p, i][0] - x, marks[p, i][1] - y)
            for p, i, x, y in mine.itertuples(index=False)
            if (p, i) in marks
        ]
        if away:
            told.append(
                f"gcp_list.txt read again: {len(again.table)} points, {len(away)} marks, the same "
                f"to {max(away):.1g} px"
            )
    return "; ".join(told)


def _write_settings(folder: Path, settings: ProgramSettings, form: str) -> None:
    lines = [f"Settings for {form}, from corridor check", "", *settings.sentences(form)]
    (folder / MARK).write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


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


def _write_positions(folder: Path, block: Block, formats) -> None:
    table = formats.camera_positions(block)
    if len(table):
        table = _out(block, table)
        write_csv(table, folder / "positions.csv")


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
    columns = ["point", *_XYZ, "sx", "sy", "sz", "role"]
    text = ground[columns].to_csv(index=False, float_format="%.4f", lineterminator="\n")
    (folder / "ground.csv").write_text(text, encoding="utf-8", newline="\n")
    crs = world_crs(block)
    used = ground[ground["role"] != "unused"].set_index("point")
    if not len(block.marks):
        return
    marks = block.marks[["point", "image", "x", "y"]].astype({"point": str, "image": str})
    marks.to_csv(folder / "marks.csv", index=False, float_format="%.4f", lineterminator="\n")
    if crs is None or not len(used):
        return
    lines = [crs]
    for point, image, x, y in marks.itertuples(index=False):
        if point in used.index:
            place = used.loc[point, _XYZ].to_numpy(float)
            e, n, h = (f"{value:.4f}" for value in place)
            lines.append(f"{e} {n} {h} {x:.3f} {y:.3f} {_word(image)} {_word(point)}")
    (folder / "gcp_list.txt").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _word(name: str) -> str:
    """A name in a file whose words stand between blanks."""
    return name.replace(" ", "_")
