"""Flight plans: what is flown, over which ground, with what errors."""

import math
import numbers
import os
import types
import typing
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache, reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from corridor.core.block import Mounting, mountings_of, possible
from corridor.core.brief import brief
from corridor.core.camera import Camera
from corridor.core.errors import InputError, did_you_mean
from corridor.core.simulation.axis import Axis
from corridor.core.textfile import read_toml

_READY_MADE, _CAMERAS = (Path(__file__).with_name(name) for name in ("plans", "cameras.toml"))

LOOKS = ("forward", "sideways", "alternating")
LAYOUTS = ("alternating", "spread")
_MOST_STRIPS = 10_000
MOST_SURVEYED = 100_000
# Above any aeroplane that takes pictures of corridors.
_HIGHEST_M = 20_000.0


@dataclass(frozen=True)
class Flight:
    """One flight: parallel strips along the axis of the corridor.

    name: of the flight. camera: of the plan's own cameras or of `cameras()`.
    axis_m: positions [x, y] of a line that its strips follow in place of the corridor's axis: one
        across the corridor for strips across it.
    height_m: above the plain, one number or one a strip.
    strips: how many; offsets_m: their distances to the right of the axis, else they follow from
        the side overlap at the mean height.
    forward, side: overlap on the plain of a picture taken straight down, 0 to below 1.
    speed_m_s, interval_s: of the exposures. Two of forward, speed and interval give the third;
        interval_s is 2.5 unless said otherwise.
    images: of all strips together. With an overlap or a speed the strips are as long as that makes
        them, about the middle of the stations; alone it is spread evenly from end to end. Without
        it the strips cover the stations.
    stations_m: first and last distance along the axis to be covered; default: all of it.
    tilt_deg, look: of the camera: 0 looks straight down; `forward` towards the heading, `sideways`
        towards the axis (from a strip on the axis to the right), `alternating` ahead and back
        from image to image.
    heading: `turned` at each strip's end, or `kept`. direction: strips are flown `alternating`, or
        all the `same` way. long_side: of the picture, `across` the flight (rows follow each other
        along it) or `along`.
    attitude_jitter_deg: sigmas of roll, pitch and yaw; position_jitter_m, velocity_jitter_m_s,
        angular_rate_deg_s (camera's x, y, z): of each axis. wind_m_s: makes strips with it faster.
    start_s: clock at the first exposure; default: pause_s after the flight before. turn_s: from a
        strip's last exposure to the next one's first.
    lever_arm_m: antenna in the camera frame.
    temperature_c: at the start; warming_c: the camera warms by, with a time constant of 10 min.
    """

    name: str
    height_m: float | tuple[float, ...]
    camera: str = "camlight"
    axis_m: tuple[tuple[float, float], ...] | None = None
    strips: int = 3
    offsets_m: tuple[float, ...] | None = None
    images: int | None = None
    forward: float | None = None
    side: float = 0.7
    speed_m_s: float | None = None
    interval_s: float | None = None
    stations_m: tuple[float, float] | None = None
    tilt_deg: float = 0.0
    look: str = "forward"
    heading: str = "turned"
    direction: str = "alternating"
    long_side: str = "across"
    attitude_jitter_deg: float | tuple[float, float, float] = 1.5
    position_jitter_m: float = 0.3
    velocity_jitter_m_s: float = 0.1
    angular_rate_deg_s: float | tuple[float, float, float] = 1.0
    wind_m_s: float = 0.0
    start_s: float | None = None
    pause_s: float = 900.0
    turn_s: float = 12.0
    lever_arm_m: tuple[float, float, float] = (0.10, -0.05, 0.35)
    temperature_c: float = 20.0
    warming_c: float = 9.0

    def __post_init__(self):
        if not self.name.strip() or not self.name.isprintable():
            raise InputError(f"a flight cannot be called {self.name!r}: give letters and digits")
        say = _Checker(f"flight {self.name}", self)
        say.at_least(1, "strips")
        say.at_most(_MOST_STRIPS, "strips", told="are more than {most}: fly fewer")
        heights = self.heights
        if heights.shape != (self.strips,):
            say.fail(f"height_m gives {len(heights)} heights for {self.strips} strips")
        if not np.all(heights > 0):
            say.fail(f"height_m = {heights.min():g} is not above the ground: give metres above 0")
        if not np.all(heights < _HIGHEST_M):
            say.fail(f"height_m = {heights.max():g} cannot be the height of a drone: give metres")
        if self.offsets_m is not None and len(self.offsets_m) != self.strips:
            say.fail(f"offsets_m gives {len(self.offsets_m)} offsets for {self.strips} strips")
        for offset in self.offsets_m or ():
            if not abs(offset) < _HIGHEST_M:
                say.fail(f"offsets_m = {offset:g} is far from any corridor: give metres")
        for key in ("forward", "side"):
            value = getattr(self, key)
            if value is not None and not 0 <= value < 1:
                say.fail(f"an overlap {key} = {value:g} cannot be flown: give 0 to below 1")
        if None not in (self.forward, self.speed_m_s, self.interval_s):
            say.fail("forward, speed_m_s and interval_s say the same thing twice: leave one out")
        say.positive("speed_m_s", "interval_s")
        if self.images is not None and self.images < 2 * self.strips:
            say.fail(
                f"{self.images} images cannot fly {self.strips} strips: at least 2 images a strip"
            )
        say.one_of("look", *LOOKS)
        say.one_of("heading", "turned", "kept")
        if self.direction in ("across", "cross", "perpendicular"):
            say.fail(
                f"direction = {self.direction!r} is unknown, it says which way strips are flown: "
                "for strips across the corridor give the flight a line, axis_m = [[x, y], [x, y]]"
            )
        say.one_of("direction", "alternating", "same")
        say.one_of("long_side", "across", "along")
        if not 0 <= self.tilt_deg < 90:
            say.fail(f"tilt_deg = {self.tilt_deg:g} does not look down: give 0 to below 90")
        say.at_least(0, "position_jitter_m", "velocity_jitter_m_s", "angular_rate_deg_s")
        say.at_least(0, "attitude_jitter_deg", "pause_s", "turn_s")

    @property
    def heights(self) -> np.ndarray:
        """Height of each strip above the plain, metres."""
        given = np.atleast_1d(np.asarray(self.height_m, dtype=float))
        return np.repeat(given, self.strips) if given.size == 1 else given


