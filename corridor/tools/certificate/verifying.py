"""A certificate made anew from the files of its block, and compared."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corridor.core.brief import brief
from corridor.core.errors import InputError, WorkFailed
from corridor.core.output import counted, plain
from corridor.tools.certificate.certifying import MARK, NAMES, certify, hashes, model_of, software
from corridor.tools.certificate.paper import taken_from


@brief
@dataclass(frozen=True)
class Verified:
    """What came of it. same: whether the certificate is the one that its files give; sentences:
    what is the same, or what is not."""

    same: bool
    sentences: list[str]

    def __str__(self) -> str:
        return "\n".join(self.sentences)


def verify(certificate: str | os.PathLike, block: str | os.PathLike) -> Verified:
    """Whether a certificate is the one that the files of a block give, made anew.

    certificate: certificate.html or certificate.pdf, or the folder of both. block: folder of the
    block. Files are compared by their SHA-256 first; then the block is adjusted as the certificate
    says, and every byte is compared.
    Raises InputError for what is no certificate, AdjustmentFailed where the block does not adjust.
    """
    path = Path(certificate)
    if (path / "block.toml").is_file():
        raise InputError(f"{path} is a block: give the certificate first, then the block")
    if path.is_dir():
        path = path / NAMES[0]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
    record = _record(path, content)
    changed = _files(record["files"], hashes(block))
    if changed:
        return Verified(False, [f"Not verified: {path.name} is not of these files.", *changed])
    asked = dict(record["asked"])
    try:
        model = model_of(asked.pop("model"))
        made = certify(block, record["form"], model=model, **asked)
    except (AttributeError, TypeError, KeyError, ValueError) as error:
        if isinstance(error, InputError | WorkFailed):
            raise
        raise _damaged(path) from None
    anew = made.pdf if content.startswith(b"%PDF") else made.html
    if anew == content:
        name, files = made.record["block"], counted(len(record["files"]), "input file")
        found = f"{path.name} is, byte by byte, what corridor makes of {name} ({files}, unchanged)"
        return Verified(True, [f"Verified: {found}."])
    return Verified(False, _differences(path, record, plain(made.record)))


def _record(path: Path, content: bytes) -> dict[str, Any]:
    text = taken_from(content, MARK)
    if text is None:
        raise InputError(
            f"{path} is not a certificate made by corridor: give certificate.html or .pdf"
        )
    try:
        record = json.loads(text)
        tables = [record["files"], record["asked"], record["figures"], record["software"]]
        whole = all(isinstance(table, dict) for table in [*tables, record["asked"]["model"]])
    except (ValueError, KeyError, TypeError):
        whole = False
    if not (whole and isinstance(record.get("form"), str)):
        raise _damaged(path)
    return record


def _damaged(path: Path) -> InputError:
    return InputError(
        f"{path}: the record inside the certificate is damaged; make the certificate again"
    )


def _files(stated: dict[str, str], found: dict[str, str]) -> list[str]:
    out = [f"{name} has changed." for name in stated if found.get(name, stated[name])
           != stated[name]]  # fmt: skip
    out += [f"{name} is missing." for name in stated if name not in found]
    return out + [f"{name} is not in the certificate." for name in found if name not in stated]


def _differences(path: Path, stated: dict, made: dict) -> list[str]:
    """What differs although the files are the same."""
    out = [f"Not verified: {path.name} is not what corridor makes of these files."]
    for name, number in stated["software"].items():
        mine = software().get(name)
        if mine != number:
            out.append(f"It was made with {name} {number}; here is {mine}.")
    differ = 0
    for name, value in made["figures"].items():
        if stated["figures"].get(name) != value:
            differ += 1
            out.append(f"{name} is {stated['figures'].get(name)} in it, and {value} made anew.")
    if not differ:
        out.append(
            "Its figures are the same to six digits"
            + ("." if len(out) > 1 else ": its text was changed after it was made.")
        )
    return out
