"""From photographs alone: features, matches, incremental mapping, by pycolmap.

What is finished is kept in a folder beside the block (`.BLOCK.photos`) until the block is written:
the same command goes on where it was interrupted. Images are matched with their neighbours: by
position where the photographs have one, else all with all, or along the sequence for many.

Source: Schönberger and Frahm 2016, "Structure-from-motion revisited" (COLMAP).
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from corridor.errors import AdjustmentFailed, InputError
from corridor.gnss import Local
from corridor.interchange.formats import colmap
from corridor.interchange.project import Project
from corridor.photographs import Metadata, photographs_in, read_metadata
from corridor.report import whole_folder

# Neighbours by position, all with all up to so many images, along the sequence beyond.
_NEIGHBOURS, _ALL, _SEQUENCE = 20, 60, 12
_BATCH_IMAGES, _BATCH_PAIRS = 10, 200
_MODEL = "RADIAL"
_LEAST = 3


def workplace(output: Path) -> Path:
    """Where the finished part of the work is kept until the block is written."""
    output = output.resolve()
    return output.parent / f".{output.name}.photos"


def from_photographs(
    folder: Path, output: Path, progress: Callable[[str], None] = lambda what: None
) -> Project:
    """A free reconstruction of the photographs of a folder, as a project.

    output: the block to be written; the work is kept beside it.
    Raises InputError without pycolmap or without enough photographs, AdjustmentFailed where they
    do not make one model.
    """
    pycolmap = _pycolmap()
    files = photographs_in(folder)
    if len(files) < _LEAST:
        raise InputError(f"{folder} holds {len(files)} photographs; a block needs {_LEAST} or more")
    photos = [read_metadata(file) for file in files]
    names = [file.relative_to(folder).as_posix() for file in files]
    place = workplace(output)
    _same_photos(place, folder, files, names)
    database = place / "database.db"
    for done in _features(pycolmap, database, folder, names, photos):
        progress(f"features: {done} of {len(names)} photographs")
    pairs = _pairs(photos)
    for done in _matches(pycolmap, database, place, names, pairs):
        progress(f"matches: {done} of {len(pairs)} pairs")
    model = place / "model"
    if not (model / "images.bin").is_file():
        _map(pycolmap, database, folder, model, len(names), progress)
    project = colmap.read(model)
    left = len(names) - len(project.block.images)
    lost = f"{left} of {len(names)} photographs could not be connected to the others"
    project = project.having(warnings=[lost] if left else [], name=folder.resolve().name)
    return replace(project, form="photos", source=folder)


def forget(output: Path) -> None:
    """Remove the kept work, once the block is written."""
    shutil.rmtree(workplace(output), ignore_errors=True)


def _pycolmap():
    try:
        import pycolmap
    except ImportError:
        raise InputError(
            "a block from photographs alone needs pycolmap; install it with pip install "
            "'corridor[images]'"
        ) from None
    pycolmap.logging.minloglevel = 3
    return pycolmap


def _same_photos(place: Path, folder: Path, files: list[Path], names: list[str]) -> None:
    """Start anew where the kept work is of other photographs."""
    stamp = place / "photographs.json"
    wanted = {
        "folder": str(folder.resolve()),
        "photographs": {
            name: [file.stat().st_size, file.stat().st_mtime_ns]
            for name, file in zip(names, files, strict=True)
        },
    }
    try:
        known = json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        known = None
    if known != wanted:
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        stamp.write_text(json.dumps(wanted), encoding="utf-8")


def _features(pycolmap, database, folder, names, photos) -> Iterator[int]:
    """Extract in batches; yields how many are done. Those that are done are skipped."""
    alike = {(photo.model, photo.width, photo.height_px) for photo in photos}
    mode = pycolmap.CameraMode.SINGLE if len(alike) == 1 else pycolmap.CameraMode.AUTO
    options = pycolmap.ImageReaderOptions()
    options.camera_model = _MODEL
    for first in range(0, len(names), _BATCH_IMAGES):
        batch = names[first : first + _BATCH_IMAGES]
        options.existing_camera_id = _camera_id(pycolmap, database) if len(alike) == 1 else -1
        pycolmap.extract_features(
            database, folder, image_names=batch, camera_mode=mode, reader_options=options,
            device=pycolmap.Device.cpu,
        )  # fmt: skip
        yield first + len(batch)


def _camera_id(pycolmap, database):
    """The one camera of earlier batches: each batch would make its own."""
    if not database.is_file():
        return -1
    with pycolmap.Database.open(database) as base:
        cameras = base.read_all_cameras()
    return cameras[0].camera_id if cameras else -1


def _pairs(photos: list[Metadata]) -> list[tuple[int, int]]:
    """Rows of images worth matching."""
    count = len(photos)
    placed = [k for k, photo in enumerate(photos) if photo.lat_deg is not None]
    if len(placed) < count and count <= _ALL or count <= _NEIGHBOURS:
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    found = set()
    if len(placed) < count:
        found |= {(i, j) for i in range(count) for j in range(i + 1, min(i + _SEQUENCE, count))}
    if placed:
        spots = np.array([[photos[k].lon_deg, photos[k].lat_deg, 0.0] for k in placed])
        lon, lat, _ = np.median(spots, axis=0)
        plan = Local(float(lat), float(lon), 0.0).from_geographic(spots)[:, :2]
        for k, spot in zip(placed, plan, strict=True):
            near = np.argsort(np.hypot(*(plan - spot).T), kind="stable")[1 : _NEIGHBOURS + 1]
            found |= {(min(k, placed[n]), max(k, placed[n])) for n in near.tolist()}
    return sorted(found)


def _matches(pycolmap, database, place, names, pairs) -> Iterator[int]:
    listed = place / "pairs.txt"
    for first in range(0, len(pairs), _BATCH_PAIRS):
        batch = pairs[first : first + _BATCH_PAIRS]
        text = "".join(f"{names[i]} {names[j]}\n" for i, j in batch)
        listed.write_text(text, encoding="utf-8")
        options = pycolmap.ImportedPairingOptions()
        options.match_list_path = str(listed)
        pycolmap.match_image_pairs(database, pairing_options=options, device=pycolmap.Device.cpu)
        yield first + len(batch)


def _map(pycolmap, database, folder, model, count, progress) -> None:
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = _LEAST
    options.random_seed = 0
    done = 2

    def registered():
        nonlocal done
        done += 1
        if done % 10 == 0 or done == count:
            progress(f"mapping: {done} of {count} photographs")

    progress(f"mapping {count} photographs")
    with tempfile.TemporaryDirectory(prefix="corridor-") as work:
        found = pycolmap.incremental_mapping(
            database, folder, work, options=options, next_image_callback=registered
        )
    if not found:
        raise AdjustmentFailed(
            f"the photographs of {folder} do not make a model: too little overlap or texture"
        )
    best = max(found.values(), key=lambda reconstruction: reconstruction.num_reg_images())
    with whole_folder(model, "images.bin") as part:
        best.write_binary(part)
