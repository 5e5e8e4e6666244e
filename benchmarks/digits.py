"""Published numbers of other programs beside ours, counted in digits.

    python -m benchmarks.digits --data FOLDER -o docs/digits.md

Each row is one kind of number of one published answer: how many there are, how many agree to the
last printed digit (within half a unit of it), the least and the median of

    LRE = -log10 |ours - published| / |published|

and one verdict: `all` (every digit), or `within` with the largest difference in published standard
deviations. What a print cannot give (a standard deviation of three digits has an LRE of 2.4 to 4)
is no fault of either. Source: NIST Statistical Reference Datasets (log relative error).
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import norm

import corridor
from benchmarks import image_to_ray, nist
from corridor.core.adjustment.cofactors import of_points
from corridor.core.adjustment.reliability import OF_ALL, critical
from corridor.core.camera import INTERIOR
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.tools.formats import read_project

# A pose ends so near the optimum, in standard deviations, where both programs stop.
AT_REST = 5e-5
# So far from the least sum of squares, in standard deviations, AICON's run stopped.
AICON_STOPPED = 0.04


@dataclass
class Row:
    """One kind of number of one answer. pairs: (ours, published, half a unit of the last digit)."""

    answer: str
    what: str
    pairs: list[tuple[float, float, float]] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    allowed: float = AT_REST

    @property
    def equal(self) -> int:
        """How many agree to the last printed digit."""
        # A sum of rounded numbers and the print may both end on a five.
        return sum(abs(ours - theirs) <= 1.0001 * half for ours, theirs, half in self.pairs)

    @property
    def lre(self) -> np.ndarray:
        """Log relative error of each."""
        out = []
        for ours, theirs, _ in self.pairs:
            away = abs(ours - theirs) / (abs(theirs) or 1.0)
            out.append(min(-math.log10(away), 15.0) if away > 0 else 15.0)
        return np.array(out)

    @property
    def worst(self) -> float:
        """Largest difference in published standard deviations; NaN where none is printed."""
        away = [
            max(abs(ours - theirs) - half, 0.0) / sigma
            for (ours, theirs, half), sigma in zip(self.pairs, self.sigmas, strict=False)
            if sigma > 0
        ]
        return max(away, default=math.nan)

    @property
    def verdict(self) -> str:
        """`all`, `within ... sigma`, or `differs`."""
        if self.equal == len(self.pairs):
            return "all"
        if self.sigmas and self.worst <= (self.allowed):
            return f"within {self.worst:.1g} sigma"
        if not self.sigmas and all(abs(a - b) <= 3.0 * half for a, b, half in self.pairs):
            return "within a unit of the last digit"
        return "differs"

    def line(self) -> str:
        """A row of the table in the documentation."""
        lre = self.lre
        return (
            f"| `{self.answer}` | {self.what} | {len(self.pairs)} | {self.equal} | {lre.min():.1f} "
            f"| {np.median(lre):.1f} | {self.verdict} |"
        )


def half_unit(text) -> float:
    """Half a unit of the last digit of a printed number."""
    mantissa, _, power = f"{text}".lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(power or 0) - decimals)


def angles(rotation: np.ndarray) -> np.ndarray:
    """Omega, phi, kappa (n, 3), degrees, of R = diag(1, -1, -1) (R1(omega) R2(phi) R3(kappa))'."""
    m = (np.diag([1.0, -1.0, -1.0]) @ rotation).transpose(0, 2, 1)
    phi = np.arcsin(np.clip(m[:, 0, 2], -1, 1))
    omega = np.arctan2(-m[:, 1, 2], m[:, 2, 2])
    kappa = np.arctan2(-m[:, 0, 1], m[:, 0, 0])
    return np.degrees(np.column_stack([omega, phi, kappa]))


