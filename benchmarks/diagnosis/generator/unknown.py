"""Effects outside the catalogue: a diagnosis should say that something is there, and where."""

import numpy as np

from .physics import _plane_entry, entry

UNKNOWN = {}


def unknown(function):
    """Enter a function into the register, under its own name."""
    UNKNOWN[function.__name__] = function
    return function


def _spot(scene, rng):
    """A place of the picture (2,), px, neither in its middle nor at its rim."""
    way = rng.uniform(0, 2 * np.pi)
    return (scene.size - 1) / 2 + 0.28 * scene.size * [np.cos(way), np.sin(way)]


@unknown
def local_bump(scene, world, amplitude, rng, radius_px=500.0):
    """A dent in the cover glass bends rays away from its middle. amplitude: largest shift, px."""
    spot = _spot(scene, rng)

    def law(x, y, image):
        p, q = (x - spot[0]) / radius_px, (y - spot[1]) / radius_px
        size = amplitude * np.exp(0.5 - (p * p + q * q) / 2)
        return size * p, size * q

    world.plane.append(law)
    box = [*(spot - 2 * radius_px), *(spot + 2 * radius_px)]
    return [
        _plane_entry(
            "local_bump", scene, law, {"largest": amplitude},
            where={"image": np.clip(box, 0, np.tile(scene.size - 1, 2)).tolist()},
        )
    ]  # fmt: skip


@unknown
def window(scene, world, amplitude, rng, tilt_deg=8.0):
    """A tilted plate between lens and sensor covers one side of the picture.

    amplitude: shift in the plate's middle, px. A ray that meets a plate of thickness t and index n
    at the angle i leaves it shifted by t (sin i - cos i sin i / sqrt(n^2 - sin^2 i)).
    """
    index, side, tilt = 1.5, rng.choice([-1.0, 1.0]), np.radians(tilt_deg)
    rim = (scene.size[0] - 1) / 2 + side * 0.15 * scene.size[0]

    def shift(x):
        i = np.arctan((x - (scene.size[0] - 1) / 2) / scene.lens.f) + side * tilt
        return np.sin(i) - np.cos(i) * np.sin(i) / np.sqrt(index**2 - np.sin(i) ** 2)

    far = (rim + (side > 0) * (scene.size[0] - 1)) / 2
    thickness = amplitude / abs(shift(far))

    def law(x, y, image):
        return np.where(side * (x - rim) > 0, thickness * shift(x), 0.0), 0.0 * y

    world.plane.append(law)
    width, height = (scene.size - 1).tolist()
    box = [rim, 0, width, height] if side > 0 else [0, 0, rim, height]
    return [_plane_entry("window", scene, law, {"shift": amplitude}, where={"image": box})]


@unknown
def jello(scene, world, amplitude, rng, frequency=55.0, readout=0.025):
    """A motor's vibration turns the camera to and fro within the readout.

    amplitude: of the rotation, rad; frequency: Hz. Each image has its own phase; the axis is the
    camera's and stays. Nothing else moves during the readout.
    """
    world.readout, world.carried, world.turning = readout, False, False
    phase = rng.uniform(0, 2 * np.pi, len(scene.images))
    axis = rng.normal(0, 1, 3) * [1, 1, 0.3]
    axis /= np.linalg.norm(axis)

    def shake(image, tau):
        return amplitude * np.sin(2 * np.pi * frequency * tau + phase[image])[:, None] * axis

    world.shake = shake
    return [entry("jello", "rad", {"amplitude": amplitude}, where={"row": "all"},
                  frequency_hz=frequency)]  # fmt: skip


@unknown
def ground_motion(scene, world, amplitude, rng, width=0.12):
    """The bank has settled in one place between the survey of the control and the flight.

    amplitude: m; width: standard deviation of the trough, of the corridor's length. Check points
    were surveyed on the day of the flight.
    """
    at = rng.uniform(0.3, 0.7) * scene.length
    s = scene.ground @ scene.along
    sunk = amplitude * np.exp(-0.5 * ((s - at) / (width * scene.length)) ** 2) * scene.control
    world.survey = world.survey + sunk[:, None] * [0, 0, 1]
    place = at * scene.along
    return [entry("ground_motion", "m", {"depth": amplitude},
                  where={"x": float(place[0]), "y": float(place[1])})]  # fmt: skip


@unknown
def ground_creep(scene, world, amplitude, rng, width=0.12):
    """A stretch of the bank slides sideways while the flight goes on, control points and all.

    amplitude: m from the first to the last image; given coordinates are those in the middle.
    """
    at = rng.uniform(0.3, 0.7) * scene.length
    across = np.cross(scene.along, [0, 0, 1])
    share = scene.time / np.ptp(scene.time)

    def moves(position, image):
        s = position @ scene.along
        size = amplitude * np.exp(-0.5 * ((s - at) / (width * scene.length)) ** 2)
        return (size * share[image])[:, None] * across

    world.ground_moves = moves
    place = at * scene.along
    return [entry("ground_creep", "m", {"slide": amplitude},
                  where={"x": float(place[0]), "y": float(place[1])})]  # fmt: skip


@unknown
def focus_hunting(scene, world, amplitude, rng, lasts=8):
    """The autofocus settles anew every few images. amplitude: standard deviation of f, px."""
    steps = rng.random(len(scene.images)) < 1 / lasts
    level = rng.normal(0, 1, len(steps))[np.cumsum(steps)]
    gain = amplitude * (level - level.mean()) / level.std()
    world.focal = world.focal + gain
    values = dict(zip(scene.images.tolist(), gain.tolist(), strict=True))
    return [entry("focus_hunting", "px", {"rms": amplitude}, per_image={"f": values})]


@unknown
def camera_step(scene, world, amplitude, rng):
    """A knock between two strips of one flight moves the lens. amplitude: px of cx, cy; f half."""
    strip, flight = scene.trajectory.strip, scene.trajectory.flight
    ends = np.flatnonzero((np.diff(strip) != 0) & (np.diff(flight) == 0))
    if not len(ends):
        raise ValueError("a step needs a flight of two strips")
    last = ends[np.argmin(np.abs(ends - 0.5 * len(strip)))]
    after = np.arange(len(strip)) > last
    way = rng.uniform(0, 2 * np.pi)
    shift = amplitude * np.array([np.cos(way), np.sin(way)])
    change = rng.choice([-0.5, 0.5]) * amplitude
    world.shift = world.shift + after[:, None] * shift
    world.focal = world.focal + after * change
    time = scene.trajectory.exposure
    moment = float((time[last] + time[last + 1]) / 2)
    return [entry("camera_step", "px", {"f": change, "cx": shift[0], "cy": shift[1]},
                  where={"time_s": moment, "flight": scene.flights[flight[last]]})]  # fmt: skip
