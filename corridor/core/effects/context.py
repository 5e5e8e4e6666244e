"""What an effect may look at: the images of a block, and a row for each thing that it moves."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
import pandas as pd

from corridor.core.block import Block, exposures_of, members_of
from corridor.core.effects.gyroscope import RATES, Gyroscope
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion

# Who may share a set of values.
GROUPS = ("block", "camera", "flight", "image", "point", "survey", "member", "distance")


@dataclass
class Images:
    """What is known of each image of a block, row for row.

    names, cameras, flights: text. centre (m, 3) and rotation (m, 3, 3) are the current pose;
    the rest comes from images.csv, NaN where unknown. record: row of each image in `gyroscope`,
    which rates.csv gives (None without). start_centre, start_rotation: the pose that
    images.csv states, which stays. ground: mean height of the points, m; elevation: of z = 0
    above the sea, m. constants: of the block, by effect, as [effect.SLUG] of block.toml says.
    survey: from where each ground point was surveyed, by its name; survey_names: all of these.
    member (m,): which of member_names, the cameras of rigs but for the bases, took an image
    together with others; -1: none of them. distance_names: of the rows of distances.csv.
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
    velocity_error: np.ndarray
    start_centre: np.ndarray
    start_rotation: np.ndarray
    ground: float
    elevation: float = 0.0
    record: np.ndarray | None = None
    gyroscope: Gyroscope | None = None
    constants: dict = field(default_factory=dict)
    survey: dict[str, str] = field(default_factory=dict)
    survey_names: list[str] = field(default_factory=list)
    member: np.ndarray | None = None
    member_names: list[str] = field(default_factory=list)
    distance_names: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, block: Block) -> "Images":
        """The images of a block in the order of images.csv."""
        table = block.images
        names = list(block.cameras)
        codes, used = pd.factorize(table["camera"].array)
        camera = np.array([names.index(name) for name in used], dtype=np.int64)[codes]
        cameras = [block.cameras[name] for name in names]
        sense = {"down": (1, 1.0), "up": (1, -1.0), "right": (0, 1.0), "left": (0, -1.0)}
        reading = np.array([sense[c.row_direction] for c in cameras])[camera]

        def columns(*names: str) -> np.ndarray:
            return np.stack([block.column("images", name) for name in names], axis=-1)

        members = list(members_of(block))
        member = np.full(len(table), -1, dtype=np.int64)
        if members:
            together = exposures_of(block).member
            taken = table["camera"].to_numpy(object)[together]
            member[together] = pd.Index(members).get_indexer(taken)
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
            velocity_error=columns("dvx", "dvy", "dvz"),
            start_centre=centre,
            start_rotation=rotation,
            ground=float(np.mean(block.points["z"])) if len(block.points) else 0.0,
            elevation=float(block.offset[2]),
            record=np.arange(len(table)),
            constants=block.constants,
            survey=dict(zip(block.ground["point"], block.ground_groups, strict=True)),
            member=member,
            member_names=members,
            survey_names=list(dict.fromkeys(block.ground_groups)),
            distance_names=block.distance_names,
            gyroscope=Gyroscope(block)
            if set(RATES) <= set(block.rates) and len(block.rates)
            else None,
        )

    def reordered(self, order: np.ndarray) -> "Images":
        """The same images in another order."""
        fields = vars(self).items()
        return replace(self, **{k: v[order] for k, v in fields if isinstance(v, np.ndarray)})

    def with_poses(self, centre: np.ndarray, rotation: np.ndarray) -> "Images":
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
    def mid_time_of_flight(self) -> np.ndarray:
        """Middle of the times of each flight (flights,), s: the epoch of what drifts in each."""
        flights = range(len(self.flight_names))
        return np.array([_middle(self.time[self.flight == one]) for one in flights])

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


def _of_image(name: str, told: str) -> Any:
    """What a context says of the image of each row."""
    return property(lambda context: getattr(context.images, name)[context.image], doc=told)


