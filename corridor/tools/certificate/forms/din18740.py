"""Proof of the orientation of a flight, as contracts under DIN 18740 ask for it.

The parts of DIN 18740 (photogrammetric products) name what has to be documented of a flight, its
camera and its orientation; limits are those of the contract. This form states the figures: camera
with its calibration, observations, sigma naught, standard deviations of the exterior orientation,
residuals at control points and differences at check points. It judges none of them.
Source of the figures: Luhmann et al., "Close-range photogrammetry and 3D imaging", section 4.4
(bundle triangulation); Kraus 2007, section 5.3.
"""

import math

import numpy as np

from corridor.core.output import DASH, Table, counted
from corridor.tools.certificate.statement import MOST_LISTED, Statement, Subject

TITLE = "Proof of orientation, after DIN 18740"
LEAST = 3  # check points of which an RMS is more than their single numbers


def statement(subject: Subject) -> Statement:
    """Project, camera, orientation and check of a block."""
    adjusted = subject.adjustment
    kept = subject.reported
    taken = [table for title, table in kept.items() if title.startswith(("Observations", "Camera",
             "Lever arm"))]  # fmt: skip
    points = subject.checked
    tables = [_project(subject), *taken, _orientation(subject), _control(subject), _check(subject)]
    if len(points):
        tables.append(points.listed())
    caption = "Images, points and where in the image they were measured."
    rms = adjusted.check_rms
    return Statement(
        _opening(subject),
        adjusted.warnings,
        [table for table in tables if table is not None],
        _UNTESTED,
        {
            "sigma0": float(adjusted.sigma0),
            "redundancy": int(adjusted.redundancy),
            "check_points": len(points),
            "check_rms_xy_m": float(rms.xy),
            "check_rms_z_m": float(rms.z),
        },
        [subject.picture("first_look", adjusted.block, caption)],
    )


def _opening(subject: Subject) -> str:
    adjusted, count = subject.adjustment, len(subject.checked)
    said = (
        f"Bundle adjustment of {counted(len(adjusted.block.images), 'image')}: sigma naught "
        f"{adjusted.sigma0:.3f} with a redundancy of {adjusted.redundancy:,}."
    )
    if not subject.tied_to_ground:
        return f"{said} No accuracy on the ground is stated: it is a free network."
    if count < LEAST:
        none = f"there {'is' if count < 2 else 'are'} only {counted(count, 'check point')}"
        none = none if count else "there is no check point"
        return f"{said} No accuracy on the ground is stated: {none}."
    rms = adjusted.check_rms
    return (
        f"{said} Check points ({count}) differ by {1e3 * rms.xy:.1f} mm horizontally and "
        f"{1e3 * rms.z:.1f} mm in height (RMS)."
        f"{subject.compared(rms.d3) or ' The contract says whether that is enough.'}"
    )


def _project(subject: Subject) -> Table:
    block, adjusted = subject.block, subject.adjustment
    state = adjusted.state
    cameras = ", ".join(
        f"{name} ({camera.width} x {camera.height} px, f {camera['f']:.1f} px, "
        f"{'calibrated beforehand' if camera.calibrated else 'self-calibration'})"
        for name, camera in block.cameras.items()
    )
    depth = float(np.median(state.centre[:, 2]) - np.median(state.points[:, 2]))
    focal = float(np.median([camera["f"] for camera in block.cameras.values()]))
    ground = f"{1e2 * abs(depth) / focal:.1f} cm" if focal > 0 else DASH
    rows = [
        ("block", block.name),
        ("images", f"{len(adjusted.block.images)} in {counted(len(block.flight_names), 'flight')}"),
        ("camera", cameras),
        ("height above ground, ground sample", f"{depth:.1f} m, {ground} (median)"),
        ("reference", subject.reference),
    ]
    return Table("Project", (), tuple(rows), "lw")


def _orientation(subject: Subject) -> Table:
    poses = subject.adjustment.poses
    large = float(np.nanmax(poses[["sx", "sy", "sz"]].to_numpy(float))) >= 1.0
    far, length = (1.0, "m") if large else (1e3, "mm")
    rows = []
    for name, column, factor, unit in (
        ("X", "sx", far, length), ("Y", "sy", far, length), ("Z", "sz", far, length),
        ("about x", "s_rx", 1e3 * 180 / math.pi, "mdeg"),
        ("about y", "s_ry", 1e3 * 180 / math.pi, "mdeg"),
        ("about z", "s_rz", 1e3 * 180 / math.pi, "mdeg"),
    ):  # fmt: skip
        sigma = factor * poses[column].to_numpy(float)
        worst = int(np.nanargmax(sigma))
        rms = math.sqrt(float(np.mean(sigma**2)))
        rows.append((name, f"{rms:.2f}", f"{np.nanmin(sigma):.2f}", f"{sigma[worst]:.2f}",
                     str(poses["image"].iloc[worst]), unit))  # fmt: skip
    header = ("standard deviation", "RMS", "smallest", "largest", "at", "unit")
    return Table("Exterior orientation", header, tuple(rows), "lrrrll",
                 ("rotations about the axes of the camera",))  # fmt: skip


def _control(subject: Subject) -> Table | None:
    """Residuals of control, with the standard deviations that were given."""
    table = subject.adjustment.residuals["control"]
    if not len(table):
        return None
    v = 1e3 * table[["vx", "vy", "vz"]].to_numpy(float)
    s = 1e3 * table[["sx", "sy", "sz"]].to_numpy(float)
    order = np.sort(np.argsort(-np.abs(v / s).max(axis=1), kind="stable")[:MOST_LISTED])
    rows = tuple(
        (str(table["point"].iloc[k]), *(f"{x:.1f}" for x in v[k]), *(f"{x:.1f}" for x in s[k]))
        for k in order
    )
    rms = ", ".join(f"{x:.1f}" for x in np.sqrt(np.mean(v**2, axis=0)))
    notes = [f"given minus adjusted, and the standard deviation that was given, mm; RMS {rms} mm"]
    if len(rows) < len(table):
        notes.append(f"the {len(rows)} with the largest of {len(table)}")
    header = ("control point", "vx", "vy", "vz", "sx", "sy", "sz")
    return Table("Control points", header, rows, "lrrrrrr", tuple(notes))


def _check(subject: Subject) -> Table | None:
    adjusted = subject.adjustment
    if not len(subject.checked):
        return None
    rows = []
    names = ("RMS", "mean", "standard deviation")
    for name, part in zip(names, adjusted.check_statistics, strict=True):
        rows.append((name, *(f"{1e3 * x:.1f}" if math.isfinite(x) else DASH for x in part)))
    header = (f"{len(subject.checked)} check points", "horizontal", "height", "3D")
    return Table("Check points together", header, tuple(rows), "lrrr",
                 ("adjusted minus given, mm; horizontal and 3D are lengths",))  # fmt: skip


_UNTESTED = (
    "Conformity with DIN 18740: the standard's clauses on the flight (overlap, weather, image "
    "quality) and the limits of the contract are not among what was computed.",
    "Products (orthophoto, elevation model): only orientation and points were tested.",
    "Correlations and reliability are in the form `full`.",
)