def _angle_covariances(adjusted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles (m, 3), the standard deviations of centre and angles (m, 6) and their correlations
    (m, 6, 6), in file order."""
    p, state = adjusted.problem, adjusted.state
    covariance = adjusted.covariance.each_pose[:, :6, :6]
    middle = angles(state.rotation)
    turn = np.zeros((len(middle), 3, 3))
    for k in range(3):
        small = 1e-6 * np.eye(3)[k]
        ahead, back = (
            angles(rotation_from_vector(np.tile(sign * small, (len(middle), 1))) @ state.rotation)
            for sign in (1, -1)
        )
        turn[:, :, k] = (np.mod(ahead - back + 180, 360) - 180) / 2e-6
    by = np.zeros((len(middle), 6, 6))
    by[:, :3, :3], by[:, 3:, 3:] = np.eye(3), turn
    full = by @ covariance @ by.transpose(0, 2, 1)
    size = np.sqrt(np.einsum("nii->ni", full))
    order = np.empty_like(p.order)
    order[p.order] = np.arange(len(order))
    like = full / size[:, :, None] / size[:, None]
    return middle[order], adjusted.sigma0 * size[order], like[order]


_ANGLES, _CENTRE = ("Omega", "Phi", "Kappa"), ("Xc", "Yc", "Zc")


def of_photogrammetry(folder: Path) -> Iterator[Row]:
    """Rows of one block with its expected.json."""
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    published, name = expected["published"], folder.name
    block = corridor.read(folder)
    adjusted = corridor.adjust(block, weights="stated", **expected["adjust"])
    yield from _of_solution(name, adjusted, published)
    yield from _of_residuals(name, adjusted, published)
    yield from _of_control(name, adjusted, published)
    photos = next((v for k, v in published.items() if k.startswith("photos")), None)
    if photos:
        yield from _of_poses(name, adjusted, photos, published.get("correlations over 95 %", {}))


def _of_solution(name: str, adjusted, published: dict) -> Iterator[Row]:
    """Sigma naught of everything, and the redundancy."""
    sigma0 = math.sqrt(2 * adjusted.cost / adjusted.redundancy)
    for what, ours in (("sigma0", sigma0), ("redundancy", adjusted.redundancy)):
        if what in published:
            text = published[what]
            yield Row(name, what, [(ours, float(text), half_unit(text))])


def _factor(adjusted) -> float:
    """By how much standard deviations of sigma naught of everything are larger than ours."""
    return math.sqrt(2 * adjusted.cost / adjusted.redundancy) / adjusted.sigma0


def _of_poses(name: str, adjusted, photos: dict, correlations: dict) -> Iterator[Row]:
    """Poses with their standard deviations and their strong correlations."""
    block, factor = adjusted.block, _factor(adjusted)
    turned, sigma, like = _angle_covariances(adjusted)
    offset = block.offset
    centre = adjusted.pose[:, :3] + offset
    of_image = {str(image): k for k, image in enumerate(block.images["image"])}
    values = Row(name, "poses", allowed=AT_REST)
    errors = Row(name, "standard deviations of poses")
    for image, photo in photos.items():
        k = of_image.get(image)
        if k is None:
            continue
        for at, label in enumerate((*_CENTRE, *_ANGLES)):
            text, spread = photo[label], photo.get(f"s{label}")
            ours = centre[k, at] if at < 3 else turned[k, at - 3]
            theirs = float(text)
            if at >= 3:
                ours = theirs + (ours - theirs + 180) % 360 - 180
            values.pairs.append((float(ours), theirs, half_unit(text)))
            values.sigmas.append(float(spread) if spread else 0.0)
            if spread:
                found = factor * sigma[k, at]
                errors.pairs.append((float(found), float(spread), half_unit(spread)))
    yield values
    if errors.pairs:
        yield errors
    strong = Row(name, "correlations over 95 %")
    labels = [*_CENTRE, *_ANGLES]
    for key, text in correlations.items():
        image, _, one = key.partition(": ")
        for other, value in re.findall(r"(\w+):(-?[\d.]+)%", text):
            ours = 100.0 * like[of_image[image], labels.index(one), labels.index(other)]
            strong.pairs.append((float(ours), float(value), half_unit(value)))
    if strong.pairs:
        yield strong


def _of_residuals(name: str, adjusted, published: dict) -> Iterator[Row]:
    """Norm of the weighted residuals, root mean square of image points and the largest, px."""
    v = np.concatenate(
        [adjusted.residuals[kind][["vx", "vy"]].to_numpy(float) for kind in ("tie", "mark")]
    )
    square = np.sum(v**2, axis=1)
    row = Row(name, "residuals: norm, RMS, largest")
    for what, ours in (
        ("residual_norm", math.sqrt(2 * adjusted.cost)),
        ("image_rms_px", math.sqrt(square.mean())),
        ("largest_residual_px", math.sqrt(square.max())),
    ):
        text = published[what]
        row.pairs.append((ours, float(text), half_unit(text)))
    yield row


def _of_control(name: str, adjusted, published: dict) -> Iterator[Row]:
    """Control points as adjusted, with their standard deviations; exact ones have none."""
    given = next((v for k, v in published.items() if k.startswith("control adjusted")), {})
    points = adjusted.points.assign(point=adjusted.points["point"].astype(str))
    at = {point: k for k, point in enumerate(points["point"])}
    places, sigma = points[["x", "y", "z"]].to_numpy(float), adjusted.point_sigma
    values, errors = Row(name, "control"), Row(name, "standard deviations of control")
    for point, printed in given.items():
        k = at[point]
        for axis in range(3):
            ours = float(places[k, axis] + adjusted.block.offset[axis])
            values.pairs.append((ours, float(printed[axis]), half_unit(printed[axis])))
            spread = printed[3 + axis]
            if float(spread):
                own = float(sigma[k, axis] * _factor(adjusted))
                errors.pairs.append((own, float(spread), half_unit(spread)))
    yield from (row for row in (values, errors) if row.pairs)


def of_list(folder: Path) -> Iterator[Row]:
    """Rows of a block whose published numbers stand in a list of names and values."""
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    numbers = {name: value for name, value, *_ in expected["published"]}
    block = corridor.read(folder)
    adjusted = corridor.adjust(block, camera="fixed", weights="stated")
    at = adjusted.points.assign(point=adjusted.points["point"].astype(str)).set_index("point")
    sigma = dict(zip(at.index, adjusted.point_sigma, strict=True))
    values, errors = Row(folder.name, "points", allowed=0.1), Row(folder.name, "their sigmas")
    for name, value in numbers.items():
        kind, _, which = name.partition(".")
        point, axis = which[:-1], which[-1:].lower()
        if point not in at.index or axis not in "xyz":
            continue
        k = "xyz".index(axis)
        if kind == "value":
            ours = float(at.loc[point, axis]) + float(block.offset[k])
            values.pairs.append((ours, float(value), half_unit(value)))
            values.sigmas.append(float(numbers.get(f"sigma.{which}", 0.0)))
        else:
            errors.pairs.append((float(sigma[point][k]), float(value), half_unit(value)))
    if values.pairs:
        yield values
        yield errors


# --- AICON ---------------------------------------------------------------------------------------

# Conventions, proved from the printed residuals: image coordinates in mm, x right and y up, camera
# constant negative, distortion from the ray to the image:
# dr = A1 r (r^2 - R0^2) + A2 r (r^4 - R0^4).
_SENSOR_MM, _SENSOR_PX, _SIGMA_MM, _MM = (35.968, 23.979), (8688, 5792), 0.0005, 1e-3


def _numbers(path: Path) -> list[list[str]]:
    import gzip

    opened = gzip.open(path, "rt") if path.suffix == ".gz" else path.open()
    with opened as file:
        return [line.split() for line in file if line.strip()]


def aicon_block(folder: Path) -> corridor.Block:
    """The AICON project as a block in metres: a free network with its scale bar."""
    pitch = _SENSOR_MM[0] / _SENSOR_PX[0]
    lines = _numbers(folder / "example.ior")
    constant, xh, yh, a1, a2, r0 = map(float, lines[0][2:])
    c1, c2 = map(float, lines[3])
    f = -constant * (1 - a1 * r0**2 - a2 * r0**4)
    camera = corridor.Camera.from_table(
        "A",
        {
            "width": _SENSOR_PX[0], "height": _SENSOR_PX[1], "f": f / pitch,
            "cx": (_SENSOR_PX[0] - 1) / 2 + xh / pitch, "cy": (_SENSOR_PX[1] - 1) / 2 - yh / pitch,
            "k1": -a1 * constant**3 / f, "k2": -a2 * constant**5 / f, "b1": c1, "b2": -c2,
        },
    )  # fmt: skip
    points = {
        row[0]: [float(x) * _MM for x in row[1:4]] for row in _numbers(folder / "example.obc")
    }
    images, names = [], {}
    for row in _numbers(folder / "example.eor"):
        place, turn = np.array(row[2:5], float) * _MM, np.array(row[5:8], float)
        (so, sp, sk), (co, cp, ck) = np.sin(turn), np.cos(turn)
        to_world = (
            np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
            @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
        )
        rotation = np.diag([1.0, -1.0, -1.0]) @ to_world.T
        names[row[0]] = f"I{row[0]}"
        images.append((names[row[0]], "A", *place, *quaternion_from_rotation(rotation[None])[0]))
    rays = [
        (f"P{row[1]}", names[row[0]], (_SENSOR_PX[0] - 1) / 2 + float(row[2]) / pitch,
         (_SENSOR_PX[1] - 1) / 2 - float(row[3]) / pitch)
        for row in _numbers(folder / "example.phc.gz")
        if row[9] == "1" and row[1] in points and row[0] in names
    ]  # fmt: skip
    ties = pd.DataFrame(rays, columns=["point", "image", "x", "y"])
    often = ties["point"].value_counts()
    ties = ties[ties["point"].map(often) > 1].reset_index(drop=True)
    # Four measurements of two pictures have ten times the standard deviation of all others.
    stated = {key: float(words[6]) / pitch for key, words in _aicon_rays(folder).items()}
    ties["sigma"] = [stated[pair] for pair in zip(ties["point"], ties["image"], strict=True)]
    (bar,) = _numbers(folder / "example.scale")
    return corridor.Block(
        name="aicon",
        cameras={"A": camera},
        images=pd.DataFrame(images, columns=["image", "camera", *"xyz", "qw", "qx", "qy", "qz"]),
        tie_points=ties,
        points=pd.DataFrame([(f"P{k}", *v) for k, v in points.items()], columns=["point", *"xyz"]),
        sigma={"tie_px": _SIGMA_MM / pitch},
        distances=pd.DataFrame(
            {
                "from": [f"P{bar[2]}"], "to": [f"P{bar[3]}"],
                "distance": [float(bar[4]) * _MM], "sigma": [float(bar[5]) * _MM],
            }
        ),
    )  # fmt: skip


def of_aicon(folder: Path) -> Iterator[Row]:
    """Rows of AICON's protocol: sigma naught, redundancy, points and their standard deviations in
    its datum (all object points, the scale by the bar)."""
    adjusted = corridor.adjust(aicon_block(folder), camera="f,cx,cy,k1,k2,p1,p2")
    yield Row("aicon", "redundancy", [(adjusted.redundancy, 18804.0, 0.5)])
    ours = adjusted.sigma0 * _SIGMA_MM
    yield Row("aicon", "sigma0 (mm)", [(ours, 0.000405, 5e-7)])
    bar = adjusted.distances.iloc[0]
    yield Row("aicon", "scale bar (mm)", [((bar["given"] - bar["v"]) / _MM, 1389.688, 5e-4)])
    table = adjusted.relative_precision(scale=False).set_index("point")
    printed = {f"P{row[0]}": row[1:7] for row in _numbers(folder / "example.obc")}
    both = [name for name in table.index if name in printed]
    found = table.loc[both, ["x", "y", "z"]].to_numpy(float) / _MM
    given = np.array([[float(x) for x in printed[name][:3]] for name in both])
    # In the datum of the print: laid on all its points, without a scale.
    a, b = found - found.mean(axis=0), given - given.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    laid = a @ turn + given.mean(axis=0)
    sigma = table.loc[both, ["sx", "sy", "sz"]].to_numpy(float) / _MM
    places = Row("aicon", "points (mm)", allowed=AICON_STOPPED)
    errors = Row("aicon", "standard deviations of points (mm)")
    for k, name in enumerate(both):
        for at in range(3):
            value, spread = printed[name][at], printed[name][3 + at]
            places.pairs.append((laid[k, at], float(value), half_unit(value)))
            places.sigmas.append(float(spread))
            errors.pairs.append((sigma[k, at], float(spread), half_unit(spread)))
    yield places
    yield errors
    yield from _of_aicon_poses(folder, adjusted)
    yield from _of_aicon_rays(folder, adjusted)


def _of_aicon_poses(folder: Path, adjusted) -> Iterator[Row]:
    """Correlations of every pose with the camera, in AICON's datum (all object points, scale by the
    bar): centre, and turns about the axes of the object; and the standard deviations of centres."""
    p = adjusted.problem
    found = adjusted.in_datum(scale=False)
    free = [n for n, one in enumerate(p.unknowns) if one.kind == "camera"]
    value = adjusted.state.interior[0].copy()
    names = [p.unknowns[n].label.rpartition(".")[2] for n in free]
    at = [INTERIOR.index(name) for name in names]
    step = np.maximum(np.abs(value[at]), 1e-6) * 1e-6
    by = np.zeros((7, len(at)))
    for k, place in enumerate(at):
        ahead, back = value.copy(), value.copy()
        ahead[place] += step[k]
        back[place] -= step[k]
        by[:, k] = (_as_aicon(ahead) - _as_aicon(back)) / (2 * step[k])
    camera = by @ adjusted.covariance.shared[np.ix_(free, free)] @ by.T
    size = np.sqrt(np.diag(camera))
    ours, sigmas = {}, {}
    for k, name in enumerate(p.images.names):
        # Ours turn the object in the camera; AICON's turn the camera about the object's axes.
        turn = np.eye(6)
        turn[3:, 3:] = -adjusted.state.rotation[k].T
        cross = turn @ found.poses_shared[k][:6][:, free] @ by.T
        spread = np.sqrt(np.diag(turn @ found.poses[k][:6, :6] @ turn.T))
        ours[str(name)] = cross / spread[:, None] / size
        sigmas[str(name)] = adjusted.sigma0 * spread[:3] / _MM
    row = Row("aicon", "correlations of poses with the camera")
    own = Row("aicon", "correlations of the camera")
    errors = Row("aicon", "standard deviations of centres (mm)")
    printed, poses, spreads = _aicon_correlations(folder)
    whole = camera / size[:, None] / size
    for i, line in enumerate(printed):
        own.pairs += [
            (whole[i, j], float(text), half_unit(text)) for j, text in enumerate(line[:i])
        ]
    for name, table in poses.items():
        for i, line in enumerate(table):
            row.pairs += [
                (ours[name][i, j], float(text), half_unit(text)) for j, text in enumerate(line)
            ]
    for name, line in spreads.items():
        errors.pairs += [
            (float(sigmas[name][i]), float(text), half_unit(text)) for i, text in enumerate(line)
        ]
    yield own
    yield row
    yield errors


def _of_aicon_rays(folder: Path, adjusted) -> Iterator[Row]:
    """Redundancy of every image coordinate and its test value |v| / (s0 sqrt(r)), printed with two
    digits each."""
    p = adjusted.problem
    printed = {key: words[8:12] for key, words in _aicon_rays(folder).items()}
    residuals = adjusted.residuals["tie"]
    v = residuals[["vx", "vy"]].to_numpy() / residuals["sigma"].to_numpy()[:, None]
    shares = Row("aicon", "redundancies of rays")
    # AICON stopped 0.02 standard deviations beside the least sum of squares.
    tests = Row("aicon", "test values of rays", allowed=AICON_STOPPED)
    table = p.block.tie_points
    names = list(zip(table["point"].astype(str), table["image"].astype(str), strict=True))
    for one in of_points(adjusted.covariance, range(len(p.ptr) - 1)):
        rows = p.row[p.ptr[one.point] : p.ptr[one.point + 1]]
        share = np.diag(one.share)[: 2 * len(rows)].reshape(-1, 2)
        for row, r in zip(rows.tolist(), share, strict=True):
            line = printed[names[row]]
            w = np.abs(v[row]) / adjusted.sigma0 / np.sqrt(r)
            shares.pairs += [(float(r[k]), float(line[k]), half_unit(line[k])) for k in (0, 1)]
            tests.pairs += [
                (float(w[k]), float(line[2 + k]), half_unit(line[2 + k])) for k in (0, 1)
            ]
    tests.sigmas = [1.0] * len(tests.pairs)
    yield shares
    yield tests
    (text,) = {
        words[-1] for words in _protocol(folder) if words[:1] == ["Testwert"] and "den" in words
    }
    count = len(tests.pairs) + len(p.distance_given)
    alpha = 2.0 * norm.sf(_normal_quantile(OF_ALL / count / 2.0))
    ours = critical(alpha, adjusted.redundancy)
    yield Row("aicon", "critical value of the outlier test", [(ours, float(text), half_unit(text))])


def _normal_quantile(p: float) -> float:
    """What a normal number exceeds with a small probability, good to 4.5e-4, as AICON has it.

    Source: Abramowitz and Stegun 1964, 26.2.23.
    """
    t = math.sqrt(-2.0 * math.log(p))
    above = 2.515517 + 0.802853 * t + 0.010328 * t * t
    return t - above / (1.0 + 1.432788 * t + 0.189269 * t * t + 0.001308 * t**3)


def _aicon_rays(folder: Path) -> dict[tuple[str, str], list[str]]:
    """Printed line of every measurement: point, picture, x, y, vx, vy, a priori sx and sy,
    redundancy of x and y, test value of both."""
    found = {}
    for words in _protocol(folder):
        if len(words) == 12 and words[0].isdigit() and words[1].isdigit() and words[6] == words[7]:
            found[f"P{words[0]}", f"I{words[1]}"] = words
    return found


def _protocol(folder: Path) -> list[list[str]]:
    """Words of every line of AICON's protocol."""
    import gzip

    with gzip.open(folder / "example.htm.gz", "rt", encoding="latin-1") as file:
        return [re.sub(r"<[^>]*>", " ", line).split() for line in file]


