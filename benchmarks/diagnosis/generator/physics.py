"""The effects of the catalogue, each by its own physics: what it changes in the world.

A function takes (scene, world, amplitude, rng) and options, changes the world and returns what is
true: a list of entries with `slug`, `parameters` (name, value, unit) and, where it is not the
block's, `flight`, `point` or `per_image`. Names, units and signs: those of the effects' files.
Drifts count from the middle of the exposures.
"""

import numpy as np
from numpy.polynomial.legendre import legvander

EFFECTS = {}


def effect(function):
    """Enter a function into the register, under its own name."""
    EFFECTS[function.__name__] = function
    return function


def entry(slug, unit, values, **where):
    """One entry of the truth; values: name -> number."""
    parameters = [{"name": k, "value": float(v), "unit": unit} for k, v in values.items()]
    return {"slug": slug, **where, "parameters": parameters}


def xyz(vector):
    """x, y, z as names."""
    return dict(zip("xyz", vector, strict=True))


def some_way(rng, size):
    """A vector (3,) of a length, 35 degrees up or down, in a random direction."""
    way = rng.uniform(0, 2 * np.pi)
    up = rng.choice([-1.0, 1.0]) * np.sqrt(1 / 3)
    return size * np.array([np.sqrt(2 / 3) * np.cos(way), np.sqrt(2 / 3) * np.sin(way), up])


# --- the shutter -----------------------------------------------------------------------------


@effect
def rolling_shutter(scene, world, amplitude, rng):
    """Rows are read one after the other while the drone flies and turns. amplitude: readout, s."""
    world.readout = amplitude
    return [entry("rolling_shutter", "s", {"readout": amplitude})]


@effect
def rolling_shutter_rotation(scene, world, amplitude, rng):
    """The camera turns while rows are read; its motion through the air has no part in it.

    amplitude: rms of the rotation from the first row to the last, rad an axis.
    """
    rate = scene.trajectory.rate(scene.trajectory.exposure)
    world.readout, world.carried = amplitude / np.sqrt(np.mean(rate**2)), False
    values = dict(zip(scene.images.tolist(), (world.readout * rate).tolist(), strict=True))
    return [
        entry("rolling_shutter_rotation", "rad", {"rms": amplitude}, per_image={"x, y, z": values})
    ]


# --- the camera ------------------------------------------------------------------------------


@effect
def focal(scene, world, amplitude, rng):
    """A lens of another focal length than its calibration. amplitude: true minus stated, px."""
    world.focal = world.focal + amplitude
    return [entry("focal", "px", {"f": amplitude})]


@effect
def focal_drift(scene, world, amplitude, rng):
    """The lens creeps. amplitude: px/s."""
    world.focal = world.focal + amplitude * scene.time
    return [entry("focal_drift", "px/s", {"rate": amplitude})]


@effect
def focal_per_flight(scene, world, amplitude, rng):
    """Refocused between flights. amplitude: largest change, px; the flights' mean is zero."""
    values = amplitude * _contrast(len(scene.flights), rng)
    world.focal = world.focal + values[scene.trajectory.flight]
    return [
        entry("focal_per_flight", "px", {"f": v}, flight=name)
        for name, v in zip(scene.flights, values, strict=True)
    ]


@effect
def principal_point_drift(scene, world, amplitude, rng):
    """The mount creeps sideways. amplitude: px/s."""
    way = rng.uniform(0, 2 * np.pi)
    rate = amplitude * np.array([np.cos(way), np.sin(way)])
    world.shift = world.shift + scene.time[:, None] * rate
    return [entry("principal_point_drift", "px/s", {"x_rate": rate[0], "y_rate": rate[1]})]


@effect
def principal_point_per_flight(scene, world, amplitude, rng):
    """A stabiliser parks elsewhere in each flight. amplitude: largest shift, px, mean zero."""
    way = rng.uniform(0, 2 * np.pi)
    values = amplitude * _contrast(len(scene.flights), rng)[:, None] * [np.cos(way), np.sin(way)]
    world.shift = world.shift + values[scene.trajectory.flight]
    return [
        entry("principal_point_per_flight", "px", {"cx": v[0], "cy": v[1]}, flight=name)
        for name, v in zip(scene.flights, values, strict=True)
    ]


def _contrast(count, rng):
    """Numbers (count,) of mean zero and size one, in random order."""
    if count < 2:
        raise ValueError("an effect per flight needs two flights")
    return rng.permutation(np.linspace(-1, 1, count))


