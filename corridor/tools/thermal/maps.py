"""Deformation maps of a series: measured picture by picture, kept meanwhile, saved whole."""

import hashlib
import json
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.stats import siegelslopes

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.core.output import Progress, telling, whole_file
from corridor.tools.thermal.matching import Matcher, fault
from corridor.tools.thermal.series import Series, another_size, read_series

LEAST_SPAN_C = 1.0  # of temperatures, for a thermal model
_HOTTEST_C = 85.0  # of the industrial range of electronics
_UNEVEN = 1.8  # of the steps of a grid, x to y: `matching.grid` stays below 1.3 up to 12 : 1
# A picture that grows otherwise than its temperature says: shares of what all grow, and times what
# the others miss by (Iglewicz and Hoaglin 1993). Optics that lag are off by a fifth in each picture
# of one side, which is no slip: more than a third of the pictures are not named.
_UNLIKE, _UNLIKE_SPREADS, _LEAST_ALIKE = 0.25, 3.5, 5
# 500 pictures with 10,000 nodes each, 25 bytes a node, have 125 MB.
_MOST_BYTES = 500_000_000
_MARK = "series.json"
_METHOD = 1  # raise it when numbers change: an interrupted run must not mix two methods
_ARRAYS = {
    "picture": "P", "time_s": "P", "temperature_c": "P", "reference": "P", "width": "",
    "height": "", "x": "N", "y": "N", "dx": "PN", "dy": "PN", "sigma": "PN", "valid": "PN",
}  # fmt: skip
_KINDS = {"picture": str, "reference": bool, "valid": bool}  # the others: float


@brief
@dataclass(frozen=True, eq=False)
class Maps:
    """Where nodes of the reference lie in each picture.

    picture: (P,) names. time_s: (P,) s. temperature_c: (P,) C, NaN unknown. reference: (P,) bool.
    width, height: px. x, y: (N,) px in the reference. dx, dy: (P, N) px: what lies at (x, y) in
    the reference lies at (x + dx, y + dy) in the picture; NaN where not valid. sigma: (P, N) px,
    of dx and of dy. valid: (P, N) bool. warnings: one sentence each.
    """

    picture: np.ndarray
    time_s: np.ndarray
    temperature_c: np.ndarray
    reference: np.ndarray
    width: int
    height: int
    x: np.ndarray
    y: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    sigma: np.ndarray
    valid: np.ndarray
    warnings: tuple[str, ...] = ()

    def select(self, rows) -> "Maps":
        """The maps of some pictures: row numbers or a mask (P,)."""
        values = {
            name: getattr(self, name)[rows] if shape[:1] == "P" else getattr(self, name)
            for name, shape in _ARRAYS.items()
        }
        return Maps(**values, warnings=self.warnings)

    def write(self, path: str | os.PathLike) -> None:
        """Write MAPS.npz, whole or not at all."""
        values = {name: np.asarray(getattr(self, name)) for name in _ARRAYS}
        values["picture"] = values["picture"].astype(str)
        with whole_file(path) as part, part.open("wb") as stream:
            np.savez_compressed(stream, **values, warnings=np.array(self.warnings, dtype=str))


def read_maps(path: str | os.PathLike) -> Maps:
    """The maps of a MAPS.npz. Raises InputError where it is missing or not such a file."""
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            if sum(one.file_size for one in file.zip.infolist()) > _MOST_BYTES:
                raise InputError(
                    f"{path} unpacks to more than {_MOST_BYTES / 1e6:.0f} MB, which no maps have: "
                    "make it with `corridor thermal map`"
                )
            values = {name: file[name] for name in _ARRAYS if name in file}
            notes = tuple(str(text) for text in file["warnings"]) if "warnings" in file else ()
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error, EOFError,
            TypeError, AttributeError, MemoryError) as error:  # fmt: skip
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or "it is not a .npz file of plain arrays"
        raise InputError(
            f"{path} cannot be read as maps ({reason}): give a file that `corridor thermal map` "
            "wrote"
        ) from error
    _refuse(path, _faults_of_form(values))
    values = {name: values[name].astype(_KINDS.get(name, float)) for name in _ARRAYS}
    _refuse(path, chain(_faults_of_nodes(values), _faults_of_shifts(values)))
    sizes = {name: int(values[name]) for name in ("width", "height")}
    return Maps(**values | sizes, warnings=notes)


def _refuse(path: Path, faults: Iterator[str]) -> None:
    """Raises InputError with the first of the faults."""
    for first in faults:
        raise InputError(f"{path}{first}: make it with `corridor thermal map`")


