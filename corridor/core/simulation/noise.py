"""Random errors of the measurements of a block."""

from collections.abc import Sequence

import numpy as np

from corridor.core.block import RHO, Block, along_axes, independent, level_axes
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.core.gnss import SlowNoise
from corridor.core.options import options
from corridor.core.simulation.plan import Noise

_OUTLIER_PX = (5.0, 50.0)


@options(noise=Noise)
def add_noise(block: Block, noise: Noise, seed: int = 0) -> Block:
    """A copy of the block with Gaussian errors on its measurements.

    tie_px, mark_px: standard deviation of an image coordinate, pixels.
    attitude_deg: of a turn about the heading, the horizontal to its right and the vertical,
    degrees, one number or three.
    gnss_m, control_m: of an antenna position and of a surveyed ground point (control and check
    points alike), metres, one number or three (x, y, z). distance_m: of a distance, metres.
    outliers: share of the tie observations that are moved by 5 to 50 px in any direction on top;
    an outlier stays inside its picture.
    rounding_px: step to which all image coordinates are rounded in the end, pixels.
    image_rho: correlation of x and y of an image point; gnss_rho, control_rho: of x and y, x and z,
    y and z of an antenna position and of a ground point. The tables get them as rho_xy, rho_xz,
    rho_yz; without, errors have the correlations that a table has.
    gnss_slow: share of the antenna's variance that is exponentially correlated in time, with the
    time constant gnss_slow_s, seconds; each flight on its own.
    noise: a `Noise` in place of these.
    The default sigmas of the block become the ones drawn, wherever those are not zero.
    Each kind of measurement has its own stream of the seed: adding one does not change another.
    Raises InputError for negative sigmas and a share outside 0 to 1, as `Noise` does.
    """
    gnss = np.broadcast_to(np.asarray(noise.gnss_m, dtype=float), 3)
    control = np.broadcast_to(np.asarray(noise.control_m, dtype=float), 3)
    attitude = np.broadcast_to(np.asarray(noise.attitude_deg, dtype=float), 3)
    block = block.copy()
    for table, names, rho in (
        ("tie_points", RHO[:1], noise.image_rho),
        ("marks", RHO[:1], noise.image_rho),
        ("gnss", RHO, noise.gnss_rho),
        ("ground", RHO, noise.control_rho),
    ):
        if np.any(rho):
            shape = len(getattr(block, table)), len(names)
            block.put(table, names, np.broadcast_to(np.asarray(rho, float), shape))
    draw = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(8)]

    def shake(table: str, columns: Sequence[str], sigma: float | np.ndarray, rng) -> None:
        if len(getattr(block, table)):
            values = block.numbers(table, *columns)
            drawn = correlated(table, rng.standard_normal(values.shape))
            block.put(table, columns, values + sigma * drawn)

    def correlated(table: str, drawn: np.ndarray) -> np.ndarray:
        rho = block.correlation(table) if drawn.shape[1] > 1 else np.zeros(0)
        if not rho.any():
            return drawn
        turn, left = independent(np.ones(drawn.shape), rho)
        return along_axes(turn, left * drawn)

    shake("tie_points", "xy", noise.tie_px, draw[0])
    shake("marks", "xy", noise.mark_px, draw[1])
    shake("gnss", "xyz", np.sqrt(1 - noise.gnss_slow) * gnss, draw[2])
    if noise.gnss_slow and len(block.gnss):
        slow = correlated("gnss", _slow(block, noise.gnss_slow_s, draw[5]))
        slow *= np.sqrt(noise.gnss_slow) * gnss
        block.put("gnss", "xyz", block.numbers("gnss", *"xyz") + slow)
    shake("ground", "xyz", control, draw[3])
    if noise.distance_m and len(block.distances):
        shake("distances", ("distance",), noise.distance_m, draw[7])
        block.put("distances", ("sigma",), np.full((len(block.distances), 1), noise.distance_m))
    if len(block.attitudes) and attitude.any():
        turned = block.attitude_rotations
        level = np.radians(attitude) * draw[6].standard_normal((len(turned), 3))
        turn = np.einsum("nij,nkj,nk->ni", turned, level_axes(turned), level)
        block.put_attitudes(rotation_from_vector(-turn) @ turned)
    if noise.outliers:
        _displace(block, noise.outliers, draw[4])
    if noise.rounding_px:
        for table in ("tie_points", "marks"):
            steps = np.round(block.numbers(table, "x", "y") / noise.rounding_px)
            block.put(table, "xy", steps * noise.rounding_px)

    block.sigma = dict(block.sigma)
    for key, sigma in (("tie_px", noise.tie_px), ("mark_px", noise.mark_px)):
        if sigma > 0:
            block.sigma[key] = float(sigma)
    for key, three in (("gnss_m", gnss), ("control_m", control), ("attitude_deg", attitude)):
        if np.all(three > 0) and (key != "attitude_deg" or len(block.attitudes)):
            block.sigma[key] = three.copy()
    return block


def _slow(block: Block, constant_s: float, rng: np.random.Generator) -> np.ndarray:
    """Unit Gauss-Markov noise (n, 3) at the times of the antenna positions."""
    rows = block.image_rows("gnss")
    time, flight = block.column("images", "time_s")[rows], block.image_flight[rows]
    if np.isnan(time).any():
        raise InputError("gnss_slow needs times: fill time_s of images.csv, or leave it at 0")
    return SlowNoise(constant_s).draw(time, rng, 3, flight)


def _displace(block: Block, share: float, rng: np.random.Generator) -> None:
    count = len(block.tie_points)
    rows = np.sort(rng.choice(count, round(share * count), replace=False))
    length = rng.uniform(*_OUTLIER_PX, len(rows))
    angle = rng.uniform(0, 2 * np.pi, len(rows))
    name = block.tie_points["image"].iloc[rows].astype(str)
    camera = block.images.set_index("image")["camera"].loc[name]
    limit = {key: (value.width - 1, value.height - 1) for key, value in block.cameras.items()}
    limits = np.array([limit[key] for key in camera], dtype=float).reshape(-1, 2)
    values = block.numbers("tie_points", "x", "y")
    moved = values[rows] + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    values[rows] = np.clip(moved, 0.0, limits)
    block.put("tie_points", "xy", values)