def _as_aicon(interior: np.ndarray) -> np.ndarray:
    """Ck, Xh, Yh, A1, A2, B1, B2 (mm) of our interior parameters."""
    pitch, r0 = _SENSOR_MM[0] / _SENSOR_PX[0], 13.488
    of = dict(zip(INTERIOR, interior, strict=False))
    f, c = of["f"] * pitch, -of["f"] * pitch
    for _ in range(50):  # f = -c (1 - A1 r0^2 - A2 r0^4), which A1 and A2 have in them
        a1, a2 = -of["k1"] * f / c**3, -of["k2"] * f / c**5
        c = -f / (1 - a1 * r0**2 - a2 * r0**4)
    xh = (of["cx"] - (_SENSOR_PX[0] - 1) / 2) * pitch
    yh = -(of["cy"] - (_SENSOR_PX[1] - 1) / 2) * pitch
    return np.array([c, xh, yh, a1, a2, of["p1"] * f / c**2, -of["p2"] * f / c**2])


def _aicon_correlations(folder: Path):
    """Printed correlations of the camera, and of each picture: six lines of seven; and the
    standard deviations of its centre, mm."""
    camera: list[list[str]] = []
    poses: dict[str, list[list[str]]] = {}
    spreads: dict[str, list[str]] = {}
    image = ""
    for words in _protocol(folder):
        if len(words) == 9 and words[0].isdigit() and words[1] == "1":
            image = f"I{words[0]}"
            spreads[image] = words[5:8]
        elif len(words) == 8 and words[0] in ("x", "y", "z", "rx", "ry", "rz"):
            poses.setdefault(image, []).append(words[1:])
        elif words and words[0] in ("Ck", "Xh", "Yh", "A1", "A2", "B1", "B2"):
            if not image and len(words) == 2 + len(camera) and words[-1] == "1.000":
                camera.append(words[1:])
    return camera, poses, spreads


