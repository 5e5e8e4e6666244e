"""For tests of programs that take blocks: blocks by lot, and changes that must change nothing else.

`blocks` is a strategy of Hypothesis, as xarray has them of its arrays: small flights of any shape,
with noise, that can be adjusted. The functions below are changes of which it is known what an
adjustment (or any other verb) must make of them: rows in another order, other names, another
origin, a turn, a mirror, another unit, another clock, other sigmas.

from hypothesis import given
from corridor.testing import blocks, turned

@given(blocks())
def test_of_mine(block): ...
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.block import LAYOUTS, Block
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.simulation import (
    CAMLIGHT,
    Flight,
    Ground,
    Plan,
    Terrain,
    TiePoints,
    add_noise,
    perfect_block,
)

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

_PLACES = ("images", "points", "ground", "gnss", "track")
_TIMES = ("images", "rates", "track")
_MIRROR = np.diag([-1.0, 1.0, 1.0])
_POSE = ("qw", "qx", "qy", "qz")


def blocks(most_images: int = 18, noise: bool = True) -> SearchStrategy[Block]:
    """Blocks of two to four strips, 9 images or more, with GNSS and five control points.

    Height 30 to 120 m, overlaps 70 to 85 and 50 to 70 per cent, any direction, one flight or two,
    heading kept or turned, terrain of some metres. noise: of measurements, by the sigmas of the
    block; without, all is true. Sigmas are alike in x and y, so that a block can be turned.
    Raises ModuleNotFoundError without hypothesis.
    """
    from hypothesis import strategies as st

    @st.composite
    def made(draw):
        strips = draw(st.integers(2, 4), "strips")
        images = draw(st.integers(max(9, 3 * strips), max(most_images, 3 * strips)), "images")
        flights = draw(st.integers(1, 2), "flights")
        height = draw(st.sampled_from([30.0, 50.0, 80.0, 120.0]), "height")
        forward = draw(st.sampled_from([0.7, 0.8, 0.85]), "forward overlap")
        side = draw(st.sampled_from([0.5, 0.6, 0.7]), "side overlap")
        azimuth = draw(st.sampled_from([0.0, 33.0, 90.0, 200.0]), "azimuth")
        heading = draw(st.sampled_from(["kept", "turned"]), "heading")
        seed = draw(st.integers(0, 2**16), "seed")
        block = perfect_block(
            _plan(images, strips, flights, height, forward, side, azimuth, heading), seed
        )
        if not noise:
            return block
        return add_noise(
            block, tie_px=0.5, mark_px=0.3, gnss_m=(0.02, 0.02, 0.04), control_m=0.01, seed=seed
        )

    return made()


def _plan(images, strips, flights, height, forward, side, azimuth, heading) -> Plan:
    across = height / CAMLIGHT["f"] * np.array([CAMLIGHT.width, CAMLIGHT.height])
    each = -(-images // strips)
    length = (each - 1) * (1 - forward) * across[1]
    turn = np.radians(azimuth)
    offsets = (np.arange(strips) - (strips - 1) / 2) * (1 - side) * across[0]
    parts = np.array_split(np.arange(strips), flights)
    return Plan(
        name="by lot",
        flights=tuple(
            Flight(
                name=f"F{k}", camera=CAMLIGHT.name, strips=len(part),
                height_m=(height,) * len(part), offsets_m=tuple(offsets[part].tolist()),
                images=each * len(part), forward=forward, side=side, heading=heading,
                long_side="across",
            )
            for k, part in enumerate(parts, 1)
        ),
        axis_m=((0.0, 0.0), (float(length * np.sin(turn)), float(length * np.cos(turn)))),
        terrain=Terrain(3.0, 0.0),
        tie_points=TiePoints(60),
        ground=Ground(5, 3),
        gnss=True,
        cameras={CAMLIGHT.name: CAMLIGHT},
    )  # fmt: skip


# --- what means nothing -------------------------------------------------------------------------


def shuffled(block: Block, seed: int = 0) -> Block:
    """The rows of every table in another order."""
    random = np.random.default_rng(seed)
    tables = {
        table: getattr(block, table).iloc[random.permutation(len(getattr(block, table)))]
        for table in LAYOUTS
    }
    return _made(block, **{name: frame.reset_index(drop=True) for name, frame in tables.items()})


def renamed(block: Block, seed: int = 0) -> tuple[Block, dict[str, str]]:
    """Images and points with names in another order; old name -> new name."""
    random = np.random.default_rng(seed)
    names = {}
    points = pd.unique(
        pd.concat(
            [
                getattr(block, t)["point"].astype(str)
                for t in ("tie_points", "marks", "points", "ground")
            ]
        )
    )
    for letter, old in (("n", block.images["image"]), ("q", points)):
        numbers = random.permutation(len(old))
        names[letter] = {name: f"{letter} {k}" for name, k in zip(old, numbers, strict=True)}
    tables = {}
    for table in LAYOUTS:
        frame = getattr(block, table).copy()
        for column, letter in (("image", "n"), ("point", "q")):
            if column in frame:
                frame[column] = frame[column].astype(object).map(names[letter])
        tables[table] = frame
    return _made(block, **tables), {
        old: new for each in names.values() for old, new in each.items()
    }


def later(block: Block, seconds: float) -> Block:
    """All clocks ahead by so many seconds."""
    return _made(block, **{
        table: getattr(block, table).assign(time_s=block.column(table, "time_s") + seconds)
        for table in _TIMES
        if "time_s" in getattr(block, table)
    })  # fmt: skip


# --- what changes the result in a known way -----------------------------------------------------


def moved(block: Block, by: tuple[float, float, float]) -> Block:
    """Everything moved by x, y, z, m: positions move, sigmas stay."""
    return _placed(block, lambda xyz: xyz + np.asarray(by, dtype=float))


def turned(block: Block, degrees: float) -> Block:
    """Everything turned about the vertical, anticlockwise: so are positions; sigmas of z stay."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return _seen(block, lambda xyz: xyz @ turn.T, lambda rotation: rotation @ turn.T)


