"""Import, adjust, diagnose, and say on one page what came of it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from corridor.core import __version__, registry
from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Model
from corridor.core.block import Block, read
from corridor.core.brief import brief
from corridor.core.errors import AdjustmentFailed, InputError, WorkFailed
from corridor.core.gnss import known_crs, local_of, world_crs
from corridor.core.output import (
    Progress,
    counted,
    millimetres,
    plain,
    telling,
    whole_file,
    write_json,
)
from corridor.core.photographs import photographs_in
from corridor.tools.check.advice import ProgramSettings, verdict_of
from corridor.tools.check.report import report_of
from corridor.tools.check.taking_back import TakenBack, take_back

# What a folder of a check is known by, from its first second on.
MARK = "check.state.json"
RESULT = "check.json"
_MOST_FILES = 20_000
# A self-calibration that works knows f to some 0.01 to 0.1 %, and the value in a project is of one:
# where the images of this block leave f more open than this, the project knows more than they do.
_MOST_OF_F = 0.005
# What a diagnosis takes on two processors: 15 s at 60,000 observations, 64 s at 333,000 and 254 s
# at 1.7 million (benchmarks/diagnosis_speed.py).
_START_S, _S_PER_MILLION = 8.0, 160.0
# Where a free camera does not adjust, holding it is an answer only if the residuals are about what
# is stated: beyond three times that, something else is wrong, which the start values tell.
_FITS = 3.0


@brief
@dataclass
class Checked:
    """What a check found.

    verdict: `good enough`, `not good enough`, `not known` or `failed`. sentence: the answer in one
    or two sentences. wrong: what is wrong, the gravest first. actions: what to do. settings: for
    the program that the project comes from. taken_back: the files for it. imported: what the import
    said. adjustment, diagnosis: contents of their JSON files, None where there is none.
    """

    project: str
    form: str
    folder: Path
    verdict: str
    sentence: str
    wrong: list[str]
    actions: list[str]
    settings: list[str]
    imported: list[str]
    taken_back: TakenBack | None
    adjustment: dict | None
    diagnosis: dict | None
    required: float | None
    files: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return str(report_of(self))

    def to_dict(self) -> dict[str, Any]:
        """check.json: finite numbers, texts or null."""
        content = {
            "project": self.project,
            "format": self.form,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "required": self.required,
            "wrong": self.wrong,
            "actions": self.actions,
            "settings": self.settings,
            "imported": self.imported,
            "take_back": None if self.taken_back is None else asdict(self.taken_back),
            "adjustment": _of(self.adjustment, "converged", "sigma0", "check_points", "camera"),
            "diagnosis": _of(self.diagnosis, "verdict", "sentence", "effects", "gap"),
            "files": self.files,
        }
        return plain(content)


def _of(content: dict | None, *keys: str) -> dict | None:
    return None if content is None else {key: content.get(key) for key in keys}


def check_project(
    project: str | os.PathLike,
    output: str | os.PathLike,
    *,
    form: str = "auto",
    required: float | None = None,
    added: dict[str, Any] | None = None,
    diagnose: bool = True,
    certificate: str | None = None,
    threads: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> Checked:
    """Import a project, adjust and diagnose it, and write the answer into the folder `output`.

    project: file or folder of a project of another program, a folder of photographs, or a block.
    form: its format, where it is not told by the content. required: 3D RMS of check points that
    is good enough, m. added: fields of `corridor.interchange.Additions`. diagnose: whether to ask
    what is missing from the model, which takes most of the time.
    certificate: form of a certificate of OUT/block, adjusted with what was found; see
    `corridor.certificate`.

    Each stage (block/, adjusted/, missing/, take_back/) is written when it is whole, and is not
    done again by the same call: after an interruption it goes on.
    Raises InputError where the project cannot be read; WorkFailed where photographs do not become a
    model. A block that does not adjust is an answer, too.
    """
    project, output, say = Path(project), Path(output), telling(progress)
    if not project.exists():
        registry.room("interchange").read_project(project)  # which says so
    stages = _Stages(output, _digest(project, form, added, required, diagnose, certificate))
    form = _form(project, form)
    imported = stages.get("imported")
    if imported is None:
        say(f"importing {project}")
        imported = _imported(project, form, output / "block", added or {}, progress)
        stages.done("imported", imported)
    block = read(output / "block")
    adjustment = stages.get("adjusted")
    if adjustment is None:
        say(f"adjusting {len(block.images)} images")
        adjustment = _adjusted_somehow(block, output / "adjusted", required, threads)
        stages.done("adjusted", adjustment)
        if diagnose and adjustment["converged"]:
            say(f"diagnosing: {_about(block)}; --quick leaves it out")
    held = adjustment.get("held", False)
    found = stages.get("diagnosed")
    if found is None and diagnose and adjustment["converged"]:
        found = _diagnosed(block, output / "missing", required, threads, held, progress)
        stages.done("diagnosed", found)
    best = stages.get("with_found")
    slugs = _named(found)
    if best is None and slugs:
        say(f"adjusting with {', '.join(slugs)}")
        best = _adjusted(block, output / "adjusted_with_found", required, threads, held, slugs)
        stages.done("with_found", best)
    home = output / "adjusted"
    if best is not None and best["converged"]:
        home = output / "adjusted_with_found"
    final = best if home.name != "adjusted" else adjustment
    # What contradicts itself is corrected first: its numbers would spoil the next adjustment too.
    contradicted = final.get("contradicted") or []
    answers = final["converged"] and not contradicted
    # The adjusted block has the standard deviations that were used.
    settings = ProgramSettings.of(final, found, read(home / "block")) if answers else None
    taken = None
    if settings is not None:
        taken = stages.get("taken")
        taken = None if taken is None else TakenBack(**taken)
        if taken is None:
            say("writing what to take back, and importing it again")
            taken = take_back(home, output / "take_back", imported["form"], settings)
            stages.done("taken", asdict(taken))
    if certificate is not None and final["converged"] and stages.get("certified") is None:
        say("adjusting once more for the certificate")
        slugs = slugs if home.name != "adjusted" else []
        made = registry.room("certificate").certify(
            output / "block", certificate, model=_model(held, slugs), required=required,
            threads=threads,
        )  # fmt: skip
        stages.done("certified", {"files": [str(path) for path in made.save(output)]})
    certified = (stages.get("certified") or {"files": []})["files"]
    verdict, sentence = verdict_of(final, found, required)
    wrong, actions = _told(final, found, imported, home)
    if contradicted:
        no_settings = (
            "So the adjustment contradicts itself, and no settings are given back: correct the "
            "cause, and check again."
        )
        wrong = [*contradicted, no_settings, *(one for one in wrong if one not in contradicted)]
    checked = Checked(
        project=str(project),
        form=imported["form"],
        folder=output,
        verdict=verdict,
        sentence=sentence,
        wrong=wrong,
        actions=actions,
        settings=[] if settings is None else settings.sentences(),
        imported=imported["notes"],
        taken_back=taken,
        adjustment=final,
        diagnosis=found,
        required=required,
    )
    checked.files = _write(checked, output, certified)
    return checked


# --- stages ----------------------------------------------------------------------------------


class _Stages:
    """What is done already of the same check, in the folder itself."""

    def __init__(self, folder: Path, digest: str):
        self._file, self._of = folder / MARK, digest
        try:
            content = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            content = {}
        same = isinstance(content, dict) and content.get("of") == digest
        self._done = content["done"] if same else {}
        if not same:
            self._keep()

    def get(self, name: str) -> dict | None:
        """What a stage left, None where it is not done."""
        return self._done.get(name)

    def done(self, name: str, content: dict) -> None:
        """Keeps what a stage left."""
        self._done[name] = plain(content)
        self._keep()

    def _keep(self) -> None:
        with whole_file(self._file) as part:
            write_json({"of": self._of, "done": self._done}, part)


def _digest(project: Path, *asked) -> str:
    """What the answer depends on: files of the project, what is asked, the version."""
    digest = hashlib.sha256(repr((__version__, str(project.resolve()), asked)).encode())
    beside = project.with_suffix(".files")
    places = [project, *([beside] if beside.is_dir() else [])]
    files = [
        file
        for place in places
        for file in (sorted(place.rglob("*"))[:_MOST_FILES] if place.is_dir() else [place])
        if file.is_file()
    ]
    for file in files:
        status = file.stat()
        digest.update(f"{file} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _form(project: Path, form: str) -> str:
    """The format to ask for: photographs where nothing else is recognised and there are some."""
    if form != "auto" or not project.is_dir():
        return form
    if registry.room("interchange").candidates(project):
        return form
    try:
        return "photos" if photographs_in(project) else form
    except InputError:
        return form


def _imported(project, form, folder, added, progress) -> dict:
    formats = registry.room("interchange")
    made = formats.import_project(
        project, form, folder, unadjusted=True, progress=progress, **added
    )
    block, notes, warnings = made.block, list(made.project.notes), made.project.warnings
    if not (len(block.tie_points) or len(block.marks)):
        told = "".join(
            f"; {sentence}"
            for sentence in made.project.warnings
            if sentence != made.proof.refusal()
        )
        raise InputError(
            f"{project} has {counted(len(block.images), 'image')} and no image measurement (tie "
            "points or marks), so there is nothing to adjust; name a file that has them, or the "
            f"folder of the photographs{told}"
        )
    if _in_grid(block):
        # A grid is no Cartesian frame: what it bends would be laid on the camera.
        try:
            again = formats.import_project(folder, "block", folder, to_crs=block.crs)
            notes += again.project.notes
        except InputError as error:
            # A geoid that is not installed: heights stay as they are.
            warnings = [*warnings, f"the block is adjusted in its grid as it is: {error}"]
    return {
        "form": made.project.form,
        "notes": notes,
        "warnings": warnings,
        "proof": str(made.proof),
    }


def _about(block: Block) -> str:
    """How long a diagnosis takes, in words."""
    seconds = _START_S + _S_PER_MILLION * 1e-6 * (len(block.tie_points) + len(block.marks))
    long = f"{seconds / 60:.0f} minutes" if seconds > 90 else f"{seconds:.0f} s"
    return f"about {long} on two idle processors, more on busy ones"


def _in_grid(block: Block) -> bool:
    """Whether coordinates are those of a grid; a crs that nobody knows is none, and is told."""
    if local_of(block) is not None or world_crs(block) is None:
        return False
    try:
        return bool(known_crs(block.crs).is_projected)
    except InputError:
        return False


def _adjusted_somehow(block: Block, folder: Path, required, threads: int) -> dict:
    """Adjusted with a free camera; with the project's own where the images cannot determine it."""
    free = _adjusted(block, folder, required, threads)
    told = _undetermined(free)
    if not told or all(camera.calibrated for camera in block.cameras.values()):
        return free | _by_own_poses(block, free)
    held = _adjusted(block, folder, required, threads, held=True)
    if not held["converged"] or not (free["converged"] or held["sigma0"] < _FITS):
        return free | _by_own_poses(block, free)
    remark = f"{told}: it is held at the calibration of the project."
    return held | {"held": True, "warnings": [remark, *held["warnings"]]}


