"""A set of data, fetched from its source, checked, and converted by the readers of the package."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

# Its rooms come at first use: a list of what there is needs none of them.
from corridor.core import registry
from corridor.core.errors import FetchFailed, InputError, did_you_mean
from corridor.tools.data.registered import DataSet, register

if TYPE_CHECKING:
    from corridor.core.output import Progress

# The file by which a fetched folder is known again.
_MARK = "SOURCE.txt"
_HERE = Path(__file__).parents[2]


def fetch(
    name: str,
    output: str | os.PathLike,
    mirror: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> list[str]:
    """Writes a set of data to a folder; returns sentences on what it is and what was checked.

    mirror: an address that has the set's files by their names, in place of its public source;
    for sets of which hashes are known.
    Raises InputError for an unknown name, a folder that holds something else or a mirror of what
    cannot be verified, and FetchFailed where a file cannot be had, is not the one known, or does
    not come to the figures that are known of it; then nothing is left behind.
    """
    from corridor.core.output import check_folder, file_lines, telling, whole_folder

    one = register().get(name)
    if one is None:
        known = ", ".join(register())
        raise InputError(f"no data are called {name!r}{did_you_mean(name, register())}: {known}")
    if mirror and not one.verified:
        raise InputError(
            f"no hash of the files of {name} is known, so a mirror could hand over anything: leave "
            "--mirror out, they come from their own source then"
        )
    check_folder(output, _MARK)
    say = telling(progress)
    with whole_folder(output, _MARK) as part:
        said = [one.about]
        if one.kind == "shipped":
            shutil.copytree(_shipped(name), part, dirs_exist_ok=True)
        else:
            _download(one, mirror, part, say)
            said.append(f"source: {one.source}; licence: {one.licence}")
            said += _CHECKS[one.kind](one, part)
        hashes = "".join(f"sha256: {_sha256(part / file)} {file}\n" for file in one.files)
        (part / _MARK).write_text(
            f"{one.about}\nsource: {one.source}\nlicence: {one.licence}\n{hashes}"
            f"{file_lines(part)}",
            encoding="utf-8",
        )
        return said


def _sha256(path):
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _shipped(name):
    """Folder of a block that this project ships: beside the package, or within it if installed."""
    for root in (_HERE.parent / "data_synthetic", _HERE / "data_synthetic"):
        if (root / name).is_dir():
            return root / name
    raise FetchFailed(f"the files of {name} are not where the package was installed")


def _download(one: DataSet, mirror, folder, say):
    if find_spec("pooch") is None:
        raise InputError("fetching needs pooch: pip install 'corridor[data]'")
    import pooch
    import requests

    pooch.get_logger().setLevel("ERROR")
    address = (mirror or one.address).rstrip("/")
    with tempfile.TemporaryDirectory() as kept:
        for n, (name, (path, digest)) in enumerate(one.files.items(), 1):
            say(f"{one.name}: file {n} of {len(one.files)}, {name}")
            url = f"{address}/{name if mirror else path}"
            try:
                found = pooch.retrieve(url, f"sha256:{digest}" if digest else None, name, kept)
            except requests.exceptions.RequestException as reason:
                raise FetchFailed(
                    f"{name} of {one.name} cannot be fetched from {url} ({_why(reason)}); try "
                    "again later, or name a copy with --mirror"
                ) from None
            except ValueError:
                raise FetchFailed(
                    f"{name} of {one.name} is not the file that is known (SHA-256): a broken "
                    f"download, or another version at {url}"
                ) from None
            shutil.move(found, folder / name)


def _why(reason):
    response = getattr(reason, "response", None)
    return f"status {response.status_code}" if response is not None else type(reason).__name__


def _project(one, folder):
    """Another program's project, imported beside its files."""
    known = one.known
    size = tuple(known["size_px"]) if "size_px" in known else None
    path = folder / next(iter(one.files))
    formats = registry.room("formats")
    made = formats.import_project(path, known["form"], folder / "block", size=size)
    block = made.block
    _as_known(one, images=len(block.images), observations=len(block.tie_points))
    found = made.proof.main.rms
    if abs(found - known["rms_px"]) > 0.005:
        raise FetchFailed(
            f"{one.name} reprojects to {found:.2f} px, known are {known['rms_px']:.2f} px"
        )
    return [f"imported into block/: {len(block.images)} images, {found:.2f} px as known"]


def _gnss(one, folder):
    """A receiver's track and the exposures on it."""
    gnss = registry.room("gnss")
    track = gnss.read_track(folder / one.known["track"])
    exposures = gnss.read_exposures(folder / one.known["exposures_file"])
    _as_known(one, epochs=len(track.table), exposures=len(exposures.table))
    return [
        f"read: {len(track.table):,} epochs and {len(exposures.table)} exposures as known; go on "
        f"with corridor gnss {one.known['track']} --images {one.known['exposures_file']} -o GNSS"
    ]


def _photographs(one, folder):
    """Photographs, whose bytes nobody has vouched for: what they say of themselves is checked."""
    from corridor.core.photographs import read_metadata

    found = [read_metadata(folder / name) for name in one.files]
    models = {photo.model for photo in found}
    _as_known(one, photographs=len(found))
    if models != {one.known["model"]}:
        raise FetchFailed(
            f"the photographs of {one.name} are by {', '.join(map(str, models))}, known is "
            f"{one.known['model']}"
        )
    return [
        f"not verified, for no hash of them is known: {len(found)} photographs of a "
        f"{one.known['model']}, by what they say; what came is hashed in {_MARK}; go on with "
        "corridor import photos FOLDER -o BLOCK"
    ]


def _readout(one, folder):
    """A photograph of something lit by a blinking LED, measured."""
    path = folder / next(iter(one.files))
    hertz, known = one.known["frequency_hz"], one.known["readout_ms"]
    found = registry.room("readout").readout_from_led(path, hertz).readout_ms
    if abs(found - known) > 1e-3 * known:
        raise FetchFailed(f"{one.name} gives {found:.3f} ms, known are {known:.3f} ms")
    return [
        f"measured: {found:.2f} ms, known are {known:.2f} ms; go on with corridor readout led "
        f"{path.name} --frequency {hertz:g} -o OUT"
    ]


_CHECKS = {"project": _project, "gnss": _gnss, "photographs": _photographs, "readout": _readout}


def _as_known(one, **counts):
    for what, count in counts.items():
        if count != one.known[what]:
            raise FetchFailed(
                f"{one.name} holds {count} {what}, known are {one.known[what]}: another version?"
            )
