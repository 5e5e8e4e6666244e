"""What in a block is probably a mistake: read without a fault, and still not what was meant.

Each doubt is one sentence with the likely cause. Nothing here stops anything: a block may be odd.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from corridor.core.block import LAYOUTS, Block
from corridor.core.camera import INTERIOR, project_rays, undistort
from corridor.core.errors import InputError, did_you_mean, some
from corridor.core.geometry import GROSS, is_outlier, robust_scale_of_lengths
from corridor.core.output import counted
from corridor.core.preparation.half_turns import AsPosed, as_posed, turned_images
from corridor.core.preparation.plausibility_of_motion import motion_warnings
from corridor.core.preparation.plausibility_of_rigs import rig_warnings
from corridor.core.preparation.plausibility_of_rows import row_warnings
from corridor.core.preparation.plausibility_on_earth import earth_warnings
from corridor.core.preparation.record import derived
from corridor.core.preparation.units import UNITS_M, unit_of

# Observations outside their picture: a few are bad matches, which are named one by one.
_SHARE_OUTSIDE = 0.02
# What distortion and simulated effects push over the edge stays within this share of it.
_FAR_OUTSIDE = 0.02
# A picture in both directions filled by no more than this was smaller when it was measured.
_FILLED, _LEAST_COUNT = 0.6, 100
# Pictures are made smaller or larger by more than this (logarithm); what is left of the distance
# then is that of rough start values.
_RESIZED, _OF_RESIZED = 0.05, 0.2
# So many marks, this far from where start values put them, show by which factor.
_SOME, _FAR_PX, _OF_ONE = 3, 10.0, 0.1
_KEYS = ("name", "description", "source", "licence", "crs", "offset", "camera", "sigma",
         "lever_arm", "effect", "corrected", "derived", "date", "local_frame", "frame")  # fmt: skip
# The last two are written by `corridor import photos`.
_CAMERA_KEYS = ("width", "height", "model", *INTERIOR, "pixel_um", "readout_s", "row_direction",
                "calibrated", "readout_from", "f_stated")  # fmt: skip
# Observations in which a picture that is there twice shows.
_ENOUGH = 200_000
# So far a file's name is that of a table: `tiepoints`, `Gnss`, `ground.txt`.
_ALIKE = 0.85
# Measured and modelled image coordinates that agree but for noise and rough start values.
_CLEAR = 0.9
# Beyond these two sets of positions of one flight do not belong together.
_FAR_M, _FAR_UP_M, _GEOID_M = 100.0, 10.0, 120.0
# Share of the width of a flight by which the same images may lie apart, each another way.
_UNLIKE = 0.4
# An image is astray from here on; where more than this share are, all of them are.
_STRAY_M, _FEW, _FEWEST = 1.0, 0.1, 5
# Positions belong to another image by so many places, and lie so much nearer to it.
_PLACES, _ELSEWHERE = 3, 0.2
# Drones and small aircraft fly no higher above ground, m.
_HIGHEST_M = 3000.0
_FOOT_M = UNITS_M["feet"]
# No camera that works is hotter (industrial range of electronics), which is 185 F; a distance is
# another when it is longer or shorter by this much (logarithm), which no survey's error is.
_HOTTEST_C, _HOTTEST_F, _OTHER_LENGTH = 85.0, 185.0, 0.2
# Drones, which fly below a height, and aircraft carry an antenna no farther from the camera.
_OF_DRONES_M, _LONGEST_ARM_M = 150.0, (2.5, 15.0)
_LEAST_UNIT_PX = 5.0  # of marks that are not in pixels
_COARSE_M = 0.1  # from here on standard deviations may be millimetres taken for metres
# Axes that coordinates are given in by mistake: their order and signs.
AXES = (
    ("x and y exchanged", [1, 0, 2], [1, 1, 1]),
    ("x and y exchanged, and x with the opposite sign", [1, 0, 2], [1, -1, 1]),
    ("x and y exchanged, and y with the opposite sign", [1, 0, 2], [-1, 1, 1]),
    ("x and y exchanged, both with the opposite sign", [1, 0, 2], [-1, -1, 1]),
    ("x with the opposite sign", [0, 1, 2], [-1, 1, 1]),
    ("y with the opposite sign", [0, 1, 2], [1, -1, 1]),
    ("x and y with the opposite sign", [0, 1, 2], [-1, -1, 1]),
    ("z counted downwards", [0, 1, 2], [1, 1, -1]),
)
_REMEDY = "x is east, y north, in metres less the block's offset."


def plausibility_warnings(block: Block, without: bool = False) -> list[str]:
    """Sentences on what is probably a mistake in a block, the gravest first.

    without: whether it is what `without_impossible_points` left, which told the rest, for what asks
        by itself which rows are wild.
    """
    return [
        *earth_warnings(block),
        *_positions(block),
        *_pictures(block),
        *_twice(block),
        *(list(mirrored(block)) or turned_images(block)),
        *([] if without else [*without_impossible_points(block)[1], *row_warnings(block)]),
        *_settings(block),
        *_units(block),
        *rig_warnings(block),
        *passed_over(block),
        *_other_spelling(block),
        *motion_warnings(block),
    ]


# --- files ------------------------------------------------------------------------------------


def passed_over(block: Block) -> Iterator[str]:
    """Sentences on files of the folder that are called nearly as a table that the block lacks."""
    if block.folder is None or not block.folder.is_dir():
        return
    lacking = [table for table in LAYOUTS if not len(getattr(block, table))]
    names = sorted(file.name for file in block.folder.iterdir() if file.is_file())
    for name in names:
        stem = name.partition(".")[0]
        near = get_close_matches(stem.lower().replace("-", "_"), lacking, 1, _ALIKE)
        # What synchronising programs and explorers make of a name: `ground (1).csv`.
        near = near or [one for one in lacking if re.match(rf"{one}[ _(-].*\.csv$", name, re.I)]
        if near and name not in (f"{near[0]}.csv", f"{near[0]}.parquet"):
            yield f"{name} is not read: a block has {near[0]}.csv (or {near[0]}.parquet)."


def _other_spelling(block: Block) -> Iterator[str]:
    """Ground points that no image shows, where marks of nearly that name are of no ground point."""
    given, seen = set(block.ground["point"]), set(block.marks["point"])
    alike: dict[str, list[str]] = {}
    for name in seen - given:
        alike.setdefault(_plain(name), []).append(name)
    found = [(name, alike.get(_plain(name), [])) for name in sorted(given - seen)]
    pairs = [(name, others[0]) for name, others in found if len(others) == 1]
    if pairs:
        name, other = pairs[0]
        yield (
            f"Is {name!r} of ground.csv {other!r} of marks.csv? Names written in two ways are two "
            f"points ({counted(len(pairs), 'such pair')}): write one name."
        )


def _plain(name: str) -> str:
    """A name as a spreadsheet or another program may have changed it: `001`, `1`, `1.0`."""
    name = re.sub(r"(?<![\d.])0+(?=\d)", "", re.sub(r"\.0+$", "", name.casefold()))
    return re.sub(r"[\s_-]+", "", name)


# --- pictures given twice ---------------------------------------------------------------------


def _twice(block: Block) -> Iterator[str]:
    """Images of which most points lie at the very place of another's: no two exposures are so."""
    ties = block.tie_points
    some_points = ties["point"].cat.codes % (1 + len(ties) // _ENOUGH) == 0
    ties = ties.loc[some_points, ["image", "point", "x", "y"]]
    image, called = ties["image"].cat.codes.to_numpy(), ties["image"].cat.categories
    same = ties.duplicated(["point", "x", "y"], keep=False).to_numpy()
    of, seen = (np.bincount(rows, minlength=len(called)) for rows in (image[same], image))
    names = sorted(called[of > _CLEAR * seen].astype(str))
    if names:
        yield (
            f"{len(names)} images ({some(names, 4)}) have their points at the very pixels of "
            "another: is one picture there under two names? What it shows then counts twice: "
            "leave one of them out."
        )


# --- block.toml -------------------------------------------------------------------------------


def _settings(block: Block) -> Iterator[str]:
    tables: list[tuple[str, dict, tuple[str, ...]]] = [("", block.extra, _KEYS)]
    cameras = block.cameras.items()
    tables += [(f" of [camera.{name}]", one.extra, _CAMERA_KEYS) for name, one in cameras]
    for where, table, known in tables:
        for key, value in table.items():
            near = did_you_mean(key, known) if key not in known else ""
            if near:
                shown = f"[{key}]" if isinstance(value, dict) else key
                yield f"block.toml: {shown}{where} is not known to corridor and not used{near}."
    for name, camera in cameras:
        yield from (f"block.toml, [camera.{name}]: {slip}." for slip in camera.slips)
    heights = [block.numbers(table, "z") for table in ("images", "points")]
    above, below = (z[np.isfinite(z)] for z in heights)
    for name, arm in block.lever_arm.items() if len(above) and len(below) else ():
        high = float(np.median(above) - np.median(below))
        longest = _LONGEST_ARM_M[high > _OF_DRONES_M]
        if (length := float(np.linalg.norm(arm))) > longest and high > 0:
            yield (
                f"block.toml: the lever arm of {name} is {length:.4g} m long; what flies "
                f"{high:.0f} m above the ground is not so large: lever arms are in metres "
                f"({length:.4g} mm are {length / 1000:.4g}, {length:.4g} cm {length / 100:.4g})."
            )


def _units(block: Block) -> Iterator[str]:
    """Temperatures in kelvin, distances that are not those between their ends in ground.csv."""
    warm = block.column("images", "temperature_c")
    if np.isfinite(warm).any() and np.nanmedian(warm) > _HOTTEST_C:
        kelvin = np.nanmedian(warm) > _HOTTEST_F
        yield (
            f"images.csv: temperature_c is {np.nanmedian(warm):.0f} (median), hotter than a camera "
            f"that works: is it in {'kelvin? Subtract 273.15.' if kelvin else 'Fahrenheit?'}"
        )
    if not len(block.distances):
        return
    places = dict(zip(block.ground["point"], block.numbers("ground", *"xyz"), strict=True))
    nowhere = np.full(3, np.nan)
    one, other = (
        np.array([places.get(name, nowhere) for name in block.distances[end]])
        for end in ("from", "to")
    )
    ratio = block.column("distances", "distance") / np.linalg.norm(one - other, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        wrong = np.abs(np.log(ratio)) > _OTHER_LENGTH
    if wrong.any():
        row = int(np.argmax(wrong))
        name, end = block.distances.iloc[row][["from", "to"]]
        unit = unit_of(float(ratio[row]))
        yield (
            f"{block.where('distances', row)}: from {name} to {end} are "
            f"{block.distances['distance'].iloc[row]:g} m, {ratio[row]:.3g} times what ground.csv "
            f"says ({int(wrong.sum())} of {len(wrong)} rows): "
            + (f"is it in {unit}? Write metres." if unit else "are the names right?")
        )


# --- pictures ---------------------------------------------------------------------------------


def _pictures(block: Block) -> Iterator[str]:
    cameras = list(block.cameras.values())
    tables = [table for table in ("tie_points", "marks") if len(getattr(block, table))]
    # An axis at a time: of a river both side by side take three times as long to look through.
    pixels = {
        table: [getattr(block, table)[axis].to_numpy(float) for axis in "xy"] for table in tables
    }
    users = {}
    if len(cameras) > 1:
        users = {table: block.image_camera[block.image_rows(table)] for table in tables}
    for table, axes in pixels.items():
        if len(axes[0]) > 2 and all(np.abs(axis).max() <= 1.0 for axis in axes):
            yield (
                f"All x and y of {table}.csv lie between -1 and 1: are they shares of the picture, "
                "or focal lengths? Write pixels."
            )
    for n, camera in enumerate(cameras):
        size = np.array([camera.width, camera.height], dtype=float)
        mine = {
            table: np.flatnonzero(users[table] == n) if users else slice(None) for table in tables
        }
        parts = [[axis[rows] for axis in pixels[table]] for table, rows in mine.items()]
        parts = [part for part in parts if len(part[0])]
        if not parts:
            continue
        count = sum(len(x) for x, _ in parts)
        low = np.min([[axis.min() for axis in part] for part in parts], axis=0)
        high = np.max([[axis.max() for axis in part] for part in parts], axis=0)
        beyond = float(np.maximum(-0.5 - low, high - (size - 0.5)).max())
        gone = 0
        # The rule is that none lies outside: then nobody asks which.
        if not beyond <= 0.0:
            for x, y in parts:
                outside = (x < -0.5) | (x > size[0] - 0.5) | (y < -0.5) | (y > size[1] - 0.5)
                gone += int(np.count_nonzero(outside))
        shape = f"{camera.width} x {camera.height} px"
        if gone > _SHARE_OUTSIDE * count:
            seen = np.concatenate([np.stack(part, axis=1) for part in parts])
            yield (
                f"{gone:,} of {count:,} observations of camera {camera.name} lie outside "
                f"its picture of {shape}: {_why_outside(seen, size)}"
            )
        elif beyond > _FAR_OUTSIDE * size.max():
            yield _outside(block, camera, mine, pixels)
        elif count >= _LEAST_COUNT and (high < _FILLED * size).all():
            x, y = high
            yield (
                f"No observation of camera {camera.name} lies beyond x = {x:.0f}, y = {y:.0f} of "
                f"its picture of {shape}: points measured on reduced pictures, or width and "
                "height in block.toml too large?"
            )


def _why_outside(seen: np.ndarray, size: np.ndarray) -> str:
    low, high = np.percentile(seen, [1, 99], axis=0)
    if (low < -0.2 * size).all() and (high < 0.7 * size).all():
        return (
            "pixels counted from the middle of the picture? (0, 0) is the centre of its top-left "
            "pixel."
        )
    turned = size[::-1]
    if (low > -0.05 * size).all() and (high < turned).all() and (high > size).any():
        return "x and y exchanged, or the pictures turned by 90 degrees?"
    return "are width and height in block.toml those of the pictures it was measured in?"


def _outside(block, camera, mine, pixels) -> str:
    """A few observations outside the picture, the farthest with its row."""
    size = np.array([camera.width, camera.height], dtype=float)
    count, far, at = 0, 0.0, ("", 0)
    for table, rows in mine.items():
        xy = np.stack([axis[rows] for axis in pixels[table]], axis=1)
        away = np.maximum(-0.5 - xy, xy - (size - 0.5)).max(axis=1)
        count += int((away > 0).sum())
        if len(away) and away.max() > far:
            row = int(np.arange(len(pixels[table][0]))[rows][away.argmax()])
            far, at = float(away.max()), (table, row)
    table, row = at
    there = getattr(block, table).iloc[row]
    return (
        f"{counted(count, 'observation')} outside the picture of camera {camera.name} "
        f"({camera.width} x {camera.height} px), the farthest in {block.named(table, row)} at "
        f"{there['x']:g}, {there['y']:g}."
    )


# What quaternions may be that are not those of images.csv: what is told, and those that were meant.
_OTHER_TURNS = (
    ("qw is the last of the four", lambda q: q[:, [3, 0, 1, 2]]),
    ("the turns are those from camera to world", lambda q: q * [1.0, -1.0, -1.0, -1.0]),
    ("qw is the last of the four, and the turns are those from camera to world",
     lambda q: q[:, [3, 0, 1, 2]] * [1.0, -1.0, -1.0, -1.0]),
)  # fmt: skip


def mirrored(block: Block) -> Iterator[str]:
    """A sentence on axes of the image coordinates that no pose of a camera makes of the others, or
    on quaternions of another order or sense, as start values tell."""
    step = max(len(block.tie_points) // 2000, 1)
    (xu, xv), (yu, yv) = _alike(as_posed(block, "tie_points", step))
    if xu > _CLEAR and yv < -_CLEAR:
        yield (
            "Image coordinates run against the start poses in y: is y counted upwards? It is "
            "counted downwards from the centre of the top-left pixel."
        )
    elif xu < -_CLEAR and yv > _CLEAR:
        yield (
            "Image coordinates run against the start poses in x: are the pictures mirrored? x is "
            "counted to the right from the centre of the top-left pixel."
        )
    elif xv > _CLEAR and yu > _CLEAR:
        yield (
            "Image coordinates fit the start poses with x and y exchanged: x is to the right, y "
            "downwards."
        )
    elif not (xu > _CLEAR and yv > _CLEAR):
        for told, meant in _OTHER_TURNS:
            (xu, _), (_, yv) = _alike(as_posed(block, "tie_points", step, meant))
            if xu > _CLEAR and yv > _CLEAR:
                yield f"Image coordinates fit the start poses if {told} (qw to qz of images.csv)."
                return


def _alike(seen: AsPosed) -> np.ndarray:
    """Correlations (2, 2) of x, y with u, v; 0 of hardly any."""
    _, measured, ray, _ = seen
    if len(measured) < _LEAST_COUNT:
        return np.zeros((2, 2))
    with np.errstate(invalid="ignore"):  # a coordinate that never varies goes with nothing
        return np.corrcoef(measured.T, ray.T)[:2, 2:]


def without_impossible_points(block: Block, strict: bool = False) -> tuple[Block, list[str]]:
    """The block without image points with which no adjustment is of any use, and sentences on them.

    They are what a fisheye sees 90 degrees or more from its axis (but where that is most of it:
    then its camera is wrong), and marks that lie where start values put them in pictures resized,
    turned or mirrored. Where tie points are turned, marks are turned with them. strict: raises
    InputError instead.
    """
    told = []
    for table in ("tie_points", "marks"):
        beside, rows = _beside(block, table), getattr(block, table)
        if not beside.any():
            continue
        few = beside.mean() < 0.5
        where = block.where(table, int(np.argmax(beside)))
        told.append(
            f"{where}: {beside.sum():,} of {len(rows):,} image points lie 90 degrees or more from "
            "the axis of a fisheye, or where its distortion folds: corridor has no such rays. "
            + ("They are set aside." if few else "Correct f and k1..k4 in block.toml.")
        )
        block = replace(block, **{table: rows[~beside].reset_index(drop=True)}) if few else block
    if not (list(mirrored(block)) or list(turned_images(block))):
        other, sized = list(_marks_of_other_pictures(block)), np.zeros(0, int)
        if not other:
            sized, other = marks_of_another_size(block)
        told += other
        left = block.marks.drop(block.marks.index[sized]) if len(sized) else block.marks.iloc[:0]
        block = replace(block, marks=left.reset_index(drop=True)) if other else block
    if told and strict:
        raise InputError(told[0])
    return block, told


def _beside(block: Block, table: str) -> np.ndarray:
    """Which image points (n,) a fisheye would see 90 degrees or more from its axis."""
    cameras = list(block.cameras.values())
    wide = np.array([camera.fisheye and not camera.too_short for camera in cameras])
    out = np.zeros(len(getattr(block, table)), dtype=bool)
    if not wide.any():
        return out
    camera = block.image_camera[block.image_rows(table)]
    rows = np.flatnonzero(wide[camera])
    lens = np.array([camera.interior for camera in cameras])
    out[rows] = np.isnan(undistort(block.numbers(table, "x", "y")[rows], lens, camera[rows])[:, 0])
    return out


def marks_of_another_size(block: Block) -> tuple[np.ndarray, list[str]]:
    """Rows of the marks that alone were measured in pictures of another size, and a sentence."""
    if len(block.marks) < _FEWEST:
        return np.zeros(0, int), []
    seen, measured, there, _ = _marks_as_posed(block)
    off = np.linalg.norm(measured - there, axis=1)
    # Up to half of all may be; the others lie as far off as rough start values bring them.
    for usual in np.quantile(off, [0.25, 0.5]) if len(off) else ():
        bad = off > max(_FAR_PX, usual / _OF_RESIZED)
        if bad.sum() < _SOME or bad.mean() > 0.5:
            continue
        factor = float(np.median(measured[bad] / there[bad]))
        left = np.median(np.linalg.norm(measured[bad] - factor * there[bad], axis=1))
        far, size = np.median(off[bad]), np.median(np.linalg.norm(measured[bad], axis=1))
        if factor > 0 and abs(np.log(factor)) > _RESIZED and left < _OF_ONE * min(far, size):
            images = block.images["image"].to_numpy()[seen.image[bad]].astype(str)
            names = some(list(dict.fromkeys(images)), 3)
            camera = next(iter(block.cameras.values()))
            return seen.row[bad], [
                f"{bad.sum()} of {len(block.marks)} marks, in {names}, lie {far:.0f} px (median) "
                "from where the start values put them, all towards "
                f"the corner x = y = 0 by one factor, {factor:.2f}: were these measured in "
                f"pictures of {factor * camera.width:.0f} x {factor * camera.height:.0f} px? "
                f"Multiply their x and y by {1 / factor:.3f}; until then they are set aside."
            ]
    return np.zeros(0, int), []


def _marks_as_posed(block: Block) -> tuple[AsPosed, np.ndarray, np.ndarray, np.ndarray]:
    """Marks, what was measured and where the start values put it (n, 2), px from the corner of the
    picture, half a pixel before its first pixel's centre; and the sizes of the pictures (n, 2)."""
    seen = as_posed(block, "marks")
    camera = block.image_camera[seen.image]
    lens = np.array([c.interior for c in block.cameras.values()])
    lens[:, 3:-1] = 0.0
    size = np.array([[c.width, c.height] for c in block.cameras.values()])[camera]
    return seen, seen.pixel + 0.5, project_rays(seen.ray, lens, camera) + 0.5, size


def _marks_of_other_pictures(block: Block) -> Iterator[str]:
    """A sentence on marks of other pictures, with the way to correct them."""
    if len(block.marks) < _FEWEST:
        return
    seen, measured, there, size = _marks_as_posed(block)
    if len(seen.image) < _FEWEST:
        return
    factor = float(np.median(measured / there))
    off = np.median(np.linalg.norm(measured - there, axis=1))
    left = np.median(np.linalg.norm(measured - factor * there, axis=1))
    # A factor that takes whatever is there to the corner leaves marks where they are.
    if left > _OF_RESIZED * np.median(np.linalg.norm(measured, axis=1)):
        left = np.inf
    for words, other in (
        *_in_other_units(measured - 0.5, there, size),
        ("they were counted from the middle", measured + size / 2),
        ("they were counted from the middle, y upwards", size / 2 + measured * [1.0, -1.0]),
        ("y were counted upwards", np.column_stack([measured[:, 0], size[:, 1] - measured[:, 1]])),
        ("the pictures were turned by 180 degrees", size - measured),
        (
            "the pictures were mirrored",
            np.column_stack([size[:, 0] - measured[:, 0], measured[:, 1]]),
        ),
        ("x and y were exchanged", measured[:, ::-1]),
    ):
        if np.median(np.linalg.norm(other - there, axis=1)) < _OF_RESIZED * min(off, left):
            remedy = "Write x and y in pixels from the centre of the top-left pixel, y downwards."
            if words.startswith("the pictures"):
                remedy = "Measure them in the pictures in which the tie points were measured."
            yield (
                f"Marks lie {off:.0f} px (median) from where the start values put them, as if "
                f"{words}: they are set aside, and ground points with them. {remedy}"
            )
            return
    if not abs(np.log(max(factor, 1e-9))) > _RESIZED or left > _OF_RESIZED * off:
        return
    width, height = factor * size[0]
    yield (
        f"Marks lie {off:.0f} px (median) from where the start values put them, all towards the "
        f"corner x = y = 0 by one factor, {factor:.2f}: were they measured in pictures of "
        f"{width:.0f} x {height:.0f} px? Multiply x and y of marks.csv by {1 / factor:.3f}; until "
        "then they are set aside, and ground points with them."
    )


def _in_other_units(measured: np.ndarray, there: np.ndarray, size: np.ndarray):
    """(words, image points) of marks (n, 2) from the middle, in millimetres or shares of a side."""
    for words, axes in (("", [1.0, 1.0]), (", y upwards", [1.0, -1.0])):
        turned, goal = measured * axes, there - size / 2
        unit = float((turned * goal).sum() / (turned**2).sum())
        if unit > _LEAST_UNIT_PX:
            told = f"in a unit of {unit:.4g} px (millimetres, or a share of the width?)"
            yield f"they were counted from the middle{words}, {told}", size / 2 + unit * turned


# --- standard deviations ----------------------------------------------------------------------


def coarse_sigmas(block: Block) -> Iterator[str]:
    """Sentences on positions and control that lie ten times nearer to the start poses than their
    standard deviations say: millimetres or centimetres taken for metres. For what adjusts nothing;
    an adjustment says it by its residuals."""
    known = {one.column for one in derived(block)}
    at = block.image_rows("gnss")
    away = block.numbers("gnss", *"xyz") - block.numbers("images", *"xyz")[at]
    flight = block.image_flight[at]
    for one in np.unique(flight):
        away[flight == one] -= np.nanmedian(away[flight == one], axis=0)
    away = away[np.isfinite(away).all(axis=1)]
    if len(away) >= _FEWEST and "gnss.sx" not in known:
        yield from _coarse("gnss", "GNSS positions", block.gnss_sigma(), np.median(np.abs(away)))
    if len(block.ground) < _SOME or len(block.marks) < _FEWEST:
        return
    seen, measured, there, _ = _marks_as_posed(block)
    f = np.array([camera["f"] for camera in block.cameras.values()])[block.image_camera[seen.image]]
    above = block.poses[seen.image, 2] - float(np.median(block.column("ground", "z")))
    off = np.linalg.norm(measured - there, axis=1) / f * above
    if len(off) >= _FEWEST:
        yield from _coarse("ground", "ground points", block.ground_sigma(), np.median(off))


def _coarse(table: str, what: str, sigma: np.ndarray, away: float) -> Iterator[str]:
    usual = float(np.median(sigma)) if len(sigma) else 0.0
    if usual >= _COARSE_M and 0.0 < away < _OF_ONE * usual:
        default = {"gnss": "gnss_m", "ground": "control_m"}[table]
        yield (
            f"{table}.csv: {what} are stated to {usual:g} m and lie within {away:.2g} m (median) "
            "of where the start poses put them. Unless the poses were made from them: are their "
            f"standard deviations (sx, sy, sz, or {default} of block.toml) in metres? 8 mm are "
            "0.008."
        )


# --- positions --------------------------------------------------------------------------------


def _positions(block: Block) -> Iterator[str]:
    centres = block.numbers("images", *"xyz")
    antenna = np.full(centres.shape, np.nan)
    antenna[block.image_rows("gnss")] = block.numbers("gnss", *"xyz")
    told = (
        position_difference("gnss.csv", antenna, "images.csv", centres)
        or _displaced(block, antenna, centres)
        or _flights_apart(block, antenna - centres)
    )
    if told:
        yield told
    posed = np.isfinite(centres).all(axis=1).sum() > 2
    file, reach = ("images.csv", centres) if posed else ("gnss.csv", antenna)
    told = _ground(block, reach)
    if told:
        yield f"ground.csv {told} {file}: {_REMEDY}"


def _flights_apart(block: Block, away: np.ndarray) -> str:
    """A sentence on a flight whose positions all lie by one vector from its start poses, of which
    they lie by away (images, 3), m, where those of another flight do not."""
    middle, spread, names = [], [], []
    for flight, name in enumerate(block.flight_names):
        mine = away[(block.image_flight == flight) & np.isfinite(away).all(axis=1)]
        if len(mine) >= _FEWEST:
            middle.append(np.median(mine, axis=0))
            spread.append(np.median(np.abs(mine - middle[-1])))
            names.append(name)
    for k in range(1, len(names)):
        apart = float(np.linalg.norm(middle[k] - middle[0]))
        if apart > max(_FAR_UP_M, max(spread[0], spread[k]) / _OF_RESIZED):
            one, other = (", ".join(f"{v:+.1f}" for v in middle[n]) for n in (0, k))
            return (
                f"gnss.csv lies ({other}) m from images.csv in flight {names[k]}, and ({one}) m in "
                f"flight {names[0]}: are its positions from another base, zone or height system?"
            )
    return ""


def _displaced(block: Block, antenna: np.ndarray, centres: np.ndarray) -> str:
    """A sentence on positions (images, 3) that are those of other images, so many places on."""
    time = block.column("images", "time_s")
    order = np.lexsort((time, block.image_flight))
    given, known = antenna[order], centres[order]
    away = {
        places: _median_apart(given[max(-places, 0) :], known[max(places, 0) :])
        for places in range(-_PLACES, _PLACES + 1)
    }
    backward = _median_apart(given[::-1], known)
    if backward < min(_ELSEWHERE * min(away.values()), away[0] - _STRAY_M):
        return (
            f"gnss.csv gives the images their positions from the last to the first: read so, they "
            f"lie {backward:.1f} m (median) from those of images.csv; as given, {away[0]:.1f} m."
        )
    best = min(away, key=lambda places: away[places])
    if not best or not away[best] < min(_ELSEWHERE * away[0], away[0] - _STRAY_M):
        return ""
    which = "image" if abs(best) == 1 else f"{abs(best)} images"
    return (
        f"gnss.csv gives each image the position of the {which} {'after' if best > 0 else 'before'}"
        f" it: read so, its positions lie {away[best]:.1f} m (median) from those of images.csv; as "
        f"given, {away[0]:.1f} m. Was a photograph deleted, or a position lost? Give "
        "each image its own."
    )


def _median_apart(given: np.ndarray, known: np.ndarray) -> float:
    """How far positions (n, 3) and (m, 3) of the same rows lie apart horizontally, m."""
    count = min(len(given), len(known))
    away = (given[:count] - known[:count])[:, :2]
    away = away[np.isfinite(away).all(axis=1)]
    return float(np.median(np.linalg.norm(away, axis=1))) if len(away) >= _FEWEST else np.inf


def position_difference(file: str, given: np.ndarray, other: str, known: np.ndarray) -> str:
    """What is wrong with positions (n, 3) beside those of the same images; empty where nothing is.

    file, other: where they stand. Rows with NaN are left out.
    """
    both = np.isfinite(given).all(axis=1) & np.isfinite(known).all(axis=1)
    given, known = given[both], known[both]
    if len(given) < 3:
        return ""
    extent = np.ptp(known[:, :2], axis=0).max()
    away = given - known
    turned = {
        words: np.median(np.linalg.norm(given[:, order] * sign - known, axis=1))
        for words, order, sign in AXES
    }
    words = min(turned, key=lambda words: turned[words])
    # Along a diagonal, axes that are exchanged put images hardly elsewhere.
    if turned[words] < 0.05 * np.median(np.linalg.norm(away, axis=1)):
        return f"{file} has {words} beside {other}: x is east, y north, z up."
    middle = np.median(away, axis=0)
    spread = np.median(np.abs(away - middle), axis=0)
    if not np.linalg.norm(middle) > _FAR_UP_M and spread.max() < 0.2 * extent:
        return ""
    if _degrees(given[:, :2], known[:, :2]):
        return (
            f"{file} gives x and y in degrees, {other} in metres: convert them to the block's "
            "coordinates (`corridor gnss` does)."
        )
    for unit, metres in UNITS_M.items():
        for one, mine, others in ((file, given, known), (other, known, given)):
            wide = np.ptp(others[:, :2], axis=0).max()
            # No flight is less than a metre wide: then it is the other table that counts otherwise.
            left = np.median(np.abs(metres * mine - others), axis=0).max()
            if left < 0.05 * wide and wide > _STRAY_M:
                return f"{one} is in {unit}: write metres."
    level = np.abs(middle[:2]).max() < min(_FAR_UP_M, 0.3 * abs(middle[2]))
    if level and spread.max() < max(0.25 * abs(middle[2]), 2.0):
        for one, mine, two, others in ((file, given, other, known), (other, known, file, given)):
            height = float(np.median(others[:, 2]))
            unit = unit_of(float(np.median(mine[:, 2])) / height) if height else ""
            if unit:
                return (
                    f"Heights of {one} are {1.0 / UNITS_M[unit]:.4g} times those of {two}: are "
                    f"they in {unit}? Write metres."
                )
        if abs(middle[2]) > _GEOID_M:
            return f"Heights of {file} lie {middle[2]:+.1f} m (median) from those of {other}."
        return (
            f"Heights of {file} lie {middle[2]:+.1f} m (median) from those of {other}: one above "
            "the ellipsoid, the other above the geoid?"
        )
    if np.abs(middle[:2]).max() > _FAR_M and spread[:2].max() < 0.1 * np.abs(middle[:2]).max():
        return (
            f"{file} lies {_kilometres(np.hypot(*middle[:2]))} from {other}, all images by the "
            "same vector: subtract the block's offset from it."
        )
    return ""


def position_disagreement(file: str, given: np.ndarray, other: str, known: np.ndarray) -> str:
    """A sentence where positions (n, 3) go ways of their own beside those of the same images."""
    both = np.isfinite(given).all(axis=1) & np.isfinite(known).all(axis=1)
    if both.sum() < 4:
        return ""
    given, known = given[both, :2], known[both, :2]
    away, wide = (
        float(np.median(np.linalg.norm(one - np.median(one, axis=0), axis=1)))
        for one in (given - known, given)
    )
    if away <= _UNLIKE * wide:
        return ""
    return (
        f"{file} and {other} put the images {away:.1f} m (median) apart horizontally, each in "
        "another direction, "
        f"in a flight that is {2 * wide:.0f} m wide: do names, times and columns belong together?"
    )


def position_outliers(
    given: np.ndarray, other: str, known: np.ndarray, images: Sequence[str]
) -> str:
    """A sentence on the few images whose two positions (n, 3) lie apart where the others' agree.

    other: where `known` stands. What is less than a metre, or than start poses miss, is not told.
    """
    away = given - known
    both = np.isfinite(away).all(axis=1)
    if both.sum() < _FEWEST:
        return ""
    length = np.linalg.norm(away - np.median(away[both], axis=0), axis=1)
    scale = robust_scale_of_lengths(length[both], _STRAY_M / GROSS)
    far = np.flatnonzero(is_outlier(length, scale, GROSS))
    if not len(far) or len(far) > _FEW * both.sum():
        return ""
    worst = far[np.argmax(length[far])]
    more = f" ({len(far) - 1} more too)" if len(far) > 1 else ""
    return (
        f"{images[worst]} lies {length[worst]:.1f} m from its pose in {other}, the others "
        f"{np.median(length[both]):.2f} m (median){more}: is its time right?"
    )


def _kilometres(metres: float) -> str:
    return f"{metres / 1000:,.{0 if metres > 1e4 else 2}f} km"


def _degrees(given: np.ndarray, known: np.ndarray) -> bool:
    """Whether plan positions (n, 2) are degrees, as the extent of the known metres says."""
    if not (np.abs(given[:, 0]) <= 360).all() or not (np.abs(given[:, 1]) <= 360).all():
        return False
    extent, metres = np.ptp(given, axis=0).max(), np.ptp(known, axis=0).max()
    # A degree of latitude has 111 km, one of longitude less.
    return bool(metres > 10.0 and 5e-6 < extent / metres < 2e-4)


def _ground(block: Block, centres: np.ndarray) -> str:
    """How ground points lie that the images which show them could not see; empty where they could.

    centres: (images, 3), NaN where unknown.
    """
    marked = block.marks["point"].array
    from_where = centres[block.image_rows("marks")]
    posed = np.isfinite(from_where).all(axis=1) & (marked.codes >= 0)
    # The last place is that of a point which nobody marked.
    count, *sums = (
        np.bincount(marked.codes[posed], weights, len(marked.categories) + 1)
        for weights in (None, *from_where[posed].T)
    )
    with np.errstate(invalid="ignore"):
        above = (np.array(sums) / count).T[marked.categories.get_indexer(block.ground["point"])]
    given = block.numbers("ground", *"xyz")
    known = np.isfinite(above).all(axis=1)
    above, given = above[known], given[known]
    if len(given) < 3:
        return ""
    height = _height(block, centres, given, above)
    away = np.median(np.linalg.norm(given[:, :2] - above[:, :2], axis=1))
    turned = np.median(np.linalg.norm(given[:, [1, 0]] - above[:, :2], axis=1))
    if _degrees(given[:, :2], above[:, :2]):
        return "is in degrees, not in the metres of"
    # What images around the points see on their way round is in the middle whatever the axes are.
    wide = np.median(np.linalg.norm(given[:, :2] - np.median(given[:, :2], axis=0), axis=1))
    if turned < 0.5 * min(away, wide) and away > 0.3 * height:
        return "has x and y exchanged beside"
    away = float(np.hypot(away, np.median(np.abs(given[:, 2] - above[:, 2]))))
    if away < 5.0 * height:
        return ""
    in_feet = above - _FOOT_M * given
    if np.hypot(*np.median(np.abs(in_feet[:, [0, 2]]), axis=0)) < 2.0 * height:
        return "is in feet, not in the metres of"
    return f"lies {_kilometres(away)} from"


def _height(block: Block, centres: np.ndarray, given: np.ndarray, above: np.ndarray) -> float:
    """Flying height, m, beyond a few of which nobody looks; never by the points in question.

    By the tie points, else as far as the images lie apart, else as high as such flights are.
    """
    points = block.points["z"].to_numpy(float)
    known = points[np.isfinite(points)]
    flown = float(np.nanmedian(centres[:, 2]))
    stated = float(np.median(above[:, 2] - given[:, 2]))
    if len(known):
        return max(flown - float(np.median(known)), 10.0)
    wide = float(np.nanmax(np.ptp(centres[np.isfinite(centres).all(axis=1)][:, :2], axis=0)))
    return min(max(stated, 10.0), max(wide, _HIGHEST_M))
