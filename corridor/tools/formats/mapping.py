"""From photographs alone: features, matches, incremental mapping, by pycolmap.

What is finished is kept in a folder beside the block (`.BLOCK.photos`) until the block is written:
the same command goes on where it was interrupted. Images are matched with their neighbours: by
position where the photographs have one, else all with all, or along the sequence for many.

Source: Schönberger and Frahm 2016, "Structure-from-motion revisited" (COLMAP).
"""

import json
import os
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from filecmp import cmp
from pathlib import Path

import numpy as np
from PIL import Image

from corridor.core.errors import InputError, WorkFailed
from corridor.core.output import silent, whole_folder
from corridor.core.photographs import (
    FAULTS,
    Metadata,
    fault,
    open_picture,
    photographs_in,
    read_metadata,
)
from corridor.tools.formats.focal import of_a_lens, stated_focal
from corridor.tools.formats.heading import east_north
from corridor.tools.formats.joining import damaged, listed, places_apart, why_lost
from corridor.tools.formats.programs import colmap
from corridor.tools.formats.project import Project
from corridor.tools.formats.starting import from_attitudes

# Neighbours by position, all with all up to so many images, along the sequence beyond.
_NEIGHBOURS, _ALL, _SEQUENCE = 16, 60, 12
_BATCH_PAIRS = 20
# A focal length further from the stated one than this is of a model that bends, or of a wrong
# statement: the stated one is held unless the other fits so much better.
# Where it fits better by less, it contradicts: residuals of thousands of points are known to a
# per cent.
_FOCAL_RANGE, _FITS_BETTER, _FITS_LITTLE, _FREED = 0.10, 0.7, 0.97, "freed.json"
# A model of less than this share of the photographs is refused, of less than this kept to go on.
_REFUSED, _KEPT = 0.5, 0.9
_OTHER_LENS = "or the focal length that their EXIF states is that of another lens: take it out"
_MODEL = "RADIAL"
# Features a pixel: in small pictures the smallest ones are noise. COLMAP's most, and enough to map.
_DENSITY, _FEWEST, _MOST = 4e-3, 2000, 8192
_LEAST = 3
# Stands for a blank in the names of a list of pairs, where blanks part the names.
_BLANK = "\ue020"
# Seconds of one processor a megapixel of features, a pair of pictures of the most features, and an
# image that is mapped: measured with 18 pictures of 0.8 megapixels (21, 8.5 and 6 s together).
_PICTURE_S, _PAIR_S, _MAPPED_S = 1.45, 0.36, 0.3
_SOON_S = 60.0


@dataclass(frozen=True)
class Cheaply:
    """How much of the photographs is used.

    size: long side of the pictures, px; larger ones are made smaller first, and the block is of
    the smaller ones. share: every so many-th photograph.
    """

    size: int | None = None
    share: int = 1


def workplace(output: Path) -> Path:
    """Where the finished part of the work is kept until the block is written."""
    output = output.resolve()
    return output.parent / f".{output.name}.photos"


