"""Adjustments that were never computed: a block with residuals drawn at random.

Pictures and reports take what an adjustment holds and compute nothing, so their tests need its
tables, not its truth. Shapes and sizes are those of real blocks.
"""

from types import SimpleNamespace

import numpy as np
import pandas as pd

from corridor.core.adjustment.check_statistics import CheckStatistics, Parts
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.effects import EffectValues, Parameter, Values

FREE = ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
SCALE = {"f": 2.9, "cx": 0.9, "cy": 0.8, "k1": 1.2e-4, "k2": 5e-4, "k3": 7e-4}


def corridor(azimuth_deg=62.0, length=900.0, strips=2, images=40, ground=7, name="thin", seed=3):
    """A block of parallel strips 60 m apart, 150 m above ground, seen from straight above."""
    rng = np.random.default_rng(seed)
    azimuth = np.radians(azimuth_deg)
    along = np.array([np.sin(azimuth), np.cos(azimuth)])
    across = np.array([along[1], -along[0]])

    def world(s, t):
        return np.outer(s, along) + np.outer(t, across)

    s = np.tile(np.linspace(0, length, images), strips)
    strip = np.repeat(np.arange(strips), images)
    xy = world(s, 60.0 * strip) + rng.normal(0, 1, (len(s), 2))
    names = [f"DJI_{k:04d}.JPG" for k in range(len(s))]
    pictures = pd.DataFrame(
        {
            "image": names,
            "camera": "P1",
            "flight": "1",
            "strip": [f"S{k + 5:02d}" for k in strip],
            "time_s": np.arange(len(s)) * 1.5,
            "x": xy[:, 0],
            "y": xy[:, 1],
            "z": 150.0,
            "qw": 0.0,
            "qx": 1.0,
            "qy": 0.0,
            "qz": 0.0,
        }
    )
    count = 15 * len(s)
    place = world(rng.uniform(0, length, count), rng.uniform(-40, 60 * strips - 20, count))
    points = [f"t{k:05d}" for k in range(count)]
    rays = rng.choice([2, 3, 4, 5, 9, 10], size=count, p=[0.1, 0.1, 0.2, 0.3, 0.1, 0.2])
    rays = np.minimum(rays, len(s))
    nearest = np.argsort(((place[:, None] - xy[None]) ** 2).sum(-1), axis=1)
    tie = pd.DataFrame(
        [(points[k], names[i]) for k in range(count) for i in nearest[k, : rays[k]]],
        columns=["point", "image"],
    )
    tie["x"], tie["y"] = rng.uniform(0, 8191, len(tie)), rng.uniform(0, 5459, len(tie))
    spot = world(np.linspace(0.05, 0.95, ground) * length, rng.uniform(-10, 60, ground))
    control = pd.DataFrame(
        {
            "point": [f"GCP{k + 11}" for k in range(ground)],
            "x": spot[:, 0],
            "y": spot[:, 1],
            "z": 2.0,
            "sx": 0.02,
            "sy": 0.02,
            "sz": 0.05,
            "role": ["control" if k % 3 == 0 else "check" for k in range(ground)],
        }
    )
    marks = pd.DataFrame(
        [(p, n) for p in control["point"] for n in names[:4]], columns=["point", "image"]
    )
    marks["x"], marks["y"] = rng.uniform(0, 8191, len(marks)), rng.uniform(0, 5459, len(marks))
    camera = Camera.from_table("P1", {"width": 8192, "height": 5460, "f": 8192.0})
    return Block(
        name=name, cameras={"P1": camera}, images=pictures, tie_points=tie,
        points=pd.DataFrame({"point": points, "x": place[:, 0], "y": place[:, 1], "z": 2.0}),
        marks=marks, ground=control,
        gnss=pd.DataFrame({"image": names, "x": xy[:, 0], "y": xy[:, 1], "z": 150.0}),
        crs="EPSG:32647", offset=np.array([717541.0, 1606017.0, 0.0]),
    )  # fmt: skip


