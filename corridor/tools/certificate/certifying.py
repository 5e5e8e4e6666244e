"""A certificate: what it is of, what it states, and its two files."""

import hashlib
import importlib
import json
import os
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from corridor.core import __version__
from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Adjustment, Model
from corridor.core.block import Block, files_of, read
from corridor.core.brief import brief
from corridor.core.effects import Effect, find
from corridor.core.errors import InputError
from corridor.core.output import Report, Table, plain, whole_files
from corridor.tools.certificate.paper import embedded, pdf
from corridor.tools.certificate.statement import Statement, Subject

MARK = "corridor-certificate:"
NAMES = ("certificate.html", "certificate.pdf")
# What computes and draws: other versions may give other last digits, or other letters.
_LIBRARIES = ("numpy", "scipy", "numba", "pandas", "matplotlib")
_NATURE = (
    "This is a statement of figures that corridor computed from the files named below; nobody "
    "signs it, and it says nothing of what is not in them."
)
_FORMS = Path(__file__).parent / "forms"


def form_names() -> list[str]:
    """The forms that there are: each a file in the folder `forms`."""
    return sorted(file.stem for file in _FORMS.glob("*.py") if file.stem != "__init__")


def _form(name: str) -> ModuleType:
    if name not in form_names():
        raise InputError(f"certificates have no form {name!r}: use {', '.join(form_names())}")
    return importlib.import_module(f"corridor.tools.certificate.forms.{name}")


@brief
@dataclass(frozen=True)
class Certificate:
    """A certificate.

    form: its form. record: what it is of: asked (what the adjustment was told), files (SHA-256 of
    each input file), software, figures (to six digits). report, pictures: what it states.
    """

    form: str
    record: dict[str, Any]
    report: Report
    pictures: list[tuple[str, str, bytes]]

    def __str__(self) -> str:
        return str(self.report)

    @cached_property
    def _record(self) -> str:
        return json.dumps(plain(self.record), sort_keys=True, ensure_ascii=False)

    @property
    def html(self) -> bytes:
        """One page of HTML, to be printed too, that needs no other file."""
        kept = embedded(self._record, MARK)
        page = self.report.page(self.pictures)
        # For programs: nobody sees it.
        return page.replace("</head>", f"<!-- {kept} -->\n</head>", 1).encode("utf-8")

    @property
    def pdf(self) -> bytes:
        """The same on A4 sheets."""
        digest = hashlib.sha256(self._record.encode("utf-8")).hexdigest()[:16]
        footer = f"corridor {__version__}   form {self.form}   statement {digest}"
        return pdf(self.report, self.pictures, footer, embedded(self._record, MARK))

    @property
    def files(self) -> dict[str, bytes]:
        """Its files by their names."""
        return dict(zip(NAMES, (self.html, self.pdf), strict=True))

    def save(self, folder: str | os.PathLike) -> list[Path]:
        """Writes certificate.html and certificate.pdf into a folder; returns their paths."""
        paths = [Path(folder) / name for name in NAMES]
        with whole_files(*paths) as parts:
            for part, content in zip(parts, self.files.values(), strict=True):
                part.write_bytes(content)
        return paths