@effect
def thermal(scene, world, amplitude, rng, shares=(1.0, -0.4, 0.3, 0.2)):
    """Heat stretches the image plane about the picture's middle, bends and shifts it.

    amplitude: px a degree at the end of the long side; shares of scale, cubic and shift x, y.
    Nothing moves at the middle of the temperatures that the optics really have.
    """
    scale, cubic, right, down = amplitude * np.array(shares)
    warmer = scene.heat - (scene.heat.min() + scene.heat.max()) / 2
    middle = (scene.size - 1) / 2

    def law(x, y, image):
        p, q = (x - middle[0]) / scene.half, (y - middle[1]) / scene.half
        stretch = scale + cubic * (p * p + q * q)
        return warmer[image] * (p * stretch + right), warmer[image] * (q * stretch + down)

    world.plane.append(law)
    values = {"scale": scale, "cubic": cubic, "x": right, "y": down}
    return [entry("thermal", "px/C", values)]


@effect
def radial_distortion(scene, world, amplitude, rng):
    """A lens that bends more than its calibration. amplitude: px at the end of the long side."""
    k1 = amplitude / (scene.lens.f * scene.edge**3)

    def law(u, v):
        cube = k1 * (u * u + v * v)
        return u * cube, v * cube

    world.rays.append(law)
    return [entry("radial_distortion", "1", {"k1": k1, "k2": 0.0, "k3": 0.0})]


@effect
def decentring_distortion(scene, world, amplitude, rng):
    """A lens element off its axis, more than calibrated. amplitude: px at the end of the long side.

    Conrady's form: a displacement that grows with the square of the radius, three times as large
    along the element's offset (w) as across.
    """
    way = rng.uniform(0, 2 * np.pi)
    w = amplitude / (3 * scene.lens.f * scene.edge**2) * np.array([np.cos(way), np.sin(way)])

    def law(u, v):
        inner, square = 2 * (w[0] * u + w[1] * v), u * u + v * v
        return w[0] * square + u * inner, w[1] * square + v * inner

    world.rays.append(law)
    return [entry("decentring_distortion", "1", {"p1": w[0], "p2": w[1]})]


@effect
def affine_distortion(scene, world, amplitude, rng):
    """Pixels that are not square and lean. amplitude: px at the end of the long side."""
    way = rng.uniform(0, 2 * np.pi)
    b1, b2 = amplitude / (scene.lens.f * scene.edge) * np.array([np.cos(way), np.sin(way)])
    world.rays.append(lambda u, v: (b1 * u + b2 * v, 0.0 * v))
    return [entry("affine_distortion", "1", {"b1": b1, "b2": b2})]


@effect
def sensor_unflatness(scene, world, amplitude, rng):
    """A sensor that is bent and twisted: where it stands too far back, rays spread further.

    amplitude: rms of the displacement, px. The bump is a polynomial of degree 1 to 3, so that the
    displacement, bump times tangent of the ray, is of degree 2 to 4. What of it is a shift or
    linear, a camera would have been calibrated with: principal point, focal length, affinity. The
    truth holds its coefficients of Legendre polynomials over the picture, x_ij and y_ij, and a map.
    """
    powers = [(i, j) for i in range(4) for j in range(4) if 1 <= i + j <= 3]
    weight = rng.normal(0, 1, len(powers))
    middle, half = (scene.size - 1) / 2, scene.half

    def raw(x, y):
        p, q = (x - middle[0]) / half, (y - middle[1]) / half
        bump = sum(w * p**i * q**j for w, (i, j) in zip(weight, powers, strict=True))
        return bump * p, bump * q

    grid = _grid(scene, 31)
    full = _legendre(scene, *grid)
    low = [np.linalg.lstsq(full, gain, rcond=None)[0][:3] for gain in raw(*grid)]

    def bent(x, y):
        x, y = np.broadcast_arrays(x, y)
        level = _legendre(scene, np.ravel(x), np.ravel(y))[:, :3]
        return tuple(
            gain - (level @ part).reshape(np.shape(x))
            for gain, part in zip(raw(x, y), low, strict=True)
        )

    gain = amplitude / np.sqrt(np.mean(np.square(bent(*grid))))

    def law(x, y, image):
        dx, dy = bent(x, y)
        return gain * dx, gain * dy

    world.plane.append(law)
    return [_plane_entry("sensor_unflatness", scene, law, {"rms": amplitude}, legendre=True)]


def _grid(scene, count):
    """Pixels (n,), (n,) of a grid over the picture."""
    axes = (np.linspace(0, side - 1, count) for side in scene.size)
    return tuple(g.ravel() for g in np.meshgrid(*axes))


def _plane_entry(slug, scene, law, values, legendre=False, **where):
    """Truth of a displacement of the picture, with its map: x, y, dx, dy, px."""
    x, y = _grid(scene, 9)
    dx, dy = law(x, y, 0)
    out = entry(slug, "px", values, **where)
    out["map"] = np.round(np.stack([x, y, dx + 0 * x, dy + 0 * x], axis=1), 4).tolist()
    if legendre:
        x, y = _grid(scene, 31)
        design = _legendre(scene, x, y)
        for axis, gain in zip("xy", law(x, y, 0), strict=True):
            found = np.linalg.lstsq(design, gain, rcond=None)[0]
            out["parameters"] += [
                {"name": f"{axis}_{i}{j}", "value": float(c), "unit": "px"}
                for (i, j), c in zip(_TERMS, found, strict=True)
            ]
    return out