def _faults_of_form(values) -> Iterator[str]:
    """Arrays that are missing, of another shape, or hold no numbers."""
    yield from (f" has no array {name}" for name in _ARRAYS if name not in values)
    size = {"P": values["picture"].shape[:1], "N": values["x"].shape[:1]}
    for name, letters in _ARRAYS.items():
        wanted = sum((size[letter] for letter in letters), ())
        if values[name].shape != wanted:
            yield f": array {name} has the shape {values[name].shape}, not {wanted}"
        if name != "picture" and values[name].dtype.kind not in "biuf":
            yield f": array {name} holds no numbers"
    if not all(0 < values[name] < np.inf for name in ("width", "height")):
        yield f": width and height are {values['width']:g} x {values['height']:g} px"


def _faults_of_nodes(values) -> Iterator[str]:
    """Nodes lie in the picture, on a grid of about one step in x and in y, as `grid` makes it."""
    steps = []
    for axis, size in (("x", values["width"]), ("y", values["height"])):
        lost = ~((values[axis] >= 0) & (values[axis] < size))
        if lost.any():
            yield (
                f": array {axis} has no place inside the picture for node "
                f"{int(np.argmax(lost)) + 1} of {len(lost)}"
            )
        places = np.unique(values[axis])
        steps.append(np.ptp(places) / max(len(places) - 1, 1))
    if max(steps) > _UNEVEN * min(steps):
        yield (
            f": nodes are {steps[0]:.3g} px apart in x and {steps[1]:.3g} px in y, which is no "
            "grid of `corridor thermal map`"
        )


def _faults_of_shifts(values) -> Iterator[str]:
    """Every picture has a time, and what is valid was measured."""
    lost = ~np.isfinite(values["time_s"])
    if lost.any():
        yield f": array time_s has no number for picture {values['picture'][lost][0]}"
    measured = values["valid"] & ~values["reference"][:, None]
    for name in ("dx", "dy", "sigma"):
        lost = values["valid"] & ~np.isfinite(values[name])
        if lost.any():
            row, node = np.argwhere(lost)[0]
            yield (
                f": array {name} has no number for picture {values['picture'][row]}, node "
                f"{node + 1}, which is valid"
            )
        if name != "sigma" and measured.any() and not values[name][measured].any():
            yield f": array {name} is zero everywhere, which no measurement is"