@dataclass(frozen=True)
class Terrain:
    """Ground: a dike (see `Dike`). relief_m: crest above the plain, level_m: the plain's height.

    roughness_m: RMS of smooth random waves; default: a twelfth of the relief.
    """

    relief_m: float = 3.0
    level_m: float = 0.0
    roughness_m: float | None = None

    def __post_init__(self):
        _Checker("terrain", self).at_least(0, "roughness_m")


@dataclass(frozen=True)
class TiePoints:
    """Tie points: how many an image has on average, and how near the picture's edge.

    Points are thinned as a whole, so that each is seen in every image that contains it and
    multiplicity stays what the overlap makes it (Zhou 2019, section 5.6.4).
    match_angle_deg, match_scale: a matcher knows a feature again only in images that see it from
        nearly the same side and as large. Each point has one of its images, drawn by lot, as its
        reference; images whose ray differs from its by a larger angle, or which are nearer or
        farther by a larger factor, do not measure it. Default: all that see it do.
    """

    per_image: int = 440
    border_px: float = 10.0
    match_angle_deg: float | None = None
    match_scale: float | None = None

    def __post_init__(self):
        say = _Checker("tie_points", self)
        say.at_least(0, "border_px")
        say.at_least(1, "per_image", "match_scale")
        if self.match_angle_deg is not None and not self.match_angle_deg > 0:
            say.fail(f"match_angle_deg = {self.match_angle_deg:g} matches nothing: raise it")

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """Of a matcher: match_angle_deg, match_scale."""
        return self.match_angle_deg, self.match_scale