def from_photographs(
    folder: Path,
    output: Path,
    say: Callable[..., None] = silent,
    cheaply: Cheaply | None = None,
    force: bool = False,
    started: bool = False,
) -> Project:
    """A free reconstruction of the photographs of a folder, as a project.

    output: the block to be written; the work is kept beside it. force: also of few photographs.
    started: from the photographs' positions and attitudes, all at once.
    Raises InputError without pycolmap or without enough photographs, WorkFailed where they
    do not make one model of at least half of them.
    """
    pycolmap, cheaply = _pycolmap(), cheaply or Cheaply()
    every = photographs_in(folder)
    files, copies = _each_once(every[:: cheaply.share])
    if len(files) < _LEAST:
        several = f"{len(files)} photograph{'s' * (len(files) != 1)}"
        raise InputError(f"{folder} holds {several}; a block needs {_LEAST} or more")
    photos, smaller = _without_smaller([read_metadata(file) for file in files])
    files = [photo.path for photo in photos]
    names = [file.relative_to(folder).as_posix() for file in files]
    place = workplace(output)
    _same_photos(place, folder, files, names, cheaply)
    pictures = _pictures(folder, place, names, photos, cheaply, say)
    database = place / "database.db"
    model = place / ("started" if started else "model")
    if not (place / "model" / "images.bin").is_file():
        pairs = _pairs(photos)
        pace = _Pace([_size_of(photo, cheaply) for photo in photos], len(pairs))
        apart = places_apart(photos, names)
        say(f"{len(names)} photographs, {len(pairs)} pairs: {pace}")
        if apart:
            say(f"warning: {apart}")
        for done in _features(pycolmap, database, pictures, names, photos, cheaply):
            say(f"features: {done} of {len(names)} photographs{pace.left(done, 0)}")
        for done in _matches(pycolmap, database, place, names, pairs):
            say(f"matches: {done} of {len(pairs)} pairs{pace.left(len(names), done)}")
    if started and not (model / "images.bin").is_file():
        say("starting from positions and attitudes")
        known = dict(zip(names, photos, strict=True))
        with whole_folder(model, "images.bin") as part:
            from_attitudes(pycolmap, database, pictures, known, say).write_binary(part)
    if not (model / "images.bin").is_file():
        stated = all(stated_focal(photo) for photo in photos)
        _map(pycolmap, database, pictures, model, photos, stated, say)
    project = colmap.read(model)
    project = _with_lost_named(project, place, names, photos, force)
    project = _with_focal_compared(project, names, photos, model / _FREED)
    for said in damaged([photo for photo, name in zip(photos, names, strict=True)
                         if name not in project.lost]):  # fmt: skip
        project = project.warned(said)
    for what, pairs in (("copies of others, byte by byte", copies), ("others, smaller", smaller)):
        if pairs:
            one, other = (file.relative_to(folder).as_posix() for file in pairs[0])
            project = project.warned(
                f"{len(pairs)} photographs are {what}, and were left out (first: {one}, of "
                f"{other}): they measure nothing anew"
            )
    if cheaply.share > 1:
        project = project.noted(f"{len(files)} of {len(every)} photographs were used")
    project = project.having(name=folder.resolve().name)
    return replace(project, form="photos", source=folder)


def _each_once(files: list[Path]) -> tuple[list[Path], list[tuple[Path, Path]]]:
    """The files without copies of others, and each copy with what it is a copy of.

    Of copies that with the shortest name stays: the others are `NAME (1)`.
    """
    alike: dict[int, list[Path]] = {}
    copies = []
    for file in sorted(files, key=lambda file: (len(file.name), file)):
        # Nearly no two photographs have one size: few are read.
        others = alike.setdefault(file.stat().st_size, [])
        first = next((other for other in others if cmp(other, file, shallow=False)), None)
        if first is None:
            others.append(file)
        else:
            copies.append((file, first))
    return sorted(set(files) - {file for file, _ in copies}), copies


def _without_smaller(photos: list[Metadata]) -> tuple[list[Metadata], list[tuple[Path, Path]]]:
    """The photographs without previews of others, and the file of each preview with that of its
    photograph: of one name, camera, time, place and shape, in another folder."""
    largest: dict[tuple, Metadata] = {}
    for photo in sorted(photos, key=lambda photo: -photo.width):
        largest.setdefault(_one_exposure(photo), photo)
    of = [largest[_one_exposure(photo)] for photo in photos]
    kept = [photo for photo, one in zip(photos, of, strict=True) if one.width == photo.width]
    pairs = [(p.path, one.path) for p, one in zip(photos, of, strict=True) if one.width > p.width]
    return kept, pairs


def _one_exposure(photo: Metadata) -> tuple:
    stem, shape = photo.path.stem.casefold(), round(100 * photo.width / photo.height_px)
    if photo.taken is None:
        return (photo.path,)
    return stem, shape, photo.make, photo.model, photo.taken, photo.lat_deg, photo.lon_deg


class _Pace:
    """How long features, matches and mapping take: as measured once, then by what is done."""

    def __init__(self, sizes: list[tuple[int, int]], pairs: int):
        self.picture = _PICTURE_S * float(np.mean([w * h for w, h in sizes])) * 1e-6
        self.pair = _PAIR_S * float(np.mean([(_features_in(size) / _MOST) ** 2 for size in sizes]))
        cores = os.cpu_count() or 1
        self.total = (len(sizes) * self.picture + pairs * self.pair) / cores
        self.total += len(sizes) * _MAPPED_S
        self.cores, self.begun = cores, time.perf_counter()

    def __str__(self) -> str:
        return f"about {_minutes(self.total)} on {self.cores} processors, if they are idle"

    def left(self, pictures: int, pairs: int) -> str:
        """What is left of the work, by how quickly so much of it was done; empty if little."""
        done = (pictures * self.picture + pairs * self.pair) / self.cores
        passed = time.perf_counter() - self.begun
        left = passed * (self.total / max(done, 1e-9) - 1)
        return f", about {_minutes(left)} left" if left > _SOON_S else ""


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds > 90 else f"{max(seconds, 10):.0f} s"


