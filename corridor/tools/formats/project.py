"""What a project of another program says, and how its pieces become a block."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import POSE, SIGMAS, Block
from corridor.core.brief import brief
from corridor.core.camera import Camera
from corridor.core.errors import InputError, some
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.gnss import Local
from corridor.core.preparation import Witness, record_derived
from corridor.tools.formats.cameras import NoModel
from corridor.tools.formats.frames import local_table
from corridor.tools.formats.names import numbered
from corridor.tools.formats.rows import rows_of

# What the keys of [sigma] in block.toml are of.
_OF_SIGMA = {
    "tie_px": "tie points", "mark_px": "marks", "gnss_m": "camera positions",
    "control_m": "ground points",
}  # fmt: skip
# From here on a float32 of another program, or a difference of cubes, loses what a survey needs.
_FAR_M = 10_000.0


@brief
@dataclass
class Project:
    """A block made from another program's project, and what is worth knowing about it.

    form: the format's name. block: not yet checked; without observations where the project has
    none. pairs: image, x, y (px), X, Y, Z: image and ground that the project itself says belong
    together, for the proof only. notes: sentences on what was decided or left out. warnings:
    sentences on what may be wrong. placed: the coordinates are metres in a known or stated frame,
    not the free frame of a reconstruction. lost: photographs that did not join. image_to_ray: the
    format's distortion goes that way. rounding: how far the digits of the file let poses be off:
    centres (m), angles (rad). own: the conventions are those of this package, and nothing has to be
    proved. apart: its control and positions are in a local system that it states, its poses not.
    """

    form: str
    source: Path
    block: Block
    pairs: pd.DataFrame | None = None
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    placed: bool = True
    lost: list[str] = field(default_factory=list)
    image_to_ray: bool = False
    rounding: tuple[float, float] = (0.0, 0.0)
    own: bool = False
    apart: bool = False

    def having(
        self,
        *,
        notes: Iterable[str] = (),
        warnings: Iterable[str] = (),
        placed: bool | None = None,
        **changes,
    ) -> Project:
        """The project with more sentences, and with other fields of its block."""
        return replace(
            self,
            block=replace(self.block, **changes) if changes else self.block,
            notes=list(dict.fromkeys([*self.notes, *notes])),
            warnings=list(dict.fromkeys([*self.warnings, *warnings])),
            placed=self.placed if placed is None else placed,
        )

    def noted(self, *notes: str) -> Project:
        """The project with sentences on what was decided or left out."""
        return self.having(notes=notes)

    def warned(self, *warnings: str) -> Project:
        """The project with sentences on what may be wrong."""
        return self.having(warnings=warnings)

    def deriving(
        self,
        column: str,
        source: str,
        sigma: np.ndarray | None,
        told: str,
        frame: str = "",
        witnesses: Iterable[Witness] = (),
    ) -> Project:
        """The project whose block.toml says how a column came about (`record_derived`)."""
        block = replace(self.block, extra=dict(self.block.extra))
        text = f"{told[0].upper()}{told[1:].rstrip('.')}."
        record_derived(block, column, source, sigma, text, frame, witnesses)
        return replace(self, block=block)


def hung_together(project: Project, leader: Mapping[str, str]) -> Project:
    """The project with its rigs: tables [rig.NAME], and images of one exposure named alike.

    leader: image -> that of the base camera of its exposure, or where it did not fire any other.
    Mountings are left to the poses, in whose frame and scale they are. A rig of which a camera
    hangs in two places is left out, and that is said.
    """
    camera = dict(zip(project.block.images["image"], project.block.images["camera"], strict=True))
    pairs = {i: first for i, first in leader.items() if i != first and {i, first} <= set(camera)}
    rigs: dict[str, dict] = {}
    for image, first in pairs.items():
        rigs.setdefault(camera[first], {})[camera[image]] = {}
    # Exposures without the base are led by a member.
    led = [
        base
        for base, members in rigs.items()
        if any(base in other and members.keys() <= other.keys() for other in rigs.values())
    ]
    rigs = {base: members for base, members in rigs.items() if base not in led}
    hung = [name for base, members in rigs.items() for name in (base, *members)]
    taken = [(first, camera[image]) for image, first in pairs.items()]
    if not pairs:
        return project
    if not hung or len(set(hung)) < len(hung) or len(set(taken)) < len(taken):
        told = "a rig was left out: a camera hangs in two places, or two have one calibration"
        return project.having(notes=[told])
    names = {**pairs, **{first: first for first in pairs.values()}}
    images = project.block.images
    images = images.assign(exposure=[names.get(image) for image in images["image"]])
    tables = {f"rig_{base}": {"base": base, "member": members} for base, members in rigs.items()}
    many = f"{len(hung)} cameras hang together in {len(rigs)} rig{'s' * (len(rigs) > 1)}"
    told = f"{many}, {len(set(pairs.values()))} exposures: see [rig] in block.toml"
    extra = {**project.block.extra, "rig": tables}
    return project.having(notes=[told], images=images, extra=extra)


def rotations_to_columns(rotation: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) of rotations (n, 3, 3), world to camera, made exactly orthogonal.

    Raises ValueError where one is no rotation: who reads a file says which it is.
    """
    rotation = np.asarray(rotation, dtype=float).reshape(-1, 3, 3)
    u, singular, vt = np.linalg.svd(rotation)
    if np.abs(singular - 1).max(initial=0.0) > 1e-3 or (np.linalg.det(rotation) < 0).any():
        row = int(np.argmax(np.abs(singular - 1).max(axis=1)))
        if np.abs(singular[row] - 1).max() <= 1e-3:
            row = int(np.argmax(np.linalg.det(rotation) < 0))
        raise ValueError(
            f"the rotation of image {row + 1} of {len(rotation)} is not a rotation: its rows are "
            "not perpendicular unit vectors, right-handed"
        )
    return quaternion_from_rotation(u @ vt)


