"""What is doubtful about an adjustment, in sentences."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.special import chdtri

from corridor.core.adjustment.blunders import told_exchanged
from corridor.core.adjustment.tables import Tables
from corridor.core.block import values_of
from corridor.core.camera import project_rays
from corridor.core.effects import Without, every_effect
from corridor.core.errors import some
from corridor.core.geometry import GROSS
from corridor.core.output import counted
from corridor.core.preparation import prepare

# Beyond this a parameter and a height are one quantity for every practical purpose.
INSEPARABLE = 0.995
# Residuals that follow the rows of single images: share of their squares, and length in sigmas.
ROW_SHARE, ROW_SIGMAS = 0.15, 0.5
_ROW_DEGREE = 4
# An estimate this far from what is stated beforehand is told.
FAR_SIGMAS = 3.0
# Pixels of sensors are square to a few parts in ten thousand, and their axes perpendicular.
NOT_SQUARE = 2e-3
# An adjusted camera is another than the stated: focal length, principal point (of the width).
FAR_FOCAL, FAR_CENTRE = 0.08, 0.1
# No drone carries its antenna so far from the camera.
LONG_ARM_M = 5.0
# So far from the axis the two models of lenses are compared at most: the tangent is 5 there.
WIDEST_RAD = 1.37
# Lever arms of one camera in two flights are another's beyond this many sigmas and this size, m,
# which no mounting moves by.
_SURE_OF_ARMS, _OTHER_ARM_M = 5.0, 0.1
# Control that is stated this coarsely, m, and by points that are several fits to this share of it.
_COARSE_M, _SEVERAL, _FINE = 0.1, 4, 0.1
# Below this many standard deviations a value may be zero, which by chance happens to so many.
_TWO_SIGMAS, _BY_CHANCE = 2.0, 0.0455
# Sigma naught of a kind of observation that contradicts what is stated of it.
DOUBTFUL = 2.0
# Sigma naught of a model, or of measurements, that something is wrong with.
MISFIT = 1.5


def warnings_of(adjustment: Tables) -> list[str]:
    """Sentences, the gravest first."""
    return [*grave(adjustment), *_insignificant(adjustment), *_beside_a_diagnosis(adjustment)]


def grave(adjustment: Tables) -> list[str]:
    """Those of them that put the numbers in doubt."""
    missed = _missed(adjustment)
    return [
        *_convergence(adjustment),
        *implausible(adjustment),
        *_straight_fisheyes(adjustment),
        *different_arms(adjustment),
        *_inseparable(adjustment),
        *_motion(adjustment),
        *_doubtful_effects(adjustment),
        *(sentence for _, sentence in missed),
        *_priors(adjustment),
        *_pixels(adjustment),
        *_fit(adjustment),
        *_wrong_control(adjustment),
        *_wrong_distances(adjustment),
        *_outliers(adjustment, {place for place, _ in missed}),
    ]


def implausible(adjustment: Tables) -> list[str]:
    """Sentences on results that tell of a mistake in the block, and on which."""
    pairs = (told_exchanged(*pair) for pair in adjustment.exchanged)
    return [*pairs, *_strange_camera(adjustment), *_long_arm(adjustment)]


def _convergence(a):
    if not a.converged:
        yield (
            f"The iterations did not converge in {a.iterations} steps: the numbers below are not "
            "the optimum."
        )


def _strange_camera(a):
    """An adjusted camera that is another one than block.toml states."""
    for name, stated in a.start.cameras.items():
        free = a.problem.free.get(name, ())
        found = a.state.interior[a.problem.images.camera_names.index(name)]
        f, cx, cy = found[:3].tolist()
        ratio = f / stated["f"]
        far = "f" in free and ratio > 0.0 and abs(np.log(ratio)) > np.log(1.0 + FAR_FOCAL)
        if far and abs(f - stated["f"]) > FAR_SIGMAS * _sigma_of_focal(a, name):
            half = abs(np.log2(ratio) - np.round(np.log2(ratio))) < 0.03 and abs(ratio - 1) > 0.4
            cause = (
                "were image points measured on pictures of another size?"
                if half
                else "is it that of another camera or zoom, or do GNSS heights pull it?"
            )
            yield (
                f"The focal length of camera {name} came out as {f:.0f} px where block.toml states "
                f"{stated['f']:.0f} px, {ratio:.2f} times as long: {cause}"
            )
        away = np.array([cx - stated["cx"], cy - stated["cy"]])
        if {"cx", "cy"} & set(free) and np.abs(away).max() > FAR_CENTRE * stated.width:
            middle = [(stated.width - 1) / 2, (stated.height - 1) / 2]
            cause = (
                "are pixels counted from the middle? (0, 0) is the centre of the top-left pixel."
                if np.abs([cx, cy]).max() < FAR_CENTRE * stated.width
                else f"the middle of its picture is at {middle[0]:.0f}, {middle[1]:.0f}."
            )
            yield (
                f"The principal point of camera {name} came out at {cx:.0f}, {cy:.0f} px where "
                f"block.toml states {stated['cx']:.0f}, {stated['cy']:.0f}: {cause}"
            )


def _sigma_of_focal(a, camera: str) -> float:
    mine = (a.camera["camera"] == camera) & (a.camera["parameter"] == "f")
    return float(a.camera["sigma"][mine].iloc[0])


def _straight_fisheyes(a):
    """A fisheye whose distortion came out as what takes the fisheye back."""
    for camera in a.block.cameras.values():
        if not camera.fisheye or "k1" not in a.problem.free.get(camera.name, ()):
            continue
        theta = min(np.hypot(camera.width, camera.height) / 2 / camera["f"], WIDEST_RAD)
        seen = project_rays(np.array([[np.tan(theta), 0.0]]), camera.interior)[0, 0]
        # Lenses between the two (stereographic: k1 = 1/12) go a quarter of the way.
        if (seen - camera["cx"]) / camera["f"] - theta > 0.75 * (np.tan(theta) - theta):
            yield (
                f"The distortion of camera {camera.name}, a fisheye in block.toml, came out as "
                f"that of a central projection: k1 = {camera['k1']:.3f}, where 1/3 takes a fisheye "
                'back to one. Is it an ordinary lens? Leave out model = "fisheye" of its table.'
            )


def _long_arm(a):
    """A lever arm that no drone carries is an offset of the GNSS positions."""
    p = a.problem
    if not p.arms_free:
        return
    for k, name in enumerate(p.images.flight_names):
        arm, mine = a.state.arms[k], p.images.flight == k
        length = float(np.linalg.norm(arm))
        if not mine.any() or length < LONG_ARM_M:
            continue
        # Seen from the world, over all images of the flight.
        world = np.einsum("nij,i->nj", a.state.rotation[mine], arm).mean(axis=0)
        up = abs(world[2]) > 0.9 * length
        cause = (
            "GNSS heights above the ellipsoid and ground control above the geoid?"
            if up
            else "are GNSS and ground control in one coordinate system?"
        )
        yield (
            f"The lever arm of flight {name} came out {length:.1f} m long, {world[2]:+.1f} m of it "
            f"in height: {cause}"
        )


def different_arms(a: Tables) -> Iterator[str]:
    """A sentence on flights of one camera whose lever arms differ, though it has one antenna."""
    p, arms = a.problem, a.lever_arm
    if not p.arms_free or len(arms) < 2:
        return
    at = [p.images.flight_names.index(name) for name in arms["flight"]]
    camera = [set(p.images.camera[p.images.flight == k]) for k in at]
    stated = p.start.arms[at]
    value, sigma = (arms[names].to_numpy(float) for names in (["x", "y", "z"], ["sx", "sy", "sz"]))
    alike = a.correlation_matrix
    for k in range(1, len(arms)):
        away = value[k] - value[0]
        pair = [[f"lever_arm.{arms['flight'].iloc[n]}.{axis}" for n in (0, k)] for axis in "xyz"]
        rho = np.array([alike.loc[one, other] for one, other in pair])
        # What a focal length does to all heights moves both alike.
        square = sigma[0] ** 2 + sigma[k] ** 2 - 2.0 * rho * sigma[0] * sigma[k]
        doubt = np.sqrt(np.maximum(square, 0.0))
        clear = (np.abs(away) > _SURE_OF_ARMS * doubt) & (np.abs(away) > _OTHER_ARM_M)
        if camera[k] != camera[0] or (stated[k] != stated[0]).any() or not clear.any():
            continue
        vector = ", ".join(f"{one:+.2f}" for one in away)
        yield (
            f"The lever arms of flights {arms['flight'].iloc[0]} and {arms['flight'].iloc[k]} "
            f"differ by ({vector}) m (x, y, z of the camera frame), though one camera flew both: "
            "were the positions computed from another base, in another height system, or for "
            "another antenna height, or is its focal length another one? A shutter or a clock that "
            "is missing from the model does the same: `corridor diagnose` finds out."
        )


def _beside_a_diagnosis(a):
    """Why a diagnosis may not name an effect that is significant here."""
    p, table = a.problem, a.effects
    mine = {m.effect.slug for m in p.stack.at("antenna")}
    strong = table[(table["value"].abs() > 2.0 * table["sigma"]) & (table["sigma"] > 0)]
    slugs = [slug for slug in dict.fromkeys(strong["slug"]) if slug in mine]
    if slugs:
        yield (
            f"The sigmas of {', '.join(slugs)} take GNSS errors of one image and the next as "
            "independent; a receiver errs slowly. `corridor diagnose` allows for that, and may "
            "find that nothing is missing where values here reach several sigmas."
        )


def _inseparable(a):
    p = a.problem
    if not (len(p.gnss_image) or len(p.control_rows)):
        return
    with_what = "this GNSS" if len(p.gnss_image) else "this ground control"
    for pair in a.correlations.itertuples():
        if not pair.a.startswith("camera.") or pair.b not in ("height", "ground height"):
            continue
        if abs(pair.mean) < INSEPARABLE:
            continue
        name = pair.a.split(".")[1]
        focal = a.camera.query("camera == @name and parameter == 'f'").iloc[0]
        if pair.b == "height":
            sigma = float(np.median(a.poses["sz"]))
            which = "camera heights"
        else:
            chosen = p.point_kinds if p.point_kinds.any() else np.diff(p.ptr) >= 3
            sigma = float(np.nanmedian(a.point_sigma[chosen, 2]))
            which = "ground heights"
        yield (
            f"Camera {name}: focal length and height cannot be separated by these images and "
            f"{with_what} (correlation {pair.mean:.4f}; sigma of f {focal['sigma']:.3g} px, of "
            f"the {which} {sigma:.3g} m): add a ground control point, fly at two heights or with "
            "oblique images, or hold a calibrated focal length."
        )
        return


def _motion(a):
    """Says so where a motion during the readout is modelled and residuals still follow the rows."""
    p, ties = a.problem, a.residuals["tie"]
    during = [m.effect.slug for m in p.stack.at("motion") if m.effect.during_readout]
    if not during or not len(ties):
        return
    ties = ties[~ties["gross"]]
    image = pd.Index(p.images.names).get_indexer(ties["image"].astype(str))
    axis, factor, offset = p.images.row_of[image].T
    row = 2 * (factor * np.where(axis == 1, ties["y"], ties["x"]) + offset)
    basis = np.vander(row, _ROW_DEGREE + 1, increasing=True)
    v = values_of(ties, "vx", "vy") / values_of(ties, "sigma")
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
        names = ", ".join(during)
        yield (
            f"The motion model ({names}) does not explain the pictures: {100 * share:.0f} % of the "
            f"tie residuals' squares follow the rows of single images ({size:.1f} sigmas). Its "
            "values are those of a wrong model: the camera moved otherwise during the readout "
            "(rates that change within it, as a gyroscope records them in rates.csv)."
        )


def _doubtful_effects(a):
    """Values of effects that contradict what is known of such an effect, or of the block."""
    for slug, one in a.values.items():
        yield from one.effect.doubts(a.problem.block, a.effects[a.effects["slug"] == slug])


def _missed(a) -> list[tuple[str, str]]:
    """Place of an effect that the model leaves out though the block shows it, and what shows it.

    Where the model has one of the same place, that may take it up.
    """
    p = a.problem
    block = p.block
    if len(block.gnss) and not block.has("images.vx") and block.has("images.time_s"):
        # Without effects nobody has derived velocities, by which positions may be late.
        block = prepare(block).block
    found = Without(
        block=block,
        free=frozenset(name for free in p.free.values() for name in free),
        height=float(np.median(a.state.centre[:, 2]) - np.median(a.state.points[:, 2])),
        gnss=a.residuals["gnss"],
    )
    return [
        (effect.place, sentence)
        for effect in every_effect()
        # A finer variant shows where the effect itself does.
        if not effect.refines and not p.stack.at(effect.place)
        for sentence in effect.missed(found)
    ]


def _priors(a):
    """Priors that the measurements overrule."""
    if not a.problem.prior_weight.any():
        return
    for one in a.parameters.values():
        if one.prior is None or not one.vary:
            continue
        value, sigma = one.prior
        off = abs(one.value - value) / sigma
        if off > FAR_SIGMAS:
            unit = f" {one.unit}" if one.unit else ""
            yield (
                f"{one.name} comes to {one.value:.5g} +- {one.sigma:.2g}{unit}, {off:.1f} sigmas "
                f"from what is stated beforehand, {value:.5g} +- {sigma:.2g}{unit}: either that is "
                "wrong, or the model lacks something that this parameter takes up; hold it and "
                "look at the residuals, or run `corridor diagnose`."
            )


def _pixels(a):
    """Affinity that no sensor has."""
    free = a.camera[a.camera["free"] & a.camera["parameter"].isin(["b1", "b2"])]
    size = free["value"].abs()
    found = free[(size > NOT_SQUARE) & (size > FAR_SIGMAS * free["sigma"])]
    for camera, rows in found.groupby("camera", sort=False):
        values = " and ".join(f"{r.parameter} {100 * r.value:.2f} %" for r in rows.itertuples())
        yield (
            f"Camera {camera} has {values}: the pixels of sensors are square to less than "
            f"{100 * NOT_SQUARE:g} %. It takes up what the model lacks (a rolling shutter at one "
            "speed, say), or the flight does not determine it: `--camera fraser8` holds it."
        )


def _fit(a):
    if a.redundancy > 30 and a.sigma0 > MISFIT:
        yield (
            f"Sigma naught is {a.sigma0:.2f}: the residuals are larger than the stated standard "
            "deviations, or the model lacks something."
        )
    if a.redundancy > 30 and 0 < a.sigma0 < 0.5:
        p = a.problem
        others = [("GNSS", len(p.gnss_image)), ("control", len(p.control_rows))]
        beside = " and ".join(name for name, count in others if count)
        weights = f", so the weights of {beside} against the images are wrong" if beside else ""
        yield (
            f"Sigma naught is {a.sigma0:.3g}: the stated standard deviations are larger than the "
            f"residuals{weights}."
        )
    control = a.residuals["control"]
    if len(control) < _SEVERAL:
        return
    left, stated = (values_of(control, *(f"{one}{axis}" for axis in "xyz")) for one in "vs")
    size, usual = float(np.sqrt(np.mean(left**2))), float(np.median(stated))
    if usual >= _COARSE_M and size < _FINE * usual:
        yield (
            f"Ground control is stated to {usual:g} m and fits to {size:.2g} m (RMS), so it hardly "
            "counts: are its standard deviations (sx, sy, sz of ground.csv, control_m of "
            "block.toml) in metres?"
        )


def tested_by(block) -> str:
    """How the accuracy of a block without check points gets known: an action, without full stop."""
    if len(block.ground) and len(block.marks):
        return "Keep some surveyed points to test it with: `corridor adjust BLOCK --check ID,ID`"
    if len(block.ground):
        return (
            "To know its accuracy, measure the ground points in the images: no image shows one "
            "(marks.csv)"
        )
    return (
        "To know its accuracy, survey points on the ground, measure them in the images, and add "
        "both with `--ground FILE` of `corridor import`"
    )


def _wrong_control(a):
    """Coordinates of control that all other observations contradict."""
    table = a.residuals["control"]
    # Where most control is off, nobody knows who is right.
    most = len(table) > _SEVERAL and table["outlier"].mean() > 0.5
    if not a.converged or len(table) < 2 or most:
        return
    # Small residuals too: where little else shows a coordinate, it draws the block to itself.
    found = a.reliability.wrong_control
    # Where other measurements contradict what is stated, or too many coordinates do, nobody knows
    # who is right, but of a gross error which all else bends to.
    gnss, mark, tie = (a.statistics[kind].get("sigma0", 0.0) for kind in ("gnss", "mark", "tie"))
    doubtful = max(gnss, mark, tie) > DOUBTFUL
    if doubtful or len(found) >= len(table):
        found = found[found["w"].abs() > GROSS * a.control_factor * max(tie, 1.0)][:1]
    if not len(found):
        return
    axes = {"x": "x", "y": "y", "z": "height"}
    names = [f"{row.point} in {axes[row.axis]}" for row in found.itertuples(index=False)]
    yield (
        f"Ground control is wrong, given minus true: {_errors(names, found)}. All other "
        "measurements contradict it (data snooping of all coordinates together, 1 % false names): "
        "check the survey and the marks, and leave it out (role check) if they do not explain it."
    )


def _wrong_distances(a):
    """Distances that all other observations contradict."""
    found = a.wrong_distances if a.converged else ()
    if len(found):
        names = [f"{one} to {two}" for one, two in zip(found["from"], found["to"], strict=True)]
        yield (
            f"Distances are wrong, given minus true: {_errors(names, found)}. All other "
            "measurements contradict it (data snooping of distances and control together, 1 % "
            "false names): check the tape and the marks at both ends, and take the row out of "
            "distances.csv if they do not explain it."
        )


def _errors(names, found):
    return "; ".join(
        f"{name} by {row.error:+.3f} +- {row.sigma:.3f} m"
        + (f" (or else {row.or_else})" if row.or_else else "")
        for name, row in zip(names, found.itertuples(index=False), strict=True)
    )


def _outliers(a, missed):
    """missed: places of effects that the model leaves out, which may be what lies outside."""
    for kind, what in (("tie", "tie point"), ("mark", "mark")):
        found = a.statistics[kind]
        if not found or not found["outliers"]:
            continue
        share = 100.0 * found["outliers"] / found["count"]
        gross = f"; {found['gross']} of them beyond 15 are left out of the RMS"
        gross = gross if found["gross"] else ""
        advice = ": a robust loss (huber:2) limits their weight" if a.system.loss.kind == 0 else ""
        yield (
            f"{found['outliers']} of {found['count']} {what} observations ({share:.2g} %) "
            f"{'lies' if found['outliers'] == 1 else 'lie'} beyond 5 robust sigmas{gross}{advice}."
        )
    # What most of a kind does is no outlier of it.
    few = 2 * a.statistics.get("gnss", {}).get("outliers", 0) <= len(a.residuals["gnss"])
    reject = "; --reject-gnss leaves such out" if few and "antenna" not in missed else ""
    for kind, what, remedy in (
        ("gnss", "GNSS position", reject),
        ("control", "control point", ""),
        ("attitude", "attitude", ""),
    ):
        found = a.statistics.get(kind)
        if found and found["outliers"]:
            frame = a.residuals[kind]
            names = frame.loc[frame["outlier"], frame.columns[0]].astype(str).tolist()
            yield (
                f"{counted(len(names), what)} {'lies' if len(names) == 1 else 'lie'} beyond 5 "
                f"robust sigmas: {some(names, 10)}{remedy}."
            )


def may_be_zero(a: Tables) -> pd.DataFrame:
    """Rows of `camera` with the coefficients that may all be zero together, camera by camera.

    Each is below two standard deviations; of those that go together, as k1 to k3 do, the one of the
    most standard deviations is left free until the rest passes the test of all (95 %).
    Source: the general linear hypothesis, Koch 1999, section 4.2.
    """
    free = a.camera[a.camera["free"] & (a.camera["unit"] == "") & (a.camera["sigma"] > 0)]
    share = (free["value"] / free["sigma"]).rename(None)
    weak = list(free.index[share.abs() < _TWO_SIGMAS])
    label = "camera." + free["camera"].astype(str) + "." + free["parameter"].astype(str)
    if not weak:
        return a.camera.loc[[]]
    matrix, kept = a.correlation_matrix, []
    for _, mine in free.loc[weak].groupby("camera", sort=False):
        rows = list(mine.index)
        while len(rows) > 1:
            rho = matrix.loc[label[rows], label[rows]].to_numpy()
            value = share[rows].to_numpy()
            if value @ np.linalg.pinv(rho, hermitian=True) @ value < chdtri(len(rows), _BY_CHANCE):
                break
            rows.remove(share[rows].abs().idxmax())
        kept += rows
    return a.camera.loc[sorted(kept)]


def _insignificant(a):
    weak = may_be_zero(a)
    if len(weak):
        alike: dict[str, list[str]] = {}
        for parameter, rows in weak.groupby("parameter", sort=False):
            alike.setdefault(some(rows["camera"], 10), []).append(str(parameter))
        names = [f"{some(own, 10)} of camera {camera}" for camera, own in alike.items()]
        yield f"Not significantly different from zero: {'; '.join(names)}."
    told = a.effects[a.effects["sigma"] > 0]
    members, block = a.problem.stack.members, a.problem.block
    for slug, mine in told.groupby("slug", sort=False):
        if members[slug].effect.believed(block):
            continue
        share = (mine["value"] / mine["sigma"]).abs()
        # Of many values some reach two sigmas by chance; all together, two sigmas do not.
        if len(mine) <= 10 and share.max() < 2.0:
            values = (
                f"none of its {len(mine)} values reaches" if len(mine) > 1 else "it stays below"
            )
            yield (
                f"This block does not show the effect {slug}: {values} two sigmas (largest "
                f"{share.max():.1f}). Without it everything else is determined better."
            )