def _with_lost_named(project, place, names, photos, force):
    """Says which photographs are not in the model and why. Raises where they are most."""
    there = set(project.block.images["image"])
    joined = {row for row, name in enumerate(names) if name in there}
    lost = [name for name in names if name not in there]
    if not lost:
        return project
    apart = places_apart(photos, names)
    said = (
        f"{len(lost)} of {len(names)} photographs could not be connected to the others "
        f"({listed(lost, names)}): {apart or why_lost(photos, joined)}"
    )
    if len(joined) < _REFUSED * len(names) and all(stated_focal(photo) for photo in photos):
        said += f"; {_OTHER_LENS}"
    if len(joined) < _KEPT * len(names):
        said += f"; features and matches are kept in {place}, the same command goes on from there"
    if len(joined) < _REFUSED * len(names) and not force:
        raise WorkFailed(
            f"only {len(joined)} of {len(names)} photographs make one model, which is not enough "
            "for a block. "
            f"{said[0].upper()}{said[1:]}; --force writes the block of those that are joined"
        )
    return replace(project.warned(said), lost=lost)


def _with_focal_compared(project, names, photos, freed):
    """Says so where a focal length is far from what the photographs state.

    freed: file with the focal lengths that fit better than the stated ones, which were held.
    """
    other = json.loads(freed.read_text(encoding="utf-8")) if freed.is_file() else {}
    cameras = dict(project.block.cameras)
    row = {name: k for k, name in enumerate(names)}
    for name, camera in project.block.cameras.items():
        mine = project.block.images["image"][project.block.images["camera"] == name]
        photo = next((photos[row[image]] for image in mine if image in row), None)
        stated = photo and stated_focal(photo, max(camera.width, camera.height))
        if not stated:
            continue
        measured = other.get(name, camera["f"])
        off = measured / stated.px - 1
        said = (
            f"camera {name}: f {measured:.0f} px{' fits better' if name in other else ''}; stated "
            f"{stated.px:.0f} px ({stated.of}), "
            f"{abs(100 * off):.0f} % {'longer' if off > 0 else 'shorter'}"
        )
        if abs(off) > _FOCAL_RANGE:
            cameras[name] = replace(camera, extra={**camera.extra, "f_measured": measured})
            project = project.warned(
                f"{said}: heights and focal length may have exchanged, pictures may be turned "
                "or cropped, or the statement is wrong; check it before you trust heights"
            )
    return project.having(cameras=cameras)


def is_whole(project: Project, output: Path) -> bool:
    """Whether nearly all photographs are in the model: the kept work is of no more use."""
    stamp = _read_stamp(workplace(output))
    return len(project.block.images) >= _KEPT * len(stamp["photographs"]) if stamp else True


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


