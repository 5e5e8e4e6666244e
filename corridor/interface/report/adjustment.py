"""What an adjustment found, for a terminal, a notebook, another program and a folder."""

import math
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtri

from corridor.core.adjustment import ALPHA, Adjustment, critical, may_be_zero, tested_by
from corridor.core.geometry import is_outlier
from corridor.core.output import (
    DASH,
    Report,
    Table,
    coefficient,
    counted,
    files_in,
    fixed,
    metre_digits,
    millimetres,
    plain,
    rounded,
    scaled,
    short,
    significant,
    times,
    whole_folder,
    with_units,
    write_csv,
    write_json,
    write_picture,
)

RESULT = "adjustment.json"
CAPTIONS = {
    "check_points": (
        "Where the adjusted check points lie, seen from where they were surveyed. A pattern that "
        "turns, bends or grows along the corridor is not chance."
    ),
    "residual_vectors": (
        "What the camera model leaves over. Arrows in all directions are noise; arrows that "
        "follow their neighbours are something the camera did that the model does not know."
    ),
    "residuals_along": (
        "Image and GNSS residuals along the block. Steps between strips or flights, and slopes "
        "along one, point at time, at the antenna or at the camera."
    ),
    "correlation_matrix": (
        "Parameters that this block cannot separate: a full cell means that one can stand in "
        "for the other."
    ),
    "first_look": "Images, points and coverage of the block after the adjustment.",
}

_KINDS = {"tie": "tie points", "mark": "marks", "gnss": "GNSS", "control": "control",
          "attitude": "attitudes"}  # fmt: skip
_DIFFERENCES, _SIGMAS = ["dx", "dy", "dz"], ["s_dx", "s_dy", "s_dz"]
_STRONG = 0.95
_MOST_GROUPS_SHOWN = 8  # of one effect parameter
_MOST_POINTS = 20
_MOST_PAIRS = 12
_GO_ON = "Go on with OUT/block, or in another program: `corridor export FORMAT OUT -o OUT2`."
# A sum of squares of check points that chance exceeds this rarely; a sigma naught worth a question.
_RARE, _LARGE = 0.01, 1.1
_MOST_STEPS = 3
# A variance component so far from 1 is no chance.
_IMPROBABLE = 1e-3


def of_adjustment(adjustment: Adjustment) -> Report:
    """Headline, warnings and every table of an adjustment, those without rows left out."""
    if len(adjustment.check_points):
        # Theirs need those of all points: of a river, before the residuals take the room.
        adjustment.point_sigma  # noqa: B018
    made = [
        _observations(adjustment),
        _components(adjustment),
        _reliability(adjustment),
        _distances(adjustment),
        _points(adjustment),
        _camera(adjustment),
        _effects(adjustment),
        _lever_arms(adjustment),
        _check_points(adjustment),
        _check_statistics(adjustment),
        _correlations(adjustment),
        _strong_correlations(adjustment),
    ]
    return Report(
        title=f"Adjustment of {adjustment.block.name}",
        opening=_headline(adjustment),
        warnings=adjustment.warnings,
        tables=[table for table in made if table is not None],
        actions=(steps(adjustment) or [_GO_ON]) if adjustment.converged else [],
    )


