"""Dirty blocks of any size, by code of their own.

Nothing of the package's projection or effects is used, only its tables. What makes a block dirty is
what real ones have and no effect of the catalogue describes: a lens that is no polynomial, rows
that shift from image to image, clusters of wrong matches, uneven overlap, water without points,
images without a position, gaps, a second camera, control or none. Points are drawn and seen in
arrays, so that 2,500 images take seconds.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
import pandas as pd

from corridor import Block, Camera

WIDTH, HEIGHT, F = 4000, 3000, 3000.0
ALTITUDE_M, SPEED, BEND_M, BENDS_M = 60.0, 5.0, 20.0, 700.0
TIE_PX, MARK_PX = 0.4, 0.4
GNSS_M, SLOW_M, SLOW_S = (0.008, 0.008, 0.015), (0.006, 0.006, 0.012), 60.0
CONTROL_M = (0.005, 0.005, 0.008)
ARM = np.array([0.10, -0.05, -0.30])
# Waves of what a lens leaves, and of the rows of one image.
_BUMPS, _WAVES = 14, 3


@dataclass(frozen=True)
class Dirt:
    """What is wrong with a block.

    lens: rms px of what no polynomial describes. rows: rms px of the rows' shift in each image.
    matches: clusters of wrong matches. uneven: spread of the logarithm of base lengths. water:
    spread of the logarithm of the density of points. lost: share of images without a position.
    gaps: runs of images that are missing. cameras: 1, or 2 in turn of strips. strips. control,
    check: ground points. motion: whether images.csv has velocities. heat: and temperatures.
    """

    lens: float = 0.0
    rows: float = 0.0
    matches: int = 0
    uneven: float = 0.0
    water: float = 0.0
    lost: float = 0.0
    gaps: int = 0
    cameras: int = 1
    strips: int = 2
    control: int = 5
    check: int = 5
    motion: bool = True
    heat: bool = False

    @classmethod
    def drawn(cls, images: int, rng: np.random.Generator) -> Dirt:
        """Dirt of all kinds, each there or not."""

        def one(of: list, chances: list | None = None):
            return of[int(rng.choice(len(of), p=chances))]

        strips = one([1, 2, 3], [0.2, 0.5, 0.3])
        lost = one([0.0, 0.3, 1.0], [0.6, 0.25, 0.15])
        # Strips that nothing holds are lines about which a block can turn.
        control = one([0, 4, 6], [0.25, 0.4, 0.35]) if lost < 1.0 else 6
        return cls(
            lens=one([0.0, 0.1, 0.2, 0.3]),
            rows=one([0.0, 0.1, 0.2], [0.6, 0.2, 0.2]),
            matches=one([0, 1, 3]) * max(images // 40, 1),
            uneven=one([0.0, 0.15, 0.3]),
            water=one([0.0, 0.7, 1.2]),
            lost=lost,
            gaps=one([0, 1, 2]) if images >= 40 else 0,
            cameras=one([1, 2], [0.75, 0.25]) if strips > 1 and images >= 40 else 1,
            strips=strips,
            control=control,
            check=one([0, 4]),
            motion=one([True, False]),
            heat=one([True, False]),
        )


@dataclass(frozen=True)
class Rung:
    """block, and what is wrong with it; truth: as `NAME.truth.json` holds it."""

    block: Block
    dirt: Dirt

    @property
    def truth(self) -> dict:
        """No effect of the catalogue; what lies outside is told by its kind."""
        d = self.dirt
        there = {"lens": d.lens, "rows": d.rows, "matches": d.matches}
        outside = [name for name, size in there.items() if size]
        return {"effects": [], "outside": outside, "dirt": asdict(d)}


def made(images: int, seed: int, dirt: Dirt | None = None, per_image: int = 120) -> Rung:
    """A block of about so many images; dirt: default drawn. per_image: tie observations."""
    rng = np.random.default_rng([images, seed])
    dirt = Dirt.drawn(images, rng) if dirt is None else dirt
    flight = _flown(images, dirt, rng)
    lenses = [_Lens.drawn(dirt.lens, rng) for _ in range(dirt.cameras)]
    ties = _ties(flight, lenses, dirt, per_image, rng)
    ground = _ground(flight, lenses, dirt, rng)
    tables = flight.tables(dirt, rng) | ties | ground
    cameras = {
        name: Camera.from_table(name, {"width": WIDTH, "height": HEIGHT, "f": F + 8.0})
        for name in [f"cam{k + 1}" for k in range(dirt.cameras)]
    }
    sigma = {
        "tie_px": TIE_PX,
        "mark_px": MARK_PX,
        "gnss_m": np.hypot(GNSS_M, SLOW_M),
        "control_m": np.array(CONTROL_M),
    }
    block = Block(name=f"rung_{images}_{seed}", cameras=cameras, sigma=sigma, **tables)
    return Rung(block, dirt)


def double(block: Block) -> Block:
    """The same evidence twice, or half of it: its verdict should be that of the block.

    With positions: two copies, one behind the other in space and time, as one flight. Without:
    every second point, for copies would not hang together.
    """
    # Of blocks that little holds, a second copy would be a second block.
    if len(block.gnss) < 0.5 * len(block.images):
        out = block.copy()
        rows = block.tie_points
        out.tie_points = rows[rows["point"].cat.codes.to_numpy() % 2 == 0].reset_index(drop=True)
        return out
    images = block.images
    place = images[["x", "y"]].to_numpy(float)
    away = np.array([np.ptp(place[:, 0]) + 500.0, 0.0])
    later = float(np.ptp(images["time_s"]) + 60.0)
    out = replace(block, name=f"{block.name}_double")
    for table in ("images", "tie_points", "points", "marks", "ground", "gnss"):
        rows = getattr(block, table)
        copy = rows.copy()
        for name in ("image", "point"):
            if name in copy:
                copy[name] = copy[name].astype(str) + "_b"
        if table not in ("tie_points", "marks") and len(copy):
            copy["x"], copy["y"] = copy["x"] + away[0], copy["y"] + away[1]
        if table == "images":
            copy["time_s"] = copy["time_s"] + later
        both = [rows.astype({n: str for n in ("image", "point") if n in rows}), copy]
        setattr(out, table, pd.concat(both, ignore_index=True) if len(rows) else rows)
    return replace(out)


# --- the flight ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Flight:
    """Images as flown: centre (m, 3), world to camera (m, 3, 3), strip and camera (m,), along
    (m,) m, time (m,) s, velocity (m, 3); length of the corridor, m."""

    centre: np.ndarray
    rotation: np.ndarray
    strip: np.ndarray
    camera: np.ndarray
    along: np.ndarray
    time: np.ndarray
    velocity: np.ndarray
    length: float

    @property
    def names(self) -> np.ndarray:
        return np.array([f"S{s + 1}_{n:05d}" for n, s in enumerate(self.strip)], dtype=object)

    def tables(self, dirt: Dirt, rng) -> dict:
        """images.csv and gnss.csv."""
        m = len(self.centre)
        start = self.centre + rng.normal(0, 0.2, (m, 3))
        turned = _turn(rng.normal(0, np.radians(0.2), (m, 3))) @ self.rotation
        images = {
            "image": self.names,
            "camera": [f"cam{k + 1}" for k in self.camera],
            "flight": [f"F{k + 1}" for k in self.camera],
            "strip": [f"S{s + 1}" for s in self.strip],
            "time_s": np.round(self.time, 3),
            **dict(zip("xyz", start.T, strict=True)),
            **dict(zip(("qw", "qx", "qy", "qz"), _quaternion(turned).T, strict=True)),
        }
        if dirt.motion:
            speed = self.velocity + rng.normal(0, 0.02, (m, 3))
            images |= dict(zip(("vx", "vy", "vz"), speed.T, strict=True))
        if dirt.heat:
            warm = 20.0 + 15.0 * (1.0 - np.exp(-(self.time - self.time.min()) / 400.0))
            images["temperature_c"] = np.round(warm, 1)
        out = {"images": pd.DataFrame(images)}
        kept = rng.random(m) >= dirt.lost
        if kept.any():
            antenna = self.centre + np.einsum("nji,j->ni", self.rotation, ARM)
            antenna = antenna + rng.normal(0, 1, (m, 3)) * GNSS_M + self._slow(rng) * SLOW_M
            table = {"image": self.names, **dict(zip("xyz", antenna.T, strict=True))}
            out["gnss"] = pd.DataFrame(table)[kept].reset_index(drop=True)
        return out

    def _slow(self, rng) -> np.ndarray:
        """Noise (m, 3) of size one that remembers for a minute."""
        order = np.argsort(self.time)
        keep = np.exp(-np.diff(self.time[order], prepend=-np.inf) / SLOW_S)
        out, state = np.empty((len(order), 3)), np.zeros(3)
        for n, k in zip(order, keep, strict=True):
            state = k * state + np.sqrt(1.0 - k * k) * rng.standard_normal(3)
            out[n] = state
        return out


def _flown(images: int, dirt: Dirt, rng) -> _Flight:
    """Strips along a winding corridor, each flown back against the one before."""
    each = np.diff(np.linspace(0, images, dirt.strips + 1).round().astype(int))
    apart = 28.0
    strip, along, time, now = [], [], [], 0.0
    for s, count in enumerate(each):
        steps = 12.0 * np.exp(rng.normal(0, dirt.uneven, count) - dirt.uneven**2 / 2)
        # More than that and the next image but one shows nothing of this one.
        place = np.cumsum(np.clip(steps, 5.0, 20.0))
        when = now + np.cumsum(np.clip(steps, 5.0, 20.0)) / SPEED
        now = when[-1] + 40.0
        if s % 2:
            place = place[::-1]
        strip.append(np.full(count, s))
        along.append(place)
        time.append(when)
    strip, along, time = (np.concatenate(part) for part in (strip, along, time))
    keep = np.ones(len(strip), dtype=bool)
    for _ in range(dirt.gaps):
        # Three images in a row: less than half of the overlap is left, and strips beside.
        first = rng.integers(3, max(len(strip) - 6, 4))
        keep[first : first + 2] = False
    strip, along, time = strip[keep], along[keep], time[keep]
    across = (strip - (dirt.strips - 1) / 2) * apart
    centre, heading = _corridor(along, across)
    centre[:, 2] = ALTITUDE_M + 4.0 * (strip % 2) + 2.0 * np.sin(along / 90.0)
    centre += rng.normal(0, 0.4, centre.shape)
    back = strip % 2 == 1
    heading = heading + np.where(back, np.pi, 0.0)
    c, s, zero = np.cos(heading), np.sin(heading), np.zeros(len(heading))
    rows = [np.stack(r, 1) for r in ((s, -c, zero), (-c, -s, zero), (zero, zero, zero - 1.0))]
    level = np.stack(rows, axis=1)
    rotation = _turn(rng.normal(0, np.radians(2.0), (len(heading), 3))) @ level
    velocity = SPEED * np.stack([c, s, zero], axis=1)
    camera = strip * dirt.cameras // dirt.strips
    # A change of the camera is a landing.
    time = time + 300.0 * camera
    return _Flight(centre, rotation, strip, camera, along, time, velocity, float(along.max()))


def _corridor(along, across):
    """Places (n, 3) beside a winding middle line, and its heading (n,) rad."""
    slope = np.arctan(BEND_M * 2 * np.pi / BENDS_M * np.cos(2 * np.pi * along / BENDS_M))
    x = along - across * np.sin(slope)
    y = BEND_M * np.sin(2 * np.pi * along / BENDS_M) + across * np.cos(slope)
    return np.stack([x, y, np.zeros_like(x)], axis=1), slope


def _turn(vector):
    """Rotations (n, 3, 3) of vectors (n, 3), rad (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=1)
    x, y, z = (vector / np.maximum(angle, 1e-300)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, rest = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + rest * cross @ cross


def _quaternion(rotation):
    """w, x, y, z (n, 4) of rotations (n, 3, 3), by the largest of the four (Shepperd 1978)."""
    r = rotation
    trace = np.trace(r, axis1=1, axis2=2)
    square = np.stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1)
    square = np.where(np.arange(4) == 0, 1 + trace[:, None], 1 + 2 * square - trace[:, None]) / 4
    a, b, c = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]
    d, e, f = r[:, 0, 1] + r[:, 1, 0], r[:, 0, 2] + r[:, 2, 0], r[:, 1, 2] + r[:, 2, 1]
    w2, x2, y2, z2 = 4 * square.T
    table = np.array([[w2, a, b, c], [a, x2, d, e], [b, d, y2, f], [c, e, f, z2]])
    best = square.argmax(axis=1)
    out = table[best, :, np.arange(len(r))]
    return out / np.linalg.norm(out, axis=1, keepdims=True)


