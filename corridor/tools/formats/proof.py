"""The proof of an import: the imported points through the imported poses and camera.

A convention taken the wrong way (origin, order of p1 and p2, sense of rotation, direction of the
distortion) looks like a bad camera. Here each usual mistake is undone in turn; one that explains
the observations decisively better is named.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.camera import INTERIOR
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.tools.formats.cameras import FLIP
from corridor.tools.formats.project import Project
from corridor.tools.formats.rows import Rows, rows_of

# Above this median the import is refused.
MEDIAN_PX = 2.0
LARGE_PX = 3.0
_MOST_PX = 100_000
# An observation this far off, and so much further than the others, is damaged rather than noisy.
_GROSS_PX, _GROSS = 50.0, 30.0
# So much better, in RMS of the better nine tenths and in log likelihood, makes an alternative.
_BETTER, _LIKELIER, _LEAST_PX = 0.95, 10.0, 0.05
_SAMPLE = 20_000
# A picture of another size moves image points by more than this.
_OF_SIZE_PX = 10.0
# Cameras are looked at one by one up to so many, and from so many observations.
_CAMERAS, _LEAST_MEASUREMENTS = 12, 40


@brief
@dataclass(frozen=True)
class Residuals:
    """Lengths of residuals, px: how many, median, RMS, share above 3 px."""

    count: int
    median: float
    rms: float
    large: float

    @classmethod
    def of(cls, length: np.ndarray) -> "Residuals":
        """Statistics of lengths (n,); NaN (behind the camera) counts as infinitely long."""
        length = np.where(np.isnan(length), np.inf, length)
        if not len(length):
            return cls(0, np.nan, np.nan, np.nan)
        finite = length[np.isfinite(length)]
        rms = float(np.sqrt(np.mean(finite**2))) if len(finite) else np.inf
        return cls(len(length), float(np.median(length)), rms, float((length > LARGE_PX).mean()))

    def __str__(self) -> str:
        return (
            f"median {_px(self.median)}, RMS {_px(self.rms)}, {100 * self.large:.1f} % above "
            f"{LARGE_PX:g} px ({self.count:,} observations)"
        )


def _px(length: float) -> str:
    """A residual in words: no picture is so large that more than this says anything."""
    return f"{length:,.2f} px" if length < _MOST_PX else f"more than {_MOST_PX:,} px"


@brief
@dataclass
class Proof:
    """What reprojection says of an import.

    by_kind: residuals of tie points, marks, and pairs of the project itself. decided: the kind
    that the verdict is about. verdict: `proved`, `unproved` (nothing to reproject), `refused`.
    explained: the alternatives that explain the observations decisively better, as sentences, the
    best first. sentences: what else is seen. unposed: there are observations, and no pose.
    """

    by_kind: dict[str, Residuals] = field(default_factory=dict)
    decided: str = ""
    verdict: str = "unproved"
    explained: list[str] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    unposed: bool = False

    @property
    def main(self) -> Residuals | None:
        """The residuals that decide: tie points, else marks, else pairs of the project itself."""
        return self.by_kind.get(self.decided)

    def __str__(self) -> str:
        if self.main is None:
            return "proof: nothing to reproject, the conventions of this import are not proved"
        rows = [f"proof, {kind}: {found}" for kind, found in self.by_kind.items()]
        return "\n".join([*rows, *self.sentences, *self.explained])

    def refusal(self) -> str:
        """Why the import is refused, one sentence."""
        if self.unposed:
            return (
                "no image has a pose, so nothing proves the conventions of the project: the "
                "adjustment finds poses from the measurements"
            )
        if self.verdict == "unproved":
            if self.explained:
                return f"the rays of no point meet, so nothing is proved: {self.explained[0]}"
            return (
                "the project holds no image observation that could prove its conventions, and a "
                "block needs some: add them with --ground FILE, or as tie_points.csv or marks.csv"
            )
        said = "; ".join(self.explained) or (
            "no usual mistake of convention explains it (origin, p1 and p2, sense of rotation, y "
            "upwards, direction of distortion were tried)"
        )
        return (
            f"the imported points do not reproject: {self.main}; {said}; correct the project, or "
            "write it as it is with --force"
        )


@np.errstate(all="ignore")
def prove(project: Project) -> Proof:
    """Reproject what was imported, and try the usual mistakes of convention."""
    proof = Proof()
    block = project.block
    posed = {"x", "qw"} <= set(block.images.columns)
    kinds = []
    if posed and (len(block.tie_points) or len(block.marks)):
        rows = rows_of(block, complete=False).usable()
        ties = rows.point < rows.ties
        kinds = [("tie points", rows.only(ties)), ("marks", rows.only(~ties))]
    if posed and project.pairs is not None and len(project.pairs):
        kinds.append(("pairs of the project itself", _pairs(project)))
    kinds = [(kind, part) for kind, part in kinds if len(part.image)]
    if not kinds:
        measured = len(block.tie_points) or len(block.marks)
        proof.unposed = bool(measured) and not np.isfinite(block.poses).all(axis=1).any()
        proof.explained = _slips(block) if measured else []
        return proof
    lengths = {}
    for kind, part in kinds:
        lengths[kind] = np.linalg.norm(part.residuals(), axis=1)
        proof.by_kind[kind] = Residuals.of(lengths[kind])
    # Few marks prove less than the pairs the project itself vouches for.
    first = kinds[0]
    if first[0] == "marks" and len(kinds) > 1:
        first = kinds[-1]
    if first[0] == "marks" and proof.by_kind["marks"].median > MEDIAN_PX:
        first = _intersected(first, proof)
    proof.decided = first[0]
    for kind, part in kinds:
        _gross(kind, part, lengths[kind], proof)
        # A list of marks has an origin of its own.
        if kind == "marks" != first[0] and proof.by_kind[kind].median <= MEDIAN_PX:
            found = _alternatives(part, again=False)
            proof.sentences += [f"of the marks, {told}" for told in found[:1]]
    proof.explained = _alternatives(first[1])
    if not proof.explained:
        _by_camera(first[1], block, proof)
    rounded = _rounded(first[1], project.rounding)
    if rounded > 0.5 * MEDIAN_PX:
        proof.sentences.append(
            f"the file prints poses with so few digits that image points are off by up to "
            f"{rounded:.1f} px (median): the proof allows for it"
        )
    bad = proof.by_kind[first[0]].median > MEDIAN_PX + rounded
    if bad and not proof.explained:
        proof.explained = _slips(block)
    proof.verdict = "refused" if bad or proof.explained else "proved"
    if project.image_to_ray:
        # As image-to-ray programs state them.
        away = np.linalg.norm(first[1].undistorted_residuals(), axis=1)
        proof.sentences.append(f"in undistorted coordinates: {Residuals.of(away)}")
    for kind, found in proof.by_kind.items():
        # Of marks a reconstruction from photographs alone knows nothing yet.
        if kind != first[0] and found.median > MEDIAN_PX and not bad and project.form != "photos":
            proof.sentences.append(
                f"{kind} do not agree with the {first[0]}: their coordinates may be in another "
                "frame, or they were not used in the reconstruction"
            )
    return proof


def _slips(block: Block) -> list[str]:
    """What no camera has, and one in another unit."""
    slips = ((name, camera.slips) for name, camera in block.cameras.items())
    return [f"camera {name}: {'; '.join(told)}" for name, told in slips if told]


def _rounded(rows: Rows, rounding: tuple[float, float]) -> float:
    """By how much, px (median), half a unit of the last digit of every pose moves image points."""
    if not any(rounding):
        return 0.0
    away = np.linalg.norm(rows.positions[rows.point] - rows.centre[rows.image], axis=1)
    moved = rows.interior[rows.image, 0] * (rounding[0] / away + rounding[1])
    return float(np.nanmedian(moved))


def _intersected(marks: tuple[str, Rows], proof: Proof) -> tuple[str, Rows]:
    """Marks against the points where their own rays meet, where that fits and the given do not.

    Given ground points that were not used, or are check points of a poor block, prove nothing
    about conventions; their rays do.
    """
    kind, rows = "marks (points from their own rays)", marks[1]
    used = np.unique(rows.point)
    positions = rows.positions.copy()
    positions[used] = rows.intersected(used)
    own = replace(rows, positions=positions).usable()
    found = Residuals.of(np.linalg.norm(own.residuals(), axis=1))
    # Two rays always nearly meet.
    if found.count < 10 or found.count < 2.5 * len(np.unique(own.point)):
        return marks
    if not found.median <= MEDIAN_PX:
        return marks
    proof.by_kind[kind] = found
    return kind, own


def _pairs(project):
    block, pairs = project.block, project.pairs
    rows = rows_of(block, complete=False)
    at = {name: k for k, name in enumerate(rows.image_names)}
    return replace(
        rows,
        image=np.array([at[name] for name in pairs["image"]]),
        point=np.arange(len(pairs)),
        pixels=pairs[["x", "y"]].to_numpy(),
        point_names=pd.Index([f"pair {k + 1}" for k in range(len(pairs))]),
        positions=pairs[["X", "Y", "Z"]].to_numpy() - block.offset,
    )


def _gross(kind, rows, length, proof):
    typical = np.nanmedian(length) if np.isfinite(length).any() else 0.0
    behind = int(np.isnan(length).sum())
    if behind:
        proof.sentences.append(f"{behind} {kind} lie behind the camera that sees them")
    gross = length > max(_GROSS_PX, _GROSS * typical)
    if gross.any():
        worst = int(np.nanargmax(length))
        name = rows.point_names[rows.point[worst]]
        proof.sentences.append(
            f"{int(gross.sum())} {kind} are far off, the worst by {length[worst]:.0f} px: point "
            f"{name} in image {rows.image_names[rows.image[worst]]}"
        )


# --- the usual mistakes ----------------------------------------------------------------------


def _sample(rows: Rows) -> Rows:
    """All observations of points drawn evenly, at most some twenty thousand."""
    step = int(np.ceil(len(rows.image) / _SAMPLE))
    if step > 1:
        rows = rows.only(rows.point % step == 0)
    used, point = np.unique(rows.point, return_inverse=True)
    return replace(
        rows, point=point.ravel(), positions=rows.positions[used],
        point_names=rows.point_names[used],
    )  # fmt: skip


def _by_camera(rows: Rows, block, proof: Proof) -> None:
    """A mistake in one camera of several, which the others hide."""
    names = block.images["camera"]
    cameras = list(dict.fromkeys(names))
    if not 1 < len(cameras) <= _CAMERAS:
        return
    for name in cameras:
        mine = rows.only((names == name).to_numpy()[rows.image])
        if len(mine.image) < _LEAST_MEASUREMENTS:
            continue
        found = _alternatives(mine, again=False)
        proof.explained += [f"camera {name}: {sentence}" for sentence in found[:1]]
        own = Residuals.of(np.linalg.norm(mine.residuals(), axis=1))
        if own.median > MEDIAN_PX:
            proof.sentences.append(f"camera {name}: {own}")


def _alternatives(rows: Rows, again: bool = True) -> list[str]:
    """Mistakes that explain the observations, as sentences, the best first.

    again: whether points may be intersected anew.
    """
    rows = _sample(rows)
    with np.errstate(all="ignore"):
        base, anew = _lengths(rows), None
        found = []
        far = np.median(np.nan_to_num(base, nan=np.inf)) > _OF_SIZE_PX
        for name, steps in (_MISTAKES | _SIZES if far else _MISTAKES).items():
            other = _undone(rows, steps)
            if other is None:
                continue
            length = _lengths(other)
            better = _is_better(base, length)
            if better is None and again:
                # Points of a wrong pose are wrong too, unless they were given: meet the rays anew.
                length = _lengths(other, moved=True)
                anew = _lengths(rows, moved=True) if anew is None else anew
                better = _is_better(anew, length)
            if better is not None:
                found.append((better, name, Residuals.of(length)))
        shifted = _half_pixel(rows)
    found.sort(key=lambda entry: entry[0])
    sentences = [f"{name} would explain it: {residuals}" for _, name, residuals in found[:2]]
    if shifted and not found:
        sentences.append(shifted)
    return sentences


def _lengths(rows: Rows, moved: bool = False) -> np.ndarray:
    """Lengths (m,) of the residuals; moved: of the points where the rays meet."""
    if moved:
        rows = replace(rows, positions=rows.intersected(np.arange(len(rows.positions))))
    return np.linalg.norm(rows.residuals(), axis=1)


def _is_better(base: np.ndarray, other: np.ndarray) -> float | None:
    """RMS of the better nine tenths, other over base, where that decides; else None."""
    if len(base) < 6:
        return None
    low, high = (_trimmed(length) for length in (other, base))
    if not np.isfinite(low):
        return None
    if not np.isfinite(high):
        return low / 1e9 if low < MEDIAN_PX * 5 else None
    likelier = min(len(base), 1000) * np.log(max(high, 1e-9) / max(low, 1e-9))
    # Bad either way is no explanation.
    middle, before = (np.median(np.nan_to_num(x, nan=np.inf)) for x in (other, base))
    good = low < MEDIAN_PX or (low < 0.3 * high and middle < 0.3 * before)
    if good and low < _BETTER * high and likelier > _LIKELIER and high - low > _LEAST_PX:
        return low / high
    return None


def _trimmed(length):
    length = np.sort(np.where(np.isnan(length), np.inf, length))
    return float(np.sqrt(np.mean(length[: max(int(0.9 * len(length)), 1)] ** 2)))


def _half_pixel(rows: Rows) -> str | None:
    """A mean residual of half a pixel in both directions: adjusted projects have none."""
    residual = rows.residuals()
    residual = residual[np.isfinite(residual).all(axis=1)]
    if len(residual) < 20:
        return None
    middle = np.median(residual, axis=0)
    spread = robust_scale(residual, centred=True, axis=0)
    error = 1.2533 * spread / np.sqrt(len(residual))
    if (np.abs(np.abs(middle) - 0.5) < 0.15).all() and (error < 0.05).all():
        return (
            f"half a pixel of origin: the residuals have the median ({middle[0]:.2f}, "
            f"{middle[1]:.2f}) px, as if the first pixel's centre were counted as (0.5, 0.5) in "
            "the observations and (0, 0) in the camera, or the other way round"
        )
    return None


_EXCHANGED = [INTERIOR.index({"p1": "p2", "p2": "p1"}.get(name, name)) for name in INTERIOR] + [-1]
_BENT = np.array([False] * 3 + [True] * (len(INTERIOR) - 3) + [False])  # what bends the ray
# Steps that undo a mistake: the fields of `Rows` that change.
_STEPS: dict[str, Callable[[Rows], dict]] = {
    "right and down": lambda rows: {"pixels": rows.pixels + 0.5},
    "left and up": lambda rows: {"pixels": rows.pixels - 0.5},
    "p1, p2": lambda rows: {"interior": rows.interior[:, _EXCHANGED]},
    "transposed": lambda rows: {"rotation": rows.rotation.transpose(0, 2, 1)},
    # The three numbers are t of X = R P + t, not the centre.
    "C = -R' t": lambda rows: {"centre": -np.einsum("nji,nj->ni", rows.rotation, rows.centre)},
    # They were turned into a centre though they were one.
    "t = -R C": lambda rows: {"centre": -np.einsum("nij,nj->ni", rows.rotation, rows.centre)},
    "camera up": lambda rows: {"rotation": FLIP @ rows.rotation},
    # y of the observations counted upwards, from the other edge of the picture.
    "image up": lambda rows: _image_up(rows, rows.middle[rows.image, 1]),
    "image up about cy": lambda rows: _image_up(rows, rows.interior[rows.image, 2]),
    "from the middle": lambda rows: {"pixels": rows.pixels + rows.middle[rows.image]},
    "x, y": lambda rows: {"pixels": rows.pixels[:, ::-1]},
    "backwards": lambda rows: {"backwards": True},
    "other sign": lambda rows: {"interior": np.where(_BENT, -rows.interior, rows.interior)},
    "times 2": lambda rows: _in_size(rows, 2.0),
    "times 4": lambda rows: _in_size(rows, 4.0),
    "times 1/2": lambda rows: _in_size(rows, 0.5),
    "times 1/4": lambda rows: _in_size(rows, 0.25),
    "middle times 2": lambda rows: _about_middle(rows, 2.0),
    "middle times 1/2": lambda rows: _about_middle(rows, 0.5),
    "no distortion": lambda rows: {"interior": np.where(_BENT, 0.0, rows.interior)},
}


def _in_size(rows, factor):
    """Observations of pictures of another size, from the corner of the first pixel."""
    return {"pixels": factor * (rows.pixels + 0.5) - 0.5}


def _about_middle(rows, factor):
    """The principal point where it is in pictures of another size, as far from their middle."""
    interior = rows.interior.copy()
    interior[:, 1:3] += (factor - 1) * (rows.middle + 0.5)
    return {"interior": interior}


def _image_up(rows, about):
    x, y = rows.pixels.T
    return {"pixels": np.column_stack([x, 2 * about - y])}


# What is undone, one step after the other.
_MISTAKES: dict[str, tuple[str, ...]] = {
    "half a pixel of origin (the observations half a pixel further right and down)": (
        "right and down",
    ),
    "half a pixel of origin (the observations half a pixel further left and up)": ("left and up",),
    "p1 and p2 exchanged": ("p1, p2",),
    "a transposed rotation (camera to world in place of world to camera)": ("transposed",),
    # C made of t with the wrong rotation: t again, then C.
    "a transposed rotation (and the centre made with it)": ("t = -R C", "transposed", "C = -R' t"),
    "the translation t read as the centre": ("C = -R' t",),
    "the centre read as the translation t": ("t = -R C",),
    "y upwards in the camera frame (the camera looks along -z)": ("camera up",),
    "y upwards in the image": ("image up",),
    "y upwards in the image and in the camera frame": ("image up", "camera up"),
    "y upwards in the image (about the principal point)": ("image up about cy",),
    "y upwards in the image (about the principal point) and in the camera frame": (
        "image up about cy", "camera up",
    ),
    "a transposed rotation and y upwards": ("transposed", "camera up"),
    "the origin in the middle of the image": ("from the middle",),
    "x and y of the observations exchanged": ("x, y",),
    "the other direction of distortion (image to ray in place of ray to image)": ("backwards",),
    "the other sign of the distortion": ("other sign",),
    "observations that are free of distortion already": ("no distortion",),
}  # fmt: skip
_SIZES: dict[str, tuple[str, ...]] = {
    "image points measured in pictures of half the size": ("times 2",),
    "image points measured in pictures of a quarter of the size": ("times 4",),
    "image points measured in pictures of twice the size": ("times 1/2",),
    "image points measured in pictures of four times the size": ("times 1/4",),
    "pictures of twice the stated width and height": ("middle times 2",),
    "pictures of half the stated width and height": ("middle times 1/2",),
}


def _undone(rows: Rows, steps: tuple[str, ...]) -> Rows | None:
    """The rows without a mistake; None where it makes no difference to this camera."""
    other = rows
    for step in steps:
        other = replace(other, **_STEPS[step](other))
    if other.backwards and not rows.interior[:, _BENT].any():
        return None
    same = other.interior is not rows.interior and (other.interior == rows.interior).all()
    return None if same else other


def demand(proof: Proof, force: bool) -> None:
    """Raise InputError where the proof refuses and nobody insists."""
    if proof.verdict == "refused" and not force:
        raise InputError(proof.refusal())