def of_roma(data: Path) -> Iterator[Row]:
    """Roma with a principal point a photograph: 127 unknowns of the camera. DBAT's lens goes from
    the image to the ray, so that only the redundancy is comparable."""
    expected = json.loads((data / "digits" / "roma_imagevariant" / "expected.json").read_text())
    adjusted = corridor.adjust(
        data / "roma", camera="f,k1,k2,k3,p1,p2,b1", effects="principal_point_per_flight@image"
    )
    theirs = expected["published"]["redundancy"]
    yield Row("roma_imagevariant", "redundancy", [(adjusted.redundancy, theirs, 0.5)])


def table(rows: Iterable[Row]) -> str:
    """The page."""
    rows = list(rows)
    done = sum(row.verdict != "differs" for row in rows)
    numbers = sum(len(row.pairs) for row in rows)
    equal = sum(row.equal for row in rows)
    lines = [
        "# Digits",
        "",
        "Published numbers of other programs beside those of corridor, from the same measurements.",
        f"Of {numbers:,} printed numbers {equal:,} agree to the last digit; {done} of {len(rows)} "
        "rows agree as well as both programs can say.",
        "",
        "LRE is the number of digits that agree (log relative error). A standard deviation",
        "is printed with three digits, which gives an LRE of 2.4 to 4. `within ... sigma`: the",
        "largest difference beyond the printed digits, in published standard deviations; both",
        f"programs stop before {AT_REST:g} of one. AICON's run stopped beside the least sum of",
        f"squares, as its points and test values show: less than {AICON_STOPPED:g} of one.",
        "",
        "`python -m benchmarks.digits --data FOLDER -o docs/digits.md` makes this page; the data",
        "are those of DBAT (camera calibration, Strasbourg), of pyBundleBlock and of AICON. NIST's",
        "27 regressions (StRD, eleven certified digits) go through the solver of adjustments, each",
        "from its near start; of the 27 far starts it claims no result for five. DBAT's runs of",
        "camcal without a datum, with a point of one ray and with missing measurements end without",
        "a result; corridor's converge, and what both count is compared. The lenses of camcal go",
        "from the measured image point to the ray: an effect (`benchmarks/image_to_ray.py`).",
        "",
        "| answer | numbers | printed | equal | least LRE | median LRE | verdict |",
        "|---|---|---|---|---|---|---|",
        *(row.line() for row in rows),
        "",
    ]
    return "\n".join(lines)