# --- what the cameras make of it -------------------------------------------------------------


@dataclass(frozen=True)
class _Lens:
    """f, point (2,) px, strength of a radial law by the angle; bumps (k, 5): middle, width (in
    half pictures), size dx, dy px."""

    f: float
    point: np.ndarray
    strength: float
    bumps: np.ndarray

    @classmethod
    def drawn(cls, rms: float, rng) -> _Lens:
        bumps = np.concatenate(
            [
                rng.uniform(-1, 1, (_BUMPS, 2)),
                rng.uniform(0.15, 0.5, (_BUMPS, 1)),
                rng.normal(0, 1, (_BUMPS, 2)),
            ],
            axis=1,
        )
        point = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) + rng.normal(0, 5, 2)
        lens = cls(F + rng.normal(0, 4), point, rng.uniform(0.03, 0.12), bumps)
        grid = np.stack(np.meshgrid(np.linspace(0, WIDTH, 31), np.linspace(0, HEIGHT, 31)), -1)
        size = np.sqrt(np.mean(lens._left(grid.reshape(-1, 2)) ** 2))
        bumps[:, 3:] *= rms / size
        return lens

    def _left(self, xy):
        """What it leaves (n, 2) px of all polynomials at pixels (n, 2)."""
        p = xy / np.array([WIDTH, HEIGHT]) * 2 - 1
        out = np.zeros_like(xy)
        for bump in self.bumps:
            near = np.exp(-0.5 * ((p - bump[:2]) ** 2).sum(axis=1) / bump[2] ** 2)
            out += near[:, None] * bump[3:]
        return out

    def picture(self, seen):
        """Pixels (n, 2) of points (n, 3) in the camera frame, z forward."""
        u, v = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        r = np.maximum(np.hypot(u, v), 1e-12)
        # A part of the tangent is replaced by the angle, as wide lenses have it.
        factor = (1 - self.strength) + self.strength * np.arctan(r) / r
        xy = self.point + self.f * np.stack([u * factor, v * factor], axis=1)
        return xy + self._left(xy)