@dataclass(frozen=True)
class Ground:
    """Surveyed points: control, check, and where they lie.

    layout: `alternating` banks, or `spread` over both banks and the axis. every_m: one point
    each so many metres, in place of control + check; control takes the ends and is spread evenly.
    offset_m: of a bank from the axis; default: 0.3 of the ground width of the lowest picture.
    check_from_ties: up to so many more check points, taken from the tie points that three images
    or more show, evenly over the ground between the strips' ends; within_m: at most so far from
    the axis. Their marks are the tie points'.
    bars: up to so many scale bars or tapes between two tie points that three images or more show,
    each about bar_m long, evenly over the ground.
    """

    control: int = 5
    check: int = 6
    layout: str = "alternating"
    every_m: float | None = None
    offset_m: float | None = None
    check_from_ties: int = 0
    within_m: float | None = None
    bars: int = 0
    bar_m: float = 2.0

    def __post_init__(self):
        say = _Checker("ground", self)
        say.at_least(0, "control", "check", "check_from_ties", "offset_m", "bars")
        say.one_of("layout", *LAYOUTS)
        say.at_most(MOST_SURVEYED, "control", "check", told="is more than {most} points")
        say.positive("every_m", "within_m", "bar_m")


@dataclass(frozen=True)
class Noise:
    """Errors of measurement, see `add_noise`; none by default."""

    tie_px: float = 0.0
    mark_px: float = 0.0
    gnss_m: float | tuple[float, float, float] = 0.0
    control_m: float | tuple[float, float, float] = 0.0
    distance_m: float = 0.0
    attitude_deg: float | tuple[float, float, float] = 0.0
    image_rho: float = 0.0
    gnss_rho: float | tuple[float, float, float] = 0.0
    control_rho: float | tuple[float, float, float] = 0.0
    outliers: float = 0.0
    rounding_px: float = 0.0
    gnss_slow: float = 0.0
    gnss_slow_s: float = 120.0

    def __post_init__(self):
        say = _Checker("noise", self)
        say.at_least(0, "tie_px", "mark_px", "gnss_m", "control_m", "distance_m", "attitude_deg")
        say.at_least(0, "rounding_px", "outliers", "gnss_slow")
        say.at_most(1, "outliers", "gnss_slow", told="is a share: give 0 to 1")
        say.positive("gnss_slow_s")
        for key, count in (("image_rho", 1), ("gnss_rho", 3), ("control_rho", 3)):
            rho = np.asarray(getattr(self, key), dtype=float)
            if rho.shape not in ((), (count,)) or not possible(np.broadcast_to(rho, (1, count)))[0]:
                say.fail(f"{key} = {getattr(self, key)!r}: no covariance has such correlations")


@dataclass(frozen=True)
class Start:
    """By how much the start values in the block miss the truth.

    centre_m, rotation_deg, points_m: sigmas of each axis. camera: added to the true interior
    parameters of every camera, `{f = 50}` (what somebody believes about it).
    """

    centre_m: float = 0.5
    rotation_deg: float = 0.5
    points_m: float = 1.0
    camera: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        _Checker("start", self).at_least(0, "centre_m", "rotation_deg", "points_m")