def of_camcal(data: Path) -> Iterator[Row]:
    """Rows of DBAT's camera calibrations by its five lenses, from the image to the ray."""
    for answer, model in (
        ("camcal_5photos", 3), *((f"camcal_model{model}", model) for model in range(1, 6)),
    ):  # fmt: skip
        report = data / "dbat" / "camcal" / f"camcal-dbatreport-model{model}.txt"
        adjusted, pitch = image_to_ray.calibrated(data, model, few=answer == "camcal_5photos")
        if answer == "camcal_5photos":
            folder = data / "digits" / answer
            published = json.loads((folder / "expected.json").read_text())["published"]
            photos, camera = published["photos (deg, m)"], published["camera (mm; value, sigma)"]
        else:
            published, camera, photos = image_to_ray.report(report)
            same = data / "digits" / answer / "expected.json"
            if same.is_file():
                published |= json.loads(same.read_text())["published"]
        yield from _of_solution(answer, adjusted, published)
        if "image_rms_px" in published:
            yield from _of_residuals(answer, adjusted, published)
        ours, sigma = image_to_ray.camera_of(adjusted, pitch)
        values, errors = Row(answer, "camera"), Row(answer, "standard deviations of the camera")
        for name, found in ours.items():
            text, spread = camera[name]
            values.pairs.append((found, float(text), half_unit(text)))
            values.sigmas.append(float(spread))
            own = sigma[name] * _factor(adjusted)
            errors.pairs.append((own, float(spread), half_unit(spread)))
        yield from (values, errors)
        yield from _of_poses(answer, adjusted, photos, {})