_TERMS = [(t - j, j) for t in range(5) for j in range(t + 1)]  # the first three are no bend


def _legendre(scene, x, y):
    """Products (n, 15) of Legendre polynomials over the picture, `_TERMS`."""
    along, across = (2 * c / (s - 1) - 1 for c, s in zip((x, y), scene.size, strict=True))
    a, b = legvander(along, 4), legvander(across, 4)
    return np.stack([a[:, i] * b[:, j] for i, j in _TERMS], axis=1)


# --- the antenna and the clocks --------------------------------------------------------------


@effect
def lever_arm(scene, world, amplitude, rng):
    """The antenna sits elsewhere than stated, in all flights. amplitude: m."""
    arm = some_way(rng, amplitude)
    world.arm = world.arm + arm
    return [entry("lever_arm", "m", xyz(arm))]


@effect
def lever_arm_per_flight(scene, world, amplitude, rng):
    """The camera is mounted anew between flights; one arm is stated. amplitude: m."""
    arm = _contrast(len(scene.flights), rng)[:, None] * some_way(rng, amplitude)
    world.arm = world.arm + arm
    return [
        entry("lever_arm_per_flight", "m", xyz(a), flight=name)
        for name, a in zip(scene.flights, arm, strict=True)
    ]


@effect
def clock_offset(scene, world, amplitude, rng):
    """The camera's clock is slow: true time = time_s + amplitude, s."""
    world.late = world.late + amplitude
    return [entry("clock_offset", "s", {"offset": amplitude})]


@effect
def time_rounding(scene, world, amplitude, rng):
    """Times are written in coarse steps. amplitude: rms of the error, s: the step is sqrt(12)."""
    step = amplitude * np.sqrt(12)
    time = scene.trajectory.exposure
    late = time - step * np.round(time / step)
    world.late = world.late + late
    values = dict(zip(scene.images.tolist(), late.tolist(), strict=True))
    return [entry("time_rounding", "s", {"rms": amplitude}, per_image={"offset": values})]


@effect
def gnss_bias(scene, world, amplitude, rng, way=None):
    """The base station's coordinates are wrong. amplitude: m; way: direction, else random."""
    bias = some_way(rng, amplitude) if way is None else amplitude * np.asarray(way, dtype=float)
    world.antenna.append(lambda time, position, flight: bias)
    return [entry("gnss_bias", "m", xyz(bias))]


@effect
def gnss_drift(scene, world, amplitude, rng):
    """An ambiguity that converges slowly. amplitude: m/s."""
    rate = some_way(rng, amplitude)
    world.antenna.append(lambda time, position, flight: time[:, None] * rate)
    return [entry("gnss_drift", "m/s", xyz(rate))]


@effect
def gnss_scale(scene, world, amplitude, rng):
    """Positions on a map, in plan, taken for metres on the ground. amplitude: map over true - 1."""
    world.antenna.append(
        lambda time, position, flight: amplitude * (position - scene.middle) * [1, 1, 0]
    )
    return [entry("gnss_scale", "1", {"scale": amplitude})]


# --- the ground ------------------------------------------------------------------------------


@effect
def control_blunder(scene, world, amplitude, rng):
    """One control point, not at the ends of the corridor, is given wrongly. amplitude: m."""
    row = rng.choice(np.flatnonzero(scene.control)[1:-1])
    wrong = some_way(rng, amplitude)
    world.survey = world.survey + (np.arange(len(scene.ground)) == row)[:, None] * wrong
    return [entry("control_blunder", "m", xyz(wrong), point=str(scene.ground_name[row]))]


@effect
def control_datum(scene, world, amplitude, rng):
    """The control points were surveyed from another base. Check points stay true. amplitude: m."""
    wrong = some_way(rng, amplitude)
    world.survey = world.survey + scene.control[:, None] * wrong
    world.surveys = np.where(scene.control, "control", "check")
    return [entry("control_datum", "m", xyz(wrong), survey="control")]


@effect
def earth_curvature(scene, world, amplitude, rng):
    """Control heights above the sea, taken for heights above a plane. amplitude: times the earth's.

    The sea falls away from the plane by R (1 / cos(angle) - 1). Check points stay true.
    """
    radius = 6.371e6
    angle = np.hypot(*(scene.ground - scene.middle)[:, :2].T) / radius
    rise = amplitude * radius * (1 / np.cos(angle) - 1)
    world.survey = world.survey + (scene.control * rise)[:, None] * [0, 0, 1]
    return [entry("earth_curvature", "1", {"fraction": amplitude})]


@effect
def refraction(scene, world, amplitude, rng):
    """Rays bend in the air. amplitude: times that of a standard atmosphere."""
    world.air = amplitude
    return [entry("refraction", "1", {"fraction": amplitude})]