def _undetermined(adjustment: dict) -> str:
    """Why the camera of an adjustment is not to be believed; empty where it is."""
    if not adjustment["converged"]:
        return "With a free camera the block does not adjust"
    for name, camera in adjustment["camera"].items():
        value, sigma = (camera["f"][key] for key in ("value", "sigma"))
        if sigma and sigma > _MOST_OF_F * value:
            return (
                f"These images do not determine the camera ({name}): free, its focal length is "
                f"{value:,.0f} +- {sigma:,.0f} px"
            )
    return ""


def _by_own_poses(block: Block, adjustment: dict) -> dict:
    """Where the rays of the marks meet by the poses of the project, for one that does not adjust.

    Empty where it adjusts, or where no ground point is seen by two images with poses.
    """
    if adjustment["converged"] or not (len(block.marks) and len(block.ground)):
        return {}
    if "qw" not in block.images or block.extra.get("frame") == "arbitrary":
        return {}
    seen = registry.room("interchange").ground_seen(block)
    if not len(seen.names):
        return {}
    off = np.linalg.norm(seen.given - seen.met, axis=1)
    told = (
        f"By the poses that the project has, the rays of the marks meet "
        f"{millimetres(float(np.sqrt(np.mean(off**2))))} from "
        f"{counted(len(off), 'surveyed point')} (3D RMS). That is no independent check of "
        "points that the project itself used as control."
    )
    return {"own": told}


