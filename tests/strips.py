"""A plain flight in one call: parallel nadir strips along a straight dike."""

from dataclasses import replace

import numpy as np

from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.core.simulation import CAMLIGHT
from corridor.core.simulation.fly import MOST_IMAGES, ground_width, share_out
from corridor.core.simulation.plan import Flight, Ground, Plan, Start, Terrain, TiePoints
from corridor.core.simulation.simulating import perfect_block, simulate

# What a test may say of the flight, by the field of `Flight` that it is.
_FLIGHT = {
    "height": "height_m", "wind": "wind_m_s", "position_jitter": "position_jitter_m",
    "velocity_jitter": "velocity_jitter_m_s", "lever_arm": "lever_arm_m",
} | {
    name: name for name in (
        "forward", "side", "interval_s", "long_side", "turn_s", "attitude_jitter_deg",
        "angular_rate_deg_s", "heading",
    )
}  # fmt: skip


def corridor_block(
    images: int = 42,
    strips: int = 3,
    seed: int = 0,
    *,
    flights: int = 1,
    camera: Camera = CAMLIGHT,
    gnss: bool = True,
    start_error: tuple[float, float, float] | None = None,
    **options,
) -> Block:
    """Error-free block of parallel nadir strips along a straight dike.

    images: of all strips together; a strip gets its share so that all have one length.
    flights: share the strips out in order.
    start_error: sigmas (metres, radians, metres) by which the start values of centres, rotations
    and points miss the truth; the measurements are the same without.
    options: of the `Flight` (`_FLIGHT`; height: one number or one a strip; turned: its heading);
    azimuth_deg of the corridor, clockwise from north; relief, level of the ground;
    observations_per_image; control, check; name.

    Returns a Block whose start values are the truth (but for start_error). Same arguments, same
    block. Raises InputError for a flight that cannot be.
    """
    if strips < 1 or images < 2 * strips:
        raise InputError(f"{images} images cannot fly {strips} strips: at least 2 images a strip")
    if images > MOST_IMAGES:
        raise InputError(f"{images} images are more than {MOST_IMAGES}: fly a shorter corridor")
    if not 1 <= flights <= strips:
        raise InputError(f"{strips} strips cannot be shared out among {flights} flights")
    plan = _plan(images, strips, flights, camera, gnss, options)
    if start_error is None:
        return perfect_block(plan, seed)
    metres, radians, ground = start_error
    start = Start(metres, float(np.degrees(radians)), ground)
    block = simulate(plan, seed=seed, start=start).copy()
    block.lever_arm = {f.name: f.lever_arm_m for f in plan.flights} if gnss else {}
    return block


def _plan(
    images: int, strips: int, flights: int, camera: Camera, gnss: bool, options: dict
) -> Plan:
    said = {"height": 50.0, "forward": 0.8, "side": 0.6, "interval_s": 2.5, "wind": 0.3} | options
    if "turned" in said:
        said["heading"] = "turned" if said.pop("turned") else "kept"
    flown = {_FLIGHT[name]: said.pop(name) for name in list(said) if name in _FLIGHT}
    heights = np.atleast_1d(np.asarray(flown["height_m"], dtype=float))
    if heights.size not in (1, strips) or not np.all(heights > 0):
        raise InputError(
            f"height = {flown['height_m']!r} is not one positive number, or one for each of "
            f"{strips} strips"
        )
    heights = np.broadcast_to(heights, strips)
    flown["height_m"] = tuple(heights)
    if "lever_arm_m" in flown:
        flown["lever_arm_m"] = tuple(flown["lever_arm_m"])
    # Checks the overlaps before they divide anything.
    one = Flight(name="F1", camera=camera.name, strips=strips, images=images, **flown)
    width = ground_width(camera, one.long_side)
    count = share_out(images, 1 / heights)
    length = float(np.max((count - 1) * (1 - one.forward) * width[0] * heights))
    offset = (np.arange(strips) - (strips - 1) / 2) * (1 - one.side) * width[1] * heights.mean()
    parts = np.split(np.arange(strips), np.cumsum(share_out(strips, np.ones(flights)))[:-1])
    direction = np.radians(said.pop("azimuth_deg", 90.0))
    end = length * np.array([np.sin(direction), np.cos(direction)])
    made = Plan(
        name=said.pop("name", "corridor"),
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
        terrain=Terrain(said.pop("relief", 3.0), said.pop("level", 0.0)),
        tie_points=TiePoints(said.pop("observations_per_image", 440)),
        ground=Ground(said.pop("control", 5), said.pop("check", 6)),
        gnss=gnss,
        cameras={camera.name: camera},
        description=f"{strips} nadir strips along a straight dike, free of error",
    )
    if said:
        raise TypeError(f"corridor_block knows no {', '.join(said)}")
    return made