def adjustment(block, effects=(), seed=5, **changes):
    """An adjustment of `block` in which everything went reasonably well; `changes` override it.

    effects: (slug, parameter, group, value, sigma, unit) each.
    """
    rng = np.random.default_rng(seed)
    residuals = {
        "tie": _pixels(block, block.tie_points, rng),
        "mark": _pixels(block, block.marks, rng),
    }
    gnss = block.gnss.copy()
    gnss[["vx", "vy", "vz"]] = rng.normal(0, 0.011, (len(gnss), 3))
    gnss[["sx", "sy", "sz"]] = np.array([0.02, 0.02, 0.05])
    residuals["gnss"] = gnss.assign(outlier=False)
    ground = block.ground
    control = ground[ground["role"] == "control"] if len(ground) else ground
    residuals["control"] = control.assign(vx=0.01, vy=-0.01, vz=0.001, outlier=False)

    check = ground[ground["role"] == "check"] if len(ground) else ground
    difference = rng.normal(0, 1, (len(check), 3)) * [0.02, 0.02, 0.03]
    check_points = pd.DataFrame(
        {
            "point": check["point"].astype(str).to_numpy(),
            "dx": difference[:, 0], "dy": difference[:, 1], "dz": difference[:, 2],
            "sx": 0.016, "sy": 0.009, "sz": 0.055,
            "s_dx": 0.017, "s_dy": 0.011, "s_dz": 0.056, "rays": 6,
        }
    )  # fmt: skip
    rows = [
        (name, key, camera[key], SCALE.get(key, 3e-5), "px" if key[0] in "fc" else "", True)
        for name, camera in block.cameras.items()
        for key in FREE
    ]
    named = ["camera", "parameter", "value", "sigma", "unit", "free"]
    camera = pd.DataFrame(rows, columns=named)
    camera.loc[camera["parameter"] == "k1", "value"] = -0.049312
    columns = ["slug", "parameter", "group", "value", "sigma", "unit"]
    effects = pd.DataFrame(list(effects), columns=columns)
    names = [f"camera.{name}.{key}" for name, key, *_ in rows]
    names += [
        f"{e.slug}.{e.parameter}" if e.group == "block" else f"{e.slug}.{e.group}.{e.parameter}"
        for e in effects.itertuples()
    ]
    matrix = _correlations(len(names), rng)
    high = [
        {"a": names[i], "b": names[j], "value": float(matrix[i, j])}
        for i in range(len(names)) for j in range(i + 1, len(names)) if abs(matrix[i, j]) > 0.95
    ]  # fmt: skip
    poses = block.images.reindex(columns=["image", "x", "y", "z"]).assign(
        sx=0.004, sy=0.004, sz=0.006, s_rx=1e-5, s_ry=1e-5, s_rz=4e-6
    )
    points = block.points.reindex(columns=["point", "x", "y", "z"]).assign(
        sx=0.01, sy=0.01, sz=0.03, rays=5, kind="tie"
    )
    arms = (
        [(f, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True) for f in block.flight_names] if len(gnss) else []
    )
    statistics = CheckStatistics(
        _three(np.sqrt(np.mean(difference**2, axis=0))) if len(check) else _none(),
        _three(difference.mean(axis=0)) if len(check) else _none(),
        _three(difference.std(axis=0, ddof=1)) if len(check) > 1 else _none(),
    )
    made = {
        "block": block, "start": block, "required": None,
        "converged": True, "iterations": 5, "seconds": 0.31,
        "sigma0": 0.9312, "redundancy": 27340, "cost": 25458.0, "history": [],
        "residuals": residuals,
        "statistics": {kind: _statistics(kind, table) for kind, table in residuals.items()},
        "camera": camera, "effects": effects,
        "lever_arm": pd.DataFrame(
            arms, columns=["flight", "x", "y", "z", "sx", "sy", "sz", "fixed"]
        ),
        "check_points": check_points,
        "check_statistics": statistics,
        "check_rms": statistics.rms, "check_mean": statistics.mean, "check_std": statistics.std,
        "poses": poses, "points": points,
        "correlations": [
            {"a": f"camera.{name}.f", "b": b, "mean": 0.36, "std": 0.02,
             "sigma_a": 2.9, "sigma_b": 0.012}
            for name in block.cameras for b in ("camera height", "ground height")
        ],
        "high_correlations": high, "warnings": [],
        "correlation_matrix": pd.DataFrame(matrix, names, names),
        "variance_components": pd.DataFrame(
            columns=["kind", "part", "flight", "count", "redundancy", "sigma0", "p"]
        ),
        "distances": pd.DataFrame(),
        "correlated_kinds": [],
        "reliability": SimpleNamespace(
            whole=False,
            summary=pd.DataFrame(columns=["largest_w"]), to_dict=dict, to_frame=pd.DataFrame
        ),
    }  # fmt: skip
    made["values"] = _values(made["effects"])
    made |= changes
    made["correlations"] = pd.DataFrame(
        made["correlations"], columns=["a", "b", "mean", "std", "sigma_a", "sigma_b"]
    )
    made["high_correlations"] = pd.DataFrame(made["high_correlations"], columns=["a", "b", "value"])
    made["point_sigma"] = np.full((len(made["block"].points), 3), 0.01)
    return SimpleNamespace(**made)


