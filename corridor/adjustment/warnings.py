"""What is doubtful about an adjustment, in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

# Beyond this a parameter and a height are one quantity for every practical purpose.
INSEPARABLE = 0.995
# Residuals that follow the rows of single images: share of their squares, and length in sigmas.
ROW_SHARE, ROW_SIGMAS = 0.15, 0.5
_ROW_DEGREE = 4
# An estimated readout this far from the stated one, in sigmas and as a share, is told.
FAR_SIGMAS, FAR_SHARE = 3.0, 0.15


def warnings_of(adjustment: Adjustment) -> list[str]:
    """Sentences, the gravest first."""
    return [
        *_convergence(adjustment),
        *_inseparable(adjustment),
        *_motion(adjustment),
        *_readout(adjustment),
        *_fit(adjustment),
        *_outliers(adjustment),
        *_insignificant(adjustment),
    ]


def _convergence(a):
    if not a.converged:
        yield (
            f"The iterations did not converge in {a.iterations} steps: the numbers below are not "
            "the optimum."
        )


def _inseparable(a):
    p = a.problem
    if not (len(p.gnss_image) or len(p.control_rows)):
        return
    with_what = "this GNSS" if len(p.gnss_image) else "this ground control"
    for pair in a.correlations:
        if not pair["a"].startswith("camera.") or pair["b"] not in ("height", "ground height"):
            continue
        if abs(pair["mean"]) < INSEPARABLE:
            continue
        name = pair["a"].split(".")[1]
        focal = a.camera.query("camera == @name and parameter == 'f'").iloc[0]
        if pair["b"] == "height":
            sigma = float(np.median(a.poses["sz"]))
            which = "camera heights"
        else:
            chosen = p.point_kinds if p.point_kinds.any() else np.diff(p.ptr) >= 3
            sigma = float(np.median(a.point_sigma[chosen, 2]))
            which = "ground heights"
        yield (
            f"Camera {name}: focal length and height cannot be separated by these images and "
            f"{with_what} (correlation {pair['mean']:.4f}; sigma of f {focal['sigma']:.3g} px, of "
            f"the {which} {sigma:.3g} m): add a ground control point, fly at two heights or with "
            "oblique images, or hold a calibrated focal length."
        )
        return


def _motion(a):
    """Says so where a motion during the readout is modelled and residuals still follow the rows."""
    p, ties = a.problem, a.residuals["tie"]
    if not p.stack.at("motion") or not len(ties):
        return
    ties = ties[~ties["gross"]]
    image = pd.Index(p.images.names).get_indexer(ties["image"].astype(str))
    axis, factor, offset = p.images.row_of[image].T
    row = 2 * (factor * np.where(axis == 1, ties["y"], ties["x"]) + offset)
    basis = np.vander(row, _ROW_DEGREE + 1, increasing=True)
    v = ties[["vx", "vy"]].to_numpy() / ties[["sigma"]].to_numpy()
    order = np.argsort(image, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(image[order])) + 1)
    parts = [part for part in parts if len(part) > 10 * (_ROW_DEGREE + 1)]
    if len(parts) < 2:
        return
    # What all images share is the camera's.
    v = v - basis @ np.linalg.lstsq(basis, v, rcond=None)[0]
    count, by_row = 2 * sum(map(len, parts)), 0.0
    for part in parts:
        mine = np.linalg.lstsq(basis[part], v[part], rcond=None)[0]
        by_row += float(np.sum((basis[part] @ mine) ** 2))
    by_chance = 2.0 * (_ROW_DEGREE + 1) * len(parts) * a.sigma0**2
    share = (by_row - by_chance) / float(np.sum(v**2))
    size = np.sqrt(max(by_row - by_chance, 0.0) / count)
    if share > ROW_SHARE and size > ROW_SIGMAS:
        names = ", ".join(member.effect.slug for member in p.stack.at("motion"))
        yield (
            f"The motion model ({names}) does not explain the pictures: {100 * share:.0f} % of the "
            f"tie residuals' squares follow the rows of single images ({size:.1f} sigmas). Its "
            "values are those of a wrong model: the camera moved otherwise during the readout "
            "(rates that change within it, as a gyroscope records them in rates.csv)."
        )


def _readout(a):
    """A readout that no shutter has, or that is far from the stated one."""
    table, cameras = a.effects, a.problem.block.cameras
    for row in table[table["parameter"] == "readout"].itertuples(index=False):
        found = f"{1000 * row.value:.1f} +- {1000 * row.sigma:.1f} ms"
        mine = [cameras[row.group]] if row.group in cameras else cameras.values()
        stated = {camera.readout_s for camera in mine} - {None}
        if row.value < 0:
            yield (
                f"A readout of {found} is negative: the rows run the other way (row_direction in "
                "block.toml), or this is no measurement, because speed and flight direction vary "
                "too little in the pictures."
            )
        elif len(stated) == 1 and row.sigma > 0:
            (known,) = stated
            off = abs(row.value - known)
            if off > FAR_SIGMAS * row.sigma and off > FAR_SHARE * known:
                yield (
                    f"A readout of {found} was estimated where block.toml states "
                    f"{1000 * known:.1f} ms: the velocities are wrong, the flight does not tell "
                    "the readout, or the camera was in another mode."
                )


def _fit(a):
    if a.redundancy > 30 and a.sigma0 > 1.5:
        yield (
            f"Sigma naught is {a.sigma0:.2f}: the residuals are larger than the stated standard "
            "deviations, or the model lacks something."
        )
    if a.redundancy > 30 and 0 < a.sigma0 < 0.5:
        yield (
            f"Sigma naught is {a.sigma0:.3g}: the stated standard deviations are larger than the "
            "residuals; GNSS and control weigh too much against the images, or too little."
        )


def _outliers(a):
    for kind, what in (("tie", "tie point"), ("mark", "mark")):
        found = a.observations[kind]
        if not found or not found["outliers"]:
            continue
        share = 100.0 * found["outliers"] / found["count"]
        gross = (
            f"; {found['gross']} of them beyond 15 are left out of the RMS"
            if found["gross"]
            else ""
        )
        advice = ": a robust loss (huber:2) limits their weight" if a.system.loss.kind == 0 else ""
        yield (
            f"{found['outliers']} of {found['count']} {what} observations ({share:.1f} %) lie "
            f"beyond 5 robust sigmas{gross}{advice}."
        )
    for kind, what, remedy in (
        ("gnss", "GNSS position", ": --reject-gnss leaves them out"),
        ("control", "control point", ""),
    ):
        found = a.observations[kind]
        if found and found["outliers"]:
            frame = a.residuals[kind]
            names = frame.loc[frame["outlier"], frame.columns[0]].astype(str).tolist()
            yield (
                f"{len(names)} {what}{'s' * (len(names) > 1)} beyond 5 sigmas: "
                f"{', '.join(names[:10])}{', ...' if len(names) > 10 else ''}"
                f"{remedy}."
            )


def _insignificant(a):
    weak = a.camera[
        a.camera["free"]
        & ~a.camera["parameter"].isin(["f", "cx", "cy"])
        & (a.camera["value"].abs() < 2 * a.camera["sigma"])
    ]
    if len(weak):
        names = [f"{row.parameter} of camera {row.camera}" for row in weak.itertuples()]
        yield f"Not significantly different from zero: {', '.join(names)}."