def _land(along, across):
    """Points (n, 3) of the ground: a dike beside gentle land."""
    out, _ = _corridor(along, across)
    out[:, 2] = 4.0 * np.exp(-((across / 9.0) ** 2)) + 1.5 * np.sin(along / 45.0)
    return out


def _seen(flight: _Flight, lenses, xyz, along):
    """Point, image (k,) and pixel (k, 2) of all sights of points (n, 3)."""
    found = []
    for s in range(int(flight.strip.max()) + 1):
        images = np.flatnonzero(flight.strip == s)
        images = images[np.argsort(flight.along[images])]
        near = np.searchsorted(flight.along[images], along)
        for step in range(-7, 7):
            place = near + step
            rows = np.flatnonzero((place >= 0) & (place < len(images)))
            image = images[place[rows]]
            rows, image = rows[:], image
            close = np.abs(flight.along[image] - along[rows]) < 45.0
            rows, image = rows[close], image[close]
            seen = np.einsum("nij,nj->ni", flight.rotation[image], xyz[rows] - flight.centre[image])
            lens = lenses[int(flight.camera[images[0]])]
            pixel = lens.picture(seen)
            inside = ((pixel > 15) & (pixel < np.array([WIDTH, HEIGHT]) - 16)).all(axis=1)
            found.append((rows[inside], image[inside], pixel[inside]))
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def _ties(flight: _Flight, lenses, dirt: Dirt, per_image: int, rng) -> dict:
    """tie_points.csv and points.csv."""
    m, reach = len(flight.centre), 0.5 * (int(flight.strip.max()) + 1) * 28.0 + 25.0
    # Some six rays a point, of which two in three are found.
    count = max(int(per_image * m / 4.0), 120)
    density = np.exp(dirt.water * _smooth(rng, flight.length)(np.arange(0, flight.length, 5.0)))
    cell = rng.choice(len(density), count, p=density / density.sum())
    along = 5.0 * cell + rng.uniform(0, 5.0, count)
    across = rng.uniform(-reach, reach, count)
    xyz = _land(along, across)
    point, image, pixel = _seen(flight, lenses, xyz, along)
    taken = rng.random(len(point)) < 0.65
    point, image, pixel = point[taken], image[taken], pixel[taken]
    many = np.bincount(point, minlength=count)[point] >= 2
    point, image, pixel = point[many], image[many], pixel[many]
    pixel = pixel + _of_rows(flight, dirt, image, pixel, rng)
    tail = np.sqrt(5.0 / rng.chisquare(5.0, len(point))) * np.sqrt(3.0 / 5.0)
    pixel = pixel + TIE_PX * tail[:, None] * rng.standard_normal(pixel.shape)
    wrong = rng.random(len(point)) < 0.004
    pixel[wrong] += rng.normal(0, 12.0, (int(wrong.sum()), 2))
    for _ in range(dirt.matches):
        # A patch that moves while it is photographed: water, a shadow, a car.
        middle = xyz[rng.integers(count)]
        there = (np.linalg.norm((xyz - middle)[:, :2], axis=1) < 5.0)[point]
        for k in np.unique(image[there]):
            mine = np.flatnonzero(there & (image == k))
            mine = mine[rng.random(len(mine)) < 0.6]
            pixel[mine] += rng.normal(0, 8.0, 2)
    inside = ((pixel > 0) & (pixel < np.array([WIDTH, HEIGHT]) - 1)).all(axis=1)
    point, image, pixel = point[inside], image[inside], pixel[inside]
    names = np.array([f"T{k:06d}" for k in range(count)], dtype=object)
    known = np.unique(point)
    start = xyz[known] + rng.normal(0, 0.2, (len(known), 3))
    return {
        "tie_points": _observed(names[point], flight.names[image], pixel),
        "points": pd.DataFrame({"point": names[known], **dict(zip("xyz", start.T, strict=True))}),
    }