def save_adjustment(
    adjustment: Adjustment,
    folder: str | os.PathLike,
    pictures: Mapping[str, Any] | Callable[[Adjustment], Mapping[str, Any]] | None = None,
    captions: Mapping[str, str] | None = None,
    gis: bool = False,
    beside: Mapping[str, bytes] | None = None,
) -> list[Path]:
    """Writes an adjustment into `folder`, whole or not at all; returns the paths, sorted.

    adjustment.json, report.html (one page, pictures inside), block/ (the adjusted block), one
    PNG for each picture, check_points.csv, poses.csv, outliers.csv (image measurements held to be
    wrong) and effect_SLUG.csv for an effect of more than 50 groups.
    pictures: matplotlib figures by name, or what makes them: `corridor.figures.of_adjustment`.
    captions: one sentence for each, for the page.
    gis: also adjustment.gpkg (points, check vectors, cameras, footprints) and adjustment.las.
    beside: further files by their names, a certificate say.
    An earlier result in `folder` is replaced; what else lies there stays. Raises InputError where
    `folder` is a file, or holds something but no earlier result; with gis, where the extra is
    missing.
    """
    folder, block = Path(folder), adjustment.block
    captions = CAPTIONS if captions is None else captions
    with whole_folder(folder, RESULT) as part, ThreadPoolExecutor(1) as aside:
        # Of a river both take as long, and a file is written while Python draws.
        written = aside.submit(block.write, part / "block", form=block.form)
        pictures = pictures(adjustment) if callable(pictures) else pictures or {}
        shown = []
        for name, figure in pictures.items():
            png = write_picture(figure, part / f"{name}.png")
            shown.append((name.replace("_", " "), captions.get(name, ""), png))
        page = of_adjustment(adjustment).page(shown)
        (part / "report.html").write_text(page, encoding="utf-8", newline="\n")
        for name, table in _files(adjustment).items():
            write_csv(table, part / name)
        for name, content in (beside or {}).items():
            (part / name).write_bytes(content)
        if gis:
            adjustment.write_gis(part / "adjustment")
        written.result()
        content = adjustment_dict(adjustment)
        content["pictures"] = [f"{name}.png" for name in pictures]
        content["files"] = sorted([RESULT, *files_in(part)])
        write_json(content, part / RESULT)
        names = files_in(part)
    return [folder / name for name in names]


def adjustment_dict(adjustment: Adjustment) -> dict[str, Any]:
    """The content of `adjustment.json`: finite numbers or None.

    Effects are as `corridor.effects.Values` writes them; effect_groups: who shares their values.
    """
    check = {
        name: {"xy": found.xy, "z": found.z, "3d": found.d3}
        for name, found in adjustment.check_statistics._asdict().items()
    }
    camera: dict[str, dict] = {}
    for row in adjustment.camera.itertuples(index=False):
        camera.setdefault(row.camera, {})[row.parameter] = {"value": row.value, "sigma": row.sigma}
    lever_arm = {
        row.flight: {
            axis: {"value": getattr(row, axis), "sigma": getattr(row, f"s{axis}")} for axis in "xyz"
        }
        for row in adjustment.lever_arm.itertuples(index=False)
    }
    content = {
        "block": adjustment.block.name,
        "required": adjustment.required,
        "converged": bool(adjustment.converged),
        "iterations": adjustment.iterations,
        "seconds": adjustment.seconds,
        "sigma0": adjustment.sigma0,
        "redundancy": adjustment.redundancy,
        "observations": adjustment.statistics,
        "camera": camera,
        "effects": adjustment.values.to_json(),
        "effect_groups": {slug: one.kind for slug, one in adjustment.values.items()},
        "lever_arm": lever_arm,
        "check_points": {"rows": adjustment.check_points.to_dict(orient="records"), **check},
        "correlations": adjustment.correlations.to_dict(orient="records"),
        "high_correlations": adjustment.high_correlations.to_dict(orient="records"),
        "parameters": len(adjustment.correlation_matrix),
        "variance_components": adjustment.variance_components.to_dict(orient="records"),
        "reliability": adjustment.reliability.to_dict(),
        "distances": adjustment.distances.to_dict(orient="records"),
        "warnings": adjustment.warnings,
    }
    return plain(content)


def _files(adjustment: Adjustment) -> dict[str, pd.DataFrame]:
    """The tables of full numbers by the names of their files."""
    files = {
        "check_points.csv": adjustment.check_points,
        "poses.csv": adjustment.poses,
        "outliers.csv": _outliers(adjustment),
        "reliability.csv": adjustment.reliability.to_frame(),
        "external_reliability.csv": (
            adjustment.reliability.external if adjustment.reliability.whole else pd.DataFrame()
        ),
    } | adjustment.values.tables()
    return {name: table for name, table in files.items() if len(table) or name == "poses.csv"}


def _outliers(adjustment: Adjustment) -> pd.DataFrame:
    """Image measurements flagged as outlier, largest first."""
    columns = ["point", "image", "x", "y", "vx", "vy", "sigma"]
    parts = []
    for kind in ("tie", "mark"):
        table = adjustment.residuals[kind]
        part = table.loc[table["outlier"], columns].astype({"point": str, "image": str})
        parts.append(part.assign(kind=kind))
    every = with_units(pd.concat(parts, ignore_index=True), {"px": "x y vx vy sigma"})
    size = np.hypot(every["vx"], every["vy"]) / every["sigma"]
    return every.iloc[np.argsort(-size.to_numpy(), kind="stable")].reset_index(drop=True)