def _values(frame):
    """The same numbers as the table of effects has, and the numbers alone."""
    out = []
    for slug, part in frame.groupby("slug", sort=False):
        groups = list(dict.fromkeys(part["group"]))
        units = part.groupby("parameter", sort=False)["unit"].first()
        value, sigma = (
            part.pivot(index="group", columns="parameter", values=name).loc[groups, units.index]
            for name in ("value", "sigma")
        )
        out.append(
            EffectValues(
                SimpleNamespace(slug=slug, group="flight"),
                [str(group) for group in groups],
                [Parameter(name, unit, 1.0) for name, unit in units.items()],
                value.to_numpy(),
                sigma.to_numpy(),
            )
        )
    return Values(out)


def _three(values):
    return Parts(float(np.hypot(*values[:2])), float(values[2]), float(np.linalg.norm(values)))


def _none():
    return Parts(float("nan"), float("nan"), float("nan"))


def _pixels(block, table, rng):
    """Noise with a long tail and a small swirl that follows the position in the image."""
    made = table[["point", "image", "x", "y"]].copy()
    camera = next(iter(block.cameras.values()))
    u = made["x"].to_numpy() / camera.width - 0.5
    v = made["y"].to_numpy() / camera.height - 0.5
    tail = rng.normal(0, 0.6, (len(made), 2)) * (1 + (rng.random((len(made), 1)) < 0.05) * 4)
    made["vx"] = tail[:, 0] + 0.5 * v + 0.8 * u * v
    made["vy"] = 0.7 * tail[:, 1] - 0.3 * u + 0.8 * u * u
    made["sigma"], made["weight"] = 1.0, 1.0
    made["outlier"] = np.hypot(made["vx"], made["vy"]).to_numpy() > 3.5
    made["gross"] = False
    return made


def _statistics(kind, table):
    if not len(table):
        return {"count": 0}
    good = table[~table["outlier"]]
    if kind in ("tie", "mark"):
        rms = float(np.sqrt((good["vx"] ** 2 + good["vy"] ** 2).mean() / 2))
    else:
        rms = np.sqrt((good[["vx", "vy", "vz"]] ** 2).mean()).to_numpy()
    outliers = int(table["outlier"].sum())
    return {"count": len(table), "rms": rms, "outliers": outliers, "sigma0": 0.95}


def _correlations(count, rng):
    factor = rng.normal(size=(count, count)) * 0.25 + np.eye(count)
    if count > 5:
        factor[4] = -factor[3] + 0.15 * factor[4]
        factor[5] = factor[3] + 0.2 * factor[5]
    covariance = factor @ factor.T
    size = np.sqrt(np.diag(covariance))
    return covariance / np.outer(size, size)
