"""Perfect blocks of parallel strips along a straight corridor."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numba import njit

from corridor.block import Block
from corridor.camera import (
    INTERIOR,
    Camera,
    distort,
    quaternion_from_rotation,
    radials_in_use,
    rotation_from_quaternion,
    rotation_from_vector,
    undistort,
)
from corridor.errors import InputError
from corridor.simulation.terrain import Dike

# IGN's CamLight with a 35 mm lens (thesis, tables 4.1 and 5.1: 5120 x 3840 px, f 5489 px); its
# distortion is not published: these coefficients move a corner by some 35 px, as such a lens does.
CAMLIGHT = Camera(
    name="camlight",
    width=5120,
    height=3840,
    interior=np.array(
        [
            {
                "f": 5489.0,
                "cx": 2571.5,
                "cy": 1911.5,
                "k1": -0.042,
                "k2": 0.028,
                "k3": -0.006,
                "p1": 2.0e-4,
                "p2": -1.5e-4,
            }.get(parameter, 0.0)
            for parameter in INTERIOR
        ]
    ),
    pixel_um=6.4,
)

# Points are not found in the outermost pixels: a window of a matcher must fit in.
_BORDER_PX = 10.0
_MOST_IMAGES = 1_000_000


def corridor_block(
    images: int = 42,
    strips: int = 3,
    height: float | Sequence[float] = 50.0,
    forward: float = 0.8,
    side: float = 0.6,
    camera: Camera = CAMLIGHT,
    observations_per_image: int = 440,
    relief: float = 3.0,
    gnss: bool = True,
    control: int = 5,
    check: int = 6,
    seed: int = 0,
    *,
    flights: int = 1,
    long_side: str = "across",
    turned: bool = True,
    azimuth_deg: float = 90.0,
    interval_s: float = 2.5,
    wind: float = 0.3,
    turn_s: float = 12.0,
    attitude_jitter_deg: float = 1.5,
    position_jitter: float = 0.3,
    velocity_jitter: float = 0.1,
    angular_rate_deg_s: float = 1.0,
    lever_arm: Sequence[float] = (0.10, -0.05, 0.35),
    level: float = 0.0,
    start_error: tuple[float, float, float] | None = None,
    name: str = "corridor",
) -> Block:
    """Error-free block of parallel nadir strips along a straight dike.

    images: of all strips together; a strip gets its share so that all have one length.
    height: of the camera above the plain, metres, one number or one a strip.
    forward, side: overlap, 0 to below 1, at the plain; with several heights the side overlap is
    that of the mean height.
    observations_per_image: tie observations, on average over the images. Points are drawn evenly
    over the ground and kept or dropped as a whole, so that each is seen in every image that
    contains it and multiplicity stays what the overlap makes it (thesis, section 5.6.4).
    relief: crest of the dike above the plain, metres (see Dike); level: height of the plain.
    gnss: antenna positions at the exposures, C + R' lever_arm (metres, camera frame).
    control, check: ground points with marks in every image that contains them, spread along
    the corridor on alternating banks; control points take the ends.
    flights: the strips are shared out among them in order; 15 minutes lie between two.
    long_side: of the picture, `across` the flight (rows follow each other along it) or `along`.
    turned: the drone turns round at the end of each strip; else it keeps its heading.
    azimuth_deg: of the corridor, clockwise from north (y).
    interval_s: between two exposures in calm air; wind (m/s, with the first strip) makes strips
    faster and slower. velocity_jitter (m/s) and angular_rate_deg_s are sigmas of each axis.
    attitude_jitter_deg, position_jitter: sigmas of each axis of a pose, degrees and metres.
    start_error: sigmas (metres, radians, metres) by which the start values of centres, rotations
    and points miss the truth; drawn from a stream of their own, the block is the same without.

    Returns a Block whose start values are the truth (but for start_error), with flight, strip,
    time, temperature (warming up from 20 C), velocity and angular rate of every image. Same
    arguments, same block. Raises InputError for a flight that cannot be.
    """
    heights = _checked(
        images, strips, height, forward, side, observations_per_image, interval_s, flights,
        long_side, control, check,
    )  # fmt: skip
    draw = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(6)]
    ground = Dike(relief, level, seed)

    # Half the ground width of a picture, per metre of height, along and across the flight.
    border = undistort(_frame(camera), camera.interior)
    if not np.isfinite(border).all():
        raise InputError(
            f"camera {camera.name}: its distortion folds inside the picture, nothing can be "
            "projected there: check its coefficients"
        )
    spread = np.abs(border).max(axis=0)[:: -1 if long_side == "across" else 1]
    width = np.ptp(border, axis=0)[:: -1 if long_side == "across" else 1]

    share = 1 / heights
    per_strip = _share_out(images, share)
    base = (1 - forward) * width[0] * heights
    length = float(np.max((per_strip - 1) * base))
    spacing = (1 - side) * width[1] * heights.mean()
    offset = (np.arange(strips) - (strips - 1) / 2) * spacing

    # --- the flight, in corridor coordinates: along, to the right, up
    strip = np.repeat(np.arange(strips), per_strip)
    number = np.concatenate([np.arange(n) for n in per_strip])
    back = strip % 2 == 1
    step = np.where(per_strip > 1, length / np.maximum(per_strip - 1, 1), 0.0)
    along = np.where(back, length - number * step[strip], number * step[strip])
    ahead = np.where(back, -1.0, 1.0)
    calm = base.mean() / interval_s
    if abs(wind) >= calm:
        raise InputError(
            f"a wind of {wind:g} m/s stops a drone that flies {calm:.2f} m/s: lower wind or "
            "interval_s"
        )
    speed = calm + wind * ahead
    flight = np.searchsorted(np.cumsum(_share_out(strips, np.ones(flights))), strip, side="right")
    gap = np.where(number == 0, turn_s, step[strip] / speed)
    gap[0] = 0.0
    gap[1:][np.diff(flight) > 0] = 900.0
    time = np.round(np.cumsum(gap), 6)

    local = np.column_stack([along, offset[strip], heights[strip]])
    local = local + position_jitter * draw[0].standard_normal((images, 3))
    frame = _corridor_frame(azimuth_deg)  # columns: along, right, up in the world
    centre = local @ frame.T + [0.0, 0.0, level]
    heading = np.where(back & turned, -1.0, 1.0)
    rotation = _nadir(frame, heading, long_side)
    tilt = np.radians(attitude_jitter_deg) * draw[1].standard_normal((images, 3))
    quaternion = quaternion_from_rotation(rotation_from_vector(tilt) @ rotation)
    # Through the quaternion, so that the projection sees the very rotation that is stored.
    rotation = rotation_from_quaternion(quaternion)
    arm = np.asarray(lever_arm, dtype=float)
    antenna = centre + arm @ rotation
    velocity = (ahead * speed)[:, None] * frame[:, 0]
    velocity = velocity + velocity_jitter * draw[2].standard_normal((images, 3))
    rate = np.radians(angular_rate_deg_s) * draw[2].standard_normal((images, 3))

    flight_name = np.array([f"F{k + 1}" for k in range(flights)])[flight]
    digits = max(4, len(str(images)))
    image_name = pd.Index(
        [f"{part}_{k + 1:0{digits}d}.tif" for k, part in enumerate(flight_name.tolist())],
        dtype="str",
    )
    table = {
        "image": image_name,
        "camera": camera.name,
        "flight": flight_name.tolist(),
        "strip": (strip + 1).astype(str).tolist(),
        "time_s": time,
        # A body that warms by 9 degrees with a time constant of ten minutes after take-off.
        "temperature_c": np.round(20 + 9 * (1 - np.exp(-_since_start(time, flight) / 600)), 3),
        **dict(zip("xyz", centre.T, strict=True)),
        **dict(zip(("qw", "qx", "qy", "qz"), quaternion.T, strict=True)),
        **dict(zip(("vx", "vy", "vz"), velocity.T, strict=True)),
        **dict(zip(("wx", "wy", "wz"), rate.T, strict=True)),
    }

    # --- the ground
    slack = 4 * np.radians(attitude_jitter_deg) * (1 + (spread**2).sum() + spread[::-1])
    low = max(relief, 0.0)
    reach = (spread + slack)[None, :] * (heights + low)[:, None] + 4 * position_jitter
    order = np.lexsort((local[:, 0], strip))
    first = np.concatenate([[0], np.cumsum(per_strip)])
    network = (
        np.ascontiguousarray(local[order, 0]), order, first, np.ascontiguousarray(reach[:, 0]),
        centre, rotation, camera.interior[None], int(radials_in_use(camera.interior[None])),
        np.array([camera.width, camera.height], dtype=float),
    )  # fmt: skip

    def surface(along, across):
        position = np.column_stack([along, across, ground.height(along, across) - level])
        return position @ frame.T + [0.0, 0.0, level]

    swath = offset[-1] + reach[:, 1].max()
    box = np.array([[-reach[:, 0].max(), length + reach[:, 0].max()], [-swath, swath]])
    pictured = np.prod(width) * np.mean(heights**2)
    # Images at the rim share less ground with others and need their points more densely.
    candidates = int(np.prod(np.ptp(box, axis=1)) * observations_per_image / pictured * 2) + 100
    along, across = draw[3].uniform(box[:, 0], box[:, 1], (candidates, 2)).T
    points = surface(along, across)
    start, image = _who_sees(points, along, *network)
    turn, target = draw[3].permutation(candidates), float(observations_per_image)
    keep = _thin(start, image, turn, images, target)
    # The last point of an image overshoots; a second pass meets the number on average.
    mean = np.diff(start)[keep].sum() / images
    if mean > target:
        keep = _thin(start, image, turn, images, target * target / mean)
    kept = np.flatnonzero(keep)
    del image
    points, along = points[kept], along[kept]
    start, image = _who_sees(points, along, *network)
    # Numbered as they appear in the flight, as a matcher does.
    by_image = np.argsort(image[start[:-1]], kind="stable") if len(kept) else kept
    points, along = points[by_image], along[by_image]
    start, image = _who_sees(points, along, *network)
    point_name = _names("T", len(points))

    station = np.linspace(0.04, 0.96, control + check) * length if control + check > 1 else length
    bank = 0.3 * width[1] * heights.min() * np.where(np.arange(control + check) % 2, -1, 1)
    station = np.broadcast_to(station, control + check) * 1.0
    bank = bank * draw[4].uniform(0.85, 1.0, control + check)
    station = station + draw[4].uniform(-0.02, 0.02, control + check) * length
    marked = surface(station, bank)
    mark_start, mark_image = _who_sees(marked, station, *network)
    role = np.full(control + check, "check", dtype=object)
    if control:
        role[np.round(np.linspace(0, control + check - 1, control)).astype(int)] = "control"
    mark_name = _names("G", control + check, digits=2)

    block = Block(
        name=name,
        cameras={camera.name: camera},
        images=pd.DataFrame(table),
        tie_points=_observations(point_name, image_name, points, start, image, network),
        points=pd.DataFrame({"point": point_name, **_xyz(points)}),
        marks=_observations(mark_name, image_name, marked, mark_start, mark_image, network),
        ground=pd.DataFrame(
            {
                "point": mark_name,
                **_xyz(marked),
                "role": role.tolist(),
            }
        ),
        gnss=pd.DataFrame({"image": image_name, **_xyz(antenna)})[: images if gnss else 0],
        lever_arm={"default": tuple(arm.tolist())} if gnss else {},
        description=f"{strips} nadir strips along a straight dike, free of error",
    )
    return _miss(block, start_error, draw[5]) if start_error else block


def _checked(
    images, strips, height, forward, side, observations, interval, flights, long_side, control,
    check,
):  # fmt: skip
    heights = np.atleast_1d(np.asarray(height, dtype=float))
    if strips < 1 or images < 2 * strips:
        raise InputError(f"{images} images cannot fly {strips} strips: at least 2 images a strip")
    if images > _MOST_IMAGES:
        raise InputError(f"{images} images are more than {_MOST_IMAGES}: fly a shorter corridor")
    if heights.size not in (1, strips) or not np.all(heights > 0):
        raise InputError(
            f"height = {height!r} is not one positive number, or one for each of {strips} strips"
        )
    for key, value in (("forward", forward), ("side", side)):
        if not 0 <= value < 1:
            raise InputError(f"an overlap {key} = {value:g} cannot be flown: give 0 to below 1")
    if forward < 0.5 and strips == 1:
        raise InputError(
            f"one strip with forward = {forward:g} sees no point twice: give 0.5 or more"
        )
    if observations < 1:
        raise InputError(f"observations_per_image = {observations} is not positive")
    if interval <= 0:
        raise InputError(f"interval_s = {interval:g} is not positive: give seconds")
    if not 1 <= flights <= strips:
        raise InputError(f"{strips} strips cannot be shared out among {flights} flights")
    if long_side not in ("across", "along"):
        raise InputError(f"long_side = {long_side!r} is neither 'across' nor 'along'")
    if control < 0 or check < 0:
        raise InputError("control and check are numbers of points: give 0 or more")
    return np.broadcast_to(heights, strips).copy()


def _share_out(count: int, share: np.ndarray) -> np.ndarray:
    """Whole numbers (n,) that add up to count, as near to the shares as can be, at least 1."""
    ideal = np.cumsum(share / share.sum() * count)
    return np.diff(np.concatenate([[0], np.round(ideal + 1e-9)])).astype(int)


def _since_start(time: np.ndarray, flight: np.ndarray) -> np.ndarray:
    return time - time[np.searchsorted(flight, flight)]


def _frame(camera: Camera, count: int = 9) -> np.ndarray:
    """Pixels around the border of the picture."""
    x, y = np.linspace(0, camera.width - 1, count), np.linspace(0, camera.height - 1, count)
    sides = [(x, x * 0), (x, x * 0 + y[-1]), (y * 0, y), (y * 0 + x[-1], y)]
    return np.concatenate([np.column_stack(side) for side in sides])


def _corridor_frame(azimuth_deg: float) -> np.ndarray:
    sine, cosine = np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))
    # Along, right, up is left-handed: good for positions, never used as a rotation.
    return np.array([[sine, cosine, 0.0], [cosine, -sine, 0.0], [0.0, 0.0, 1.0]])


def _nadir(frame: np.ndarray, heading: np.ndarray, long_side: str) -> np.ndarray:
    """World to camera (n, 3, 3) looking down, picture's top or right towards the heading."""
    ahead = heading[:, None] * frame[:, 0]
    right = heading[:, None] * frame[:, 1]
    down = np.broadcast_to([0.0, 0.0, -1.0], ahead.shape)
    axes = (right, -ahead, down) if long_side == "across" else (ahead, right, down)
    return np.stack(axes, axis=1)


