"""A result saved into a folder, whole or not at all."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from corridor.adjustment.report.dictionary import as_dict, effect_table, has_table
from corridor.adjustment.report.page import as_page
from corridor.block import whole_folder

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_RESULT = "adjustment.json"


def save(
    adjustment: Adjustment,
    folder: str | os.PathLike,
    pictures: Mapping[str, Any] | None = None,
    captions: Mapping[str, str] | None = None,
) -> list[Path]:
    """Writes the result into `folder`, whole or not at all; returns the paths, sorted.

    adjustment.json, report.html (one page, pictures inside), block/ (the adjusted block), one
    PNG for each picture, check_points.csv, poses.csv, outliers.csv (image measurements held to be
    wrong) and effect_SLUG.csv for an effect of more than 50 groups.
    pictures: matplotlib figures by name; captions: one sentence for each, for the page.
    An earlier result in `folder` is replaced; what else lies there stays. Raises InputError where
    `folder` is a file, or holds something but no earlier result.
    """
    folder = Path(folder)
    earlier = _earlier(folder)
    with whole_folder(folder, _RESULT, lambda name: name in earlier) as part:
        _write(adjustment, part, pictures or {}, captions or {})
        written = _files(part)
    return [folder / name for name in written]


def _earlier(folder: Path) -> set[str]:
    """Entries of `folder` that an earlier adjustment wrote, as its own list has them."""
    try:
        files = json.loads((folder / _RESULT).read_text(encoding="utf-8"))["files"]
        return {_RESULT, *(str(name).split("/")[0] for name in files)}
    except (OSError, ValueError, KeyError, TypeError):
        return {_RESULT}


def _write(
    adjustment: Adjustment, folder: Path, pictures: Mapping[str, Any], captions: Mapping[str, str]
) -> None:
    adjustment.block.write(folder / "block")
    shown = []
    for name, figure in pictures.items():
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=144, metadata={"Software": None})
        (folder / f"{name}.png").write_bytes(stream.getvalue())
        shown.append((name.replace("_", " "), captions.get(name, ""), stream.getvalue()))
    (folder / "report.html").write_text(as_page(adjustment, shown), encoding="utf-8")
    if len(adjustment.check_points):
        _write_csv(adjustment.check_points, folder / "check_points.csv")
    _write_csv(adjustment.poses, folder / "poses.csv")
    outliers = _outliers(adjustment)
    if len(outliers):
        _write_csv(outliers, folder / "outliers.csv")
    for slug, effect in adjustment.effects.groupby("slug", sort=False):
        if has_table(effect):
            _write_csv(effect.drop(columns="slug"), folder / effect_table(str(slug)))
    content = as_dict(adjustment)
    content["pictures"] = [f"{name}.png" for name in pictures]
    content["files"] = sorted([_RESULT, *_files(folder)])
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / _RESULT).write_text(text + "\n", encoding="utf-8")


def _outliers(adjustment: Adjustment) -> pd.DataFrame:
    """Image measurements flagged as outlier, largest first."""
    columns = ["point", "image", "x", "y", "vx", "vy", "sigma"]
    parts = []
    for kind in ("tie", "mark"):
        table = adjustment.residuals[kind]
        part = table.loc[table["outlier"], columns].astype({"point": str, "image": str})
        parts.append(part.assign(kind=kind))
    every = pd.concat(parts, ignore_index=True)
    size = np.hypot(every["vx"], every["vy"]) / every["sigma"]
    return every.iloc[np.argsort(-size.to_numpy(), kind="stable")]


def _write_csv(frame: pd.DataFrame, path: Path) -> None:
    frame.to_csv(path, index=False, float_format="%.10g", lineterminator="\n")


def _files(folder: Path) -> list[str]:
    """Every file below a folder, relative, with forward slashes, sorted."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