def certify(
    block: str | os.PathLike,
    form: str = "full",
    *,
    model: Model | None = None,
    required: float | None = None,
    adjustment: Adjustment | None = None,
    **more: Any,
) -> Certificate:
    """The certificate of a block, adjusted as asked.

    block: folder of a block, whose files are hashed. form: `asprs` (ASPRS Positional Accuracy
    Standards, edition 2, 2023), `din18740` (proof of orientation) or `full`. model: what is
    estimated. required: 3D RMS of check points that is good enough, m. adjustment: of this very
    block with this very model, where it is there already. more: other keywords of `adjust`.
    The same files, asked the same, with the same software, give the same bytes.
    Raises InputError for an unknown form, for what is no folder of a block and for a model that
    cannot be written down; AdjustmentFailed where the block does not adjust.
    """
    made = _form(form)
    model = Model() if model is None else model
    asked = plain({"model": _written(model), "required": required, **more})
    if isinstance(block, Block):
        raise InputError(
            "a certificate names the files that it was made from: write the block "
            "(block.write(FOLDER)) and give that folder"
        )
    given = read(block)
    files = hashes(block)
    if adjustment is None:
        adjustment = least_squares.adjust(given, model=model, **more)
    if not adjustment.converged:
        raise least_squares.not_converged(adjustment)
    subject = Subject(given, adjustment, required)
    stated: Statement = made.statement(subject)
    record = {
        "form": form,
        "block": given.name,
        "asked": asked,
        "files": files,
        "software": software(),
        # Six digits of a figure: beyond them processors differ.
        "figures": {
            name: float(f"{value:.6g}") if isinstance(value, float) else value
            for name, value in stated.figures.items()
        },
    }
    untested = tuple((sentence,) for sentence in stated.untested)
    untested = Table("What was not tested", (), untested, "w")
    tables = [*stated.tables, untested, _made_with(asked), _files(files)]
    report = Report(
        title=f"{made.TITLE}: {given.name}",
        opening=f"{stated.opening} {_NATURE}",
        warnings=stated.doubts,
        tables=tables,
    )
    return Certificate(form, record, report, stated.pictures)


def hashes(folder: str | os.PathLike) -> dict[str, str]:
    """SHA-256 of each file of a block's folder, by its name; whether it can be read or not.

    Raises InputError where there is none.
    """
    files = files_of(Path(folder))
    if not files:
        raise InputError(f"{folder} is not the folder of a block: its files are not there")
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def software() -> dict[str, str]:
    """Versions of what computes and draws."""
    found = {"corridor": __version__}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


# --- the model in words ----------------------------------------------------------------------


def _written(model: Model) -> dict[str, Any]:
    """A model as JSON can hold it; `_read_back` makes the same one of it."""
    wishes = {
        name: {"value": wish.value, "vary": wish.vary, "prior": wish.prior}
        for name, wish in model.parameters.items()
    }
    if model.motion is not None:
        raise InputError("a certificate cannot write down a model with `motion`: leave it out")
    return {
        "camera": model.camera,
        "effects": [_word(effect) for effect in model.effects],
        "control": model.control,
        "check": model.check,
        "priors": model.priors,
        "lever_arm": model.lever_arm,
        "loss": model.loss,
        "parameters": wishes,
    }


def _word(effect: Effect) -> str:
    """`slug`, or `slug@group` of an effect that is shared otherwise than its file says."""
    try:
        usual = find(effect.slug)
    except InputError:
        raise InputError(
            f"effect {effect.slug} is not in the catalogue, so nobody could make the certificate "
            "anew: offer it by the entry points `corridor.effects`"
        ) from None
    return effect.slug if effect.group == usual.group else f"{effect.slug}@{effect.group}"


def model_of(written: dict[str, Any]) -> Model:
    """The model that a certificate states."""
    given = dict(written)
    wishes = {
        name: least_squares.Setting(
            wish["value"], wish["vary"], None if wish["prior"] is None else tuple(wish["prior"])
        )
        for name, wish in given.pop("parameters").items()
    }
    given["priors"] = {name: tuple(prior) for name, prior in given["priors"].items()}
    return Model(**given, parameters=wishes)


# --- the tables that every form has ----------------------------------------------------------


def _made_with(asked: dict[str, Any]) -> Table:
    given = asked["model"] | {key: value for key, value in asked.items() if key != "model"}
    if given["loss"] == Model().loss:
        given.pop("loss")
    told = "; ".join(
        f"{key}: {', '.join(map(str, value)) if isinstance(value, list) else value}"
        for key, value in sorted(given.items())
        if value not in (None, [], {}, False)
    )
    libraries = ", ".join(f"{name} {number}" for name, number in software().items())
    rows = (("asked", told or "as the block says"), ("software", libraries))
    return Table("How it was made", (), rows, "lw")


def _files(files: dict[str, str]) -> Table:
    rows = tuple((name, digest) for name, digest in files.items())
    note = "`corridor verify CERTIFICATE BLOCK` makes this certificate anew and compares"
    return Table("Input files", ("file", "SHA-256"), rows, "ll", (note,))