@brief
@dataclass(frozen=True)
class Plan:
    """Flights over a corridor, in the order in which they are flown.

    axis_m: positions [x, y] of the corridor's axis, its corners rounded by bend_radius_m.
    gnss, attitudes: whether antenna positions, and the camera's attitudes, are measured.
    effects: `{slug: {parameter: value}}`.
    effect: what an effect has to know of the block, `{slug: {name: value}}`: the tables
    [effect.SLUG], as in block.toml. cameras: of the plan's own, beside those of `cameras()`.
    rig: tables [rig.NAME] as in block.toml: flights with the camera of a base carry its members.
    Raises InputError, one sentence, for a plan that cannot be flown.
    """

    name: str
    flights: tuple[Flight, ...]
    axis_m: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0, 200.0))
    bend_radius_m: float = 150.0
    terrain: Terrain = field(default_factory=Terrain)
    tie_points: TiePoints = field(default_factory=TiePoints)
    ground: Ground = field(default_factory=Ground)
    gnss: bool = True
    attitudes: bool = False
    noise: Noise = field(default_factory=Noise)
    start: Start = field(default_factory=Start)
    effects: Mapping[str, Mapping] = field(default_factory=dict)
    effect: Mapping[str, Mapping] = field(default_factory=dict)
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    rig: Mapping[str, Mapping] = field(default_factory=dict)
    source: str = ""
    description: str = ""

    def __post_init__(self):
        if not self.flights:
            raise InputError(f"plan {self.name} has no flight: add a table [[flight]]")
        names = [flight.name for flight in self.flights]
        for flight in self.flights:
            if names.count(flight.name) > 1:
                raise InputError(f"flight {flight.name} is there twice: give each its own name")
            self.camera(flight)
        _Checker("the plan", self).positive("bend_radius_m")
        for camera, mounting in self.mountings.items():
            if not np.isfinite(mounting.place).all():
                raise InputError(
                    f"the plan does not say how {camera} is mounted: add xyz and quaternion to "
                    f"[rig.{mounting.rig}.member.{camera}]"
                )

    @property
    def axis(self) -> Axis:
        """The corridor's axis."""
        return Axis(self.axis_m, self.bend_radius_m)

    @property
    def mountings(self) -> dict[str, Mounting]:
        """How the cameras of its rigs hang, by camera, the bases among them."""
        known = {**cameras(), **self.cameras} if self.rig else {}
        return mountings_of(types.SimpleNamespace(extra={"rig": self.rig}, cameras=known))

    def members(self, base: str) -> dict[str, Mounting]:
        """The other cameras of the rig of which a camera is the base."""
        rigs = [name for name, rig in self.rig.items() if rig["base"] == base]
        return {
            camera: one for camera, one in self.mountings.items()
            if one.rig in rigs and camera != base
        }  # fmt: skip

    def camera(self, flight: Flight) -> Camera:
        """The camera of a flight. Raises InputError where nobody knows it."""
        known = {**cameras(), **self.cameras}
        if flight.camera not in known:
            raise InputError(
                f"flight {flight.name}: no camera {flight.camera!r} is known"
                f"{did_you_mean(flight.camera, known)}: use {', '.join(known)}, or add a table "
                f"[camera.{flight.camera}]"
            )
        camera = known[flight.camera]
        if camera.slips:
            raise InputError(f"camera {flight.camera}: {camera.slips[0]}")
        return camera

    def axis_of(self, flight: Flight) -> Axis:
        """The line that the strips of a flight follow."""
        return self.axis if flight.axis_m is None else Axis(flight.axis_m, self.bend_radius_m)

    def __add__(self, other: "Plan") -> "Plan":
        """The other plan's flights flown after this one's, over this one's ground."""
        flights = other.flights
        if other.axis_m != self.axis_m:
            flights = tuple(replace(f, axis_m=f.axis_m or other.axis_m) for f in flights)
        taken = {f.name: f for f in self.flights}
        # Another flight of the same name, not the same one twice.
        flights = tuple(
            replace(f, name=f"{f.name}_{other.name}") if taken.get(f.name, f) != f else f
            for f in flights
        )
        return replace(
            self,
            name=f"{self.name}+{other.name}",
            flights=self.flights + flights,
            cameras={**self.cameras, **other.cameras},
            rig={**self.rig, **other.rig},
            source="; ".join(dict.fromkeys(filter(None, (self.source, other.source)))),
        )

    def with_flights(self, **changes) -> "Plan":
        """The plan with the same change made to every flight: `with_flights(tilt_deg=20)`."""
        return replace(self, flights=tuple(replace(f, **changes) for f in self.flights))