def _names(letter: str, count: int, digits: int = 6) -> list[str]:
    digits = max(digits, len(str(count)))
    return [f"{letter}{k:0{digits}d}" for k in range(1, count + 1)]


def _xyz(points: np.ndarray) -> dict:
    return {axis: np.ascontiguousarray(points[:, k]) for k, axis in enumerate("xyz")}


def _observations(names, images, points, start, image, network) -> pd.DataFrame:
    """Rows of tie_points or marks; names: of points, images: pandas index of image names."""
    centre, rotation, interior, radials = network[4:8]
    point = np.repeat(np.arange(len(points), dtype=np.int32), np.diff(start))
    x, y = _project(points, point, image, centre, rotation, interior, radials)
    return pd.DataFrame(
        {
            "point": pd.Categorical.from_codes(point, categories=pd.Index(names, dtype="str")),
            "image": pd.Categorical.from_codes(image, categories=images),
            "x": x,
            "y": y,
        }
    )


def _miss(block: Block, start_error: tuple[float, float, float], rng) -> Block:
    """The block with start values that miss the truth."""
    metres, radians, ground = start_error
    count = len(block.images)
    rotation = rotation_from_quaternion(block.images[["qw", "qx", "qy", "qz"]].to_numpy())
    turn = rotation_from_vector(radians * rng.standard_normal((count, 3)))
    quaternion = quaternion_from_rotation(turn @ rotation)
    centre = block.images[["x", "y", "z"]].to_numpy() + metres * rng.standard_normal((count, 3))
    block.images = block.images.assign(
        **_xyz(centre), **dict(zip(("qw", "qx", "qy", "qz"), quaternion.T, strict=True))
    )
    points = block.points[["x", "y", "z"]].to_numpy()
    block.points = block.points.assign(**_xyz(points + ground * rng.standard_normal(points.shape)))
    return block


