"""Where the drone is and how its camera looks at any moment: one spline through time.

The path is flown as a drone flies it: take-off from rest, run in, strip, stop and turn, next strip,
home. Wind pushes the path and shakes the gimbal. Nothing here knows of images or of the package.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

KNOT_S = 0.5
ACCELERATION = 2.0  # m/s2 at the ends of a leg
REST_S, STOP_S = 12.0, 4.0  # on the ground before take-off; at a turn
RATE_STEP_S = 1e-3


@dataclass(frozen=True)
class Strip:
    """A line to photograph: ends (3,) m, heading of the picture's top and tilt forward, rad."""

    start: np.ndarray
    end: np.ndarray
    heading: float
    tilt: float
    images: int


@dataclass(frozen=True)
class Air:
    """What the wind does.

    gust_m, gust_s: standard deviation and correlation time of the push of the path; wander_m: of
    the slow one (15 s); shake_deg, shake_s: of the camera's attitude; head: wind along the
    corridor as a fraction of the speed; surge: variation of the speed within a strip, fraction.
    """

    gust_m: float = 0.3
    gust_s: float = 3.0
    wander_m: float = 0.8
    shake_deg: float = 0.5
    shake_s: float = 1.5
    head: float = 0.08
    surge: float = 0.04


CALM = Air(gust_m=0.0, wander_m=0.0, shake_deg=0.0, surge=0.0)


@dataclass
class Trajectory:
    """One spline over all flights.

    exposure: (images,) s, true; flight, strip: (images,) index; span: (flights, 2) s from power on
    to power off of the receiver.
    """

    spline: CubicSpline
    exposure: np.ndarray
    flight: np.ndarray
    strip: np.ndarray
    span: np.ndarray
    turned: CubicSpline = field(init=False)
    moved: CubicSpline = field(init=False)

    def __post_init__(self):
        pieces, knots = self.spline.c, self.spline.x
        self.moved = CubicSpline.construct_fast(pieces[..., :3], knots)
        self.turned = CubicSpline.construct_fast(pieces[..., 3:], knots)

    def centre(self, time):
        """Camera centre (n, 3), m."""
        return self.moved(time)

    def velocity(self, time):
        """Velocity of the centre (n, 3), m/s."""
        return self.moved(time, 1)

    def rotation(self, time):
        """World to camera (n, 3, 3)."""
        heading, tilt, *shake = np.moveaxis(self.turned(time), -1, 0)
        return rotation(np.stack(shake, axis=-1)) @ looking(heading, tilt)

    def rate(self, time):
        """Angular rate of the camera in its own frame (n, 3), rad/s: dR/dt = -[w] R."""
        before, after = self.rotation(time - RATE_STEP_S), self.rotation(time + RATE_STEP_S)
        return -vector(after @ before.transpose(0, 2, 1)) / (2 * RATE_STEP_S)


def looking(heading, tilt):
    """World to camera (n, 3, 3): down, the picture's top towards heading, tilted towards it.

    heading: rad clockwise from north; tilt: rad from the nadir.
    """
    zero = np.zeros_like(heading)
    right = np.stack([np.cos(heading), -np.sin(heading), zero], axis=-1)
    ahead = np.stack([np.sin(heading), np.cos(heading), zero], axis=-1)
    down = np.stack([zero, zero, zero - 1.0], axis=-1)
    cosine, sine = np.cos(tilt)[..., None], np.sin(tilt)[..., None]
    return np.stack([right, sine * down - cosine * ahead, cosine * down + sine * ahead], axis=-2)