def _smooth(rng, length: float):
    """A smooth curve of unit spread along the corridor."""
    wave = rng.uniform(1.0, 9.0, 6) * 2 * np.pi / max(length, 300.0)
    phase = rng.uniform(0, 2 * np.pi, 6)
    return lambda s: np.sin(np.multiply.outer(s, wave) + phase).sum(axis=-1) / np.sqrt(3.0)


def _of_rows(flight: _Flight, dirt: Dirt, image, pixel, rng):
    """What shifts the rows (n, 2) px of each image, as a shaken shutter does."""
    m = len(flight.centre)
    size = dirt.rows / np.sqrt(_WAVES / 2) * rng.standard_normal((m, _WAVES, 2))
    number = rng.uniform(0.5, 3.0, (m, _WAVES)) * 2 * np.pi / HEIGHT
    phase = rng.uniform(0, 2 * np.pi, (m, _WAVES))
    wave = np.sin(number[image] * pixel[:, 1:] + phase[image])
    return np.einsum("nk,nkj->nj", wave, size[image])


def _ground(flight: _Flight, lenses, dirt: Dirt, rng) -> dict:
    """marks.csv and ground.csv; nothing without ground points."""
    count = dirt.control + dirt.check
    if not count:
        return {}
    along = flight.along.min() + np.ptp(flight.along) * (np.arange(count) + 0.5) / count
    xyz = _land(along, np.where(np.arange(count) // 2 % 2, 12.0, -12.0))
    point, image, pixel = _seen(flight, lenses, xyz, along)
    pixel = pixel + rng.normal(0, MARK_PX, pixel.shape)
    role = np.full(count, "check", dtype=object)
    role[np.linspace(0, count - 1, dirt.control).round().astype(int)] = "control"
    names = np.array([f"G{k + 1}" for k in range(count)], dtype=object)
    given = xyz + rng.normal(0, 1, xyz.shape) * CONTROL_M
    seen = np.bincount(point, minlength=count) >= 2
    ground = pd.DataFrame({"point": names, **dict(zip("xyz", given.T, strict=True)), "role": role})
    shown = seen[point]
    return {
        "marks": _observed(names[point[shown]], flight.names[image[shown]], pixel[shown]),
        "ground": ground[seen].reset_index(drop=True),
    }


def _observed(point, image, pixel):
    return pd.DataFrame({"point": point, "image": image, "x": pixel[:, 0], "y": pixel[:, 1]})