@njit(cache=True)
def _inside(point, centre, rotation, c, radials, size):
    d0, d1, d2 = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    depth = rotation[2, 0] * d0 + rotation[2, 1] * d1 + rotation[2, 2] * d2
    if depth <= 0.0:
        return False
    u = (rotation[0, 0] * d0 + rotation[0, 1] * d1 + rotation[0, 2] * d2) / depth
    v = (rotation[1, 0] * d0 + rotation[1, 1] * d1 + rotation[1, 2] * d2) / depth
    x, y, xu, xv, yu, yv = distort(u, v, c, np.uint64(0), radials)
    # Beyond the fold of the distortion a far point would seem to lie inside.
    if xu * yv - xv * yu <= 0.0:
        return False
    return (
        _BORDER_PX <= x <= size[0] - 1 - _BORDER_PX and _BORDER_PX <= y <= size[1] - 1 - _BORDER_PX
    )


@njit(cache=True)
def _visit(points, along, fill, start, image, ahead, order, first, reach, centre, rotation, c,
           radials, size):  # fmt: skip
    for p in range(points.shape[0]):
        n = start[p] if fill else 0
        for s in range(first.shape[0] - 1):
            lo, hi = first[s], first[s + 1]
            k = lo + np.searchsorted(ahead[lo:hi], along[p] - reach[s])
            while k < hi and ahead[k] <= along[p] + reach[s]:
                i = order[k]
                if _inside(points[p], centre[i], rotation[i], c, radials, size):
                    if fill:
                        image[n] = i
                    n += 1
                k += 1
        if fill:
            image[start[p] : n].sort()
        else:
            start[p + 1] = n