@cache
def cameras() -> dict[str, Camera]:
    """Cameras that a plan may call by name: those of `cameras.toml`."""
    tables = read_toml(_CAMERAS)
    return {
        name: Camera.from_table(name, {k: v for k, v in table.items() if k != "source"})
        for name, table in tables.items()
    }


def ready_made() -> dict[str, Path]:
    """Plans that come with the package, by name."""
    return {path.stem: path for path in sorted(_READY_MADE.glob("*.toml"))}


def read_plan(plan: str | os.PathLike) -> Plan:
    """A plan from a `.toml` file or the name of a ready-made one, or several of them joined by +.

    Flights of plans joined by +, `thesis_50vt+thesis_50ob` or `along.toml+across.toml`, are flown
    in that order over the first one's ground, each along the axis of its own plan.
    Raises InputError, one sentence naming file, key and remedy.
    """
    try:
        text = os.fspath(plan)
    except TypeError:
        raise InputError(
            f"a plan is a .toml file or the name of one that comes with corridor, not "
            f"{type(plan).__name__}"
        ) from None
    if os.path.isfile(text) or (text.endswith(".toml") and "+" not in text):
        return _read(Path(text))
    known, parts = ready_made(), []
    for name in text.split("+"):
        if name.endswith(".toml"):
            parts.append(_read(Path(name)))
            continue
        if name not in known:
            if os.path.isdir(text):
                raise InputError(
                    f"{text} is a folder, a plan is a .toml file or the name of one that comes "
                    "with corridor: `corridor simulate --like BLOCK` makes the counterpart of a "
                    "block"
                )
            near = did_you_mean(name, known)
            raise InputError(
                f"no plan {name!r} comes with corridor{near}: give a .toml file, "
                f"or one of {', '.join(known)}"
            )
        parts.append(_read(known[name]))
    return reduce(add, parts)