# --- the opening -------------------------------------------------------------------------------


def _headline(adjustment: Adjustment) -> str:
    """The first sentences of a report, for a surveyor who reads nothing else."""
    block = adjustment.block
    name = short(block.name, 50)
    steps = counted(adjustment.iterations, "iteration")
    images = counted(len(block.images), "image")
    if not adjustment.converged:
        return (
            f"The adjustment of {name} ({images}) did not converge in {steps}: "
            "its numbers are not a result."
        )
    parts = [f"The adjustment of {name} ({images}) converged in {steps}."]
    sigma0 = float(adjustment.sigma0)
    if math.isfinite(sigma0):
        parts.append(f"Sigma naught is {sigma0:.3f}: the residuals are {_compared(sigma0)}.")
    return " ".join([*_judged(adjustment), *parts, *_measured(adjustment)])


def _judged(adjustment: Adjustment) -> list[str]:
    """Whether it is good enough, where somebody says what is."""
    if adjustment.required is None:
        return []
    wanted = f"{millimetres(adjustment.required)} are required"
    count = len(adjustment.check_points)
    if not count:
        return [f"Whether it is good enough is not known: {wanted}, and there is no check point."]
    found = adjustment.check_rms.d3
    verdict = "Good enough" if found <= adjustment.required else "Not good enough"
    at = counted(count, "check point")
    return [f"{verdict}: {millimetres(found)} at {at} (3D RMS), {wanted}."]


def _measured(adjustment: Adjustment) -> list[str]:
    """How far off the check points are."""
    count, rms = len(adjustment.check_points), adjustment.check_rms
    if not count:
        return ["There are no check points, so nothing independent tests it."]
    return [
        f"At {counted(count, 'check point')} it is off by {millimetres(rms.xy)} horizontally and "
        f"{millimetres(rms.z)} in height (RMS)."
    ]


def doubted(adjustment: Adjustment) -> bool:
    """Whether check points or residuals are larger than their standard deviations say."""
    return _beyond(adjustment) or bool(adjustment.sigma0 > _LARGE)


def _beyond(adjustment: Adjustment) -> bool:
    """Whether check points are off by more than chance makes of their standard deviations."""
    check = adjustment.check_points
    if not len(check):
        return False
    # The sum of squares of n normalised numbers is a chi-square of n degrees of freedom.
    scaled = check[_DIFFERENCES].to_numpy(float) / check[_SIGMAS].to_numpy(float)
    return bool(np.sum(np.square(scaled)) > chdtri(np.size(scaled), _RARE))


def steps(adjustment: Adjustment) -> list[str]:
    """What has to be done about an adjustment, the most useful first, at most three sentences."""
    out, check = [], adjustment.check_points
    rms, beyond = adjustment.check_rms, _beyond(adjustment)
    missed = len(check) and adjustment.required is not None and rms.d3 > adjustment.required
    if beyond or missed or adjustment.sigma0 > _LARGE:
        why = "Check points are off by more than their standard deviations say" if beyond else ""
        why = why or ("It is not accurate enough" if missed else "The residuals are too large")
        out.append(
            f"{why}: find what is missing from the model with `corridor diagnose BLOCK -o OUT`"
        )
    if missed and not beyond:
        out.append(
            "The standard deviations say the same: more control, images or GNSS are needed; "
            "`corridor plan PLAN` says how many"
        )
    if not len(check):
        out.append(tested_by(adjustment.block))
    outliers = sum(len(table[table["outlier"]]) for table in adjustment.residuals.values())
    if outliers:
        where = counted(outliers, "measurement")
        out.append(f"Look at {where} held to be wrong: image measurements are in outliers.csv")
    doubtful = _doubtful(adjustment)
    if doubtful and adjustment.camera["camera"].nunique() == 1:
        free = adjustment.camera.loc[adjustment.camera["sigma"] > 0, "parameter"]
        kept = ",".join(name for name in free if name not in {name for _, name in doubtful})
        named = ", ".join(name for _, name in doubtful)
        out.append(f"Leave out {named}, which may be zero: `--camera {kept or 'fixed'}`")
    return [f"{action}." for action in out[:_MOST_STEPS]]