def _model(held: bool, effects: Iterable[str]) -> Model:
    """Free cameras, but for those that are calibrated; none of them where the camera is held."""
    return Model(camera="fixed" if held else None, effects=effects)


def _adjusted(
    block: Block,
    folder: Path,
    required,
    threads: int,
    held: bool = False,
    effects: Iterable[str] = (),
) -> dict:
    model = _model(held, effects)
    try:
        adjustment = least_squares.adjust(block, model=model, threads=threads)
    except (AdjustmentFailed, InputError) as failed:
        return {"converged": False, "warnings": [f"{failed}."]}
    adjustment.required = required
    if not adjustment.converged:
        doubts = [*adjustment.doubts, *adjustment.start_misfit()]
        return {"converged": False, "warnings": doubts}
    adjustment.save(folder, registry.room("figures").of_adjustment)
    report = registry.room("report").of_adjustment(adjustment)
    contradicted = [*least_squares.implausible(adjustment)]
    if adjustment.sigma0 > _FITS:
        contradicted.append(
            f"Sigma naught is {adjustment.sigma0:.3g}: the measurements do not fit each other."
        )
    zero = least_squares.may_be_zero(adjustment).groupby("camera", sort=False)["parameter"]
    return adjustment.to_dict() | {
        "opening": report.opening,
        "actions": list(report.actions),
        "contradicted": contradicted,
        "may_be_zero": {str(camera): list(names) for camera, names in zero},
    }