class Context:
    """What an effect may look at: one row for each thing that it moves.

    image: (rows,) image of each row; None at the place `ground`.
    pixel, ray: (rows, 2) modelled image point, px, and normalised u, v (place image).
    measured: (rows, 2) image point as measured, px, for models that go from the image to the ray;
    where nothing is measured yet, as modelled (place image).
    row: (rows,) row fraction: -1/2 in the row that is read first, 1/2 in the last (places motion
    and image).
    point, position: names and given coordinates (rows, 3) of ground control (place ground).
    distance, length: rows of distances.csv (rows,), and as measured, m (place distance).
    At the place image position is the object point (rows, 3), m, world, and depth (rows,) how far
    before the camera it lies, for effects that say `sees_points`.
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
        distance: np.ndarray | None = None,
        length: np.ndarray | None = None,
        measured: np.ndarray | None = None,
    ):
        # Which of these there are depends on the place; an effect asks for those of its own.
        self.images, self.image = images, cast(np.ndarray, image)
        self.pixel, self.ray, self._row = cast(np.ndarray, pixel), cast(np.ndarray, ray), row
        self.point, self._position = cast(list[str], point), position
        self.distance, self.length = distance, cast(np.ndarray, length)
        self.measured = self.pixel if measured is None else measured

    # Of the image of each row.
    size: np.ndarray = _of_image("size", "Width and height (rows, 2) of the picture, px.")
    interior: np.ndarray = _of_image("interior", "Interior vector (rows, 15) of its camera.")
    temperature: np.ndarray = _of_image("temperature", "Degrees Celsius (rows,).")
    velocity: np.ndarray = _of_image("velocity", "Of the camera centre (rows, 3), m/s, world.")
    angular_rate: np.ndarray = _of_image("angular_rate", "(rows, 3), rad/s, in the camera frame.")
    rotation: np.ndarray = _of_image("rotation", "Rotation (rows, 3, 3), world to camera.")
    centre: np.ndarray = _of_image("centre", "Camera centre (rows, 3), m, world.")

    def __len__(self) -> int:
        if self.distance is not None:
            return len(self.distance)
        return len(self.point) if self.image is None else len(self.image)

    @property
    def names(self) -> list[str]:
        """Names of the ground points, or distances."""
        if self.distance is None:
            return self.point
        return [self.images.distance_names[k] for k in self.distance]

    @property
    def row(self) -> np.ndarray:
        """Row fraction (rows,): as given, else that of the pixel."""
        if self._row is not None:
            return self._row
        axis, factor, offset = self.images.row_of[self.image].T
        return factor * np.where(axis == 1, self.pixel[:, 1], self.pixel[:, 0]) + offset

    @property
    def position(self) -> np.ndarray:
        """Ground control as given, or the object point (rows, 3), m, world."""
        if self._position is None:
            raise InputError(
                "an effect looks at object points: it is of the place image, and says "
                "sees_points = True"
            )
        return self._position

    @property
    def seen(self) -> np.ndarray:
        """Object point (rows, 3) from the camera, m, in the camera frame."""
        return np.einsum("nij,nj->ni", self.rotation, self.position - self.centre)

    @property
    def depth(self) -> np.ndarray:
        """How far before the camera (rows,) the object point lies, m."""
        return self.seen[:, 2]

    @property
    def plane(self) -> np.ndarray:
        """Modelled point (rows, 2) from the picture's middle, 1 at the end of its long side."""
        half = (self.size - 1) / 2
        return (self.pixel - half) / half.max(axis=1, keepdims=True)

    @property
    def time(self) -> np.ndarray:
        """Seconds (rows,) since the middle of the block."""
        return self.images.time[self.image] - self.images.mid_time

    def turn(self, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Turn of the camera (rows, 3), rad, and its derivatives by end and begin, rad/s.

        begin, end: (rows,) s from the image's time, on the clock of rates.csv.
        """
        time, record = self.images.time[self.image], self.images.record
        assert record is not None and self.images.gyroscope is not None  # `needs` asks for rates
        return self.images.gyroscope.turn(record[self.image], time + begin, time + end)

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
        if kind == "distance":
            return cast(np.ndarray, self.distance)
        if kind == "survey":
            names = self.images.survey_names
            return np.array([names.index(self.images.survey[one]) for one in self.point], np.int64)
        return group_of_image(self.images, kind)[self.image]


def group_of_image(images: Images, kind: str) -> np.ndarray:
    """Group (images,) of a kind to which each image belongs."""
    count = len(images.names)
    return {
        "block": np.zeros(count, dtype=np.int64),
        "camera": images.camera,
        "flight": images.flight,
        "image": np.arange(count),
        "member": np.full(count, -1) if images.member is None else images.member,
    }[kind]


def control_names(block: Block) -> list[str]:
    """Names of the ground control of a block, in the order of ground.csv."""
    return list(block.ground["point"].array[(block.ground["role"] == "control").to_numpy()])


def group_names(images: Images, kind: str, points: Sequence[str] = ()) -> list[str]:
    """Names of the groups of a kind, in the order of their values."""
    return {
        "block": ["block"],
        "camera": images.camera_names,
        "flight": images.flight_names,
        "image": list(images.names),
        "point": list(points),
        "survey": images.survey_names,
        "member": images.member_names,
        "distance": images.distance_names,
    }[kind]