def _compared(sigma0: float) -> str:
    percent = round(100 * (sigma0 - 1))
    if abs(percent) <= 5:
        return "as large as the stated standard deviations say"
    if percent > 100:
        return f"{sigma0:.1f} times as large as the stated standard deviations say"
    word = "larger" if percent > 0 else "smaller"
    return f"{abs(percent)} % {word} than the stated standard deviations say"


# --- the tables --------------------------------------------------------------------------------


def _observations(adjustment: Adjustment) -> Table:
    """Number, outliers and RMS of each kind of measurement, and that in its stated sigmas."""
    rows, gross = [], []
    for kind, found in adjustment.statistics.items():
        if not found.get("count"):
            continue
        counts = (f"{found['count']:,}", f"{found['outliers']:,}")
        rows.append((_KINDS[kind], *counts, _rms(kind, found["rms"]), fixed(found["sigma0"], 3)))
        if found.get("gross"):
            gross.append(f"{found['gross']:,} of {_KINDS[kind]}")
    bars = adjustment.distances
    if len(bars):
        sizes = (bars["v"] / bars["sigma"]).to_numpy()
        rms = f"{significant(math.sqrt(np.mean(bars['v'] ** 2)))} m"
        far = f"{int(is_outlier(np.abs(sizes)).sum()):,}"
        rows.append(("distances", f"{len(bars):,}", far, rms,
                     fixed(math.sqrt(np.mean(sizes**2)), 3)))  # fmt: skip
    notes = [
        f"all together: sigma naught {fixed(adjustment.sigma0, 4)}, "
        f"redundancy {adjustment.redundancy:,}"
    ]
    if gross:
        left_out = "the RMS of a line leaves out gross errors, beyond 15 robust sigmas"
        notes.insert(0, f"{left_out}: {', '.join(gross)}")
    correlated = adjustment.correlated_kinds
    if correlated:
        named = ", ".join(_KINDS[kind] for kind in correlated)
        notes.append(f"adjusted with the correlations of their coordinates: {named}")
    header = ("residuals", "count", "outliers", "RMS", "RMS / sigma")
    return Table("Observations", header, tuple(rows), "lrrlr", tuple(notes))


def _components(adjustment: Adjustment) -> Table | None:
    """Sigma naught of each kind and flight with its redundancy and its test."""
    frame = adjustment.variance_components
    if not adjustment.converged or len(frame) < 2:
        return None
    several = frame["flight"].nunique() > 2
    rows, beyond = [], []
    for row in frame.itertuples(index=False):
        name = " ".join(part for part in (_KINDS[row.kind], row.part) if part)
        if several and row.flight:
            name = f"{name}, {short(row.flight)}"
        rows.append((name, f"{row.count:,}", fixed(row.redundancy, 1), fixed(row.sigma0, 3),
                     significant(row.p)))  # fmt: skip
        if row.p < _IMPROBABLE and row.sigma0 > _LARGE:
            beyond.append(name)
    notes = ["sigma naught with the redundancy of the group; p: of one so far from 1 by chance"]
    if beyond:
        notes.append(f"larger than stated: {', '.join(beyond)}")
    header = ("variance component", "numbers", "redundancy", "sigma naught", "p")
    return Table("Variance components", header, tuple(rows), "lrrrr", tuple(notes))


def _reliability(adjustment: Adjustment) -> Table | None:
    """What could have hidden in each kind of measurement."""
    frame = adjustment.reliability.summary
    frame = frame[frame["largest_w"].notna()]
    if not adjustment.converged or not len(frame):
        return None
    rows = [
        (
            _KINDS[row.Index],
            fixed(row.mean, 2),
            fixed(row.least, 2),
            fixed(row.largest_w, 1),
            f"{significant(row.median_least_error)} {row.unit}",
            f"{significant(row.largest_least_error)} {row.unit}",
        )
        for row in frame.itertuples()
    ]
    beyond = f"{critical(ALPHA):.1f}"
    of_marks = f"{critical(ALPHA, adjustment.redundancy):.1f}"
    if "mark" in frame.index and of_marks != beyond:
        beyond += f" (marks: {of_marks})"
    notes = [
        "redundancy: share of an error that its residual shows; w: residual over its own sigma, "
        f"beyond {beyond} for one good measurement in a thousand; least error: the smallest that "
        "is found with a probability of 80 %",
        "each measurement, with its prediction by all others: reliability.csv",
        *_hidden(adjustment),
    ]
    header = ("kind", "redundancy", "least", "largest w", "least error", "worst")
    return Table("Reliability", header, tuple(rows), "lrrrrr", tuple(notes))