def mirrored(block: Block) -> Block:
    """The world with x for -x, and the pictures as they would have been taken in it.

    p1, b2 and the lever arm's x change their sign; rates of rotation are of a mirrored turn.
    """
    out = _seen(block, lambda xyz: xyz @ _MIRROR, lambda r: _MIRROR @ r @ _MIRROR)
    width = np.array([block.cameras[name].width for name in block.images["camera"]])
    tables = {
        table: getattr(out, table).assign(
            x=width[block.image_rows(table)] - 1.0 - block.column(table, "x")
        )
        for table in ("tie_points", "marks")
    }
    for table in ("images", "rates"):
        frame = getattr(out, table)
        if {"wx", "wy", "wz"} <= set(frame):
            tables[table] = frame.assign(wy=-frame["wy"], wz=-frame["wz"])
    other = {"right": "left", "left": "right"}
    cameras = {}
    for name, camera in block.cameras.items():
        interior = camera.interior.copy()
        interior[1] = camera.width - 1.0 - interior[1]
        interior[[3, 6]] *= -1.0
        cameras[name] = replace(
            camera,
            interior=interior,
            row_direction=other.get(camera.row_direction, camera.row_direction),
        )
    arms = {flight: (-x, y, z) for flight, (x, y, z) in block.lever_arm.items()}
    return _made(out, cameras=cameras, lever_arm=arms, **tables)


def in_units(block: Block, factor: float) -> Block:
    """Lengths in another unit, `factor` of them a metre: positions and their sigmas grow by it."""
    out = _placed(block, lambda xyz: factor * xyz)
    tables = {}
    for table in LAYOUTS:
        frame = getattr(out, table).copy()
        lengths = (
            ["sx", "sy", "sz", "vx", "vy", "vz"] if table not in ("tie_points", "marks") else []
        )
        for name in frame.columns.intersection(lengths):
            frame[name] = factor * frame[name]
        tables[table] = frame
    sigma = {
        key: value if key.endswith("_px") else factor * np.asarray(value)
        for key, value in block.sigma.items()
    }
    arms = {flight: tuple(factor * np.array(arm)) for flight, arm in block.lever_arm.items()}
    return _made(out, sigma=sigma, lever_arm=arms, **tables)


def with_sigmas(block: Block, factor: float) -> Block:
    """All stated sigmas times `factor`: sigma naught is divided by it, all else stays.

    Sigmas of results are those a posteriori, so that only the ratios of the stated ones count.
    """
    tables = {}
    for table in LAYOUTS:
        frame = getattr(block, table).copy()
        for name in frame.columns.intersection(["sx", "sy", "sz", "sigma"]):
            frame[name] = factor * frame[name]
        tables[table] = frame
    sigma = {key: factor * np.asarray(value) for key, value in block.sigma.items()}
    return _made(block, sigma=sigma, **tables)


# --- building blocks ----------------------------------------------------------------------------


def _made(block: Block, **changes) -> Block:
    """The block with other tables, not from a folder."""
    kept = {table: getattr(block, table) for table in LAYOUTS}
    fields = ("name", "cameras", "sigma", "lever_arm", "lever_arm_fixed", "offset", "crs", "extra")
    kept |= {name: getattr(block, name) for name in fields}
    return Block(**(kept | changes))


def _placed(block: Block, place) -> Block:
    """The block with what `place` makes of the positions (n, 3) in every table."""
    tables = {}
    for table in _PLACES:
        frame = getattr(block, table)
        if {"x", "y", "z"} <= set(frame):
            xyz = place(block.numbers(table, "x", "y", "z"))
            tables[table] = frame.assign(x=xyz[:, 0], y=xyz[:, 1], z=xyz[:, 2])
    return _made(block, **tables)


def _seen(block: Block, place, look) -> Block:
    """The same, with velocities, and with what `look` makes of the rotations (n, 3, 3)."""
    out = _placed(block, place)
    tables = {}
    for table in ("images", "track"):
        frame = getattr(out, table)
        if {"vx", "vy", "vz"} <= set(frame):
            v = place(block.numbers(table, "vx", "vy", "vz"))
            frame = frame.assign(vx=v[:, 0], vy=v[:, 1], vz=v[:, 2])
        if set(_POSE) <= set(frame):
            rotation = look(rotation_from_quaternion(block.numbers(table, *_POSE)))
            pose = quaternion_from_rotation(rotation)
            frame = frame.assign(**dict(zip(_POSE, pose.T, strict=True)))
        tables[table] = frame
    return _made(out, **tables)
