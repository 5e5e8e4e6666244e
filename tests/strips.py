"""A plain flight in one call: parallel nadir strips along a straight dike."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from corridor.block import Block
from corridor.camera import Camera
from corridor.errors import InputError
from corridor.simulation import CAMLIGHT
from corridor.simulation.fly import MOST_IMAGES, ground_width, share_out
from corridor.simulation.plan import Flight, Ground, Plan, Start, Terrain, TiePoints
from corridor.simulation.simulate import perfect_block, simulate


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

    A `Plan` whose flights share the strips out in order; see `Flight` for what the arguments of
    the same names mean.

    images: of all strips together; a strip gets its share so that all have one length.
    height: of the camera above the plain, metres, one number or one a strip.
    azimuth_deg: of the corridor, clockwise from north (y).
    start_error: sigmas (metres, radians, metres) by which the start values of centres, rotations
    and points miss the truth; the measurements are the same without.

    Returns a Block whose start values are the truth (but for start_error). Same arguments, same
    block. Raises InputError for a flight that cannot be.
    """
    if strips < 1 or images < 2 * strips:
        raise InputError(f"{images} images cannot fly {strips} strips: at least 2 images a strip")
    if images > MOST_IMAGES:
        raise InputError(f"{images} images are more than {MOST_IMAGES}: fly a shorter corridor")
    if not 1 <= flights <= strips:
        raise InputError(f"{strips} strips cannot be shared out among {flights} flights")
    heights = np.atleast_1d(np.asarray(height, dtype=float))
    if heights.size not in (1, strips) or not np.all(heights > 0):
        raise InputError(
            f"height = {height!r} is not one positive number, or one for each of {strips} strips"
        )
    heights = np.broadcast_to(heights, strips)
    # Checks the overlaps before they divide anything.
    one = Flight(
        name="F1", camera=camera.name, strips=strips, height_m=tuple(heights), forward=forward,
        side=side, images=images, interval_s=interval_s, long_side=long_side,
        heading="turned" if turned else "kept", turn_s=turn_s, wind_m_s=wind,
        attitude_jitter_deg=attitude_jitter_deg, position_jitter_m=position_jitter,
        velocity_jitter_m_s=velocity_jitter, angular_rate_deg_s=angular_rate_deg_s,
        lever_arm_m=tuple(lever_arm),
    )  # fmt: skip
    width = ground_width(camera, long_side)
    base = (1 - forward) * width[0] * heights
    count = share_out(images, 1 / heights)
    length = float(np.max((count - 1) * base))
    offset = (np.arange(strips) - (strips - 1) / 2) * (1 - side) * width[1] * heights.mean()
    parts = np.split(np.arange(strips), np.cumsum(share_out(strips, np.ones(flights)))[:-1])
    direction = np.radians(azimuth_deg)
    end = length * np.array([np.sin(direction), np.cos(direction)])
    plan = Plan(
        name=name,
        flights=tuple(
            replace(
                one,
                name=f"F{k + 1}",
                strips=len(part),
                height_m=tuple(heights[part]),
                offsets_m=tuple(offset[part]),
                images=int(count[part].sum()),
            )
            for k, part in enumerate(parts)
        ),
        axis_m=((0.0, 0.0), tuple(end.tolist())),
        terrain=Terrain(relief, level),
        tie_points=TiePoints(observations_per_image),
        ground=Ground(control, check),
        gnss=gnss,
        cameras={camera.name: camera},
        description=f"{strips} nadir strips along a straight dike, free of error",
    )
    if start_error is None:
        return perfect_block(plan, seed)
    metres, radians, ground = start_error
    block = simulate(
        plan, seed=seed, start=Start(metres, float(np.degrees(radians)), ground)
    ).copy()
    block.lever_arm = {f.name: f.lever_arm_m for f in plan.flights} if gnss else {}
    return block