def _hidden(adjustment: Adjustment) -> list[str]:
    """What an error of control that is not found does at most, and where."""
    if not adjustment.reliability.whole or not len(adjustment.residuals["control"]):
        return []
    table = adjustment.reliability.external
    table = table[np.isfinite(table["least_error"]) & np.isfinite(table["moved"])]
    if not len(table):
        return []
    row = table.loc[table["moved"].idxmax()]
    return [
        f"an error of control that is not found moves no point by more than "
        f"{millimetres(row['moved'])}: {short(row['at'])}, where {short(row['point'])} is wrong "
        f"in {row['axis']} by {millimetres(row['least_error'])}"
    ]


def _points(adjustment: Adjustment) -> Table | None:
    """Angles of rays and correlations within points."""
    if not (adjustment.converged and adjustment.reliability.whole):
        return None
    table = adjustment.point_quality
    marks = adjustment.points["kind"].to_numpy() == "mark"
    rows = []
    for name, mine in (("tie points", ~marks), ("marks", marks)):
        part = table[mine & (table["rays"] > 1).to_numpy()]
        if not len(part):
            continue
        angle, correlation = part["angle"], part["correlation"]
        weak = part.loc[angle.idxmin()]
        rows.append(
            (
                name,
                f"{len(part):,}",
                fixed(part["rays"].mean(), 1),
                f"{angle.min():.1f} ({short(weak['point'], 12)})",
                fixed(angle.median(), 1),
                fixed(angle.max(), 1),
                f"{int((correlation > _STRONG).sum()):,}",
            )
        )
    notes = (
        "angle: the largest between two rays of a point, degrees; correlated: points of which two "
        f"coordinates are correlated above {_STRONG}",
    )
    header = ("points", "count", "rays", "least angle", "median", "largest", "correlated")
    return Table("Points", header, tuple(rows), "lrrrrrr", notes) if rows else None


def _distances(adjustment: Adjustment) -> Table | None:
    """Scale bars and tapes, with their tests."""
    frame = adjustment.distances
    if not len(frame):
        return None
    order = np.argsort(-frame["w"].abs().fillna(0.0).to_numpy(), kind="stable")[:_MOST_POINTS]
    rows = [
        (
            short(row["from"]),
            short(row["to"]),
            rounded(row["given"], row["sigma"])[0],
            significant(row["sigma"]),
            f"{1e3 * row['v']:.3g}",
            significant(row["s_adjusted"]),
            fixed(row["redundancy"], 2),
            fixed(row["w"], 1),
        )
        for _, row in frame.iloc[np.sort(order)].iterrows()
    ]
    notes = ["v: given minus adjusted; a redundancy of 0: nothing else shows this length"]
    if len(rows) < len(frame):
        notes.append(f"the {len(rows)} of {len(frame)} with the largest w")
    header = ("from", "to", "given m", "sigma m", "v mm", "adjusted +- m", "redundancy", "w")
    return Table("Distances", header, tuple(rows), "llrrrrrr", tuple(notes))


def _rms(kind: str, rms) -> str:
    """One number in px an axis, or three in metres or degrees."""
    if np.ndim(rms) == 0:
        return f"{fixed(rms, 3)} px an axis"
    if kind == "attitude":
        return "  ".join(fixed(value, 3) for value in rms) + " degrees (roll, pitch, yaw)"
    digits = metre_digits(rms)
    return "  ".join(fixed(value, digits) for value in rms) + " m (x, y, z)"