def _diagnosed(
    block: Block, folder: Path, required, threads: int, held: bool, progress: Callable
) -> dict:
    def say(step):
        if progress and step.result is None and step.done == step.of:
            progress(step)

    try:
        model = {"camera": "fixed"} if held else {}
        diagnosis = registry.room("diagnosis").diagnose(
            block, threads=threads, progress=say, **model
        )
    except (WorkFailed, InputError) as failed:
        return {"verdict": "failed", "sentence": f"No diagnosis was possible: {failed}."}
    diagnosis.required = required
    diagnosis.save(folder, threads=threads, progress=say)
    return diagnosis.to_dict()


def _named(found: dict | None) -> list[str]:
    """Effects that are named, but for what is wrong with one ground point."""
    effects = (found or {}).get("effects") or []
    named = [one["slug"] for one in effects if one.get("class") == "named" and "point" not in one]
    return list(dict.fromkeys(named))


def _capital(sentence: str) -> str:
    """With a capital letter, unless it begins with the name of a file, a column or an option."""
    return sentence[0].upper() + sentence[1:] if sentence.split()[0].isalpha() else sentence


def _told(final: dict, found: dict | None, imported: dict, home: Path):
    """What is wrong, and what to do."""
    wrong = [found["sentence"]] if found and found["verdict"] != "nothing" else []
    warnings = final.get("warnings") or []
    wrong += warnings[: bool(final.get("held"))]  # what has been decided here
    # What is wrong with where the project lies, or with what it holds, makes the rest.
    wrong += [_capital(told) + "." * (told[-1] not in ".?!") for told in imported["warnings"]]
    wrong += warnings
    wrong += [final["own"]] if final.get("own") else []
    asked = (found or {}).get("actions") or []
    actions = list(asked or final.get("actions") or [])
    # Each speaks of what lies beside its own page.
    of = home.with_name("missing") if asked else home
    block = str(home.parent / "block")
    put = {
        "BLOCK": block,
        "OUT/": f"{of}/",
        "`--camera": f"`corridor adjust {block} --camera",
        "`--ground FILE` of `corridor import`": "`--ground FILE` of `corridor check`",
    }
    for old, new in put.items():
        actions = [action.replace(old, new) for action in actions]
    return list(dict.fromkeys(wrong)), actions


def _write(checked: Checked, folder: Path, beside: list[str]) -> list[str]:
    """The page and the JSON file."""
    found = folder / "adjusted_with_found"
    home = found if found.is_dir() else folder / "adjusted"
    tested = (checked.adjustment or {}).get("check_points", {}).get("rows")
    empty = () if tested else ("check_points",)
    empty = ("check_points", "residuals_along") if checked.verdict == "failed" else empty
    shown = [
        (name.replace("_", " "), "", file.read_bytes())
        for name in ("check_points", "residuals_along")
        if name not in empty and (file := home / f"{name}.png").is_file()
    ]
    with whole_file(folder / "report.html") as part:
        part.write_text(report_of(checked).page(shown), encoding="utf-8", newline="\n")
    with whole_file(folder / RESULT) as part:
        write_json(checked.to_dict(), part)
    taken = [] if checked.taken_back is None else checked.taken_back.files
    return [str(folder / "report.html"), str(folder / RESULT), *beside, *taken]