def matrices_of(quaternions: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3), world to camera, of quaternions as files have them, any length > 0.

    A quaternion printed with six digits is unit to 1e-6 only; its matrix is then made without
    dividing by its length, so that R and C = -R' t belong to the t that was printed with it.
    `rotations_to_columns` makes rotations of them. One that is far from unit is divided.
    """
    q = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    length = np.linalg.norm(q, axis=1)[:, None, None]
    # All that the usual formula adds to the unit matrix is of the second degree.
    size = np.where(np.abs(length - 1) < 1e-4, length**2, 1.0)
    return np.eye(3) + size * (rotation_from_quaternion(q) - np.eye(3))


def observations_table(
    point: np.ndarray,
    point_names: Sequence[str] | pd.Index,
    image: np.ndarray,
    image_names: Sequence[str],
    pixels: np.ndarray,
) -> pd.DataFrame:
    """tie_points.csv or marks.csv of codes into names, and pixels (n, 2)."""
    return pd.DataFrame(
        {
            "point": _coded(point, point_names),
            "image": _coded(image, image_names),
            "x": np.ascontiguousarray(pixels[:, 0]),
            "y": np.ascontiguousarray(pixels[:, 1]),
        }
    )


def _coded(codes, names):
    names = names if isinstance(names, pd.Index) else pd.Index(list(names), dtype="str")
    if not names.is_unique:
        where = names.duplicated()
        # Whoever reads the project says which file is at fault (`blaming`).
        raise InputError(
            f"two images or points are named {names[where][0]!r}; give each a name of its own"
        )
    return pd.Categorical.from_codes(np.asarray(codes, dtype=np.int32), names)


def points_table(names: Sequence[str] | pd.Index, positions: np.ndarray) -> pd.DataFrame:
    """points.csv of names and positions (n, 3)."""
    table = pd.DataFrame({"point": pd.Series(names, dtype="str")})
    table[["x", "y", "z"]] = np.asarray(positions, dtype=float).reshape(-1, 3)
    return table


def ground_table(
    names: Sequence[str],
    positions: np.ndarray,
    sigmas: np.ndarray | None = None,
    roles: Sequence[str] | None = None,
) -> pd.DataFrame:
    """ground.csv of names, positions (n, 3), sigmas (n, 3) in metres, roles (default control)."""
    table = points_table(list(names), positions)
    if sigmas is not None and np.isfinite(sigmas).any():
        table[["sx", "sy", "sz"]] = sigmas
    table["role"] = pd.Series(list(roles) if roles is not None else ["control"] * len(table))
    table["role"] = table["role"].astype("str")
    return table


def gnss_table(rows: Sequence[tuple]) -> pd.DataFrame | None:
    """gnss.csv of rows image, x, y, z, sx, sy, sz, metres; None without any.

    Standard deviations that are not positive are unknown.
    """
    if not rows:
        return None
    table = pd.DataFrame(rows, columns=["image", *"xyz", *SIGMAS])
    sigma = table[list(SIGMAS)]
    table[list(SIGMAS)] = sigma.where(sigma > 0)
    return table.dropna(axis="columns", how="all")


def same_point_once(table: pd.DataFrame, what: str, warnings: list[str]) -> pd.DataFrame:
    """The observations without a second one of the same point in the same image, which are told."""
    again = table.duplicated(["point", "image"]).to_numpy()
    if not again.any():
        return table
    first = table.iloc[int(np.argmax(again))]
    warnings.append(
        f"{int(again.sum())} of {len(table)} {what} see a point a second time in one image (first: "
        f"point {first['point']} in {first['image']}); the first of each was kept"
    )
    return table[~again].reset_index(drop=True)


def near_origin(block: Block) -> Block:
    """The block with small coordinates, and the rest in its offset (whole hundreds of metres).

    Coordinates already below 10 km stay as they are.
    """
    places = {}
    for name in ("images", "points", "ground", "gnss"):
        frame = getattr(block, name)
        if len(frame) and set(POSE[:3]) <= set(frame.columns):
            places[name] = frame[list(POSE[:3])].to_numpy(float)
    known = (places[name] for name in ("images", "points", "ground") if name in places)
    known = (xyz[np.isfinite(xyz).all(axis=1)] for xyz in known)
    first = next((xyz for xyz in known if len(xyz)), np.zeros((1, 3)))
    middle = np.median(first, axis=0)
    shift = np.where(np.abs(middle) > _FAR_M, np.round(middle / 100) * 100, 0.0)
    if not shift.any():
        return block
    moved = {
        name: getattr(block, name).assign(**dict(zip(POSE[:3], (xyz - shift).T, strict=True)))
        for name, xyz in places.items()
    }
    return replace(block, offset=block.offset + shift, **moved)


# --- the step that all formats share ---------------------------------------------------------


@dataclass
class Views:
    """Where points are seen: one row an observation.

    point (m,): into names. image (m,): into the images. pixels (m, 2). what: the format's word.
    sigma (m,): px, NaN where the project states none.
    """

    point: np.ndarray
    names: Sequence[str] | pd.Index
    image: np.ndarray
    pixels: np.ndarray
    what: str = "observations"
    sigma: np.ndarray | None = None

    @classmethod
    def of(
        cls, rows: Sequence[tuple[str, int, float, float]], what: str = "observations"
    ) -> Views | None:
        """Of rows (name of the point, row of the image, x, y, perhaps sigma); None without any."""
        if not rows:
            return None
        names, image, x, y, *sigma = zip(*rows, strict=True)
        codes, known = pd.factorize(np.array(names, dtype=object))
        pixels = np.column_stack([x, y])
        sigma = np.array(sigma[0], dtype=float) if sigma else None
        return cls(codes, pd.Index(known, dtype="str"), np.array(image), pixels, what, sigma)

    def in_images(self, keep: np.ndarray) -> Views:
        """Those in the images that are kept (n,), numbered anew."""
        mine = keep[self.image]
        return replace(
            self,
            point=self.point[mine],
            image=(np.cumsum(keep) - 1)[self.image[mine]],
            pixels=self.pixels[mine],
            sigma=None if self.sigma is None else self.sigma[mine],
        )

    def table(self, images: Sequence[str], warnings: list[str]) -> pd.DataFrame:
        """tie_points.csv or marks.csv; a second view of a point in one image is left out."""
        table = observations_table(self.point, self.names, self.image, images, self.pixels)
        if self.sigma is not None and (self.sigma > 0).any():
            table["sigma"] = np.where(self.sigma > 0, self.sigma, np.nan)
        return same_point_once(table, self.what, warnings)


@dataclass
class Contents:
    """What a format found, before it is a block.

    cameras: by name; a NoModel in the place of one leaves its images out. images, used: names of
    the images and of the camera of each. centre (n, 3), rotation (n, 3, 3), world to camera; NaN
    where an image has no pose. columns: more of images.csv. ties, marks: what is seen of points.
    points: names and places (p, 3), or None: where the rays of the ties meet. ground, gnss: as in
    a block. sigma: what the project states of the defaults of a block. local: the east, north, up
    frame of the coordinates.
    """

    name: str
    cameras: dict[str, Camera | NoModel]
    images: list[str]
    used: Sequence[str]
    centre: np.ndarray
    rotation: np.ndarray
    columns: dict = field(default_factory=dict)
    ties: Views | None = None
    marks: Views | None = None
    points: tuple[Sequence[str] | pd.Index, np.ndarray] | None = None
    ground: pd.DataFrame | None = None
    gnss: pd.DataFrame | None = None
    distances: pd.DataFrame | None = None
    sigma: dict[str, float] = field(default_factory=dict)
    local: Local | None = None
    offset: np.ndarray | None = None
    crs: str | None = None
    description: str = ""
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def project(self, form: str, source: Path, **more) -> Project:
        """The project; more: further fields of it. Raises InputError where a pose is none."""
        self = self._of_known_cameras(source)
        names, self.images = self.images, numbered(self.images)
        pairs = zip(names, self.images, strict=True)
        twice = sorted({name for name, other in pairs if name != other})
        if twice:
            self.warnings.append(
                f"{len(twice)} names belong to several images ({some(twice, 5)}): the second is "
                "called 2/NAME; name the photographs with their folders to tell them apart"
            )
        known = np.isfinite(self.rotation).all(axis=(1, 2))
        quaternion = np.full((len(known), 4), np.nan)
        quaternion[known] = rotations_to_columns(self.rotation[known])
        used = set(self.used)
        images = pd.DataFrame({"image": self.images, "camera": list(self.used)}, dtype="str")
        images = images.assign(**self.columns)
        images[list(POSE)] = np.column_stack([self.centre, quaternion])
        block = Block(
            name=self.name,
            cameras={name: camera for name, camera in self.cameras.items() if name in used},
            images=images,
            tie_points=self.ties and self.ties.table(self.images, self.warnings),
            marks=self.marks and self.marks.table(self.images, self.warnings),
            points=self.points and points_table(*self.points),
            ground=self.ground,
            gnss=self.gnss,
            distances=self.distances,
            sigma=self.sigma,
            offset=np.zeros(3) if self.offset is None else self.offset,
            crs=self.crs,
            description=self.description,
            extra={} if self.local is None else {"local_frame": local_table(self.local)},
        )
        if self.sigma:
            told = ", ".join(
                f"{_OF_SIGMA[key]} {value:g} {key.rpartition('_')[2]}"
                for key, value in self.sigma.items()
            )
            self.notes.append(f"standard deviations as the project states them: {told}")
        if set(block.ground["point"]) | set(block.marks["point"].cat.categories):
            block = apart(block, self.notes)
        if self.points is None and self.ties is not None:
            block = replace(block, points=_met(block))
            self.notes.append(
                f"{form} has no coordinates of tie points: they were intersected from the rays"
            )
            lost = len(block.tie_points["point"].cat.categories) - len(block.points)
            if lost:
                said = "1 tie point has no coordinates: its rays do not meet"
                many = f"{lost} tie points have no coordinates: their rays do not meet"
                self.warnings.append(said if lost == 1 else many)
        return Project(form, source, block, notes=self.notes, warnings=self.warnings, **more)

    def _of_known_cameras(self, source: Path) -> Contents:
        """The pieces without the images of cameras for which there is no model, which are told."""
        strange = {k: why for k, why in self.cameras.items() if isinstance(why, NoModel)}
        if not strange:
            return self
        keep = np.array([name not in strange for name in self.used], dtype=bool)
        if not keep.any():
            raise InputError(
                f"{source}: {next(iter(strange.values()))}; nothing is left to import: adjust it "
                "with an ordinary camera model there, or undistort the pictures first"
            )
        for name, why in strange.items():
            lost = [
                image for image, used in zip(self.images, self.used, strict=True) if used == name
            ]
            if lost:
                first = ", ".join(lost[:5])
                self.warnings.append(f"{why}: its {len(lost)} images were left out ({first})")
        images = [image for image, kept in zip(self.images, keep, strict=True) if kept]
        return replace(
            self,
            images=images,
            used=[name for name in self.used if name not in strange],
            centre=self.centre[keep],
            rotation=self.rotation[keep],
            columns={name: np.asarray(values)[keep] for name, values in self.columns.items()},
            ties=self.ties and self.ties.in_images(keep),
            marks=self.marks and self.marks.in_images(keep),
            gnss=None if self.gnss is None else self.gnss[self.gnss["image"].isin(images)],
        )


def apart(block: Block, notes: list[str], more: Iterable[str] = ()) -> Block:
    """The block whose tie points have other names than its ground points and `more`.

    Numbers name tie points and ground points alike in many programs.
    """
    ties = block.tie_points["point"].cat.categories
    taken = {*block.ground["point"], *block.marks["point"].cat.categories, *more}
    if not ties.isin(taken).any():
        return block
    notes.append("tie points got a t before their names, which ground points have too")
    table = block.tie_points.assign(
        point=block.tie_points["point"].cat.rename_categories(("t" + ties).astype("str"))
    )
    names = block.points["point"]
    points = block.points.assign(point=names.where(~names.isin(ties), "t" + names))
    return replace(block, tie_points=table, points=points)


def _met(block: Block) -> pd.DataFrame:
    rows = rows_of(block, complete=False)
    good = np.isfinite(rows.positions).all(axis=1)
    good[rows.ties :] = False
    return points_table(rows.point_names[good], rows.positions[good])