def rotation(vectors):
    """Rotation matrices (n, 3, 3) about vectors (n, 3), rad (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    first = np.sinc(angle / np.pi)[..., None, None]
    second = (0.5 * np.sinc(angle / (2 * np.pi)) ** 2)[..., None, None]
    return np.eye(3) + first * cross + second * (cross @ cross)


def vector(matrices):
    """Rotation vector (n, 3), rad, of small rotations (n, 3, 3)."""
    m = matrices
    half = 0.5 * np.stack(
        [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=-1
    )
    sine = np.linalg.norm(half, axis=1, keepdims=True)
    return half * np.where(sine > 1e-12, np.arcsin(sine) / np.maximum(sine, 1e-12), 1.0)


def quaternion(matrices):
    """Unit quaternions (n, 4), w first and not negative, by the largest eigenvector.

    Source: Bar-Itzhack 2000, "New method for extracting the quaternion from a rotation matrix".
    """
    m = matrices
    k = np.empty((len(m), 4, 4))
    k[:, 0, 0] = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    k[:, 0, 1] = k[:, 1, 0] = m[:, 2, 1] - m[:, 1, 2]
    k[:, 0, 2] = k[:, 2, 0] = m[:, 0, 2] - m[:, 2, 0]
    k[:, 0, 3] = k[:, 3, 0] = m[:, 1, 0] - m[:, 0, 1]
    for a in range(3):
        for b in range(3):
            k[:, a + 1, b + 1] = m[:, a, b] + m[:, b, a]
        k[:, a + 1, a + 1] = 2 * m[:, a, a] - k[:, 0, 0]
    found = np.linalg.eigh(k)[1][:, :, -1]
    return found * np.where(found[:, :1] < 0, -1.0, 1.0)


def fly(flights, speed, air, pause_s, rng, beyond_s=0.0):
    """A Trajectory.

    flights: list of lists of Strip; speed: m/s through the air; pause_s: s between two flights.
    beyond_s: photographs go on so long before and after each strip, where the drone speeds up,
    brakes and stands.
    """
    legs = [_plan(strips, speed, air, rng) for strips in flights]
    tables, windows, clock = [], [], 30.0
    for table, window in legs:
        tables.append(table + [clock, *[0.0] * 5])
        windows.append(window + clock)
        clock = np.ceil(tables[-1][-1, 0] + pause_s)
    parts = [_disturb(table, air, rng) for table in tables]
    known = np.concatenate(parts)
    exposure, flight, strip, number = [], [], [], 0
    for k, (strips, window) in enumerate(zip(flights, windows, strict=True)):
        for one, (begin, end) in zip(strips, window, strict=True):
            step = (end - begin) / (one.images - 1)
            more = int(beyond_s / step)
            count = one.images + 2 * more
            time = np.linspace(begin - more * step, end + more * step, count)
            time += rng.normal(0, 0.02, count)
            exposure.append(np.round(time, 6))
            flight.append(np.full(count, k))
            strip.append(np.full(count, number))
            number += 1
    span = np.array([[np.ceil(part[0, 0]), np.floor(part[-1, 0])] for part in parts])
    return Trajectory(
        CubicSpline(known[:, 0], known[:, 1:]),
        np.concatenate(exposure), np.concatenate(flight), np.concatenate(strip), span,
    )  # fmt: skip


def _plan(strips, speed, air, rng):
    """Knots (n, 6): time, centre, heading, tilt, undisturbed; and the strips' windows (k, 2) s."""
    home = strips[0].start * [1, 1, 0] + [-15.0, 10.0, 0.0]
    home[2] = strips[0].start[2] - 0.95 * abs(strips[0].start[2])
    run = speed**2 / ACCELERATION + 2.0 * speed  # the smoothing of the path reaches 2 s far
    stops = [(home, strips[0].heading, strips[0].tilt, 0.0)]
    up = home.copy()
    up[2] = strips[0].start[2]
    stops.append((up, strips[0].heading, strips[0].tilt, 3.0))
    lengths = {}  # of the stops at which strips end
    for one in strips:
        way = one.end - one.start
        ahead = way / np.linalg.norm(way)
        against = np.sign(ahead[0] + 1e-9)
        fast = speed * (1 + air.head * against + air.surge * rng.uniform(-1, 1))
        stops.append((one.start - run * ahead, one.heading, one.tilt, speed))
        stops.append((one.end + run * ahead, one.heading, one.tilt, fast))
        lengths[len(stops) - 1] = np.linalg.norm(way)
    stops += [(up, strips[-1].heading, strips[-1].tilt, speed), (home, *stops[-1][1:3], 2.0)]

    time, angle = [0.0, REST_S], [stops[0][1:3]] * 2
    when, where = [np.array([0.0])], [stops[0][0][None]]
    windows, clock = [], REST_S
    for n in range(1, len(stops)):
        here, there = stops[n - 1][0], stops[n][0]
        distance = np.linalg.norm(there - here)
        elapsed, passed = _trapezoid(distance, stops[n][3])
        if n in lengths:
            waves = max(1, round(distance / 150.0))
            size = air.surge * distance / (2 * np.pi * waves) * rng.choice([-1, 1])
            passed = passed + size * np.sin(2 * np.pi * waves * passed / distance)
            windows.append(clock + np.interp([run, run + lengths[n]], passed, elapsed))
        when.append(clock + elapsed)
        where.append(here + (passed / max(distance, 1e-9))[:, None] * (there - here))
        # The camera turns while the drone stands, before it leaves for the next stop.
        time += [clock, clock + elapsed[-1]]
        angle += [stops[n][1:3]] * 2
        clock += elapsed[-1] + STOP_S
    time.append(clock + REST_S)
    angle.append(angle[-1])
    knots = np.arange(0.0, time[-1], KNOT_S)
    when, where = np.concatenate(when), np.concatenate(where)
    table = np.empty((len(knots), 6))
    table[:, 0] = knots
    for axis in range(3):
        table[:, 1 + axis] = np.interp(knots, when, where[:, axis])
    angle = np.array(angle, dtype=float)
    for axis in range(2):
        table[:, 4 + axis] = np.interp(knots, time, angle[:, axis])
    table[:, 1:] = gaussian_filter1d(table[:, 1:], 1.0 / KNOT_S, axis=0, mode="nearest")
    return table, np.array(windows)