def _camera(adjustment: Adjustment) -> Table:
    """Interior parameters, and which of them may be zero."""
    frame = adjustment.camera
    several = frame["camera"].nunique() > 1
    rows = []
    for row in frame.itertuples(index=False):
        if row.sigma <= 0 and row.value == 0:
            continue  # a coefficient this camera does not have
        name = (short(row.camera),) if several else ()
        rows.append((*name, row.parameter, *rounded(row.value, row.sigma), row.unit))
    doubtful = [
        f"{short(camera)} {parameter}" if several else parameter
        for camera, parameter in _doubtful(adjustment)
    ]
    notes = ()
    if doubtful:
        verb = "differs" if len(doubtful) == 1 else "differ"
        notes = (f"{', '.join(doubtful)} {verb} from zero by less than two standard deviations",)
    if several:
        header = ("camera", "parameter", "value", "sigma", "unit")
        return Table("Cameras", header, tuple(rows), "llrrl", notes)
    title = f"Camera {short(frame['camera'].iloc[0])}"
    return Table(title, ("parameter", "value", "sigma", "unit"), tuple(rows), "lrrl", notes)


def _doubtful(adjustment: Adjustment) -> list[tuple[str, str]]:
    """Camera and parameter of the coefficients that may be zero."""
    rows = may_be_zero(adjustment)
    return list(zip(rows["camera"], rows["parameter"], strict=True))


def _effects(adjustment: Adjustment) -> Table | None:
    """Parameters of the effects that were estimated; many groups of one are summed up."""
    frame = adjustment.effects
    if not len(frame):
        return None
    rows, notes = [], []
    for (slug, parameter), part in frame.groupby(["slug", "parameter"], sort=False):
        slug = short(slug)
        known = part[["value", "sigma"]].to_numpy(float)
        factor, unit = scaled(str(part["unit"].iloc[0]), *known.ravel(), name=str(parameter))
        part = part.assign(value=factor * part["value"], sigma=factor * part["sigma"])
        if len(part) > _MOST_GROUPS_SHOWN:
            values, typical = part["value"], float(np.nanmedian(part["sigma"]))
            mean = rounded(values.mean(), typical)
            low, high = (rounded(value, typical)[0] for value in (values.min(), values.max()))
            rows.append((slug, parameter, f"{len(part):,} groups", *mean, unit, DASH))
            notes.append(
                f"{slug} {parameter}: mean of the groups and median of their sigmas; "
                f"values from {low} to {high} {unit}".rstrip()
            )
            continue
        for row in part.itertuples(index=False):
            found = rounded(row.value, row.sigma)
            ratio = abs(row.value) / row.sigma if row.sigma > 0 else math.nan
            rows.append((slug, parameter, short(row.group, 16), *found, unit, times(ratio)))
    notes += _readouts(adjustment)
    header = ("effect", "parameter", "of", "value", "sigma", "unit", "value/sigma")
    return Table("Effects", header, tuple(rows), "lllrrlr", tuple(notes))


def _readouts(adjustment: Adjustment) -> list[str]:
    """What block.toml states of a camera's readout beside what was estimated of it."""
    frame, cameras = adjustment.effects, adjustment.block.cameras
    notes = []
    for row in frame[frame["parameter"] == "readout"].itertuples(index=False):
        mine = [cameras[row.group]] if row.group in cameras else cameras.values()
        stated = {camera.readout_s for camera in mine} - {None}
        sources = {camera.extra.get("readout_from") for camera in mine} - {None}
        source = f" ({sources.pop()})" if len(sources) == 1 else ""
        if len(stated) == 1 and math.isfinite(row.sigma) and row.sigma > 0:
            value, sigma = rounded(1000 * row.value, 1000 * row.sigma)
            of = f" of {short(row.group, 16)}" if row.group in cameras else ""
            notes.append(
                f"readout{of}: stated {1000 * stated.pop():.1f} ms{source}, estimated {value} +- "
                f"{sigma} ms"
            )
    return notes


def _lever_arms(adjustment: Adjustment) -> Table | None:
    """From the camera to the GNSS antenna, flight by flight."""
    rows = []
    for row in adjustment.lever_arm.itertuples(index=False):
        axes = ((row.x, row.sx), (row.y, row.sy), (row.z, row.sz))
        found = [rounded(value, 0.0 if row.fixed else sigma) for value, sigma in axes]
        rows.append((short(row.flight), *found[0], *found[1], *found[2]))
    if not rows:
        return None
    header = ("flight", "x", "sigma", "y", "sigma", "z", "sigma")
    note = "metres, camera frame (x right, y down, z forward), camera to antenna"
    return Table("Lever arm of the GNSS antenna", header, tuple(rows), "lrrrrrr", (note,))


