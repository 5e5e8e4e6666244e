"""A change as text, page and folder, and as files of a GIS and of programs of point clouds."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import registry
from corridor.core.adjustment import grave
from corridor.core.errors import InputError
from corridor.core.gnss import in_world, local_of, world_crs
from corridor.core.output import (
    Layer,
    Report,
    Table,
    files_in,
    significant,
    times,
    whole_folder,
    write_csv,
    write_geopackage,
    write_json,
    write_las,
    write_picture,
)
from corridor.tools.change.explanation import Explanation
from corridor.tools.change.points import PointChanges
from corridor.tools.change.raster import on_north_grid, write_geotiff
from corridor.tools.change.sentence import lower, millimetres, remedies, verdict_sentence
from corridor.tools.change.signature import SHOWN_LOG_EVIDENCE
from corridor.tools.change.surface import SurfaceChange, Volume

RESULT = "change.json"
# Student's limit of 95 % with ten degrees of freedom: below that a scale is told by few numbers.
STUDENT_95_OF_10 = 2.23
_VERDICTS = {
    "moved": "the ground moved",
    "camera": "the camera explains it",
    "undecided": "cannot be told apart",
    "nothing": "no change",
    "unfit": "cannot be told",
    "cover": "what covers the ground changed",
}


def of_change(change) -> Report:
    """The report of a `Change`: one sentence first."""
    said = verdict_sentence(change)
    notes = (note for note in change.notes if note not in said)
    warnings = [*remedies(change), *notes, *_datum(change), *_adjusted(change)]
    tables = []
    if change.points is not None:
        tables.append(_points(change.points))
    if change.surface is not None:
        tables.append(_surface(change.surface))
    if change.explanation is not None and len(change.explanation.table):
        tables.append(_effects(change.explanation))
    if change.volumes:
        tables.append(_volumes(change.volumes))
    title = f"Change from {change.names[0]} to {change.names[1]}"
    return Report(title, said, warnings, tables)


def to_dict(change) -> dict:
    """Every number of a change that is not of a map."""
    surface, points, told = change.surface, change.points, change.explanation
    out = {
        "before": change.names[0],
        "after": change.names[1],
        "verdict": change.verdict,
        "verdict_in_words": verdict_in_words(change),
        "sentence": verdict_sentence(change),
        "remedies": remedies(change),
        "objections": [vars(one) for one in change.objections],
        "patches": [
            {name: value for name, value in vars(one).items() if name not in ("rows", "weight")}
            for one in change.final.patches
        ],
        "level": change.asked.level,
        "common": list(change.asked.common),
        "datum": change.asked.datum,
        "together": change.asked.together,
        "notes": list(change.notes),
        "doubts": _adjusted(change),
    }
    if points is not None:
        out["points"] = points.frame.to_dict("records")
        out["congruency"] = vars(points.overall)
    if surface is not None:
        out["surface"] = {
            "core_points": len(surface),
            "significant": int(surface.moved.sum()),
            "sigma_median": float(np.median(surface.sigma)),
            "detection_95_median": float(np.median(surface.detection)),
            "radius": surface.cores.radius,
            "spacing": surface.cores.spacing,
        }
    if told is not None:
        out["explanation"] = {
            "as_adjusted": vars(told.as_adjusted),
            "all_modelled": vars(told.all_modelled),
            "shown_modelled": vars(told.shown_modelled),
            "shown": [sorted(slugs) for slugs in told.shown],
            "effects": told.table.to_dict("records"),
        }
    out["volumes"] = {
        name: vars(one) | {"total": one.total} for name, one in change.volumes.items()
    }
    if change.gained is not None:
        out["gained"] = {"sigma_apart": change.gained[0], "sigma_together": change.gained[1]}
    return out


def verdict_in_words(change) -> str:
    """Of the surface alone nobody says that it is the ground."""
    points = change.points
    if change.verdict == "moved" and (points is None or not points.moved.any()):
        return "the surface moved"
    return _VERDICTS[change.verdict]


def save(change, folder: str | os.PathLike, gis: bool = True) -> list[Path]:
    """Writes report.html, change.json, points.csv, surface.csv and pictures, whole or not at all.

    gis: also change.gpkg (pyogrio), change.tif (rasterio) and change.las (laspy), where these are
    installed.
    Raises InputError where `folder` holds something else.
    """
    folder = Path(folder)
    with whole_folder(folder, RESULT) as part:
        pictures = []
        for name, (drawn, caption) in registry.room("figures").of_change(change).items():
            pictures.append((name, caption, write_picture(drawn, part / f"{name}.png")))
        page = of_change(change).page(pictures)
        (part / "report.html").write_text(page, encoding="utf-8", newline="\n")
        if change.points is not None:
            write_csv(change.points.frame, part / "points.csv")
        if change.surface is not None:
            write_csv(change.surface.frame, part / "surface.csv")
        missing = _write_gis(change, part) if gis else []
        listed = sorted([RESULT, *files_in(part)])
        write_json(to_dict(change) | {"not_written": missing, "files": listed}, part / RESULT)
        names = sorted(path.name for path in part.iterdir())
    return [folder / name for name in names]


def _write_gis(change, folder: Path) -> list[str]:
    """Writes change.gpkg (points, cells), change.tif and change.las into a folder; a sentence on
    each that could not be."""
    block, points, surface = change.compared.adjustments[0].block, change.points, change.surface
    layers, missing = {}, []
    if points is not None:
        layers["points"] = Layer(points.frame, in_world(block, points.xyz))
    if surface is not None:
        # The square around each core point, closed, at its height.
        plan = surface.cores.cells[:, [0, 1, 2, 3, 0]]
        height = np.broadcast_to(surface.cores.xyz[:, None, 2:], (len(plan), 5, 1))
        corners = in_world(block, np.concatenate([plan, height], axis=2))
        layers["cells"] = Layer(surface.frame, list(corners), "Polygon Z")
        fields = {
            "change": surface.distance,
            "sigma": surface.sigma,
            "sampling": surface.sampling,
            "detection_95": surface.detection,
            "significant": surface.moved.astype(np.int32),
        }
        places = in_world(block, surface.cores.xyz)
        missing += _tried(write_las, folder / "change.las", places, fields, world_crs(block))
        bands = {"change": surface.distance, "sigma": surface.total}
        bands["detection_95"] = surface.detection
        spacing = surface.cores.spacing
        plan = places[:, :2]
        if local_of(block) is not None:
            # Cells lie along the axes of the local frame, pixels along those of the map's grid.
            plan, row = on_north_grid(plan, spacing)
            bands = {name: values[row] for name, values in bands.items()}
        tif = folder / "change.tif"
        missing += _tried(write_geotiff, tif, plan, spacing, bands, world_crs(block))
    if layers:
        missing += _tried(write_geopackage, folder / "change.gpkg", layers, world_crs(block))
    return missing


def _tried(write: Callable, *arguments) -> list[str]:
    """A sentence where it could not be written."""
    try:
        write(*arguments)
    except InputError as error:
        return [str(error)]
    return []


def _points(points: PointChanges) -> Table:
    rows = [
        {
            "point": str(row.point),
            "dx": millimetres(row.dx, row.sx),
            "dy": millimetres(row.dy, row.sy),
            "dz": millimetres(row.dz, row.sz),
            "probability": "" if np.isnan(row.probability) else _chance(row.probability),
            "verdict": row.verdict,
        }
        for row in points.frame.itertuples()
    ]
    overall = points.overall
    notes = [
        f"All together: {overall.statistic:.1f} with {overall.freedom} independent numbers, "
        f"probability {_chance(overall.probability)} were nothing moved."
    ]
    if points.undecided is not None and points.undecided.any():
        notes.append(
            "undecided: beyond its own noise, but among all points and the whole surface one so "
            "large comes by chance, effects of camera and flight can make it, or nothing else says "
            "the same."
        )
    return Table.of(pd.DataFrame(rows), "Points, second date minus first", notes)


def _surface(surface: SurfaceChange) -> Table:
    low, high = np.percentile(surface.distance, [5, 95])
    rows = [
        ("core points", f"{len(surface):,}"),
        ("of them significant", f"{surface.moved.sum():,}"),
        ("change, 5 and 95 %", f"{1000 * low:.0f} to {1000 * high:.0f} mm"),
        *_accuracy(surface),
    ]
    frame = pd.DataFrame(rows, columns=["what", "value"])
    title = "Surface, second date minus first along the normal"
    return Table.of(frame, title, [lower(surface)])


def _accuracy(surface: SurfaceChange) -> list[tuple[str, str]]:
    """What is known of a surface before any change is asked for."""
    return [
        ("sigma of the measurements, median", f"{1000 * np.median(surface.sigma):.1f} mm"),
        ("sampling of rough ground, median", f"{1000 * np.median(surface.sampling):.1f} mm"),
        ("level of detection (95 %), median", f"{1000 * np.median(surface.detection):.0f} mm"),
        ("points in a cylinder, median", f"{np.median(surface.count):.0f}"),
        ("radius of the cylinder", f"{surface.cores.radius:.2f} m"),
    ]


def _effects(told: Explanation, most: int = 8) -> Table:
    table = told.table.sort_values(["hides", "explained"], ascending=False, kind="stable")
    rows = [
        {
            "epoch": row.epoch,
            "effect": row.effect,
            "shown": "yes" if row.log_evidence > SHOWN_LOG_EVIDENCE else "no",
            "shape": f"{100 * row.shape_share:.0f} %",
            "explains": f"{100 * row.explained:.0f} %",
            "likely": _chance(row.probability),
            "could hide it": "yes" if row.hides else "no",
        }
        for row in table.head(most).itertuples()
    ]
    notes = [
        "shown: by the measurements of that epoch alone. shape: share of the change that has the "
        "effect's shape on the ground, whatever its size. explains: with the size that the epoch "
        "says. likely: probability against motion of the ground in patches."
    ]
    return Table.of(pd.DataFrame(rows), "What effects could do to the ground", notes)


def _volumes(volumes: Mapping[str, Volume]) -> Table:
    rows = [
        {
            "polygon": name,
            "volume": f"{one.value:.2f} \u00b1 {one.total:.2f} m\u00b3",
            "of it measurements": f"{one.sigma:.2f} m\u00b3",
            "were cells independent": f"{one.independent:.2f} m\u00b3",
            "area": f"{one.area:.0f} m\u00b2",
            "covered": f"{100 * one.share:.0f} %",
        }
        for name, one in volumes.items()
    ]
    return Table.of(pd.DataFrame(rows), "Volumes, second date minus first")


def _datum(change) -> list[str]:
    out, asked, surface = [], change.asked, change.surface
    if asked.datum == "stable":
        registration = None if surface is None else surface.registration
        carried = (
            ""
            if registration is None
            else f" ({100 * registration.stable.mean():.0f} % of the surface)"
        )
        out.append(
            f"Both dates are aligned on what stands still{carried} by a "
            f"{asked.motion} motion: a motion of the whole block cannot be seen."
        )
        if registration is not None and registration.scale >= 1.05:
            one = "One adjustment of both dates with one camera (--together --same-camera), or "
            less = "Control" if asked.together and asked.same_camera else f"{one}control,"
            out.append(
                f"What stands still scatters {times(registration.scale)} times as much as its "
                "standard deviations say, by errors that the adjustments do not know; those of the "
                f"surface are multiplied by it. {less} would lessen them."
            )
        limit = 0.0 if surface is None else float(np.median(surface.detection / surface.total))
        if limit > STUDENT_95_OF_10:
            out.append(
                "What stands still shows how far to trust the standard deviations, and few parts "
                f"of it are independent: a change counts (95 %) from {times(limit)} times "
                "its sigma on."
            )
    if change.gained is not None:
        apart, one = (1000 * g for g in change.gained)
        out.append(
            f"One adjustment of both dates: the median sigma of the surface is {one:.1f} mm in "
            f"place of {apart:.1f} mm."
        )
    return out


def _adjusted(change, most: int = 3) -> list[str]:
    """What is doubtful about the adjustments that the change rests on, the gravest of each."""
    found: dict[str, list[str]] = {}
    dates = ("First date", "Second date") if not change.asked.together else ("Both dates",)
    for date, one in zip(dates, change.final.adjustments, strict=False):
        for sentence in [*one.doubts, *one.notes, *grave(one)[:most]]:
            found.setdefault(sentence, []).append(date)
    both = {2: "Both dates"}
    return [f"{both.get(len(of), of[0])}: {sentence}" for sentence, of in found.items()]


def detection_report(surface: SurfaceChange) -> Report:
    """What could be seen at one date's accuracy, in words."""
    table = detection_table(surface)
    return Report(table.title, table.notes[0], [], [replace(table, notes=())])


def detection_table(surface: SurfaceChange) -> Table:
    """The same for a report of something else: the sentence is the table's note."""
    low, middle, high = 1000 * np.percentile(surface.detection, [5, 50, 95])
    share = 100 * np.mean(surface.detection <= 0.01)
    said = (
        f"Two such flights would show a change of {middle:.0f} mm in half of the surface (95 %; "
        f"{low:.0f} to {high:.0f} mm from best to worst); one of 10 mm in {share:.0f} % of it."
    )
    said += f" {lower(surface)}"
    rows = [("core points", f"{len(surface):,}"), *_accuracy(surface)]
    frame = pd.DataFrame(rows, columns=["what", "value"])
    return Table.of(frame, "Level of detection", [said])


def _chance(probability: float) -> str:
    """A probability to two digits; far below what any test tells apart it is only said so."""
    return "below 1e-9" if probability < 1e-9 else significant(probability)