def _who_sees(points, along, *network):
    """Images that see each point: image[start[p]:start[p + 1]], ascending."""
    start = np.zeros(len(points) + 1, dtype=np.int64)
    nothing = np.empty(0, dtype=np.int32)
    _visit(points, along, False, start, nothing, *network)
    start = np.cumsum(start)
    image = np.empty(start[-1], dtype=np.int32)
    _visit(points, along, True, start, image, *network)
    return start, image


@njit(cache=True)
def _thin(start, image, turn, images, target):
    """Points to keep: as long as the images that see one still want more, taken together."""
    count = np.zeros(images, dtype=np.int64)
    keep = np.zeros(len(turn), dtype=np.bool_)
    for p in turn:
        rays = start[p + 1] - start[p]
        if rays < 2:
            continue
        wanted = 0.0
        for n in range(start[p], start[p + 1]):
            wanted += target - count[image[n]]
        if wanted <= 0:
            continue
        keep[p] = True
        for n in range(start[p], start[p + 1]):
            count[image[n]] += 1
    return keep


@njit(cache=True)
def _project(points, point, image, centre, rotation, c, radials):
    x = np.empty(len(point))
    y = np.empty(len(point))
    for n in range(len(point)):
        p, i = point[n], image[n]
        d0 = points[p, 0] - centre[i, 0]
        d1 = points[p, 1] - centre[i, 1]
        d2 = points[p, 2] - centre[i, 2]
        r = rotation[i]
        depth = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
        u = (r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2) / depth
        v = (r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2) / depth
        x[n], y[n], _, _, _, _ = distort(u, v, c, np.uint64(0), radials)
    return x, y