def _read_stamp(place: Path) -> dict | None:
    try:
        return json.loads((place / "photographs.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _same_photos(
    place: Path, folder: Path, files: list[Path], names: list[str], cheaply: Cheaply
) -> None:
    """Start anew where the kept work is of other photographs, or of another size."""
    wanted = {
        "folder": str(folder.resolve()),
        "size": cheaply.size,
        "photographs": {
            name: [file.stat().st_size, file.stat().st_mtime_ns]
            for name, file in zip(names, files, strict=True)
        },
    }
    if _read_stamp(place) != wanted:
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        (place / "photographs.json").write_text(json.dumps(wanted), encoding="utf-8")


def _pictures(folder, place, names, photos, cheaply, say) -> Path:
    """The folder of the pictures: the photographs, or all of them made smaller."""
    size = cheaply.size
    if size is None or all(max(p.width, p.height_px) <= size for p in photos):
        return folder
    smaller = place / "pictures"
    for done, (name, photo) in enumerate(zip(names, photos, strict=True), 1):
        to = smaller / name
        if to.is_file():
            continue
        to.parent.mkdir(parents=True, exist_ok=True)
        try:
            with open_picture(photo.path) as picture:
                # A JPEG is decoded at a half or a quarter where that is enough, which is quick.
                picture.draft("L", (2 * size, 2 * size))
                grey, form = picture.convert("L"), picture.format
        except FAULTS as error:
            raise InputError(
                f"{name} cannot be read whole ({fault(error)}); copy it again, or take it out of "
                "the folder"
            ) from None
        grey.thumbnail((size, size), Image.Resampling.LANCZOS, reducing_gap=3.0)
        part = to.with_name(f".{to.name}")
        grey.save(part, format=form, quality=95)
        part.replace(to)
        say(f"pictures made smaller: {done} of {len(names)}")
    return smaller


def _features(pycolmap, database, folder, names, photos, cheaply) -> Iterator[int]:
    """Extract in batches, one camera for pictures alike; yields how many are done.

    Those that are done are skipped.
    """
    alike: dict[tuple, list[int]] = {}
    for row, photo in enumerate(photos):
        key = (photo.model, photo.width, photo.height_px, photo.focal_mm)
        alike.setdefault(key, []).append(row)
    done, step = 0, max(os.cpu_count() or 1, 1)
    for rows in alike.values():
        options = pycolmap.ImageReaderOptions()
        options.camera_model = _MODEL
        first = photos[rows[0]]
        size = _size_of(first, cheaply)
        stated = stated_focal(first, max(size))
        if stated:
            options.camera_params = f"{stated.px}, {size[0] / 2}, {size[1] / 2}, 0, 0"
        for start in range(0, len(rows), step):
            batch = [names[row] for row in rows[start : start + step]]
            options.existing_camera_id = _camera_id(pycolmap, database, names[rows[0]])
            # Extraction numbers images as they are done: in their order, imports are alike.
            pycolmap.import_images(
                database, folder, camera_mode=pycolmap.CameraMode.SINGLE, image_names=batch,
                options=options,
            )  # fmt: skip
            if not stated:
                _let_go_of_exif(pycolmap, database, batch[0])
            extraction = pycolmap.FeatureExtractionOptions()
            extraction.sift.max_num_features = _features_in(size)
            # A second orientation is the same point again, and matching costs the square.
            extraction.sift.max_num_orientations = 1
            pycolmap.extract_features(
                database, folder, image_names=batch, camera_mode=pycolmap.CameraMode.SINGLE,
                reader_options=options, extraction_options=extraction,
                device=pycolmap.Device.cpu,
            )  # fmt: skip
            done += len(batch)
            yield done


def _let_go_of_exif(pycolmap, database, name):
    """COLMAP reads EXIF itself: what no lens has is as if nothing were stated."""
    with pycolmap.Database.open(database) as base:
        camera = base.read_camera(base.read_image_with_name(name).camera_id)
        long = max(camera.width, camera.height)
        if not of_a_lens(camera.focal_length / long):
            usual = pycolmap.ImageReaderOptions().default_focal_length_factor
            camera.focal_length, camera.has_prior_focal_length = usual * long, False
            base.update_camera(camera)


def _features_in(size: tuple[int, int]) -> int:
    """How many features a picture of a size is to have: matching costs the square of them."""
    return int(np.clip(_DENSITY * size[0] * size[1], _FEWEST, _MOST))


def _size_of(photo, cheaply):
    """Width and height of the picture that features are taken from."""
    size = photo.width, photo.height_px
    if cheaply.size is None or max(size) <= cheaply.size:
        return size
    return tuple(round(side * cheaply.size / max(size)) for side in size)


def _camera_id(pycolmap, database, name):
    """The camera that an earlier batch or run made of this image, -1 without one."""
    with pycolmap.Database.open(database) as base:
        if not base.exists_image(name):
            return -1
        return base.read_image_with_name(name).camera_id


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
        plan = east_north([photos[k] for k in placed])
        for k, spot in zip(placed, plan, strict=True):
            near = np.argsort(np.hypot(*(plan - spot).T), kind="stable")[1 : _NEIGHBOURS + 1]
            found |= {(min(k, placed[n]), max(k, placed[n])) for n in near.tolist()}
    return sorted(found)


@contextmanager
def _without_blanks(database: Path) -> Iterator[None]:
    """The names of a database without blanks, for as long as a list of pairs is read."""

    def rename(old: str, new: str) -> None:
        with closing(sqlite3.connect(database)) as base, base:
            base.execute("UPDATE images SET name = replace(name, ?, ?)", (old, new))

    rename(" ", _BLANK)
    try:
        yield
    finally:
        rename(_BLANK, " ")


def _matches(pycolmap, database, place, names, pairs) -> Iterator[int]:
    listed = place / "pairs.txt"
    names = [name.replace(" ", _BLANK) for name in names]
    verified = pycolmap.TwoViewGeometryOptions()
    verified.ransac.random_seed = 0  # one import is like another
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = _threads(len(names))
    for first in range(0, len(pairs), _BATCH_PAIRS):
        batch = pairs[first : first + _BATCH_PAIRS]
        text = "".join(f"{names[i]} {names[j]}\n" for i, j in batch)
        listed.write_text(text, encoding="utf-8")
        options = pycolmap.ImportedPairingOptions()
        options.match_list_path = str(listed)
        with _without_blanks(database):
            pycolmap.match_image_pairs(
                database,
                matching_options=matching,
                pairing_options=options,
                verification_options=verified,
                device=pycolmap.Device.cpu,
            )
        yield first + len(batch)


def _threads(count: int) -> int:
    """Threads of COLMAP, -1 for all: several race for matches and for the first pair.

    One gains little by more where models are small.
    """
    return 1 if count <= _ALL else -1


def _map(pycolmap, database, folder, model, photos, stated, say) -> None:
    """The model of most photographs, written to `model`.

    stated: all photographs state a focal length: it is held while the model grows, and let go at
    the end, where it may move within a tenth.
    """
    best = _grown(pycolmap, database, folder, len(photos), say, held=stated)
    if stated and (best is None or best.num_reg_images() < _KEPT * len(photos)):
        say("mapping again: the stated focal length let go")
        other = _grown(pycolmap, database, folder, len(photos), say, held=False)
        least = best.num_reg_images() if best is not None else 0
        if other is not None and other.num_reg_images() > 1.2 * least:
            best, stated = other, False
    if best is None:
        other = f"{_OTHER_LENS}; " if stated else ""
        raise WorkFailed(
            f"the photographs do not make a model: {why_lost(photos, set())}; {other}features and "
            f"matches are kept in {model.parent}, the same command goes on from there"
        )
    freed = {}
    if stated:
        best, freed = _focal_let_go(pycolmap, best)
    with whole_folder(model, "images.bin") as part:
        best.write_binary(part)
        (part / _FREED).write_text(json.dumps(freed), encoding="utf-8")


def _grown(pycolmap, database, folder, count, say, held):
    """The largest model; None without one. held: the focal length stays as it is stated."""
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = _LEAST
    options.random_seed = 0
    options.num_threads = _threads(count)
    options.ba_refine_focal_length = not held
    options.mapper.abs_pose_refine_focal_length = not held
    done = 2

    def registered():
        nonlocal done
        done += 1
        say(f"mapping: {min(done, count)} of {count} photographs")

    say(f"mapping {count} photographs")
    with tempfile.TemporaryDirectory(prefix="corridor-") as work:
        found = pycolmap.incremental_mapping(
            database, folder, work, options=options, next_image_callback=registered
        )
    return max(found.values(), key=lambda model: model.num_reg_images()) if found else None


def _focal_let_go(pycolmap, held):
    """The model with its focal length adjusted, where that stays near the stated one; and by
    camera the focal length, px, that contradicts the stated one that was held nevertheless.

    Beyond, the stated one stays held: over flat ground f and height exchange, and a bent model
    takes an absurd f; unless the other fits decisively better.
    """
    free = pycolmap.Reconstruction(held)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    images = pycolmap.BundleAdjustmentConfig()
    for image in free.reg_image_ids():
        images.add_image(image)
    images.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, images, free).solve()
    before, after = (
        {str(name): one.mean_focal_length() for name, one in model.cameras.items()}
        for model in (held, free)
    )
    far = {name: f for name, f in after.items() if abs(f / before[name] - 1) > _FOCAL_RANGE}
    for one in (held, free):
        one.update_point_3d_errors()
    fits = free.compute_mean_reprojection_error() / held.compute_mean_reprojection_error()
    if not far or fits < _FITS_BETTER:
        return free, {}
    return held, far if fits < _FITS_LITTLE else {}