def of_dbat_failures(folder: Path) -> Iterator[Row]:
    """Rows of DBAT's runs that end without a result: what it counts before it stops. corridor lays
    a datum on the start, leaves points of one ray out, and adjusts."""
    for run, report in (
        ("pmexport", "no-datum"), ("pmexport-1ray", "1ray"),
        ("pmexport-missing-obs", "missing-obs"),
    ):  # fmt: skip
        block = read_project(folder / f"camcal-{run}.txt").block
        adjusted = corridor.adjust(block, camera="f,cx,cy,k1,k2,k3,p1,p2,b1")
        assert adjusted.converged, report
        p, printed = adjusted.problem, (folder / f"camcal-dbatreport-{report}.txt").read_text()

        def number(label: str, text: str = printed) -> float:
            return float(re.search(rf"{label}\D*(\d+)", text)[1])

        lost = len(block.tie_points) - len(p.block.tie_points)
        pairs = [(p.observation_count + 2 * lost, number("Number of observations:"), 0.5)]
        if report == "no-datum":
            pairs.append((p.unknown_count, number("Number of params:"), 0.5))
            pairs.append((len(adjusted.system.held), number("deficiency:"), 0.5))
        else:
            # Unknowns of points that too few rays show; the four of control are tie points here.
            few = len(block.points) - len(p.ptr[1:])
            rest = p.unknown_count - 12 + 3 * few
            pairs.append((rest, number("Number of params:"), 0.5))
            pairs.append((3 * few - 2 * lost, number("deficiency:"), 0.5))
        yield Row(f"camcal {report}", "measurements, unknowns, rank deficiency", pairs)