def _check_points(adjustment: Adjustment) -> Table | None:
    """The check points one by one, of many the largest."""
    frame = adjustment.check_points
    if not len(frame):
        return None
    differences = frame[_DIFFERENCES].to_numpy(dtype=float)
    numbers = 1e3 * np.hstack([differences, frame[_SIGMAS].to_numpy(float)])
    names, rays = frame["point"].to_numpy(object), frame["rays"].to_numpy()
    digits = _mm_digits(numbers)
    notes = [
        "mm, adjusted minus given; s_dx, s_dy, s_dz: standard deviations of the differences, the "
        "survey included"
    ]
    if len(frame) > _MOST_POINTS:
        size = np.linalg.norm(differences, axis=1)
        left_out = counted(len(frame) - _MOST_POINTS, "smaller one")
        notes.append(f"the {_MOST_POINTS} largest; {left_out} left out")
        largest = np.sort(np.argsort(-size, kind="stable")[:_MOST_POINTS])
        numbers, names, rays = numbers[largest], names[largest], rays[largest]
    rows = [
        (short(name), *(fixed(value, digits) for value in values), f"{seen:,}")
        for name, values, seen in zip(names, numbers, rays, strict=True)
    ]
    header = ("check point", "dx", "dy", "dz", "s_dx", "s_dy", "s_dz", "images")
    return Table("Check points", header, tuple(rows), "lrrrrrrr", tuple(notes))


def _mm_digits(numbers) -> int:
    """Decimals of differences in millimetres: none, unless all are below two of them."""
    return max(metre_digits(np.asarray(numbers) / 1e3) - 3, 0)


def _check_statistics(adjustment: Adjustment) -> Table | None:
    """RMS, mean and STD of all check points, in plan, height and space."""
    count = len(adjustment.check_points)
    if not count:
        return None
    digits = _mm_digits(1e3 * adjustment.check_points[_DIFFERENCES].to_numpy(float))
    rows = tuple(
        (name, *(fixed(1e3 * value, digits) for value in found))
        for name, found in zip(("RMS", "mean", "STD"), adjustment.check_statistics, strict=True)
    )
    title = f"{counted(count, 'check point')} together" if count > 1 else "The check point"
    note = "mm; RMS about zero, STD about the mean"
    return Table(title, ("", "xy", "z", "3D"), rows, "lrrr", (note,))


def _correlations(adjustment: Adjustment) -> Table | None:
    """Focal length and lever arm with the heights they can stand in for."""
    rows = tuple(
        (
            short(pair.a, 30),
            short(pair.b, 28),
            coefficient(pair.mean),
            fixed(pair.std, 3),
            significant(pair.sigma_a),
            significant(pair.sigma_b),
        )
        for pair in adjustment.correlations.itertuples()
    )
    if not rows:
        return None
    header = ("of", "with", "mean", "STD", "sigma of", "sigma with")
    note = "over all images or points the second name stands for; sigmas in px (f) and m"
    return Table("Correlations with position", header, rows, "llrrrr", (note,))


def _strong_correlations(adjustment: Adjustment) -> Table | None:
    """Parameters that can hardly be told apart, the strongest first."""
    pairs = adjustment.high_correlations.sort_values("value", key=lambda v: -v.abs(), kind="stable")
    names = list(adjustment.correlation_matrix)
    if not len(pairs):
        if len(names) < 2:
            return None
        note = f"none of the {len(names):,} parameters' correlations is above {_STRONG}"
        return Table("Strong correlations", notes=(note,))
    shown = pairs[:_MOST_PAIRS]
    rows = tuple(
        (short(pair.a, 38), short(pair.b, 38), coefficient(pair.value))
        for pair in shown.itertuples()
    )
    notes = [f"between parameters, above {_STRONG} in size"]
    if len(pairs) > len(shown):
        notes.append(f"{counted(len(pairs) - len(shown), 'further pair')} above it left out")
    header = ("of", "with", "correlation")
    return Table("Strong correlations", header, rows, "llr", tuple(notes))
