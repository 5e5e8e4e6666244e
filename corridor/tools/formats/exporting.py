"""From a block to another program's project, without losing silently what it cannot hold.

A target that holds less (no b2, no rolling shutter, no lever arms) gets measurements corrected to
what it can hold, or the export is refused, or the rest is lost because somebody said so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corridor.core.block import Block, as_mounted, exposures_of, read, rigs_of
from corridor.core.brief import brief
from corridor.core.effects import Effect, Values, every_effect, take_out
from corridor.core.errors import InputError
from corridor.core.gnss import in_metres
from corridor.core.output import Progress, counted, file_lines, telling, whole_folder
from corridor.tools.formats.cameras import moved_to
from corridor.tools.formats.frames import moved
from corridor.tools.formats.programs import writers
from corridor.tools.formats.project import near_origin
from corridor.tools.formats.proof import MEDIAN_PX, Residuals
from corridor.tools.formats.rows import rows_of

_MARK = "exported_by_corridor.txt"
_RESULT = "adjustment.json"
# What a block may have that a format cannot hold: the keys of its LOSSES.
_HAS: dict[str, Callable[[Block], bool]] = {
    "tie points": lambda block: bool(len(block.tie_points)),
    "sigmas": lambda block: "sigma" in block.tie_points,
    "marks": lambda block: bool(len(block.marks)),
    "GNSS": lambda block: bool(len(block.gnss)),
    "ground without place": lambda block: len(block.ground) and "local_frame" not in block.extra,
    "offset": lambda block: bool(block.offset.any()),
    "names": lambda block: True,
    "unlike rigs": lambda block: not as_mounted(block),
    "rigs without base": lambda block: _led_by_a_member(block),
}


@brief
@dataclass
class Exported:
    """What was written where, what the target cannot hold and what became of it."""

    form: str
    folder: Path
    images: int
    observations: int
    sentences: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        counts = f"{self.images:,} images, {self.observations:,} observations"
        return "\n".join([f"{self.form}: {counts}", *self.sentences])


def read_adjusted(folder: str | Path) -> tuple[Block, Values]:
    """A block, or the adjusted block of a result of `corridor adjust`, and its effects.

    Without those that the adjusted block states itself. Raises InputError.
    """
    folder = Path(folder)
    if not (folder / _RESULT).is_file():
        return read(folder), Values()
    block = read(folder / "block")
    found = Values.read(folder / _RESULT, block)
    own = Effect.restated
    return block, Values(one for one in found.values() if type(one.effect).restated is own)


def export_project(
    block: Block | str | Path,
    form: str,
    folder: str | Path,
    *,
    effects: Mapping[str, Mapping] | None = None,
    corrected: bool = False,
    lossy: bool = False,
    to_crs: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Exported:
    """Write the block as a project of another program, whole or not at all.

    block: as read, or its folder, or the result of `corridor adjust`, whose effects are in the
    measurements too. form: a name of `export_names()`. effects: values that are in the
    measurements, as `take_out` takes them; with `corrected` they are taken out, and the
    measurements moved to a camera that the target holds. lossy: parameters and effects the target
    cannot hold are dropped instead. to_crs: a grid in metres, as `EPSG:25832`, to which the
    coordinates are converted.
    Raises InputError where the target cannot hold the block and neither is allowed, or nothing says
    where on Earth a block lies that is to be converted.
    """
    if form not in writers():
        raise InputError(f"format {form!r} is not written; use one of {', '.join(writers())}")
    if corrected and lossy:
        raise InputError("--corrected and --lossy contradict each other: give one of them")
    target, say = writers()[form], telling(progress)
    if not isinstance(block, Block):
        block, found = read_adjusted(block)
        effects = {**found, **{s: {**found.get(s, {}), **v} for s, v in (effects or {}).items()}}
    effects = Values.of(block, effects or {})
    fisheyes = [name for name, camera in block.cameras.items() if camera.fisheye]
    if fisheyes and not target.HOLDS.fisheye:
        held = [name for name, module in writers().items() if module.HOLDS.fisheye]
        raise InputError(
            f"{form} has no fisheye lens, and camera {fisheyes[0]} is one: use one of "
            f"{', '.join(held)}"
        )
    unheld = {name: list(target.HOLDS.unheld(camera)) for name, camera in block.cameras.items()}
    unheld = {name: names for name, names in unheld.items() if names}
    stated = _stated_effect(block, effects)
    if (unheld or effects or stated) and not (corrected or lossy):
        raise InputError(_refusal(form, target, unheld, effects, stated))
    sentences = []
    exported = block.copy()
    if effects and corrected:
        say(f"taking out {', '.join(effects)}")
        exported = take_out(exported, effects)
        sentences.append(f"taken out of the measurements: {', '.join(effects)}")
    elif effects:
        sentences.append(f"lost: {', '.join(effects)} (they stay in the measurements)")
    if stated and corrected:
        sentences.append(f"not corrected: {stated}")
    elif stated:
        sentences.append(f"lost: {stated}")
    if unheld:
        exported = _to_held_cameras(exported, target, unheld, corrected, sentences)
    if to_crs is not None:
        in_metres(to_crs)
        if not getattr(target, "GRIDS", True):
            raise InputError(
                f"coordinates of {form} are east, north, up about a point that its files name, "
                "never those of a grid; leave --to-crs out"
            )
        exported = near_origin(moved(exported, to_crs))
        sentences.append(f"coordinates are in {to_crs}")
    sentences += [
        f"{form} holds no {said}" for has, said in target.LOSSES.items() if _HAS[has](exported)
    ]
    lost = len(exported.distances)
    if getattr(target, "DISTANCES", False):
        shown = set(exported.marks["point"].astype(str)) | set(exported.ground["point"].astype(str))
        there = [exported.distances[end].astype(str).isin(shown) for end in ("from", "to")]
        lost -= int((there[0] & there[1]).sum())
    if lost:
        sentences.append(
            f"lost: {counted(lost, 'row')} of distances.csv; enter them in the other program as "
            "scale bars between markers"
        )
    if rigs_of(exported) and not getattr(target, "RIGS", False):
        sentences.append(f"lost: the rigs {', '.join(rigs_of(exported))}; each image is on its own")
    found = Residuals.of(np.linalg.norm(rows_of(exported).residuals(), axis=1))
    sentences.append(f"what is written reprojects with {found}")
    if found.median > MEDIAN_PX:
        sentences.append(
            "warning: that is not an adjusted block; adjust it first and export the result"
        )
    say(f"writing {folder}")
    with whole_folder(folder, _MARK) as part:
        target.write(exported, part, form)
        (part / _MARK).write_text(
            "\n".join([f"block {block.name} as {form}", *sentences, file_lines(part)]),
            encoding="utf-8",
        )
    observations = len(exported.tie_points) + len(exported.marks)
    return Exported(form, Path(folder), len(exported.images), observations, sentences)


def export_names() -> dict[str, str]:
    """What each kind of export is, by its name."""
    return {name: f"{module.TITLE}; holds {module.HOLDS}" for name, module in writers().items()}


def _led_by_a_member(block):
    """Whether an exposure of a rig lacks the base camera."""
    cameras = block.images["camera"].to_numpy(object)[exposures_of(block).base]
    return not {rig["base"] for rig in rigs_of(block).values()}.issuperset(cameras)


def _stated_effect(block, effects):
    """An effect whose values the block states and nobody estimated or takes out."""
    chosen = [one.effect for one in effects.values()]
    for effect in (one.form(block) for one in every_effect()):
        if effect.stated(block) is None or effect.missing(block):
            continue
        if not any(other.place == effect.place for other in chosen):
            values = ",".join(f"{p.name}=VALUE" for p in effect.parameters(block))
            return (
                f"{effect.called}, whose values block.toml states: give it with --effect "
                f"{effect.slug}:{values}, or adjust with it and export the result"
            )
    return ""


def _refusal(form, target, unheld, effects, stated):
    parts = [f"{', '.join(names)} of camera {name}" for name, names in unheld.items()]
    if effects:
        parts.append(f"the effects {', '.join(effects)}")
    if stated:
        parts.append(stated)
    return (
        f"{form} cannot hold {'; '.join(parts)} (it holds {target.HOLDS}); --corrected writes "
        "measurements corrected to what it holds, --lossy drops the rest"
    )


def _to_held_cameras(block, target, unheld, corrected, sentences):
    cameras = {name: target.HOLDS.nearest(camera) for name, camera in block.cameras.items()}
    for name, names in unheld.items():
        what = "measurements moved to a camera without" if corrected else "lost:"
        sentences.append(f"camera {name}: {what} {', '.join(names)}")
    if corrected:
        source = np.array([block.cameras[name].interior for name in block.images["camera"]])
        held = np.array([cameras[name].interior for name in block.images["camera"]])
        for table in ("tie_points", "marks"):
            frame = getattr(block, table)
            if not len(frame):
                continue
            pixels = frame[["x", "y"]].to_numpy(float)
            moved = moved_to(pixels, block.image_rows(table), source, held)
            lost = ~np.isfinite(moved).all(axis=1)
            if lost.any():
                sentences.append(
                    f"{int(lost.sum())} rows of {table} lie beyond the fold of the distortion: "
                    "left out"
                )
            frame = frame[~lost].reset_index(drop=True)
            frame[["x", "y"]] = moved[~lost]
            setattr(block, table, frame)
    block.cameras = cameras
    return block