def measure_maps(
    series: str | os.PathLike | Series,
    keep: str | os.PathLike | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Maps:
    """Deformation maps of a series: the folder it lies in, or anything with what `Series` has.

    keep: folder for finished pictures, so that the same call goes on where an earlier one was
        stopped, to the same numbers; remove it with `forget` once the maps are safe.
    progress: called with a `Progress` for each picture, which its result names.
    Raises InputError where the series cannot be measured: no reference, a picture of another size,
    unreadable or cut off, no usable picture.
    """
    if isinstance(series, (str, os.PathLike)):
        series = read_series(series)
        series.check_sizes()
    kept = _Kept(keep, series.fingerprint()) if keep is not None else None
    try:
        return _measured(series, kept, telling(progress))
    except InputError:
        # Nothing to go on from: the series has to be changed.
        if kept:
            forget(kept.folder)
        raise


def forget(keep: str | os.PathLike) -> None:
    """Remove the finished pictures that `measure_maps` kept."""
    if (Path(keep) / _MARK).is_file():
        shutil.rmtree(keep, ignore_errors=True)


def _measured(series: Series, kept: "_Kept | None", say) -> Maps:
    matcher, notes = _reference(series)
    height, width = matcher.reference.shape
    count, nodes = len(series.picture), len(matcher.nodes)
    dx, dy, sigma = (np.full((count, nodes), np.nan) for _ in range(3))
    valid, seen = np.zeros((count, nodes), bool), {}
    for row, name in enumerate(series.picture):
        found = kept.get(row) if kept else None
        if found is None:
            grey = series.read(row)
            if grey.shape != (height, width):
                raise another_size(name, grey.shape, (height, width))
            first = seen.setdefault(hashlib.sha256(grey.tobytes()).digest(), name)
            if first != name:
                notes.append(f"pictures {first} and {name} are the same, dot by dot")
            match = matcher.find(grey)
            found = {
                "shift": match.shift, "sigma": match.sigma, "valid": match.valid,
                "trouble": np.array(match.trouble),
            }  # fmt: skip
            if kept:
                kept.put(row, found)
        dx[row], dy[row] = found["shift"].T
        sigma[row], valid[row] = found["sigma"], found["valid"]
        if str(found["trouble"]):
            notes.append(f"picture {name} has no valid node: {found['trouble']}")
        say("matching", row + 1, count, name)
    notes += _of_temperatures(series)
    notes += _unlike_their_temperature(series, matcher.nodes, np.stack([dx, dy], axis=-1), valid)
    if not valid[~series.reference].any() and not series.reference.all():
        raise InputError(f"no picture of the series can be matched to the reference: {notes[-1]}")
    return Maps(
        picture=np.array(series.picture), time_s=series.time_s,
        temperature_c=series.temperature_c, reference=series.reference, width=width,
        height=height, x=matcher.nodes[:, 0].astype(float), y=matcher.nodes[:, 1].astype(float),
        dx=dx, dy=dy, sigma=sigma, valid=valid, warnings=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _of_temperatures(series) -> list[str]:
    """What a thermal model will lack."""
    known = np.isfinite(series.temperature_c)
    if not known.any():
        return ["series.csv: no picture has a temperature_c, which a thermal model needs"]
    notes = []
    if not known.all():
        first = series.picture[int(np.argmin(known))]
        notes.append(
            f"series.csv: {(~known).sum()} of {len(known)} pictures have no temperature_c, the "
            f"first of them {first}: a thermal model does without them"
        )
    hottest = float(series.temperature_c[known].max())
    if hottest > _HOTTEST_C:
        notes.append(
            f"series.csv: the temperatures reach {hottest:.1f} C, and electronics endure "
            f"{_HOTTEST_C:g} C: are they degrees Fahrenheit?"
        )
    span = np.ptp(series.temperature_c[known])
    if span < LEAST_SPAN_C:
        notes.append(
            f"series.csv: the temperatures span {span:.1f} C, and a thermal model needs "
            f"{LEAST_SPAN_C:g} C at least: is temperature_c filled in for each picture?"
        )
    of_reference = series.temperature_c[known & series.reference]
    if len(of_reference) and np.ptp(of_reference) >= LEAST_SPAN_C:
        notes.append(
            f"series.csv: pictures of the reference were taken at {of_reference.min():.1f} to "
            f"{of_reference.max():.1f} C, so their mean belongs to no temperature: mark pictures "
            "of one temperature with 1"
        )
    return notes


def _unlike_their_temperature(series, nodes, shift, valid) -> list[str]:
    """Names pictures whose size does not follow their temperature as that of the others does: a
    slip of the thermometer's table, or pictures that stand in for each other.

    shift (P, N, 2), valid (P, N).
    """
    use = valid.any(axis=1) & np.isfinite(series.temperature_c)
    if use.sum() < _LEAST_ALIKE:
        return []
    arm = nodes - nodes.mean(axis=0)
    part = valid[use][..., None] * np.nan_to_num(shift[use])
    grown = np.sum(part * arm, axis=(1, 2)) / np.sum(valid[use][..., None] * arm**2, axis=(1, 2))
    warm = series.temperature_c[use]
    # Half of the points may be off (Siegel 1982).
    slope, start = siegelslopes(grown, warm) if np.ptp(warm) > 0 else (0.0, np.median(grown))
    off = grown - (start + slope * warm)
    most = max(_UNLIKE * abs(slope) * np.ptp(warm), _UNLIKE_SPREADS * robust_scale(off))
    slips = np.abs(off) > most
    if 3 * slips.sum() > len(slips):
        return []
    return [
        f"picture {series.picture[row]} grew by {1e6 * grown[k]:.0f} ppm, and {warm[k]:.1f} C says "
        f"{1e6 * (grown[k] - off[k]):.0f} by the other pictures: are picture and temperature_c of "
        "series.csv those of one moment?"
        for k, row in zip(np.flatnonzero(slips), np.flatnonzero(use)[slips], strict=True)
    ]


def _reference(series) -> tuple[Matcher, list[str]]:
    """The mean of the reference's pictures, those that are spoilt left out."""
    notes, total, used = [], None, 0
    for row in np.flatnonzero(series.reference):
        grey = series.read(row)
        if total is None:
            total = np.zeros(grey.shape)
        if grey.shape != total.shape:
            raise another_size(series.picture[row], grey.shape, total.shape)
        trouble = fault(grey)
        if trouble:
            notes.append(f"picture {series.picture[row]} is left out of the reference: {trouble}")
            continue
        total += grey
        used += 1
    if not used:
        raise InputError(f"no usable picture, the reference cannot be matched: {notes[0]}")
    return Matcher((total / used).astype(np.float32)), notes


class _Kept:
    """Finished pictures in a folder, one file each; of another series they do not count."""

    def __init__(self, folder, fingerprint):
        self.folder = Path(folder)
        mark = self.folder / _MARK
        text = json.dumps({"method": _METHOD, "series": fingerprint})
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{self.folder} is in the way: move it, or write to another file")
        if self.folder.is_dir() and (not mark.is_file() or mark.read_text("utf-8") != text):
            if any(self.folder.iterdir()) and not mark.is_file():
                raise InputError(f"{self.folder} is in the way: move it, or write to another file")
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(text, "utf-8")

    def get(self, row):
        try:
            with np.load(self.folder / f"{row:06d}.npz", allow_pickle=False) as file:
                return {name: file[name] for name in ("shift", "sigma", "valid", "trouble")}
        except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError):
            return None

    def put(self, row, values):
        with whole_file(self.folder / f"{row:06d}.npz") as part, part.open("wb") as stream:
            np.savez(stream, **values)
