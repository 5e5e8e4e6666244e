"""What an effect is: one class in one file, found by looking in this folder.

A class says where it acts (`place`), with which parameters, and by how much it moves what, with
the derivative. Simulating, adjusting, correcting, diagnosing and documenting all follow from it.
"""

from __future__ import annotations

import importlib
import pkgutil
from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from corridor.block import Block
from corridor.camera import INTERIOR
from corridor.effects.gyroscope import RATES, Gyroscope
from corridor.errors import InputError
from corridor.geometry import rotation_from_quaternion

# Shape of one row's shift, by place.
PLACES = {"camera": len(INTERIOR), "image": 2, "motion": 6, "antenna": 3, "ground": 3}
GROUPS = ("block", "camera", "flight", "image", "point")


@dataclass(frozen=True)
class Parameter:
    """One unknown of an effect.

    start: value it starts from; scale: standard deviation one would expect before looking.
    """

    name: str
    unit: str
    scale: float
    start: float = 0.0


class Effect(ABC):
    """One physical effect.

    slug: public name. title: one line. place: one of `PLACES`.
    called: the effect in the middle of a sentence, "... is missing from the model".
    needs: columns that must be known, `table.column`, or `camera.key`. takes: columns that are
    used where they are known.
    group: who shares a set of values: the block, a camera, a flight, an image or a ground point.
    generic: a mathematical shape that stands for the unknown, not a physical cause.
    searched: whether the diagnosis asks for it; not where others of the catalogue say it better.
    sudden: a break of the picture at a line, which matches across that line show one by one too.
    by_row: it differs from row to row of a picture, and has no one place in it.
    refines: slug of the effect of which it is the same with more sets of values, if there is one.
    row_degree: of the place motion: degree of the polynomial in the row that holds the shift.
    stands_in_for: camera parameters that have to be held, or the effect to have a prior: it can
    move what they move.
    revealed_by, unobservable_when: the data that show it, and the flight that hides it, for people.
    """

    slug: str
    title: str
    called: str
    place: str
    needs: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    group: str = "block"
    generic: bool = False
    searched: bool = True
    sudden: bool = False
    by_row: bool = False
    refines: str = ""
    row_degree: int = 1
    stands_in_for: tuple[str, ...] = ()
    revealed_by: str = ""
    unobservable_when: str = ""

    def __init__(self, group: str | None = None):
        if group is not None:
            self.group = self.per(group).group

    def per(self, group: str) -> Effect:
        """The same effect with another kind of groups: one set of values for each of them."""
        if group not in GROUPS:
            raise InputError(f"group {group!r} is unknown: use one of {', '.join(GROUPS)}")
        out = copy(self)
        out.group = group
        return out

    @abstractmethod
    def parameters(self, block: Block) -> list[Parameter]:
        """The unknowns of one group."""

    @abstractmethod
    def shift(self, context: Context, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far everything moves, and the derivative.

        values: (rows, parameters), the values of each row's own group.
        Returns (rows, dimension) in the unit of the place (camera: `INTERIOR`; image: px; motion:
        centre m and rotation of the camera rad, in the camera frame; antenna, ground: m), and
        its derivative (rows, dimension, parameters) by the values of the row's group.
        """

    def form(self, block: Block) -> Effect:
        """The effect as this block's data let it be: other parameters, another group."""
        return self

    def stated(self, block: Block) -> dict[str, float | dict[str, float]] | None:
        """Values that the block itself states, `{parameter: number or {group: number}}`, or None.

        They are taken where somebody corrects the effect without giving values.
        """
        return None

    def missing(self, block: Block) -> list[str]:
        """Those of `needs` that the block does not have."""
        return [column for column in self.needs if not block.has(column)]


def linear(derivative: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Shift (rows, dimension) of an effect that is linear in its values (rows, parameters)."""
    values = np.broadcast_to(values, (len(derivative), derivative.shape[2]))
    return np.einsum("nij,nj->ni", derivative, values)


def edge_of(block: Block) -> tuple[float, float]:
    """Focal length, px, of the block's first camera, and u at the end of its long side."""
    camera = next(iter(block.cameras.values()))
    return camera["f"], (max(camera.width, camera.height) - 1) / 2 / camera["f"]


@dataclass
class Images:
    """What is known of each image of a block, row for row.

    names, cameras, flights: text. centre (m, 3) and rotation (m, 3, 3) are the current pose;
    the rest comes from images.csv, NaN where unknown. record: row of each image in `gyroscope`,
    which rates.csv gives (None without). start_centre, start_rotation: the pose that
    images.csv states, which stays. ground: mean height of the points, m; elevation: of z = 0
    above the sea, m.
    """

    names: np.ndarray
    camera: np.ndarray
    camera_names: list[str]
    flight: np.ndarray
    flight_names: list[str]
    size: np.ndarray
    row_axis: np.ndarray  # 1 where rows follow each other along y, 0 along x
    row_sign: np.ndarray  # 1 down and right, -1 up and left
    interior: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    time: np.ndarray
    temperature: np.ndarray
    velocity: np.ndarray
    angular_rate: np.ndarray
    start_centre: np.ndarray
    start_rotation: np.ndarray
    ground: float
    elevation: float = 0.0
    record: np.ndarray | None = None
    gyroscope: Gyroscope | None = None

    @classmethod
    def of(cls, block: Block) -> Images:
        """The images of a block in the order of images.csv."""
        table = block.images
        names = list(block.cameras)
        camera = np.array([names.index(name) for name in table["camera"]], dtype=np.int64)
        cameras = [block.cameras[name] for name in names]
        sense = {"down": (1, 1.0), "up": (1, -1.0), "right": (0, 1.0), "left": (0, -1.0)}
        reading = np.array([sense[c.row_direction] for c in cameras])[camera]

        def columns(*names: str) -> np.ndarray:
            return np.stack([block.column("images", name) for name in names], axis=-1)

        centre = columns("x", "y", "z")
        rotation = rotation_from_quaternion(columns("qw", "qx", "qy", "qz"))
        return cls(
            names=table["image"].to_numpy(dtype=object),
            camera=camera,
            camera_names=names,
            flight=np.asarray(block.image_flight, dtype=np.int64),
            flight_names=list(block.flight_names),
            size=np.array([(c.width, c.height) for c in cameras], dtype=float)[camera],
            row_axis=reading[:, 0].astype(int),
            row_sign=reading[:, 1],
            interior=np.array([c.interior for c in cameras])[camera],
            centre=centre,
            rotation=rotation,
            time=columns("time_s")[:, 0],
            temperature=columns("temperature_c")[:, 0],
            velocity=columns("vx", "vy", "vz"),
            angular_rate=columns("wx", "wy", "wz"),
            start_centre=centre,
            start_rotation=rotation,
            ground=float(np.mean(block.points["z"])) if len(block.points) else 0.0,
            elevation=float(block.offset[2]),
            record=np.arange(len(table)),
            gyroscope=Gyroscope(block)
            if set(RATES) <= set(block.rates) and len(block.rates)
            else None,
        )

    def reordered(self, order: np.ndarray) -> Images:
        """The same images in another order."""
        fields = vars(self).items()
        return replace(self, **{k: v[order] for k, v in fields if isinstance(v, np.ndarray)})

    def with_poses(self, centre: np.ndarray, rotation: np.ndarray) -> Images:
        """The same images at other poses."""
        return replace(self, centre=centre, rotation=rotation)

    @cached_property
    def row_of(self) -> np.ndarray:
        """Row fraction from pixels (m, 3): 1 for y or 0 for x, factor, offset."""
        last = self.size[np.arange(len(self.size)), self.row_axis] - 1
        return np.stack([self.row_axis, self.row_sign / last, -0.5 * self.row_sign], axis=1)

    @cached_property
    def turns(self) -> bool:
        """Whether any angular rate is known and not zero."""
        return bool(np.nanmax(np.abs(self.angular_rate), initial=0.0) > 0)

    @cached_property
    def mid_time(self) -> float:
        """Middle of the block's times, s: the epoch of drifts."""
        return _middle(self.time)

    @cached_property
    def mid_temperature(self) -> float:
        """Middle of the block's temperatures, degrees Celsius: where thermal effects are zero."""
        return _middle(self.temperature)

    @cached_property
    def middle(self) -> np.ndarray:
        """Mean of the stated camera centres (3,), m: about which the block as a whole scales."""
        return self.start_centre.mean(axis=0)


def _middle(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float((known.min() + known.max()) / 2) if len(known) else 0.0


class Context:
    """What an effect may look at: one row for each thing that it moves.

    image: (rows,) image of each row; None at the place `ground`.
    pixel, ray: (rows, 2) modelled image point, px, and normalised u, v (place image).
    row: (rows,) row fraction: -1/2 in the row that is read first, 1/2 in the last (places motion
    and image).
    point, position: names and given coordinates (rows, 3) of ground control (place ground).
    """

    def __init__(
        self,
        images: Images,
        image: np.ndarray | None = None,
        pixel: np.ndarray | None = None,
        ray: np.ndarray | None = None,
        row: np.ndarray | None = None,
        point: list[str] | None = None,
        position: np.ndarray | None = None,
    ):
        self.images, self.image = images, image
        self.pixel, self.ray, self._row = pixel, ray, row
        self.point, self.position = point, position

    def __len__(self) -> int:
        return len(self.point) if self.image is None else len(self.image)

    @property
    def row(self) -> np.ndarray:
        """Row fraction (rows,): as given, else that of the pixel."""
        if self._row is not None:
            return self._row
        axis, factor, offset = self.images.row_of[self.image].T
        return factor * np.where(axis == 1, self.pixel[:, 1], self.pixel[:, 0]) + offset

    @property
    def plane(self) -> np.ndarray:
        """Modelled point (rows, 2) from the picture's middle, 1 at the end of its long side."""
        half = (self.size - 1) / 2
        return (self.pixel - half) / half.max(axis=1, keepdims=True)

    @property
    def size(self) -> np.ndarray:
        """Width and height (rows, 2) of the picture, px."""
        return self.images.size[self.image]

    @property
    def interior(self) -> np.ndarray:
        """Interior vector (rows, 15) of the image's camera."""
        return self.images.interior[self.image]

    @property
    def time(self) -> np.ndarray:
        """Seconds (rows,) since the middle of the block."""
        return self.images.time[self.image] - self.images.mid_time

    @property
    def temperature(self) -> np.ndarray:
        """Degrees Celsius (rows,)."""
        return self.images.temperature[self.image]

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of the camera centre (rows, 3), m/s, world."""
        return self.images.velocity[self.image]

    @property
    def angular_rate(self) -> np.ndarray:
        """Angular rate of the camera (rows, 3), rad/s, camera frame."""
        return self.images.angular_rate[self.image]

    def turn(self, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Turn of the camera (rows, 3), rad, and its derivatives by end and begin, rad/s.

        begin, end: (rows,) s from the image's time, on the clock of rates.csv.
        """
        time = self.images.time[self.image]
        record = self.images.record[self.image]
        return self.images.gyroscope.turn(record, time + begin, time + end)

    @property
    def rotation(self) -> np.ndarray:
        """Rotation (rows, 3, 3), world to camera."""
        return self.images.rotation[self.image]

    @property
    def centre(self) -> np.ndarray:
        """Camera centre (rows, 3), m, world."""
        return self.images.centre[self.image]

    @property
    def height(self) -> np.ndarray:
        """Height of the camera above the mean ground (rows,), m."""
        return self.images.centre[self.image, 2] - self.images.ground

    def group(self, kind: str) -> np.ndarray:
        """Which group (rows,) of a kind each row belongs to."""
        if kind == "block":
            return np.zeros(len(self), dtype=np.int64)
        if kind == "point":
            return np.arange(len(self))
        return group_of_image(self.images, kind)[self.image]


def group_of_image(images: Images, kind: str) -> np.ndarray:
    """Group (images,) of a kind to which each image belongs."""
    count = len(images.names)
    return {
        "block": np.zeros(count, dtype=np.int64),
        "camera": images.camera,
        "flight": images.flight,
        "image": np.arange(count),
    }[kind]


def group_names(images: Images, kind: str, points: list[str] = ()) -> list[str]:
    """Names of the groups of a kind, in the order of their values."""
    return {
        "block": ["block"],
        "camera": images.camera_names,
        "flight": images.flight_names,
        "image": list(images.names),
        "point": list(points),
    }[kind]


def every_effect() -> list[Effect]:
    """Every effect of the folder `catalogue`, by slug."""
    package = importlib.import_module("corridor.effects.catalogue")
    found = {}
    for module in pkgutil.iter_modules(package.__path__):
        for value in vars(importlib.import_module(f"{package.__name__}.{module.name}")).values():
            if isinstance(value, type) and issubclass(value, Effect) and "slug" in vars(value):
                found[value.slug] = value
    return [found[slug]() for slug in sorted(found)]


def find(name: str) -> Effect:
    """The effect with a slug; `slug@flight` asks for one set of values a flight.

    Raises InputError where there is none.
    """
    slug, _, group = name.partition("@")
    for effect in every_effect():
        if effect.slug == slug:
            return type(effect)(group or None)
    raise InputError(
        f"effect {slug!r} is unknown: `corridor effects` lists them all, the physical ones are "
        f"{', '.join(effect.slug for effect in every_effect() if not effect.generic)}"
    )
