"""An adjustment for a GIS and for programs of point clouds."""

from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.adjustment import Adjustment
from corridor.core.block import footprints
from corridor.core.gnss import in_world, world_crs
from corridor.core.output import Layer, nice, write_geopackage, write_las

_SIGMAS = ["sx", "sy", "sz"]
# The largest vector is drawn about so long, as a share of the block.
_DRAWN = 0.05


def write_gis(adjustment: Adjustment, stem: Path) -> None:
    """Writes STEM.gpkg and STEM.las, in the CRS of the block's results (`world_crs`).

    Layers: points (adjusted, sx, sy, sz in m, rays, kind), check_vectors (lines from the surveyed
    to the adjusted place, drawn `times` as long; dx, dy, dz, sx, sy, sz in m), cameras (centres,
    sx, sy, sz in m, s_rx, s_ry, s_rz in rad), footprints (of pictures, at the height of what each
    of them shows). The LAS file has the points. Raises InputError without the extra `gis`.
    """
    block = adjustment.block
    points = adjustment.points.copy()
    points[_SIGMAS] = adjustment.point_sigma
    xyz = in_world(block, points[["x", "y", "z"]].to_numpy())
    layers = {"points": Layer(points.drop(columns=["x", "y", "z"]), xyz)}
    if len(adjustment.check_points):
        layers["check_vectors"] = _vectors(adjustment)
    poses, images = adjustment.poses, block.images
    kept = [name for name in ("camera", "flight", "strip", "time_s") if name in images]
    cameras = pd.concat([poses.drop(columns=["x", "y", "z"]), images[kept]], axis=1)
    layers["cameras"] = Layer(cameras, in_world(block, poses[["x", "y", "z"]].to_numpy()))
    corners = footprints(block, _level(adjustment))
    whole = np.isfinite(corners).all(axis=(1, 2))
    rings = [*in_world(block, corners[whole])]
    layers["footprints"] = Layer(images.loc[whole, ["image", *kept]], rings, "Polygon Z")
    crs = world_crs(block)
    write_geopackage(stem.with_suffix(".gpkg"), layers, crs)
    fields = {name: points[name].to_numpy() for name in (*_SIGMAS, "rays")}
    fields["mark"] = (points["kind"] == "mark").to_numpy().astype(np.int32)
    write_las(stem.with_suffix(".las"), xyz, fields, crs)


def _vectors(adjustment: Adjustment) -> Layer:
    """Lines from where check points were surveyed towards where they came out."""
    block, table = adjustment.block, adjustment.check_points
    ground = block.ground.set_index("point").loc[table["point"], ["x", "y", "z"]].to_numpy(float)
    off = table[["dx", "dy", "dz"]].to_numpy(float)
    # By how much they are drawn longer than they are.
    largest = float(np.linalg.norm(off, axis=1).max())
    centres = block.poses[:, :2]
    extent = float(np.linalg.norm(np.nanmax(centres, axis=0) - np.nanmin(centres, axis=0)))
    times = max(nice(_DRAWN * extent / largest), 1.0) if largest > 0 else 1.0
    lines = [*in_world(block, np.stack([ground, ground + times * off], axis=1))]
    return Layer(table.assign(times=times), lines, "LineString Z")


def _level(adjustment: Adjustment) -> np.ndarray:
    """Median height (images,) of the points that each picture shows, m."""
    height = dict(zip(adjustment.points["point"], adjustment.points["z"], strict=True))
    seen = [
        pd.DataFrame({"image": t["image"].astype(str), "z": t["point"].map(height).astype(float)})
        for t in (adjustment.block.tie_points, adjustment.block.marks)
    ]
    found = pd.concat(seen).groupby("image")["z"].median()
    names = adjustment.block.images["image"].astype(str)
    return names.map(found).fillna(found.median()).to_numpy(float)
