"""Two dates of a dike by a generator that shares no line with the package: what is said of them?

`python -m benchmarks.two_dates -o FOLDER --draws 30`: for each kind of error in the second date
how often `corridor change` says that the ground moved though it did not, and with a motion of the
ground how often it is found, at the right place, with the right sign and size.

Every draw is kept in FOLDER as soon as it is done: the same command goes on where it stopped.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from benchmarks.diagnosis.rates import Rate
from benchmarks.draws import kept, ratio
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.core.output import whole_file, write_json
from corridor.tools.change.sentence import verdict_sentence

WIDTH, HEIGHT, FOCAL = 4000, 3000, 3000.0
CENTRE = np.array([2006.5, 1494.5])
START = np.array([1000.0, 2000.0])
FLIGHTS = ("F1", "F2")


@dataclass(frozen=True)
class Date:
    """How a date is flown, measured and described.

    readout: s, one number, one a flight or one an image; turning: rad/s rms an axis. focal: change
    of the focal length, share, a function of time (0 to 1) and flight. lens: change of (k1, k2) in
    the second flight, and of its focal length (share); shift: px of the principal point there.
    blur: px rms of a vibration with rows. water: share of the corridor where tie points drift, m/s.
    gnss_slow: m, noise that lasts a minute; gnss_factor: noise over its stated sigma; bias (3,), m;
    floating (3,): m that GNSS is off around the middle; jump (3,): m from three quarters on;
    no_gnss: none. arm (3,), m; clock: s. control: shift of given coordinates, of (names, xyz).
    raised: height of what grows, m, in half of the area. parked: height, m, of lorries.
    water_level: m, of still water beyond 20 m to the right. painted: m that marks are painted anew
    beside where they were, and surveyed there if so. outliers: share of tie points 8 px off. spot:
    px of a local deformation of the picture. mark: px, mark_of measured beside itself. repeated:
    share of tie points that a pattern takes 25 px aside in the second strip. exchanged: two
    control points with each other's name. tele: another lens, its focal length. part: share of the
    images that are flown. calibrated: camera held. without: no ground control.
    """

    readout: object = 0.0
    turning: float = 0.003
    focal: object = None
    lens: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0
    water: float = 0.0
    gnss_slow: float = 0.0
    gnss_factor: float = 1.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    floating: tuple[float, float, float] | None = None
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock: float = 0.0
    control: object = None
    raised: float = 0.0
    outliers: float = 0.0
    spot: float = 0.0
    mark: float = 0.0
    mark_of: str = "C1"
    repeated: float = 0.0
    exchanged: bool = False
    jump: tuple[float, float, float] = (0.0, 0.0, 0.0)
    no_gnss: bool = False
    parked: float = 0.0
    water_level: float | None = None
    painted: float = 0.0
    surveyed: bool = True
    tele: float = 1.0
    part: float = 1.0
    calibrated: bool = False
    without: bool = False
    motion: object = None


@dataclass(frozen=True)
class Motion:
    """Of a round piece of ground: most (3,), m, in its middle, less by a cosine as its profile;
    station and radius, m."""

    most: tuple[float, float, float]
    station: float = 70.0
    radius: float = 30.0

    def __call__(self, xyz: np.ndarray) -> np.ndarray:
        """Of places (n, 3), m."""
        away = np.linalg.norm(xyz[:, :2] - START - [self.station, 0.0], axis=1) / self.radius
        return np.outer(0.5 * (1.0 + np.cos(np.pi * np.minimum(away, 1.0))), self.most)


@dataclass(frozen=True)
class World:
    """The dike: places of tie points and of ground points, and how high it is.

    images: of a flight. count: tie points.
    """

    images: int
    ties: np.ndarray
    marks: dict[str, np.ndarray]
    waves: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, draw: np.random.Generator, images: int = 14, count: int = 1800) -> World:
        """Waves of 0.6 to 6 m with heights of centimetres make the ground rough."""
        length = 12.0 * (images - 1)
        waves = np.column_stack(
            [
                draw.normal(0.0, 1.0, (60, 2)) * 2 * np.pi / draw.uniform(0.6, 8.0, (60, 1)),
                draw.uniform(0.0, 2 * np.pi, 60),
                np.full(60, 0.003),
            ]
        )
        low, high = START + [-15.0, -30.0], START + [length + 15.0, 30.0]
        places = draw.uniform(low, high, (count, 2))
        names = [f"C{k}" for k in range(6)] + [f"K{k}" for k in range(5)]
        names += [f"M{k}" for k in range(6)]
        station = np.concatenate(
            [np.linspace(0, length, 6), np.linspace(8, length - 8, 5), np.linspace(3, length, 6)]
        )
        across = draw.uniform(-18, 18, len(names))
        marked = START + np.column_stack([station, across])
        out = cls(images, np.zeros((0, 3)), {}, waves)
        z = out.height(np.vstack([places, marked]))
        ties = np.column_stack([places, z[:count]])
        marks = {n: np.append(xy, h) for n, xy, h in zip(names, marked, z[count:], strict=True)}
        return replace(out, ties=ties, marks=marks)

    def seen_again(self, draw: np.random.Generator) -> World:
        """The same ground at other tie points: no two dates find the same ones."""
        low, high = self.ties[:, :2].min(axis=0), self.ties[:, :2].max(axis=0)
        places = draw.uniform(low, high, (len(self.ties), 2))
        return replace(self, ties=np.column_stack([places, self.height(places)]))

    def height(self, xy: np.ndarray) -> np.ndarray:
        """Height (n,), m: a trapezoid of 4 m, slopes 1 : 2, and roughness."""
        away = np.abs(xy[:, 1] - START[1])
        z = 12.0 + np.clip(8.0 - 0.5 * away, 0.0, 4.0)
        phase = xy @ self.waves[:, :2].T + self.waves[:, 2]
        return z + np.sin(phase) @ self.waves[:, 3]


def fly(world: World, date: Date, draw: np.random.Generator, name: str) -> Block:
    """A block as it would come from the field."""
    m = world.images
    strip = np.repeat([0, 1], m)
    along = np.concatenate([np.arange(m), np.arange(m)[::-1]]) * 12.0
    time = 1000.0 + np.concatenate([np.arange(m), m + 15 + np.arange(m)]) * 2.4
    heading = np.where(strip == 0, 0.0, np.pi)
    count = 2 * m
    centre = np.column_stack(
        [START[0] + along, START[1] + np.where(strip == 0, -8.0, 8.0), np.full(count, 62.0)]
    ) + draw.normal(0, [0.4, 0.4, 0.4], (count, 3))
    velocity = np.column_stack([5.0 * np.cos(heading), 5.0 * np.sin(heading), 0 * heading])
    velocity += draw.normal(0, 0.15, (count, 3))
    rotation = np.stack([_attitude(h, draw.normal(0, 0.02, 3)) for h in heading])
    rate = draw.normal(0, date.turning, (count, 3))
    share = (time - time[0]) / (time[-1] - time[0])
    readout = np.asarray(date.readout, float)
    readout = readout[strip] if readout.shape == (2,) else np.broadcast_to(readout, count)
    if callable(date.focal):
        focal = FOCAL * (1.0 + date.focal(share, strip, draw))
    else:
        focal = np.full(count, FOCAL)
    focal = focal * date.tele * (1.0 + date.lens[0] * strip)
    k1, k2 = -0.02 + date.lens[1] * strip, 0.01 + date.lens[2] * strip
    shift = strip[:, None] * np.array(date.shift)
    wave = draw.uniform(0, 2 * np.pi, count)

    ties, marks = world.ties.copy(), np.array(list(world.marks.values()))
    moved = date.motion or (lambda xyz: 0.0 * xyz)
    ties, marks = ties + moved(ties), marks + moved(marks)
    if date.raised:
        grown = np.sin((ties[:, 0] - START[0]) / 9.0) * np.sin(ties[:, 1] / 7.0) > 0
        grown &= np.abs(ties[:, 1] - START[1]) > 3.0
        height = draw.gamma(4.0, date.raised / 4.0, len(ties))
        ties[:, 2] += np.where(grown, height, 0.0)
    if date.parked:
        lorry = (np.abs((ties[:, 0] - START[0]) % 40.0 - 20.0) < 5.0) & (
            np.abs(ties[:, 1] - START[1] - 2.0) < 1.5
        )
        ties[lorry, 2] += date.parked
    if date.water_level is not None:
        ties[ties[:, 1] < START[1] - 20.0, 2] = date.water_level
    if date.painted:
        beside = draw.normal(size=(len(marks), 2))
        beside *= date.painted / np.linalg.norm(beside, axis=1)[:, None]
        marks[:, :2] += beside
    flowing = (ties[:, 0] - START[0]) / (12.0 * (m - 1)) < date.water
    flowing &= ties[:, 1] > START[1] + 12.0

    rows = {"tie": [], "mark": []}
    for k in range(count):
        for kind, xyz in (("tie", ties), ("mark", marks)):
            here = xyz
            if kind == "tie" and date.water:
                here = xyz + np.outer(flowing * (time[k] - time[0]), [0.06, 0.0, 0.0])
            pixel, front = _picture(
                here, centre[k], rotation[k], velocity[k], rate[k], readout[k],
                (focal[k], CENTRE + shift[k], k1[k], k2[k]),
            )  # fmt: skip
            if date.blur:
                cycle = 3.0 * 2 * np.pi * pixel[:, 1] / HEIGHT + wave[k]
                pixel = pixel + date.blur * np.sqrt(2) * np.column_stack(
                    [np.cos(cycle), np.sin(cycle)]
                )
            if date.spot:
                away = np.linalg.norm(pixel - [1200.0, 900.0], axis=1) / 700.0
                pixel = pixel + date.spot * np.exp(-(away**2))[:, None] * [1.0, 0.6]
            seen = front & (pixel >= 0).all(axis=1) & (pixel < [WIDTH, HEIGHT]).all(axis=1)
            if kind == "tie":
                # Features are found again from one picture to the next, not always.
                seen &= draw.uniform(size=len(xyz)) < 0.7
            at = np.flatnonzero(seen)
            noisy = pixel[at] + draw.normal(0, 0.3, (len(at), 2))
            rows[kind].append(np.column_stack([at, np.full(len(at), k), noisy]))
    tie, mark = (np.vstack(rows[kind]) for kind in ("tie", "mark"))
    if date.outliers:
        wrong = draw.uniform(size=len(tie)) < date.outliers
        tie[wrong, 2:] += draw.normal(0, 8.0, (wrong.sum(), 2))
    names = list(world.marks)
    if date.mark:
        mark[mark[:, 0] == names.index(date.mark_of), 2:] += [date.mark, 0.0]
    if date.repeated:
        # One period aside in all pictures of the second strip.
        other = draw.uniform(size=len(ties)) < date.repeated
        tie[other[tie[:, 0].astype(int)] & (strip[tie[:, 1].astype(int)] > 0), 2] += 25.0
    if date.water:
        # Nobody finds the same wave again in the next strip.
        tie[:, 0] += len(ties) * (
            flowing[tie[:, 0].astype(int)] & (strip[tie[:, 1].astype(int)] > 0)
        )
    tie = tie[np.bincount(tie[:, 0].astype(int))[tie[:, 0].astype(int)] > 1]

    to_world = rotation.transpose(0, 2, 1)
    antenna = centre + to_world @ np.array(date.arm) + velocity * date.clock
    sigma = np.array([0.02, 0.02, 0.03])
    gnss = antenna + date.gnss_factor * draw.normal(0, sigma, (count, 3)) + date.bias
    if date.gnss_slow:
        gnss += _slow(time, date.gnss_slow, draw) * [1.0, 1.0, 1.6]
    if date.floating is not None:
        gnss[m - 5 : m + 4] += date.floating
    gnss += np.outer(share > 0.75, date.jump)

    surveyed = np.array(list(world.marks.values()))
    surveyed = marks if date.surveyed else surveyed + moved(surveyed)
    role = np.where(np.char.startswith(names, "C"), "control", "check")
    known = np.isin(np.char.array(names).astype(str), [n for n in names if n[0] in "CK"])
    ground = pd.DataFrame({"point": names})
    ground[["x", "y", "z"]] = surveyed + _survey(world) * [0.005, 0.005, 0.008]
    if date.control is not None:
        ground[["x", "y", "z"]] += date.control(names, surveyed)
    ground[["sx", "sy", "sz"]] = [0.005, 0.005, 0.008]
    ground["role"] = "check" if date.without else role
    ground = ground[known].reset_index(drop=True)
    if date.exchanged:
        ground["point"] = ground["point"].replace({"C1": "C3", "C3": "C1"})

    image = np.array([f"I{k:03d}" for k in range(count)], dtype=object)
    images = pd.DataFrame({"image": image, "camera": "A", "flight": [FLIGHTS[s] for s in strip]})
    images["strip"] = [f"S{s}" for s in strip]
    images["time_s"], images["temperature_c"] = time, 20.0 + 5.0 * share
    images[["x", "y", "z"]] = centre + draw.normal(0, 0.2, (count, 3))
    turned = [
        _attitude(h, e) for h, e in zip(heading, draw.normal(0, 0.02, (count, 3)), strict=True)
    ]
    images[["qw", "qx", "qy", "qz"]] = [_quaternion(r) for r in turned]
    images[["vx", "vy", "vz"]] = velocity
    stations = pd.DataFrame({"image": image})
    stations[["x", "y", "z"]] = gnss
    stations[["sx", "sy", "sz"]] = sigma
    lens = {
        "width": WIDTH,
        "height": HEIGHT,
        "f": FOCAL * date.tele,
        "cx": CENTRE[0],
        "cy": CENTRE[1],
    }
    lens |= {"k1": -0.02, "k2": 0.01, "calibrated": date.calibrated}
    camera = Camera.from_table("A", lens)
    block = Block(
        name=name,
        cameras={"A": camera},
        images=images,
        tie_points=pd.DataFrame(
            {
                "point": [f"T{int(p)}" for p in tie[:, 0]],
                "image": image[tie[:, 1].astype(int)],
                "x": tie[:, 2],
                "y": tie[:, 3],
            }
        ),  # fmt: skip
        marks=pd.DataFrame(
            {
                "point": [names[int(p)] for p in mark[:, 0]],
                "image": image[mark[:, 1].astype(int)],
                "x": mark[:, 2],
                "y": mark[:, 3],
            }
        ),  # fmt: skip
        ground=ground,
        gnss=stations[:0] if date.no_gnss else stations,
        sigma={"tie_px": 0.3, "mark_px": 0.3},
        lever_arm={"default": (0.0, 0.0, 0.0)},
        lever_arm_fixed=True,
    )
    return block if date.part == 1.0 else block.select(images=image[along < date.part * 12.0 * m])


def _survey(world: World) -> np.ndarray:
    """One survey for both dates: the same draw for the same world."""
    seed = int(abs(world.waves[0, 0]) * 1e6) % 2**32
    return np.random.default_rng(seed).normal(0, 1, (len(world.marks), 3))


def _attitude(heading: float, small: np.ndarray) -> np.ndarray:
    """World to camera: x to the right of the flight, y backwards, z down, turned a little."""
    c, s = np.cos(heading), np.sin(heading)
    forward, right = np.array([c, s, 0.0]), np.array([s, -c, 0.0])
    return _turn(small) @ np.array([right, -forward, [0.0, 0.0, -1.0]])


def _turn(vector: np.ndarray) -> np.ndarray:
    """Rotation by a vector, Rodrigues."""
    angle = np.linalg.norm(vector)
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def _quaternion(r: np.ndarray) -> np.ndarray:
    """Unit quaternion w, x, y, z by the eigenvector of Bar-Itzhack 2000."""
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    x, y, z, w = np.linalg.eigh(k)[1][:, -1]
    return np.array([w, x, y, z])


def _picture(xyz, centre, rotation, velocity, rate, readout, lens):
    """Image points (n, 2), px, each row at its own moment, and whether they lie in front."""
    focal, middle, k1, k2 = lens
    late = np.zeros(len(xyz))
    for _ in range(4 if readout else 1):
        away = xyz - centre - late[:, None] * velocity
        seen = away @ rotation.T
        # The camera turns by rate * late: what it sees turns the other way.
        turn = rate * late[:, None]
        seen = seen - np.cross(turn, seen)
        front = seen[:, 2] > 1.0
        u = seen[:, :2] / np.where(front, seen[:, 2], 1.0)[:, None]
        r2 = np.sum(u * u, axis=1)
        u = u * (1 + k1 * r2 + k2 * r2 * r2)[:, None]
        pixel = middle + focal * u
        late = readout * (pixel[:, 1] / (HEIGHT - 1) - 0.5)
    return pixel, front & (np.sum((seen[:, :2] / seen[:, 2:]) ** 2, axis=1) < 1.5)


def _slow(time: np.ndarray, size: float, draw: np.random.Generator) -> np.ndarray:
    """Noise (n, 3) of a minute: first-order Gauss-Markov."""
    alike = np.exp(-np.abs(time[:, None] - time) / 60.0)
    root = np.linalg.cholesky(alike + 1e-9 * np.eye(len(time)))
    return size * root @ draw.normal(0, 1, (len(time), 3))


def _hunting(share, flight, draw):
    return draw.normal(0, 2.5 / FOCAL, len(share))


def _cooling(share, flight, draw):
    return 8e-4 * np.exp(-share / 0.15)


def _blunder(axis: int, size: float):
    def shift(names, xyz):
        out = np.zeros_like(xyz)
        out[names.index("C2"), axis] = size
        return out

    return shift


def _whole(names, xyz):
    return np.array([1.0, 0.0, 0.0])


def _higher(by: float):
    return lambda names, xyz: np.array([0.0, 0.0, by])


def _geoid(names, xyz):
    """Given heights follow a geoid that slopes by 1 mm a metre."""
    return np.outer(xyz[:, 0] - START[0], [0.0, 0.0, 1e-3])


# What is wrong with the second date. Of the examination of 27 November 2026, and new ones.
KINDS = {
    "rest": {},
    "outliers 2 %": {"outliers": 0.02},
    "GNSS float": {"floating": (0.25, -0.15, 0.40)},
    "two readouts": {"readout": np.array([0.012, 0.032])},
    "a readout an image": {"readout": "each"},
    "moving water": {"water": 0.5},
    "readout 20 ms": {"readout": 0.02},
    "readout 20 ms, turning": {"readout": 0.02, "turning": 0.02},
    "focal length held": {
        "focal": lambda share, flight, draw: 5e-4 + 0 * share,
        "calibrated": True,
    },
    "lens of F2": {"lens": (0.003, 0.03, 0.0)},
    "crop of F2": {"shift": (-20.0, -12.0)},
    "focus hunts": {"focal": _hunting},
    "vibration": {"blur": 1.2},
    "clock 50 ms": {"clock": 0.05},
    "arm 3 cm": {"arm": (0.03, 0.0, 0.03)},
    "GNSS 20 mm, no control": {"bias": (0.0, 0.0, 0.02), "without": True},
    "control point 0.10 m": {"control": _blunder(0, 0.1)},
    "control point 0.05 m": {"control": _blunder(2, 0.05)},
    "datum 1 m": {"control": _whole, "bias": (1.0, 0.0, 0.0)},
    "names exchanged": {"exchanged": True},
    "vegetation": {"raised": 0.03},
    # New ones.
    "slow GNSS": {"gnss_slow": 0.03},
    "GNSS 3 x its sigma": {"gnss_factor": 3.0},
    "geoid of control": {"control": _geoid},
    "lens cools": {"focal": _cooling},
    "drop on the lens": {"spot": 2.0},
    "mark of C1 5 px off": {"mark": 5.0},
    "mark M3 6 px off": {"mark": 6.0, "mark_of": "M3"},
    "repeated pattern": {"repeated": 0.04},
    "another lens": {"tele": 1.2},
    "half of the corridor": {"part": 0.5},
    "control 30 m higher": {"control": _higher(30.0)},
    "control 1 mm higher": {"control": _higher(0.001)},
    "no GNSS": {"no_gnss": True},
    "marks painted anew": {"painted": 0.05},
    "marks painted anew, not surveyed": {"painted": 0.05, "surveyed": False},
    "same folder": {},
    "GNSS jump": {"jump": (0.3, 0.2, 0.4)},
    "GNSS 5 x its sigma": {"gnss_factor": 5.0},
    "focus jump": {"lens": (1e-3, 0.0, 0.0)},
    "lorries": {"parked": 3.0},
    "water 0.4 m lower": {"water_level": 12.1},
    "flood that left": {},
    "maize": {"raised": 0.8},
    "K2 on another target": {"mark": 40.0, "mark_of": "K2"},
}
# What the first date has of these kinds too, with its own value.
BOTH = {
    "water 0.4 m lower": {"water_level": 12.5},
    "flood that left": {"water_level": 12.5},
}
# Verdicts that are right where the ground does not move, for kinds where one is.
RIGHT = {
    "rest": {"nothing"},
    "outliers 2 %": {"nothing"},
    # The false positions are named and count for less.
    "GNSS float": {"nothing", "unfit"},
    "two readouts": {"camera", "unfit"},
    "readout 20 ms": {"camera"},
    "readout 20 ms, turning": {"camera"},
    "crop of F2": {"camera", "nothing"},
    "clock 50 ms": {"camera", "nothing"},
    "arm 3 cm": {"nothing", "camera"},
    "focal length held": {"nothing", "camera"},
    "control point 0.10 m": {"nothing"},
    "control point 0.05 m": {"nothing"},
    "datum 1 m": {"unfit"},
    "geoid of control": {"unfit"},
    "names exchanged": {"nothing"},
    # Nothing, or where two surfaces show that the points move, a change that is none of the ground.
    "moving water": {"nothing", "undecided", "unfit"},
    "GNSS 3 x its sigma": {"nothing"},
    "slow GNSS": {"nothing"},
    # No effect of the catalogue is one: not to be told, or gone where control holds the flights.
    "a readout an image": {"camera", "unfit", "undecided"},
    "lens of F2": {"camera", "unfit"},
    "focus hunts": {"nothing", "camera"},
    "vibration": {"nothing"},
    "GNSS 20 mm, no control": {"nothing"},
    "vegetation": {"cover", "nothing"},
    "lens cools": {"nothing", "camera"},
    "drop on the lens": {"nothing", "camera", "unfit"},
    "mark of C1 5 px off": {"nothing", "unfit"},
    "mark M3 6 px off": {"nothing", "undecided"},
    "repeated pattern": {"nothing"},
    "another lens": {"nothing"},
    "half of the corridor": {"nothing"},
    "control 30 m higher": {"refused"},
    "control 1 mm higher": {"nothing"},
    "no GNSS": {"nothing"},
    "marks painted anew": {"unfit"},
    "marks painted anew, not surveyed": {"unfit"},
    "same folder": {"nothing"},
    "GNSS jump": {"nothing", "unfit"},
    "GNSS 5 x its sigma": {"nothing", "unfit"},
    "focus jump": {"camera", "nothing", "unfit"},
    "lorries": {"nothing", "cover"},
    "water 0.4 m lower": {"cover", "nothing"},
    "flood that left": {"cover", "nothing"},
    "maize": {"cover", "nothing"},
    "K2 on another target": {"nothing", "undecided"},
}
# Kinds that are flown with a motion of the ground too, and which.
BOWL = Motion((0.0, 0.0, -0.12))
MOTIONS = {
    "bowl": BOWL,
    "slide": Motion((0.02, -0.15, -0.03), 110.0, 40.0),
    "settlement": Motion((0.0, 0.0, -0.07), 45.0, 40.0),
}
MOVING = (
    "rest",
    "readout 20 ms",
    "readout 20 ms, turning",
    "crop of F2",
    "control point 0.10 m",
    "repeated pattern",
)
# What a first sentence says, by the words it begins with, and verdicts that may say so.
SAYS = {
    "The ground moved: ": {"moved"},
    "The surface moved: ": {"moved"},
    "No change is significant": {"nothing"},
    "No change of the ground is significant": {"nothing"},
    "The camera explains it": {"camera"},
    "Not the ground": {"cover"},
    "Cannot be determined: ": {"unfit"},
    "Ground and camera cannot be told apart": {"undecided"},
    "Ground and mark cannot be told apart": {"undecided"},
}


def pair(kind: str, seed: int, motion: Motion | None = None, images: int = 14, count: int = 1800):
    """Both dates (two blocks) of one draw."""
    draw = np.random.default_rng(seed)
    world = World.of(draw, images, count)
    wrong = dict(KINDS[kind])
    if wrong.get("readout") is not None and isinstance(wrong["readout"], str):
        wrong["readout"] = draw.uniform(0.005, 0.04, 2 * images)
    later = world.seen_again(draw)
    both = {name: wrong[name] for name in ("without", "calibrated") if name in wrong}
    first = fly(world, Date(**both | BOTH.get(kind, {})), draw, "a")
    if kind == "same folder":
        return first, first
    return first, fly(later, Date(**wrong, motion=motion), draw, "b")


def told(kind: str, motion: Motion | None, k: int) -> dict:
    """What is said of a draw, and whether the words of the first sentence are true.

    verdict; sentence; words: whether it says the verdict; errors: mean squares over the variances
    of points, surface and volume, where all stands still; detection, m. With a motion: place, sign,
    size by the words.
    """
    seed = 1000 + k
    try:
        found = corridor.change(*pair(kind, seed, motion), polygons={"all": CREST})
    except InputError as error:
        out = {"verdict": "refused", "sentence": str(error), "detection": np.nan, "words": True}
        return out | {"errors": [np.nan] * 3, "place": False, "sign": False, "size": False}
    said = verdict_sentence(found)
    out = {
        "verdict": found.verdict,
        "sentence": said,
        "detection": np.median(found.surface.detection),
    }
    out["words"] = any(said.startswith(a) and found.verdict in b for a, b in SAYS.items())
    if motion is None:
        points, surface, volume = found.points, found.surface, found.volumes["all"]
        free = ~points.held
        out["errors"] = [
            np.mean((points.shift[free] / points.sigma[free]) ** 2),
            np.mean((surface.distance / surface.total) ** 2),
            (volume.value / volume.total) ** 2,
        ]
        return out
    return out | (true_words(said, found, World.of(np.random.default_rng(seed)), motion))


# How a sentence gives a size: of a height, or horizontally; and a place.
_SIZE = re.compile(
    r"(sank|rose|moved) by (\d+\.?\d*) \u00b1 (\d+\.?\d*) mm(?: horizontally \(towards (\d+))?"
)
_PLACE = re.compile(r"station (-?\d+) m, (?:(\d+) m to the (left|right)|on its axis)")


def true_words(said: str, found, world: World, motion: Motion) -> dict:
    """Whether place (10 m), sign and size (2 sigmas) in a sentence are those of the motion; the
    size of a patch too, where it says one beside a point."""
    size, place = _SIZE.search(said), _PLACE.search(said)
    if not (said.startswith(("The ground moved: ", "The surface moved: ")) and size and place):
        return {"place": False, "sign": False, "size": False}
    point = re.search(r"moved: point (\w+)", said)
    # What a surface shows of a motion, by its height at a place that stays.
    cores = found.surface.cores
    seen = np.sum(cores.normal * motion(cores.xyz), axis=1)
    patches = found.final.patches
    one = max(patches, key=lambda p: abs(p.change / p.sigma)) if patches else None
    held = one is None or abs(one.change - one.weight @ seen) < 2.0 * one.sigma + 5e-4
    if point:
        xyz = world.marks[point[1]][None]
        true = motion(xyz)[0]
    else:
        xyz = np.array([[*(START + [motion.station, 0.0]), 0.0]])
        true = np.array([0.0, 0.0, one.weight @ seen])
    stated = float(place[1]), float(place[2] or 0.0) * (-1.0 if place[3] == "right" else 1.0)
    away = np.hypot(*(found.surface.cores.along(xyz)[:, 0] - stated))
    value, sigma = 1e-3 * float(size[2]), 1e-3 * float(size[3])
    if size[4]:
        truth = float(np.hypot(*true[:2]))
        turned = np.radians(float(size[4])) - np.arctan2(true[0], true[1])
        sign = np.cos(turned) > 0.0
    else:
        truth, sign = abs(true[2]), (size[1] == "rose") == (true[2] > 0.0)
    moves = bool(np.abs(true).max() > 0.0)
    return {
        "place": bool(moves and away < 10.0),
        "sign": bool(moves and sign),
        "size": bool(held and abs(value - truth) < 2.0 * sigma + 5e-4),
    }


# Corners of an area of which the volume is compared: all of the ground that is seen well.
CREST = START + np.array([[0.0, -20.0], [150.0, -20.0], [150.0, 20.0], [0.0, 20.0]])


def rates(draws: int, folder: Path | None = None, kinds=tuple(KINDS), moving=MOVING) -> dict:
    """By kind: verdicts, `moved` where nothing moved, shares of right verdicts and words."""

    def every(kind, name=None):
        draw = partial(told, kind, MOTIONS.get(name))
        if folder is None:
            return [draw(k) for k in range(draws)]
        return kept(folder / f"{kind}{f', {name}' if name else ''}", range(draws), draw)

    out, false, errors = {}, 0, []
    for kind in kinds:
        each = every(kind)
        found = [str(one["verdict"]) for one in each]
        false += found.count("moved")
        out[kind] = {"verdicts": dict(Counter(found)), "moved": _share(v == "moved" for v in found)}
        out[kind]["right"] = _share(v in RIGHT[kind] for v in found)
        out[kind]["words"] = _share(one["words"] for one in each)
        out[kind]["detection"] = float(np.median([one["detection"] for one in each]))
        if kind in ("rest", "outliers 2 %", "no GNSS", "another lens"):
            errors += [one["errors"] for one in each]
    out["moved where nothing moved"] = Rate(false, draws * len(kinds)).to_dict()
    if len(errors) > 1:
        names = ("points", "surface", "volume")
        out["errors over sigma"] = {
            name: ratio(squares) for name, squares in zip(names, np.array(errors).T, strict=True)
        }
    for kind in moving:
        for name in MOTIONS:
            found = every(kind, name)
            verdicts = Counter(str(one["verdict"]) for one in found)
            what = ("words", "place", "sign", "size")
            right = {name: _share(one[name] for one in found) for name in what}
            out[f"{kind}, {name}"] = {"verdicts": dict(verdicts), **right}
    return out


def _share(found: Iterable[bool]) -> dict:
    return Rate.of(bool(one) for one in found).to_dict()


def main(arguments: list[str] | None = None) -> None:
    """Run the kinds and write two_dates.json."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=30)
    parser.add_argument("--kind", action="append", choices=KINDS, help="only this one")
    options = parser.parse_args(arguments)
    kinds = tuple(options.kind or KINDS)
    moving = tuple(kind for kind in MOVING if kind in kinds)
    # One draw of every kind after the other: an interrupted run says something of all.
    for draws in range(1, options.draws + 1):
        found = rates(draws, options.output / "draws", kinds, moving)
    for kind, one in found.items():
        words = [f"{what} {v['share']:.2f}" for what, v in one.items() if "share" in str(v)]
        print(kind, one["verdicts"], *words) if "verdicts" in one else print(kind, one)
    with whole_file(options.output / "two_dates.json") as part:
        write_json(found, part)


if __name__ == "__main__":
    main()
