"""A first look at a block: what is there, how well it hangs together, what is missing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from corridor.block.tables import LAYOUTS, ROLES, SIGMAS, is_among
from corridor.geometry import rotation_from_quaternion
from corridor.report import Report, Table, counted

# A pose has six unknowns and a point gives two numbers; below this there is little to check it by.
FEW_OBSERVATIONS = 10
# Points that are seen in so many images or more stand in one line.
MANY_IMAGES = 10


@dataclass
class Summary:
    """Numbers of a first look; prints as text, shows itself as a table in a notebook.

    counts: how many of each thing.
    multiplicity: images a tie point -> number of tie points.
    observations_per_image: min, median, max of tie observations and marks, over all images.
    few: images with fewer than `FEW_OBSERVATIONS` observations, with their number.
    points_seen_once: names of tie points with a single observation.
    known: listed optional column -> share of its rows that are known (0 to 1).
    missing: files and optional columns that are absent or wholly unknown, such as
        `images.time_s`, `gnss` or `camera.readout_s`.
    untestable: what was handed in as `needs` and lacks a column -> the missing columns.
    extent: "cameras", "points", "ground", "GNSS" -> ((x, y, z) min, (x, y, z) max), m.
    gsd_m: median of depth / f over the observations, m; None without poses and points.
    cameras: one dict a camera: name, width, height, f, pixel_um, readout_s, calibrated, images.
    notes: one sentence each.
    """

    name: str
    counts: dict[str, int]
    multiplicity: dict[int, int]
    observations_per_image: dict[str, float]
    few: dict[str, int]
    points_seen_once: list[str]
    known: dict[str, float]
    missing: list[str]
    untestable: dict[str, list[str]]
    extent: dict[str, tuple[list[float], list[float]]]
    gsd_m: float | None
    cameras: list[dict]
    notes: list[str] = field(default_factory=list)

    def to_dict(self) -> dict:
        """Plain numbers and text, as JSON takes them."""
        return {
            "name": self.name,
            "counts": self.counts,
            "multiplicity": {str(rays): count for rays, count in self.multiplicity.items()},
            "observations_per_image": self.observations_per_image,
            "images_with_few_observations": self.few,
            "points_seen_once": len(self.points_seen_once),
            "known": self.known,
            "missing": self.missing,
            "untestable": self.untestable,
            "extent": {
                what: {"min": low, "max": high} for what, (low, high) in self.extent.items()
            },
            "gsd_m": self.gsd_m,
            "cameras": self.cameras,
            "notes": self.notes,
        }

    def report(self) -> Report:
        """The first look as tables."""
        sections = (
            ("Contents", self._contents()),
            ("Images a tie point is seen in", self._multiplicity()),
            ("Cameras", self._cameras()),
            ("Extent", self._extent()),
            ("Not in this block", self._absent()),
        )
        tables = [Table(title, (), tuple(rows), "lrl") for title, rows in sections if rows]
        if self.notes:
            tables.append(Table("Notes", notes=tuple(self.notes)))
        return Report(f"Block {self.name}", f"Block {self.name}", (), tables)

    def __str__(self) -> str:
        return str(self.report())

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return self.report().html()

    def _contents(self) -> list[tuple[str, str, str]]:
        count, rays = self.counts, self.observations_per_image
        rows = [
            (
                "images",
                f"{count['images']:,}",
                f"{counted(count['flights'], 'flight')}, {counted(count['cameras'], 'camera')}, "
                f"{count['images_with_pose']:,} with a start pose",
            ),
            (
                "observations an image",
                f"{rays['median']:,.0f}",
                f"median; {rays['min']:,.0f} to {rays['max']:,.0f}",
            ),
            (
                "tie points",
                f"{count['tie_points']:,}",
                f"{counted(count['tie_observations'], 'observation')}, "
                f"{count['tie_points_with_start']:,} points with start coordinates",
            ),
        ]
        if count["ground_points"] or count["marks"]:
            roles = ", ".join(f"{count[role]:,} {role}" for role in ROLES if count[role])
            rows.append(
                (
                    "ground points",
                    f"{count['ground_points']:,}",
                    f"{roles + '; ' if roles else ''}{counted(count['marks'], 'mark')} in images",
                )
            )
        for key, label, remark in (
            ("gnss", "GNSS positions", "antenna at exposure"),
            ("track", "GNSS track", "epochs of the receiver"),
            ("rates", "angular rates", "epochs of the gyroscope"),
        ):
            if count[key]:
                rows.append((label, f"{count[key]:,}", remark))
        return rows

    def _multiplicity(self) -> list[tuple[str, str, str]]:
        total = sum(self.multiplicity.values())
        rows: dict[str, int] = {}
        for rays, count in self.multiplicity.items():
            label = str(rays) if rays < MANY_IMAGES else f"{MANY_IMAGES} and more"
            rows[label] = rows.get(label, 0) + count
        most = max([*rows.values(), 1])
        return [
            (label, f"{count:,}", f"{count / total:6.1%}  {'#' * round(30 * count / most)}")
            for label, count in rows.items()
        ]

    def _cameras(self) -> list[tuple[str, str, str]]:
        rows = []
        for camera in self.cameras:
            focal = f"f {camera['f']:.1f} px"
            if camera["pixel_um"] is not None:
                focal += f" ({camera['f'] * camera['pixel_um'] / 1000:.2f} mm)"
            readout = camera["readout_s"]
            shutter = "unknown" if readout is None else f"{readout * 1000:.2f} ms"
            use = "calibrated" if camera["calibrated"] else "start values"
            rows.append(
                (
                    camera["name"],
                    f"{camera['width']} x {camera['height']} px",
                    f"{focal}, {use}, readout {shutter}, {counted(camera['images'], 'image')}",
                )
            )
        return rows

    def _extent(self) -> list[tuple[str, str, str]]:
        rows = []
        for what, (low, high) in self.extent.items():
            size = [top - bottom for bottom, top in zip(low, high, strict=True)]
            rows.append(
                (
                    what,
                    f"{size[0]:,.1f} x {size[1]:,.1f} m",
                    f"height {low[2]:,.1f} to {high[2]:,.1f} m",
                )
            )
        if self.gsd_m is not None:
            size = f"{self.gsd_m * 1000:.2f} mm" if self.gsd_m < 1 else f"{self.gsd_m:.2f} m"
            rows.append(("ground pixel", size, "median of depth / f"))
        return rows

    def _absent(self) -> list[tuple[str, str, str]]:
        by_column: dict[str, list[str]] = {column: [] for column in self.missing}
        for what, columns in self.untestable.items():
            for column in columns:
                by_column.setdefault(column, []).append(what)
        if not self.untestable:
            tables = [column for column in self.missing if "." not in column]
            grouped: dict[str, list[str]] = {"tables": tables} if tables else {}
            for column in self.missing:
                table, _, name = column.partition(".")
                if name:
                    grouped.setdefault(table, []).append(name)
            return [(table, "", ", ".join(names)) for table, names in grouped.items()]
        return [
            (column, "", f"cannot be tested: {', '.join(what)}" if what else "")
            for column, what in by_column.items()
        ]


def summarise(block, needs: Mapping[str, Iterable[str]]) -> Summary:
    """Summary of a Block; see `Block.summary`."""
    rays = pd.Series(np.bincount(_codes(block.tie_points), minlength=1))
    rays = rays[rays > 0]
    multiplicity = rays.value_counts().sort_index()
    rows = np.concatenate([block.image_rows("tie_points"), block.image_rows("marks")])
    per_image = np.bincount(rows[rows >= 0], minlength=len(block.images))
    few = np.flatnonzero(per_image < FEW_OBSERVATIONS)
    once = block.tie_points["point"].dtype.categories[rays.index[rays == 1]]
    pose = block.poses
    posed = ~np.isnan(pose).any(axis=1)
    start = block.points.dropna(subset=["x", "y", "z"])
    known, missing = _columns(block)
    lacking = {
        what: [column for column in columns if not block.has(column)]
        for what, columns in needs.items()
    }
    corners = {
        "cameras": pose[posed, :3],
        "points": start[["x", "y", "z"]].to_numpy(),
        "ground": block.ground[["x", "y", "z"]].to_numpy(),
        "GNSS": block.gnss[["x", "y", "z"]].to_numpy(),
    }
    summary = Summary(
        name=block.name,
        counts=_counts(block, len(rays), int(posed.sum()), start),
        multiplicity={int(seen): int(count) for seen, count in multiplicity.items()},
        observations_per_image={
            "min": float(per_image.min()),
            "median": float(np.median(per_image)),
            "max": float(per_image.max()),
        },
        few={block.images["image"].iloc[row]: int(per_image[row]) for row in few},
        points_seen_once=[str(name) for name in once],
        known=known,
        missing=missing,
        untestable={what: columns for what, columns in lacking.items() if columns},
        extent={
            what: (xyz.min(axis=0).tolist(), xyz.max(axis=0).tolist())
            for what, xyz in corners.items()
            if len(xyz)
        },
        gsd_m=_ground_pixel(block, pose),
        cameras=_camera_facts(block),
    )
    summary.notes = _notes(block, summary)
    return summary


def _columns(block) -> tuple[dict[str, float], list[str]]:
    """Known share of each optional column that is there; tables and columns that are not."""
    known, missing = {}, []
    for table, layout in LAYOUTS.items():
        frame = getattr(block, table)
        if not len(frame):
            missing.append(table)
            continue
        for name in layout.optional:
            if block.has(f"{table}.{name}"):
                known[f"{table}.{name}"] = float(frame[name].notna().mean())
            elif name not in ("sigma", *SIGMAS):  # these have defaults
                missing.append(f"{table}.{name}")
    if not block.has("camera.readout_s"):
        missing.append("camera.readout_s")
    return known, missing


def _counts(block, tie_points: int, posed: int, start: pd.DataFrame) -> dict[str, int]:
    observed = block.tie_points["point"].dtype.categories
    return {
        "images": len(block.images),
        "flights": len(block.flight_names),
        "cameras": len(block.cameras),
        "images_with_pose": posed,
        "tie_points": tie_points,
        "tie_observations": len(block.tie_points),
        "tie_points_with_start": int(is_among(start["point"], observed).sum()),
        "marks": len(block.marks),
        "ground_points": len(block.ground),
        **{role: int((block.ground["role"] == role).sum()) for role in ROLES},
        **{table: len(getattr(block, table)) for table in ("gnss", "track", "rates")},
    }


def _camera_facts(block) -> list[dict]:
    users = block.images["camera"].value_counts()
    return [
        {
            "name": camera.name,
            "width": camera.width,
            "height": camera.height,
            "f": camera["f"],
            "pixel_um": camera.pixel_um,
            "readout_s": camera.readout_s,
            "calibrated": camera.calibrated,
            "images": int(users.get(camera.name, 0)),
        }
        for camera in block.cameras.values()
    ]


def _codes(observations: pd.DataFrame) -> np.ndarray:
    return observations["point"].array.codes


def _ground_pixel(block, pose: np.ndarray) -> float | None:
    """Median of depth / f over the observations of points with coordinates, in posed images."""
    coordinates = pd.concat([block.points, block.ground])[["point", "x", "y", "z"]]
    coordinates = coordinates.dropna().drop_duplicates("point").set_index("point")
    sizes = []
    rotation = rotation_from_quaternion(np.where(np.isnan(pose[:, 3:]), 0.5, pose[:, 3:]))
    focal = block.images["camera"].map({n: camera["f"] for n, camera in block.cameras.items()})
    focal = focal.to_numpy(dtype=float)
    for table in ("tie_points", "marks"):
        names = getattr(block, table)["point"].dtype.categories
        xyz = coordinates.reindex(names).to_numpy()[_codes(getattr(block, table))]
        image = block.image_rows(table)
        depth = np.einsum("nj,nj->n", rotation[image, 2], xyz - pose[image, :3])
        sizes.append(depth / focal[image])
    size = np.concatenate(sizes)
    size = size[size > 0]
    return float(np.median(size)) if len(size) else None


def _notes(block, summary: Summary) -> list[str]:
    marks = block.marks["point"].value_counts()
    rays = block.ground["point"].map(marks.to_dict()).fillna(0).to_numpy(dtype=float)
    used = (block.ground["role"] != "unused").to_numpy()
    point = ("control or check point is", "control or check points are")
    notes = []
    if summary.few:
        shown = ", ".join(f"{image} ({n})" for image, n in list(summary.few.items())[:5])
        more = ", ..." if len(summary.few) > 5 else ""
        few = counted(len(summary.few), "image")
        notes.append(f"{few} with fewer than {FEW_OBSERVATIONS} observations: {shown}{more}.")
    for count, one, many, what in (
        (
            len(summary.points_seen_once),
            "tie point is seen in one image only and tells",
            "tie points are seen in one image only and tell",
            "nothing",
        ),
        (int((used & (rays == 0)).sum()), *point, "not measured in any image"),
        (int((used & (rays == 1)).sum()), *point, "measured in one image only"),
        (
            _outside(block),
            "observation lies outside its",
            "observations lie outside their",
            "picture",
        ),
    ):
        if count:
            notes.append(f"{counted(count, one, many)} {what}.")
    flights = set(block.flight_names)
    for table in ("track", "rates"):
        frame = getattr(block, table)
        if "flight" in frame:
            for flight in sorted(set(frame["flight"].dropna()) - flights):
                notes.append(f"{table} has flight {flight}, of which there are no images.")
    if not summary.counts["control"] and not summary.counts["gnss"]:
        if summary.counts["track"]:
            notes.append("Antenna positions are to be interpolated from the track.")
        else:
            notes.append("No control and no GNSS: a free network, without scale and datum.")
    return notes


def _outside(block) -> int:
    size = {name: (camera.width, camera.height) for name, camera in block.cameras.items()}
    limits = np.array([size[name] for name in block.images["camera"]], dtype=float) - 0.5
    count = 0
    for table in ("tie_points", "marks"):
        frame = getattr(block, table)
        pixels = frame[["x", "y"]].to_numpy()
        limit = limits[block.image_rows(table)]
        count += int(((pixels < -0.5) | (pixels > limit)).any(axis=1).sum())
    return count