def of_nist() -> Iterator[Row]:
    """Rows of NIST's certified regressions through the solver, from their near starts."""
    values, errors, squares = (
        Row("NIST StRD", what, allowed=1e-3)
        for what in ("values", "standard deviations", "sums of squares")
    )
    for name in nist.MODELS:
        b, sigma, left, converged = nist.fitted(name, 1)
        _, certified, spread, total, *_ = nist.read(name)
        # Eleven digits are certified; rounding of the residuals leaves Lanczos1 none.
        pairs = [(values, b, certified)]
        if name != "Lanczos1":
            pairs += [(errors, sigma, spread), (squares, np.array([left]), np.array([total]))]
        for row, ours, theirs in pairs:
            half = 0.5 * 10.0 ** (np.floor(np.log10(np.abs(theirs))) - 10)
            row.pairs += list(zip(ours.tolist(), theirs.tolist(), half.tolist(), strict=True))
            # Of Lanczos1 standard deviations are rounding.
            allowed = np.zeros(len(b)) if name == "Lanczos1" else spread
            row.sigmas += (allowed if row is values else 0.1 * np.abs(theirs)).tolist()
        assert converged, name
    yield from (values, errors, squares)


def rows_of(data: Path, only: Iterable[str] = ()) -> Iterator[Row]:
    """Rows of every answer under a folder `digits`; only: names of some."""
    only = set(only)
    for folder in sorted((data / "digits").iterdir()):
        if only and folder.name not in only or not (folder / "block.toml").is_file():
            continue
        if folder.name.startswith("camcal"):
            continue
        expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
        many = isinstance(expected["published"], list)
        yield from (of_list if many else of_photogrammetry)(folder)
    if (data / "dbat" / "camcal").is_dir() and (not only or "camcal" in only):
        yield from of_camcal(data)
    if (data / "dbat" / "camcal").is_dir() and (not only or "camcal_failures" in only):
        yield from of_dbat_failures(data / "dbat" / "camcal")
    if not only or "nist" in only:
        yield from of_nist()
    if (data / "roma").is_dir() and (not only or "roma_imagevariant" in only):
        yield from of_roma(data)
    if (data / "aicon").is_dir() and (not only or "aicon" in only):
        yield from of_aicon(data / "aicon")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the published answers")
    parser.add_argument("--only", nargs="*", default=(), help="some answers only")
    parser.add_argument("-o", "--output", type=Path, help="page to write")
    options = parser.parse_args()
    found = []
    for row in rows_of(options.data, options.only):
        print(row.line(), flush=True)
        found.append(row)
    if options.output is not None:
        options.output.write_text(table(found), encoding="utf-8")


if __name__ == "__main__":
    main()
