"""Flights of a head of three cameras by code of its own: matrix exponentials and a pinhole."""

import numpy as np
import pandas as pd
from scipy.linalg import expm

from corridor.core.block import Block
from corridor.core.camera import Camera

# Nadir, and two that look to the sides; t (m, base frame) and turn (rad) from the base to each.
HEAD = {
    "left": ([-0.12, 0.02, 0.03], [0.02, -0.6, 0.01]),
    "right": ([0.13, 0.01, 0.02], [0.0, 0.6, 0.03]),
}
SIZE, F = (1200, 800), 1500.0


def exp(vector):
    """Exp of a vector, rad, by the series of the matrix."""
    x, y, z = vector
    return expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def quaternion(rotation):
    """qw, qx, qy, qz: the largest column of 4 q q', which the matrix holds (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    outer = np.array([
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ])  # fmt: skip
    column = outer[:, np.argmax(np.diag(outer))]
    return column / np.linalg.norm(column)


def mounting(camera, head=HEAD):
    """t (3,) and M (3, 3)."""
    t, turn = head[camera]
    return np.array(t), exp(turn)


def rig_table(head=HEAD, stated=True, **sigmas):
    """[rig.HEAD] of block.toml."""
    members = {}
    for camera in head:
        t, m = mounting(camera, head)
        members[camera] = (
            {"xyz": t.tolist(), "quaternion": quaternion(m).tolist()} if stated else {}
        )
        members[camera] |= sigmas
    return {"HEAD": {"base": "nadir", "member": members}}


def rigged_block(exposures=10, strips=2, head=HEAD, gnss=True, points=900, seed=1, lacking=()):
    """A perfect block of strips east and west at 60 m; lacking: (exposure, camera) that fail."""
    rng = np.random.default_rng(seed)
    per = exposures // strips
    rows, centres, turns = [], [], []
    for k in range(exposures):
        strip, along = divmod(k, per)
        heading = np.pi / 2 * (1 if strip % 2 == 0 else -1)
        x = 9.0 * (along if strip % 2 == 0 else per - 1 - along)
        centre = np.array([x, 22.0 * strip, 60.0 + 4.0 * strip]) + rng.normal(0, 0.3, 3)
        ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
        level = np.array([[ahead[1], -ahead[0], 0.0], -ahead, [0.0, 0.0, -1.0]])
        base = exp(rng.normal(0, 0.03, 3)) @ level
        for camera in ("nadir", *head):
            if (k, camera) in lacking:
                continue
            c, r = centre, base
            if camera != "nadir":
                t, m = mounting(camera, head)
                c, r = centre + base.T @ t, m @ base
            rows.append((f"{camera}_{k:03d}", camera, f"E{k}", "F1", 2.5 * k, *c, *quaternion(r)))
            centres.append(c)
            turns.append(r)
    columns = ["image", "camera", "exposure", "flight", "time_s", *"xyz", "qw", "qx", "qy", "qz"]
    images = pd.DataFrame(rows, columns=columns)
    reach = 9.0 * per
    xyz = np.column_stack([
        rng.uniform(-70, reach + 70, points),
        rng.uniform(-90, 110, points),
        rng.normal(0, 4, points),
    ])  # fmt: skip
    names = np.array([f"P{k:04d}" for k in range(points)], dtype=object)
    names[:12] = [f"G{k:02d}" for k in range(12)]
    seen = []
    for row, c, r in zip(rows, centres, turns, strict=True):
        ray = (xyz - c) @ r.T
        pixel = F * ray[:, :2] / ray[:, 2:] + (np.array(SIZE) - 1) / 2
        inside = (ray[:, 2] > 0) & (pixel > 0).all(1) & (pixel < np.array(SIZE) - 1).all(1)
        seen += [(names[n], row[0], *pixel[n]) for n in np.flatnonzero(inside)]
    table = pd.DataFrame(seen, columns=["point", "image", "x", "y"])
    table = table[table.groupby("point")["image"].transform("size") > 1]
    ground = table["point"].str.startswith("G")
    given = pd.DataFrame(xyz, columns=list("xyz")).assign(point=names)
    shown = set(table["point"])
    marked = given[given["point"].isin(shown) & given["point"].str.startswith("G")]
    nadir = images[images["camera"] == "nadir"]
    block = Block(
        name="rigged",
        cameras={
            name: Camera.from_table(
                name, {"width": SIZE[0], "height": SIZE[1], "f": F, "calibrated": True}
            )
            for name in ("nadir", *head)
        },
        images=images,
        tie_points=table[~ground],
        marks=table[ground],
        points=given[given["point"].isin(shown) & ~given["point"].str.startswith("G")],
        ground=marked.assign(role=["control", "check"] * (len(marked) // 2)
                             + ["check"] * (len(marked) % 2)),
        gnss=nadir[["image", *"xyz"]].reset_index(drop=True) if gnss else None,
        sigma={"tie_px": 0.5, "mark_px": 0.5, "gnss_m": 0.02, "control_m": 0.01},
        extra={"rig": rig_table(head)},
    )  # fmt: skip
    block.check()
    return block
