"""A first look at a block: what is there, how well it hangs together, what is missing."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from corridor.core.block.correlation import RHO
from corridor.core.block.tables import LAYOUTS, ROLES, SIGMAS, is_among
from corridor.core.errors import some
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.output import Report, Table, counted

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
        told = dict(vars(self))
        told["multiplicity"] = {str(rays): count for rays, count in self.multiplicity.items()}
        told["images_with_few_observations"] = told.pop("few")
        told["points_seen_once"] = len(self.points_seen_once)
        told["extent"] = {
            what: {"min": low, "max": high} for what, (low, high) in self.extent.items()
        }
        return told

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
        images = (
            f"{counted(count['flights'], 'flight')}, {counted(count['cameras'], 'camera')}, "
            f"{count['images_with_pose']:,} with a start pose"
        )
        ties = (
            f"{counted(count['tie_observations'], 'observation')}, "
            f"{count['tie_points_with_start']:,} points with start coordinates"
        )
        roles = ", ".join(f"{count[role]:,} {role}" for role in ROLES if count[role])
        ground = f"{roles + '; ' if roles else ''}{counted(count['marks'], 'mark')} in images"
        share = f"median; {rays['min']:,.0f} to {rays['max']:,.0f}"
        rows = [
            ("images", count["images"], images, True),
            ("observations an image", rays["median"], share, True),
            ("tie points", count["tie_points"], ties, True),
            ("ground points", count["ground_points"], ground, count["marks"]),
            ("GNSS positions", count["gnss"], "antenna at exposure", False),
            ("distances", count["distances"], "scale bars and tapes between points", False),
            ("attitudes", count["attitudes"], "camera or body at exposure", False),
            ("GNSS track", count["track"], "epochs of the receiver", False),
            ("angular rates", count["rates"], "epochs of the gyroscope", False),
        ]
        return [(what, f"{n:,.0f}", told) for what, n, told, anyway in rows if n or anyway]

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
            told = f"{focal}, {use}, readout {shutter}, {counted(camera['images'], 'image')}"
            rows.append((camera["name"], f"{camera['width']} x {camera['height']} px", told))
        return rows

    def _extent(self) -> list[tuple[str, str, str]]:
        rows = []
        for what, (low, high) in self.extent.items():
            x, y, _ = (top - bottom for bottom, top in zip(low, high, strict=True))
            height = f"height {low[2]:,.1f} to {high[2]:,.1f} m"
            rows.append((what, f"{x:,.1f} x {y:,.1f} m", height))
        if self.gsd_m is not None:
            size = f"{self.gsd_m * 1000:.2f} mm" if self.gsd_m < 1 else f"{self.gsd_m:.2f} m"
            rows.append(("ground pixel", size, "median of depth / f"))
        return rows

    def _absent(self) -> list[tuple[str, str, str]]:
        told: dict[str, list[str]] = {column: [] for column in self.missing}
        for what, columns in self.untestable.items():
            for column in columns:
                told.setdefault(column, []).append(what)
        if self.untestable:
            said = {column: f"cannot be tested: {', '.join(w)}" for column, w in told.items() if w}
            return [(column, "", said.get(column, "")) for column in told]
        grouped: dict[str, list[str]] = {}
        for column in sorted(self.missing, key=lambda column: "." in column):
            table, _, name = column.partition(".")
            grouped.setdefault(table if name else "tables", []).append(name or table)
        return [(table, "", ", ".join(names)) for table, names in grouped.items()]


def summarise(block, needs: Mapping[str, Iterable[str]]) -> Summary:
    """Summary of a Block; see `Block.summary`."""
    rays = pd.Series(np.bincount(block.tie_points["point"].array.codes, minlength=1))
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
            # These have defaults; attitudes have one of several forms.
            elif name not in ("sigma", *SIGMAS, *RHO) and table != "attitudes":
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
        **{
            table: len(getattr(block, table))
            for table in ("gnss", "attitudes", "track", "rates", "distances")
        },
    }


def _camera_facts(block) -> list[dict]:
    users = block.images["camera"].value_counts()
    facts = ("name", "width", "height", "pixel_um", "readout_s", "calibrated")
    return [
        {fact: getattr(camera, fact) for fact in facts}
        | {"f": camera["f"], "images": int(users.get(camera.name, 0))}
        for camera in block.cameras.values()
    ]


def _ground_pixel(block, pose: np.ndarray) -> float | None:
    """Median of depth / f over the observations of points with coordinates, in posed images."""
    sizes = []
    view = rotation_from_quaternion(pose[:, 3:])[:, 2]
    focal = np.array([camera["f"] for camera in block.cameras.values()])[block.image_camera]
    for table in ("tie_points", "marks"):
        point, image = getattr(block, table)["point"].array.codes, block.image_rows(table)
        away = block.positions(table)[point] - pose[image, :3]
        sizes.append(np.einsum("nj,nj->n", view[image], away) / focal[image])
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
        shown = some([f"{image} ({n})" for image, n in summary.few.items()], 5)
        few = counted(len(summary.few), "image")
        notes.append(f"{few} with fewer than {FEW_OBSERVATIONS} observations: {shown}.")
    for count, one, many, what in (
        (
            len(summary.points_seen_once),
            "tie point is seen in one image only and determines",
            "tie points are seen in one image only and determine",
            "nothing",
        ),
        (int((used & (rays == 0)).sum()), *point, "not measured in any image"),
        (int((used & (rays == 1)).sum()), *point, "measured in one image only"),
        (
            int(sum(block.outside(table).sum() for table in ("tie_points", "marks"))),
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