def _read(path: Path) -> Plan:
    table = read_toml(path)
    if path.name == "block.toml" and "flight" not in table:
        raise InputError(
            f"{path} is of a block, no plan: `corridor simulate --like BLOCK` "
            "makes the counterpart of a block"
        )
    try:
        return _plan(path.stem, table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _plan(name: str, table: dict) -> Plan:
    table = dict(table)
    for key, right in (("flights", "[[flight]]"), ("cameras", "[camera.NAME]")):
        if key in table:
            raise InputError(f"the plan has no key {key!r}: write {right}")
    if isinstance(table.get("noise"), dict) and table["noise"]:
        # What a plan with errors does not state is ordinary, for who flies it and who plans it.
        ordinary = ("tie_px", "mark_px", "gnss_m", "control_m", "attitude_deg")
        table["noise"] = {key: getattr(ORDINARY_NOISE, key) for key in ordinary} | table["noise"]
    flights = table.pop("flight", [])
    own = table.pop("camera", {})
    tables = [*(flights if isinstance(flights, list) else [None]), own]
    if not all(isinstance(entry, dict) for entry in tables):
        raise InputError("flights are tables [[flight]], cameras tables [camera.NAME]")
    flown = tuple(
        build(Flight, {"name": str(k)} | flight, f"flight {flight.get('name', k)}")
        for k, flight in enumerate(flights, 1)
    )
    cameras = {key: Camera.from_table(key, value) for key, value in own.items()}
    return build(Plan, {"name": name} | table | {"flights": flown, "cameras": cameras}, "the plan")


def build(kind: type, table: dict, where: str):
    """An instance of a dataclass from a table of the plan; says which key is wrong and why."""
    if not isinstance(table, dict):
        raise InputError(f"{where} is a table, not {table!r}")
    known = typing.get_type_hints(kind)
    known = {f.name: known[f.name] for f in fields(kind)}
    values = {}
    for key, value in table.items():
        if key not in known:
            raise InputError(
                f"{where} has no key {key!r}{did_you_mean(key, known)}: leave it out or correct it"
            )
        sort = known[key]
        if isinstance(sort, type) and issubclass(
            sort, Terrain | TiePoints | Ground | Noise | Start
        ):
            values[key] = build(sort, value, key)
        else:
            values[key] = value_of(value, sort, f"{where}: {key}")
    for one in fields(kind):
        if one.name not in values and one.default is one.default_factory is MISSING:
            raise InputError(f"{where} lacks {one.name}: add it")
    return kind(**values)


def value_of(value, sort, where: str):
    """A value of the sort that a field wants, lists as tuples."""
    if typing.get_origin(sort) in (typing.Union, types.UnionType):
        options = [s for s in typing.get_args(sort) if s is not type(None)]
        for option in options[:-1]:
            try:
                return value_of(value, option, where)
            except InputError:
                pass
        if len(options) > 1 and not isinstance(value, list | tuple | np.ndarray):
            raise InputError(f"{where} = {value!r} is not a number or a list of numbers")
        return value_of(value, options[-1], where)
    origin, inner = typing.get_origin(sort), typing.get_args(sort)
    if origin is tuple and isinstance(value, list | tuple | np.ndarray):
        if inner[-1] is Ellipsis:
            inner = (inner[0],) * len(value)
        if len(inner) == len(value):
            return tuple(value_of(v, s, where) for v, s in zip(value, inner, strict=True))
        raise InputError(f"{where} = {value} has {len(value)} values, {len(inner)} are needed")
    if sort is float and isinstance(value, numbers.Real) and not isinstance(value, bool):
        # Finite, and a whole number of TOML may have any length.
        with suppress(OverflowError):
            if math.isfinite(value):
                return float(value)
    elif sort in (int, bool, str) and type(value) is sort:
        return value
    elif origin is not None and issubclass(origin, Mapping) and isinstance(value, Mapping):
        return dict(value)
    elif isinstance(sort, type) and isinstance(value, sort):
        return value
    word = {float: "a number", int: "a whole number", bool: "true or false", str: "text"}
    wanted = word.get(sort, "a list of numbers" if origin is tuple else "a table")
    raise InputError(f"{where} = {value!r} is not {wanted}")


class _Checker:
    """Says in one sentence which key of which table is wrong."""

    def __init__(self, where: str, values):
        self.where, self.values = where, values

    def fail(self, sentence: str):
        raise InputError(f"{self.where}: {sentence}")

    def at_least(self, least: float, *keys: str) -> None:
        for key, value in self._given(keys):
            if not np.all(np.asarray(value, dtype=float) >= least):
                self.fail(f"{key} = {value} is below {least:g}")

    def at_most(self, most: float, *keys: str, told: str) -> None:
        for key, value in self._given(keys):
            if value > most:
                self.fail(f"{key} = {value:.10g} {told.format(most=most)}")

    def positive(self, *keys: str) -> None:
        for key, value in self._given(keys):
            if not value > 0:
                self.fail(f"{key} = {value:g} is not greater than 0")

    def _given(self, keys: tuple[str, ...]) -> list[tuple[str, Any]]:
        found = [(key, getattr(self.values, key)) for key in keys]
        return [(key, value) for key, value in found if value is not None]

    def one_of(self, key: str, *words: str) -> None:
        value = getattr(self.values, key)
        if value not in words:
            self.fail(f"{key} = {value!r} is unknown: use {' or '.join(words)}")


# What a plan of the command is flown with that states none: ordinary images, RTK, a careful survey.
ORDINARY_NOISE = Noise(
    tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), control_m=0.01, attitude_deg=0.5
)
CAMLIGHT = cameras()["camlight"]