def _trapezoid(distance, speed):
    """Times (n,) s and ways (n,) m of a leg that starts and ends at rest."""
    if distance < 1e-6:
        return np.array([0.0, 0.0]), np.array([0.0, 0.0])
    speed = min(speed, np.sqrt(distance * ACCELERATION))
    ramp = speed / ACCELERATION
    total = distance / speed + ramp
    time = np.linspace(0, total, max(int(total / 0.05), 20))
    early, late = np.minimum(time, ramp), np.minimum(total - time, ramp)
    way = 0.5 * ACCELERATION * early**2 + speed * np.clip(time - ramp, 0, total - 2 * ramp)
    return time, way + np.where(time > total - ramp, 0.5 * ACCELERATION * (ramp**2 - late**2), 0.0)


def _disturb(table, air, rng):
    """Knots (n, 9): time, centre, heading, tilt, shake (rotation vector, rad), in the wind."""
    count = len(table)
    flying = np.clip((table[:, 3] - table[:, 3].min()) / 5.0, 0, 1)
    flying = flying * flying * (3 - 2 * flying)

    def smooth(seconds, axes):
        width = seconds / np.sqrt(2) / KNOT_S
        pad = int(5 * width) + 1
        noise = gaussian_filter1d(rng.standard_normal((count + 2 * pad, axes)), width, axis=0)
        return noise[pad : pad + count] * np.sqrt(2 * width * np.sqrt(np.pi)) * flying[:, None]

    out = np.empty((count, 9))
    out[:, :6] = table
    out[:, 1:4] += air.gust_m * smooth(air.gust_s, 3) * [1, 1, 0.5]
    out[:, 1:4] += air.wander_m * smooth(15.0, 3) * [1, 1, 0.3]
    out[:, 6:] = np.radians(air.shake_deg) * smooth(air.shake_s, 3)
    return out
